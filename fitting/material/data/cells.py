"""The cells of a file as text, whatever wrote it: delimited text or an .xlsx workbook.

Text: UTF-8 and UTF-16 with or without byte order mark, Shift-JIS, GB 18030, EUC-KR, Windows
code pages 1250, 1251, 1252, 1254, any line ends; commas, semicolons, tabs, bars or blanks
between fields; lines that begin with #, // or % are comments. Workbooks: every sheet,
values as they were last computed.
"""

import dataclasses
import io
import itertools
import math
import os
import re
import warnings
import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path

from fitting.material.data.column_names import EASTERN_WORDS, with_latin_units, words_known
from fitting.material.data.columns import with_unit
from fitting.material.data.errors import DataError, said_of
from suas_jax.files.reading import MEGABYTE, read_bytes, split_fields

_MISSING = frozenset(
    (
        *("", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "---", "."),
        *("inf", "+inf", "-inf", "#div/0!", "#value!", "#num!", "1.#qnan", "1.#inf"),
    )
)
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?")
_PLAIN = re.compile(r"[+-]?\d{1,15}(?:\.\d{0,20})?")
_SHAPE = re.compile(r"[+-]?[\d.,]*\d[\d.,]*(?:[eEdD][+-]?\d+)?")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:[.,]\d{3})+")


def is_missing(text: str) -> bool:
    """Whether a cell is one of the usual ways to write that there is no value."""
    return text.strip().casefold() in _MISSING


def looks_numeric(text: str) -> bool:
    """Whether a cell is a number in one spelling or another."""
    return not math.isnan(number(text))


def decimal_mark(cells: Iterable[str]) -> str:
    """The decimal mark of a table, from the cells that leave no choice.

    "1,5" can only have a decimal comma, "1,234.5" only a decimal point; "1,234" alone is
    read with a decimal comma unless other cells have points.
    """
    comma = point = open_comma = 0
    for text in cells:
        bare = _bare(text)
        if not _SHAPE.fullmatch(bare):
            continue
        commas, points = bare.count(","), bare.count(".")
        if commas and points:
            comma += bare.rfind(",") > bare.rfind(".")
            point += bare.rfind(".") > bare.rfind(",")
        elif _THOUSANDS.fullmatch(bare):
            open_comma += commas == 1
            comma += points > 1
            point += commas > 1
        elif commas == 1:
            comma += 1
        elif points == 1:
            point += 1
    if comma != point:
        return "," if comma > point else "."
    return "," if open_comma and not point else "."


def number(text: str, decimal: str | None = None) -> float:
    """The number in a cell; NaN if there is none.

    `decimal`: decimal mark of its table; None takes the last mark of the cell, unless it comes
    twice.
    """
    if decimal != "," and _PLAIN.fullmatch(text):  # most cells of most files
        return float(text)
    bare = _bare(text)
    if decimal is None:
        decimal = "," if bare.rfind(",") > bare.rfind(".") else "."
        if bare.count(decimal) > 1:  # it parts thousands
            decimal = "." if decimal == "," else ","
    other = "." if decimal == "," else ","
    if other in bare:
        grouped = bare.split(decimal)[0].lstrip("+-").split(other)
        if other in bare.rpartition(decimal)[2] and decimal in bare:
            return math.nan
        thousands = all(len(part) == 3 for part in grouped[1:])
        if thousands and 1 <= len(grouped[0]) <= 3 and not grouped[0].startswith("0"):
            bare = bare.replace(other, "")
        elif decimal in bare or bare.count(other) > 1:
            return math.nan
        else:  # a column of another spelling than the rest of the table
            bare = bare.replace(other, decimal)
    bare = bare.replace(decimal, ".")
    if not _NUMBER.fullmatch(bare):
        return math.nan
    value = float(bare.replace("d", "e").replace("D", "e"))
    return value if math.isfinite(value) else math.nan


def _bare(text: str) -> str:
    text = re.sub(r"[\s\u00a0\u202f']", "", text).replace("\N{MINUS SIGN}", "-")
    return text.removesuffix("%")


_MOST_BYTES = 64 * MEGABYTE
_MOST_UNPACKED = 512 * MEGABYTE
_MOST_ROWS = 2_000_000
_DELIMITERS = {";": "semicolons", "\t": "tabs", "|": "bars", ",": "commas", " ": "blanks"}
_SAMPLED = 60
_WESTERN = 1252, 1250, 1251, 1254  # code pages of Windows, a byte a character
_OF_NAMES = 20_000  # characters in which names of columns stand
_NO_TABLES = {
    b"\xd0\xcf\x11\xe0": "a workbook of the old format .xls",
    b"%PDF": "a PDF",
    b"<html": "a web page",
    b"<!doc": "a web page",
}
_WIDE = str.maketrans("（）［］％：；，", "()[]%:;,")
_SIGNAL = re.compile(r"Sig\d+")
_OPEN = re.compile(r'(?:^|[,;\t|])\s*"[^"]*$')  # an inch's mark follows a number
_BROKEN = 40  # lines that one row may take
_FORMULA = re.compile(r'(^|[,;\t])=(?=")', re.MULTILINE)  # ="6.0", which Excel takes as text
_ERROR_CELLS = ("#n/a", "#div/0!", "#value!", "#num!")


