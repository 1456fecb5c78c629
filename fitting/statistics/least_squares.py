"""Nonlinear least squares from many starts, with its own check of convergence.

A short run of MINPACK's Levenberg-Marquardt from every start, then a long one of the best few.
Whether a start has converged is decided here and not by the solver's flag: at a minimum no
Gauss-Newton step, cut to length one in every singular direction of the Jacobian, lowers the
cost noticeably.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np
import scipy.optimize
from jaxtyping import Float

from fitting.statistics.residuals import AbstractResiduals, by_theta

# A start has converged when the predicted decrease of its cost is below this fraction,
# or when nothing but rounding is left to fit.
CONVERGED = 1e-9
_ROUNDING = 1e-20
# A decrease that is none of residuals that are equilibria, which are those compiled for a few
# runs: MINPACK would go on in their rounding.
_ENOUGH = 1e-12
AGREEMENT = 1e-6
# How many of the best starts go on, and evaluations of each: of all at first, then of these.
BEST = 16
_ROUGH, _EVALUATIONS = 20, 200
_IMPOSSIBLE = 1e6
_EXACT = {"xtol": 1e-12, "ftol": 1e-12, "gtol": 1e-12}
_HOLD = 5e-9  # of the derivatives: what holds a parameter at its start
_FARTHEST = 300.0  # of parameters: beyond it exponentials are zero or no number


Linearised = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Residuals [n] and their derivatives [n, p] at parameters [p]."""


class Minima(NamedTuple):
    """What became of the best starts, best first."""

    theta: np.ndarray  # parameters, shape [lanes, p]
    cost: np.ndarray  # ½ Σ r², shape [lanes]; infinite where nothing finite was found
    converged: np.ndarray  # whether it is a minimum, shape [lanes]
    predicted_decrease: np.ndarray  # of the cost by one more step, relative, shape [lanes]
    rounding: float = _ROUNDING  # difference of costs that is none

    @property
    def agreeing(self) -> int:
        """How many converged starts share the lowest cost."""
        close = self.cost <= self.cost[0] * (1.0 + AGREEMENT) + self.rounding
        return int(np.sum(close & self.converged))


def minimise(residuals: AbstractResiduals, starts: Float[np.ndarray, "starts p"]) -> Minima:
    """Minimise ½ Σ r² from many starting points, of which the `BEST` go on to their minima.

    `starts`: unconstrained parameters to start from.
    Returns the starts that went on, best first. Nothing raises: a start that fails has infinite
    cost and is not converged.
    """
    if len(starts) > BEST:
        starts = minimise_one_by_one(residuals, starts, _ROUGH).theta[:BEST]
    return minimise_one_by_one(residuals, starts, _EVALUATIONS)


def solved_by_scipy(
    at: Linearised,  # residuals [n] and their derivatives [n, p] at parameters [p]
    start: np.ndarray,  # parameters to start from [p]
    # residual that stands for one that is not a number, flat there
    impossible: float = _IMPOSSIBLE,
    **options: Any,
) -> Any:
    """SciPy's least squares of residuals that come with their derivatives.

    Returns SciPy's result; `fun` and `jac` are the residuals and derivatives at its end.
    """
    kept = _kept(at, impossible)
    return scipy.optimize.least_squares(
        lambda x: kept(x)[0], start, lambda x: kept(x)[1], **options
    )


def _kept(at: Linearised, impossible: float) -> Linearised:
    """A function that remembers its last points, large and flat where it is not a number."""

    @functools.lru_cache(maxsize=4)
    def known(key: bytes) -> tuple[np.ndarray, np.ndarray]:
        with np.errstate(all="ignore"):
            r, J = at(np.frombuffer(key))
        finite = np.isfinite(r) & np.all(np.isfinite(J), axis=1)
        return np.where(finite, r, impossible), np.where(finite[:, None], J, 0.0)

    return lambda x: known(x.tobytes())


