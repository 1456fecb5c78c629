"""Record a stream to a log."""

import time
from collections.abc import Callable
from typing import Any

from suas_jax.acquisition.integrity import Flags
from suas_jax.acquisition.log.log_file import LogWriter
from suas_jax.acquisition.stream import Judged, Stream

FLAG_COLUMNS = Flags._fields


def write_reading(log: LogWriter, judged: Judged, began: float = 0.0) -> None:
    """Add a reading to a log, which is made as wide as it needs to be.

    Args:
        log: the log.
        judged: the reading.
        began: host time at which the log's own begins [s].
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
        judged.flags + reading.extra,
    )


def record(
    stream: Stream,
    log: LogWriter,
    *,
    duration: float | None = None,
    started: float = 0.0,
    on_progress: Callable[[], None] = lambda: None,
) -> dict[str, Any]:
    """Write every reading of a stream to a log until it is stopped.

    Args:
        stream: its clock gives `t_host_s`.
        log: closed when this returns or raises.
        duration: stop after this many seconds.
        started: `time.monotonic()` when the port was opened [s].
        on_progress: called some ten times a second.

    Returns:
        What was recorded and what is missing, see `totals`.
    """
    with log:
        for batch in stream.batches():
            for judged in batch:
                if log.taxels is None:
                    log.start(max(len(other.reading.counts) for other in batch))
                write_reading(log, judged)
            if not batch:
                log.flush()
            on_progress()
            if duration is not None and time.monotonic() - started >= duration:
                stream.stop.set()
    return totals(stream, time.monotonic() - started)


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
        "stuck_taxels": {str(module): taxels for module, taxels in summary.stuck.items()},
        "bytes": tally.bytes,
        "bad_crc": tally.bad_crc,
        "malformed": tally.malformed,
        "partial": tally.partial,
        "discarded_bytes": tally.discarded,
        "reconnects": stream.reconnects,
    }
