"""Rigid bodies that press on the outer face: where they come in, and their friction.

A body has a frame of its own: its origin is the body's tip, the point that comes in along the
inward normal of the undeformed skin, its last axis points away from the skin. Its shape
(`body_shapes`) is a signed distance in that frame, so contact needs no search and the skin may
slide beneath it.
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from suas_jax.config import BodyLoadSpec
from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.jet import Jet, second_order
from suas_jax.skin.body_shapes import AbstractShape, shape_of
from suas_jax.skin.circle import Circle
from suas_jax.skin.section import AbstractSection, outward, tangent
from suas_jax.skin.wall import AbstractPressureGap, Wall

_STICK = 1e-3  # thicknesses of slip until friction is mobilised
_ANGLES, _LENGTHS = 1601, 81  # places among which the first touch is sought
_CLOSER, _AMONG = 3, 33  # further rounds around the best of them, and places of each


class Grip(NamedTuple):
    """How friction holds the points of a face to a body."""

    # largest force of friction of a point [N]; in plane strain per width [N/m]
    bound: Float[Array, "*point"]
    normal: Float[Array, "component *point"]  # of the body's surface there, away from the body


class Body(eqx.Module):
    """A rigid body on its way into the skin."""

    shape: AbstractShape  # its surface
    angle: Lanes  # of the reference point, as sections define it [rad]
    # of the reference point, from the middle of the pad [m]; None in plane strain
    axial: Lanes | None
    travel: Lanes  # beyond first touch at full load [m]
    origin: Float[Array, "component lane"]  # where its tip is at first touch [m]
    # its axes, row by row: along the arc, along the pad, away from the skin
    frame: Float[Array, "component component lane"]
    law: AbstractPressureGap  # pressure over gap
    # travel across the approach at full load [m]; None for none
    drag: Float[Array, "component lane"] | None = None
    friction: Lanes | None = None  # Coulomb's coefficient; None for none
    stick: Lanes | None = None  # slip by which friction is as good as fully mobilised [m]
    # of friction on the points of the face; None for that of the state at hand
    grip: Grip | None = None
    # whether the law is softer than the body's own; None where it never is
    soft: Bool[Array, "..."] | None = None

    @classmethod
    def of(
        cls,
        spec: BodyLoadSpec,  # says which shape
        section: AbstractSection,  # what it is pressed on
        # angle of the reference point [rad], and on a pad its axial position [m]
        places: tuple[Lanes, Lanes | None],
        value: Callable[[str], Lanes],  # gives the body's numbers by key, with a lane axis [SI]
        law: AbstractPressureGap,  # of its contact
    ) -> "Body":
        """A body of a scene."""
        angle, axial = places
        shape = shape_of(spec, value, flat=axial is None)
        direction = section.direction(angle)
        t, n = tangent(direction), outward(direction)
        if axial is None:
            frame = jnp.stack([t, n])
        else:
            zero, turn = jnp.zeros_like(direction), value("turn")
            along, out = jnp.stack([*t, zero]), jnp.stack([*n, zero])
            axis = jnp.stack([zero, zero, zero + 1])
            first = jnp.cos(turn) * along - jnp.sin(turn) * axis
            second = jnp.sin(turn) * along + jnp.cos(turn) * axis
            frame = jnp.stack(jnp.broadcast_arrays(first, second, out))
        reference = section.mid_line(angle) + section.thickness(angle) / 2 * n
        if axial is not None:
            reference = jnp.stack(jnp.broadcast_arrays(*reference, axial))
        rise = _first_touch(shape, section, reference, frame)
        origin = reference + rise * frame[-1]
        drag = stick = None
        if any(spec.dragged):
            along_arc = value("drag") * t if spec.dragged[0] else 0.0 * t
            along_axis = value("drag_axial") if spec.dragged[1] else 0.0 * along_arc[0]
            rows = (*along_arc, along_axis)[: len(frame)]
            drag = jnp.stack(jnp.broadcast_arrays(*rows))
        friction = None if spec.friction is None else value("friction")
        if friction is not None:
            stick = _STICK * section.mean_thickness
        travel = value("depth")
        return cls(shape, angle, axial, travel, origin, frame, law, drag, friction, stick)

    def placed(self, factor: Lanes | float) -> "PlacedBody":
        """The body where a factor on its travel has brought it."""
        drag = None if self.drag is None else factor * self.drag
        return PlacedBody(self, factor * self.travel, drag)

    @property
    def way(self) -> Float[Array, "component lane"]:
        """From first touch to where it is at full load [m]."""
        inward = -self.travel * self.frame[-1]
        return inward if self.drag is None else inward + self.drag

    def room(self, position: Float[Array, "component *point"]) -> Float[Array, "*point"]:
        """Travel at which places come to lie on its surface, with all of its drag [m].

        Infinite for places that it passes by. `position`: of the places [m].
        """
        seen = PlacedBody(self, jnp.zeros_like(self.travel), self.drag).seen(position)
        return self.shape.height(seen[:-1]) - seen[-1]

    def tip_over(self, wall: Wall, layer: Lanes | float) -> Lanes:
        """Height of its tip over a wall, at full load or little beneath the wall [m].

        `layer`: how far the wall lies beneath the surface of what covers it [m].
        """
        start = self.origin if self.drag is None else self.origin + self.drag
        over = jnp.maximum(wall.gap(start, self.angle) + layer, 0.0)
        # No further, as a height means nothing far beneath a curved surface.
        travel = jnp.minimum(self.travel, 2 * over)
        return wall.gap(start - travel * self.frame[-1], self.angle) + layer

    @property
    def along(self) -> Float[Array, "2 lane"]:
        """Direction of growing angles across the approach, in the section."""
        out = self.frame[-1]
        return jnp.stack([out[1], -out[0]])

    def holding(self, grip: Grip | None) -> "Body":
        """The same body with a given grip."""
        return dataclasses.replace(self, grip=grip)

    def softened(self, factor: Array) -> "Body":
        """The same body with a law that is nowhere stiffer than a share of the rigid limit."""
        return dataclasses.replace(self, law=self.law.softened(factor), soft=factor < 1)


class PlacedBody(eqx.Module):
    """A body after some of its travel."""

    body: Body  # at first touch
    travel: Lanes  # so far [m]
    # so far across the approach [m]; None for none
    drag: Float[Array, "component lane"] | None = None

    @property
    def law(self) -> AbstractPressureGap:
        """That of the body."""
        return self.body.law

    def seen(
        self, position: Float[Array, "component *point"]
    ) -> Float[Array, "component *point"]:
        """Places in the body's frame [m]."""
        origin = self.body.origin if self.drag is None else self.body.origin + self.drag
        *across, along = seen_from(origin, self.body.frame, position)
        # Several travels may be asked for of points of one lane.
        return jnp.stack(jnp.broadcast_arrays(*across, along + self.travel))

    def expanded(self, position: Float[Array, "2 *point"], near: Array) -> Jet:
        """See `Obstacle`."""
        return second_order(lambda x, y: self.gap(jnp.stack([x, y]), near), *position)

    def gap(
        self, position: Float[Array, "component *point"], near: Array | None = None
    ) -> Float[Array, "*point"]:
        """Distance of points from the body, wherever they have slid [m]."""
        del near
        shape, soft, seen = self.body.shape, self.body.soft, self.seen(position)
        if soft is None:
            return shape.distance(seen)
        # From a state that is far off the body's own law, too, sends skin out behind the body.
        straight = soft | shape.is_beyond(seen)
        return jnp.where(straight, shape.straight_distance(seen), shape.distance(seen))

    def grip(
        self, position: Float[Array, "component *point"], area: Float[Array, "*#point"]
    ) -> Grip:
        """What friction can hold of points of a face where they are.

        `position`: of the points [m]. `area`: of the undeformed face that a point stands for.
        """

        def gap(position: Array) -> Array:
            return jnp.sum(self.gap(position))

        pressure = -jax.grad(lambda g: jnp.sum(self.law.energy(g)))(self.gap(position))
        friction = 0.0 if self.body.friction is None else self.body.friction
        return Grip(friction * area * pressure, jax.grad(gap)(position))

    def work_of_slip(
        self,
        moved: Float[Array, "component *point"],  # displacement of points of the face [m]
        normal: Float[Array, "component *point"],  # of the body's surface there
    ) -> Float[Array, "*point"]:
        """Work against friction of a unit bound [m]: the slip, but for a short one.

        With the slip s from first touch to the state at hand, whatever the way, and a short
        length e the force is s / sqrt(s^2 + e^2) of the bound.
        """
        body, drag = self.body, 0.0 if self.drag is None else self.drag
        way = drag - self.travel * body.frame[-1]
        apart = [x - w for x, w in zip(moved, way, strict=True)]
        off = functools.reduce(jnp.add, [n * x for n, x in zip(normal, apart, strict=True)])
        slip = [x - off * n for n, x in zip(normal, apart, strict=True)]
        square = functools.reduce(jnp.add, [x**2 for x in slip])
        assert body.stick is not None
        return square / (jnp.sqrt(square + body.stick**2) + body.stick)


