"""Where fits begin, whatever the dimension: nodes of a table, and several contacts at once."""

import abc

import numpy as np
from numpy.typing import NDArray

from suas_jax.equilibrium.equilibrium import State

Start = tuple[NDArray[np.float64], int]
"""Parameters of several contacts, and the node of the strongest one."""


class AbstractSeveralSearch(abc.ABC):
    """Starting points of fits by several contacts."""

    @abc.abstractmethod
    def of_two(self, y: NDArray[np.float64], weight: NDArray[np.float64]) -> list[Start]:
        """Starting points of two contacts in one frame, best first.

        Args:
            y: its readings [taxel].
            weight: inverse variances [taxel].
        """

    @abc.abstractmethod
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
    """

    def __init__(
        self,
        loads: NDArray[np.float64],
        readings: NDArray[np.float64],
        rest: NDArray[np.float64],
        places: NDArray[np.float64],
        signatures: NDArray[np.float64],
    ) -> None:
        self.loads, self.readings, self.rest = loads, readings, rest
        self.places, self.signatures = places, signatures
        self.known = np.all(np.isfinite(readings), 1)
        """Nodes that have a state [node]."""
        # Changes from rest, so that single precision leaves no error that matters.
        change = np.where(self.known[:, None], readings - rest, 0.0)
        self._change = np.ascontiguousarray(change.T, np.float32)
        self._squares = self._change**2
        self._forbidden = np.where(self.known, 0.0, np.inf).astype(np.float32)

    def costs(self, y: NDArray[np.float64], weight: NDArray[np.float64]) -> NDArray[np.float32]:
        """Weighted squares of y less every node, but for a constant a frame [frame, node]."""
        moved = (weight * (y - self.rest)).astype(np.float32)
        cost = weight.astype(np.float32) @ self._squares
        cost -= 2 * (moved @ self._change)
        cost += self._forbidden
        return np.asarray(cost)

    @abc.abstractmethod
    def nearest(
        self, y: NDArray[np.float64], weight: NDArray[np.float64]
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """The nearest node of every frame, and the nearest of those far from it, or -1."""

    @abc.abstractmethod
    def nearest_to(self, parameters: NDArray[np.float64], contacts: int) -> NDArray[np.intp]:
        """Nodes nearest to the first contacts of some parameters [frame, parameter]."""

    @abc.abstractmethod
    def near(
        self, y: NDArray[np.float64], weight: NDArray[np.float64], node: NDArray[np.intp]
    ) -> NDArray[np.float64]:
        """Place and force near some nodes that explain frames better [frame, parameter]."""

    @abc.abstractmethod
    def states(self, node: NDArray[np.intp]) -> State:
        """Equilibria of some nodes, a lane each."""

    @abc.abstractmethod
    def rest_states(self, frames: int) -> State:
        """The undeformed state, a lane a frame."""

    @abc.abstractmethod
    def apart(self, a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether the first contacts of parameters are different modes [frame]."""

    @abc.abstractmethod
    def several(self) -> AbstractSeveralSearch:
        """The search for several contacts."""
