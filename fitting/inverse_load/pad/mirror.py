"""Mirror images of a pad's taxels and places: only a quarter of the places is solved.

What the other quarters' contacts do to a taxel is what this quarter's do to its mirror image.
"""

from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from fitting.arrays import Floats, Rows
from suas_jax.scene.skin import Skin
from suas_jax.sensing.taxels import Taxels


def mirror_images(skin: Skin) -> tuple[Skin, Rows]:
    """The pad with all distinct mirror images of its taxels.

    Returns the pad, and which of its taxels is the image of each own one: as it is, mirrored in
    the crown's plane, in the middle's and in both [image, taxel].
    """
    e = skin.electrodes
    taxels = len(e.taxels.angle)

    def column(x: Any) -> Floats:
        return np.broadcast_to(np.asarray(x, float).reshape(-1), (taxels,))

    own = [column(x) for x in (e.permittivity, e.stray, e.layers, e.lsb, e.height)]
    rows = []
    for first, second in ((1, 1), (-1, 1), (1, -1), (-1, -1)):
        place = (first * column(e.taxels.angle), second * column(e.taxels.axial))
        rows.append(np.stack([*place, column(e.taxels.diameter), *own], 1))
    every = np.concatenate(rows)
    scale = np.maximum(np.abs(every).max(0), 1e-300)
    _, first_of, inverse = np.unique(
        np.round(every / scale, 9) + 0.0, axis=0, return_index=True, return_inverse=True
    )
    chosen = [jnp.asarray(x[:, None]) for x in every[first_of].T]
    count = len(first_of)
    angle, axial, diameter = chosen[:3]
    numbers = tuple(range(1, count + 1))
    taxel = Taxels(angle, axial, diameter, (0,) * count, numbers)
    electrodes = replace(
        e,
        taxels=taxel,
        permittivity=chosen[3],
        stray=chosen[4],
        layers=chosen[5],
        lsb=chosen[6],
        height=chosen[7],
    )
    return replace(skin, electrodes=electrodes), inverse.reshape(4, taxels)


def mirrored(x: NDArray) -> NDArray:
    """Values of a quarter [angle, axial, ...] on the whole pad, the same on all quarters."""
    x = np.concatenate([x[:, :0:-1], x], 1)
    return np.concatenate([x[:0:-1], x], 0)
