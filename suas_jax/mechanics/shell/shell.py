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
from collections.abc import Callable
from typing import ClassVar, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.constitutive.base import AbstractLaw
from suas_jax.mechanics.base import (
    Assembly,
    ContactState,
    Displacements,
    Profile,
    largest,
)
from suas_jax.mechanics.section import AbstractSection
from suas_jax.mechanics.shell.contact import InnerFace
from suas_jax.mechanics.shell.ends import EndMatrices, turn_blocks, turn_matrices, turn_vector
from suas_jax.mechanics.shell.fibres import Fibres
from suas_jax.mechanics.shell.loads import Loaded, load_terms, load_work, radial, under
from suas_jax.mechanics.shell.omitted import Resultants, relaxed_energy, thinning_work
from suas_jax.mechanics.shell.points import (
    Moments,
    Points,
    element_tables,
    kinematics,
    mix,
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
from suas_jax.numerics.array_types import Diagonal, Lanes, OffDiagonal, StationVector
from suas_jax.numerics.block_tridiagonal import BlockTridiagonal
from suas_jax.numerics.hermite import hermite
from suas_jax.numerics.quadrature import gauss_legendre
from suas_jax.skin.geometry import SkinGeometry, outward, tangent
from suas_jax.skin.loads import LoadPoints
from suas_jax.skin.wall import Wall


class Shell(AbstractSection):
    """Discretised lumped shell, optionally the left half of a symmetric one.

    The unknowns of a station are the displacement (x, y) and its derivative by arc
    length, in Cartesian components except at the two ends, where they are tangential and
    normal so that a clamp is a mask: position and normal fixed, stretch free.

    Attributes:
        law: the membrane's material.
        mid_radius: radius of the undeformed mid-surface [m].
        thickness: [m].
        angles: of the stations from the symmetry axis [rad].
        points: the line loads as points on the outer face, per width [N/m].
        film_volume: see the base class.
        wall: see the base class.
        symmetric: whether the last station is the crown of a symmetric arch.
        gauss: quadrature points along an element.
        layers: quadrature points through the thickness.
        equilibrium: see `around`; None for faces of the unknowns' own.
    """

    corrected: ClassVar[bool] = True
    law: AbstractLaw
    mid_radius: Lanes
    thickness: Lanes
    angles: Float[Array, "station #lane"]
    points: LoadPoints
    film_volume: Lanes
    wall: Wall | None
    symmetric: bool = eqx.field(static=True)
    gauss: int = eqx.field(static=True, default=3)
    layers: int = eqx.field(static=True, default=3)
    equilibrium: StationVector | None = None

    @classmethod
    def build(
        cls,
        geometry: SkinGeometry,
        law: AbstractLaw,
        angles: Float[Array, "station #lane"],
        points: LoadPoints,
        *,
        symmetric: bool,
        wall: Wall | None = None,
    ) -> "Shell":
        """Discretise a skin.

        Args:
            geometry: dimensions, with a lane axis.
            law: material, its constants with a lane axis.
            angles: stations from clamp to clamp, or from clamp to crown.
            points: loads on those elements.
            symmetric: whether the last station is the crown of a symmetric arch.
            wall: what holds the inner face; None for nothing.
        """
        return cls(
            law=law,
            mid_radius=geometry.mid_radius,
            thickness=geometry.thickness,
            angles=angles,
            points=points,
            film_volume=geometry.film_area / (2 if symmetric else 1),
            wall=wall,
            symmetric=symmetric,
        )

    @property
    def length_scale(self) -> Lanes:
        """The thickness [m]."""
        return self.thickness

    @property
    def clamp_reach(self) -> Lanes:
        """Zero: the shell's stretches are bounded [rad]."""
        return jnp.zeros_like(self.thickness)

    @property
    def lengths(self) -> Float[Array, "element #lane"]:
        """Reference lengths of the elements along the mid-surface [m]."""
        return self.mid_radius * (self.angles[1:] - self.angles[:-1])

    def rest(self) -> StationVector:
        """Zero displacement."""
        return jnp.zeros((4, *self.angles.shape), self.angles.dtype)

    def _free(self) -> np.ndarray:
        """Mask of the unknowns that may move [dof, station, 1]."""
        free = np.ones((4, self.angles.shape[0], 1))
        clamp, crown = [[0.0], [0.0], [1.0], [0.0]], [[0.0], [1.0], [1.0], [0.0]]
        free[:, 0] = clamp
        free[:, -1] = crown if self.symmetric else clamp
        return free

    def unknowns(self) -> int:
        """Free displacements and slopes."""
        return int(self._free().sum())

    def _ends(self) -> EndMatrices:
        return turn_matrices(tangent(jnp.stack([self.angles[0], self.angles[-1]])))

    def _scale(self) -> Float[Array, "4 1 element #lane"]:
        """Factors that turn element unknowns into values and slopes by xi."""
        one = jnp.ones_like(self.lengths)
        return jnp.stack([one, self.lengths, one, self.lengths])[:, None]

    def _gather(self, q: StationVector) -> Float[Array, "4 2 element lane"]:
        """Element unknowns [shape, component]; slopes times the element's length."""
        q = turn_vector(self._ends(), q)
        pairs = jnp.stack([q[:, :-1], q[:, 1:]])
        return pairs.reshape(4, 2, *pairs.shape[2:]) * self._scale()

    def _scatter(self, f: Float[Array, "4 2 element lane"]) -> StationVector:
        """Sum element vectors into stations: the transpose of `_gather`, masked."""
        left, right = (f * self._scale()).reshape(2, 4, *f.shape[2:])
        free = self._free()[:, [0, -1]]
        return turn_vector(jnp.swapaxes(self._ends(), 0, 1) * free[:, None], _sum(left, right))

    def _reference(self, xi: np.ndarray) -> tuple[Array, Array, Array]:
        """Reference angle, tangent and normal at local coordinates [xi, element, lane]."""
        start, span = self.angles[:-1], self.angles[1:] - self.angles[:-1]
        angle = start + xi[:, None, None] * span
        return angle, tangent(angle), outward(angle)

    def _points(
        self, xi: np.ndarray, d: Float[Array, "point*order component element lane"]
    ) -> Points:
        """Kinematics at local coordinates from displacement derivatives by xi there."""
        _, t, n = self._reference(xi)
        d = d.reshape(len(xi), 2, *d.shape[1:])
        return kinematics(d, t, n, self.mid_radius, self.lengths)

    @property
    def fibres(self) -> Fibres:
        """The material through the thickness."""
        return Fibres(self.law, self.mid_radius, self.thickness, self.layers)

    def strain_energy(self, q: StationVector) -> Lanes:
        """Strain energy per width [J/m]."""
        tables = element_tables(self.gauss)
        points = self._points(tables.xi, mix(tables.derivatives, self._gather(q)))
        density = self.fibres.energy(points.stretch, points.curvature)
        weights = tables.weights[:, None, None] * self.lengths
        return jnp.sum(weights * density, (0, 1))

    def _volume(self, qe: Array, product: Array) -> tuple[Lanes, Array]:
        """Enclosed volume less rest, and its gradient by the element unknowns.

        The area under the mid-line is a quadratic form; the area under the inner face
        differs from it by the membrane's own lower half, which incompressibility keeps.

        Args:
            qe: element unknowns.
            product: the antisymmetric area matrix times them.
        """
        x, w = gauss_legendre(4)
        _, _, n = self._reference(x)
        shapes = np.stack(hermite(x), 1) * w[:, None]
        linear = jnp.einsum("gn,cgel->ncel", shapes, n) * self.lengths
        quadratic = product[:, ::-1] * np.array([1.0, -1.0])[:, None, None]
        return jnp.sum(qe * (linear + quadratic / 2), (0, 1, 2)), linear + quadratic

    def _resultants(self, points: Points, first: tuple[Array, Array]) -> Resultants:
        size = jnp.sqrt(1 + points.stretch)
        return Resultants(2 * size * first[0], size * first[1])

    def _relaxed_energy(self, at: Resultants) -> Lanes:
        tables, modulus = element_tables(self.gauss), self.law.shear_modulus
        gauss = tables.xi, tables.weights
        clamped = True, not self.symmetric
        return relaxed_energy(at, *gauss, self.lengths, self.thickness, modulus, clamped)

    def _omitted_energy(self, at: Resultants, factor: Lanes) -> Lanes:
        tables, modulus = element_tables(self.gauss), self.law.shear_modulus
        inward = factor * radial(self.points, self.angles)
        gauss = tables.xi, tables.weights
        work = thinning_work(at, *gauss, self.points, inward, self.thickness, modulus)
        return self._relaxed_energy(at) + work

    def _at_gauss_points(self, q: StationVector) -> tuple[Points, Moments]:
        tables = element_tables(self.gauss)
        points = self._points(tables.xi, mix(tables.derivatives, self._gather(q)))
        return points, self.fibres.moments(points.stretch, points.curvature)

    def omitted_energy(self, q: StationVector, factor: Lanes) -> Lanes:
        """Energy of shear, of loads where the membrane thins, and of clamped faces [J/m].

        Args:
            q: unknowns.
            factor: on the loads.
        """
        points, moments = self._at_gauss_points(q)
        return self._omitted_energy(self._resultants(points, moments.first), factor)

    def omitted_gradient(self, q: StationVector, factor: Lanes) -> StationVector:
        """Derivative of the omitted energy by the unknowns that are free; see the base.

        The derivative by the resultants, then the chain rule that makes forces of stresses.
        """
        tables = element_tables(self.gauss)
        points, moments = self._at_gauss_points(q)
        at = self._resultants(points, moments.first)
        by = jax.grad(lambda at: jnp.sum(self._omitted_energy(at, factor)))(at)
        size = jnp.sqrt(1 + points.stretch)
        (by_a, by_b), (by_aa, by_ab, by_bb) = moments
        first = (
            by.normal * (2 * size * by_aa + by_a / size)
            + by.moment * (size * by_ab + by_b / (2 * size)),
            by.normal * 2 * size * by_ab + by.moment * size * by_bb,
        )
        # Sums over Gauss points weigh what they add up; the derivative is not a density.
        shares = tables.weights[:, None, None] * self.lengths
        density = first[0] / shares, first[1] / shares
        stress = point_stress(points, density, self.mid_radius, self.lengths)
        return self._scatter(mix(tables.force, stress.reshape(-1, *stress.shape[2:])))

    def stored_energy(self, q: StationVector) -> Lanes:
        """Strain energy of the state that is reported, to first order; see the base class."""
        root = self.equilibrium
        if root is None:
            return self.strain_energy(q)
        stored, more = jax.jvp(self.strain_energy, (root,), (q - root,))
        points, moments = self._at_gauss_points(root)
        return stored + more - self._relaxed_energy(self._resultants(points, moments.first))

    def around(self, equilibrium: StationVector) -> Self:
        """The same shell, its faces recovered around an equilibrium.

        A correction of its unknowns then moves and turns the normals there but does not bend
        them: beneath loads and at clamps the mid-line of a membrane that shears has kinks,
        which are no strain.
        """
        return dataclasses.replace(self, equilibrium=equilibrium)

    def volume_change(self, q: StationVector) -> Lanes:
        """Enclosed volume less its value at rest, per width [m^2]."""
        qe = self._gather(q)
        return self._volume(qe, mix(element_tables(self.gauss).area, qe))[0]

    def work(self, q: StationVector) -> Lanes:
        """Work of the loads, which act at the rigid-normal point r + (t/2) n [J/m]."""
        return load_work(self.points, self._loaded(self._gather(q)), self.thickness)

    def _inner_face(self, qe: Array, wall: Wall) -> InnerFace:
        return InnerFace(wall, self.thickness, self.mid_radius, self.angles, qe)

    def contact_energy(self, q: StationVector) -> Lanes:
        """Energy of contact per width [J/m]; see the base class."""
        if self.wall is None:
            return jnp.zeros_like(self.thickness)
        return self._inner_face(self._gather(q), self.wall).energy()

    def contact(self, q: StationVector, wall: Wall) -> ContactState:
        """The inner face against a wall; see the base class."""
        own = q if self.equilibrium is None else self.equilibrium
        face = self._inner_face(self._gather(own), wall)
        if self.equilibrium is None:
            return face.state()
        return face.state(self._inner_face(self._gather(q - self.equilibrium), wall).inputs)

    def _loaded(self, qe: Array) -> Loaded:
        return under(self.points, qe, self.angles, self.mid_radius)

    def assemble(self, q: StationVector, pressure: Lanes, factor: Lanes) -> Assembly:
        """Residual, tangent and border at a trial state; see the base class."""
        tables = element_tables(self.gauss)
        qe = self._gather(q)
        rows = mix(np.concatenate([tables.derivatives, tables.area]), qe)
        points = self._points(tables.xi, rows[:-4])
        moments = self.fibres.moments(points.stretch, points.curvature)
        stress, tangents = point_terms(points, moments, self.mid_radius, self.lengths)
        internal = mix(tables.force, stress.reshape(-1, *stress.shape[2:]))
        stiffness = mix(tables.stiffness, tangents.reshape(-1, *tangents.shape[3:]))
        stiffness = _full(stiffness.reshape(4, 4, *stiffness.shape[1:]))
        if self.wall is not None:
            push, spring = self._inner_face(qe, self.wall).element_terms()
            internal, stiffness = internal + push, stiffness + spring
        volume, gradient = self._volume(qe, rows[-4:])
        load, load_stiffness = load_terms(self.points, self._loaded(qe), self.thickness)
        load = jnp.broadcast_to(load, qe.shape)
        rotation = np.array([[0.0, 1.0], [-1.0, 0.0]])
        coupling = np.einsum("nm,ce->nmce", tables.area, rotation)[..., None, None]
        diagonal, upper = self._blocks(
            stiffness - pressure * coupling - factor * load_stiffness
        )
        return Assembly(
            self._scatter(internal - pressure * gradient - factor * load),
            BlockTridiagonal(diagonal, upper),
            self._scatter(gradient),
            self._scatter(load),
            volume,
        )

    def _blocks(self, k: Float[Array, "4 4 2 2 element lane"]) -> tuple[Diagonal, OffDiagonal]:
        """Element stiffness [shape, shape, component, component] to station blocks."""
        scale = self._scale()[..., None, None, :, :][:, 0]
        k = k * (scale[:, None] * scale[None])
        # [end, end, 4, 4]
        k = k.reshape(2, 2, 2, 2, *k.shape[2:]).transpose(0, 2, 1, 4, 3, 5, 6, 7)
        k = k.reshape(2, 2, 4, 4, *k.shape[6:])
        diagonal = _sum(k[0, 0], k[1, 1])
        return turn_blocks(diagonal, k[0, 1], self._ends(), self._free()[:, [0, -1]])

    def profile(self, q: StationVector, samples: int) -> Profile:
        """The deformed section at evenly spaced points; see the base class."""
        return self._recovered(q, lambda qe: sampled(qe, self.angles, self.mid_radius, samples))

    def _recovered(self, q: StationVector, line_of: Callable[[Array], MidLine]) -> Profile:
        """The section around the mid-line that element unknowns describe."""
        own = q if self.equilibrium is None else self.equilibrium
        line = line_of(self._gather(own))
        shape = recovered(line, self.mid_radius, self.thickness, self.fibres.energy)
        if self.equilibrium is None:
            return shape
        change = line_of(self._gather(q - self.equilibrium))
        return shifted(shape, line, change, self.thickness)

    def at_angle(self, q: StationVector, angle: Lanes) -> Displacements:
        """How the section moves at a reference angle; see the base class."""
        shape = self._recovered(q, lambda qe: at(qe, self.angles, self.mid_radius, angle))
        return Displacements(shape.mid_displacement, shape.inner_displacement)

    def mirrored(self, q: StationVector) -> StationVector:
        """Unknowns of the whole arc; see the base class."""
        return mirrored(q)

    def to_comparison_mesh(self, q: StationVector) -> StationVector:
        """The same deformation on elements half as long; see the base class."""
        return prolonged(q, self._gather(q), self.lengths)

    @property
    def error_share(self) -> float:
        """Order four where the mesh resolves all layers, less on the coarsest meshes."""
        return 6 / 5

    def displacement_size(self, q: StationVector) -> Lanes:
        """Largest component of a station's displacement [m]."""
        return largest(q[:2])


def _full(k: Float[Array, "4 4 3 element lane"]) -> Float[Array, "4 4 2 2 element lane"]:
    """Component blocks of a symmetric element matrix from (xx, yy, xy)."""
    xx, yy, xy = k[:, :, 0], k[:, :, 1], k[:, :, 2]
    full = jnp.stack([xx, xy, jnp.swapaxes(xy, 0, 1), yy], 2)
    return full.reshape(4, 4, 2, 2, *k.shape[3:])


def _sum(left: Array, right: Array) -> Array:
    """Sum what elements give to their left and their right stations."""
    rest = [(0, 0)] * (left.ndim - 2)
    return jnp.pad(left, [*rest, (0, 1), (0, 0)]) + jnp.pad(right, [*rest, (1, 0), (0, 0)])
