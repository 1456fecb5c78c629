"""Starts of fits, whatever the dimension: nodes of a table, and several contacts at once."""

import abc
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitting.arrays import Flags, Floats, Rows
from fitting.steps import Steps
from suas_jax.equilibrium.state import State

NEARLY = 40.0
"""Difference of chi2, on the table, below which a second mode is fitted."""

Start = tuple[Floats, int]
"""Parameters of several contacts, and the node of the strongest one."""
_STARTS = 3
_ROWS = 100  # first nodes of pairs that are tried together
_SUPERPOSITION = 0.05  # its relative error
_LEAST, _MOST = 0.5, 2.0  # scales of a node's change


class PairSearch:
    """Starting points of fits by several contacts on one skin.

    The gap changes almost linearly with the loads, and a reading is almost the gap's
    reciprocal: so with u = 1 / (SO - stray) the change of several contacts is the sum of those
    of each. All pairs of a thinned table are tried by one matrix product, each node's change
    scaled by what explains the readings best, as it is nearly proportional to the force.
    """

    def __init__(
        self,
        nodes: "AbstractNodeSearch",  # the search for one contact
        thinned: Rows,  # nodes of which pairs are made
        *,
        closest: float,  # distance that contacts of a pair have at least
        apart: float,  # starting points closer than this are one
    ) -> None:
        self._search, self._stray, self._taxels = nodes, nodes.stray, len(nodes.stray)
        self._node = thinned[nodes.known[thinned]]
        self._loads = nodes.loads[self._node]
        readings = nodes.readings[self._node, : self._taxels]
        self._rest = self._reciprocal(nodes.rest[: self._taxels])
        self._change = self._reciprocal(readings) - self._rest
        self._distance = nodes.distance(self._loads[:, None], self._loads[None])
        self._apart = apart
        lower = np.tri(len(self._node), dtype=bool)  # a pair is tried once
        self._excluded = lower | (self._distance < closest)

    def _reciprocal(self, so: Floats) -> Floats:
        return np.asarray(1 / np.maximum(so - self._stray, 1e-3))

    def of_two(self, y: Floats, weight: Floats) -> Steps[list[Start]]:
        """Starting points of two contacts in one frame, best first.

        Readings of the frame [taxel] have inverse variances [taxel].
        """
        used, u, variance = self._measured(y, weight)
        change = u - self._rest
        # Errors of the superposition grow with the change.
        w = used / (variance + (_SUPERPOSITION * change) ** 2)
        scaled = self._change * np.sqrt(w)
        along = self._change @ (w * change)
        own, parts = (scaled**2).sum(1), []
        for begin in range(0, len(own), _ROWS):
            yield "pairs"
            rows = slice(begin, begin + _ROWS)
            parts.append(
                _scaled(scaled[rows] @ scaled.T, (own[rows], along[rows]), (own, along))
            )
        first, second, cost = (np.concatenate(x) for x in zip(*parts, strict=True))
        yield "best pairs"
        cost[self._excluded] = np.inf
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
        """Starting points of one contact beside those that a fit has, best first.

        The frame is as for two; the fit has parameters, readings [taxel] and a known number of
        contacts.
        """
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
    products: Floats,  # of the weighted changes of first and second nodes [first, second]
    # squares of the nodes' own changes, and their products with the measured one [node]
    firsts: tuple[Floats, Floats],
    seconds: tuple[Floats, Floats],
) -> tuple[Floats, Floats, Floats]:
    """Scales of the nodes of pairs and what is left, but for a constant.

    Returns scales of the first and of the second node of a pair, and the weighted squares of
    what is left [first, second].
    """
    one, along_one = (np.maximum(firsts[0], 1e-300)[:, None], firsts[1][:, None])
    two, along_two = np.maximum(seconds[0], 1e-300), seconds[1]
    determinant = np.maximum(one * two - products**2, 1e-12 * one * two)
    first = (along_one * two - products * along_two) / determinant
    first = np.clip(first, _LEAST, _MOST)
    # The best second beside the first's, which may have been clipped, and the other way round.
    second = np.clip((along_two - products * first) / two, _LEAST, _MOST)
    first = np.clip((along_one - products * second) / one, _LEAST, _MOST)
    cost = first * (first * one - 2 * along_one)
    cost += second * (second * two - 2 * along_two) + 2 * first * second * products
    return first, second, cost


def _start(loads: Any, node: Any) -> Start:
    """Parameters of contacts [contact, parameter], and the node of the strongest."""
    return loads.T.reshape(-1), int(node[int(np.argmax(loads[:, -1]))])


