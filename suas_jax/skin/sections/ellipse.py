"""An arc of an ellipse."""

from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array, Float

from suas_jax.config.geometry import GeometrySpec
from suas_jax.numerics.array_types import Lanes
from suas_jax.skin.charted import AbstractArc


class Ellipse(AbstractArc):
    """x = a sin t, y = b cos t; the angle of scenes is t."""

    semi_axes: tuple[Lanes, Lanes]  # a and b [m]
    last: Lanes  # t at the right clamp [rad]

    @classmethod
    def of(cls, spec: GeometrySpec, value: Callable[[str], Lanes]) -> "Ellipse":
        """See the base class."""
        del spec
        axes = value("inner_semi_axes.0"), value("inner_semi_axes.1")
        return cls(semi_axes=axes, last=value("half_angle"))

    def position(self, parameter: Array, interval: Array) -> Float[Array, "2 *shape"]:
        """See the base class."""
        del interval
        a, b = self.semi_axes
        return jnp.stack([a * jnp.sin(parameter), b * jnp.cos(parameter)])
