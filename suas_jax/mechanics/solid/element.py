"""The Q9/P1 element: biquadratic displacement, linear discontinuous pressure.

Local coordinates (xi, eta) run over [-1, 1]^2, xi along the arc and eta outwards. Nodes are
ordered left, right, middle, centre: those shared with neighbouring elements along the arc
first, those inside the column of elements next, the node inside the element last. The pair
satisfies the inf-sup condition; piecewise constant pressure would lock.
"""

from typing import NamedTuple, TypeVar

import numpy as np
from jaxtyping import Array, Float

from suas_jax.numerics.polynomials import gauss_legendre

Values = TypeVar("Values", np.ndarray, Array)

# (position along the arc, position through the thickness) of each node, 0 to 2.
NODES = ((0, 0), (0, 1), (0, 2), (2, 0), (2, 1), (2, 2), (1, 0), (1, 2), (1, 1))
PRESSURES = 3  # modes 1, xi, eta


def quadratic(x: Values, derivative: int = 0) -> list[Values]:
    """Lagrange polynomials for nodes at -1, 0 and 1, or their derivatives.

    `x`: local coordinates. `derivative`: order of differentiation, 0 or 1.
    """
    if derivative:
        return [x - 0.5, -2 * x, x + 0.5]
    return [x * (x - 1) / 2, 1 - x * x, x * (x + 1) / 2]


def located(ends: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Elements in which places lie, and their local coordinates there."""
    element = np.clip(np.searchsorted(ends, x, side="right") - 1, 0, len(ends) - 2)
    start, end = ends[element], ends[element + 1]
    return element, 2 * (x - start) / (end - start) - 1


def node_weights(element: np.ndarray, xi: np.ndarray, elements: int) -> np.ndarray:
    """Weights of the nodes in the values at places [place, node]."""
    weights = np.zeros((len(xi), 2 * elements + 1))
    rows = np.arange(len(xi))
    for k, weight in enumerate(quadratic(xi)):
        weights[rows, 2 * element + k] += weight
    return weights


def gradients(
    xi: Float[np.ndarray, " point"], eta: Float[np.ndarray, " point"]
) -> Float[np.ndarray, "point 2 9"]:
    """Derivatives of the shape functions by (xi, eta)."""
    n, m = quadratic(xi), quadratic(eta)
    dn, dm = quadratic(xi, 1), quadratic(eta, 1)
    along = np.stack([dn[a] * m[b] for a, b in NODES], -1)
    across = np.stack([n[a] * dm[b] for a, b in NODES], -1)
    return np.stack([along, across], 1)


def modes(
    xi: Float[np.ndarray, " point"], eta: Float[np.ndarray, " point"]
) -> Float[np.ndarray, "point 3"]:
    """Pressure modes at points."""
    return np.stack([np.ones_like(xi), xi, eta], -1)


class Tables(NamedTuple):
    """Constants of one element at its 3 x 3 quadrature points."""

    xi: np.ndarray  # [gauss]
    weights: np.ndarray  # [gauss]
    gradient: np.ndarray  # [gauss, 2, node]
    modes: np.ndarray  # [gauss, mode]
    force: np.ndarray  # [node, gauss * 2]
    coupling: np.ndarray  # [node * mode, gauss * 2]
    stiffness: np.ndarray  # [node * node, gauss * 2 * 2]


def _tables() -> Tables:
    points, weights = gauss_legendre(3, -1.0, 1.0)
    xi, eta = (x.ravel() for x in np.meshgrid(points, points, indexing="ij"))
    d, psi = gradients(xi, eta), modes(xi, eta)
    return Tables(
        xi,
        np.outer(weights, weights).ravel(),
        d,
        psi,
        np.einsum("qdn->nqd", d).reshape(9, -1),
        np.einsum("qdn,qa->naqd", d, psi).reshape(27, -1),
        np.einsum("qdn,qfm->nmqdf", d, d).reshape(81, -1),
    )


TABLES = _tables()
