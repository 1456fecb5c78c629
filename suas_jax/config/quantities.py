"""Quantities with units: text such as ``"57.5 mm"`` to SI floats, and back for messages.

The units library is imported when the first quantity is parsed, and its registry is built
from the short list below instead of the library's own (1 ms against 150 ms or more). The short
list also makes an angle a dimension of its own, so that ``"45 %"`` is no angle, and keeps
rare units out, so that a slip of the finger is an error and not an exotic unit.
"""

from __future__ import annotations

import decimal
import difflib
import functools
import math
import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal, NamedTuple

from suas_jax.config.errors import show

if TYPE_CHECKING:
    import pint

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
    "number",
]


class Dimension(NamedTuple):
    """What kind of quantity a key holds.

    Attributes:
        article: the name as it stands in a sentence, such as ``"a length"``.
        si: the SI unit that values are stored in (``""`` for a pure number).
        units: units that messages may show: name and size in SI units, from small to large.
        usual: the unit that an example in a message carries.
    """

    article: str
    si: str
    units: tuple[tuple[str, float], ...]
    usual: str


_PRESSURES = (("Pa", 1.0), ("kPa", 1e3), ("MPa", 1e6), ("GPa", 1e9))

DIMENSIONS: Mapping[DimensionName, Dimension] = MappingProxyType(
    {
        "length": Dimension("a length", "m", (("um", 1e-6), ("mm", 1e-3), ("m", 1.0)), "mm"),
        "angle": Dimension("an angle", "rad", (("deg", math.pi / 180.0),), "deg"),
        "pressure": Dimension("a pressure", "Pa", _PRESSURES, "kPa"),
        "stress": Dimension("a stress", "Pa", _PRESSURES, "MPa"),
        "force": Dimension("a force", "N", (("mN", 1e-3), ("N", 1.0), ("kN", 1e3)), "N"),
        "capacitance": Dimension(
            "a capacitance", "F", (("fF", 1e-15), ("pF", 1e-12), ("nF", 1e-9)), "fF"
        ),
        "density": Dimension("a density", "kg/m^3", (("kg/m^3", 1.0),), "kg/m^3"),
        "specific weight": Dimension(
            "a specific weight", "N/m^3", (("N/m^3", 1.0), ("kN/m^3", 1e3)), "kN/m^3"
        ),
        "time": Dimension(
            "a time", "s", (("ms", 1e-3), ("s", 1.0), ("min", 60.0), ("h", 3600.0)), "s"
        ),
        "number": Dimension("a number", "", (("", 1.0),), ""),
    }
)

_DEFINITIONS = """
femto- = 1e-15 = f-
pico- = 1e-12 = p-
nano- = 1e-9 = n-
micro- = 1e-6 = µ- = μ- = u-
milli- = 1e-3 = m-
centi- = 1e-2 = c-
deci- = 1e-1 = d-
hecto- = 1e2 = h-
kilo- = 1e3 = k-
mega- = 1e6 = M-
giga- = 1e9 = G-
meter = [length] = m = metre
kilogram = [mass] = kg
second = [time] = s
ampere = [current] = A
radian = [angle] = rad
kelvin = [temperature] = K
count = []
percent = 0.01 count = %
gram = 1e-3 kilogram = g
tonne = 1e3 kilogram = t
pound = 0.45359237 kilogram = lb
inch = 0.0254 meter = in = inches
foot = 0.3048 meter = ft = feet
minute = 60 second = min
hour = 3600 second = h
degree = 0.017453292519943295 radian = deg
arcminute = 2.908882086657216e-4 radian = arcmin
turn = 6.283185307179586 radian = turn = revolution
newton = kilogram * meter / second ** 2 = N
dyne = 1e-5 newton = dyn
gram_force = 9.80665e-3 newton = gf
kilogram_force = 9.80665 newton = kgf
pound_force = 4.4482216152605 newton = lbf
pascal = newton / meter ** 2 = Pa
bar = 1e5 pascal
atmosphere = 101325 pascal = atm
torr = 133.32236842105263 pascal
mmHg = 133.322387415 pascal
pound_force_per_square_inch = 6894.757293168361 pascal = psi
kilopound_force_per_square_inch = 6894757.293168361 pascal = ksi
joule = newton * meter = J
watt = joule / second = W
volt = watt / ampere = V
coulomb = ampere * second = C
farad = coulomb / volt = F
hertz = 1 / second = Hz
liter = 1e-3 meter ** 3 = l = L = litre
"""

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf(?:inity)?)\b")
_COMMA = re.compile(r"([+-]?[\d.]+(?:,[\d.]+)+)(\D*)")
# Units by name, each with at most one power of one digit, multiplied or divided, and one
# level of parentheses: all that people write, and nothing whose evaluation takes long.
_LONGEST = 200  # characters of a quantity
_NAME = r"[A-Za-zµμ°%]+(?:_[A-Za-z]+)*"
_POWER = r"(?:\s*(?:\*\*|\^)\s*(?:[+-]?[1-9]|\(\s*[+-]?[1-9]\s*\))|[⁺⁻]?[¹²³⁴⁵⁶⁷⁸⁹]|[1-9])?"
_FACTOR = rf"{_NAME}{_POWER}(?![\d.])"
_BETWEEN = r"(?:\s*[*/·]\s*|\s+)"
_PRODUCT = rf"{_FACTOR}(?:{_BETWEEN}{_FACTOR})*"
_PART = rf"(?:{_FACTOR}|\(\s*{_PRODUCT}\s*\){_POWER})"
_UNIT_TEXT = re.compile(rf"{_PART}(?:{_BETWEEN}{_PART})*")
_BARE_POWER = re.compile(r"(?<=[A-Za-z])(\d)")


