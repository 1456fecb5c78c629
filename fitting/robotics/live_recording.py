"""A live run as a recording."""

import time

from fitting.inverse_load.live.stream import FrameReadings, LiveFrame
from fitting.inverse_load.live.watcher import LiveWatcher
from fitting.robotics.recording import Recording


class LiveRecording(LiveWatcher):
    """Writes every frame's readings, and the loads of those that were not dropped.

    Args:
        recording: to write to.
    """

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        # Frames are stamped by the clock that never steps, recordings by the calendar.
        self._epoch = time.time_ns() - round(1e9 * time.monotonic())

    def read(self, frame: FrameReadings) -> None:
        """Write its readings."""
        self._recording.taxels(self._stamp(frame), frame.seq, frame.time, frame.so, frame.stuck)

    def estimated(self, frame: LiveFrame) -> None:
        """Write its loads."""
        if frame.readings is not None:
            stamp = self._stamp(frame.readings)
            self._recording.contacts(stamp, frame.seq, frame.estimate)

    def _stamp(self, frame: FrameReadings) -> int:
        return self._epoch + round(1e9 * frame.arrived)
