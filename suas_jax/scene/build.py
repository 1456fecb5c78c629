"""From a scene's numbers to the problem that is solved.

The forward model is a pure function of `continuous_inputs`: this file maps those numbers,
traced or not, to geometry, law, oil and loads. The scene itself only says which classes.
"""

import dataclasses
import functools
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike

from suas_jax.config import (
    LineLoadSpec,
    SceneSpec,
    SkinSpec,
    continuous_inputs,
    structure,
)
from suas_jax.constitutive import AbstractLaw, build_law
from suas_jax.equilibrium.balance import Problem
from suas_jax.mechanics.base import AbstractMechanics
from suas_jax.mechanics.shell.shell import Shell
from suas_jax.mechanics.solid.solid import Solid
from suas_jax.mesh.plan import MeshPlan, load_points, plan_mesh
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.loads import LineLoad
from suas_jax.skin.oil import AbstractOil
from suas_jax.skin.registry import build_oil

# Decay length of what a load or clamp does to the section around it, in thicknesses.
_LOCAL_FIELD = 0.25
# Length of the shortest elements relative to their height.
_SMALLEST = 0.5


def all_numbers(scene: SkinSpec, inputs: Mapping[str, ArrayLike]) -> dict[str, Any]:
    """Every value of a scene by TOML path, the continuous inputs replaced by those given."""
    return {**dict(structure(scene)), **inputs}


def _lane(value: Any) -> Array:
    return jnp.asarray(value, float)[..., None]


def geometry_of(numbers: Mapping[str, Any]) -> SkinGeometry:
    """Dimensions from [geometry]."""
    names = ("inner_radius", "thickness", "half_angle", "width", "oil_gap")
    return SkinGeometry(*(_lane(numbers[f"geometry.{name}"]) for name in names))


def law_of(scene: SkinSpec, numbers: Mapping[str, Any]) -> AbstractLaw:
    """Material law from [material], its constants with a lane axis."""
    return build_law(scene.material, lambda path: _lane(numbers[f"material.{path}"]))


def oil_of(scene: SkinSpec, numbers: Mapping[str, Any]) -> AbstractOil:
    """Oil model from [oil]."""
    return build_oil(scene.oil, lambda key: _lane(numbers[f"oil.{key}"]))


def line_loads_of(scene: SceneSpec, numbers: Mapping[str, Any]) -> list[LineLoad]:
    """The line loads of [[load]], in the order of the file."""
    loads = []
    for i, spec in enumerate(scene.loads):
        if not isinstance(spec, LineLoadSpec):
            continue
        turn = 0.0 if isinstance(spec.direction, str) else numbers[f"load.{i}.direction"]
        spread = None if spec.spread is None else _lane(numbers[f"load.{i}.spread"])
        loads.append(
            LineLoad(
                _lane(numbers[f"load.{i}.angle"]),
                _lane(numbers[f"load.{i}.force"]),
                _lane(turn),
                spread,
                vertical=spec.direction == "vertical",
            )
        )
    return loads


def external_pressure_of(scene: SceneSpec, numbers: Mapping[str, Any]) -> Array:
    """Sum of the uniform pressures of [[load]] [Pa]."""
    total = _lane(0.0)
    for i, spec in enumerate(scene.loads):
        if not isinstance(spec, LineLoadSpec):
            total = total + _lane(numbers[f"load.{i}.pressure"])
    return total


def build_problem(scene: SceneSpec, plan: MeshPlan, inputs: Mapping[str, ArrayLike]) -> Problem:
    """The discrete problem of a scene as a function of its continuous inputs.

    Args:
        scene: says which law, oil and loads; its numbers are not used where `inputs` has
            them.
        plan: the mesh.
        inputs: SI values by TOML path, see `suas_jax.config.continuous_inputs`.
    """
    numbers = all_numbers(scene, inputs)
    geometry = geometry_of(numbers)
    angles, points = load_points(plan, geometry, line_loads_of(scene, numbers))
    law, symmetric = law_of(scene, numbers), plan.symmetric
    mechanics: AbstractMechanics
    if plan.layers:
        layers = plan.layers
        mechanics = Solid.build(
            geometry, law, angles, points, layers=layers, symmetric=symmetric
        )
    else:
        mechanics = Shell.build(geometry, law, angles, points, symmetric=symmetric)
    wanted = None
    if scene.solve.oil_pressure is not None:
        wanted = _lane(numbers["solve.oil_pressure"])
    external = external_pressure_of(scene, numbers)
    return Problem(mechanics, oil_of(scene, numbers), external, wanted)


def _mirror_image(scene: SceneSpec) -> bool:
    """Whether the loads are their own mirror image."""

    def key(load: LineLoadSpec, sign: int) -> tuple[float, float, float, float]:
        turn = 0.0
        if load.direction == "vertical":
            turn = load.angle  # the turn that points a radial force down
        elif not isinstance(load.direction, str):
            turn = load.direction
        return (sign * load.angle, load.force, sign * turn, load.spread or 0.0)

    loads = [load for load in scene.loads if isinstance(load, LineLoadSpec)]
    given = sorted(key(load, 1) for load in loads)
    mirrored = sorted(key(load, -1) for load in loads)
    return bool(np.allclose(given, mirrored, rtol=1e-12, atol=1e-12)) if loads else True


def plan_for(scene: SceneSpec, elements: int, layers: int = 0) -> MeshPlan:
    """Mesh of the whole arc for a scene.

    Args:
        scene: the scene.
        elements: along the whole arc.
        layers: through the thickness, of the solid; none for the lumped shell.
    """
    geometry = scene.geometry
    outer = geometry.inner_radius + geometry.thickness
    numbers, spread = [-geometry.half_angle, geometry.half_angle], []
    for load in scene.loads:
        if isinstance(load, LineLoadSpec):
            half = 0.0 if load.spread is None else load.spread / (2 * outer)
            numbers += (
                [load.angle]
                if load.spread is None
                else [
                    load.angle - half,
                    load.angle + half,
                ]
            )
            spread.append(load.spread is not None)
    layer, symmetric = layer_angle(scene), _mirror_image(scene)
    if not layers:
        return plan_mesh(numbers, spread, elements, layer, symmetric=symmetric)
    # Elements come in pairs: joined, they make the mesh that the error is estimated with.
    thickness = geometry.thickness / outer
    local = (_LOCAL_FIELD * thickness, 2 * _SMALLEST * thickness / layers)
    pairs = plan_mesh(
        numbers, spread, (elements + 1) // 2, layer, symmetric=symmetric, local=local
    )
    return dataclasses.replace(pairs.refined(elements), layers=layers)


@functools.lru_cache(maxsize=64)
def layer_angle(scene: SceneSpec) -> float:
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
        return law_of(scene, all_numbers(scene, numbers)).shear_modulus[0]

    return jax.jit(modulus)(continuous_inputs(scene))
