"""Record a stream to a log."""

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from suas_jax.acquisition.frames.reading import Decoder
from suas_jax.acquisition.integrity import Flags
from suas_jax.acquisition.log.format import RAW_CLOCK
from suas_jax.acquisition.log.log_file import LineWriteError, LogWriter, log_header
from suas_jax.acquisition.ports.serial_port import Source
from suas_jax.acquisition.stream import Judged, Stream

FLAG_COLUMNS = (*Flags._fields, RAW_CLOCK)
"""Columns after the counts in a recorded log."""


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
        (*judged.flags, reading.t_device, *reading.extra),
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
        What was recorded and what is missing, see `totals`; `beside` names the files that the
        log went on in where its own was lost, `stopped` says that the disk is full.
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
    source: Source,
    decode: Decoder,
    format_name: str,
    path: Path,
    *,
    duration: float,
    report: Callable[[str], None],
    header: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """Record an open port to a new log for some time; returns what `record` does.

    Args:
        source: the open port, which is closed in the end.
        decode: decoder of its format.
        format_name: the format's name.
        path: of the log.
        duration: [s].
        report: see `Stream`.
        header: of the log; None for what every log has.
    """
    started = time.monotonic()
    try:
        columns = FLAG_COLUMNS + decode.extra_columns
        log = LogWriter(path, header or log_header(), flags=columns)
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
