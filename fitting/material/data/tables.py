"""Read the text that test machines write: one table of numbers, whatever the locale.

Understood: UTF-8 and UTF-16 with or without byte order mark, Windows code page 1252, any
line ends; commas, semicolons, tabs, bars or blanks between fields; decimal points or
commas; `# key: value` lines anywhere; lines of other text before the column names; a line
of units below them; empty and "NaN" cells.
"""

import csv
import dataclasses
import math
import os
import re

import numpy as np

from suas_jax.files.reading import MEGABYTE, read_bytes

_MISSING = frozenset(
    (
        *("", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "---", "."),
        *("inf", "+inf", "-inf", "#div/0!", "#value!", "#num!", "1.#qnan", "1.#inf"),
    )
)
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?")
_META = re.compile(r"^\s*([A-Za-z][\w /^-]*?)\s*[:=]\s*(.+?)\s*$")
_MOST_BYTES = 64 * MEGABYTE
_DELIMITERS = (";", "\t", "|", ",")


class DataError(ValueError):
    """A data file can't be used; the message names file, line, column and what is allowed."""


@dataclasses.dataclass(frozen=True)
class Table:
    """A table of numbers as it stands in a file.

    Attributes:
        file: the file, as the user named it.
        names: column names.
        cells: numbers, NaN where missing, shape [rows, columns].
        texts: the cells as written, for columns of words.
        lines: line number of each row in the file, from one.
        comments: the comment lines, without their mark.
        metadata: `key: value` pairs of the comments, keys in lower case with underscores.
    """

    file: str
    names: tuple[str, ...]
    cells: np.ndarray
    texts: tuple[tuple[str, ...], ...]
    lines: np.ndarray
    comments: tuple[str, ...]
    metadata: dict[str, str]


def read_table(path: str | os.PathLike[str]) -> Table:
    """Read a delimited text file of numbers.

    Args:
        path: the file.

    Raises:
        DataError: the file is missing, empty, binary, has no line of column names or a
            line that doesn't fit them, with the line and what to do.
    """
    file = os.fspath(path)
    lines = _text(file).splitlines()
    rows: list[tuple[int, str]] = []
    comments: list[str] = []
    for number, line in enumerate(lines, 1):
        bare = line.strip().strip("\x1a")
        if bare.startswith(("#", "%", "//")) and not bare.casefold().startswith(
            ("#n/a", "#div/0!", "#value!", "#num!")
        ):
            comments.append(bare.lstrip("#%/ ").rstrip(" ,;\t"))
        elif bare.strip(",;\t| "):
            rows.append((number, line.rstrip("\r\n")))
    if not rows:
        raise DataError(f"{file}: the file is empty: it holds no table")
    head, delimiter = _header(file, rows)
    preamble = [line for _, line in rows[:head]]
    names = _fields(rows[head][1], delimiter)
    while names and not names[-1]:
        names.pop()
    body = rows[head + 1 :]
    if body and _is_units(_fields(body[0][1], delimiter), len(names)):
        units = _fields(body[0][1], delimiter)
        names = [
            f"{name} [{unit.strip('()[] ')}]" if unit.strip("()[] -") else name
            for name, unit in zip(names, units, strict=False)
        ]
        body = body[1:]
    repeated = [name for name in names if name and names.count(name) > 1]
    if repeated:
        raise DataError(f'{file}: line {rows[head][0]}: column "{repeated[0]}" stands twice')
    texts = [_row(file, number, line, delimiter, len(names)) for number, line in body]
    if not texts:
        raise DataError(f"{file}: there is no row below the column names")
    cells = np.array([[_number(text) for text in row] for row in texts], dtype=float)
    metadata = {}
    for text in [*comments, *(line.replace(delimiter, ": ", 1) for line in preamble)]:
        found = _META.match(text)
        if found:
            key = re.sub(r"[^a-z0-9]+", "_", found.group(1).casefold()).strip("_")
            metadata[key] = found.group(2).strip(" ;,\t\"'")
    return Table(
        file,
        tuple(names),
        cells,
        tuple(tuple(row) for row in texts),
        np.array([number for number, _ in body]),
        tuple(comments),
        metadata,
    )


