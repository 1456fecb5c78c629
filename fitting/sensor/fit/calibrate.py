"""Calibrate a skin's electrical constants, and its material's, from logs with known inputs.

SO = (C_stray + eps0 eps A <1/d>) / lsb: at rest only permittivity over gap shows; a known
displacement changes d by a known amount and tells the gap itself; a second fluid of known
permittivity tells gap times scale. What the logs at hand determine is read from the
derivatives of the readings; a constant that they leave open keeps the value of the skin
file within a stated tolerance (a prior), and the report says so.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import jax.numpy as jnp
import numpy as np

from fitting.sensor.fit.assumptions import elastic_warning, exact_membrane_warning
from fitting.sensor.fit.checks import check_agreement, drift_warning
from fitting.sensor.fit.input_noise import (
    NO_INPUT_ERRORS,
    InputErrors,
    InputNoise,
    stated_errors,
    with_input_errors,
)
from fitting.sensor.fit.priors import as_built_priors, needed_priors, prior_of
from fitting.sensor.fit.residuals import Prior, SensorProblem
from fitting.sensor.fit.result import SensorFit, judged_fit, with_discrepancy
from fitting.sensor.fit.search import Found, robust, search
from fitting.sensor.fit.settling import away_from_the_wall, settled_shapes
from fitting.sensor.fit.suspects import zeros_off
from fitting.sensor.logs.data import SensorData
from fitting.sensor.logs.readings import averaged, gathered, measured_noise, with_model_error
from fitting.sensor.logs.shared_errors import apart
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
    SensorConstant,
    SensorFamily,
    is_gap,
    moves_membrane,
    named,
    naming,
    single_gaps,
    starting_values,
)
from fitting.sensor.shapes.shapes import Shapes, ShapeSolver
from suas_jax.acquisition.baseline import Baseline
from suas_jax.runtime.compiled import require_float64
from suas_jax.skin.plain import angles_at, plain_geometry

_FIELD_ROUNDS = 2
# Presses by bodies or on pads, beyond which errors of what was told of them are not looked at
# unasked: each is then solved by itself and once more for its derivative, up to seconds.
_FEW = 30
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
    input_noise: Mapping[str, float] | None = None,
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
        input_noise: standard deviations of known "force" [N], "displacement" and "depth" [m];
            None for what the readings show.
        like: a calibration of the same known states, whose shapes are used again.
        progress: called with what is being done.

    Raises:
        ValueError: an argument is not allowed.
        NoCalibration: the logs don't follow the skin's model at all.
        Float64Error: float64 is off.
    """
    require_float64()
    drawing, own, frames, looked = data.spec, AS_BUILT in fit, np.zeros(0), False
    if own:
        if len(fit) > 1 or gaps != "global" or (like, input_noise) != (None, None):
            raise ValueError(
                f"--fit {AS_BUILT} finds the gap, every other constant of a unit and how exact "
                "forces are: name no other one, and leave --gap and noises of known inputs out"
            )
        data, frames = averaged(_as_built(data))
        fit = as_built_names(data.spec)
    else:
        data, looked = _apart(data, stated=input_noise is not None)
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
    held = _held(parts, stated)
    correlation = None
    if own:
        places = data.loads.angle[0, pressed]
        before, correlation = as_built_priors(drawing, parts, start, places)
        given = before | given
        share = MODEL_ERROR[drawing.geometry.dimension]
        readings = with_model_error(readings, frames, data.loaded, share)
    problem = SensorProblem(shapes.model, readings, held | given, correlation)
    inputs = _input_errors(solver, shapes, like, input_noise) if looked else NO_INPUT_ERRORS
    problem = stated_errors(problem, loads, inputs)
    problem, touching = away_from_the_wall(problem, start)
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
    settled = settled_shapes(problem, found, shapes, touching, solver, stated, progress)
    problem, found, shapes, touching, steady = settled
    problem, found, doubts = _checked(data, problem, found)
    shown = with_input_errors(problem, found, loads, inputs, solver, shapes)
    problem, found, inputs, shapes = shown
    if problem.readings.input_errors is not None and problem.model.moving:
        settled = settled_shapes(problem, found, shapes, touching, solver, stated, progress)
        problem, found, shapes, touching, steady = settled
    warnings = [*data.warnings, *solver.warnings, "" if steady else _UNSTEADY, *doubts]
    # As built, the noise is that of means, with the model's error.
    noise = readings.sigma.min(1, keepdims=True) * np.ones(readings.logs)
    if not own:
        problem, found, noise = _with_measured_noise(problem, found)
        warnings += zeros_off(problem, found.constants, loads, inputs, solver)
    judged = judged_fit(
        data, problem, found, shapes, loads, noise, touching, steady, inputs, warnings
    )
    return with_discrepancy(judged) if own else judged


def _apart(data: SensorData, *, stated: bool) -> tuple[SensorData, bool]:
    """Presses with errors of their own, and whether these are looked at, or are stated."""
    separate = apart(data)
    alone = data.spec.geometry.dimension == 3 or data.loads.bodies
    looked = stated or not alone or separate.loads.states <= _FEW
    return (separate, looked) if looked else (data, looked)


def _held(parts: Sequence[SensorConstant], stated: Sequence[float | None]) -> dict[str, Prior]:
    """Filling and mounting do much the same: the first fit holds both near the file's."""
    return {
        part.name: prior_of(part, value, "")
        for part, value in zip(parts, stated, strict=True)
        if part.name in (FILL, MOUNTING)
    }


def _checked(
    data: SensorData, problem: SensorProblem, found: Found
) -> tuple[SensorProblem, Found, list[str]]:
    """The fit with drift taken out, and what is doubtful in it.

    Raises NoCalibration: the logs are of another skin, or units are mixed up.
    """
    exact = exact_membrane_warning(problem.family, data) if problem.correlation is None else ""
    doubts, drifts = [elastic_warning(data), exact], drift_warning(problem, found.constants)
    if drifts:
        doubts.append(drifts)
        drifting = dataclasses.replace(problem.readings, drifting=True)
        problem, found = robust(problem.replace(readings=drifting), found.constants)
    return problem, found, doubts + check_agreement(problem, found.constants, data)


def _input_errors(
    solver: ShapeSolver,
    shapes: Shapes,
    like: SensorFit | None,
    stated: Mapping[str, float] | None,
) -> InputErrors:
    """What readings change by with known inputs, and what is stated of these."""
    if like is None:
        slopes = solver.by_inputs(shapes)
    else:
        fluid = np.asarray(like.problem.model.permittivity)
        slopes = like.input_errors.slopes[..., solver.alike(like.loads, fluid)]
    return InputErrors(slopes, InputNoise(dict(stated or {}), stated is not None))


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
