"""The lumped shell's inner face against the wall.

The inner face is the fibre at -t/2 of the thinned membrane, so its gap at a point depends on
the mid-line's displacement and on its first two derivatives by arc length: six inputs.
Points are even along an element: the shell touches the wall in a zone much shorter than its
elements, and even points leave the least between them.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.mechanics.base import ContactState
from suas_jax.mechanics.contact.term import (
    ContactTerms,
    contact_pressure,
    contact_terms,
    expanded,
)
from suas_jax.mechanics.shell.points import mix
from suas_jax.mechanics.shell.shape import carried, fibre_position, turn
from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.hermite import hermite
from suas_jax.skin.prestress import Growth
from suas_jax.skin.section import AbstractSection
from suas_jax.skin.wall import Wall

_INTERVALS = 16  # between contact points of an element; both ends are points, too

ElementVector = Float[Array, "4 2 element lane"]
ElementMatrix = Float[Array, "4 4 2 2 element lane"]


def _points() -> tuple[np.ndarray, np.ndarray]:
    """Local coordinates and weights of the trapezoidal rule."""
    weights = np.full(_INTERVALS + 1, 1.0 / _INTERVALS)
    weights[[0, -1]] /= 2
    return np.linspace(0, 1, _INTERVALS + 1), weights


_XI, _WEIGHTS = _points()
# Shape functions and their derivatives [point, order, shape].
_SHAPES = np.stack([np.stack(hermite(_XI, order), 1) for order in range(3)], 1)
_TO_FORCE = _SHAPES.reshape(-1, 4).T
_TO_STIFFNESS = np.einsum("gon,gpm->nmgop", _SHAPES, _SHAPES).reshape(16, -1)


class InnerFace:
    """The inner face of a shell at the contact points of its elements.

    Args:
        wall: what it may touch.
        section: the undeformed membrane.
        angles: of the stations [rad].
        qe: element unknowns [shape, component].
        growth: of the membrane; None where it fits its seat.
    """

    def __init__(
        self,
        wall: Wall,
        section: AbstractSection,
        angles: Float[Array, "station #lane"],
        qe: ElementVector,
        growth: Growth | None = None,
    ) -> None:
        self.growth = growth
        span = angles[1:] - angles[:-1]
        length = section.size * span
        self.wall, self.section = wall, section
        self.at = section.frame(angles[:-1] + _XI[:, None, None] * span)
        # Derivatives by arc length from those by the local coordinate [order].
        one = jnp.ones_like(length)
        self.power = jnp.stack([one, 1 / length, 1 / length**2])
        values = mix(_SHAPES.reshape(-1, 4), qe).reshape(-1, 3, *qe.shape[1:])
        values = values * self.power[:, None]
        # [order and component, point, ...]
        self.inputs = jnp.moveaxis(values, 0, 2).reshape(6, len(_XI), *qe.shape[2:])
        # Of the undeformed inner face, which a unit of width covers [m].
        inner = 1 - self.at.curvature * self.at.thickness / 2
        self.area = jnp.asarray(_WEIGHTS)[:, None, None] * inner * length
        self.rest = section.mid_line(self.at.angle)

    def position(self, z: Float[Array, "6 *point"]) -> Float[Array, "2 *point"]:
        """Current positions of the inner face [m].

        Args:
            z: displacement of the mid-line and its derivatives by arc length.
        """
        t, n, k = self.at.tangent, self.at.normal, self.at.curvature
        r1 = (t[0] + z[2], t[1] + z[3])
        r2 = (z[4] - n[0] * k, z[5] - n[1] * k)
        inner = -self.at.thickness / 2
        return self.rest + z[:2] + fibre_position(r1, r2, inner, k, self.growth)

    def gap(self, position: Float[Array, "2 *point"]) -> Float[Array, "*point"]:
        """Distance of places near the contact points from the wall [m]."""
        return self.wall.gap(position, self.at.angle)

    def terms(self) -> ContactTerms:
        """Contact at every point, by its inputs."""
        gap = expanded(lambda z: self.gap(self.position(z)), self.inputs)
        return contact_terms(self.wall.law, gap, self.area)

    def energy(self) -> Lanes:
        """Energy of contact per width [J/m]."""
        gap = self.gap(self.position(self.inputs))
        return jnp.sum(self.area * self.wall.law.energy(gap), (0, 1))

    def element_terms(self) -> tuple[ElementVector, ElementMatrix]:
        """First and second derivatives of the energy by the element unknowns."""
        terms, power = self.terms(), self.power
        tail = terms.force.shape[2:]
        force = terms.force.reshape(3, 2, *terms.force.shape[1:]) * power[:, None, None]
        force = jnp.moveaxis(force, 2, 0).reshape(-1, 2, *tail)
        stiffness = terms.stiffness.reshape(3, 2, 3, 2, *terms.stiffness.shape[2:])
        stiffness = stiffness * (power[:, None] * power)[:, None, :, None, None]
        stiffness = stiffness.transpose(4, 0, 2, 1, 3, 5, 6)  # [point, order, order, c, c]
        stiffness = stiffness.reshape(-1, 2, 2, *tail)
        matrix = mix(_TO_STIFFNESS, stiffness).reshape(4, 4, 2, 2, *tail)
        return mix(_TO_FORCE, force), matrix

    def state(self, change: Float[Array, "6 point element lane"] | None = None) -> ContactState:
        """Where the face is, and how it is pushed.

        Args:
            change: small change of the inputs that moves and turns normals, see `shifted`.
        """
        place = self.position(self.inputs)
        if change is not None:
            t, z = self.at.tangent, self.inputs
            angle = turn((t[0] + z[2], t[1] + z[3]), (change[2], change[3]))
            middle = self.rest + z[:2]
            place = place + carried(place - middle, change[:2], angle)
        polar, gap = self.wall.seen_from(place, self.at.angle)
        pressure = contact_pressure(self.wall.law, gap)
        return ContactState(self.at.angle, polar, gap, pressure, self.area)