def is_missing(text: str) -> bool:
    """Whether a cell is one of the usual ways to write that there is no value."""
    return text.strip().casefold() in _MISSING


def _text(file: str) -> str:
    try:
        raw = read_bytes(file, _MOST_BYTES)
    except FileNotFoundError:
        raise DataError(f"{file}: no such file") from None
    except IsADirectoryError:
        raise DataError(f"{file}: is a directory; name a CSV file") from None
    except OSError as error:
        raise DataError(f"{file}: can't be read: {error.strerror or error}") from None
    except ValueError as error:  # a NUL in the name
        raise DataError(f"{file!r}: can't be read: {error}") from None
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return raw.decode("utf-16", errors="replace")
    if raw[:4] == b"PK\x03\x04" or b"\x00" in raw:
        raise DataError(f"{file}: is no text; export the sheet as CSV")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("cp1252", errors="replace")


def _fields(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]


def _header(file: str, rows: list[tuple[int, str]]) -> tuple[int, str]:
    """Find the line of column names, and what separates the fields."""
    for head, (number, line) in enumerate(rows):
        following = [text for _, text in rows[head + 1 : head + 3]]
        for delimiter in (*_DELIMITERS, " "):
            if delimiter not in line.strip():
                continue
            names = _fields(line, delimiter)
            wordy = [
                bool(re.search(r"[^\W\d]", n)) and _NUMBER.fullmatch(n) is None for n in names
            ]
            if sum(wordy) < 2 or not all(w or not n for w, n in zip(wordy, names, strict=True)):
                continue
            if not following:
                return head, delimiter
            if any(_numeric(_fields(text, delimiter)) for text in following):
                return head, delimiter
        if _numeric(_fields(line, _most_likely(line)), share=0.9):
            raise DataError(
                f"{file}: line {number}: numbers without a line of column names above them; "
                f"name the columns and their units, for example "
                f'"stretch_1,nominal_stress_MPa"'
            )
    first = rows[0]
    raise DataError(
        f"{file}: line {first[0]}: no line of column names followed by numbers was found; "
        f'expected columns such as "stretch_1,nominal_stress_MPa" (found {first[1][:60]!r})'
    )


def _most_likely(line: str) -> str:
    return next((d for d in _DELIMITERS if d in line), " ")


def _numeric(fields: list[str], share: float = 0.5) -> bool:
    """Whether a line looks like data: this share of its filled cells are numbers."""
    filled = [field for field in fields if not is_missing(field)]
    numbers = sum(not math.isnan(_number(field)) for field in filled)
    return numbers >= max(1.0, share * len(filled))


def _is_units(fields: list[str], width: int) -> bool:
    words = [f for f in fields if f]
    short = all(len(f) <= 14 for f in words)
    return (
        bool(words)
        and short
        and len(fields) >= width - 1
        and all(math.isnan(_number(f)) and not is_missing(f) for f in words if f != "-")
    )


def _row(file: str, number: int, line: str, delimiter: str, width: int) -> list[str]:
    fields = _fields(line, delimiter)
    while len(fields) > width and not fields[-1]:
        fields.pop()
    if len(fields) > width:
        hint = ""
        if delimiter == "," and len(fields) == 2 * width:
            hint = (
                "; decimal commas can't be told from commas between fields: put semicolons "
                "between fields, or use decimal points"
            )
        raise DataError(
            f"{file}: line {number}: {len(fields)} fields, but {width} columns are named{hint}"
        )
    return fields + [""] * (width - len(fields))


def _number(text: str) -> float:
    """The number in a cell; NaN if there is none."""
    bare = re.sub(r"[\s\u00a0\u202f']", "", text).replace("\N{MINUS SIGN}", "-")
    if "," in bare:
        if "." in bare and bare.rfind(".") > bare.rfind(","):
            bare = bare.replace(",", "")
        else:
            bare = bare.replace(".", "").replace(",", ".")
    if not _NUMBER.fullmatch(bare):
        return math.nan
    value = float(bare.replace("d", "e").replace("D", "e"))
    return value if math.isfinite(value) else math.nan
