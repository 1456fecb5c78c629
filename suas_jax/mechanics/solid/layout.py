"""Where the solid's unknowns are stored, and how elements take and give them.

A station vector of the solid carries, at station i, the displacements of the nodes across
the thickness there and then all that lies inside the column of elements to its right: the
displacements of the nodes half-way to the next station and the elements' pressures. The
last station has no column; its places are filled with zeros that nothing couples to.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.mechanics.solid.element import NODES, PRESSURES
from suas_jax.numerics.array_types import StationVector
from suas_jax.numerics.block_tridiagonal import at_stations

# Power of the distance from a face with which layers grow towards the middle.
_GRADING = 1.75

NodeValues = Float[Array, "9 2 layer element lane"]
PressureValues = Float[Array, "3 layer element lane"]
# At the left, middle and right nodes of every element's edge on a face.
FaceValues = Float[Array, "3 2 element lane"]


def with_midpoints(ends: Float[np.ndarray, " end"]) -> Float[np.ndarray, " node"]:
    """Ends of elements and the points half-way between them."""
    nodes = np.empty(2 * len(ends) - 1)
    nodes[::2], nodes[1::2] = ends, (ends[1:] + ends[:-1]) / 2
    return nodes


class Layout(NamedTuple):
    """Numbers of elements."""

    elements: int  # along the arc
    layers: int  # through the thickness

    @property
    def nodes(self) -> int:
        """Nodes across the thickness."""
        return 2 * self.layers + 1

    @property
    def dof(self) -> int:
        """Displacements of a station."""
        return 2 * self.nodes

    @property
    def size(self) -> int:
        """All unknowns stored with a station."""
        return 2 * self.dof + PRESSURES * self.layers

    @property
    def layer_ends(self) -> Float[np.ndarray, " end"]:
        """Where layers begin and end, as shares of the thickness.

        Layers are thin at the faces, where corners of clamps and ends of spread loads make the
        solution singular. Every other end is one of half as many layers.
        """
        even = np.linspace(-1, 1, self.layers + 1)
        return (1 + np.sign(even) * (1 - (1 - np.abs(even)) ** _GRADING)) / 2

    @property
    def heights(self) -> Float[np.ndarray, " node"]:
        """Where the nodes across lie, as shares of the thickness."""
        return with_midpoints(self.layer_ends)

    def split(self, q: StationVector) -> tuple[Array, Array]:
        """Displacements at the stations, and what lies between them, [row, ..., lane]."""
        return q[: self.dof], q[self.dof :, :-1]

    def joined(
        self,
        stations: Float[Array, "dof station lane"],
        inside: Float[Array, "row element lane"],
    ) -> StationVector:
        """The inverse of `split`."""
        return jnp.concatenate([stations, jnp.pad(inside, [(0, 0), (0, 1), (0, 0)])])

    def lines(self, q: StationVector) -> tuple[Array, Array]:
        """Displacements at the stations and half-way between them, [2, node, ..., lane]."""

        def nodes(x: Array) -> Array:
            return jnp.swapaxes(x.reshape(self.nodes, 2, *x.shape[1:]), 0, 1)

        return nodes(q[: self.dof]), nodes(q[self.dof : 2 * self.dof, :-1])

    def gather(self, q: StationVector) -> tuple[NodeValues, PressureValues]:
        """Displacements and pressures of every element."""
        stations, middles = self.lines(q)
        p = q[2 * self.dof :, :-1]
        return self.corners(stations, middles), p.reshape(PRESSURES, self.layers, *p.shape[1:])

    def corners(self, stations: Array, middles: Array) -> NodeValues:
        """Nodal values of every element from those of the lines of nodes."""
        lines = (stations[:, :, :-1], middles, stations[:, :, 1:])
        last = 2 * self.layers - 1
        return jnp.stack([lines[a][:, b : b + last : 2] for a, b in NODES])

    def scatter(
        self, u: NodeValues, p: PressureValues, free: Float[np.ndarray, "dof station 1"]
    ) -> StationVector:
        """Sum element vectors: the transpose of `gather`, masked.

        `u`: of the displacements. `p`: of the pressures. `free`: mask of the station
        displacements that may move.
        """
        left, right, middle = (
            self._line([u[NODES.index((a, b))] for b in range(3)]) for a in (0, 2, 1)
        )
        inside = jnp.concatenate([middle, p.reshape(-1, *p.shape[2:])])
        return self.joined(at_stations(left, right) * free, inside)

    def ends(self, symmetric: bool) -> tuple[tuple[bool, ...], tuple[bool, ...]]:
        """Displacements of the end stations that may move: none, at the crown those in y.

        `symmetric`: whether the last station is the crown of a symmetric arch.
        """
        clamp = (False,) * self.dof
        return clamp, (False, True) * self.nodes if symmetric else clamp

    def mask(
        self, ends: tuple[tuple[bool, ...], tuple[bool, ...]]
    ) -> Float[np.ndarray, "dof station 1"]:
        """One where a station's displacement may move, zero where it is held.

        `ends`: which displacements of the two end stations may move.
        """
        mask = np.ones((self.dof, self.elements + 1, 1))
        mask[:, 0, 0], mask[:, -1, 0] = ends
        return mask

    def inner_face(self, u: NodeValues) -> FaceValues:
        """Values at the nodes of the inner face."""
        return jnp.stack([u[NODES.index((a, 0))][:, 0] for a in range(3)])

    def outer_face(self, u: NodeValues) -> FaceValues:
        """Values at the nodes of the outer face."""
        return jnp.stack([u[NODES.index((a, 2))][:, -1] for a in range(3)])

    def on_face(self, values: FaceValues, face: int) -> NodeValues:
        """Nodal values that are zero but on a face.

        `values`: at its left, middle and right nodes. `face`: position across an element, 0 for
        the inner face and 2 for the outer one.
        """
        none = jnp.zeros_like(values[0])
        rows = jnp.stack([values[a] if b == face else none for a, b in NODES])[:, :, None]
        others = (0, self.layers - 1) if face == 0 else (self.layers - 1, 0)
        return jnp.pad(rows, [(0, 0), (0, 0), others, (0, 0), (0, 0)])

    def _line(self, parts: list[Array]) -> Array:
        """Sum [2, layer, ...] of the three nodes across each element into [dof, ...]."""
        bottom, centre, top = parts
        none = jnp.zeros_like(bottom[:, :1])
        shared = jnp.concatenate([bottom, none], 1) + jnp.concatenate([none, top], 1)
        centre = jnp.concatenate([centre, none], 1)
        woven = jnp.stack([shared, centre], 2).reshape(2, -1, *bottom.shape[2:])[:, :-1]
        return jnp.swapaxes(woven, 0, 1).reshape(self.dof, *bottom.shape[2:])
