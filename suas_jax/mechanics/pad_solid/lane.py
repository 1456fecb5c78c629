"""One lane of a pad as a solid: sums over its quadrature points.

Unknowns of a control value are the displacements of its levels through the thickness, from
the inner face to the outer one, then the multipliers of J = 1. A multiplier is a length, in
units of the shear modulus over the thickness.
"""

import functools
from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.constitutive.deformation_gradient import green
from suas_jax.mechanics.pad import loads as pad_loads
from suas_jax.mechanics.pad.contact import ContactFace
from suas_jax.mechanics.pad.faces import Faces
from suas_jax.mechanics.pad.lane import skew
from suas_jax.mechanics.pad.mid_surface import Vector, components
from suas_jax.mechanics.pad.net import ElementVector
from suas_jax.mechanics.pad.net_lane import AbstractLane, Kinds, Sums
from suas_jax.mechanics.pad_solid import points
from suas_jax.mechanics.pad_solid.points import Thickness, shapes_at, thickness
from suas_jax.numerics.polynomials import gauss_legendre
from suas_jax.skin.section import AbstractSection
from suas_jax.skin.wall import Obstacle, Wall

# The displacement, its derivatives by arc length and along the axis.
KINDS = ((0, 0), (1, 0), (0, 1))
PAIRS = tuple((k, m) for k in range(3) for m in range(k, 3))


class Swept(NamedTuple):
    """Enclosed volume less that at rest, per area of the mid-surface."""

    more: Float[Array, " place"]  # the volume [m]
    first: list[Float[Array, "3 place"]]  # derivatives by u, u,s and u,z [component, place]
    # by pairs of these: zero where a pair is not what it depends on
    second: dict[tuple[int, int], Float[Array, "3 3 place"]]


def swept(section: AbstractSection, angle: Array, moved: Float[Array, "3 3 place"]) -> Swept:
    """Volume that the inner face sweeps, with its derivatives.

    The flux of (x, y, 0)/2 through the face x(s, z), of which x,s x x,z points inwards; planes
    across the axis let nothing through. Everything is written in differences from rest.

    `section`: across the axis. `angle`: of the places [rad]. `moved`: displacement of the inner
    face, by arc length, along the axis.
    """

    def face(angle: Array) -> Array:
        at = section.frame(angle)
        return section.mid_line(angle) - at.thickness / 2 * at.normal

    place, along = jax.jvp(face, (angle,), (jnp.ones_like(angle),))
    zero = jnp.zeros_like(angle)
    rest = jnp.stack([*place, zero]), jnp.stack([*along / section.size, zero])
    axis = jnp.stack([zero, zero, zero + 1])
    u, us, uz = moved
    s, z = rest[1] + us, axis + uz
    at_rest = _cross(rest[1], axis)
    spin = _cross(us, axis) + _cross(rest[1], uz) + _cross(us, uz)
    flat = jnp.array([1.0, 1.0, 0.0])[:, None]
    here = flat * (rest[0] + u)
    normal = at_rest + spin
    more = -jnp.sum(flat * u * at_rest + here * spin, 0) / 2
    first = [-flat * normal / 2, -_cross(z, here) / 2, -_cross(here, s) / 2]
    none = jnp.zeros((3, 3, *zero.shape))
    second = {
        (0, 0): none,
        (0, 1): flat[:, None] * skew(z) / 2,
        (0, 2): -flat[:, None] * skew(s) / 2,
        (1, 1): none,
        (1, 2): skew(here) / 2,
        (2, 2): none,
    }
    return Swept(more, first, second)


def _cross(a: Array, b: Array) -> Array:
    return jnp.cross(a, b, axis=0)


