"""Header of a table: keys with values, and specimens' sizes, in the rows above it.

Read are comments (`# width: 6 mm`), rows of a key, a value and perhaps its unit, several
such in a row, and small tables of results whose columns are sizes of the specimens.
"""

import contextlib
import dataclasses
import re
import statistics
from collections.abc import Mapping, Sequence

from fitting.column_units import unit_size
from fitting.material.data.cells import Cells, decimal_mark, looks_numeric, number
from fitting.material.data.column_names import plain_words
from fitting.material.data.columns import (
    SIZES,
    is_unit,
    size_of,
    split_specimen,
    understood,
    with_unit,
)
from fitting.material.data.errors import DataError, said_of
from fitting.material.data.layout import STATISTICS, TableLayout
from suas_jax.config.errors import unknown
from suas_jax.config.quantities import parse_quantity

# Sizes within a line of text, and those of TA Instruments: length, width, thickness.
_STATED = re.compile(r"([^\W\d][\w ]*?)\s*[:=]\s*([\d.,]*\d)\s*([^\W\d]\w*)")
_THREE = re.compile(r"([\d.,]+)\s*(?:x\s*)?([\d.,]+)\s*(?:x\s*)?([\d.,]+)\s*(\w+)")
_META = re.compile(r"^\s*([^\W\d][\w /^()\[\]-]*?)\s*[:=]\s*(.+?)\s*$")
_PLACE = re.compile(r"(.*\w)[\s_#]+[1-9]")  # one of several where a size was measured
_SI = {"area": "m2", "thickness_ratio": ""}  # of other sizes "m"


@dataclasses.dataclass(frozen=True, eq=False)
class Header:
    """What a file says beside its table."""

    metadata: dict[str, str]  # values by key, lower case with underscores
    # sizes in SI units as text, by column name with unit, by specimen
    by_specimen: dict[str, dict[str, str]]
    # values of sizes whose row states several, of specimens or at places, by column name
    in_rows: dict[str, list[str]] = dataclasses.field(default_factory=dict)

    @staticmethod
    def merged(headers: Sequence["Header"]) -> "Header":
        """One header of several sheets; the first word counts."""
        metadata: dict[str, str] = {}
        sizes: dict[str, dict[str, str]] = {}
        for header in headers:
            metadata = {**header.metadata, **metadata}
            sizes = {**header.by_specimen, **sizes}
        return Header(metadata, sizes)

    def single(self, *, several: bool) -> dict[str, str]:
        """The metadata; of a single specimen with its sizes."""
        if several or len(self.by_specimen) != 1:
            return self.metadata
        (own,) = self.by_specimen.values()
        keys = (key.rstrip("]").partition(" [") for key in own)
        pairs = zip(keys, own.values(), strict=True)
        named = {name: f"{text} {unit}" for (name, _, unit), text in pairs}
        return {**named, **self.metadata}

    def of_sheet(self) -> dict[str, str]:
        """Sizes of the single specimen of a sheet, as those of `by_specimen`."""
        own = next(iter(self.by_specimen.values())) if len(self.by_specimen) == 1 else {}
        sizes = (_size(key, text, "", ".") for key, text in self.metadata.items())
        return {**dict(size for size in sizes if size is not None), **own}


def read_header(cells: Cells, layout: TableLayout | None) -> Header:
    """Read the rows of a sheet that are not part of the table of readings."""
    rows = cells.rows if layout is None else [cells.rows[i] for i in layout.head]
    decimal = decimal_mark(cell for row in cells.rows[:2000] for cell in row)
    metadata: dict[str, str] = {}
    sizes: dict[str, dict[str, str]] = {}
    numbered: dict[str, list[float]] = {}  # what "Thickness 1" to "Thickness 3" say
    for text in cells.comments:
        if found := _META.match(text):
            metadata.setdefault(_key(found.group(1)), found.group(2).strip(" ;,\t\"'"))
    across = [_across(row, decimal) for row in rows]
    in_rows = dict(filter(None, reversed(across)))  # of rows of one size the first counts
    for name, values in in_rows.items():
        known, _, si = name.rstrip("]").partition(" [")
        metadata.setdefault(known, f"{statistics.median(map(float, values))!r} {si}")
    single = (row for row, found in zip(rows, across, strict=True) if found is None)
    for key, value, unit in (pair for row in single for pair in _pairs(row)):
        name, label = split_specimen(key)
        place = _PLACE.fullmatch(name)
        size = _size(place[1] if place else name, value, unit, decimal)
        if size is not None and label:
            sizes.setdefault(label, {}).setdefault(*size)
        elif size is not None:
            known, _, si = size[0].rstrip("]").partition(" [")
            if place and (known in numbered or known not in metadata):
                # ISO 37 and ASTM D412: the median of the places that were measured.
                numbered.setdefault(known, []).append(float(size[1]))
                metadata[known] = f"{statistics.median(numbered[known])!r} {si}"
            # Of two lengths the one of the gauge counts, see `stated_sizes`.
            key_of_size = known if place else _key(name)
            metadata.setdefault(
                key_of_size if size_of(key_of_size) else known, f"{size[1]} {si}"
            )
        elif not size_of(name):
            metadata.setdefault(_key(key), f"{value} {unit}".strip())
    for label, own in _results(rows, decimal).items():
        for known_size in own.items():
            sizes.setdefault(label, {}).setdefault(*known_size)
    return Header(metadata, sizes, in_rows)


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
        title = len(filled) > 3 and not pairs and not looks_numeric(value)
        pairs.append((key, value, unit if title else unit.strip("()[] ")))
        i += 1 if title else 3 if unit else 2
    return pairs


