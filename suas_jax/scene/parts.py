"""The parts of a scene, made once from its numbers (`continuous_inputs`), traced or not."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike

from suas_jax.config import SceneSpec, SkinSpec, structure
from suas_jax.config.schema_scene import NO_ELECTRODES
from suas_jax.constitutive import AbstractLaw, build_law
from suas_jax.numerics.array_types import Lanes
from suas_jax.runtime.compiled import COMPILED
from suas_jax.runtime.content_key import Keyed
from suas_jax.sensing.electrodes import Electrodes, electrodes_of
from suas_jax.skin.body import Body
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.loads import DeadLoad, LineLoad, PadLoad, angle_of
from suas_jax.skin.oil import AbstractOil
from suas_jax.skin.plain import charted, shape_key
from suas_jax.skin.prestress import Prestress, ambient_pressure
from suas_jax.skin.registry import build_geometry, build_oil
from suas_jax.skin.wall import RigidLimit, Wall


class SkinParts(NamedTuple):
    """A skin's objects; arrays have a lane axis."""

    geometry: SkinGeometry  # dimensions
    law: AbstractLaw  # the membrane's material
    oil: AbstractOil  # how the oil answers
    # taxels and the converter's scale; None where nothing is sensed
    electrodes: Electrodes | None
    wall: Wall | None  # what may hold the membrane; None where it passes through

    def sensing(self) -> Electrodes:
        """The electrodes; ValueError where the skin has none."""
        if self.electrodes is None:
            raise ValueError(NO_ELECTRODES)
        return self.electrodes


class SceneParts(NamedTuple):
    """A scene's objects; arrays have a lane axis."""

    skin: SkinParts  # the skin's objects
    forces: list[DeadLoad]  # the dead loads, in the order of the file
    bodies: list[Body]  # that are pressed on the skin, in the order of the file
    pressures: list[Lanes]  # of the uniform pressure loads, in the order of the file [Pa]
    # wanted oil pressure [Pa]; None where loads are given as they are
    oil_pressure: Lanes | None
    ambient_pressure: Lanes | None  # of the water around [Pa]; None where no depth is given
    scene: SceneSpec  # the specification, which says how to solve and what to call things

    @property
    def external_pressure(self) -> Lanes:
        """Sum of the uniform pressures [Pa]."""
        return sum(self.pressures, jnp.zeros(1))


class SkinStructure(Keyed):
    """A skin compared by its section, and of the rest by all but its numbers."""

    def __init__(self, spec: SkinSpec) -> None:
        self.spec, self.key = spec, (structure(spec), shape_key(spec.geometry))


@eqx.filter_jit
def _compiled(skin: SkinStructure, inputs: Mapping[str, ArrayLike]) -> SkinParts:
    return _skin(skin.spec, _all_numbers(skin.spec, inputs))


def skin_parts(spec: SkinSpec, inputs: Mapping[str, ArrayLike]) -> SkinParts:
    """Make a skin's objects.

    A circle's few numbers need no program; the curves of other sections are made by one that
    is kept between runs.

    `spec`: says which classes; its numbers are not used where `inputs` has them. `inputs`: SI
    values by TOML path, see `suas_jax.config.continuous_inputs`.
    """
    traced = any(isinstance(x, jax.core.Tracer) for x in inputs.values())
    if traced or not charted(spec.geometry):
        return _skin(spec, _all_numbers(spec, inputs))
    numbers = {path: np.asarray(x, float) for path, x in inputs.items()}
    found: SkinParts = COMPILED.run(_compiled, SkinStructure(spec), numbers, once=True)
    return found


def scene_parts(
    scene: SceneSpec, inputs: Mapping[str, ArrayLike], law: AbstractLaw | None = None
) -> SceneParts:
    """Make a scene's objects, as `skin_parts` does a skin's.

    The membrane's `law`, its constants with a lane axis, may be another than the scene's own.
    """
    numbers = _all_numbers(scene, inputs)
    skin = skin_parts(scene, inputs) if law is None else _skin(scene, numbers, law)
    section = skin.geometry.section
    forces: list[DeadLoad] = []
    bodies, pressures = [], []
    flat = scene.geometry.dimension == 2
    for i, spec in enumerate(scene.loads):
        path = f"load.{i}."
        if spec.kind == "pressure":
            pressures.append(_lane(numbers[path + "pressure"]))
            continue
        lane = _lanes_of_load(numbers, path)
        if spec.kind == "body":
            places = angle_of(spec, section, lane), None if flat else lane("axial")
            rigid = RigidLimit.of(skin.law.shear_modulus, skin.geometry.thickness)
            bodies.append(Body.of(spec, section, places, lane, rigid))
        elif not flat:
            angle = angle_of(spec, section, lane)
            forces.append(PadLoad.of(spec, angle, lane, skin.geometry.width))
        else:
            assert spec.kind == "line"  # a scene with a patch in plane strain is refused
            forces.append(LineLoad.of(spec, section, lane))
    wanted = ambient = None
    if scene.solve.oil_pressure is not None:
        wanted = _lane(numbers["solve.oil_pressure"])
    environment = scene.environment
    if environment is not None and environment.depth is not None:
        ambient = ambient_pressure(_lanes_in(numbers))
    return SceneParts(skin, forces, bodies, pressures, wanted, ambient, scene)


def law_of(spec: SkinSpec, inputs: Mapping[str, ArrayLike]) -> AbstractLaw:
    """Material law from [material], its constants with a lane axis."""
    return _law(spec, _all_numbers(spec, inputs))


def _all_numbers(spec: SkinSpec, inputs: Mapping[str, ArrayLike]) -> dict[str, Any]:
    """Every value by TOML path, the continuous inputs replaced by those given."""
    return {**dict(structure(spec)), **inputs}


def _lane(value: Any) -> Array:
    return jnp.asarray(value, float)[..., None]


def _lanes_in(numbers: Mapping[str, Any], table: str = "") -> Callable[[str], Array]:
    """Values of a table by key, with a lane axis."""
    return lambda key: _lane(numbers[table + key])


def _lanes_of_load(numbers: Mapping[str, Any], table: str) -> Callable[[str], Array]:
    """The same of a load, whose keys may be left out."""
    return lambda key: _lane(0.0 if (x := numbers[table + key]) is None else x)


def _skin(
    spec: SkinSpec, numbers: Mapping[str, Any], law: AbstractLaw | None = None
) -> SkinParts:
    prestress = Prestress.of(spec, _lanes_in(numbers))
    geometry = build_geometry(spec.geometry, _lanes_in(numbers, "geometry."), prestress)
    electrodes = electrodes_of(spec, numbers, geometry, prestress.warmed)
    law = law or _law(spec, numbers)
    wall = None
    if spec.wall.contact:
        lane, layer = _lanes_in(numbers, "wall.layer."), None
        if spec.wall.layer is not None:
            layer = lane("thickness"), lane("stiffness")
        wall = Wall.of(geometry, law.shear_modulus, layer)
    oil = prestress.contain(build_oil(spec.oil, _lanes_in(numbers, "oil.")))
    return SkinParts(geometry, law, oil, electrodes, wall)


def _law(spec: SkinSpec, numbers: Mapping[str, Any]) -> AbstractLaw:
    return build_law(spec.material, _lanes_in(numbers, "material."))
