"""The part of `suas fit material` that samples: files written beside the report."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from fitting.material.fit.material_posterior import sample_material
from fitting.material.fit.result import MaterialFit
from fitting.material.report.posterior_files import plot_corner, to_arviz
from fitting.statistics.posterior import PosteriorError, Settings
from suas_jax.files.writing import written


def run(
    fit: MaterialFit,
    bounds: Mapping[str, tuple[float, float]],
    show: Callable[[str], None],
    arviz: Path | None,
    corner: Path | None,
    predictive: Path | None = None,
    **settings: Any,
) -> dict[str, Any]:
    """Sample around a fit, write what was asked for, and return the report."""

    def progress(step: int, steps: int, tau: float) -> None:
        known = f", autocorrelation time {tau:.0f}" if tau < float("inf") else ""
        show(f"posterior: step {step} of at most {steps}{known}")

    try:
        found = sample_material(fit, Settings(**settings), bounds, progress)
    except PosteriorError as error:
        return {"converged": False, "status": "no_posterior", "message": str(error)}
    if arviz is not None:
        with written(arviz) as draft:
            draft.unlink()  # HDF5 makes its files itself
            to_arviz(found).to_netcdf(str(draft), engine="h5netcdf")
    if corner is not None:
        plot_corner(found, corner)
    if predictive is not None:
        from fitting.material.report.predictive_plot import plot_predictive

        show("posterior predictive plot")
        plot_predictive(found, predictive)
    return found.report
