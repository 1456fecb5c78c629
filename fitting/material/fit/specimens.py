"""Several specimens of one rubber: how much stiffer or softer each is than the typical one.

Every specimen s follows the law times a factor k_s of its own; log k_s scatter between the
specimens of a mode with a standard deviation τ. The law is fitted to readings over their
factors, so that the difference between specimens is no misfit; the stiffness of the typical
specimen is as uncertain as τ/√S adds.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from scipy import stats

from fitting.material.experiments.measurements import Dataset
from fitting.material.experiments.stress_tests import StressTest
from fitting.material.fit.problem import MaterialProblem
from fitting.statistics.random_effects import Scatter, scatter_between
from fitting.statistics.residuals import sensitivity

_FEWEST_READINGS = 5
_CHANCE = 0.01


@dataclasses.dataclass(frozen=True)
class Specimens:
    """Factors of the specimens of a fit.

    Attributes:
        labels: file and label of each specimen.
        modes: of each specimen's test.
        factors: k_s, geometric mean one in every mode, shape [s].
        errors: relative standard errors of the factors, shape [s].
        scatter: of log k_s between specimens of one mode.
    """

    labels: tuple[tuple[str, str], ...]
    modes: tuple[str, ...]
    factors: np.ndarray
    errors: np.ndarray
    scatter: Scatter

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

        Args:
            modulus: shear modulus of the typical specimen [Pa].
        """
        count = len(self.factors)
        # A further specimen of the same rubber.
        reach = self.scatter.deviation * float(np.sqrt(1.0 + 1.0 / count))
        reach *= float(stats.t.ppf(0.975, count - 1))
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
    sets: Sequence[Dataset],
    problem: MaterialProblem,
    constants: np.ndarray,
    known: np.ndarray | None = None,
) -> Specimens | None:
    """Factors of the specimens, from a fit to all of them.

    Args:
        sets: the data.
        problem: residuals of the fit.
        constants: fitted constants.
        known: factors that the readings were divided by already, shape [s].

    Returns:
        The factors; None where no mode has two specimens with five readings or more.
    """
    r, _ = sensitivity(problem.residuals, jnp.asarray(constants))
    inverse = np.asarray(problem.residuals.inverse_scale)
    measured = np.asarray(problem.residuals.value)
    predicted = measured + np.asarray(problem.residuals.misfit(r))
    labels, modes, logs, errors = [], [], [], []
    for data, place in zip(sets, problem.places, strict=True):
        # Tests of one rubber at several rates are no further specimens.
        if not isinstance(data, StressTest) or not data.is_curve or data.follows_history:
            return None
        for label in dict.fromkeys(data.specimen):
            rows = place[data.specimen == label]
            if len(rows) < _FEWEST_READINGS:
                return None
            x, y = predicted[rows] * inverse[rows], measured[rows] * inverse[rows]
            square = float(x @ x)
            factor = float(x @ y) / square if square > 0.0 else np.nan
            if not factor > 0.0:
                return None
            rest = y - factor * x
            error = np.sqrt(float(rest @ rest) / (len(rows) - 1) / square) / factor
            labels.append((data.file, str(label)))
            modes.append(data.mode)
            logs.append(np.log(factor))
            errors.append(error)
    values, spread = np.array(logs), np.array(errors)
    if known is not None:
        values = values + np.log(known)
    several = [mode for mode in dict.fromkeys(modes) if modes.count(mode) > 1]
    if not several:
        return None
    belongs = np.array(modes)
    centred = values.copy()
    for mode in dict.fromkeys(modes):
        own = belongs == mode
        # What a mode has as a whole is the law's.
        weight = 1.0 / (spread[own] ** 2 + np.var(values[own]) + 1e-300)
        centred[own] -= np.sum(weight * values[own]) / np.sum(weight)
    compared = np.isin(belongs, several)
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
