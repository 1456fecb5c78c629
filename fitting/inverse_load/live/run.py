"""`suas invert --live`: a port read, its loads estimated, shown and recorded."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import typer

from fitting.inverse_load.estimator import LoadEstimator
from fitting.inverse_load.live.stream import live_frames
from fitting.inverse_load.live.view import LoadView
from fitting.inverse_load.report.text import frame_json
from fitting.json_text import json_text
from suas_jax.acquisition.frames.registry import decoder, open_source
from suas_jax.acquisition.log.log_file import LogWriter, log_header
from suas_jax.acquisition.log.record import FLAG_COLUMNS, write_reading
from suas_jax.acquisition.signals import ended_by_signal
from suas_jax.acquisition.stream import Judged, Stream, discard_waiting


@dataclass(frozen=True)
class LiveOptions:
    """How to run.

    Attributes:
        port: as `suas log` takes it.
        format_name: frame format.
        baud: bits per second.
        duration: stop after this long [s].
        latency: age at which a frame is dropped [s].
        log: where readings are recorded, if anywhere.
        as_json: JSON lines instead of a view.
        smooth: filter over time.
        overwrite: replace an existing log.
    """

    port: str
    format_name: str = "text"
    baud: int = 115200
    duration: float | None = None
    latency: float = 0.1
    log: Path | None = None
    as_json: bool = False
    smooth: bool = False
    overwrite: bool = False

    def __post_init__(self) -> None:
        if not self.latency > 0:
            raise ValueError(f"--latency {self.latency:g}: a time above zero is needed")


def run_live(prepare: Callable[[], LoadEstimator], options: LiveOptions) -> None:
    """`suas invert --live`: until Ctrl-C, SIGTERM or the end of the duration.

    Args:
        prepare: makes the estimator, which takes long: a port that can't be opened is refused
            before.
        options: how to run.
    """
    decode = decoder(options.format_name)
    source = open_source(options.port, options.format_name, options.baud)
    writer: LogWriter | None = None
    try:
        estimator = prepare()
        estimator.warm_up()
        discard_waiting(source)
        if options.log is not None:  # not before the port is known to be there
            writer = _log_writer(estimator, options, decode.extra_columns)
        with LoadView(estimator, options.port, show=not options.as_json) as view:
            stream = Stream(source, decode, options.format_name, report=view.say)
            began = time.monotonic()

            def idle() -> None:
                over = options.duration is not None
                if over and time.monotonic() - began > options.duration:  # type: ignore[operator]
                    stream.stop.set()

            def record(judged: Judged) -> None:
                if writer is not None:
                    write_reading(writer, judged, began)

            frames = dropped = 0
            with ended_by_signal(stream):
                for frame in live_frames(
                    stream,
                    estimator,
                    latency=options.latency,
                    smooth=options.smooth,
                    on_reading=record,
                    idle=idle,
                ):
                    frames, dropped = frames + 1, frame.dropped
                    if options.as_json:
                        line = frame_json(
                            frame.time,
                            frame.seq,
                            frame.estimate,
                            frame.filtered,
                            dropped=frame.dropped,
                        )
                        typer.echo(json_text(line))
                    view.update(frame)
            view.say(f"{options.port}: {frames} frames estimated, {dropped} dropped")
    finally:
        source.close()
        if writer is not None:
            writer.close()


def _log_writer(
    estimator: LoadEstimator, options: LiveOptions, extra_columns: tuple[str, ...]
) -> LogWriter:
    electrodes = estimator.spec.electrodes
    assert electrodes is not None
    assert options.log is not None
    header = log_header(
        scale=f"{1e15 * electrodes.lsb:.6g} fF",
        start_time=datetime.now(UTC),
        port=options.port,
        frame_format=options.format_name,
    )
    flags = FLAG_COLUMNS + extra_columns
    return LogWriter(options.log, header, flags=flags, overwrite=options.overwrite)
