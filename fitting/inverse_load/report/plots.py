"""Figures of estimated loads over time."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fitting.arrays import Floats
from fitting.inverse_load.estimate.estimate import Contact, LoadEstimate
from suas_jax.figures.style import CONTACT, FIRST, SECOND, styled, written

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


@styled
def plot_loads(
    time: Floats,  # of the frames [s]
    estimates: Sequence[LoadEstimate],  # one a frame
    file: Path | None = None,  # where to write the figure; its ending chooses the format
    filtered: Sequence[Sequence[Contact]] | None = None,
) -> Figure:
    """Place, force and misfit over time, with 95 % intervals.

    Bars are what the noise of a frame leaves open. The band is what the skin file's tolerances
    leave open beside it, by one error that all frames share.

    Loads that are filtered over time are drawn as points.
    """
    contacts = [estimate.contacts for estimate in estimates]
    estimated = {name for found in contacts for c in found for name in c.names}
    names = [name for name in _LABELS if name in (estimated or {"angle", "force"})]
    figure = Figure(figsize=(8, 1.6 * (len(names) + 1)), layout="constrained")
    panels = figure.subplots(len(names) + 1, 1, sharex=True)
    for axes, name in zip(panels, names, strict=False):
        axes.set_ylabel(_LABELS[name][1])
        _draw_quantity(axes, name, time, contacts)
        if name == "force":
            _draw_bounds(axes, time, estimates)
        if name in ("force", "angle", "arc", "axial"):
            _draw_fields(axes, name, time, estimates)
        if filtered is not None and name in ("angle", "arc", "axial", "force"):
            scale = _LABELS[name][0]
            smooth = [
                (t, scale * getattr(c, name))
                for t, found in zip(time, filtered, strict=True)
                for c in found
            ]
            label = "filtered"
            axes.plot(*_columns(smooth), ".", ms=2, color=SECOND, zorder=3, label=label)
    _draw_misfit(panels[-1], time, estimates)
    for axes in panels:
        axes.grid(alpha=0.3)
        if axes.get_legend_handles_labels()[0]:
            off = (1.0, 1.0)  # the data
            axes.legend(loc="upper left", bbox_to_anchor=off, fontsize="small", frameon=False)
    return written(figure, file)


def _draw_quantity(
    axes: Axes, name: str, time: Floats, contacts: Sequence[Sequence[Contact]]
) -> None:
    """A quantity of all contacts: points, bars of noise, a band of tolerances."""
    scale = _LABELS[name][0]
    shared = any(c.systematic is not None for found in contacts for c in found)
    label = "noise and tolerances, 95 %"
    for t, rows in _tracks(time, contacts) if shared else ():
        values = np.array([scale * getattr(c, name) for c in rows])
        whole = np.array([_BAND * scale * c.deviation(name) for c in rows])
        style: dict[str, Any] = {"color": FIRST, "alpha": 0.2, "label": label}
        if len(t) > 1:
            axes.fill_between(t, values - whole, values + whole, lw=0, **style)
        else:
            axes.vlines(t, values - whole, values + whole, lw=4, **style)
        label = "_"  # not once more in the legend
    seen = [(t, c) for t, found in zip(time, contacts, strict=True) for c in found]
    if not seen:
        return
    values = np.array([scale * getattr(c, name) for _, c in seen])
    bars = np.array([_BAND * scale * _noise(c, name) for _, c in seen])
    at, label = [t for t, _ in seen], "estimate, noise 95 %"
    axes.errorbar(at, values, bars, fmt=".", ms=3, lw=0.8, color=FIRST, label=label)
    _limit(axes, values, np.array([_BAND * scale * c.deviation(name) for _, c in seen]))


def _tracks(
    time: Floats, contacts: Sequence[Sequence[Contact]]
) -> Iterator[tuple[list[float], list[Contact]]]:
    """Times and contacts of frames that follow one another with the same number of contacts."""
    start = 0
    for k in range(1, len(contacts) + 1):
        if k == len(contacts) or len(contacts[k]) != len(contacts[start]):
            for rows in zip(*contacts[start:k], strict=True):
                yield list(time[start:k]), list(rows)
            start = k


def _noise(contact: Contact, name: str) -> float:
    """Standard deviation of a quantity by noise alone; NaN where unknown."""
    covariance = contact.noise_covariance
    if covariance is None:
        return float("nan")
    k = contact.names.index(name)
    return float(np.sqrt(max(covariance[k, k], 0.0)))


def _columns(rows: Sequence[tuple[float, float]]) -> tuple[list[float], list[float]]:
    return [x for x, _ in rows], [y for _, y in rows]


def _draw_misfit(axes: Axes, time: Floats, estimates: Sequence[LoadEstimate]) -> None:
    """Weighted squares of the residuals, a colour and a marker for each status."""
    markers = "os^vDPX*<>"
    for k, status in enumerate(sorted({e.status for e in estimates})):
        rows = [
            (t, e.chi2_per_dof)
            for t, e in zip(time, estimates, strict=True)
            if e.status == status
        ]
        axes.plot(*_columns(rows), markers[k % len(markers)], ms=3, label=status)
    axes.set(xlabel="time [s]", ylabel="χ² per degree\nof freedom")


def _draw_bounds(axes: Axes, time: Floats, estimates: Sequence[LoadEstimate]) -> None:
    """What acts at least where the wall takes the rest."""
    bounds = [
        (t, e.at_least) for t, e in zip(time, estimates, strict=True) if e.at_least is not None
    ]
    if bounds:
        axes.plot(*_columns(bounds), "^", ms=5, color=CONTACT, label="at least")


def _draw_fields(
    axes: Axes, name: str, time: Floats, estimates: Sequence[LoadEstimate]
) -> None:
    """Totals and centres of load fields, with what holds them in 95 of 100 cases."""
    told = [
        (t, getattr(e.field, name))
        for t, e in zip(time, estimates, strict=True)
        if e.field is not None and getattr(e.field, name) is not None
    ]
    if told:
        at = [t for t, _ in told]
        value, low, high = _LABELS[name][0] * np.array([known for _, known in told]).T
        axes.vlines(at, low, high, color=CONTACT, alpha=0.3, lw=2)
        axes.plot(at, value, "D", ms=3, color=CONTACT, label="load field, 95 %")


def _limit(axes: Axes, values: Floats, errors: Floats) -> None:
    """Show all values, and of their intervals what the few widest don't hide."""
    if not np.isfinite(errors).any():
        return
    shown = np.minimum(np.nan_to_num(errors), _LONGEST * np.nanmedian(errors))
    low, high = (values - shown).min(), (values + shown).max()
    margin = 0.05 * (high - low)
    if margin > 0:
        axes.set_ylim(low - margin, high + margin)
