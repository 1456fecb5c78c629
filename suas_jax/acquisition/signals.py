"""End a stream, not the process, when a person or the system asks for it."""

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType

from suas_jax.acquisition.stream import Stream


@contextlib.contextmanager
def set_by_signal(stop: threading.Event) -> Iterator[None]:
    """Ctrl-C, SIGTERM and a closed terminal set an event instead of ending the process."""

    def end(_signal: int, _frame: FrameType | None) -> None:
        stop.set()

    names = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")  # not every system has all
    known = [getattr(signal, name) for name in names if hasattr(signal, name)]
    before = {number: signal.signal(number, end) for number in known}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def ended_by_signal(stream: Stream) -> contextlib.AbstractContextManager[None]:
    """Signals end the stream; see `set_by_signal`."""
    return set_by_signal(stream.stop)
