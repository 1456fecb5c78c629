"""Figures of estimated loads over time."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fitting.arrays import Floats
from fitting.inverse_load.estimate.estimate import Contact, LoadEstimate
from suas_jax.figures.style import written

_BAND = 1.96  # standard deviations of the 95 % interval
_LONGEST = 3.0  # intervals shown whole, in terms of their median
_LABELS = {
    "angle": (180 / np.pi, "angle [°]"),
    "arc": (1e3, "arc [mm]"),
    "axial": (1e3, "axial [mm]"),
    "force": (1.0, "force [N]"),
    "diameter": (1e3, "diameter [mm]"),
    "direction": (180 / np.pi, "direction [°]"),
    "tilt": (180 / np.pi, "tilt [°]"),
}


def plot_loads(
    time: Floats,
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
    estimated = {"force"}.union(*(c.names for _, c in rows)) if rows else {"angle", "force"}
    names = [name for name in _LABELS if name in estimated]
    figure = Figure(figsize=(9, 3 + 2 * len(names)), layout="constrained")
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
        _limit(axes, values, errors)
        if name == "force":
            _draw_bounds(axes, time, estimates)
        if filtered is not None and name in ("angle", "arc", "axial", "force"):
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
        if len(axes.get_legend_handles_labels()[0]) > 1:
            axes.legend(fontsize="small")
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


def _draw_bounds(axes: Axes, time: Floats, estimates: Sequence[LoadEstimate]) -> None:
    """What acts at least where the wall takes the rest."""
    bounds = [
        (t, e.at_least) for t, e in zip(time, estimates, strict=True) if e.at_least is not None
    ]
    if bounds:
        axes.plot(*zip(*bounds, strict=True), "^", ms=5, color="C3", label="at least")


def _limit(axes: Axes, values: Floats, errors: Floats) -> None:
    """Show all values, and of their intervals what the few widest don't hide."""
    if not np.isfinite(errors).any():
        return
    shown = np.minimum(np.nan_to_num(errors), _LONGEST * np.nanmedian(errors))
    low, high = (values - shown).min(), (values + shown).max()
    margin = 0.05 * (high - low)
    if margin > 0:
        axes.set_ylim(low - margin, high + margin)
