"""The grid of points on the membrane that a picture shows."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.estimate.place import ContactPlaces
from suas_jax.config import GeometrySpec
from suas_jax.runtime.compiled import jit
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.plain import plain_geometry

_ARC, _AXIAL = 49, 25  # of a pad; 7 kB a picture
_SECTION = 181


@dataclass(frozen=True)
class Grid:
    """Points of the undeformed membrane, even along the arc and along the axis."""

    angle: Floats  # as sections define it, see `suas_jax.skin.section` [arc, rad]
    # from the middle [axial, m]; one point in plane strain, where nothing changes
    axial: Floats
    place: Floats  # of the inner face [arc, 2] [m]
    normal: Floats  # unit vectors outwards [arc, 2]
    curvature: Floats  # of the inner face [arc] [1/m]
    gap: Floats  # to the wall at rest [arc] [m]
    width: float  # of the skin along its axis [m]
    places: ContactPlaces  # how the skin's scenes tell places

    @classmethod
    def of(cls, spec: GeometrySpec) -> "Grid":
        """The grid of a skin."""
        pad, geometry = spec.dimension == 3, plain_geometry(spec)
        half = float(geometry.half_angle[0])
        angle = np.linspace(-1, 1, _ARC if pad else _SECTION) * half
        axial = np.linspace(-1, 1, _AXIAL) * spec.width / 2 if pad else np.zeros(1)
        rows = (np.asarray(x)[..., 0] for x in _sampled(geometry, jnp.asarray(angle)[:, None]))
        place, normal, curvature, gap = rows
        places = ContactPlaces.of(spec, geometry)
        return cls(angle, axial, place.T, normal.T, curvature, gap, spec.width, places)

    @property
    def points(self) -> tuple[Floats, Floats]:
        """Angle and axial position of every point [arc * axial]."""
        angle, axial = np.meshgrid(self.angle, self.axial, indexing="ij")
        return angle.ravel(), axial.ravel()

    @property
    def outward(self) -> Floats:
        """Unit normals of the inner face [arc * axial, 3]."""
        flat = np.pad(self.normal, ((0, 0), (0, 1)))
        return np.repeat(flat, len(self.axial), axis=0)

    def direction(self, angle: float) -> float:
        """Of the outward normal, from the y axis, clockwise [rad]."""
        x, y = (np.interp(angle, self.angle, side) for side in self.normal.T)
        return float(np.arctan2(x, y))


@jit
def _sampled(geometry: SkinGeometry, angle: jnp.ndarray) -> tuple[jnp.ndarray, ...]:
    section = geometry.section
    middle, thick = section.curvature(angle), section.thickness(angle)
    curvature = middle / (1 - middle * thick / 2)
    inner, normal = section.inner_face(angle), section.inner_normal(angle)
    flat = (jnp.broadcast_to(x, angle.shape) for x in (curvature, geometry.gap(angle)))
    return (inner, normal, *flat)
