"""The skin file of a design: the one it started from with new numbers; comments stay."""

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from fitting.arrays import Floats
from fitting.design.want import Want
from fitting.inverse_load.estimate.place import ContactPlaces
from suas_jax import skin_of
from suas_jax.config import continuous_inputs
from suas_jax.config.toml_file import MOST_BYTES
from suas_jax.files.reading import read_bytes

_QUANTITY = re.compile(r"\s*([+-]?[\d.]+(?:[eE][+-]?\d+)?)(.*)", re.DOTALL)


def designed_skin(want: Want, x: Floats, output: Path) -> str:
    """Text of the skin file of a design, by its variables x between 0 and 1.

    A table of points that it names is found from where the output is to lie.

    Raises:
        ValueError: an input is not in the file itself.
    """
    document = _copied(want, output)
    values = {path: float(value) for path, value in want.inputs(x).items()}
    if "preset" in document["material"] and any(p.startswith("material.") for p in values):
        table = want.spec.material.table()
        table.pop("note", None)  # of a preset, whose constants these are no more
        document["material"] = table
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
    return str(tomlkit.dumps(document))


def skin_with_taxels(want: Want, kept: Sequence[int], output: Path) -> str:
    """Text of the skin file with some of its taxels, by their places in the layout, rising."""
    document = _copied(want, output)
    electrodes, spec = document["electrodes"], want.spec.electrodes
    assert spec is not None
    if spec.layout == "list":
        for k in reversed(range(len(spec.taxels))):
            if k not in kept:
                del electrodes["taxels"][k]
        return str(tomlkit.dumps(document))
    skin = skin_of(want.spec, contact=False)
    taxels, places = skin.electrodes.taxels, ContactPlaces(want.spec.geometry, skin.geometry)
    angle = np.asarray(taxels.angle)[:, 0]
    arc = places.arc(angle)
    height = np.broadcast_to(np.asarray(skin.electrodes.height), (len(angle), 1))
    rows = tomlkit.array()
    for k in kept:
        row = tomlkit.inline_table()
        if arc is None:
            row["angle"] = f"{np.rad2deg(places.angle(angle)[k]):.9g} deg"
        else:
            row["arc"] = _millimetres(arc[k])
        row["axial"] = _millimetres(taxels.axial[k, 0])
        row["diameter"] = _millimetres(taxels.diameter[k, 0])
        if height[k, 0]:
            row["height"] = _millimetres(height[k, 0])
        name = f"module {taxels.module[k]}, taxel {taxels.number[k]}"
        rows.add_line(row, indent="  ", comment=name)
    rows.add_line(indent="")
    del electrodes["modules"]
    electrodes["layout"] = "list"
    electrodes["taxels"] = rows
    return str(tomlkit.dumps(document))


def _copied(want: Want, output: Path) -> Any:
    """The skin file of a design as it was; its calibration is another skin's."""
    raw = read_bytes(want.skin, MOST_BYTES).decode("utf-8-sig")
    document: Any = tomlkit.parse(raw)
    points = document["geometry"].get("points")
    if isinstance(points, str):
        where = (want.skin.parent / points).resolve()
        document["geometry"]["points"] = os.path.relpath(where, output.resolve().parent)
    document.pop("calibration", None)
    return document


def _millimetres(value: Any) -> str:
    return f"{1e3 * float(value):.9g} mm"


def _changed(text: Any, now: float, value: float) -> Any:
    """A quantity as the file has it, with another value in the same unit."""
    if not isinstance(text, str):
        return float(f"{value:.9g}")
    found = _QUANTITY.fullmatch(text)
    if found is None or now == 0:
        raise KeyError(text)
    number = float(found[1]) * value / now
    return f"{number:.9g}{found[2]}"
