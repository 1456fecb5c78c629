"""What moves with a pad: its force on the membrane, and that force's derivative.

The film's flow is a field on a grid of samples, which links join along the arc and along the
axis. With the velocity v along a link of length l, the film's thickness h there and the
pressure p at the samples ::

    rho dv/dt + 12 mu v / h^2 = -(dp + d(rho v^2 / 2)) / l,   div(h v) + w = 0

where w is what the membrane sweeps. Over half a step, dv/dt = (v - v_b) / c, this is one
scalar elliptic problem for the pressure, whose work on what is swept is the force: as on a
section (`suas_jax.dynamics.moving_section`) the film brings no unknowns of its own.
"""

from collections.abc import Callable
from typing import NamedTuple, Self

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.dynamics.film_grid import Links, Sides, areas_of
from suas_jax.dynamics.inertia import THINNEST_FILM, Densities
from suas_jax.mechanics.pad.pad import Pad
from suas_jax.numerics.array_types import StationVector
from suas_jax.skin.geometry import SkinGeometry

SAMPLES = 2
"""Intervals along either side of an element."""
HARMONICS = 24
"""Of the water outside, in either direction."""
BATCH = 64
"""Unknowns whose motion is sampled at once."""

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
