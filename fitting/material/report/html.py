"""A material fit as one page of HTML that needs nothing else: figures are inside.

The page may be opened anywhere: it asks no host for anything, and its own policy forbids it.
"""

import base64
import io
from datetime import UTC, datetime
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from matplotlib.figure import Figure

from fitting.material.cards.card import card
from fitting.material.fit.result import MaterialFit
from fitting.material.report.plots import plot_material
from fitting.material.report.provenance import data_provenance, versions
from suas_jax.config.quantities import format_quantity
from suas_jax.config.schema_material import LAWS
from suas_jax.files.writing import write_text

_TEMPLATE = "report.html.j2"
_DOTS_PER_INCH = 110


def write_html(fit: MaterialFit, report: dict[str, Any], file: Path) -> None:
    """Write the report of a fit.

    Args:
        fit: the fit.
        report: its JSON, with whatever the command added.
        file: where to write it.
    """
    text = files("fitting.material.report").joinpath(_TEMPLATE).read_text(encoding="utf-8")
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    page = environment.from_string(text).render(
        report=report,
        title=fit.family.title,
        constants=_constants(fit),
        modes=_modes(report),
        figure=_embedded(plot_material(fit)),
        data=data_provenance(fit.sets),
        versions=versions(),
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        material=card(fit.material(), "toml") if fit.family.law_name in LAWS else "",
    )
    write_text(file, page)


def _constants(fit: MaterialFit) -> list[list[str]]:
    """Name, value, standard error and 95 % interval of each constant, as text."""
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
    for mode in {**report["modes"], **report["stable_range"]}:
        measured = report["modes"].get(mode)
        window, shown = report["stable_range"].get(mode), ""
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
