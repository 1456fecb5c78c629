"""Polynomials through samples at any places, in powers of the coordinate."""

from collections.abc import Sequence

import jax.numpy as jnp
from jaxtyping import Array, Float


def power_coefficients(
    t: Float[Array, "sample *shape"], values: Float[Array, "sample *shape"]
) -> Float[Array, "power *shape"]:
    """Coefficients in ascending powers of the polynomial through samples.

    Newton's divided differences, then Horner's scheme on polynomials.

    `t`: where the samples are, all different. `values`: of the function there.
    """
    # Whole columns at a time: one by one, XLA computes each again for all that is made of it.
    n = t.shape[0]
    newton, column = [values[0]], values
    for order in range(1, n):
        column = (column[1:] - column[:-1]) / (t[order:] - t[:-order])
        newton.append(column[0])
    powers = newton[-1][None]
    for i in range(n - 2, -1, -1):
        powers = jnp.concatenate([newton[i][None], powers]) - t[i] * jnp.concatenate(
            [powers, jnp.zeros_like(powers[:1])]
        )
    return powers


def polynomial(powers: Sequence[Array], t: Array) -> Array:
    """Value of a polynomial by Horner's scheme.

    `powers`: coefficients in ascending powers. `t`: where.
    """
    value = powers[-1]
    for power in powers[-2::-1]:
        value = value * t + power
    return value
