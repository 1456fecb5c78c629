"""Polynomials: quadrature that is exact for them, and functions by their values."""

from collections.abc import Sequence
from typing import Any, TypeVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

_Numbers = TypeVar("_Numbers", Array, np.ndarray)


def gauss_legendre(
    n: int, lower: float = 0.0, upper: float = 1.0
) -> tuple[Float[np.ndarray, " {n}"], Float[np.ndarray, " {n}"]]:
    """Points and weights that integrate polynomials up to degree 2n - 1 exactly.

    Returns points in ascending order and their weights, which sum to ``upper - lower``.
    """
    points, weights = np.polynomial.legendre.leggauss(n)
    half = (upper - lower) / 2
    return lower + half * (points + 1), half * weights


def lagrange_slopes(points: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n n"]:
    """Derivatives at points of the polynomial through values there [point, value].

    `points`: all different.
    """
    n = len(points)
    apart = points[:, None] - points + np.eye(n)
    weight = 1 / np.prod(apart, 1)  # barycentric
    slope = weight / weight[:, None] / apart
    return slope - np.diag(np.sum(slope, 1))  # those of a constant are zero


def lagrange_weights(points: Float[np.ndarray, " n"], x: float) -> Float[np.ndarray, " n"]:
    """Weights of values at points in the polynomial through them at another place.

    `points`: NaN or infinite weights where two are equal. `x`: the place.
    """
    others = [np.delete(points, k) for k in range(len(points))]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.array(
            [np.prod((x - o) / (p - o)) for p, o in zip(points, others, strict=True)]
        )


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


def polynomial(powers: Sequence[Array | float] | np.ndarray, t: _Numbers) -> _Numbers:
    """Value of a polynomial by Horner's scheme.

    `powers`: coefficients in ascending powers. `t`: where.
    """
    value: Any = powers[-1]
    for power in powers[-2::-1]:
        value = value * t + power
    return value


def with_derivatives(powers: Sequence[Array], t: Array) -> tuple[Array, Array, Array]:
    """Value, first and second derivative of a polynomial by Horner's scheme.

    `powers`: coefficients in ascending powers. `t`: where.
    """
    value, slope, half_bend = powers[-1], jnp.zeros_like(t), jnp.zeros_like(t)
    for power in powers[-2::-1]:
        half_bend = half_bend * t + slope
        slope = slope * t + value
        value = value * t + power
    return value, slope, 2 * half_bend


# Coefficients of the four cubic shape functions in ascending powers of xi, a row a power.
_HERMITE = np.array(
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [-3.0, -2.0, 3.0, -1.0], [2.0, 1.0, -2.0, 1.0]]
)


def hermite(xi: _Numbers, derivative: int = 0) -> _Numbers:
    """The cubic Hermite shape functions, or a derivative by xi, at points in [0, 1].

    A function on an element of length L is ``N_0 v_0 + L N_1 s_0 + N_2 v_1 + L N_3 s_1`` with
    the values v and the slopes s (per unit length) at its two stations: continuous with its
    first derivative, as the bending energy of a thin shell asks.

    `xi`: local coordinate, 0 at the left station and 1 at the right one. `derivative`: order of
    differentiation, 0 to 3.
    Returns values for left value, left slope, right value, right slope [4, *points].
    """
    powers = np.polynomial.polynomial.polyder(_HERMITE, derivative)
    powers = powers.reshape(*powers.shape, *[1] * xi.ndim)
    value = polynomial(powers, xi)
    return value if derivative < 3 else value + 0.0 * xi  # a constant has no shape
