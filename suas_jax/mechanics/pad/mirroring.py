"""Mirror planes of a symmetric pad: across the arc at the crown, across the axis at mid-length.

The modelled part lies at negative angles and axial positions. An image's displacement across
the plane has the other sign: the tangential one (x) at the crown, the axial one (z) at
mid-length.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.numerics.array_types import Lanes
from suas_jax.skin.pad_loads import PadLoadPoints

_SIGNS = np.array([[-1.0, 1.0, 1.0], [1.0, 1.0, -1.0]])  # [plane, direction]


def points_on_both_sides(points: PadLoadPoints, plane: int) -> PadLoadPoints:
    """Load points and their images in a plane, 0 at the crown, 1 at mid-length."""
    angle, axial = points.angle, points.axial
    images = (-angle, axial) if plane == 0 else (angle, -axial)
    force = jnp.concatenate([points.force, _SIGNS[plane][:, None, None] * points.force], 1)
    return PadLoadPoints(
        jnp.concatenate([angle, images[0]]), jnp.concatenate([axial, images[1]]), force
    )


def breaks_on_both_sides(breaks: Float[Array, "breakpoint #lane"]) -> Array:
    """Breakpoints up to a plane, and beyond it."""
    return jnp.concatenate([breaks, -breaks[-2::-1]])


def values_on_both_sides(
    values: Float[Array, "arc axial width lane"], plane: int, vectors: int
) -> Float[Array, "arc axial width lane"]:
    """Control values up to a plane, and beyond it: those of vectors, then of scalars."""
    part = values[-2::-1] if plane == 0 else values[:, -2::-1]
    signs = np.ones((values.shape[2], 1))
    signs[: 3 * vectors, 0] = np.tile(_SIGNS[plane], vectors)
    return jnp.concatenate([values, part * signs], plane)


def image_in_part(
    planes: tuple[bool, bool], angle: Lanes, axial: Lanes
) -> tuple[Float[Array, "3 lane"], Lanes, Lanes]:
    """The place of the modelled part that moves as a place of the whole pad does.

    Returns the signs of the displacement's components; angle [rad] and axial position [m].
    """
    sign = jnp.ones((3, *angle.shape))
    if planes[0]:
        sign = sign.at[0].set(jnp.where(angle > 0, -1.0, 1.0))
        angle = -jnp.abs(angle)
    if planes[1]:
        sign = sign.at[2].set(jnp.where(axial > 0, -1.0, 1.0))
        axial = -jnp.abs(axial)
    return sign, angle, axial
