"""Profile-likelihood intervals of constants and of functions of them.

The profile of a quantity g is the least cost of all parameters that share its value::

    C(v) = min ½ Σ r(θ)²  subject to  g(θ) = v

Its interval ends where C exceeds its minimum by as much as a Gaussian likelihood would at the
ends of the interval of this level (Venzon & Moolgavkar 1988). It follows curved valleys, stays
within a constant's sign, and is open where the data never exclude the constant's limit.

The constraint is one more residual, w (g(θ) - v), of a large weight w. Where the sum is least
g falls short of v, but the cost is the profile's at the value that g has there.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from fitting.statistics.least_squares import Linearised, solved_by_scipy

# Evaluations of the residuals for one value of g, over their number.
_EVALUATIONS, _FEWEST, _MOST = 3e4, 20, 60
_WEIGHT = 10.0  # of the constraint, in units of what a Gaussian likelihood knows of g
_TOLERANCE = 1e-3
_STEPS_OUT, _STEPS_BETWEEN = 12, 16

Quantity = Callable[[np.ndarray], tuple[float, np.ndarray]]


class End(NamedTuple):
    """One end of an interval."""

    value: float  # of the quantity; NaN where the search failed
    is_open: bool  # the data do not exclude anything up to the quantity's own limit


class _Point(NamedTuple):
    """A point of a profile."""

    theta: np.ndarray  # parameters
    gone: float  # how far g has come towards the end
    size: float  # root of the cost's rise over that of the end: Gaussian, a straight line


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
    least, (start, _) = 0.5 * float(r @ r), quantity(theta)
    step = min(step, farthest) if np.isfinite(step) and step > 0.0 else farthest
    weight = _WEIGHT * np.sqrt(2.0 * excess) / step
    evaluations = int(np.clip(_EVALUATIONS / len(r), _FEWEST, _MOST))
    known = {0.0: _Point(theta, 0.0, 0.0)}  # by distance asked for

    @functools.cache
    def above(distance: float) -> float:
        """Size over that of the end, less one; one where there is none."""
        if distance == 0.0:
            return -1.0
        near = known[max(d for d in known if d < distance)].theta
        wanted = start + side * distance
        x, cost = constrained(at, quantity, near, wanted, weight, evaluations)
        gone = side * (quantity(x)[0] - start)
        size = float(np.sqrt(max(cost - least, 0.0) / excess))
        if not (np.isfinite(size) and np.isfinite(gone)):
            return 1.0
        known[distance] = _Point(x, gone, size)
        return size - 1.0

    inner, outer = 0.0, min(1.02 * step, farthest)  # a Gaussian's end, and a little further
    for _ in range(_STEPS_OUT):
        if (rise := above(outer)) >= 0.0:
            break
        if outer >= farthest:
            if known[outer].gone > 0.5 * farthest:
                return End(start + side * outer, True)
            break
        inner = outer
        outer = min(inner * max(1.02 / max(rise + 1.0, 0.25), 1.5), farthest)
    if rise > 0.0:
        accuracy = {"xtol": _TOLERANCE * step, "rtol": _TOLERANCE, "maxiter": _STEPS_BETWEEN}
        brentq(above, inner, outer, **accuracy, disp=False)
    last = min(known.values(), key=lambda point: abs(point.size - 1.0))
    if abs(last.size - 1.0) < 10.0 * _TOLERANCE:
        return End(start + side * last.gone, False)
    # A limit of the law's, if most of the way was gone; else a valley too narrow.
    return End(start + side * last.gone if last.gone >= step else np.nan, True)


def constrained(
    at: Linearised,
    quantity: Quantity,
    start: np.ndarray,  # parameters to start from
    wanted: float,  # value of the quantity
    weight: float,  # of its residual
    evaluations: int,
) -> tuple[np.ndarray, float]:
    """Parameters of least cost with the quantity near a value, and their cost."""

    def held(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        (r, J), (value, gradient) = at(theta), quantity(theta)
        return np.append(r, weight * (value - wanted)), np.vstack([J, weight * gradient])

    with np.errstate(over="ignore"):  # of steps that are taken back
        theta = solved_by_scipy(held, start, method="trf", max_nfev=evaluations).x
    r, _ = at(theta)
    return theta, 0.5 * float(r @ r)
