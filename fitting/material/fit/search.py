"""The search for the constants with the least sum of squares.

Two things are known only after a first fit: the noise of the readings, and how much stiffer or
softer each specimen is than the typical one. Readings are weighed by that noise, or divided by
the factors of their specimens, and the constants are sought again.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from fitting.material.experiments.free_zero import Zero
from fitting.material.experiments.measurements import Dataset
from fitting.material.fit.noise import noise_of, with_noise
from fitting.material.fit.problem import MaterialProblem, Residuals, pose, predicted_readings
from fitting.material.fit.specimens import Specimens, of_typical_specimen, specimens_of
from fitting.material.laws.blocks import Relaxation, Softening
from fitting.material.laws.parameters import Family, block_of
from fitting.statistics.least_squares import (
    Minima,
    minimise,
    minimise_one_by_one,
    solved_by_scipy,
)
from fitting.statistics.residuals import AbstractResiduals, by_theta
from suas_jax.config.quantities import format_quantity

# Of a bulge test's fit: most evaluations of a start by either method, how far like starts are
# moved apart, and the largest parameter that a minimum may have.
_BULGE_STEPS, _APART, _FARTHEST = 40, 0.1, 300.0

# Starts of what is beside the law, and steps of each; the stiffness of a long-term law and of a
# virgin one over that of the data taken as elastic.
_BESIDE, _BESIDE_STEPS, _LONG_TERM, _VIRGIN = 6, 80, 0.7, 1.2

# Smallest shear modulus of a law over that of the least deformed readings: below it the search
# was on its way to zero, where no minimum is.
_LEAST_STIFFNESS = 1e-3

# Rounds of weighing by the estimated noise, which the fit itself then changes little.
_NOISE_ROUNDS = 2


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
    most = most_starts(sets, starts)
    if any(data.mode == "indentation" for data in sets):
        return problem, minimise_one_by_one(problem.residuals, points[:most])
    if any(data.mode == "skin" for data in sets):
        return problem, minimise(problem.residuals, points[:most], lanes=most)
    if chosen.beside and not zeros:
        return problem, _with_effects(sets, chosen, problem, starts, seed)
    if not any(data.mode == "bulge" for data in sets):
        return problem, minimise(problem.residuals, points)
    # Membranes are expensive: explore with spherical caps, which then lead the way.
    caps = pose(sets, chosen, kind, estimate=True).residuals
    rough = minimise(caps, points, finish=False).theta
    # The plain guess may have membranes where the rough minima have none. What may be the same
    # is moved apart, so that it means something if both agree.
    some = [rough[0], rough[:2][-1] + _APART, points[0], points[0] + _APART]
    return problem, _with_membranes(problem.residuals, caps, some)


def _with_membranes(
    membranes: Residuals, caps: Residuals, starts: Sequence[np.ndarray]
) -> Minima:
    """Minima from a few starts, one after the other until two agree."""
    found: list[Minima] = []
    for start in starts:
        near = minimise_corrected(membranes, caps, start, _BULGE_STEPS)
        end = minimise_one_by_one(membranes, near[None], _BULGE_STEPS)
        # Beyond this, a law's constants are zero or have no number.
        sound = np.max(np.abs(end.theta)) < _FARTHEST
        found.append(end if sound else end._replace(cost=np.array([np.inf])))
        parts = [np.concatenate(part) for part in zip(*found, strict=True)]
        order = np.argsort(parts[1], kind="stable")
        minima = Minima(*(part[order] for part in parts))
        if minima.agreeing > 1:
            break
    return minima


def _with_effects(
    sets: Sequence[Dataset],
    chosen: Family,
    problem: MaterialProblem,
    starts: int,
    seed: int,
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
    sets: Sequence[Dataset],
    chosen: Family,
    settings: SearchSettings,
    zeros: Sequence[Zero],
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

    def judged(known: np.ndarray | None) -> Specimens | None:
        theta, scales = jnp.asarray(minima.theta[0]), problem.residuals.scales
        return specimens_of(problem, np.asarray(chosen.constants(theta, scales)), known)

    found = judged(None)
    if found is None or not found.differ:
        return found, problem, minima
    typical = of_typical_specimen(problem.sets, found)
    problem, minima = weighed_search(typical, chosen, settings, ())
    return judged(found.factors) if np.isfinite(minima.cost[0]) else None, problem, minima


# The radius, largest change of a parameter: first, over that of a step that failed, and by how
# much it grows or shrinks where the gain is more or less of the predicted one than this.
_RADIUS, _FAILED = 1.0, 0.3
_GOOD, _POOR, _FACTOR = 0.75, 0.25, 2.0
# Predicted gain, relative to the cost, that is not worth an evaluation.
_ENOUGH = 1e-8
_EXACT = {"xtol": 1e-12, "ftol": 1e-12, "gtol": 1e-14, "max_nfev": 100}


def minimise_corrected(
    costly: AbstractResiduals,
    cheap: AbstractResiduals,
    start: Float[np.ndarray, " p"],  # unconstrained parameters to start from
    evaluations: int,  # most evaluations of the costly residuals
) -> Float[np.ndarray, " p"]:
    """Approach the minimum of ½ Σ r² of costly residuals.

    The cheap residuals get an affine term in θ that gives them the costly ones' values and
    derivatives at the best point so far; their minimum within a radius is the next point. Where
    the steps end both models have the same gradient, so that the minimum is the costly model's
    (first-order model management: Alexandrov and Lewis, Optimization and Engineering 2, 2001).
    It follows a curved valley in a few evaluations, where steps on costly residuals creep.

    `cheap`: residuals of the same readings by a cheap model with the same parameters.
    Returns the best parameters found; the start where either model has no numbers there.
    """
    best, cost = start, np.inf
    r, J = by_theta(costly, start)
    theta, predicted, radius = start, 0.0, _RADIUS
    for _ in range(evaluations):
        found = _cost(r, J)
        if found < cost:
            gain = (cost - found) / max(cost - predicted, 1e-300) if np.isfinite(cost) else 0.5
            radius *= _FACTOR if gain > _GOOD else 1.0 / _FACTOR if gain < _POOR else 1.0
            best, cost = theta, found
            corrected = _corrected(cheap, best, r, J)
        else:
            radius = _FAILED * float(np.max(np.abs(theta - best)))
        if not np.isfinite(cost) or corrected is None:
            break
        # The corrected model's minimum within the radius.
        run = solved_by_scipy(corrected, best, bounds=(best - radius, best + radius), **_EXACT)
        theta, predicted = run.x, float(run.cost)
        if not cost - predicted > _ENOUGH * cost:
            break
        r, J = by_theta(costly, theta)
    return best


def _cost(r: np.ndarray, J: np.ndarray) -> float:
    """½ Σ r², infinite where anything is not a number."""
    return 0.5 * float(r @ r) if np.all(np.isfinite(r)) and np.all(np.isfinite(J)) else np.inf


_Model = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def _corrected(
    cheap: AbstractResiduals, best: np.ndarray, r: np.ndarray, J: np.ndarray
) -> _Model | None:
    """The cheap residuals and derivatives that agree with r and J at the best point."""
    r_cheap, J_cheap = by_theta(cheap, best)
    if not np.isfinite(_cost(r_cheap, J_cheap)):
        return None
    offset, slope = r - r_cheap, J - J_cheap

    def at(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, derivative = by_theta(cheap, theta)
        return value + offset + slope @ (theta - best), derivative + slope

    return at
