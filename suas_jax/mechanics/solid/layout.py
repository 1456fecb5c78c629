"""The Q9/P1 element of the solid, where its unknowns are stored, and how elements take them.

Displacement is biquadratic, pressure linear and discontinuous. Local coordinates (xi, eta) run
over [-1, 1]^2, xi along the arc and eta outwards. Nodes are ordered left, right, middle,
centre: those shared with neighbouring elements along the arc first, those inside the column of
elements next, the node inside the element last. The pair satisfies the inf-sup condition;
piecewise constant pressure would lock.

A station vector of the solid carries, at station i, the displacements of the nodes across
the thickness there and then all that lies inside the column of elements to its right: the
displacements of the nodes half-way to the next station and the elements' pressures. The
last station has no column; its places are filled with zeros that nothing couples to.
"""

from typing import NamedTuple, TypeVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.numerics.array_types import StationVector
from suas_jax.numerics.block_tridiagonal import at_stations
from suas_jax.numerics.polynomials import gauss_legendre

Values = TypeVar("Values", np.ndarray, Array)

# (position along the arc, position through the thickness) of each node, 0 to 2.
NODES = ((0, 0), (0, 1), (0, 2), (2, 0), (2, 1), (2, 2), (1, 0), (1, 2), (1, 1))
PRESSURES = 3  # modes 1, xi, eta
# Power of the distance from a face with which layers grow towards the middle.
_GRADING = 1.75


def quadratic(x: Values, derivative: int = 0) -> list[Values]:
    """Lagrange polynomials for nodes at -1, 0 and 1, or their derivatives.

    `x`: local coordinates. `derivative`: order of differentiation, 0 or 1.
    """
    if derivative:
        return [x - 0.5, -2 * x, x + 0.5]
    return [x * (x - 1) / 2, 1 - x * x, x * (x + 1) / 2]


def located(ends: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Elements in which places lie, and their local coordinates there."""
    element = np.clip(np.searchsorted(ends, x, side="right") - 1, 0, len(ends) - 2)
    start, end = ends[element], ends[element + 1]
    return element, 2 * (x - start) / (end - start) - 1


def node_weights(element: np.ndarray, xi: np.ndarray, elements: int) -> np.ndarray:
    """Weights of the nodes in the values at places [place, node]."""
    weights = np.zeros((len(xi), 2 * elements + 1))
    rows = np.arange(len(xi))
    for k, weight in enumerate(quadratic(xi)):
        weights[rows, 2 * element + k] += weight
    return weights


def gradients(
    xi: Float[np.ndarray, " point"], eta: Float[np.ndarray, " point"]
) -> Float[np.ndarray, "point 2 9"]:
    """Derivatives of the shape functions by (xi, eta)."""
    n, m = quadratic(xi), quadratic(eta)
    dn, dm = quadratic(xi, 1), quadratic(eta, 1)
    along = np.stack([dn[a] * m[b] for a, b in NODES], -1)
    across = np.stack([n[a] * dm[b] for a, b in NODES], -1)
    return np.stack([along, across], 1)


def modes(
    xi: Float[np.ndarray, " point"], eta: Float[np.ndarray, " point"]
) -> Float[np.ndarray, "point 3"]:
    """Pressure modes at points."""
    return np.stack([np.ones_like(xi), xi, eta], -1)


class Tables(NamedTuple):
    """Constants of one element at its 3 x 3 quadrature points."""

    xi: np.ndarray  # [gauss]
    weights: np.ndarray  # [gauss]
    gradient: np.ndarray  # [gauss, 2, node]
    modes: np.ndarray  # [gauss, mode]
    force: np.ndarray  # [node, gauss * 2]
    coupling: np.ndarray  # [node * mode, gauss * 2]
    stiffness: np.ndarray  # [node * node, gauss * 2 * 2]


def _tables() -> Tables:
    points, weights = gauss_legendre(3, -1.0, 1.0)
    xi, eta = (x.ravel() for x in np.meshgrid(points, points, indexing="ij"))
    d, psi = gradients(xi, eta), modes(xi, eta)
    return Tables(
        xi,
        np.outer(weights, weights).ravel(),
        d,
        psi,
        np.einsum("qdn->nqd", d).reshape(9, -1),
        np.einsum("qdn,qa->naqd", d, psi).reshape(27, -1),
        np.einsum("qdn,qfm->nmqdf", d, d).reshape(81, -1),
    )


TABLES = _tables()


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
