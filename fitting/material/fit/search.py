"""The search for the constants with the least sum of squares.

Two things are known only after a first fit: the noise of the readings, and how much stiffer or
softer each specimen is than the typical one. Readings are weighed by that noise, or divided by
the factors of their specimens, and the constants are sought again.
"""

import dataclasses
from collections.abc import Sequence
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
from fitting.statistics.least_squares import Minima, minimise, minimise_one_by_one
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
