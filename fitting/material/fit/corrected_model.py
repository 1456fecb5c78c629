"""The minimum of costly residuals, found along those of a cheap model of the same readings.

The cheap residuals get an affine term in θ that gives them the costly ones' values and
derivatives at the best point so far; their minimum within a radius is the next point. Where
the steps end both models have the same gradient, so that the minimum is the costly model's
(first-order model management: Alexandrov and Lewis, Optimization and Engineering 2, 2001). A
cheap model that has the shape of a curved valley is followed along it in a few evaluations;
steps on the costly residuals alone creep there.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from fitting.statistics.least_squares import solved_by_scipy
from fitting.statistics.residuals import AbstractResiduals, by_theta

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
    start: Float[np.ndarray, " p"],
    evaluations: int,
) -> Float[np.ndarray, " p"]:
    """Approach the minimum of ½ Σ r² of costly residuals.

    `cheap`: residuals of the same readings by a cheap model with the same parameters. `start`:
    unconstrained parameters to start from. `evaluations`: most evaluations of the costly
    residuals.
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
