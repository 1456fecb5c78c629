"""The lumped thin shell: plane strain, incompressible, normals stay normal.

With mid-surface stretch l and current curvature k, incompressibility gives the thickness
change in closed form: a fibre at reference offset Z from a mid-surface of radius R has
the squared stretch ::

    lambda^2 = (a + 2 m c / a) / (1 + Z/R)^2,     m = Z + Z^2 / (2 R)

with a = |r'|^2 = l^2 and c = x'' y' - x' y'' = k l^3 of the mid-line r(s), so that the
strain energy per length is a function of a and c alone. Strains are measured from rest,
A = a - 1 and b = c/a - 1/R, without cancellation.

Interpolation is cubic Hermite in the Cartesian displacement over exact reference
geometry: the undeformed state is stress-free to the last digit.
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import ClassVar, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.constitutive.base import AbstractLaw
from suas_jax.constitutive.relaxation import Response
from suas_jax.mechanics.base import Assembly, Displacements, Profile, largest
from suas_jax.mechanics.contact.face import ContactState, Strip, by_travel
from suas_jax.mechanics.section import AbstractPlaneStrain
from suas_jax.mechanics.shell.contact import ContactFace
from suas_jax.mechanics.shell.elements import Elements, full_blocks
from suas_jax.mechanics.shell.loads import Loaded, load_terms, load_work, places, under
from suas_jax.mechanics.shell.omitted import (
    LinesOverElements,
    Resultants,
    indentation,
    relaxed_energy,
    resultants,
    resultants_transposed,
    strip,
    thinning,
)
from suas_jax.mechanics.shell.points import (
    Fibres,
    Moments,
    Points,
    Tables,
    element_tables,
    kinematics,
    point_stress,
    point_terms,
)
from suas_jax.mechanics.shell.shape import (
    MidLine,
    at,
    mirrored,
    prolonged,
    recovered,
    sampled,
    shifted,
)
from suas_jax.numerics.array_types import Lanes, StationVector
from suas_jax.numerics.block_tridiagonal import BlockTridiagonal
from suas_jax.numerics.lanes import mix
from suas_jax.skin.body import Body, PlacedBody
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.loads import LoadPoints
from suas_jax.skin.prestress import Growth
from suas_jax.skin.section import AbstractSection, Frame
from suas_jax.skin.wall import Obstacle, Wall


class Shell(AbstractPlaneStrain):
    """Discretised lumped shell, optionally the left half of a symmetric one.

    The unknowns of a station are the displacement (x, y) and its derivative by arc
    length, in Cartesian components except at the two ends, where they are tangential and
    normal so that a clamp is a mask: position and normal fixed, stretch free.
    """

    corrected: ClassVar[bool] = True
    # order four where the mesh resolves all layers, less on the coarsest meshes
    error_shares: ClassVar[tuple[float, ...]] = (6 / 5,)
    law: AbstractLaw  # the membrane's material
    section: AbstractSection  # the undeformed membrane
    angles: Float[Array, "station #lane"]  # of the stations from the symmetry axis [rad]
    elements: Elements  # between the stations
    points: LoadPoints  # the line loads as points on the outer face, per width [N/m]
    film_volume: Lanes
    wall: Wall | None
    growth: Growth | None
    bodies: tuple[Body, ...]
    gauss: int = eqx.field(static=True, default=3)  # quadrature points along an element
    layers: int = eqx.field(static=True, default=3)  # quadrature points through the thickness
    # see `around`; None for faces of the unknowns' own
    equilibrium: StationVector | None = None
    # of a material with a past at the Gauss points, see `Fibres`; None of an elastic one
    response: Response | None = None

    @classmethod
    def build(
        cls,
        geometry: SkinGeometry,  # dimensions, with a lane axis
        law: AbstractLaw,  # material, its constants with a lane axis
        angles: Float[Array, "station #lane"],
        points: LoadPoints,  # loads on the elements between the stations
        *,
        symmetric: bool,  # whether the last station is the crown of a symmetric arch
        wall: Wall | None = None,  # what holds the inner face; None for nothing
    ) -> "Shell":
        """Discretise a skin. `angles`: stations from clamp to clamp, or from clamp to crown."""
        return cls(
            law=law,
            section=geometry.section,
            angles=angles,
            elements=Elements.between(angles, geometry.section, symmetric=symmetric),
            points=points,
            film_volume=geometry.film_area / (2 if symmetric else 1),
            wall=wall,
            bodies=(),
            growth=geometry.growth,
        )

    @property
    def clamp_reach(self) -> Lanes:
        """Zero: the shell's stretches are bounded [rad]."""
        return jnp.zeros_like(self.section.mean_thickness)

    def rest(self) -> StationVector:
        """Zero displacement."""
        return jnp.zeros((4, *self.angles.shape), self.angles.dtype)

    def unknowns(self) -> int:
        """Free displacements and slopes."""
        return int(self.free.sum())

    @property
    def free(self) -> np.ndarray:
        """Mask of the unknowns that may move, of the shape of a station vector."""
        return self.elements.free()

    def _points(
        self, xi: np.ndarray, d: Float[Array, "point*order component element lane"]
    ) -> Points:
        """Kinematics at local coordinates from displacement derivatives by xi there."""
        d, lengths = d.reshape(len(xi), 2, *d.shape[1:]), self.elements.lengths
        u1, u2 = d[:, 0] / lengths, d[:, 1] / lengths**2
        at = self.elements.reference(xi)
        return kinematics((u1[:, 0], u1[:, 1]), (u2[:, 0], u2[:, 1]), at)

    @property
    def _tables(self) -> Tables:
        return element_tables(self.gauss)

    def _kinematics(self, q: StationVector) -> Points:
        """At the Gauss points."""
        tables = self._tables
        return self._points(tables.xi, mix(tables.derivatives, self.elements.gather(q)))

    def fibres(self, at: Frame) -> Fibres:
        """The material through the thickness."""
        return Fibres(self.law, at.curvature, at.thickness, self.layers, growth=self.growth)

    @property
    def _material(self) -> Fibres:
        """At the Gauss points."""
        return dataclasses.replace(self.fibres(self._at_gauss), response=self.response)

    @property
    def _shear_modulus(self) -> Lanes:
        modulus = self.law.shear_modulus
        return modulus if self.response is None else self.response.share * modulus

    def deviator(self, q: StationVector) -> Float[Array, "2 layer gauss element lane"]:
        """Instantaneous stress that the material remembers; see `Fibres.deviator`."""
        points = self._kinematics(q)
        return self._material.deviator(points.stretch, points.curvature)

    @property
    def _at_gauss(self) -> Frame:
        return self.elements.reference(self._tables.xi)

    def strain_energy(self, q: StationVector) -> Lanes:
        """Strain energy per width [J/m]."""
        points = self._kinematics(q)
        density = self._material.energy(points.stretch, points.curvature)
        weights = self._tables.weights[:, None, None] * self.elements.lengths
        return jnp.sum(weights * density, (0, 1))

    def _lines(self, at: Resultants) -> list[LinesOverElements]:
        return at.lines(self._tables.xi, self._tables.weights)

    def _relaxed_energy(self, at: Resultants) -> Lanes:
        lengths, thickness = self.elements.lengths, self._at_gauss.thickness
        material = self._shear_modulus, (True, not self.elements.symmetric), self.growth
        return relaxed_energy(self._lines(at), lengths, thickness, *material)

    def _omitted_energy(self, at: Resultants, factor: Lanes) -> Lanes:
        loaded = self.section.frame(places(self.points, self.angles))
        inward = -factor * jnp.sum(self.points.force * loaded.normal, 0)
        normal, moment = (line.at_points(self.points) for line in self._lines(at))
        thinned = thinning(normal, moment, loaded.thickness, self._shear_modulus)
        return self._relaxed_energy(at) + jnp.sum(inward * thinned, 0)

    def _at_gauss_points(self, q: StationVector) -> tuple[Points, Moments]:
        points = self._kinematics(q)
        return points, self._material.moments(points.stretch, points.curvature)

    def omitted_energy(self, q: StationVector, factor: Lanes) -> Lanes:
        """Energy of shear, of loads where the membrane thins, and of clamped faces [J/m].

        `factor`: on the loads.
        """
        points, moments = self._at_gauss_points(q)
        return self._omitted_energy(resultants(points, moments.first), factor)

    def omitted_gradient(self, q: StationVector, factor: Lanes) -> StationVector:
        """Derivative of the omitted energy by the unknowns that are free; see the base.

        The derivative by the resultants, then the chain rule that makes forces of stresses.
        """
        tables = self._tables
        points, moments = self._at_gauss_points(q)
        at = resultants(points, moments.first)
        qe = self.elements.gather(q)
        faces = [self._face_against(body.placed(factor), qe) for body in self.bodies]

        def energy(at: Resultants) -> Array:
            work = [jnp.sum(f.shares(f.inputs) * self._thinned(f, at)) for f in faces]
            return functools.reduce(jnp.add, work, jnp.sum(self._omitted_energy(at, factor)))

        by = jax.grad(energy)(at)
        first = resultants_transposed(by, points, moments)
        # Sums over Gauss points weigh what they add up; the derivative is not a density.
        shares = tables.weights[:, None, None] * self.elements.lengths
        density = first[0] / shares, first[1] / shares
        curvature, lengths = self._at_gauss.curvature, self.elements.lengths
        stress = point_stress(points, density, curvature, lengths)
        force = mix(tables.force, stress.reshape(-1, *stress.shape[2:]))
        for face, body in zip(faces, self.bodies, strict=True):
            shift = self._thinned(face, at)
            shift = shift + self._indentation(face, points, body.placed(factor))
            force = force + face.pulled(jnp.broadcast_arrays(shift, face.area)[0])
        return self.elements.scatter(force)

    def stored_energy(self, q: StationVector) -> Lanes:
        """Strain energy of the state that is reported, to first order; see the base class."""
        root = self.equilibrium
        if root is None:
            return self.strain_energy(q)
        stored, more = jax.jvp(self.strain_energy, (root,), (q - root,))
        points, moments = self._at_gauss_points(root)
        return stored + more - self._relaxed_energy(resultants(points, moments.first))

    def around(self, equilibrium: StationVector) -> Self:
        """The same shell, its faces recovered around an equilibrium.

        A correction of its unknowns then moves and turns the normals there but does not bend
        them: beneath loads and at clamps the mid-line of a membrane that shears has kinks,
        which are not strains.
        """
        return dataclasses.replace(self, equilibrium=equilibrium)

    def with_more_fibres(self) -> Self:
        """See the base class."""
        return dataclasses.replace(self, layers=2 * self.layers)

    def volume_change(self, q: StationVector) -> Lanes:
        """Enclosed volume less its value at rest, per width [m^2]."""
        qe = self.elements.gather(q)
        return self._enclosed(qe, mix(self._tables.area, qe))[0]

    def _enclosed(self, qe: Array, product: Array) -> tuple[Lanes, Array]:
        """Enclosed volume less its value at rest, and its gradient; see `Elements.volume`."""
        volume, gradient = self.elements.volume(qe, product)
        if self.growth is not None:  # the lower half of a membrane that grows takes room
            at, weights = self._at_gauss, self._tables.weights
            half = at.thickness / 2 * (1 - at.thickness * at.curvature / 4)
            lower = jnp.sum(weights[:, None, None] * self.elements.lengths * half, (0, 1))
            volume = volume - (self.growth.volume - 1) * lower
        return volume, gradient

    def work(self, q: StationVector) -> Lanes:
        """Work of the loads, which act at the rigid-normal point r + (t/2) n [J/m]."""
        return load_work(self.points, self._loaded(self.elements.gather(q)))

    def _gathered(self, q: StationVector) -> Array:
        return self.elements.gather(q)

    def _face_against(self, obstacle: Obstacle, u: Array) -> ContactFace:
        spans = self.angles[:-1], self.angles[1:] - self.angles[:-1]
        return ContactFace(obstacle, self.section, spans, u, self.growth)

    def gap_shift(self, q: StationVector, body: PlacedBody) -> Array:
        """By thinning, and by indentation beneath the body; see the base class."""
        points, moments = self._at_gauss_points(q)
        face = self._face_against(body, self.elements.gather(q))
        thinned = self._thinned(face, resultants(points, moments.first))
        return thinned + self._indentation(face, points, body)

    def strip(self, q: StationVector, body: PlacedBody) -> Strip:
        """See the base class."""
        points, _ = self._at_gauss_points(q)
        return self._strip(self._face_against(body, self.elements.gather(q)), points, body)

    def _strip(self, face: ContactFace, points: Points, body: PlacedBody) -> Strip:
        tables = self._tables
        bend = points.curvature + self._at_gauss.curvature
        line = LinesOverElements.through(bend, tables.xi, tables.weights)
        return strip(face, line.along(face.xi), body, self._shear_modulus)

    def _indentation(self, face: ContactFace, points: Points, body: PlacedBody) -> Lanes:
        touched = self._strip(face, points, body)
        return indentation(face, touched, self._shear_modulus)

    def _thinned(self, face: ContactFace, at: Resultants) -> Array:
        normal, moment = (line.along(face.xi) for line in self._lines(at))
        return thinning(normal, moment, face.at.thickness, self._shear_modulus)

    def contact(self, q: StationVector, wall: Wall) -> ContactState:
        """The inner face against a wall; see the base class."""
        own = q if self.equilibrium is None else self.equilibrium
        face = self._face_against(wall, self.elements.gather(own))
        if self.equilibrium is None:
            return face.state()
        change = self._face_against(wall, self.elements.gather(q - self.equilibrium))
        return face.state(face.carried(change.inputs))

    def _loaded(self, qe: Array) -> Loaded:
        return under(self.points, qe, self.angles, self.section)

    def assemble(self, q: StationVector, pressure: Lanes, factor: Lanes) -> Assembly:
        """Residual, tangent and border at a trial state; see the base class."""
        tables = self._tables
        qe = self.elements.gather(q)
        rows = mix(np.concatenate([tables.derivatives, tables.area]), qe)
        points = self._points(tables.xi, rows[:-4])
        at = self._at_gauss
        moments = self._material.moments(points.stretch, points.curvature)
        stress, tangents = point_terms(points, moments, at.curvature, self.elements.lengths)
        internal = mix(tables.force, stress.reshape(-1, *stress.shape[2:]))
        stiffness = mix(tables.stiffness, tangents.reshape(-1, *tangents.shape[3:]))
        stiffness = full_blocks(stiffness.reshape(4, 4, *stiffness.shape[1:]))
        if self.wall is not None:
            forces, matrices = self._face_against(self.wall, qe).assembled()
            internal, stiffness = internal + forces, stiffness + matrices
        contact, travel = jnp.zeros_like(qe), jnp.zeros_like(qe)
        for body in self.bodies:
            face = self._face_against(body.placed(factor), qe)
            terms = face.terms()
            pushes, pulls = face.forces(terms.force), face.forces(by_travel(terms, body))
            contact, travel = contact + pushes, travel - pulls
            stiffness = stiffness + face.matrix(terms)
        if self.bodies:
            internal = internal + contact
        volume, gradient = self._enclosed(qe, rows[-4:])
        load, load_stiffness = load_terms(self.points, self._loaded(qe))
        load = jnp.broadcast_to(load, qe.shape)
        rotation = np.array([[0.0, 1.0], [-1.0, 0.0]])
        coupling = np.einsum("nm,ce->nmce", tables.area, rotation)[..., None, None]
        diagonal, upper = self.elements.blocks(
            stiffness - pressure * coupling - factor * load_stiffness
        )
        return Assembly(
            self.elements.scatter(internal - pressure * gradient - factor * load),
            BlockTridiagonal(diagonal, upper),
            self.elements.scatter(gradient),
            self.elements.scatter(load),
            volume,
            *(self.elements.scatter(x) for x in (travel, contact) if self.bodies),
        )

    def imbalance(
        self, q: StationVector, pressure: Lanes, factor: Lanes
    ) -> tuple[StationVector, Lanes]:
        """Of all elements, whether they touch or not; see the base class."""
        free = self.with_wall(None).assemble(q, pressure, factor)
        if self.wall is None:
            return free.residual, free.volume_change
        pushes = self._face_against(self.wall, self.elements.gather(q)).push()
        return free.residual + self.elements.scatter(pushes), free.volume_change

    def profile(self, q: StationVector, samples: int) -> Profile:
        """The deformed section at evenly spaced points; see the base class."""
        return self._recovered(q, lambda qe: sampled(qe, self.angles, self.section, samples))

    def energy_density(self, q: StationVector, samples: int) -> Float[Array, "*point"]:
        """Strain energy per volume where `profile` samples, mean over the thickness [J/m^3]."""
        own = q if self.equilibrium is None else self.equilibrium
        line = sampled(self.elements.gather(own), self.angles, self.section, samples)
        _, stretch, curvature = kinematics(line.u1, line.u2, line.at)
        return self.fibres(line.at).energy(stretch, curvature) / line.at.thickness

    def _recovered(self, q: StationVector, line_of: Callable[[Array], MidLine]) -> Profile:
        """The section around the mid-line that element unknowns describe."""
        own = q if self.equilibrium is None else self.equilibrium
        line = line_of(self.elements.gather(own))
        shape = recovered(line, self.section, self.growth)
        if self.equilibrium is None:
            return shape
        change = line_of(self.elements.gather(q - self.equilibrium))
        return shifted(shape, line, change)

    def at_angle(self, q: StationVector, angle: Lanes) -> Displacements:
        """How the section moves at a reference angle; see the base class."""
        shape = self._recovered(q, lambda qe: at(qe, self.angles, self.section, angle))
        return Displacements(shape.mid_displacement, shape.inner_displacement)

    def mirrored(self, q: StationVector) -> StationVector:
        """Unknowns of the whole arc; see the base class."""
        return mirrored(q)

    def to_comparison_mesh(self, q: StationVector, counts: tuple[int, ...]) -> StationVector:
        """The same deformation on elements half as long; see the base class."""
        del counts  # there is one
        return prolonged(q, self.elements.gather(q), self.elements.lengths)

    def displacement_size(self, q: StationVector) -> Lanes:
        """Largest component of a station's displacement [m]."""
        return largest(q[:2])
