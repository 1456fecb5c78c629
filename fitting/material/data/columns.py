"""What a column of a data file measures, read off its name: quantity, direction, unit."""

import re
from typing import NamedTuple

from fitting.column_units import UNITS, unit_size

STRESS_UNITS = "Pa, kPa, MPa, psi, kgf/cm2, bar, N/mm2"


class Quantity(NamedTuple):
    """What a column can measure.

    Attributes:
        name: how this project calls it.
        dimension: kind of unit; "area" is a length squared, "word" has none.
        pattern: regular expression of its names, blanks as underscores.
    """

    name: str
    dimension: str
    pattern: str


_QUANTITIES = tuple(
    Quantity(name, dimension, pattern)
    for name, dimension, pattern in (
        (
            "cauchy_difference",
            "stress",
            r"(?:cauchy|true)_stress_difference_(?:22_minus_11|2_minus_1)",
        ),
        (
            "cauchy_difference_reversed",
            "stress",
            r"(?:cauchy|true)_stress_difference_(?:11_minus_22|1_minus_2)",
        ),
        ("sigma_displacement", "length", r"(?:sigma|noise|uncertainty|std)_displacement"),
        (
            "sigma",
            "stress",
            r"(?:sigma|noise|uncertainty|std|stdev|standard_deviation|error)"
            r"(?:_(?:nominal|cauchy|engineering|true))?(?:_stress)?"
            r"(?:_(?:oil_)?pressure)?",
        ),
        ("nominal_shear", "stress", r"(?:nominal_|engineering_|cauchy_)?shear_stress"),
        ("cauchy", "stress", r"(?:cauchy|true|kirchhoff)_?stress"),
        ("second_pk", "stress", r"(?:second_piola_kirchhoff|pk2|2nd_pk|second_pk)(?:_stress)?"),
        (
            "nominal",
            "stress",
            r"(?:nominal|engineering|eng|first_piola_kirchhoff|pk1|1st_pk|first_pk|tensile"
            r"|compressive|standard)_?stress|pk1|first_piola_kirchhoff",
        ),
        ("stress", "stress", r"stress"),
        ("pressure", "pressure", r"(?:inflation_|gauge_|differential_|oil_)?pressure|p"),
        ("force", "force", r"(?:axial_|standard_|tensile_)?(?:force|load)"),
        ("shear_angle", "angle", r"shear_angle"),
        ("shear", "number", r"shear_strain|amount_of_shear|shear|gamma|γ"),
        ("log_strain", "number", r"(?:log|true|hencky|logarithmic|natural|ln)_?strain"),
        ("green_strain", "number", r"green(?:_lagrange)?_?strain"),
        (
            "strain",
            "number",
            r"(?:nominal_|engineering_|eng_|tensile_|compressive_)?strain|elongation_percent"
            r"|epsilon",
        ),
        ("stretch", "number", r"(?:hoop_)?stretch(?:_ratio)?|extension_ratio|lambda|λ|lam"),
        (
            "displacement",
            "length",
            r"(?:crosshead_|loads_0_)?(?:displacement|extension|elongation|stroke|travel|deflection)",
        ),
        ("height", "length", r"(?:apex_|pole_|bulge_|dome_)?height|apex_displacement"),
        ("length", "length", r"(?:gauge_|gage_|initial_|specimen_)?length|l0"),
        ("width", "length", r"(?:specimen_)?width"),
        ("thickness", "length", r"(?:specimen_|wall_|initial_|membrane_)?thickness"),
        ("diameter", "length", r"(?:specimen_)?diameter"),
        ("rest_radius", "length", r"(?:initial|undeformed|reference|rest)_radius|r0"),
        ("radius", "length", r"(?:current_|balloon_|membrane_|diaphragm_)?radius"),
        ("area", "area", r"(?:specimen_|initial_|cross_section(?:al)?_)?area|a0"),
        ("thickness_ratio", "number", r"thickness_ratio|h_over_r"),
        ("weight", "number", r"weight"),
        ("use", "word", r"use|mask|valid|include"),
        ("specimen", "word", r"specimen|sample|specimen_id|sample_id"),
    )
)


