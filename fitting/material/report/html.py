"""A material fit as one page of HTML that needs nothing else: figures are inside.

The page may be opened anywhere: it asks no host for anything, and its own policy forbids it.
"""

import contextlib
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from fitting.material.cards.card import card
from fitting.material.experiments.measurements import Dataset
from fitting.material.fit.bulk_modulus import BulkModulus
from fitting.material.fit.result import MaterialFit
from fitting.material.report.description import described
from fitting.material.report.plots import plot_material
from fitting.report.page import embedded, page
from suas_jax.config.schema_scene import LAWS
from suas_jax.files.reading import MEGABYTE, sha256_of
from suas_jax.files.writing import write_text

_MOST_BYTES = 64 * MEGABYTE
_PROGRAMS = ("suas-jax", "jax", "optimistix", "numpy", "scipy")


def write_html(
    fit: MaterialFit | None,  # the fit; None where only a bulk modulus was fitted
    report: dict[str, Any],  # its JSON, with whatever the command added
    file: Path,
    bulk: BulkModulus | None = None,  # the bulk modulus, if there is one
) -> None:
    """Write the report of a fit."""
    text = page(
        "fitting.material.report",
        "report.html.j2",
        parts=described(report, fit),
        title="bulk modulus" if fit is None else fit.family.title,
        figure=embedded(plot_material(fit, bulk=bulk), "png"),
        data=_provenance([*(fit.sets if fit else ()), *(bulk.sets if bulk else ())]),
        versions={name: version(name) for name in _PROGRAMS},
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        material=card(fit.material(), "toml") if fit and fit.family.law_name in LAWS else "",
    )
    write_text(file, text)


def _provenance(sets: Sequence[Dataset]) -> list[dict[str, Any]]:
    """One entry a file, with its SHA-256; None where the file is no longer there."""
    found = []
    for data in sets:
        entry = {"file": data.file, "mode": data.mode, "sha256": None}
        with contextlib.suppress(OSError, ValueError):
            entry["sha256"] = sha256_of(data.file, _MOST_BYTES)
        readings = {
            "readings_fitted": data.size,
            "readings_stand_for": float(data.weight.sum()),
        }
        found.append(entry | readings)
    return found
