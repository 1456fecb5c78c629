"""A face of the membrane against a rigid surface: where it is, what it touches, how hard.

The gap g of a point of a face is a function of a few local inputs z (a position; for
a shell also the slopes that turn and thin it). With the law's energy W per area and the
point's share w of the area::

    E = w W(g),   dE/dz = w W' dg/dz,   d2E/dz2 = w (W'' dg/dz (x) dg/dz + W' d2g/dz2)

Nothing here knows about dimensions or about what the inputs are, but that the first of them
are displacements: every mechanics brings its gap and takes the terms back through its own shape
functions.
"""

import abc
import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from suas_jax.numerics.array_types import Lanes
from suas_jax.skin.body import Body, Grip, PlacedBody
from suas_jax.skin.wall import AbstractPressureGap, Obstacle, Wall


class Gap(NamedTuple):
    """The gap at points and its derivatives by their local inputs."""

    value: Float[Array, "*point"]  # [m]
    first: Float[Array, "input *point"]  # derivatives
    second: Float[Array, "input input *point"]  # second derivatives


def expanded(
    # function whose value at a point depends on the inputs at that point alone
    gap: Callable[[Float[Array, "input *point"]], Float[Array, "*point"]],
    inputs: Float[Array, "input *point"],  # leading axis over the inputs
) -> Gap:
    """Differentiate a gap twice by its inputs, each point on its own."""
    unit = jnp.eye(inputs.shape[0], dtype=inputs.dtype)
    unit = unit.reshape(*unit.shape, *(1,) * (inputs.ndim - 1))

    # Values and first derivatives are the same in all directions: told once.
    def slopes(z: Array) -> tuple[Array, Array]:
        def along(direction: Array) -> tuple[Array, Array]:
            value, slope = jax.jvp(gap, (z,), (jnp.broadcast_to(direction, z.shape),))
            return value, slope

        return jax.vmap(along, out_axes=(None, 0))(unit)

    def curvatures(direction: Array) -> tuple[tuple[Array, Array], Array]:
        known, (_, second) = jax.jvp(
            slopes, (inputs,), (jnp.broadcast_to(direction, inputs.shape),)
        )
        return known, second

    (value, first), second = jax.vmap(curvatures, out_axes=((None, None), 0))(unit)
    return Gap(value, first, second)


class ContactTerms(NamedTuple):
    """What a mechanics adds to its energy, residual and tangent."""

    energy: Float[Array, "*point"]  # at every point, weight included [J/m of width]
    force: Float[Array, "input *point"]  # its derivatives by the local inputs
    stiffness: Float[Array, "input input *point"]  # its second derivatives


def contact_terms(
    law: AbstractPressureGap, gap: Gap, weight: Float[Array, "*#point"]
) -> ContactTerms:
    """Energy of contact and its derivatives.

    `law`: of the obstacle. `gap`: at the points. `weight`: quadrature weights times the
    undeformed area that a unit covers.
    """

    def slope(g: Array) -> tuple[Array, Array]:
        energy, first = jax.jvp(law.energy, (g,), (jnp.ones_like(g),))
        return first, energy

    first, second, energy = jax.jvp(
        slope, (gap.value,), (jnp.ones_like(gap.value),), has_aux=True
    )
    direct = second * gap.first[:, None] * gap.first[None]
    return ContactTerms(
        weight * energy, weight * first * gap.first, weight * (direct + first * gap.second)
    )


def by_travel(terms: ContactTerms, body: Body) -> Float[Array, "input *point"]:
    """Derivative of the force on the points by a factor on a body's travel.

    A body that goes some way meets the points as if they had gone the opposite way.
    """
    rows = [-x * terms.stiffness[k] for k, x in enumerate(body.way)]
    return functools.reduce(jnp.add, rows)


def contact_pressure(law: AbstractPressureGap, gap: Float[Array, "*point"]) -> Array:
    """Pressure on a face at given gaps [Pa]."""
    return -jax.jvp(law.energy, (gap,), (jnp.ones_like(gap),))[1]


class ContactState(NamedTuple):
    """The inner face at the points where it may touch the wall.

    Arrays are [point, element, lane] along a section, [arc, axial, lane] over a pad.
    """

    angle: Array  # reference angle [rad]
    polar_angle: Array  # angle of the normal of the undeformed section through the point [rad]
    gap: Array  # to the wall's surface, negative inside it [m]
    pressure: Array  # of the wall on the face, per area of the undeformed face [Pa]
    # of the undeformed face that a point stands for [m^2]; in plane strain per width [m]
    area: Array
    axial: Array | None = None  # current position along the axis [m]; None in plane strain


