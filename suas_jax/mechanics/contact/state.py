"""What a state says of contact: where a face is, what it touches, how hard."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool

from suas_jax.mechanics.contact.term import contact_pressure, push
from suas_jax.numerics.array_types import Lanes
from suas_jax.skin.body import PlacedBody


class ContactState(NamedTuple):
    """The inner face at the points where it may touch the wall.

    Arrays are [point, element, lane] along a section, [arc, axial, lane] over a pad.

    Attributes:
        angle: reference angle [rad].
        polar_angle: angle of the normal of the undeformed section through the point [rad].
        gap: to the wall's surface, negative inside it [m].
        pressure: of the wall on the face, per area of the undeformed face [Pa].
        area: of the undeformed face that a point stands for [m^2]; in plane strain per
            width [m].
        axial: current position along the axis [m]; None in plane strain.
    """

    angle: Array
    polar_angle: Array
    gap: Array
    pressure: Array
    area: Array
    axial: Array | None = None


class BodyContact(NamedTuple):
    """The outer face at the points where it may touch a body.

    Arrays are [point, element, lane] along a section, [arc, axial, lane] over a pad; components
    lead.

    Attributes:
        angle: reference angle [rad].
        position: current position [m].
        gap: to the body's surface, negative inside it [m].
        pressure: on the face, per area of the undeformed face [Pa].
        force: on the body [N]; in plane strain per width [N/m].
        area: of the undeformed face that a point stands for [m^2]; in plane strain per
            width [m].
        axial: reference position along the axis [m]; None in plane strain.
    """

    angle: Array
    position: Array
    gap: Array
    pressure: Array
    force: Array
    area: Array
    axial: Array | None = None

    @classmethod
    def of(
        cls,
        body: PlacedBody,
        angle: Array,
        position: Array,
        rest: Array | None,
        area: Array,
        axial: Array | None,
        shift: Array | float = 0.0,
    ) -> "BodyContact":
        """What a face's points say about a body; a shift adds to the gaps that they see.

        Args:
            body: where it is.
            angle: reference angle of the points [rad].
            position: of the points [m].
            rest: where they were at rest [m]; None without friction.
            area: of the undeformed face that a point stands for.
            axial: see the attribute.
            shift: added to the gaps [m].
        """
        gap = body.gap(position) + shift
        pressure = contact_pressure(body.law, gap)
        force = push(body, position, angle, area, shift, rest)
        return cls(angle, position, gap, pressure, force, area, axial)

    @property
    def on_clamp(self) -> Bool[Array, " lane"]:
        """Whether the body reaches a clamped edge, which a plane of symmetry is none."""

        def clamped(place: Array) -> Array:
            far = jnp.abs(jnp.broadcast_to(place, self.gap.shape))
            return (self.gap < 0) & (far > jnp.max(far, (0, 1)) / 2)

        along = clamped(self.angle)
        if self.axial is None:
            return along[0, 0] | along[-1, -1]
        across = clamped(self.axial)
        return jnp.any(along[0] | along[-1], 0) | jnp.any(across[:, 0] | across[:, -1], 0)


class Strip(NamedTuple):
    """The strip that a body touches, as a continuum does where a shell touches along lines.

    Attributes:
        half: half its width [m].
        pressure: the largest on it [Pa].
        told: whether both are good to a tenth.
    """

    half: Lanes
    pressure: Lanes
    told: Bool[Array, " lane"]
