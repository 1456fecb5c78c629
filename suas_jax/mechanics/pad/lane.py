"""One lane of a pad as a thin shell: sums over its quadrature points."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array

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
from suas_jax.mechanics.pad.net import ElementVector
from suas_jax.mechanics.pad.net_lane import AbstractLane, Kinds, LaneParts, Sums
from suas_jax.mechanics.pad.omitted import (
    Elements,
    Forces,
    forces_of,
    relaxed_energy,
    thinning_work,
    with_sides_swapped,
)
from suas_jax.mechanics.pad.points import PAIRS, stress, tangent
from suas_jax.skin.wall import Obstacle


class PadLane(AbstractLane):
    """One lane of a thin shell."""

    kinds_of_derivative: ClassVar[Kinds] = KINDS
    pairs: ClassVar[Kinds] = PAIRS

    def __init__(self, parts: LaneParts, response: Response | None = None) -> None:
        """See the base class; `response` is that of a material with a past."""
        super().__init__(parts)
        modulus = parts.law.shear_modulus
        self.modulus = modulus if response is None else response.share * modulus
        self.rest = self._rest(self.angle, self.axial)
        self.fibres: Layers = self._layers(self.rest)._replace(response=response)

    def _rest(self, angle: Array, axial: Array) -> Rest:
        return Rest.of(self.section, angle, self.beyond_mean(angle, axial))

    def surface(self, qe: ElementVector) -> Surface:
        """The mid-surface at the quadrature points."""
        values = jnp.moveaxis(self.values(qe), 2, 1).reshape(3 * len(KINDS), -1)
        return surface(vectors(values), self.rest)

    def deviator(self, q: Array) -> Array:
        """See `Pad.deviator`."""
        return deviator(self.law, self.surface(self.net.gather(q)), self.fibres)

    def _swelling(self) -> Array | float:
        """Growth of the membrane's lower half, which takes room below it, per area [m]."""
        if self.growth is None:
            return 0.0
        below = self.rest.below
        lower = below * (1 - below * self.rest.curvature / 2)
        return (self.growth.volume - 1) * lower

    def _layers(self, rest: Rest) -> Layers:
        return layers(self.layer_count, rest, self.growth)

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

    def face_against(self, obstacle: Obstacle, q: Array) -> ContactFace:
        """See the base class."""
        return ContactFace(self.net, obstacle, self.section, self.net.gather(q), self.growth)

    def _spots(self) -> pad_loads.Spots:
        """Where the loads act."""
        at = (self.points.angle, self.points.axial)
        found = pad_loads.spots(self.net, self.section, at)
        return found._replace(above=found.above + self.beyond_mean(*at))

    def _faces(self, moved: Array, angle: Array, axial: Array) -> Faces:
        """See the base class."""
        s = surface(list(moved), self._rest(angle, axial))
        place = jnp.broadcast_arrays(angle, axial)
        return faces(self.law, s, (place[0], place[1]), self._layers(s.rest))

    def relaxed_energy(self, q: Array) -> Array:
        """See `omitted`; straight lines join the resultants at the points of an element."""
        qe, g = self.net.gather(q), self.gauss
        found = forces_of(self.law, self.surface(qe), self.fibres)
        thickness = jnp.broadcast_to(self.rest.thickness, self.angle.shape)

        def gridded(x: Array) -> Array:
            x = x.reshape(*x.shape[:-1], g, g, *self.elements)
            return x if self.topology.along_arc else with_sides_swapped(x)

        arc, axial = self.topology.ordered(self.lengths[0][:, 0], self.lengths[1][0])
        axes = self.topology.arc, self.topology.axial
        clamped = [(axis.left == "open", axis.right == "open") for axis in axes]
        elements = Elements(
            self.tables.xi, self.tables.weights, arc, axial, (clamped[0], clamped[1])
        )
        at = Forces(*(gridded(x) for x in found))
        return relaxed_energy(at, elements, gridded(thickness), self.modulus, self.growth)

    def omitted_energy(self, q: Array, factor: Array) -> Array:
        """See `omitted`: the membrane's part, and that of loads with a factor on them."""
        points = self.points
        under = self._at(self.net.gather(q), points.angle, points.axial)
        below = forces_of(self.law, under, self._layers(under.rest))
        inward = -factor * jnp.sum(points.force * jnp.stack(jnp.broadcast_arrays(*under.n)), 0)
        # Instantaneous forces over the instantaneous modulus: both relax alike.
        modulus = self.law.shear_modulus
        work = thinning_work(below, inward, under.rest.thickness, modulus)
        return self.relaxed_energy(q) + work

    def _at(self, qe: ElementVector, angle: Array, axial: Array) -> Surface:
        """The mid-surface at places."""
        spots = pad_loads.spots(self.net, self.section, (angle, axial), KINDS)
        moved = pad_loads.interpolated(spots, qe)
        return surface(list(moved), self._rest(angle, axial))

    def inner_displacement(self, qe: ElementVector, angle: Array, axial: Array) -> Vector:
        """Displacement of the inner face at places."""
        s = self._at(qe, angle, axial)
        return face_displacement(s, -s.rest.below, self.growth)[0]

    def sums(self, qe: ElementVector, pressure: Array, factor: Array) -> Sums:
        """See the base class."""
        s = self.surface(qe)
        results = resultants(self.law, s, self.fibres)
        forces = stress(s, results.first)
        more, pulls = swept(s)
        more = more - self._swelling()
        points, spots = self.points, self._spots()
        moved = pad_loads.interpolated(spots, qe)
        vectors, hessian = pad_loads.load_terms(points, spots, moved)
        upper = self._stiffness(tangent(s, results, pressure))
        return Sums(
            self._forces(dict(enumerate(map(jnp.stack, forces), 1))),
            self._forces(dict(enumerate(map(jnp.stack, pulls)))),
            pad_loads.add_vectors(jnp.zeros_like(qe), spots, vectors),
            upper - factor * pad_loads.load_bands(self.net, spots, hessian),
            jnp.sum(self.areas.reshape(-1) * more),
        )
