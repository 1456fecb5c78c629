"""What taxels see and a user reads of a deformed membrane, whatever mechanics found it."""

import abc
from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
from jaxtyping import Array, Bool, Float

from suas_jax.constitutive.base import AbstractLaw
from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.length import length
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.section import AbstractSection


class AbstractFace(eqx.Module):
    """An inner face, ready to be asked for gaps: its distance from the wall along rays.

    Rays are normals of the undeformed section; of a circle they come from its axis.
    """

    varies_along_axis: ClassVar[bool]  # whether the gap depends on the axial position

    def gaps(
        self, rays: Sequence[tuple[Array, Array]], geometry: SkinGeometry
    ) -> list[Float[Array, "taxel lane"]]:
        """Gaps along several rays for each taxel, ray after ray [m].

        Not all in one array: a reduction over them would cost the compiled program several
        times what the look-ups do.

        `rays`: angles [rad] and axial positions [m] of the taxels, a pair a ray. `geometry`:
        says where the wall is.
        """
        return [self.height(angle, axial) + geometry.gap(angle, axial) for angle, axial in rays]

    @abc.abstractmethod
    def height(
        self, angle: Float[Array, "ray #lane"], axial: Float[Array, "ray #lane"]
    ) -> Float[Array, "ray lane"]:
        """Height of the inner face over the undeformed one along rays [m].

        `angle`: of the rays [rad]. `axial`: their positions along the axis, from the middle
        [m].
        Returns the heights; NaN where a ray meets the face more than once.
        """


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
