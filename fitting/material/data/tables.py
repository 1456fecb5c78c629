"""Read the file of a test machine: one table of readings, whatever wrote it.

Understood: what `cells` reads; decimal points or commas; `# key: value` lines anywhere; units
in brackets or in a row; specimens side by side, one below the other, or one a sheet; their
sizes in rows above or in a table of results; gaps; repeated names and remarks between rows.
"""

import dataclasses
import os
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from fitting.material.data.cells import Cells, decimal_mark, is_missing, number, read_cells
from fitting.material.data.columns import (
    quantity_of,
    split_specimen,
    understand,
    understood,
    with_unit,
)
from fitting.material.data.errors import DataError
from fitting.material.data.header import Header, read_header
from fitting.material.data.layout import TableLayout, find_table, stacked
from suas_jax.config.errors import listed

_SAMPLED = 2000  # rows that tell the decimal mark
# "Stress 2 (MPa)", "Stress S2 (MPa)"
_NUMBERED = re.compile(
    r"(?P<what>.*?[^\W\d])(?P<letter>[ _][SsPp])?[ _]?(?P<number>\d{1,2})(?P<unit>\s*[\[(].*)?"
)
_ANSWERS = ("stress", "nominal", "cauchy", "force")  # of specimens that share a strain


@dataclasses.dataclass(frozen=True)
class Table:
    """A table of numbers as it stands in a file."""

    file: str  # the file, as the user named it
    names: tuple[str, ...]  # column names
    cells: np.ndarray  # numbers, NaN where missing, shape [rows, columns]
    texts: tuple[tuple[str, ...], ...]  # the cells as written, for columns of words
    lines: np.ndarray  # line number of each row in the file, from one
    # `key: value` pairs of the comments and of the rows above the table, keys in lower case
    # with underscores
    metadata: dict[str, str]
    # how the file was read, for people: format, decimal mark, lines
    reading: dict[str, Any] = dataclasses.field(default_factory=dict)
    remarks: tuple[str, ...] = ()  # what a person should know about how it was read


def read_table(
    path: str | os.PathLike[str],
    columns: Mapping[str, str] | None = None,
    *,
    plane: bool = False,  # numbers in names are directions in the plane, not specimens
) -> Table:
    """Read a delimited text file, or a workbook, of numbers.

    `columns`: what columns measure where their names don't say, as quantity to column ("3", or
    its name) and, where the file states none, a unit: {"force": "3 N"}.
    Raises DataError: the file is missing, empty, binary, has no line of column names or a line
    that doesn't fit them, with the line and what to do.
    """
    file = os.fspath(path)
    sheets = read_cells(file)
    found = []
    problem = DataError(f"{file}: the file is empty: it holds no table")
    for cells in (part for sheet in sheets for part in stacked(sheet)):
        try:
            found.append((cells, find_table(file, cells, named=bool(columns))))
        except DataError as error:
            problem = error
    if not found:
        raise problem
    most = max(min(layout.known, 2) for _, layout in found)
    found = [pair for pair in found if min(pair[1].known, 2) == most]
    longest = max(found, key=lambda pair: len(pair[1].body))
    signatures = [list(map(with_unit, layout.names, layout.units)) for _, layout in found]
    wanted = signatures[found.index(longest)]
    alike = [pair for pair, own in zip(found, signatures, strict=True) if own == wanted]
    # Sheets without a table of readings may state the specimens' sizes.
    taken = [id(cells) for cells, _ in found]
    headers = [read_header(cells, None) for cells in sheets if id(cells) not in taken]
    parts = [
        _part(file, cells, layout, columns or {}, cells.name * (len(alike) > 1), plane=plane)
        for cells, layout in alike
    ]
    return _joined(file, headers, parts)


@dataclasses.dataclass(frozen=True)
class _Part:
    """Readings of one specimen."""

    specimen: str  # its label; "" where the file holds one
    names: list[str]  # of the columns
    rows: list[list[str]]  # cells as written
    lines: list[int]  # line numbers
    header: Header  # what the rows about the test say
    reading: dict[str, Any]  # how it was read
    remarks: list[str]  # for people


