"""Figures of estimated loads over time."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from fitting.inverse_load.estimate.estimate import Contact, LoadEstimate
from suas_jax.figures.style import written

_BAND = 1.96  # standard deviations of the 95 % interval


def plot_loads(
    time: NDArray[np.float64],
    estimates: Sequence[LoadEstimate],
    file: Path | None = None,
    filtered: Sequence[Sequence[Contact]] | None = None,
) -> Figure:
    """Angle, force and misfit over time, with 95 % intervals.

    Args:
        time: of the frames [s].
        estimates: one a frame.
        file: where to write the figure; its ending chooses the format.
        filtered: loads filtered over time, drawn as a line.
    """
    figure = Figure(figsize=(9, 7), layout="constrained")
    angle, force, misfit = figure.subplots(3, 1, sharex=True)
    rows = [(t, c) for t, e in zip(time, estimates, strict=True) for c in e.contacts]
    for axes, scale, name, k in (
        (angle, 180 / np.pi, "angle", 0),
        (force, 1.0, "force", 1),
    ):
        values = np.array([scale * getattr(c, name) for _, c in rows])
        errors = np.array(
            [
                np.nan if c.covariance is None else _BAND * scale * np.sqrt(c.covariance[k, k])
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
    angle.set_ylabel("angle [°]")
    force.set_ylabel("force [N]")
    names = sorted({e.status for e in estimates})
    for name in names:
        chosen = [
            (t, e.chi2_per_dof)
            for t, e in zip(time, estimates, strict=True)
            if e.status == name
        ]
        misfit.plot(*zip(*chosen, strict=True), ".", ms=4, label=name)
    misfit.set_ylabel("χ² per degree of freedom")
    misfit.set_xlabel("time [s]")
    if names:
        misfit.legend(loc="upper right", fontsize="small")
    return written(figure, file)
