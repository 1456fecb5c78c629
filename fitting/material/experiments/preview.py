"""Preview of a data file: what is understood of it, before anything is fitted."""

import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from fitting.material.data.columns import understand
from fitting.material.data.errors import DataError
from fitting.material.data.header import given_sizes, stated_sizes
from fitting.material.data.tables import Table, read_table
from fitting.material.experiments.artefacts import curve_suspects
from fitting.material.experiments.data_checks import warnings_of
from fitting.material.experiments.datasets import load_dataset
from fitting.material.experiments.measurements import Dataset, StressTest
from fitting.material.experiments.selection import loadings

_MODULUS = {"volumetric": "bulk_modulus_Pa"}


def preview(
    path: str | os.PathLike[str],
    mode: str = "uniaxial",  # kind of test that it is read as
    columns: Mapping[str, str] | None = None,
    specimen: Mapping[str, str] | None = None,
) -> tuple[dict[str, Any], Table, Dataset | None]:
    """Read a file as a test of a mode, and say what was understood.

    Returns the JSON of `suas data`, the table, and the test; None where something is missing
    for it, which the JSON says.
    Raises DataError: the file holds no table.
    """
    plane = mode in ("biaxial", "biaxial_difference")
    table = read_table(path, columns, plane=plane)
    report: dict[str, Any] = {
        "file": table.file,
        "reading": table.reading,
        "columns": [_column(table, i) for i in range(len(table.names)) if table.names[i]],
        "sizes_m": {
            **stated_sizes(table.file, table.metadata)[0],
            **given_sizes(table.file, specimen or {}),
        },
        "metadata": table.metadata,
        "rows": len(table.lines),
        "mode": mode,
        "test": None,
        "suspects": [],
        "warnings": list(table.remarks),
        "status": "understood",
        "message": "",
    }
    try:
        data = load_dataset(mode, path, specimen, columns=columns)
    except DataError as error:
        report["status"], report["message"] = "incomplete", str(error)
        return report, table, None
    report["test"] = _test(data)
    suspects = curve_suspects(data)
    report["suspects"] = [suspect.report for suspect in suspects]
    report["warnings"] = [*warnings_of(data), *(suspect.text for suspect in suspects)]
    return report, table, data


def _column(table: Table, index: int) -> dict[str, Any]:
    """One column: what it means, and its numbers in the unit that the file states."""
    name, values = table.names[index], table.cells[:, index]
    known = values[np.isfinite(values)]
    entry: dict[str, Any] = {
        "number": index + 1,
        "name": name,
        "quantity": None,
        "direction": 0,
        "unit": "",
        "numbers": len(known),
        "missing": int(len(values) - len(known)),
        "min": float(known.min()) if known.size else None,
        "max": float(known.max()) if known.size else None,
    }
    try:
        column = understand(name, table.file)
    except ValueError as error:
        return {**entry, "problem": str(error)}
    if column is not None:
        entry |= {
            "quantity": column.quantity,
            "direction": column.direction,
            "unit": column.unit or ("s" if column.quantity == "time" else "1"),
        }
    return entry


def _test(data: Dataset) -> dict[str, Any]:
    specimens = []
    for cycles, label in zip(loadings(data), dict.fromkeys(data.specimen), strict=True):
        rows = data.specimen == label
        specimens.append(
            {
                "specimen": str(label),
                "readings": int(rows.sum()),
                "loadings": len(cycles),
                "first_line": int(data.line[rows].min()),
                "last_line": int(data.line[rows].max()),
            }
        )
    report: dict[str, Any] = {
        "readings": data.size,
        "specimens": specimens,
        "dropped": data.dropped,
        "abscissa": data.abscissa_label,
        "abscissa_min": float(np.min(data.abscissa)),
        "abscissa_max": float(np.max(data.abscissa)),
        _MODULUS.get(data.mode, "shear_modulus_Pa"): float(data.modulus),
    }
    if isinstance(data, StressTest):
        report |= {
            "measure": data.measure,
            "stress_min_Pa": float(np.min(data.value)),
            "stress_max_Pa": float(np.max(data.value)),
        }
    return report
