"""Contact detection: a test with a stated rate of false alarms.

Of all contacts the one that raises the likelihood most is looked for, so the chance that
noise alone looks like one of them grows with the variety of patterns. With readings scaled
by their noise, a light contact at place t has the unit pattern s(t), and the statistic is
z = max_t s(t).e. Under noise alone (Hotelling's and Weyl's tube formula, one-sided)

    P(z > u) = A u / (2 pi)^(3/2) exp(-u^2 / 2) + L / (2 pi) exp(-u^2 / 2) + Phi(-u)

Along an arc the patterns are a curve: L is its length and A = 0. On a pad they are a surface:
A is its area and L half the length of its edge. Both follow from the taxels in use: missing
ones change them, and the rate still holds.

Where readings are absolute, errors of the skin's inputs move them at rest: with S their
effects and W the weights, the noise's inverse covariance becomes
W - W S^T (1 + S W S^T)^-1 S W, in patterns and readings alike.
"""

import abc
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import ndtr

from fitting.arrays import Floats

_SURE = 10.0  # significance beyond which the rate of false alarms is not told exactly


class Detection(NamedTuple):
    """Result of the test, frame by frame."""

    statistic: Floats  # z, the significance of the best light contact
    # probability that noise alone reaches it; where that is far below any rate that is asked
    # for, something above it
    p_value: Floats


class AbstractDetector(abc.ABC):
    """The test for one skin.

    `signatures`: change of readings under a light contact [place, taxel].
    """

    def __init__(self, signatures: Floats) -> None:
        self._patterns = signatures
        self._squares = signatures**2

    @property
    def channels(self) -> int:
        """Number of readings: of the taxels, and on a pad the oil's pressure."""
        return int(self._patterns.shape[1])

    @abc.abstractmethod
    def extent(
        self, weight: Floats, size: Floats, shared: Floats | None = None
    ) -> tuple[Floats, Floats]:
        """Length and area of the patterns, L and A above [frame].

        `weight`: inverse variance [frame, taxel]. `size`: of the patterns, scaled by the noise
        [frame, place]. `shared`: what errors of the inputs take from the patterns' products:
        the sum of products of its rows [frame, row, place]; None without errors.
        """

    def test(self, change: Floats, weight: Floats, errors: Floats | None = None) -> Detection:
        """Test frames.

        `change`: readings less those at rest [frame, taxel]; anything where not used. `weight`:
        inverse variance, zero where not used [frame, taxel]. `errors`: change of the readings
        at rest by errors of the inputs, one standard deviation each [error, taxel].
        """
        change, shared = np.where(weight > 0, change, 0.0), None
        kind = self._patterns.dtype
        if errors is not None and errors.any():
            change, root = without_errors(change, weight, errors)
            shared = root.astype(kind) @ self._patterns.T
        along = (weight * change).astype(kind) @ self._patterns.T
        weight = weight.astype(kind)
        squares = weight @ self._squares.T
        if shared is not None:
            squares = np.maximum(squares - (shared**2).sum(1), 0.0)
        size = np.sqrt(squares)
        safe = np.where(size > 0, size, 1.0)
        z = np.where(size > 0, along / safe, -np.inf).max(1).astype(float)
        places = len(self._patterns)
        rate = false_alarm_rate(z, np.pi * places, 4.0 * places)  # more than any extent
        rows = np.flatnonzero(z < _SURE)
        if rows.size:
            # The extent is the weights' alone.
            one = rows[:1] if (weight == weight[0]).all() else rows
            common = None if shared is None else shared[one]
            extent = self.extent(weight[one], safe[one], common)
            rate[rows] = false_alarm_rate(z[rows], *extent)
        return Detection(z, rate)

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

    def __init__(self, signatures: Floats) -> None:
        super().__init__(signatures)
        self._products = signatures[1:] * signatures[:-1]

    def extent(
        self, weight: Floats, size: Floats, shared: Floats | None = None
    ) -> tuple[Floats, Floats]:
        """See the base class."""
        products = weight @ self._products.T
        if shared is not None:
            products = products - (shared[..., 1:] * shared[..., :-1]).sum(1)
        cosine = products / (size[:, 1:] * size[:, :-1])
        length = np.arccos(np.clip(cosine, -1, 1)).sum(1)
        return length, np.zeros_like(length)


class PadDetector(AbstractDetector):
    """The test for a pad: places lie on a grid.

    Signatures are changes of readings under a light contact [place, taxel]. The grid has the
    stated shape, its places are in row-major order.
    """

    def __init__(self, signatures: Floats, shape: tuple[int, int]) -> None:
        signatures = signatures.astype(np.float32)  # of hundreds of places: half the time
        super().__init__(signatures)
        self._shape = shape
        grid = signatures.reshape(*shape, -1)
        taxels = grid.shape[-1]
        steps = (grid[1:] * grid[:-1], grid[:, 1:] * grid[:, :-1])
        diagonals = (grid[1:, 1:] * grid[:-1, :-1], grid[1:, :-1] * grid[:-1, 1:])
        self._steps = [x.reshape(-1, taxels) for x in (*steps, *diagonals)]

    def extent(
        self, weight: Floats, size: Floats, shared: Floats | None = None
    ) -> tuple[Floats, Floats]:
        """See the base class: the surface as triangles between the grid's patterns."""
        a, b = self._shape
        size = size.reshape(-1, a, b)
        common = None if shared is None else shared.reshape(*shared.shape[:2], a, b)
        every, first, last = slice(None), slice(None, -1), slice(1, None)
        ends = (
            ((last, every), (first, every)),
            ((every, last), (every, first)),
            ((last, last), (first, first)),
            ((last, first), (first, last)),
        )
        squares = []  # of chords between unit patterns
        for products, (one, other) in zip(self._steps, ends, strict=True):
            p, q = size[(every, *one)], size[(every, *other)]
            product = (weight @ products.T).reshape(p.shape)
            if common is not None:
                both = common[(every, every, *one)] * common[(every, every, *other)]
                product = product - both.sum(1)
            cosine = product / (p * q)
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


def without_errors(change: Floats, weight: Floats, errors: Floats) -> tuple[Floats, Floats]:
    """Take what errors of the inputs explain best off the readings at rest.

    The change is that of the readings from those at rest, zero where not used [frame, taxel];
    errors are changes of the readings by each error [error, taxel]; weights are inverse
    variances [frame, taxel].
    Returns the rest of the change [frame, taxel], and R with R^T R = W S^T (1 + S W S^T)^-1 S W
    [frame, error, taxel].
    """
    weighted = errors * weight[:, None]
    matrix = np.eye(len(errors)) + weighted @ errors.T
    root = np.linalg.solve(np.linalg.cholesky(matrix), weighted)
    along = (root @ change[..., None])[..., 0]
    # W times this is (W - R^T R) times the change.
    taken = np.einsum("fe,fet->ft", along, root)
    safe = np.where(weight > 0, weight, 1.0)
    return np.where(weight > 0, change - taken / safe, 0.0), root


def _triangle(a: NDArray, b: NDArray, c: NDArray) -> Floats:
    """Area of triangles from the squares of their sides (Heron)."""
    return np.sqrt(np.maximum(4 * a * b - (a + b - c) ** 2, 0.0)) / 4


def false_alarm_rate(z: Floats, length: Floats | float, area: Floats | float) -> Floats:
    """Probability that noise alone reaches z."""
    bounded = np.maximum(z, 0.0)
    tail = length / (2 * np.pi) + area * bounded / (2 * np.pi) ** 1.5
    return np.minimum(tail * np.exp(-(bounded**2) / 2) + ndtr(-z), 1.0)
