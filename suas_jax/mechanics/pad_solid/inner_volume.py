"""Volume that the inner face of a solid pad sweeps, with its derivatives.

The flux of (x, y, 0)/2 through the face x(s, z), of which x,s x x,z points inwards; planes
across the axis let nothing through. Everything is written in differences from rest.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from suas_jax.mechanics.pad.lane import skew
from suas_jax.skin.section import AbstractSection


class Swept(NamedTuple):
    """Enclosed volume less that at rest, per area of the mid-surface."""

    more: Float[Array, " place"]  # the volume [m]
    first: list[Float[Array, "3 place"]]  # derivatives by u, u,s and u,z [component, place]
    # by pairs of these: zero where a pair is not what it depends on
    second: dict[tuple[int, int], Float[Array, "3 3 place"]]


def swept(section: AbstractSection, angle: Array, moved: Float[Array, "3 3 place"]) -> Swept:
    """Volume and derivatives.

    `section`: across the axis. `angle`: of the places [rad]. `moved`: displacement of the inner
    face, by arc length, along the axis.
    """

    def face(angle: Array) -> Array:
        at = section.frame(angle)
        return section.mid_line(angle) - at.thickness / 2 * at.normal

    place, along = jax.jvp(face, (angle,), (jnp.ones_like(angle),))
    zero = jnp.zeros_like(angle)
    rest = jnp.stack([*place, zero]), jnp.stack([*along / section.size, zero])
    axis = jnp.stack([zero, zero, zero + 1])
    u, us, uz = moved
    s, z = rest[1] + us, axis + uz
    at_rest = _cross(rest[1], axis)
    spin = _cross(us, axis) + _cross(rest[1], uz) + _cross(us, uz)
    flat = jnp.array([1.0, 1.0, 0.0])[:, None]
    here = flat * (rest[0] + u)
    normal = at_rest + spin
    more = -jnp.sum(flat * u * at_rest + here * spin, 0) / 2
    first = [-flat * normal / 2, -_cross(z, here) / 2, -_cross(here, s) / 2]
    none = jnp.zeros((3, 3, *zero.shape))
    second = {
        (0, 0): none,
        (0, 1): flat[:, None] * skew(z) / 2,
        (0, 2): -flat[:, None] * skew(s) / 2,
        (1, 1): none,
        (1, 2): skew(here) / 2,
        (2, 2): none,
    }
    return Swept(more, first, second)


def _cross(a: Array, b: Array) -> Array:
    return jnp.cross(a, b, axis=0)
