"""Loads from a port, frame by frame: bounded latency, frames dropped rather than lagging.

A thread of `suas_jax.acquisition.stream` takes the bytes away from the port; here frames
are put together and estimated in order. Where one has waited too long, the newest is next.
"""

import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from fitting.arrays import Flags, Floats
from fitting.inverse_load.estimate.estimate import Contact, LoadEstimate
from fitting.inverse_load.estimator import LoadEstimator
from fitting.inverse_load.live.filter import LoadFilter
from fitting.inverse_load.readings import Layout, LayoutMismatchError, StepWatch
from fitting.inverse_load.report.text import frame_json
from fitting.json_text import json_text
from suas_jax.acquisition.stream import Judged, Stream
from suas_jax.acquisition.taxel_faults import StuckWatch


class FrameReadings(NamedTuple):
    """Readings of one frame of a stream."""

    time: float  # on the device's clock if it has one, else on the host's [s]
    seq: int  # frame number
    arrived: float  # host time of its last byte [s]
    so: Floats  # readings [taxel] [counts]; NaN where missing
    stuck: Flags  # taxels that repeat one count beyond chance [taxel]


class LiveFrame(NamedTuple):
    """One frame of a stream with its loads."""

    time: float  # on the device's clock if it has one, else on the host's [s]
    seq: int  # frame number
    estimate: LoadEstimate  # its loads; `latency` counts from the arrival of its last byte
    # its loads filtered over time; None where that wasn't asked for
    filtered: list[Contact] | None
    dropped: int  # frames left out so far because they had waited too long
    # that it was estimated from; None where they are of another layout
    readings: FrameReadings | None = None


@dataclass
class _Frame:
    seq: int
    time: float
    arrived: float
    modules: dict[int, tuple[int | None, ...]] = field(default_factory=dict)


class FrameBuilder:
    """Puts modules of equal seq together.

    A frame is complete when all modules of the skin have spoken, or when the next begins.
    """

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._expected = set(layout.module.tolist())
        self._open: _Frame | None = None

    def feed(self, judged: Judged) -> Iterator[tuple[_Frame, Floats]]:
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

    def _readings(self, frame: _Frame) -> Floats:
        source = f"frame {frame.seq}"
        self._layout.check_sent({m: len(c) for m, c in frame.modules.items()}, source)
        width = max(len(counts) for counts in frame.modules.values())
        so = np.full((len(frame.modules), width), np.nan)
        for row, counts in enumerate(frame.modules.values()):
            so[row, : len(counts)] = [np.nan if c is None else c for c in counts]
        modules = list(frame.modules)
        self._layout.check(modules, so.__getitem__, source)
        return self._layout.pick(modules, so.__getitem__)


def live_frames(
    stream: Stream,  # of readings; set its `stop` to end
    estimator: LoadEstimator,  # made with `live=True`
    *,
    latency: float = 0.1,
    smooth: bool = False,  # also filter over time
    clock: Callable[[], float] = time.monotonic,  # the stream's
    on_reading: Callable[[Judged], None] = lambda judged: None,
    on_frame: Callable[[FrameReadings], None] = lambda frame: None,
    idle: Callable[[], None] = lambda: None,  # called ten times a second or more
) -> Generator[LiveFrame, None, None]:
    """Loads of a stream's frames, in the order of arrival.

    Once a frame has waited longer than the latency [s] before its turn, it and all others up to
    the newest are dropped; the newest is always estimated. `on_reading` is called with every
    reading, `on_frame` with every frame of the skin's layout, dropped or not.
    """
    builder = FrameBuilder(Layout(estimator.spec))
    watch, steps = StuckWatch(estimator.reading_noise, estimator.taxels), StepWatch()
    track = LoadFilter() if smooth else None
    dropped, behind = 0, False
    for batch in stream.batches():
        idle()
        built: list[tuple[_Frame, Floats | None]] = []
        for judged in batch:
            on_reading(judged)
            built += _built(builder, judged)
        for number, (frame, so) in enumerate(built, 1):
            if so is None:
                nothing = LoadEstimate(None, status="layout_mismatch")
                yield LiveFrame(frame.time, frame.seq, nothing, None, dropped)
                continue
            stuck = watch.feed(so, steps.feed(so))
            readings = FrameReadings(frame.time, frame.seq, frame.arrived, so, stuck)
            on_frame(readings)
            behind = behind or clock() - frame.arrived > latency
            if behind and (number < len(built) or stream.waiting):
                dropped += 1
                continue
            behind = False  # nothing newer is there
            now = np.array([readings.time])
            estimate = estimator.estimate(readings.so[None], readings.stuck[None], time=now)[0]
            smoothed = None if track is None else track.feed(readings.time, estimate)
            estimate = replace(estimate, latency=clock() - readings.arrived)
            yield LiveFrame(readings.time, readings.seq, estimate, smoothed, dropped, readings)


def _built(builder: FrameBuilder, judged: Judged) -> Iterator[tuple[_Frame, Floats | None]]:
    try:
        yield from builder.feed(judged)
    except LayoutMismatchError:
        reading = judged.reading
        stamp = judged.t_device if np.isfinite(judged.t_device) else reading.t_host
        yield _Frame(reading.seq, float(stamp), reading.t_host), None


class LiveWatcher:
    """Takes part in a live run; each method does nothing unless overridden."""

    def said(self, sentence: str) -> None:
        """Take a sentence that a person should know, such as that a link is lost."""

    def read(self, frame: FrameReadings) -> None:
        """Take a frame's readings, whether it will be estimated or dropped."""

    def estimated(self, frame: LiveFrame) -> None:
        """Take a frame's loads."""

    def waited(self, stream: Stream) -> None:
        """Look at the stream; called ten times a second or more."""


def json_line(frame: LiveFrame) -> str:
    """A frame as `suas invert --json` prints it."""
    line = frame_json(
        frame.time, frame.seq, frame.estimate, frame.filtered, dropped=frame.dropped
    )
    return json_text(line)
