"""Names, units and rows of numbers of the table of readings among a file's cells.

Machines write reports: rows about the test, tables of results, and one table of readings: the
longest run of rows with numbers under a row of names of which some are known quantities.
"""

import dataclasses
import itertools
import re

from fitting.material.data.cells import Cells, is_missing, looks_numeric
from fitting.material.data.column_names import plain_words
from fitting.material.data.columns import (
    SIZES,
    is_unit,
    quantity_of,
    size_of,
    split_specimen,
    understand,
    with_unit,
)
from fitting.material.data.errors import DataError

_HEAD_ROWS = 4  # of names and units above a table
_BRACKETS = "()[]{}<> "
# First words of rows about the rows of a table, which may stand below it.
STATISTICS = re.compile(
    r"(?:mean|average|median|min|max|minimum|maximum|range|std|stdev|sd|standard_dev\w*|variance|"
    r"coefficient|mittelwert|standardabweichung|moyenne|ecart|media|desviacion|deviazione|"
    r"平均|標準偏差|标准差|最大|最小)(?![a-z])"
)
_SPECIMEN_ROW = re.compile(r"specimen|sample|probe|eprouvette|test_?(?:no|number|run)")


@dataclasses.dataclass(frozen=True)
class TableLayout:
    """The parts of a sheet."""

    names: list[str]  # column names as they stand there; empty where there is no row of names
    units: list[str]  # unit of each column, from the row of units; "" where there is none
    # specimen of each column, from a row above the names; "" where there is none
    groups: list[str]
    body: list[int]  # positions of the rows of numbers
    skipped: list[int]  # positions of rows among them that hold no numbers
    head: list[int]  # positions of the rows above the table that are not names or units
    line: int  # line number of the row of names, or of the first row of numbers

    @property
    def known(self) -> int:
        """How many columns are known quantities that a test reads; sizes are none."""
        return _read(self.names, self.units)


def find_table(file: str, cells: Cells, *, named: bool) -> TableLayout:
    """Find the table of readings; its columns need no known names where the user names them.

    Raises DataError: there is no table.
    """
    rows = cells.rows
    if not rows:
        raise DataError(f"{file}: the file is empty: it holds no table")
    kinds = [_kind(row) for row in rows]
    runs = _runs(kinds)
    tables = [_above(cells, kinds, first, last) for first, last in runs]
    whole = [table for table in tables if table.names or named]
    if not whole:
        if tables:
            longest = max(tables, key=lambda table: len(table.body))
            raise DataError(
                f"{file}: line {longest.line}: numbers without a line of column names above "
                f"them; name the columns and their units, for example "
                f'"stretch_1,nominal_stress_MPa", or give --columns "force=1 N,extension=2 mm"'
            )
        head = [i for i, row in enumerate(rows) if sum(map(_is_word, row)) > 1]
        if head:
            raise DataError(f"{file}: there is no row below the column names")
        raise DataError(
            f"{file}: line {cells.lines[0]}: no line of column names followed by numbers was "
            f'found; expected columns such as "stretch_1,nominal_stress_MPa" '
            f"(found {' '.join(rows[0])[:60]!r})"
        )
    best = max(whole, key=lambda table: (min(table.known, 2), len(table.body)))
    return _continued(cells, kinds, best)


def stacked(cells: Cells) -> list[Cells]:
    """Tables of several specimens that stand below each other, each with rows about it.

    A row of names that returns begins another table if the rows above it state a size or a
    specimen; otherwise the first table goes on.
    """
    rows = cells.rows
    heads = (row for row in rows if not looks_numeric(row[0]) and _are_names(row))
    names = next((row for row in heads if _read(row, []) > 1), None)
    places = [k for k, row in enumerate(rows) if row == names]
    starts = [0]
    for last, place in itertools.pairwise(places):
        first = place
        while first > last + 1:
            above = rows[first - 1]
            if len(above) > 1 and all(is_missing(x) or looks_numeric(x) for x in above):
                break
            first -= 1
        keys = [row[0] for row in rows[first:place]]
        if any(size_of(key) or _SPECIMEN_ROW.match(plain_words(key)) for key in keys):
            starts.append(first)
    if len(starts) == 1:
        return [cells]
    return [
        dataclasses.replace(
            cells,
            name=str(k),
            rows=rows[a:b],
            lines=cells.lines[a:b],
            comments=cells.comments if k == 1 else (),
        )
        for k, (a, b) in enumerate(itertools.pairwise([*starts, len(rows)]), 1)
    ]


def _kind(row: list[str]) -> str:
    """Whether a row holds numbers ("n"), gaps ("e") or words ("w")."""
    filled = [cell for cell in row if not is_missing(cell)]
    if not filled:
        return "e"
    numbers = [looks_numeric(cell) for cell in filled]
    if not numbers[0] and STATISTICS.match(plain_words(filled[0])):
        return "w"
    return "n" if any(numbers) and 3 * sum(numbers) >= len(filled) else "w"


