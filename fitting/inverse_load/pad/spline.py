"""Tensor-product cubic splines of many channels, with their derivatives, frame by frame.

An interpolating spline along each axis (not-a-knot, as SciPy makes it); a value needs the
4 x 4 x 4 coefficients around it, so evaluation is one small matrix product a frame.
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
        found: list[Any] = [
            axis.at(np.asarray(v, float)) for axis, v in zip(self.axes, x, strict=True)
        ]
        count, variables = len(found[0][0]), len(found)
        shape = self.coefficients.shape
        index = np.zeros((count, 1), np.intp)
        for k, (first, _, _) in enumerate(found):
            own = first[:, None] + np.arange(4)
            index = (index[:, :, None] * shape[k] + own[:, None]).reshape(count, -1)
        block = self.coefficients.reshape(-1, shape[-1])[index]  # [place, 4^n, channel]
        rows = []
        for wanted in range(variables + 1):
            parts = [f[2 if k + 1 == wanted else 1] for k, f in enumerate(found)]
            row = parts[0]
            for part in parts[1:]:
                row = (row[:, :, None] * part[:, None]).reshape(count, -1)
            rows.append(row)
        both: Floats = np.stack(rows, 1) @ block
        return both[:, 0], both[:, 1:]
