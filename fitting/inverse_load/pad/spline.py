"""Tensor-product cubic splines of many channels, with their derivatives, frame by frame.

An interpolating spline along each axis (not-a-knot, as SciPy makes it); a value needs the
4 x 4 x 4 coefficients around it, so evaluation is one small matrix product a place.

The mean over a box is a product of means along its sides, each exact by the antiderivative::

    mean of B over [x - h, x + h] = (I(x + h) - I(x - h)) / (2 h),   I' = B,   v = h^2 / 3

For a small variance v of its points, of either sign, it follows from B and the mean over a
small box. B + v B'' / 2, to first order the same, has a kink at every knot.
"""

import functools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from fitting.arrays import Floats, Rows

# Of means over boxes: the mean, and its slopes by middle, level and variances.
_OVER = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [2, 0, 0], [0, 2, 0]])


class SplineBasis:
    """Cubic splines on four ascending nodes or more."""

    def __init__(self, nodes: Floats) -> None:
        self.nodes = np.asarray(nodes, float)
        count = len(self.nodes)
        through = make_interp_spline(self.nodes, np.eye(count), k=3)
        # coefficients of the spline through values: a product for all channels together
        self.of_values = through.c  # [function, node]
        unit = BSpline(through.t, np.eye(count), 3)
        self._breaks = unit.t[3:-3]
        intervals = len(self._breaks) - 1
        self._least = (0.4 * np.diff(self._breaks).min()) ** 2 / 3  # variance of a box
        powers = [  # [power, interval, function], from the third down
            unit.derivative(m)(self._breaks[:-1]) / math.factorial(m) for m in (3, 2, 1, 0)
        ]
        pieces = np.stack(powers, -1)
        self._pieces = np.stack([pieces[i, i : i + 4] for i in range(intervals)])
        self._before = unit.antiderivative()(self._breaks[:-1])  # integrals of all functions

    def at(self, x: Floats) -> tuple[Rows, Floats]:
        """First of the four functions that count at places, their values and slopes.

        Shapes are [place] and [2, place, function]. Beyond the nodes the last polynomial goes
        on.
        """
        i, c, s = self._piece(x)
        value = ((c[..., 0] * s + c[..., 1]) * s + c[..., 2]) * s + c[..., 3]
        slope = (3 * c[..., 0] * s + 2 * c[..., 1]) * s + c[..., 2]
        return i, np.stack([value, slope])

    def _piece(self, x: Floats) -> tuple[Rows, Floats, Floats]:
        """Intervals of places, their polynomials, and how far the places are along them."""
        i = np.searchsorted(self._breaks, x, side="right") - 1
        i = np.minimum(np.maximum(i, 0), len(self._pieces) - 1)
        return i, self._pieces[i], (x - self._breaks[i])[..., None]

    def over(self, x: Floats, variance: Floats) -> tuple[Rows, Floats]:
        """Means of all functions that count over intervals around places.

        What reaches beyond the nodes counts as nothing.

        Intervals have middles `x` [place], and their points a variance [place].
        Returns the first of the functions [place]; their means, and the slopes of these by
        place and by variance [3, place, function].
        """
        small = variance < self._least
        if small.all():
            return self._over_little(x, variance)
        if not small.any():
            return self._over_much(x, variance)
        parts = (small, self._over_little), (~small, self._over_much)
        found = [(at, *part(x[at], variance[at])) for at, part in parts]
        count = max(rows.shape[2] for *_, rows in found)
        begin, box = np.zeros(len(x), np.intp), np.zeros((3, len(x), count))
        for at, first, rows in found:
            begin[at] = np.minimum(first, len(self.nodes) - count)
            shift = (first - begin[at])[:, None] + np.arange(rows.shape[2])
            box[:, np.flatnonzero(at)[:, None], shift] = rows
        return begin, box

    def _over_much(self, x: Floats, variance: Floats) -> tuple[Rows, Floats]:
        """`over` for intervals that are long enough."""
        half = np.sqrt(3 * variance)
        ends = np.concatenate([x - half, x + half])
        inside = np.minimum(np.maximum(ends, self.nodes[0]), self.nodes[-1])
        value, integral = self._all(inside)
        value *= (inside == ends)[:, None]
        (low, high), (start, end) = (v.reshape(2, -1, v.shape[-1]) for v in (value, integral))
        width = 2 * half[:, None]
        mean = (end - start) / width
        by_half = (low + high) / width - mean / half[:, None]
        box = np.stack([mean, (high - low) / width, by_half * 1.5 / half[:, None]])
        first = np.searchsorted(self._breaks, inside[: len(x)], side="right") - 1
        last = np.searchsorted(self._breaks, inside[len(x) :], side="left") - 1
        count = min(int((last - first).max()) + 4, len(self.nodes))
        first = np.minimum(first, len(self.nodes) - count)
        rows = np.arange(len(x))[:, None]
        return first, box[:, rows, first[:, None] + np.arange(count)]

    def _over_little(self, x: Floats, variance: Floats) -> tuple[Rows, Floats]:
        """`over` for small variances, of either sign."""
        edges, firsts, pieces = self._little
        i = np.minimum(np.maximum(edges.searchsorted(x, side="right") - 1, 0), len(firsts) - 1)
        c, s = pieces[i], (x - edges[i])[:, None, None]
        value, slope = c[..., 0], np.zeros_like(c[..., 0])
        for k in range(1, c.shape[-1]):
            slope = slope * s + value
            value = value * s + c[..., k]
        v = (variance / self._least)[:, None]
        # Of the value, the chord and the bend: see `_little`.
        chord = np.where(v > 0, v**2 * (v - 1), 0.0)
        both = [y[:, 0] + v * y[:, 1] + chord * y[:, 2] for y in (value, slope)]
        by_variance = value[:, 1] + np.where(v > 0, v * (3 * v - 2), 0.0) * value[:, 2]
        return firsts[i], np.stack([*both, by_variance / self._least])

    @functools.cached_property
    def _little(self) -> tuple[Floats, Rows, Floats]:
        """Piecewise polynomials of what `_over_little` is made of.

        With B the functions, and M and W their means over an interval of the least variance v
        and the slopes of these by it: B, M - B and v W - (M - B), from which means over less
        follow with continuous slopes by place and variance, those at knots among them.

        Returns edges of the pieces [piece + 1]; the first function of each [piece]; polynomials
        [piece, quantity, function, power], from the fourth power down.
        """
        half = np.sqrt(3 * self._least)
        moved = [self._breaks, self._breaks - half, self._breaks + half]
        ends = self.nodes[0] + half, self.nodes[-1] - half  # the last polynomials go on there
        edges = np.unique(np.clip(np.concatenate(moved), *ends))
        edges = edges[np.append(np.diff(edges) > 1e-9 * half, True)]
        size = np.diff(edges)
        share = (1 + np.cos(np.linspace(0, np.pi, 5))) / 2 * 0.998 + 0.001
        x = (edges[:-1, None] + share * size[:, None]).reshape(-1)
        first, (mean, _, by_variance) = self._over_much(x, np.full(len(x), self._least))
        whole = np.zeros((3, len(x), len(self.nodes)))
        at = np.arange(len(x))[:, None], first[:, None] + np.arange(mean.shape[1])
        whole[0], _ = self._all(x)
        whole[1][at], whole[2][at] = mean, self._least * by_variance
        whole[1] -= whole[0]
        whole[2] -= whole[1]
        middle = (edges[:-1] + edges[1:]) / 2
        low = np.maximum(middle - half, self.nodes[0])
        firsts = self._breaks[:-1].searchsorted(low, side="right") - 1
        count = min(5, len(self.nodes))
        firsts = np.clip(firsts, 0, len(self.nodes) - count)
        powers = np.linalg.inv(np.vander(share, 5)) / size[:, None, None] ** np.arange(
            4, -1, -1
        ).reshape(-1, 1)
        at_nodes = whole.reshape(3, len(size), 5, -1)
        columns = firsts[:, None] + np.arange(count)
        own = np.take_along_axis(at_nodes, columns[None, :, None], 3)
        return edges, firsts, np.einsum("ikp,qipf->iqfk", powers, own)

    def _all(self, x: Floats) -> tuple[Floats, Floats]:
        """All functions and their integrals from the first node, at places between nodes."""
        i, c, s = self._piece(x)
        value = np.zeros((len(x), len(self.nodes)))
        integral = self._before[i]
        at = np.arange(len(x))[:, None], i[:, None] + np.arange(4)
        value[at] = ((c[..., 0] * s + c[..., 1]) * s + c[..., 2]) * s + c[..., 3]
        quartic = ((c[..., 0] / 4 * s + c[..., 1] / 3) * s + c[..., 2] / 2) * s + c[..., 3]
        integral[at] += quartic * s
        return value, integral


