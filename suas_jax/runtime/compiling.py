"""Who wants to know that a program is being compiled, which takes longer than its answer."""

import contextlib
from collections.abc import Callable, Iterator


class CompileTime:
    """Time that programs took so far to be traced, compiled and loaded."""

    seconds = 0.0


COMPILE_TIME = CompileTime()
"""That of this process."""
_LISTENERS: list[Callable[[bool], None]] = []


@contextlib.contextmanager
def listening(listener: Callable[[bool], None]) -> Iterator[None]:
    """Call a function with True when compiling begins and with False when it has ended."""
    _LISTENERS.append(listener)
    try:
        yield
    finally:
        _LISTENERS.remove(listener)


@contextlib.contextmanager
def compiling() -> Iterator[None]:
    """A program is compiled meanwhile."""
    for listener in tuple(_LISTENERS):
        listener(True)
    try:
        yield
    finally:
        for listener in tuple(_LISTENERS):
            listener(False)