@dataclasses.dataclass(frozen=True)
class Cells:
    """Rows of text cells."""

    name: str  # of the sheet; empty for text
    rows: list[list[str]]  # cells of each row that is not blank
    lines: list[int]  # line number of each row, from one
    comments: tuple[str, ...] = ()  # lines that are marked as comments, without their mark
    delimiter: str = ""  # what separates the fields; empty for a sheet
    encoding: str = ""  # of a text

    @property
    def format(self) -> str:
        """Encoding and separator in words."""
        if not self.delimiter:
            return f'workbook, sheet "{self.name}"'
        return f"{self.encoding}, {_DELIMITERS[self.delimiter]} between fields"


def read_cells(path: str | os.PathLike[str]) -> list[Cells]:
    """Read the cells of a file, one `Cells` a sheet; text has one.

    Raises DataError: the file is missing, binary, too large, or a broken workbook.
    """
    file = os.fspath(path)
    raw = _raw(file)
    if raw[:4] == b"PK\x03\x04":
        return _workbook(file, raw)
    for mark, what in _NO_TABLES.items():
        if raw[:512].lstrip()[: len(mark)].lower() == mark.lower():
            raise DataError(f"{file}: is {what}; save the readings as .xlsx or as CSV")
    text, encoding = _decoded(file, raw)
    return [_delimited(file, text, encoding)]


def _raw(file: str) -> bytes:
    try:
        return read_bytes(file, _MOST_BYTES)
    except FileNotFoundError:
        raise DataError(f"{file}: no such file") from None
    except IsADirectoryError:
        raise DataError(f"{file}: is a directory; name a CSV file") from None
    except OSError as error:
        raise DataError(f"{file}: can't be read: {error.strerror or error}") from None
    except ValueError as error:  # a NUL in the name
        raise DataError(f"{file!r}: can't be read: {error}") from None


def _decoded(file: str, raw: bytes) -> tuple[str, str]:
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return raw.decode("utf-16", errors="replace"), "UTF-16"
    zeros = [raw[:2000:2].count(0), raw[1:2000:2].count(0)]
    if max(zeros) > 0.4 * len(raw[:2000:2]) and min(zeros) == 0:  # mostly Latin letters
        order = "utf-16-be" if zeros[0] else "utf-16-le"
        return raw.decode(order, errors="replace"), "UTF-16"
    raw = raw.rstrip(b"\x00")  # a logger's file that was made large in advance
    if b"\x00" in raw:
        raise DataError(f"{file}: is not text; export the sheet as CSV")
    try:
        return raw.decode("utf-8-sig"), "UTF-8"
    except UnicodeDecodeError:
        return _of_one_country(raw)


def _of_one_country(raw: bytes) -> tuple[str, str]:
    """Text of a code page: the one in which a word of a test stands."""
    pages = (("cp932", "Shift-JIS"), ("gb18030", "GB 18030"), ("cp949", "EUC-KR"))
    for encoding, name in pages:
        text = raw.decode(encoding, errors="replace")
        if any(word in text for word in EASTERN_WORDS):
            return text, name

    def known(page: int) -> int:
        return words_known(raw[:_OF_NAMES].decode(f"cp{page}", errors="replace"))

    page = max(_WESTERN, key=known)
    text = raw.decode(f"cp{page}", errors="replace")
    return text, "Latin-1 (Windows 1252)" if page == 1252 else f"Windows {page}"


def _delimited(file: str, text: str, encoding: str) -> Cells:
    comments, kept, lines = [], [], []
    text = with_latin_units(_FORMULA.sub(r"\1", text))
    for number, line in _numbered_lines(text.translate(_WIDE).splitlines()):
        bare = line.strip().strip("\x1a\ufeff")
        if _is_comment(bare):
            comments.append(bare.lstrip("#%/ ").rstrip(" ,;\t"))
        elif bare.strip(',;\t|" '):
            kept.append(line.rstrip("\r\n").strip("\ufeff"))
            lines.append(number)
    delimiter = _delimiter(kept)
    # A separator declared for Excel says nothing else.
    if kept and re.fullmatch(r"sep=.", kept[0].strip()):
        kept, lines = kept[1:], lines[1:]
    rows = []
    for number, line in zip(lines, kept, strict=True):
        with said_of(f"{file}: line {number}"):
            rows.append(fields(line, delimiter))
    # TA Instruments names its columns one a line, and says where the readings start.
    signals = [" ".join(row[1:]) for row in rows if row[1:] and _SIGNAL.fullmatch(row[0])]
    rows = [signals if signals and row == ["StartOfData"] else row for row in rows]
    # LabVIEW states the channels' units in a row of their own, lines above the names.
    units = next((row[1:] for row in rows if row[0] == "Y_Unit_Label"), [])
    rows = [_with_units(row, units) if row[0] == "X_Value" else row for row in rows]
    return Cells("", rows, lines, tuple(comments), delimiter, encoding)


