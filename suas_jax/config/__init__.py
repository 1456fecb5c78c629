"""Configuration: skins and scenes in TOML files, with units, to immutable specifications.

Importing it starts neither JAX nor the units library. It has the declarations of laws, oils and
sections (`GentSpec`, `CompressibleOilSpec` ...), too.
"""

from typing import Any

from suas_jax.config.errors import ConfigError, Mistake
from suas_jax.config.geometry import AlongSpec, GeometrySpec, SheetSpec
from suas_jax.config.input_errors import InputErrors, input_errors
from suas_jax.config.inputs import continuous_inputs, structure, with_inputs, with_solve
from suas_jax.config.law import LawSpec
from suas_jax.config.load import load_scene, load_skin, scene_from_dict
from suas_jax.config.oil import OilSpec
from suas_jax.config.presets import load_preset, preset_names
from suas_jax.config.quantities import format_quantity, parse_quantity
from suas_jax.config.schema_load import (
    BodyLoadSpec,
    EnvironmentSpec,
    LineLoadSpec,
    LoadSpec,
    PatchLoadSpec,
    PressureLoadSpec,
    ReferenceSpec,
)
from suas_jax.config.schema_scene import LAWS, OILS, SECTIONS, MaterialSpec, SceneSpec, SkinSpec
from suas_jax.config.schema_skin import (
    ElectrodesSpec,
    LayerSpec,
    ModuleSpec,
    SoftLayerSpec,
    TaxelSpec,
    WallSpec,
)
from suas_jax.config.schema_solve import SolveSpec
from suas_jax.config.tolerance import UncertainQuantity


def __getattr__(name: str) -> Any:
    for declaration in (*LAWS.values(), *OILS.values(), *SECTIONS.values()):
        if declaration.__name__ == name:
            return declaration
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
