"""Several specimens of one rubber: how much stiffer or softer each is than the typical one.

Every specimen s follows the law times a factor k_s of its own. The law is fitted to readings
over their factors, so that the difference between specimens is not a misfit; the stiffness
of the typical specimen is as uncertain as τ/√S adds.

Estimates log k_s of S specimens with standard errors e_s scatter as N(m, τ² + e_s²). τ is the
moment estimate of Paule and Mandel (1982), its interval the Q-profile of Viechtbauer (2007). A
further specimen's log k lies about m with what the likelihood of τ leaves open, under the prior
1/√(τ² + ē²) up to τ = 0.5: Student's t for exact estimates, and never a point.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy import optimize, stats

from fitting.material.experiments.measurements import Dataset, StressTest
from fitting.material.fit.problem import MaterialProblem, readings

_LARGEST = 1e3  # of the spread of the estimates
_MOST_SCATTER = 0.5  # of specimens of one rubber

_FEWEST_READINGS = 5
_CHANCE = 0.01


class Scatter(NamedTuple):
    """Scatter between groups."""

    mean: float  # m
    mean_error: float  # its standard error, scatter included
    deviation: float  # τ
    low: float  # end of the 95 % interval of τ
    high: float  # end of the 95 % interval of τ
    chance: float  # of groups this different without any scatter
    further: float  # half width of the 95 % interval of a further group about m


def scatter_between(values: np.ndarray, errors: np.ndarray) -> Scatter:
    """Scatter between groups beyond their own standard errors.

    `values`: estimate of each group, shape [s], two or more. `errors`: their standard errors,
    shape [s].
    """
    count = len(values)
    spread = max(float(np.ptp(values)), float(np.max(errors)), 1e-300)
    errors = np.maximum(errors, 1e-9 * spread)

    def excess(deviation: float) -> float:
        weight = 1.0 / (deviation**2 + errors**2)
        mean = np.sum(weight * values) / np.sum(weight)
        return float(np.sum(weight * (values - mean) ** 2))

    def where(target: float) -> float:
        if excess(0.0) <= target:
            return 0.0
        return float(optimize.brentq(lambda t: excess(t) - target, 0.0, _LARGEST * spread))

    deviation = where(count - 1.0)
    low, high = (where(float(stats.chi2.ppf(p, count - 1))) for p in (0.975, 0.025))
    weight = 1.0 / (deviation**2 + errors**2)
    return Scatter(
        mean=float(np.sum(weight * values) / np.sum(weight)),
        mean_error=float(1.0 / np.sqrt(np.sum(weight))),
        deviation=deviation,
        low=low,
        high=high,
        chance=float(stats.chi2.sf(excess(0.0), count - 1)),
        further=_further(excess, errors, spread),
    )


def _further(excess: Callable[[float], float], errors: np.ndarray, spread: float) -> float:
    """Half width of the 95 % interval of a further group; see the module.

    `excess`: Σ (y - m)²/(τ² + e²) at τ. `errors`: standard errors of the groups [s].
    """
    typical = float(np.mean(errors**-2.0) ** -0.5)
    tau = np.geomspace(1e-3 * typical, max(_MOST_SCATTER, 10.0 * spread), 400)
    weight = 1.0 / (tau[:, None] ** 2 + errors**2)
    total = weight.sum(1)
    log = 0.5 * np.log(weight).sum(1) - 0.5 * np.log(total)
    log -= 0.5 * np.array([excess(float(t)) for t in tau])
    share = np.exp(log - log.max()) * tau / np.hypot(tau, typical)
    share /= share.sum()
    deviation = np.sqrt(tau**2 + 1.0 / total)

    def beyond(reach: float) -> float:
        return float(share @ stats.norm.sf(reach / deviation)) - 0.025

    return float(optimize.brentq(beyond, 0.0, 10.0 * deviation[-1]))


@dataclasses.dataclass(frozen=True)
class Specimens:
    """Factors of the specimens of a fit."""

    labels: tuple[tuple[str, str], ...]  # file and label of each specimen
    modes: tuple[str, ...]  # of each specimen's test
    factors: np.ndarray  # k_s, geometric mean one in every mode, shape [s]
    errors: np.ndarray  # relative standard errors of the factors, shape [s]
    scatter: Scatter  # of log k_s between specimens of one mode

    @property
    def differ(self) -> bool:
        """Whether the specimens differ by more than their readings' noise."""
        return self.scatter.chance < _CHANCE

    @property
    def mean_error(self) -> float:
        """Relative standard error of the typical stiffness from the scatter alone."""
        return self.scatter.deviation / float(np.sqrt(len(self.factors)))

    def report(self, modulus: float) -> dict[str, Any]:
        """The key "specimens" of the JSON.

        `modulus`: shear modulus of the typical specimen [Pa].
        """
        reach = self.scatter.further
        return {
            "specimens": [
                {
                    "file": file,
                    "specimen": label,
                    "mode": mode,
                    "factor": float(factor),
                    "standard_error": float(error * factor),
                    "shear_modulus_Pa": float(factor * modulus),
                }
                for (file, label), mode, factor, error in zip(
                    self.labels, self.modes, self.factors, self.errors, strict=True
                )
            ],
            "relative_scatter": self.scatter.deviation,
            "relative_scatter_95": [self.scatter.low, self.scatter.high],
            "differ": self.differ,
            "next_specimen_95_Pa": [
                float(modulus * np.exp(-reach)),
                float(modulus * np.exp(reach)),
            ],
        }


