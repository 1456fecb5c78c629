"""Record the steps of a guided calibration from a port, each once it is held steadily."""

import time
from collections import deque
from collections.abc import Callable, Iterator

from fitting.calibration.steadiness import Rest, SteadyWindow
from fitting.inverse_load.live.stream import FrameBuilder
from fitting.inverse_load.readings import Layout
from suas_jax.acquisition.health import MIN_FRAMES
from suas_jax.acquisition.stream import Judged, Stream

_MOST_ROWS = 200_000  # kept while a step lasts
# Frames at rest: a fifth is cut off, and the taxels are judged by what is left.
REST_FRAMES = 3 * MIN_FRAMES // 2
_LIFTED = 0.3  # time without contact after which the load is taken to be off [s]


class InterruptedStepError(ValueError):
    """A step was not done; the steps before it are kept."""


class StepRecorder:
    """Takes a stream's frames and cuts the steady ones out.

    Args:
        stream: of the port.
        layout: of the skin.
        hold: how long a load is to be held still [s].
        timeout: how long a step may take [s].
        say: called with what a person should do.
    """

    def __init__(
        self,
        stream: Stream,
        layout: Layout,
        *,
        hold: float,
        timeout: float,
        say: Callable[[str], None],
    ) -> None:
        self._hold, self._timeout, self._say = hold, timeout, say
        self._builder = FrameBuilder(layout)
        self._rows: deque[Judged] = deque(maxlen=_MOST_ROWS)
        self._stream = stream
        self._batches = stream.batches()

    def rest(self) -> tuple[list[Judged], Rest]:
        """Rows of a steady window, and their readings.

        Raises:
            InterruptedStepError: the time is over, or the stream ended.
            LayoutMismatchError: the device is of another layout.
        """
        for window in self._windows(SteadyWindow(self._hold, fewest=REST_FRAMES)):
            if window.steady():
                return self._cut(window), window.measured()
        raise InterruptedStepError("the readings never came to rest")

    def press(self, rest: Rest) -> list[Judged]:
        """Rows of a steady window under a load; returns once the load is off again.

        Args:
            rest: readings of the untouched skin.

        Raises:
            InterruptedStepError, LayoutMismatchError: as for `rest`.
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