def _part(
    file: str,
    cells: Cells,
    layout: TableLayout,
    columns: Mapping[str, str],
    sheet: str,
    *,
    plane: bool,
) -> list[_Part]:
    """The table of a sheet, split into the specimens that stand side by side."""
    lines = [cells.lines[i] for i in layout.body]
    names = layout.names or [f"column {i + 1}" for i in range(len(layout.units))]
    # Numbers in columns of which nothing is known have no names either.
    pairs = enumerate(zip(names, layout.units, strict=True), 1)
    names = [name or (f"column {i}" if unit else "") for i, (name, unit) in pairs]
    rows = [
        _row(file, cells.lines[i], cells.rows[i], cells.delimiter, names) for i in layout.body
    ]
    units = [
        "%" if "%" not in name and _in_percent(rows, i) else unit
        for i, (name, unit) in enumerate(zip(names, layout.units, strict=True))
    ]
    shown = renamed(file, names, units, columns)
    header = read_header(cells, layout)
    remarks = []
    if count := len(layout.skipped):
        where = ", ".join(str(cells.lines[i]) for i in layout.skipped[:4])
        where += ", ..." if count > 4 else ""
        what = f"{count} {'row' if count == 1 else 'rows'} without readings left out"
        remarks.append(f"{what} (line {where})")
    reading = {
        "format": cells.format,
        "names_line": layout.line if layout.names else None,
        "first_line": lines[0],
        "last_line": lines[-1],
    }
    groups = side_by_side(shown, layout.groups, fixed=bool(columns), plane=plane)
    repeated = [name for name in shown if name and shown.count(name) > 1]
    if repeated and len(groups) == 1:
        raise DataError(f'{file}: line {layout.line}: column "{repeated[0]}" stands twice')
    parts = []
    for label, positions in groups:
        own = [_unnumbered(shown[i]) if label else shown[i] for i in positions]
        taken = [[row[i] for i in positions] for row in rows]
        kept = [k for k, row in enumerate(taken) if len(groups) == 1 or any(row)]
        of_part = [taken[k] for k in kept], [lines[k] for k in kept]
        parts.append(_Part(label or sheet, own, *of_part, header, reading, remarks))
    return parts


def _in_percent(rows: list[list[str]], column: int) -> bool:
    """Whether all values of a column are written with a percent sign, as sheets show them."""
    filled = (row[column] for row in rows if not is_missing(row[column]))
    return next(filled, "").endswith("%") and all(cell.endswith("%") for cell in filled)


def _row(file: str, line: int, row: list[str], delimiter: str, names: list[str]) -> list[str]:
    cells, width = list(row), len(names)
    while len(cells) > width and not cells[-1]:
        cells.pop()
    if len(cells) > width:
        hint = ""
        if delimiter == "," and len(cells) == 2 * width:
            hint = (
                "; decimal commas look like commas between fields: put semicolons "
                "between fields, or use decimal points"
            )
        raise DataError(
            f"{file}: line {line}: {len(cells)} fields, but {width} columns are named{hint}"
        )
    return cells + [""] * (width - len(cells))


def _sizes(
    file: str, header: Header, others: list[Header], parts: list[_Part], *, sheets: int
) -> list[dict[str, str]]:
    """Sizes of each specimen: those under its label, in its order, or on its sheet."""
    labels = list(header.by_specimen)
    found: list[dict[str, str]] = []
    for k, part in enumerate(parts):
        own = header.by_specimen.get(part.specimen, {})
        if not own and len(labels) == len(parts):
            own = header.by_specimen[labels[k]]  # the same order, other labels
        if sheets > 1:
            own = {**parts[0].header.of_sheet(), **part.header.of_sheet(), **own}
        found.append(dict(own))
    # Rows of values above the first table are of all specimens, unless each has its own.
    above = [] if sheets > 1 and any(parts[-1].header.in_rows) else [parts[0].header]
    for name, values in (pair for one in [*others, *above] for pair in one.in_rows.items()):
        if len(values) != len(parts):
            size = name.partition(" ")[0]
            raise DataError(
                f"{file}: {len(values)} values of {size} stand in a row, for {len(parts)} "
                f"specimens: state one for each, in their order"
            )
        for own, value in zip(found, values, strict=True):
            own[name] = value
    return found


