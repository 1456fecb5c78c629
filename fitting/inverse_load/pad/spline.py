"""Tensor-product cubic splines of many channels, with their derivatives, frame by frame.

An interpolating spline along each axis (not-a-knot, as SciPy makes it); a value needs the
4 x 4 x 4 coefficients around it, so evaluation is one small matrix product a frame.

The mean over a box is a product of means along its sides, each exact by the antiderivative::

    mean of B over [x - h, x + h] = (I(x + h) - I(x - h)) / (2 h),   I' = B,   v = h^2 / 3

For a small variance v of its points, of either sign, it is B + v B'' / 2.
"""

from dataclasses import dataclass
from math import factorial
from typing import Any

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from fitting.arrays import Floats, Rows


class SplineBasis:
    """Cubic splines on some nodes.

    Args:
        nodes: ascending, four or more.
    """

    def __init__(self, nodes: Floats) -> None:
        self.nodes = np.asarray(nodes, float)
        count = len(self.nodes)
        knots = make_interp_spline(self.nodes, np.zeros(count), k=3).t
        unit = BSpline(knots, np.eye(count), 3)
        self._breaks = unit.t[3:-3]
        intervals = len(self._breaks) - 1
        self._integral, self._unit = unit.antiderivative(), unit
        self._least = (0.4 * np.diff(self._breaks).min()) ** 2 / 3  # variance of a box
        powers = [  # [power, interval, function], from the third down
            unit.derivative(m)(self._breaks[:-1]) / factorial(m) for m in (3, 2, 1, 0)
        ]
        pieces = np.stack(powers, -1)
        self._pieces = np.stack([pieces[i, i : i + 4] for i in range(intervals)])

    def at(self, x: Floats) -> tuple[Rows, Floats, Floats]:
        """First of the four functions that count at places, their values and slopes.

        Beyond the nodes the last polynomial goes on.
        """
        i = np.searchsorted(self._breaks, x, side="right") - 1
        i = np.clip(i, 0, len(self._pieces) - 1)
        c, s = self._pieces[i], (x - self._breaks[i])[..., None]
        value = ((c[..., 0] * s + c[..., 1]) * s + c[..., 2]) * s + c[..., 3]
        slope = (3 * c[..., 0] * s + 2 * c[..., 1]) * s + c[..., 2]
        return i, value, slope

    def over(self, x: Floats, variance: Floats) -> tuple[Rows, Floats]:
        """Means of all functions that count over intervals around places.

        What reaches beyond the nodes counts as nothing.

        Args:
            x: middles [place].
            variance: of a point of the interval [place].

        Returns:
            First of the functions [place]; their means, and the slopes of these by place and by
            variance [3, place, function].
        """
        half = np.sqrt(3 * np.maximum(variance, self._least))
        ends = [np.clip(x + side * half, self.nodes[0], self.nodes[-1]) for side in (-1, 1)]
        low, high = (self._unit(e) * (np.abs(e - x) >= 0.999 * half)[:, None] for e in ends)
        width = 2 * half[:, None]
        mean = (self._integral(ends[1]) - self._integral(ends[0])) / width
        by_half = (low + high) / width - mean / half[:, None]
        box = np.stack([mean, (high - low) / width, by_half * 1.5 / half[:, None]])
        small = variance < self._least
        if small.any():
            at = x[small]
            value, slope, second, third = (self._unit(at, nu=k) for k in range(4))
            v = variance[small, None]
            box[:, small] = value + v / 2 * second, slope + v / 2 * third, second / 2
        first = np.searchsorted(self._breaks, ends[0], side="right") - 1
        last = np.searchsorted(self._breaks, ends[1], side="left") - 1
        count = min(int((last - first).max()) + 4, len(self.nodes))
        first = np.clip(first, 0, len(self.nodes) - count)
        columns = first[:, None] + np.arange(count)
        return first, np.take_along_axis(box, columns[None], 2)


@dataclass(frozen=True)
class TensorSpline:
    """A spline in several variables.

    Attributes:
        axes: one basis a variable.
        coefficients: [variable, ..., channel].
    """

    axes: tuple[SplineBasis, ...]
    coefficients: Floats

    @classmethod
    def through(cls, nodes: tuple[Floats, ...], values: Floats) -> "TensorSpline":
        """The spline through values at the nodes of a grid [variable, ..., channel]."""
        axes = tuple(SplineBasis(x) for x in nodes)
        coefficients = np.asarray(values, float)
        for k, axis in enumerate(axes):
            moved = np.moveaxis(coefficients, k, 0)
            flat = make_interp_spline(axis.nodes, moved.reshape(len(moved), -1), k=3).c
            coefficients = np.moveaxis(flat.reshape(moved.shape), 0, k)
        return cls(axes, np.ascontiguousarray(coefficients))

    def __call__(self, *x: Floats) -> tuple[Floats, Floats]:
        """Values and derivatives at places.

        Args:
            x: the variables [place].

        Returns:
            Values [place, channel] and derivatives [place, variable, channel].
        """
        both = self._products(self._at(x), np.eye(len(x) + 1, len(x), -1, dtype=int))
        return both[:, 0], both[:, 1:]

    def values(self, *x: Floats) -> Floats:
        """Values alone [place, channel]."""
        return self._products(self._at(x), np.zeros((1, len(x)), int))[:, 0]

    def _at(self, x: tuple[Floats, ...]) -> list[Any]:
        found = (axis.at(np.asarray(v, float)) for axis, v in zip(self.axes, x, strict=True))
        return [(first, rows) for first, *rows in found]

    def over(self, x: Floats, variance: Floats, level: Floats) -> tuple[Floats, Floats]:
        """Means over boxes of the first two variables, at values of the third.

        Args:
            x: middles of the boxes [place, 2].
            variance: of their points, along each side [place, 2].
            level: the third variable [place].

        Returns:
            Means [place, channel], and derivatives by the middle's coordinates, the level and
            the variances [place, 5, channel].
        """
        sides = [self.axes[k].over(x[:, k], variance[:, k]) for k in range(2)]
        first, value, slope = self.axes[2].at(level)
        orders = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [2, 0, 0], [0, 2, 0]])
        both = self._products([*sides, (first, (value, slope))], orders)
        return both[:, 0], both[:, 1:]

    def _products(self, found: list[Any], orders: Rows) -> Floats:
        """Products of one-dimensional rows with the coefficients [place, row, channel].

        Args:
            found: of each variable the first function and rows of values, slopes, ...
            orders: which row of each variable a product takes [product, variable].
        """
        count, shape = len(found[0][0]), self.coefficients.shape
        index = np.zeros((count, 1), np.intp)
        for k, (first, rows) in enumerate(found):
            own = first[:, None] + np.arange(rows[0].shape[1])
            index = (index[:, :, None] * shape[k] + own[:, None]).reshape(count, -1)
        block = self.coefficients.reshape(-1, shape[-1])[index]  # [place, function, channel]
        products = []
        for order in orders:
            row = np.ones((count, 1))
            for (_, rows), k in zip(found, order, strict=True):
                row = (row[:, :, None] * rows[k][:, None]).reshape(count, -1)
            products.append(row)
        return np.asarray(np.stack(products, 1) @ block)
