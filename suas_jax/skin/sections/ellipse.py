"""An arc of an ellipse."""

from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array, Float

from suas_jax.config.geometry import GeometrySpec
from suas_jax.numerics.array_types import Lanes
from suas_jax.skin.charted import AbstractCurve


class Ellipse(AbstractCurve):
    """x = a sin t, y = b cos t; the angle of scenes is t."""

    semi_axes: tuple[Lanes, Lanes]  # a and b [m]
    last: Lanes  # t at the right clamp [rad]

    @classmethod
    def of(cls, spec: GeometrySpec, value: Callable[[str], Lanes]) -> "Ellipse":
        """See the base class."""
        del spec
        axes = value("inner_semi_axes.0"), value("inner_semi_axes.1")
        return cls(axes, value("half_angle"))

    @property
    def symmetric(self) -> bool:
        """See the base class."""
        return True

    def edges(self) -> Float[Array, "edge lane"]:
        """The clamps [rad]."""
        return jnp.stack([-self.last, self.last])

    def position(self, parameter: Array, interval: Array) -> Float[Array, "2 *shape"]:
        """See the base class."""
        del interval
        a, b = self.semi_axes
        return jnp.stack([a * jnp.sin(parameter), b * jnp.cos(parameter)])

    def given_angle(self, parameter: Array, direction: Array) -> Array:
        """T."""
        del direction
        return parameter
