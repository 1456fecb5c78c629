"""One lane of a pad as a thin shell: sums over its quadrature points.

There the first and second derivatives of strain energy less pressure times volume are taken,
per area of the undeformed mid-surface, by u,s  u,z  u,ss  u,zz  u,sz.
"""

from collections.abc import Sequence
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.constitutive.relaxation import Response
from suas_jax.mechanics.pad import loads as pad_loads
from suas_jax.mechanics.pad.contact import ContactFace
from suas_jax.mechanics.pad.faces import Faces, face_displacement, faces
from suas_jax.mechanics.pad.fibres import (
    Layers,
    Resultants,
    deviator,
    energy_density,
    layers,
    resultants,
)
from suas_jax.mechanics.pad.mid_surface import (
    KINDS,
    Rest,
    Scalar,
    Surface,
    Vector,
    components,
    cross,
    surface,
    swept,
    total,
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
from suas_jax.skin.wall import Obstacle

Rows = Float[Array, "3 *point"]

# Pairs of kinds that the tangent couples: each once, and each kind with itself.
PAIRS = ((1, 1), (1, 2), (2, 2), *((k, a) for k in (1, 2) for a in (3, 4, 5)))
PAIRS += ((3, 3), (3, 4), (3, 5), (4, 4), (4, 5), (5, 5), (0, 1), (0, 2))


def skew(v: Sequence[Array] | Array) -> Float[Array, "3 3 *point"]:
    """The matrix of v x."""
    zero = jnp.zeros_like(v[0])
    entries = jnp.stack([zero, -v[2], v[1], v[2], zero, -v[0], -v[1], v[0], zero])
    return entries.reshape(3, 3, *zero.shape)


def _pull(s: Surface, first: list[Scalar]) -> Vector:
    """The sum of r,ss  r,zz  r,sz, each times the derivative by its curvature."""
    return components(
        total(first[3 + k] * v[i] for k, v in enumerate(s.second)) for i in range(3)
    )


def stress(s: Surface, first: list[Scalar]) -> list[Vector]:
    """Derivatives of the energy density by u,s u,z u,ss u,zz u,sz."""
    pull = _pull(s, first)
    along, across = cross(s.rz, pull), cross(pull, s.rs)
    by_s = [2 * first[0] * s.rs[i] + first[2] * s.rz[i] + along[i] for i in range(3)]
    by_z = [2 * first[1] * s.rz[i] + first[2] * s.rs[i] + across[i] for i in range(3)]
    by_curvature = [components(first[3 + k] * x for x in s.m) for k in range(3)]
    return [components(by_s), components(by_z), *by_curvature]


def tangent(s: Surface, found: Resultants, pressure: Array) -> Float[Array, "pair 3 3 *point"]:
    """Second derivatives of the energy less pressure times volume, per area.

    Returns a block for each of `PAIRS`.
    """
    first, second = found.first, found.second
    rs, rz, m = jnp.stack(s.rs), jnp.stack(s.rz), jnp.stack(s.m)
    # What each of the six numbers depends on; a_22 not on u,s and a_11 not on u,z.
    by_s = {0: 2 * rs, 2: rz}
    by_z = {1: 2 * rz, 2: rs}
    for k, v in enumerate(s.second):
        by_s[3 + k], by_z[3 + k] = jnp.stack(cross(s.rz, v)), jnp.stack(cross(v, s.rs))

    def weighed(rows: dict[int, Rows]) -> list[Rows]:
        return [total(second[p][q] * row for p, row in rows.items()) for q in range(6)]

    s_weighed, z_weighed = weighed(by_s), weighed(by_z)

    def joint(weighed: list[Rows], rows: dict[int, Rows]) -> Array:
        return total(weighed[p][:, None] * row for p, row in rows.items())

    points = (1,) * s.u[0].ndim
    eye = np.eye(3).reshape(3, 3, *points)
    across = np.array([1.0, 1.0, 0.0]).reshape(3, 1, *points)
    half = pressure / 2
    pull = _pull(s, first)
    x, y = (pull[k] + half * (s.rest.place[k] + s.u[k]) for k in (0, 1))
    skew_s, skew_z = skew(s.rs), skew(s.rz)
    blocks = {
        (1, 1): joint(s_weighed, by_s) + 2 * first[0] * eye,
        (1, 2): joint(s_weighed, by_z) + first[2] * eye - skew((x, y, pull[2])),
        (2, 2): joint(z_weighed, by_z) + 2 * first[1] * eye,
        (0, 1): -half * across * skew_z,
        (0, 2): half * across * skew_s,
    }
    normals = m[:, None] * m
    for a in range(3):
        blocks[1, 3 + a] = s_weighed[3 + a][:, None] * m + first[3 + a] * skew_z
        blocks[2, 3 + a] = z_weighed[3 + a][:, None] * m - first[3 + a] * skew_s
        for b in range(a, 3):
            blocks[3 + a, 3 + b] = second[3 + a][3 + b] * normals
    return jnp.stack([blocks[pair] for pair in PAIRS])


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
