"""A pad at its quadrature points: derivatives of the potential by the displacement's own.

First and second derivatives of strain energy less pressure times volume, per area of the
undeformed mid-surface, by u,s  u,z  u,ss  u,zz  u,sz.
"""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.mechanics.pad.fibres import Resultants
from suas_jax.mechanics.pad.mid_surface import Scalar, Surface, Vector, components, cross, total

Rows = Float[Array, "3 *point"]

# Pairs of kinds that the tangent couples: each once, and each kind with itself.
PAIRS = ((1, 1), (1, 2), (2, 2), *((k, a) for k in (1, 2) for a in (3, 4, 5)))
PAIRS += ((3, 3), (3, 4), (3, 5), (4, 4), (4, 5), (5, 5), (0, 1), (0, 2))


def skew(v: Sequence[Array] | Array) -> Float[Array, "3 3 *point"]:
    """The matrix of v x."""
    zero = jnp.zeros_like(v[0])
    entries = jnp.stack([zero, -v[2], v[1], v[2], zero, -v[0], -v[1], v[0], zero])
    return entries.reshape(3, 3, *zero.shape)


def _pull(s: Surface, first: list[Scalar]) -> Vector:
    """The sum of r,ss  r,zz  r,sz, each times the derivative by its curvature."""
    return components(
        total(first[3 + k] * v[i] for k, v in enumerate(s.second)) for i in range(3)
    )


def stress(s: Surface, first: list[Scalar]) -> list[Vector]:
    """Derivatives of the energy density by u,s u,z u,ss u,zz u,sz."""
    pull = _pull(s, first)
    along, across = cross(s.rz, pull), cross(pull, s.rs)
    by_s = [2 * first[0] * s.rs[i] + first[2] * s.rz[i] + along[i] for i in range(3)]
    by_z = [2 * first[1] * s.rz[i] + first[2] * s.rs[i] + across[i] for i in range(3)]
    by_curvature = [components(first[3 + k] * x for x in s.m) for k in range(3)]
    return [components(by_s), components(by_z), *by_curvature]


def tangent(s: Surface, found: Resultants, pressure: Array) -> Float[Array, "pair 3 3 *point"]:
    """Second derivatives of the energy less pressure times volume, per area.

    Returns a block for each of `PAIRS`.
    """
    first, second = found.first, found.second
    rs, rz, m = jnp.stack(s.rs), jnp.stack(s.rz), jnp.stack(s.m)
    # What each of the six numbers depends on; a_22 not on u,s and a_11 not on u,z.
    by_s = {0: 2 * rs, 2: rz}
    by_z = {1: 2 * rz, 2: rs}
    for k, v in enumerate(s.second):
        by_s[3 + k], by_z[3 + k] = jnp.stack(cross(s.rz, v)), jnp.stack(cross(v, s.rs))

    def weighed(rows: dict[int, Rows]) -> list[Rows]:
        return [total(second[p][q] * row for p, row in rows.items()) for q in range(6)]

    s_weighed, z_weighed = weighed(by_s), weighed(by_z)

    def joint(weighed: list[Rows], rows: dict[int, Rows]) -> Array:
        return total(weighed[p][:, None] * row for p, row in rows.items())

    points = (1,) * s.u[0].ndim
    eye = np.eye(3).reshape(3, 3, *points)
    across = np.array([1.0, 1.0, 0.0]).reshape(3, 1, *points)
    half = pressure / 2
    pull = _pull(s, first)
    x, y = (pull[k] + half * (s.rest.place[k] + s.u[k]) for k in (0, 1))
    skew_s, skew_z = skew(s.rs), skew(s.rz)
    blocks = {
        (1, 1): joint(s_weighed, by_s) + 2 * first[0] * eye,
        (1, 2): joint(s_weighed, by_z) + first[2] * eye - skew((x, y, pull[2])),
        (2, 2): joint(z_weighed, by_z) + 2 * first[1] * eye,
        (0, 1): -half * across * skew_z,
        (0, 2): half * across * skew_s,
    }
    normals = m[:, None] * m
    for a in range(3):
        blocks[1, 3 + a] = s_weighed[3 + a][:, None] * m + first[3 + a] * skew_z
        blocks[2, 3 + a] = z_weighed[3 + a][:, None] * m - first[3 + a] * skew_s
        for b in range(a, 3):
            blocks[3 + a, 3 + b] = second[3 + a][3 + b] * normals
    return jnp.stack([blocks[pair] for pair in PAIRS])
