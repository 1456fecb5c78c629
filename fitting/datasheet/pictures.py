"""Pictures of a data sheet: the skin with dimensions, figures over it, what tolerances do."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fitting.datasheet.figures import Measured
from fitting.datasheet.sheet import DataSheet
from fitting.datasheet.words import PLACED, WORDS
from suas_jax.config import SkinSpec, continuous_inputs
from suas_jax.config.quantities import format_quantity
from suas_jax.figures.outline import Outline, outline
from suas_jax.figures.style import BODY, FIRST, styled
from suas_jax.scene.parts import SkinParts, skin_parts

_MEMBRANE, _FILM, _TAXEL = "#4c78a8", "#f6e3ae", "#c44e00"


@styled
def plot_skin(spec: SkinSpec) -> Figure:
    """Draw a skin with electrodes to scale, with dimensions."""
    drawn = outline(spec.unloaded)
    drawn = drawn._replace(**{k: 1e3 * getattr(drawn, k) for k in ("inner", "outer", "wall")})
    parts = skin_parts(spec, continuous_inputs(spec))
    pad = spec.geometry.dimension == 3
    figure = Figure(figsize=(10, 4.2) if pad else (7.5, 4.6), layout="constrained")
    panels = figure.subplots(1, 2 if pad else 1, squeeze=False)[0]
    _section(panels[0], spec, drawn, parts)
    if pad:
        _plan(panels[1], spec, parts)
    for axes in panels:
        axes.set(aspect="equal")
        axes.set_axis_off()
    return figure


def _section(axes: Axes, spec: SkinSpec, drawn: Outline, parts: SkinParts) -> None:
    axes.fill(*drawn.wall, color=BODY, ec="0.5", lw=0.6)
    for face, other, color in (
        (drawn.inner, drawn.wall, _FILM),
        (drawn.inner, drawn.outer, _MEMBRANE),
    ):
        axes.fill(*np.concatenate([face, other[:, ::-1]], 1), color=color, lw=0)
    own = parts.sensing().taxels
    half = own.diameter / 2 / parts.geometry.wall_size
    for a, h in np.unique(np.concatenate([own.angle, half], 1), axis=0):
        along = np.linspace(a - h, a + h, 5)
        place = [np.interp(along, drawn.angle, x) for x in drawn.wall]
        axes.plot(*place, color=_TAXEL, lw=3, solid_capstyle="butt")
    x, y = drawn.wall.mean(1)
    count = len(own.angle)
    axes.text(x, y, f"rigid wall\n{count} taxels", ha="center", va="center", color=_TAXEL)
    left, right = drawn.inner[:, 0], drawn.inner[:, -1]
    for end in (left, right):
        axes.plot(*end, "s", color="0.3", ms=8)
    base, top = float(min(left[1], right[1])), drawn.outer[:, drawn.outer[1].argmax()]
    low, side = base - 0.12 * np.ptp(drawn.inner[0]), 1.08 * drawn.outer[0].max()
    _dimension(axes, (left[0], low), (right[0], low), "inside")
    _dimension(axes, (side, base), (side, top[1]))
    wide, high = np.ptp(drawn.outer[0]), top[1] - base
    axes.set(
        xlim=(drawn.outer[0].min() - 0.04 * wide, side + 0.12 * wide),
        ylim=(low - 0.14 * wide, base + 1.25 * high),
    )
    middle = len(drawn.angle) // 2
    inner, outer, wall = (x[:, middle] for x in (drawn.inner, drawn.outer, drawn.wall))
    g = spec.geometry
    for ends, name, size, height in (
        ((inner, outer), "membrane", g.thickness, 1.16),
        ((wall, inner), "oil", g.oil_gap, 1.07),
    ):
        varies = "" if isinstance(size, float) else " in the middle"
        axes.annotate(
            f"{name} {_length(float(np.linalg.norm(ends[1] - ends[0])))}{varies}",
            xy=tuple(sum(ends) / 2),
            xytext=(drawn.outer[0].min(), base + height * high),
            arrowprops={"arrowstyle": "-", "lw": 0.7},
        )
    arc = 1e3 * float(drawn.arc[-1] - drawn.arc[0])
    ends_are = "clamped" if g.dimension == 3 else "sliding"
    axes.text(
        x,
        low - 0.03 * wide,
        f"inner face {_length(arc)} along the arc,\n{_length(1e3 * float(g.width))} along the "
        f"axis, ends {ends_are}",
        ha="center",
        va="top",
    )


def _plan(axes: Axes, spec: SkinSpec, parts: SkinParts) -> None:
    """The unrolled wall with its taxels, axis upwards."""
    own, geometry = parts.sensing().taxels, parts.geometry
    half = 1e3 * float(geometry.wall_arc(geometry.half_angle)[0])
    across = 500 * spec.geometry.width
    axes.fill([-half, half, half, -half], [-across, -across, across, across], color=BODY)
    arc = 1e3 * np.asarray(geometry.wall_arc(own.angle))[:, 0]
    axes.scatter(arc, 1e3 * np.asarray(own.axial)[:, 0], s=6, color=_TAXEL)
    axes.set(xlim=(-1.1 * half, 1.4 * half), ylim=(-1.4 * across, 1.2 * across))
    _dimension(axes, (-half, -1.2 * across), (half, -1.2 * across), "along the wall")
    _dimension(axes, (1.1 * half, -across), (1.1 * half, across))


def _dimension(axes: Axes, a: Any, b: Any, words: str = "") -> None:
    """A dimension between two places [mm], across or upright."""
    axes.annotate("", xy=a, xytext=b, arrowprops={"arrowstyle": "<->", "lw": 0.8})
    x, y = (np.asarray(a) + b) / 2
    upright = a[0] == b[0]
    axes.annotate(
        f"{_length(float(np.hypot(*(np.asarray(a) - b))))} {words}".strip(),
        (x, y),
        (6, 0) if upright else (0, 4),
        textcoords="offset points",
        ha="left" if upright else "center",
        va="center" if upright else "bottom",
    )


def _length(value: float) -> str:
    """Of a length in millimetres."""
    return format_quantity(float(f"{1e-3 * value:.4g}"), "length")


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
    at, label = _along(measured)
    axes.plot(at, values, ".-", color=FIRST, lw=1.2, ms=4)
    factor = np.exp(1.96 * np.nan_to_num(deviation / values))
    axes.fill_between(at, values / factor, values * factor, alpha=0.2, lw=0)
    inside = at[measured.region]
    axes.axvspan(at[0], inside[0], color="0.5", alpha=0.12, lw=0)
    axes.axvspan(inside[-1], at[-1], color="0.5", alpha=0.12, lw=0)
    axes.set(xlabel=label, xlim=(at[0], at[-1]))
    if key in _LOGARITHMIC:
        axes.set_yscale("log")
    elif np.isfinite(values).any():
        axes.set_ylim(0, None)
    axes.grid(alpha=0.3)


def _map(axes: Axes, sheet: DataSheet, values: np.ndarray, figure: Figure) -> None:
    measured = sheet.measured
    places, label = _along(measured)
    axial = 1e3 * measured.coordinates["axial_m"]
    own = values[measured.region & np.isfinite(values)]
    ends = (own.min(), own.max()) if own.size else (None, None)  # clamps would hide the rest
    rows = (x.reshape(measured.grid) for x in (places, axial, values))
    drawn = axes.pcolormesh(*rows, shading="nearest", cmap="viridis")
    drawn.set_clim(*ends)
    figure.colorbar(drawn, ax=axes, shrink=0.85, extend="both")
    axes.set(xlabel=label, ylabel="axial [mm]")


def _along(measured: Measured) -> tuple[np.ndarray, str]:
    """Places along the arc, and what they are with their unit."""
    if "arc_m" in measured.coordinates:
        return 1e3 * measured.coordinates["arc_m"], "arc [mm]"
    return measured.coordinates["angle_deg"], "angle [deg]"


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
