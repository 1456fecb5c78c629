"""The search for the constants with the least sum of squares.

Two things are known only after a first fit: the noise of the readings, and how much stiffer or
softer each specimen is than the typical one. Readings are weighed by that noise, or divided by
the factors of their specimens, and the constants are sought again.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from fitting.material.experiments.free_zero import Zero
from fitting.material.experiments.measurements import Dataset
from fitting.material.fit.noise import noise_of, with_noise
from fitting.material.fit.problem import MaterialProblem, pose, predicted_readings
from fitting.material.fit.specimens import Specimens, of_typical_specimen, specimens_of
from fitting.material.laws.blocks import Relaxation, Softening
from fitting.material.laws.parameters import Family, block_of
from fitting.statistics.least_squares import (
    CONVERGED,
    Minima,
    judged,
    minimise,
    minimise_one_by_one,
    solved_by_scipy,
)
from fitting.statistics.residuals import AbstractResiduals, sensitivity
from suas_jax.config.quantities import format_quantity

_APART = 0.1  # how far like starts of a bulge test's fit are moved apart

# Starts of what is beside the law, and steps of each; the stiffness of a long-term law and of a
# virgin one over that of the data taken as elastic.
_BESIDE, _BESIDE_STEPS, _LONG_TERM, _VIRGIN = 6, 80, 0.7, 1.2

# Smallest shear modulus of a law over that of the least deformed readings: below it the search
# was on its way to zero, where no minimum is.
_LEAST_STIFFNESS = 1e-3

# Rounds of weighing by the estimated noise, which the fit itself then changes little.
_NOISE_ROUNDS = 2

_AT_BOUND = 1e-6


class NoFit(ArithmeticError):  # noqa: N818
    """No constants can be returned: every start failed, or the law has no stiffness at rest."""


def refuse_without_stiffness(
    sets: Sequence[Dataset], family: Family, constants: np.ndarray
) -> None:
    """Refuse constants [SI] that follow the data best, of a law without stiffness at rest.

    Raises NoFit: the law refuses the constants, or its shear modulus is below a thousandth of
    what the least deformed readings of every test suggest.
    """
    suggested = min((data.modulus for data in sets if data.modulus > 0.0), default=0.0)
    try:
        modulus = float(family.law(jnp.asarray(constants)).shear_modulus)
        if modulus > _LEAST_STIFFNESS * suggested:
            return
        found, wanted = (format_quantity(x, "stress") for x in (modulus, suggested))
        reason = f"its shear modulus is {found}, the least deformed readings suggest {wanted}"
    except ValueError as error:  # rounding leaves nothing of a sum such as C1 + C2
        reason = str(error)
    raise NoFit(
        f"{family.title}: follows the data best without stiffness at rest ({reason}); choose "
        f"another law"
    )


def most_starts(sets: Sequence[Dataset], starts: int) -> int:
    """How many starts a fit takes, of those asked for."""
    return min([starts, *(x.most_starts for x in sets if x.most_starts is not None)])


class SearchSettings(NamedTuple):
    """How constants are sought."""

    kind: str  # of the residuals
    starts: int  # number of starting points
    seed: int  # of their draw
    zero: tuple[str, ...]  # kinds of zeros of the tests that are found with the law


def search(
    sets: Sequence[Dataset],
    chosen: Family,
    settings: SearchSettings,
    zeros: Sequence[Zero] = (),  # of tests that are found with the law
) -> tuple[MaterialProblem, Minima]:
    """Minima from many starts, the best one first."""
    kind, starts, seed, _ = settings
    points = chosen.random(np.random.default_rng(seed), starts)
    problem = pose(sets, chosen, kind, zeros=zeros)
    if chosen.beside and not zeros:
        return problem, _with_effects(sets, chosen, problem, starts, seed)
    if any(data.mode == "bulge" for data in sets):
        # Membranes are expensive: explore with spherical caps, which then lead the way. The
        # plain guess may have membranes where the rough minima have none. What may be the same
        # is moved apart, so that it means something if both agree.
        caps = pose(sets, chosen, kind, estimate=True).residuals
        rough = minimise(caps, points).theta
        points = np.stack([rough[0], rough[:2][-1] + _APART, points[0], points[0] + _APART])
    return problem, minimise(problem.residuals, points[: most_starts(sets, starts)])


def _with_effects(
    sets: Sequence[Dataset], chosen: Family, problem: MaterialProblem, starts: int, seed: int
) -> Minima:
    """Minima of a law that relaxes or softens, from the best law without."""
    rng = np.random.default_rng(seed)
    base = dataclasses.replace(chosen, beside=())
    elastic = pose(sets, base, problem.kind, estimate=True).residuals
    found = minimise(elastic, base.random(rng, starts))
    if not np.isfinite(found.cost[0]):
        return found
    theta = jnp.asarray(found.theta[0])
    factor = 1.0 if block_of(chosen, Relaxation) is None else _LONG_TERM
    factor *= 1.0 if block_of(chosen, Softening) is None else _VIRGIN
    constants = base.constants(theta, elastic.scales)
    changed = jnp.where(base.stresses, factor * constants, constants)
    law = np.asarray(base.unconstrained(changed, elastic.scales))
    count = min(starts, _BESIDE)
    beside = np.concatenate([block.random(rng, count) for block in chosen.beside], axis=1)
    points = np.concatenate([np.tile(law, (len(beside), 1)), beside], axis=1)
    return minimise_one_by_one(problem.residuals, points, _BESIDE_STEPS)


def weighed_search(
    sets: Sequence[Dataset], chosen: Family, settings: SearchSettings, zeros: Sequence[Zero]
) -> tuple[MaterialProblem, Minima]:
    """The search, with readings weighed by their noise where it is to be estimated.

    Residuals of the kind "estimated" are weighed; the noise stands beside the problem's data.
    """
    if settings.kind != "estimated":
        return search(sets, chosen, settings, zeros)
    problem, minima = search(sets, chosen, settings._replace(kind="relative"), zeros)
    for _ in range(_NOISE_ROUNDS):
        if not np.isfinite(minima.cost[0]):
            break
        scales = problem.residuals.scales
        constants = np.asarray(chosen.constants(jnp.asarray(minima.theta[0]), scales))
        sizes = predicted_readings(problem, constants)
        known = with_noise(problem.sets, noise_of(problem, constants), sizes)
        posed = pose(known, chosen, "noise", zeros=zeros)
        minima = minimise(posed.residuals, minima.theta)
        problem = dataclasses.replace(posed, kind="estimated")
    return problem, minima


def search_for_typical_specimen(
    chosen: Family, problem: MaterialProblem, minima: Minima, settings: SearchSettings
) -> tuple[Specimens | None, MaterialProblem, Minima]:
    """The search for the typical specimen's constants, if the specimens differ.

    Returns the specimens' factors, the problem, of data over their factors where the specimens
    differ, and its minima.
    """

    def found_with(known: np.ndarray | None) -> Specimens | None:
        theta, scales = jnp.asarray(minima.theta[0]), problem.residuals.scales
        return specimens_of(problem, np.asarray(chosen.constants(theta, scales)), known)

    found = found_with(None)
    if found is None or not found.differ:
        return found, problem, minima
    typical = of_typical_specimen(problem.sets, found)
    problem, minima = weighed_search(typical, chosen, settings, ())
    return found_with(found.factors) if np.isfinite(minima.cost[0]) else None, problem, minima


def minimise_in_box(
    residuals: AbstractResiduals,
    family: Family,  # the law, which may bind the signs of constants
    constants: np.ndarray,  # the free minimum, SI units; its signs are kept
    others: np.ndarray,  # further starting points θ, shape [k, p]
    bounds: Mapping[str, tuple[float, float]],  # lowest and highest value by constant, SI units
) -> tuple[np.ndarray, Minima, tuple[str, ...]]:
    """Minimise ½ Σ r² with some constants kept between bounds, by SciPy's trust region.

    Bounds are on the constants themselves (pascals, exponents), where a person puts them,
    beside sign conditions of the law.

    Returns constants, what the starts in the box found, and which constants are at a bound.
    Raises ValueError: a bound names no constant of the law, or excludes every allowed value.
    """
    points = [constants] + [
        family.ordered(np.asarray(residuals.constants(jnp.asarray(theta)))) for theta in others
    ]
    found = []
    for point in points:
        low, high = _box(family, point, bounds)
        found.append((*_solve(residuals, point, low, high), low, high))
    found.sort(key=lambda run: run[1])
    best, _, _, low, high = found[0]
    reach = _AT_BOUND * np.maximum(np.abs(best), 1e-12)
    stuck = (best - low <= reach) | (high - best <= reach)
    names = tuple(name for name, at in zip(family.names, stuck, strict=True) if at)
    theta = [np.asarray(residuals.unconstrained(jnp.asarray(run[0]))) for run in found]
    cost, decrease = (np.array([run[i] for run in found]) for i in (1, 2))
    return best, Minima(np.stack(theta), cost, decrease <= CONVERGED, decrease), names


def _box(
    family: Family, point: np.ndarray, bounds: Mapping[str, tuple[float, float]]
) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of every constant: the user's, and the signs of the law's conditions."""
    for name in bounds:
        if name not in family.names:
            raise ValueError(
                f"--bound {name}: {family.title} has no such constant; allowed: "
                f"{', '.join(family.names)}"
            )
    low, high = family.signs(point, bounds)
    for i, name in enumerate(family.names):
        if name in bounds:
            low[i], high[i] = max(low[i], bounds[name][0]), min(high[i], bounds[name][1])
        if not low[i] < high[i]:
            raise ValueError(
                f"--bound {name}={bounds[name][0]:g}:{bounds[name][1]:g}: no value in it is "
                f"allowed by the law's sign conditions"
            )
    return low, high


