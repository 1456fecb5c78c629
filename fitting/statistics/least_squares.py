"""Nonlinear least squares from many starts at once, with its own check of convergence.

All starts advance together in one `vmap` of Optimistix's Levenberg-Marquardt: a short run
of all of them, then a long run of the best few. Whether a start has converged is decided
here and not by the solver's flag: at a minimum no Gauss-Newton step, cut to length one in
every singular direction of the Jacobian, lowers the cost noticeably.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import scipy.optimize
from jaxtyping import Array, Float

from fitting.statistics.residuals import AbstractResiduals, by_theta, linearised
from suas_jax.runtime.compiled import COMPILED

# A start has converged when the predicted decrease of its cost is below this fraction,
# or when nothing but rounding is left to fit.
CONVERGED = 1e-9
_ROUNDING = 1e-20
AGREEMENT = 1e-6
# Starts advance in batches of one size, so that one compiled program does everything.
LANES = 16
_STEPS, _PASSES, _PROGRESS = 20, 40, 1e-12
# Of the best starts, how many are finished one by one, and in how many evaluations each.
_FINISHED, _EVALUATIONS, _FARTHEST = 4, 200, 300.0
_IMPOSSIBLE = 1e6


class Minima(NamedTuple):
    """What became of the best starts, best first."""

    theta: np.ndarray  # parameters, shape [lanes, p]
    cost: np.ndarray  # ½ Σ r², shape [lanes]; infinite where nothing finite was found
    converged: np.ndarray  # whether it is a minimum, shape [lanes]
    predicted_decrease: np.ndarray  # of the cost by one more step, relative, shape [lanes]

    @property
    def agreeing(self) -> int:
        """How many converged starts share the lowest cost."""
        close = self.cost <= self.cost[0] * (1.0 + AGREEMENT) + _ROUNDING
        return int(np.sum(close & self.converged))


def minimise(
    residuals: AbstractResiduals,
    starts: Float[np.ndarray, "starts p"],
    lanes: int = LANES,  # how many advance together, and how many of the best go on
    passes: int = _PASSES,  # how many more runs the best get at most
    *,
    finish: bool = True,  # follow long valleys to their bottom; a rough minimum needs none
) -> Minima:
    """Minimise ½ Σ r² from many starting points.

    Every start gets one run of Levenberg-Marquardt; the best go on until they have
    converged or their passes are used up.

    `starts`: unconstrained parameters to start from; fewer than `lanes` are repeated.
    Returns the starts that went on, best first. Nothing raises: a start that fails has infinite
    cost and is not converged.
    """
    points = np.asarray(starts, float)
    filled = np.resize(points, (-(-len(points) // lanes) * lanes, points.shape[1]))
    once = residuals.costly
    batches = [
        COMPILED.run(
            _advance, residuals, COMPILED.run(_refined, residuals, batch, once=once), once=once
        )
        for batch in jnp.asarray(filled).reshape(-1, lanes, points.shape[1])
    ]
    theta, cost, predicted_decrease = (
        np.concatenate([np.asarray(batch[i]) for batch in batches])[: len(points)]
        for i in range(3)
    )
    order = np.argsort(cost, kind="stable")[:lanes]
    theta, cost, predicted_decrease = theta[order], cost[order], predicted_decrease[order]
    used = int(residuals.used.sum())
    for _ in range(passes):
        if np.all(_is_minimum(cost, predicted_decrease, used) | ~np.isfinite(cost)):
            break
        again = np.resize(theta, (lanes, theta.shape[1]))
        advanced = COMPILED.run(_advance, residuals, jnp.asarray(again), once=once)
        moved = [np.asarray(x)[: len(theta)] for x in advanced]
        better = moved[1] <= cost
        stuck = not np.any(moved[1] < cost * (1.0 - _PROGRESS))
        # Where two starts or more share the lowest cost and only creep on, along a valley, they
        # are finished one by one.
        lowest = moved[1] <= np.min(moved[1]) * (1.0 + AGREEMENT)
        gains = moved[1] < cost * (1.0 - AGREEMENT)
        creeps = lowest.sum() > 1 and not np.any(gains & lowest)
        theta = np.where(better[:, None], moved[0], theta)
        cost, predicted_decrease = (
            np.where(better, moved[1], cost),
            np.where(better, moved[2], predicted_decrease),
        )
        if stuck or (finish and creeps):
            break
    minima = _sorted(residuals, theta, cost, predicted_decrease)
    if finish and np.isfinite(minima.cost[0]) and not minima.converged[0]:
        return _finished(residuals, minima)
    return minima


def _sorted(
    residuals: AbstractResiduals, theta: np.ndarray, cost: np.ndarray, decrease: np.ndarray
) -> Minima:
    """Ends of starts, the lowest cost first."""
    order = np.argsort(cost, kind="stable")
    theta, cost, decrease = theta[order], cost[order], decrease[order]
    used = int(residuals.used.sum())
    return Minima(theta, cost, _is_minimum(cost, decrease, used), decrease)


def solved_by_scipy(
    at: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    start: np.ndarray,  # parameters to start from [p]
    impossible: float = _IMPOSSIBLE,
    **options: Any,
) -> Any:
    """SciPy's least squares of residuals that come with their derivatives.

    `at`: residuals [n] and their derivatives [n, p] at parameters [p]. `impossible`: residual
    that stands for one that is not a number, flat there.
    Returns SciPy's result; `fun` and `jac` are the residuals and derivatives at its end.
    """

    @functools.lru_cache(maxsize=2)
    def kept(key: bytes) -> tuple[np.ndarray, np.ndarray]:
        with np.errstate(all="ignore"):
            return _finite(*at(np.frombuffer(key)), impossible)

    return scipy.optimize.least_squares(
        lambda x: kept(x.tobytes())[0], start, lambda x: kept(x.tobytes())[1], **options
    )


def _finite(r: np.ndarray, J: np.ndarray, impossible: float) -> tuple[np.ndarray, np.ndarray]:
    """Residuals and derivatives, with large and flat ones for those that are no numbers."""
    finite = np.isfinite(r) & np.all(np.isfinite(J), axis=1)
    return np.where(finite, r, impossible), np.where(finite[:, None], J, 0.0)


def compressed(r: np.ndarray, J: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Few residuals with the cost, the gradient and the steps of many.

    With J = Q R they are Q^T r and, last, the length of what of r no step changes.

    Args:
        r: residuals [n].
        J: their derivatives [n, p].

    Returns:
        As many residuals as parameters and one more, and their derivatives; those given where
        they are hardly more or no numbers.
    """
    n, p = J.shape
    if n <= 2 * p or not (np.all(np.isfinite(r)) and np.all(np.isfinite(J))):
        return r, J
    Q, R = np.linalg.qr(J)
    along = Q.T @ r
    rest = np.sqrt(max(float(r @ r - along @ along), 0.0))
    return np.append(along, rest), np.vstack([R, np.zeros(p)])


