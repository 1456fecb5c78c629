"""What a state says of contact: where a face is, what it touches, how hard."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool

from suas_jax.numerics.array_types import Lanes


class ContactState(NamedTuple):
    """The inner face at the points where it may touch the wall.

    Arrays are [point, element, lane] along a section, [arc, axial, lane] over a pad.
    """

    angle: Array  # reference angle [rad]
    polar_angle: Array  # angle of the normal of the undeformed section through the point [rad]
    gap: Array  # to the wall's surface, negative inside it [m]
    pressure: Array  # of the wall on the face, per area of the undeformed face [Pa]
    # of the undeformed face that a point stands for [m^2]; in plane strain per width [m]
    area: Array
    axial: Array | None = None  # current position along the axis [m]; None in plane strain


class BodyContact(NamedTuple):
    """The outer face at the points where it may touch a body.

    Arrays are [point, element, lane] along a section, [arc, axial, lane] over a pad; components
    lead.
    """

    angle: Array  # reference angle [rad]
    position: Array  # current position [m]
    gap: Array  # to the body's surface, negative inside it [m]
    pressure: Array  # on the face, per area of the undeformed face [Pa]
    force: Array  # on the body [N]; in plane strain per width [N/m]
    # of the undeformed face that a point stands for [m^2]; in plane strain per width [m]
    area: Array
    axial: Array | None = None  # reference position along the axis [m]; None in plane strain

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
    """The strip that a body touches, as a continuum does where a shell touches along lines."""

    half: Lanes  # half its width [m]
    pressure: Lanes  # the largest on it [Pa]
    told: Bool[Array, " lane"]  # whether both are good to a tenth