def _solve(
    residuals: AbstractResiduals, point: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, float, float]:
    """Constants, cost, and the relative decrease that a step inside the box predicts."""
    size = np.maximum(np.abs(point), 1e-6 * np.max(np.abs(point)))
    size = np.where(np.isfinite(high - low), np.maximum(size, 1e-3 * (high - low)), size)

    def scaled(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r, J = sensitivity(residuals, jnp.asarray(q * size))
        return np.asarray(r), np.asarray(J) * size

    margin = np.where(np.isfinite(high - low), 1e-3 * (high - low), 1e-3 * size)
    exact = {"xtol": 1e-14, "ftol": 1e-14, "gtol": 1e-14, "max_nfev": 4000}
    run = solved_by_scipy(
        scaled,
        np.clip(point, low + margin, high - margin) / size,
        bounds=(low / size, high / size),
        method="trf",
        **exact,
    )
    constants = np.clip(run.x * size, low, high)
    r, J = scaled(constants / size)
    # At a bound only a step back into the box counts.
    slope = J.T @ r
    reach = _AT_BOUND * np.maximum(np.abs(constants), 1e-12)
    free = ~((constants - low <= reach) & (slope > 0.0)) & ~(
        (high - constants <= reach) & (slope < 0.0)
    )
    return constants, *judged(r, J[:, free])
