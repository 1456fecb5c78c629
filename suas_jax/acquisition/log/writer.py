"""Write an SO log, append-only."""

import contextlib
import os
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType

from suas_jax.acquisition.log.format import CONTINUED, KEY_COLUMNS

# Columns of a log in which no module ever spoke: a ROBOSKIN triangle's.
_USUAL_TAXELS = 10


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
        # What is replaced stays until the new log has begun.
        place = self.path if not occupied else self.path.with_name(f".{self.path.name}.part")
        mode = os.O_WRONLY | os.O_CREAT | os.O_APPEND | (os.O_TRUNC if occupied else 0)
        self._file = os.open(place, mode, 0o666)
        self._size = 0
        self._flushed = self._synced = time.monotonic()
        header = self._header | ({"part": str(self._part)} if self._part > 1 else {})
        try:
            self._append("".join(f"# {key}: {value}\n" for key, value in header.items()))
            if occupied:
                os.fsync(self._file)
                os.replace(place, self.path)
        except OSError:
            os.close(self._file)
            self._file = -1
            with contextlib.suppress(OSError):
                place.unlink()
            raise
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
        os.write(previous, f"# {CONTINUED}: {successor.name}\n".encode())
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
