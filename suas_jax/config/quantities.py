"""Quantities with units: text such as ``"57.5 mm"`` to SI floats, and back for messages."""

import decimal
import difflib
import math
import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, NamedTuple

from suas_jax.config.errors import show
from suas_jax.config.units import Unit, find_unit

DimensionName = Literal[
    "length",
    "angle",
    "stress",
    "pressure",
    "force",
    "capacitance",
    "density",
    "specific weight",
    "time",
    "viscosity",
    "kinematic viscosity",
    "temperature",
    "warming",
    "expansion",
    "number",
]


class Dimension(NamedTuple):
    """What kind of quantity a key holds."""

    article: str  # the name as it stands in a sentence, such as ``"a length"``
    si: str  # the SI unit that values are stored in (``""`` for a pure number)
    # that messages may show: name and size in SI units, from small to large
    units: tuple[tuple[str, float], ...]
    usual: str  # the unit that an example in a message carries


_PRESSURES = (("Pa", 1.0), ("kPa", 1e3), ("MPa", 1e6), ("GPa", 1e9))
_CAPACITANCES = (("fF", 1e-15), ("pF", 1e-12), ("nF", 1e-9))
_WEIGHTS = (("N/m^3", 1.0), ("kN/m^3", 1e3))
_TIMES = (("ms", 1e-3), ("s", 1.0), ("min", 60.0), ("h", 3600.0))
_VISCOSITIES = (("mPa s", 1e-3), ("Pa s", 1.0))
_KINEMATIC = (("cSt", 1e-6), ("m^2/s", 1.0))

DIMENSIONS: Mapping[DimensionName, Dimension] = MappingProxyType(
    {
        "length": Dimension("a length", "m", (("um", 1e-6), ("mm", 1e-3), ("m", 1.0)), "mm"),
        "angle": Dimension("an angle", "rad", (("deg", math.pi / 180.0),), "deg"),
        "pressure": Dimension("a pressure", "Pa", _PRESSURES, "kPa"),
        "stress": Dimension("a stress", "Pa", _PRESSURES, "MPa"),
        "force": Dimension("a force", "N", (("mN", 1e-3), ("N", 1.0), ("kN", 1e3)), "N"),
        "capacitance": Dimension("a capacitance", "F", _CAPACITANCES, "fF"),
        "density": Dimension("a density", "kg/m^3", (("kg/m^3", 1.0),), "kg/m^3"),
        "specific weight": Dimension("a specific weight", "N/m^3", _WEIGHTS, "kN/m^3"),
        "time": Dimension("a time", "s", _TIMES, "s"),
        "viscosity": Dimension("a viscosity", "Pa s", _VISCOSITIES, "mPa s"),
        "kinematic viscosity": Dimension("a kinematic viscosity", "m^2/s", _KINEMATIC, "cSt"),
        "temperature": Dimension("a temperature", "K", (("degC", 1.0),), "degC"),
        "warming": Dimension("a difference of temperatures", "K", (("K", 1.0),), "K"),
        "expansion": Dimension("an expansion per kelvin", "1/K", (("/ K", 1.0),), "/ K"),
        "number": Dimension("a number", "", (("", 1.0),), ""),
    }
)

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf(?:inity)?)\b")
_COMMA = re.compile(r"([+-]?[\d.]+(?:,[\d.]+)+)(\D*)")
ZERO_CELSIUS = 273.15  # [K]
_ZERO_FAHRENHEIT = 459.67 / 1.8  # [K]
ZEROS = MappingProxyType(
    dict.fromkeys(("degC", "celsius", "°C", "degreeC"), ZERO_CELSIUS)
    | dict.fromkeys(("degF", "fahrenheit", "°F", "degreeF"), _ZERO_FAHRENHEIT)
)
"""Zero [K] of the scales that do not begin at absolute zero, by all names of their units."""
_LONGEST = 200  # characters of a quantity


def _nearest_unit(text: str, dimension: Dimension) -> str | None:
    """Find the known unit that ``text`` was probably meant to be, the wanted kind first."""
    everything = [name for kind in DIMENSIONS.values() for name, _ in kind.units if name]
    wanted = [name for name, _ in dimension.units if name] + [dimension.si]
    for names in (wanted, [*everything, "degree", "newton", "pascal", "farad", "meter"]):
        folded = {name.casefold(): name for name in reversed(names)}
        if text.casefold() in folded:
            return folded[text.casefold()]
        close = difflib.get_close_matches(text, names, n=1, cutoff=0.6)
        if close:
            return close[0]
    return None


