"""A timeline that is played, stopped, or at any place: of logs and of histories."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from fitting.arrays import Floats
from fitting.view.hub import Hub

_SPEEDS = (0.01, 0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 20.0)
_TICK = 1 / 30  # between two pictures while it is played [s]
_LOOK = 0.25  # between two looks whether to end, while it stands still [s]


class Player:
    """Where on a timeline the page is.

    `times`: of the frames, never falling [s]. `seconds`: that playing all of it shall take at
    first, as near as a speed comes; real time where not given.
    """

    def __init__(self, times: Floats, seconds: float | None = None) -> None:
        self._time, self._place, self._playing = times, float(times[0]), True
        length = float(times[-1] - times[0])
        wanted = 1.0 if seconds is None or not length else length / seconds
        self._speed = min(_SPEEDS, key=lambda speed: abs(np.log(speed / wanted)))

    @property
    def timeline(self) -> dict[str, Any]:
        """What the page's controls need to know."""
        ends = {"first": float(self._time[0]), "last": float(self._time[-1])}
        return {**ends, "speeds": list(_SPEEDS), "frames": len(self._time)}

    @property
    def header(self) -> dict[str, Any]:
        """Keys of a picture's header."""
        return {"playing": self._playing, "speed": self._speed}

    @property
    def index(self) -> int:
        """Number of the frame that is shown."""
        return max(int(np.searchsorted(self._time, self._place, side="right")) - 1, 0)

    def run(
        self,
        hub: Hub,  # that pages wish at
        over: Callable[[], bool],  # whether to end
        show: Callable[[int], None],  # shows a frame
        state: Callable[[int], Any] = lambda index: None,
    ) -> None:
        """Play until it is over. `state`: what of a frame may change while it is shown."""
        last, shown = time.monotonic(), None
        while not (over() or hub.closed):
            now = time.monotonic()
            if self._playing:
                self._place += self._speed * (now - last)
                if self._place >= self._time[-1]:
                    self._place, self._playing = float(self._time[-1]), False
            last = now
            index = self.index
            current = (index, state(index), self._playing, self._speed)
            if current != shown:
                shown = current
                show(index)
            wishes = hub.wishes(_TICK if self._playing else _LOOK)
            self._place = wishes.get("seek", self._place)
            self._speed = wishes.get("speed", self._speed)
            self._playing = wishes.get("play", self._playing)
            if wishes.get("play") and self._place >= self._time[-1]:
                self._place = float(self._time[0])
