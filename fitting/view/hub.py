"""Between a source of pictures and the pages that show them: the newest of each.

The source works in one thread, the server in another. Nothing piles up: a picture that no
page has taken is replaced by the next, and so is a wish (a slider's value, a place in the
log) that the source has not yet looked at.
"""

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from fitting.arrays import Floats
from fitting.view.picture import Picture

_MOST_SENTENCES = 8
_MOST_SAMPLES = 3000  # of the charts
_MOST_LATENCIES = 10_000
_SPEEDS = (0.01, 0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 20.0)
_TICK = 1 / 30  # between two pictures while it is played [s]
_LOOK = 0.25  # between two looks whether to end, while it stands still [s]


class Message(NamedTuple):
    """A picture as it is sent."""

    number: int  # of the picture
    content: bytes  # its bytes
    made: float  # when the picture was made, by `time.monotonic` [s]


class Hub:
    """What source and server share.

    `description`: what a page needs to know once, see `fitting.view.picture`.
    """

    def __init__(self, description: dict[str, Any]) -> None:
        self.description = description
        self.on_news: Callable[[], None] = lambda: None
        self._lock = threading.Condition()
        self._wishes: dict[str, Any] = {}
        self._picture: Picture | None = None
        self._number = 0
        self._encoded = Message(0, b"", 0.0)
        self._samples: deque[tuple[float, float, float]] = deque(maxlen=_MOST_SAMPLES)
        self._whole: list[tuple[float, float, float]] | None = None
        self._sentences: deque[str] = deque(maxlen=_MOST_SENTENCES)
        self._closed = False
        self.edition = 0  # grows when the history has changed otherwise than by a picture
        # from the making of a picture until a page had drawn it [s]
        self.latencies: deque[float] = deque(maxlen=_MOST_LATENCIES)

    # --- the source's side ------------------------------------------------------------

    def show(self, picture: Picture) -> None:
        """Replace the picture, and go on with the charts."""
        with self._lock:
            self._picture, self._number = picture, self._number + 1
            if self._whole is None:
                self._samples.append((picture.time, picture.force, picture.oil_pressure))
        self.on_news()

    def chart(self, samples: list[tuple[float, float, float]]) -> None:
        """Show these samples (time, force, oil pressure) instead of the pictures' own."""
        with self._lock:
            step = max(1, math.ceil(len(samples) / _MOST_SAMPLES))
            self._whole = samples[::step]
            self.edition += 1
        self.on_news()

    def say(self, sentence: str) -> None:
        """Show a sentence, with the time of day."""
        with self._lock:
            self._sentences.append(f"{time.strftime('%H:%M:%S')}  {sentence}")
            self.edition += 1
        self.on_news()

    def wishes(self, timeout: float) -> dict[str, Any]:
        """What pages wish since the last call; waits for a wish.

        `timeout`: longest wait [s].
        """
        with self._lock:
            if not self._wishes and not self._closed:
                self._lock.wait(timeout)
            wishes, self._wishes = self._wishes, {}
            return wishes

    @property
    def closed(self) -> bool:
        """Whether the server has ended."""
        return self._closed

    # --- the server's side ------------------------------------------------------------

    def wish(self, name: str, value: Any) -> None:
        """Take a wish, which replaces an older one of the same name."""
        with self._lock:
            self._wishes[name] = value
            self._lock.notify_all()

    def newest(self, after: int) -> Message | None:
        """The newest picture's message, if its number is above another.

        It is encoded once for all pages, and only if one asks.
        """
        with self._lock:
            picture, number = self._picture, self._number
        if picture is None or number <= after:
            return None
        if self._encoded.number != number:
            self._encoded = Message(number, picture.encoded(number), picture.made)
        return self._encoded

    def drawn(self, latency: float) -> None:
        """Take how long a picture took from its making to the page [s]."""
        self.latencies.append(latency)

    def history(self) -> dict[str, Any]:
        """Charts and sentences so far."""
        with self._lock:
            samples = self._whole if self._whole is not None else list(self._samples)
            return {
                "type": "history",
                "whole": self._whole is not None,
                "samples": [list(sample) for sample in samples],
                "sentences": list(self._sentences),
            }

    def close(self) -> None:
        """End: a source that waits for wishes returns."""
        with self._lock:
            self._closed = True
            self._lock.notify_all()


def understood(message: dict[str, Any], description: dict[str, Any]) -> tuple[str, Any] | None:
    """Name and value of a wish; None where the message is none.

    Values are kept within what the description of the skin allows.

    `description`: of the skin and its controls, as the page got it.
    """
    kind, value = message.get("type"), message.get("value")
    if kind == "set":
        sliders = {slider["name"]: slider for slider in description.get("sliders", ())}
        slider = sliders.get(str(message.get("name")))
        if slider is None or not isinstance(value, int | float):
            return None
        return slider["name"], _within(value, slider["least"], slider["most"])
    if kind == "play" and isinstance(value, bool):
        return "play", value
    timeline = description.get("timeline")
    if timeline and isinstance(value, int | float):
        if kind == "seek":
            return "seek", _within(value, timeline["first"], timeline["last"])
        if kind == "speed" and value in timeline["speeds"]:
            return "speed", float(value)
    return None


def _within(value: float, least: float, most: float) -> float:
    """The value, or the end that it is beyond; the least where it is not a number."""
    # Compared as it is: a whole number of 400 digits can't be converted.
    return float(min(max(value, least), most)) if value == value else least


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
