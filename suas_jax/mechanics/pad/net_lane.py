"""Sums over the quadrature points of a control net, in arrays without lanes."""

import abc
from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.constitutive.base import AbstractLaw
from suas_jax.mechanics.pad import loads as pad_loads
from suas_jax.mechanics.pad.contact import ContactFace
from suas_jax.mechanics.pad.faces import Faces
from suas_jax.mechanics.pad.mid_surface import Vector
from suas_jax.mechanics.pad.net import ElementVector, Net, tables
from suas_jax.mechanics.pad.stiffness import Upper, dense_bands, upper_bands
from suas_jax.skin.body import Body
from suas_jax.skin.geometry import Sheet, thickness_beyond_mean
from suas_jax.skin.loads import PadLoadPoints
from suas_jax.skin.prestress import Growth
from suas_jax.skin.section import AbstractSection
from suas_jax.skin.wall import Obstacle, Wall

# Newton steps to the material point on a ray: displacements along the wall are small.
_RAY_STEPS = 4
_ORDERS = 3  # to which derivatives of heights are exact
_NEAR = 5e-6  # off a ray, from where a linear step's error is 1e-5 of a gap at most [m]

Kinds = tuple[tuple[int, int], ...]
Place = tuple[Array, Array]  # reference angles [rad] and axial positions [m]
# Angle of the normal through points of the inner face, their axial position, their height.
OverWall = tuple[Array, Array, Array]


class Slopes(NamedTuple):
    """How what is over the wall changes with the inner face's points."""

    # of the points' angle and axial position by those over the wall, row after row
    inverse: tuple[Array, Array, Array, Array]
    height: tuple[Array, Array]  # of the height by both over the wall [m/rad], [1]

    def step(self, off: Place) -> Place:
        """How far the points are from those that lie an angle and a length further."""
        a, b, c, d = self.inverse
        return a * off[0] + b * off[1], c * off[0] + d * off[1]

    def rise(self, off: Place) -> Array:
        """How much higher those are [m]."""
        return self.height[0] * off[0] + self.height[1] * off[1]


class OnRays(NamedTuple):
    """The inner face along rays."""

    place: Place  # of the material points on them
    height: Float[Array, " ray"]  # of the face over the undeformed one [m]
    slopes: tuple[Array, Array]  # of the height by a ray's angle [m/rad] and axial position


def _off(rays: Place, here: OverWall) -> Place:
    """How far rays are from points."""
    return rays[0] - here[0], rays[1] - here[1]


class LaneParts(NamedTuple):
    """What a lane is made of."""

    law: AbstractLaw  # the membrane's material
    net: Net  # control values
    section: AbstractSection  # the undeformed membrane across the axis
    points: PadLoadPoints  # the loads
    # points along either side of an element, and through the thickness
    quadrature: tuple[int, int]
    growth: Growth | None  # of the membrane; None where it fits its seat
    relief: Sheet | None  # of its outer face; None where it is the same all along


class Sums(NamedTuple):
    """The membrane's share of a system, before contact."""

    internal: ElementVector  # derivatives of the potential by the unknowns
    gradient: ElementVector  # of the enclosed volume
    load: ElementVector  # of the loads' work at unit factor
    upper: Upper  # bands of the tangent
    volume: Array  # enclosed volume less its value at rest [m^3]


