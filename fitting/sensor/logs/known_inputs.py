"""Known inputs of a log: columns of loads, displacements and fluid.

A column is a quantity of a load with its unit, such as `load_0_force_N`,
`load_0_angle_deg` or `load_0_arc_mm`, `load_0_direction_deg`,
`load_0_displacement_mm` (mid-surface) or `load_0_inner_displacement_mm` (inner face), or
`load_0_depth_mm` with `load_0_radius_mm` of a rigid body; on a pad also `load_0_axial_mm`
and `load_0_diameter_mm`. `loads.0.force_N`, as in load paths, and `force_N`, where there is
one load, mean the same. A column `fluid` names what fills the gap.
They stand beside the counts of the log, in its header (`# load_0_angle_deg: 30`) where they
are constant, or in a second file with a time column.
"""

import dataclasses
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from fitting.column_units import unit_size
from suas_jax.config import GeometrySpec, SkinSpec, format_quantity
from suas_jax.config.csv_table import number_in, read_csv_table
from suas_jax.config.oil import FLUIDS
from suas_jax.skin.plain import clamped_edge

_FORCES, _ANGLES, _LENGTHS = (
    ("N", "mN", "kN", "gf", "kgf"),
    ("deg", "rad"),
    ("mm", "um", "m", "cm"),
)
# Dimension of each quantity, and the units that its columns may have.
_UNITS: dict[str, tuple[str, tuple[str, ...]]] = {
    "force": ("force", _FORCES),
    "angle": ("angle", _ANGLES),
    "arc": ("length", _LENGTHS),
    "direction": ("angle", _ANGLES),
    "displacement": ("length", _LENGTHS),
    "inner_displacement": ("length", _LENGTHS),
    "axial": ("length", _LENGTHS),
    "diameter": ("length", _LENGTHS),
    "depth": ("length", _LENGTHS),
    "radius": ("length", _LENGTHS),
}
_COLUMN = re.compile(
    r"(?:loads?[._]?(?P<load>\d*)[._])?(?:mid_)?"
    r"(?P<quantity>inner_displacement|displacement|force|angle|arc|direction|axial|diameter"
    r"|depth|radius)"
    r"(?:[._ ]?[\[(]?(?P<unit>[A-Za-zµ]+)[\])]?)?",
    re.IGNORECASE,
)
_TIMES = ("t_device_s", "t_s", "t_host_s", "time_s")
FLUID = "fluid"
_SAME = 1e-6  # of the largest value, by which two sources may differ
MOST_LOADS = 8

Key = tuple[int, str]

OIL = "oil"


@dataclasses.dataclass(frozen=True)
class Known:
    """Known inputs, row by row."""

    # by load and quantity, SI units [row]; NaN where a row has none
    values: dict[Key, np.ndarray]
    # names or permittivities, as given [row]; None where nothing is said
    fluid: np.ndarray | None
    names: dict[Key, str]  # the column that each quantity came from

    def merged(self, other: "Known", where: str) -> "Known":
        """Together with what another source knows.

        Raises ValueError: both give the same quantity with different values.
        """
        for key in sorted(self.values.keys() & other.values.keys()):
            own, given = self.values[key], other.values[key]
            size = float(np.nanmax(np.abs(own), initial=0.0))
            if not np.allclose(own, given, rtol=0.0, atol=_SAME * size, equal_nan=True):
                raise ValueError(
                    f"{where}: load {key[0]}: {key[1]} is given by {self.names[key]} and, with "
                    f"other values, by {other.names[key]}; leave one out"
                )
        first, fluid = self.fluid, other.fluid
        if first is not None and fluid is not None and not np.array_equal(first, fluid):
            raise ValueError(
                f"{where}: two sources (header, column, --inputs) name the fluid, and not the "
                "same one; leave one out"
            )
        fluid = first if fluid is None else fluid
        return Known(self.values | other.values, fluid, self.names | other.names)


def understood(name: str, where: str) -> tuple[Key, float] | None:
    """Load, quantity and unit of a column; None if it is not a known input.

    Raises ValueError: it looks like one, but its unit is missing or unknown.
    """
    found = _COLUMN.fullmatch(name.strip())
    if found is None:
        return None
    quantity = found["quantity"].lower()
    dimension, units = _UNITS[quantity]
    unit = found["unit"]
    if unit is None:
        raise ValueError(
            f'{where}, column "{name}": its unit is missing; allowed: '
            + ", ".join(f"{name}_{u}" for u in units)
        )
    unit = {"µm": "um"}.get(unit, unit)
    if unit not in units:
        raise ValueError(
            f'{where}, column "{name}": "{unit}" is not a unit of {quantity}; allowed: '
            + ", ".join(units)
        )
    load = int(found["load"] or 0)
    if load >= MOST_LOADS:
        raise ValueError(
            f'{where}, column "{name}": loads are numbered from 0 to {MOST_LOADS - 1}'
        )
    return (load, quantity), unit_size(unit, dimension)


