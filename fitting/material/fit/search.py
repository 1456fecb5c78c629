"""The search for the constants with the least sum of squares."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from fitting.material.experiments.free_zero import Zero
from fitting.material.experiments.measurements import Dataset
from fitting.material.fit.problem import MaterialProblem, pose, settle
from fitting.material.laws.with_effects import WithEffects
from fitting.statistics.least_squares import Minima, minimise, minimise_one_by_one
from fitting.statistics.parameters import AbstractFamily

SKIN_LANES = 4
"""Most starts for data of a skin, where every residual is an equilibrium."""
# A reading is wrong by the square of how far its apex stretch still is from settled.
_BULGE_ROUNDS, _SETTLED = 8, 3e-3
_BULGE_STEPS, _BULGE_STEPS_AT_LAST, _NEARLY = 4, 40, 3e-2


# Starts of what is beside the law, and steps of each; the stiffness of a long-term law and of a
# virgin one over that of the data taken as elastic.
_BESIDE, _BESIDE_STEPS, _LONG_TERM, _VIRGIN = 6, 80, 0.7, 1.2


class NoFit(ArithmeticError):  # noqa: N818
    """No constants can be returned: every start failed."""


def search(
    sets: Sequence[Dataset],
    chosen: AbstractFamily,
    kind: str,
    starts: int,
    seed: int,
    zeros: Sequence[Zero] = (),
) -> tuple[MaterialProblem, Minima]:
    """Minima from many starts, the best one first.

    Args:
        sets: the data.
        chosen: parameters of the law.
        kind: of the residuals.
        starts: number of them.
        seed: of their draw.
        zeros: of tests that are found with the law.
    """
    points = chosen.random(np.random.default_rng(seed), starts)
    problem = pose(sets, chosen, kind, zeros=zeros)
    if any(data.mode == "skin" for data in sets):
        # Every residual is an equilibrium, and the modulus is known from the start.
        return problem, minimise(problem.residuals, points[:SKIN_LANES], lanes=SKIN_LANES)
    if isinstance(chosen, WithEffects):
        return problem, _with_effects(sets, chosen, problem, starts, seed)
    if not any(data.mode == "bulge" for data in sets):
        return problem, minimise(problem.residuals, points)
    # Membranes are expensive: explore with spherical caps, then fit the best with
    # membranes, whose apex stretches follow the constants.
    estimate = pose(sets, chosen, kind, estimate=True).residuals
    rough = minimise(estimate, points, finish=False)
    found = rough
    for done in range(_BULGE_ROUNDS):
        if not np.isfinite(found.cost[0]):
            return problem, found
        best = chosen.constants(jnp.asarray(found.theta[0]), problem.residuals.scales)
        problem, change = settle(problem, np.asarray(best))
        if done and change < _SETTLED and found.converged[0]:
            break
        # States follow the constants, so there is no need to go on before they do.
        steps = _BULGE_STEPS if change > _NEARLY else _BULGE_STEPS_AT_LAST
        nearer = minimise_one_by_one(problem.residuals, found.theta[:1], steps)
        if not np.isfinite(nearer.cost[0]):
            return problem, found
        found = nearer
    # Whether another start ends there, too.
    others = np.concatenate([found.theta, rough.theta[1:2]])
    return problem, minimise_one_by_one(problem.residuals, others, _BULGE_STEPS_AT_LAST)


def _with_effects(
    sets: Sequence[Dataset],
    chosen: WithEffects,
    problem: MaterialProblem,
    starts: int,
    seed: int,
) -> Minima:
    """Minima of a law that relaxes or softens, from the best law without."""
    rng = np.random.default_rng(seed)
    elastic = pose(sets, chosen.base, problem.kind, estimate=True).residuals
    found = minimise(elastic, chosen.base.random(rng, starts))
    if not np.isfinite(found.cost[0]):
        return found
    theta = jnp.asarray(found.theta[0])
    stresses = np.array([unit == "Pa" for unit in chosen.base.units])
    factor = (_LONG_TERM if chosen.prony else 1.0) * (_VIRGIN if chosen.mullins else 1.0)
    constants = chosen.base.constants(theta, elastic.scales)
    changed = jnp.where(stresses, factor * constants, constants)
    law = np.asarray(chosen.base.unconstrained(changed, elastic.scales))
    beside = chosen.spread(rng, min(starts, _BESIDE))
    points = np.concatenate([np.tile(law, (len(beside), 1)), beside], axis=1)
    return minimise_one_by_one(problem.residuals, points, _BESIDE_STEPS)
