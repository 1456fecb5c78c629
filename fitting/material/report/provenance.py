"""Where the data of a fit come from: files with their hash, and what was read of them."""

import hashlib
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from fitting.material.experiments.measurements import Dataset
from suas_jax.files.reading import MEGABYTE, read_bytes

_MOST_BYTES = 64 * MEGABYTE
_PROGRAMS = ("suas-jax", "jax", "optimistix", "numpy", "scipy")


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
