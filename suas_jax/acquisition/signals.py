"""End a stream, not the process, when a person or the system asks for it."""

import contextlib
import signal
from collections.abc import Iterator
from types import FrameType

from suas_jax.acquisition.stream import Stream


@contextlib.contextmanager
def ended_by_signal(stream: Stream) -> Iterator[None]:
    """Ctrl-C, SIGTERM and a closed terminal end the stream instead of the process."""

    def end(_signal: int, _frame: FrameType | None) -> None:
        stream.stop.set()

    names = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")  # not every system has all
    known = [getattr(signal, name) for name in names if hasattr(signal, name)]
    before = {number: signal.signal(number, end) for number in known}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
