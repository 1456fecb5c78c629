"""Motions of a section: small ones about a state, and what moves with it close to one.

Everything is a matrix over the membrane's unknowns, per width along the axis. The stiffness is
the tangent of the equilibrium; faces and film are polylines through samples of every element,
with the derivatives of their points by the unknowns.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.dynamics.inertia import (
    THINNEST_FILM,
    Densities,
    Flow,
    Outline,
    Water,
    flow_of,
    weights_of,
)
from suas_jax.equilibrium.balance import State
from suas_jax.mechanics.base import AbstractMechanics
from suas_jax.mechanics.model import AbstractPlan
from suas_jax.mechanics.pad.pad import Pad
from suas_jax.mechanics.shell.shell import Shell
from suas_jax.numerics.array_types import StationVector
from suas_jax.numerics.block_tridiagonal import AbstractTangent
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.build import Inputs, Structure, problem_of
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.program import inputs_of, structure_of
from suas_jax.scene.solve import Solution
from suas_jax.skin.geometry import SkinGeometry

# Intervals of an element: faces are polylines, whose error goes with the square.
_SAMPLES = 6


class Motion(NamedTuple):
    """What small motions of a section are made of, for its free unknowns."""

    # tangent of the membrane under pressure and dead loads [N/m^2]
    stiffness: Float[Array, "unknown unknown"]
    # second derivative of the energy that the shell leaves out
    omitted: Float[Array, "unknown unknown"]
    volume: Float[Array, " unknown"]  # derivative of the enclosed volume
    # of the oil, derivative of its volume by its pressure, zero or less [m^2/Pa]
    compliance: float | Float[Array, ""]
    outline: Outline  # faces and film in the state
    # displacement of the faces' points by the unknowns
    moved: Float[Array, "3 2 point unknown"]
    wall: Float[Array, "2 point"]  # its points beneath those of the inner face [m]
    section: Float[Array, " segment"]  # cross-section of the membrane's segments [m^2]
    water: Water  # outside

    def shapes(
        self, vectors: Float[np.ndarray, "unknown mode"]
    ) -> Float[np.ndarray, "mode face 2 point"]:
        """Displacement of the inner and the outer face, the largest component being one."""
        shapes = np.moveaxis(np.asarray(self.moved[::2] @ vectors), -1, 0)
        scaled: np.ndarray = shapes / np.max(np.abs(shapes), (1, 2, 3), keepdims=True)
        return scaled


class Sampling(NamedTuple):
    """Samples of a shell along its arc, at rest."""

    shell: Shell  # the membrane
    geometry: SkinGeometry  # of the skin
    angle: Float[Array, " point"]  # of the samples [rad]
    rest: Float[Array, "3 2 point"]  # inner face, mid-line and outer face [m]
    section: Float[Array, " segment"]  # cross-section of the membrane's segments [m^2]
    water: Water  # outside

    @classmethod
    def of(cls, shell: Shell, geometry: SkinGeometry) -> "Sampling":
        """Evenly spaced in every element."""
        angles = shell.angles + jnp.zeros((1, 1))
        xi = np.linspace(0, 1, _SAMPLES, endpoint=False)[:, None, None]
        angle = _along(angles[:-1] + xi * (angles[1:] - angles[:-1]), angles[-1:])[:, None]
        section = geometry.section
        middle = section.mid_line(angle)
        thickness = section.thickness(angle) + 0 * angle
        outer = middle + thickness / 2 * section.frame(angle).normal
        rest = jnp.stack([section.inner_face(angle), middle, outer])[..., 0]
        angle, thickness = angle[:, 0], thickness[:, 0]
        area = section.size * jnp.diff(angle) * (thickness[1:] + thickness[:-1]) / 2
        water = Water.over(jnp.hypot(*jnp.diff(rest[2])))
        return cls(shell, geometry, angle, rest, area, water)

    def near(self, q: StationVector) -> "Near":
        """Faces and film at a state, and how they move with its unknowns."""

        def faces(q: StationVector) -> Float[Array, "3 2 point"]:
            shape = self.shell.profile(q, _SAMPLES)
            moved = jnp.stack(
                [shape.inner_displacement, shape.mid_displacement, shape.outer_displacement]
            )
            return self.rest + _along(moved[..., :-1, :, :], moved[..., -1:, -1, :])

        section = self.geometry.section
        at, push = jax.linearize(faces, q)
        foot, height = section.foot(at[0, :, :, None], self.angle[:, None])
        gap = (height + self.geometry.gap(foot))[:, 0]
        normal = section.inner_normal(foot)
        wall = section.inner_face(foot) - self.geometry.gap(foot) * normal
        return Near(q, Outline(at, gap), push, normal[..., 0], wall[..., 0])


class Near(NamedTuple):
    """Faces and film of a section close to a state, of first order in the distance."""

    q: StationVector  # unknowns of the state
    at: Outline  # faces and film there
    # what velocities of the unknowns make of the faces' points
    push: Callable[[StationVector], Float[Array, "3 2 point"]]
    normal: Float[Array, "2 point"]  # of the wall beneath the inner face
    wall: Float[Array, "2 point"]  # its points there [m]

    def outline(self, q: StationVector) -> Outline:
        """Faces and film."""
        moved = self.push(q - self.q)
        return Outline(self.at.faces + moved, self.at.gap + self.closing(moved))

    def closing(
        self, moved: Float[Array, "*unknown 3 2 point"]
    ) -> Float[Array, "*unknown point"]:
        """Change of the film's thickness where the faces move."""
        return jnp.sum(self.normal * moved[..., 0, :, :], -2)

    def by_unknowns(self, free: np.ndarray) -> Float[Array, "unknown 3 2 point"]:
        """What the free unknowns make of the faces' points."""
        unit = jnp.eye(self.q.size).reshape(-1, *self.q.shape)
        moved: Array = jax.vmap(self.push)(unit[free])
        return moved


