"""What acts on the solid's faces: the oil's pressure inside, dead loads outside, contact.

The inner face is a chain of quadratic edges, so the area under it is a quadratic form of its
nodes' positions. Its first derivative is the load of a unit of pressure, the second one how
that load follows the face. Contact is by the edges' positions at quadrature points.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.mechanics.contact.face import (
    AbstractContactFace,
    ContactTerms,
    contact_terms,
    expanded,
)
from suas_jax.mechanics.solid.element import NODES, quadratic
from suas_jax.mechanics.solid.layout import FaceValues, Layout
from suas_jax.numerics.array_types import Lanes, StationVector
from suas_jax.numerics.polynomials import gauss_legendre
from suas_jax.skin.loads import LoadPoints
from suas_jax.skin.wall import Obstacle, Wall


def _edge_area() -> Float[np.ndarray, "3 3"]:
    """Matrix A with x^T A y = 1/2 integral of (y dx - x dy) along a quadratic edge."""
    x, w = gauss_legendre(3, -1.0, 1.0)
    n, d = np.stack(quadratic(x)), np.stack(quadratic(x, 1))
    product = np.einsum("g,ag,bg->ab", w, d, n)
    return (product - product.T) / 2


_EDGE_AREA = _edge_area()  # nodes in the order left, middle, right


def enclosed_volume(at_rest: FaceValues, moved: FaceValues) -> tuple[Lanes, FaceValues]:
    """Enclosed volume less its value at rest, per width, and its gradient [m^2, m].

    `at_rest`: positions of the inner face's nodes [m]. `moved`: their displacements [m].
    """

    def turned(x: Array) -> Array:
        along = jnp.einsum("ab,bel->ael", _EDGE_AREA, x[:, 1])
        upward = jnp.einsum("ba,bel->ael", _EDGE_AREA, x[:, 0])
        return jnp.stack([along, upward], 1)

    rest, more = turned(at_rest), turned(moved)
    return jnp.sum(moved * (rest + more / 2), (0, 1, 2)), rest + more


def follower(layers: int) -> Float[np.ndarray, "9 9 3 layer 1 1"]:
    """Second derivative of the enclosed volume: the innermost layer's alone."""
    matrix = np.zeros((9, 9, 3, layers, 1, 1))
    for a in range(3):
        for b in range(3):
            matrix[NODES.index((a, 0)), NODES.index((b, 0)), 2, 0] = _EDGE_AREA[a, b]
    return matrix


def load_vector(
    layout: Layout, points: LoadPoints, ends: tuple[tuple[bool, ...], tuple[bool, ...]]
) -> StationVector:
    """Nodal forces of the load points.

    `layout`: numbers of elements. `points`: the loads. `ends`: which displacements of the two
    end stations may move.
    """
    shapes = jnp.stack(quadratic(2 * points.xi - 1))
    force = jnp.einsum("apl,cpl,epl->acel", shapes, points.force, points.select)
    u = layout.on_face(force, 2)
    return layout.scatter(u, jnp.zeros((3, *u.shape[2:])), layout.mask(ends))


# Points on an edge of the inner face: enough that a zone shorter than an edge is seen, and that
# its ends, which no mesh follows, move smoothly with the load.
_POINTS = 5
# Even ones on an edge of the outer face: where a body is touched turns its force.
_EVEN = 32


class _Rule(NamedTuple):
    """Local coordinates and weights, and shape functions there."""

    xi: Float[np.ndarray, " point"]
    weights: Float[np.ndarray, " point"]
    shapes: Float[np.ndarray, "3 point"]

    @classmethod
    def of(cls, xi: np.ndarray, weights: np.ndarray) -> "_Rule":
        """A rule on [-1, 1]."""
        return cls(xi, weights, np.stack(quadratic(xi)))


_RULES = {
    0: _Rule.of(*gauss_legendre(_POINTS, -1.0, 1.0)),
    2: _Rule.of((2 * np.arange(_EVEN) + 1) / _EVEN - 1, np.full(_EVEN, 2 / _EVEN)),
}


def _in_element(face: int) -> Float[np.ndarray, "9 3"]:
    """Nodes of an element's edge on a face, left, middle and right, among its nine."""
    table = np.zeros((9, 3))
    for a in range(3):
        table[NODES.index((a, face)), a] = 1
    return table


class ContactFace(AbstractContactFace):
    """A face of a solid at the contact points of its edges. `angles`: of the stations [rad]."""

    def __init__(
        self,
        obstacle: Obstacle,  # a wall inside, a body outside
        angles: Float[Array, "station #lane"],
        length: Callable[[Array], Array],  # of the undeformed face per angle [m]
        rest: FaceValues,  # positions of the edges' nodes at rest, left, middle, right [m]
        moved: FaceValues,  # their displacements [m]
    ) -> None:
        self.obstacle = obstacle
        self.face = 0 if isinstance(obstacle, Wall) else 2  # position across an element
        span = angles[1:] - angles[:-1]
        xi, weights, self.shapes = _RULES[self.face]
        self.angle = angles[:-1] + (xi[:, None, None] + 1) / 2 * span
        self.area = jnp.asarray(weights)[:, None, None] * length(self.angle) * span / 2
        self.rest, self.moved = (
            jnp.einsum("ag,acel->cgel", self.shapes, x) for x in (rest, moved)
        )

    def place(self) -> Array:
        """See the base class."""
        return self.rest + self.moved

    def place_at_rest(self) -> Array:
        """See the base class."""
        return self.rest

    def terms(self) -> ContactTerms:
        """Contact at every point, by its position."""
        place = self.place()
        gap = expanded(lambda x: self.obstacle.gap(x, self.angle), place)
        terms = contact_terms(self.obstacle.law, gap, self.area)
        return self.with_friction(terms, lambda x: x - self.rest, place, self.grip())

    def forces(self, by_position: Float[Array, "2 point element lane"]) -> FaceValues:
        """Forces of the edges' nodes from derivatives by the points' positions."""
        return jnp.einsum("ag,cgel->acel", self.shapes, by_position)

    def matrix(self, terms: ContactTerms) -> Float[Array, "9 9 3 element lane"]:
        """Second derivatives of the energy by all nodes of the elements."""
        (xx, xy), (_, yy) = terms.stiffness
        products = np.einsum("ag,bg->abg", self.shapes, self.shapes)
        stiffness = jnp.einsum("abg,igel->abiel", products, jnp.stack([xx, yy, xy]))
        nodes = _in_element(self.face)
        return jnp.einsum("na,mb,abiel->nmiel", nodes, nodes, stiffness)