def _numbered_lines(lines: list[str]) -> Iterator[tuple[int, str]]:
    """Lines with their numbers; those that break within a quoted field are joined."""
    begin = 0
    while begin < len(lines):
        end, line = begin + 1, lines[begin]
        if line.count('"') % 2 and _OPEN.search(line):
            quotes = itertools.accumulate(x.count('"') for x in lines[begin : begin + _BROKEN])
            whole = (k for k, count in enumerate(quotes, 1) if count % 2 == 0)
            end = begin + next(whole, 1)
        yield begin + 1, " ".join(lines[begin:end])
        begin = end


def _with_units(names: list[str], units: list[str]) -> list[str]:
    """Names of columns with the units of all but the first."""
    return [names[0], *map(with_unit, names[1:], [*units, *[""] * len(names)])]


def _is_comment(line: str) -> bool:
    if line.startswith("%"):  # or a line of units that begins with per cent
        return re.match(r"%\s*(?:[;\t,|]|$)", line) is None
    return line.startswith(("#", "//")) and not line.casefold().startswith(_ERROR_CELLS)


def fields(line: str, delimiter: str) -> list[str]:
    """The fields of a line of text, without blanks around them.

    Raises ValueError: as `split_fields`.
    """
    if delimiter == " ":
        # Names may hold single blanks, in lines whose columns stand wider apart.
        wide = re.split(r"\s{2,}", line.strip())
        narrow = line.split()
        return wide if len(wide) > 1 and any(" " in cell for cell in wide) else narrow
    return [cell.strip() for cell in split_fields(line, delimiter)]


def _delimiter(lines: list[str]) -> str:
    """What separates fields: in most of a sample of lines it leaves numbers, or gaps."""
    tail = lines[len(lines) // 3 :] or lines
    sample = tail[:: max(1, len(tail) // _SAMPLED)] + lines[-3:]
    best, most = next((d for d in _DELIMITERS if any(d in line for line in lines)), " "), 0.0
    for delimiter in _DELIMITERS:
        share = 0.0
        for line in sample:
            if delimiter not in line.strip():
                continue
            try:
                cells = fields(line, delimiter)
            except ValueError:  # said of the line once it is read
                continue
            filled = [cell for cell in cells if not is_missing(cell)]
            numbers = sum(looks_numeric(cell) for cell in filled)
            share += numbers / len(filled) if len(cells) > 1 and filled else 0.0
        if share > most + 1e-9:
            best, most = delimiter, share
    return best


def _workbook(file: str, raw: bytes) -> list[Cells]:
    import openpyxl

    try:
        with zipfile.ZipFile(io.BytesIO(raw)) as archive:
            unpacked = sum(entry.file_size for entry in archive.infolist())
        if unpacked > _MOST_UNPACKED:
            raise DataError(
                f"{file}: the workbook unpacks to {unpacked / MEGABYTE:.0f} MB; at most "
                f"{_MOST_UNPACKED / MEGABYTE:.0f} MB are read"
            )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of styles and extensions, which are not read
            book = openpyxl.load_workbook(io.BytesIO(raw), read_only=True, data_only=True)
            sheets = [_sheet(file, sheet) for sheet in book.worksheets]
    except DataError:
        raise
    except Exception as error:  # whatever a broken archive makes the library raise
        suffix = Path(file).suffix
        if suffix.casefold() not in (".xlsx", ".xlsm"):
            raise DataError(f"{file}: is not text; export the sheet as CSV") from None
        raise DataError(
            f"{file}: the workbook can't be read ({type(error).__name__}); save it again as "
            f".xlsx or as CSV"
        ) from None
    return [sheet for sheet in sheets if sheet.rows]


def _sheet(file: str, sheet: object) -> Cells:
    rows, lines = [], []
    cells_of = sheet.iter_rows()  # type: ignore[attr-defined]
    for number, row in enumerate(cells_of, 1):
        if number > _MOST_ROWS:
            raise DataError(f"{file}: more than {_MOST_ROWS} rows; export fewer")
        texts = [_as_text(cell.value, cell.number_format) for cell in row]
        while texts and not texts[-1]:
            texts.pop()
        if texts:
            rows.append(texts)
            lines.append(number)
    title = str(sheet.title)  # type: ignore[attr-defined]
    return Cells(title, rows, lines)


def _as_text(value: object, shown_as: str | None) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "1" if value else "0"
    if isinstance(value, float | int):
        return f"{100 * value!r}%" if "%" in (shown_as or "") else repr(value)
    return with_latin_units(" ".join(str(value).translate(_WIDE).split()))
