"""Write a calibrated skin file: the original with new numbers and the record of the fit."""

import platform
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from fitting.sensor.fit.result import SensorFit
from fitting.sensor.model.as_built import is_gain, places_of_shifts, shift_of_loads
from fitting.sensor.model.constants import (
    FILL,
    GAP,
    LAYERS,
    MOUNTING,
    PERMITTIVITY,
    PRESS_ERRORS,
    SCALE,
    STIFFNESS,
    STRAY,
    THICKNESS,
    ZEROS,
    is_gap,
    is_press_error,
)
from fitting.sensor.report.mark import MARK
from fitting.statistics.discrepancy import Discrepancy
from suas_jax.config import SkinSpec
from suas_jax.config.geometry import SheetSpec
from suas_jax.config.input_errors import stresses_of
from suas_jax.config.schema_skin import MODULE_TAXELS
from suas_jax.config.toml_file import MOST_BYTES
from suas_jax.files.reading import read_bytes, sha256_of

_PLACES = {
    GAP: ("geometry", "oil_gap", "mm", 1e-3),
    PERMITTIVITY: ("oil", "relative_permittivity", "", 1.0),
    SCALE: ("electrodes", "lsb", "fF", 1e-15),
    STRAY: ("electrodes", "stray", "fF", 1e-15),
    FILL: ("oil", "fill", "", 1.0),
    MOUNTING: ("geometry", "mounting", "%", 1e-2),
    THICKNESS: ("geometry", "thickness", "mm", 1e-3),
}


_NOT_MATERIAL = ("geometry.", "electrodes.", *ZEROS, *(f"{kind}." for kind in PRESS_ERRORS))


def calibrated_skin(skin: Path, fit: SensorFit) -> str:
    """Text of a skin file with the calibrated numbers; comments and the rest stay.

    Args:
        skin: the file that was calibrated.
        fit: its calibration.
    """
    document: Any = tomlkit.parse(read_bytes(skin, MOST_BYTES).decode("utf-8-sig"))
    material: dict[str, float] = {}
    found = dict(zip(fit.family.names, map(float, fit.constants), strict=True))
    _set_as_built(document, fit.data.spec, found)
    for part, value in zip(fit.family.parts, fit.constants, strict=True):
        if part.name == STIFFNESS:
            inputs = fit.problem.model.inputs
            for path in stresses_of(fit.data.spec):
                material[path.removeprefix("material.")] = float(value * inputs[path])
        elif part.name in _PLACES:
            table, key, unit, size = _PLACES[part.name]
            document[table][key] = _text(value / size, unit)
        elif is_gap(part.name) or part.name.startswith(_NOT_MATERIAL):
            continue
        elif part.name == LAYERS:
            document["electrodes"]["layers"] = _layers(fit.data.spec, float(value))
        else:
            material[part.name.removeprefix("material.")] = float(value)
    if fit.problem.model.gap_of is not None:
        _set_heights(document, fit)
    if material:
        _set_material(document, fit.data.spec, material)
    document.pop("calibration", None)
    document.add(tomlkit.nl())
    document["calibration"] = _record(skin, fit)
    return str(tomlkit.dumps(document))


def _text(value: float, unit: str) -> Any:
    return f"{value:.12g} {unit}" if unit else float(f"{value:.12g}")


def _layers(spec: SkinSpec, total: float) -> list[dict[str, Any]]:
    """Layers with a given sum of thickness over permittivity [m]."""
    layers = spec.sensing.layers
    now = sum(layer.thickness / layer.relative_permittivity for layer in layers)
    if total <= 0.0:
        return []
    if not layers:
        return [{"thickness": _text(total / 1e-6, "um"), "relative_permittivity": 1.0}]
    return [
        {
            "thickness": _text(layer.thickness * total / now / 1e-6, "um"),
            "relative_permittivity": layer.relative_permittivity,
        }
        for layer in layers
    ]


def _set_as_built(document: Any, spec: SkinSpec, found: dict[str, float]) -> None:
    """Write tables of thickness and gap, and the gains of channels."""
    for key in ("thickness", "oil_gap"):
        table, prefix = getattr(spec.geometry, key), f"geometry.{key}.value"
        if f"{prefix}.0" not in found and f"{prefix}.0.0" not in found:
            continue
        own: dict[str, Any] = {"arc": list(table.arc)}
        if isinstance(table, SheetSpec):
            own["axial"] = list(table.axial)
            own["value"] = [
                [_text(found[f"{prefix}.{i}.{j}"] / 1e-3, "mm") for j in range(len(row))]
                for i, row in enumerate(table.value)
            ]
        else:
            count = len(table.value)
            own["value"] = [_text(found[f"{prefix}.{i}"] / 1e-3, "mm") for i in range(count)]
        row = tomlkit.inline_table()
        row.update(own)
        document["geometry"][key] = row
    gains = {name.split(".", 1)[1]: value for name, value in found.items() if is_gain(name)}
    for name, value in gains.items():
        table, index, key, *number = name.split(".")
        own = document["electrodes"][table][int(index)]
        if not number:
            own[key] = _text(value, "")
        elif number == ["0"]:
            own[key] = [
                _text(gains[f"{table}.{index}.{key}.{k}"], "") for k in range(MODULE_TAXELS)
            ]


