"""What every mechanics of the section in plane strain has in common."""

import abc
from typing import ClassVar

from suas_jax.mechanics.base import AbstractMechanics, Displacements, Profile
from suas_jax.mechanics.section_face import INTERVALS, NormalFace, normal_face
from suas_jax.mechanics.section_shape import SAMPLES, SectionShape
from suas_jax.numerics.array_types import Lanes, StationVector
from suas_jax.skin.loads import LineLoad


class AbstractPlaneStrain(AbstractMechanics):
    """A membrane in plane strain; sums are per unit of width.

    Attributes:
        resolves_loads: whether stretches of the outer face diverge under line loads on finer
            meshes.
    """

    per_width: ClassVar[bool] = True
    resolves_loads: ClassVar[bool] = False

    @property
    @abc.abstractmethod
    def clamp_reach(self) -> Lanes:
        """Angle from a clamped edge within which stretches diverge on finer meshes [rad]."""

    @abc.abstractmethod
    def profile(self, q: StationVector, samples: int) -> Profile:
        """The deformed section at evenly spaced points of every element.

        Args:
            q: unknowns of the whole arc.
            samples: intervals an element is divided in.
        """

    @abc.abstractmethod
    def at_angle(self, q: StationVector, angle: Lanes) -> Displacements:
        """How the section moves at one reference angle per lane.

        Args:
            q: unknowns.
            angle: from the symmetry axis, within the discretised arc [rad].

        Returns:
            Displacements [2, 1, 1, lane].
        """

    def shape(self, q: StationVector) -> SectionShape:
        """The deformed section, sampled; see the base class."""
        profile = self.profile(q, SAMPLES)
        return SectionShape(profile, self.clamp_reach, self.growth, self.resolves_loads)

    def under(self, q: StationVector, load: LineLoad) -> Displacements:
        """How the section moves under a load; see the base class."""
        at = self.at_angle(q, load.angle)
        return Displacements(at.mid_displacement[:, 0, 0], at.inner_displacement[:, 0, 0])

    def face(self, q: StationVector) -> NormalFace:
        """The deformed inner face by its height over the undeformed one; see the base."""
        return normal_face(self.profile(q, INTERVALS), self.section)


def section_of(mechanics: AbstractMechanics) -> AbstractPlaneStrain:
    """The mechanics, known to be one in plane strain.

    Raises:
        TypeError: it is three-dimensional.
    """
    if not isinstance(mechanics, AbstractPlaneStrain):
        raise TypeError(f"plane strain is needed here, not a {type(mechanics).__name__}")
    return mechanics
