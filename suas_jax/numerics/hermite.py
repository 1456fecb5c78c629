"""Cubic Hermite shape functions on the unit interval.

A function on an element of length L is ``N_0 v_0 + L N_1 s_0 + N_2 v_1 + L N_3 s_1`` with
the values v and the slopes s (per unit length) at its two stations: continuous with its
first derivative, as the bending energy of a thin shell asks.
"""

import numpy as np
from jaxtyping import Array, Float

# Coefficients of the four shape functions in ascending powers of xi.
_HERMITE = np.array(
    [[1.0, 0.0, -3.0, 2.0], [0.0, 1.0, -2.0, 1.0], [0.0, 0.0, 3.0, -2.0], [0.0, 0.0, -1.0, 1.0]]
)


def hermite(
    xi: Float[Array | np.ndarray, "*points"], derivative: int = 0
) -> list[Float[Array | np.ndarray, "*points"]]:
    """The four shape functions, or a derivative with respect to xi, at points in [0, 1].

    `xi`: local coordinate, 0 at the left station and 1 at the right one. `derivative`: order of
    differentiation, 0 to 3.
    Returns values for left value, left slope, right value, right slope; each shaped like xi.
    """
    shapes = []
    for row in _HERMITE:
        polynomial = np.polynomial.Polynomial(row)
        for _ in range(derivative):
            polynomial = polynomial.deriv()
        value = 0.0 * xi
        for c in polynomial.coef[::-1]:
            value = value * xi + float(c)
        shapes.append(value)
    return shapes
