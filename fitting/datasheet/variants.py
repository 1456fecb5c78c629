"""A skin and its neighbours: each tolerance moved to either side, warmer and deeper water."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from fitting.arrays import Floats
from suas_jax.config import InputErrors, SkinSpec, input_errors
from suas_jax.config.input_errors import as_assembled, value_of
from suas_jax.config.schema_load import EnvironmentSpec
from suas_jax.skin.prestress import unloaded_depth

WARMER, DEEPER = "environment.temperature", "environment.depth"
STEP = 0.02
"""Of a standard deviation, a kelvin or a metre: far inside what is linear."""
# Inputs that no one states a share of: their units in SI, and what a person calls them.
_UNITS = {
    "temperature": (1.0, "K"),
    "depth": (1.0, "m"),
    "mounting": (1e-2, "%"),
    "mounting_axial": (1e-2, "%"),
    "angle": (np.pi / 180, "deg"),
    "arc": (1e-3, "mm"),
    "axial": (1e-3, "mm"),
}


@dataclass(frozen=True)
class Variants:
    """A skin, then each change of its inputs downwards and upwards."""

    spec: SkinSpec  # names every input that moves
    errors: InputErrors  # its tolerances
    # values by TOML path [skin]: the skin's own, then two a change
    inputs: dict[str, np.ndarray]

    @property
    def changes(self) -> tuple[str, ...]:
        """What moves: the tolerances by name, then `WARMER` by 1 K and `DEEPER` by 1 m."""
        return (*self.errors.names, WARMER, DEEPER)

    def size(self, change: int) -> tuple[float, str] | None:
        """One standard deviation of a tolerance and its unit; None of a joint one of several.

        A share of the number where nothing else is usual for it.
        """
        row = self.errors.directions[change]
        paths = [self.errors.paths[k] for k in np.flatnonzero(row)]
        own = np.array([value_of(self.spec, path) for path in paths])
        size = row[row != 0]
        if len(paths) == 1:
            key = paths[0].rpartition(".")[2]
            if key in _UNITS:
                scale, unit = _UNITS[key]
                return abs(float(size[0])) / scale, unit
        shares = np.abs(size) / np.where(own == 0, np.nan, np.abs(own))
        alike = bool(len(shares)) and bool(np.ptp(shares) <= 1e-9 * shares[0])
        return (100 * float(shares[0]), "%") if alike else None

    @staticmethod
    def slopes(values: Floats, axis: int = 0) -> Floats:
        """Derivatives by the changes of what has an axis of skins, from its values."""
        return np.moveaxis(by_changes(np.moveaxis(values, axis, 0)), 0, axis)


def by_changes(values: Any) -> Any:
    """Derivatives by the changes, from values of the skin and its neighbours [skin, ...]."""
    return (values[2::2] - values[1::2]) / (2 * STEP)


def named(spec: SkinSpec) -> SkinSpec:
    """The skin with every input named that may move; its numbers are the same."""
    spec = as_assembled(spec)
    around = spec.environment or EnvironmentSpec()
    own = {}
    if around.temperature is None:
        own["temperature"] = spec.reference.temperature
    if around.depth is None:
        own["depth"] = unloaded_depth(around, spec.reference)
    tables: dict[str, Any] = {"environment": around.model_copy(update=own)}
    if spec.geometry.mounting is None:
        tables["geometry"] = spec.geometry.model_copy(update={"mounting": 0.0})
    if spec.electrodes is not None:
        lsb = {"lsb": spec.electrodes.lsb}
        tables["electrodes"] = spec.electrodes.model_copy(update=lsb)
    return spec.model_copy(update=tables)


def variants_of(spec: SkinSpec) -> Variants:
    """The neighbours of a skin."""
    spec = named(spec)
    errors = input_errors(spec)
    paths = dict.fromkeys((*errors.paths, WARMER, DEEPER))
    own = np.array([value_of(spec, path) for path in paths])
    steps = np.zeros((len(errors) + 2, len(paths)))
    steps[:-2, : len(errors.paths)] = errors.directions
    for row, path in ((-2, WARMER), (-1, DEEPER)):
        steps[row, list(paths).index(path)] = 1.0
    sides = np.array([-STEP, STEP])[:, None]
    rows = np.concatenate([own[None], *(own + sides * step for step in steps)])
    return Variants(spec, errors, dict(zip(paths, rows.T, strict=True)))


def why_constant(spec: SkinSpec, path: str) -> str:
    """Why a skin does not feel `WARMER` or `DEEPER` surroundings; empty where it does."""
    parts = (spec.material, spec.oil, spec.wall)
    if path == WARMER and all(part.expansion is None for part in parts):
        return (
            "the skin file states no expansion: add expansion to [material], [oil] and [wall]"
        )
    moduli = (spec.material.bulk_modulus, spec.wall.bulk_modulus)
    if path == DEEPER and not spec.oil.yields and moduli == (None, None):
        solids = "rubber and wall are taken as incompressible"
        oil = f"oil, {solids}" if spec.oil.trapped else f"vented oil comes and goes, {solids}"
        return f"{oil}: depth changes nothing"
    return ""
