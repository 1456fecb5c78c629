"""The deformed inner face as taxels see it: its distance from the wall along rays."""

import abc
from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from suas_jax.numerics.array_types import Lanes


class AbstractFace(eqx.Module):
    """An inner face, ready to be asked for gaps.

    Attributes:
        varies_along_axis: whether the gap depends on the axial position.
    """

    varies_along_axis: ClassVar[bool]

    def gaps(
        self, rays: Sequence[tuple[Array, Array]], wall_radius: Lanes
    ) -> list[Float[Array, "taxel lane"]]:
        """Gaps along several rays for each taxel, ray after ray [m].

        Not all in one array: a reduction over them would cost the compiled program several
        times what the look-ups do.

        Args:
            rays: polar angles [rad] and axial positions [m] of the taxels, a pair a ray.
            wall_radius: [m].
        """
        return [self.gap(angle, axial, wall_radius) for angle, axial in rays]

    @abc.abstractmethod
    def gap(
        self,
        angle: Float[Array, "ray #lane"],
        axial: Float[Array, "ray #lane"],
        wall_radius: Lanes,
    ) -> Float[Array, "ray lane"]:
        """Gap between inner face and wall along rays from the axis [m].

        Args:
            angle: polar angles of the rays [rad].
            axial: their positions along the axis, from the middle [m].
            wall_radius: [m].

        Returns:
            The gaps; NaN where a ray meets the face more than once.
        """