class AbstractLane(abc.ABC):
    """One lane of a pad; arrays without lanes, inputs with a lane axis of length one."""

    # that energies depend on, by arc length and along the axis
    kinds_of_derivative: ClassVar[Kinds]
    # of kinds that the tangent couples: each once, and each kind with itself
    pairs: ClassVar[Kinds]

    def __init__(self, parts: LaneParts) -> None:
        self.law, self.net, self.section, self.points = parts[:4]
        self.growth, self.relief = parts.growth, parts.relief
        self.gauss, self.layer_count = parts.quadrature
        net, order = self.net, self.net.topology.ordered
        self.topology = net.topology
        self.kinds = tuple(order(*kind) for kind in self.kinds_of_derivative)
        self.tables = tables(self.gauss, self.kinds)
        arc, axial = self.section.size * jnp.diff(net.angles), jnp.diff(net.axial)
        long, across = order(arc, axial)
        self.lengths = long[:, None], across[None]
        self.elements = (len(long), len(across))

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

    def beyond_mean(self, angle: Array, axial: Array) -> Array | float:
        """Thickness beyond its mean along the axis [m]."""
        return thickness_beyond_mean(self.section, self.relief, angle, axial)

    @property
    def areas(self) -> Float[Array, "gauss element"]:
        """Weights of the points in integrals over the undeformed mid-surface [m^2]."""
        long, across = self.lengths
        return np.outer(self.tables.weights, self.tables.weights).reshape(-1, 1) * (
            long * across
        ).reshape(-1)

    def values(self, qe: ElementVector) -> Float[Array, "kind gauss width element"]:
        """Control values' fields at the points, by the kinds of derivative."""
        width = self.topology.width
        columns = jnp.moveaxis(qe.reshape(width, 16, -1), 0, 1).reshape(16, -1)
        values = jnp.asarray(self.tables.values) @ columns
        values = values.reshape(len(self.kinds), self.gauss**2, width, -1)
        return values * jnp.stack(self.powers)[:, None, None]

    def strain_energy(self, q: Array) -> Array:
        """Strain energy [J]."""
        return self.energies(q)[0]

    @abc.abstractmethod
    def energies(self, q: Array) -> tuple[Array, Array, Array]:
        """Potential of the membrane, volume change and work of the loads.

        The potential of a solid is stationary, the strain energy of a shell.
        """

    @abc.abstractmethod
    def face_against(self, obstacle: Obstacle, q: Array) -> ContactFace:
        """The inner face against a wall, or the outer one against a body."""

    @abc.abstractmethod
    def sums(self, qe: ElementVector, pressure: Array, factor: Array) -> Sums:
        """What the membrane adds to a system, from the elements' control values."""

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
        internal, gradient, load, upper, volume = self.sums(qe, pressure, factor)
        if wall is not None:
            pushes, more = self.face_against(wall, q).element_terms()
            internal, upper = (
                internal + self._at_level(pushes[0], 0),
                upper + self._within(more, 0),
            )
        contact = jnp.zeros((2, *qe.shape), qe.dtype)
        for body in bodies:
            pushes, more = self.face_against(body.placed(factor), q).element_terms(body)
            contact = contact + jnp.stack([self._at_level(push, -1) for push in pushes])
            upper = upper + self._within(more, -1)
        if bodies:
            internal = internal + contact[0]
        forces, by_volume, by_load = (self.net.scatter(f) for f in (internal, gradient, load))
        residual = forces - pressure * by_volume - factor * by_load
        found = residual, dense_bands(self.net, upper), by_volume, by_load, volume
        if not bodies:
            return found
        return *found, -self.net.scatter(contact[1]), self.net.scatter(contact[0])

    def _room(self, index: int) -> tuple[int, int]:
        """Unknowns of a control value before and after those of one level."""
        first = 3 * (index % self.topology.vectors)
        return first, self.topology.width - first - 3

    def _at_level(self, x: Array, index: int) -> Array:
        """Components of one level among all unknowns, the others zero.

        `x`: components of a vector, leading. `index`: of the level: 0 has the inner face, -1
        the outer one. A shell has one level.
        """
        return jnp.pad(x, [self._room(index), *((0, 0) for _ in x.shape[1:])])

    def _within(self, bands: Upper, index: int) -> Upper:
        """Bands of one level among those of all unknowns; see `_at_level`."""
        room = self._room(index)
        return jnp.pad(bands, [(0, 0), (0, 0), (0, 0), room, room, (0, 0)])

    def faces(self, q: Array, angle: Array, axial: Array) -> Faces:
        """See `Pad.faces`."""
        kinds = self.kinds_of_derivative
        spots = pad_loads.spots(self.net, self.section, (angle, axial), kinds)
        return self._faces(pad_loads.interpolated(spots, self.net.gather(q)), angle, axial)

    def sampled(self, q: Array, angle: Array, axial: Array) -> Faces:
        """The same at the crossings of lines of angles and lines of axial positions."""
        kinds, qe = self.kinds_of_derivative, self.net.gather(q)
        moved = pad_loads.on_grid(self.net, self.section, (angle, axial), qe, kinds)
        grid = jnp.broadcast_arrays(angle[:, None], axial)
        return self._faces(moved, *(x.reshape(-1) for x in grid))

    @abc.abstractmethod
    def _faces(
        self, moved: Float[Array, "kind width point"], angle: Array, axial: Array
    ) -> Faces:
        """The faces at places, from the unknowns' fields and their derivatives there."""

    @abc.abstractmethod
    def inner_displacement(self, qe: ElementVector, angle: Array, axial: Array) -> Vector:
        """Displacement of the inner face at places."""

    def height_at(self, q: Array, angle: Array, axial: Array) -> Array:
        """See `Pad`: which material point lies on a ray is found by Newton's method.

        Derivatives see further steps with its last slopes kept: each adds an order to those of
        the place, and the height has one more than the place.
        """
        qe, rays = self.net.gather(q), (angle, axial)

        # One loop for all steps: each that is traced on its own takes a second to compile.
        def search(place: Place, _: None) -> tuple[Place, Slopes]:
            here, slopes = self._slopes(qe, place)
            nearer = self._nearer(place, slopes, _off(rays, here))
            found: tuple[Place, Slopes] = jax.lax.stop_gradient((nearer, slopes))
            return found

        def follow(place: Place, _: None) -> tuple[Place, Array]:
            here = self._over_wall(qe, place)
            off = _off(rays, here)
            return self._nearer(place, slopes, off), here[2] + slopes.rise(off)

        first, second = jax.lax.stop_gradient(jnp.broadcast_arrays(angle, axial))
        place, every = jax.lax.scan(search, (first, second), None, length=_RAY_STEPS - 1)
        slopes = jax.tree.map(lambda x: x[-1], every)
        return jax.lax.scan(follow, place, None, length=_ORDERS)[1][-1]

    def on_rays(self, q: Array, angle: Array, axial: Array, near: Place) -> OnRays:
        """The material points on rays from places near them: few steps, no derivatives.

        The last step's linear part stands for another one: its error is the square of what is
        left, over a length like the thickness.
        """
        qe, rays = self.net.gather(q), (angle, axial)

        def step(at: tuple[OnRays, Array, Array]) -> tuple[OnRays, Array, Array]:
            before, _, count = at
            here, slopes = self._slopes(qe, before.place)
            off = _off(rays, here)
            size = self.section.size * jnp.abs(off[0]) + jnp.abs(off[1])
            height = here[2] + jnp.where(size <= _NEAR, slopes.rise(off), 0.0)
            place = self._nearer(before.place, slopes, off)
            return OnRays(place, height, slopes.height), jnp.max(size), count + 1

        def going(at: tuple[OnRays, Array, Array]) -> Array:
            return (at[1] > _NEAR) & (at[2] < _RAY_STEPS)

        zero = jnp.zeros_like(angle)
        start = OnRays(near, zero, (zero, zero)), jnp.array(jnp.inf), jnp.array(0)
        return jax.lax.while_loop(going, step, start)[0]

    def heights_moved(self, q: Array, at: OnRays, by: Array) -> Array:
        """Derivative of the heights along rays by a displacement.

        A point's height changes, and another point comes to lie on the ray.
        """

        def over_wall(q: Array) -> OverWall:
            return self._over_wall(self.net.gather(q), at.place)

        polar, along, height = jax.jvp(over_wall, (q,), (by,))[1]
        return height - at.slopes[0] * polar - at.slopes[1] * along

    def _over_wall(self, qe: ElementVector, place: Place) -> OverWall:
        """Angle of the normal through the inner face's point, axial position, height."""
        x, y, z = self.inner_displacement(qe, *place)
        rest = self.section.inner_face(place[0])
        polar, height = self.section.foot(rest + jnp.stack([x, y]), place[0])
        return polar, place[1] + z, height

    def _slopes(self, qe: ElementVector, place: Place) -> tuple[OverWall, Slopes]:
        """`_over_wall` of material points and how it changes with them."""

        def along(way: Array) -> tuple[OverWall, OverWall]:
            ways = tuple(jnp.full_like(x, w) for x, w in zip(place, way, strict=True))
            return jax.jvp(lambda place: self._over_wall(qe, place), (place,), (ways,))

        here, both = jax.vmap(along, out_axes=(None, 0))(jnp.eye(2))
        (a, b, h), (c, d, k) = ([x[i] for x in both] for i in range(2))
        determinant = a * d - c * b
        inverse = d / determinant, -c / determinant, -b / determinant, a / determinant
        height = (d * h - b * k) / determinant, (a * k - c * h) / determinant
        return here, Slopes(inverse, height)

    def _nearer(self, place: Place, slopes: Slopes, off: Place) -> Place:
        """One step of Newton's method towards the material points on rays."""
        ends = jax.lax.stop_gradient((self.net.angles, self.net.axial))
        moved = [x + step for x, step in zip(place, slopes.step(off), strict=True)]
        angle, axial = (jnp.clip(x, e[0], e[-1]) for x, e in zip(moved, ends, strict=True))
        return angle, axial

    def _stiffness(self, blocks: Float[Array, "pair width width point"]) -> Upper:
        """Upper bands from second derivatives of a density by the pairs of kinds."""
        g = self.gauss
        _, across = self.lengths
        powers = [across[0] ** (1 - self.kinds[k][1] - self.kinds[m][1]) for k, m in self.pairs]
        scale = jnp.stack(powers)[:, None, None, None, None, None]
        blocks = (
            blocks.reshape(len(self.pairs), *blocks.shape[1:3], g, g, *self.elements) * scale
        )
        lengths = self.lengths[0][:, 0]
        return upper_bands(self.net, self.tables, self.pairs, self.kinds, blocks, lengths)

    def _forces(self, by_kind: dict[int, Float[Array, "width point"]]) -> ElementVector:
        """Element vectors from derivatives of a density by the kinds of derivative."""
        count, width = self.gauss**2, self.topology.width
        powers = self.powers
        scale = (jnp.stack([powers[k] for k in by_kind])[:, None] * self.areas)[:, :, None]
        rows = jnp.stack(list(by_kind.values())).reshape(len(by_kind), width, count, -1)
        rows = (jnp.moveaxis(rows, 1, 2) * scale).reshape(len(by_kind) * count, -1)
        values = self.tables.values.reshape(len(self.kinds), count, 16)[list(by_kind)]
        flat = jnp.asarray(values.reshape(-1, 16).T) @ rows
        return jnp.moveaxis(flat.reshape(4, 4, width, *self.elements), 2, 0)
