"""Gauss-Legendre quadrature."""

import numpy as np
from jaxtyping import Float


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
