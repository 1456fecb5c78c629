"""The deformed mid-surface of a pad at points: metric, curvature, the volume it sweeps.

Everything is written in differences from rest. Vectors are lists of their Cartesian components
(x right, y to the crown, z along the axis), each ``[gauss, gauss, element, element]``, which
"point" stands for: each index into an array would be two operations more to compile, a
quarter of a pad's program.
"""

import functools
import operator
from collections.abc import Iterable
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from suas_jax.numerics.jet import staged
from suas_jax.skin.section import AbstractSection

Scalar = Float[Array, "*point"]
Vector = tuple[Scalar, Scalar, Scalar]

# Orders of differentiation (by arc length s, along the axis z) of what is needed of u:
# itself, u,s  u,z  u,ss  u,zz  u,sz.
KINDS = ((0, 0), (1, 0), (0, 1), (2, 0), (0, 2), (1, 1))


def total(terms: Iterable[Array]) -> Array:
    """Sum of one or more arrays."""
    return functools.reduce(operator.add, terms)


def components(x: Iterable[Array]) -> Vector:
    """A vector from an array that its components lead."""
    first, second, third = x
    return first, second, third


def vectors(rows: Iterable[Array]) -> list[Vector]:
    """Vectors from rows that hold their components one after the other."""
    x = list(rows)
    return [components(x[k : k + 3]) for k in range(0, len(x), 3)]


def dot(a: Vector, b: Vector) -> Scalar:
    """Inner product of vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


class Rest(NamedTuple):
    """The undeformed mid-surface at points.

    Of a membrane whose thickness varies along the axis it is the one of the mean along it.
    """

    angle: Scalar  # as sections define it [rad]
    place: tuple[Scalar, Scalar]  # x and y [m]
    normal: tuple[Scalar, Scalar]  # x and y of the outward unit vector
    curvature: Array  # of the section [1/m]
    below: Array  # distance of the inner face [m]
    above: Array  # distance of the outer face [m]

    @property
    def thickness(self) -> Array:
        """Of the membrane [m]."""
        return self.below + self.above

    @classmethod
    def of(cls, section: AbstractSection, angle: Scalar, relief: Array | float = 0.0) -> "Rest":
        """That of a section's angles.

        `section`: the membrane across the axis, its mean where it varies along it. `angle`:
        reference angles [rad]. `relief`: how much further the outer face lies out there [m].
        """
        x, y = section.mid_line(angle)
        direction = section.direction(angle)
        normal = jnp.sin(direction), jnp.cos(direction)
        curvature, half = section.curvature(angle), section.thickness(angle) / 2
        return cls(angle, (x, y), normal, curvature, half, half + relief)


class Surface(NamedTuple):
    """The deformed mid-surface at points."""

    u: Vector  # displacement
    rest: Rest  # the undeformed mid-surface
    n: Vector  # reference normal, outwards
    rs: Vector  # r,s
    rz: Vector  # r,z
    second: tuple[Vector, Vector, Vector]  # r,ss  r,zz  r,sz
    m: Vector  # r,s x r,z, inwards
    spin: Vector  # m less its value at rest, -n
    metric: Vector  # a less the unit matrix, entries (11, 22, 12)
    bending: Vector  # h less its value at rest, (1/R, 0, 0)


def surface(derivatives: Iterable[Iterable[Array]], rest: Rest) -> Surface:
    """The mid-surface from the displacement and its derivatives.

    `derivatives`: of the displacement, in the order of `KINDS`, components leading. `rest`: the
    undeformed mid-surface there.
    """
    u, us, uz, uss, uzz, usz = (components(x) for x in derivatives)
    sine, cosine = jnp.broadcast_arrays(*rest.normal, u[0])[:2]
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
    m = spin[0] - sine, spin[1] - cosine, spin[2]
    bending = [
        dot(uss, m) - (sine * spin[0] + cosine * spin[1]) * rest.curvature,
        dot(uzz, m),
        dot(usz, m),
    ]
    rows = staged([*metric, *bending, *spin])
    strain, bent, turned = (components(rows[k : k + 3]) for k in (0, 3, 6))
    n = sine, cosine, jnp.zeros_like(sine)
    rs = us[0] + cosine, us[1] - sine, us[2]
    rz = uz[0], uz[1], uz[2] + 1
    rss = uss[0] - sine * rest.curvature, uss[1] - cosine * rest.curvature, uss[2]
    m = turned[0] - sine, turned[1] - cosine, turned[2]
    return Surface(u, rest, n, rs, rz, (rss, uzz, usz), m, turned, strain, bent)


def swept(s: Surface) -> tuple[Scalar, list[Vector]]:
    """Enclosed volume less that at rest, per area, and its derivatives by u, u,s, u,z.

    The flux of (x, y, 0)/2 through the mid-surface; none passes through planes across the
    axis, so that ends free to slide in them are not part of it.
    """
    x, y = (s.rest.place[k] + s.u[k] for k in (0, 1))
    more = s.u[0] * s.n[0] + s.u[1] * s.n[1] - x * s.spin[0] - y * s.spin[1]
    half = x / 2, y / 2, jnp.zeros_like(x)
    by_u = -s.m[0] / 2, -s.m[1] / 2, half[2]
    return more / 2, [by_u, cross(half, s.rz), cross(s.rs, half)]
