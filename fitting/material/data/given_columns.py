"""Columns whose meaning the user gives, where their names don't say what they measure.

The user names a quantity, then a column by its number or its name, and a unit where the file
states none: `--columns "force=3,extension=5 mm"`. That column is then called as the quantity
is, and any other column of the same meaning is not used.
"""

from collections.abc import Mapping

from fitting.material.data.columns import understand
from fitting.material.data.errors import DataError
from suas_jax.config.errors import listed


def renamed(
    file: str,
    names: list[str],
    units: list[str],
    shown: list[str],
    columns: Mapping[str, str],
) -> list[str]:
    """Column names with the user's word for what they measure.

    Args:
        file: for messages.
        names: of the columns, as they stand in the file.
        units: of the columns, from a row of units; "" where there is none.
        shown: names with their units.
        columns: see `read_table`.

    Raises:
        DataError: there is no such column or quantity, or its unit is missing or unknown.
    """
    if not columns:
        return shown
    found = list(shown)
    meant = {}
    for quantity, text in columns.items():
        index, given = _position(file, quantity, text, names, shown)
        unit = given or units[index]
        if not unit and (known := _understood(shown[index])) is not None:
            unit = known
        spelled = f"{quantity} [{unit}]" if unit else quantity
        try:
            column = understand(spelled, f"--columns {quantity}={text}")
        except ValueError as error:
            raise DataError(
                f"{error}; the file states none: give it after the column, for example "
                f'--columns "{quantity}={index + 1} mm"'
                if not unit
                else str(error)
            ) from None
        if column is None:
            raise DataError(
                f"--columns {quantity}={text}: {quantity} is no known quantity"
                f"{f' in {unit}' if unit else ''}; such as force, extension, strain, stretch, "
                f"stress, pressure, time"
            )
        found[index] = spelled
        meant[index] = (column.quantity, column.direction)
    # Other columns of the same meaning give way.
    for i, name in enumerate(found):
        if i in meant:
            continue
        try:
            column = understand(name, "")
        except ValueError:
            continue
        if column is not None and (column.quantity, column.direction) in meant.values():
            found[i] = f"(not used) {name}"
    return found


def _position(
    file: str, quantity: str, text: str, names: list[str], shown: list[str]
) -> tuple[int, str]:
    """Column that the user names by number or name, and the unit after it."""
    for spellings in (shown, names):
        if text in spellings:
            return spellings.index(text), ""
    first, _, unit = text.partition(" ")
    if first.isdigit() and 1 <= int(first) <= len(names):
        return int(first) - 1, unit.strip("()[] ")
    for i, name in enumerate(names):
        if name and text.startswith(f"{name} "):
            return i, text[len(name) :].strip("()[] ")
    have = listed(f'{i}: "{name}"' for i, name in enumerate(names, 1) if name)
    raise DataError(
        f"--columns {quantity}={text}: {file} has no such column; it has {have or 'no names'}"
        + (f" and {len(names)} columns" if not any(names) else "")
    )


def _understood(name: str) -> str | None:
    """Unit of a column that is understood by its name."""
    try:
        column = understand(name, "")
    except ValueError:
        return None
    return column.unit if column is not None else None
