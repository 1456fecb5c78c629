"""The wall under the skin: where it is, and how it answers the membrane that reaches it.

The wall is rigid and parallel to the undeformed inner face. It is frictionless and analytic:
the gap of a point is its height over the undeformed face, along the normal through it, and
the oil gap there, so contact needs no search. The contact pressure comes on top of the oil's
and follows from an energy per area of the inner face at rest, W(gap)::

    p_c = -dW/dgap >= 0

Every law is zero until the gap closes, so it changes nothing of a state without contact.
"""

import abc
import functools
from typing import Protocol

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.jet import Jet, second_order, staged
from suas_jax.skin.geometry import SkinGeometry

# Stiffness of the rigid limit in shear moduli per membrane thickness. Its error falls with
# its inverse: a tenth of it leaves 5e-4 in the oil's pressure, this 5e-5.
_RIGID = 500.0
# Contact pressure, in shear moduli, over which the rigid limit's stiffness sets in.
_ONSET = 0.1
# Share of a soft layer's thickness over which its stiffness sets in.
_LAYER_ONSET = 1e-3


class AbstractPressureGap(eqx.Module):
    """A law between the contact pressure and the gap to the wall."""

    @abc.abstractmethod
    def energy(self, gap: Array) -> Array:
        """Energy per area of the undeformed inner face [J/m^2], zero while the gap is open.

        `gap`: distance from the wall's surface, negative inside it, lanes last [m].
        """

    @abc.abstractmethod
    def softened(self, factor: Array) -> "AbstractPressureGap":
        """A law that no part of is stiffer than a share of the rigid limit.

        `factor`: that share; 1 is the law itself.
        """


class RigidLimit(AbstractPressureGap):
    """A stiffness high enough to stand for a rigid wall.

    With the penetration d = -gap::

        p_c = k d^2 / (2 b)     for 0 < d < b
        p_c = k (d - b / 2)     beyond

    The onset b makes the tangent a continuous function of the state: Newton's method
    converges quadratically, and derivatives of the solution don't jump from point to point.
    """

    stiffness: Lanes  # k [Pa/m]
    onset: Lanes  # b [m]

    @classmethod
    def of(cls, modulus: Lanes, thickness: Lanes) -> "RigidLimit":
        """Stiff compared with a membrane.

        `modulus`: small-strain shear modulus of the membrane [Pa]. `thickness`: of the membrane
        [m].
        """
        stiffness = _RIGID * modulus / thickness
        return cls(stiffness, _ONSET * modulus / stiffness)

    def energy(self, gap: Array) -> Array:
        """Cubic in the penetration, then quadratic; see the base class."""
        return _spring(-gap, self.stiffness, self.onset)

    def softened(self, factor: Array) -> "RigidLimit":
        """Less stiff, the pressure where stiffness sets in kept; see the base class."""
        return RigidLimit(factor * self.stiffness, self.onset / factor)


class SoftLayer(AbstractPressureGap):
    """A soft layer over the rigid wall, such as a fabric, whose pores the oil fills.

    The gap is measured from its free surface, so it takes no room from the oil film. With
    the indentation d = -gap and its thickness h::

        p_c = E d / h

    until the rigid wall beneath takes over at d = h.
    """

    thickness: Lanes  # h [m]
    stiffness: Lanes  # pressure per strain, E [Pa]
    beneath: RigidLimit  # the rigid wall

    def energy(self, gap: Array) -> Array:
        """That of the layer and of the wall beneath; see the base class."""
        onset = _LAYER_ONSET * self.thickness
        layer = _spring(-gap, self.stiffness / self.thickness, onset)
        return layer + self.beneath.energy(gap + self.thickness)

    def softened(self, factor: Array) -> "SoftLayer":
        """Layer and wall less stiff; see the base class."""
        beneath = self.beneath.softened(factor)
        stiffness = jnp.minimum(self.stiffness, beneath.stiffness * self.thickness)
        return SoftLayer(self.thickness, stiffness, beneath)


class Obstacle(Protocol):
    """A rigid surface that a face of the membrane may touch."""

    @property
    def law(self) -> AbstractPressureGap:
        """Pressure over gap."""
        ...

    def gap(
        self, position: Float[Array, "component *point"], near: Array
    ) -> Float[Array, "*point"]:
        """Distance of points from the surface, negative inside it [m].

        `position`: x and y first, then along the axis. `near`: angles close to theirs, such as
        those of the material [rad].
        """
        ...

    def expanded(self, position: Float[Array, "2 *point"], near: Array) -> Jet:
        """The gap of a section's points and its derivatives by their two coordinates."""
        ...


class Wall(eqx.Module):
    """A surface parallel to the undeformed inner face, and its law of contact."""

    geometry: SkinGeometry  # says where its surface is, a soft layer's where there is one
    law: AbstractPressureGap  # pressure over gap

    @classmethod
    def of(
        cls,
        geometry: SkinGeometry,
        modulus: Lanes,  # small-strain shear modulus of its membrane [Pa]
        # thickness [m] and stiffness [Pa] of a soft layer, if there is one
        layer: tuple[Lanes, Lanes] | None = None,
    ) -> "Wall":
        """The wall of a skin."""
        rigid = RigidLimit.of(modulus, geometry.thickness)
        return cls(geometry, rigid if layer is None else SoftLayer(*layer, rigid))

    def softened(self, factor: Array) -> "Wall":
        """The same wall with a law that is nowhere stiffer than a share of the rigid limit."""
        return Wall(self.geometry, self.law.softened(factor))

    def gap(
        self, position: Float[Array, "component *point"], near: Array
    ) -> Float[Array, "*point"]:
        """See `Obstacle`."""
        return self.seen_from(position, near)[1]

    def may_touch(
        self, position: Float[Array, "2 *point"], near: Array
    ) -> Bool[Array, "*point"]:
        """Whether points may be inside the wall; where not they are outside. See `gap`."""
        if self.geometry.gap_along is not None:
            return self.gap(position, near) < 0
        return self.geometry.section.may_lie_below(position, near, self.geometry.oil_gap)

    def expanded(self, position: Float[Array, "2 *point"], near: Array) -> Jet:
        """See `Obstacle`.

        With the normal n through a place, the tangent t and the curvature k of the curve
        through it that is parallel to the inner face::

            gap' = n,   gap'' = k t t
        """
        if self.geometry.gap_along is not None:
            return second_order(lambda x, y: self.gap(jnp.stack([x, y]), near), *position)
        height, n, k = self.geometry.section.height_frame(position, near)
        # Else all of it is computed anew for every entry of the elements' matrices.
        gap, x, y, k = staged([height + self.geometry.oil_gap, *n, k])
        return Jet(gap, x, y, k * y**2, -k * x * y, k * x**2)

    def seen_from(
        self, position: Float[Array, "component *point"], near: Array
    ) -> tuple[Float[Array, "*point"], Float[Array, "*point"]]:
        """Angle of the normal through points, and the gap there [rad, m]; see `gap`."""
        angle, height = self.geometry.section.foot(position, near)
        axial = position[2] if len(position) == 3 else None
        return angle, height + self.geometry.gap(angle, axial)


@functools.partial(jax.jit, inline=True)
def _spring(compression: Array, stiffness: Lanes, onset: Lanes) -> Array:
    """Energy of a linear spring whose stiffness sets in over a short compression."""
    d = jnp.maximum(compression, 0.0)
    start = d**3 / (6 * onset)
    beyond = d**2 / 2 - onset * d / 2 + onset**2 / 6
    return stiffness * jnp.where(d < onset, start, beyond)
