"""What moves with a pad: its force on the membrane, and that force's derivative.

The film's flow is a field on a grid of samples, which links join along the arc and along the
axis. With the velocity v along a link of length l, the film's thickness h there and the
pressure p at the samples ::

    rho dv/dt + 12 mu v / h^2 = -(dp + d(rho v^2 / 2)) / l,   div(h v) + w = 0

where w is what the membrane sweeps. Over half a step, dv/dt = (v - v_b) / c, this is one
scalar elliptic problem for the pressure, whose work on what is swept is the force: as on a
section (`suas_jax.dynamics.motion`) the film brings no unknowns of its own. The pressures
follow from finite volumes, row after row along the arc (a block-tridiagonal system whose blocks
off the diagonal are diagonal): what a sample gains is what its links bring.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, Self

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.dynamics.inertia import THINNEST_FILM, Densities
from suas_jax.mechanics.pad.pad import Pad
from suas_jax.numerics.array_types import StationVector
from suas_jax.skin.geometry import SkinGeometry

Sides = tuple[Float[Array, "arc_link axial"], Float[Array, "arc axial_link"]]
"""Of links along the arc, and of those along the axis."""
SAMPLES = 2
"""Intervals along either side of an element."""
HARMONICS = 24
"""Of the water outside, in either direction."""
BATCH = 64
"""Unknowns whose motion is sampled at once."""


class Links(NamedTuple):
    """Links between samples, over some time."""

    passage: Sides  # cross-section of the film [m^2]
    conductance: Sides  # flux by the pressure that drives it [m^3/(s Pa)]
    kept: Sides  # share of a velocity that is left without pressure

    @classmethod
    def over(
        cls,
        position: Float[Array, "3 arc axial"],  # of the samples [m]
        film: Float[Array, "arc axial"],  # thickness of the film there [m]
        given: Densities,  # of the oil, and its viscosity
        time: Array,  # in which a flow changes [s]
    ) -> Self:
        """Of a film."""
        lengths = [jnp.sqrt(jnp.sum(jnp.diff(position, axis=k) ** 2, 0)) for k in (1, 2)]
        rows = []
        for axis in (0, 1):
            # Width of the strip that a sample's flux has: half of either length beside it.
            ends = [[(0, 0)] * (1 - axis) + [pad] + [(0, 0)] * axis for pad in ((1, 0), (0, 1))]
            width = sum(jnp.pad(lengths[1 - axis], end) for end in ends) / 2
            passage, drained = (_mean(film**n * width, axis) for n in (1, 3))
            inert = given.oil / time
            slow = inert + 12 * given.viscosity * passage / drained
            rows.append((passage, passage / lengths[axis] / slow, inert / slow))
        first, second = rows
        return cls(*((a, b) for a, b in zip(first, second, strict=True)))

    def flow(
        self, room: Float[Array, "arc axial"], before: Sides
    ) -> tuple[Float[Array, "arc axial"], Sides]:
        """Pressures, and velocities along the links.

        `room`: what the film gains at every sample [m^3/s]; together nothing. `before`:
        velocities at the begin of the time.
        """
        kept = [a * b * c for a, b, c in zip(self.passage, self.kept, before, strict=True)]
        pressure = self.potential(-room - _leaving(kept))
        driven = [-jnp.diff(pressure, axis=k) * self.conductance[k] for k in (0, 1)]
        along, aside = ((a + b) / c for a, b, c in zip(kept, driven, self.passage, strict=True))
        return pressure, (along, aside)

    def squares(self, flow: Sides) -> Float[Array, "arc axial"]:
        """Square of the velocity at the samples."""
        along, aside = (jnp.pad(x**2, _beyond(k)) for k, x in enumerate(flow))
        return (along[1:] + along[:-1] + aside[:, 1:] + aside[:, :-1]) / 2

    def potential(
        self, source: Float[Array, "arc axial *right"]
    ) -> Float[Array, "arc axial *right"]:
        """Pressures that make samples lose what they have; together they have nothing."""
        along, aside = self.conductance
        rows, columns = (jnp.pad(x, _beyond(k)) for k, x in enumerate((along, aside)))
        own = rows[1:] + rows[:-1] + columns[:, 1:] + columns[:, :-1]
        # A pressure is known but for a constant: it is zero at the last sample.
        own = own.at[-1, -1].multiply(2.0)
        beside = jax.vmap(lambda x: jnp.diag(x, 1) + jnp.diag(x, -1))(aside)
        blocks = jax.vmap(jnp.diag)(own) - beside
        after = jnp.pad(along, ((0, 1), (0, 0)))
        right = source.reshape(*own.shape, -1)

        def forward(before: tuple[Array, Array, Array], row: tuple[Array, ...]) -> Any:
            inverse, y, link = before
            block, mine, following = row
            inverse = jnp.linalg.inv(block - link[:, None] * inverse * link)
            y = inverse @ (mine + link[:, None] * y)
            return (inverse, y, following), (inverse, y)

        def backward(later: Array, row: tuple[Array, Array, Array]) -> Any:
            inverse, y, link = row
            x = y + inverse @ (link[:, None] * later)
            return x, x

        none = jnp.zeros_like(blocks[0]), jnp.zeros_like(right[0]), jnp.zeros_like(after[0])
        _, (inverses, y) = jax.lax.scan(forward, none, (blocks, right, after))
        _, x = jax.lax.scan(backward, none[1], (inverses, y, after), reverse=True)
        return x.reshape(source.shape)


def areas_of(position: Float[Array, "3 arc axial"]) -> Float[Array, "3 arc axial"]:
    """Vectors of the area that a sample stands for, inwards [m^2]."""
    along, aside = (jnp.asarray(jnp.gradient(position, axis=k)) for k in (1, 2))
    count = position.shape[1:]
    return jnp.cross(along, aside, axis=0) * _ends(count[0])[:, None] * _ends(count[1])


def _ends(count: int) -> np.ndarray:
    """Ones, halves at both ends."""
    weights = np.ones(count)
    weights[[0, -1]] = 0.5
    return weights


def _beyond(axis: int) -> list[tuple[int, int]]:
    """No links beyond the ends."""
    return [(1, 1), (0, 0)] if axis == 0 else [(0, 0), (1, 1)]


def _leaving(flux: list[Array]) -> Array:
    """What leaves every sample."""
    along, aside = (jnp.pad(x, _beyond(k)) for k, x in enumerate(flux))
    return jnp.diff(along, axis=0) + jnp.diff(aside, axis=1)


def _mean(nodes: Array, axis: int) -> Array:
    """Values at the middle of links."""
    first = jax.lax.slice_in_dim(nodes, 0, -1, axis=axis)
    return (first + jax.lax.slice_in_dim(nodes, 1, None, axis=axis)) / 2


Grid = Float[Array, "arc axial"]


class PadFlow(NamedTuple):
    """How a pad moves."""

    film: Sides  # velocities of the oil along the links [m/s]
    membrane: Float[Array, "3 arc axial"]  # velocities of the mid-surface [m/s]
    water: Float[Array, "harmonic harmonic"]  # of what the outer face sweeps [m^3/s]


class _Swept(NamedTuple):
    """What moves where the unknowns do, or what works on it."""

    room: Float[Array, "arc axial"]  # volume swept outwards, less an even share [m^3]
    membrane: Float[Array, "3 arc axial"]  # of the mid-surface
    water: Float[Array, "harmonic harmonic"]


class MovingPad(NamedTuple):
    """What moves with a pad close to a state."""

    given: Densities  # densities and viscosity
    q: StationVector  # unknowns of the state
    faces: Float[Array, "3 3 arc axial"]  # inner face, mid-surface and outer face there [m]
    gap: Grid  # thickness of the film there [m]
    normal: Float[Array, "2 arc axial"]  # of the wall beneath the inner face
    mass: Grid  # of the membrane [kg]
    outside: Float[Array, "harmonic harmonic"]  # added mass of the water's harmonics
    around: Float[Array, "harmonic arc"]  # the harmonics along the arc
    along: Float[Array, "harmonic axial"]  # and along the axis
    # what velocities of the unknowns make of the faces
    push: Callable[[StationVector], Float[Array, "3 3 arc axial"]]

    @classmethod
    def near(
        cls,
        pad: Pad,
        geometry: SkinGeometry,
        given: Densities,
        outside: Float[Array, "harmonic harmonic"],  # see `pad.outside_of`
        q: StationVector,
    ) -> Self:
        """Close to a state."""

        def sheets(q: Array) -> Array:
            found = pad.sampled(q, SAMPLES)
            rows = found.inner_displacement, found.mid_displacement, found.outer_displacement
            return jnp.stack(rows)[..., 0]

        displaced, push = jax.linearize(sheets, q)
        grid, section = pad.sampled(0 * q, SAMPLES), geometry.section
        angle, axial = grid.angle, grid.axial
        thickness = jnp.broadcast_to(section.thickness(angle), angle.shape)
        middle, inner = section.mid_line(angle), section.inner_face(angle)
        outer = middle + thickness / 2 * section.frame(angle).normal
        rest = jnp.stack([inner, middle, outer])[..., 0]
        along = jnp.broadcast_to(axial[None, None, ..., 0], (3, 1, *rest.shape[2:]))
        faces = jnp.concatenate([rest, along], 1) + displaced
        foot, height = section.foot(inner + displaced[0, :2, ..., None], angle)
        gap = (height + geometry.gap(foot, faces[0, 2][..., None]))[..., 0]
        area = jnp.sqrt(jnp.sum(areas_of(faces[1]) ** 2, 0))
        half = geometry.half_angle
        place = (angle[:, 0] + half) / (2 * half), axial[0] / geometry.width + 0.5
        n = np.arange(HARMONICS)[:, None]
        around, along = (jnp.cos(n * jnp.pi * x[..., 0]) for x in place)
        return cls(
            given,
            q,
            faces,
            gap,
            section.inner_normal(foot)[..., 0],
            given.membrane * thickness[..., 0] * area,
            given.water * outside,
            around,
            along,
            push,
        )

    @property
    def still(self) -> PadFlow:
        """Of a pad at rest."""
        arc, axial = self.gap.shape
        film = jnp.zeros((arc - 1, axial)), jnp.zeros((arc, axial - 1))
        return PadFlow(film, 0 * self.faces[1], 0 * self.outside)

    def _swept(self, faces: Array, film: Grid, moved: Array) -> _Swept:
        """What motions of the faces sweep, and move."""
        inner, outer = (-jnp.sum(areas_of(faces[k]) * moved[k], 0) for k in (0, 2))
        room = film * jnp.sqrt(jnp.sum(areas_of(faces[0]) ** 2, 0))
        inner = inner - room / jnp.sum(room) * jnp.sum(inner)
        return _Swept(inner, moved[1], self.around @ outer @ self.along.T)

    def force(
        self,
        q: StationVector,  # unknowns
        velocity: StationVector,  # of them
        before: PadFlow,  # that a rate adds to
        length: Array,  # for so long [s]
    ) -> tuple[StationVector, PadFlow, PadFlow]:
        """Force on the unknowns, the flow and its rate."""
        change = self.push(q - self.q)
        faces, gap = self.faces + change, self.gap + jnp.sum(self.normal * change[0, :2], 0)
        film = jnp.maximum(gap, THINNEST_FILM)

        def moved(velocity: Array) -> _Swept:
            return self._swept(faces, film, self.push(velocity))

        found, links = moved(velocity), Links.over(faces[0], film, self.given, length)
        pressure, flow = links.flow(found.room, before.film)
        flows = PadFlow(flow, found.membrane, found.water)
        rate = jax.tree.map(lambda a, b: (a - b) / length, flows, before)
        pressure = pressure - self.given.oil / 2 * links.squares(flow)
        pulls = _Swept(-pressure, self.mass * rate.membrane, self.outside * rate.water)
        (own,) = jax.linear_transpose(moved, velocity)(pulls)
        return own, flows, rate

    def stiffness(
        self, velocity: StationVector, length: Array, free: np.ndarray
    ) -> Float[Array, "unknown unknown"]:
        """Derivative of the force by the free unknowns, where these change for some time.

        Of what flows through a film as thick as it is: steps are short against its closing.
        """
        del velocity
        film = jnp.maximum(self.gap, THINNEST_FILM)

        def moved_by(index: Array) -> _Swept:
            unit = jnp.zeros(self.q.size).at[index].set(1.0).reshape(self.q.shape)
            return self._swept(self.faces, film, self.push(unit))

        by = jax.lax.map(moved_by, jnp.asarray(free), batch_size=BATCH)
        room, middle, water = (x.reshape(len(free), -1) for x in by)
        links = Links.over(self.faces[0], film, self.given, length)
        pressure = links.potential(jnp.moveaxis(by.room, 0, -1))
        heavy = jnp.broadcast_to(self.mass, (3, *self.mass.shape)).ravel()
        matrix: Array = room @ pressure.reshape(-1, len(free)) / length
        matrix += (middle * heavy / length**2) @ middle.T
        return matrix + (water * self.outside.ravel() / length**2) @ water.T
