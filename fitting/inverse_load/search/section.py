"""Nearest states of a section's table, where a fit of one contact begins."""

import numpy as np

from fitting.arrays import Floats, Rows
from fitting.inverse_load.model.evaluation import at_rest
from fitting.inverse_load.search.base import AbstractNodeSearch, PairSearch
from fitting.inverse_load.search.table import LoadTable
from suas_jax.equilibrium.state import State
from suas_jax.scene.skin import Skin

APART = np.deg2rad(10.0)
"""Contacts closer than this are one mode of the search."""
_REFINEMENTS = 3
_ANGLES, _FORCES = 60, 8  # of the thinned table that pairs are made of
_CLOSEST = np.deg2rad(4.0)  # contacts of a pair are at least so far apart
_ONE_START = np.deg2rad(8.0)  # starting points of pairs closer than this are one


class NodeSearch(AbstractNodeSearch):
    """The coarse search of one skin in plane strain."""

    def __init__(self, skin: Skin, table: LoadTable) -> None:
        self._skin, self._table = skin, table
        angle = np.repeat(table.angles, table.forces.shape[1])
        loads = np.stack([angle, table.forces.reshape(-1)], 1)
        places = table.angles[:, None]
        stray = np.asarray(skin.electrodes.stray / skin.electrodes.lsb)[..., 0]
        super().__init__(
            loads,
            table.nodes,
            table.rest,
            places,
            table.signatures,
            np.broadcast_to(stray, table.rest.shape),
            levels=table.forces.shape[1],
            separate=APART,
        )

    def states(self, node: Rows) -> State:
        """See the base class."""
        return self._table.start(node)

    def rest_states(self, frames: int) -> State:
        """See the base class."""
        return at_rest(self._skin, frames)

    def distance(self, a: Floats, b: Floats) -> Floats:
        """Between angles [..., (angle, ...)] [rad]."""
        return np.asarray(np.abs(a[..., 0] - b[..., 0]))

    def several(self) -> PairSearch:
        """See the base class."""
        table = self._table
        forces = table.forces.shape[1]
        j = np.linspace(0, len(table.angles) - 1, _ANGLES).round().astype(int)
        i = np.linspace(4, forces - 2, _FORCES).round().astype(int)
        return PairSearch(
            self,
            (np.unique(j)[:, None] * forces + i).reshape(-1),
            closest=_CLOSEST,
            apart=_ONE_START,
        )

    def nearest_to(self, parameters: Floats, contacts: int) -> Rows:
        """See the base class; the lightest of an angle where there is no state."""
        forces = self._table.forces
        angle, force = parameters[:, 0], parameters[:, contacts]
        j = np.abs(self._table.angles - angle[:, None]).argmin(1)
        i = np.abs(np.log(forces[j] / np.maximum(force, 1e-12)[:, None])).argmin(1)
        lightest = j * forces.shape[1]
        return np.where(self.known[lightest + i], lightest + i, lightest)

    def near(self, y: Floats, weight: Floats, node: Rows) -> Floats:
        """Angle and force [frame, 2] near some nodes, by the table's slopes and curvatures.

        Gauss-Newton on the Taylor polynomial of the readings about the node: it costs
        nothing next to one evaluation of the model, and saves one or two.
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
        angle, force = self.loads[node].T
        angle = angle + a[:, 0] * by_angle
        return np.stack([angle, force * np.exp(f[:, 0] * by_log_force)], 1)