def _joined(file: str, others: list[Header], groups: list[list[_Part]]) -> Table:
    """One table of all specimens, with their labels and own sizes as columns."""
    parts = [part for group in groups for part in group]
    names = parts[0].names
    header = Header.merged([*others, *dict.fromkeys(part.header for part in parts)])
    several = len(parts) > 1
    sizes = _sizes(file, header, others, parts, sheets=len(groups)) if several else [{}]
    sized = list(dict.fromkeys(key for own in sizes for key in own))
    rows: list[tuple[str, ...]] = []
    for k, (part, own) in enumerate(zip(parts, sizes, strict=True), 1):
        extra = [part.specimen or str(k), *(own.get(key, "") for key in sized)]
        rows += [(*row, *(extra if several else ())) for row in part.rows]
    sampled = rows[:: max(1, len(rows) // _SAMPLED)]
    decimal = decimal_mark(cell for row in sampled for cell in row[: len(names)])
    cells = np.array([[number(text, decimal) for text in row] for row in rows], dtype=float)
    for j in range(len(names) + 1, len(names) + 1 + len(sized)):
        cells[:, j] = [float(row[j]) if row[j] else np.nan for row in rows]
    reading = {
        **parts[0].reading,
        "decimal_mark": decimal,
        "specimens": len(parts),
        "last_line": max(part.reading["last_line"] for part in parts),
    }
    return Table(
        file,
        (*names, *(("specimen", *sized) if several else ())),
        cells,
        tuple(rows),
        np.array([line for part in parts for line in part.lines]),
        header.single(several=several),
        reading,
        tuple(dict.fromkeys(text for part in parts for text in part.remarks)),
    )


def renamed(
    file: str, names: list[str], units: list[str], columns: Mapping[str, str]
) -> list[str]:
    """Names of columns with their units, or with the user's word for what they measure.

    The user names a quantity, then a column by its number or its name, and a unit where the
    file states none: `--columns "force=3,extension=5 mm"`. Any other column of the same
    meaning is not used.
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
                f"--columns {quantity}={text}: {quantity} is not a known quantity"
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

    A column belongs to a specimen by the label in its name ("Specimen 2 Force"), by a number at
    the end of its name where all numbered sets are alike ("Stress 2 (MPa)"), or by its place in
    a sequence of names that is repeated; columns before or without these are common to all.

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
    """Numbers at the ends of names, such as 2 in "Stress 2 (MPa)", where all sets are alike.

    A set of one column is a stress or a force beside strains of all: of two such, "Stress 1"
    may be a direction, "Stress S1" is a specimen.
    """
    found = [_NUMBERED.fullmatch(name) for name in names]
    sets: dict[str, list[str]] = {}
    for match in found:
        if match is not None:
            sets.setdefault(match["number"], []).append(match["what"] + (match["unit"] or ""))
    alike = len(sets) > 1 and len({tuple(own) for own in sets.values()}) == 1
    if not alike:
        return [""] * len(names)
    own, *others = next(iter(sets.values()))
    lettered = any(match is not None and match["letter"] for match in found)
    if not others and not (
        (lettered or len(sets) > 2)
        and quantity_of(own) in _ANSWERS
        and any(name for name, match in zip(names, found, strict=True) if match is None)
    ):
        return [""] * len(names)
    return [match["number"] if match is not None else "" for match in found]


def _unnumbered(name: str) -> str:
    """A specimen's column without what says which specimen it is of."""
    name = split_specimen(name)[0]
    match = _NUMBERED.fullmatch(name)
    return name if match is None else match["what"] + (match["unit"] or "")
