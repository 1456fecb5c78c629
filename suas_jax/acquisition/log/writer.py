"""Write an SO log, append-only: its header, its rows, and the parts that it is rotated into."""

import contextlib
import time
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path

from suas_jax.acquisition.log.data import APPENDED, CONTINUED, KEY_COLUMNS
from suas_jax.acquisition.log.resume import LogEnd, end_of_log
from suas_jax.files.line_file import LineFile, LineWriteError
from suas_jax.files.ownership import OwnedError

# Columns of a log in which no module ever spoke: a ROBOSKIN triangle's.
_USUAL_TAXELS = 10


class LogWriter:
    """Append rows to a log.

    Only whole lines reach the file, at least every `flush_interval` seconds while rows
    come (call `flush` when they don't): a killed process loses no more than that. Every
    `sync_interval` seconds the file is forced to the disk, for a power cut. Where another
    program has deleted, moved or replaced it by then, all of it is copied to
    `NAME.beside1.csv`, and the log goes on there.

    Raises FileExistsError: the file exists, and neither `overwrite` nor `append` is set;
    LogFileError: it can't be appended to; OwnedError: another process is writing it; OSError:
    it can't be written.
    """

    def __init__(
        self,
        # file to create. An existing one is refused unless it is empty or `overwrite` is set: a
        # log is never lost by a typing error.
        path: Path,
        header: Mapping[str, str],  # written as `# key: value` lines, usually from `log_header`
        *,
        # number of so_ columns, or None to call `start` once it is known
        taxels: int | None = None,
        flags: Sequence[str] = (),  # names of the integer columns after the counts
        flush_interval: float = 0.2,  # [s]
        sync_interval: float = 5.0,  # [s]
        # go on in `NAME.part2.csv`, `NAME.part3.csv`, ... once a file has this size. The file
        # left ends with a `# continued_in` line, which `read_log` follows.
        rotate_bytes: int | None = None,
        overwrite: bool = False,  # replace an existing file
        # go on in an existing file (the last part of a rotated one), whose columns and scale
        # must be the same; a last line that was cut off is taken out
        append: bool = False,
        # called with a sentence where the log goes on beside its file
        report: Callable[[str], None] = lambda sentence: None,
    ) -> None:
        for key, value in header.items():
            if ":" in key or "\n" in key or "\n" in value or "\r" in value:
                raise ValueError(f"log header {key!r}: {value!r} does not fit on one line")
        self.rows = self.unwritten = 0  # handed over, and those that a full disk left out
        self.elapsed = 0.0  # since the log's `start_time` when this recording began [s]
        self.resumed = False  # whether the log had rows before this recording
        # what was found at the end of the log that is appended to, in words
        self.notes: tuple[str, ...] = ()
        self._report = report
        self._earlier_beside: tuple[Path, ...] = ()
        self._base = path
        self._header = dict(header)
        self._flags = tuple(flags)
        self._flush_interval = flush_interval
        self._sync_interval = sync_interval
        self._rotate_bytes = rotate_bytes
        self._part = 1
        self._taxels: int | None = None
        self._pending: list[str] = []
        self._file = (self._reopened() if append else None) or self._open(path, overwrite)
        self._file.report = report
        self._flushed = self._synced = time.monotonic()
        if taxels is not None:
            try:
                self.start(taxels)
            except BaseException:
                self._file.close()
                raise

    @property
    def path(self) -> Path:
        """The file, or the part, that is written."""
        return self._file.path

    @property
    def beside(self) -> tuple[Path, ...]:
        """Files that the log went on in, where its own was lost."""
        return self._earlier_beside + self._file.beside

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

        Times and flags that are NaN are written as missing. Raises LineWriteError: the disk
        takes no more.
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

        Raises LineWriteError: the disk takes no more; the file ends with a whole row.
        """
        now = time.monotonic()
        self._flushed = now
        if self._pending:
            self._append_rows()
            if self._rotate_bytes is not None and self._file.size >= self._rotate_bytes:
                self._next_part()
        if now - self._synced > self._sync_interval:
            self._synced = now
            self._file.sync()

    def close(self) -> None:
        """Write what is left and force it to the disk."""
        if self._file.closed:
            return
        try:
            if self._taxels is None:
                self.start(_USUAL_TAXELS)  # an empty log is still a log
            self.flush()
            self._file.sync()
        finally:
            self._file.close()

    def __enter__(self) -> "LogWriter":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _open(self, path: Path, overwrite: bool = False) -> LineFile:
        header = self._header | ({"part": str(self._part)} if self._part > 1 else {})
        text = "".join(f"# {key}: {value}\n" for key, value in header.items())
        return LineFile.create(path, text, overwrite=overwrite)

    def _reopened(self) -> LineFile | None:
        """The last part of an existing log, behind its last whole line; None: there is none."""
        while (end := end_of_log(self._base)) is not None:
            end.check(self._header, self._flags)
            file = LineFile.reopen(end.path)
            try:
                # Nobody else writes from here on; who did before has left what `end` says, or
                # we look again.
                if file.size == end.whole_bytes + len(end.cut_off):
                    self._go_on(file, end)
                    return file
            except BaseException:
                file.close()
                raise
            file.close()
        return None

    def _go_on(self, file: LineFile, end: LogEnd) -> None:
        self.resumed = True
        self._part, self._taxels, self._header = end.part, end.taxels, end.header
        if end.cut_off:
            self.notes = (f"a last line that was cut off was taken out: {end.cut_off!r}",)
            file.cut(end.whole_bytes)
        now = datetime.now(UTC)
        # Behind the last row even where the host's clock was set back meanwhile.
        self.elapsed = max((now - end.start_time).total_seconds(), end.last_time)
        file.append(f"# {APPENDED}: {now.isoformat(timespec='microseconds')}\n")

    def _write_columns(self) -> None:
        assert self._taxels is not None
        so = (f"so_{k}" for k in range(1, self._taxels + 1))
        self._file.append(",".join((*KEY_COLUMNS, *so, *self._flags)) + "\n")

    def _next_part(self) -> None:
        if self._pending:
            self._append_rows()
        previous = self._file
        try:
            previous.sync()  # its folder may have gone
            self._file = self._begun_part()
            self._flushed = self._synced = time.monotonic()
            self._write_columns()
            # Only now, so that the line never names a file that isn't there.
            previous.append(f"# {CONTINUED}: {self.path.name}\n")
            previous.sync()
        finally:
            previous.close()
        self._earlier_beside += previous.beside

    def _begun_part(self) -> LineFile:
        """The first part that is not there yet."""
        while True:
            self._part += 1
            name = f"{self._base.stem}.part{self._part}{self._base.suffix}"
            path = self._base.with_name(name)
            with contextlib.suppress(FileExistsError, OwnedError):
                if not path.exists():
                    file = self._open(path)
                    file.report = self._report
                    return file

    def _append_rows(self) -> None:
        rows, self._pending = self._pending, []
        before = self._file.size
        try:
            self._file.append("".join(rows))
        except LineWriteError:
            written = self._file.size - before
            for row in rows:
                written -= len(row.encode())
                self.unwritten += written < 0
            raise
