"""The skin file of a design: the one it started from with new numbers; comments stay."""

import os
import re
from pathlib import Path
from typing import Any

import tomlkit

from fitting.arrays import Floats
from fitting.design.want import Want
from suas_jax.config import continuous_inputs
from suas_jax.config.toml_file import MOST_BYTES
from suas_jax.files.reading import read_bytes

_QUANTITY = re.compile(r"\s*([+-]?[\d.]+(?:[eE][+-]?\d+)?)(.*)", re.DOTALL)


def designed_skin(want: Want, x: Floats, output: Path) -> str:
    """Text of the skin file of a design.

    Args:
        want: what was wanted.
        x: variables of the design, between 0 and 1.
        output: where the file is to lie; a table of points that it names is found from there.

    Raises:
        ValueError: an input is not in the file itself.
    """
    raw = read_bytes(want.skin, MOST_BYTES).decode("utf-8-sig")
    document: Any = tomlkit.parse(raw)
    values = {path: float(value) for path, value in want.inputs(x).items()}
    if "preset" in document["material"] and any(p.startswith("material.") for p in values):
        document["material"] = want.spec.material.table()
    points = document["geometry"].get("points")
    if isinstance(points, str):
        where = (want.skin.parent / points).resolve()
        document["geometry"]["points"] = os.path.relpath(where, output.resolve().parent)
    now = continuous_inputs(want.spec)
    for path, value in values.items():
        *parents, last = (int(k) if k.isdigit() else k for k in path.split("."))
        table = document
        try:
            for key in parents:
                table = table[key]
            table[last] = _changed(table[last], now[path], value)
        except (KeyError, IndexError, TypeError):
            raise ValueError(
                f"{want.skin}: {path}: is not written in the file itself; write it there"
            ) from None
    document.pop("calibration", None)
    return str(tomlkit.dumps(document))


def _changed(text: Any, now: float, value: float) -> Any:
    """A quantity as the file has it, with another value in the same unit."""
    if not isinstance(text, str):
        return float(f"{value:.9g}")
    found = _QUANTITY.fullmatch(text)
    if found is None or now == 0:
        raise KeyError(text)
    number = float(found[1]) * value / now
    return f"{number:.9g}{found[2]}"
