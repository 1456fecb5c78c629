"""Searches in steps, so that a frame of a stream can return before its search has ended.

A search is a generator: it yields the name of every step before it takes it, and returns what
it found. Where time does not press all are taken (`finished`). A frame of a stream may have a
budget of time; what is left of its search then goes on with the next frames.
"""

import contextlib
import threading
import time
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import Future, wait
from typing import Any, Generic, TypeVar

T = TypeVar("T")
Steps = Generator[str | Future[Any], None, T]
"""Yields names of steps, or what goes on by itself and has to be waited for."""


def finished(steps: Steps[T]) -> T:
    """What a search finds, all of its steps taken."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            found: T = end.value
            return found


class Budget:
    """Time that a frame may take.

    A step begins where there is time for as long as it took before. One that is put off for
    want of time is the first of the next frame, whatever it takes: a search always goes on.
    """

    def __init__(
        self,
        seconds: float,  # a frame may take [s]
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self.seconds, self.clock = seconds, clock
        self._took: dict[str, float] = {}  # of steps, by name [s]
        self._end = float("inf")

    def begin(self, seconds: float | None = None) -> None:
        """Begin a frame; of another time [s] where it is given."""
        self._end = self.clock() + (self.seconds if seconds is None else seconds)

    @property
    def left(self) -> float:
        """What is left of the frame's time [s]."""
        return max(self._end - self.clock(), 0.0)

    def allows(self, step: str) -> bool:
        """Whether there is time for a step."""
        return self.clock() + self._took.get(step, 0.0) <= self._end

    def took(self, step: str, seconds: float) -> None:
        """Take note of how long a step took [s]."""
        self._took[step] = seconds

    @contextlib.contextmanager
    def timing(self, step: str) -> Iterator[None]:
        """Take a step and note how long it takes."""
        begin = self.clock()
        yield
        self.took(step, self.clock() - begin)


class Search(Generic[T]):
    """One search, as far as it went. `found`: what it found; None before it ended."""

    def __init__(self, steps: Steps[T], budget: Budget) -> None:
        self._steps, self._budget = steps, budget
        self._step: str | Future[Any] = "begin"
        self._put_off = self._ended = False
        self.found: T | None = None

    def go_on(self) -> bool:
        """Take steps while there is time; whether the search has ended."""
        while not self._ended:
            step, begin = self._step, self._budget.clock()
            if isinstance(step, Future):
                wait([step], min(self._budget.left, threading.TIMEOUT_MAX))
                if not step.done():
                    return False
            elif not (self._put_off or self._budget.allows(step)):
                self._put_off = True
                return False
            self._put_off = False
            try:
                self._step = next(self._steps)
            except StopIteration as end:
                self.found, self._ended = end.value, True
            if isinstance(step, str):
                self._budget.took(step, self._budget.clock() - begin)
        return True
