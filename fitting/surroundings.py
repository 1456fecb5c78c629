"""A skin's temperature and depth, from a log's columns, and the skin in these surroundings.

Columns `temperature_degC` (or `temperature_K`) and `water_depth_m` are taken as they are.
ROBOSKIN's thermal pads, `thermal_1` and `thermal_2`, send counts; two header lines turn them
into temperatures::

    # thermal_counts_per_K: 12
    # thermal_zero: 3100

`thermal_zero` are the counts at the skin file's [reference] temperature. A skin has one
temperature and one depth at a time, and what is calibrated by a log takes their means.
"""

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple, Self

import numpy as np

from fitting.arrays import Floats
from suas_jax.config import SkinSpec, UncertainQuantity
from suas_jax.config.csv_table import DEPTH, SURROUNDINGS, TEMPERATURE, number_in
from suas_jax.config.quantities import ZERO_CELSIUS
from suas_jax.config.schema_load import EnvironmentSpec
from suas_jax.config.tolerance import deviation_of

_PLAIN = {TEMPERATURE: ZERO_CELSIUS, "temperature_K": 0.0}
_PADS = ("thermal_1", "thermal_2")
_SENSOR = 0.5  # standard deviation of a thermometer that states none [K]
_STEADY = {"temperature": 2.0, "depth": 10.0}  # change within which one state stands for all


@dataclasses.dataclass(frozen=True)
class LogColumn:
    """What a log says of one quantity of its surroundings."""

    value: Floats  # in each row or frame [SI]; NaN where it says nothing
    source: str  # its columns

    @property
    def mean(self) -> float:
        """Over the log."""
        return float(np.nanmean(self.value))

    @property
    def ends(self) -> tuple[float, float]:
        """The smallest and the largest value."""
        return float(np.nanmin(self.value)), float(np.nanmax(self.value))

    def and_then(self, other: Self) -> "LogColumn":
        """Together with a second log."""
        return LogColumn(np.concatenate([self.value, other.value]), self.source)


class Surroundings(NamedTuple):
    """Of the skin of a log; None where it says nothing."""

    temperature: LogColumn | None = None  # [K]
    depth: LogColumn | None = None  # below the water's surface [m]

    def by(self, change: Callable[[Floats], Floats]) -> "Surroundings":
        """With other values."""
        return Surroundings(
            *(x and dataclasses.replace(x, value=change(x.value)) for x in self)
        )

    def and_then(self, other: "Surroundings") -> "Surroundings":
        """Together with those of a second log."""
        pairs = zip(self, other, strict=True)
        return Surroundings(*(a.and_then(b) if a and b else a or b for a, b in pairs))

    def changing(self, spec: SkinSpec) -> "Surroundings":
        """Those that change by more than one state of a skin stands for."""
        felt = _felt(spec)
        return Surroundings(
            **{
                name: column
                for name, column in self._asdict().items()
                if column is not None and felt[name] and np.ptp(column.ends) > _STEADY[name]
            }
        )


def log_surroundings(
    columns: Mapping[str, Iterable[object]],  # of the log beside its counts
    header: Mapping[str, str],
    spec: SkinSpec,  # the skin, whose [reference] the thermal pads' zero is at
    where: str,  # the log, for messages
) -> tuple[Surroundings, list[str]]:
    """Find a log's temperature and depth among its columns.

    Returns them, and what a person should know.
    Raises ValueError: a value is not a number, or nothing that a skin meets.
    """
    named = {name.strip().lower(): column for name, column in columns.items()}
    temperature, said = _temperature(named, header, spec, where)
    depth = None
    if DEPTH in named:
        value = numbers_of(named[DEPTH], DEPTH, where)
        if np.isfinite(value).any():
            depth = LogColumn(value, f"column {DEPTH}")
            met = SURROUNDINGS[DEPTH]
            worst = met.beyond(*depth.ends)
            if worst is not None:
                raise ValueError(
                    f"{where}, column {DEPTH}: {worst:.4g} m is no depth of water ({met.low:g} "
                    f"to {met.high:g} m, positive downwards)"
                )
        else:
            said = [*said, f"{where}, column {DEPTH}: no depth in any row; not used"]
    return Surroundings(temperature, depth), said


