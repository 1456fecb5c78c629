"""How stations are spread between breakpoints: close together where solutions change fast."""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

# Elements shrink towards a layer in proportion to exp(distance / (_DECAY layer)), which
# spreads the interpolation error of an exponential evenly over cubic elements.
_DECAY = 4.0
# Elements that follow the layers at an interval's ends, when those are much shorter than it,
# over the ones spread evenly: those of the boundary layers, those of the local fields.
_SHARES = (1.5, 1.0)
# Of the shortest decay length: intervals shorter than that need no elements of their own, whose
# stiffness would leave rounding of the forces on them.
_SHORT = 0.25


def rounded(length: float, steps: int = 4) -> float:
    """The nearest power of a root of two, as many a doubling as there are steps.

    Grading by rounded lengths divides nearby scenes alike, so that the difference of two
    solves is what the gradient says and not the difference of two meshes.
    """
    return float(2 ** (np.round(steps * np.log2(length)) / steps)) if length > 0 else length


class Density(NamedTuple):
    """How close stations lie."""

    # decay length of the boundary layers at either end of an interval [rad], and in a continuum
    # that of the local fields there
    decays: tuple[float, ...]
    # length below which elements gain nothing, because those across
    # the thickness are no smaller [rad]
    smallest: float = 0.0

    def cumulative(
        self, lengths: Sequence[float], elements: int
    ) -> list[tuple[np.ndarray, np.ndarray]]:
        """Position and number of stations up to there, for every interval."""
        pairs = [self._of(length) for length in lengths]
        if self.smallest > 0:
            pairs = _limited(pairs, elements, self.smallest)
        return [(x, _integrals(x, density)) for x, density in pairs]

    def _of(self, length: float) -> tuple[np.ndarray, np.ndarray]:
        shortest = min(_DECAY * min(self.decays), length)
        ends = np.geomspace(1e-3 * shortest, length / 2, 1000)
        x = np.concatenate([[0.0], ends, (length - ends)[-2::-1], [length]])
        own = min(1.0, length / (_SHORT * min(self.decays)))
        density = np.full_like(x, own / length)
        for layer, share in zip(self.decays, _SHARES, strict=False):
            decay = _DECAY * layer
            reach = -np.expm1(-length / decay)
            near = np.exp(-x / decay) + np.exp(-(length - x) / decay)
            density = density + share / (2 * decay) * near * reach
        return x, density


def distinct(
    candidates: list[np.ndarray], values: np.ndarray, elements: int
) -> list[np.ndarray]:
    """Breakpoints far enough apart for a station each, ends always kept."""
    first, *middle, last = candidates
    lower, upper = first @ values, last @ values
    closest = 0.02 * (upper - lower) / elements
    kept = [first]
    for weights in sorted(middle, key=lambda w: float(w @ values)):
        angle = weights @ values
        room = angle - kept[-1] @ values > closest and upper - angle > closest
        if room and len(kept) < elements:
            kept.append(weights)
    return [*kept, last]


def stations_between(
    ends: list[np.ndarray], values: np.ndarray, elements: int, density: Density
) -> np.ndarray:
    """Divide the intervals between breakpoints by their density of stations."""
    angles = np.array([w @ values for w in ends])
    lengths = [rounded(b - a) for a, b in itertools.pairwise(angles)]
    cumulative = density.cumulative(lengths, elements)
    wanted = [
        grid[-1] + length / sum(lengths)
        for (_, grid), length in zip(cumulative, lengths, strict=True)
    ]
    counts = _apportion(np.array(wanted), elements)
    rows = [ends[0]]
    for (x, grid), n, a, b in zip(cumulative, counts, ends[:-1], ends[1:], strict=True):
        fractions = np.interp(np.arange(1, n) / n, grid / grid[-1], x / x[-1])
        rows += [(1 - f) * a + f * b for f in fractions]
        rows.append(b)
    return np.array(rows)


def _integrals(x: np.ndarray, density: np.ndarray) -> np.ndarray:
    steps = (density[1:] + density[:-1]) / 2 * np.diff(x)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _limited(
    pairs: list[tuple[np.ndarray, np.ndarray]], elements: int, smallest: float
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Add the smallest length to that of every element, their number kept."""
    total = sum(x[-1] for x, _ in pairs)
    smallest = min(smallest, 0.95 * total / elements)

    def scaled(c: float) -> list[tuple[np.ndarray, np.ndarray]]:
        return [(x, c * d / (1 + c * d * smallest)) for x, d in pairs]

    low, high = 1e-6, 1e12
    for _ in range(200):
        c = np.sqrt(low * high)
        count = sum(_integrals(x, d)[-1] for x, d in scaled(c))
        low, high = (c, high) if count < elements else (low, c)
    return scaled(high)


def _apportion(wanted: np.ndarray, total: int) -> np.ndarray:
    """Whole numbers in proportion to what is wanted, at least one each."""
    counts = np.ones(len(wanted), int)
    for _ in range(total - len(wanted)):
        counts[np.argmax(wanted / counts)] += 1
    return counts
