"""Figures of estimated loads over time."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from fitting.inverse_load.estimate.estimate import Contact, LoadEstimate
from suas_jax.figures.style import written

_BAND = 1.96  # standard deviations of the 95 % interval
_LABELS = {
    "angle": (180 / np.pi, "angle [°]"),
    "axial": (1e3, "axial [mm]"),
    "force": (1.0, "force [N]"),
}


def plot_loads(
    time: NDArray[np.float64],
    estimates: Sequence[LoadEstimate],
    file: Path | None = None,
    filtered: Sequence[Sequence[Contact]] | None = None,
) -> Figure:
    """Place, force and misfit over time, with 95 % intervals.

    Args:
        time: of the frames [s].
        estimates: one a frame.
        file: where to write the figure; its ending chooses the format.
        filtered: loads filtered over time, drawn as a line.
    """
    rows = [(t, c) for t, e in zip(time, estimates, strict=True) for c in e.contacts]
    on_pad = any(c.axial is not None for _, c in rows)
    names = [name for name in _LABELS if name != "axial" or on_pad]
    figure = Figure(figsize=(9, 7 + 2 * on_pad), layout="constrained")
    panels = figure.subplots(len(names) + 1, 1, sharex=True)
    misfit = panels[-1]
    for axes, name in zip(panels, names, strict=False):
        scale, label = _LABELS[name]
        axes.set_ylabel(label)
        values = np.array([scale * getattr(c, name) for _, c in rows])
        errors = np.array(
            [
                np.nan if c.covariance is None else _BAND * scale * c.deviation(name)
                for _, c in rows
            ]
        )
        at = np.array([t for t, _ in rows])
        axes.errorbar(at, values, errors, fmt=".", ms=4, lw=0.8, color="C0", label="frames")
        if filtered is not None:
            smooth = [(t, c) for t, cs in zip(time, filtered, strict=True) for c in cs]
            axes.plot(
                [t for t, _ in smooth],
                [scale * getattr(c, name) for _, c in smooth],
                ".",
                ms=2,
                color="C1",
                zorder=3,  # over the frames, which they lie among
                label="filtered",
            )
            axes.legend()
    statuses = sorted({e.status for e in estimates})
    for name in statuses:
        chosen = [
            (t, e.chi2_per_dof)
            for t, e in zip(time, estimates, strict=True)
            if e.status == name
        ]
        misfit.plot(*zip(*chosen, strict=True), ".", ms=4, label=name)
    misfit.set_ylabel("χ² per degree of freedom")
    misfit.set_xlabel("time [s]")
    if statuses:
        misfit.legend(loc="upper right", fontsize="small")
    return written(figure, file)