def _along(
    samples: Float[Array, "*axes sample element lane"], last: Float[Array, "*axes 1 lane"]
) -> Float[Array, "*axes point"]:
    """Samples of one element after another, and the last one's end."""
    rows = jnp.swapaxes(samples[..., 0], -1, -2)
    return jnp.concatenate([rows.reshape(*rows.shape[:-2], -1), last[..., 0]], -1)


def free_unknowns(membrane: AbstractMechanics) -> np.ndarray:
    """Places of the unknowns that may move in a flat station vector."""
    assert isinstance(membrane, Shell | Pad)
    return np.flatnonzero(membrane.free)


def dense(tangent: AbstractTangent, free: np.ndarray) -> Float[Array, "unknown unknown"]:
    """A tangent as a matrix over the free unknowns."""
    shape = tangent.structure.shape
    unit = jnp.eye(int(np.prod(shape))).reshape(-1, *shape)
    return jax.vmap(tangent.mv)(unit[free]).reshape(len(free), -1)[:, free]


@eqx.filter_jit
def _program(scene: Structure, plan: AbstractPlan, inputs: Inputs, state: State) -> Motion:
    parts = scene_parts(scene.scene, inputs)
    problem = problem_of(parts, plan, wall=scene.wall)
    shell, q = problem.mechanics, state.q
    assert isinstance(shell, Shell)
    net = state.pressure - state.factor * problem.external_pressure
    a = shell.assemble(q, net, state.factor)
    free = free_unknowns(shell)
    unit = jnp.eye(q.size).reshape(q.size, *q.shape)[free]
    sampling = Sampling.of(shell, parts.skin.geometry)

    def pull(q: Array) -> Array:
        return shell.omitted_gradient(q, state.factor)

    _, bend = jax.linearize(pull, q)
    near = sampling.near(q)
    return Motion(
        stiffness=dense(a.tangent, free),
        omitted=jax.vmap(bend)(unit).reshape(len(free), -1)[:, free],
        volume=a.volume_gradient.reshape(-1)[free],
        compliance=problem.oil.compliance(state.pressure, shell.film_volume)[0],
        outline=near.at,
        moved=jnp.moveaxis(near.by_unknowns(free), 0, -1),
        wall=near.wall,
        section=sampling.section,
        water=sampling.water,
    )


