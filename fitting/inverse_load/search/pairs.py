"""Nearest states of a table, where a fit of one contact begins; superposed, one of several.

The gap changes almost linearly with the loads, and a reading is almost the gap's
reciprocal: so with u = 1 / (SO - stray) the change of several contacts is the sum of those
of each. All pairs of a thinned table are tried by one matrix product, each node's change
scaled by what explains the readings best, as it is nearly proportional to the force.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from fitting.arrays import Floats, Rows
from fitting.inverse_load.model.evaluation import at_rest
from fitting.inverse_load.search.base import AbstractNodeSearch, AbstractSeveralSearch, Start
from fitting.inverse_load.search.table import LoadTable
from suas_jax.equilibrium.equilibrium import State
from suas_jax.scene.skin import Skin

_STARTS = 3
_SUPERPOSITION = 0.05  # its relative error
_LEAST, _MOST = 0.5, 2.0  # scales of a node's change

Distance = Callable[[Floats, Floats], Floats]
"""Distance between places [..., coordinate]; coordinates after those of places don't count."""

APART = np.deg2rad(10.0)
"""Contacts closer than this are one mode of the search."""
_REFINEMENTS = 3
_ANGLES, _FORCES = 60, 8  # of the thinned table that pairs are made of
_CLOSEST = np.deg2rad(4.0)  # contacts of a pair are at least so far apart
_ONE_START = np.deg2rad(8.0)  # starting points of pairs closer than this are one


class PairSearch(AbstractSeveralSearch):
    """Starting points of several contacts on one skin."""

    def __init__(
        self,
        nodes: AbstractNodeSearch,  # the search for one contact
        thinned: Rows,  # nodes of which pairs are made
        stray: Floats,  # part of the readings that no gap changes [taxel] [counts]
        distance: Distance,  # between places
        *,
        closest: float,  # distance that contacts of a pair have at least
        apart: float,  # starting points closer than this are one
    ) -> None:
        self._search, self._stray, self._taxels = nodes, stray, len(stray)
        self._node = thinned[nodes.known[thinned]]
        self._loads = nodes.loads[self._node]
        readings = nodes.readings[self._node, : self._taxels]
        self._rest = self._reciprocal(nodes.rest[: self._taxels])
        self._change = self._reciprocal(readings) - self._rest
        self._distance = distance(self._loads[:, None], self._loads[None])
        self._closest, self._apart = closest, apart

    def _reciprocal(self, so: Floats) -> Floats:
        return np.asarray(1 / np.maximum(so - self._stray, 1e-3))

    def of_two(self, y: Floats, weight: Floats) -> list[Start]:
        """See the base class."""
        used, u, variance = self._measured(y, weight)
        change = u - self._rest
        # Errors of the superposition grow with the change.
        w = used / (variance + (_SUPERPOSITION * change) ** 2)
        scaled = self._change * np.sqrt(w)
        first, second, cost = _scaled(scaled @ scaled.T, self._change @ (w * change))
        cost[self._distance < self._closest] = np.inf
        cost[np.tril_indices(len(cost))] = np.inf
        chosen: list[Start] = []
        for _ in range(_STARTS):
            a, b = np.unravel_index(cost.argmin(), cost.shape)
            if not np.isfinite(cost[a, b]):
                break
            pair = [a, b]
            loads = self._loads[pair]
            loads[:, -1] *= first[a, b], second[a, b]
            chosen.append(_start(loads, self._node[pair]))
            near_a, near_b = (self._distance[k] < self._apart for k in pair)
            cost[np.ix_(near_a, near_b)] = np.inf
            cost[np.ix_(near_b, near_a)] = np.inf
        return chosen

    def of_one_more(
        self, y: Floats, weight: Floats, parameters: Floats, so: Floats, known: int
    ) -> list[Start]:
        """See the base class."""
        used, u, variance = self._measured(y, weight)
        fitted = np.where(used, so[: self._taxels], 1.0)
        left = np.where(used, u - self._reciprocal(fitted), 0.0)
        w = used / variance
        own, along = (self._change**2) @ w, self._change @ (w * left)
        scale = np.clip(along / np.maximum(own, 1e-300), _LEAST, _MOST)
        cost = scale * (scale * own - 2 * along)
        width = self._loads.shape[1]
        before = parameters[: known * width].reshape(width, known).T
        chosen: list[Start] = []
        for _ in range(_STARTS):
            a = int(cost.argmin())
            loads = np.concatenate([before, self._loads[a : a + 1]])
            loads[-1, -1] *= scale[a]
            nearest = self._search.nearest_to(loads, 1)
            chosen.append(_start(loads, nearest))
            cost[self._distance[a] < self._apart] = np.inf
        return chosen

    def _measured(self, y: Any, weight: Any) -> tuple[Any, Any, Any]:
        """Taxels in use, reciprocal readings, and their variances, as |du/dSO| = u^2."""
        y, weight = y[: self._taxels], weight[: self._taxels]
        used = weight > 0
        u = np.where(used, self._reciprocal(np.where(used, y, 1.0)), self._rest)
        return used, u, u**4 / np.where(used, weight, 1.0)


def _scaled(products: Floats, along: Floats) -> tuple[Floats, Floats, Floats]:
    """Scales of the nodes of all pairs and what is left, but for a constant.

    `products` are those of the nodes' weighted changes with one another [node, node], `along`
    those of the nodes' changes with the measured one [node].
    Returns scales of the first and of the second node of a pair, and the weighted squares of
    what is left [node, node].
    """
    own = np.maximum(np.diagonal(products), 1e-300)
    determinant = np.maximum(own[:, None] * own - products**2, 1e-12 * own[:, None] * own)
    first = (along[:, None] * own - products * along) / determinant
    first = np.clip(first, _LEAST, _MOST)
    # The best second beside the first's, which may have been clipped, and the other way round.
    second = np.clip((along - products * first) / own, _LEAST, _MOST)
    first = np.clip((along[:, None] - products * second) / own[:, None], _LEAST, _MOST)
    cost = first * (first * own[:, None] - 2 * along[:, None])
    cost += second * (second * own - 2 * along) + 2 * first * second * products
    return first, second, cost


def _start(loads: Any, node: Any) -> Start:
    """Parameters of contacts [contact, parameter], and the node of the strongest."""
    return loads.T.reshape(-1), int(node[int(np.argmax(loads[:, -1]))])


class NodeSearch(AbstractNodeSearch):
    """The coarse search of one skin in plane strain."""

    def __init__(self, skin: Skin, table: LoadTable) -> None:
        self._skin, self._table = skin, table
        angle = np.repeat(table.angles, table.forces.shape[1])
        loads = np.stack([angle, table.forces.reshape(-1)], 1)
        places = table.angles[:, None]
        super().__init__(
            loads,
            table.nodes,
            table.rest,
            places,
            table.signatures,
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
        table, electrodes = self._table, self._skin.electrodes
        stray = np.asarray(electrodes.stray / electrodes.lsb)[..., 0]
        forces = table.forces.shape[1]
        j = np.linspace(0, len(table.angles) - 1, _ANGLES).round().astype(int)
        i = np.linspace(4, forces - 2, _FORCES).round().astype(int)
        return PairSearch(
            self,
            (np.unique(j)[:, None] * forces + i).reshape(-1),
            np.broadcast_to(stray, table.rest.shape),
            self.distance,
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
