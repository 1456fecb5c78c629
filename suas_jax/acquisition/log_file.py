"""The SO log: written append-only while a port is recorded, read back strictly.

Format (UTF-8 CSV)::

    # format: suas-so-log
    # format_version: 1
    # start_time: 2025-11-21T05:40:12.123456+00:00
    # skin: skins/suas.toml
    # scale: 0.305 fF
    # units: t_host_s and t_device_s in seconds, so_k in raw counts (0 to 65535)
    t_host_s,t_device_s,seq,module,so_1,...,so_n[,flag columns]
    0.012345,0.01,1,0,13675,13680,...

`t_host_s` counts from `start_time`; one row is one module in one frame, and the rows of
equal `seq` make a frame. An empty field is a missing value. A log that was cut off loses
its last line only.
"""

import csv
import os
import re
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

FORMAT = "suas-so-log"
FORMAT_VERSION = 1
MAX_COUNT = 65535
UNITS = f"t_host_s and t_device_s in seconds, so_k in raw counts (0 to {MAX_COUNT})"
# The paper's Eq. 2: one count is 3.05e-16 F.
DEFAULT_SCALE = "0.305 fF"
KEY_COLUMNS = ("t_host_s", "t_device_s", "seq", "module")

_CONTINUED = "continued_in"
# Rows of one frame may be interleaved with those of its neighbours (several buses), but
# an equal seq further away is another frame: the counter wrapped or the device restarted.
_FRAME_WINDOW = 256
# Between the fields of a row once quotes are undone: ASCII's unit separator.
_SEPARATOR = "\x1f"
# Whole numbers up to here are exact in float64.
_LARGEST_INTEGER = 2**53
# Columns of a log in which no module ever spoke: a ROBOSKIN triangle's.
_USUAL_TAXELS = 10


class LogFileError(ValueError):
    """A log that can't be read: names the file, the line and the column."""


def log_header(
    *,
    skin: str = "not given",
    scale: str = DEFAULT_SCALE,
    start_time: datetime | None = None,
    **more: str,
) -> dict[str, str]:
    """The header that every log carries, in its order; `more` adds keys after it."""
    start = datetime.now(UTC) if start_time is None else start_time
    if start.tzinfo is None:
        raise ValueError(f"start_time = {start}: a time zone is needed, such as UTC")
    return {
        "format": FORMAT,
        "format_version": str(FORMAT_VERSION),
        "start_time": start.isoformat(timespec="microseconds"),
        "skin": skin,
        "scale": scale,
        "units": UNITS,
    } | more