def motion_of(solution: Solution) -> Motion:
    """Small motions about a solved section.

    `solution`: of a scene in plane strain, by the shell, with trapped oil.
    """
    scene = structure_of(solution.scene, wall=solution.wall)
    inputs = inputs_of(solution.scene)
    found = COMPILED.run(_program, scene, solution.plan, inputs, solution.state, once=True)
    motion: Motion = jax.tree.map(np.asarray, found)
    return motion


class MovingSection(NamedTuple):
    """What moves with a section close to a state: its force, and that force's derivative.

    The flows of film, membrane and water are linear in the velocities of the unknowns
    (`suas_jax.dynamics.inertia`): v = Y dq/dt. Their momentum and the film's friction act
    through the transposed of Y. The oil's own acceleration is that of what flows, v dv/ds
    included.
    """

    at: Near  # faces and film there
    sampling: Sampling  # of the membrane
    given: Densities  # densities and viscosity

    @property
    def still(self) -> Flow:
        """Of a section at rest."""
        return flow_of(self.at.at, self.at.push(0 * self.at.q), self.sampling.water)

    def force(
        self,
        q: StationVector,  # unknowns
        velocity: StationVector,  # of them
        before: Flow,  # that a rate adds to
        length: Array,  # for so long [s]
    ) -> tuple[StationVector, Flow, Flow]:
        """Force on the unknowns, the flow and its rate."""
        at, given = self.at.outline(q), self.given

        def moved(velocity: Array) -> Flow:
            return flow_of(at, self.at.push(velocity), self.sampling.water)

        flow = moved(velocity)
        flow = flow._replace(film=flow.film / at.film)
        rate = jax.tree.map(lambda a, b: (a - b) / length, flow, before)
        weights = weights_of(at, self.sampling.section, self.sampling.water, given)
        pulls = jax.tree.map(jnp.multiply, weights.mass, rate)
        speed = jnp.pad(flow.film, 1) ** 2
        carried = given.oil / 2 * jnp.diff((speed[1:] + speed[:-1]) / 2)
        film = at.film * (pulls.film + weights.damping * flow.film) + carried
        (own,) = jax.linear_transpose(moved, velocity)(pulls._replace(film=film))
        return own, flow, rate

    def stiffness(
        self, velocity: StationVector, length: Array, free: np.ndarray
    ) -> Float[Array, "unknown unknown"]:
        """Derivative of the force by the free unknowns, where these change for some time."""
        near = self.at
        moved = near.by_unknowns(free)
        weights = weights_of(near.at, self.sampling.section, self.sampling.water, self.given)
        flow = flow_of(near.at, jnp.moveaxis(moved, 0, -1), self.sampling.water)
        passing = flow_of(near.at, near.push(velocity), self.sampling.water).film
        film = near.at.film
        closes = jnp.where(near.at.gap > THINNEST_FILM, near.closing(moved), 0.0).T
        closes = (closes[1:] + closes[:-1]) / 2
        by_flow = weights.mass.film / length**2 + weights.damping / length
        by_film = -(weights.mass.film / length + 3 * weights.damping) * passing / film
        rows = by_flow[:, None] * flow.film + by_film[:, None] * closes
        # All three faces: their rotation is part of the mass that short steps balance.
        own = flow.membrane.reshape(-1, len(free))
        mass = (weights.mass.membrane / length**2).reshape(-1, 1)
        water = (weights.mass.water / length**2)[:, None] * flow.water
        matrix: Array = flow.film.T @ rows + flow.water.T @ water
        return matrix + own.T @ (mass * own)
