"""A picture of the pad: one value a taxel on the unrolled wall, never interpolated."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from suas_jax.config import SkinSpec, continuous_inputs
from suas_jax.figures.style import CONTACT, styled, written
from suas_jax.scene.parts import skin_parts


@styled
def plot_pad(
    skin: SkinSpec,
    values: Sequence[float],
    file: Path | None = None,
    *,
    label: str = "sensor output [counts]",
    numbers: bool = False,
) -> Figure:
    """Draw every taxel as the disc it is, in the colour of its value.

    Taxels without a value (NaN: the membrane touches them) are crossed out.

    Args:
        skin: a skin, or a scene, with [electrodes].
        values: one a taxel, in the order of the report's `taxels`.
        file: where to write the figure; its ending chooses the format.
        label: of the colour bar, with the unit.
        numbers: write module.taxel on every disc.

    Raises:
        ValueError: the skin has no electrodes, or values don't match its taxels.
    """
    if skin.electrodes is None:
        raise ValueError("the skin has no [electrodes]: there is no pad to draw")
    parts = skin_parts(skin, continuous_inputs(skin))
    assert parts.electrodes is not None
    wall, taxels = parts.geometry.wall_size, parts.electrodes.taxels
    value = np.asarray(values, float)
    if value.shape != (len(taxels.number),):
        raise ValueError(f"{value.size} values for {len(taxels.number)} taxels")
    scale = 1e3 * float(wall[0])  # mm of wall per radian
    x = scale * np.asarray(taxels.angle)[:, 0]
    y, radius = 1e3 * np.asarray(taxels.axial)[:, 0], 5e2 * np.asarray(taxels.diameter)[:, 0]
    width = 1e3 * skin.geometry.width / 2
    length = scale * float(parts.geometry.half_angle[0])
    figure = Figure(figsize=(9, 1.2 + 8 * min(1.0, width / length)), layout="constrained")
    axes = figure.subplots()
    discs = [Circle((a, b), r) for a, b, r in zip(x, y, radius, strict=True)]
    patches = PatchCollection(discs, array=np.ma.masked_invalid(value), ec="0.3", lw=0.4)
    patches.get_cmap().set_bad("0.9")
    axes.add_collection(patches)
    axes.plot(*[c[np.isnan(value)] for c in (x, y)], "x", color=CONTACT, ms=6)
    if numbers:
        for a, b, m, k in zip(x, y, taxels.module, taxels.number, strict=True):
            axes.text(a, b, f"{m}.{k}", ha="center", va="center", fontsize=5)
    axes.set(
        xlim=(-length, length),
        ylim=(-width, width),
        aspect="equal",
        xlabel="along the unrolled wall [mm]",
        ylabel="along the axis [mm]",
    )

    def degrees_of(arc: Any) -> Any:
        return np.rad2deg(arc / scale)

    def arc_of(degrees: Any) -> Any:
        return np.deg2rad(degrees) * scale

    degrees = axes.secondary_xaxis("top", functions=(degrees_of, arc_of))
    degrees.set_xlabel("angle from the symmetry axis [deg]")
    figure.colorbar(patches, ax=axes, label=label, shrink=0.8)
    return written(figure, file)
