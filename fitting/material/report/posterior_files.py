"""Samples of the constants of a law: as ArviZ data, as a corner plot, and what they predict.

Where a band of predicted readings does not hold 95 % of the data, law or noise are wrong.
"""

import inspect
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from matplotlib.figure import Figure

from fitting.material.experiments.measurements import Channel, Dataset
from fitting.material.fit.material_posterior import MaterialPosterior, sample_material
from fitting.material.fit.problem import Residuals
from fitting.material.fit.result import MaterialFit
from fitting.statistics.posterior import PosteriorError, Settings
from suas_jax.figures.style import styled
from suas_jax.figures.style import written as figure_written
from suas_jax.files.writing import written
from suas_jax.runtime.compiled import COMPILED

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_DRAWS, _REPEATS = 64, 32
_ENDS = (2.5, 97.5)


def to_arviz(found: MaterialPosterior) -> Any:
    """Samples after burn-in as ArviZ data: a chain a walker, constants in SI units.

    Raises ValueError: ArviZ is not installed.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FutureWarning)
            import arviz
    except ImportError:
        raise ValueError('--arviz needs ArviZ: pip install "suas-jax[posterior]"') from None
    posterior = found.posterior
    kept = posterior.chain[posterior.burn_in :].swapaxes(0, 1)
    values = found.constants(kept.reshape(-1, kept.shape[-1])).reshape(*kept.shape[:2], -1)
    columns = {name: values[..., i] for i, name in enumerate(found.fit.family.names)}
    if not found.noise_known:
        columns["noise"] = np.exp(kept[..., -1])
    statistics = {"lp": posterior.log_probability[posterior.burn_in :].T}
    groups: dict[str, Any] = {"posterior": columns, "sample_stats": statistics}
    # Since ArviZ 1 the groups are one argument.
    if "data" in inspect.signature(arviz.from_dict).parameters:
        return arviz.from_dict(groups)
    return arviz.from_dict(**groups)


@styled
def plot_corner(found: MaterialPosterior, file: Path) -> None:
    """Write a corner plot of the constants (MPa or plain numbers).

    Raises ValueError: corner is not installed.
    """
    try:
        import corner
    except ImportError:
        raise ValueError('--corner needs corner: pip install "suas-jax[posterior]"') from None
    family = found.fit.family
    size = np.array([1e6 if unit == "Pa" else 1.0 for unit in family.units])
    labels = [
        f"{name} [MPa]" if unit == "Pa" else name
        for name, unit in zip(family.names, family.units, strict=True)
    ]
    count = family.size
    figure = Figure(figsize=(2.2 * count + 1, 2.2 * count + 1))
    draws = found.constants(found.posterior.samples) / size
    corner.corner(
        draws, labels=labels, truths=found.fit.constants / size, fig=figure, show_titles=True
    )
    figure_written(figure, file)


@styled
def plot_predictive(found: MaterialPosterior, file: Path | None = None) -> Figure:
    """Draw the posterior's predictions over the data.

    Returns one panel a test (two for a skin: displacement and oil pressure), with the 95 % band
    of the law (dark) and of single readings (light). Modes that were not measured have one band
    only, that of `plots.plot_material`.
    """
    theta = found.posterior.draws(_DRAWS)
    constants = jnp.asarray(found.constants(theta))
    residuals = found.fit.problem.residuals
    law = np.asarray(COMPILED.run(_readings, residuals, constants, once=True))
    readings = np.tile(law, (_REPEATS, 1)) + _noise(found, np.tile(theta, (_REPEATS, 1)))
    panels = [
        (data, place, channel)
        for data, place in found.fit.problem.tests
        for channel in data.channels()
    ]
    figure = Figure(figsize=(3.8 * len(panels), 3.6), layout="constrained")
    axes = figure.subplots(1, len(panels), squeeze=False)[0]
    for ax, (data, place, channel) in zip(axes, panels, strict=True):
        rows = place[channel.rows]
        _draw_test(ax, data, channel, law[:, rows], readings[:, rows])
    noise = "known" if found.noise_known else "inferred"
    figure.suptitle(f"{found.fit.family.title}: 95 % posterior predictive, noise {noise}")
    return figure_written(figure, file)


@eqx.filter_jit
def _readings(residuals: Residuals, constants: Float[Array, "draw p"]) -> Array:
    return jax.vmap(residuals.predict)(constants)


def _noise(found: MaterialPosterior, theta: np.ndarray) -> np.ndarray:
    """Noise of single readings as the posterior has it, shape [draw, n]."""
    inverse = np.asarray(found.fit.problem.residuals.inverse_scale)
    scale = np.where(inverse > 0.0, 1.0 / np.where(inverse > 0.0, inverse, 1.0), 0.0)
    level = np.ones(len(theta)) if found.noise_known else np.exp(theta[:, -1])
    random = np.random.default_rng(0).standard_normal((len(theta), len(scale)))
    return level[:, None] * scale * random


def _draw_test(
    ax: "Axes", data: Dataset, channel: Channel, law: np.ndarray, readings: np.ndarray
) -> None:
    unit, x = channel.unit, data.abscissa[channel.rows]
    low, high = np.percentile(readings, _ENDS, axis=0) / unit
    inner = np.percentile(law, _ENDS, axis=0) / unit
    if data.is_curve:
        order = np.argsort(x, kind="stable")
        ax.fill_between(x[order], low[order], high[order], color="0.85", label="readings")
        ax.fill_between(x[order], *inner[:, order], color="0.55", label="law")
    else:
        ax.vlines(x, low, high, color="0.8", lw=3.0, label="readings")
        ax.vlines(x, *inner, color="0.5", lw=3.0, label="law")
    ax.plot(x, data.value[channel.rows] / unit, "o", ms=3.5, mfc="none", label="data")
    ax.set(title=data.mode.replace("_", " "), xlabel=data.abscissa_label, ylabel=channel.label)
    ax.legend(frameon=False, fontsize="small")


def sample_and_write(
    fit: MaterialFit,
    settings: Settings,
    bounds: Mapping[str, tuple[float, float]],
    show: Callable[[str], None],
    arviz: Path | None,
    corner: Path | None,
    predictive: Path | None,
) -> dict[str, Any]:
    """Sample around a fit, write what was asked for, and return the report."""

    def progress(step: int, steps: int, tau: float) -> None:
        known = f", autocorrelation time {tau:.0f}" if tau < float("inf") else ""
        show(f"posterior: step {step} of at most {steps}{known}")

    try:
        found = sample_material(fit, settings, bounds, progress)
    except PosteriorError as error:
        return {"converged": False, "status": "no_posterior", "message": str(error)}
    if arviz is not None:
        with written(arviz) as draft:
            draft.unlink()  # HDF5 makes its files itself
            to_arviz(found).to_netcdf(str(draft), engine="h5netcdf")
    if corner is not None:
        plot_corner(found, corner)
    if predictive is not None:
        show("posterior predictive plot")
        plot_predictive(found, predictive)
    return found.report
