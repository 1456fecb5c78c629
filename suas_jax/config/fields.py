"""The kinds of value that a key may hold: quantities in a range, whole numbers, lists."""

import dataclasses
from collections.abc import Callable
from typing import Annotated, Any, Self

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainValidator,
    ValidationInfo,
    model_validator,
)

from suas_jax.config.quantities import DimensionName, format_quantity, to_si
from suas_jax.config.tolerance import UncertainQuantity, is_uncertain_text, parse_uncertain


def file_key(example: str, default: Any = ..., **rules: Any) -> Any:
    """A key of a table: its value as a file may have it, and its default."""
    return Field(default=default, examples=[example], **rules)


FILE_RULES = {"units_required": True}
"""Validation context of values that come from a file: every number states its unit."""


class PlacedError(ValueError):
    """One entry of a list, or one key of a table, is wrong.

    `place`: index of the entry from zero, or the key.
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
    """

    dimension: DimensionName = "number"  # the kind of quantity
    # what is allowed, in words, such as ``"must be greater than zero"``
    rules: tuple[str, ...] = ()


def quantity(
    dimension: DimensionName,  # the kind of quantity
    *,
    above: float | None = None,  # the value must be greater than this, in SI units
    at_least: float | None = None,  # it must not be less than this
    below: float | None = None,  # it must be less than this
    nonzero: bool = False,  # it must not be zero
) -> Quantity:
    """Build the validator of a quantity, which may carry its uncertainty.

    Returns a validator that yields the SI value, an `UncertainQuantity` where a deviation is
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
    """Read a value of a specification, which may carry ``+-`` and a standard deviation.

    Args and errors are those of `suas_jax.config.quantities.to_si`.
    """
    if isinstance(value, UncertainQuantity):  # of a specification that is built anew
        return value
    if isinstance(value, str) and is_uncertain_text(value):
        return parse_uncertain(value, dimension)
    return to_si(value, dimension, bare_numbers=bare_numbers)


Length = Annotated[float, quantity("length")]
PositiveLength = Annotated[float, quantity("length", above=0.0)]
Angle = Annotated[float, quantity("angle")]
Pressure = Annotated[float, quantity("pressure")]
PositivePressure = Annotated[float, quantity("pressure", above=0.0)]
Force = Annotated[float, quantity("force")]
Temperature = Annotated[float, quantity("temperature", above=0.0)]
PositiveNumber = Annotated[float, quantity("number", above=0.0)]


class PlacedSpec(Spec):
    """What has a place on the skin, told by an angle or by an arc length.

    Attributes:
        angle: of its middle (a body's reference point), from the symmetry axis, positive
            towards +x [rad].
        arc: of its middle, along the undeformed inner face from the face's own middle [m];
            instead of the angle.
        axial: of its middle, from mid-width [m]; of loads in three dimensions.
    """

    angle: Angle | None = file_key('"45 deg"', None)
    arc: Length | None = file_key('"22 mm"', None)
    axial: Length = file_key('"10 mm"', 0.0)

    @model_validator(mode="after")
    def _told_once(self) -> Self:
        if (self.angle is None) == (self.arc is None):
            raise PlacedError(
                "angle",
                'missing; add it, for example angle = "45 deg" (or arc = "22 mm")'
                if self.angle is None
                else "a place has an angle or an arc; take one out",
            )
        return self

    @property
    def told_by(self) -> str:
        """The key that says where along the arc it is."""
        return "angle" if self.angle is not None else "arc"


def whole_number(value: object) -> int:
    """A count from a file: a whole number of at least 1."""
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise ValueError("must be a whole number of at least 1")
    return value


NOT_A_LIST = "a list in square brackets is expected"


def at_most(count: int) -> BeforeValidator:
    """A validator of the same kind as `AsList` for lists of limited length."""

    def check(value: Any) -> tuple[Any, ...]:
        if not isinstance(value, list | tuple):
            raise ValueError(NOT_A_LIST)
        if len(value) > count:
            raise ValueError(f"has {len(value)} entries; at most {count} are allowed")
        return tuple(value)

    return BeforeValidator(check)


Count = Annotated[int, BeforeValidator(whole_number)]
AsList = at_most(1_000_000)
"""Accepts a TOML list for a tuple, and refuses everything else (text is not a list)."""
