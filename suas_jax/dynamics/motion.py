"""Small motions of a section about a state: stiffness, and how its faces move.

Everything is a matrix over the membrane's unknowns, per width along the axis. The stiffness is
the tangent of the equilibrium; faces and film are polylines through samples of every element,
with the derivatives of their points by the unknowns.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.equilibrium.balance import State
from suas_jax.mechanics.model import AbstractPlan
from suas_jax.mechanics.shell.shell import Shell
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.build import problem_of
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.program import inputs_of, structure_of
from suas_jax.scene.solve import Solution
from suas_jax.scene.structure import Inputs, Structure

# Intervals of an element: faces are polylines, whose error goes with the square.
_SAMPLES = 6


class Face(NamedTuple):
    """A line of the section.

    Attributes:
        position: of its points in the state [m].
        moved: displacement of the points by the unknowns.
    """

    position: Float[np.ndarray, "2 point"]
    moved: Float[np.ndarray, "2 point unknown"]

    def flux(self) -> Float[np.ndarray, "segment unknown"]:
        """Area that each segment sweeps outwards, by the unknowns: the normal motion."""
        x, y = np.diff(self.position)[..., None]
        mean = (self.moved[:, 1:] + self.moved[:, :-1]) / 2
        swept: np.ndarray = x * mean[1] - y * mean[0]
        return swept

    def lengths(self) -> Float[np.ndarray, " segment"]:
        """Of its segments [m]."""
        return np.hypot(*np.diff(self.position))


class Motion(NamedTuple):
    """What small motions of a section are made of, for its free unknowns.

    Attributes:
        stiffness: tangent of the membrane under pressure and dead loads [N/m^2].
        omitted: second derivative of the energy that the shell leaves out.
        volume: derivative of the enclosed volume.
        compliance: of the oil, derivative of its volume by its pressure, zero or less [m^2/Pa].
        inner: the inner face.
        middle: the mid-line.
        outer: the outer face.
        wall: its points beneath those of the inner face [m].
        gap: thickness of the film along the normal of the undeformed inner face [m].
        mass: cross-section of the membrane's segments [m^2].
    """

    stiffness: Float[np.ndarray, "unknown unknown"]
    omitted: Float[np.ndarray, "unknown unknown"]
    volume: Float[np.ndarray, " unknown"]
    compliance: float
    inner: Face
    middle: Face
    outer: Face
    wall: Float[np.ndarray, "2 point"]
    gap: Float[np.ndarray, " point"]
    mass: Float[np.ndarray, " segment"]

    def shapes(
        self, vectors: Float[np.ndarray, "unknown mode"]
    ) -> Float[np.ndarray, "mode face 2 point"]:
        """Displacement of the inner and the outer face, the largest component being one."""
        moved = np.stack([self.inner.moved, self.outer.moved]) @ vectors
        shapes = np.moveaxis(moved, -1, 0)
        scaled: np.ndarray = shapes / np.max(np.abs(shapes), (1, 2, 3), keepdims=True)
        return scaled


@eqx.filter_jit
def _program(scene: Structure, plan: AbstractPlan, inputs: Inputs, state: State) -> Motion:
    parts = scene_parts(scene.scene, inputs)
    problem = problem_of(parts, plan, wall=scene.wall)
    shell, geometry, q = problem.mechanics, parts.skin.geometry, state.q
    assert isinstance(shell, Shell)
    net = state.pressure - state.factor * problem.external_pressure
    a = shell.assemble(q, net, state.factor)
    unit = jnp.eye(q.size).reshape(q.size, *q.shape)
    free = np.flatnonzero(np.broadcast_to(shell.elements.free(), q.shape))

    def pull(q: Array) -> Array:
        return shell.omitted_gradient(q, state.factor)

    def faces(q: Array) -> Array:
        shape = shell.profile(q, _SAMPLES)
        rows = shape.inner_displacement, shape.mid_displacement, shape.outer_displacement
        # Along the arc: samples of an element after one another.
        return jnp.stack(rows)[..., 0].swapaxes(-1, -2).reshape(3, 2, -1)

    _, bend = jax.linearize(pull, q)
    moved, move = jax.linearize(faces, q)
    omitted = jax.vmap(bend)(unit).reshape(q.size, q.size)
    stiffness = jax.vmap(a.tangent.mv)(unit).reshape(q.size, q.size)
    points: Any = jnp.moveaxis(jax.vmap(move)(unit[free]), 0, -1)

    angle = shell.profile(q, _SAMPLES).angle[..., 0].T.reshape(-1, 1)
    section = geometry.section
    middle, normal = section.mid_line(angle), section.frame(angle).normal
    half = (section.thickness(angle) + 0 * angle) / 2 * normal
    inner, middle, outer = (
        (rest + by)[..., 0]
        for rest, by in zip(
            (section.inner_face(angle), middle, middle + half), moved[..., None], strict=True
        )
    )
    foot, height = section.foot(inner[..., None], angle)
    gap = geometry.gap(foot)
    wall = section.inner_face(foot) - gap * section.inner_normal(foot)
    thick = (section.thickness(angle) + 0 * angle)[:, 0]
    mass = section.size * jnp.diff(angle[:, 0]) * (thick[1:] + thick[:-1]) / 2
    volume = a.volume_gradient.reshape(-1)[free]
    compliance = problem.oil.compliance(state.pressure, shell.film_volume)[0]
    cut = np.ix_(free, free)
    found: dict[str, Any] = {
        "stiffness": stiffness[cut],
        "omitted": omitted[cut],
        "volume": volume,
        "compliance": compliance,
        "inner": Face(inner, points[0]),
        "middle": Face(middle, points[1]),
        "outer": Face(outer, points[2]),
        "wall": wall[..., 0],
        "gap": (height + gap)[:, 0],
        "mass": mass,
    }
    return Motion(**found)


def motion_of(solution: Solution) -> Motion:
    """Small motions about a solved section.

    Args:
        solution: of a scene in plane strain, by the shell, with trapped oil.
    """
    scene = structure_of(solution.scene, wall=solution.wall)
    inputs = inputs_of(solution.scene)
    found = COMPILED.run(_program, scene, solution.plan, inputs, solution.state, once=True)
    motion: Motion = jax.tree.map(np.asarray, found)
    return motion
