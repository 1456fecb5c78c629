"""The kinds of value that a key may hold: quantities in a range, whole numbers, lists."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, PlainValidator, ValidationInfo

from suas_jax.config.quantities import DimensionName, format_quantity, to_si
from suas_jax.config.tolerance import UncertainQuantity, is_uncertain_text, parse_uncertain

FILE_RULES = {"units_required": True}
"""Validation context of values that come from a file: every number states its unit."""


class PlacedError(ValueError):
    """One entry of a list, or one key of a table, is wrong.

    Attributes:
        place: index of the entry from zero, or the key.
    """

    def __init__(self, place: int | str, message: str):
        self.place = place
        super().__init__(message)


class Spec(BaseModel):
    """Base of all specifications: immutable, hashable, no unknown keys, SI values.

    From Python, quantities may be SI floats or text with a unit; from files, only the latter.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)


@dataclasses.dataclass(frozen=True)
class Quantity(PlainValidator):
    """Validator of a quantity, as `quantity` builds it.

    It is a plain one: the library's own validation of a float would drop the deviation.

    Attributes:
        dimension: the kind of quantity.
        rules: what is allowed, in words, such as ``"must be greater than zero"``.
    """

    dimension: DimensionName = "number"
    rules: tuple[str, ...] = ()


def quantity(
    dimension: DimensionName,
    *,
    above: float | None = None,
    at_least: float | None = None,
    below: float | None = None,
    nonzero: bool = False,
) -> Quantity:
    """Build the validator of a quantity, which may carry its uncertainty.

    Args:
        dimension: the kind of quantity.
        above: the value must be greater than this, in SI units.
        at_least: the value must not be less than this, in SI units.
        below: the value must be less than this, in SI units.
        nonzero: the value must not be zero.

    Returns:
        A validator that yields the SI value, an `UncertainQuantity` where a deviation is
        stated, or raises ValueError with what is allowed.
    """

    def limit(value: float) -> str:
        zero = value == 0.0 and dimension != "temperature"
        return "zero" if zero else format_quantity(value, dimension)

    bounds: list[tuple[Callable[[float], bool], str]] = []
    if above is not None and below is not None:
        bounds.append(
            (lambda x: above < x < below, f"must be between {limit(above)} and {limit(below)}")
        )
    elif above is not None:
        bounds.append((lambda x: x > above, f"must be greater than {limit(above)}"))
    if at_least is not None:
        bounds.append((lambda x: x >= at_least, f"must not be less than {limit(at_least)}"))
    if nonzero:
        bounds.append((lambda x: x != 0.0, "must not be zero"))

    def check(value: object, info: ValidationInfo) -> float:
        strict = bool(info.context and info.context.get("units_required"))
        number = quantity_of(value, dimension, bare_numbers=not strict)
        for holds, rule in bounds:
            if not holds(number):
                raise ValueError(rule)
        return number

    rules = tuple(rule for _, rule in bounds)
    return Quantity(check, dimension=dimension, rules=rules)


def quantity_of(
    value: object, dimension: DimensionName, *, bare_numbers: bool = False
) -> float:
    """Read a value of a specification; see `suas_jax.config.quantities.to_si`.

    Args:
        value: text with a unit, with or without ``+-`` and a standard deviation, or a number.
        dimension: the kind of quantity that is expected.
        bare_numbers: accept a number without a unit as a value in SI units.

    Raises:
        ValueError: if the value is no finite quantity of that kind, with what is expected.
    """
    if isinstance(value, UncertainQuantity):  # of a specification that is built anew
        return value
    if isinstance(value, str) and is_uncertain_text(value):
        return parse_uncertain(value, dimension)
    return to_si(value, dimension, bare_numbers=bare_numbers)


def whole_number(value: object) -> int:
    """A count from a file: a whole number of at least 1."""
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise ValueError("must be a whole number of at least 1")
    return value


NOT_A_LIST = "a list in square brackets is expected"


def angle_or_arc(angle: float | None, arc: float | None) -> None:
    """Refuse a place that is told twice, or not at all.

    Raises:
        PlacedError: with what to do.
    """
    if (angle is None) == (arc is None):
        raise PlacedError(
            "angle",
            'missing; add it, for example angle = "45 deg" (or arc = "22 mm")'
            if angle is None
            else "a place has an angle or an arc; take one out",
        )


def at_most(count: int) -> BeforeValidator:
    """A validator of the same kind as `AsList` for lists of limited length."""

    def check(value: Any) -> tuple[Any, ...]:
        if not isinstance(value, list | tuple):
            raise ValueError(NOT_A_LIST)
        if len(value) > count:
            raise ValueError(f"has {len(value)} entries; at most {count} are allowed")
        return tuple(value)

    return BeforeValidator(check)


Length = Annotated[float, quantity("length")]
PositiveLength = Annotated[float, quantity("length", above=0.0)]
Angle = Annotated[float, quantity("angle")]
Stress = Annotated[float, quantity("stress")]
PositiveStress = Annotated[float, quantity("stress", above=0.0)]
Pressure = Annotated[float, quantity("pressure")]
PositivePressure = Annotated[float, quantity("pressure", above=0.0)]
Force = Annotated[float, quantity("force")]
Temperature = Annotated[float, quantity("temperature", above=0.0)]
Number = Annotated[float, quantity("number")]
PositiveNumber = Annotated[float, quantity("number", above=0.0)]
Count = Annotated[int, BeforeValidator(whole_number)]
AsList = at_most(1_000_000)
"""Accepts a TOML list for a tuple, and refuses everything else (text is no list)."""
