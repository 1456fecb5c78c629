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
    n = t.shape[0]
    table = list(values)
    for order in range(1, n):
        for i in range(n - 1, order - 1, -1):
            table[i] = (table[i] - table[i - 1]) / (t[i] - t[i - order])
    powers = [table[-1]]
    for i in range(n - 2, -1, -1):
        shifted = [table[i] - t[i] * powers[0]]
        shifted += [powers[k - 1] - t[i] * powers[k] for k in range(1, len(powers))]
        powers = [*shifted, powers[-1]]
    return jnp.stack(powers)


def polynomial(powers: Sequence[Array], t: Array) -> Array:
    """Value of a polynomial by Horner's scheme.

    `powers`: coefficients in ascending powers. `t`: where.
    """
    value = powers[-1]
    for power in powers[-2::-1]:
        value = value * t + power
    return value
