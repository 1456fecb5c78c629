"""Which of some values is the largest, whatever their rounding."""

import jax.numpy as jnp
from jaxtyping import Array, Int

_ROUNDING = 1e-10  # share of the largest by which equal values may differ


def first_largest(values: Array) -> Int[Array, "..."]:
    """Index along the first axis of the largest value, of equal ones the first.

    A symmetric state has two equal extremes; rounding must not say which of them is reported.
    Not a number counts as the largest.
    """
    top = jnp.max(values, 0)
    equal = jnp.isnan(values) | (values >= top - _ROUNDING * jnp.abs(top))
    return jnp.argmax(equal, 0)
