"""Terminal view of a live estimate: the pad, its readings and where it is pressed."""

import sys
import time
from collections import deque
from typing import TYPE_CHECKING

import numpy as np

from fitting.inverse_load.estimator import LoadEstimator
from fitting.inverse_load.live.stream import LiveFrame, LiveWatcher
from fitting.inverse_load.report.text import contact_text, field_text
from suas_jax.acquisition.terminal import LiveTerminal

if TYPE_CHECKING:
    from rich.table import Table


_WIDTH = 61  # characters of the pad's picture
_WINDOW = 2.0  # rates are means over this time [s]
_REFRESH = 0.1  # between two pictures [s]


class LoadView(LiveTerminal, LiveWatcher):
    """Messages on stderr; on a terminal also a picture that moves.

    The estimator names the skin, the title is the port. `show`: whether a picture is wanted;
    without a terminal there is none.
    """

    def __init__(self, estimator: LoadEstimator, title: str, *, show: bool) -> None:
        super().__init__(show and sys.stderr.isatty(), _REFRESH)
        self._by_arc, self._edge = estimator.along.name == "arc", estimator.along.edge
        self._title = title
        self._times: deque[float] = deque()

    def said(self, sentence: str) -> None:
        """Print a sentence."""
        self.say(sentence)

    def estimated(self, frame: LiveFrame) -> None:
        """Show a frame, a few times a second."""
        now = time.monotonic()
        self._times.append(now)
        while now - self._times[0] > _WINDOW:
            self._times.popleft()
        if self.due():
            self.draw(self._table(frame))

    def _table(self, frame: LiveFrame) -> "Table":
        from rich.table import Table

        estimate = frame.estimate
        table = Table(show_header=False, box=None, title=self._title, title_justify="left")
        if self._by_arc:
            arcs = [c.arc for c in estimate.contacts if c.arc is not None]
            line = picture(arcs, self._edge, unit=" mm", scale=1e3)
        else:
            line = picture([c.angle for c in estimate.contacts], self._edge)
        table.add_row("pad", line)
        for contact in estimate.contacts:
            table.add_row("load", contact_text(contact))
        if estimate.field is not None:
            table.add_row("load", field_text(estimate.field))
        if not np.isnan(estimate.oil_pressure):
            table.add_row("oil", f"{1e-3 * estimate.oil_pressure:.2f} kPa")
        table.add_row("status", estimate.status_text)
        span = max(self._times[-1] - self._times[0], 1e-9)
        rate = (len(self._times) - 1) / span
        table.add_row("rate", f"{rate:.1f} per second, {frame.dropped} dropped")
        table.add_row("latency", f"{1e3 * estimate.latency:.1f} ms")
        return table


def picture(
    angles: list[float], edge: float, *, unit: str = "°", scale: float = 180 / np.pi
) -> str:
    """The pad from edge to edge as a line of characters, a mark at each contact.

    Angles are those of the contacts, or their places along the axis; `edge` is the largest that
    there is. `scale` turns them into the unit that is written at the edges.
    """
    line = ["─"] * _WIDTH
    line[0], line[-1], line[_WIDTH // 2] = "├", "┤", "┼"
    for angle in angles:
        place = round((angle / edge + 1) / 2 * (_WIDTH - 1))
        line[min(max(place, 0), _WIDTH - 1)] = "▼"
    limit = f"{scale * edge:.0f}{unit}"
    return f"-{limit} {''.join(line)} +{limit}"