class AbstractNodeSearch(abc.ABC):
    """The coarse search of one skin: nodes of a table of states under one contact."""

    def __init__(
        self,
        loads: Floats,  # place and force of every node [node, parameter]
        readings: Floats,  # of every node [node, taxel]; NaN where it has no state
        rest: Floats,  # readings at rest [taxel]
        places: Floats,  # of the table [place, coordinate]
        # change of readings per newton of a light contact there [place, taxel]
        signatures: Floats,
        stray: Floats,  # part of the readings that no gap changes [taxel] [counts]
        *,
        levels: int,  # nodes of one place, which follow one another
        separate: float,  # distance below which contacts are one mode, see `distance`
    ) -> None:
        self.loads, self.readings, self.rest = loads, readings, rest
        self.places, self.signatures, self.stray = places, signatures, stray
        self.levels, self.separate = levels, separate
        self._first = loads[::levels]  # of every place
        self._light = signatures.astype(np.float32)
        self._light_squares = self._light**2
        self.known = np.all(np.isfinite(readings), 1)
        """Nodes that have a state [node]."""
        # Changes from rest, so that single precision leaves no error that matters.
        change = np.where(self.known[:, None], readings - rest, 0.0)
        self._change = np.ascontiguousarray(change.T, np.float32)
        self._squares = self._change**2
        self._forbidden = np.where(self.known, 0.0, np.inf).astype(np.float32)

    def costs(
        self, y: Floats, weight: Floats
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Weighted squares of y less every node, but for a constant a frame [frame, node].

        And weighted products of the changes from rest, of y and every node, likewise.
        """
        moved = (weight * (y - self.rest)).astype(np.float32)
        along = moved @ self._change
        cost = weight.astype(np.float32) @ self._squares - 2 * along
        cost += self._forbidden
        return cost, along

    def score(self, change: Floats, weight: Floats) -> tuple[Floats, Floats]:
        """How well light contacts at all places explain a change of readings.

        `change`: of the readings, zero where not used [frame, taxel]. `weight`: inverse
        variances, likewise [frame, taxel].
        Returns s^T W change and s^T W s of the signatures s [frame, place]: of the force that
        explains most, and of what chi2 falls by.
        """
        along = (weight * change).astype(np.float32) @ self._light.T
        size = weight.astype(np.float32) @ self._light_squares.T
        return along.astype(float), np.maximum(size.astype(float), 1e-300)

    def within(self, rows: Floats, weight: Floats) -> Floats:
        """Sum of (s^T W r)^2 over rows r, of the signatures s at all places [frame, place].

        `rows`: changes of the readings [frame, row, taxel]. `weight`: inverse variances [frame,
        taxel].
        """
        weighted = (rows * weight[:, None]).astype(np.float32)
        return np.asarray(((weighted @ self._light.T) ** 2).sum(1), float)

    @abc.abstractmethod
    def distance(self, a: Floats, b: Floats) -> Floats:
        """Between places [..., coordinate], in radians in plane strain, in metres on a pad.

        Coordinates after those of places don't count.
        """

    def _lowest(self, y: Floats, weight: Floats) -> tuple[NDArray[np.float32], Rows]:
        """Cost of every place under the best force there, and the best of its nodes.

        Both are [frame, place].
        """
        shape = len(y), -1, self.levels
        cost, along = (x.reshape(shape) for x in self.costs(y, weight))
        row = cost.argmin(2)
        lowest = np.take_along_axis(cost, row[..., None], 2)[..., 0]
        # Contacts lighter than any node: a share of the lightest one's change explains more.
        along = along[..., 0]  # zero where there is no state
        own = np.maximum(cost[..., 0] + 2 * along, 1e-30)
        light = (along > 0) & (along < own) & (row == 0)
        return np.where(light, np.minimum(lowest, -(along**2) / own), lowest), row

    def nearest(self, y: Floats, weight: Floats) -> tuple[Rows, Rows]:
        """The nearest node of every frame, and the nearest of those far from it, or -1."""
        lowest, row = self._lowest(y, weight)
        frame = np.arange(len(y))
        first = lowest.argmin(1)
        best = lowest[frame, first].copy()
        far = self.distance(self._first[None], self._first[first][:, None])
        lowest[far < self.separate] = np.inf
        second = lowest.argmin(1)
        close = lowest[frame, second] < best + NEARLY
        other = np.where(close, second * self.levels + row[frame, second], -1)
        return first * self.levels + row[frame, first], other

    def minima(
        self,
        y: Floats,  # readings [taxel]
        weight: Floats,  # inverse variances [taxel]
        most: int,  # how many at most
        within: float,  # chi2, on the table, above its smallest
    ) -> Rows:
        """The nodes of the lowest minima of one frame over the skin, best first."""
        (lowest,), (row,) = self._lowest(y[None], weight[None])
        limit = lowest.min() + within
        chosen: list[int] = []
        while len(chosen) < most and lowest.min() < limit:
            k = int(lowest.argmin())
            chosen.append(k * self.levels + int(row[k]))
            lowest[self.distance(self._first, self._first[k]) < self.separate] = np.inf
        return np.array(chosen, np.intp)

    @abc.abstractmethod
    def nearest_to(self, parameters: Floats, contacts: int) -> Rows:
        """Nodes nearest to the first contacts of some parameters [frame, parameter]."""

    @abc.abstractmethod
    def near(self, y: Floats, weight: Floats, node: Rows) -> Floats:
        """Place and force near some nodes that explain frames better [frame, parameter]."""

    @abc.abstractmethod
    def states(self, node: Rows) -> State:
        """Equilibria of some nodes, a lane each."""

    @abc.abstractmethod
    def rest_states(self, frames: int) -> State:
        """The undeformed state, a lane a frame."""

    def apart(self, a: Floats, b: Floats) -> Flags:
        """Whether single contacts are different modes [frame]."""
        return np.asarray(self.distance(a, b) > self.separate)

    @abc.abstractmethod
    def several(self) -> PairSearch:
        """The search for several contacts."""
