"""The programs of one known state: its equilibrium, and derivatives of what is read there."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from fitting.sensor.model.constants import AXIAL, FORCE_ZERO, PLACE, PUSH, TOUCH, with_constants
from fitting.sensor.shapes.shape_slopes import Moving, slopes_of
from suas_jax.equilibrium.balance import Problem, State
from suas_jax.equilibrium.correction import Corrected, corrected
from suas_jax.equilibrium.equilibrium import equilibrium
from suas_jax.mechanics.model import AbstractPlan
from suas_jax.mechanics.shape import AbstractFace
from suas_jax.scene.build import Structure, problem_of
from suas_jax.scene.observables import load_observables
from suas_jax.scene.parts import SceneParts, scene_parts
from suas_jax.sensing.electrodes import Electrodes
from suas_jax.sensing.taxels import DISC
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.oil import AbstractOil
from suas_jax.skin.plain import plain_geometry

Inputs = Mapping[str, Any]


class SolvedState(NamedTuple):
    """What a program says of one state, beside face, force and displacement of `Solved`."""

    state: State  # the equilibrium
    face: AbstractFace
    force: Array
    displacement: Array
    gap: Array  # the smallest [m]
    result: Array  # index of the outcome


def _problem(
    scene: Structure, plan: AbstractPlan, inputs: Inputs, oil: AbstractOil | None
) -> tuple[SceneParts, Problem]:
    parts = scene_parts(scene.scene, inputs)
    if oil is not None:
        parts = parts._replace(skin=parts.skin._replace(oil=oil))
    return parts, problem_of(parts, plan)


def _read(
    parts: SceneParts, problem: Problem, found: Corrected, inner: Array
) -> tuple[AbstractFace, Array, Array]:
    """Inner face, forces and displacements of the loads in a known state."""
    root, shown, mechanics = found
    seen = dataclasses.replace(problem, mechanics=mechanics)
    entries = load_observables(parts, seen, shown, problem.mechanics, root)
    keys = ("force_N", "displacement_m", "inner_displacement_m")
    force, mid, below = (jnp.stack([x[key] for x in entries]) for key in keys)
    face = mechanics.face(shown.q)
    if face.varies_along_axis:
        face = taxel_face(face, parts.skin.sensing(), parts.skin.geometry)
    return face, force, jnp.where(inner[:, None], below, mid)


@eqx.filter_jit
def solve_state(
    scene: Structure,
    plan: AbstractPlan,
    inputs: Inputs,
    inner: Array,
    oil: AbstractOil | None,
    start: State,
) -> SolvedState:
    """The equilibrium from a start, without the wall, and what is read of it."""
    parts, problem = _problem(scene, plan, inputs, oil)
    found = equilibrium(problem, start)
    whole = corrected(problem, found.state)
    read = _read(parts, problem, whole, inner)
    gap = problem.mechanics.shape(found.state.q).smallest_gap(parts.skin.geometry).value
    return SolvedState(found.state, *read, gap, found.outcome)


@eqx.filter_jit
def state_slopes(
    scene: Structure,
    plan: AbstractPlan,
    known: tuple[Inputs, Array, Array, Array, Array, Array],
    moving: Moving,
    oil: AbstractOil | None,
    state: State,
    known_equilibrium: Callable[[Problem, State], Corrected],
) -> AbstractFace:
    """See `slopes_of`.

    `known`: numbers, angles [load], forces, what is wanted, inner, which loads press.
    `known_equilibrium`: `corrected`, or `uncorrected`, which takes half as long.
    """
    inputs, angle, force, wanted, inner, pressed = known
    section = plain_geometry(scene.scene.geometry).section

    def shape(values: Array, force: Array) -> tuple[Array, AbstractFace]:
        own = with_constants(scene.scene, inputs, moving.names, values)
        own["load.0.arc"] = section.arc(angle[:1] + moving.shift(PLACE, values))[0]
        own["load.0.axial"] = own["load.0.axial"] + moving.shift(AXIAL, values)
        for i in range(len(force)):
            if f"load.{i}.force" in own:
                push = 1 + moving.shift(PUSH, values) if i == 0 else 1
                zero = pressed[i] * moving.shift(FORCE_ZERO, values)
                own[f"load.{i}.force"] = push * force[i, 0] - zero
            if f"load.{i}.depth" in own:
                own[f"load.{i}.depth"] -= pressed[i] * moving.shift(TOUCH, values)
        parts, problem = _problem(scene, plan, own, oil)
        found = known_equilibrium(problem, state)
        face, _, moved = _read(parts, problem, found, inner)
        moved = moved + (pressed * moving.shift(TOUCH, values))[:, None]
        return moved, eqx.filter(face, eqx.is_inexact_array)

    return slopes_of(shape, moving.values, force, wanted)


class TaxelFace(AbstractFace):
    """A deformed inner face that is known along the taxels' own rays alone."""

    varies_along_axis: ClassVar[bool] = True
    # over the undeformed face, ray by ray [ray, taxel, state] [m]
    heights: Float[Array, "ray taxel state"]

    def gaps(
        self, rays: Sequence[tuple[Array, Array]], geometry: SkinGeometry
    ) -> list[Float[Array, "taxel state"]]:
        """Gaps along the rays that the heights are of; see the base class."""
        assert len(rays) == len(self.heights)
        pairs = zip(self.heights, rays, strict=True)
        return [height + geometry.gap(angle, axial) for height, (angle, axial) in pairs]

    def height(self, angle: Array, axial: Array) -> Array:
        """See the base class.

        Raises ValueError: always; heights are known along the taxels' own rays alone.
        """
        raise ValueError("a calibration knows the pad along its taxels' own rays alone")


def taxel_face(face: AbstractFace, electrodes: Electrodes, geometry: SkinGeometry) -> TaxelFace:
    """What of a pad's inner face the taxels see."""
    rays = electrodes.taxels.rays(DISC, geometry)
    pairs = zip(face.gaps(rays, geometry), rays, strict=True)
    return TaxelFace(jnp.stack([gap - geometry.gap(*ray) for gap, ray in pairs]))
