"""Dead loads on the solid's outer face: forces that keep their direction and move with it."""

import jax.numpy as jnp

from suas_jax.mechanics.solid.element import quadratic
from suas_jax.mechanics.solid.layout import Layout
from suas_jax.numerics.array_types import StationVector
from suas_jax.skin.loads import LoadPoints


def load_vector(
    layout: Layout, points: LoadPoints, ends: tuple[tuple[bool, ...], tuple[bool, ...]]
) -> StationVector:
    """Nodal forces of the load points.

    Args:
        layout: numbers of elements.
        points: the loads.
        ends: which displacements of the two end stations may move.
    """
    shapes = jnp.stack(quadratic(2 * points.xi - 1))
    force = jnp.einsum("apl,cpl,epl->acel", shapes, points.force, points.select)
    u = layout.on_face(force, 2)
    return layout.scatter(u, jnp.zeros((3, *u.shape[2:])), layout.mask(ends))
