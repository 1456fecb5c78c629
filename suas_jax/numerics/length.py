"""Lengths of vectors whose derivative is defined everywhere."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def length(vectors: Float[Array, "component *lanes"]) -> Float[Array, "*lanes"]:
    """Root of the sum of squares, with derivative zero where the vector is zero.

    A state at rest has such vectors, and any subgradient is right there; that of a square
    root is NaN, as is that of `jnp.hypot` under JAX 0.12.
    """
    square = jnp.sum(vectors**2, 0)
    none = square == 0
    return jnp.where(none, 0.0, jnp.sqrt(jnp.where(none, 1.0, square)))
