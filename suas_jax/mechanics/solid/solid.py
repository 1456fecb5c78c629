"""The solid: total-Lagrangian finite elements in plane strain, exactly incompressible.

The potential is stationary in the displacements u and the pressure p::

    Pi(u, p) = integral of Psi(F) + p (J - 1) dV - (oil pressure) dV_enclosed - load work

Biquadratic displacement and linear discontinuous pressure (Q9/P1) on a structured mesh,
clamped edge to clamped edge and inner to outer face. The oil's pressure follows the inner
face; loads are dead forces on the outer one.
"""

import dataclasses
import functools
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from suas_jax.constitutive.base import AbstractLaw
from suas_jax.constitutive.deformation import PlaneStrain
from suas_jax.constitutive.relaxation import Response
from suas_jax.mechanics.base import Assembly, Displacements, Profile, largest
from suas_jax.mechanics.contact.face import ContactState, by_travel
from suas_jax.mechanics.section import AbstractPlaneStrain
from suas_jax.mechanics.solid.element import TABLES
from suas_jax.mechanics.solid.faces import ContactFace, enclosed_volume, follower, load_vector
from suas_jax.mechanics.solid.layout import FaceValues, Layout, NodeValues
from suas_jax.mechanics.solid.points import (
    Grid,
    Kinematics,
    kinematics,
    point_terms,
    remembered_stress,
    rest_energy,
)
from suas_jax.mechanics.solid.shape import (
    displacements,
    face_stretch,
    joined_across,
    joined_along,
    mirrored,
    section,
)
from suas_jax.mechanics.solid.tangent import ElementTangent
from suas_jax.numerics.array_types import Lanes, StationVector
from suas_jax.numerics.lanes import mix
from suas_jax.skin.body import Body
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.loads import LoadPoints
from suas_jax.skin.prestress import Growth
from suas_jax.skin.section import AbstractSection
from suas_jax.skin.wall import Obstacle, Wall

# Penalty on an element's change of volume in shear moduli; see `ElementTangent`.
_PENALTY = 10.0


