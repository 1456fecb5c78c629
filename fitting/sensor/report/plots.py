"""Figure of a calibration: counts by taxel, residuals over the pad, corner of the constants."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from fitting.sensor.fit.result import SensorFit
from fitting.sensor.model.constants import SensorFamily
from fitting.sensor.model.counts import parts_of
from fitting.statistics.chain import Posterior
from suas_jax.figures.style import FIRST, styled, written

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST = 6
_DRAWS = 4000


@styled
def plot_sensor(
    fit: SensorFit, file: Path | None = None, posterior: Posterior | None = None
) -> Figure:
    """Draw predicted against measured counts, residuals over the pad, and the constants.

    The ending of the file chooses the figure's format. Samples of the constants, `posterior`,
    are drawn behind the ellipses of the fit.
    """
    figure = Figure(figsize=(12.0, 8.0), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=(3, 2), squeeze=False)[0]
    counts, pad = left.subplots(2, 1)
    _draw_counts(fit, counts)
    _draw_pad(fit, pad)
    _draw_corner(fit, right, posterior)
    figure.suptitle(f"Sensor calibration: {fit.status}")
    return written(figure, file)


def _draw_counts(fit: SensorFit, axes: "Axes") -> None:
    modules, numbers = fit.data.spec.sensing.taxel_names
    errors, measured = fit.errors, fit.data.so
    for i in range(len(modules)):
        used = np.isfinite(errors[i])
        if used.any():
            predicted = measured[i, used] + errors[i, used]
            label = f"{modules[i]}.{numbers[i]}" if len(modules) <= 20 else None
            colour = colormaps["viridis"](
                i / len(modules)
            )  # they have an order, and may be many
            axes.plot(measured[i, used], predicted, ".", ms=3, color=colour, label=label)
    ends = np.array(axes.get_xlim())
    axes.plot(ends, ends, "k-", lw=0.8)
    axes.set_xlabel("measured [counts]")
    axes.set_ylabel("predicted [counts]")
    if len(modules) <= 20:
        axes.legend(title="taxel", frameon=False, fontsize="x-small", ncols=2, markerscale=3)


def _draw_pad(fit: SensorFit, axes: "Axes") -> None:
    """Mean residual of every taxel over the unrolled wall."""
    constants = jnp.asarray(fit.constants)
    geometry, _, _, electrodes = parts_of(fit.data.spec, fit.problem.model.numbers(constants))
    taxels = electrodes.taxels
    wall = float(geometry.wall_size[0])
    count = len(fit.data.so)
    x = 1e3 * wall * np.broadcast_to(np.asarray(taxels.angle)[:, 0], count)
    y = 1e3 * np.broadcast_to(np.asarray(taxels.axial)[:, 0], count)
    used = np.isfinite(fit.errors)
    sums = np.where(used, fit.errors, 0.0).sum(1)
    mean = np.where(used.any(1), sums / np.maximum(used.sum(1), 1), np.nan)
    limit = float(np.nanmax(np.abs(mean), initial=1e-3))
    known = np.isfinite(mean)
    drawn = axes.scatter(
        x[known], y[known], c=mean[known], cmap="coolwarm", vmin=-limit, vmax=limit, s=90
    )
    axes.scatter(x[~known], y[~known], marker="x", color="0.5", label="masked")
    if (~known).any():
        axes.legend(frameon=False)
    axes.figure.colorbar(drawn, ax=axes, label="mean residual [counts]")
    axes.set_xlabel("along the arc, on the wall [mm]")
    axes.set_ylabel("axial [mm]")
    if not np.ptp(y):
        axes.set_yticks(y[:1])  # a row of taxels: no zoom into the same number


def _draw_corner(fit: SensorFit, figure: Any, posterior: Posterior | None) -> None:
    """Ellipses of one and two standard deviations of every pair, relative to the values."""
    shown = min(fit.family.size, _MOST)
    axes = figure.subplots(shown, shown, squeeze=False)
    sizes = np.where(fit.constants != 0, np.abs(fit.constants), fit.family.sizes)[:shown]
    scaled = 100 * 100 * fit.uncertainty.covariance[:shown, :shown] / np.outer(sizes, sizes)
    deviation = np.sqrt(np.diagonal(scaled))
    grid = np.linspace(-3.5, 3.5, 120)
    draws = np.zeros((0, shown))
    if posterior is not None:
        thinned = posterior.samples[:: max(1, len(posterior.samples) // _DRAWS)]
        first = SensorFamily(fit.family.parts[:shown])  # errors of presses come last
        found = np.asarray(jax.vmap(first.constants)(jnp.asarray(thinned[:, :shown])))
        draws = 100 * ((found - fit.constants[:shown]) / sizes)
    for row in range(shown):
        for column in range(shown):
            own = axes[row, column]
            if column > row:
                own.axis("off")
                continue
            if len(draws) and column < row:
                own.plot(draws[:, column], draws[:, row], ",", color=FIRST, alpha=0.5)
            if column == row:
                if len(draws):
                    _histogram(own, draws[:, row])
                own.plot(grid * deviation[row], np.exp(-0.5 * grid**2), "k-")
                own.set_yticks([])
            else:
                _ellipses(own, scaled[np.ix_([column, row], [column, row])])
            if row == shown - 1:
                own.set_xlabel(f"{fit.family.names[column]}\n[% of value]", fontsize="small")
            if column == 0 and row:
                own.set_ylabel(f"{fit.family.names[row]}\n[% of value]", fontsize="small")


def _histogram(axes: "Axes", draws: np.ndarray) -> None:
    """Samples, to the height of a Gaussian of one."""
    heights, edges = np.histogram(draws, bins=40)
    axes.stairs(heights / max(heights.max(), 1), edges, fill=True, color=FIRST, alpha=0.4)


def _ellipses(axes: "Axes", covariance: np.ndarray) -> None:
    values, vectors = np.linalg.eigh(covariance)
    angle = float(np.rad2deg(np.arctan2(vectors[1, 1], vectors[0, 1])))
    for level in (1.0, 2.0):
        width, height = 2 * level * np.sqrt(np.maximum(values[::-1], 0.0))
        axes.add_patch(Ellipse((0.0, 0.0), width, height, angle=angle, fill=False))
    reach = 3.0 * np.sqrt(np.diagonal(covariance))
    axes.set_xlim(-reach[0], reach[0])
    axes.set_ylim(-reach[1], reach[1])
