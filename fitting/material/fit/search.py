"""The search for the constants with the least sum of squares."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from fitting.material.experiments.free_zero import Zero
from fitting.material.experiments.measurements import Dataset
from fitting.material.fit.corrected_model import minimise_corrected
from fitting.material.fit.problem import MaterialProblem, pose
from fitting.material.fit.residuals import Residuals
from fitting.material.laws.with_effects import WithEffects
from fitting.statistics.least_squares import Minima, minimise, minimise_one_by_one
from fitting.statistics.parameters import AbstractFamily
from suas_jax.config.quantities import format_quantity

SKIN_LANES = 4
"""Most starts for data of a skin, where every residual is an equilibrium."""
# Of a bulge test's fit: most evaluations of a start by either method, how far like starts are
# moved apart, and the largest parameter that a minimum may have.
_BULGE_STEPS, _APART, _FARTHEST = 40, 0.1, 300.0

# Starts of what is beside the law, and steps of each; the stiffness of a long-term law and of a
# virgin one over that of the data taken as elastic.
_BESIDE, _BESIDE_STEPS, _LONG_TERM, _VIRGIN = 6, 80, 0.7, 1.2

# Smallest shear modulus of a law over that of the least deformed readings: below it the search
# was on its way to zero, where no minimum is.
_LEAST_STIFFNESS = 1e-3


class NoFit(ArithmeticError):  # noqa: N818
    """No constants can be returned: every start failed, or the best is no rubber."""


def refuse_without_stiffness(
    sets: Sequence[Dataset], family: AbstractFamily, constants: np.ndarray
) -> None:
    """Refuse constants of a law that has no stiffness at rest.

    Args:
        sets: the data.
        family: the law.
        constants: those that follow the data best, SI units.

    Raises:
        NoFit: the law refuses the constants, or its shear modulus is below a thousandth of
            what the least deformed readings of every test suggest.
    """
    suggested = min((data.modulus for data in sets if data.modulus > 0.0), default=0.0)
    try:
        modulus = float(family.law(jnp.asarray(constants)).shear_modulus)
    except ValueError as error:  # rounding leaves nothing of a sum such as C1 + C2
        reason = str(error)
    else:
        if modulus > _LEAST_STIFFNESS * suggested:
            return
        found, wanted = (format_quantity(x, "stress") for x in (modulus, suggested))
        reason = f"its shear modulus is {found}, the least deformed readings suggest {wanted}"
    raise NoFit(
        f"{family.title}: follows the data best without stiffness at rest ({reason}); choose "
        f"another law"
    )


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
    # Membranes are expensive: explore with spherical caps, which then lead the way.
    caps = pose(sets, chosen, kind, estimate=True).residuals
    rough = minimise(caps, points, finish=False).theta
    # The plain guess may have membranes where the rough minima have none. What may be the same
    # is moved apart, so that it means something if both agree.
    some = [rough[0], rough[:2][-1] + _APART, points[0], points[0] + _APART]
    return problem, _with_membranes(problem.residuals, caps, some)


def _with_membranes(
    membranes: Residuals, caps: Residuals, starts: Sequence[np.ndarray]
) -> Minima:
    """Minima from a few starts, one after the other until two agree."""
    found: list[Minima] = []
    for start in starts:
        near = minimise_corrected(membranes, caps, start, _BULGE_STEPS)
        end = minimise_one_by_one(membranes, near[None], _BULGE_STEPS)
        # Beyond this, a law's constants are zero or have no number.
        sound = np.max(np.abs(end.theta)) < _FARTHEST
        found.append(end if sound else end._replace(cost=np.array([np.inf])))
        parts = [np.concatenate(part) for part in zip(*found, strict=True)]
        order = np.argsort(parts[1], kind="stable")
        minima = Minima(*(part[order] for part in parts))
        if minima.agreeing > 1:
            break
    return minima


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
