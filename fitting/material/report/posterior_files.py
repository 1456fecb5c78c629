"""Samples of the constants of a law: as ArviZ data, and as a corner plot."""

import inspect
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from fitting.material.fit.material_posterior import MaterialPosterior, sample_material
from fitting.material.fit.result import MaterialFit
from fitting.statistics.posterior import PosteriorError, Settings
from suas_jax.figures.style import styled
from suas_jax.figures.style import written as figure_written
from suas_jax.files.writing import written
from suas_jax.runtime.optional import optional


def to_arviz(found: MaterialPosterior) -> Any:
    """Samples after burn-in as ArviZ data: a chain a walker, constants in SI units.

    Raises ValueError: ArviZ is not installed.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)
        arviz = optional("arviz", "--arviz needs", "posterior")
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
    corner = optional("corner", "--corner needs", "posterior")
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


def sample_and_write(
    fit: MaterialFit,
    settings: Settings,
    bounds: Mapping[str, tuple[float, float]],
    show: Callable[[str], None],
    arviz: Path | None,
    corner: Path | None,
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
    return found.report
