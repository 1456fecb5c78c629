"""One lane of a pad: sums over its quadrature points, in arrays without lanes."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.constitutive.base import AbstractLaw
from suas_jax.constitutive.relaxation import Response
from suas_jax.mechanics.pad import loads as pad_loads
from suas_jax.mechanics.pad.contact import ContactFace
from suas_jax.mechanics.pad.faces import Faces, face_displacement, faces
from suas_jax.mechanics.pad.fibres import Layers, deviator, energy_density, layers, resultants
from suas_jax.mechanics.pad.mid_surface import (
    KINDS,
    Rest,
    Surface,
    Vector,
    surface,
    swept,
    vectors,
)
from suas_jax.mechanics.pad.net import ElementVector, Net, tables
from suas_jax.mechanics.pad.omitted import moments, shear_energy_density
from suas_jax.mechanics.pad.points import PAIRS, stress, tangent
from suas_jax.mechanics.pad.refinement import refined
from suas_jax.mechanics.pad.stiffness import Upper, both_ways, dense_bands, upper_bands
from suas_jax.numerics.quadrature import lagrange_slopes
from suas_jax.skin.along import Sheet
from suas_jax.skin.body import Body, PlacedBody
from suas_jax.skin.pad_loads import PadLoadPoints
from suas_jax.skin.prestress import Growth
from suas_jax.skin.section import AbstractSection
from suas_jax.skin.wall import Wall

# Newton steps to the material point on a ray: displacements along the wall are small.
_RAY_STEPS = 4


class PadLane:
    """One lane of a pad; arrays without lanes, inputs with a lane axis of length one."""

    def __init__(
        self,
        law: AbstractLaw,
        net: Net,
        section: AbstractSection,
        points: PadLoadPoints,
        quadrature: tuple[int, int],
        growth: Growth | None,
        relief: Sheet | None = None,
        response: Response | None = None,
    ) -> None:
        """Prepare what sums need.

        Args:
            law: the membrane's material.
            net: control values.
            section: the undeformed membrane across the axis.
            points: the loads.
            quadrature: points along either side of an element, and through the thickness.
            growth: of the membrane; None where it fits its seat.
            relief: of its outer face; None where it is the same all along.
            response: of a material with a past at the quadrature points; None of an elastic
                one.
        """
        self.growth, self.relief = growth, relief
        modulus = law.shear_modulus
        self.modulus = modulus if response is None else response.share * modulus
        self.law, self.net, self.points = law, net, points
        self.section = section
        self.gauss, self.layer_count = quadrature
        self.topology = net.topology
        order = self.topology.ordered
        self.kinds = tuple(order(*kind) for kind in KINDS)
        self.tables = tables(self.gauss, self.kinds, tuple(both_ways(PAIRS)))
        arc, axial = section.size * jnp.diff(net.angles), jnp.diff(net.axial)
        long, across = order(arc, axial)
        self.lengths = long[:, None], across[None]
        self.elements = (len(long), len(across))
        self.rest = self._rest(self.angle, self.axial)
        self.fibres: Layers = self._layers(self.rest)._replace(response=response)

    @property
    def powers(self) -> list[Array]:
        """What turns a derivative by local coordinates into one by length, for each kind."""
        long, across = self.lengths
        return [1 / (long**m * across**n).reshape(-1) for m, n in self.kinds]

    @property
    def angle(self) -> Float[Array, " point"]:
        """Reference angle of the points [rad]."""
        return self._spread(self.net.angles, along=self.topology.along_arc)

    @property
    def axial(self) -> Float[Array, " point"]:
        """Reference position of the points along the axis [m]."""
        return self._spread(self.net.axial, along=not self.topology.along_arc)

    def _spread(self, breaks: Array, *, along: bool) -> Array:
        """A coordinate of one direction, along the stations or across, at all points."""
        inside = breaks[:-1] + jnp.asarray(self.tables.xi)[:, None] * jnp.diff(breaks)
        shape = (self.gauss, self.gauss, *self.elements)
        inside = inside[:, None, :, None] if along else inside[None, :, None, :]
        return jnp.broadcast_to(inside, shape).reshape(-1)

    def _beyond_mean(self, angle: Array, axial: Array) -> Array | float:
        """Thickness beyond its mean along the axis [m]."""
        if self.relief is None:
            return 0.0
        return self.relief(self.section.fraction(angle), axial)

    def _rest(self, angle: Array, axial: Array) -> Rest:
        return Rest.of(self.section, angle, self._beyond_mean(angle, axial))

    @property
    def areas(self) -> Float[Array, "gauss element"]:
        """Weights of the points in integrals over the undeformed mid-surface [m^2]."""
        long, across = self.lengths
        return np.outer(self.tables.weights, self.tables.weights).reshape(-1, 1) * (
            long * across
        ).reshape(-1)

    def surface(self, qe: ElementVector) -> Surface:
        """The mid-surface at the quadrature points."""
        values = jnp.asarray(self.tables.values) @ _leading(qe, 16)
        values = values.reshape(len(KINDS), self.gauss**2, 3, -1)
        powers = jnp.stack(self.powers)[:, None, None]
        values = jnp.moveaxis(values * powers, 2, 1).reshape(3 * len(KINDS), -1)
        return surface(vectors(values), self.rest)

    def deviator(self, q: Array) -> Array:
        """See `Pad.deviator`."""
        return deviator(self.law, self.surface(self.net.gather(q)), self.fibres)

    def strain_energy(self, q: Array) -> Array:
        """Strain energy [J]."""
        return self.energies(q)[0]

    def volume_change(self, q: Array) -> Array:
        """Enclosed volume less its value at rest [m^3]."""
        return self.energies(q)[1]

    def _swelling(self) -> Array | float:
        """Growth of the membrane's lower half, which takes room below it, per area [m]."""
        if self.growth is None:
            return 0.0
        below = self.rest.below
        lower = below * (1 - below * self.rest.curvature / 2)
        return (self.growth.volume - 1) * lower

    def _layers(self, rest: Rest) -> Layers:
        return layers(self.layer_count, rest, self.growth)

    def work(self, q: Array) -> Array:
        """Work of the loads at unit factor [J]."""
        return self.energies(q)[2]

    def energies(self, q: Array) -> tuple[Array, Array, Array]:
        """Strain energy, volume change and work of the loads."""
        qe, areas = self.net.gather(q), self.areas.reshape(-1)
        s = self.surface(qe)
        density = energy_density(self.law, s, self.fibres)
        more = swept(s)[0] - self._swelling()
        points, spots = self.points, self._spots()
        moved = pad_loads.interpolated(spots, qe)
        work = pad_loads.load_work(points, spots, moved)
        return jnp.sum(areas * density), jnp.sum(areas * more), work

    def inner_face(self, q: Array, wall: Wall) -> ContactFace:
        """The inner face against a wall."""
        return ContactFace(self.net, wall, -1, self.section, self.net.gather(q), self.growth)

    def outer_face(self, q: Array, body: PlacedBody) -> ContactFace:
        """The outer face against a body."""
        return ContactFace(self.net, body, 1, self.section, self.net.gather(q), self.growth)

    def _spots(self) -> pad_loads.Spots:
        """Where the loads act."""
        at = (self.points.angle, self.points.axial)
        found = pad_loads.spots(self.net, self.section, at)
        return found._replace(above=found.above + self._beyond_mean(*at))

    def faces(self, q: Array, angle: Array, axial: Array) -> Faces:
        """See `Pad.faces`."""
        s = self._at(self.net.gather(q), angle, axial)
        place = jnp.broadcast_arrays(angle, axial)
        return faces(self.law, s, (place[0], place[1]), self._layers(s.rest))

    def omitted_energy(self, q: Array) -> Array:
        """Of transverse shear; polynomials join the moments at the points of an element."""
        s = self.surface(self.net.gather(q))
        found = moments(self.law, s, self.fibres)
        g = self.gauss
        found = found.reshape(3, g, g, *self.elements)
        long, across = self.lengths
        slope = lagrange_slopes(self.tables.xi)
        by_long = jnp.einsum("hg,cgkef->chkef", slope, found) / long
        by_across = jnp.einsum("hk,cgkef->cghef", slope, found) / across
        by_arc, by_axial = self.topology.ordered(by_long, by_across)
        stiffness = self.modulus * jnp.broadcast_to(
            self.rest.thickness, self.angle.shape
        ).reshape(g, g, *self.elements)
        density = shear_energy_density(by_arc, by_axial, stiffness)
        return jnp.sum(self.areas.reshape(-1) * density.reshape(-1))

    def _at(self, qe: ElementVector, angle: Array, axial: Array) -> Surface:
        """The mid-surface at places."""
        spots = pad_loads.spots(self.net, self.section, (angle, axial), KINDS)
        moved = pad_loads.interpolated(spots, qe)
        return surface(list(moved), self._rest(angle, axial))

    def height_at(self, q: Array, angle: Array, axial: Array) -> Array:
        """See `Pad`: which material point lies on a ray is found by Newton's method."""
        qe = self.net.gather(q)
        ends = jax.lax.stop_gradient((self.net.angles, self.net.axial))

        def position(place: tuple[Array, Array]) -> tuple[Array, Array, Array]:
            """Angle of the normal through the inner face's point, axial position, height."""
            s = self._at(qe, *place)
            x, y, z = face_displacement(s, -s.rest.below, self.growth)[0]
            rest = self.section.inner_face(place[0])
            polar, height = self.section.foot(rest + jnp.stack([x, y]), place[0])
            return polar, place[1] + z, height

        def step(place: tuple[Array, Array], _: None) -> tuple[tuple[Array, Array], None]:
            one, zero = jnp.ones_like(angle), jnp.zeros_like(angle)
            here, by_angle = jax.jvp(position, (place,), ((one, zero),))
            _, by_axial = jax.jvp(position, (place,), ((zero, one),))
            off = angle - here[0], axial - here[1]
            determinant = by_angle[0] * by_axial[1] - by_axial[0] * by_angle[1]
            turn = (by_axial[1] * off[0] - by_axial[0] * off[1]) / determinant
            shift = (by_angle[0] * off[1] - by_angle[1] * off[0]) / determinant
            moved = place[0] + turn, place[1] + shift
            clipped = [jnp.clip(x, e[0], e[-1]) for x, e in zip(moved, ends, strict=True)]
            return (clipped[0], clipped[1]), None

        first, second = jnp.broadcast_arrays(angle, axial)
        place, _ = jax.lax.scan(step, (first, second), None, length=_RAY_STEPS)
        return position(place)[2]

    def refined(self, q: Array) -> Array:
        """See `Pad.to_comparison_mesh`."""
        return refined(self.net, self.section, q)

    def assemble(
        self,
        q: Array,
        pressure: Array,
        factor: Array,
        wall: Wall | None,
        bodies: tuple[Body, ...],
    ) -> tuple[Array, ...]:
        """Residual, bands, derivatives of volume and load, and volume change.

        With bodies also the residual's derivative by their travel, its sign changed, and their
        force.
        """
        qe = self.net.gather(q)
        s = self.surface(qe)
        results = resultants(self.law, s, self.fibres)
        forces = stress(s, results.first)
        more, pulls = swept(s)
        more = more - self._swelling()
        internal = self._forces(dict(zip(range(1, 6), forces, strict=True)))
        gradient = self._forces(dict(zip(range(3), pulls, strict=True)))
        points, spots = self.points, self._spots()
        moved = pad_loads.interpolated(spots, qe)
        vectors, hessian = pad_loads.load_terms(points, spots, moved)
        load = pad_loads.add_vectors(jnp.zeros_like(qe), spots, vectors)
        upper = self._stiffness(tangent(s, results, pressure))
        upper = upper - factor * pad_loads.load_bands(self.net, spots, hessian)
        if wall is not None:
            pushes, more_bands = self.inner_face(q, wall).element_terms()
            internal, upper = internal + pushes[0], upper + more_bands
        contact = jnp.zeros((2, *qe.shape), qe.dtype)
        for body in bodies:
            pushes, more_bands = self.outer_face(q, body.placed(factor)).element_terms(body)
            contact, upper = contact + pushes, upper + more_bands
        if bodies:
            internal = internal + contact[0]
        bands = dense_bands(self.net, upper)
        scattered = [self.net.scatter(f) for f in (internal, gradient, load)]
        residual = scattered[0] - pressure * scattered[1] - factor * scattered[2]
        volume = jnp.sum(self.areas.reshape(-1) * more)
        found = residual, bands, scattered[1], scattered[2], volume
        if not bodies:
            return found
        return *found, -self.net.scatter(contact[1]), self.net.scatter(contact[0])

    def _stiffness(self, blocks: Float[Array, "pair 3 3 point"]) -> Upper:
        """Upper bands from second derivatives of a density by `PAIRS`."""
        g = self.gauss
        _, across = self.lengths
        powers = [across[0] ** (1 - self.kinds[k][1] - self.kinds[m][1]) for k, m in PAIRS]
        scale = jnp.stack(powers)[:, None, None, None, None, None]
        blocks = blocks.reshape(len(PAIRS), 3, 3, g, g, *self.elements) * scale
        orders = [kind[0] for kind in self.kinds]
        lengths = self.lengths[0][:, 0]
        return upper_bands(self.net, self.tables, PAIRS, orders, blocks, lengths)

    def _forces(self, by_kind: dict[int, Vector]) -> ElementVector:
        """Element vectors from derivatives of a density by the kinds of derivative."""
        count = self.gauss**2
        powers = self.powers
        scale = (jnp.stack([powers[k] for k in by_kind])[:, None] * self.areas)[:, :, None]
        rows = jnp.stack([x for vector in by_kind.values() for x in vector])
        rows = rows.reshape(len(by_kind), 3, count, -1)
        rows = (jnp.moveaxis(rows, 1, 2) * scale).reshape(len(by_kind) * count, -1)
        values = self.tables.values.reshape(len(KINDS), count, 16)[list(by_kind)]
        flat = jnp.asarray(values.reshape(-1, 16).T) @ rows
        return jnp.moveaxis(flat.reshape(4, 4, 3, *self.elements), 2, 0)


def _leading(qe: ElementVector, count: int) -> Float[Array, "16 rest"]:
    """Element coefficients as columns of a matrix."""
    return jnp.moveaxis(qe.reshape(3, count, -1), 0, 1).reshape(count, -1)
