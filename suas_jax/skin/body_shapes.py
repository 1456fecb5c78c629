"""Surfaces of rigid bodies, each as a signed distance in the frame of its tip."""

import abc
import functools
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from suas_jax.config import BodyLoadSpec
from suas_jax.numerics.array_types import Lanes

_STRAIGHT = 0.25  # of how narrow it is, down to which the inside of a soft body is its own


class AbstractShape(eqx.Module):
    """A rigid surface; in its frame its tip is the origin, the last axis points into it."""

    @abc.abstractmethod
    def distance(self, place: Float[Array, "component *point"]) -> Float[Array, "*point"]:
        """Distance of places from the surface, negative inside it [m]."""

    @abc.abstractmethod
    def height(self, across: Float[Array, "component *point"]) -> Float[Array, "*point"]:
        """Height of the surface over its tip [m]; infinite beside the body.

        `across`: coordinates across the approach.
        """

    def straight_distance(
        self, place: Float[Array, "component *point"]
    ) -> Float[Array, "*point"]:
        """The distance near the tip, deep inside a straight continuation of it [m].

        What a soft law lets so deep into a small body that another side is as near is pushed
        back the way it came.
        """
        if self.narrow is None:
            return self.distance(place)
        deepest = _STRAIGHT * self.narrow
        low = jnp.minimum(place[-1], deepest)

        def at(out: Array) -> Array:
            return self.distance(place.at[-1].set(out))

        value, slope = jax.jvp(at, (low,), (jnp.ones_like(low),))
        return value + slope * (place[-1] - low)

    def is_beyond(self, place: Float[Array, "component *point"]) -> Bool[Array, "*point"]:
        """Whether places lie so deep in the tip, or behind it, that another side is near."""
        if self.narrow is None:
            return jnp.zeros(jnp.shape(place[-1]), bool)
        deepest = _STRAIGHT * self.narrow
        return (place[-1] > deepest) & (self.height(place[:-1]) < deepest)

    @property
    def centre(self) -> Lanes | float:
        """Height over the tip of the point that moments are taken about [m]."""
        return 0.0

    @property
    def curvature(self) -> Lanes | float:
        """Of the surface at its tip [1/m]."""
        return 0.0

    @property
    def narrow(self) -> Lanes | None:
        """Depth at which another side is as near as the tip [m]; None for an endless plane."""
        return None


class AbstractRound(AbstractShape):
    """A surface with a round tip."""

    radius: eqx.AbstractVar[Lanes]  # of the tip [m]

    @property
    def centre(self) -> Lanes:
        """The middle of the tip."""
        return self.radius

    @property
    def curvature(self) -> Lanes:
        """See the base class."""
        return 1 / self.radius

    @property
    def narrow(self) -> Lanes:
        """See the base class."""
        return self.radius


class Round(AbstractRound):
    """A sphere, or a cylinder: what lies within a radius of a point, or of a line."""

    radius: Lanes  # [m]
    # whether the line is the second axis, or, in plane strain, across the plane
    endless: bool = eqx.field(static=True)
    length: Lanes | None = None  # of the line [m]; None for a point, or where it is endless

    def _beside(self, across: Float[Array, "component *point"]) -> Float[Array, "*point"]:
        """Square of the distance from the line, across the approach."""
        square = across[0] ** 2
        if self.endless:
            return square
        along = across[1]
        if self.length is not None:
            along = along - jnp.clip(along, -self.length / 2, self.length / 2)
        return square + along**2

    def distance(self, place: Float[Array, "component *point"]) -> Float[Array, "*point"]:
        """Without cancellation for any radius; see the base class."""
        beside, out = self._beside(place[:-1]), place[-1]
        size = jnp.sqrt(beside + (out - self.radius) ** 2)
        return (beside + out * (out - 2 * self.radius)) / (size + self.radius)

    def height(self, across: Float[Array, "component *point"]) -> Float[Array, "*point"]:
        """See the base class."""
        beside, square = self._beside(across), self.radius**2
        inside = beside < square
        left = jnp.sqrt(jnp.where(inside, square - beside, 1.0))
        return jnp.where(inside, beside / (self.radius + left), jnp.inf)