def compressed(r: np.ndarray, J: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Few residuals with the cost, the gradient and the steps of many.

    With J = Q R they are Q^T r and, last, the length of what of r no step changes.

    `r`: residuals [n]. `J`: their derivatives [n, p].
    Returns as many residuals as parameters and one more, and their derivatives; those given
    where they are hardly more or no numbers.
    """
    n, p = J.shape
    if n <= 2 * p or not (np.all(np.isfinite(r)) and np.all(np.isfinite(J))):
        return r, J
    Q, R = np.linalg.qr(J)
    along = Q.T @ r
    rest = np.sqrt(max(float(r @ r - along @ along), 0.0))
    return np.append(along, rest), np.vstack([R, np.zeros(p)])


def minimise_one_by_one(
    residuals: AbstractResiduals, starts: Float[np.ndarray, "starts p"], evaluations: int = 60
) -> Minima:
    """Minimise ½ Σ r² from a few points that are near, one after the other.

    The steps are taken outside of the compiled programs (MINPACK's Levenberg-Marquardt), so
    that of residuals that are long to compile nothing but `sensitivity` is compiled.

    Returns the starts, best first, judged as `minimise` judges them.
    """

    def at(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        try:
            return by_theta(residuals, theta)
        except jax.errors.JaxRuntimeError:  # an equilibrium inside that has no numbers
            r = np.full(len(residuals.value), np.nan)
            return r, np.zeros((len(r), theta.size))

    kept = _kept(at, _IMPOSSIBLE)
    enough = _ENOUGH if residuals.effort else 0.0
    found = [_minimum(kept, start, evaluations, enough) for start in np.asarray(starts, float)]
    found.sort(key=lambda run: run[1])
    theta, cost, decrease = (np.array(column) for column in zip(*found, strict=True))
    count = int(residuals.used.sum())
    with np.errstate(invalid="ignore"):  # a start without numbers has an infinite cost
        settled = cost * decrease < enough
    converged = _is_minimum(cost, decrease, count) | settled
    return Minima(theta, cost, converged, decrease, max(_ROUNDING, enough))


def _is_minimum(cost: np.ndarray, decrease: np.ndarray, count: int) -> np.ndarray:
    """Whether starts ended in minima, by what remains of `count` readings [lanes]."""
    return np.isfinite(cost) & ((decrease <= CONVERGED) | (cost <= count * _ROUNDING))


class _AtMinimumError(Exception):
    """Parameters at which too little is left to gain."""

    def __init__(self, theta: np.ndarray) -> None:
        super().__init__("nothing is left to gain")
        self.theta = theta


def _minimum(
    at: Linearised,
    start: np.ndarray,
    evaluations: int,
    enough: float,  # predicted decrease of the cost below which no step is taken
) -> tuple[np.ndarray, float, float]:
    """The end of one start: parameters, cost, predicted decrease; see `minimise_one_by_one`."""
    x, left = start, evaluations
    while left > 0:
        start = x
        # What the residuals do not see stays where it is: rounding would move it by any amount.
        # What they hardly see gets on from round to round.
        hold = _HOLD * float(np.linalg.norm(at(start)[1])) * np.eye(len(start))

        def held(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            r, J = at(theta)
            if enough and np.prod(judged(r, J)) < enough:
                raise _AtMinimumError(theta.copy())
            # MINPACK takes as many residuals at every point.
            rows = np.append(r, hold @ (theta - start))  # noqa: B023
            return compressed(rows, np.vstack([J, hold]))  # noqa: B023

        try:
            run = solved_by_scipy(held, start, method="lm", max_nfev=left, **_EXACT)
            x, left = run.x, left - run.nfev
        except _AtMinimumError as end:
            x = end.theta
        cost, decrease = judged(*at(x))
        if decrease <= CONVERGED or np.array_equal(x, start):
            break
    possible = np.max(np.abs(at(x)[0])) < _IMPOSSIBLE and np.max(np.abs(x)) < _FARTHEST
    return x, cost if possible else np.inf, decrease


def judged(r: np.ndarray, J: np.ndarray) -> tuple[float, float]:
    """Cost, and the relative decrease that a bounded Gauss-Newton step predicts."""
    if not (np.all(np.isfinite(r)) and np.all(np.isfinite(J))):
        return np.inf, np.inf
    few, R = compressed(r, J)
    u, s, _ = np.linalg.svd(R, full_matrices=False)
    along = np.abs(u.T @ few)
    # Decrease of ½|r|²: in full if the step s⁻¹ along is at most one, else up to there.
    decrease = np.where(along <= s, 0.5 * along**2, s * along - 0.5 * s**2)
    cost = 0.5 * float(r @ r)
    return cost, float(np.sum(decrease)) / cost if cost > 0.0 else 0.0