def seen_from(
    origin: Float[Array, "component lane"],
    frame: Float[Array, "component component lane"],
    position: Float[Array, "component *point"],
) -> Float[Array, "component *point"]:
    """Places in a frame [m]."""
    away = [x - x0 for x, x0 in zip(position, origin, strict=True)]
    rows = [
        functools.reduce(jnp.add, [a * x for a, x in zip(r, away, strict=True)]) for r in frame
    ]
    return jnp.stack(rows)


def _first_touch(
    shape: AbstractShape,
    section: AbstractSection,
    reference: Float[Array, "component lane"],
    frame: Float[Array, "component component lane"],
) -> Lanes | float:
    """How far over its reference point the body's tip is when it first touches the skin [m].

    Zero where the outer face is convex: there it touches at the reference point.
    """
    if isinstance(section, Circle):
        return 0.0

    def rise(angle: Array, *axial: Array) -> Array:
        angle = jnp.clip(angle, -section.half_angle, section.half_angle)
        height = section.thickness(angle) / 2
        face = section.mid_line(angle) + height * outward(section.direction(angle))
        face = jnp.stack(jnp.broadcast_arrays(*face, *axial))
        seen = seen_from(reference, frame, face)
        return seen[-1] - shape.height(seen[:-1])

    def along(angle: Array) -> list[Array]:
        # Over each angle the body is lowest at one place along the axis, as it is convex.
        reach = 2 * jnp.max(jnp.abs(reference[:2]))
        return [
            _highest(functools.partial(rise, angle), 0 * angle + middle, reach, _LENGTHS)
            for middle in reference[2:]
        ]

    def over(angle: Array) -> Array:
        return rise(angle, *along(angle))

    angle = _highest(over, 0 * reference[0], section.half_angle, _ANGLES)
    # The derivatives are those at a fixed place.
    return jnp.maximum(rise(*jax.lax.stop_gradient([angle, *along(angle)])), 0.0)


def _highest(
    height: Callable[[Array], Array],  # by place, with an axis of places before the others
    middle: Float[Array, "*place lane"],
    reach: Lanes,  # to either side of the middle
    count: int,  # of places that are tried, evenly
) -> Float[Array, "*place lane"]:
    """Where a height is largest, closed in on around the best of some places."""

    def closer(count: int, at: tuple[Array, Array]) -> tuple[Array, Array]:
        middle, reach = at
        steps = jnp.linspace(-1.0, 1.0, count)
        places = middle + steps.reshape(-1, *(1,) * middle.ndim) * reach
        best = steps[jnp.argmax(height(places), 0)]
        return middle + best * reach, 2 / (count - 1) * reach

    at = closer(count, (middle, reach))
    return jax.lax.fori_loop(0, _CLOSER, lambda _, at: closer(_AMONG, at), at)[0]