class Plate(AbstractShape):
    """A plane across the approach."""

    def distance(self, place: Float[Array, "component *point"]) -> Float[Array, "*point"]:
        """See the base class."""
        return -place[-1]

    def height(self, across: Float[Array, "component *point"]) -> Float[Array, "*point"]:
        """See the base class."""
        return jnp.zeros_like(across[0])


class Wedge(AbstractRound):
    """Two planes that meet in a round tip."""

    radius: Lanes  # of the tip [m]
    opening: Lanes  # angle between the planes [rad]

    def distance(self, place: Float[Array, "component *point"]) -> Float[Array, "*point"]:
        """See the base class."""
        steep = (np.pi - self.opening) / 2
        beside, below = jnp.abs(place[0]), self.radius - place[-1]
        flank = beside * jnp.sin(steep) + below * jnp.cos(steep) - self.radius
        at_tip = beside * jnp.cos(steep) <= below * jnp.sin(steep)
        tip = Round(self.radius, endless=True).distance(place)
        return jnp.where(at_tip, tip, flank)

    def height(self, across: Float[Array, "component *point"]) -> Float[Array, "*point"]:
        """See the base class."""
        steep, beside = (np.pi - self.opening) / 2, jnp.abs(across[0])
        flank = self.radius - (self.radius - beside * jnp.sin(steep)) / jnp.cos(steep)
        tip = Round(self.radius, endless=True).height(across)
        return jnp.where(beside <= self.radius * jnp.sin(steep), tip, flank)


class Box(AbstractShape):
    """A rectangle across the approach whose edges are round."""

    size: tuple[Lanes, Lanes]  # of the rectangle, edges included [m]
    edge: Lanes  # radius of the edges [m]

    @property
    def narrow(self) -> Lanes:
        """See the base class."""
        return jnp.minimum(*self.size) / 2

    def distance(self, place: Float[Array, "component *point"]) -> Float[Array, "*point"]:
        """See the base class."""
        sides = [
            jnp.abs(x) - (size / 2 - self.edge)
            for x, size in zip(place[:-1], self.size, strict=True)
        ]
        beyond = [*sides, self.edge - place[-1]]
        square = functools.reduce(jnp.add, [jnp.maximum(x, 0.0) ** 2 for x in beyond])
        outside = square > 0
        inner = functools.reduce(jnp.maximum, beyond)
        size = jnp.where(outside, jnp.sqrt(jnp.where(outside, square, 1.0)), inner)
        return size - self.edge

    def height(self, across: Float[Array, "component *point"]) -> Float[Array, "*point"]:
        """See the base class."""
        beyond = [
            jnp.maximum(jnp.abs(x) - (size / 2 - self.edge), 0.0)
            for x, size in zip(across, self.size, strict=True)
        ]
        over = functools.reduce(jnp.add, [x**2 for x in beyond])
        inside = over < self.edge**2
        left = jnp.sqrt(jnp.where(inside, self.edge**2 - over, 1.0))
        return jnp.where(inside, self.edge - left, jnp.inf)


def shape_of(spec: BodyLoadSpec, value: Callable[[str], Lanes], *, flat: bool) -> AbstractShape:
    """The surface that a scene asks for.

    `value`: gives the body's numbers by key, with a lane axis [SI]. `flat`: in plane strain.
    """
    if spec.shape == "wedge":
        return Wedge(value("radius"), value("opening"))
    if spec.shape in ("plate", "box"):
        if flat:
            return Plate()
        return Box((value("size.0"), value("size.1")), value("edge"))
    endless = flat or (spec.shape == "cylinder" and spec.length is None)
    length = None if spec.length is None else value("length")
    return Round(value("radius"), endless, length)
