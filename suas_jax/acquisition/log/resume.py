"""Where an existing log ends, so that a recording can go on in it."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from suas_jax.acquisition.log.data import CONTINUED, KEY_COLUMNS, LogFileError
from suas_jax.files.reading import MEGABYTE

_MOST_HEAD = MEGABYTE  # bytes within which a log names its columns
_MOST_TAIL = MEGABYTE  # bytes in which its last rows are looked for
_MOST_PARTS = 100_000


@dataclass(frozen=True)
class LogEnd:
    """The end of a log, or of the last part of a rotated one."""

    path: Path  # the file
    part: int  # which part it is, from 1
    header: dict[str, str]  # its `# key: value` lines
    start_time: datetime  # from which `t_host_s` counts
    columns: tuple[str, ...] | None  # their names; None where they are not named yet
    whole_bytes: int  # length without a last line that was cut off
    cut_off: bytes  # that line
    last_time: float  # `t_host_s` of the last row, 0 where there is none [s]

    @property
    def taxels(self) -> int | None:
        """Number of so_ columns; None where they are not named yet."""
        if self.columns is None:
            return None
        return sum(name.startswith("so_") for name in self.columns)

    def check(self, header: Mapping[str, str], flags: Sequence[str]) -> None:
        """Refuse (LogFileError) to append rows of another scale or with other columns."""
        if self.columns is not None:
            taxels = [f"so_{k + 1}" for k in range(self.taxels or 0)]
            expected = (*KEY_COLUMNS, *taxels, *flags)
            if self.columns != expected:
                odd = sorted(set(self.columns) ^ set(expected))
                raise LogFileError(
                    f"{self.path}: can't be appended to: its columns are others than this "
                    f"recording's ({', '.join(odd)[:200] or 'in another order'}); record to a "
                    "file of its own"
                )
        for key in ("scale", "frame_format"):
            before, now = self.header.get(key), header.get(key)
            if before is not None and now is not None and before != now:
                raise LogFileError(
                    f"{self.path}: can't be appended to: its {key} is {before}, this "
                    f"recording's {now}; record to a file of its own"
                )


def end_of_log(path: Path) -> LogEnd | None:
    """The end of a log; None where there is no file, or an empty one.

    Raises LogFileError: it is not a log, or can't be appended to; OSError: it can't be read.
    """
    names = {path.name}
    for part in range(1, _MOST_PARTS):
        if not path.exists() or (path.is_file() and path.stat().st_size == 0):
            if part == 1:
                return None
            raise LogFileError(f"{path}: is missing, though the part before it names it")
        end, successor = _end_of_file(path, part)
        if successor is None:
            return end
        if Path(successor).name != successor or successor in names:
            raise LogFileError(f'{path}: continued_in "{successor[:80]}" is no further part')
        names.add(successor)
        path = path.with_name(successor)
    raise LogFileError(f"{path}: too many parts")


def _end_of_file(path: Path, part: int) -> tuple[LogEnd, str | None]:
    if not path.is_file():
        raise LogFileError(f"{path}: is not a regular file; --append needs a log")
    with path.open("rb") as stream:
        head = stream.read(_MOST_HEAD)
        size = os.fstat(stream.fileno()).st_size
        stream.seek(max(size - _MOST_TAIL, 0))
        tail = stream.read(_MOST_TAIL)
    header, columns = _head(path, head)
    try:
        start = datetime.fromisoformat(header["start_time"])
    except (KeyError, ValueError):
        start = None
    if start is None or start.tzinfo is None:
        raise LogFileError(
            f"{path}: can't be appended to: its header has no start_time with a time zone"
        )
    whole = tail.rfind(b"\n") + 1
    successor = None
    last_time = 0.0
    for line in tail[:whole].split(b"\n")[::-1]:
        text = line.decode("utf-8", "replace").strip()
        key, _, value = text.lstrip("# ").partition(":")
        if text.startswith("#") and key.strip() == CONTINUED:
            successor = value.strip()
        elif text and not text.startswith("#"):
            if columns is not None and not text.startswith(columns[0]):
                last_time = _time(text, columns)
            break
    whole_bytes = size - len(tail) + whole
    end = LogEnd(path, part, header, start, columns, whole_bytes, tail[whole:], last_time)
    return end, successor


def _head(path: Path, head: bytes) -> tuple[dict[str, str], tuple[str, ...] | None]:
    """Header and names of the columns; None where they are not named yet."""
    header: dict[str, str] = {}
    lines = head.split(b"\n")[:-1]
    for line in lines:
        text = line.decode("utf-8-sig", "replace").strip()
        if text.startswith("#"):
            key, colon, value = text[1:].partition(":")
            if colon:
                header.setdefault(key.strip(), value.strip())
        elif text:
            names = tuple(name.strip() for name in text.split(","))
            if not set(KEY_COLUMNS) <= set(names):
                raise LogFileError(f"{path}: no SO log: its columns are {text[:80]!r}")
            return header, names
    if not header:
        raise LogFileError(f"{path}: no SO log: neither a header nor names of columns")
    return header, None


def _time(row: str, columns: Sequence[str]) -> float:
    fields = row.split(",")
    try:
        time = float(fields[columns.index("t_host_s")])
    except (IndexError, ValueError):
        return 0.0
    return time if time >= 0.0 else 0.0  # also where it is missing