def _finished(residuals: AbstractResiduals, found: Minima) -> Minima:
    """Starts of which the best few are brought to the bottom of a long valley."""
    theta, cost, _, decrease = (part.copy() for part in found)
    for i in range(min(_FINISHED, len(theta))):
        end = minimise_one_by_one(residuals, theta[i : i + 1], _EVALUATIONS)
        # Beyond this, exponentials of parameters are zero or have no number.
        if end.cost[0] <= cost[i] and np.max(np.abs(end.theta[0])) < _FARTHEST:
            theta[i], cost[i], decrease[i] = (
                end.theta[0],
                end.cost[0],
                end.predicted_decrease[0],
            )
    return _sorted(residuals, theta, cost, decrease)


def _is_minimum(cost: np.ndarray, predicted_decrease: np.ndarray, used: int) -> np.ndarray:
    return np.isfinite(cost) & ((predicted_decrease <= CONVERGED) | (cost <= used * _ROUNDING))


def minimise_one_by_one(
    residuals: AbstractResiduals, starts: Float[np.ndarray, "starts p"], evaluations: int = 60
) -> Minima:
    """Minimise ½ Σ r² from a few points that are near, one after the other.

    The steps are taken outside of the compiled programs (MINPACK's Levenberg-Marquardt), so
    that of residuals that are long to compile nothing but `sensitivity` is compiled.

    Returns the starts, best first, judged as `minimise` judges them.
    """
    found = []

    def at(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        try:
            r, J = by_theta(residuals, theta)
        except jax.errors.JaxRuntimeError:  # an equilibrium inside that has no numbers
            r = np.full(len(residuals.value), np.nan)
            J = np.zeros((len(r), theta.size))
        # MINPACK takes as many residuals at every point.
        return compressed(*_finite(r, J, _IMPOSSIBLE))

    exact = {"xtol": 1e-12, "ftol": 1e-12, "gtol": 1e-12}
    for start in np.asarray(starts, float):
        run = solved_by_scipy(at, start, method="lm", max_nfev=evaluations, **exact)
        cost, decrease = judged(jnp.asarray(run.fun), jnp.asarray(run.jac))
        possible = np.max(np.abs(run.fun)) < 0.5 * _IMPOSSIBLE
        found.append((run.x, float(cost) if possible else np.inf, float(decrease)))
    theta, costs, decreases = (np.array([run[i] for run in found]) for i in range(3))
    return _sorted(residuals, theta, costs, decreases)


@eqx.filter_jit
def _advance(
    residuals: AbstractResiduals, starts: Float[Array, "lanes p"]
) -> tuple[Array, Array, Array]:
    """One run of Levenberg-Marquardt on every lane: parameters, cost, predicted decrease."""
    solver: optx.LevenbergMarquardt = optx.LevenbergMarquardt(rtol=1e-10, atol=1e-10)

    # Traced once, whoever asks.
    at = jax.jit(lambda theta: linearised(residuals, theta))

    # The solver linearises and materialises; with the Jacobian as one explicit product
    # it traces, compiles and runs in half the time. Where the law can't follow a test the
    # residual is large and flat: the solver stops at anything that is not a number.
    @jax.custom_jvp
    def residual(theta: Array) -> Array:
        value, _ = at(theta)
        return jnp.where(jnp.isfinite(value), value, _IMPOSSIBLE)

    @residual.defjvp
    def _(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
        value, jacobian = at(primals[0])
        finite = jnp.isfinite(value) & jnp.all(jnp.isfinite(jacobian), 1)
        jacobian = jnp.where(finite[:, None], jacobian, 0.0)
        return jnp.where(finite, value, _IMPOSSIBLE), jacobian @ tangents[0]

    def run(start: Array) -> tuple[Array, Array, Array]:
        found = optx.least_squares(
            lambda theta, _: residual(theta), solver, start, max_steps=_STEPS, throw=False
        ).value
        found = jnp.where(jnp.all(jnp.isfinite(found)), found, start)
        return found, *judged(*at(found))

    return jax.vmap(run)(starts)


def judged(
    r: Float[Array, " n"], J: Float[Array, "n p"]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Cost, and the relative decrease that a bounded Gauss-Newton step predicts."""
    finite = jnp.all(jnp.isfinite(r)) & jnp.all(jnp.isfinite(J))
    u, s, _ = jnp.linalg.svd(jnp.where(finite, J, 0.0), full_matrices=False)
    along = jnp.abs(u.T @ jnp.where(finite, r, 0.0))
    # Decrease of ½|r|²: in full if the step s⁻¹ along is at most one, else up to there.
    decrease = jnp.where(along <= s, 0.5 * along**2, s * along - 0.5 * s**2)
    cost = 0.5 * jnp.sum(r * r)
    predicted_decrease = jnp.where(cost > 0.0, jnp.sum(decrease) / cost, 0.0)
    return jnp.where(finite, cost, jnp.inf), jnp.where(finite, predicted_decrease, jnp.inf)


@eqx.filter_jit
def _refined(
    residuals: AbstractResiduals, starts: Float[Array, "lanes p"]
) -> Float[Array, "lanes p"]:
    """Starts improved by what is linear in them."""

    def improve(start: Array) -> Array:
        better = residuals.refined(start)
        return jnp.where(jnp.all(jnp.isfinite(better)), better, start)

    return jax.vmap(improve)(starts)
