"""The undeformed section of the membrane: one object for its curve and what lies along it.

x points right and y to the crown. Every place along the section has one coordinate, the
*angle*: arc length of the membrane's mid-line from its middle over the line's `size`. On a
circle that is the angle from the symmetry axis, positive towards +x; elsewhere it runs over a
quarter turn to either side as well.

The undeformed mid-line has the unit tangent t and the outward normal n::

    t = (cos a, -sin a),   n = (sin a, cos a),   da/ds = k

with the direction a(angle) and the curvature k(angle); outer face, inner face and wall lie
along n, so that lengths along them are 1 + k z times those of the mid-line.
"""

import abc
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from suas_jax.numerics.array_types import Lanes

INVERSE_STEPS = 5
"""Newton steps of an inverse: smooth functions, from a start good to a per cent."""


def outward(direction: Float[Array, "*shape"]) -> Float[Array, "2 *shape"]:
    """Unit vector at an angle from the y axis, clockwise: the normal of that direction."""
    return jnp.stack([jnp.sin(direction), jnp.cos(direction)])


def tangent(direction: Float[Array, "*shape"]) -> Float[Array, "2 *shape"]:
    """Unit vector along the undeformed section, in the direction of growing angle."""
    return jnp.stack([jnp.cos(direction), -jnp.sin(direction)])


class Frame(NamedTuple):
    """The undeformed mid-line at angles."""

    angle: Array  # where [rad]
    tangent: Float[Array, "2 *shape"]  # unit vector along it
    normal: Float[Array, "2 *shape"]  # outward unit vector
    curvature: Array  # of the mid-line [1/m]
    thickness: Array  # of the membrane [m]


class AbstractSection(eqx.Module):
    """The undeformed section of a membrane; the kinds are files of `suas_jax.skin.sections`.

    Every method takes angles [*shape, lane] as the module defines them.
    """

    mean_thickness: eqx.AbstractVar[Lanes]  # of the membrane [m]
    # angle of the right clamped edge [rad]; the left one has its negative
    half_angle: eqx.AbstractVar[Lanes]

    @property
    def symmetric(self) -> bool:
        """Whether the left half is the mirror image of the right one."""
        return True

    @property
    @abc.abstractmethod
    def size(self) -> Lanes:
        """Length of the mid-line per angle [m]; of a circle its radius."""

    @abc.abstractmethod
    def thickness(self, angle: Array) -> Array:
        """Thickness of the membrane [m]."""

    @abc.abstractmethod
    def direction(self, angle: Array) -> Array:
        """Angle of the outward normal from the y axis, clockwise [rad]."""

    @abc.abstractmethod
    def inner_direction(self, angle: Array) -> Array:
        """The same of the inner face, which differs where the thickness varies [rad]."""

    @abc.abstractmethod
    def curvature(self, angle: Array) -> Array:
        """Curvature of the mid-line, positive where it bulges outwards [1/m]."""

    @abc.abstractmethod
    def mid_line(self, angle: Array) -> Float[Array, "2 *shape"]:
        """Position of the mid-line [m]."""

    @abc.abstractmethod
    def inner_face(self, angle: Array) -> Float[Array, "2 *shape"]:
        """Position of the inner face [m]."""

    @abc.abstractmethod
    def given_angle(self, angle: Array) -> Array:
        """The angle that a scene calls so, from this module's [rad]."""

    @abc.abstractmethod
    def from_given_angle(self, angle: Array) -> Array:
        """Inverse of `given_angle`."""

    @abc.abstractmethod
    def arc(self, angle: Array) -> Array:
        """Arc length of the inner face from its middle [m]."""

    @abc.abstractmethod
    def from_arc(self, arc: Array) -> Array:
        """Inverse of `arc`."""

    def fraction(self, angle: Array) -> Array:
        """Share of the inner face's arc that lies left of an angle."""
        return 0.5 + self.arc(angle) / (2 * self.arc(self.half_angle))

    @property
    def breakpoints(self) -> list[Lanes]:
        """Angles inside the section where its curvature jumps."""
        return []

    def frame(self, angle: Array) -> Frame:
        """Directions, curvature and thickness at angles."""
        direction = self.direction(angle)
        t, n = tangent(direction), outward(direction)

        def over(x: Array) -> Array:
            """With as many axes as the angles."""
            return jnp.reshape(x, (1,) * (angle.ndim - x.ndim) + x.shape)

        curvature, thickness = over(self.curvature(angle)), over(self.thickness(angle))
        return Frame(angle, t, n, curvature, thickness)

    def inner_normal(self, angle: Array) -> Float[Array, "2 *shape"]:
        """Outward unit normal of the undeformed inner face."""
        return outward(self.inner_direction(angle))

    @abc.abstractmethod
    def foot(self, position: Float[Array, "2 *shape"], near: Array) -> tuple[Array, Array]:
        """Angle of the normal through a place, and the height over the inner face there [m].

        `position`: x and y first, coordinates along the axis don't matter. `near`: angle to
        start from.
        """

    @abc.abstractmethod
    def height_frame(
        self, position: Float[Array, "2 *shape"], near: Array
    ) -> tuple[Array, Float[Array, "2 *shape"], Array]:
        """The height by `foot`, the normal there, and the curvature of the parallel curve.

        The curve runs through the place, beside the inner face [m, -, 1/m].
        """

    @abc.abstractmethod
    def may_lie_below(
        self, position: Float[Array, "2 *shape"], near: Array, depth: Lanes
    ) -> Bool[Array, "*shape"]:
        """Whether places may lie a depth [m] below the inner face; surely not where False."""

    def moved(self, angle: Array, length: Array, height: Array) -> Array:
        """The angle a length further along a line beside the mid-line.

        The line is as much longer than the mid-line as the normal turns. Curvatures jump;
        Newton's method takes that where a quadrature would not.

        `angle`: where to start. `length`: signed, along the line [m]. `height`: of the line
        over the mid-line [m].
        """
        start = self.direction(angle)

        def step(end: Array, _: None) -> tuple[Array, None]:
            along = self.size * (end - angle) + height * (self.direction(end) - start)
            rate = self.size * (1 + self.curvature(end) * height)
            return end + (length - along) / rate, None

        first = angle + length / self.size + jnp.zeros_like(start)
        return jax.lax.scan(step, first, None, length=INVERSE_STEPS)[0]
