"""Pictures of a data sheet: figures over the skin, and what each tolerance does."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fitting.datasheet.sheet import DataSheet
from fitting.datasheet.words import PLACED, WORDS
from suas_jax.figures.style import FIRST, styled

_SHOWN = (
    "range_N",
    "force_resolution_N",
    "place_resolution_m",
    "detection_limit_N",
    "sensitivity_counts_per_N",
    "two_point_m",
)
_LOGARITHMIC = {"range_N", "force_resolution_N", "place_resolution_m", "detection_limit_N"}
_MOST = 12  # tolerances that are drawn


@styled
def plot_places(sheet: DataSheet) -> Figure:
    """Figures over the arc, with their 95 % intervals; over a pad, as maps."""
    figure = Figure(figsize=(10, 5.6), layout="constrained")
    for axes, key in zip(figure.subplots(2, 3).ravel(), _SHOWN, strict=True):
        word = WORDS[key]
        if key in PLACED:
            values, deviation = (x / word.size for x in sheet.at[key])
        else:
            values, deviation = sheet.two_point / word.size, np.full_like(sheet.two_point, 0.0)
        axes.set_title(f"{word.title} [{word.unit}]", fontsize="medium")
        if "axial_m" in sheet.measured.coordinates:
            _map(axes, sheet, values, figure)
        else:
            _curve(axes, sheet, key, values, deviation)
    return figure


def _curve(
    axes: Axes, sheet: DataSheet, key: str, values: np.ndarray, deviation: np.ndarray
) -> None:
    measured = sheet.measured
    name, unit = (
        ("arc_m", "arc [mm]") if "arc_m" in measured.coordinates else ("", "angle [deg]")
    )
    at = 1e3 * measured.coordinates[name] if name else measured.coordinates["angle_deg"]
    axes.plot(at, values, ".-", color=FIRST, lw=1.2, ms=4)
    factor = np.exp(1.96 * np.nan_to_num(deviation / values))
    axes.fill_between(at, values / factor, values * factor, alpha=0.2, lw=0)
    inside = at[measured.region]
    axes.axvspan(at[0], inside[0], color="0.5", alpha=0.12, lw=0)
    axes.axvspan(inside[-1], at[-1], color="0.5", alpha=0.12, lw=0)
    axes.set(xlabel=unit, xlim=(at[0], at[-1]))
    if key in _LOGARITHMIC:
        axes.set_yscale("log")
    elif np.isfinite(values).any():
        axes.set_ylim(0, None)
    axes.grid(alpha=0.3)


def _map(axes: Axes, sheet: DataSheet, values: np.ndarray, figure: Figure) -> None:
    coordinates = sheet.measured.coordinates
    angle, axial = (np.unique(coordinates[k]) for k in ("angle_deg", "axial_m"))
    grid = values.reshape(len(angle), len(axial))
    own = values[sheet.measured.region & np.isfinite(values)]
    ends = (own.min(), own.max()) if own.size else (None, None)  # clamps would hide the rest
    drawn = axes.pcolormesh(angle, 1e3 * axial, grid.T, shading="nearest", cmap="viridis")
    drawn.set_clim(*ends)
    figure.colorbar(drawn, ax=axes, shrink=0.85, extend="both")
    axes.set(xlabel="angle [deg]", ylabel="axial [mm]")


@styled
def plot_tolerances(sheet: DataSheet) -> Figure:
    """What a standard deviation of each tolerance does to an estimated force, largest first."""
    order = sheet.order[:_MOST]
    size = [100 * abs(float(sheet.effects[i, 0])) for i in order]
    names = [sheet.variants.changes[i] for i in order]
    figure = Figure(figsize=(7, 0.6 + 0.32 * len(order)), layout="constrained")
    axes = figure.subplots()
    axes.barh(names, size, color=FIRST)
    for row, value in enumerate(size):
        axes.annotate(f" {value:.3g} %", (value, row), va="center", fontsize="small")
    axes.invert_yaxis()
    axes.set(xlabel="estimated force moves by [%]", xlim=(0, 1.15 * max([*size, 1e-9])))
    return figure
