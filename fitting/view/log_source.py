"""Pictures of a log: played, stopped, or at any place of its timeline."""

import threading
import time
from collections.abc import Callable, Sequence

import numpy as np

from fitting.inverse_load.estimate.estimate import LoadEstimate
from fitting.inverse_load.log.log_estimator import LogEstimator
from fitting.inverse_load.readings import LogReadings
from fitting.view.hub import Hub, Player
from fitting.view.picture import total_force
from fitting.view.readings_picture import ReadingsPictures

_BLOCK = 64  # frames estimated together
_CHARTED = 1.0  # between two additions to the charts [s]


class LogSource:
    """A log on a timeline; loads are estimated in the background, or given."""

    def __init__(
        self,
        readings: LogReadings,  # of the log
        pictures: ReadingsPictures,  # of its skin
        title: str,  # what the page calls it
        *,
        # finds the loads; None where `estimates` has them, or nobody does
        estimator: LogEstimator | None = None,
        # of the log's frames, where they are known
        estimates: Sequence[LoadEstimate] | None = None,
    ) -> None:
        self._readings, self._pictures, self._estimator = readings, pictures, estimator
        count = len(readings.so)
        self._estimates: list[LoadEstimate | None] = [None] * count
        if estimates is not None:
            self._estimates = list(estimates)
        # Device clocks may begin again: the timeline never runs backwards.
        self._time = np.maximum.accumulate(readings.time - readings.time[0])
        self._player = Player(self._time)
        timeline = self._player.timeline
        self.hub = Hub(pictures.description(title, source="log", timeline=timeline))

    def run(self, over: Callable[[], bool]) -> None:
        """Play until it is over."""
        for note in self._readings.notes:
            self.hub.say(note)
        self._chart()
        worker = threading.Thread(target=self._estimate, args=(over,), daemon=True)
        worker.start()
        self._player.run(
            self.hub, over, self._show, lambda index: self._estimates[index] is not None
        )
        worker.join(timeout=5)

    def _show(self, index: int) -> None:
        readings = self._readings
        rows = [("frame", f"{readings.seq[index]} ({index + 1} of {len(readings.so)})")]
        picture = self._pictures.picture(
            float(self._time[index]),
            readings.so[index],
            readings.stuck[index],
            self._estimates[index],
            rows,
            **self._player.header,
        )
        self.hub.show(picture)

    def _estimate(self, over: Callable[[], bool]) -> None:
        """Estimate the whole log, the frames behind the place that is shown last."""
        if self._estimator is None:
            return
        charted = time.monotonic()
        open_ = np.array([estimate is None for estimate in self._estimates])
        while open_.any() and not (over() or self.hub.closed):
            begin = self._player.index
            ahead = np.flatnonzero(open_[begin:])
            index = begin + ahead if ahead.size else np.flatnonzero(open_)
            index = index[:_BLOCK]
            found = self._estimator.of_frames(index)
            for i, estimate in zip(index.tolist(), found, strict=True):
                self._estimates[i] = estimate
            open_[index] = False
            if time.monotonic() - charted > _CHARTED or not open_.any():
                charted = time.monotonic()
                self._chart()
        if not open_.any():
            self.hub.say(f"all {len(open_)} frames estimated")

    def _chart(self) -> None:
        known = [
            (float(t), total_force(estimate), estimate.oil_pressure)
            for t, estimate in zip(self._time, self._estimates, strict=True)
            if estimate is not None
        ]
        self.hub.chart(known)
