"""What acts on the membrane from outside: dead line loads, on a pad loads even over patches."""

from collections.abc import Callable
from typing import Any, TypeAlias

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from suas_jax.config import LineLoadSpec, PatchLoadSpec
from suas_jax.numerics.array_types import Lanes
from suas_jax.skin.section import AbstractSection, outward


def angle_of(spec: Any, section: AbstractSection, value: Callable[[str], Lanes]) -> Lanes:
    """Where a load, a taxel or a module is, as sections define angles [rad].

    `spec`: says whether the place is told by angle or by arc. `section`: what it lies on.
    `value`: gives its numbers by key, with a lane axis [SI].
    """
    if spec.arc is not None:
        return section.from_arc(value("arc"))
    return section.from_given_angle(value("angle"))


class LineLoad(eqx.Module):
    """A dead force on the outer face, even over the width, at an angle or around it."""

    # of the point of application, or of the middle of the loaded
    # arc [rad]; as sections define it
    angle: Lanes
    force: Lanes  # total over the width; negative pulls outwards [N]
    # counter-clockwise rotation of the force from the inward normal
    # [rad]; not used by a vertical load
    turn: Lanes
    # arc of the undeformed outer face over which the force is even [m], or None for a line
    spread: Lanes | None = None
    # whether the force points down instead
    vertical: bool = eqx.field(static=True, default=False)

    @classmethod
    def of(
        cls, spec: LineLoadSpec, section: AbstractSection, value: Callable[[str], Lanes]
    ) -> "LineLoad":
        """A load of a scene.

        `spec`: says which kind of direction and of place. `section`: what it lies on. `value`:
        gives the load's numbers by key, with a lane axis [SI].
        """
        angle = angle_of(spec, section, value)
        free = not isinstance(spec.direction, str)
        return cls(
            angle,
            value("force"),
            value("direction") if free else jnp.zeros(1),
            None if spec.spread is None else value("spread"),
            vertical=spec.direction == "vertical",
        )

    def direction(self, section: AbstractSection) -> Float[Array, "2 lane"]:
        """Unit vector of a positive force."""
        if self.vertical:
            zero = jnp.zeros_like(self.angle)
            return jnp.stack([zero, zero - 1])
        # Turning the inward normal counter-clockwise lowers its direction, which is measured
        # clockwise from the crown.
        return -outward(section.direction(self.angle) - self.turn)

    def breakpoints(self, section: AbstractSection) -> list[Lanes]:
        """Angles where the load is singular: its point, or the ends of its arc [rad]."""
        if self.spread is None:
            return [self.angle]
        height = section.thickness(self.angle) / 2
        ends = (section.moved(self.angle, s * self.spread / 2, height) for s in (-1, 1))
        return list(ends)


class LoadPoints(eqx.Module):
    """Dead forces at points of the outer face, the form every mechanics takes loads in."""

    # one where a point lies in an element, else zero
    select: Float[Array, "element point #lane"]
    xi: Float[Array, "point #lane"]  # local coordinate in that element, 0 to 1
    force: Float[Array, "2 point #lane"]  # Cartesian components per width [N/m]


class PadLoad(eqx.Module):
    """A dead force, even over a part of the undeformed outer face.

    The part is a rectangle, a disc or a line along the axis: what is given says which.
    """

    angle: Lanes  # of its centre [rad]
    axial: Lanes  # of its centre, from the middle of the pad [m]
    force: Lanes  # total; negative pulls outwards [N]
    # counter-clockwise rotation of the force from the inward radial in the section's plane
    # [rad]; not used by a vertical load
    turn: Lanes
    tilt: Lanes  # of the force out of that plane towards +axial [rad]
    # extent of a rectangle along the arc of the outer face [m]; None for others
    arc: Lanes | None = None
    # extent of a rectangle or of a line along the axis [m]; None for a disc
    length: Lanes | None = None
    diameter: Lanes | None = None  # of a disc [m]; None for others
    # whether the force, before its tilt, points down
    vertical: bool = eqx.field(static=True, default=False)

    @classmethod
    def of(
        cls,
        spec: LineLoadSpec | PatchLoadSpec,  # says which shape and kind of direction
        angle: Lanes,  # of its centre, as sections define it [rad]
        # gives the load's numbers by key (``axial``, ``size.0`` ...), with a lane axis [SI]
        value: Callable[[str], Lanes],
        width: ArrayLike,  # of the pad, the length of a line that states none [m]
    ) -> "PadLoad":
        """A load of a scene."""

        def given(name: str) -> Lanes | None:
            return None if getattr(spec, name, None) is None else value(name)

        arc, length = given("spread"), given("length")
        if isinstance(spec, PatchLoadSpec) and spec.size is not None:
            arc, length = value("size.0"), value("size.1")
        elif isinstance(spec, LineLoadSpec) and length is None:
            length = jnp.atleast_1d(jnp.asarray(width, float))
        turn = jnp.zeros(1) if isinstance(spec.direction, str) else value("direction")
        place, force, tilt = value("axial"), value("force"), value("tilt")
        shape = arc, length, given("diameter")
        down = spec.direction == "vertical"
        return cls(angle, place, force, turn, tilt, *shape, vertical=down)

    def __check_init__(self) -> None:
        """Reject a shape that is none.

        Raises ValueError: not exactly one of rectangle, disc and line is described.
        """
        if (self.diameter is None) == (self.length is None) or (
            self.diameter is not None and self.arc is not None
        ):
            raise ValueError(
                "a load on the pad is a rectangle (arc and length), a disc (diameter) or a "
                "line along the axis (length)"
            )

    def direction(self, section: AbstractSection) -> Float[Array, "3 lane"]:
        """Unit vector of a positive force: x right, y to the crown, z along the axis."""
        zero = jnp.zeros_like(self.angle + self.turn + self.tilt)
        # Turning counter-clockwise lowers the direction, which is measured clockwise.
        plane = -outward(section.direction(self.angle) - self.turn + zero)
        if self.vertical:
            plane = jnp.stack([zero, zero - 1])
        tilt = self.tilt + zero
        return jnp.concatenate([jnp.cos(tilt) * plane, jnp.sin(tilt)[None]])

    def extent(self) -> tuple[Lanes, Lanes]:
        """Half extents along the arc of the outer face and along the axis [m]."""
        if self.diameter is not None:
            return self.diameter / 2, self.diameter / 2
        assert self.length is not None
        arc = jnp.zeros_like(self.length) if self.arc is None else self.arc
        return arc / 2, self.length / 2


DeadLoad: TypeAlias = LineLoad | PadLoad
"""What acts on a membrane, in plane strain or in three dimensions."""


class PadLoadPoints(eqx.Module):
    """Dead forces at points of the outer face, the form the pad's mechanics takes loads in."""

    angle: Float[Array, "point #lane"]  # reference angle [rad]
    axial: Float[Array, "point #lane"]  # reference position along the axis [m]
    force: Float[Array, "3 point #lane"]  # Cartesian components [N]
