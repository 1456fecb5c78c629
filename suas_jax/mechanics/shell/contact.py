"""The lumped shell's faces against rigid surfaces: the inner one's wall, bodies on the outer.

The inner face is the fibre at -t/2 of the thinned membrane, so its gap at a point depends on
the mid-line's displacement and on its first two derivatives by arc length: six inputs. The
outer one is at t/2 on the rigid normal, which loads act on, too: four inputs. Beneath a body
the shell bends more sharply than a continuum, and thinned by that bending it would meet the
body too early.
Points are even along an element: the shell touches in zones much shorter than its elements,
and even points leave the least between them.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.mechanics.base import BodyContact, ContactState
from suas_jax.mechanics.contact.term import (
    ContactTerms,
    contact_pressure,
    contact_terms,
    expanded,
    grip_of,
    held_energy,
    held_terms,
)
from suas_jax.mechanics.shell.points import mix
from suas_jax.mechanics.shell.shape import carried, fibre_position, turn
from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.hermite import hermite
from suas_jax.skin.body import Grip, PlacedBody
from suas_jax.skin.prestress import Growth
from suas_jax.skin.section import AbstractSection
from suas_jax.skin.wall import Obstacle, Wall

# Between contact points of an element, whose ends are points, too: against the wall, and under
# bodies, where the place of contact turns the force.
_INTERVALS = {-1: 16, 1: 64}
_ORDERS = {-1: 3, 1: 2}  # of the derivatives that the face's position depends on, and one more

ElementVector = Float[Array, "4 2 element lane"]
ElementMatrix = Float[Array, "4 4 2 2 element lane"]


class _Rule(NamedTuple):
    """Local coordinates and weights of the trapezoidal rule, and shape functions there."""

    xi: Float[np.ndarray, " point"]
    weights: Float[np.ndarray, " point"]
    shapes: Float[np.ndarray, "point order 4"]

    @classmethod
    def of(cls, side: int) -> "_Rule":
        """For the inner face (-1) or the outer one (1)."""
        intervals = _INTERVALS[side]
        weights = np.full(intervals + 1, 1.0 / intervals)
        weights[[0, -1]] /= 2
        xi = np.linspace(0, 1, intervals + 1)
        shapes = [np.stack(hermite(xi, order), 1) for order in range(_ORDERS[side])]
        return cls(xi, weights, np.stack(shapes, 1))


_RULES = {side: _Rule.of(side) for side in (-1, 1)}


class ContactFace:
    """A face of a shell at the contact points of its elements.

    Args:
        obstacle: what it may touch.
        side: -1 for the inner face, 1 for the outer one.
        section: the undeformed membrane.
        angles: of the stations [rad].
        qe: element unknowns [shape, component].
        growth: of the membrane; None where it fits its seat.
    """

    def __init__(
        self,
        obstacle: Obstacle,
        side: int,
        section: AbstractSection,
        angles: Float[Array, "station #lane"],
        qe: ElementVector,
        growth: Growth | None = None,
    ) -> None:
        self.growth = growth
        span = angles[1:] - angles[:-1]
        length = section.size * span
        self.obstacle, self.side, self.section = obstacle, side, section
        self.xi, weights, self.shapes = _RULES[side]
        self.at = section.frame(angles[:-1] + self.xi[:, None, None] * span)
        # Derivatives by arc length from those by the local coordinate [order].
        one = jnp.ones_like(length)
        self.power = jnp.stack([one, 1 / length, 1 / length**2])
        orders = self.shapes.shape[1]
        self.power = self.power[:orders]
        values = mix(self.shapes.reshape(-1, 4), qe).reshape(-1, orders, *qe.shape[1:])
        values = values * self.power[:, None]
        # [order and component, point, ...]
        self.inputs = jnp.moveaxis(values, 0, 2).reshape(
            2 * orders, len(self.xi), *qe.shape[2:]
        )
        # Of the undeformed face, which a unit of width covers [m].
        face = 1 + self.at.curvature * self._offset
        self.area = jnp.asarray(weights)[:, None, None] * face * length
        self.rest = section.mid_line(self.at.angle)

    @property
    def _offset(self) -> Array:
        """Of the face from the mid-line, outwards [m]."""
        return self.side * self.at.thickness / 2

    def position(self, z: Float[Array, "input *point"]) -> Float[Array, "2 *point"]:
        """Current positions of the face [m].

        Args:
            z: displacement of the mid-line and its derivatives by arc length.
        """
        t, n, k = self.at.tangent, self.at.normal, self.at.curvature
        r1 = (t[0] + z[2], t[1] + z[3])
        if self.side > 0:
            size = jnp.sqrt(r1[0] ** 2 + r1[1] ** 2)
            return self.rest + z[:2] + self._offset * jnp.stack([-r1[1], r1[0]]) / size
        r2 = (z[4] - n[0] * k, z[5] - n[1] * k)
        return self.rest + z[:2] + fibre_position(r1, r2, self._offset, k, self.growth)

    def gap(self, position: Float[Array, "2 *point"]) -> Float[Array, "*point"]:
        """Distance of places near the contact points from the obstacle [m]."""
        return self.obstacle.gap(position, self.at.angle)

    def terms(self) -> ContactTerms:
        """Contact at every point, by its inputs."""
        gap = expanded(lambda z: self.gap(self.position(z)), self.inputs)
        terms = contact_terms(self.obstacle.law, gap, self.area)
        return held_terms(terms, self.obstacle, self.moved, self.inputs, self.grip())

    def energy(self) -> Lanes:
        """Energy of contact per width, and work against friction at its bound [J/m]."""
        gap = self.gap(self.position(self.inputs))
        energy = self.area * self.obstacle.law.energy(gap)
        slipped = held_energy(self.obstacle, self.moved(self.inputs), self.grip())
        return jnp.sum(energy + slipped, (0, 1))

    def moved(self, z: Float[Array, "input *point"]) -> Float[Array, "2 *point"]:
        """Displacements of the points of the face [m]."""
        return self.position(z) - self.position(jnp.zeros_like(z))

    def grip(self) -> Grip | None:
        """How friction holds the points; None without friction."""
        return grip_of(self.obstacle, self.position(self.inputs), self.area)

    def forces(self, by_inputs: Float[Array, "input point element lane"]) -> ElementVector:
        """Element forces from derivatives by the inputs."""
        force = by_inputs.reshape(-1, 2, *by_inputs.shape[1:]) * self.power[:, None, None]
        force = jnp.moveaxis(force, 2, 0).reshape(-1, 2, *by_inputs.shape[2:])
        return mix(self.shapes.reshape(-1, 4).T, force)

    def matrix(self, terms: ContactTerms) -> ElementMatrix:
        """Second derivatives of the energy by the element unknowns."""
        power, tail = self.power, terms.force.shape[2:]
        orders = len(power)
        stiffness = terms.stiffness.reshape(orders, 2, orders, 2, *terms.stiffness.shape[2:])
        stiffness = stiffness * (power[:, None] * power)[:, None, :, None, None]
        stiffness = stiffness.transpose(4, 0, 2, 1, 3, 5, 6)  # [point, order, order, c, c]
        stiffness = stiffness.reshape(-1, 2, 2, *tail)
        products = np.einsum("gon,gpm->nmgop", self.shapes, self.shapes).reshape(16, -1)
        return mix(products, stiffness).reshape(4, 4, 2, 2, *tail)

    def touched(self, body: PlacedBody, shift: Array | float) -> BodyContact:
        """Where the face is, and how it pushes a body."""
        position, rest = self.position(self.inputs), self.position(0 * self.inputs)
        return BodyContact.of(body, self.at.angle, position, rest, self.area, None, shift)

    def shares(self, z: Float[Array, "input point element lane"]) -> Array:
        """Force of every point, along its own normal, by its inputs [N/m]."""
        return self.area * contact_pressure(self.obstacle.law, self.gap(self.position(z)))

    def pulled(self, by_share: Float[Array, "point element lane"]) -> ElementVector:
        """Element forces from derivatives by `shares`."""
        (by_inputs,) = jax.vjp(self.shares, self.inputs)[1](by_share)
        return self.forces(by_inputs)

    def state(self, change: Float[Array, "6 point element lane"] | None = None) -> ContactState:
        """Where the face is, and how the wall pushes it.

        Args:
            change: small change of the inputs that moves and turns normals, see `shifted`.
        """
        place = self.position(self.inputs)
        if change is not None:
            t, z = self.at.tangent, self.inputs
            angle = turn((t[0] + z[2], t[1] + z[3]), (change[2], change[3]))
            middle = self.rest + z[:2]
            place = place + carried(place - middle, change[:2], angle)
        wall = self.obstacle
        assert isinstance(wall, Wall)
        polar, gap = wall.seen_from(place, self.at.angle)
        pressure = contact_pressure(wall.law, gap)
        return ContactState(self.at.angle, polar, gap, pressure, self.area)