class BodyContact(NamedTuple):
    """The outer face at the points where it may touch a body.

    Arrays are [point, element, lane] along a section, [arc, axial, lane] over a pad; components
    lead.
    """

    angle: Array  # reference angle [rad]
    position: Array  # current position [m]
    gap: Array  # to the body's surface, negative inside it [m]
    pressure: Array  # on the face, per area of the undeformed face [Pa]
    force: Array  # on the body [N]; in plane strain per width [N/m]
    # of the undeformed face that a point stands for [m^2]; in plane strain per width [m]
    area: Array
    axial: Array | None = None  # reference position along the axis [m]; None in plane strain

    @property
    def push(self) -> Float[Array, "component lane"]:
        """Force on the body where points touch it [N]; in plane strain per width [N/m]."""
        return jnp.sum(jnp.where(self.gap < 0, self.force, 0.0), (1, 2))

    @property
    def on_clamp(self) -> Bool[Array, " lane"]:
        """Whether the body reaches a clamped edge, which a plane of symmetry is none."""

        def clamped(place: Array) -> Array:
            far = jnp.abs(jnp.broadcast_to(place, self.gap.shape))
            return (self.gap < 0) & (far > jnp.max(far, (0, 1)) / 2)

        along = clamped(self.angle)
        if self.axial is None:
            return along[0, 0] | along[-1, -1]
        across = clamped(self.axial)
        return jnp.any(along[0] | along[-1], 0) | jnp.any(across[:, 0] | across[:, -1], 0)

    def turn_between_points(self, curvature: Lanes | float) -> Lanes | float:
        """Turn of a tip's surface over half the distance of the points that touch it [rad].

        `curvature`: of the tip [1/m]. A pad's points hold one that is twice as sharp.
        """
        area, touched = jnp.broadcast_to(self.area, self.gap.shape), self.gap < 0
        if self.axial is not None:
            apart = jnp.sqrt(jnp.max(jnp.where(touched, area, 0.0), (0, 1)))
            return apart * curvature / 4
        # Points at the ends of an element stand for half of the distance.
        touched = jnp.any(touched, 0)
        return jnp.max(jnp.where(touched, jnp.max(area, 0), 0.0), 0) * curvature / 2

    def passed_by(self, body: PlacedBody) -> Bool[Array, " lane"]:
        """Whether a body has come through between points: the nearest lies behind its tip."""
        seen = body.seen(self.position)
        height, lowest = body.body.shape.height(seen[:-1]), jnp.min(self.gap, (0, 1))
        behind = seen[-1] > jnp.where(jnp.isinf(height), 0.0, height)
        return (lowest >= 0) & jnp.any(behind & (self.gap == lowest), (0, 1))


class Strip(NamedTuple):
    """The strip that a body touches, as a continuum does where a shell touches along lines."""

    half: Lanes  # half its width [m]
    pressure: Lanes  # the largest on it [Pa]
    told: Bool[Array, " lane"]  # whether both are good to a tenth


class AbstractContactFace(abc.ABC):
    """A face at the points where it may touch something."""

    obstacle: Obstacle  # a wall, beneath the inner face, or a placed body, on the outer one
    angle: Array  # reference angles of the points [rad]
    area: Array  # of the undeformed face that each point stands for

    @abc.abstractmethod
    def place(self) -> Array:
        """Current positions of the points, components leading [m]."""

    @abc.abstractmethod
    def place_at_rest(self) -> Array:
        """Where they were at rest, from where they slide on a body [m]."""

    def energy(self) -> Lanes:
        """Energy of contact, and work against friction at its bound."""
        place, grip = self.place(), self.grip()
        energy = self.area * self.obstacle.law.energy(self.obstacle.gap(place, self.angle))
        if grip is not None:
            if self._body.body.grip is None:  # of the state at hand, whose change is not work
                grip = jax.lax.stop_gradient(grip)
            energy = energy + self._slip(place, grip)
        return jnp.sum(energy, (0, 1))

    @property
    def _body(self) -> PlacedBody:
        assert isinstance(self.obstacle, PlacedBody)
        return self.obstacle

    def _slip(self, place: Array, grip: Grip) -> Array:
        """Work against friction at a known bound."""
        moved = place - self.place_at_rest()
        return grip.bound * self._body.work_of_slip(moved, grip.normal)

    def grip(self) -> Grip | None:
        """How friction holds the points; None without friction."""
        if not isinstance(self.obstacle, PlacedBody) or self.obstacle.body.friction is None:
            return None
        known = self.obstacle.body.grip
        return self.obstacle.grip(self.place(), self.area) if known is None else known

    def with_friction(
        self,
        terms: ContactTerms,  # of contact without friction
        # displacement of the points of the face by their inputs [m]
        moved: Callable[[Float[Array, "input *point"]], Float[Array, "component *point"]],
        inputs: Float[Array, "input *point"],  # leading axis over the inputs
        grip: Grip | None,  # of friction; None without
    ) -> ContactTerms:
        """Terms of contact with those of friction at a known bound.

        Coulomb's law has no potential, as the bound changes with the pressure. The stiffness is
        that at a given bound, which is symmetric.
        """
        if grip is None:
            return terms
        body, bound, normal = self._body, grip.bound, grip.normal
        work = expanded(lambda z: body.work_of_slip(moved(z), normal), inputs)
        return ContactTerms(*(a + bound * b for a, b in zip(terms, work, strict=True)))

    def touched(self, shift: Array | float = 0.0) -> BodyContact:
        """Where the face is, and how it pushes its body. `shift`: added to the gaps [m]."""
        body, place, grip = self._body, self.place(), self.grip()

        def energy(place: Array) -> Array:
            found = self.area * body.law.energy(body.gap(place, self.angle) + shift)
            return jnp.sum(found if grip is None else found + self._slip(place, grip))

        gap = body.gap(place) + shift
        pressure, force = contact_pressure(body.law, gap), jax.grad(energy)(place)
        return BodyContact(self.angle, place, gap, pressure, force, self.area)

    def state(self, place: Array | None = None) -> ContactState:
        """Where the face is, unless a place is given, and how its wall pushes it."""
        wall, angle = self.obstacle, self.angle
        assert isinstance(wall, Wall)
        polar, gap = wall.seen_from(self.place() if place is None else place, angle)
        return ContactState(angle, polar, gap, contact_pressure(wall.law, gap), self.area)
