"""The deformed mid-surface of a pad at points: metric, curvature, the volume it sweeps.

Everything is written in differences from rest. Vectors are Cartesian (x right, y to the crown,
z along the axis) and lead the axes ``[component, gauss, gauss, element, element]``; "point"
stands for the last four.
"""

import functools
import operator
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from suas_jax.numerics.staging import staged

Vector = Float[Array, "3 *point"]
Scalar = Float[Array, "*point"]

# Orders of differentiation (by arc length s, along the axis z) of what is needed of u:
# itself, u,s  u,z  u,ss  u,zz  u,sz.
KINDS = ((0, 0), (1, 0), (0, 1), (2, 0), (0, 2), (1, 1))


def total(terms: Iterable[Array]) -> Array:
    """Sum of one or more arrays."""
    return functools.reduce(operator.add, terms)


def dot(a: Vector | Sequence[Array], b: Vector | Sequence[Array]) -> Scalar:
    """Inner product of vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return jnp.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


class Surface(NamedTuple):
    """The deformed mid-surface at points.

    Attributes:
        u: displacement.
        n: reference normal, outwards.
        rs: r,s.
        rz: r,z.
        second: r,ss  r,zz  r,sz.
        m: r,s x r,z, inwards.
        spin: m less its value at rest, -n.
        metric: a less the unit matrix, entries (11, 22, 12).
        bending: h less its value at rest, (1/R, 0, 0).
    """

    u: Vector
    n: Vector
    rs: Vector
    rz: Vector
    second: tuple[Vector, Vector, Vector]
    m: Vector
    spin: Vector
    metric: Float[Array, "3 *point"]
    bending: Float[Array, "3 *point"]


def surface(derivatives: Sequence[Vector], angle: Scalar, radius: Array) -> Surface:
    """The mid-surface from the displacement and its derivatives.

    Args:
        derivatives: of the displacement, in the order of `KINDS`.
        angle: reference angle of the points [rad].
        radius: of the undeformed mid-surface [m].
    """
    u, us, uz, uss, uzz, usz = derivatives
    sine, cosine = jnp.broadcast_arrays(jnp.sin(angle), jnp.cos(angle), u[0])[:2]
    zero, one = jnp.zeros_like(sine), jnp.ones_like(sine)
    n = jnp.stack([sine, cosine, zero])
    along = cosine * us[0] - sine * us[1]
    metric = [
        2 * along + dot(us, us),
        2 * uz[2] + dot(uz, uz),
        cosine * uz[0] - sine * uz[1] + us[2] + dot(us, uz),
    ]
    # t x u,z + u,s x (z + u,z) with the tangent t.
    spin = [
        us[1] - sine * uz[2] + us[1] * uz[2] - us[2] * uz[1],
        -us[0] - cosine * uz[2] + us[2] * uz[0] - us[0] * uz[2],
        cosine * uz[1] + sine * uz[0] + us[0] * uz[1] - us[1] * uz[0],
    ]
    m = [spin[0] - sine, spin[1] - cosine, spin[2]]
    bending = [
        dot(uss, m) - (sine * spin[0] + cosine * spin[1]) / radius,
        dot(uzz, m),
        dot(usz, m),
    ]
    rows = staged([*metric, *bending, *spin])
    strain, bent, turned = (jnp.stack(rows[k : k + 3]) for k in (0, 3, 6))
    rs = us + jnp.stack([cosine, -sine, zero])
    rz = uz + jnp.stack([zero, zero, one])
    return Surface(u, n, rs, rz, (uss - n / radius, uzz, usz), turned - n, turned, strain, bent)


def swept(s: Surface, radius: Array) -> tuple[Scalar, list[Vector]]:
    """Enclosed volume less that at rest, per area, and its derivatives by u, u,s, u,z.

    The flux of (x, y, 0)/2 through the mid-surface; none passes through planes across the
    axis, so that ends free to slide in them are no part of it.
    """
    across = jnp.asarray([1.0, 1.0, 0.0]).reshape(3, *(1,) * (s.u.ndim - 1))
    away = across * (radius * s.n + s.u)
    more = dot(across * s.u, s.n) - dot(away, s.spin)
    derivatives = [-across * s.m, cross(away, s.rz), cross(s.rs, away)]
    return more / 2, [d / 2 for d in derivatives]
