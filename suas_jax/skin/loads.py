"""What acts on the membrane from outside: dead line loads and a uniform pressure."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from suas_jax.config import LineLoadSpec
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
