"""Sizes of a specimen, from the comments of a file or from the command line."""

from collections.abc import Mapping

from fitting.column_units import unit_size
from fitting.material.data.columns import SIZES, size_of, understand
from fitting.material.data.errors import DataError
from fitting.material.data.tables import Table
from suas_jax.config.errors import listed, nearest
from suas_jax.config.quantities import DimensionName, parse_quantity

_DIMENSIONS: dict[str, DimensionName | str] = {"area": "area", "thickness_ratio": "number"}


def stated_sizes(table: Table) -> dict[str, float]:
    """Specimen sizes in the file's comments."""
    sizes = {}
    for key, text in table.metadata.items():
        name = size_of(key)
        if not name:
            continue
        number = _plain_number(text)
        if number is not None and (factor := _factor(key)) is not None:
            unit = {"area": " m2", "thickness_ratio": ""}.get(name, " m")
            text = f"{number * factor!r}{unit}"
        sizes[name] = _size(table, name, text, f"# {key}")
    return sizes


def given_sizes(table: Table, specimen: Mapping[str, str]) -> dict[str, float]:
    """Specimen sizes of the command line."""
    specimen = {size_of(name) or name: text for name, text in specimen.items()}
    for name in specimen:
        if name not in SIZES:
            near = nearest(name, SIZES)
            hint = f'did you mean "{near}"? ' if near else ""
            raise DataError(f"--specimen {name}: unknown size; {hint}allowed: {listed(SIZES)}")
    return {
        name: _size(table, name, text, f"--specimen {name}") for name, text in specimen.items()
    }


def _size(table: Table, name: str, text: str, where: str) -> float:
    dimension = _DIMENSIONS.get(name, "length")
    try:
        if dimension == "area":
            number, _, unit = text.strip().partition(" ")
            plain = unit.replace("²", "2").replace("^2", "2")
            if not plain.endswith("2"):
                raise ValueError('an area with its unit is expected, for example "12 mm2"')
            value = float(number.replace(",", ".")) * unit_size(f"{plain[:-1]}^2", "area")
        else:
            value = parse_quantity(text, dimension)  # type: ignore[arg-type]
    except ValueError as error:
        raise DataError(f'{table.file}: {where} = "{text}": {error}') from None
    if not value > 0.0:
        raise DataError(f'{table.file}: {where} = "{text}": {name} must be greater than zero')
    return value


def _plain_number(text: str) -> float | None:
    try:
        return float(text.replace(",", "."))
    except ValueError:
        return None


def _factor(key: str) -> float | None:
    """Size of the unit that a comment's key states; None where it states none."""
    try:
        column = understand(key, "")
    except ValueError:
        return None
    return None if column is None else column.factor