def _set_heights(document: Any, fit: SensorFit) -> None:
    """Write the gaps of single taxels or modules as heights of their electrodes."""
    assert fit.problem.model.gap_of is not None
    electrodes = fit.data.spec.sensing
    gaps = fit.constants[list(fit.problem.model.gap_of)]
    heights = [_text((fit.data.spec.geometry.oil_gap - gap) / 1e-3, "mm") for gap in gaps]
    if electrodes.layout == "list":
        for taxel, height in zip(document["electrodes"]["taxels"], heights, strict=True):
            taxel["height"] = height
        return
    for i, module in enumerate(document["electrodes"]["modules"]):
        module["heights"] = heights[MODULE_TAXELS * i : MODULE_TAXELS * (i + 1)]


def _set_material(document: Any, spec: SkinSpec, values: dict[str, float]) -> None:
    """Write material constants; a preset is written out."""
    table = spec.material.table()
    for path, value in values.items():
        key, _, index = path.partition(".")
        text = _text(value / 1e6, "MPa") if spec.material.unit(key) == "Pa" else value
        if index:
            table[key][int(index)] = text
        else:
            table[key] = text
    document["material"] = table


def _record(skin: Path, fit: SensorFit) -> Any:
    table = tomlkit.table()
    table.comment(f"{MARK}; SI units")
    programs = ("suas-jax", "jax", "optimistix", "numpy")
    table["created"] = datetime.now(UTC).isoformat(timespec="seconds")
    table["versions"] = ", ".join(
        [f"{name} {version(name)}" for name in programs]
        + [f"Python {platform.python_version()}"]
    )
    family, judged = fit.family, fit.uncertainty
    # Errors of places are the presses', not the skin's. What gains of a pad's hundreds of
    # channels leave open is within the model's error of a reading.
    pad = fit.data.spec.geometry.dimension == 3
    own = [
        i
        for i, name in enumerate(family.names)
        if not (is_press_error(name) or (pad and is_gain(name)))
    ]
    table["parameters"] = [family.names[i] for i in own]
    table["units"] = [family.units[i] for i in own]
    table["values"] = [float(fit.constants[i]) for i in own]
    table["standard_errors"] = [float(judged.standard_errors[i]) for i in own]
    table["covariance"] = [list(map(float, row)) for row in judged.covariance[np.ix_(own, own)]]
    table["priors"] = [
        f"{name}: {prior.mean:.6g} +- {prior.sd:.3g} {family.units[family.names.index(name)]}, "
        f"{prior.reason}"
        for name, prior in fit.priors.items()
        if name in table["parameters"]
    ]
    table["unidentifiable"] = list(fit.findings)
    if fit.offsets is not None:
        table["offsets"] = [float(np.round(x, 4)) for x in fit.offsets[0]]
        table["offset_errors"] = [float(np.round(x, 4)) for x in fit.offsets[1]]
    table["masked"] = [
        f"module {m.module}, taxel {m.taxel}: {m.reason}" for m in fit.masked if m.whole
    ]
    nodes = places_of_shifts(fit.data.spec.geometry)
    if (shared := fit.place_shift(nodes)) is not None:
        table["place_shift"] = _place_shift(nodes, *shift_of_loads(*shared))
    if fit.force_scatter is not None:
        table["force_scatter"] = float(f"{fit.force_scatter:.6g}")
    if fit.discrepancy is not None:
        table["discrepancy"] = _discrepancy(fit.discrepancy)
    table["skin"] = _file(str(skin), sha256_of(skin, MOST_BYTES))
    logs = tomlkit.array()
    for file in fit.data.files:
        logs.append(_file(file.path, file.sha256))
        if file.inputs is not None:
            logs.append(_file(*file.inputs))
    table["logs"] = logs
    return table


def _place_shift(angle: np.ndarray, shift: np.ndarray, covariance: np.ndarray) -> Any:
    table = tomlkit.inline_table()
    table.update({"angles": _rounded(angle), "shifts": _rounded(shift)})
    table["covariance"] = [_rounded(row) for row in covariance]
    return table


def _discrepancy(found: Discrepancy) -> Any:
    """Its numbers, and the presses that it was learned from."""
    presses = found.presses
    table = tomlkit.inline_table()
    table.update({key: float(f"{x:.6g}") for key, x in found.numbers._asdict().items()})
    lists = (presses.angle, presses.force)
    table.update({key: _rounded(x) for key, x in zip(("angles", "forces"), lists, strict=True)})
    rows = (presses.change, presses.left, presses.noise, presses.place, presses.push)
    keys = ("changes", "left", "noise", "places", "pushes")
    table.update({key: [_rounded(row) for row in x] for key, x in zip(keys, rows, strict=True)})
    return table


def _rounded(values: np.ndarray) -> list[float]:
    return [float(f"{x:.6g}") for x in values]


def _file(path: str, digest: str) -> Any:
    row = tomlkit.inline_table()
    row.update({"path": path, "sha256": digest})
    return row