def _across(row: list[str], decimal: str) -> tuple[str, list[str]] | None:
    """A size that a row states several times, of specimens or at places, in SI units."""
    name, *cells = [cell for cell in row if cell] or [""]
    units = [cell for cell in cells if is_unit(cell) and not looks_numeric(cell)]
    values = [cell for cell in cells if cell not in units]
    if len(values) < 2 or len(set(units)) > 1 or not size_of(name):
        return None
    unit = units[0].strip("()[] ") if units else ""
    found = [size for cell in values if (size := _size(name, cell, unit, decimal))]
    return (found[0][0], [size for _, size in found]) if len(found) == len(values) else None


def _size(name: str, value: str, unit: str, decimal: str) -> tuple[str, str] | None:
    """A specimen's size as column name with SI unit and number; None for anything else."""
    amount = number(value, decimal)
    if not amount > 0.0:
        found = re.fullmatch(r"([\d.,]+)\s*([^\d\s].*)", value)  # "6,02 mm" in one cell
        if found is None or not number(found.group(1), decimal) > 0.0:
            return None
        amount, unit = number(found.group(1), decimal), found.group(2).strip("()[] ")
    column, size = understood(with_unit(name, unit)), size_of(name)
    if column is None or not size:
        return None
    return f"{size} [{_SI.get(size, 'm')}]", repr(amount * column.factor)


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
            if any(STATISTICS.match(plain_words(cell)) for cell in row[:2]):
                break
            label = row[0] if row[0] and 0 not in sized else str(count)
            label = split_specimen(label)[1] or label
            sizes = (_size(names[k], row[k], units[k], decimal) for k in sized if k < len(row))
            for size in filter(None, sizes):
                found.setdefault(label, {}).setdefault(*size)
    return found


def _key(text: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", plain_words(text)).strip("_")


# Of two sizes of a kind, the one of the part that is measured.
_OF_GAUGE = re.compile(r"gau?ge|initial|original|parallel|[lbwah]0")


def stated_sizes(
    file: str, metadata: Mapping[str, str]
) -> tuple[dict[str, float], dict[str, str]]:
    """Specimen sizes in a file's metadata, SI units, and doubts about some of them."""
    sizes: dict[str, float] = {}
    keys: dict[str, str] = {}
    doubts: dict[str, str] = {}
    for key, text in metadata.items():
        name = size_of(key)
        if not name:
            continue
        column = understood(key)
        if column is not None:
            with contextlib.suppress(ValueError):  # a number, whose unit the key states
                size = float(text.replace(",", ".")) * column.factor
                text = f"{size!r} {_SI.get(name, 'm')}".rstrip()
        size, before = _parsed(file, name, text, f"# {key}"), keys.get(name)
        gauge = [bool(_OF_GAUGE.search(k)) for k in (before or "", key)]
        counts = gauge[1] >= gauge[0]
        if before is not None and abs(size - sizes[name]) > 1e-6 * size:
            first, second = (f'"{k}" = {metadata[k]}' for k in (before, key))
            doubts[name] = (
                f'{name} stands twice, {first} and {second}: "{key if counts else before}" '
                f'counts; --specimen "{name}=..." says otherwise'
            )
        if counts:
            sizes[name], keys[name] = size, key
    return sizes, doubts


def given_sizes(file: str, specimen: Mapping[str, str]) -> dict[str, float]:
    """Specimen sizes of the command line, SI units."""
    specimen = {size_of(name) or name: text for name, text in specimen.items()}
    for name in specimen:
        if name not in SIZES:
            raise DataError(f"--specimen {name}: {unknown(name, SIZES, 'size')}")
    return {k: _parsed(file, k, text, f"--specimen {k}") for k, text in specimen.items()}


def _parsed(file: str, name: str, text: str, where: str) -> float:
    with said_of(f'{file}: {where} = "{text}"'):
        if name == "area":
            amount, _, unit = text.strip().partition(" ")
            plain = unit.replace("²", "2").replace("^2", "2")
            if not plain.endswith("2"):
                raise ValueError('an area with its unit is expected, for example "12 mm2"')
            value = float(amount.replace(",", ".")) * unit_size(f"{plain[:-1]}^2", "area")
        else:
            value = parse_quantity(text, "number" if name == "thickness_ratio" else "length")
        if not value > 0.0:
            raise ValueError(f"{name} must be greater than zero")
    return value
