"""Units as they stand in the names of columns."""

import math

from suas_jax.config.quantities import DimensionName, parse_quantity

_PLAIN = (
    "Pa hPa kPa MPa GPa psi ksi bar mbar atm mmHg torr N/mm^2 N/cm^2 N/m^2 kN/m^2 MN/m^2 "
    "kgf/cm^2 kgf/mm^2 gf/cm^2 N mN kN kgf gf lbf um mm cm m in deg rad % mm^2 cm^2 m^2 in^2"
)
_OTHERS = {
    "psi": "lbf/in2",
    "kgf/cm^2": "kg/cm2 kp/cm2",
    "kgf/mm^2": "kg/mm2",
    "kgf": "kg",
    "gf": "g grams",
    "lbf": "lb lbs",
    "um": "\N{MICRO SIGN}m \N{GREEK SMALL LETTER MU}m",
    "in": "inch inches",
    "deg": "degree degrees °",
    "%": "percent pct",
    "": "mm/mm m/m in/in - 1",
}
UNITS = {unit.lower().replace("^", ""): unit for unit in _PLAIN.split()} | {
    spelled: unit for unit, others in _OTHERS.items() for spelled in others.split()
}
"""What the units library calls a unit, by its spelling in names of columns.

Spellings are lower case and without blanks.
Megapascals are never millipascals here.
"""

MULTIPLES = {
    "dan": "10N",
    "cn": "0.01N",
    "ozf": "0.278013851N",
    "mil": "0.0254mm",
    "\N{GREEK SMALL LETTER MU}\N{GREEK SMALL LETTER EPSILON}": "1e-4%",
    "microstrain": "1e-4%",
    "inh2o": "249.089Pa",
    "cmh2o": "98.0665Pa",
    "mmh2o": "9.80665Pa",
}
"""Units that are a number of others, spelled as those of `UNITS`."""


def unit_size(unit: str, dimension: str) -> float:
    """Size of a unit in SI units; an area's is the square of its length's.

    The unit is named as the units library calls it, such as a value of `UNITS`; the dimension
    is a kind of unit of that library, or "area".
    Raises ValueError: the unit is none of this kind.
    """
    if dimension == "area":
        if not unit.endswith("^2"):
            raise ValueError(f'"{unit}" is not a unit of area')
        return parse_quantity(f"1 {unit[:-2]}", "length") ** 2
    kind: DimensionName = dimension  # type: ignore[assignment]
    size = parse_quantity(f"1 {unit}", kind)
    assert math.isfinite(size)
    return size
