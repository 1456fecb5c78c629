"""Nonlinear least squares from many starts at once, with its own check of convergence.

All starts advance together in one `vmap` of Optimistix's Levenberg-Marquardt: a short run
of all of them, then a long run of the best few. Whether a start has converged is decided
here and not by the solver's flag: at a minimum no Gauss-Newton step, cut to length one in
every singular direction of the Jacobian, promises to lower the cost noticeably.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from fitting.residuals import Residuals

# A start has converged when the promised decrease of its cost is below this fraction,
# or when nothing but rounding is left to fit.
CONVERGED = 1e-9
_ROUNDING = 1e-20
AGREEMENT = 1e-6
_SHORT, _LONG, _FINALISTS = 40, 400, 16


class Minimum(NamedTuple):
    """What became of every start, best first.

    Attributes:
        theta: parameters, shape [starts, p].
        cost: ½ Σ r², shape [starts]; infinite where nothing finite was found.
        converged: whether it is a minimum, shape [starts].
        promised: relative decrease that one more step promises, shape [starts].
    """

    theta: np.ndarray
    cost: np.ndarray
    converged: np.ndarray
    promised: np.ndarray

    @property
    def agreeing(self) -> int:
        """How many converged starts share the lowest cost."""
        close = self.cost <= self.cost[0] * (1.0 + AGREEMENT) + _ROUNDING
        return int(np.sum(close & self.converged))


def minimise(
    residuals: Residuals, starts: Float[np.ndarray, "starts p"], finalists: int = _FINALISTS
) -> Minimum:
    """Minimise ½ Σ r² from many starting points.

    Args:
        residuals: the misfit.
        starts: unconstrained parameters to start from.
        finalists: how many of the best go on after the short run.

    Returns:
        All finalists, best first. Nothing raises: a start that fails has infinite cost.
    """
    theta, cost = _advance(residuals, jnp.asarray(starts, float), _SHORT, True)
    order = np.argsort(np.asarray(cost), kind="stable")[: min(finalists, len(starts))]
    theta, _ = _advance(residuals, theta[order], _LONG, False)
    cost, promised = map(np.asarray, _judge(residuals, theta))
    order = np.argsort(cost, kind="stable")
    small = np.asarray(residuals.used).sum() * _ROUNDING
    converged = np.isfinite(cost) & ((promised <= CONVERGED) | (cost <= small))
    return Minimum(np.asarray(theta)[order], cost[order], converged[order], promised[order])


@eqx.filter_jit
def _advance(
    residuals: Residuals, starts: Float[Array, "starts p"], steps: int, refine: bool
) -> tuple[Array, Array]:
    """Levenberg-Marquardt on every lane for at most `steps` steps."""
    solver: optx.LevenbergMarquardt = optx.LevenbergMarquardt(rtol=1e-10, atol=1e-10)

    def run(start: Array) -> tuple[Array, Array]:
        if refine:
            start = _refined(residuals, start)
        found = optx.least_squares(
            lambda t, r: r(t), solver, start, residuals, max_steps=steps, throw=False
        ).value
        found = jnp.where(jnp.all(jnp.isfinite(found)), found, start)
        r = residuals(found)
        cost = 0.5 * jnp.sum(r * r)
        return found, jnp.where(jnp.isfinite(cost), cost, jnp.inf)

    return jax.vmap(run)(starts)


def _refined(residuals: Residuals, start: Array) -> Array:
    """Use what is linear in a start: shares of terms, or the stiffness alone."""

    def columns(law: object) -> Array:
        readings = [test.predict(law) for test in residuals.experiments]  # type: ignore[arg-type]
        return residuals.weighed(jnp.concatenate(readings) * residuals.scales.stress)

    target = residuals.weighed(residuals.value)
    better = residuals.family.refined(start, columns, target)
    usable = jnp.all(jnp.isfinite(better))
    return jnp.where(usable, better, start)


@eqx.filter_jit
def _judge(residuals: Residuals, theta: Float[Array, "k p"]) -> tuple[Array, Array]:
    """Cost, and the relative decrease that a bounded Gauss-Newton step promises."""

    def one(t: Array) -> tuple[Array, Array]:
        r, J = residuals(t), jax.jacfwd(residuals)(t)
        finite = jnp.all(jnp.isfinite(r)) & jnp.all(jnp.isfinite(J))
        u, s, _ = jnp.linalg.svd(jnp.where(finite, J, 0.0), full_matrices=False)
        along = jnp.abs(u.T @ jnp.where(finite, r, 0.0))
        # Decrease of ½|r|²: in full if the step s⁻¹ along is at most one, else up to there.
        decrease = jnp.where(along <= s, 0.5 * along**2, s * along - 0.5 * s**2)
        cost = 0.5 * jnp.sum(r * r)
        promised = jnp.where(cost > 0.0, jnp.sum(decrease) / cost, 0.0)
        return jnp.where(finite, cost, jnp.inf), jnp.where(finite, promised, jnp.inf)

    return jax.vmap(one)(theta)
