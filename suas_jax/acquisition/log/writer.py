"""Write an SO log, append-only."""

import contextlib
import errno
import os
import time
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType

from suas_jax.acquisition.log.format import APPENDED, CONTINUED, KEY_COLUMNS
from suas_jax.acquisition.log.resume import LogEnd, end_of_log

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

# Columns of a log in which no module ever spoke: a ROBOSKIN triangle's.
_USUAL_TAXELS = 10
# What a disk answers that can't take more; a pipe or a network drive that can't be forced to
# the disk answers something else.
_LOST = (errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EFBIG)


class LogWriteError(OSError):
    """The log can't be written any more: the disk is full or gone. Names the file."""


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
        append: go on in an existing file (the last part of a rotated one), whose columns and
            scale must be the same; a last line that was cut off is taken out.

    Attributes:
        path: the file, or the part, that is written.
        rows: handed over so far.
        unwritten: rows among them that a full disk left no room for.
        elapsed: since the log's `start_time` when this recording began [s].
        resumed: whether the log had rows before this recording.
        notes: what was found at the end of the log that is appended to, in words.

    Raises:
        FileExistsError: the file exists, and neither `overwrite` nor `append` is set.
        LogFileError: it can't be appended to.
        OSError: it can't be written, or another program is writing it.
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
        append: bool = False,
    ) -> None:
        for key, value in header.items():
            if ":" in key or "\n" in key or "\n" in value or "\r" in value:
                raise ValueError(f"log header {key!r}: {value!r} does not fit on one line")
        self.path = path
        self.rows = self.unwritten = 0
        self.elapsed = 0.0
        self.resumed = False
        self.notes: tuple[str, ...] = ()
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
        end = end_of_log(path) if append else None
        if end is None:
            self._file = self._open()
        else:
            self._file = self._reopen(end)
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
        flags: Sequence[float] = (),
    ) -> None:
        """Add one row; counts that are None, or fewer than the columns, are missing.

        Times and flags that are NaN are written as missing.

        Raises:
            LogWriteError: the disk takes no more.
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
        fields += ["" if flag != flag else str(flag) for flag in flags]
        # repr is the shortest text that reads back to the same float.
        device = "" if t_device != t_device else repr(t_device)
        host = "" if t_host != t_host else f"{t_host:.6f}"
        self._pending.append(f"{host},{device},{seq},{module},{','.join(fields)}\n")
        self.rows += 1
        if time.monotonic() - self._flushed > self._flush_interval:
            self.flush()

    def flush(self) -> None:
        """Hand all complete rows to the operating system: they survive the process.

        Raises:
            LogWriteError: the disk takes no more; the file ends with a whole row.
        """
        now = time.monotonic()
        self._flushed = now
        if self._pending:
            self._append_rows()
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
            self._let_go()

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
                "choose another name, or give --append or --overwrite"
            )
        # What is replaced stays until the new log has begun.
        place = self.path if not occupied else self.path.with_name(f".{self.path.name}.part")
        mode = os.O_WRONLY | os.O_CREAT | os.O_APPEND | (os.O_TRUNC if occupied else 0)
        self._file = os.open(place, mode, 0o666)
        self._size = 0
        self._flushed = self._synced = time.monotonic()
        header = self._header | ({"part": str(self._part)} if self._part > 1 else {})
        try:
            self._lock()
            self._append("".join(f"# {key}: {value}\n" for key, value in header.items()))
            if occupied:
                os.fsync(self._file)
                os.replace(place, self.path)
        except LogWriteError:
            self._let_go()
            with contextlib.suppress(OSError):
                place.unlink()
            raise
        except OSError:
            self._let_go()
            raise
        return self._file

    def _reopen(self, end: LogEnd) -> int:
        """Open the last part of an existing log, behind its last whole line."""
        end.check(self._header, self._flags)
        self.resumed = True
        self.path, self._part, self._taxels = end.path, end.part, end.taxels
        self._header = end.header
        self._file = os.open(self.path, os.O_WRONLY | os.O_APPEND)
        try:
            self._lock()
            now = datetime.now(UTC)
            if end.cut_off:
                os.ftruncate(self._file, end.whole_bytes)
                self.notes = (f"a last line that was cut off was taken out: {end.cut_off!r}",)
            self._size = end.whole_bytes
            self._flushed = self._synced = time.monotonic()
            # Behind the last row even where the host's clock was set back meanwhile.
            self.elapsed = max((now - end.start_time).total_seconds(), end.last_time)
            self._append(f"# {APPENDED}: {now.isoformat(timespec='microseconds')}\n")
        except OSError:
            self._let_go()
            raise
        return self._file

    def _lock(self) -> None:
        """Keep other loggers out of the file."""
        if fcntl is None:
            return
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            reason = "another program is writing this log; choose another name"
            raise OSError(errno.EBUSY, reason, str(self.path)) from None
        except OSError:  # a file system without locks
            return

    def _let_go(self) -> None:
        os.close(self._file)
        self._file = -1

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
            self._append_rows()
        previous = self._file
        self.path = successor
        try:
            self._open()
        except BaseException:
            os.close(previous)
            raise
        self._write_columns()
        # Only now, so that the line never names a file that isn't there.
        try:
            os.write(previous, f"# {CONTINUED}: {successor.name}\n".encode())
            os.fsync(previous)
        except OSError as error:
            raise self._failed(error) from None
        finally:
            os.close(previous)

    def _append_rows(self) -> None:
        rows, self._pending = self._pending, []
        before = self._size
        try:
            self._append("".join(rows))
        except LogWriteError:
            written = self._size - before
            for row in rows:
                written -= len(row.encode())
                self.unwritten += written < 0
            raise

    def _append(self, text: str) -> None:
        """Append whole lines; where the disk is full, as many as it takes."""
        data = text.encode()
        begin = 0
        try:
            while begin < len(data):
                begin += os.write(self._file, data[begin:])
        except OSError as error:
            whole = data.rfind(b"\n", 0, begin) + 1
            with contextlib.suppress(OSError):  # a pipe or a device has no end to cut off
                os.ftruncate(self._file, os.fstat(self._file).st_size - (begin - whole))
            self._size += whole
            raise self._failed(error) from None
        self._size += len(data)

    def _sync(self) -> None:
        self._synced = time.monotonic()
        try:
            os.fsync(self._file)
        except OSError as error:
            if error.errno in _LOST:
                raise self._failed(error) from None
            self._sync_interval = float("inf")  # pipes and some network drives can't

    def _failed(self, error: OSError) -> LogWriteError:
        return LogWriteError(error.errno, error.strerror, str(self.path))
