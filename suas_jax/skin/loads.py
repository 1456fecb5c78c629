"""What acts on the membrane from outside: dead line loads and a uniform pressure."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from suas_jax.numerics.array_types import Lanes
from suas_jax.skin.geometry import SkinGeometry, outward


class LineLoad(eqx.Module):
    """A dead force on the outer face, even over the width, at an angle or around it.

    Attributes:
        angle: of the point of application, or of the middle of the loaded arc [rad].
        force: total over the width; negative pulls outwards [N].
        turn: counter-clockwise rotation of the force from the inward radial [rad]; not
            used by a vertical load.
        spread: arc of the undeformed outer face over which the force is even [m], or None
            for a line.
        vertical: whether the force points down instead.
    """

    angle: Lanes
    force: Lanes
    turn: Lanes
    spread: Lanes | None = None
    vertical: bool = eqx.field(static=True, default=False)

    @property
    def direction(self) -> Float[Array, "2 lane"]:
        """Unit vector of a positive force."""
        if self.vertical:
            zero = jnp.zeros_like(self.angle)
            return jnp.stack([zero, zero - 1])
        # Turning the inward radial vector counter-clockwise lowers its polar angle, which
        # is measured clockwise from the crown.
        return -outward(self.angle - self.turn)

    def breakpoints(self, geometry: SkinGeometry) -> list[Lanes]:
        """Angles where the load is singular: its point, or the ends of its arc [rad]."""
        if self.spread is None:
            return [self.angle]
        half = self.spread / (2 * geometry.outer_radius)
        return [self.angle - half, self.angle + half]


class LoadPoints(eqx.Module):
    """Dead forces at points of the outer face, the form every mechanics takes loads in.

    Attributes:
        select: one where a point lies in an element, else zero.
        xi: local coordinate in that element, 0 to 1.
        force: Cartesian components per width [N/m].
    """

    select: Float[Array, "element point #lane"]
    xi: Float[Array, "point #lane"]
    force: Float[Array, "2 point #lane"]
