"""Contact points of a pad's face in some of its elements, and the terms of contact there.

The inner face is the fibre at -t/2 of the thinned membrane, so its gap at a point depends on
the displacement and on its first and second derivatives: eighteen inputs. The outer one is at
t/2 on the rigid normal, as for the section's shell: nine. Points are even in an element, the
corners included: where the membrane first touches, the zone is smaller than an element.
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from suas_jax.mechanics.contact.face import (
    AbstractContactFace,
    ContactTerms,
    contact_terms,
    expanded,
)
from suas_jax.mechanics.pad.net import Net
from suas_jax.mechanics.pad.stiffness import COLUMNS, ROWS
from suas_jax.numerics.bspline import bernstein
from suas_jax.numerics.jet import staged
from suas_jax.skin.body import Grip, PlacedBody
from suas_jax.skin.section import AbstractSection
from suas_jax.skin.wall import Obstacle, Wall

Kinds = tuple[tuple[int, int], ...]
# Current positions of a face's points [m] from displacement and its derivatives, reference
# angles [rad] and positions along the axis [m].
Position = Callable[[Float[Array, "input *point"], Array, Array], Array]

# Between points, along either side of an element: against the wall, and under bodies, where the
# place of contact turns the force.
_INTERVALS = {-1: 8, 1: 16}


class Rule(NamedTuple):
    """Points of an element: of the trapezoidal rule along either side, or every few of them."""

    xi: Float[np.ndarray, " side"]  # local coordinates
    weights: Float[np.ndarray, " side"]

    @classmethod
    def of(cls, intervals: int) -> "Rule":
        """With points at both ends."""
        xi = np.linspace(0, 1, intervals + 1)
        return cls(xi, np.where((xi == 0) | (xi == 1), 0.5, 1.0) / intervals)


RULES = {side: Rule.of(intervals) for side, intervals in _INTERVALS.items()}


@functools.cache
def _shapes(count: int, kinds: Kinds) -> Float[np.ndarray, "kind point 16"]:
    """Bernstein polynomials at the points by kind of derivative (along stations, across)."""
    xi = np.linspace(0, 1, count)
    by_order = [np.stack(bernstein(xi, order), 1) for order in range(3)]
    products = [np.einsum("ga,hb->ghab", by_order[m], by_order[n]) for m, n in kinds]
    return np.stack(products).reshape(len(kinds), -1, 16)


class Side(NamedTuple):
    """A face of the membrane and what it may touch."""

    net: Net
    obstacle: Obstacle  # a wall inside, a body outside
    section: AbstractSection  # the undeformed membrane across the axis
    kinds: Kinds  # of derivatives that a point's place depends on, along the stations first
    position: Position

    @property
    def sign(self) -> int:
        """-1 of the inner face, 1 of the outer one."""
        return -1 if isinstance(self.obstacle, Wall) else 1


class ContactPoints(AbstractContactFace):
    """The points of a side in some elements [point, element]."""

    def __init__(
        self,
        side: Side,
        qe: Float[Array, "3 16 element"],  # Bernstein coefficients of their displacement
        element: Int[Array, " element"],  # which ones, along the stations first
        rule: Rule,
        share: Float[Array, " element"] | float = 1.0,  # of their area that counts
    ) -> None:
        net, self._position = side.net, side.position
        self.obstacle = obstacle = side.obstacle
        if isinstance(obstacle, PlacedBody) and (grip := obstacle.body.grip) is not None:
            own = Grip(share * grip.bound[:, element], grip.normal[..., element])
            self.obstacle = dataclasses.replace(obstacle, body=obstacle.body.holding(own))
        order, section = net.topology.ordered, side.section
        span, axial = jnp.diff(net.angles), jnp.diff(net.axial)
        sizes = order(section.size * span, axial)
        self.at = jnp.divmod(element, len(sizes[1]))  # index along the stations, and across
        long, across = (x[i] for x, i in zip(sizes, self.at, strict=True))
        count = len(rule.xi)
        self.shapes = _shapes(count, side.kinds)
        self.powers = jnp.stack([1 / (long**m * across**n) for m, n in side.kinds])
        values = jnp.einsum("kgs,cse->kcge", self.shapes, qe)
        values = values * self.powers[:, None, None]
        self.inputs = values.reshape(3 * len(side.kinds), count**2, -1)
        xi = order(np.repeat(rule.xi, count), np.tile(rule.xi, count))
        arc, along = order(*self.at)
        self.angle = net.angles[arc] + xi[0][:, None] * span[arc]
        self.axial = net.axial[along] + xi[1][:, None] * axial[along]
        self._columns = net.along[:, :, self.at[0]], net.across[:3, :, :, self.at[1]]
        weights = np.outer(rule.weights, rule.weights).reshape(-1, 1)
        half = side.sign * section.thickness(self.angle) / 2
        face = 1 + section.curvature(self.angle) * half
        self.area = share * weights * (long * across) * face

    def gap(self) -> Float[Array, "point element"]:
        """Distance from the obstacle [m]."""
        return self.obstacle.gap(self.place(), self.angle)

    def place(self) -> Array:
        """See the base class."""
        return jnp.stack(staged([*self._position(self.inputs, self.angle, self.axial)]))

    def place_at_rest(self) -> Array:
        """See the base class."""
        return self._position(0 * self.inputs, self.angle, self.axial)

    def terms(self) -> ContactTerms:
        """Energy of contact at the points, and its derivatives by their inputs."""

        def position(z: Array) -> Array:
            return self._position(z, self.angle, self.axial)

        def gap_of(z: Array) -> Array:
            return self.obstacle.gap(position(z), self.angle)

        def moved(z: Array) -> Array:
            return position(z) - position(0 * z)

        terms = contact_terms(self.obstacle.law, expanded(gap_of, self.inputs), self.area)
        return self.with_friction(terms, moved, self.inputs, self.grip())

    def forces(self, by_inputs: Array) -> Float[Array, "3 16 element"]:
        """Derivatives by control values from those by the points' inputs."""
        force = by_inputs.reshape(len(self.powers), 3, len(self.angle), -1)
        force = force * self.powers[:, None, None]
        return jnp.einsum("kgs,kcge->cse", self.shapes, force)

    def blocks(self, terms: ContactTerms) -> Array:
        """Second derivatives by control values, by `SLOTS` along the stations."""
        powers, points = self.powers, len(self.angle)
        kinds = len(powers)
        stiffness = terms.stiffness.reshape(kinds, 3, kinds, 3, points, -1)
        stiffness = stiffness * (powers[:, None] * powers)[:, None, :, None, None]
        half = jnp.einsum("kgs,kcldge->csldge", self.shapes, stiffness)
        k = jnp.einsum("csldge,lgt->csdte", half, self.shapes)
        k = k.reshape(3, 4, 4, 3, 4, 4, -1)
        along, across = self._columns
        k = jnp.einsum("iae,cabdxye->cibdxye", along, k)
        k = jnp.einsum("lxe,cibdxye->cibdlye", along, k)
        k = jnp.einsum("cjbe,cibdlye->cijdlye", across, k)
        k = jnp.einsum("dmye,cijdlye->cijdlme", across, k)
        pairs = k[:, ROWS, :, :, COLUMNS]  # [slot, component, across, component, across, .]
        return jnp.transpose(pairs, (0, 5, 2, 4, 1, 3))
