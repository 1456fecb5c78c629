"""Record a stream to a log."""

import sys
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from suas_jax.acquisition.frames.reading import Decoder
from suas_jax.acquisition.integrity import Flags
from suas_jax.acquisition.log.data import RAW_CLOCK
from suas_jax.acquisition.log.log_file import LineWriteError, LogWriter, log_header
from suas_jax.acquisition.ports.serial_port import Source
from suas_jax.acquisition.stream import Judged, Stream
from suas_jax.acquisition.terminal import LiveTerminal

if TYPE_CHECKING:
    from rich.table import Table


FLAG_COLUMNS = (*Flags._fields, RAW_CLOCK)
"""Columns after the counts in a recorded log."""


def write_reading(log: LogWriter, judged: Judged, began: float = 0.0) -> None:
    """Add a reading to a log, which is made as wide as it needs to be.

    `began`: host time at which the log's own begins [s].
    """
    reading = judged.reading
    if log.taxels is not None and len(reading.counts) > log.taxels:
        log.widen(len(reading.counts))
    log.write(
        reading.t_host - began,
        judged.t_device,
        reading.seq,
        reading.module,
        reading.counts,
        (*judged.flags, reading.t_device, *reading.extra),
    )


def record(
    stream: Stream,  # its clock gives `t_host_s`
    log: LogWriter,  # closed when this returns or raises
    *,
    duration: float | None = None,  # stop after this many seconds
    started: float = 0.0,  # `time.monotonic()` when the port was opened [s]
    on_progress: Callable[[], None] = lambda: None,  # called some ten times a second
) -> dict[str, Any]:
    """Write every reading of a stream to a log until it is stopped.

    Returns what was recorded and what is missing, see `totals`; `beside` names the files that
    the log went on in where its own was lost, `stopped` says that the disk is full.
    """
    stopped = None
    batches = stream.batches()
    try:
        with log:
            for batch in batches:
                for judged in batch:
                    if log.taxels is None:
                        log.start(max(len(other.reading.counts) for other in batch))
                    write_reading(log, judged)
                if not batch:
                    log.flush()
                on_progress()
                if duration is not None and time.monotonic() - started >= duration:
                    stream.stop.set()
    except LineWriteError as error:
        batches.close()
        stopped = (
            f"{error.filename}: {error.strerror}: the recording ends; the file ends with a "
            "whole row; make room and go on with --append"
        )
    result = totals(stream, time.monotonic() - started)
    result["unwritten_rows"] = result["rows"] - log.rows + log.unwritten
    result["beside"] = [str(path) for path in log.beside]
    result["stopped"] = stopped
    return result


def record_port(
    source: Source,  # the open port, which is closed in the end
    decode: Decoder,  # decoder of its format
    format_name: str,  # the format's name
    path: Path,  # of the log
    *,
    duration: float,  # [s]
    report: Callable[[str], None],  # see `Stream`
) -> dict[str, Any]:
    """Record an open port to a new log for some time; returns what `record` does."""
    started = time.monotonic()
    try:
        columns = FLAG_COLUMNS + decode.extra_columns
        log = LogWriter(path, log_header(), flags=columns)
    except BaseException:
        source.close()
        raise
    stream = Stream(
        source, decode, format_name, report=report, clock=lambda: time.monotonic() - started
    )
    return record(stream, log, duration=duration, started=started)


def totals(stream: Stream, elapsed: float) -> dict[str, Any]:
    """Counts of a recording, by name; a module's stuck taxels count from 1."""
    tally, summary = stream.tally, stream.summary
    return {
        "elapsed_s": elapsed,
        "rows": summary.rows,
        "modules": stream.modules,
        "lost_frames": summary.lost,
        "duplicates": summary.duplicates,
        "repeats": summary.repeats,
        "restarts": summary.restarts,
        "suspect_rows": summary.suspects,
        "clock_jumps": summary.clock_jumps,
        "other_taxels_rows": summary.other_taxels,
        "stuck_taxels": {str(module): taxels for module, taxels in summary.stuck.items()},
        "bytes": tally.bytes,
        "bad_crc": tally.bad_crc,
        "malformed": tally.malformed,
        "partial": tally.partial,
        "discarded_bytes": tally.discarded,
        "reconnects": stream.reconnects,
    }


# Rates are means over this time [s].
_WINDOW = 2.0
_REFRESH = 0.25  # between two tables [s]


class View(LiveTerminal):
    """Messages on stderr; on a terminal also a table of rates and losses."""

    def __init__(self, title: str) -> None:
        super().__init__(sys.stderr.isatty(), _REFRESH)
        self._title = title
        self._history: deque[tuple[float, int, int]] = deque()

    def update(self, stream: Stream) -> None:
        """Show where the recording stands, a few times a second."""
        if not self.due():
            return
        now = time.monotonic()
        self._history.append((now, stream.summary.rows, stream.tally.bytes))
        while now - self._history[0][0] > _WINDOW:
            self._history.popleft()
        self.draw(self._table(stream))

    def _table(self, stream: Stream) -> "Table":
        from rich.table import Table

        (then, rows, size), (now, rows_now, size_now) = self._history[0], self._history[-1]
        span = max(now - then, 1e-9)
        modules, total, tally = len(stream.modules), stream.summary, stream.tally
        row_rate = (rows_now - rows) / span
        table = Table(show_header=False, box=None, title=self._title, title_justify="left")
        state = "[red]link lost[/]" if stream.lost_link else "recording"
        table.add_row("state", f"{state}, {stream.reconnects} reconnects")
        table.add_row("modules", str(modules))
        table.add_row("frames", f"{row_rate / max(modules, 1):.1f} per second and module")
        table.add_row(
            "rows",
            f"{total.rows} ({row_rate:.0f}/s, {1e-3 * (size_now - size) / span:.1f} kB/s)",
        )
        table.add_row("lost", f"{total.lost} frames, {total.restarts} device restarts")
        table.add_row(
            "refused", f"{tally.bad_crc} wrong checksums, {tally.malformed} malformed frames"
        )
        table.add_row(
            "flagged",
            f"{total.duplicates} sent twice, {total.repeats} not refreshed, "
            f"{total.suspects} suspect",
        )
        if total.stuck:
            taxels = ", ".join(f"{m}: {ks}" for m, ks in sorted(total.stuck.items()))
            table.add_row("[yellow]stuck taxels[/]", f"module {taxels}")
        return table


def totals_text(totals: dict[str, Any]) -> str:
    """The totals of a recording in a sentence."""
    troubles = [
        f"{totals[key]} {words}"
        for key, words in (
            ("lost_frames", "frames lost"),
            ("bad_crc", "wrong checksums"),
            ("malformed", "malformed frames"),
            ("duplicates", "frames sent twice"),
            ("suspect_rows", "suspect rows"),
            ("restarts", "device restarts"),
            ("clock_jumps", "jumps of the device's clock"),
            ("other_taxels_rows", "rows with another number of taxels"),
            ("reconnects", "reconnects"),
            ("unwritten_rows", "rows not written"),
        )
        if totals[key]
    ]
    troubles += [f"module {m}: taxels {ks} stuck" for m, ks in totals["stuck_taxels"].items()]
    return (
        f"{totals['rows']} rows of {len(totals['modules'])} modules in "
        f"{totals['elapsed_s']:.1f} s; {', '.join(troubles) or 'nothing lost'}"
    )
