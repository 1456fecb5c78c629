"""The two end stations of an arc, where unknowns turn to tangential and normal.

Clamps and the crown's symmetry concern the end stations alone: their few numbers are
taken out, worked on and put back, which leaves everything between untouched.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.numerics.array_types import Diagonal, OffDiagonal, StationVector
from suas_jax.numerics.block_tridiagonal import product

EndMatrices = Float[Array, "4 4 end #lane"]


def turn_matrices(t: Float[Array, "2 end #lane"]) -> EndMatrices:
    """From tangential and normal slopes to Cartesian ones; displacements stay.

    Args:
        t: tangents at the ends.
    """
    zero, one = jnp.zeros_like(t[0]), jnp.ones_like(t[0])
    rows = [
        [one, zero, zero, zero],
        [zero, one, zero, zero],
        [zero, zero, t[0], -t[1]],
        [zero, zero, t[1], t[0]],
    ]
    return jnp.stack([jnp.stack(row) for row in rows])


def turn_vector(matrices: EndMatrices, q: StationVector) -> StationVector:
    """Multiply the end stations of a vector."""
    ends = jnp.stack([q[:, 0], q[:, -1]], 1)
    turned = functools.reduce(jnp.add, [matrices[:, k] * ends[k] for k in range(4)])
    return _put(_put(q, turned[:, 0], 0), turned[:, 1], -1)


def turn_blocks(
    diagonal: Diagonal, upper: OffDiagonal, matrices: EndMatrices, free: np.ndarray
) -> tuple[Diagonal, OffDiagonal]:
    """Congruence transform of the end stations, then fix what is clamped.

    Args:
        diagonal: blocks on the diagonal.
        upper: blocks above it.
        matrices: for both ends.
        free: mask of the unknowns that may move [dof, end, 1].
    """
    turn = matrices * free
    ends = jnp.stack([diagonal[:, :, 0], diagonal[:, :, -1]], 2)
    fixed = np.eye(4)[:, :, None, None] * (1 - free)
    ends = _times(product(turn, ends), turn) + fixed
    diagonal = _put(_put(diagonal, ends[:, :, 0], 0), ends[:, :, 1], -1)
    upper = _put(upper, product(turn[:, :, 0], upper[:, :, 0]), 0)
    upper = _put(upper, _times(upper[:, :, -1], turn[:, :, 1]), -1)
    return diagonal, upper


def _put(x: Array, station: Array, index: int) -> Array:
    axis = x.ndim - 2
    return jax.lax.dynamic_update_index_in_dim(x, station, index % x.shape[axis], axis)


def _times(a: Array, b: Array) -> Array:
    return product(jnp.swapaxes(a, 0, 1), b)
