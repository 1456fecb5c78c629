"""Weighted least squares for the loads of many frames at once, inside bounds."""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from fitting.inverse_load.fit.damped_step import (
    FIRST_DAMPING,
    GIVEN_UP,
    Descent,
    damped_step,
    next_damping,
)
from fitting.inverse_load.fit.explanation import PRIOR_OF_TANGENT
from fitting.inverse_load.model.evaluation import Evaluation, evaluate
from suas_jax.equilibrium.state import State
from suas_jax.numerics.array_types import Lanes
from suas_jax.scene.skin import Skin


class Target(NamedTuple):
    """What is fitted, lane by lane."""

    so: Float[Array, "taxel lane"]  # readings [counts]; anything where the weight is zero
    # inverse variance [1/counts^2]; zero where a taxel is left out
    weight: Float[Array, "taxel lane"]
    low: Float[Array, "parameter lane"]  # lower bounds of the parameters
    high: Float[Array, "parameter lane"]  # upper bounds


class Fit(NamedTuple):
    """A weighted least-squares fit, lane by lane."""

    parameters: Float[Array, "parameter lane"]  # see `loads_from`
    evaluation: Evaluation  # the model there
    chi2: Lanes  # weighted sum of squares; infinite where nothing was found
    # J^T W (y - SO), half the steepest descent of chi2
    gradient: Float[Array, "parameter lane"]
    information: Float[Array, "parameter parameter lane"]  # J^T W J at the parameters
    predicted_decrease: Lanes  # of chi2, by one more step: zero at a minimum


SETTLED = 1e-2
"""Decrease of chi2 below which a step is the last: it moves the estimate by less than a tenth
of its standard deviation, so linearly that its end needn't be evaluated."""
_RIDGE = 1e-12


class _Walk(NamedTuple):
    fit: Fit
    damping: Lanes
    live: Array
    evaluations: Array


def fit_loads(
    skin: Skin,
    target: Target,  # readings, weights, bounds
    parameters: Float[Array, "parameter lane"],  # where to start
    start: State,  # an equilibrium near there
    steps: Int[Array, ""],  # most evaluations
    *,
    contacts: int,
    wide: bool = False,  # whether they are one load over an arc, see `wide_load`
) -> Fit:
    """Levenberg-Marquardt in all lanes at once, inside bounds.

    minimise chi2(x) = sum_k w_k (y_k - SO_k(x))^2. Steps that would leave the bounds end
    on them, and what presses against a bound is left out of the predicted decrease.
    """

    def body(walk: _Walk) -> _Walk:
        old = walk.fit
        step, _ = _step(old, target, walk.damping)
        there = jnp.clip(old.parameters + step, target.low, target.high)
        new = _judged(skin, target, there, old.evaluation.state, contacts, wide)
        better = walk.live & (new.chi2 <= old.chi2)
        worse = walk.live & ~better
        damping = next_damping(walk.damping, ~worse, jnp)
        settled = better & ~(new.predicted_decrease >= SETTLED)
        lost = (better & ~jnp.isfinite(new.chi2)) | (worse & (damping > GIVEN_UP))
        live = walk.live & ~settled & ~lost
        fit = jax.tree.map(lambda x, y: jnp.where(better, x, y), new, old)
        return _Walk(fit, damping, live, walk.evaluations + 1)

    # The first turn evaluates the start itself, so that the model is compiled once.
    lanes = parameters.shape[-1]
    walk = _Walk(
        _nowhere(skin, parameters, start),
        jnp.full(lanes, FIRST_DAMPING),
        jnp.ones(lanes, bool),
        jnp.array(0),
    )

    def going(walk: _Walk) -> Array:
        return jnp.any(walk.live) & (walk.evaluations < steps)

    return _last_step(jax.lax.while_loop(going, body, walk).fit, target)


