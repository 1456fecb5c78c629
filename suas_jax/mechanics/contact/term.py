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

from suas_jax.skin.body import Body
from suas_jax.skin.wall import AbstractPressureGap


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
