"""The deformed inner face as taxels see it: its distance from the wall along rays.

Rays are normals of the undeformed section; of a circle they come from its axis.
"""

import abc
from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from suas_jax.skin.geometry import SkinGeometry


class AbstractFace(eqx.Module):
    """An inner face, ready to be asked for gaps."""

    varies_along_axis: ClassVar[bool]  # whether the gap depends on the axial position

    def gaps(
        self, rays: Sequence[tuple[Array, Array]], geometry: SkinGeometry
    ) -> list[Float[Array, "taxel lane"]]:
        """Gaps along several rays for each taxel, ray after ray [m].

        Not all in one array: a reduction over them would cost the compiled program several
        times what the look-ups do.

        `rays`: angles [rad] and axial positions [m] of the taxels, a pair a ray. `geometry`:
        says where the wall is.
        """
        return [self.height(angle, axial) + geometry.gap(angle, axial) for angle, axial in rays]

    @abc.abstractmethod
    def height(
        self, angle: Float[Array, "ray #lane"], axial: Float[Array, "ray #lane"]
    ) -> Float[Array, "ray lane"]:
        """Height of the inner face over the undeformed one along rays [m].

        `angle`: of the rays [rad]. `axial`: their positions along the axis, from the middle
        [m].
        Returns the heights; NaN where a ray meets the face more than once.
        """
