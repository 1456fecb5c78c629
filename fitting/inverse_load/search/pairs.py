"""Superposed gaps of single contacts: where a fit of several contacts begins.

The gap changes almost linearly with the loads, and a reading is almost the gap's
reciprocal: so with u = 1 / (SO - stray) the change of several contacts is the sum of those
of each. All pairs of a thinned table are tried by one matrix product.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitting.inverse_load.search.nearest import NodeSearch
from fitting.inverse_load.search.table import LoadTable
from suas_jax.scene.forward import Skin

_ANGLES, _FORCES = 60, 8  # of the thinned table
_CLOSEST = np.deg2rad(4.0)  # contacts of a pair are at least so far apart
_APART = np.deg2rad(8.0)  # starting points closer than this are one
_STARTS = 3
_SUPERPOSITION = 0.05  # its relative error

Start = tuple[NDArray[np.float64], int]
"""Parameters (angles, then forces), and the node of the strongest contact."""


class PairSearch:
    """Starting points of several contacts on one skin.

    Args:
        skin: the skin.
        table: its states under one contact.
        nodes: the search for one contact.
    """

    def __init__(self, skin: Skin, table: LoadTable, nodes: NodeSearch) -> None:
        self._search = nodes
        self._stray = np.broadcast_to(
            np.asarray(skin.electrodes.stray / skin.electrodes.lsb)[..., 0], table.rest.shape
        )
        forces = table.forces.shape[1]
        j = np.linspace(0, len(table.angles) - 1, _ANGLES).round().astype(int)
        i = np.linspace(4, forces - 2, _FORCES).round().astype(int)
        node = (np.unique(j)[:, None] * forces + i).reshape(-1)
        self._node = node[nodes.known[node]]
        self._rest = self._reciprocal(table.rest)
        self._change = self._reciprocal(table.nodes[self._node]) - self._rest
        self._angle, self._force = nodes.angle[self._node], nodes.force[self._node]

    def _reciprocal(self, so: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(1 / np.maximum(so - self._stray, 1e-3))

    def of_two(self, y: NDArray[np.float64], weight: NDArray[np.float64]) -> list[Start]:
        """Starting points of two contacts in one frame, best first.

        Args:
            y: its readings [taxel].
            weight: inverse variances [taxel].
        """
        used, u, variance = self._measured(y, weight)
        change = u - self._rest
        # Errors of the superposition grow with the change.
        w = used / (variance + (_SUPERPOSITION * change) ** 2)
        scaled = self._change * np.sqrt(w)
        own = (scaled**2).sum(1) - 2 * self._change @ (w * change)
        cost = own[:, None] + own + 2 * scaled @ scaled.T
        cost[np.abs(self._angle[:, None] - self._angle) < _CLOSEST] = np.inf
        cost[np.tril_indices(len(cost))] = np.inf
        chosen: list[Start] = []
        for _ in range(_STARTS):
            a, b = np.unravel_index(cost.argmin(), cost.shape)
            if not np.isfinite(cost[a, b]):
                break
            pair = [a, b]
            chosen.append(_start(self._angle[pair], self._force[pair], self._node[pair]))
            near_a, near_b = (np.abs(self._angle - self._angle[k]) < _APART for k in pair)
            cost[np.ix_(near_a, near_b)] = np.inf
            cost[np.ix_(near_b, near_a)] = np.inf
        return chosen

    def of_one_more(
        self,
        y: NDArray[np.float64],
        weight: NDArray[np.float64],
        parameters: NDArray[np.float64],
        so: NDArray[np.float64],
        known: int,
    ) -> list[Start]:
        """Starting points of one contact beside those that a fit has, best first.

        Args:
            y: readings of the frame [taxel].
            weight: inverse variances [taxel].
            parameters: of the fit: all angles, then all forces.
            so: readings of the fit [taxel].
            known: its number of contacts.
        """
        used, u, variance = self._measured(y, weight)
        left = np.where(used, u - self._reciprocal(np.where(used, so, 1.0)), 0.0)
        w = used / variance
        cost = (self._change**2) @ w - 2 * self._change @ (w * left)
        chosen: list[Start] = []
        for _ in range(_STARTS):
            a = int(cost.argmin())
            angle = np.append(parameters[:known], self._angle[a])
            force = np.append(parameters[known : 2 * known], self._force[a])
            chosen.append(_start(angle, force, self._search.nearest_to(angle, force)))
            cost[np.abs(self._angle - self._angle[a]) < _APART] = np.inf
        return chosen

    def _measured(self, y: Any, weight: Any) -> tuple[Any, Any, Any]:
        """Taxels in use, reciprocal readings, and their variances, as |du/dSO| = u^2."""
        used = weight > 0
        u = np.where(used, self._reciprocal(np.where(used, y, 1.0)), self._rest)
        return used, u, u**4 / np.where(used, weight, 1.0)


def _start(angle: Any, force: Any, node: Any) -> Start:
    return np.concatenate([angle, force]), int(node[int(np.argmax(force))])
