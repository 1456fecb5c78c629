"""What every mechanics of the section in plane strain has in common; its sampled shape.

Extremes are taken at the vertex of a parabola through neighbouring samples, so that they can be
differentiated.
"""

import abc
from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from suas_jax.constitutive.base import AbstractLaw
from suas_jax.constitutive.deformation import FibreStretch, HeldFibre
from suas_jax.constitutive.stability import drucker_modulus
from suas_jax.mechanics.base import AbstractMechanics, Displacements, Profile
from suas_jax.mechanics.contact.face import AbstractContactFace, BodyContact
from suas_jax.mechanics.shape import AbstractFace, AbstractShape
from suas_jax.numerics.array_types import Lanes, StationVector
from suas_jax.numerics.extremes import first_largest
from suas_jax.numerics.polynomials import polynomial, power_coefficients
from suas_jax.skin.body import Grip, PlacedBody
from suas_jax.skin.loads import LineLoad
from suas_jax.skin.prestress import Growth
from suas_jax.skin.section import AbstractSection
from suas_jax.skin.wall import Obstacle

# Intervals an element is sampled in, the degree of its polynomial.
INTERVALS = 4
_NOWHERE = 1e3  # angle of no ray [rad]: finite, as weighted sums are made of faces
_CRUSHED = 1e-3  # stretch of a fibre below which no material follows its law
SAMPLES = 8  # intervals per element in which extremes are sought


class NormalFace(AbstractFace):
    """The inner face as its height over the angle of normals, element by element.

    A mechanics gives points of its deformed inner face, a ray asks for a height at its angle.
    On one element the face is smooth and the angle of the normal through it grows with the
    local coordinate, so the height is a smooth function of the angle: the polynomial through a
    few samples is exact to far below the error of the mesh. No iteration is needed, neither for
    values nor for derivatives, and one polynomial serves any number of rays.
    """

    varies_along_axis: ClassVar[bool] = False
    edges: Float[Array, "station lane"]  # angles of the elements' ends [rad]
    # coefficients of the height [m] in ascending powers of a coordinate that runs from -1 to 1
    # over the element's angle
    powers: Float[Array, "power element lane"]
    # first and last angle of the elements along which it turns back [rad]: rays there meet the
    # face more than once, and no gap can be told there; the first is larger where none does
    fold: Float[Array, "2 lane"]

    @property
    def folded(self) -> Bool[Array, " lane"]:
        """Whether some ray meets the face more than once."""
        return self.fold[0] <= self.fold[1]

    def height(
        self, angle: Float[Array, "ray #lane"], axial: Float[Array, "ray #lane"]
    ) -> Float[Array, "ray lane"]:
        """Whatever the axial position; see the base class."""
        del axial
        known = (angle < self.fold[0]) | (angle > self.fold[1])
        return jnp.where(known, height_at(self, angle), jnp.nan)


def normal_face(shape: Profile, section: AbstractSection) -> NormalFace:
    """Describe the deformed inner face by its height over the angle of normals.

    `shape`: the section, in `INTERVALS` intervals an element.
    """
    angle, height = section.foot(shape.rest + shape.inner_displacement, shape.angle)
    first, last = angle[0], angle[-1]
    t = (2 * angle - first - last) / (last - first)
    back = jnp.any(~(angle[1:] > angle[:-1]), 0)
    ends = [
        jnp.min(jnp.where(back, jnp.min(angle, 0), _NOWHERE), 0),
        jnp.max(jnp.where(back, jnp.max(angle, 0), -_NOWHERE), 0),
    ]
    edges = jnp.concatenate([first, last[-1:]])
    fold = jax.lax.stop_gradient(jnp.stack(ends))
    return NormalFace(edges, power_coefficients(t, height), fold)


