"""Superposed gaps of single contacts: where a fit of several contacts begins.

The gap changes almost linearly with the loads, and a reading is almost the gap's
reciprocal: so with u = 1 / (SO - stray) the change of several contacts is the sum of those
of each. All pairs of a thinned table are tried by one matrix product.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitting.inverse_load.search.base import AbstractNodeSearch, AbstractSeveralSearch, Start

_STARTS = 3
_SUPERPOSITION = 0.05  # its relative error

Distance = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]
"""Distance between places [..., coordinate]; coordinates after those of places don't count."""


class PairSearch(AbstractSeveralSearch):
    """Starting points of several contacts on one skin.

    Args:
        nodes: the search for one contact.
        thinned: nodes of which pairs are made.
        stray: part of the readings that no gap changes [taxel] [counts].
        distance: between places.
        closest: distance that contacts of a pair have at least.
        apart: starting points closer than this are one.
    """

    def __init__(
        self,
        nodes: AbstractNodeSearch,
        thinned: NDArray[np.intp],
        stray: NDArray[np.float64],
        distance: Distance,
        *,
        closest: float,
        apart: float,
    ) -> None:
        self._search, self._stray, self._taxels = nodes, stray, len(stray)
        self._node = thinned[nodes.known[thinned]]
        self._loads = nodes.loads[self._node]
        readings = nodes.readings[self._node, : self._taxels]
        self._rest = self._reciprocal(nodes.rest[: self._taxels])
        self._change = self._reciprocal(readings) - self._rest
        self._distance = distance(self._loads[:, None], self._loads[None])
        self._closest, self._apart = closest, apart

    def _reciprocal(self, so: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(1 / np.maximum(so - self._stray, 1e-3))

    def of_two(self, y: NDArray[np.float64], weight: NDArray[np.float64]) -> list[Start]:
        """See the base class."""
        used, u, variance = self._measured(y, weight)
        change = u - self._rest
        # Errors of the superposition grow with the change.
        w = used / (variance + (_SUPERPOSITION * change) ** 2)
        scaled = self._change * np.sqrt(w)
        own = (scaled**2).sum(1) - 2 * self._change @ (w * change)
        cost = own[:, None] + own + 2 * scaled @ scaled.T
        cost[self._distance < self._closest] = np.inf
        cost[np.tril_indices(len(cost))] = np.inf
        chosen: list[Start] = []
        for _ in range(_STARTS):
            a, b = np.unravel_index(cost.argmin(), cost.shape)
            if not np.isfinite(cost[a, b]):
                break
            pair = [a, b]
            chosen.append(_start(self._loads[pair], self._node[pair]))
            near_a, near_b = (self._distance[k] < self._apart for k in pair)
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
        """See the base class."""
        used, u, variance = self._measured(y, weight)
        fitted = np.where(used, so[: self._taxels], 1.0)
        left = np.where(used, u - self._reciprocal(fitted), 0.0)
        w = used / variance
        cost = (self._change**2) @ w - 2 * self._change @ (w * left)
        width = self._loads.shape[1]
        before = parameters[: known * width].reshape(width, known).T
        chosen: list[Start] = []
        for _ in range(_STARTS):
            a = int(cost.argmin())
            loads = np.concatenate([before, self._loads[a : a + 1]])
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


def _start(loads: Any, node: Any) -> Start:
    """Parameters of contacts [contact, parameter], and the node of the strongest."""
    return loads.T.reshape(-1), int(node[int(np.argmax(loads[:, -1]))])
