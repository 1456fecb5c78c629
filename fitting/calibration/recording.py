"""Record the steps of a guided calibration from a port, each once it is held steadily."""

import time
from collections import deque
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.live.stream import FrameBuilder
from fitting.inverse_load.readings import Layout
from suas_jax.acquisition.health import MIN_FRAMES
from suas_jax.acquisition.stream import Judged, Stream
from suas_jax.acquisition.taxel_faults import mean, noise_by_taxel

_TOUCHED = 8.0  # standard errors of a mean, and counts beside them
_LEAST_CHANGE = 3.0
_SILENT = 5.0  # a pause of the device after which its frames are no longer of one touch [s]
_STEADY, _PARTS = 6.0, 10
_STEADY_SHARE = 0.02  # of the change, that a hand may tremble

_MOST_ROWS = 200_000  # kept while a step lasts
# Frames at rest: a fifth is cut off, and the taxels are judged by what is left.
REST_FRAMES = 3 * MIN_FRAMES // 2
_LIFTED = 0.3  # time without contact after which the load is taken to be off [s]


class Rest(NamedTuple):
    """Readings of the untouched skin."""

    so: Floats  # their mean [taxel] [counts]; NaN where a taxel is silent
    noise: Floats  # standard deviation of one [taxel] [counts]


class SteadyWindow:
    """The last frames of a stream.

    The window is `hold` [s] long; it is longer where a slow device takes longer for the fewest
    frames. Readings at rest are None while they are unknown.
    """

    def __init__(self, hold: float, rest: Rest | None = None, *, fewest: int = 50) -> None:
        self._hold, self._fewest = hold, fewest
        self._rest = rest
        self._frames: deque[tuple[float, Floats]] = deque()

    def feed(self, time: float, so: Floats) -> None:
        """Take a frame. `time`: of the frame [s]. `so`: readings [taxel] [counts]."""
        if self._frames and not 0 <= time - self._frames[-1][0] < _SILENT:
            self._frames.clear()  # the device started again, or was silent
        self._frames.append((time, so))
        while len(self._frames) > self._fewest and time - self._frames[0][0] > self._hold:
            self._frames.popleft()

    @property
    def settled(self) -> float:
        """Time after a fifth of the window, in which the load may still have settled [s]."""
        return 0.8 * self._frames[0][0] + 0.2 * self._frames[-1][0]

    @property
    def full(self) -> bool:
        """Whether the frames span the window, but for a twentieth."""
        if len(self._frames) < self._fewest:
            return False
        return self._frames[-1][0] - self._frames[0][0] > 0.95 * self._hold

    def measured(self) -> Rest:
        """Mean and noise of the frames."""
        so = self._readings()
        return Rest(mean(so), noise_by_taxel(so))

    def touched(self) -> bool:
        """Whether the last tenth of the frames is away from rest."""
        if self._rest is None:
            return False
        last = self._readings()[-max(len(self._frames) // 10, 3) :]
        noise = np.hypot(np.nan_to_num(self._rest.noise), 12**-0.5)
        allowed = _TOUCHED * noise / np.sqrt(len(last)) + _LEAST_CHANGE
        return bool((np.abs(mean(last) - self._rest.so) > allowed).any())

    def steady(self) -> bool:
        """Whether the window is full and its tenths agree."""
        if not self.full:
            return False
        so = self._readings()
        rest = self.measured() if self._rest is None else self._rest
        noise = np.hypot(np.nan_to_num(rest.noise), 12**-0.5)
        whole = mean(so)
        parts = np.array_split(so, _PARTS)
        moved = np.array([np.abs(mean(part) - whole) for part in parts])
        change = np.nan_to_num(np.abs(whole - rest.so)).max()
        error = noise / np.sqrt(len(so) / _PARTS)
        allowed = _STEADY * error + 1.0 + _STEADY_SHARE * change
        return not bool((moved > allowed).any())

    def _readings(self) -> Floats:
        return np.array([so for _, so in self._frames])


class InterruptedStepError(ValueError):
    """A step was not done; the steps before it are kept."""


class StepRecorder:
    """Takes a stream's frames and cuts the steady ones out."""

    def __init__(
        self,
        stream: Stream,  # of the port
        layout: Layout,
        *,
        hold: float,  # how long a load is to be held still [s]
        timeout: float,  # how long a step may take [s]
        say: Callable[[str], None],  # called with what a person should do
    ) -> None:
        self._hold, self._timeout, self._say = hold, timeout, say
        self._builder = FrameBuilder(layout)
        self._rows: deque[Judged] = deque(maxlen=_MOST_ROWS)
        self._stream = stream
        self._batches = stream.batches()

    def rest(self) -> tuple[list[Judged], Rest]:
        """Rows of a steady window, and their readings.

        Raises InterruptedStepError: the time is over, or the stream ended.
        Raises LayoutMismatchError: the device is of another layout.
        """
        for window in self._windows(SteadyWindow(self._hold, fewest=REST_FRAMES)):
            if window.steady():
                return self._cut(window), window.measured()
        raise InterruptedStepError("the readings never came to rest")

    def press(self, rest: Rest) -> list[Judged]:
        """Rows of a steady window under a load; returns once the load is off again.

        Raises InterruptedStepError, LayoutMismatchError: as for `rest`.
        """
        touched = False
        for window in self._windows(SteadyWindow(self._hold, rest)):
            if window.touched() and not touched:
                self._say("touched: hold still")
                touched = True
            if window.touched() and window.steady():
                rows = self._cut(window)
                self._say("recorded: lift off")
                self._lifted(rest)
                return rows
        raise InterruptedStepError(
            "the load was never held still" if touched else "nothing touched the skin"
        )

    def close(self) -> None:
        """End the stream, and let go of its port."""
        self._stream.close()
        self._batches.close()

    def _lifted(self, rest: Rest) -> None:
        for window in self._windows(SteadyWindow(_LIFTED, rest)):
            if not window.touched():
                return
        raise InterruptedStepError("the load was not taken off")

    def _windows(self, window: SteadyWindow) -> Iterator[SteadyWindow]:
        """The window after every frame, once it is full, until the time is over."""
        begin = time.monotonic()
        for batch in self._batches:
            if time.monotonic() - begin > self._timeout:
                return
            for judged in batch:
                self._rows.append(judged)
                for frame, so in self._builder.feed(judged):
                    window.feed(frame.time, so)
                    if window.full:
                        yield window

    def _cut(self, window: SteadyWindow) -> list[Judged]:
        """The rows of the window's frames, less the first fifth."""
        rows: list[Judged] = []
        for judged in reversed(self._rows):
            device = judged.t_device
            if (device if device == device else judged.reading.t_host) < window.settled:
                break
            rows.append(judged)
        return rows[::-1]
