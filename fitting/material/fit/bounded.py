"""Least squares with hard bounds on the constants.

Bounds are on the constants themselves (pascals, exponents), where a person puts them, beside
sign conditions of the law; SciPy's trust-region reflective least squares minimises the cost, in
units of each constant's natural size.
"""

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np

from fitting.material.laws.parameters import Family
from fitting.statistics.least_squares import CONVERGED, Minima, judged, solved_by_scipy
from fitting.statistics.residuals import AbstractResiduals, sensitivity

_AT_BOUND = 1e-6


def minimise_in_box(
    residuals: AbstractResiduals,
    family: Family,  # the law, which may bind the signs of constants
    constants: np.ndarray,  # the free minimum, SI units; its signs are kept
    others: np.ndarray,  # further starting points θ, shape [k, p]
    bounds: Mapping[str, tuple[float, float]],  # lowest and highest value by constant, SI units
) -> tuple[np.ndarray, Minima, tuple[str, ...]]:
    """Minimise ½ Σ r² with some constants kept between bounds.

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
