"""What a skin should become: variables with bounds, a goal and limits, from a TOML file."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, NoReturn, Self

import numpy as np
from pydantic import Field, ValidationError, model_validator

from fitting.arrays import Floats
from fitting.datasheet.words import PLACED, WORDS
from suas_jax.config import ConfigError, SkinSpec, continuous_inputs, load_skin, with_inputs
from suas_jax.config.errors import Mistake, show, unknown
from suas_jax.config.fields import AsList, Count, PlacedError, Spec, quantity
from suas_jax.config.quantities import DimensionName, to_si
from suas_jax.config.tolerance import deviation_start
from suas_jax.config.toml_file import read_toml
from suas_jax.config.validation import validate_table
from suas_jax.skin.plain import angles_at, clamped_edge

BY_DIFFERENCES = ("lowest_frequency_Hz", "damping_ratio", "bandwidth_Hz", "buckling_mismatch")
"""Figures that have no place; their derivatives are central differences."""
GOALS = tuple(PLACED)
"""Figures that can be a goal."""


class Variable(NamedTuple):
    """What may change."""

    name: str  # as in the file
    paths: tuple[str, ...]  # of the inputs that it sets
    low: float  # its bounds, in SI units, or as factors on the inputs of the skin file
    high: float  # see `low`
    factor: bool  # whether they are factors

    def at(self, share: Any) -> Any:
        """Its value at a share of the way from the lower bound to the upper one."""
        return self.low + (self.high - self.low) * share


class Limit(NamedTuple):
    """A figure that must not be worse than a value."""

    key: str  # of the figure
    value: float  # in SI units
    least: bool  # whether the figure must be at least as large; else at most

    def margin(self, figure: Any) -> Any:
        """Share of the limit by which a figure keeps it; negative where it does not."""
        share = figure / self.value - 1
        return share if self.least else -share


class OwnLimit(Limit):
    """A limit that no file asks for: a search has it itself."""

    __slots__ = ()

    @property
    def purpose(self) -> str:
        """What it does, in a sentence whose subject is the limit."""
        if self.key == "min_gap_m":
            return "keeps the membrane off the wall under the rated force"
        return "keeps the skin from buckling at rest"


class Front(NamedTuple):
    """A second figure that the goal is traded against."""

    figure: str  # its key
    points: int  # designs from the best by the goal to the best by it


@dataclass(frozen=True)
class Want:
    """What is wanted."""

    skin: Path  # file of the skin to start from
    spec: SkinSpec  # that skin
    variables: tuple[Variable, ...]  # what may change
    goal: str  # key of the figure whose worst over the region is to be as good as it can be
    maximise: bool  # whether that means large
    limits: tuple[Limit, ...]  # on other figures
    # of the places that count, as the skin's scenes state them [rad or m]; None for all of the
    # skin
    region: tuple[float, float] | None
    places: int  # how many
    # the rated force [N]; None for that of the data sheet of the skin to start from
    force: float | None
    starts: int  # of the search, the skin itself first
    seed: int  # of the other starts
    keep: int | None = None  # how many of the skin's taxels; None where they are not asked for
    # share of units built within the tolerances that keep each figure; None for one as drawn
    units: float | None = None
    front: "Front | None" = None  # of two goals; None for one goal

    @property
    def against(self) -> tuple[str, ...]:
        """The second figure, where there is one."""
        return () if self.front is None else (self.front.figure,)

    @property
    def figures(self) -> set[str]:
        """Keys of the figures that goals and limits ask for."""
        return {self.goal, *self.against, *(limit.key for limit in self.limits)}

    @property
    def angles(self) -> tuple[float, float] | None:
        """The region as sections define angles [rad]."""
        if self.region is None:
            return None
        name = "angle" if self.spec.geometry.has_angle else "arc"
        low, high = angles_at(self.spec.geometry, name, np.array(self.region))
        return float(low), float(high)

    def inputs(self, x: Any) -> dict[str, Any]:
        """Inputs of the skin by path, from variables between 0 and 1, traced or not."""
        own = continuous_inputs(self.spec)
        found = {}
        for i, variable in enumerate(self.variables):
            value = variable.at(x[i])
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


if TYPE_CHECKING:
    _Figure = str
else:
    _Figure = Literal[GOALS]


class _Goal(Spec):
    minimise: _Figure | None = None
    maximise: _Figure | None = None

    @model_validator(mode="after")
    def _one_of_them(self) -> Self:
        if (self.minimise is None) == (self.maximise is None):
            raise PlacedError("minimise", "one of minimise and maximise names a figure")
        return self


class _Limit(Spec):
    at_least: Any = None
    at_most: Any = None


class _At(Spec):
    region: Annotated[tuple[str | float, str | float], AsList] | None = None
    places: Count = 9
    force: Annotated[float, quantity("force", above=0.0)] | None = None
    units: Annotated[float, quantity("number", above=0.5, below=1.0)] | None = None


class _Front(Spec):
    figure: _Figure
    points: Count = 6


class _Search(Spec):
    starts: Count = 3
    seed: Annotated[int, Field(ge=0)] = 0


class _Taxels(Spec):
    keep: Count


_Factor = Annotated[float, quantity("number")]


class _Together(Spec):
    of: Annotated[tuple[str, ...], AsList]
    factor: Annotated[tuple[_Factor, _Factor], AsList]


_EDGES = ("geometry.half_angle", "geometry.width")
_BEYOND = 1 + 1e-9  # of an edge, by rounding
_MOST_PLACES = 1000
_TABLES = ("skin", "variables", "taxels", "goal", "front", "limits", "at", "search")
CHOOSABLE = ("force_resolution_N", "place_resolution_m")
"""Figures that decide which taxels are kept."""


def load_want(file: Path) -> Want:
    """Read what is wanted; the path of the skin is relative to the file that names it.

    Raises:
        ConfigError: it can't be understood; the message names key, value and what is allowed.
    """
    table, reader = read_toml(file), _Reader(str(file))
    for key in table:
        if key not in _TABLES:
            reader.refuse(key, table[key], unknown(key, _TABLES, "key"))
    if not isinstance(table.get("skin"), str):
        reader.refuse("skin", table.get("skin"), 'a skin file is needed, such as "skin.toml"')
    path = file.parent / table["skin"]
    spec = load_skin(path)
    goal, at, search = (
        reader.part(kind, table.get(key, {}), key)
        for kind, key in ((_Goal, "goal"), (_At, "at"), (_Search, "search"))
    )
    region = at.region
    if region is not None:
        kind: DimensionName = "angle" if spec.geometry.has_angle else "length"
        low, high = (reader.quantity("at.region", side, kind) for side in at.region)
        region = low, high
        if low >= high:
            reader.refuse("at.region", at.region, "the first place must be left of the second")
        edge, text = clamped_edge(spec.geometry, by_arc=kind == "length")
        if max(-low, high) > edge * _BEYOND:
            advice = f"reaches beyond the clamped edges at -{text} and {text}"
            reader.refuse("at.region", at.region, advice)
    if not 3 <= at.places <= _MOST_PLACES:
        advice = f"at least 3 are needed, {_MOST_PLACES} at most"
        reader.refuse("at.places", at.places, advice)
    keep = None
    if "taxels" in table:
        keep = reader.part(_Taxels, table["taxels"], "taxels").keep
        for key in ("variables", "front", "limits", "search"):
            if key in table:
                advice = "has no meaning beside [taxels]; choose taxels of the designed skin"
                reader.refuse(key, None, advice)
        if goal.minimise not in CHOOSABLE:
            advice = f"allowed beside [taxels]: minimise {' or '.join(CHOOSABLE)}"
            reader.refuse("goal", goal.minimise or goal.maximise, advice)
    limits = tuple(reader.limits(reader.table(table, "limits")))
    if at.units is not None:
        alone = [limit.key for limit in limits if limit.key in BY_DIFFERENCES]
        if alone or keep:
            where = f"limits.{alone[0]}" if alone else "taxels"
            reader.refuse(
                "at.units", at.units, f"has no meaning beside [{where}]; leave it out"
            )
        if spec.geometry.dimension == 3:
            advice = "is known of sections alone; leave it out, and see `suas datasheet`"
            reader.refuse("at.units", at.units, advice)
    front = None
    if "front" in table:
        given = reader.part(_Front, table["front"], "front")
        front = Front(given.figure, given.points)
        if front.figure in (goal.minimise, goal.maximise):
            reader.refuse("front.figure", front.figure, "is the goal itself; name another one")
        if front.points < 3:
            reader.refuse("front.points", front.points, "at least 3 are needed")
    return Want(
        path,
        spec,
        () if keep else tuple(reader.variables(reader.table(table, "variables"), spec)),
        goal.minimise or goal.maximise,
        goal.maximise is not None,
        limits,
        region,
        at.places,
        at.force,
        search.starts,
        search.seed,
        keep,
        at.units,
        front,
    )


class _Reader:
    """Reads tables of one file, and says what is wrong with them."""

    def __init__(self, file: str) -> None:
        self.file = file

    def refuse(self, key: str, value: object, advice: str) -> NoReturn:
        shown = None if value is None else show(value)
        raise ConfigError([Mistake(self.file, key, advice, shown)])

    def table(self, whole: dict[str, Any], key: str) -> dict[str, Any]:
        found = whole.get(key, {})
        if not isinstance(found, dict):
            self.refuse(key, found, f"a table is expected: [{key}]")
        return found

    def part(self, kind: type[Spec], table: Any, key: str) -> Any:
        found, findings = validate_table(kind, table, key)
        if findings:
            raise ConfigError(Mistake(self.file, *finding) for finding in findings)
        return found

    def quantity(self, key: str, text: Any, kind: DimensionName) -> float:
        try:
            return to_si(text, kind, bare_numbers=kind == "number")
        except ValueError as error:
            self.refuse(key, text, str(error))

    def limits(self, table: dict[str, Any]) -> Iterator[Limit]:
        for key, bounds in table.items():
            if key not in (*GOALS, *BY_DIFFERENCES):
                advice = unknown(key, (*GOALS, *BY_DIFFERENCES), "figure")
                self.refuse(f"limits.{key}", bounds, advice)
            given = self.part(_Limit, bounds, f"limits.{key}")
            if not given.model_fields_set:
                self.refuse(f"limits.{key}", bounds, "at_least or at_most is needed")
            values = {
                side: self._limit(f"limits.{key}.{side}", getattr(given, side), WORDS[key].unit)
                for side in given.model_fields_set
            }
            if len(values) == 2 and values["at_least"] >= values["at_most"]:
                self.refuse(f"limits.{key}", bounds, "at_least must be below at_most")
            yield from (Limit(key, value, side == "at_least") for side, value in values.items())

    def _limit(self, key: str, text: Any, unit: str) -> float:
        """A limit of a figure that data sheets tell in a unit [SI]."""
        kinds: dict[str, DimensionName] = {"N": "force", "mm": "length"}
        kind, bare = kinds.get(unit, "number"), text
        if kind == "number" and unit != "%" and isinstance(text, str):
            bare = text.removesuffix(unit)  # which no dimension of a skin file has
        value = self.quantity(key, bare, kind)
        if value <= 0:
            self.refuse(key, text, "must be greater than zero")
        if unit == "%" and value >= 1 and "%" not in str(text):
            advice = f'its unit is needed from 1 on: "{value:g} %", or "{100 * value:g} %"'
            self.refuse(key, text, advice)
        return value

    def variables(self, table: dict[str, Any], spec: SkinSpec) -> Iterator[Variable]:
        if not table:
            self.refuse("variables", None, "at least one is needed")
        known, named = continuous_inputs(spec), set[str]()
        for name, value in _flat(table):
            key, factor = f"variables.{name}", isinstance(value, dict)
            paths, bounds = (name,), value
            if factor:
                together = self.part(_Together, value, key)
                paths, bounds = together.of, together.factor
                if not paths:
                    self.refuse(f"{key}.of", value["of"], "at least one input is needed")
            for path in paths:
                if path not in known:
                    self.refuse(key, path, unknown(path, known, "input of the skin"))
                if path in _EDGES and spec.geometry.dimension == 3:
                    advice = "moves a pad's edges, to which its mesh holds; leave it out"
                    self.refuse(key, path, advice)
                if path == "electrodes.noise":
                    advice = "is the converter's, and the less the better; leave it out"
                    self.refuse(key, path, advice)
                if path in named:
                    self.refuse(key, path, "is named twice; one variable sets an input")
                named.add(path)
            if not isinstance(bounds, list | tuple) or len(bounds) != 2:
                self.refuse(key, bounds, "two values are expected, the lower and the upper one")
            sides = []
            for x in bounds:
                if isinstance(x, str) and deviation_start(x) < len(x):
                    advice = "a bound has no deviation; the skin file's stays the same share"
                    self.refuse(key, x, advice)
                given = str(x) if type(x) in (int, float) else x  # as text it needs its unit
                own = {path: known[path] * x if factor else given for path in paths}
                found = self._inputs(key, spec, own, x)
                sides.append(x if factor else found[name])
            low, high = sides
            if not low < high:
                self.refuse(key, bounds, "the lower bound must be below the upper one")
            yield Variable(name, tuple(paths), low, high, factor)

    def _inputs(
        self, key: str, spec: SkinSpec, values: dict[str, Any], bound: Any
    ) -> dict[str, float]:
        """Inputs of the skin at a bound, whose values are read as the skin file's own are."""
        try:
            return continuous_inputs(with_inputs(spec.unloaded, values))
        except ValueError as error:
            reason = str(error)
            if isinstance(error, ValidationError):
                reason = error.errors(include_url=False)[0]["msg"].removeprefix("Value error, ")
            self.refuse(key, bound, reason)


def _flat(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Paths and values of variables, whether their keys are quoted or dotted."""
    for key, value in table.items():
        if isinstance(value, dict) and not {"of", "factor"} & value.keys():
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value