def height_at(face: NormalFace, angle: Float[Array, "ray #lane"]) -> Float[Array, "ray lane"]:
    """Height of the inner face along rays, folded or not [m].

    `angle`: of the rays [rad]; beyond the clamped edges, where nothing moves, a ray takes the
    height of the edge.
    """
    edges, powers = face.edges, list(face.powers)
    angle = jnp.clip(angle, edges[0], edges[-1])
    element = jnp.sum(angle[:, None] >= edges[1:-1], 1)
    table = jnp.stack([(edges[:-1] + edges[1:]) / 2, 2 / jnp.diff(edges, axis=0), *powers], -1)
    # One row of the table a ray: with lanes and elements in one axis, rows are contiguous.
    lanes = jnp.arange(edges.shape[1])
    rows = jnp.moveaxis(table, 0, 1).reshape(-1, table.shape[-1])
    picked = rows[lanes * table.shape[0] + element]
    middle, scale, *powers = jnp.moveaxis(picked, -1, 0)
    return polynomial(powers, (angle - middle) * scale)


class SectionShape(AbstractShape):
    """Samples of a deformed section."""

    samples: Profile
    clamp_reach: Lanes  # angle from a clamped edge within which stretches diverge [rad]
    growth: Growth | None = None  # of the membrane; None where it fits its seat
    # whether stretches of the outer face diverge under line loads
    resolves_loads: bool = eqx.field(static=True, default=False)

    @staticmethod
    def peak(values: Array, *companions: Array) -> tuple[Lanes, ...]:
        """Each element's samples [sample, element, lane] joined by parabolas.

        They never reach across an element's end, where solutions may have a kink. Elements are
        compared by the tops of their parabolas: two of them share the sample at their end.
        """
        row = jnp.clip(jnp.argmax(values, 0), 1, len(values) - 2)[None]

        def local(f: Array) -> tuple[Array, Array, Array]:
            f = jnp.broadcast_to(f, values.shape)
            left, middle, right = (jnp.take_along_axis(f, row + d, 0)[0] for d in (-1, 0, 1))
            return middle, (right - left) / 2, left + right - 2 * middle

        middle, slope, bend = local(values)
        curved = jnp.where(bend < 0, bend, -1.0)
        vertex = jnp.where(bend < 0, -slope / curved, jnp.sign(slope))
        x = jnp.clip(vertex, -1.0, 1.0)
        found = [middle + slope * x + bend * x**2 / 2]
        for companion in companions:
            middle, slope, bend = local(companion)
            found.append(middle + slope * x + bend * x**2 / 2)
        best = first_largest(found[0])[None]
        return tuple(jnp.take_along_axis(f, best, 0)[0] for f in found)

    @property
    def places(self) -> tuple[Array]:
        """See the base class."""
        return (self.samples.angle,)

    def inner_face(self, section: AbstractSection) -> tuple[Array, Array]:
        """See the base class."""
        profile = self.samples
        place = profile.rest + profile.inner_displacement
        angle, height = section.foot(place, profile.angle)
        return height, angle

    def _stretches(self) -> tuple[Array, Array]:
        """Hoop stretches of both faces, those next to the clamps hidden."""
        profile, reach = self.samples, self.clamp_reach
        first, last = profile.angle[0, 0] + reach, profile.angle[-1, -1] - reach
        keep = (profile.angle >= first) & (profile.angle <= last)
        samples, elements, _ = profile.angle.shape
        lowest, highest = jnp.argmax(keep, 0), samples - 1 - jnp.argmax(keep[::-1], 0)
        nearest = jnp.clip(jnp.arange(samples)[:, None, None], lowest, highest)
        seen = jnp.any(keep, 0)

        def hidden(stretch: Array) -> Array:
            kept = jnp.take_along_axis(stretch, nearest, 0)
            return jnp.where(seen, kept, stretch[:1, elements // 2, None])

        return hidden(profile.inner_stretch), hidden(profile.outer_stretch)

    def inner_stretch(self) -> Array:
        """See the base class."""
        return self._stretches()[0]

    def material_stable(self, law: AbstractLaw) -> Bool[Array, " lane"]:
        """See the base class."""
        stretch = jnp.stack(self._stretches())
        axial = jnp.ones_like(stretch)
        if self.growth is not None:
            axial = axial * jnp.exp(-self.growth.axial)
        modulus = drucker_modulus(law, stretch, axial)
        return jnp.all((modulus > 0) & (stretch > _CRUSHED), (0, 1, 2))

    def in_domain(self, law: AbstractLaw) -> Bool[Array, " lane"]:
        """See the base class."""
        inner, outer = self._stretches()
        faces = inner if self.resolves_loads else jnp.stack([inner, outer])
        reported = jnp.stack(self.stretch_range())
        stretch = jnp.concatenate([faces.reshape(-1, faces.shape[-1]), reported])
        if self.growth is None:
            return jnp.all(law.has_energy(FibreStretch(stretch**2 - 1)), 0)
        axial = -self.growth.axial
        held = HeldFibre(stretch**2 * jnp.exp(axial) - 1, axial)
        return jnp.all(law.has_energy(held), 0)


class AbstractPlaneStrain(AbstractMechanics):
    """A membrane in plane strain; sums are per unit of width.

    `angles`: of the stations from the symmetry axis [rad].
    """

    per_width: ClassVar[bool] = True
    # whether stretches of the outer face diverge under line loads on finer meshes
    resolves_loads: ClassVar[bool] = False
    angles: eqx.AbstractVar[Float[Array, "station #lane"]]

    @property
    @abc.abstractmethod
    def clamp_reach(self) -> Lanes:
        """Angle from a clamped edge within which stretches diverge on finer meshes [rad]."""

    @abc.abstractmethod
    def profile(self, q: StationVector, samples: int) -> Profile:
        """The deformed section at evenly spaced points of every element.

        `q`: unknowns of the whole arc. `samples`: intervals an element is divided in.
        """

    @abc.abstractmethod
    def at_angle(self, q: StationVector, angle: Lanes) -> Displacements:
        """How the section moves at one reference angle per lane.

        `q`: unknowns. `angle`: from the symmetry axis, within the discretised arc [rad].
        Returns displacements [2, 1, 1, lane].
        """

    @abc.abstractmethod
    def _gathered(self, q: StationVector) -> Array:
        """Displacements element by element."""

    @abc.abstractmethod
    def _face_against(self, obstacle: Obstacle, u: Array) -> AbstractContactFace:
        """The inner face against a wall, or the outer one against a body."""

    @property
    def mid_extent(self) -> Lanes:
        """Length of the mid-line [m]."""
        return self.section.size * (self.angles[-1] - self.angles[0])

    def contact_energy(self, q: StationVector, factor: Lanes | float = 1.0) -> Lanes:
        """Energy of contact per width [J/m]; see the base class."""
        u, energy = self._gathered(q), jnp.zeros_like(self.section.mean_thickness)
        if self.wall is not None:
            energy = self._face_against(self.wall, u).energy()
        for body in self.bodies:
            energy = energy + self._face_against(body.placed(factor), u).energy()
        return energy

    def touched(
        self, q: StationVector, body: PlacedBody, shift: Array | float = 0.0
    ) -> BodyContact:
        """The outer face against a body; see the base class."""
        return self._face_against(body, self._gathered(q)).touched(shift)

    def grip(self, q: StationVector, body: PlacedBody) -> Grip | None:
        """See the base class."""
        return self._face_against(body, self._gathered(q)).grip()

    def shape(self, q: StationVector) -> SectionShape:
        """The deformed section, sampled; see the base class."""
        profile = self.profile(q, SAMPLES)
        return SectionShape(profile, self.clamp_reach, self.growth, self.resolves_loads)

    def under(self, q: StationVector, loads: Sequence[LineLoad]) -> Displacements:
        """How the section moves under loads; see the base class."""
        angles = jnp.stack(jnp.broadcast_arrays(*(x.angle for x in loads)))
        at = jax.vmap(self.at_angle, (None, 0), 1)(q, angles)
        return Displacements(at.mid_displacement[:, :, 0, 0], at.inner_displacement[:, :, 0, 0])

    def face(self, q: StationVector) -> NormalFace:
        """The deformed inner face by its height over the undeformed one; see the base."""
        return normal_face(self.profile(q, INTERVALS), self.section)


def section_of(mechanics: AbstractMechanics) -> AbstractPlaneStrain:
    """The mechanics, known to be one in plane strain.

    Raises TypeError: it is three-dimensional.
    """
    if not isinstance(mechanics, AbstractPlaneStrain):
        raise TypeError(f"plane strain is needed here, not a {type(mechanics).__name__}")
    return mechanics