class Solid(AbstractPlaneStrain):
    """Discretised continuum, optionally the left half of a symmetric one."""

    resolves_loads: ClassVar[bool] = True
    law: AbstractLaw  # the membrane's material
    section: AbstractSection  # the undeformed membrane
    angles: Float[Array, "station #lane"]  # of the stations from the symmetry axis [rad]
    # positions of the stations' nodes, inner face first [m]
    stations: Float[Array, "2 node station lane"]
    # positions of the nodes half-way between stations [m]
    middles: Float[Array, "2 node element lane"]
    grid: Grid  # geometry at the quadrature points
    load: StationVector  # load vector at unit factor, per width [N/m]
    film_volume: Lanes
    wall: Wall | None
    growth: Growth | None  # see the base class; the grid knows it
    bodies: tuple[Body, ...]
    layers: int = eqx.field(static=True)  # elements through the thickness
    # whether the last station is the crown of a symmetric arch
    symmetric: bool = eqx.field(static=True)
    # of a material with a past at the quadrature points, its rest by reference coordinates (XX,
    # YY, XY); None of an elastic one
    response: Response | None = None

    @classmethod
    def build(
        cls,
        geometry: SkinGeometry,  # dimensions, with a lane axis
        law: AbstractLaw,  # material, its constants with a lane axis
        angles: Float[Array, "station #lane"],
        points: LoadPoints,  # loads on the elements between the stations
        *,
        layers: int,  # elements through the thickness
        symmetric: bool,  # whether the last station is the crown of a symmetric arch
        wall: Wall | None = None,  # what holds the inner face; None for nothing
    ) -> "Solid":
        """Discretise a skin. `angles`: stations from clamp to clamp, or from clamp to crown."""
        layout = Layout(angles.shape[0] - 1, layers)

        def nodes(angles: Array) -> Float[Array, "2 node angle lane"]:
            at = geometry.section.frame(angles)
            height = (layout.heights[:, None, None] - 0.5) * at.thickness
            middle = geometry.section.mid_line(angles)[:, None]
            return middle + height * at.normal[:, None]

        stations, middles = nodes(angles), nodes((angles[1:] + angles[:-1]) / 2)
        solid = cls(
            law=law,
            section=geometry.section,
            angles=angles,
            stations=stations,
            middles=middles,
            grid=Grid.of(layout.corners(stations, middles)),
            load=load_vector(layout, points, layout.ends(symmetric)),
            film_volume=geometry.film_area / (2 if symmetric else 1),
            wall=wall,
            bodies=(),
            layers=layers,
            symmetric=symmetric,
            growth=None,
        )
        return solid if geometry.growth is None else solid.with_growth(geometry.growth)

    def with_growth(self, growth: Growth | None) -> "Solid":
        """See the base class."""
        grid = Grid.of(self.layout.corners(self.stations, self.middles))
        if growth is not None:
            xi = jnp.asarray(TABLES.xi)[:, None, None]
            angle = self.angles[:-1] + (xi + 1) / 2 * (self.angles[1:] - self.angles[:-1])
            grid = grid.grown(growth, self.section.frame(angle).tangent[:, :, None])
        return dataclasses.replace(self, grid=grid, growth=growth)

    @property
    def layout(self) -> Layout:
        """Where the unknowns are stored."""
        return Layout(self.angles.shape[0] - 1, self.layers)

    @property
    def clamp_reach(self) -> Lanes:
        """One and a half thicknesses: the corner of clamp and face is singular [rad]."""
        return 1.5 * self.section.mean_thickness / self._inner_length(self.angles[:1])[0]

    def _length(self, angle: Array, side: int) -> Array:
        """Length of the inner face (side -1) or of the outer one (side 1) per angle [m]."""
        at = self.section.frame(angle)
        length = self.section.size * (1 + at.curvature * side * at.thickness / 2)
        return length + jnp.zeros_like(angle)

    def _inner_length(self, angle: Array) -> Array:
        return self._length(angle, -1)

    @property
    def _ends(self) -> tuple[tuple[bool, ...], tuple[bool, ...]]:
        return self.layout.ends(self.symmetric)

    def _mask(self) -> Float[np.ndarray, "dof station 1"]:
        return self.layout.mask(self._ends)

    def rest(self) -> StationVector:
        """Zero displacement and pressure."""
        shape = (self.layout.size, *self.angles.shape)
        return jnp.zeros(shape, self.angles.dtype)

    def unknowns(self) -> int:
        """Free displacements, and the pressures."""
        inside = (self.layout.size - self.layout.dof) * self.layout.elements
        return int(self._mask().sum()) + inside

    def _energy(self, k: Kinematics) -> Array:
        energy = self.law.energy(PlaneStrain(k.distortion, k.dilatation))
        if self.response is None:
            return energy
        return self.response.share * energy + rest_energy(k, self.response)

    def deviator(self, q: StationVector) -> Float[Array, "3 gauss layer element lane"]:
        """Instantaneous stress that the material remembers; see `remembered_stress`."""
        return remembered_stress(self.law, self._kinematics(q))

    def strain_energy(self, q: StationVector) -> Lanes:
        """Strain energy per width [J/m]."""
        return jnp.sum(self.grid.volume * self._energy(self._kinematics(q)), (0, 1, 2))

    def dilatation(self, q: StationVector) -> Float[Array, "3 layer element lane"]:
        """Moments of J - 1 over every element with 1, xi and eta, relative to its area."""
        return self._constraint(q) / jnp.sum(self.grid.volume, 0)

    def potential(self, q: StationVector, pressure: Lanes, factor: Lanes) -> Lanes:
        """The mixed potential, pressures included; see the base class."""
        _, p = self.layout.gather(q)
        constraint = jnp.sum(p * self._constraint(q), (0, 1, 2))
        return super().potential(q, pressure, factor) + constraint

    def _kinematics(self, q: StationVector) -> Kinematics:
        return kinematics(self.grid, self._gathered(q))

    def _constraint(self, q: StationVector) -> Float[Array, "3 layer element lane"]:
        """What the pressures make zero."""
        return _moments(self.grid.swelling(self._kinematics(q)))

    def _at_rest(self, node: int) -> FaceValues:
        """Positions of the nodes of the inner face (0) or the outer one (-1): edge by edge."""
        return jnp.stack(
            [self.stations[:, node, :-1], self.middles[:, node], self.stations[:, node, 1:]]
        )

    def _face_against(self, obstacle: Obstacle, u: NodeValues) -> ContactFace:
        if isinstance(obstacle, Wall):
            length, edges = self._inner_length, (self._at_rest(0), self.layout.inner_face(u))
        else:
            length = functools.partial(self._length, side=1)
            edges = self._at_rest(-1), self.layout.outer_face(u)
        return ContactFace(obstacle, self.angles, length, *edges)

    def _gathered(self, q: StationVector) -> NodeValues:
        return self.layout.gather(q)[0]

    def contact(self, q: StationVector, wall: Wall) -> ContactState:
        """The inner face against a wall; see the base class."""
        return self._face_against(wall, self._gathered(q)).state()

    def _enclosed(self, u: NodeValues) -> tuple[Lanes, FaceValues]:
        """Enclosed volume less rest, and its gradient by the inner face's nodes."""
        return enclosed_volume(self._at_rest(0), self.layout.inner_face(u))

    def volume_change(self, q: StationVector) -> Lanes:
        """Enclosed volume less its value at rest, per width [m^2]."""
        return self._enclosed(self._gathered(q))[0]

    def work(self, q: StationVector) -> Lanes:
        """Work of the loads on the outer face [J/m]."""
        return jnp.sum(self.load * q, (0, 1))

    def assemble(self, q: StationVector, pressure: Lanes, factor: Lanes) -> Assembly:
        """Residual, tangent and border at a trial state; see the base class."""
        u, p = self.layout.gather(q)
        at_points = mix(TABLES.modes, p)
        k = kinematics(self.grid, u)
        terms = point_terms(self.law, self.grid, k, at_points, self.response)
        tail = u.shape[2:]
        internal = mix(TABLES.force, _paired(terms.stress)).reshape(9, 2, *tail)
        tangent = terms.tangent.reshape(-1, 3, *tail)
        stiffness = mix(TABLES.stiffness, tangent).reshape(9, 9, 3, *tail)
        coupling = mix(TABLES.coupling, _paired(terms.cofactor))
        constraint = coupling.reshape(9, 3, 2, *tail)
        volume, by_face = self._enclosed(u)
        stiffness = stiffness - pressure * follower(self.layers)
        if self.wall is not None:
            push, spring, _ = self._contact(self._face_against(self.wall, u))
            internal, stiffness = internal + push, stiffness + spring
        contact, travel = jnp.zeros_like(u), jnp.zeros_like(u)
        for body in self.bodies:
            face = self._face_against(body.placed(factor), u)
            push, spring, more = self._contact(face, body)
            contact, travel = contact + push, travel - more
            stiffness = stiffness + spring
        if self.bodies:
            internal = internal + contact
        gradient = self.layout.on_face(by_face, 0)
        mask, none = self._mask(), jnp.zeros_like(p)
        border = self.layout.scatter(gradient, none, mask)
        residual = self.layout.scatter(internal, _moments(terms.constraint), mask)
        modulus = self.law.shear_modulus / jnp.sum(self.grid.volume, 0)
        return Assembly(
            residual - pressure * border - factor * self.load,
            ElementTangent(stiffness, constraint, _PENALTY * modulus, self._ends, self.layout),
            border,
            self.load,
            volume,
            *(self.layout.scatter(x, none, mask) for x in (travel, contact) if self.bodies),
        )

    def _contact(
        self, contact: ContactFace, body: Body | None = None
    ) -> tuple[NodeValues, Array, NodeValues | float]:
        """Forces of the nodes by contact, their stiffness, and forces by a body's travel."""
        terms, face = contact.terms(), contact.face
        layer = (0, self.layers - 1) if face == 0 else (self.layers - 1, 0)
        spring = contact.matrix(terms)[:, :, :, None]
        spring = jnp.pad(spring, [(0, 0)] * 3 + [layer, (0, 0), (0, 0)])
        more: NodeValues | float = 0.0
        if body is not None:
            more = self.layout.on_face(contact.forces(by_travel(terms, body)), face)
        return self.layout.on_face(contact.forces(terms.force), face), spring, more

    def displacement_size(self, q: StationVector) -> Lanes:
        """Largest component of a station's displacement [m]."""
        return largest(q[: self.layout.dof])

    def _inner_stretch(self, q: StationVector) -> Float[Array, "3 element lane"]:
        """Hoop stretch of the inner face at its nodes."""
        at_stations, between = self.layout.lines(q)
        rest = self.stations[:, 0], self.middles[:, 0]
        current = rest[0] + at_stations[:, 0], rest[1] + between[:, 0]
        return face_stretch(self.angles, rest, current)

    def profile(self, q: StationVector, samples: int) -> Profile:
        """The deformed section at evenly spaced points; see the base class."""
        u, _ = self.layout.gather(q)
        xi = jnp.linspace(-1, 1, samples + 1)[:, None, None]
        start, end = self.angles[:-1], self.angles[1:]
        angle = start + (xi + 1) / 2 * (end - start)
        nodes = self.layout.corners(self.stations, self.middles)
        rest = self.section.inner_face(angle)
        return section(angle, rest, xi, u, nodes, self._inner_stretch(q), self.growth)

    def at_angle(self, q: StationVector, angle: Lanes) -> Displacements:
        """How the section moves at a reference angle; see the base class.

        Between two elements it is the mean of both, whose slopes differ under a load.
        """
        u, _ = self.layout.gather(q)
        start, end = self.angles[:-1], self.angles[1:]

        def on(before: Bool[Array, "element lane"]) -> Displacements:
            inside = jnp.clip(jnp.sum(before, 0) - 1, 0, self.layout.elements - 1)

            def pick(x: Array) -> Array:
                index = jnp.broadcast_to(inside, x.shape[-1:])
                index = index.reshape((1,) * (x.ndim - 1) + (-1,))
                return jnp.take_along_axis(x, index, -2)

            first, last = pick(start)[0], pick(end)[0]
            xi = 2 * (angle - first) / (last - first) - 1
            return displacements(xi[None, None], pick(u))

        both = zip(on(start <= angle), on(start < angle), strict=True)
        return Displacements(*((a + b) / 2 for a, b in both))

    def mirrored(self, q: StationVector) -> StationVector:
        """Unknowns of the whole arc; see the base class."""
        return mirrored(self.layout, q)

    def to_comparison_mesh(self, q: StationVector, counts: tuple[int, ...]) -> StationVector:
        """The same deformation on a coarser mesh; see the base class."""
        elements, layers = counts
        if elements < self.layout.elements:
            q = joined_along(self.layout, q)
        return q if layers == self.layout.layers else joined_across(self.layout, q)

    @property
    def error_shares(self) -> tuple[float, ...]:
        """Observed in random scenes (`benchmarks/error_estimate.py`).

        Where the difference across is unknown, that along the arc stands for both.
        """
        if self.layout.layers % 2:
            return (0.5,)
        return (0.3, 0.2) if self.layout.layers == 2 else (0.14, 0.08)


def _moments(change: Float[Array, "gauss layer element lane"]) -> Array:
    """Integrals with the pressure modes."""
    return mix(TABLES.modes.T, change)


def _paired(x: Float[Array, "gauss 4 *rest"]) -> Float[Array, "gauss*2 2 *rest"]:
    """Quadrature point and local direction first, component next."""
    return x.reshape(-1, 2, *x.shape[2:])
