"""The membrane's shape under rigid bodies that are pressed in by known travels.

A body stands for itself: a cylinder on a section, a ball on a pad. Its travel fixes the shape
almost alone, as a known displacement does, but the skin is free to slide beneath it. Every
state is a scene of its own; scenes that differ in numbers alone share one program.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from fitting.arrays import Floats
from fitting.sensor.logs.known_loads import KnownLoads
from fitting.sensor.model.constants import with_constants
from fitting.sensor.shapes.deformations import NoDeformation
from fitting.sensor.shapes.pad_deformations import taxel_face
from fitting.sensor.shapes.shape_slopes import Moving
from suas_jax.config import BodyLoadSpec, SceneSpec, SkinSpec, SolveSpec
from suas_jax.equilibrium.balance import Problem, State
from suas_jax.equilibrium.correction import corrected
from suas_jax.equilibrium.equilibrium import equilibrium
from suas_jax.equilibrium.outcomes import NAMES, advice
from suas_jax.mechanics.face import AbstractFace
from suas_jax.mechanics.model import AbstractPlan
from suas_jax.mechanics.registry import MODELS
from suas_jax.numerics.lanes import number
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.build import plan_for, problem_of
from suas_jax.scene.observables import load_observables
from suas_jax.scene.parts import SceneParts, scene_parts
from suas_jax.scene.program import inputs_of
from suas_jax.scene.structure import Structure
from suas_jax.skin.oil import AbstractOil
from suas_jax.skin.plain import plain_geometry


@dataclasses.dataclass(frozen=True)
class BodyDeformed:
    """Solved states.

    Attributes:
        face: the deformed inner faces.
        force: of each body, found [load, state] [N].
        displacement: of the material under its reference point, inwards [load, state] [m].
        state: the equilibria, one a state.
    """

    face: AbstractFace
    force: Floats
    displacement: Floats
    state: list[State]


def deform_by_bodies(
    loads: KnownLoads, spec: SkinSpec, inputs: Mapping[str, Array], oil: AbstractOil | None
) -> BodyDeformed:
    """Find the shape of the membrane in every state.

    Args:
        loads: places, radii and travels of bodies.
        spec: the skin.
        inputs: SI values by TOML path.
        oil: how the fluid answers, if not as the skin file says.

    Raises:
        NoDeformation: a state has no equilibrium.
    """
    faces, forces, moved, states = [], [], [], []
    for k in range(loads.states):
        scene, plan, numbers = _prepared(spec, loads, k, inputs)
        face, force, u, state, gap, result = COMPILED.run(_solved, scene, plan, numbers, oil)
        where = ", ".join(
            f"{1e3 * d:.4g} mm deep at {np.rad2deg(a):.4g} deg"
            for d, a in zip(loads.depth[:, k], loads.angle[:, k], strict=True)
        )
        if found := int(number(result)):
            raise NoDeformation(
                f"a body {where}: {NAMES[found]}. {advice(NAMES[found])}; check the columns' "
                f"units"
            )
        if number(gap) <= 0:
            raise NoDeformation(
                f"a body {where} presses the membrane onto the wall; leave such rows out"
            )
        faces.append(face)
        forces.append(np.asarray(force))
        moved.append(np.asarray(u))
        states.append(state)
    joined: AbstractFace = jax.tree.map(lambda *x: np.concatenate(x, -1), *faces)
    return BodyDeformed(joined, np.concatenate(forces, -1), np.concatenate(moved, -1), states)


def body_shape_slopes(
    found: BodyDeformed,
    loads: KnownLoads,
    spec: SkinSpec,
    inputs: Mapping[str, Array],
    moving: Mapping[str, float],
    oil: AbstractOil | None,
) -> AbstractFace:
    """How the faces change with constants that move the membrane; see `shape_slopes`."""
    slopes = []
    for k, state in enumerate(found.state):
        scene, plan, numbers = _prepared(spec, loads, k, inputs)
        slopes.append(
            COMPILED.run(_slopes, scene, plan, numbers, oil, state, Moving.of(moving))
        )
    together: AbstractFace = jax.tree.map(lambda *x: np.concatenate(x, -1), *slopes)
    return together


def _prepared(
    spec: SkinSpec, loads: KnownLoads, k: int, inputs: Mapping[str, Array]
) -> tuple[Structure, AbstractPlan, dict[str, Any]]:
    """A state as a scene: its structure, its mesh and its numbers."""
    flat = spec.geometry.dimension == 2
    section = plain_geometry(spec.geometry).section
    bodies = [
        BodyLoadSpec(
            shape="cylinder" if flat else "sphere",
            radius=float(loads.radius[i, k]),
            arc=float(section.arc(loads.angle[i, k])[0]),
            axial=float(loads.axial[i, k]),
            depth=float(loads.depth[i, k]),
        )
        for i in range(len(loads.depth))
    ]
    given = {name: getattr(spec, name) for name in spec.model_fields_set}
    solve = SolveSpec(symmetry=False)
    scene = SceneSpec(**given, load=tuple(bodies), solve=solve)
    counts = MODELS[spec.geometry.dimension]["shell"].first(scene)
    plan = plan_for(scene, "shell", counts)
    return Structure(scene), plan, {**inputs_of(scene), **inputs}


def _problem(
    scene: Structure, plan: AbstractPlan, inputs: Mapping[str, Any], oil: AbstractOil | None
) -> tuple[SceneParts, Problem]:
    parts = scene_parts(scene.scene, inputs)
    if oil is not None:
        parts = parts._replace(skin=parts.skin._replace(oil=oil))
    return parts, problem_of(parts, plan)


def _read(
    parts: SceneParts, problem: Problem, state: State
) -> tuple[AbstractFace, Array, Array]:
    """Inner face, forces and displacements of the bodies in a known state."""
    root, shown, mechanics = corrected(problem, state)
    held = problem.mechanics
    problem = dataclasses.replace(problem, mechanics=mechanics)
    entries = load_observables(parts, problem, shown, held, root)
    force, moved = (
        jnp.stack([x[key] for x in entries]) for key in ("force_N", "displacement_m")
    )
    face = mechanics.face(shown.q)
    if face.varies_along_axis:
        face = taxel_face(face, parts.skin.sensing(), parts.skin.geometry)
    return face, force, moved


@eqx.filter_jit
def _solved(
    scene: Structure, plan: AbstractPlan, inputs: Mapping[str, Any], oil: AbstractOil | None
) -> tuple[AbstractFace, Array, Array, State, Array, Array]:
    parts, problem = _problem(scene, plan, inputs, oil)
    found = equilibrium(problem)
    face, force, moved = _read(parts, problem, found.state)
    gap = problem.mechanics.shape(found.state.q).smallest_gap(parts.skin.geometry).value
    return face, force, moved, found.state, gap, found.result


@eqx.filter_jit
def _slopes(
    scene: Structure,
    plan: AbstractPlan,
    inputs: Mapping[str, Any],
    oil: AbstractOil | None,
    state: State,
    moving: Moving,
) -> AbstractFace:
    def face(values: Array) -> AbstractFace:
        own = with_constants(scene.scene, inputs, moving.names, values)
        parts, problem = _problem(scene, plan, own, oil)
        return eqx.filter(_read(parts, problem, state)[0], eqx.is_inexact_array)

    slope = jax.jacfwd(face)(moving.values)
    in_front: AbstractFace = jax.tree.map(lambda x: jnp.moveaxis(x, -1, 0), slope)
    return in_front
