"""The grid of points on the membrane that a picture shows."""

from dataclasses import dataclass

import numpy as np

from fitting.arrays import Floats
from suas_jax.config import GeometrySpec

_ARC, _AXIAL = 49, 25  # of a pad; 7 kB a picture
_SECTION = 181


@dataclass(frozen=True)
class Grid:
    """Points of the undeformed membrane, even along the arc and along the axis.

    Attributes:
        angle: from the symmetry axis [arc, rad].
        axial: from the middle [axial, m]; one point in plane strain, where nothing changes.
        radius: of the inner face [m].
    """

    angle: Floats
    axial: Floats
    radius: float

    @classmethod
    def of(cls, geometry: GeometrySpec) -> "Grid":
        """The grid of a skin."""
        circle, pad = geometry.circle("`suas view`"), geometry.dimension == 3
        angle = np.linspace(-1, 1, _ARC if pad else _SECTION) * circle.half_angle
        axial = np.linspace(-1, 1, _AXIAL) * geometry.width / 2 if pad else np.zeros(1)
        return cls(angle, axial, circle.inner_radius)

    @property
    def points(self) -> tuple[Floats, Floats]:
        """Angle and axial position of every point [arc * axial]."""
        angle, axial = np.meshgrid(self.angle, self.axial, indexing="ij")
        return angle.ravel(), axial.ravel()

    @property
    def outward(self) -> Floats:
        """Unit vectors away from the axis [arc * axial, 3]."""
        angle, _ = self.points
        return np.stack([np.sin(angle), np.cos(angle), np.zeros_like(angle)], 1)
