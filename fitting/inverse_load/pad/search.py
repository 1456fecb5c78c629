"""Nodes of a pad's table: where fits of contacts begin."""

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from fitting.inverse_load.pad.table import PadTable
from fitting.inverse_load.search.base import AbstractNodeSearch
from fitting.inverse_load.search.pairs import PairSearch
from suas_jax.equilibrium.equilibrium import State

APART = 12e-3
"""Contacts closer than this are one mode of the search [m]."""
_NEARLY = 40.0  # difference of chi2, on the table, below which a second mode is fitted
_EVERY = 2  # of the table's places is a node, and of its forces one of those of pairs
_CLOSEST = 6e-3  # contacts of a pair are at least so far apart [m]


class PadNodeSearch(AbstractNodeSearch):
    """The coarse search of one pad.

    Args:
        table: states under one radial contact.
        radius: of the outer face [m].
    """

    def __init__(self, table: PadTable, radius: float) -> None:
        # Steps on the interpolant find their way from far.
        coarse = table.thinned(_EVERY)
        loads, channels = coarse.nodes
        rest = np.append(table.rest, 0.0)
        super().__init__(loads, channels, rest, table.places, table.signatures)
        self._table, self._radius = coarse, radius
        self._grid = (len(coarse.angle), len(coarse.axial))
        self._levels = len(loads) // len(coarse.places)

    def distance(self, a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
        """Between places on the outer face [..., (angle, axial, ...)] [m]."""
        along = self._radius * (a[..., 0] - b[..., 0])
        return np.asarray(np.hypot(along, a[..., 1] - b[..., 1]))

    def nearest(
        self, y: NDArray[np.float64], weight: NDArray[np.float64]
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """See the base class."""
        cost = self.costs(y, weight).reshape(len(y), -1, self._levels)
        frame = np.arange(len(y))
        row = cost.argmin(2)  # [frame, place]
        lowest = np.take_along_axis(cost, row[..., None], 2)[..., 0]
        first = lowest.argmin(1)
        best = lowest[frame, first].copy()
        places = self._table.places
        lowest[self.distance(places[None], places[first][:, None]) < APART] = np.inf
        second = lowest.argmin(1)
        close = lowest[frame, second] < best + _NEARLY
        other = np.where(close, second * self._levels + row[frame, second], -1)
        return first * self._levels + row[frame, first], other

    def nearest_to(self, parameters: NDArray[np.float64], contacts: int) -> NDArray[np.intp]:
        """See the base class."""
        angle, axial, force = (parameters[:, k * contacts] for k in range(3))
        i = np.abs(self._table.angle - angle[:, None]).argmin(1)
        j = np.abs(self._table.axial - axial[:, None]).argmin(1)
        place = i * self._grid[1] + j
        forces = self.loads[:, 2].reshape(-1, self._levels)[place]
        return np.asarray(
            place * self._levels + np.abs(forces - force[:, None]).argmin(1), np.intp
        )

    def near(
        self, y: NDArray[np.float64], weight: NDArray[np.float64], node: NDArray[np.intp]
    ) -> NDArray[np.float64]:
        """The nodes' own loads: steps on the interpolant cost nothing."""
        return self.loads[node]

    def states(self, node: NDArray[np.intp]) -> State:
        """Empty: fits on the interpolant start from no state."""
        return self.rest_states(len(node))

    def rest_states(self, frames: int) -> State:
        """Likewise."""
        none = jnp.zeros((0, 0, frames))
        return State(none, jnp.zeros(frames), jnp.zeros(frames))

    def apart(self, a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.bool_]:
        """See the base class."""
        return np.asarray(self.distance(a, b) > APART)

    def several(self) -> PairSearch:
        """See the base class."""
        index = np.arange(len(self.loads)).reshape(*self._grid, self._levels)
        thinned = index[:, :, ::_EVERY].reshape(-1)
        return PairSearch(
            self, thinned, self._table.stray, self.distance, closest=_CLOSEST, apart=APART
        )
