"""The skin's dimensions and the curves derived from them.

Cross-section, plane strain: a half-cylinder membrane clamped along both straight edges
over a rigid wall, the oil film between them. Angles are measured from the symmetry axis,
positive towards +x; x points right and y to the crown.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from suas_jax.numerics.array_types import Lanes


class SkinGeometry(eqx.Module):
    """Undeformed dimensions of a skin.

    Attributes:
        inner_radius: radius of the membrane's inner face [m].
        thickness: of the membrane [m].
        half_angle: from the symmetry axis to a clamped edge [rad].
        width: extent along the axis [m].
        oil_gap: from the inner face to the rigid wall [m].
    """

    inner_radius: Lanes
    thickness: Lanes
    half_angle: Lanes
    width: Lanes
    oil_gap: Lanes

    @property
    def mid_radius(self) -> Lanes:
        """Radius of the mid-surface [m]."""
        return self.inner_radius + self.thickness / 2

    @property
    def outer_radius(self) -> Lanes:
        """Radius of the outer face [m]."""
        return self.inner_radius + self.thickness

    @property
    def wall_radius(self) -> Lanes:
        """Radius of the rigid wall [m]."""
        return self.inner_radius - self.oil_gap

    @property
    def film_area(self) -> Lanes:
        """Cross-section of the undeformed oil film, between wall and membrane [m^2]."""
        return self.half_angle * (self.inner_radius + self.wall_radius) * self.oil_gap


def outward(angle: Float[Array, "*shape"]) -> Float[Array, "2 *shape"]:
    """Unit vector that points away from the axis at an angle from the symmetry axis."""
    return jnp.stack([jnp.sin(angle), jnp.cos(angle)])


def tangent(angle: Float[Array, "*shape"]) -> Float[Array, "2 *shape"]:
    """Unit vector along the undeformed arc, in the direction of growing angle."""
    return jnp.stack([jnp.cos(angle), -jnp.sin(angle)])