def has_several_specimens(sets: Sequence[Dataset]) -> bool:
    """Whether a mode has more than one specimen."""
    seen = [
        (data.mode, data.file, label) for data in sets for label in dict.fromkeys(data.specimen)
    ]
    return len({mode for mode, *_ in seen}) < len(seen)


def specimens_of(
    problem: MaterialProblem, constants: np.ndarray, known: np.ndarray | None = None
) -> Specimens | None:
    """Factors of the specimens, from a fit to all of them.

    `known`: factors that the readings were divided by already, shape [s].
    Returns the factors; None where no mode has two specimens with five readings or more.
    """
    predicted = np.asarray(readings(problem.residuals, jnp.asarray(constants))[0])
    inverse = np.asarray(problem.residuals.inverse_scale)
    measured = np.asarray(problem.residuals.value)
    labels, modes, logs, errors = [], [], [], []
    for data, place in problem.tests:
        # Tests of one rubber at several rates are no further specimens.
        if not isinstance(data, StressTest) or not data.is_curve or data.follows_history:
            return None
        for label in dict.fromkeys(data.specimen):
            rows = place[data.specimen == label]
            x, y = predicted[rows] * inverse[rows], measured[rows] * inverse[rows]
            square = float(x @ x)
            factor = float(x @ y) / square if square > 0.0 else np.nan
            if len(rows) < _FEWEST_READINGS or not factor > 0.0:
                return None
            rest = y - factor * x
            errors.append(np.sqrt(float(rest @ rest) / (len(rows) - 1) / square) / factor)
            labels.append((data.file, str(label)))
            modes.append(data.mode)
            logs.append(np.log(factor))
    values, spread = np.array(logs), np.array(errors)
    if known is not None:
        values = values + np.log(known)
    several = [mode for mode in dict.fromkeys(modes) if modes.count(mode) > 1]
    if not several:
        return None
    centred = values.copy()
    for mode in dict.fromkeys(modes):
        own = np.array(modes) == mode
        # What a mode has as a whole is the law's.
        weight = 1.0 / (spread[own] ** 2 + np.var(values[own]) + 1e-300)
        centred[own] -= np.sum(weight * values[own]) / np.sum(weight)
    compared = np.isin(modes, several)
    scatter = scatter_between(centred[compared], spread[compared])
    return Specimens(tuple(labels), tuple(modes), np.exp(centred), spread, scatter)


def of_typical_specimen(sets: Sequence[Dataset], found: Specimens) -> list[Dataset]:
    """The readings over the factors of their specimens."""
    changed = []
    factors = dict(zip(zip(found.labels, found.modes, strict=True), found.factors, strict=True))
    for data in sets:
        own = np.array([factors[(data.file, str(label)), data.mode] for label in data.specimen])
        changed.append(dataclasses.replace(data, value=data.value / own))
    return changed
