"""Read an SO log strictly, whoever wrote it."""

import dataclasses
import operator
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from suas_jax.acquisition.log.columns import Column, log_of, number_in
from suas_jax.acquisition.log.data import (
    CONTINUED,
    FRAME_WINDOW,
    KEY_COLUMNS,
    LogFileError,
    SoLog,
)
from suas_jax.files.reading import MEGABYTE, opened, read_bytes, split_fields

# Between the fields of a row once quotes are undone: ASCII's unit separator.
_SEPARATOR = "\x1f"
MOST_BYTES = 512 * MEGABYTE
"""Size of a log, or of one part of it, that is still read; rotate longer ones."""
_LONGEST_LINE = 1_000_000


def is_log(path: Path) -> bool:
    """Whether a file begins as a log does: comments, then names with `t_host_s` among them."""
    with opened(path, MOST_BYTES) as file:
        while line := file.readline(_LONGEST_LINE):
            if line.strip() and not line.lstrip(b"\xef\xbb\xbf").startswith(b"#"):
                return b"t_host_s" in line
    return False


def read_log(path: Path, *, follow: bool = True) -> SoLog:
    """Read a log of this or another program.

    Tolerated: comment lines and blank lines anywhere, CRLF, a byte order mark, quoted
    fields, columns in another order, further columns (returned as `flags`), missing values
    (empty or `nan`) in the counts and times, the line of column names repeated where logs
    were joined, a last line that was cut off (dropped, with a note).

    Args:
        path: the log.
        follow: also read the parts that a rotated log was continued in.

    Raises:
        LogFileError: naming the file, the line, the column, the value and what is allowed.
        OSError: the file can't be read.
    """
    path = Path(path)
    parts: list[SoLog] = []
    names = {path.name}
    while True:
        part = _Parser(path).parse(read_bytes(path, MOST_BYTES))
        parts.append(part)
        successor = part.header.pop(CONTINUED, None)
        if successor is None or not follow:
            return _joined(parts)
        if Path(successor).name != successor or successor in names:
            raise LogFileError(
                f'{path}: continued_in "{successor[:80]}": a file beside it is expected, which '
                "is not an earlier part"
            )
        names.add(successor)
        path = path.with_name(successor)


def _joined(parts: Sequence[SoLog]) -> SoLog:
    first = parts[0]
    if len(parts) == 1:
        return first
    width = max(part.so.shape[1] for part in parts)

    def joined(column: Callable[[SoLog], NDArray[Any]]) -> NDArray[Any]:
        return np.concatenate([column(part) for part in parts])

    def widened(log: SoLog) -> NDArray[np.float64]:
        more = width - log.so.shape[1]
        return np.pad(log.so, ((0, 0), (0, more)), constant_values=np.nan)

    shared = [name for name in first.flags if all(name in part.flags for part in parts)]
    keys = ("t_host", "t_device", "seq", "module")
    rows: dict[str, Any] = {name: joined(operator.attrgetter(name)) for name in keys}
    return dataclasses.replace(
        first,
        **rows,
        so=joined(widened),
        flags={name: np.concatenate([part.flags[name] for part in parts]) for name in shared},
        notes=tuple(note for part in parts for note in part.notes),
    )


