"""Intermediate results that the compiler computes once.

XLA merges elementwise operations into the loops that use them and computes shared ones anew
in each: with dozens of users, time to compile and to run grow manifold. Optimisation barriers
are removed before that happens. A matrix product it neither looks through nor repeats.
"""

from collections.abc import Sequence

import jax.numpy as jnp
from jaxtyping import Array, Float


def staged(rows: Sequence[Float[Array, "*shape"]]) -> list[Float[Array, "*shape"]]:
    """The same arrays, computed before anything that uses them.

    `rows`: a few dozen arrays of the same shape, which are multiplied by the unit matrix; none
    may hold infinities.
    """
    stacked = jnp.stack(jnp.broadcast_arrays(*rows))
    flat = stacked.reshape(len(rows), -1)
    # A matrix that is a constant of the program would be multiplied out, row by row.
    product = jnp.eye(len(rows), dtype=flat.dtype) @ flat
    return list(product.reshape(stacked.shape))