class LogWriter:
    """Append rows to a log.

    Only whole lines reach the file, at least every `flush_interval` seconds while rows
    come (call `flush` when they don't): a killed process loses no more than that. Every
    `sync_interval` seconds the file is forced to the disk, for a power cut.

    Args:
        path: file to create. An existing one is refused unless it is empty or
            `overwrite` is set: a log is never lost by a typing error.
        header: written as `# key: value` lines, usually from `log_header`.
        taxels: number of so_ columns, or None to call `start` once it is known.
        flags: names of the integer columns after the counts.
        flush_interval: [s].
        sync_interval: [s].
        rotate_bytes: go on in `NAME.part2.csv`, `NAME.part3.csv`, ... once a file has this
            size. The file left ends with a `# continued_in` line, which `read_log` follows.
        overwrite: replace an existing file.
    """

    def __init__(
        self,
        path: Path,
        header: Mapping[str, str],
        *,
        taxels: int | None = None,
        flags: Sequence[str] = (),
        flush_interval: float = 0.2,
        sync_interval: float = 5.0,
        rotate_bytes: int | None = None,
        overwrite: bool = False,
    ) -> None:
        for key, value in header.items():
            if ":" in key or "\n" in key or "\n" in value or "\r" in value:
                raise ValueError(f"log header {key!r}: {value!r} does not fit on one line")
        self.path = path
        self.rows = 0
        self._base = path
        self._header = dict(header)
        self._flags = tuple(flags)
        self._flush_interval = flush_interval
        self._sync_interval = sync_interval
        self._rotate_bytes = rotate_bytes
        self._overwrite = overwrite
        self._part = 1
        self._taxels: int | None = None
        self._pending: list[str] = []
        self._file = self._open()
        if taxels is not None:
            self.start(taxels)

    @property
    def taxels(self) -> int | None:
        """Number of so_ columns; None before `start`."""
        return self._taxels

    def start(self, taxels: int) -> None:
        """Write the line that names the columns, with so_1 to so_`taxels`."""
        if taxels < 1:
            raise ValueError(f"taxels = {taxels}: a log needs at least one so_ column")
        if self._taxels is not None:
            raise ValueError("the columns of this log are already written")
        self._taxels = taxels
        self._write_columns()

    def widen(self, taxels: int) -> None:
        """Go on in a new part with more so_ columns: a larger module has appeared."""
        self._taxels = taxels
        self._next_part()

    def write(
        self,
        t_host: float,
        t_device: float,
        seq: int,
        module: int,
        counts: Sequence[int | None],
        flags: Sequence[int] = (),
    ) -> None:
        """Add one row; counts that are None, or fewer than the columns, are missing.

        A NaN time is written as missing.
        """
        if self._taxels is None:
            self.start(len(counts))
        assert self._taxels is not None
        if len(counts) > self._taxels or len(flags) != len(self._flags):
            raise ValueError(
                f"module {module}: {len(counts)} counts and {len(flags)} flags for "
                f"{self._taxels} so_ columns and {len(self._flags)} flag columns"
            )
        fields = ["" if c is None else str(c) for c in counts]
        fields += [""] * (self._taxels - len(counts))
        fields += [str(flag) for flag in flags]
        # repr is the shortest text that reads back to the same float.
        device = "" if t_device != t_device else repr(t_device)
        host = "" if t_host != t_host else f"{t_host:.6f}"
        self._pending.append(f"{host},{device},{seq},{module},{','.join(fields)}\n")
        self.rows += 1
        if time.monotonic() - self._flushed > self._flush_interval:
            self.flush()

    def flush(self) -> None:
        """Hand all complete rows to the operating system: they survive the process."""
        now = time.monotonic()
        self._flushed = now
        if self._pending:
            self._append("".join(self._pending))
            self._pending.clear()
            if self._rotate_bytes is not None and self._size >= self._rotate_bytes:
                self._next_part()
        if now - self._synced > self._sync_interval:
            self._sync()

    def close(self) -> None:
        """Write what is left and force it to the disk."""
        if self._file < 0:
            return
        try:
            if self._taxels is None:
                self.start(_USUAL_TAXELS)  # an empty log is still a log
            self.flush()
            self._sync()
        finally:
            os.close(self._file)
            self._file = -1

    def __enter__(self) -> "LogWriter":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _open(self) -> int:
        try:
            occupied = self.path.stat().st_size > 0
        except FileNotFoundError:
            occupied = False
        if occupied and not self._overwrite:
            raise FileExistsError(
                f"{self.path}: exists and is not empty; logs are never overwritten unasked, "
                "choose another name or give --overwrite"
            )
        mode = os.O_WRONLY | os.O_CREAT | os.O_APPEND | (os.O_TRUNC if occupied else 0)
        self._file = os.open(self.path, mode, 0o644)
        self._size = 0
        self._flushed = self._synced = time.monotonic()
        header = self._header | ({"part": str(self._part)} if self._part > 1 else {})
        self._append("".join(f"# {key}: {value}\n" for key, value in header.items()))
        return self._file

    def _write_columns(self) -> None:
        assert self._taxels is not None
        so = (f"so_{k}" for k in range(1, self._taxels + 1))
        self._append(",".join((*KEY_COLUMNS, *so, *self._flags)) + "\n")

    def _next_part(self) -> None:
        successor = self.path
        while successor.exists():
            self._part += 1
            name = f"{self._base.stem}.part{self._part}{self._base.suffix}"
            successor = self._base.with_name(name)
        if self._pending:
            self._append("".join(self._pending))
            self._pending.clear()
        previous = self._file
        self.path = successor
        self._open()
        self._write_columns()
        # Only now, so that the line never names a file that isn't there.
        os.write(previous, f"# {_CONTINUED}: {successor.name}\n".encode())
        os.fsync(previous)
        os.close(previous)

    def _append(self, text: str) -> None:
        data = text.encode()
        self._size += len(data)
        while data:
            data = data[os.write(self._file, data) :]

    def _sync(self) -> None:
        self._synced = time.monotonic()
        try:
            os.fsync(self._file)
        except OSError:  # pipes and some network drives can't
            self._sync_interval = float("inf")