class _Parser:
    """One reading of one file: keeps what an error message needs."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notes: list[str] = []
        self.header: dict[str, str] = {}
        self.restated: dict[str, str] = {}

    def parse(self, data: bytes) -> SoLog:
        lines = list(self._lines(data))
        tail = lines.pop()  # empty, unless the file was cut off
        names: list[str] | None = None
        rows: list[str] = []  # with their fields told apart by _SEPARATOR
        numbers: list[int] = []
        for number, line in lines:
            if line.startswith("#"):
                self._comment(line)
            elif line.strip():
                row = self._separated(number, line)
                if names is None:
                    names = [name.strip() for name in row.split(_SEPARATOR)]
                    so = self._check_columns(number, names)
                elif row.count(_SEPARATOR) != len(names) - 1:
                    raise self._wrong_length(number, row.split(_SEPARATOR), names)
                elif not row.lstrip().startswith(names[0]):  # else they are named once more
                    rows.append(row)
                    numbers.append(number)
        if names is None:
            raise LogFileError(
                f"{self.path}: no line of column names; a log has the columns "
                f"{','.join(KEY_COLUMNS)},so_1,..."
            )
        if tail[1].strip() and not tail[1].startswith("#"):
            self._last_line(*tail, names, rows, numbers, so)
        # One flat list: a list for each row would cost several times more.
        fields = _SEPARATOR.join(rows).split(_SEPARATOR) if rows else []
        found = {
            name: Column(self.path, name, fields[k :: len(names)], numbers)
            for k, name in enumerate(names)
        }
        log = log_of(self.path, self.header, found, so, self.notes)
        return dataclasses.replace(log, restated=self.restated)

    def _lines(self, data: bytes) -> Iterator[tuple[int, str]]:
        # A power cut leaves zero bytes where data was promised to the file system.
        stripped = data.rstrip(b"\0")
        if len(stripped) < len(data):
            self.notes.append(f"{len(data) - len(stripped)} zero bytes at the end left out")
        raws = re.split(rb"\r\n|\n|\r", stripped)
        for number, raw in enumerate(raws, start=1):
            try:
                text = raw.decode("utf-8-sig" if number == 1 else "utf-8")
            except UnicodeDecodeError:
                if number == len(raws):
                    yield number, "?"  # cut off inside a character
                    return
                raise LogFileError(
                    f"{self.path}, line {number}: not UTF-8 text: {raw[:40]!r}"
                ) from None
            if "\0" in text:
                raise LogFileError(f"{self.path}, line {number}: zero bytes inside the log")
            yield number, text

    def _separated(self, number: int, line: str) -> str:
        if '"' not in line:
            return line.replace(",", _SEPARATOR)
        try:
            return _SEPARATOR.join(split_fields(line, strict=True))
        except ValueError as error:
            raise LogFileError(f"{self.path}, line {number}: {error}") from None

    def _comment(self, line: str) -> None:
        key, colon, value = line[1:].partition(":")
        if colon:
            key, value = key.strip(), value.strip()
            if self.header.setdefault(key, value) != value:
                self.restated.setdefault(key, value)

    def _check_columns(self, number: int, names: list[str]) -> list[str]:
        where = f"{self.path}, line {number}"
        if len(set(names)) < len(names):
            twice = sorted({name for name in names if names.count(name) > 1})
            raise LogFileError(f"{where}: columns named twice: {', '.join(twice)}")
        missing = [name for name in KEY_COLUMNS if name not in names]
        if missing:
            hint = "; put commas between fields, and decimal points" if ";" in names[0] else ""
            raise LogFileError(
                f"{where}: no column {', '.join(missing)}; a log has the columns "
                f"{','.join(KEY_COLUMNS)},so_1,... but this line reads "
                f'"{",".join(names)[:80]}"{hint}'
            )
        taxels = sorted(int(name[3:]) for name in names if re.fullmatch(r"so_[0-9]+", name))
        if not taxels or taxels != list(range(1, len(taxels) + 1)):
            raise LogFileError(
                f"{where}: the counts must be in columns so_1, so_2, ... without a hole; "
                f"found {', '.join(f'so_{k}' for k in taxels) or 'none'}"
            )
        return [f"so_{k}" for k in taxels]

    def _wrong_length(
        self, number: int, fields: Sequence[str], names: Sequence[str]
    ) -> LogFileError:
        if len(fields) < len(names):
            what = f"the row ends before column {names[len(fields)]}"
        else:
            what = f"the row goes on after the last column, {names[-1]}"
        return LogFileError(
            f"{self.path}, line {number}: {what}: {len(fields)} fields for {len(names)} "
            "columns (a missing value is an empty field)"
        )

    def _last_line(
        self,
        number: int,
        line: str,
        names: list[str],
        rows: list[str],
        numbers: list[int],
        so: list[str],
    ) -> None:
        """Keep a last line without its line end only if nothing can be missing from it.

        A number that lost digits is at most a tenth of what it was. So a last count between
        half and twice the module's previous one is whole.
        """
        fields = line.split(",")
        if len(fields) == len(names) and names[-1] in so:
            module = names.index("module")
            for earlier in reversed(rows[-FRAME_WINDOW:]):
                row = earlier.split(_SEPARATOR)
                if row[module].strip() == fields[module].strip():
                    last, before = number_in(fields[-1]), number_in(row[-1])
                    if 0 < 0.5 * before < last < 2 * before:
                        rows.append(_SEPARATOR.join(fields))
                        numbers.append(number)
                        return
                    break
        self.notes.append(f"line {number} is cut off and left out")
