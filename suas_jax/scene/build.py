"""From a scene to the discrete problem that is solved: its program, its mesh, its mechanics."""

import functools
from collections.abc import Mapping

import jax
import numpy as np
from jaxtyping import Array, ArrayLike

from suas_jax.config import SceneSpec, continuous_inputs, structure
from suas_jax.equilibrium.balance import Problem
from suas_jax.mechanics.model import AbstractPlan, Counts
from suas_jax.mechanics.registry import MODELS
from suas_jax.mesh.section import measures
from suas_jax.runtime.content_key import Keyed
from suas_jax.scene.parts import SceneParts, law_of, scene_parts
from suas_jax.sensing.taxels import check_taxels
from suas_jax.skin.prestress import water_rise

Inputs = Mapping[str, ArrayLike]


class Structure(Keyed):
    """A scene compared by what decides the compiled program, with its wall or without it."""

    def __init__(self, scene: SceneSpec, *, wall: bool = False) -> None:
        self.scene = scene
        self.wall = wall
        self.key = (structure(scene), wall)


def plan_for(
    scene: SceneSpec, model: str, counts: Counts, slid: tuple[float, ...] = ()
) -> AbstractPlan:
    """Mesh of the whole membrane for a scene, of a model and of a size as the model orders it.

    Of `slid` see `AbstractModel.plan`. Raises ConfigError: the section can't be, or a load or a
    taxel lies off it.
    """
    if scene.electrodes is not None:
        check_taxels(scene.electrodes, scene.geometry)
    plan = MODELS[scene.geometry.dimension][model].plan
    return plan(scene, counts, decay_angle(scene), slid)


def problem_of(parts: SceneParts, plan: AbstractPlan, *, wall: bool = False) -> Problem:
    """The discrete problem of a scene's parts on a mesh.

    The skin's `wall` changes nothing of a state whose gap is open everywhere, and costs.
    """
    skin = parts.skin
    model = MODELS[plan.dimension][plan.model]
    mechanics = model.build(plan, skin.geometry, skin.law, parts.forces, parts.bodies)
    mechanics = mechanics.with_wall(skin.wall if wall else None)
    return Problem(mechanics, skin.oil, parts.external_pressure, parts.oil_pressure)


def build_problem(
    # says which law, oil and loads; its numbers are not used where `inputs` has them
    scene: SceneSpec,
    plan: AbstractPlan,
    # SI values by TOML path, see `suas_jax.config.continuous_inputs`
    inputs: Mapping[str, ArrayLike],
    *,
    wall: bool = False,  # see `problem_of`
) -> Problem:
    """The same as a function of the scene's continuous inputs."""
    return problem_of(scene_parts(scene, inputs), plan, wall=wall)


@functools.lru_cache(maxsize=64)
def decay_angle(scene: SceneSpec) -> float:
    """Decay length of the boundary layers as an angle [rad].

    Where tension N and bending stiffness D meet, displacement decays over sqrt(D / N),
    with D = mu t^3 / 3 (plane strain, incompressible) and N = p R. Where the pressure is
    not known, a line load that pulls the membrane into a tent has N of a few times its
    force per width; the mesh needs the order of magnitude only. Trapped oil takes over what
    presses from all sides, a load or the water's depth, up to what would buckle the arch.
    """
    g = scene.geometry
    radius = measures(scene).size
    modulus = float(_shear_modulus(Structure(scene), continuous_inputs(scene)))
    stiffness = modulus * g.mean_thickness**3 / 3
    if scene.solve.oil_pressure is not None:
        tension = abs(scene.solve.oil_pressure) * radius
    else:
        pressures = [abs(s.pressure) for s in scene.loads if s.kind == "pressure"]
        forces = [abs(s.force) for s in scene.loads if s.kind in ("line", "patch")]
        # A body stretches the membrane that its travel makes bulge. That of half the gap stands
        # for all: meshes shall not depend on whether a travel or a force is given.
        bulged = bool(scene.bodies) * 0.5 * g.mean_gap / radius
        tension, pressure = 0.0, sum(pressures)
        if scene.oil.trapped:
            tension = 3 * sum(forces) / g.width
            tension += 12 * stiffness / g.mean_thickness**2 * bulged**2
            pressure = min(pressure + abs(water_rise(scene)), 8 * stiffness / radius**3)
        tension += pressure * radius
    if tension <= 0:
        return 1.0
    return min(1.0, float(np.sqrt(stiffness / tension)) / radius)


@functools.partial(jax.jit, static_argnums=0)
def _shear_modulus(scene: Structure, inputs: Mapping[str, ArrayLike]) -> Array:
    """Small-strain shear modulus of the membrane [Pa]: one program for all its constants."""
    return law_of(scene.scene, inputs).shear_modulus[0]
