"""Whether what a fit leaves is noise, and of which kind."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from fitting.material.experiments.measurements import Dataset
from fitting.material.fit.noise import Noise
from fitting.material.fit.problem import MaterialProblem
from fitting.statistics.diagnostics import Misfit, misfit
from fitting.statistics.noise_model import NoiseModel
from fitting.statistics.residuals import sensitivity


def noise_remark(sets: Sequence[Dataset], noise: Noise, residual: str) -> str:
    """What a report says where the data exclude the noise that was assumed."""
    parts = [
        f"{data.file}: {_in_words(model)}"
        for data, model in zip(sets, noise.models, strict=True)
        if model is not None and model.excludes_assumed
    ]
    return (
        f"the noise is not {residual}: {'; '.join(parts)}; intervals allow for it, and "
        f"--residual estimated weighs the readings by it"
    )


def _in_words(model: NoiseModel) -> str:
    relative, absolute = f"{100.0 * model.relative:.2g} %", f"{model.absolute / 1e6:.2g} MPa"
    kinds = {"relative": relative, "absolute": absolute, "both": f"{relative} and {absolute}"}
    return f"{kinds[model.kind]} ({model.kind})"


def judged_residuals(
    sets: Sequence[Dataset],
    problem: MaterialProblem,
    constants: np.ndarray,
    noise: Noise,
    *,
    known_noise: bool,
) -> Misfit:
    """Whether the residuals of a fit are more than noise of the model that fits it."""
    ratio = noise.ratio if noise.excluded and not known_noise else None
    shape, smooth = _residual_paths(sets, problem, constants, ratio)
    typical = float(np.sqrt(np.mean(np.asarray(_weighed_readings(problem)) ** 2)))
    return misfit(
        shape, len(constants), known_noise=known_noise, exact=1e-4 * typical, smooth=smooth
    )


def _residual_paths(
    sets: Sequence[Dataset],
    problem: MaterialProblem,
    constants: np.ndarray,
    ratio: np.ndarray | None = None,
) -> tuple[list[np.ndarray], list[tuple[np.ndarray, np.ndarray]]]:
    """Residuals of each test in the order in which it deforms.

    Returns:
        Them, and of tests that are one curve also residuals and derivatives on a scale that
        changes smoothly along it: where the scale is a share of the reading, noise and all,
        the same share of the prediction. Where the noise is not what the fit assumed, both
        are those of a step that weighs by the noise as it is.
    """
    residuals = problem.residuals
    r, J = (np.asarray(x) for x in sensitivity(residuals, jnp.asarray(constants)))
    if ratio is not None:
        return _paths_under_noise(sets, problem, r / ratio, J / ratio[:, None])
    size = np.abs(np.asarray(residuals.value))
    predicted = np.abs(np.asarray(residuals.value + residuals.misfit(jnp.asarray(r))))
    with np.errstate(divide="ignore", invalid="ignore"):
        factor = np.nan_to_num(np.clip(size / predicted, 0.5, 2.0), nan=1.0)
    share = size * np.asarray(residuals.inverse_scale)
    paths, smooth = [], []
    for data, place in zip(sets, problem.places, strict=True):
        for path in data.paths():
            order = place[path]
            paths.append(r[order])
            if data.is_curve:
                alike = np.isclose(share[order], np.median(share[order]), rtol=1e-6)
                w = np.where(alike & (alike.mean() > 0.5), factor[order], 1.0)
                smooth.append((w * r[order], w[:, None] * J[order]))
    return paths, smooth


def _paths_under_noise(
    sets: Sequence[Dataset], problem: MaterialProblem, r: np.ndarray, J: np.ndarray
) -> tuple[list[np.ndarray], list[tuple[np.ndarray, np.ndarray]]]:
    sizes = np.linalg.norm(J, axis=0)
    columns = J[:, sizes > 0.0] / sizes[sizes > 0.0]
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    u = u[:, s > 1e-10 * s[0]]
    r = r - u @ (u.T @ r)
    paths, smooth = [], []
    for data, place in zip(sets, problem.places, strict=True):
        for path in data.paths():
            paths.append(r[place[path]])
            if data.is_curve:
                smooth.append((r[place[path]], J[place[path]]))
    return paths, smooth


def _weighed_readings(problem: MaterialProblem) -> np.ndarray:
    residuals = problem.residuals
    return np.asarray(residuals.value * residuals.inverse_scale)[residuals.used]
