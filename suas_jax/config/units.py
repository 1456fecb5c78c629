"""Units of measurement: which expressions are one, how large it is and what it measures.

The registry is built when first needed, from a short list: in 1 ms instead of 150, an angle is
a dimension of its own, and a slip of the finger is an error and not an exotic unit.
"""

import contextlib
import functools
import math
import re
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import pint

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
celsius = kelvin = degC = degreeC
fahrenheit = 0.5555555555555556 kelvin = degF = degreeF
count = []
percent = 0.01 count = %
ppm = 1e-6 count
gram = 1e-3 kilogram = g
tonne = 1e3 kilogram = t
pound = 0.45359237 kilogram = lb
ounce = 0.028349523125 kilogram = oz
inch = 0.0254 meter = in = inches
mil = 25.4e-6 meter = thou
foot = 0.3048 meter = ft = feet
minute = 60 second = min
hour = 3600 second = h
degree = 0.017453292519943295 radian = deg
arcminute = 2.908882086657216e-4 radian = arcmin
turn = 6.283185307179586 radian = _ = revolution
newton = kilogram * meter / second ** 2 = N
dyne = 1e-5 newton = dyn
gram_force = 9.80665e-3 newton = gf
kilogram_force = 9.80665 newton = kgf
pound_force = 4.4482216152605 newton = lbf
ounce_force = 0.27801385095378125 newton = ozf
pascal = newton / meter ** 2 = Pa
bar = 1e5 pascal
atmosphere = 101325 pascal = atm
torr = 133.32236842105263 pascal
mmHg = 133.322387415 pascal
pound_force_per_square_inch = 6894.757293168361 pascal = psi
kilopound_force_per_square_inch = 6894757.293168361 pascal = ksi
poise = 0.1 pascal * second = P
stokes = 1e-4 meter ** 2 / second = St
joule = newton * meter = J
watt = joule / second = W
volt = watt / ampere = V
coulomb = ampere * second = C
farad = coulomb / volt = F
hertz = 1 / second = Hz
liter = 1e-3 meter ** 3 = l = L = litre
"""

# Units by name, each with at most one power of one digit, multiplied or divided, and one
# level of parentheses: all that people write, and nothing whose evaluation takes long.
_NAME = r"[A-Za-zµμ°%]+(?:_[A-Za-z]+)*"
_POWER = r"(?:\s*(?:\*\*|\^)\s*(?:[+-]?[1-9]|\(\s*[+-]?[1-9]\s*\))|[⁺⁻]?[¹²³⁴⁵⁶⁷⁸⁹]|[1-9])?"
_FACTOR = rf"{_NAME}{_POWER}(?![\d.])"
_BETWEEN = r"(?:\s*[*/·]\s*|\s+)"
_PRODUCT = rf"{_FACTOR}(?:{_BETWEEN}{_FACTOR})*"
_PART = rf"(?:{_FACTOR}|\(\s*{_PRODUCT}\s*\){_POWER})"
_UNIT_TEXT = re.compile(rf"{_PART}(?:{_BETWEEN}{_PART})*")
_INVERSE = re.compile(r"1?\s*/\s*(?=[A-Za-zµμ°])")
_BARE_POWER = re.compile(r"(?<=[A-Za-z])(\d)")


@contextlib.contextmanager
def _without_dask() -> Iterator[None]:
    """Let an import find no Dask.

    Pint imports it where it is installed, for arrays with units, of which there are none here:
    more than half of Pint's own time.
    """
    if "dask" in sys.modules:
        yield
        return
    sys.modules["dask"] = None  # type: ignore[assignment]  # what Python takes for "absent"
    try:
        yield
    finally:
        del sys.modules["dask"]


@functools.cache
def _registry() -> "pint.UnitRegistry":
    with _without_dask():
        import pint  # here, so that programs which parse no quantity don't pay for it

    registry: pint.UnitRegistry = pint.UnitRegistry(None)
    registry.load_definitions(_DEFINITIONS.strip().splitlines())
    return registry


class Unit(NamedTuple):
    """What a unit is worth."""

    size: float  # in SI base units
    dimensionality: Any  # what it measures; equal for units of one kind


@functools.lru_cache
def find_unit(text: str) -> Unit | None:
    """Look a unit expression such as ``"kN/m^3"`` up; None if it isn't one.

    `text`: the expression; empty for a pure number.
    """
    if not text:
        return Unit(1.0, _registry().dimensionless.dimensionality)
    inverse = _INVERSE.match(text)
    if inverse:
        unit = find_unit(text[inverse.end() :])
        return unit and Unit(1 / unit.size, unit.dimensionality**-1)
    if not _UNIT_TEXT.fullmatch(text):
        return None
    # "kN/m3" is how people write kN/m^3; the degree sign stands alone in no registry.
    spelled = _BARE_POWER.sub(r"^\1", text).replace("°", "degree")
    try:
        one = _registry().Quantity(1.0, _registry().parse_units(spelled)).to_base_units()
        size = float(one.magnitude)
    except Exception:  # the library's parser raises whatever its tokenizer stumbles on
        return None
    return Unit(size, one.units.dimensionality) if math.isfinite(size) and size > 0 else None
