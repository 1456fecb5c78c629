"""Profile-likelihood intervals of constants and of functions of them.

The profile of a quantity g is the least cost of all parameters that share its value::

    C(v) = min ½ Σ r(θ)²  subject to  g(θ) = v

Its interval ends where C exceeds its minimum by as much as a Gaussian likelihood would at the
ends of the interval of this level (Venzon & Moolgavkar 1988). It follows curved valleys, stays
within a constant's sign, and is open where the data never exclude the constant's limit.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from fitting.statistics.least_squares import Linearised

_ITERATIONS = 40
_CONSTRAINT = 1e-8
_SEARCHES = 16
# Evaluations of the residuals for one end, over their number; a search that needs more is
# given up.
_EVALUATIONS, _FEWEST, _MOST = 1.5e4, 30, 120
_TOLERANCE = 5e-3
# Parameters that the residuals hardly see move as if they saw them by this share.
_LEAST_SIZE = 1e-3
_STEPS_OUT = 12

Quantity = Callable[[np.ndarray], tuple[float, np.ndarray]]


class End(NamedTuple):
    """One end of an interval."""

    value: float  # of the quantity; NaN where the search failed
    is_open: bool  # the data do not exclude anything up to the quantity's own limit


def profile_end(
    at: Linearised,  # residuals [n] and their derivatives [n, p] at parameters
    quantity: Quantity,  # g and its gradient [p]
    theta: np.ndarray,  # parameters at the minimum
    side: float,  # −1 for the lower end, 1 for the upper
    excess: float,  # by how much the cost exceeds its minimum at the end
    step: float,  # distance of the end if the likelihood were Gaussian, in units of g
    farthest: float,  # distance at which an end is taken as open
) -> End:
    """One end of a quantity's interval. Returns the end in units of g."""
    r, _ = at(theta)
    counted = _Counted(at, int(np.clip(_EVALUATIONS / len(r), _FEWEST, _MOST)))
    least = 0.5 * float(r @ r)
    start, _ = quantity(theta)
    step = step if np.isfinite(step) and step > 0.0 else farthest
    # On this scale a Gaussian likelihood is a straight line through one.
    inner, height, point = 0.0, 0.0, theta
    outer: float | None = None
    above, beyond = 0.0, theta
    distance = min(step, farthest)
    for _ in range(_SEARCHES + _STEPS_OUT):
        if counted.left <= 0:
            return End(np.nan if outer is None else start + side * outer, False)
        base = beyond if outer is not None and outer - distance < distance - inner else point
        found = _constrained(counted, quantity, base, start + side * distance)
        if found is None:
            if outer is None and distance - inner <= 0.02 * max(distance, step):
                # A limit of the law's, if most of the way was gone; else a valley too narrow.
                return End(start + side * inner if inner >= step else np.nan, True)
            distance = 0.5 * (inner + distance)
            if outer is not None and outer - inner < _TOLERANCE * outer:
                break
            continue
        here, cost = found
        size = np.sqrt(max(cost - least, 0.0) / excess)
        if size >= 1.0:
            outer, above, beyond = distance, size, here
        else:
            if distance >= farthest:
                return End(start + side * distance, True)
            inner, height, point = distance, size, here
        if abs(size - 1.0) < _TOLERANCE:
            return End(start + side * distance, False)
        if outer is None:
            slope = size / distance if distance > 0.0 else 0.0
            wanted = distance / max(size, 0.25) if slope > 0.0 else 4.0 * distance
            distance = min(max(1.02 * wanted, 1.1 * distance), farthest)
        else:
            share = (1.0 - height) / max(above - height, 1e-12)
            distance = inner + float(np.clip(share, 0.05, 0.95)) * (outer - inner)
            if outer - inner < _TOLERANCE * outer:
                break
    return End(start + side * (outer if outer is not None else inner), outer is None)


class _Counted:
    """A function that knows how often it may still be called."""

    def __init__(self, function: Linearised, most: int) -> None:
        self.function, self.left = function, most

    def __call__(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        self.left -= 1
        return self.function(theta)


def _constrained(
    at: _Counted, quantity: Quantity, start: np.ndarray, wanted: float
) -> tuple[np.ndarray, float] | None:
    """Least cost where the quantity has a value: parameters and cost, None if unreachable.

    Levenberg-Marquardt steps that solve the linearised constraint exactly.
    """
    theta = start
    r, J = at(theta)
    value, gradient = quantity(theta)
    scale = max(1.0, abs(wanted))
    damping = 1e-6
    cost = 0.5 * float(r @ r)
    if not np.isfinite(cost):
        return None
    for _ in range(_ITERATIONS):
        if not np.all(np.isfinite(gradient)) or not np.any(gradient) or at.left <= 0:
            return None
        norms = np.linalg.norm(J, axis=0)
        sizes = np.maximum(norms, _LEAST_SIZE * np.max(norms) + 1e-300)
        step = _step(J, r, gradient, wanted - value, sizes, damping)
        if step is None:
            return None
        longest = float(np.max(np.abs(step)))
        if longest > 2.0:
            step = step * (2.0 / longest)
        new = theta + step
        r_new, J_new = at(new)
        value_new, gradient_new = quantity(new)
        cost_new = 0.5 * float(r_new @ r_new)
        missed, missed_new = abs(wanted - value), abs(wanted - value_new)
        off = missed > _CONSTRAINT * scale
        better = np.isfinite(cost_new) and (
            (off and missed_new < 0.98 * missed and cost_new < 1e3 * cost + 1e3)
            or (not off and missed_new <= 1e-5 * scale and cost_new <= cost * (1.0 + 1e-12))
        )
        if not better:
            damping = max(10.0 * damping, 1e-6)
            if damping > 1e8:
                break
            continue
        drop = (cost - cost_new) / max(cost_new, 1e-300)
        theta, r, J, value, gradient = new, r_new, J_new, value_new, gradient_new
        cost = cost_new
        damping = max(0.1 * damping, 1e-12)
        if not off and drop < 1e-7:
            break
    return (theta, cost) if abs(wanted - value) <= 1e-4 * scale else None


def _step(
    J: np.ndarray,
    r: np.ndarray,
    gradient: np.ndarray,
    missing: float,
    sizes: np.ndarray,
    damping: float,
) -> np.ndarray | None:
    """Least-squares step on the linearised constraint, in scaled parameters."""
    scaled, slope = J / sizes, gradient / sizes
    length = float(np.linalg.norm(slope))
    if not np.isfinite(length) or length == 0.0:
        return None
    along = slope / length
    base = along * (missing / length)
    # An orthonormal basis of the plane of constant g, from a Householder reflection.
    p = len(along)
    if p == 1:
        return np.asarray(base / sizes)
    v = along.copy()
    v[0] += 1.0 if along[0] >= 0.0 else -1.0
    plane = (np.eye(p) - 2.0 * np.outer(v, v) / (v @ v))[:, 1:]
    reduced = scaled @ plane
    rest = r + scaled @ base
    system = np.vstack([reduced, np.sqrt(damping) * np.eye(p - 1)])
    target = np.concatenate([-rest, np.zeros(p - 1)])
    try:
        inside, *_ = np.linalg.lstsq(system, target, rcond=1e-14)
    except np.linalg.LinAlgError:
        return None
    return np.asarray((base + plane @ inside) / sizes)
