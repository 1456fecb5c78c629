"""Units as they stand in the names of columns."""

import math

from suas_jax.config.quantities import DimensionName, parse_quantity

# Unit spellings in column names, lower case and without blanks, to what the units library
# calls them. Megapascals are never millipascals here.
UNITS: dict[str, str] = {
    "pa": "Pa",
    "hpa": "hPa",
    "kpa": "kPa",
    "mpa": "MPa",
    "gpa": "GPa",
    "psi": "psi",
    "lbf/in2": "psi",
    "ksi": "ksi",
    "bar": "bar",
    "mbar": "mbar",
    "atm": "atm",
    "mmhg": "mmHg",
    "torr": "torr",
    "n/mm2": "N/mm^2",
    "n/cm2": "N/cm^2",
    "n/m2": "N/m^2",
    "kn/m2": "kN/m^2",
    "mn/m2": "MN/m^2",
    "kgf/cm2": "kgf/cm^2",
    "kg/cm2": "kgf/cm^2",
    "kp/cm2": "kgf/cm^2",
    "kgf/mm2": "kgf/mm^2",
    "kg/mm2": "kgf/mm^2",
    "gf/cm2": "gf/cm^2",
    "n": "N",
    "mn": "mN",
    "kn": "kN",
    "kgf": "kgf",
    "kg": "kgf",
    "gf": "gf",
    "g": "gf",
    "lbf": "lbf",
    "lb": "lbf",
    "um": "um",
    "µm": "um",
    "μm": "um",
    "mm": "mm",
    "cm": "cm",
    "m": "m",
    "in": "in",
    "inch": "in",
    "deg": "deg",
    "degree": "deg",
    "degrees": "deg",
    "°": "deg",
    "rad": "rad",
    "%": "%",
    "percent": "%",
    "pct": "%",
    "mm2": "mm^2",
    "cm2": "cm^2",
    "m2": "m^2",
    "mm/mm": "",
    "m/m": "",
    "in/in": "",
    "-": "",
    "1": "",
}


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