def parse_quantity(text: str, dimension: DimensionName) -> float:
    """Read a quantity such as ``"57.5 mm"`` as an SI value (angles in radians).

    A pure number may carry ``%`` or nothing. Raises ValueError: the text is not a finite number
    with a known unit of that kind; says what is expected, with an example.
    """
    kind = DIMENSIONS[dimension]
    if len(text) > _LONGEST:
        raise ValueError(f"has {len(text)} characters; {_expected(kind)}")
    stripped = text.strip().replace("\N{MINUS SIGN}", "-")
    if not stripped:
        raise ValueError(f"is empty; {_expected(kind)}")
    found = _NUMBER.match(stripped)
    if found is None:
        unit = find_unit(stripped)
        reason = "the number is missing" if unit else "this is not a number with a unit"
        raise ValueError(f"{reason}; {_expected(kind)}")
    number, unit_text = found.group(), stripped[found.end() :].strip()
    if not math.isfinite(float(number)):
        raise ValueError(f"must be a finite number; {_expected(kind)}")
    comma = _COMMA.match(stripped)
    if comma:
        digits, rest = comma.groups()
        one_comma = digits.count(",") == 1 and "." not in digits
        plain = digits.replace(",", "." if one_comma else "")
        raise ValueError(f'write numbers with a decimal point and no comma: "{plain}{rest}"')
    if not unit_text and kind.si:
        raise ValueError(f"the unit is missing; {_expected(kind, number)}")
    unit = find_unit(unit_text)
    if unit is None and not re.match(r"[A-Za-zµμ°%]|/\s*[A-Za-z]", unit_text):
        raise ValueError(f"this is not a number followed by a unit; {_expected(kind)}")
    if unit is None:
        near = _nearest_unit(unit_text, kind)
        hint = f' (did you mean "{near}"?)' if near else ""
        raise ValueError(f"unknown unit {show(unit_text)}{hint}; {_expected(kind, number)}")
    wanted = find_unit(kind.si)
    assert wanted is not None
    if unit.dimensionality != wanted.dimensionality:
        got = _kind_of(unit)
        raise ValueError(f"{show(unit_text)} is {got}; {_expected(kind, number)}")
    # In decimal, "0.305 fF" is the float nearest to 3.05e-16, with no rounding on the way.
    value = float(decimal.Decimal(number) * decimal.Decimal(repr(unit.size)))
    if dimension == "temperature":
        value += ZEROS.get(unit_text, 0.0)
    if not math.isfinite(value):
        raise ValueError(f"is too large to compute with; {_expected(kind)}")
    return value


def _kind_of(unit: Unit) -> str:
    """Name what a unit measures, for a message."""
    for kind in DIMENSIONS.values():
        known = find_unit(kind.si)
        if known is not None and known.dimensionality == unit.dimensionality:
            return (
                "a pure number" if not kind.si else f"a unit of {kind.article.split(' ', 1)[1]}"
            )
    return "a unit of " + str(unit.dimensionality).replace("[", "").replace("]", "")


def _expected(kind: Dimension, number: str = "1") -> str:
    """Say what should have been written, with an example around the given number."""
    if not kind.si:
        return f"a number without a unit is expected, for example {number}"
    choices = [f'"{number} {unit}"' for unit in dict.fromkeys((kind.usual, kind.si))]
    return f"{kind.article} with its unit is expected, for example {' or '.join(choices)}"


def to_si(value: object, dimension: DimensionName, *, bare_numbers: bool = False) -> float:
    """Read a value of a TOML file or of Python, in SI units (angles in radians).

    `value`: text with a unit, or a number. `dimension`: the kind of quantity that is expected.
    `bare_numbers`: accept a number without a unit as an SI value, as Python code holds them;
    files must state the unit. Pure numbers need none anywhere.
    Raises ValueError: the value is not a finite quantity of that kind; says what is expected.
    """
    kind = DIMENSIONS[dimension]
    if isinstance(value, str):
        return parse_quantity(value, dimension)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(_expected(kind))
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"must be a finite number; {_expected(kind)}")
    if kind.si and not bare_numbers:
        raise ValueError(f"the unit is missing; {_expected(kind, str(value))}")
    return number


def format_quantity(value: float, dimension: DimensionName) -> str:
    """Write an SI value to six digits with the largest unit that keeps it at or above one."""
    kind = DIMENSIONS[dimension]
    if dimension == "temperature":
        return f"{value - ZERO_CELSIUS:.6g} degC"
    fitting = [unit for unit in kind.units if abs(value) >= unit[1] * (1.0 - 1e-9)]
    usual = next(unit for unit in kind.units if unit[0] == kind.usual)
    name, size = fitting[-1] if fitting else (usual if value == 0.0 else kind.units[0])
    return f"{value / size:.6g} {name}".strip()
