"""Figures of a material fit (data, law, 95 % band and residuals by mode) and of a data file."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from fitting.material.data.tables import Table
from fitting.material.experiments.history import HistoryTest
from fitting.material.experiments.measurements import PATHS, Dataset, StressTest
from fitting.material.fit.band import asked_stretches
from fitting.material.fit.bulk_modulus import ENERGY, BulkModulus
from fitting.material.fit.result import MaterialFit
from suas_jax.config.quantities import format_quantity
from suas_jax.figures.style import styled, written

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MARKERS = ("o", "s")
_POINTS = 120


@styled
def plot_material(
    fit: MaterialFit | None, file: Path | None = None, bulk: BulkModulus | None = None
) -> Figure:
    """Draw every mode's data with the fitted law, its band, and relative residuals.

    Modes that were not measured are drawn too: there the band says how little is known.

    `fit`: what to draw; None where there is a bulk modulus only. `bulk`: the bulk modulus, if
    there is one; its tests come last.
    """
    modes = []
    if fit is not None:
        modes = list(dict.fromkeys(data.mode for data in fit.sets))
        modes += [mode for mode in PATHS if mode not in modes]
    count = len(modes) + (bulk is not None)
    figure = Figure(figsize=(max(3.6 * count, 5.0), 6.0), layout="constrained")
    axes = figure.subplots(2, count, height_ratios=(3, 1), squeeze=False)
    titles = []
    if fit is not None:
        tests = list(zip(fit.sets, fit.misfits(), fit.half_widths(), strict=True))
        for mode, pair in zip(modes, axes.T, strict=False):
            _draw_mode(fit, mode, [test for test in tests if test[0].mode == mode], *pair)
        titles.append(f"{fit.family.title}, {fit.problem.kind} residuals: {fit.status}")
    if bulk is not None:
        _draw_bulk_modulus(bulk, *axes[:, -1])
        titles.append(f"bulk modulus {format_quantity(bulk.value, 'stress')}")
    figure.suptitle("; ".join(titles))
    return written(figure, file)


def _draw_bulk_modulus(bulk: BulkModulus, upper: "Axes", lower: "Axes") -> None:
    """Volumetric tests with the line of the bulk modulus."""
    for number, test in enumerate(bulk.sets):
        error = bulk.predict(test.coordinate) - test.value
        _draw_readings(test, error, upper, lower, f"C{number}")
    ratios = np.concatenate([test.coordinate for test in bulk.sets])
    ends = np.array([min(ratios.min(), 1.0), max(ratios.max(), 1.0)])
    low, high = bulk.interval(0.95)
    upper.plot(ends, bulk.predict(ends) / 1e6, "k-", lw=1.2, label=ENERGY)
    unit = (1.0 - ends) / 1e6
    upper.fill_between(ends, low * unit, high * unit, color="0.8", label="95 %")
    upper.set_title("volumetric")
    lower.set_xlabel(bulk.sets[0].abscissa_label)
    _finish(upper, lower)


def _draw_mode(
    fit: MaterialFit,
    mode: str,
    members: list[tuple[Dataset, np.ndarray, np.ndarray]],
    upper: "Axes",
    lower: "Axes",
) -> None:
    banded = mode in PATHS and all(
        isinstance(data, StressTest) and data.measure == "nominal" and not data.follows_history
        for data, *_ in members
    )
    if banded:
        _draw_band(fit, mode, [data for data, *_ in members], upper)
    for number, (data, error, half) in enumerate(members):
        _draw_readings(data, error, upper, lower, f"C{number}", None if banded else half)
    upper.set_title(mode.replace("_", " ") + ("" if members else " (not measured)"))
    lower.set_xlabel(members[0][0].abscissa_label if members else "stretch")
    if any(isinstance(data, HistoryTest) and data.is_relaxation for data, *_ in members):
        upper.set_xscale("log")
        lower.set_xscale("log")
        lower.set_xlim(upper.get_xlim())
    _finish(upper, lower)


def _finish(upper: "Axes", lower: "Axes") -> None:
    """Limits and names of the residuals, and the legend."""
    lower.set_ylabel("residual [%]")
    lower.axhline(0.0, color="0.6", lw=0.8)
    limit = max((np.max(np.abs(line.get_ydata())) for line in lower.lines), default=1.0)
    lower.set_ylim(-min(1.1 * limit, 100.0) - 0.1, min(1.1 * limit, 100.0) + 0.1)
    handles, labels = upper.get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    upper.legend(once.values(), once, frameon=False, fontsize="small")


def _draw_readings(
    data: Dataset,
    error: np.ndarray,
    upper: "Axes",
    lower: "Axes",
    colour: str,
    half: np.ndarray | None = None,
) -> None:
    """Readings and residuals; the law's own with its 95 % where no band is drawn, `half`."""
    channels = data.channels()
    size = np.maximum(data.own_size(), 1e-300)
    for (rows, unit, label), marker in zip(channels, _MARKERS, strict=False):
        x, y = data.abscissa[rows], data.value[rows]
        named = label if len(channels) > 1 else "data"
        upper.plot(x, y / unit, marker, ms=3.5, mfc="none", color=colour, label=named)
        if data.follows_history:
            for path in data.paths():
                series = (data.value + error)[path] / unit
                upper.plot(data.abscissa[path], series, "k-", lw=1.0, label="law")
        elif half is not None:
            law = f"law (95 %), {label}" if len(channels) > 1 else "law (95 %)"
            middle, known = (y + error[rows]) / unit, half[rows] / unit
            upper.errorbar(x, middle, known, fmt="x", ms=3.5, color="k", lw=0.8, label=law)
        share = 100.0 * error[rows] / size[rows]
        lower.plot(x, share, marker, ms=3, color=colour)
    if len(channels) == 1:
        upper.set_ylabel(channels[0].label)


