"""Gauss-Legendre quadrature."""

import numpy as np
from jaxtyping import Float


def gauss_legendre(
    n: int, lower: float = 0.0, upper: float = 1.0
) -> tuple[Float[np.ndarray, " {n}"], Float[np.ndarray, " {n}"]]:
    """Points and weights that integrate polynomials up to degree 2n - 1 exactly.

    Args:
        n: number of points.
        lower: lower end of the interval.
        upper: upper end of the interval.

    Returns:
        Points in ascending order and their weights, which sum to ``upper - lower``.
    """
    points, weights = np.polynomial.legendre.leggauss(n)
    half = (upper - lower) / 2
    return lower + half * (points + 1), half * weights
