"""Starts of fits, whatever the dimension: nodes of a table, and several contacts at once."""

import abc

import numpy as np
from numpy.typing import NDArray

from fitting.arrays import Flags, Floats, Rows
from suas_jax.equilibrium.equilibrium import State

NEARLY = 40.0
"""Difference of chi2, on the table, below which a second mode is fitted."""

Start = tuple[Floats, int]
"""Parameters of several contacts, and the node of the strongest one."""


class AbstractSeveralSearch(abc.ABC):
    """Starting points of fits by several contacts."""

    @abc.abstractmethod
    def of_two(self, y: Floats, weight: Floats) -> list[Start]:
        """Starting points of two contacts in one frame, best first.

        Args:
            y: its readings [taxel].
            weight: inverse variances [taxel].
        """

    @abc.abstractmethod
    def of_one_more(
        self, y: Floats, weight: Floats, parameters: Floats, so: Floats, known: int
    ) -> list[Start]:
        """Starting points of one contact beside those that a fit has, best first.

        Args:
            y: readings of the frame [taxel].
            weight: inverse variances [taxel].
            parameters: of the fit.
            so: readings of the fit [taxel].
            known: its number of contacts.
        """


class AbstractNodeSearch(abc.ABC):
    """The coarse search of one skin: nodes of a table of states under one contact.

    Args:
        loads: place and force of every node [node, parameter].
        readings: of every node [node, taxel]; NaN where it has no state.
        rest: readings at rest [taxel].
        places: of the table [place, coordinate].
        signatures: change of readings per newton of a light contact there [place, taxel].
        levels: nodes of one place, which follow one another.
        separate: distance below which contacts are one mode, see `distance`.
    """

    def __init__(
        self,
        loads: Floats,
        readings: Floats,
        rest: Floats,
        places: Floats,
        signatures: Floats,
        *,
        levels: int,
        separate: float,
    ) -> None:
        self.loads, self.readings, self.rest = loads, readings, rest
        self.places, self.signatures = places, signatures
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

    def costs(self, y: Floats, weight: Floats) -> NDArray[np.float32]:
        """Weighted squares of y less every node, but for a constant a frame [frame, node]."""
        moved = (weight * (y - self.rest)).astype(np.float32)
        cost = weight.astype(np.float32) @ self._squares
        cost -= 2 * (moved @ self._change)
        cost += self._forbidden
        return np.asarray(cost)

    def score(self, change: Floats, weight: Floats) -> tuple[Floats, Floats]:
        """How well light contacts at all places explain a change of readings.

        Args:
            change: of the readings, zero where not used [frame, taxel].
            weight: inverse variances, likewise [frame, taxel].

        Returns:
            s^T W change and s^T W s of the signatures s [frame, place]: of the force that
            explains most, and of what chi2 falls by.
        """
        along = (weight * change).astype(np.float32) @ self._light.T
        size = weight.astype(np.float32) @ self._light_squares.T
        return along.astype(float), np.maximum(size.astype(float), 1e-300)

    @abc.abstractmethod
    def distance(self, a: Floats, b: Floats) -> Floats:
        """Between places [..., coordinate], in radians in plane strain, in metres on a pad.

        Coordinates after those of places don't count.
        """

    def nearest(self, y: Floats, weight: Floats) -> tuple[Rows, Rows]:
        """The nearest node of every frame, and the nearest of those far from it, or -1."""
        cost = self.costs(y, weight).reshape(len(y), -1, self.levels)
        frame = np.arange(len(y))
        row = cost.argmin(2)  # [frame, place]
        lowest = np.take_along_axis(cost, row[..., None], 2)[..., 0]
        first = lowest.argmin(1)
        best = lowest[frame, first].copy()
        far = self.distance(self._first[None], self._first[first][:, None])
        lowest[far < self.separate] = np.inf
        second = lowest.argmin(1)
        close = lowest[frame, second] < best + NEARLY
        other = np.where(close, second * self.levels + row[frame, second], -1)
        return first * self.levels + row[frame, first], other

    def minima(self, y: Floats, weight: Floats, most: int, within: float) -> Rows:
        """The nodes of the lowest minima of one frame over the skin, best first.

        Args:
            y: readings [taxel].
            weight: inverse variances [taxel].
            most: how many at most.
            within: chi2, on the table, above its smallest.
        """
        cost = self.costs(y[None], weight[None]).reshape(-1, self.levels)
        lowest = cost.min(1)
        limit = lowest.min() + within
        chosen: list[int] = []
        while len(chosen) < most and lowest.min() < limit:
            k = int(lowest.argmin())
            chosen.append(k * self.levels + int(cost[k].argmin()))
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
    def several(self) -> AbstractSeveralSearch:
        """The search for several contacts."""
