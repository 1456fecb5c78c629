"""Columns that the user names, and columns of specimens that stand side by side.

The user names a quantity, then a column by its number or its name, and a unit where the file
states none: `--columns "force=3,extension=5 mm"`. That column is then called as the quantity
is, and any other column of the same meaning is not used.

A column belongs to a specimen by the label in its name ("Specimen 2 Force"), by a number at the
end of its name where all numbered sets are alike ("Stress 2 (MPa)"), or by its place in a
sequence of names that is repeated; columns before or without these are common to all specimens.
"""

import re
from collections.abc import Mapping

from fitting.material.data.columns import split_specimen, understand, understood, with_unit
from fitting.material.data.errors import DataError
from suas_jax.config.errors import listed


def renamed(
    file: str, names: list[str], units: list[str], columns: Mapping[str, str]
) -> list[str]:
    """Names of columns with their units, or with the user's word for what they measure.

    Raises DataError: there is no such column or quantity, or its unit is missing or unknown.
    """
    shown = list(map(with_unit, names, units))
    found, meant = list(shown), {}
    for quantity, text in columns.items():
        index, given = _position(file, quantity, text, names, shown)
        known = understood(shown[index])
        unit = given or units[index] or (known.unit if known is not None else "")
        try:
            column = understand(with_unit(quantity, unit), f"--columns {quantity}={text}")
        except ValueError as error:
            raise DataError(str(error)) from None
        if column is None:
            raise DataError(
                f"--columns {quantity}={text}: {quantity} is no known quantity"
                f"{f' in {unit}' if unit else ''}; such as force, extension, strain, stretch, "
                f"stress, pressure, time"
            )
        found[index] = with_unit(quantity, unit)
        meant[index] = column[:2]
    # Other columns of the same meaning give way.
    for i, name in enumerate(found):
        column = None if i in meant else understood(name)
        if column is not None and column[:2] in meant.values():
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


def side_by_side(
    names: list[str], groups: list[str], *, fixed: bool, plane: bool
) -> list[tuple[str, list[int]]]:
    """Columns of each specimen, by its label; one group where there is only one.

    `names`: of the columns, with their units. `groups`: specimen of each column, from a row
    above the names; "" where there is none. `fixed`: the user says what columns measure, of a
    single specimen. `plane`: numbers in names are directions in the plane, not specimens.
    """
    everything = [i for i, name in enumerate(names) if name]
    whole = [("", list(range(len(names))))]
    if fixed or len(everything) < 2:
        return whole
    labels = [split_specimen(name)[1] for name in names]
    if not any(labels) and not plane:
        labels = _numbered(names)
    if len({label for label in labels if label}) > 1:
        shared = [i for i in everything if not labels[i]]
        order = dict.fromkeys(label for label in labels if label)
        return [
            (label, shared + [i for i in everything if labels[i] == label]) for label in order
        ]
    # Repeated sequences: a name that returns begins the next specimen. What stands before
    # the first such name is common to all.
    first = next((names[i] for i in everything if names.count(names[i]) > 1), None)
    starts = [k for k, i in enumerate(everything) if names[i] == first]
    if len(starts) < 2:
        return whole
    shared = everything[: starts[0]]
    blocks = [
        everything[a:b] for a, b in zip(starts, [*starts[1:], len(everything)], strict=True)
    ]
    alike = len({tuple(names[i] for i in block) for block in blocks}) == 1
    if not alike or len(shared) + len(blocks[0]) < 2:
        return whole
    stated = [groups[block[0]] for block in blocks]
    if len(set(stated)) < len(stated):
        stated = [str(k + 1) for k in range(len(blocks))]
    return [(label, shared + block) for label, block in zip(stated, blocks, strict=True)]


def _numbered(names: list[str]) -> list[str]:
    """Numbers at the ends of names, such as 2 in "Stress 2 (MPa)", where all sets are alike."""
    found = [re.fullmatch(r"(.*?[^\W\d])[ _]?(\d{1,2})(\s*[\[(].*)?", name) for name in names]
    sets: dict[str, list[str]] = {}
    for match in found:
        if match is not None:
            sets.setdefault(match.group(2), []).append(match.group(1) + (match.group(3) or ""))
    alike = len(sets) > 1 and len({tuple(own) for own in sets.values()}) == 1
    if not alike or len(next(iter(sets.values()))) < 2:
        return [""] * len(names)
    return [match.group(2) if match is not None else "" for match in found]
