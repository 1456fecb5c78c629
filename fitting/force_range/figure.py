"""Picture of a skin's range of forces."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from fitting.force_range.bound import TOLD, ForceRange
from suas_jax.figures.style import CONTACT, written


def plot_range(found: ForceRange, file: Path | None = None) -> Figure:
    """Draw first contact over the skin, and the least error of a force before and after.

    Args:
        found: the range.
        file: where to write the figure; its ending chooses the format.
    """
    figure = Figure(figsize=(11, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    degrees = np.rad2deg(found.angle)
    left.plot(degrees, found.first_contact, "o-", ms=3, color=CONTACT, label="first contact")
    left.fill_between(
        degrees, found.smallest, found.largest, alpha=0.2, label=f"told to {TOLD:.0%}"
    )
    left.plot(degrees, found.saturation, "x", color="k", label="a taxel saturates")
    left.set(xlabel="angle of the load [deg]", ylabel="force [N]", yscale="log")
    left.legend()
    known = np.flatnonzero(np.isfinite(found.first_contact))
    for i in known[:: max(1, len(known) // 5)]:
        relative = found.force_error[i] / found.force[i]
        label = f"{degrees[i]:.3g}°"
        right.plot(found.force[i] / found.first_contact[i], relative, ".-", label=label)
    right.axvline(1.0, color=CONTACT, lw=1)
    right.axhline(TOLD, color="0.5", lw=1, ls="--")
    right.set(
        xlabel="force, in terms of first contact",
        ylabel="least standard deviation of the force, relative",
        xscale="log",
        yscale="log",
    )
    right.legend(title="load at")
    for axes in (left, right):
        axes.grid(alpha=0.3)
    return written(figure, file)