def _judged(
    skin: Skin, target: Target, parameters: Array, state: State, contacts: int, wide: bool
) -> Fit:
    """Evaluate the model and compare it with the readings."""
    e = evaluate(skin, parameters, state, contacts, wide=wide)
    used = target.weight > 0
    residual = jnp.where(used, target.so - e.so, 0.0)
    jacobian = jnp.where(used, e.jacobian, 0.0)
    weighted = jacobian * target.weight
    chi2 = jnp.sum(target.weight * residual**2, 0)
    gradient = jnp.sum(weighted * residual, 1)
    usable = (e.result == 0) & jnp.isfinite(chi2) & jnp.all(jnp.isfinite(gradient), 0)
    information = jnp.sum(weighted[:, None] * jacobian[None], 2)
    if wide:
        tangent = parameters[-1] / PRIOR_OF_TANGENT
        chi2 = chi2 + tangent**2
        gradient = gradient.at[-1].add(-tangent / PRIOR_OF_TANGENT)
        information = information.at[-1, -1].add(PRIOR_OF_TANGENT**-2)
    fit = Fit(
        parameters,
        e,
        jnp.where(usable, chi2, jnp.inf),
        jnp.where(usable, gradient, 0.0),
        jnp.where(usable, information, 0.0),
        chi2,
    )
    _, decrease = _step(fit, target, jnp.zeros_like(chi2))
    return fit._replace(predicted_decrease=jnp.where(usable, decrease, jnp.inf))


def _last_step(fit: Fit, target: Target) -> Fit:
    """Take the step of lanes that have settled, to first order."""
    settled = fit.predicted_decrease < SETTLED
    step, _ = _step(fit, target, jnp.zeros_like(fit.chi2))
    end = jnp.clip(fit.parameters + step, target.low, target.high)
    step = jnp.where(settled, end - fit.parameters, 0.0)
    change = jnp.sum(fit.evaluation.jacobian * step[:, None], 0)
    evaluation = fit.evaluation._replace(so=fit.evaluation.so + change)
    chi2 = jnp.maximum(fit.chi2 - jnp.where(settled, fit.predicted_decrease, 0.0), 0.0)
    return fit._replace(parameters=fit.parameters + step, evaluation=evaluation, chi2=chi2)


def _nowhere(skin: Skin, parameters: Array, start: State) -> Fit:
    """A fit that any other is better than, with no step to take."""
    (count, lanes), taxels = parameters.shape, skin.electrodes.taxels.angle.shape[0]
    zero = jnp.zeros(lanes)
    so = jnp.full((taxels, lanes), jnp.nan)
    jacobian = jnp.full((count, taxels, lanes), jnp.nan)
    evaluation = Evaluation(so, jacobian, zero, zero, start, jnp.ones(lanes, jnp.int32))
    infinite = zero + jnp.inf
    flat = jnp.zeros((count, count, lanes))
    return Fit(parameters, evaluation, infinite, flat[0], flat, infinite)


def _step(fit: Fit, target: Target, damping: Array) -> tuple[Array, Array]:
    """Damped Gauss-Newton step [parameter, lane] and the decrease of chi2 that it predicts."""
    here = Descent(fit.parameters, fit.gradient, fit.information, target.low, target.high)
    return damped_step(here, damping, _solve_spd, ridge=_RIDGE, xp=jnp)


def _solve_spd(matrix: Float[Array, "n n lane"], right: Float[Array, "n lane"]) -> Array:
    """Solve small symmetric positive definite systems, unrolled across lanes."""
    n = right.shape[0]
    a = [[matrix[i, j] for j in range(n)] for i in range(n)]
    x = [right[i] for i in range(n)]
    for k in range(n):
        pivot = jnp.maximum(a[k][k], 1e-14)
        for i in range(k + 1, n):
            factor = a[i][k] / pivot
            for j in range(k, n):
                a[i][j] = a[i][j] - factor * a[k][j]
            x[i] = x[i] - factor * x[k]
    for k in reversed(range(n)):
        for j in range(k + 1, n):
            x[k] = x[k] - a[k][j] * x[j]
        x[k] = x[k] / jnp.maximum(a[k][k], 1e-14)
    return jnp.stack(x)


FIT_PROGRAMS = {k: eqx.filter_jit(partial(fit_loads, contacts=k)) for k in (1, 2, 3)}
"""`fit_loads` by number of contacts, to be run by `suas_jax.runtime.compiled.COMPILED`."""
WIDE_FIT_PROGRAM = eqx.filter_jit(partial(fit_loads, contacts=1, wide=True))
"""The same of one contact of free width."""