def _temperature(
    named: Mapping[str, Iterable[object]], header: Mapping[str, str], spec: SkinSpec, where: str
) -> tuple[LogColumn | None, list[str]]:
    plain = next((name for name in _PLAIN if name.lower() in named), None)
    if plain is not None:
        value = numbers_of(named[plain.lower()], plain, where) + _PLAIN[plain]
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
        counts = np.mean([numbers_of(named[name], name, where) for name in pads], 0)
        found, source = spec.reference.temperature + (counts - zero) / scale, ", ".join(pads)
    if not np.isfinite(found).any():
        return None, [f"{where}, {source}: no temperature in any row; not used"]
    column, met = LogColumn(found, source), SURROUNDINGS[TEMPERATURE]
    worst = met.beyond(*(x - met.zero for x in column.ends))
    if worst is not None:
        raise ValueError(
            f"{where}, {source}: {worst:.4g} degC is not a skin's temperature ({met.low:g} to "
            f"{met.high:g} degC); check the column's unit, or the thermal pads' scale"
        )
    return column, []


def spec_in(spec: SkinSpec, **surroundings: float) -> SkinSpec:
    """A skin in surroundings, by their keys of [environment] [SI].

    A temperature without a deviation is a reading and has a thermometer's, which takes the
    place of its tolerance.
    """
    around = spec.environment or EnvironmentSpec()
    values: dict[str, float] = dict(surroundings)
    if "temperature" in values and deviation_of(values["temperature"]) is None:
        values["temperature"] = UncertainQuantity(values["temperature"], _SENSOR)
    return spec.model_copy(update={"environment": around.model_copy(update=values)})


def spec_at(spec: SkinSpec, found: Surroundings, where: str) -> tuple[SkinSpec, list[str]]:
    """A skin at the mean of a log's surroundings, and in words what that assumes.

    `where` names the log, for messages.
    """
    temperature, depth = found
    said, felt = [], _felt(spec)
    if depth is not None:
        text, low, high = f"{where}: {depth.mean:.4g} m deep ({depth.source}", *depth.ends
        text += f", {low:.4g} to {high:.4g})" if high - low > 0.5 else ")"
        if felt["depth"]:
            spec = spec_in(spec, depth=depth.mean)
            said.append(f"{text}: the water presses as the skin file's bulk moduli say")
        else:
            said.append(
                f"{text}, which changes nothing: the skin file states no bulk_modulus of its "
                "oil, material or wall"
            )
    if temperature is None:
        return spec, said
    mean = UncertainQuantity(
        temperature.mean, float(np.hypot(np.nanstd(temperature.value), _SENSOR))
    )
    low, high = (x - ZERO_CELSIUS for x in temperature.ends)
    text = f"{where}: at {float(mean) - ZERO_CELSIUS:.4g} degC ({temperature.source}"
    text += f", {low:.4g} to {high:.4g})" if high - low > 0.05 else ")"
    if not felt["temperature"]:
        return spec, [
            *said,
            f"{text}, which changes nothing: the skin file states no expansion of its "
            'material, oil or wall (expansion = "EPDM", "silicone-oil", "PLA")',
        ]
    own = None if spec.environment is None else spec.environment.temperature
    spec = spec_in(spec, temperature=mean)
    grows = [name for name in ("material", "oil", "wall") if getattr(spec, name).expansion]
    have = "has" if len(grows) == 1 else "have"
    text += f": {', '.join(grows)} {have} grown as the skin file says, since "
    text += f"{spec.reference.temperature - ZERO_CELSIUS:.4g} degC"
    if spec.oil.expansion is not None:
        text += ", the oil's permittivity with its density (Clausius-Mossotti)"
    text += "; material constants are those of the file"
    if own is not None and abs(own - mean) > 3 * mean.deviation:
        text += f"; the skin file's own, {own - ZERO_CELSIUS:.4g} degC, is not used"
    return spec, [*said, text]


def told_at_mean(found: Surroundings, spec: SkinSpec) -> list[str]:
    """That a log is taken at the mean of surroundings which change."""
    units = {"temperature": "K", "depth": "m"}
    return [
        f"the log is taken at its mean {name}: what {np.ptp(column.ends):.2g} {units[name]} do "
        "within it is in no reading's model"
        for name, column in found.changing(spec)._asdict().items()
        if column is not None
    ]


def _felt(spec: SkinSpec) -> dict[str, bool]:
    """Which surroundings change a skin."""
    solids = spec.material, spec.wall
    return {
        "temperature": any(part.expansion is not None for part in (*solids, spec.oil)),
        "depth": spec.oil.yields or any(part.bulk_modulus is not None for part in solids),
    }


def numbers_of(column: Iterable[object], name: str, where: str) -> Floats:
    """A column's numbers, NaN where a cell is empty. ValueError: a cell is not a number."""
    texts = [str(x).strip() for x in column]
    values = np.array([number_in(text) for text in texts])
    for text, value in zip(texts, values, strict=True):
        if np.isnan(value) and text.lower() not in ("", "nan", "na"):
            raise ValueError(f'{where}, column "{name}": "{text}": expected a number')
    return values
