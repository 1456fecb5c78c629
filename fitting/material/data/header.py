"""Header of a table: keys with values, and specimens' sizes, in the rows above it.

Read are comments (`# width: 6 mm`), rows of a key, a value and perhaps its unit, several
such in a row, and small tables of results whose columns are sizes of the specimens.
"""

import dataclasses
import re
from collections.abc import Sequence

from fitting.material.data.cells import Cells
from fitting.material.data.column_names import plain_words
from fitting.material.data.columns import is_unit, size_of, split_specimen, understand
from fitting.material.data.layout import TableLayout, with_unit
from fitting.material.data.numbers import decimal_mark, looks_numeric, number

# Sizes within a line of text, and those of TA Instruments: length, width, thickness.
_STATED = re.compile(r"([^\W\d][\w ]*?)\s*[:=]\s*([\d.,]*\d)\s*([^\W\d]\w*)")
_THREE = re.compile(r"([\d.,]+)\s*(?:x\s*)?([\d.,]+)\s*(?:x\s*)?([\d.,]+)\s*(\w+)")
_META = re.compile(r"^\s*([^\W\d][\w /^-]*?)\s*[:=]\s*(.+?)\s*$")


@dataclasses.dataclass(frozen=True, eq=False)
class Header:
    """What a file says beside its table."""

    comments: tuple[str, ...]  # lines marked as comments
    metadata: dict[str, str]  # values by key, lower case with underscores
    # sizes in SI units as text, by column name with unit, by specimen
    by_specimen: dict[str, dict[str, str]]

    @staticmethod
    def merged(headers: Sequence["Header"]) -> "Header":
        """One header of several sheets; the first word counts."""
        metadata: dict[str, str] = {}
        sizes: dict[str, dict[str, str]] = {}
        for header in headers:
            metadata = {**header.metadata, **metadata}
            sizes = {**header.by_specimen, **sizes}
        comments = tuple(text for header in headers for text in header.comments)
        return Header(comments, metadata, sizes)

    def single(self, *, several: bool) -> dict[str, str]:
        """The metadata; of a single specimen with its sizes."""
        if several or len(self.by_specimen) != 1:
            return self.metadata
        (own,) = self.by_specimen.values()
        named = {}
        for key, text in own.items():
            name, unit = re.fullmatch(r"(\w+) \[(.*)\]", key).groups()  # type: ignore[union-attr]
            named[name] = f"{text} {unit}"
        return {**named, **self.metadata}

    def of_sheet(self) -> dict[str, str]:
        """Sizes of the single specimen of a sheet, as those of `by_specimen`."""
        found: dict[str, str] = (
            dict(*self.by_specimen.values()) if len(self.by_specimen) == 1 else {}
        )
        sizes = (_size(key, text, "", ".") for key, text in self.metadata.items())
        return {**dict(size for size in sizes if size is not None), **found}


def read_header(cells: Cells, layout: TableLayout | None) -> Header:
    """Read the rows of a sheet that are no table of readings."""
    rows = cells.rows if layout is None else [cells.rows[i] for i in layout.head]
    decimal = decimal_mark(cell for row in cells.rows[:2000] for cell in row)
    metadata: dict[str, str] = {}
    sizes: dict[str, dict[str, str]] = {}
    for text in cells.comments:
        found = _META.match(text)
        if found:
            metadata.setdefault(_key(found.group(1)), found.group(2).strip(" ;,\t\"'"))
    results = _results(rows, decimal)
    for row in rows:
        for key, value, unit in _pairs(row):
            name, label = split_specimen(key)
            size = _size(name, value, unit, decimal)
            if size is not None and label:
                sizes.setdefault(label, {}).setdefault(*size)
            elif size is not None:
                metadata.setdefault(size[0].split(" ")[0], f"{size[1]} {_unit(size[0])}")
            elif not size_of(name):
                metadata.setdefault(_key(key), f"{value} {unit}".strip())
    for label, own in results.items():
        for key, text in own.items():
            sizes.setdefault(label, {}).setdefault(key, text)
    return Header(cells.comments, metadata, sizes)


def _pairs(row: list[str]) -> list[tuple[str, str, str]]:
    """Keys, values and units of a row about the test."""
    filled = [cell for cell in row if cell]
    stated = [pair for cell in filled for pair in _STATED.findall(cell) if is_unit(pair[2])]
    if stated:
        return stated
    three = _THREE.fullmatch(" ".join(filled[1:]))
    if three is not None and filled[0].casefold() == "size":
        names = ("length", "width", "thickness")
        return [(name, three.group(k), three.group(4)) for k, name in enumerate(names, 1)]
    if len(filled) == 1:
        found = _META.match(filled[0])
        return [(found.group(1), found.group(2), "")] if found else []
    pairs: list[tuple[str, str, str]] = []
    i = 0
    while i + 1 < len(filled):
        key, value = filled[i].rstrip(" :="), filled[i + 1]
        unit = filled[i + 2] if i + 2 < len(filled) and is_unit(filled[i + 2]) else ""
        if len(filled) > 3 and not pairs and not looks_numeric(value):
            pairs.append((key, value, unit))
            i += 1
            continue
        pairs.append((key, value, unit.strip("()[] ")))
        i += 3 if unit else 2
    return pairs


def _size(name: str, value: str, unit: str, decimal: str) -> tuple[str, str] | None:
    """A specimen's size as column name with SI unit and number; None for anything else."""
    amount = number(value, decimal)
    if not amount > 0.0:
        found = re.fullmatch(r"([\d.,]+)\s*([^\d\s].*)", value)  # "6,02 mm" in one cell
        if found is None or not number(found.group(1), decimal) > 0.0:
            return None
        amount, unit = number(found.group(1), decimal), found.group(2).strip("()[] ")
    try:
        column = understand(with_unit(name, unit), "")
    except ValueError:
        return None
    size = size_of(name)
    if column is None or not size:
        return None
    si = {"area": "m2", "thickness_ratio": ""}.get(size, "m")
    return f"{size} [{si}]", repr(amount * column.factor)


def _results(rows: list[list[str]], decimal: str) -> dict[str, dict[str, str]]:
    """Sizes by specimen from tables whose columns are sizes."""
    found: dict[str, dict[str, str]] = {}
    for i, names in enumerate(rows):
        if sum(bool(cell) for cell in names) < 2 or any(map(looks_numeric, names)):
            continue
        sized = [k for k, name in enumerate(names) if name and size_of(name)]
        if not sized:
            continue
        below = rows[i + 1 :]
        units = [""] * len(names)
        if below and not any(looks_numeric(cell) for cell in below[0]):
            units = [cell.strip("()[] ") for cell in below[0]] + [""] * len(names)
            below = below[1:]
        for count, row in enumerate(below, 1):
            if not any(k < len(row) and looks_numeric(row[k]) for k in sized):
                break
            label = row[0] if row[0] and 0 not in sized else str(count)
            for k in sized:
                if k < len(row):
                    size = _size(names[k], row[k], units[k], decimal)
                    if size is not None:
                        number_of = split_specimen(label)[1] or label
                        found.setdefault(number_of, {}).setdefault(*size)
    return found


def _unit(name: str) -> str:
    return name.partition("[")[2].rstrip("]")


def _key(text: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", plain_words(text)).strip("_")
