"""A history: loads and temperature over time.

A file is a table::

    t_s,force_N
    0,0
    0.1,20
    60.1,20
    60.2,0

`force_N` is the sum of the loads' magnitudes, as for a curve, `factor` multiplies all loads as
the scene has them, `depth_m` is the travel of the body that is pressed in most and
`temperature_degC` that of the whole skin; one of them at least is needed. What no column names
stays as the scene has it. Between rows everything changes linearly; two rows of one time are a
jump. The skin has been at rest before the first row.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from suas_jax.config.csv_table import number_in, read_csv_table
from suas_jax.config.errors import show_key, unknown
from suas_jax.config.surrounding_columns import TEMPERATURE

MOST_ROWS = 100_000
_COLUMNS = ("force_N", "factor", "depth_m", TEMPERATURE)
_CHOICE = f"at least one of force_N (or factor), depth_m and {TEMPERATURE}"


class History(NamedTuple):
    """Loads over time."""

    time: Float[np.ndarray, " row"]  # of the rows [s], never falling
    columns: dict[str, Float[np.ndarray, " row"]]  # values by name, one for each row


def read_history(file: Path) -> History:
    """Read a history.

    Raises ValueError: a column is missing or unknown, a field is not a number, or time falls;
    OSError: the file can't be read.
    """
    table = read_csv_table(file)
    for name in table.names:
        if name not in ("t_s", *_COLUMNS):
            reason = unknown(name, ("t_s", *_COLUMNS), "column, or its unit is another")
            raise ValueError(f"{file}: {show_key(name)}: {reason}")
    found = [name for name in table.names if name != "t_s"]
    if "t_s" not in table.names or not _allowed(found) or not table.rows:
        given = ", ".join(table.names) or "none"
        raise ValueError(
            f"{file}: the columns are {given}; t_s and {_CHOICE} are needed, "
            "once each, and a row"
        )
    if len(table.rows) > MOST_ROWS:
        raise ValueError(f"{file}: {len(table.rows)} rows; at most {MOST_ROWS} are followed")
    rows = np.array([[number_in(text) for text in fields] for _, fields in table.rows])
    for (line, fields), row in zip(table.rows, rows, strict=True):
        if not np.all(np.isfinite(row)):
            raise ValueError(
                f"{file}, line {line}: {','.join(fields)[:80]}: numbers are needed"
            )
    columns = dict(zip(table.names, rows.T, strict=True))
    time = columns.pop("t_s")
    falls = np.flatnonzero(np.diff(time) < 0)
    if len(falls):
        line = table.rows[falls[0] + 1][0]
        raise ValueError(f"{file}, line {line}: t_s is less than in the row before")
    return History(time, columns)


def _allowed(names: Sequence[str]) -> bool:
    """Whether columns go together."""
    known = bool(names) and len(set(names)) == len(names) and set(names) <= set(_COLUMNS)
    return known and not {"factor", "force_N"} <= set(names)


def history_of(time: Sequence[float], **values: Sequence[float]) -> History:
    """A history from Python: times [s] and any columns that a file may have.

    Raises:
        ValueError: another name, none, or different lengths.
    """
    columns = {name: np.asarray(x, float) for name, x in values.items()}
    if not _allowed(list(columns)) or any(len(x) != len(time) for x in columns.values()):
        raise ValueError(f"a value a time is needed for {_CHOICE}")
    return History(np.asarray(time, float), columns)
