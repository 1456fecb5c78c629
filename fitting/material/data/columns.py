"""Meaning of a data file's column, read off its name: quantity, direction, unit."""

import re
from typing import NamedTuple

from fitting.column_units import MULTIPLES, UNITS, unit_size
from fitting.material.data.column_names import QUANTITIES, Quantity, plain_words

SECONDS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0, "hr": 3600.0}
_CLOCKS = "hh:mm:ss", "h:mm:ss", "h:m:s", "mm:ss"  # how times are written, read as seconds
# Units of quantities that do not concern a material's law.
_OTHER_UNITS = frozenset(
    (
        *SECONDS,
        *_CLOCKS,
        *("seconds", "secs", "minutes", "cycles", "hz", "mm/min", "mm/s", "1/s", "%/s", "nm"),
        *("°c", "c", "k", "°f", "v", "mv", "mv/v", "mpa/s", "n/s", "kn/s", "n*m", "j", "w"),
    )
)
_STRESS = "MPa", "Pa, kPa, MPa, psi, kgf/cm2, bar, N/mm2"
# A unit to suggest, and those to name, of each dimension.
_SUGGESTED = {
    "stress": _STRESS,
    "pressure": ("kPa", _STRESS[1]),
    "force": ("N", "N, mN, kN, kgf, gf, lbf"),
    "length": ("mm", "um, mm, cm, m, in"),
    "area": ("mm2", "mm2, cm2, m2"),
    "angle": ("deg", "deg, rad"),
}
# A number of units for one of the column's.
_SCALED = re.compile(r"(-?[\d.,]*\d[.,]?(?:e[+-]?\d+)?)([^\d\s/].*?)(?:/m?v)?")
# Which specimen of a file a column or a size belongs to.
_SPECIMEN = re.compile(
    r"(?:^|_)(?:specimen|sample|probekoerper|probe|eprouvette)_*(?:no_|nr_)?#?(\d+)(?=_|$)"
)
SIZES = (
    *("length", "grip_separation", "width", "thickness", "diameter", "radius"),
    *("rest_radius", "area", "thickness_ratio"),
)
"""Sizes of a specimen."""


class Column(NamedTuple):
    """A column that was understood."""

    quantity: str  # what it measures
    direction: int  # 1 or 2; zero if its name has none
    unit: str  # unit as the units library calls it
    factor: float  # size of the unit in SI units


def understand(name: str, where: str) -> Column | None:
    """Read a column's name, such as "nominal_stress_1_MPa" or "Force [kgf]" of a file `where`.

    Returns what the column measures, or None if it is none of the known quantities.
    Raises ValueError: the quantity is known but its unit is missing or unknown.
    """
    plain, explicit = _name_and_unit(name)
    for quantity in QUANTITIES:
        found = re.match(rf"(?:{quantity.pattern})(?![a-z])", plain)
        if not found:
            continue
        direction, rest = _split_direction(plain[found.end() :])
        unit = explicit if explicit is not None else re.sub(r"^_in_(?=.)", "_", rest)
        if explicit is not None and rest.strip("_ "):
            continue
        column = _with_unit(quantity, direction, unit.strip("_, "), name, where)
        if column is not None:
            return column
    return None


def understood(name: str) -> Column | None:
    """What a column measures; None also where its unit is missing or unknown."""
    try:
        return understand(name, "")
    except ValueError:
        return None


def quantity_of(name: str) -> str | None:
    """Which quantity a name means, whatever its unit; None for others."""
    plain, _ = _name_and_unit(name)
    matching = (q for q in QUANTITIES if re.match(rf"(?:{q.pattern})(?![a-z])", plain))
    return next((quantity.name for quantity in matching), None)


def size_of(name: str) -> str:
    """Which size of a specimen a name is; "" for others. A cylinder's height is its length."""
    spelled = (understood(text) for text in (name, f"{name} [mm]", f"{name} [mm2]"))
    column = next((column for column in spelled if column is not None), None)
    if column is None:
        return ""
    size = "length" if column.quantity == "height" else column.quantity
    return size if size in SIZES else ""


def split_specimen(name: str) -> tuple[str, str]:
    """A name such as "Specimen 1 : Width" without its specimen, and that; "" for none."""
    found = _SPECIMEN.search(plain_words(name))
    if found is None:
        return name, ""
    rest = re.sub(
        rf"(?i)(?:specimen|sample|probekörper|probe|éprouvette)[\s_]*(?:no\.?|nr\.?)?\s*#?"
        rf"{found.group(1)}(?!\d)",
        " ",
        name,
        count=1,
    ).strip(" :;_-.,")
    return rest, found.group(1)


def is_unit(text: str) -> bool:
    """Whether a cell holds a unit, in brackets or without."""
    bare = text.strip("()[]{}<> ").casefold().replace("²", "2").replace("^2", "2")
    return bare in UNITS or bare in MULTIPLES or bare in _OTHER_UNITS


