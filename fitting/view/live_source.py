"""Pictures of a live port: the newest frame with its loads, and the state of the link."""

import time

import numpy as np

from fitting.inverse_load.live.stream import LiveFrame, LiveWatcher
from fitting.view.hub import Hub
from fitting.view.readings_picture import ReadingsPictures
from suas_jax.acquisition.stream import SILENT_AFTER, Stream

_WORDS = {
    "waiting": "Waiting for the first frame.",
    "link_lost": "The port is gone: unplugged? The program waits for it to come back.",
    "silent": "The device is silent: is it powered, does it send? The program listens.",
    "layout_mismatch": "The readings are of another layout than the skin's.",
}
_SHORTEST = 0.02  # between two pictures [s]
_REMIND = 0.5  # between two pictures while nothing comes [s]


class LiveSource(LiveWatcher):
    """Shows a live run.

    `pictures`: of the skin. `title`: what the page calls it, such as the port's name.
    """

    def __init__(self, pictures: ReadingsPictures, title: str) -> None:
        self._pictures = pictures
        self.hub = Hub(pictures.description(title, source="live"))
        self._began = time.monotonic()
        self._last: float | None = None
        self._arrived = self._began
        self._frames = 0
        self._told = self._began - _REMIND
        self._state(self._began, "waiting")

    def said(self, sentence: str) -> None:
        """Show a sentence."""
        self.hub.say(sentence)

    def estimated(self, frame: LiveFrame) -> None:
        """Show a frame."""
        now = time.monotonic()
        readings = frame.readings
        if readings is None:
            self._state(now, "layout_mismatch")
            return
        self._frames += 1
        self._arrived = now
        if self._last is not None and now - self._last < _SHORTEST:
            return  # no page could show both
        self._last = now
        picture = self._pictures.picture(
            now - self._began,
            readings.so,
            readings.stuck,
            frame.estimate,
            [
                ("latency", f"{1e3 * frame.estimate.latency:.1f} ms"),
                ("frame", f"{frame.seq}, {frame.dropped} dropped"),
            ],
            link="connected",
        )
        picture.made = readings.arrived
        self.hub.show(picture)

    def waited(self, stream: Stream) -> None:
        """Show that the link is lost, or that nothing comes."""
        now = time.monotonic()
        if now - self._told < _REMIND:
            return
        if stream.lost_link:
            self._state(now, "link_lost")
        elif now - self._arrived > SILENT_AFTER:
            self._state(now, "silent" if self._frames else "waiting")

    def _state(self, now: float, status: str) -> None:
        """The last readings under another status, without loads."""
        self._told = now
        count = len(self._pictures.film.rest)
        nothing = np.full(count, np.nan)
        picture = self._pictures.picture(
            now - self._began,
            nothing,
            np.zeros(count, bool),
            None,
            [("last frame", f"{now - self._arrived:.1f} s ago")] if self._frames else [],
            link=status,
        )
        picture.status, picture.message = status, _WORDS[status]
        self.hub.show(picture)
