"""Fit a law to test data."""

from collections.abc import Mapping, Sequence

import jax.numpy as jnp
import numpy as np

from fitting.material.experiments.data_checks import (
    branches,
    contradictions,
    refuse_without_information,
    warnings_of,
)
from fitting.material.experiments.measurements import Dataset
from fitting.material.fit.problem import MaterialProblem, pose, settle
from fitting.material.fit.result import MaterialFit
from fitting.material.laws.registry import family
from fitting.statistics.diagnostics import misfit
from fitting.statistics.identifiability import uncertainty
from fitting.statistics.least_squares import Minima, minimise
from fitting.statistics.parameters import AbstractFamily
from fitting.statistics.residuals import sensitivity
from suas_jax.runtime.precision import require_float64

_STARTS_IN_BOX = 5
_SKIN_LANES = 4
# A reading is wrong by the square of how far its apex stretch still is from settled.
_BULGE_LANES, _BULGE_ROUNDS, _SETTLED = 2, 8, 3e-3


def fit_material(
    sets: Sequence[Dataset],
    law: str | AbstractFamily = "ogden",
    terms: int | None = None,
    *,
    residual: str = "relative",
    starts: int = 64,
    seed: int = 0,
    branch: str = "all",
    bounds: Mapping[str, tuple[float, float]] | None = None,
    remarks: Sequence[str] = (),
) -> MaterialFit:
    """Find the constants of a law that follow test data best.

    Args:
        sets: the data, from `datasets.load_dataset`.
        law: a value of `law` in [material], or a family of one's own.
        terms: number of terms, if the law has any.
        residual: "relative", "absolute" or "noise", see `problem.pose`.
        starts: number of starting points.
        seed: of the random starting points.
        branch: "all", or "loading" to leave unloading branches out.
        bounds: hard bounds by constant, SI units, such as {"alpha.0": (1, 3)}.
        remarks: warnings to carry into the report.

    Raises:
        ValueError: law, terms, residual, branch or bounds are not allowed.
        NoFit: no start gave finite residuals.
        Float64Error: float64 is off.
    """
    require_float64()
    chosen = law if isinstance(law, AbstractFamily) else family(law, terms)
    if starts < 1:
        raise ValueError(f"--starts {starts}: at least one is needed")
    notes = [*remarks]
    used = tuple(_on_branch(data, branch) for data in sets)
    for data in used:
        refuse_without_information(data)
    for data, kept in zip(sets, used, strict=True):
        notes += warnings_of(kept)
        if kept.size < data.size:
            notes.append(
                f"{data.file}: {data.size - kept.size} readings of unloading branches left out"
            )
    notes += contradictions(used)
    problem, minima = _search(used, chosen, residual, starts, seed)
    if not np.isfinite(minima.cost[0]):
        raise NoFit(
            f"{chosen.title}: none of {starts} starts gave finite stresses; check the units, "
            f"or choose another law"
        )
    if any(data.mode == "skin" for data in used):
        starts = min(starts, _SKIN_LANES)
    if problem.model_error and residual != "noise":
        notes.append(
            f"the lumped shell's own error, about {100.0 * problem.model_error:.2g} % of "
            f"displacement and pressure, is in no interval; state the noise and use "
            f"--residual noise, which allows for it"
        )
    scales = problem.residuals.scales
    constants = np.asarray(chosen.constants(jnp.asarray(minima.theta[0]), scales))
    constants = chosen.ordered(constants)
    at_bounds: tuple[str, ...] = ()
    if bounds:
        from fitting.statistics.bounded import minimise_in_box

        others = chosen.random(np.random.default_rng(seed + 1), _STARTS_IN_BOX)
        constants, minima, at_bounds = minimise_in_box(
            problem.residuals, chosen, constants, others, bounds
        )
        if at_bounds:
            notes.append(f"at a bound, and held there in all intervals: {', '.join(at_bounds)}")
    known_noise = residual == "noise"
    shape, smooth = _residual_paths(used, problem, constants)
    typical = float(np.sqrt(np.mean(np.asarray(_weighed_readings(problem)) ** 2)))
    judged_misfit = misfit(
        shape, chosen.size, known_noise=known_noise, exact=1e-4 * typical, smooth=smooth
    )
    judged = uncertainty(
        problem.residuals,
        constants,
        known_noise=known_noise,
        inflation=judged_misfit.inflation,
        held=at_bounds,
    )
    return MaterialFit(
        used, problem, constants, minima, judged, judged_misfit, starts, tuple(notes), at_bounds
    )


class NoFit(ArithmeticError):  # noqa: N818
    """No constants can be returned: every start failed."""


def _search(
    sets: Sequence[Dataset], chosen: AbstractFamily, kind: str, starts: int, seed: int
) -> tuple[MaterialProblem, Minima]:
    points = chosen.random(np.random.default_rng(seed), starts)
    problem = pose(sets, chosen, kind)
    if any(data.mode == "skin" for data in sets):
        # Every residual is an equilibrium, and the modulus is known from the start.
        return problem, minimise(problem.residuals, points[:_SKIN_LANES], lanes=_SKIN_LANES)
    if not any(data.mode == "bulge" for data in sets):
        return problem, minimise(problem.residuals, points)
    # Membranes are expensive: explore with spherical caps, then fit the best with
    # membranes, whose apex stretches follow the constants.
    found = minimise(pose(sets, chosen, kind, estimate=True).residuals, points)
    for _ in range(_BULGE_ROUNDS):
        if not np.isfinite(found.cost[0]):
            break
        best = chosen.constants(jnp.asarray(found.theta[0]), problem.residuals.scales)
        problem, change = settle(problem, np.asarray(best))
        if change < _SETTLED:
            break
        lanes = _BULGE_LANES
        nearer = minimise(problem.residuals, found.theta[:lanes], lanes=lanes, passes=0)
        if not np.isfinite(nearer.cost[0]):
            break
        found = nearer
    return problem, found


def _on_branch(data: Dataset, branch: str) -> Dataset:
    if branch == "all":
        return data
    if branch != "loading":
        raise ValueError(f"--branch {branch}: unknown; allowed: all, loading")
    return data.select(~branches(data).unloading)


def _residual_paths(
    sets: Sequence[Dataset], problem: MaterialProblem, constants: np.ndarray
) -> tuple[list[np.ndarray], list[tuple[np.ndarray, np.ndarray]]]:
    """Residuals of each test in the order in which it deforms.

    Returns:
        Them, and of tests that are one curve also residuals and derivatives on a scale that
        changes smoothly along it: where the scale is a share of the reading, noise and all,
        the same share of the prediction.
    """
    residuals = problem.residuals
    r, J = (np.asarray(x) for x in sensitivity(residuals, jnp.asarray(constants)))
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


def _weighed_readings(problem: MaterialProblem) -> np.ndarray:
    residuals = problem.residuals
    return np.asarray(residuals.value * residuals.inverse_scale)[residuals.used]