def with_unit(name: str, unit: str) -> str:
    """A column's name with the unit of the row of units, if that states one."""
    return f"{name} [{unit}]" if unit.strip("- ") and name else name


def _name_and_unit(name: str) -> tuple[str, str | None]:
    """Plain name and the unit in brackets; None where there are no brackets.

    Brackets that hold no unit say more about the name, such as "Strain (Extensometer) [%]".
    """
    spelled = name.strip().replace("²", "2").replace("^2", "2").replace("**2", "2")
    bracket = re.search(r"[\[({<]\s*([^\])}>]*?)\s*[\])}>]\s*$", spelled)
    if bracket is None:
        return plain_words(spelled), None
    before, unit = spelled[: bracket.start()], bracket.group(1)
    plain = plain_words(re.sub(r"\s*[\[({][^\])}]*[\])}]\s*", " ", before))
    if not is_unit(unit) and re.fullmatch(r"[a-zA-Z][\w ]{3,}", unit):
        return plain, None  # "Strain (Extension)": no unit is stated
    return plain, unit


def _split_direction(rest: str) -> tuple[int, str]:
    found = re.match(r"(?:_[a-zεσ])?_?([12xy])\1?(?:_(?:fixed|held))?(?=_|/|$)", rest)
    if not found:
        return 0, rest
    return {"1": 1, "x": 1, "2": 2, "y": 2}[found.group(1)], rest[found.end() :]


def _with_unit(
    quantity: Quantity, direction: int, unit: str, name: str, where: str
) -> Column | None:
    bare = unit.casefold().strip("/_ ")
    bare = re.sub(r"_per_|_", "/", re.sub(r"\s+", "", bare))
    scaled = _SCALED.fullmatch(MULTIPLES.get(bare, bare).casefold())
    if scaled is not None:  # readings of an amplifier, such as 50 N for every volt
        column = _with_unit(quantity, direction, scaled.group(2), name, where)
        size = float(scaled.group(1).replace(",", "."))
        told = column and column._replace(factor=size * column.factor)
        return told and told._replace(unit=unit) if bare in MULTIPLES else told
    kind, dimension, known = quantity.name, quantity.dimension, UNITS.get(bare)
    if dimension == "word":
        return None if bare else Column(kind, direction, "", 1.0)
    if dimension == "number":
        if not bare or known == "":
            return Column(kind, direction, "", 1.0)
        if kind == "strain" and known in ("mm", "cm", "um"):  # "Zugdehnung [mm]"
            return Column("displacement", direction, known, unit_size(known, "length"))
        return Column(kind, direction, "%", 0.01) if known == "%" else None
    if dimension == "time":
        bare = "s" if bare in _CLOCKS else bare
        size = SECONDS.get(bare or "s", 0.0)
        return Column("time", direction, bare, size) if size else None
    # ISO 527 calls a thickness a0.
    of_thickness = kind == "area" and name.strip().casefold().startswith("a0")
    if of_thickness and known in ("mm", "cm", "m", "um"):
        return Column("thickness", direction, known, unit_size(known, "length"))
    if known == "%" and kind in ("sigma", "displacement"):
        return Column({"sigma": "relative_sigma"}.get(kind, "strain"), direction, "%", 0.01)
    example, allowed = _SUGGESTED[dimension]
    if not bare:
        if kind in ("pressure", "length", "radius", "height") and len(name) <= 2:
            return None
        bracket = re.search(r"[\[({<]([^\])}>]*)[\])}>]\s*$", name)
        own = name[: bracket.start()].strip() if bracket else name
        unknown = f" ({bracket[1]} is not one of {allowed})" if bracket else ""
        raise ValueError(
            f'{where}: column "{name}" states no unit{unknown}; add it, for example '
            f'"{own}_{example}", or say which one by --columns "{kind}={name} {example}"'
        )
    if known is None:
        if kind == "stress":  # "stress_ratio" and the like
            return None
        stands_for = f"50 {example}/V" if bare in ("v", "mv") else example
        raise ValueError(
            f'{where}: column "{name}": unknown unit "{unit}"; allowed: {allowed}; say what it '
            f'stands for by --columns "{kind}={name} {stands_for}"'
        )
    if known == "mN" and re.search(r"(?<![A-Za-z])MN(?![A-Za-z])", name):
        raise ValueError(
            f'{where}: column "{name}": MN is a meganewton, and may be meant for mN; say which '
            f'by --columns "{kind}={name} mN" or "{kind}={name} 1e6 N"'
        )
    try:
        factor = unit_size(known, dimension)
    except ValueError:
        raise ValueError(
            f'{where}: column "{name}": "{unit}" is not a unit of {dimension}; '
            f"allowed: {allowed}"
        ) from None
    return Column(kind, direction, known, factor)