def _runs(kinds: list[str]) -> list[tuple[int, int]]:
    """First row and end of every run of numbers; rows of gaps may be among them."""
    found, first = [], 0
    for words, group in itertools.groupby(kinds, "w".__eq__):
        run = list(group)
        if not words and "n" in run:
            found.append((first, first + len(run)))
        first += len(run)
    return found


def _above(cells: Cells, kinds: list[str], first: int, last: int) -> TableLayout:
    """The table of a run of numbers, with the names and units above it."""
    rows = cells.rows
    above = range(first - 1, max(first - 1 - _HEAD_ROWS, -1), -1)
    words = list(itertools.takewhile(lambda i: kinds[i] == "w", above))
    units_row = next((i for i in words[:2] if _is_units(rows[i])), None)
    units = rows[units_row] if units_row is not None else []
    candidates = [i for i in words if i != units_row and _are_names(rows[i])]
    # One name is not a table, unless a single column is the whole file.
    best = max(candidates, key=lambda i: (_known(rows[i], units), i), default=None)
    body = [i for i in range(first, last) if kinds[i] == "n" or i > first]
    shown = [cell.strip(_BRACKETS) for cell in units]
    if best is None:
        blank = [""] * max(len(rows[i]) for i in body)
        units = _filled(shown, len(blank))
        return TableLayout([], units, blank, body, [], list(range(first)), cells.lines[first])
    names = list(rows[best])
    while names and not names[-1]:
        names.pop()
    groups, taken = [""] * len(names), {best, units_row}
    if best > 0 and kinds[best - 1] == "w" and _labels(rows[best - 1], names):
        # Labels of merged cells stand over the first of their columns.
        labels = _filled(rows[best - 1], len(names))
        for k, label in enumerate(labels):
            groups[k] = label or groups[k - 1]
        taken.add(best - 1)
    head = [i for i in range(first) if i not in taken]
    units = _filled(shown, len(names))
    return TableLayout(names, units, groups, body, [], head, cells.lines[best])


def _continued(cells: Cells, kinds: list[str], table: TableLayout) -> TableLayout:
    """The table with what follows after rows of words, such as repeated names."""
    rows = cells.rows
    pattern = _numbers_in(rows[table.body[len(table.body) // 2]])
    body, skipped = list(table.body), []
    waiting: list[int] = []
    for i in range(body[-1] + 1, len(rows)):
        if kinds[i] == "n" and _numbers_in(rows[i]) == pattern:
            skipped += waiting
            waiting = []
            body.append(i)
        else:
            waiting.append(i)
    while body and kinds[body[-1]] == "e":
        body.pop()
    return dataclasses.replace(table, body=body, skipped=skipped + waiting)


def _numbers_in(row: list[str]) -> frozenset[int]:
    return frozenset(i for i, cell in enumerate(row) if looks_numeric(cell))


def _is_units(row: list[str]) -> bool:
    """Whether a row holds units, perhaps after the word "units"."""
    filled = [cell for cell in row if cell]
    if filled and re.fullmatch(r"(?i)\W*(units?|einheit(en)?|unit[eé]s?)\W*", filled[0]):
        filled = filled[1:]
    if not filled or len(filled) * 2 < len(row):
        return False
    known = sum(is_unit(cell) for cell in filled)
    bracketed = sum(bool(re.fullmatch(r"[(\[{<].*[)\]}>]", cell)) for cell in filled)
    return known == len(filled) or bracketed == len(filled) or known * 3 >= len(filled) * 2


def _is_word(cell: str) -> bool:
    return bool(re.search(r"[^\W\d]", cell)) and not looks_numeric(cell)


def _are_names(row: list[str]) -> bool:
    words = [_is_word(cell) for cell in row]
    return sum(words) > 1 and all(w or not c for w, c in zip(words, row, strict=True))


def _known(names: list[str], units: list[str]) -> int:
    return sum(
        _is_known(name, unit.strip(_BRACKETS))
        for name, unit in zip(names, _filled(units, len(names)), strict=True)
    )


def _read(names: list[str], units: list[str]) -> int:
    """How many columns are known quantities that a test reads; sizes are none."""
    pairs = zip(names, _filled(units, len(names)), strict=True)
    return sum(_is_known(name, unit) and quantity_of(name) not in SIZES for name, unit in pairs)


def _is_known(name: str, unit: str) -> bool:
    for spelled in (with_unit(name, unit), with_unit(split_specimen(name)[0], unit)):
        try:
            if understand(spelled, "") is not None:
                return True
        except ValueError:
            return True
    return False


def _labels(row: list[str], names: list[str]) -> bool:
    """Whether a row over the names labels specimens side by side."""
    repeated = len({name for name in names if name}) < sum(bool(name) for name in names)
    filled = [cell for cell in row if cell]
    several = len(filled) > 1 and len(row) <= len(names) + 1
    return repeated and several and not size_of(filled[0])


def _filled(cells: list[str], width: int) -> list[str]:
    return (list(cells) + [""] * width)[:width]
