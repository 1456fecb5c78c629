"""Functions of one number that are analytic where their textbook forms are not.

cosh √z, for one, is an entire function of z, yet computed through the root it has no
derivative at zero. The forms here have exact derivatives of every order at zero, and
full relative accuracy near it.
"""

import math

import jax.numpy as jnp
from jaxtyping import Array, Float

from suas_jax.numerics.polynomials import polynomial

# Four halvings of η bring any stretch below 20 to s < 0.036, where eleven terms suffice;
# four of x bring |x| < 24 below 1.5, where ten terms of the cosine do.
_HALVINGS = 4
_ASINH_SERIES = [
    (-1) ** k * 2.0 ** (2 * k + 1) * math.factorial(k) ** 2 / math.factorial(2 * k + 2)
    for k in range(11)
]
_COSH_SERIES = [1.0 / math.factorial(2 * k + 2) for k in range(10)]
_EXP_SERIES = [1.0 / math.factorial(k + 2) for k in range(20)]


def asinh_sqrt_squared(s: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return (asinh √s)², analytic for s > −1.

    With s = sinh² η, halving η by sinh²(η/2) = s / (2 (1 + √(1 + s))) shrinks the
    argument until a short series holds.

    `s`: any shape; to rounding error up to s = 100, to 1e-13 up to s = 2500.
    Returns η², of the shape of s.
    """
    for _ in range(_HALVINGS):
        s = 0.5 * s / (1.0 + jnp.sqrt(1.0 + s))
    return 4.0**_HALVINGS * s * polynomial(_ASINH_SERIES, s)


def cosh_sqrt_minus_1(z: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return cosh √z − 1, entire in z.

    Halved like its companion; doubled by cosh 2x − 1 = 2c (c + 2) with c = cosh x − 1.

    `z`: any shape; to rounding error up to √z = 24.
    """
    z = z / 4.0**_HALVINGS
    c = z * polynomial(_COSH_SERIES, z)
    for _ in range(_HALVINGS):
        c = 2.0 * c * (c + 2.0)
    return c


def exp_minus_1_minus_x(x: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return exp(x) − 1 − x without cancellation near zero, any shape."""
    small = jnp.abs(x) < 1.0
    # The series must not overflow where it is not wanted: 0 times infinity would spoil
    # the derivative.
    bounded = jnp.where(small, x, 0.0)
    series = bounded * bounded * polynomial(_EXP_SERIES, bounded)
    return jnp.where(small, series, jnp.expm1(x) - x)
