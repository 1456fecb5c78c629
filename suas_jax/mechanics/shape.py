"""What a user reads off a deformed membrane, whatever mechanics found it."""

import abc
from typing import NamedTuple

import equinox as eqx
from jaxtyping import Array, Bool

from suas_jax.constitutive.base import AbstractLaw
from suas_jax.numerics.array_types import Lanes
from suas_jax.skin.geometry import SkinGeometry


class Extreme(NamedTuple):
    """The largest or smallest value of a field, and where it is."""

    value: Lanes  # in SI units
    angle: Lanes  # from the symmetry axis [rad]
    axial: Lanes | None = None  # from the middle of the pad [m]; None in plane strain


class AbstractShape(eqx.Module):
    """A deformed membrane, sampled; every answer is smooth in the state."""

    @abc.abstractmethod
    def smallest_gap(self, geometry: SkinGeometry) -> Extreme:
        """Smallest distance of the inner face from the wall, at its current place [m]."""

    @abc.abstractmethod
    def largest_displacement(self) -> Extreme:
        """Largest magnitude of the inner face's displacement, at its reference place [m]."""

    @abc.abstractmethod
    def largest_mid_displacement(self) -> Lanes:
        """Largest magnitude of the mid-surface's displacement [m]."""

    @abc.abstractmethod
    def bulge(self, geometry: SkinGeometry) -> Extreme:
        """Largest outward displacement of the inner face, radial, where it is now [m]."""

    @abc.abstractmethod
    def stretch_range(self) -> tuple[Lanes, Lanes]:
        """Smallest and largest hoop stretch of the inner face, diverging places left out."""

    @abc.abstractmethod
    def material_stable(self, law: AbstractLaw) -> Bool[Array, " lane"]:
        """Whether the law is Drucker stable everywhere on both faces."""

    @abc.abstractmethod
    def in_domain(self, law: AbstractLaw) -> Bool[Array, " lane"]:
        """Whether the law has an energy on both faces, and at the stretches that are reported.

        Places where stretches diverge on finer meshes are left out.
        """
