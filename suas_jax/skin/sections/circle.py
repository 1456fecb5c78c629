"""An arc of a circle, for a membrane whose thickness varies along it."""

from collections.abc import Callable

from jaxtyping import Array, Float

from suas_jax.config.geometry import GeometrySpec
from suas_jax.numerics.array_types import Lanes
from suas_jax.skin.charted import AbstractArc
from suas_jax.skin.section import outward


class CircularArc(AbstractArc):
    """By the angle from the symmetry axis, which is the one of scenes."""

    radius: Lanes  # of the inner face [m]
    last: Lanes  # angle of the right clamp [rad]

    @classmethod
    def of(cls, spec: GeometrySpec, value: Callable[[str], Lanes]) -> "CircularArc":
        """See the base class."""
        del spec
        return cls(radius=value("inner_radius"), last=value("half_angle"))

    def position(self, parameter: Array, interval: Array) -> Float[Array, "2 *shape"]:
        """See the base class."""
        del interval
        return self.radius * outward(parameter)
