"""Noise of the data sets of a fit, and whether what the fit leaves is that noise."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from fitting.material.experiments.measurements import Dataset
from fitting.material.fit.problem import MaterialProblem, Residuals, readings
from fitting.statistics.diagnostics import Misfit, misfit
from fitting.statistics.noise_model import NoiseModel, estimate_noise
from fitting.statistics.residuals import sensitivity


@dataclasses.dataclass(frozen=True)
class Noise:
    """The noise of all readings of a fit."""

    models: tuple[NoiseModel | None, ...]  # of each data set; None where it can't be estimated
    # standard deviation of each residual over that of the whole, shape [n] with padding; one
    # where the assumed noise stands
    ratio: np.ndarray
    excluded: bool  # whether the assumed noise is excluded by one of the data sets

    def report(self, sets: Sequence[Dataset]) -> list[dict[str, Any]]:
        """One entry a data set, for JSON."""
        return [
            {
                "file": data.file,
                "kind": model.kind,
                "absolute_Pa": model.absolute,
                "relative": model.relative,
                "excludes_assumed": model.excludes_assumed,
            }
            for data, model in zip(sets, self.models, strict=True)
            if model is not None
        ]


def noise_of(problem: MaterialProblem, constants: np.ndarray) -> Noise:
    """Estimate the noise of each data set from the residuals of a fit."""
    residuals = problem.residuals
    predicted, r = (np.asarray(x) for x in readings(residuals, jnp.asarray(constants)))
    error = predicted - np.asarray(residuals.value)
    inverse = np.asarray(residuals.inverse_scale)
    return noise_among(problem.tests, error, predicted, inverse, r)


def noise_among(
    tests: Sequence[tuple[Dataset, np.ndarray]],  # with the places of their readings among all
    error: np.ndarray,  # predicted less measured readings
    predicted: np.ndarray,
    inverse: np.ndarray,  # of the scale of each residual
    r: np.ndarray,  # the residuals
) -> Noise:
    """Estimate the noise of each test; all arrays are of all readings [n]."""
    models = [estimated_noise(t, error[k], predicted[k], inverse[k]) for t, k in tests]
    excluded = any(model is not None and model.excludes_assumed for model in models)
    ratio = np.ones(len(error))
    for (data, place), model in zip(tests, models, strict=True):
        if model is not None and model.excludes_assumed:
            # Of a mean of several readings, which count as often, it is that of one of them.
            sigma = model.deviation(predicted[place]) * inverse[place] / np.sqrt(data.weight)
            ratio[place] = np.maximum(sigma, 1e-6 * np.max(sigma))
        elif excluded:
            # Residuals of all data sets share one factor, that of the assumed noise elsewhere.
            ratio[place] = float(np.sqrt(np.mean(r[place] ** 2))) or 1.0
    return Noise(tuple(models), ratio, excluded)


def with_noise(sets: Sequence[Dataset], noise: Noise, sizes: list[np.ndarray]) -> list[Dataset]:
    """The data sets with the estimated noise of predicted readings as their stated one.

    Raises ValueError: the noise of a data set can't be estimated.
    """
    found = []
    for data, model, size in zip(sets, noise.models, sizes, strict=True):
        if model is None:
            raise ValueError(
                f"{data.file}: --residual estimated needs some 12 readings along one curve "
                f"that scatter; use relative or absolute"
            )
        sigma = model.deviation(size)
        sigma = np.maximum(sigma, 1e-3 * np.max(sigma))
        found.append(dataclasses.replace(data, sigma=sigma))
    return found


def estimated_noise(
    data: Dataset, error: np.ndarray, predicted: np.ndarray, inverse: np.ndarray
) -> NoiseModel | None:
    """The noise of a test that is one curve; None where it can't be estimated.

    `error`: predicted less measured readings. `inverse`: of the scale of each residual.
    """
    if not data.is_curve or np.any(inverse <= 0.0) or len(data.paths()) != 1:
        return None
    (order,) = data.paths()
    weight = data.weight[order]
    # A reading of weight w is as good as w readings.
    assumed = 1.0 / (inverse[order] / np.sqrt(weight))
    return estimate_noise(error[order], predicted[order], assumed, data.order[order], weight)


def noise_remark(sets: Sequence[Dataset], noise: Noise, residual: str) -> str:
    """What a report says where the data exclude the noise that was assumed."""
    parts = []
    for data, model in zip(sets, noise.models, strict=True):
        if model is not None and model.excludes_assumed:
            relative, absolute = (
                f"{100.0 * model.relative:.2g} %",
                f"{model.absolute / 1e6:.2g} MPa",
            )
            both = {"relative": relative, "absolute": absolute}
            size = both.get(model.kind, f"{relative} and {absolute}")
            parts.append(f"{data.file}: {size} ({model.kind})")
    return (
        f"the noise is not {residual}: {'; '.join(parts)}; intervals allow for it, and "
        f"--residual estimated weighs the readings by it"
    )


def judged_residuals(
    problem: MaterialProblem, constants: np.ndarray, noise: Noise, *, known_noise: bool
) -> Misfit:
    """Whether the residuals of a fit are more than noise of the model that fits it.

    They are judged along each test as it deforms; of tests that are one curve also on a scale
    that changes smoothly along it: where the scale is a share of the reading, noise and all,
    the same share of the prediction. Where the noise is not what the fit assumed, they are
    those of a step that weighs by the noise as it is.
    """
    residuals = problem.residuals
    r, J = (np.asarray(x) for x in sensitivity(residuals, jnp.asarray(constants)))
    if noise.excluded and not known_noise:
        r, J = r / noise.ratio, J / noise.ratio[:, None]
        sizes = np.linalg.norm(J, axis=0)
        u, s, _ = np.linalg.svd(J[:, sizes > 0.0] / sizes[sizes > 0.0], full_matrices=False)
        u = u[:, s > 1e-10 * s[0]]
        r = r - u @ (u.T @ r)
        smooth_r, smooth_J = r, J
    else:
        orders = [place[path] for data, place in problem.tests for path in data.paths()]
        smooth_r, smooth_J = on_smooth_scale(residuals, orders, r, J)
    paths, smooth = [], []
    for data, place in problem.tests:
        for order in (place[path] for path in data.paths()):
            paths.append(r[order])
            if data.is_curve:
                smooth.append((smooth_r[order], smooth_J[order]))
    weighed = np.asarray(residuals.value * residuals.inverse_scale)[residuals.used]
    exact = 1e-4 * float(np.sqrt(np.mean(weighed**2)))
    return misfit(paths, len(constants), known_noise=known_noise, exact=exact, smooth=smooth)


def on_smooth_scale(
    residuals: Residuals,
    orders: Sequence[np.ndarray],  # positions of each path's readings
    r: np.ndarray,
    J: np.ndarray,  # derivatives of r by the constants
) -> tuple[np.ndarray, np.ndarray]:
    """Residuals and derivatives over shares of predictions, not of noisy readings.

    Errors that readings share are taken out before and put in after: they bring the scale of
    one reading, noise and all, into the derivatives of all.
    """
    size = np.abs(np.asarray(residuals.value))
    predicted = np.abs(np.asarray(residuals.value + residuals.misfit(jnp.asarray(r))))
    with np.errstate(divide="ignore", invalid="ignore"):
        factor = np.nan_to_num(np.clip(size / predicted, 0.5, 2.0), nan=1.0)
    share = size * np.asarray(residuals.inverse_scale)
    weight = np.ones(len(r))
    for order in orders:
        alike = np.isclose(share[order], np.median(share[order]), rtol=1e-6)
        weight[order] = np.where(alike & (alike.mean() > 0.5), factor[order], 1.0)

    def weighed(x: Array) -> Array:
        return residuals.weighed(residuals.misfit(x) * weight)

    own, slope = weighed(jnp.asarray(r)), jax.vmap(weighed, 1, 1)(jnp.asarray(J))
    return np.asarray(own), np.asarray(slope)