@dataclass(frozen=True)
class SoLog:
    """A log in memory.

    Attributes:
        path: where it was read.
        header: the `# key: value` lines.
        t_host: host time since `start_time` [row, s]; NaN where missing.
        t_device: device time, unwrapped [row, s]; NaN where missing.
        seq: frame number [row].
        module: module (triangle) number [row].
        so: raw counts [row, taxel]; NaN where missing.
        flags: columns after the counts, by name [row]; integers where they all are.
        notes: what the reader left out, in words.
    """

    path: Path
    header: dict[str, str]
    t_host: NDArray[np.float64]
    t_device: NDArray[np.float64]
    seq: NDArray[np.int64]
    module: NDArray[np.int64]
    so: NDArray[np.float64]
    flags: dict[str, NDArray[np.generic]]
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.seq)


@dataclass(frozen=True)
class Frames:
    """A log by frames: the rows of equal seq side by side.

    Attributes:
        t_host: host time of the frame's first row [frame, s].
        t_device: device time of the frame's first row [frame, s].
        seq: frame number [frame].
        modules: module numbers, ascending [module].
        so: raw counts [frame, module, taxel]; NaN where missing.
    """

    t_host: NDArray[np.float64]
    t_device: NDArray[np.float64]
    seq: NDArray[np.int64]
    modules: NDArray[np.int64]
    so: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.seq)


def group_frames(log: SoLog) -> Frames:
    """Group the rows of equal seq to frames.

    Rows flagged `duplicate` (the device sent them twice) are left out. An equal seq counts
    as the same frame only while it is near and its module is new: a counter that wrapped or
    a device that restarted begins new frames.
    """
    modules = np.unique(log.module)
    slot = np.searchsorted(modules, log.module).tolist()
    frame_of = np.full(len(log), -1, np.int64)
    first: list[int] = []
    members: dict[int, tuple[int, int, set[int]]] = {}  # seq: frame, last row, its modules
    duplicate = log.flags.get("duplicate")
    sequence = log.seq.tolist()
    for row in range(len(log)):
        if duplicate is not None and duplicate[row]:
            continue
        number, module = sequence[row], slot[row]
        known = members.get(number)
        if known and row - known[1] <= _FRAME_WINDOW and module not in known[2]:
            frame, _, present = known
            present.add(module)
        else:
            frame, present = len(first), {module}
            first.append(row)
        members[number] = (frame, row, present)
        frame_of[row] = frame
    so = np.full((len(first), len(modules), log.so.shape[1]), np.nan)
    kept = frame_of >= 0
    so[frame_of[kept], np.asarray(slot, np.int64)[kept]] = log.so[kept]
    start = np.asarray(first, np.int64)
    return Frames(log.t_host[start], log.t_device[start], log.seq[start], modules, so)


def is_log(path: Path) -> bool:
    """Whether a file begins as a log does: comments, then names with `t_host_s` among them."""
    with path.open("rb") as file:
        for line in file:
            if line.strip() and not line.lstrip(b"\xef\xbb\xbf").startswith(b"#"):
                return b"t_host_s" in line
    return False