def from_columns(
    columns: Mapping[str, Iterable[object]], where: str, kind: str = "column"
) -> Known:
    """Known inputs among some columns.

    Raises ValueError: naming file, column, value and what is allowed.
    """
    values: dict[Key, np.ndarray] = {}
    names: dict[Key, str] = {}
    fluid = None
    for name, column in columns.items():
        if name.strip().lower() == FLUID:
            fluid = np.array([str(x).strip() for x in column], object)
            continue
        meaning = understood(name, where)
        if meaning is None:
            continue
        key, unit = meaning
        if key in values:
            raise ValueError(f'{where}: {names[key]} and "{name}" say the same')
        values[key] = unit * np.array([_number(x, name, where) for x in column])
        names[key] = f'{kind} "{name}"'
    return Known(values, fluid, names)


def from_header(
    header: Mapping[str, str], rows: int, where: str, restated: Mapping[str, str]
) -> Known:
    """Known inputs that a header states for the whole log.

    `restated` has the lines of further headers in the file that say something else.
    Raises ValueError: these state other inputs, or a value is not allowed.
    """

    def told(texts: Mapping[str, str]) -> list[str]:
        return [k for k in texts if k.strip().lower() == FLUID or _COLUMN.fullmatch(k.strip())]

    for key in told(restated):
        raise ValueError(
            f'{where}, header: "{key}" is "{header[key]}" and further below '
            f'"{restated[key]}", as in logs that were joined; give each a file of its own'
        )
    relevant = {key: [header[key]] * rows for key in told(header)}
    return from_columns(relevant, f"{where}, header", "header line")


def from_file(path: Path, time: np.ndarray, clock: str) -> tuple[Known, np.ndarray]:
    """Known inputs of a second file at the times of a log.

    Numbers change linearly between rows, two of one time are a jump; the fluid holds until the
    next row.

    The file is a CSV with a time column and known inputs, as load paths of `suas simulate` are.
    Times are those of the log's frames [s], and the clock says which of the log's clocks that
    is, for messages.
    Returns the inputs, and which frames the file covers.
    Raises ValueError: naming file, line, column, value and what is allowed.
    """
    table = read_csv_table(path)
    if not table.rows:
        raise ValueError(f"{path}: no rows; expected t_s,load_0_force_N,... and rows below")
    clocks = [name for name in table.names if name in _TIMES]
    if len(clocks) != 1:
        raise ValueError(
            f"{path}, line {table.line}: one time column is needed ({', '.join(_TIMES)}); "
            f"found {', '.join(clocks) or ','.join(table.names)[:60]}"
        )
    rows = (fields for _, fields in table.rows)
    columns = dict(zip(table.names, zip(*rows, strict=True), strict=True))
    t = np.array([_number(x, clocks[0], str(path)) for x in columns.pop(clocks[0])])
    if not np.all(np.diff(t) >= 0):
        raise ValueError(f"{path}, column {clocks[0]}: time must not fall from row to row")
    known = from_columns(columns, str(path))
    if not known.values and known.fluid is None:
        raise ValueError(
            f"{path}: no known inputs among the columns {', '.join(columns) or 'none'}; "
            "expected load_0_force_N, load_0_displacement_mm, load_0_angle_deg, fluid, ..."
        )
    covered = (time >= t[0]) & (time <= t[-1])
    if not covered.any():
        raise ValueError(
            f"{path}, column {clocks[0]}: from {t[0]:g} to {t[-1]:g} s, the log's {clock} runs "
            f"from {np.nanmin(time):g} to {np.nanmax(time):g} s: they don't overlap; check "
            "units and time origins"
        )
    values = {key: np.interp(time, t, column) for key, column in known.values.items()}
    fluid = None
    if known.fluid is not None:
        fluid = known.fluid[np.clip(np.searchsorted(t, time, "right") - 1, 0, len(t) - 1)]
    names_of = {key: f"{path.name}, {name}" for key, name in known.names.items()}
    return Known(values, fluid, names_of), covered


