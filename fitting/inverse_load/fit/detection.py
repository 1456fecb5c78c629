"""Contact detection: a test with a stated rate of false alarms.

Of all contacts the one that raises the likelihood most is looked for, so the chance that
noise alone looks like one of them grows with the variety of patterns. With readings scaled
by their noise, a light contact at place t has the unit pattern s(t), and the statistic is
z = max_t s(t).e. Under noise alone (Hotelling's and Weyl's tube formula, one-sided)

    P(z > u) = A u / (2 pi)^(3/2) exp(-u^2 / 2) + L / (2 pi) exp(-u^2 / 2) + Phi(-u)

Along an arc the patterns are a curve: L is its length and A = 0. On a pad they are a surface:
A is its area and L half the length of its edge. Both follow from the taxels in use: missing
ones change them, and the rate still holds.
"""

import abc
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import ndtr


class Detection(NamedTuple):
    """Result of the test, frame by frame.

    Attributes:
        statistic: z, the significance of the best light contact.
        p_value: probability that noise alone reaches it.
    """

    statistic: NDArray[np.float64]
    p_value: NDArray[np.float64]


class AbstractDetector(abc.ABC):
    """The test for one skin.

    Args:
        signatures: change of readings under a light contact [place, taxel].
    """

    def __init__(self, signatures: NDArray[np.float64]) -> None:
        self._patterns = signatures
        self._squares = signatures**2

    @abc.abstractmethod
    def extent(
        self, weight: NDArray[np.float64], size: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Length and area of the patterns, L and A above [frame].

        Args:
            weight: inverse variance [frame, taxel].
            size: of the patterns, scaled by the noise [frame, place].
        """

    def test(self, change: NDArray[np.float64], weight: NDArray[np.float64]) -> Detection:
        """Test frames.

        Args:
            change: readings less those at rest [frame, taxel]; anything where not used.
            weight: inverse variance, zero where not used [frame, taxel].
        """
        along = (weight * np.where(weight > 0, change, 0.0)) @ self._patterns.T
        size = np.sqrt(weight @ self._squares.T)
        safe = np.where(size > 0, size, 1.0)
        z = np.where(size > 0, along / safe, -np.inf).max(1)
        return Detection(z, false_alarm_rate(z, *self.extent(weight, safe)))

    def threshold(self, rate: float) -> float:
        """The z that noise alone reaches at a given rate, all taxels weighing alike."""
        weight = np.ones((1, self._patterns.shape[1]))
        size = np.sqrt(weight @ self._squares.T)
        length, area = self.extent(weight, np.where(size > 0, size, 1.0))

        def excess(z: float) -> float:
            return float(false_alarm_rate(np.array(z), length[0], area[0])) - rate

        return float(brentq(excess, -8.0, 40.0))


class ArcDetector(AbstractDetector):
    """The test for a skin in plane strain: places lie along the arc, in order."""

    def __init__(self, signatures: NDArray[np.float64]) -> None:
        super().__init__(signatures)
        self._products = signatures[1:] * signatures[:-1]

    def extent(
        self, weight: NDArray[np.float64], size: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """See the base class."""
        cosine = (weight @ self._products.T) / (size[:, 1:] * size[:, :-1])
        length = np.arccos(np.clip(cosine, -1, 1)).sum(1)
        return length, np.zeros_like(length)


class PadDetector(AbstractDetector):
    """The test for a pad: places lie on a grid.

    Args:
        signatures: change of readings under a light contact [place, taxel].
        shape: of the grid; its places are in row-major order.
    """

    def __init__(self, signatures: NDArray[np.float64], shape: tuple[int, int]) -> None:
        super().__init__(signatures)
        self._shape = shape
        grid = signatures.reshape(*shape, -1)
        taxels = grid.shape[-1]
        steps = (grid[1:] * grid[:-1], grid[:, 1:] * grid[:, :-1])
        diagonals = (grid[1:, 1:] * grid[:-1, :-1], grid[1:, :-1] * grid[:-1, 1:])
        self._steps = [x.reshape(-1, taxels) for x in (*steps, *diagonals)]

    def extent(
        self, weight: NDArray[np.float64], size: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """See the base class: the surface as triangles between the grid's patterns."""
        a, b = self._shape
        size = size.reshape(-1, a, b)
        ends = (
            (size[:, 1:], size[:, :-1]),
            (size[:, :, 1:], size[:, :, :-1]),
            (size[:, 1:, 1:], size[:, :-1, :-1]),
            (size[:, 1:, :-1], size[:, :-1, 1:]),
        )
        squares = []  # of chords between unit patterns
        for products, (p, q) in zip(self._steps, ends, strict=True):
            cosine = (weight @ products.T).reshape(p.shape) / (p * q)
            squares.append(2 - 2 * np.clip(cosine, -1, 1))
        down, along, falling, rising = squares
        # Either diagonal cuts a cell in two triangles: the mean of both.
        area = (
            _triangle(down[:, :, :-1], along[:, 1:], falling)
            + _triangle(down[:, :, 1:], along[:, :-1], falling)
            + _triangle(down[:, :, :-1], along[:, :-1], rising)
            + _triangle(down[:, :, 1:], along[:, 1:], rising)
        ).sum((1, 2)) / 2
        edge = sum(
            np.sqrt(x).sum(1)
            for x in (down[:, :, 0], down[:, :, -1], along[:, 0], along[:, -1])
        )
        return np.asarray(edge / 2), np.asarray(area)


def _triangle(a: NDArray, b: NDArray, c: NDArray) -> NDArray[np.float64]:
    """Area of triangles from the squares of their sides (Heron)."""
    return np.sqrt(np.maximum(4 * a * b - (a + b - c) ** 2, 0.0)) / 4


def false_alarm_rate(
    z: NDArray[np.float64], length: NDArray[np.float64], area: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Probability that noise alone reaches z."""
    bounded = np.maximum(z, 0.0)
    tail = length / (2 * np.pi) + area * bounded / (2 * np.pi) ** 1.5
    return np.minimum(tail * np.exp(-(bounded**2) / 2) + ndtr(-z), 1.0)
