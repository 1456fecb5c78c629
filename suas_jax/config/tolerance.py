"""Quantities with their uncertainty: text such as ``"20.7 MPa +- 10 %"``.

After ``+-`` (or ``±``) stands one standard deviation, in a unit of the value's kind or as a
share in per cent; ``+- 0`` says that the value is known exactly.
"""

import re
from typing import SupportsFloat

from suas_jax.config.errors import show
from suas_jax.config.quantities import DIMENSIONS, DimensionName, parse_quantity

_PLUS_MINUS = re.compile(r"\+\s?/?\s?[-\N{MINUS SIGN}]|\N{PLUS-MINUS SIGN}")
_SHARED_UNIT = re.compile(r"\(([^()]*)\)\s*(\S.*)?")
_LAST_UNIT = re.compile(r"[\d.]\s*([A-Za-zµμ°%].*)$")
_NUMBER_ALONE = re.compile(r"\s*[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?\s*")


class UncertainQuantity(float):
    """A value in SI units that carries its standard deviation, in the same unit.

    It is the value wherever a float is expected; what is computed from it is a plain float,
    and two that differ in their deviations only are equal.
    """

    __slots__ = ("deviation",)
    deviation: float

    def __new__(cls, value: SupportsFloat, deviation: float) -> "UncertainQuantity":
        """Join a value and its standard deviation."""
        self = super().__new__(cls, value)
        self.deviation = deviation
        return self

    def __getnewargs__(self) -> tuple[float, float]:  # type: ignore[override]
        """What copies and pickles are made from."""
        return float(self), self.deviation


class TypicalQuantity(UncertainQuantity):
    """One that a file names a substance for, and states no deviation of its own."""

    __slots__ = ()


def is_uncertain_text(text: str) -> bool:
    """Whether a text states an uncertainty."""
    return deviation_start(text) < len(text)


def deviation_start(text: str) -> int:
    """Where a quantity's deviation begins, with its sign; the text's length without one."""
    found = _PLUS_MINUS.search(text)
    return len(text) if found is None else found.start()


def parse_uncertain(text: str, dimension: DimensionName) -> UncertainQuantity:
    """Read a quantity with its unit and one standard deviation, in SI units.

    Such as ``"20.7 MPa +- 10 %"``, ``"1.50 mm +- 0.03 mm"``, ``"1.50 +- 0.03 mm"``, ``"(1.50 +-
    0.03) mm"``, ``"2.2 +- 0.1"`` or ``"5 mm +- 0"``. Raises ValueError: either part can't be
    read, or the deviation is negative, or a share of zero; says what is expected.
    """
    whole = text.strip()
    shared = _SHARED_UNIT.fullmatch(whole)
    inside, outside = shared.groups() if shared else (whole, None)
    parts = _PLUS_MINUS.split(inside)
    if len(parts) != 2:
        raise ValueError(
            'write a value and one standard deviation, such as "1.50 mm +- 0.03 mm" or '
            '"20.7 MPa +- 10 %"'
        )
    value_text, deviation_text = (part.strip() for part in parts)
    if outside:
        value_text, deviation_text = f"{value_text} {outside}", f"{deviation_text} {outside}"
    has_unit = bool(DIMENSIONS[dimension].si)
    unit = _LAST_UNIT.search(deviation_text)
    if has_unit and _NUMBER_ALONE.fullmatch(value_text) and unit and unit.group(1) != "%":
        value_text = f"{value_text} {unit.group(1)}"  # one unit for both
    value = parse_quantity(value_text, dimension)
    try:
        per_cent = value_text.endswith("%")
        deviation = _deviation(deviation_text, value, dimension, per_cent=per_cent)
    except ValueError as error:
        raise ValueError(f"after +-: {error}") from None
    return UncertainQuantity(value, deviation)


def _deviation(text: str, value: float, dimension: DimensionName, *, per_cent: bool) -> float:
    """One standard deviation in SI units; a share, unless the value itself is in per cent."""
    if text.endswith("%") and not per_cent:
        share = parse_quantity(text, "number")
        if share > 0 and value == 0:
            usual = DIMENSIONS[dimension].usual
            raise ValueError(
                f"{show(text)} is a share of zero; write {DIMENSIONS[dimension].article}, "
                f"such as {f'0.1 {usual}'.strip()}"
            )
        deviation = share * abs(value)
    elif _NUMBER_ALONE.fullmatch(text) and float(text) == 0.0:
        deviation = 0.0
    elif dimension == "temperature":
        deviation = parse_quantity(text, "warming")
    else:
        deviation = parse_quantity(text, dimension)
    if deviation < 0.0:
        raise ValueError(f"{show(text)} is negative; a standard deviation is zero or more")
    return deviation


def deviation_of(value: object) -> float | None:
    """The standard deviation that a value carries; None where none is stated."""
    return value.deviation if isinstance(value, UncertainQuantity) else None


def text_of(value: float, unit: float, name: str) -> str | float:
    """A value as a file has it, to twelve digits, with its deviation where it carries one.

    `value`: in SI units. `unit`: size of the unit that it is written in. `name`: of that unit;
    "" for a number, which without a deviation stays one.
    """
    deviation = deviation_of(value)
    if deviation is None and not name:
        return value
    text = f"{value / unit:.12g} {name}".strip()
    return text if deviation is None else f"{text} +- {deviation / unit:.4g} {name}".strip()
