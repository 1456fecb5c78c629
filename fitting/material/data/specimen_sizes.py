"""Sizes of a specimen, from the comments of a file or from the command line."""

from collections.abc import Mapping

from fitting.column_units import unit_size
from fitting.material.data.columns import understand
from fitting.material.data.errors import DataError
from fitting.material.data.tables import Table
from suas_jax.config.errors import listed, nearest
from suas_jax.config.quantities import DimensionName, parse_quantity

_SPECIMEN_KEYS: dict[str, DimensionName | str] = {
    "length": "length",
    "grip_separation": "length",
    "width": "length",
    "thickness": "length",
    "diameter": "length",
    "radius": "length",
    "rest_radius": "length",
    "area": "area",
    "thickness_ratio": "number",
}


def stated_sizes(table: Table) -> dict[str, float]:
    """Specimen sizes in the file's comments."""
    sizes = {}
    for key, text in table.metadata.items():
        name, factor = _size_named(key)
        if not name:
            continue
        number = _plain_number(text)
        if number is not None and factor is not None:
            unit = {"area": " m2", "thickness_ratio": ""}.get(name, " m")
            text = f"{number * factor!r}{unit}"
        sizes[name] = _size(table, name, _SPECIMEN_KEYS[name], text, f"# {key}")
    return sizes


def given_sizes(table: Table, specimen: Mapping[str, str]) -> dict[str, float]:
    """Specimen sizes of the command line."""
    for name in specimen:
        if name not in _SPECIMEN_KEYS:
            near = nearest(name, _SPECIMEN_KEYS)
            hint = f'did you mean "{near}"? ' if near else ""
            raise DataError(
                f"--specimen {name}: unknown size; {hint}allowed: {listed(_SPECIMEN_KEYS)}"
            )
    return {
        name: _size(table, name, _SPECIMEN_KEYS[name], text, f"--specimen {name}")
        for name, text in specimen.items()
    }


def _size(table: Table, name: str, dimension: str, text: str, where: str) -> float:
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


def _size_named(key: str) -> tuple[str, float | None]:
    """Which size of a specimen a comment's key names, and its unit if the key has one."""
    for spelled, bare in ((key, False), (f"{key}_mm", True), (f"{key}_mm2", True)):
        try:
            column = understand(spelled, "")
        except ValueError:  # a known quantity whose unit is missing or another
            continue
        if column is not None and column.quantity in _SPECIMEN_KEYS:
            return column.quantity, None if bare else column.factor
    return "", None
