"""Loads from a port as they happen: bounded latency, frames dropped rather than lagging.

A thread of `suas_jax.acquisition.stream` takes the bytes away from the port; here frames
are put together, estimated in order, and left out where they have waited too long.
"""

import json
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import typer
from numpy.typing import NDArray

from fitting.cli.solve import finite
from fitting.inverse_load.estimator import LoadEstimator
from fitting.inverse_load.live.filter import LoadFilter
from fitting.inverse_load.readings import Layout, LayoutMismatchError, StuckWatch
from fitting.inverse_load.report.estimate import Contact, LoadEstimate
from fitting.inverse_load.report.text import frame_json
from suas_jax.acquisition.stream import Judged, Stream

if TYPE_CHECKING:
    pass


class LiveFrame(NamedTuple):
    """One frame of a stream.

    Attributes:
        time: on the device's clock if it has one, else on the host's [s].
        seq: frame number.
        estimate: its loads; `latency` counts from the arrival of its last byte.
        filtered: its loads filtered over time; None where that wasn't asked for.
        dropped: frames left out so far because they had waited too long.
    """

    time: float
    seq: int
    estimate: LoadEstimate
    filtered: list[Contact] | None
    dropped: int


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
    """

    port: str
    format_name: str = "text"
    baud: int = 115200
    duration: float | None = None
    latency: float = 0.1
    log: Path | None = None
    as_json: bool = False
    smooth: bool = False

    def __post_init__(self) -> None:
        if not self.latency > 0:
            raise ValueError(f"--latency {self.latency:g}: a time above zero is needed")


@dataclass
class _Frame:
    seq: int
    time: float
    arrived: float
    modules: dict[int, tuple[int | None, ...]] = field(default_factory=dict)


class FrameBuilder:
    """Puts modules of equal seq together.

    A frame is complete when all modules of the skin have spoken, or when the next begins.

    Args:
        layout: of the skin.
    """

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._expected = set(layout.module.tolist())
        self._open: _Frame | None = None

    def feed(self, judged: Judged) -> Iterator[tuple[_Frame, NDArray[np.float64]]]:
        """Take a reading; yield the frames that it completes."""
        reading = judged.reading
        if judged.flags.duplicate:
            return
        now = self._open
        if now is not None and (now.seq != reading.seq or reading.module in now.modules):
            yield now, self._readings(now)
            now = None
        if now is None:
            stamp = judged.t_device if np.isfinite(judged.t_device) else reading.t_host
            now = _Frame(reading.seq, float(stamp), reading.t_host)
        now.modules[reading.module] = reading.counts
        now.arrived = reading.t_host
        self._open = now
        if set(now.modules) >= self._expected:
            self._open = None
            yield now, self._readings(now)

    def _readings(self, frame: _Frame) -> NDArray[np.float64]:
        width = max(len(counts) for counts in frame.modules.values())
        so = np.full((len(frame.modules), width), np.nan)
        for row, counts in enumerate(frame.modules.values()):
            so[row, : len(counts)] = [np.nan if c is None else c for c in counts]
        modules = list(frame.modules)
        self._layout.check(modules, so, f"frame {frame.seq}")
        return self._layout.pick(modules, so)


def live_frames(
    stream: Stream,
    estimator: LoadEstimator,
    *,
    latency: float = 0.1,
    smooth: bool = False,
    clock: Callable[[], float] = time.monotonic,
    on_reading: Callable[[Judged], None] = lambda judged: None,
    idle: Callable[[], None] = lambda: None,
) -> Iterator[LiveFrame]:
    """Estimate the loads of a stream's frames as they come.

    Args:
        stream: of readings; set its `stop` to end.
        estimator: made with `live=True`.
        latency: a frame that has waited longer before its turn is dropped [s].
        smooth: also filter over time.
        clock: the stream's.
        on_reading: called with every reading, dropped or not.
        idle: called ten times a second or more.
    """
    builder = FrameBuilder(Layout(estimator.spec))
    watch = StuckWatch(estimator.reading_noise, estimator.taxels)
    track = LoadFilter() if smooth else None
    dropped = 0
    for batch in stream.batches():
        idle()
        for judged in batch:
            on_reading(judged)
            for frame, so in _built(builder, judged):
                if so is None:
                    nothing = LoadEstimate(None, status="layout_mismatch")
                    yield LiveFrame(frame.time, frame.seq, nothing, None, dropped)
                    continue
                stuck = watch.feed(so)
                if clock() - frame.arrived > latency:
                    dropped += 1
                    continue
                estimate = estimator.estimate(so[None], stuck[None])[0]
                smoothed = None if track is None else track.feed(frame.time, estimate)
                estimate = replace(estimate, latency=clock() - frame.arrived)
                yield LiveFrame(frame.time, frame.seq, estimate, smoothed, dropped)


def _built(
    builder: FrameBuilder, judged: Judged
) -> Iterator[tuple[_Frame, NDArray[np.float64] | None]]:
    try:
        yield from builder.feed(judged)
    except LayoutMismatchError:
        reading = judged.reading
        stamp = judged.t_device if np.isfinite(judged.t_device) else reading.t_host
        yield _Frame(reading.seq, float(stamp), reading.t_host), None


def warm_up(estimator: LoadEstimator) -> None:
    """Compile what a stream needs before the first frame comes."""
    table = estimator.table
    middle = len(table.angles) // 2
    single = table.so[middle, table.so.shape[1] // 2]
    rest = estimator.rest
    shift = 0.0 if rest is None else np.nan_to_num(rest - table.rest)
    estimator.estimate((single + shift)[None])
    if estimator.most_contacts > 1:
        quarter = len(table.angles) // 4
        pair = table.so[quarter, -6] + table.so[-quarter, -6] - table.rest
        estimator.estimate((pair + shift)[None])
    estimator.forget()


def run_live(estimator: LoadEstimator, options: LiveOptions) -> None:
    """`suas invert --live`: until Ctrl-C, SIGTERM or the end of the duration."""
    from datetime import UTC, datetime

    from fitting.inverse_load.live.view import LoadView
    from suas_jax.acquisition.frames.registry import decoder, open_source
    from suas_jax.acquisition.log.log_file import LogWriter, log_header
    from suas_jax.acquisition.log.record import FLAG_COLUMNS, write_reading
    from suas_jax.acquisition.signals import ended_by_signal

    decode = decoder(options.format_name)
    writer: LogWriter | None = None
    if options.log is not None:
        electrodes = estimator.spec.electrodes
        assert electrodes is not None
        header = log_header(
            scale=f"{1e15 * electrodes.lsb:.6g} fF",
            start_time=datetime.now(UTC),
            port=options.port,
            frame_format=options.format_name,
        )
        flags = FLAG_COLUMNS + decode.extra_columns
        writer = LogWriter(options.log, header, flags=flags)
    try:
        warm_up(estimator)
        source = open_source(options.port, options.format_name, options.baud)
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
                        typer.echo(json.dumps(finite(line), allow_nan=False))
                    view.update(frame)
            view.say(f"{options.port}: {frames} frames estimated, {dropped} dropped")
    finally:
        if writer is not None:
            writer.close()