class SolidLane(AbstractLane):
    """One lane of a solid."""

    kinds_of_derivative: ClassVar[Kinds] = KINDS
    pairs: ClassVar[Kinds] = PAIRS

    @property
    def degree(self) -> int:
        """Of the displacement through the thickness."""
        return self.topology.vectors - 1

    @property
    def through(self) -> Thickness:
        """Tables through the thickness."""
        return thickness(self.degree, self.layer_count)

    @property
    def unit(self) -> Array:
        """What a multiplier of one stands for [Pa/m]."""
        return self.law.shear_modulus / self.section.mean_thickness

    @functools.cached_property
    def frame(self) -> Float[Array, "3 3 place"]:
        """Tangent, normal and axis at the points' places [which, component]."""
        return _frame(self.section, self.angle)

    @functools.cached_property
    def geometry(self) -> points.Geometry:
        """The undeformed membrane at the points."""
        table = self.through
        return self._geometry(self.angle, self.axial, table.eta, table.weights)

    def _geometry(
        self, angle: Array, axial: Array, eta: np.ndarray, weights: np.ndarray
    ) -> points.Geometry:
        place = jnp.broadcast_arrays(angle, axial)
        return points.geometry(self.section, self.beyond_mean, place, (eta, weights))

    def _fields(self, qe: ElementVector) -> tuple[Array, Array]:
        """Displacement by the coordinates, in local components, and pressure at the points."""
        values = jnp.moveaxis(self.values(qe), 2, 1)  # [kind, width, gauss, element]
        values = values.reshape(3, values.shape[1], -1)
        count = self.degree + 1
        moved = values[:, : 3 * count].reshape(3, count, 3, -1)
        local = jnp.einsum("icp,kvcp->kvip", self.frame, moved)
        pressure = jnp.einsum("mp,me->ep", values[0, 3 * count :], self.through.modes)
        return points.at_points(
            self.through.shapes, self.through.slopes, local
        ), self.unit * pressure

    def strain_energy(self, q: Array) -> Array:
        """Strain energy [J]."""
        moved, _ = self._fields(self.net.gather(q))
        return self._stored(moved)

    def _stored(self, moved: Array) -> Array:
        L = points.displacement_gradient(moved, self.geometry.inverse)
        density = points.energy_density(self.law, green(L), self.growth)
        return jnp.sum(self.areas.reshape(-1) * self.geometry.volume * density)

    def _enclosed(self, qe: ElementVector) -> tuple[Array, Swept]:
        values = self.values(qe)
        inner = jnp.moveaxis(values[:, :, :3], 2, 1).reshape(3, 3, -1)
        found = swept(self.section, self.angle, inner)
        return jnp.sum(self.areas.reshape(-1) * found.more), found

    def energies(self, q: Array) -> tuple[Array, Array, Array]:
        """Potential of the membrane, volume change and work of the loads."""
        qe = self.net.gather(q)
        moved, pressure = self._fields(qe)
        L = points.displacement_gradient(moved, self.geometry.inverse)
        change = points.swelling(L, self.growth)
        modulus = self.law.shear_modulus
        bound = pressure * change + modulus * (
            points.PENALTY * change**2 / 2 - (pressure / modulus) ** 2 / points.MULTIPLIER / 2
        )
        held = jnp.sum(self.areas.reshape(-1) * self.geometry.volume * bound)
        outer = pad_loads.interpolated(self._spots(), self._level(qe, -1))
        work = jnp.sum(self.points.force * outer[0])
        return self._stored(moved) + held, self._enclosed(qe)[0], work

    def _spots(self) -> pad_loads.Spots:
        at = self.points.angle, self.points.axial
        return pad_loads.spots(self.net, self.section, at, KINDS[:1])

    def _level(self, qe: ElementVector, index: int) -> ElementVector:
        """The displacement of one level: 0 is the inner face, -1 the outer one."""
        first = 3 * (index % (self.degree + 1))
        return qe[first : first + 3]

    def face_against(self, obstacle: Obstacle, q: Array) -> "SolidFace":
        """See the base class."""
        qe = self._level(self.net.gather(q), 0 if isinstance(obstacle, Wall) else -1)
        return SolidFace(self.net, obstacle, self.section, qe, self.growth)

    def sums(self, qe: ElementVector, pressure: Array, factor: Array) -> Sums:
        """See the base class."""
        del factor  # loads act at places of the face, whose work is linear
        moved, multiplier = self._fields(qe)
        found = points.terms(self.law, self.geometry, moved, multiplier, self.growth)
        volume, swept = self._enclosed(qe)
        spots, still = self._spots(), jnp.zeros_like(self._level(qe, -1))
        pulls = self.points.force[:, None] * spots.shapes[0]
        corner = jnp.stack([pressure * swept.second[pair] for pair in PAIRS])
        return Sums(
            self._forces(self._internal(found, multiplier)),
            self._forces({k: self._at_level(x, 0) for k, x in enumerate(swept.first)}),
            self._at_level(pad_loads.add_vectors(still, spots, pulls), -1),
            self._stiffness(self._blocks(found).at[:, :3, :3].add(-corner)),
            volume,
        )

    def _internal(self, found: points.Terms, multiplier: Array) -> dict[int, Array]:
        """Derivatives of the potential by the unknowns, by kind of derivative."""
        table = self.through
        own = found.swelling - multiplier * self.geometry.volume / (
            self.law.shear_modulus * points.MULTIPLIER
        )
        held = self.unit * jnp.einsum("me,ep->mp", table.modes, own)
        rows: dict[int, Array] = {}
        for coordinate, kind in enumerate(points.KIND_OF):
            shapes = table.shapes if kind else table.slopes
            force = jnp.einsum("ve,cep->vcp", shapes, found.stress[coordinate])
            force = jnp.einsum("icp,vip->vcp", self.frame, force)
            force = force.reshape(3 * len(shapes), -1)
            rows[kind] = jnp.concatenate([force, jnp.zeros_like(held) if kind else held])
        return rows

    def _blocks(self, found: points.Terms) -> Float[Array, "pair width width place"]:
        """Second derivatives of the potential by the unknowns, for each of `PAIRS`."""
        table, count = self.through, self.degree + 1
        coordinate = {kind: a for a, kind in enumerate(points.KIND_OF)}
        shapes = {k: table.shapes if k else table.slopes for k in range(3)}
        own = self.geometry.volume / (self.law.shear_modulus * points.MULTIPLIER)
        places = own.shape[-1]
        corner = -(self.unit**2) * jnp.einsum("me,ne,ep->mnp", table.modes, table.modes, own)
        coupling = {}
        for k in range(3):
            rows = jnp.einsum(
                "ve,me,cep->vmcp", shapes[k], table.modes, found.cofactor[coordinate[k]]
            )
            rows = self.unit * jnp.einsum("icp,vmip->vcmp", self.frame, rows)
            coupling[k] = rows.reshape(3 * count, self.degree, places)
        blocks = []
        for k, m in PAIRS:
            product = np.einsum("ve,we->vwe", shapes[k], shapes[m]).reshape(count**2, -1)
            part = found.tangent[coordinate[k], :, coordinate[m]]  # [c, d, eta, place]
            part = jnp.moveaxis(part, 2, 0).reshape(len(table.eta), -1)
            part = (jnp.asarray(product) @ part).reshape(count, count, 3, 3, places)
            part = jnp.einsum("icp,vwijp->vwcjp", self.frame, part)
            part = jnp.einsum("jdp,vwcjp->vcwdp", self.frame, part)
            part = part.reshape(3 * count, 3 * count, places)
            zero = jnp.zeros_like(coupling[0])
            right = coupling[0] if k == m == 0 else zero
            below = coupling[m] if k == 0 else zero
            last = corner if k == m == 0 else jnp.zeros_like(corner)
            top = jnp.concatenate([part, right], 1)
            bottom = jnp.concatenate([jnp.swapaxes(below, 0, 1), last], 1)
            blocks.append(jnp.concatenate([top, bottom]))
        return jnp.stack(blocks)

    def inner_displacement(self, qe: ElementVector, angle: Array, axial: Array) -> Vector:
        """See the base class."""
        spots = pad_loads.spots(self.net, self.section, (angle, axial), KINDS[:1])
        return components(pad_loads.interpolated(spots, self._level(qe, 0))[0])

    def _faces(self, moved: Array, angle: Array, axial: Array) -> Faces:
        """See the base class."""
        count = self.degree + 1
        values = moved[:, : 3 * count].reshape(len(moved), count, 3, -1)
        local = jnp.einsum("icp,kvcp->kvip", _frame(self.section, angle), values)
        inside, weights = gauss_legendre(self.layer_count, -1.0, 1.0)
        eta = np.concatenate([[-1.0, 1.0], inside])
        at = self._geometry(angle, axial, eta, np.concatenate([[0, 0], weights]))
        shapes, slopes = (shapes_at(self.degree, eta, n) for n in range(2))
        L = points.displacement_gradient(points.at_points(shapes, slopes, local), at.inverse)
        entries = green(L)
        seen = points.elastic(entries, self.growth)
        in_plane = jnp.stack([seen[0], seen[2], seen[4]])
        density = points.energy_density(self.law, [x[2:] for x in entries], self.growth)
        volume = at.volume[2:]
        middle = jnp.einsum("v,vcp->cp", shapes_at(self.degree, np.zeros(1))[:, 0], values[0])
        place = jnp.broadcast_arrays(angle, axial)
        return Faces(
            place[0],
            place[1],
            mid_displacement=middle,
            inner_displacement=values[0, 0],
            outer_displacement=values[0, -1],
            inner_strain=in_plane[:, 0],
            outer_strain=in_plane[:, 1],
            energy_density=jnp.sum(volume * density, 0) / jnp.sum(volume, 0),
        )


class SolidFace(ContactFace):
    """One face of a solid at its contact points: it moves as its own level does."""

    kinds_of: ClassVar[dict[int, tuple[tuple[int, int], ...]]] = {-1: KINDS[:1], 1: KINDS[:1]}

    def position(self, z: Array, angle: Array, axial: Array) -> Array:
        """See the base class."""
        at = self.section.frame(angle)
        rest = self.section.mid_line(angle) + self.side * at.thickness / 2 * at.normal
        return jnp.stack([rest[0] + z[0], rest[1] + z[1], axial + z[2]])


def _frame(section: AbstractSection, angle: Array) -> Float[Array, "3 3 place"]:
    at = section.frame(angle)
    zero = jnp.zeros_like(at.tangent[0])
    rows = [[*at.tangent, zero], [*at.normal, zero], [zero, zero, zero + 1]]
    return jnp.stack([jnp.stack(row) for row in rows])
