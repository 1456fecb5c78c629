"""A material fit as one page of HTML that needs nothing else: figures are inside.

The page may be opened anywhere: it asks no host for anything, and its own policy forbids it.
"""

import base64
import hashlib
import io
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from fitting.html.page import page
from fitting.material.cards.card import card
from fitting.material.experiments.measurements import Dataset
from fitting.material.fit.bulk_modulus import BulkModulus
from fitting.material.fit.result import MaterialFit
from fitting.material.report.plots import plot_material
from suas_jax.config.quantities import format_quantity
from suas_jax.config.schema_material import LAWS
from suas_jax.files.reading import MEGABYTE, read_bytes
from suas_jax.files.writing import write_text

_MOST_BYTES = 64 * MEGABYTE
_PROGRAMS = ("suas-jax", "jax", "optimistix", "numpy", "scipy")

_DOTS_PER_INCH = 110


def data_provenance(sets: Sequence[Dataset]) -> list[dict[str, Any]]:
    """One entry a file, with its SHA-256; None where the file is no longer there."""
    return [
        {
            "file": data.file,
            "mode": data.mode,
            "sha256": _hash(Path(data.file)),
            "readings_fitted": data.size,
            "readings_stand_for": float(data.weight.sum()),
            "rows_left_out": dict(data.dropped),
            "length_m": data.origin.length,
            "area_m2": data.origin.area,
        }
        for data in sets
    ]


def versions() -> dict[str, str]:
    """Versions of the programs that a result depends on."""
    return {name: version(name) for name in _PROGRAMS}


def _hash(file: Path) -> str | None:
    try:
        return hashlib.sha256(read_bytes(file, _MOST_BYTES)).hexdigest()
    except (OSError, ValueError):
        return None


def write_html(
    fit: MaterialFit | None,
    report: dict[str, Any],
    file: Path,
    bulk: BulkModulus | None = None,
) -> None:
    """Write the report of a fit.

    Args:
        fit: the fit; None where only a bulk modulus was fitted.
        report: its JSON, with whatever the command added.
        file: where to write it.
        bulk: the bulk modulus, if there is one.
    """
    text = page(
        "fitting.material.report",
        "report.html.j2",
        report=report,
        title="bulk modulus" if fit is None else fit.family.title,
        constants=[*_constants(fit), *_bulk_modulus(report)],
        modes=_modes(report),
        figure=_embedded(plot_material(fit, bulk=bulk)),
        data=data_provenance([*(fit.sets if fit else ()), *(bulk.sets if bulk else ())]),
        versions=versions(),
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        material=card(fit.material(), "toml") if fit and fit.family.law_name in LAWS else "",
    )
    write_text(file, text)


def _bulk_modulus(report: dict[str, Any]) -> list[list[str]]:
    """The row of the bulk modulus, if there is one."""
    if "bulk_modulus_Pa" not in report:
        return []
    found = report["bulk_modulus_Pa"]
    error = report["volumetric"]["standard_error_Pa"]
    numbers = (found["value"], error, found["low95"], found["high95"])
    energy = report["volumetric"]["energy"]
    return [[f"bulk modulus K, energy {energy}", *(_text(x, "Pa") for x in numbers)]]


def _constants(fit: MaterialFit | None) -> list[list[str]]:
    """Name, value, standard error and 95 % interval of each constant, as text."""
    if fit is None:
        return []
    low, high = fit.intervals(0.95)
    errors = fit.uncertainty.standard_errors
    rows = [
        [name, *(_text(x, unit) for x in (fit.constants[i], errors[i], low[i], high[i]))]
        for i, (name, unit) in enumerate(zip(fit.family.names, fit.family.units, strict=True))
    ]
    modulus, first, last = (_text(x, "Pa") for x in fit.shear_modulus())
    return [*rows, ["shear modulus", modulus, "", first, last]]


def _modes(report: dict[str, Any]) -> list[dict[str, Any]]:
    """One row a mode: misfit where it was measured, stable stretches."""
    rows = []
    stable = report.get("stable_range", {})
    for mode in {**report["modes"], **stable}:
        measured = report["modes"].get(mode)
        window, shown = stable.get(mode), ""
        if window is not None:
            is_open = report["stable_range_open"][mode]
            low = "open" if is_open[0] else f"{window[0]:.4g}"
            high = "open" if is_open[1] else f"{window[1]:.4g}"
            shown = "all" if all(is_open) else f"{low} to {high}"
        rows.append({"mode": mode, "measured": measured, "stable": shown})
    return rows


def _text(value: float, unit: str) -> str:
    """A number with its unit; an infinite one is an open end."""
    if not np.isfinite(value):
        return "open"
    if unit == "Pa":
        return format_quantity(float(value), "stress")
    return f"{value:.5g}" + ("" if unit == "1" else f" {unit}")


def _embedded(figure: Figure) -> str:
    """A figure as the address of an image that holds it."""
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=_DOTS_PER_INCH)
    return "data:image/png;base64," + base64.b64encode(content.getvalue()).decode()
