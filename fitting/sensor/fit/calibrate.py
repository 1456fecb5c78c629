"""Calibrate a skin's electrical constants, and its material's, from logs with known inputs.

SO = (C_stray + eps0 eps A <1/d>) / lsb: at rest only permittivity over gap shows; a known
displacement changes d by a known amount and tells the gap itself; a second fluid of known
permittivity tells gap times scale. What the logs at hand determine is read from the
derivatives of the readings; a constant that they leave open keeps the value of the skin
file within a stated tolerance (a prior), and the report says so.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from fitting.sensor.fit.assumptions import elastic_warning, exact_membrane_warning
from fitting.sensor.fit.checks import check_agreement, drift_warning
from fitting.sensor.fit.lacking import with_discrepancy
from fitting.sensor.fit.priors import (
    as_built_priors,
    hierarchical,
    needed_priors,
    prior_of,
)
from fitting.sensor.fit.residuals import Prior, SensorProblem
from fitting.sensor.fit.result import SensorFit, judged_fit
from fitting.sensor.fit.search import Found, robust, search
from fitting.sensor.logs.data import NoCalibration, SensorData
from fitting.sensor.logs.readings import (
    averaged,
    gathered,
    measured_noise,
    with_model_error,
)
from fitting.sensor.model.as_built import (
    AS_BUILT,
    MODEL_ERROR,
    PLACE_ERROR,
    as_built,
    as_built_names,
    press_errors,
)
from fitting.sensor.model.constants import (
    DEFAULT,
    FILL,
    GAP,
    MOUNTING,
    PATHS,
    SensorFamily,
    is_gap,
    moves_membrane,
    named,
    naming,
    single_gaps,
    starting_values,
)
from fitting.sensor.model.counts import SensorModel
from fitting.sensor.shapes.shapes import Shapes, ShapeSolver
from fitting.statistics.residuals import sensitivity
from suas_jax.acquisition.baseline import Baseline
from suas_jax.runtime.compiled import COMPILED, require_float64
from suas_jax.skin.plain import angles_at, plain_geometry

_ROUNDS = 16
# Change of the negative log posterior that is none, and shapes that are tried for a step. The
# first step is that of Gauss and Newton, the next ones are damped, each ten times as much.
_RISE, _TRIALS, _DAMPING = 0.5, 7, 10.0
_SAME, _SAME_AS_BUILT = 1e-7, 0.02  # of a constant's size, or of its prior's deviation
# Frames are left out where the membrane would touch the wall in a gap smaller by this.
_NEAR_CONTACT = 0.85
_FIELD_ROUNDS = 2
_UNSTEADY = (
    "the fit has not settled: the skin nearly buckles, or the constants that move the membrane "
    "are far from the skin file's; put better values into it"
)


def fit_sensor(
    data: SensorData,
    fit: Sequence[str] = DEFAULT,
    *,
    priors: Mapping[str, tuple[float, float]] | None = None,
    baseline: Baseline | None = None,
    offsets: bool = False,
    air: str = "skin",
    gaps: str = "global",
    like: SensorFit | None = None,
    model: str = "auto",
    field: bool = False,
    place_error: float = PLACE_ERROR,
    progress: Callable[[str], None] = lambda text: None,
) -> SensorFit:
    """Find the constants that follow the logs best, and say how far they can be known.

    Args:
        data: the logs.
        fit: names of the constants: permittivity, gap, scale, stray, layers, material.C1 ...;
            or `AS_BUILT` alone for all that a unit has of its own, see `as_built`.
        priors: mean and standard deviation by name, SI, that are always used.
        baseline: counts at rest, which fix an offset of every taxel.
        offsets: give every taxel an offset of its own.
        air: how air in the gap responds: "skin" (as the skin file says), "trapped" or
            "vented".
        gaps: whether all taxels share one gap ("global"), those of a module ("module"), or
            each has its own ("taxel").
        model: "shell", "solid" (the shell with the solid's correction), or "auto": the
            solid, unless the logs say that `suas simulate` made them, which has the shell.
        field: take capacitances from the electrostatic field instead of the formula.
        place_error: standard deviation of the presses' places, with `AS_BUILT` [m].
        like: a calibration of the same known states, whose shapes are used again.
        progress: called with what is being done.

    Raises:
        ValueError: an argument is not allowed.
        NoCalibration: the logs don't follow the skin's model at all.
        Float64Error: float64 is off.
    """
    require_float64()
    drawing, own = data.spec, AS_BUILT in fit
    frames = np.zeros(0)
    if own:
        if len(fit) > 1 or gaps != "global" or like is not None:
            raise ValueError(
                f"--fit {AS_BUILT} finds the gap and every other constant of a unit: name no "
                "other one, and leave --gap out"
            )
        data, frames = averaged(_as_built(data))
        fit = as_built_names(data.spec)
    data = dataclasses.replace(data, spec=naming(data.spec, fit))
    parts = tuple(dict.fromkeys(named(data.spec, name) for name in fit))
    if not parts:
        raise ValueError("--fit: name at least one constant")
    parts, gap_of = single_gaps(data.spec, parts, gaps)
    pressed = [int(k) for k in np.flatnonzero(data.loaded)] if own else []
    parts += tuple(press_errors(data.spec, len(pressed), place_error))
    family = SensorFamily(parts)
    given = _given(data, family, priors or {})
    _check_kind(data, family, gap_of, model=model, field=field)
    readings, loads, permittivity = gathered(data, baseline, offsets or own)
    solver = ShapeSolver(
        data,
        loads,
        permittivity,
        family,
        gap_of,
        air=air,
        model=model,
        progress=progress,
        pressed=pressed,
    )
    stated = [solver.stated(name) for name in family.names]
    start = starting_values(parts, stated)
    shapes = solver.at(start) if like is None else solver.again(like.shapes, like.loads, start)
    # Filling and mounting do much the same: the first fit holds both near the file's.
    held = {
        part.name: prior_of(part, value, "")
        for part, value in zip(parts, stated, strict=True)
        if part.name in (FILL, MOUNTING)
    }
    correlation = None
    if own:
        places = data.loads.angle[0, pressed]
        before, correlation = as_built_priors(drawing, parts, start, places)
        given = before | given
        share = MODEL_ERROR[drawing.geometry.dimension]
        readings = with_model_error(readings, frames, data.loaded, share)
    problem = SensorProblem(shapes.model, readings, held | given, correlation)
    problem, touching = _away_from_the_wall(problem, start)
    progress("fitting")
    problem, found = robust(problem, start)
    if held:
        problem = problem.replace(priors=given)
        needed = needed_priors(problem, found.constants, stated)
        problem = problem.replace(priors=given | needed)
        found = search(problem, found.constants)
    if field:
        progress("solving the electrostatic field")
        for _ in range(_FIELD_ROUNDS):
            exact = problem.model.with_field(jnp.asarray(found.constants))
            problem, found = robust(problem.replace(model=exact), found.constants)
    settled = _settled(problem, found, shapes, touching, solver, stated, progress)
    problem, found, shapes, touching, steady = settled
    warnings = [*data.warnings, *solver.warnings, "" if steady else _UNSTEADY]
    warnings += [elastic_warning(data), "" if own else exact_membrane_warning(family, data)]
    drifts = drift_warning(problem, found.constants)
    if drifts:
        warnings.append(drifts)
        drifting = dataclasses.replace(problem.readings, drifting=True)
        problem, found = robust(problem.replace(readings=drifting), found.constants)
    warnings += check_agreement(problem, found.constants, data)
    # As built, the noise is that of means, with the model's error.
    noise = readings.sigma.min(1, keepdims=True) * np.ones(readings.logs)
    if not own:
        problem, found, noise = _with_measured_noise(problem, found)
    judged = judged_fit(data, problem, found, shapes, loads, noise, touching, steady, warnings)
    return with_discrepancy(judged) if own else judged


def _as_built(data: SensorData) -> SensorData:
    """The logs of a unit as it was built, known loads where the drawing has them.

    A section of uneven thickness counts angles along its own mid-line, so places are kept as
    arcs of the inner face.
    """
    spec, angle = as_built(data.spec), data.loads.angle
    section = plain_geometry(data.spec.geometry).section
    arc = np.asarray(section.arc(jnp.asarray(angle).reshape(-1, 1))).reshape(angle.shape)
    places = angles_at(spec.geometry, "arc", arc)
    loads = dataclasses.replace(data.loads, angle=places)
    return dataclasses.replace(data, spec=spec, loads=loads)


def _check_kind(
    data: SensorData,
    family: SensorFamily,
    gap_of: tuple[int, ...] | None,
    *,
    model: str,
    field: bool,
) -> None:
    """Refuse what the skin's dimension, or the field, leaves out."""
    pad = data.spec.geometry.dimension == 3
    if pad and (field or model == "solid"):
        raise ValueError("--field and --model solid: in plane strain only; leave them out")
    if not pad and (data.loads.axial.any() or data.loads.diameter.any()):
        raise ValueError("axial positions and diameters of known loads need a pad")
    if field and (gap_of is not None or any(map(moves_membrane, family.names))):
        raise ValueError(
            "--field: with one gap for all taxels, and without what moves the membrane"
        )


def _given(
    data: SensorData, family: SensorFamily, priors: Mapping[str, tuple[float, float]]
) -> dict[str, Prior]:
    found = {}
    for name, (mean, sd) in priors.items():
        own = named(data.spec, name).name if name not in family.names else name
        if own not in family.names:
            if own == GAP and any(map(is_gap, family.names)):
                raise ValueError("--prior gap: name each one, such as oil_gap.0")
            raise ValueError(
                f"--prior {name}: it is not fitted; name it in --fit (fitted are "
                f"{', '.join(family.names)})"
            )
        found[own] = Prior(mean, sd, "given with --prior")
    return found


def _away_from_the_wall(
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


def _settled(
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
            away, now = _away_from_the_wall(problem, found.constants)
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
        problem, touching = _away_from_the_wall(problem, start)
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


def _with_measured_noise(
    problem: SensorProblem, found: Found
) -> tuple[SensorProblem, Found, np.ndarray]:
    """Measure the noise in the residuals, log by log, and fit with it."""
    here = problem.readings
    errors = problem.standardised(found.constants) * here.sigma
    noise = measured_noise(here, errors, problem.family.size)
    sigma = np.where(here.log >= 0, noise[:, here.log], here.sigma)
    problem = problem.replace(readings=dataclasses.replace(here, sigma=sigma))
    return problem, search(problem, found.constants), noise
