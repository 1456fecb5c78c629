"""The contact energy at quadrature points, and its derivatives by a point's local inputs.

The gap g of a point of a face is a function of a few local inputs z (a position; for
a shell also the slopes that turn and thin it). With the law's energy W per area and the
point's share w of the area::

    E = w W(g),   dE/dz = w W' dg/dz,   d2E/dz2 = w (W'' dg/dz (x) dg/dz + W' d2g/dz2)

Nothing here knows about dimensions or about what the inputs are, but that the first of them
are displacements: every mechanics brings its gap and takes the terms back through its own shape
functions.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from suas_jax.skin.body import Body, Grip, PlacedBody
from suas_jax.skin.wall import AbstractPressureGap, Obstacle


class Gap(NamedTuple):
    """The gap at points and its derivatives by their local inputs."""

    value: Float[Array, "*point"]  # [m]
    first: Float[Array, "input *point"]  # derivatives
    second: Float[Array, "input input *point"]  # second derivatives


def expanded(
    gap: Callable[[Float[Array, "input *point"]], Float[Array, "*point"]],
    inputs: Float[Array, "input *point"],  # leading axis over the inputs
) -> Gap:
    """Differentiate a gap twice by its inputs, each point on its own.

    `gap`: function whose value at a point depends on the inputs at that point alone.
    """
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
        weight * energy,
        weight * first * gap.first,
        weight * (direct + first * gap.second),
    )


def grip_of(
    obstacle: Obstacle,
    position: Float[Array, "component *point"],  # of the points [m]
    area: Float[Array, "*#point"],
) -> Grip | None:
    """How friction holds points of a face; None without friction.

    `area`: of the undeformed face that a point stands for.
    """
    if not isinstance(obstacle, PlacedBody) or obstacle.body.friction is None:
        return None
    known = obstacle.body.grip
    return obstacle.grip(position, area) if known is None else known


def held_terms(
    terms: ContactTerms,  # of contact without friction
    obstacle: Obstacle,  # what the points touch
    moved: Callable[[Float[Array, "input *point"]], Float[Array, "component *point"]],
    inputs: Float[Array, "input *point"],  # leading axis over the inputs
    grip: Grip | None,  # of friction; None without
) -> ContactTerms:
    """Terms of contact with those of friction at a known bound.

    Coulomb's law has no potential, as the bound changes with the pressure. The stiffness is
    that at a given bound, which is symmetric.

    `moved`: displacement of the points of the face by their inputs [m].
    """
    if grip is None:
        return terms
    assert isinstance(obstacle, PlacedBody)
    body, bound, normal = obstacle, grip.bound, grip.normal
    work = expanded(lambda z: body.work_of_slip(moved(z), normal), inputs)
    return ContactTerms(*(a + bound * b for a, b in zip(terms, work, strict=True)))


def held_energy(
    obstacle: Obstacle, moved: Float[Array, "component *point"], grip: Grip | None
) -> Float[Array, "*point"] | float:
    """Work against friction at a known bound; zero without friction."""
    if grip is None:
        return 0.0
    assert isinstance(obstacle, PlacedBody)
    if obstacle.body.grip is None:  # of the state at hand, whose change is not work
        grip = jax.lax.stop_gradient(grip)
    return grip.bound * obstacle.work_of_slip(moved, grip.normal)


def by_travel(terms: ContactTerms, body: Body) -> Float[Array, "input *point"]:
    """Derivative of the force on the points by a factor on a body's travel.

    A body that goes some way meets the points as if they had gone the opposite way.
    """
    rows = [-x * terms.stiffness[k] for k, x in enumerate(body.way)]
    return functools.reduce(jnp.add, rows)


def push(
    obstacle: Obstacle,
    position: Float[Array, "component *point"],  # of the points [m]
    near: Float[Array, "*#point"],
    area: Float[Array, "*#point"],
    shift: Array | float = 0.0,  # added to the gaps [m]
    rest: Float[Array, "component *point"] | None = None,
) -> Float[Array, "component *point"]:
    """Force of points of a face on an obstacle [N], in plane strain per width [N/m].

    `near`: angles close to theirs [rad]. `area`: of the undeformed face that a point stands
    for. `rest`: where the points were at rest, from where they slide on a body [m].
    """
    grip = None if rest is None else grip_of(obstacle, position, area)

    def energy(position: Array) -> Array:
        gap = obstacle.gap(position, near) + shift
        found = area * obstacle.law.energy(gap)
        if grip is not None:
            assert isinstance(obstacle, PlacedBody)
            assert rest is not None
            found = found + grip.bound * obstacle.work_of_slip(position - rest, grip.normal)
        return jnp.sum(found)

    return jax.grad(energy)(position)


def contact_pressure(law: AbstractPressureGap, gap: Float[Array, "*point"]) -> Array:
    """Pressure on a face at given gaps [Pa]."""
    return -jax.jvp(law.energy, (gap,), (jnp.ones_like(gap),))[1]
