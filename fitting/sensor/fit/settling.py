"""A fit whose constants move the membrane: shapes are solved again until nothing changes."""

import dataclasses
from collections.abc import Callable, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from fitting.sensor.fit.priors import hierarchical, needed_priors
from fitting.sensor.fit.residuals import Prior, SensorProblem
from fitting.sensor.fit.search import Found, robust, search
from fitting.sensor.logs.data import NoCalibration
from fitting.sensor.model.constants import GAP, PATHS, is_gap
from fitting.sensor.model.counts import SensorModel
from fitting.sensor.shapes.shapes import Shapes, ShapeSolver
from fitting.statistics.residuals import sensitivity
from suas_jax.runtime.compiled import COMPILED

_ROUNDS = 16
# Change of the negative log posterior that is none, and shapes that are tried for a step. The
# first step is that of Gauss and Newton, the next ones are damped, each ten times as much.
_RISE, _TRIALS, _DAMPING = 0.5, 7, 10.0
_SAME, _SAME_AS_BUILT = 1e-7, 0.02  # of a constant's size, or of its prior's deviation
# Frames are left out where the membrane would touch the wall in a gap smaller by this.
_NEAR_CONTACT = 0.85


def away_from_the_wall(
    problem: SensorProblem, constants: np.ndarray
) -> tuple[SensorProblem, np.ndarray]:
    """Leave out frames in which the membrane touches the wall, or nearly.

    The shapes know no wall: where it holds the membrane all taxels read something else.
    """
    near, model = constants.copy(), problem.model
    gap = f"{PATHS[GAP]}."
    names = problem.family.names
    own = [i for i, name in enumerate(names) if is_gap(name) or name.startswith(gap)]
    near[own] *= _NEAR_CONTACT
    if not own:
        gaps = {
            k: _NEAR_CONTACT * x for k, x in model.inputs.items() if f"{k}.".startswith(gap)
        }
        model = dataclasses.replace(model, inputs=model.inputs | gaps)
    readings = problem.readings
    through = np.asarray(COMPILED.run(_through_the_wall, model, jnp.asarray(near), once=True))
    touching = through[readings.state] & np.isfinite(readings.so)
    present = np.isfinite(readings.so) & ~touching
    if not present.any():
        raise NoCalibration(
            "the membrane touches the wall in every frame: check the units of the known "
            "displacements or forces, and the skin's oil gap"
        )
    readings = dataclasses.replace(readings, present=present, used=present)
    return problem.replace(readings=readings), touching


@eqx.filter_jit
def _through_the_wall(
    model: SensorModel, constants: Float[Array, " p"]
) -> Bool[Array, " state"]:
    return model.through_the_wall(constants)


def settled_shapes(
    problem: SensorProblem,
    found: Found,
    shapes: Shapes,
    touching: np.ndarray,
    solver: ShapeSolver,
    stated: Sequence[float | None],
    progress: Callable[[str], None],
) -> tuple[SensorProblem, Found, Shapes, np.ndarray, bool]:
    """Add the priors that are needed; solve shapes again until no constant moves them.

    Returns the problem, its minimum, the shapes, which readings the wall takes, and whether
    nothing changes any more.
    """
    names, moving = problem.family.names, problem.model.shaping
    same = _SAME * problem.family.sizes[moving]
    if problem.correlation is not None:
        same = np.array([_SAME_AS_BUILT * problem.priors[names[i]].sd for i in moving])
    damping = 0.0
    for _ in range(_ROUNDS):
        at = np.asarray(problem.model.at)[moving]
        moved = bool((np.abs(found.constants[moving] - at) > same).any())
        told = hierarchical(problem, found.constants)
        needed = needed_priors(told, found.constants, stated)
        known = all(
            abs(prior.sd - problem.priors[name].sd) <= _SAME_AS_BUILT * prior.sd
            for name, prior in told.priors.items()
        )
        if not moved and not needed and known:
            # Of a gap that was found smaller than the file's, more frames touch.
            away, now = away_from_the_wall(problem, found.constants)
            if not (now & ~touching).any():
                return problem, found, shapes, touching, True
            touching |= now
            present = away.readings.present & ~touching
            readings = dataclasses.replace(away.readings, present=present, used=present)
            problem, found = robust(problem.replace(readings=readings), found.constants)
            continue
        step = _step(solver, problem, found.constants, damping) if moved else None
        if moved and step is None:
            break
        problem = told.replace(priors={**told.priors, **needed})
        if step is None:
            found = search(problem, found.constants)
            continue
        shapes, damping = step
        start, field = np.asarray(shapes.model.at), problem.model.factor
        problem = problem.replace(model=dataclasses.replace(shapes.model, factor=field))
        progress("fitting")
        problem, touching = away_from_the_wall(problem, start)
        problem, found = robust(problem, start)
    # Beyond the last shapes' constants the skin may buckle.
    found = dataclasses.replace(found, constants=np.asarray(problem.model.at))
    return problem, found, shapes, touching, False


def _step(
    solver: ShapeSolver, problem: SensorProblem, wanted: np.ndarray, damping: float
) -> tuple[Shapes, float] | None:
    """Shapes at constants that are no worse than the last shapes', by Levenberg and Marquardt.

    Shapes are linear about the last ones, so the wanted constants, of least cost in them, may
    be worse, or the skin may buckle there: then a step of more damping is tried.
    Returns the shapes and the damping of the next step; None where no step is any better.
    """
    last = np.asarray(problem.model.at)
    before = _cost(problem, last)
    for trial in range(_TRIALS):
        if damping:
            wanted = search(_damped(problem, damping), last).constants
        try:
            shapes = solver.at(wanted)
            model = dataclasses.replace(shapes.model, factor=problem.model.factor)
            cost = _cost(problem.replace(model=model), wanted)
        except NoCalibration:
            cost = np.nan
        if trial and abs(before - cost) <= _RISE:
            return None
        if cost <= before + _RISE:
            return shapes, damping / _DAMPING if damping > 1.0 else 0.0
        damping = max(1.0, _DAMPING * damping)
    return None


def _damped(problem: SensorProblem, damping: float) -> SensorProblem:
    """The problem with the last shapes' constants as further priors of so much information.

    It is counted in that of the constants' own priors, or in that of their sizes.
    """
    priors, share = dict(problem.priors), 1 + damping
    names, at = problem.family.names, np.asarray(problem.model.at)
    for name, last, size in zip(names, at, problem.family.sizes, strict=True):
        own = priors.get(name)
        mean, sd = float(last), float(size) / damping**0.5
        if own is not None:
            mean, sd = (own.mean + damping * mean) / share, own.sd / share**0.5
        priors[name] = Prior(mean, sd, "damping")
    return problem.replace(priors=priors)


def _cost(problem: SensorProblem, constants: np.ndarray) -> float:
    """Negative log posterior up to a constant; infinite where readings have no numbers."""
    r, _ = sensitivity(problem.residuals(), jnp.asarray(constants))
    cost = 0.5 * float(jnp.sum(r**2))
    return cost if np.isfinite(cost) else np.inf
