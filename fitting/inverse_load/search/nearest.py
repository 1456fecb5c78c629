"""Nearest states of a table: where a fit of one contact begins."""

import numpy as np
from numpy.typing import NDArray

from fitting.inverse_load.search.table import LoadTable

APART = np.deg2rad(10.0)
"""Contacts closer than this are one mode of the search."""
_NEARLY = 40.0  # difference of chi2, on the table, below which a second mode is fitted
_REFINEMENTS = 3


class NodeSearch:
    """The coarse search of one skin.

    Args:
        table: states under one radial contact.
    """

    def __init__(self, table: LoadTable) -> None:
        self._table = table
        nodes = table.nodes
        self.known = np.all(np.isfinite(nodes), 1)
        """Nodes that have a state [node]."""
        self.angle = np.repeat(table.angles, table.forces.shape[1])
        self.force = table.forces.reshape(-1)
        # Changes from rest, so that single precision leaves no error that matters.
        change = np.where(self.known[:, None], nodes - table.rest, 0.0)
        self._change = np.ascontiguousarray(change.T, np.float32)
        self._squares = self._change**2
        self._forbidden = np.where(self.known, 0.0, np.inf).astype(np.float32)

    def costs(self, y: NDArray[np.float64], weight: NDArray[np.float64]) -> NDArray[np.float32]:
        """Weighted squares of y less every node, but for a constant a frame [frame, node]."""
        moved = (weight * (y - self._table.rest)).astype(np.float32)
        cost = weight.astype(np.float32) @ self._squares
        cost -= 2 * (moved @ self._change)
        cost += self._forbidden
        return np.asarray(cost)

    def nearest(
        self, y: NDArray[np.float64], weight: NDArray[np.float64]
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """The nearest node of every frame, and the nearest of those far from it, or -1."""
        forces = self._table.forces.shape[1]
        cost = self.costs(y, weight).reshape(len(y), -1, forces)
        frame = np.arange(len(y))
        row = cost.argmin(2)  # [frame, angle]
        lowest = np.take_along_axis(cost, row[..., None], 2)[..., 0]
        first = lowest.argmin(1)
        best = lowest[frame, first].copy()
        angles = self._table.angles
        lowest[np.abs(angles - angles[first][:, None]) < APART] = np.inf
        second = lowest.argmin(1)
        close = lowest[frame, second] < best + _NEARLY
        other = np.where(close, second * forces + row[frame, second], -1)
        return first * forces + row[frame, first], other

    def nearest_to(
        self, angle: NDArray[np.float64], force: NDArray[np.float64]
    ) -> NDArray[np.intp]:
        """Nodes nearest to some loads; the lightest of an angle where there is no state."""
        forces = self._table.forces
        j = np.abs(self._table.angles - np.asarray(angle)[:, None]).argmin(1)
        i = np.abs(np.log(forces[j] / np.maximum(force, 1e-12)[:, None])).argmin(1)
        lightest = j * forces.shape[1]
        return np.where(self.known[lightest + i], lightest + i, lightest)

    def near(
        self, y: NDArray[np.float64], weight: NDArray[np.float64], node: NDArray[np.intp]
    ) -> NDArray[np.float64]:
        """Angle and force near some nodes, by the table's own slopes and curvatures.

        Gauss-Newton on the Taylor polynomial of the readings about the node: it costs
        nothing next to one evaluation of the model, and saves one or two.

        Returns:
            Parameters [frame, 2].
        """
        value, by_a, by_f, aa, af, ff = np.moveaxis(self._table.taylor[node], 1, 0)
        a, f = np.zeros((2, len(y), 1))
        for _ in range(_REFINEMENTS):
            slope_a, slope_f = by_a + aa * a + af * f, by_f + ff * f + af * a
            model = value + (by_a + slope_a) * a / 2 + (by_f + slope_f) * f / 2
            residual, w_a, w_f = y - model, weight * slope_a, weight * slope_f
            g_a, g_f = (w_a * residual).sum(1), (w_f * residual).sum(1)
            h_aa, h_af, h_ff = (
                (p * q).sum(1) for p, q in ((w_a, slope_a), (w_a, slope_f), (w_f, slope_f))
            )
            determinant = np.maximum(h_aa * h_ff * (1 + 1e-6) - h_af**2, 1e-300)
            step = np.stack([h_ff * g_a - h_af * g_f, h_aa * g_f - h_af * g_a]) / determinant
            step = np.nan_to_num(step)[..., None]
            a, f = np.clip(a + step[0], -0.7, 0.7), np.clip(f + step[1], -0.7, 0.7)
        by_angle, by_log_force = self._table.steps
        angle = self.angle[node] + a[:, 0] * by_angle
        return np.stack([angle, self.force[node] * np.exp(f[:, 0] * by_log_force)], 1)
