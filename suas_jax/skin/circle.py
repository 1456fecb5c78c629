"""A circle of one thickness, in closed forms; other sections need tables."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from suas_jax.numerics.array_types import Lanes
from suas_jax.skin.section import AbstractSection, outward


class Circle(AbstractSection):
    """A membrane of one thickness around an axis; its angle is the one of scenes."""

    inner_radius: Lanes  # of the inner face [m]
    mean_thickness: Lanes  # of the membrane [m]
    half_angle: Lanes  # from the symmetry axis to a clamped edge [rad]

    @property
    def size(self) -> Lanes:
        """Radius of the mid-line [m]."""
        return self.inner_radius + self.mean_thickness / 2

    def thickness(self, angle: Array) -> Array:
        """The same everywhere [m]."""
        del angle
        return self.mean_thickness

    def direction(self, angle: Array) -> Array:
        """The angle."""
        return angle

    inner_direction = direction

    def curvature(self, angle: Array) -> Array:
        """Inverse of the mid-line's radius [1/m]."""
        del angle
        return 1 / self.size

    def mid_line(self, angle: Array) -> Float[Array, "2 *shape"]:
        """Around the axis [m]."""
        return self.size * outward(angle)

    def inner_face(self, angle: Array) -> Float[Array, "2 *shape"]:
        """Around the axis [m]."""
        return self.inner_radius * outward(angle)

    def given_angle(self, angle: Array) -> Array:
        """The angle."""
        return angle

    from_given_angle = given_angle

    def arc(self, angle: Array) -> Array:
        """Of the inner face [m]."""
        return self.inner_radius * angle

    def from_arc(self, arc: Array) -> Array:
        """See the base class."""
        return arc / self.inner_radius

    def foot(self, position: Float[Array, "2 *shape"], near: Array) -> tuple[Array, Array]:
        """Polar coordinates; see the base class."""
        del near
        x, y = position[0], position[1]
        return jnp.arctan2(x, y), jnp.sqrt(x**2 + y**2) - self.inner_radius

    def height_frame(
        self, position: Float[Array, "2 *shape"], near: Array
    ) -> tuple[Array, Float[Array, "2 *shape"], Array]:
        """Along the radius; see the base class."""
        del near
        place = position[:2]
        radius = jnp.sqrt(jnp.sum(place**2, 0))
        return radius - self.inner_radius, place / radius, 1 / radius

    def may_lie_below(
        self, position: Float[Array, "2 *shape"], near: Array, depth: Lanes
    ) -> Bool[Array, "*shape"]:
        """Whether they do; see the base class."""
        del near
        x, y = position[0], position[1]
        return x**2 + y**2 < (self.inner_radius - depth) ** 2

    def moved(self, angle: Array, length: Array, height: Array) -> Array:
        """See the base class."""
        return angle + length / (self.size + height)
