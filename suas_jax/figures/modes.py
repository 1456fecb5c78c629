"""Figure of a section's natural modes."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from suas_jax.dynamics.modes import Modes
from suas_jax.figures.style import WALL, written

_COLUMNS = 3
# Largest displacement drawn, over the section's width.
_AMPLITUDE = 0.035


def plot_modes(found: Modes, file: Path | None = None) -> Figure:
    """Draw every mode at both ends of its swing, displacements enlarged.

    Args:
        found: the modes; at least one.
        file: where to write the figure; its ending chooses the format.

    Raises:
        ValueError: there are no modes to draw.
    """
    motion = found.motion
    if motion is None or not found.modes:
        raise ValueError(f"there are no modes to draw: {found.message}")
    rows = -(-len(found.modes) // _COLUMNS)
    figure = Figure(figsize=(4 * _COLUMNS, 2.6 * rows), layout="constrained")
    faces = np.stack([motion.inner.position, motion.outer.position])
    size = _AMPLITUDE * np.ptp(faces[:, 0])
    panels = figure.subplots(rows, _COLUMNS, squeeze=False).ravel()
    for axes in panels[len(found.modes) :]:
        axes.set_axis_off()
    for axes, mode, shape in zip(panels, found.modes, found.shapes, strict=False):
        axes.fill(*(1e3 * motion.wall), color=WALL, lw=0)
        for swing, style in ((0.0, "0.6"), (-size, "C1"), (size, "C0")):
            for x, y in 1e3 * (faces + swing * shape):
                axes.plot(x, y, color=style, lw=1.0)
        swings = mode["frequency_Hz"]
        text = "overdamped" if swings is None else f"{swings:.3g} Hz"
        axes.set_title(
            f"{mode['undamped_Hz']:.3g} Hz undamped, ζ = {mode['damping_ratio']:.2g}: {text}",
            fontsize="medium",
        )
        axes.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
    return written(figure, file)
