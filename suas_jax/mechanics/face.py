"""The deformed inner face as taxels see it: its distance from the wall along rays."""

import abc
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
