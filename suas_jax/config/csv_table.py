"""Tables of comma-separated values: `# key: value` lines, a line of names, rows."""

import math
import re
from pathlib import Path
from typing import NamedTuple

from suas_jax.config.quantities import ZERO_CELSIUS, parse_quantity
from suas_jax.files.reading import MEGABYTE, read_bytes, split_fields

_MOST_BYTES = 64 * MEGABYTE
TEMPERATURE, DEPTH = "temperature_degC", "water_depth_m"


class CsvTable(NamedTuple):
    """A table as it stands in a file."""

    header: dict[str, str]  # `# key: value` lines above the names
    line: int  # number of the line of names, from one; zero in a file without names
    names: tuple[str, ...]  # of the columns
    # line number and fields of each row, as many fields as names
    rows: tuple[tuple[int, tuple[str, ...]], ...]


def read_csv_table(file: Path) -> CsvTable:
    """Read a table.

    Raises ValueError: a row has another number of fields than there are names, or one that is
    too long; says which line; OSError: the file can't be read.
    """
    text = read_bytes(file, _MOST_BYTES).decode("utf-8-sig")
    header: dict[str, str] = {}
    names: tuple[str, ...] = ()
    first = 0
    rows = []
    for number, line in enumerate(text.splitlines(), start=1):
        bare = line.strip()
        if bare.startswith("#"):
            key, _, value = bare[1:].partition(":")
            if not names:
                header[key.strip()] = value.strip()
        elif bare:
            try:
                fields = tuple(text.strip() for text in split_fields(line))
            except ValueError as error:
                raise ValueError(f"{file}, line {number}: {error}") from None
            if not names:
                names, first = fields, number
            elif len(fields) != len(names):
                raise ValueError(
                    f"{file}, line {number}: {len(fields)} fields for {len(names)} columns"
                )
            else:
                rows.append((number, fields))
    return CsvTable(header, first, names, tuple(rows))


def number_in(text: str) -> float:
    """The finite number that a field holds; NaN if there is none."""
    try:
        number = float(text)
    except ValueError:
        return math.nan
    return number if math.isfinite(number) else math.nan


_NAME = re.compile(r"(?P<axis>[xyXY])(?:\s*\[|\s*\(|_|\s+)(?P<unit>[a-zµ]+)[\])]?$")


def read_points(file: Path) -> list[tuple[str, str]]:
    """Points as quantities with units, as they would stand in a skin file.

    The line of names is such as ``x_mm,y_mm`` or ``x [mm],y [mm]``. Raises ValueError: a column
    or its unit is missing, or a field is not a length; OSError: the file can't be read.
    """
    table = read_csv_table(file)
    columns = {}
    for index, name in enumerate(table.names):
        found = _NAME.match(name)
        if found:
            columns[found["axis"].lower()] = index, found["unit"]
    if set(columns) != {"x", "y"}:
        raise ValueError(f"the columns are {', '.join(table.names) or 'none'}")
    points = []
    for line, fields in table.rows:
        texts = [f"{fields[index]} {unit}" for index, unit in (columns["x"], columns["y"])]
        for text in texts:
            try:
                parse_quantity(text, "length")
            except ValueError as error:
                raise ValueError(f"line {line}: {error}") from None
        points.append((texts[0], texts[1]))
    return points


class SurroundingColumn(NamedTuple):
    """A column that changes one number of [environment]."""

    key: str  # of [environment]
    zero: float  # of the column's scale [SI]
    low: float  # smallest value that a skin meets, in the column's unit
    high: float  # largest

    def beyond(self, *ends: float) -> float | None:
        """The value of some that is farthest beyond what a skin meets; None where none is."""
        worst = max(ends, key=lambda x: abs(x - (self.low + self.high) / 2))
        return None if self.low <= worst <= self.high else worst


SURROUNDINGS = {
    TEMPERATURE: SurroundingColumn("temperature", ZERO_CELSIUS, -40.0, 120.0),
    DEPTH: SurroundingColumn("depth", 0.0, 0.0, 11e3),
}