def read_log(path: Path, *, follow: bool = True) -> SoLog:
    """Read a log, written here or by other hands.

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
    part = _Parser(path).parse(path.read_bytes())
    successor = part.header.pop(_CONTINUED, None)
    if successor is None or not follow:
        return part
    if Path(successor).name != successor or successor == path.name:
        raise LogFileError(f'{path}: continued_in "{successor}": a file beside it is expected')
    return _joined(part, read_log(path.with_name(successor)))


def _joined(a: SoLog, b: SoLog) -> SoLog:
    width = max(a.so.shape[1], b.so.shape[1])

    def widened(so: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.pad(so, ((0, 0), (0, width - so.shape[1])), constant_values=np.nan)

    return SoLog(
        a.path,
        a.header,
        np.concatenate([a.t_host, b.t_host]),
        np.concatenate([a.t_device, b.t_device]),
        np.concatenate([a.seq, b.seq]),
        np.concatenate([a.module, b.module]),
        np.concatenate([widened(a.so), widened(b.so)]),
        {k: np.concatenate([v, b.flags[k]]) for k, v in a.flags.items() if k in b.flags},
        a.notes + b.notes,
    )


class _Parser:
    """One reading of one file: keeps what an error message needs."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notes: list[str] = []
        self.header: dict[str, str] = {}

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
        by_name = {name: fields[k :: len(names)] for k, name in enumerate(names)}
        known = {*KEY_COLUMNS, *so}
        counts = [self._floats(numbers, k, by_name[k], 0.0, MAX_COUNT) for k in so]
        return SoLog(
            self.path,
            self.header,
            self._floats(numbers, "t_host_s", by_name["t_host_s"]),
            self._floats(numbers, "t_device_s", by_name["t_device_s"]),
            self._integers(numbers, "seq", by_name["seq"]),
            self._integers(numbers, "module", by_name["module"]),
            np.stack(counts, axis=1),
            {name: _flag(by_name[name]) for name in names if name not in known},
            tuple(self.notes),
        )

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
            return _SEPARATOR.join(next(csv.reader([line], strict=True)))
        except csv.Error as error:
            raise LogFileError(f"{self.path}, line {number}: {error}") from None

    def _comment(self, line: str) -> None:
        key, colon, value = line[1:].partition(":")
        if colon:
            self.header.setdefault(key.strip(), value.strip())

    def _check_columns(self, number: int, names: list[str]) -> list[str]:
        where = f"{self.path}, line {number}"
        if len(set(names)) < len(names):
            twice = sorted({name for name in names if names.count(name) > 1})
            raise LogFileError(f"{where}: columns named twice: {', '.join(twice)}")
        missing = [name for name in KEY_COLUMNS if name not in names]
        if missing:
            raise LogFileError(
                f"{where}: no column {', '.join(missing)}; a log has the columns "
                f"{','.join(KEY_COLUMNS)},so_1,... but this line reads "
                f'"{",".join(names)[:80]}"'
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
            for earlier in reversed(rows[-_FRAME_WINDOW:]):
                row = earlier.split(_SEPARATOR)
                if row[module].strip() == fields[module].strip():
                    last, before = _number(fields[-1]), _number(row[-1])
                    if 0 < 0.5 * before < last < 2 * before:
                        rows.append(_SEPARATOR.join(fields))
                        numbers.append(number)
                        return
                    break
        self.notes.append(f"line {number} is cut off and left out")

    def _floats(
        self,
        numbers: list[int],
        name: str,
        texts: Sequence[str],
        low: float = -np.inf,
        high: float = np.inf,
    ) -> NDArray[np.float64]:
        try:
            if "_" in "".join(texts):
                raise ValueError
            values = np.array(list(map(float, texts)))
        except ValueError:  # missing values, or worse
            values = np.array([_number(text) for text in texts], float)
        outside = np.isinf(values) | (values < low) | (values > high)
        bad = [
            i
            for i in np.flatnonzero(outside | np.isnan(values)).tolist()
            if outside[i] or not _is_missing(texts[i])
        ]
        if bad:
            allowed = "a number" if high == np.inf else f"a count from {low:.0f} to {high:.0f}"
            raise LogFileError(
                f'{self.path}, line {numbers[bad[0]]}, column {name}: "{texts[bad[0]]}": '
                f"expected {allowed}, or nothing where the value is missing"
            )
        return values

    def _integers(
        self, numbers: list[int], name: str, texts: Sequence[str]
    ) -> NDArray[np.int64]:
        if all(map(str.isdecimal, texts)) and max(map(len, texts), default=0) < 16:
            return np.array(list(map(int, texts)), np.int64)
        values = []
        for i, text in enumerate(texts):
            value = _number(text)
            if not (value.is_integer() and 0 <= value <= _LARGEST_INTEGER):
                raise LogFileError(
                    f'{self.path}, line {numbers[i]}, column {name}: "{text}": expected a '
                    "whole number, zero or more"
                )
            values.append(int(value))
        return np.array(values, np.int64)


def _is_missing(text: str) -> bool:
    return text.strip().lower() in ("", "nan", "na")


def _number(text: str) -> float:
    """NaN where the text is no number; Python's own `1_000` is none in a CSV."""
    try:
        return float(text) if "_" not in text else float("nan")
    except ValueError:
        return float("nan")


def _flag(fields: Sequence[str]) -> NDArray[np.generic]:
    try:
        return np.array([int(text) if text.strip() else 0 for text in fields], np.int64)
    except (ValueError, OverflowError):
        return np.array([text.strip() for text in fields], np.str_)
