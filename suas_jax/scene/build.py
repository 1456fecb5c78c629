"""From a scene to the discrete problem that is solved: its mesh, and its mechanics there."""

import functools
from collections.abc import Mapping

import jax
import numpy as np
from jaxtyping import Array, ArrayLike

from suas_jax.config import LineLoadSpec, SceneSpec, continuous_inputs
from suas_jax.equilibrium.balance import Problem
from suas_jax.mechanics.model import AbstractPlan, Counts
from suas_jax.mechanics.registry import MODELS
from suas_jax.scene.parts import SceneParts, law_of, scene_parts


def plan_for(scene: SceneSpec, model: str, counts: Counts) -> AbstractPlan:
    """Mesh of the whole membrane for a scene.

    Args:
        scene: the scene.
        model: name of the model.
        counts: size of the mesh, as the model orders it.
    """
    return MODELS[model].plan(scene, counts, decay_angle(scene))


def problem_of(parts: SceneParts, plan: AbstractPlan) -> Problem:
    """The discrete problem of a scene's parts on a mesh."""
    skin = parts.skin
    mechanics = MODELS[plan.model].build(plan, skin.geometry, skin.law, parts.lines)
    return Problem(mechanics, skin.oil, parts.external_pressure, parts.oil_pressure)


def build_problem(
    scene: SceneSpec, plan: AbstractPlan, inputs: Mapping[str, ArrayLike]
) -> Problem:
    """The discrete problem of a scene as a function of its continuous inputs.

    Args:
        scene: says which law, oil and loads; its numbers are not used where `inputs` has
            them.
        plan: the mesh.
        inputs: SI values by TOML path, see `suas_jax.config.continuous_inputs`.
    """
    return problem_of(scene_parts(scene, inputs), plan)


@functools.lru_cache(maxsize=64)
def decay_angle(scene: SceneSpec) -> float:
    """Decay length of the boundary layers as an angle [rad].

    Where tension N and bending stiffness D meet, displacement decays over sqrt(D / N),
    with D = mu t^3 / 3 (plane strain, incompressible) and N = p R. Where the pressure is
    not known, a line load that pulls the membrane into a tent has N of a few times its
    force per width; the mesh needs the order of magnitude only.
    """
    g = scene.geometry
    radius = g.inner_radius + g.thickness / 2
    stiffness = float(_shear_modulus(scene)) * g.thickness**3 / 3
    if scene.solve.oil_pressure is not None:
        tension = abs(scene.solve.oil_pressure) * radius
    else:
        forces = [abs(s.force) for s in scene.loads if isinstance(s, LineLoadSpec)]
        pressures = [abs(s.pressure) for s in scene.loads if not isinstance(s, LineLoadSpec)]
        trapped = scene.oil.trapped
        tension = (3 * sum(forces) / g.width if trapped else 0.0) + sum(pressures) * radius
    if tension <= 0:
        return 1.0
    return min(1.0, float(np.sqrt(stiffness / tension)) / radius)


def _shear_modulus(scene: SceneSpec) -> Array:
    """Small-strain shear modulus of the membrane [Pa], compiled as one program."""

    def modulus(numbers: dict[str, ArrayLike]) -> Array:
        return law_of(scene, numbers).shear_modulus[0]

    return jax.jit(modulus)(continuous_inputs(scene))
