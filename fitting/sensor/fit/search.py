"""Least squares for a calibration: from starts, robust against outliers, above the floors."""

import dataclasses

import jax.numpy as jnp
import numpy as np

from fitting.sensor.fit.residuals import SensorProblem
from fitting.sensor.logs.data import NoCalibration
from fitting.statistics.least_squares import Minima, minimise_one_by_one

_STARTS = 2
_SPREAD = 0.05
# Shapes are linear in what moves the membrane: a step is no longer than this in theta.
_LARGEST_MOVE = 0.3
_OUTLIER = 5.0
_HUBER = 1.5
_HUBER_ROUNDS = 2
_ROUNDS = 8
# Share of a taxel's readings that may be outliers before the taxel is given up, and of
# taxels that may be, before it is the model that is wrong.
_BAD_TAXEL = 0.5
_BAD_SKIN = 0.3


@dataclasses.dataclass(frozen=True)
class Found:
    """The constants that follow the readings best."""

    constants: np.ndarray  # SI [p]
    minima: Minima  # what the starts found
    held: tuple[int, ...]  # positions of constants that stopped at their floors


def search(
    problem: SensorProblem, start: np.ndarray, weight: np.ndarray | float = 1.0
) -> Found:
    """Minimise the misfit.

    A constant that would fall below its floor is held there, and the others follow.

    The search starts from constants, SI [p]; each reading has its weight beside its noise
    [taxel, frame].
    Raises NoCalibration: no constants give finite counts.
    """
    family = problem.family
    held: tuple[int, ...] = ()
    start = np.maximum(start, family.floors)
    random = np.random.default_rng(0)
    spread = _SPREAD * random.standard_normal((_STARTS, family.size))
    spread[0] = 0.0
    while True:
        centre = np.asarray(family.unconstrained(jnp.asarray(start)))
        spread[:, list(held)] = 0.0
        residuals = problem.residuals(weight, held)
        if problem.correlation is not None:  # all have priors: one minimum, of many constants
            minima = minimise_one_by_one(residuals, centre[None])
        else:
            minima = minimise_one_by_one(residuals, centre + spread)
        if not np.isfinite(minima.cost[0]):
            raise NoCalibration(_no_counts(problem, start))
        # On the way to the minimum: with single constants cut, others would make up for what
        # these no longer do.
        here = np.asarray(family.unconstrained(problem.model.at))
        step = minima.theta[0] - here
        longest = np.abs(step[list(problem.model.moving)]).max(initial=_LARGEST_MOVE)
        found = here + _LARGEST_MOVE / longest * step
        constants = np.array(family.constants(jnp.asarray(found)))
        constants[list(held)] = family.floors[list(held)]
        below = (family.floors - constants) / family.sizes
        lowest = int(np.argmax(below))
        if not below[lowest] > 0.0:
            return Found(constants, minima, held)
        held = (*held, lowest)
        start = np.maximum(start, family.floors)
        start[lowest] = family.floors[lowest]


def _no_counts(problem: SensorProblem, start: np.ndarray) -> str:
    """Why no constants near a start give finite counts, and what to look at."""
    here = problem.readings
    on_wall = np.any(here.used & ~np.isfinite(problem.predicted(start)), 0)
    cause = ""
    if on_wall.any():
        cause = (
            f" in {int(on_wall.sum())} of {len(on_wall)} frames (the first is number "
            f"{int(on_wall.argmax())}): the known loads would press the membrane onto the wall"
        )
    return (
        f"no constants give finite counts{cause}; check that no columns of loads or places are "
        "exchanged, the units of the known inputs, oil gap, thickness and material in the skin "
        "file, and that the log belongs to this skin"
    )


def robust(problem: SensorProblem, start: np.ndarray) -> tuple[SensorProblem, Found]:
    """Fit with little weight on outliers, then without them.

    All readings that are present are used at first; the search starts from constants, SI [p].
    Returns the problem without the outliers, and its minimum.
    """
    present = problem.readings.present
    problem = problem.using(present)
    weight: np.ndarray | float = 1.0
    constants = start
    for _ in range(_HUBER_ROUNDS):
        constants = search(problem, constants, weight).constants
        r = problem.standardised(constants, weight)
        weight = np.minimum(1.0, _HUBER * _spread(r[present]) / np.maximum(np.abs(r), 1e-12))
    found = search(problem, constants, weight)
    for trial in range(_ROUNDS):
        used = _kept(problem.standardised(found.constants, weight), present)
        if trial and np.array_equal(used, problem.readings.used):
            break
        problem, weight = problem.using(used), 1.0
        found = search(problem, found.constants)
    return problem, found


def _kept(r: np.ndarray, present: np.ndarray) -> np.ndarray:
    """Readings that are not outliers [taxel, frame]."""
    outlying = present & (np.abs(r) > _OUTLIER * max(_spread(r[present]), 1.0))
    share = outlying.sum(1) / np.maximum(present.sum(1), 1)
    # A taxel that mostly disagrees while others agree is broken; where most do, it is the
    # model that is wrong, and nothing is left out.
    bad = share > _BAD_TAXEL
    if bad.sum() > _BAD_SKIN * np.sum(present.any(1)):
        return present
    return np.asarray(present & ~outlying & ~bad[:, None])


def _spread(r: np.ndarray) -> float:
    """Standard deviation of what is not an outlier."""
    return max(1.4826 * float(np.median(np.abs(r))), 1e-3)