def _draw_band(fit: MaterialFit, mode: str, sets: list[Dataset], axes: "Axes") -> None:
    if sets:
        low = min(float(np.exp(data.states[0].min())) for data in sets)
        high = max(float(np.exp(data.states[0].max())) for data in sets)
        stretch = np.linspace(min(low, 1.0), max(high, 1.0), _POINTS)
    else:
        asked = asked_stretches(fit, mode, fit.up_to)
        stretch = np.linspace(min(asked.min(), 1.0), asked.max(), _POINTS)
    band = fit.predict(mode, stretch)
    middle, half = band.nominal / 1e6, band.half_width / 1e6
    axes.plot(stretch, band.law / 1e6, "k-", lw=1.2, label="law")
    axes.fill_between(stretch, middle - half, middle + half, color="0.8", label="95 %")
    axes.set_ylabel("nominal stress [MPa]")
    if not sets:
        # A law that leaves the band leaves the figure, too.
        low, high = float((middle - half).min()), float((middle + half).max())
        axes.set_ylim(low - 0.1 * (high - low), high + 0.3 * (high - low))


@styled
def plot_data(table: Table, data: Dataset | None, file: Path | None = None) -> Figure:
    """Draw what was read: the test, or where it is incomplete its columns over the rows.

    `data`: the test, or None.
    """
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    if data is None:
        _draw_columns(figure, table)
    else:
        axes = figure.subplots()
        for channel in data.channels():
            for label in dict.fromkeys(data.specimen):
                rows = channel.rows & (data.specimen == label)
                x, y = data.abscissa[rows], data.value[rows] / channel.unit
                axes.plot(x, y, ".-", ms=3, lw=0.6, label=str(label) or "readings")
            axes.set_ylabel(channel.label)
        axes.set_xlabel(data.abscissa_label)
        axes.axhline(0.0, color="0.7", lw=0.6)
        axes.legend(frameon=False, fontsize="small")
    figure.suptitle(Path(table.file).name)
    return written(figure, file)


def _draw_columns(figure: Figure, table: Table) -> None:
    shown = [
        i for i, name in enumerate(table.names) if name and np.isfinite(table.cells[:, i]).any()
    ]
    axes = figure.subplots(len(shown) or 1, sharex=True, squeeze=False)
    for axis, i in zip(axes[:, 0], shown, strict=False):
        axis.plot(table.lines, table.cells[:, i], ".-", ms=3, lw=0.6)
        axis.set_ylabel(table.names[i], fontsize="small")
    axes[-1, 0].set_xlabel("line of the file")
