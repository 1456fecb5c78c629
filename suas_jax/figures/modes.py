"""Figure of a skin's natural modes."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from suas_jax.dynamics.modes import Modes
from suas_jax.dynamics.motion import Motion
from suas_jax.dynamics.pad import PadMotion
from suas_jax.figures.style import FIRST, SECOND, WALL, styled, written

_COLUMNS = 3
# Largest displacement drawn, over the section's width.
_AMPLITUDE = 0.035


@styled
def plot_modes(found: Modes, file: Path | None = None) -> Figure:
    """Draw every mode, displacements enlarged: of a section at both ends of its swing.

    Raises:
        ValueError: there are no modes to draw.
    """
    motion = found.motion
    if motion is None or not found.modes:
        raise ValueError(f"there are no modes to draw: {found.message}")
    rows = -(-len(found.modes) // _COLUMNS)
    figure = Figure(figsize=(4 * _COLUMNS, 2.6 * rows), layout="constrained")
    panels = figure.subplots(rows, _COLUMNS, squeeze=False).ravel()
    for axes in panels[len(found.modes) :]:
        axes.set_axis_off()
    for axes, mode, shape in zip(panels, found.modes, found.shapes, strict=False):
        swings = mode["frequency_Hz"]
        text = "overdamped" if swings is None else f"{swings:.3g} Hz"
        axes.set_title(
            f"{mode['undamped_Hz']:.3g} Hz undamped, ζ = {mode['damping_ratio']:.2g}: {text}",
            fontsize="medium",
        )
        if isinstance(motion, Motion):
            _draw_section(axes, motion, shape)
        else:
            _draw_pad(axes, motion, shape)
    return written(figure, file)


def _draw_section(axes: Axes, motion: Motion, shape: np.ndarray) -> None:
    """Both ends of a swing, and the state between them."""
    faces = motion.outline.faces[::2]
    size = _AMPLITUDE * np.ptp(faces[:, 0])
    axes.fill(*(1e3 * motion.wall), color=WALL, lw=0)
    for swing, style in ((0.0, "0.6"), (-size, SECOND), (size, FIRST)):
        for x, y in 1e3 * (faces + swing * shape):
            axes.plot(x, y, color=style, lw=1.0)
    axes.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]")


def _draw_pad(axes: Axes, motion: PadMotion, shape: np.ndarray) -> None:
    """Outward displacement over the pad."""
    style: dict[str, Any] = {"cmap": "RdBu_r", "vmin": -1, "vmax": 1, "shading": "gouraud"}
    axes.pcolormesh(motion.angle, 1e3 * motion.axial, shape.T, **style)
    axes.set(xlabel="angle [deg]", ylabel="axial [mm]")
