"""The search for constants on readings that are weighed by what the fit itself finds.

Two things are known only after a first fit: the noise of the readings, and how much stiffer or
softer each specimen is than the typical one. Readings are weighed by that noise, or divided by
the factors of their specimens, and the constants are sought again.
"""

import dataclasses
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from fitting.material.experiments.free_zero import Zero
from fitting.material.experiments.measurements import Dataset
from fitting.material.fit.noise import noise_of, with_noise
from fitting.material.fit.problem import MaterialProblem, pose
from fitting.material.fit.residuals import readings
from fitting.material.fit.search import search
from fitting.material.fit.specimens import Specimens, of_typical_specimen, specimens_of
from fitting.statistics.least_squares import Minima, minimise
from fitting.statistics.parameters import AbstractFamily

# Rounds of weighing by the estimated noise, which the fit itself then changes little.
_NOISE_ROUNDS = 2


def weighed_search(
    sets: list[Dataset],
    chosen: AbstractFamily,
    kind: str,
    starts: int,
    seed: int,
    zeros: Sequence[Zero],
) -> tuple[MaterialProblem, Minima, list[Dataset]]:
    """The search, with readings weighed by their noise where it is to be estimated.

    Args:
        sets: the data.
        chosen: parameters of the law.
        kind: of the residuals; "estimated" weighs them.
        starts: number of starting points.
        seed: of their draw.
        zeros: of tests that are found with the law.

    Returns:
        The problem, its minima, and the data with the noise that they are weighed by.
    """
    if kind != "estimated":
        return *search(sets, chosen, kind, starts, seed, zeros), sets
    problem, minima = search(sets, chosen, "relative", starts, seed, zeros)
    for _ in range(_NOISE_ROUNDS):
        if not np.isfinite(minima.cost[0]):
            break
        scales = problem.residuals.scales
        constants = np.asarray(chosen.constants(jnp.asarray(minima.theta[0]), scales))
        noise = noise_of(sets, problem, constants)
        predicted, _ = readings(problem.residuals, jnp.asarray(constants))
        sizes = [np.asarray(predicted)[place] for place in problem.places]
        sets = with_noise(sets, noise, sizes)
        posed = pose(sets, chosen, "noise", zeros=zeros)
        minima = minimise(posed.residuals, minima.theta)
        problem = dataclasses.replace(posed, kind="estimated")
    return problem, minima, sets


def search_for_typical_specimen(
    sets: list[Dataset],
    chosen: AbstractFamily,
    problem: MaterialProblem,
    minima: Minima,
    options: tuple[str, int, int],
) -> tuple[Specimens | None, MaterialProblem, Minima, list[Dataset]]:
    """The search for the typical specimen's constants, if the specimens differ.

    Args:
        sets: the data.
        chosen: parameters of the law.
        problem: residuals of all specimens alike.
        minima: of that problem.
        options: kind of the residuals, number of starting points and seed of their draw.

    Returns:
        The specimens' factors, the problem, its minima, and the data, over their factors
        where the specimens differ.
    """

    def judged(known: np.ndarray | None) -> Specimens | None:
        theta, scales = jnp.asarray(minima.theta[0]), problem.residuals.scales
        constants = np.asarray(chosen.constants(theta, scales))
        return specimens_of(sets, problem, constants, known)

    found = judged(None)
    if found is None or not found.differ:
        return found, problem, minima, sets
    sets = of_typical_specimen(sets, found)
    problem, minima, sets = weighed_search(sets, chosen, *options, ())
    if not np.isfinite(minima.cost[0]):
        return None, problem, minima, sets
    return judged(found.factors), problem, minima, sets
