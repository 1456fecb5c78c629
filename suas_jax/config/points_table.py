"""Points of a section from a table: columns x and y, their units in the names."""

import re
from pathlib import Path

from suas_jax.config.csv_table import read_csv_table
from suas_jax.config.quantities import parse_quantity

_NAME = re.compile(r"(?P<axis>[xyXY])(?:\s*\[|\s*\(|_|\s+)(?P<unit>[a-zµ]+)[\])]?$")


def read_points(file: Path) -> list[tuple[str, str]]:
    """Read points as quantities with units, as they would stand in a skin file.

    Args:
        file: comma-separated, with a line of names such as ``x_mm,y_mm`` or ``x [mm],y [mm]``.

    Raises:
        ValueError: a column or its unit is missing, or a field is no length.
        OSError: the file can't be read.
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
