"""A pad at its quadrature points: derivatives of the potential by the displacement's own.

First and second derivatives of strain energy less pressure times volume, per area of the
undeformed mid-surface, by u,s  u,z  u,ss  u,zz  u,sz.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.mechanics.pad.fibres import Resultants
from suas_jax.mechanics.pad.mid_surface import Scalar, Surface, Vector, cross, total

# Pairs of kinds that the tangent couples: each once, and each kind with itself.
PAIRS = ((1, 1), (1, 2), (2, 2), *((k, a) for k in (1, 2) for a in (3, 4, 5)))
PAIRS += ((3, 3), (3, 4), (3, 5), (4, 4), (4, 5), (5, 5), (0, 1), (0, 2))


def _skew(v: Vector) -> Float[Array, "3 3 *point"]:
    """The matrix of v x."""
    zero = jnp.zeros_like(v[0])
    rows = [[zero, -v[2], v[1]], [v[2], zero, -v[0]], [-v[1], v[0], zero]]
    return jnp.stack([jnp.stack(row) for row in rows])


def stress(s: Surface, first: list[Scalar]) -> list[Vector]:
    """Derivatives of the energy density by u,s u,z u,ss u,zz u,sz."""
    pull = total(first[3 + k] * v for k, v in enumerate(s.second))
    by_s = 2 * first[0] * s.rs + first[2] * s.rz + cross(s.rz, pull)
    by_z = 2 * first[1] * s.rz + first[2] * s.rs + cross(pull, s.rs)
    return [by_s, by_z, *(first[3 + k] * s.m for k in range(3))]


def tangent(
    s: Surface, found: Resultants, pressure: Array, radius: Array
) -> Float[Array, "pair 3 3 *point"]:
    """Second derivatives of the energy less pressure times volume, per area.

    Returns:
        A block for each of `PAIRS`.
    """
    first, second = found.first, found.second
    zero = jnp.zeros_like(s.rs)
    by_s = [2 * s.rs, zero, s.rz, *(cross(s.rz, v) for v in s.second)]
    by_z = [zero, 2 * s.rz, s.rs, *(cross(v, s.rs) for v in s.second)]

    def weighed(rows: list[Vector]) -> list[Vector]:
        return [total(second[p][q] * rows[p] for p in range(6)) for q in range(6)]

    s_weighed, z_weighed = weighed(by_s), weighed(by_z)

    def joint(weighed: list[Vector], rows: list[Vector]) -> Array:
        return total(x[:, None] * y for x, y in zip(weighed, rows, strict=True))

    eye = jnp.asarray(np.eye(3).reshape(3, 3, *(1,) * (s.u.ndim - 1)))
    pull = total(first[3 + k] * v for k, v in enumerate(s.second))
    across = jnp.asarray([1.0, 1.0, 0.0]).reshape(3, *(1,) * (s.u.ndim - 1))
    away = across * (radius * s.n + s.u)
    skew_s, skew_z = _skew(s.rs), _skew(s.rz)
    blocks = {
        (1, 1): joint(s_weighed, by_s) + 2 * first[0] * eye,
        (1, 2): joint(s_weighed, by_z) + first[2] * eye - _skew(pull + pressure / 2 * away),
        (2, 2): joint(z_weighed, by_z) + 2 * first[1] * eye,
        (0, 1): -pressure / 2 * across[:, None] * skew_z,
        (0, 2): pressure / 2 * across[:, None] * skew_s,
    }
    normals = s.m[:, None] * s.m
    for a in range(3):
        blocks[1, 3 + a] = s_weighed[3 + a][:, None] * s.m + first[3 + a] * skew_z
        blocks[2, 3 + a] = z_weighed[3 + a][:, None] * s.m - first[3 + a] * skew_s
        for b in range(a, 3):
            blocks[3 + a, 3 + b] = second[3 + a][3 + b] * normals
    return jnp.stack([blocks[pair] for pair in PAIRS])
