"""What takes part in a live run: shows frames, sends them on, or records them."""

from fitting.inverse_load.live.stream import FrameReadings, LiveFrame
from fitting.inverse_load.report.text import frame_json
from fitting.json_text import json_text
from suas_jax.acquisition.stream import Stream


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
