"""A solid's state on another mesh: what Newton's method starts from after a refinement."""

import numpy as np
from jaxtyping import Float

from suas_jax.mechanics.solid.element import PRESSURES, located, node_weights
from suas_jax.mechanics.solid.layout import Layout, with_midpoints

Mesh = tuple[Float[np.ndarray, " station"], int]
"""Angles of the stations [rad], and layers."""


def carried(q: Float[np.ndarray, "row station 1"], origin: Mesh, target: Mesh) -> np.ndarray:
    """Interpolate displacements and pressures, each by its own shape functions.

    Args:
        q: unknowns of a mesh that covers the other one.
        origin: that mesh.
        target: the mesh wanted.
    """
    old, new = (Layout(len(angles) - 1, layers) for angles, layers in (origin, target))
    along = located(origin[0], with_midpoints(target[0]))
    across = located(old.layer_ends, new.heights)
    stations, inside = q[: old.dof, :, 0], q[old.dof :, :-1, 0]
    lines = np.empty((old.nodes, 2, 2 * old.elements + 1))
    lines[:, :, ::2] = stations.reshape(old.nodes, 2, -1)
    lines[:, :, 1::2] = inside[: old.dof].reshape(old.nodes, 2, -1)
    by_node = node_weights(*across, old.layers), node_weights(*along, old.elements)
    moved = np.einsum("yb,bca,xa->ycx", by_node[0], lines, by_node[1], optimize=True)
    between = moved[:, :, 1::2].reshape(new.dof, -1)
    pressures = inside[old.dof :].reshape(PRESSURES, old.layers, old.elements)
    centres = [(element[1::2], xi[1::2]) for element, xi in (across, along)]
    (layer, eta), (element, xi) = centres
    mean, by_xi, by_eta = pressures[:, layer[:, None], element]
    mean = mean + by_xi * xi + by_eta * eta[:, None]
    lengths = [np.diff(angles) for angles, _ in (origin, target)]
    heights = [np.diff(layout.layer_ends) for layout in (old, new)]
    ratio = (heights[1] / heights[0][layer])[:, None]
    slopes = by_xi * lengths[1] / lengths[0][element], by_eta * ratio
    below = np.concatenate([between, np.stack([mean, *slopes]).reshape(-1, new.elements)])
    above = moved[:, :, ::2].reshape(new.dof, -1)
    return np.concatenate([above, np.pad(below, [(0, 0), (0, 1)])])[:, :, None]
