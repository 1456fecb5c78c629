"""Scatter between groups beside the uncertainty of each: a random-effects model.

Estimates k_s of S groups with standard errors e_s scatter as k_s ~ N(m, τ² + e_s²). τ is the
moment estimate of Paule and Mandel (1982), its interval the Q-profile of Viechtbauer (2007).
"""

from typing import NamedTuple

import numpy as np
from scipy import optimize, stats

_LARGEST = 1e3  # of the spread of the estimates


class Scatter(NamedTuple):
    """Scatter between groups.

    Attributes:
        mean: m.
        mean_error: its standard error, scatter included.
        deviation: τ.
        low: end of the 95 % interval of τ.
        high: end of the 95 % interval of τ.
        chance: of groups this different without any scatter.
    """

    mean: float
    mean_error: float
    deviation: float
    low: float
    high: float
    chance: float


def scatter_between(values: np.ndarray, errors: np.ndarray) -> Scatter:
    """Scatter between groups beyond their own standard errors.

    Args:
        values: estimate of each group, shape [s], two or more.
        errors: their standard errors, shape [s].
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
    )
