"""Read the file of a test machine: one table of readings, whatever wrote it.

Understood: what `cells` reads; decimal points or commas; `# key: value` lines anywhere; rows
about the test above the table; units in brackets or in a row of their own; specimens side
by side, one below the other, or one a sheet; sizes of the specimens in the rows above or in a
table of results; empty and "NaN" cells; repeated names and remarks between the rows.
"""

import dataclasses
import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from fitting.material.data.cells import Cells, read_cells
from fitting.material.data.column_choice import renamed, side_by_side
from fitting.material.data.columns import split_specimen
from fitting.material.data.errors import DataError
from fitting.material.data.header import Header, read_header
from fitting.material.data.layout import TableLayout, find_table, stacked, with_unit
from fitting.material.data.numbers import decimal_mark, number

_SAMPLED = 2000  # rows that tell the decimal mark


@dataclasses.dataclass(frozen=True)
class Table:
    """A table of numbers as it stands in a file."""

    file: str  # the file, as the user named it
    names: tuple[str, ...]  # column names
    cells: np.ndarray  # numbers, NaN where missing, shape [rows, columns]
    texts: tuple[tuple[str, ...], ...]  # the cells as written, for columns of words
    lines: np.ndarray  # line number of each row in the file, from one
    comments: tuple[str, ...]  # the comment lines, without their mark
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
    plane: bool = False,
) -> Table:
    """Read a delimited text file, or a workbook, of numbers.

    `columns`: what columns measure where their names don't say, as quantity to column ("3", or
    its name) and, where the file states none, a unit: {"force": "3 N"}. `plane`: numbers in
    names are directions in the plane, not specimens.
    Raises DataError: the file is missing, empty, binary, has no line of column names or a line
    that doesn't fit them, with the line and what to do.
    """
    file = os.fspath(path)
    sheets = read_cells(file)
    if not sheets:
        raise DataError(f"{file}: the file is empty: it holds no table")
    found = []
    problem: DataError | None = None
    for sheet in sheets:
        for cells in stacked(sheet):
            try:
                found.append((cells, find_table(file, cells, named=bool(columns))))
            except DataError as error:
                problem = error
    if not found:
        assert problem is not None
        raise problem
    most = max(min(layout.known, 2) for _, layout in found)
    found = [pair for pair in found if min(pair[1].known, 2) == most]
    longest = max(found, key=lambda pair: len(pair[1].body))
    alike = [pair for pair in found if _signature(pair[1]) == _signature(longest[1])]
    headers = [(cells, read_header(cells, layout)) for cells, layout in _others(sheets, found)]
    parts = [
        _part(file, cells, layout, columns or {}, cells.name * (len(alike) > 1), plane=plane)
        for cells, layout in alike
    ]
    return _joined(file, [header for _, header in headers], parts)


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


def _signature(layout: TableLayout) -> tuple[str, ...]:
    return tuple(map(with_unit, layout.names, layout.units))


def _others(
    sheets: list[Cells], found: list[tuple[Cells, TableLayout]]
) -> list[tuple[Cells, TableLayout | None]]:
    """Sheets without a table of readings; they may state the specimens' sizes."""
    taken = [id(cells) for cells, _ in found]
    return [(cells, None) for cells in sheets if id(cells) not in taken]


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
    body = [cells.rows[i] for i in layout.body]
    lines = [cells.lines[i] for i in layout.body]
    names = layout.names or [f"column {i + 1}" for i in range(len(layout.units))]
    # Numbers in columns of which nothing is known have no names either.
    units = layout.units
    names = [
        name or (f"column {i + 1}" if unit else "")
        for i, (name, unit) in enumerate(zip(names, units, strict=True))
    ]
    rows = [
        _row(file, line, row, cells.delimiter, names)
        for line, row in zip(lines, body, strict=True)
    ]
    shown = [with_unit(name, unit) for name, unit in zip(names, layout.units, strict=True)]
    shown = renamed(file, names, layout.units, shown, columns)
    header = read_header(cells, layout)
    remarks = []
    if layout.skipped:
        skipped = [cells.lines[i] for i in layout.skipped]
        where = ", ".join(map(str, skipped[:4])) + (", ..." if len(skipped) > 4 else "")
        remarks.append(
            f"{len(skipped)} {'row' if len(skipped) == 1 else 'rows'} without readings left "
            f"out (line {where})"
        )
    reading = {
        "format": cells.format,
        "names_line": layout.line if layout.names else None,
        "first_line": lines[0],
        "last_line": lines[-1],
    }
    groups = side_by_side(shown, layout.groups, fixed=bool(columns), plane=plane)
    parts = []
    for label, positions in groups:
        own = [split_specimen(shown[i])[0] if label else shown[i] for i in positions]
        taken = [[row[i] for i in positions] for row in rows]
        kept = [k for k, row in enumerate(taken) if len(groups) == 1 or any(map(bool, row))]
        parts.append(
            _Part(
                label or sheet,
                own,
                [taken[k] for k in kept],
                [lines[k] for k in kept],
                header,
                reading,
                remarks,
            )
        )
    if len(groups) == 1:
        repeated = [n for n in shown if n and shown.count(n) > 1]
        if repeated:
            raise DataError(f'{file}: line {layout.line}: column "{repeated[0]}" stands twice')
    return parts


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


def _sizes(header: Header, parts: list[_Part], *, sheets: int) -> list[Mapping[str, str]]:
    """Sizes of each specimen: those under its label, in its order, or on its sheet."""
    labels = list(header.by_specimen)
    found: list[Mapping[str, str]] = []
    for k, part in enumerate(parts):
        own: Mapping[str, str] = header.by_specimen.get(part.specimen, {})
        if not own and len(labels) == len(parts):
            own = header.by_specimen[labels[k]]  # the same order, other labels
        found.append(
            {**parts[0].header.of_sheet(), **part.header.of_sheet(), **own}
            if sheets > 1
            else own
        )
    return found


def _joined(file: str, others: list[Header], groups: list[list[_Part]]) -> Table:
    """One table of all specimens, with their labels and own sizes as columns."""
    parts = [part for group in groups for part in group]
    names = parts[0].names
    header = Header.merged([*others, *dict.fromkeys(part.header for part in parts)])
    several = len(parts) > 1
    sizes = _sizes(header, parts, sheets=len(groups)) if several else [{}]
    sized = list(dict.fromkeys(key for own in sizes for key in own))
    rows: list[tuple[str, ...]] = []
    lines: list[int] = []
    for k, part in enumerate(parts):
        own = sizes[k]
        extra = [part.specimen or str(k + 1), *(own.get(key, "") for key in sized)]
        rows += [(*row, *(extra if several else ())) for row in part.rows]
        lines += part.lines
    sampled = rows[:: max(1, len(rows) // _SAMPLED)]
    decimal = decimal_mark(cell for row in sampled for cell in row[: len(names)])
    cells = np.array([[number(text, decimal) for text in row] for row in rows], dtype=float)
    shown = (*names, *(("specimen", *sized) if several else ()))
    if several:
        for j, key in enumerate(sized, len(names) + 1):
            cells[:, j] = [float(row[j]) if row[j] else np.nan for row in rows]
            assert key
    remarks = list(dict.fromkeys(text for part in parts for text in part.remarks))
    reading = {
        **parts[0].reading,
        "decimal_mark": decimal,
        "specimens": len(parts),
        "last_line": max(part.reading["last_line"] for part in parts),
    }
    return Table(
        file,
        tuple(shown),
        cells,
        tuple(rows),
        np.array(lines),
        header.comments,
        header.single(several=several),
        reading,
        tuple(remarks),
    )
