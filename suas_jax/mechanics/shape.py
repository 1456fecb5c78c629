"""What a user reads off a deformed membrane, whatever mechanics found it."""

import abc
from typing import Any, NamedTuple

import equinox as eqx
from jaxtyping import Array, Bool

from suas_jax.constitutive.base import AbstractLaw
from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.length import length
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.section import AbstractSection


class Extreme(NamedTuple):
    """The largest or smallest value of a field, and where it is."""

    value: Lanes  # in SI units
    angle: Lanes  # from the symmetry axis [rad]
    axial: Lanes | None = None  # from the middle of the pad [m]; None in plane strain


class AbstractShape(eqx.Module):
    """A deformed membrane, sampled; every answer is smooth in the state."""

    # with the inner face's and the mid-surface's displacement, components leading
    samples: eqx.AbstractVar[Any]

    @staticmethod
    @abc.abstractmethod
    def peak(values: Array, *companions: Array) -> tuple[Lanes, ...]:
        """Largest of a sampled field, between samples, and other fields at the same place."""

    @property
    @abc.abstractmethod
    def places(self) -> tuple[Array, ...]:
        """Reference angles [rad] of the samples and, of a pad, axial positions [m]."""

    @abc.abstractmethod
    def inner_face(self, section: AbstractSection) -> tuple[Array, ...]:
        """Height over rest [m] of the inner face, and `places`, where it is now."""

    @abc.abstractmethod
    def inner_stretch(self) -> Array:
        """Samples of the inner face's hoop stretch, diverging places left out."""

    def smallest_gap(self, geometry: SkinGeometry) -> Extreme:
        """Smallest distance of the inner face from the wall, at its current place [m]."""
        height, *place = self.inner_face(geometry.section)
        negative, *at = self.peak(-height - geometry.gap(*place), *place)
        return Extreme(-negative, *at)

    def largest_displacement(self) -> Extreme:
        """Largest magnitude of the inner face's displacement, at its reference place [m]."""
        return Extreme(*self.peak(length(self.samples.inner_displacement), *self.places))

    def largest_mid_displacement(self) -> Lanes:
        """Largest magnitude of the mid-surface's displacement [m]."""
        return self.peak(length(self.samples.mid_displacement))[0]

    def bulge(self, geometry: SkinGeometry) -> Extreme:
        """Largest outward displacement of the inner face, radial, where it is now [m]."""
        return Extreme(*self.peak(*self.inner_face(geometry.section)))

    def stretch_range(self) -> tuple[Lanes, Lanes]:
        """Smallest and largest hoop stretch of the inner face, diverging places left out."""
        stretch = self.inner_stretch()
        return -self.peak(-stretch)[0], self.peak(stretch)[0]

    @abc.abstractmethod
    def material_stable(self, law: AbstractLaw) -> Bool[Array, " lane"]:
        """Whether the law is Drucker stable everywhere on both faces."""

    @abc.abstractmethod
    def in_domain(self, law: AbstractLaw) -> Bool[Array, " lane"]:
        """Whether the law has an energy on both faces, and at the stretches that are reported.

        Places where stretches diverge on finer meshes are left out.
        """
