"""Picture of a skin's range of forces."""

from pathlib import Path

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from fitting.force_range.bound import TOLD, ForceRange
from fitting.force_range.pad import PadForceRange
from suas_jax.figures.style import CONTACT, styled, written

_WIDEST = 100.0  # largest value that is told from others in terms of the smallest


@styled
def plot_range(found: ForceRange, file: Path | None = None) -> Figure:
    """Draw first contact over the skin, and the least error of a force before and after."""
    figure = Figure(figsize=(11, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    at, what = found.along.shown(found.angle)
    left.plot(at, found.first_contact, "o-", ms=3, color=CONTACT, label="first contact")
    left.fill_between(
        at, found.smallest, found.largest, alpha=0.2, label=f"measurable to {TOLD:.0%}"
    )
    left.plot(at, found.saturation, "x", color="k", label="a taxel saturates")
    left.set(xlabel=what, ylabel="force [N]", yscale="log")
    left.legend()
    known = np.flatnonzero(np.isfinite(found.first_contact))
    for i in known[:: max(1, len(known) // 5)]:
        relative = found.force_error[i] / found.force[i]
        label = f"{at[i]:.3g}"
        right.plot(found.force[i] / found.first_contact[i], relative, marker=".", label=label)
    right.axvline(1.0, color="0.5", lw=1)
    right.axhline(TOLD, color="0.5", lw=1, ls="--")
    right.set(
        xlabel="force over that of first contact",
        ylabel="least standard deviation of the force, relative",
        xscale="log",
        yscale="log",
    )
    right.legend(title=what)
    for axes in (left, right):
        axes.grid(alpha=0.3)
    return written(figure, file)


@styled
def plot_pad_range(found: PadForceRange, file: Path | None = None) -> Figure:
    """Draw first contact, the force that can be told and the least errors over a pad."""
    figure = Figure(figsize=(12, 8.6), layout="constrained")
    force = found.reference
    relative = 100 * found.error[2][..., -1] / force
    maps = (
        (found.first_contact, "force of first contact [N]"),
        (found.smallest, f"force measurable to {TOLD:.0%} from [N]"),
        (1e3 * found.position_error[..., -1], f"error of the place at {force:g} N [mm]"),
        (relative, f"error of the force at {force:g} N [%]"),
    )
    (places, what), axial = found.along.shown(found.angle), 1e3 * found.axial
    for axes, (values, label) in zip(figure.subplots(2, 2).flat, maps, strict=True):
        shown = np.ma.masked_invalid(values.T)
        low = np.nanmin(values, initial=np.inf)
        high = min(np.nanmax(values, initial=0.0), _WIDEST * low)
        norm = LogNorm(low, high) if low > 0 and high > 4 * low else None
        if not np.isfinite(low):
            axes.set_title(f"{label}: nowhere")
            continue
        limits = {"norm": norm} if norm else {"vmin": low, "vmax": high}
        image = axes.pcolormesh(places, axial, shown, shading="gouraud", **limits)
        steps = np.geomspace if norm else np.linspace
        levels = steps(low, high, 7)[1:-1]
        if min(values.shape) > 1 and high > low:
            lines = axes.contour(places, axial, shown, levels, colors="w", linewidths=0.8)
            axes.clabel(lines, fmt="%.2g", fontsize=8)
        taxels = found.along.shown(found.taxels[:, 0])[0], 1e3 * found.taxels[:, 1]
        axes.plot(*taxels, ".", ms=2, color="w", alpha=0.6)
        axes.set(xlabel=what, ylabel="along the axis [mm]", title=label)
        beyond = "max" if np.nanmax(values) > high else "neither"
        bar = figure.colorbar(image, ax=axes, extend=beyond, format="%g")
        if norm:
            bar.set_ticks(LogLocator(subs=(1, 2, 5)))
            bar.minorticks_off()
    figure.suptitle(
        f"A contact of {1e3 * found.diameter:g} mm; least standard deviations from "
        f"{found.noise:.2g} counts of noise; dots: taxels"
    )
    return written(figure, file)