class Column(NamedTuple):
    """A column that was understood.

    Attributes:
        quantity: what it measures.
        direction: 1 or 2; zero if its name has none.
        unit: unit as the units library calls it.
        factor: size of the unit in SI units.
    """

    quantity: str
    direction: int
    unit: str
    factor: float


def understand(name: str, where: str) -> Column | None:
    """Read a column's name, such as "nominal_stress_1_MPa" or "Force [kgf]".

    Args:
        name: the column's name.
        where: file, for messages.

    Returns:
        What the column measures, or None if it is none of the known quantities.

    Raises:
        ValueError: the quantity is known but its unit is missing or unknown.
    """
    spelled = name.strip().replace("²", "2").replace("^2", "2").replace("**2", "2")
    bracket = re.search(r"[\[(]\s*([^\])]*?)\s*[\])]\s*$", spelled)
    explicit = bracket.group(1) if bracket else None
    plain = _plain(spelled[: bracket.start()] if bracket else spelled)
    for quantity in _QUANTITIES:
        found = re.match(rf"(?:{quantity.pattern})(?![a-z])", plain)
        if not found:
            continue
        rest = plain[found.end() :]
        direction, rest = _split_direction(rest)
        unit = explicit if explicit is not None else rest.strip("_ ")
        if explicit is not None and rest.strip("_ "):
            continue
        column = _with_unit(quantity, direction, unit, name, where)
        if column is not None:
            return column
    return None


def _plain(text: str) -> str:
    text = re.sub(r"(?<=[a-z])(?=[A-Z][a-z])(?!Pa)", "_", text.strip())
    return re.sub(r"[\s\-.:]+", "_", text.casefold()).strip("_")


def _split_direction(rest: str) -> tuple[int, str]:
    found = re.match(r"_?(1|2|x|y)(?:_(?:fixed|held))?(?=_|/|$)", rest)
    if not found:
        return 0, rest
    return {"1": 1, "x": 1, "2": 2, "y": 2}[found.group(1)], rest[found.end() :]


def _with_unit(
    quantity: Quantity, direction: int, unit: str, name: str, where: str
) -> Column | None:
    bare = unit.casefold().strip("/_ ")
    bare = re.sub(r"_per_|_", "/", re.sub(r"\s+", "", bare))
    if quantity.dimension == "word":
        return None if bare else Column(quantity.name, direction, "", 1.0)
    if quantity.dimension == "number":
        if not bare or UNITS.get(bare) == "":
            return Column(quantity.name, direction, "", 1.0)
        if UNITS.get(bare) == "%":
            return Column(quantity.name, direction, "%", 0.01)
        return None
    if quantity.name == "sigma" and UNITS.get(bare) == "%":
        return Column("relative_sigma", direction, "%", 0.01)
    if not bare:
        if quantity.name in ("pressure", "length", "radius", "height") and len(name) <= 2:
            return None
        raise ValueError(
            f'{where}: column "{name}" states no unit; add it, for example '
            f'"{name}_{_example(quantity.dimension)}"'
        )
    if bare not in UNITS:
        if quantity.name == "stress":  # "stress_ratio" and the like
            return None
        raise ValueError(
            f'{where}: column "{name}": unknown unit "{unit}"; allowed: '
            f"{_allowed(quantity.dimension)}"
        )
    known = UNITS[bare]
    if quantity.name in ("displacement",) and known == "%":
        return Column("strain", direction, "%", 0.01)
    try:
        factor = unit_size(known, quantity.dimension)
    except ValueError:
        raise ValueError(
            f'{where}: column "{name}": "{unit}" is no unit of {quantity.dimension}; allowed: '
            f"{_allowed(quantity.dimension)}"
        ) from None
    return Column(quantity.name, direction, known, factor)


def _example(dimension: str) -> str:
    examples = {"stress": "MPa", "pressure": "kPa", "force": "N", "length": "mm"}
    return examples.get(dimension, {"area": "mm2", "angle": "deg"}.get(dimension, ""))


def _allowed(dimension: str) -> str:
    choices = {
        "stress": STRESS_UNITS,
        "pressure": STRESS_UNITS,
        "force": "N, mN, kN, kgf, gf, lbf",
        "length": "um, mm, cm, m, in",
        "area": "mm2, cm2, m2",
        "angle": "deg, rad",
    }
    return choices[dimension]
