"""What acts on the pad in three dimensions: dead forces even over parts of the outer face."""

from collections.abc import Callable
from typing import TypeAlias

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from suas_jax.config import LineLoadSpec, PatchLoadSpec
from suas_jax.numerics.array_types import Lanes
from suas_jax.skin.loads import LineLoad
from suas_jax.skin.section import AbstractSection, outward


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
