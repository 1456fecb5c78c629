"""The solid's inner face against the wall: its edges' positions at quadrature points."""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.mechanics.base import ContactState
from suas_jax.mechanics.contact.term import (
    Gap,
    contact_pressure,
    contact_terms,
    expanded,
)
from suas_jax.mechanics.solid.element import NODES, quadratic
from suas_jax.mechanics.solid.layout import FaceValues
from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.quadrature import gauss_legendre
from suas_jax.skin.wall import Wall

# Points on an edge: enough that a zone shorter than an edge is seen, and that its ends,
# which no mesh follows, move smoothly with the load.
_POINTS = 5

_XI, _WEIGHTS = gauss_legendre(_POINTS, -1.0, 1.0)
_SHAPES = np.stack(quadratic(_XI))  # [node, point]
_PRODUCTS = np.einsum("ag,bg->abg", _SHAPES, _SHAPES)


def _into_element() -> Float[np.ndarray, "9 3"]:
    """Nodes of an element's inner edge, left, middle and right, among its nine."""
    table = np.zeros((9, 3))
    for a in range(3):
        table[NODES.index((a, 0)), a] = 1
    return table


_IN_ELEMENT = _into_element()


class InnerFace:
    """The inner face of a solid at the contact points of its edges.

    Args:
        wall: what it may touch.
        angles: of the stations [rad].
        length: of the undeformed face per angle [m].
        rest: positions of the edges' nodes at rest, left, middle, right [m].
        moved: their displacements [m].
    """

    def __init__(
        self,
        wall: Wall,
        angles: Float[Array, "station #lane"],
        length: Callable[[Array], Array],
        rest: FaceValues,
        moved: FaceValues,
    ) -> None:
        self.wall = wall
        span = angles[1:] - angles[:-1]
        self.angle = angles[:-1] + (_XI[:, None, None] + 1) / 2 * span
        self.area = jnp.asarray(_WEIGHTS)[:, None, None] * length(self.angle) * span / 2
        self.position = jnp.einsum("ag,acel->cgel", _SHAPES, rest + moved)

    def _gap(self) -> Gap:
        return expanded(lambda x: self.wall.gap(x, self.angle), self.position)

    def energy(self) -> Lanes:
        """Energy of contact per width [J/m]."""
        return jnp.sum(
            self.area * self.wall.law.energy(self.wall.gap(self.position, self.angle)), (0, 1)
        )

    def element_terms(
        self,
    ) -> tuple[FaceValues, Float[Array, "9 9 3 element lane"]]:
        """First derivatives by the edges' nodes, second ones by all nodes of the elements."""
        terms = contact_terms(self.wall.law, self._gap(), self.area)
        force = jnp.einsum("ag,cgel->acel", _SHAPES, terms.force)
        (xx, xy), (_, yy) = terms.stiffness
        stiffness = jnp.einsum("abg,igel->abiel", _PRODUCTS, jnp.stack([xx, yy, xy]))
        return force, jnp.einsum("na,mb,abiel->nmiel", _IN_ELEMENT, _IN_ELEMENT, stiffness)

    def state(self) -> ContactState:
        """Where the face is, and how it is pushed."""
        polar, gap = self.wall.seen_from(self.position, self.angle)
        pressure = contact_pressure(self.wall.law, gap)
        return ContactState(self.angle, polar, gap, pressure, self.area)
