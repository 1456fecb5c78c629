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
        levels = len(loads) // len(coarse.places)
        super().__init__(
            loads,
            channels,
            rest,
            table.places,
            table.signatures,
            levels=levels,
            separate=APART,
        )
        self._table, self._radius = coarse, radius
        self._grid = (len(coarse.angle), len(coarse.axial))

    def distance(self, a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
        """Between places on the outer face [..., (angle, axial, ...)] [m]."""
        along = self._radius * (a[..., 0] - b[..., 0])
        return np.asarray(np.hypot(along, a[..., 1] - b[..., 1]))

    def nearest_to(self, parameters: NDArray[np.float64], contacts: int) -> NDArray[np.intp]:
        """See the base class."""
        angle, axial, force = (parameters[:, k * contacts] for k in range(3))
        i = np.abs(self._table.angle - angle[:, None]).argmin(1)
        j = np.abs(self._table.axial - axial[:, None]).argmin(1)
        place = i * self._grid[1] + j
        forces = self.loads[:, 2].reshape(-1, self.levels)[place]
        return np.asarray(
            place * self.levels + np.abs(forces - force[:, None]).argmin(1), np.intp
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

    def several(self) -> PairSearch:
        """See the base class."""
        index = np.arange(len(self.loads)).reshape(*self._grid, self.levels)
        thinned = index[:, :, 1::_EVERY].reshape(-1)  # 3, 12, 46 and 82 % of the largest
        return PairSearch(
            self, thinned, self._table.stray, self.distance, closest=_CLOSEST, apart=APART
        )
