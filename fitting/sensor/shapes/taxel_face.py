"""A pad's deformed inner face as its taxels see it: along their own rays alone."""

from collections.abc import Sequence
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from suas_jax.mechanics.face import AbstractFace
from suas_jax.sensing.electrodes import Electrodes
from suas_jax.sensing.taxels import DISC
from suas_jax.skin.geometry import SkinGeometry


class TaxelFace(AbstractFace):
    """A deformed inner face that is known along the taxels' own rays alone."""

    varies_along_axis: ClassVar[bool] = True
    # over the undeformed face, ray by ray [ray, taxel, state] [m]
    heights: Float[Array, "ray taxel state"]

    def gaps(
        self, rays: Sequence[tuple[Array, Array]], geometry: SkinGeometry
    ) -> list[Float[Array, "taxel state"]]:
        """Gaps along the rays that the heights are of; see the base class."""
        assert len(rays) == len(self.heights)
        pairs = zip(self.heights, rays, strict=True)
        return [height + geometry.gap(angle, axial) for height, (angle, axial) in pairs]

    def height(self, angle: Array, axial: Array) -> Array:
        """See the base class.

        Raises ValueError: always; heights are known along the taxels' own rays alone.
        """
        raise ValueError("a calibration knows the pad along its taxels' own rays alone")


def taxel_face(face: AbstractFace, electrodes: Electrodes, geometry: SkinGeometry) -> TaxelFace:
    """What of a pad's inner face the taxels see."""
    rays = electrodes.taxels.rays(DISC, geometry)
    pairs = zip(face.gaps(rays, geometry), rays, strict=True)
    return TaxelFace(jnp.stack([gap - geometry.gap(*ray) for gap, ray in pairs]))
