"""Superposed gaps of single contacts: where a fit of several contacts begins.

The gap changes almost linearly with the loads, and a reading is almost the gap's
reciprocal: so with u = 1 / (SO - stray) the change of several contacts is the sum of those
of each. All pairs of a thinned table are tried by one matrix product, each node's change
scaled by what explains the readings best, as it is nearly proportional to the force.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitting.inverse_load.search.base import AbstractNodeSearch, AbstractSeveralSearch, Start

_STARTS = 3
_SUPERPOSITION = 0.05  # its relative error
_LEAST, _MOST = 0.5, 2.0  # scales of a node's change

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


def _scaled(
    products: NDArray[np.float64], along: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Scales of the nodes of all pairs and what is left, but for a constant.

    Args:
        products: of the nodes' weighted changes [node, node].
        along: of the nodes' changes and the measured one [node].

    Returns:
        Scales of the first and of the second node of a pair, and the weighted squares of what
        is left [node, node].
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
