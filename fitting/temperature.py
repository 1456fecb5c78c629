"""The temperature of a log, and the skin at it.

A column `temperature_degC` (or `temperature_K`) is taken as it is. ROBOSKIN's thermal pads,
`thermal_1` and `thermal_2`, send counts; two header lines turn them into temperatures::

    # thermal_counts_per_K: 12
    # thermal_zero: 3100

`thermal_zero` are the counts at the skin file's [reference] temperature. A skin has one
temperature, so a log stands for its mean.
"""

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Self

import numpy as np

from suas_jax.config import SkinSpec, UncertainQuantity
from suas_jax.config.csv_table import number_in
from suas_jax.config.schema_load import EnvironmentSpec

_ZERO_CELSIUS = 273.15
_PLAIN = {"temperature_degc": _ZERO_CELSIUS, "temperature_k": 0.0}
_PADS = ("thermal_1", "thermal_2")
_SENSOR = 0.5  # standard deviation of a thermometer that states none [K]
_COLDEST, _WARMEST = 233.15, 393.15  # between which rubber and oil are what the file says


@dataclasses.dataclass(frozen=True)
class LogTemperature:
    """What a log says of its skin's temperature."""

    value: np.ndarray  # in each row [K]; NaN where a row says nothing
    source: str  # its columns

    @property
    def mean(self) -> UncertainQuantity:
        """Over the log, with the deviation of its rows and of a thermometer [K]."""
        deviation = float(np.hypot(np.nanstd(self.value), _SENSOR))
        return UncertainQuantity(float(np.nanmean(self.value)), deviation)

    def and_then(self, other: Self) -> "LogTemperature":
        """Together with a second log."""
        return LogTemperature(np.concatenate([self.value, other.value]), self.source)


def log_temperature(
    columns: Mapping[str, Iterable[object]],  # of the log beside its counts
    header: Mapping[str, str],
    spec: SkinSpec,  # the skin, whose [reference] the thermal pads' zero is at
    where: str,  # the log, for messages
) -> tuple[LogTemperature | None, list[str]]:
    """Find a log's temperature among its columns.

    Returns the temperature, None where there is none, and what a person should know.
    Raises ValueError: a value is not a number, or no temperature that a skin has.
    """
    named = {name.strip().lower(): column for name, column in columns.items()}
    plain = next((name for name in _PLAIN if name in named), None)
    if plain is not None:
        value = _numbers(named[plain], plain, where) + _PLAIN[plain]
        found, source = value, f"column {plain}"
    else:
        pads = [name for name in _PADS if name in named]
        if not pads:
            return None, []
        keys = "thermal_counts_per_K", "thermal_zero"
        scale, zero = (number_in(header.get(key, "")) for key in keys)
        if not (scale and np.isfinite(scale) and np.isfinite(zero)):
            return None, [
                f"{where}: columns {', '.join(pads)} are counts of thermal pads and not used: "
                f'add header lines "# {keys[0]}: 12" and "# {keys[1]}: 3100", the counts at '
                f"[reference] temperature"
            ]
        counts = np.mean([_numbers(named[name], name, where) for name in pads], 0)
        found, source = spec.reference.temperature + (counts - zero) / scale, ", ".join(pads)
    if not np.isfinite(found).any():
        return None, [f"{where}, {source}: no temperature in any row; not used"]
    worst = float(found[np.nanargmax(np.abs(found - spec.reference.temperature))])
    if not _COLDEST < worst < _WARMEST:
        raise ValueError(
            f"{where}, {source}: {worst - _ZERO_CELSIUS:.4g} degC is not a skin's temperature "
            f"(-40 to 120 degC); check the column's unit, or the thermal pads' scale"
        )
    return LogTemperature(found, source), []


def spec_at(
    spec: SkinSpec, found: LogTemperature | None, where: str
) -> tuple[SkinSpec, list[str]]:
    """A skin at a log's temperature, and in words what that assumes.

    `found` is the log's temperature; None leaves the skin as it is. `where` names the log, for
    messages.
    """
    if found is None:
        return spec, []
    mean = found.mean
    low, high = (f(found.value) - _ZERO_CELSIUS for f in (np.nanmin, np.nanmax))
    said = f"{where}: at {float(mean) - _ZERO_CELSIUS:.4g} degC ({found.source}"
    said += f", {low:.4g} to {high:.4g})" if high - low > 0.05 else ")"
    expansions = {
        "material": spec.material.expansion,
        "oil": spec.oil.expansion,
        "wall": spec.wall.expansion,
    }
    grows = [name for name, expansion in expansions.items() if expansion is not None]
    if not grows:
        return spec, [
            f"{said}, which changes nothing: the skin file states no expansion of its "
            'material, oil or wall (expansion = "EPDM", "silicone-oil", "PLA")'
        ]
    around = spec.environment or EnvironmentSpec()
    own = around.temperature
    environment = around.model_copy(update={"temperature": mean})
    said += f": {', '.join(grows)} have grown as the skin file says, since "
    said += f"{spec.reference.temperature - _ZERO_CELSIUS:.4g} degC"
    if spec.oil.expansion is not None:
        said += ", the oil's permittivity with its density (Clausius-Mossotti)"
    said += "; material constants are those of the file"
    if high - low > 2.0:
        said += (
            f"; the log is taken at its mean, +- {mean.deviation:.2g} K: what "
            f"{high - low:.2g} K do within it is in no reading's model"
        )
    if own is not None and abs(own - mean) > 3 * mean.deviation:
        said += f"; the skin file's own, {own - _ZERO_CELSIUS:.4g} degC, is not used"
    return spec.model_copy(update={"environment": environment}), [said]


def _numbers(column: Iterable[object], name: str, where: str) -> np.ndarray:
    """A column's numbers, NaN where a cell is empty. ValueError: a cell is not a number."""
    texts = [str(x).strip() for x in column]
    values = np.array([number_in(text) for text in texts])
    for text, value in zip(texts, values, strict=True):
        if np.isnan(value) and text.lower() not in ("", "nan", "na"):
            raise ValueError(f'{where}, column "{name}": "{text}": expected a number')
    return values
