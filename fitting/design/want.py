"""What a skin should become: variables with bounds, a goal and limits, from a TOML file."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np

from fitting.arrays import Floats
from fitting.datasheet.in_time import scene_of
from fitting.datasheet.words import PLACED, WORDS
from suas_jax.config import (
    ConfigError,
    SkinSpec,
    continuous_inputs,
    load_skin,
    parse_quantity,
    with_inputs,
)
from suas_jax.config.errors import Mistake, show, unknown
from suas_jax.config.toml_file import read_toml

BY_DIFFERENCES = (
    "lowest_frequency_Hz",
    "damping_ratio",
    "bandwidth_Hz",
    "buckling_mismatch",
)
"""Figures that have no place; their derivatives are central differences."""
GOALS = tuple(PLACED)
"""Figures that can be a goal."""
_MOST_PLACES, _MOST_STARTS = 101, 1000


class Variable(NamedTuple):
    """What may change.

    Attributes:
        name: as in the file.
        paths: of the inputs that it sets.
        low: its bounds, in SI units, or as factors on the inputs of the skin file.
        high: see `low`.
        factor: whether they are factors.
    """

    name: str
    paths: tuple[str, ...]
    low: float
    high: float
    factor: bool


class Limit(NamedTuple):
    """A figure that must not be worse than a value.

    Attributes:
        key: of the figure.
        value: in SI units.
        least: whether the figure must be at least as large; else at most.
    """

    key: str
    value: float
    least: bool


@dataclass(frozen=True)
class Want:
    """What is wanted.

    Attributes:
        skin: file of the skin to start from.
        spec: that skin.
        variables: what may change.
        goal: key of the figure whose worst over the region is to be as good as it can be.
        maximise: whether that means large.
        limits: on other figures.
        region: of the places that count, as the skin's scenes state them [rad or m]; None
            for all of the skin.
        places: how many.
        force: the rated force [N]; None for that of the data sheet of the skin to start from.
        starts: of the search, the skin itself first.
        seed: of the other starts.
    """

    skin: Path
    spec: SkinSpec
    variables: tuple[Variable, ...]
    goal: str
    maximise: bool
    limits: tuple[Limit, ...]
    region: tuple[float, float] | None
    places: int
    force: float | None
    starts: int
    seed: int

    def inputs(self, x: Any) -> dict[str, Any]:
        """Inputs of the skin by path, from variables between 0 and 1.

        Args:
            x: the variables [variable], traced or not.
        """
        own = continuous_inputs(self.spec)
        found = {}
        for i, variable in enumerate(self.variables):
            value = variable.low + (variable.high - variable.low) * x[i]
            for path in variable.paths:
                found[path] = own[path] * value if variable.factor else value
        return found

    @property
    def start(self) -> Floats:
        """Variables of the skin file, moved into their bounds where they lie beyond."""
        own = continuous_inputs(self.spec)
        now = [1.0 if v.factor else own[v.paths[0]] for v in self.variables]
        share = [
            (n - v.low) / (v.high - v.low) for n, v in zip(now, self.variables, strict=True)
        ]
        return np.clip(np.array(share), 0.0, 1.0)


_KEYS = {"at": ("region", "places", "force"), "search": ("starts", "seed")}
_TABLES = ("skin", "goal", "limits", "variables", "at", "search")


def load_want(file: Path) -> Want:
    """Read what is wanted.

    Args:
        file: the TOML file; the path of its skin is relative to it.

    Raises:
        ConfigError: it can't be understood; the message names key, value and what is allowed.
    """
    table = read_toml(file)
    reader = _Reader(str(file))
    for key in table:
        if key not in _TABLES:
            reader.refuse(key, table[key], unknown(key, _TABLES, "key"))
    skin = table.get("skin")
    if not isinstance(skin, str):
        reader.refuse("skin", skin, 'the path of a skin file is needed, such as "skin.toml"')
    path = file.parent / skin
    spec = load_skin(path)
    at, search = (reader.table(table, key) for key in ("at", "search"))
    goal, maximise = reader.goal(reader.table(table, "goal"))
    variables = tuple(reader.variables(reader.table(table, "variables"), spec))
    limits = tuple(reader.limits(reader.table(table, "limits")))
    kind = "angle" if spec.geometry.has_angle else "length"
    region = at.get("region")
    if region is not None:
        low, high = reader.pair("at.region", region)
        region = (
            reader.quantity("at.region", low, kind),
            reader.quantity("at.region", high, kind),
        )
        if region[0] >= region[1]:
            reader.refuse(
                "at.region", at["region"], "the first place must be left of the second"
            )
    force = at.get("force")
    return Want(
        path,
        spec,
        variables,
        goal,
        maximise,
        limits,
        region,
        reader.whole("at.places", at.get("places", 9), 4, _MOST_PLACES),
        None if force is None else reader.quantity("at.force", force, "force"),
        reader.whole("search.starts", search.get("starts", 3), 1, _MOST_STARTS),
        reader.whole("search.seed", search.get("seed", 0), 0, 2**31),
    )


class _Reader:
    """Reads tables of one file, and says what is wrong with them."""

    def __init__(self, file: str) -> None:
        self.file = file

    def refuse(self, key: str, value: object, advice: str) -> NoReturn:
        shown = None if value is None else show(value)
        raise ConfigError([Mistake(self.file, key, advice, shown)])

    def table(self, tables: Mapping[str, Any], key: str) -> dict[str, Any]:
        found = tables.get(key, {})
        if not isinstance(found, dict):
            self.refuse(key, found, f"a table is expected: [{key}]")
        known = _KEYS.get(key, tuple(found))
        for name in found:
            if name not in known:
                self.refuse(f"{key}.{name}", found[name], unknown(name, known, "key"))
        return dict(found)

    def pair(self, key: str, value: Any) -> tuple[Any, Any]:
        if not isinstance(value, list) or len(value) != 2:
            self.refuse(key, value, "two values are expected, the lower and the upper one")
        return value[0], value[1]

    def whole(self, key: str, value: Any, low: int, high: int) -> int:
        if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
            self.refuse(key, value, f"a whole number from {low} to {high} is expected")
        return int(value)

    def quantity(self, key: str, value: Any, kind: Any) -> float:
        try:
            return parse_quantity(value if isinstance(value, str) else str(value), kind)
        except ValueError as error:
            self.refuse(key, value, str(error))

    def goal(self, table: dict[str, Any]) -> tuple[str, bool]:
        if len(table) != 1 or next(iter(table)) not in ("minimise", "maximise"):
            self.refuse(
                "goal", table, 'expected minimise = "..." or maximise = "...", one of them'
            )
        (word, key), *_ = table.items()
        if key not in GOALS:
            self.refuse(f"goal.{word}", key, unknown(str(key), GOALS, "figure", quoted=True))
        return key, word == "maximise"

    def limits(self, table: dict[str, Any]) -> Iterator[Limit]:
        allowed = (*GOALS, *BY_DIFFERENCES)
        for key, bound in table.items():
            name = f"limits.{key}"
            if key not in allowed:
                self.refuse(name, bound, unknown(key, allowed, "figure"))
            if not isinstance(bound, dict) or not bound or set(bound) - {"at_least", "at_most"}:
                self.refuse(name, bound, "expected { at_least = ... } or { at_most = ... }")
            for side, text in bound.items():
                value = self._figure(f"{name}.{side}", key, text)
                if value <= 0:
                    self.refuse(f"{name}.{side}", text, "must be greater than zero")
                yield Limit(key, value, side == "at_least")

    def _figure(self, name: str, key: str, text: Any) -> float:
        unit = WORDS[key].unit
        kind = {"N": "force", "mm": "length"}.get(unit)
        if kind is not None:
            return self.quantity(name, text, kind)
        if not isinstance(text, int | float) or isinstance(text, bool):
            self.refuse(name, text, f"a number is expected, in the unit that {key} ends with")
        return float(text)

    def variables(self, table: dict[str, Any], spec: SkinSpec) -> Iterator[Variable]:
        if not table:
            self.refuse("variables", None, "at least one is needed")
        known = continuous_inputs(spec)
        for name, value in _flat(table):
            key = f"variables.{name}"
            if isinstance(value, dict):
                paths, bounds, factor = tuple(value["of"]), value["factor"], True
            else:
                paths, bounds, factor = (name,), value, False
            for path in paths:
                if path not in known:
                    self.refuse(key, path, unknown(path, known, "input of the skin"))
            sides = self.pair(key, bounds)
            if factor:
                low, high = (self.quantity(key, side, "number") for side in sides)
            else:
                low, high = (self._input(key, spec, name, side) for side in sides)
            if not low < high:
                self.refuse(key, bounds, "the lower bound must be below the upper one")
            yield Variable(name, paths, low, high, factor)

    def _input(self, key: str, spec: SkinSpec, path: str, text: Any) -> float:
        """A value of an input, read as the skin file's own is."""
        try:
            changed = with_inputs(scene_of(spec), {path: text})
            return continuous_inputs(changed)[path]
        except ValueError as error:
            reason = str(error).splitlines()
            self.refuse(key, text, reason[min(2, len(reason) - 1)].strip())


def _flat(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Paths and values of variables, whether their keys are quoted or dotted."""
    for key, value in table.items():
        if isinstance(value, dict) and not {"of", "factor"} <= value.keys():
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value