@functools.cache
def _registry() -> pint.UnitRegistry:
    import pint  # here, so that programs which parse no quantity don't pay for it

    registry: pint.UnitRegistry = pint.UnitRegistry(None)
    registry.load_definitions(_DEFINITIONS.strip().splitlines())
    return registry


class _Unit(NamedTuple):
    size: float  # in SI base units
    dimensionality: object


@functools.lru_cache(maxsize=256)
def _unit(text: str) -> _Unit | None:
    """Look a unit expression up; None if it isn't one."""
    if not text:
        return _Unit(1.0, _registry().dimensionless.dimensionality)
    if not _UNIT_TEXT.fullmatch(text):
        return None
    # "kN/m3" is how people write kN/m^3; the degree sign stands alone in no registry.
    spelled = _BARE_POWER.sub(r"^\1", text).replace("°", "degree")
    try:
        one = _registry().Quantity(1.0, _registry().parse_units(spelled)).to_base_units()
        size = float(one.magnitude)
    except Exception:  # the library's parser raises whatever its tokenizer stumbles on
        return None
    return _Unit(size, one.units.dimensionality) if math.isfinite(size) and size > 0 else None


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
    """Read a quantity with its unit.

    Args:
        text: a number and a unit, such as ``"57.5 mm"``, ``"10.051 kN/m3"`` or ``"45 deg"``.
            A pure number may carry ``%`` or nothing.
        dimension: the kind of quantity that is expected.

    Returns:
        The value in SI units (angles in radians).

    Raises:
        ValueError: if the text is no finite number with a known unit of that kind. The message
            says what is expected, with an example.
    """
    kind = DIMENSIONS[dimension]
    if len(text) > _LONGEST:
        raise ValueError(f"has {len(text)} characters; {_expected(kind)}")
    stripped = text.strip().replace("\N{MINUS SIGN}", "-")
    if not stripped:
        raise ValueError(f"is empty; {_expected(kind)}")
    found = _NUMBER.match(stripped)
    if found is None:
        unit = _unit(stripped)
        reason = "the number is missing" if unit else "this is no number with a unit"
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
    unit = _unit(unit_text)
    if unit is None and not re.match(r"[A-Za-zµμ°%]", unit_text):
        raise ValueError(f"this is no number followed by a unit; {_expected(kind)}")
    if unit is None:
        near = _nearest_unit(unit_text, kind)
        hint = f' (did you mean "{near}"?)' if near else ""
        raise ValueError(f"unknown unit {show(unit_text)}{hint}; {_expected(kind, number)}")
    wanted = _unit(kind.si)
    assert wanted is not None
    if unit.dimensionality != wanted.dimensionality:
        got = _kind_of(unit)
        raise ValueError(f"{show(unit_text)} is {got}; {_expected(kind, number)}")
    # In decimal, "0.305 fF" is the float nearest to 3.05e-16, with no rounding on the way.
    value = float(decimal.Decimal(number) * decimal.Decimal(repr(unit.size)))
    if not math.isfinite(value):
        raise ValueError(f"is too large to compute with; {_expected(kind)}")
    return value


def _kind_of(unit: _Unit) -> str:
    """Name what a unit measures, for a message."""
    for kind in DIMENSIONS.values():
        known = _unit(kind.si)
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
    """Read a value as it comes out of a TOML file or from Python code.

    Args:
        value: text with a unit, or a number.
        dimension: the kind of quantity that is expected.
        bare_numbers: accept a number without a unit as a value in SI units. Files must state
            the unit; Python code holds SI values. Pure numbers need no unit anywhere.

    Returns:
        The value in SI units (angles in radians).

    Raises:
        ValueError: if the value is no finite quantity of that kind, with what is expected.
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
    """Write an SI value with a readable unit, such as ``"57.5 mm"`` for 0.0575 m.

    Args:
        value: in SI units (angles in radians).
        dimension: the kind of quantity.

    Returns:
        The number to six digits with the largest unit that keeps it at or above one.
    """
    kind = DIMENSIONS[dimension]
    fitting = [unit for unit in kind.units if abs(value) >= unit[1] * (1.0 - 1e-9)]
    usual = next(unit for unit in kind.units if unit[0] == kind.usual)
    name, size = fitting[-1] if fitting else (usual if value == 0.0 else kind.units[0])
    return f"{value / size:.6g} {name}".strip()