def _number(value: object, column: str, where: str) -> float:
    text = str(value).strip()
    if text.lower() in ("", "nan", "na"):
        return float("nan")
    number = number_in(text)
    if np.isnan(number):
        raise ValueError(
            f'{where}, column "{column}": "{text}": expected a number, or nothing where it '
            "is not known"
        )
    return number


def permittivities(
    column: np.ndarray | None, option: str | None, rows: int, where: str
) -> np.ndarray:
    """Permittivity of the fluid of every frame; NaN where it is the oil to be fitted."""
    texts = np.full(rows, option or OIL, object) if column is None else column
    if column is not None and option is not None:
        raise ValueError(f"{where}: the log names its fluid itself; leave --fluid out")
    found = np.empty(rows)
    cache: dict[str, float] = {}
    for i, text in enumerate(texts):
        if text not in cache:
            cache[text] = _permittivity(str(text), where)
        found[i] = cache[text]
    if "" in cache and np.isfinite(found).any():
        raise ValueError(f"{where}: fluid is empty in some rows; name it in every row")
    return found


def _permittivity(text: str, where: str) -> float:
    name = text.strip().lower() or OIL
    if name == "air":
        return FLUIDS["air"]
    if name == OIL or name in FLUIDS:
        return np.nan
    try:
        value = float(name)
    except ValueError:
        value = 0.0
    if not value >= 1.0:
        raise ValueError(
            f'{where}, fluid "{text}": allowed: air, oil (its permittivity is fitted), '
            f"{', '.join(n for n in FLUIDS if n != 'air')} (likewise), or the fluid's known "
            "relative permittivity"
        )
    return value


def fluid_name(permittivity: float) -> str:
    """Name of the fluid of a permittivity; NaN is the oil."""
    if np.isnan(permittivity):
        return OIL
    return "air" if permittivity == FLUIDS["air"] else f"{permittivity:g}"


def check_known(spec: SkinSpec, known: Known, where: str) -> None:
    """Refuse values that the skin can't take: units mixed up, more often than not."""
    geometry = spec.geometry
    loads = sorted({load for load, _ in known.values})
    if loads != list(range(len(loads))):
        raise ValueError(f"{where}: loads are numbered from 0 without a hole; found {loads}")
    for load in loads:
        have = {q for k, q in known.values if k == load}
        pushed = have & {"force", "displacement", "inner_displacement", "depth"}
        if not pushed:
            raise ValueError(
                f"{where}: load {load} has no force, displacement or depth; add "
                f"load_{load}_force_N or load_{load}_displacement_mm, or, of a rigid body, "
                f"load_{load}_depth_mm"
            )
        if ("depth" in have) != ("radius" in have):
            missing = "radius" if "depth" in have else "depth"
            raise ValueError(
                f"{where}: load {load} has no {missing}; add load_{load}_{missing}_mm of the "
                f"cylinder or ball, as a column or as a header line"
            )
        _check_place(geometry, load, have, where)
    limits: dict[str, tuple[float, str]] = {
        "angle": clamped_edge(geometry, by_arc=False),
        "arc": clamped_edge(geometry, by_arc=True),
        "displacement": (
            1.2 * geometry.mean_gap,
            f"the oil gap, {format_quantity(geometry.mean_gap, 'length')}",
        ),
    }
    limits["inner_displacement"] = limits["depth"] = limits["displacement"]
    dimensions = {"angle": "angle"}
    for (load, quantity), values in known.values.items():
        if quantity not in limits:
            continue
        limit, text = limits[quantity]
        worst = float(np.nanmax(np.abs(values), initial=0.0))
        if worst >= limit:
            shown = format_quantity(worst, dimensions.get(quantity, "length"))  # type: ignore[arg-type]
            raise ValueError(
                f"{where}, {known.names[load, quantity]}: {shown} is beyond what the skin "
                f"allows ({text}): check the unit in the column's name"
            )


def _check_place(geometry: GeometrySpec, load: int, have: set[str], where: str) -> None:
    """Refuse a load without a place that the section knows."""
    placed = [name for name in ("angle", "arc") if name in have]
    if placed == ["angle"] and not geometry.has_angle:
        raise ValueError(
            f"{where}: load {load} has an angle, which means nothing on geometry.section = "
            f'"{geometry.section}"; add a column load_{load}_arc_mm instead'
        )
    if len(placed) != 1:
        own = f"load_{load}_angle_deg" if geometry.has_angle else f"load_{load}_arc_mm"
        raise ValueError(
            f"{where}: load {load} has an angle and an arc; leave one out"
            if placed
            else f"{where}: load {load} has no angle and no arc; add a column {own}, or a "
            f'header line "# {own}: 0"'
        )
