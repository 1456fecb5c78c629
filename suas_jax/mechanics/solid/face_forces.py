"""What acts on the solid's faces: the oil's pressure on the inner one, dead loads on the outer.

The inner face is a chain of quadratic edges, so the area under it is a quadratic form of its
nodes' positions. Its first derivative is the load of a unit of pressure, the second one how
that load follows the face.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.mechanics.solid.element import NODES, quadratic
from suas_jax.mechanics.solid.layout import FaceValues, Layout
from suas_jax.numerics.array_types import Lanes, StationVector
from suas_jax.numerics.quadrature import gauss_legendre
from suas_jax.skin.loads import LoadPoints


def _edge_area() -> Float[np.ndarray, "3 3"]:
    """Matrix A with x^T A y = 1/2 integral of (y dx - x dy) along a quadratic edge."""
    x, w = gauss_legendre(3, -1.0, 1.0)
    n, d = np.stack(quadratic(x)), np.stack(quadratic(x, 1))
    product = np.einsum("g,ag,bg->ab", w, d, n)
    return (product - product.T) / 2


_EDGE_AREA = _edge_area()  # nodes in the order left, middle, right


def enclosed_volume(at_rest: FaceValues, moved: FaceValues) -> tuple[Lanes, FaceValues]:
    """Enclosed volume less its value at rest, per width, and its gradient [m^2, m].

    `at_rest`: positions of the inner face's nodes [m]. `moved`: their displacements [m].
    """

    def turned(x: Array) -> Array:
        along = jnp.einsum("ab,bel->ael", _EDGE_AREA, x[:, 1])
        upward = jnp.einsum("ba,bel->ael", _EDGE_AREA, x[:, 0])
        return jnp.stack([along, upward], 1)

    rest, more = turned(at_rest), turned(moved)
    return jnp.sum(moved * (rest + more / 2), (0, 1, 2)), rest + more


def follower(layers: int) -> Float[np.ndarray, "9 9 3 layer 1 1"]:
    """Second derivative of the enclosed volume: the innermost layer's alone."""
    matrix = np.zeros((9, 9, 3, layers, 1, 1))
    for a in range(3):
        for b in range(3):
            matrix[NODES.index((a, 0)), NODES.index((b, 0)), 2, 0] = _EDGE_AREA[a, b]
    return matrix


def load_vector(
    layout: Layout, points: LoadPoints, ends: tuple[tuple[bool, ...], tuple[bool, ...]]
) -> StationVector:
    """Nodal forces of the load points.

    `layout`: numbers of elements. `points`: the loads. `ends`: which displacements of the two
    end stations may move.
    """
    shapes = jnp.stack(quadratic(2 * points.xi - 1))
    force = jnp.einsum("apl,cpl,epl->acel", shapes, points.force, points.select)
    u = layout.on_face(force, 2)
    return layout.scatter(u, jnp.zeros((3, *u.shape[2:])), layout.mask(ends))