@dataclass(frozen=True)
class TensorSpline:
    """A spline in several variables."""

    axes: tuple[SplineBasis, ...]  # one basis a variable
    coefficients: Floats  # [variable, ..., channel]

    @classmethod
    def through(cls, nodes: tuple[Floats, ...], values: Floats) -> "TensorSpline":
        """The spline through values at the nodes of a grid [variable, ..., channel]."""
        axes = tuple(SplineBasis(x) for x in nodes)
        coefficients = np.asarray(values, float)
        for k, axis in enumerate(axes):
            shape = coefficients.shape
            lines = coefficients.reshape(math.prod(shape[:k]), shape[k], -1)
            coefficients = (axis.of_values @ lines).reshape(shape)
        return cls(axes, coefficients)

    def __call__(self, *x: Floats) -> tuple[Floats, Floats]:
        """Values [place, channel] and derivatives [place, variable, channel] at places.

        `x` are the variables [place].
        """
        both = self._products(self._at(x), np.eye(len(x) + 1, len(x), -1, dtype=np.intp))
        return both[:, 0], both[:, 1:]

    def values(self, *x: Floats) -> Floats:
        """Values alone [place, channel]."""
        return self._products(self._at(x), np.zeros((1, len(x)), np.intp))[:, 0]

    def _at(self, x: tuple[Floats, ...]) -> list[Any]:
        return [axis.at(np.asarray(v, float)) for axis, v in zip(self.axes, x, strict=True)]

    def over(self, x: Floats, variance: Floats, level: Floats) -> tuple[Floats, Floats]:
        """Means over boxes of the first two variables, at values of the third.

        Boxes have middles `x` [place, 2], and their points a variance along each side
        [place, 2]. The level is the third variable [place].
        Returns means [place, channel], and derivatives by the middle's coordinates, the level
        and the variances [place, 5, channel].
        """
        sides = [self.axes[k].over(x[:, k], variance[:, k]) for k in range(2)]
        both = self._products([*sides, self.axes[2].at(level)], _OVER)
        return both[:, 0], both[:, 1:]

    def over_grid(self, x: Floats, variance: Floats, level: float) -> Floats:
        """Means over boxes of one middle, of all pairs of variances [first, second, channel].

        The middle is `x` [2], the third variable the level.
        """
        found = self.coefficients
        for axis, middle, own in zip(self.axes[:2], x, variance, strict=True):
            first, rows = axis.over(np.full(len(own), middle), own)
            whole = np.zeros((len(own), len(axis.nodes)))
            columns = first[:, None] + np.arange(rows.shape[2])
            whole[np.arange(len(own))[:, None], columns] = rows[0]
            found = np.moveaxis(np.tensordot(whole, found, (1, 0)), 0, 1)
        at, (value, _) = self.axes[2].at(np.array([level]))
        found = found[:, :, at[0] : at[0] + value.shape[1]]
        return np.tensordot(value[0], found, (0, 2))

    def _products(self, found: list[tuple[Rows, Floats]], orders: Rows) -> Floats:
        """Products of one-dimensional rows with the coefficients [place, row, channel].

        `found` has the first function of each variable and its rows (values, slopes and so on),
        `orders` which row of each variable a product takes [product, variable].
        """
        count, channels = len(found[0][0]), self.coefficients.shape[-1]
        products = np.ones((len(orders), count, 1))
        for (_, rows), order in zip(found, orders.T, strict=True):
            products = products[..., None] * rows[order][:, :, None]
            products = products.reshape(len(orders), count, -1)
        sizes = [rows.shape[2] for _, rows in found]
        corners = np.stack([first for first, _ in found], 1).tolist()
        products = products.astype(self.coefficients.dtype)
        both = np.empty((count, len(orders), channels), products.dtype)
        for place, corner in enumerate(corners):  # one by one: in the cache
            window = tuple(slice(i, i + n) for i, n in zip(corner, sizes, strict=True))
            block = self.coefficients[window].reshape(-1, channels)
            np.matmul(products[:, place], block, out=both[place])
        return both
