"""Configuration: skins and scenes in TOML files, with units, to immutable specifications.

Importing this package starts neither JAX nor the units library.
"""

from suas_jax.config.errors import ConfigError, Problem
from suas_jax.config.inputs import continuous_inputs, structure, with_inputs, with_solve
from suas_jax.config.load import load_scene, load_skin, scene_from_dict
from suas_jax.config.presets import load_preset, preset_names
from suas_jax.config.quantities import format_quantity, parse_quantity
from suas_jax.config.schema_load import (
    EnvironmentSpec,
    LineLoadSpec,
    LoadSpec,
    PressureLoadSpec,
)
from suas_jax.config.schema_material import (
    ArrudaBoyceSpec,
    GentSpec,
    MaterialSpec,
    MooneyRivlinSpec,
    NeoHookeanSpec,
    OgdenSpec,
    PolynomialSpec,
    YeohSpec,
)
from suas_jax.config.schema_scene import SceneSpec, SkinSpec
from suas_jax.config.schema_skin import (
    ElectrodesSpec,
    GeometrySpec,
    LayerSpec,
    ModuleSpec,
    OilSpec,
    TaxelSpec,
)
from suas_jax.config.schema_solve import SolveSpec

__all__ = [
    "ArrudaBoyceSpec",
    "ConfigError",
    "ElectrodesSpec",
    "EnvironmentSpec",
    "GentSpec",
    "GeometrySpec",
    "LayerSpec",
    "LineLoadSpec",
    "LoadSpec",
    "MaterialSpec",
    "ModuleSpec",
    "MooneyRivlinSpec",
    "NeoHookeanSpec",
    "OgdenSpec",
    "OilSpec",
    "PolynomialSpec",
    "PressureLoadSpec",
    "Problem",
    "SceneSpec",
    "SkinSpec",
    "SolveSpec",
    "TaxelSpec",
    "YeohSpec",
    "continuous_inputs",
    "format_quantity",
    "load_preset",
    "load_scene",
    "load_skin",
    "parse_quantity",
    "preset_names",
    "scene_from_dict",
    "structure",
    "with_inputs",
    "with_solve",
]
