"""Whether the skin is touched, and held steadily, over the last frames."""

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from suas_jax.acquisition.missing import mean
from suas_jax.acquisition.taxel_faults import noise_by_taxel

_TOUCHED = 8.0  # standard errors of a mean, and counts beside them
_LEAST_CHANGE = 3.0
_SILENT = 5.0  # a pause of the device after which its frames are no longer of one touch [s]
_STEADY, _PARTS = 6.0, 10
_STEADY_SHARE = 0.02  # of the change, that a hand may tremble


class Rest(NamedTuple):
    """Readings of the untouched skin.

    Attributes:
        so: their mean [taxel] [counts]; NaN where a taxel is silent.
        noise: standard deviation of one [taxel] [counts].
    """

    so: NDArray[np.float64]
    noise: NDArray[np.float64]


class SteadyWindow:
    """The last frames of a stream.

    Args:
        hold: length of the window [s].
        rest: readings at rest; None while they are unknown.
        fewest: frames of the window, which a slow device takes longer for.
    """

    def __init__(self, hold: float, rest: Rest | None = None, *, fewest: int = 50) -> None:
        self._hold, self._fewest = hold, fewest
        self._rest = rest
        self._frames: deque[tuple[float, NDArray[np.float64]]] = deque()

    def feed(self, time: float, so: NDArray[np.float64]) -> None:
        """Take a frame.

        Args:
            time: of the frame [s].
            so: readings [taxel] [counts].
        """
        if self._frames and not 0 <= time - self._frames[-1][0] < _SILENT:
            self._frames.clear()  # the device started again, or was silent
        self._frames.append((time, so))
        while len(self._frames) > self._fewest and time - self._frames[0][0] > self._hold:
            self._frames.popleft()

    @property
    def settled(self) -> float:
        """Time after a fifth of the window, in which the load may still have settled [s]."""
        return 0.8 * self._frames[0][0] + 0.2 * self._frames[-1][0]

    @property
    def full(self) -> bool:
        """Whether the frames span the window, but for a twentieth."""
        if len(self._frames) < self._fewest:
            return False
        return self._frames[-1][0] - self._frames[0][0] > 0.95 * self._hold

    def measured(self) -> Rest:
        """Mean and noise of the frames."""
        so = self._readings()
        return Rest(mean(so), noise_by_taxel(so))

    def touched(self) -> bool:
        """Whether the last tenth of the frames is away from rest."""
        if self._rest is None:
            return False
        last = self._readings()[-max(len(self._frames) // 10, 3) :]
        noise = np.hypot(np.nan_to_num(self._rest.noise), 12**-0.5)
        allowed = _TOUCHED * noise / np.sqrt(len(last)) + _LEAST_CHANGE
        return bool((np.abs(mean(last) - self._rest.so) > allowed).any())

    def steady(self) -> bool:
        """Whether the window is full and its tenths agree."""
        if not self.full:
            return False
        so = self._readings()
        rest = self.measured() if self._rest is None else self._rest
        noise = np.hypot(np.nan_to_num(rest.noise), 12**-0.5)
        whole = mean(so)
        parts = np.array_split(so, _PARTS)
        moved = np.array([np.abs(mean(part) - whole) for part in parts])
        change = np.nan_to_num(np.abs(whole - rest.so)).max()
        error = noise / np.sqrt(len(so) / _PARTS)
        allowed = _STEADY * error + 1.0 + _STEADY_SHARE * change
        return not bool((moved > allowed).any())

    def _readings(self) -> NDArray[np.float64]:
        return np.array([so for _, so in self._frames])
