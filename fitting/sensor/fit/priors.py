"""Priors for what the logs leave open, and what the logs tell without them.

A constant whose standard error would exceed a share of its size is left open by the data:
it keeps the value of the skin file within a stated tolerance, and the report says so.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from fitting.sensor.fit.residuals import Prior, SensorProblem, bounds_of
from fitting.sensor.logs.data import SensorData
from fitting.sensor.model.as_built import Alike, as_built_deviations, is_gain
from fitting.sensor.model.constants import (
    FILL,
    FORCE_ZERO,
    GAP,
    LAYERS,
    MOUNTING,
    PATHS,
    PERMITTIVITY,
    SCALE,
    STRAY,
    THICKNESS,
    TOUCH,
    SensorConstant,
    is_gap,
    is_press_error,
    moves_membrane,
)
from suas_jax.config import SkinSpec
from suas_jax.config.inputs import given_inputs
from suas_jax.config.tolerance import deviation_of

OPEN = 0.05
"""Share of its size up to which a standard error leaves a constant known."""
# Tolerance of what a skin file says, where nothing else does: standard deviations relative
# to natural sizes.
TOLERANCE = {
    PERMITTIVITY: 0.1,
    GAP: 0.05,
    SCALE: 0.01,
    STRAY: 0.1,
    LAYERS: 0.1,
    FILL: 0.1,
    MOUNTING: 0.1,
    THICKNESS: 0.03,
    TOUCH: 0.02,
    FORCE_ZERO: 0.02,
}
_MATERIAL_TOLERANCE = 0.1
_EXACT = 1e-6  # of a constant that the file declares exact (+- 0), relative to its size
# What gets a prior first.
_LEAST_KNOWN = (LAYERS, STRAY, SCALE)
# Constants that are linked to one with a prior are no better known than it.
_LINKED = 2.0
_FIXED = 1e6
_EXPECTATIONS = 30  # steps of expectation and maximisation, each at a fraction of a search
_BARELY = 0.9  # of the deviation that the drawing allows


def is_static(problem: SensorProblem) -> bool:
    """Whether all readings that are used are of one state in one fluid."""
    here = problem.readings
    return len(np.unique(here.state[here.used.any(0)])) == 1


def prior_of(part: SensorConstant, stated: float | None, reason: str) -> Prior:
    """The prior of a constant that the data leave open.

    Its standard deviation is the skin file's (``+-``), or `TOLERANCE` where that states none.

    `stated` is what the skin file says, SI, None where it says nothing; the reason is why the
    prior is needed.
    """
    mean = stated if stated is not None else (part.size if part.positive else 0.0)
    deviation = deviation_of(stated)
    if deviation is not None:
        sd = max(deviation, _EXACT * part.size)
        return Prior(float(mean), sd, f"{reason}; the skin file states its tolerance")
    share = TOLERANCE.get(part.name.split(".")[0], _MATERIAL_TOLERANCE)
    return Prior(mean, share * part.size, reason)


def as_built_priors(
    drawing: SkinSpec,
    parts: Sequence[SensorConstant],
    stated: np.ndarray,
    angle: np.ndarray | None = None,
) -> tuple[dict[str, Prior], np.ndarray]:
    """Priors of all that a unit has of its own, and their correlations [p, p].

    The stated values are those of the constants in the skin file [p]; presses whose errors are
    among the constants have angles [press] [rad].
    """
    deviations, correlation = as_built_deviations(drawing, parts, angle)
    found = {}
    for part, value in zip(parts, stated, strict=True):
        own = prior_of(part, _stated(drawing, part, value), "")
        sd = deviations.get(part.name, own.sd)
        found[part.name] = Prior(float(value), sd, "given: as the drawing allows")
    return found, correlation


def _stated(drawing: SkinSpec, part: SensorConstant, value: float) -> float:
    """A constant's value with the deviation that the skin file states."""
    given = given_inputs(drawing).get(PATHS.get(part.name, part.name), value)
    return given if deviation_of(given) is not None else float(value)


def hierarchical(problem: SensorProblem, constants: np.ndarray) -> SensorProblem:
    """The problem with the deviations that constants share as these tell them themselves.

    The constants c are the most probable ones under the priors so far, of information P. Under
    others, of P', they move by (I + P')^-1 (P - P') (c - mean), where I is the readings' own
    information and readings are linear about them.
    """
    names = problem.family.names
    groups = Alike.of(names) if problem.correlation is not None else ()
    if not groups:
        return problem
    means = np.array([problem.priors[name].mean for name in names])
    sizes = problem.relative_sizes(constants)
    told, before = problem.information(constants), problem.prior_information(constants)
    for _ in range(_EXPECTATIONS):
        now = problem.prior_information(constants)
        covariance = np.linalg.inv(told + now)
        at = constants + sizes * (covariance @ ((before - now) @ ((constants - means) / sizes)))
        variance = np.diag(covariance) * sizes**2
        priors = dict(problem.priors)
        for own in groups:
            sd = own.shared_deviation((at - means)[own.rows], variance[own.rows])
            for i in own.rows:
                priors[names[i]] = dataclasses.replace(priors[names[i]], sd=sd)
        problem = problem.replace(priors=priors)
    return problem


def needed_priors(
    problem: SensorProblem, constants: np.ndarray, stated: Sequence[float | None]
) -> dict[str, Prior]:
    """Priors that the data ask for beside those that there are.

    The data are judged at the constants, SI [p]; `stated` is what the skin file says of each.
    """
    names = problem.family.names
    information = problem.information(constants) + problem.prior_information(constants)
    sizes = problem.relative_sizes(constants)
    static = is_static(problem)
    needed: dict[str, Prior] = {}
    for i in _order(names):
        all_ = {**problem.priors, **needed}
        if names[i] in all_:
            continue
        shares = [prior.sd / sizes[names.index(name)] for name, prior in all_.items()]
        limit = max([OPEN, *(_LINKED * share for share in shares)])
        reason = ""
        if bounds_of(information)[i] > limit:
            reason = "the logs leave it open"
        elif is_gap(names[i]) and static and not any(map(is_gap, all_)):
            # Under a load the pattern would tell, but only as far as the model is exact.
            reason = "one static state in one fluid determines permittivity over gap only"
        if reason:
            needed[names[i]] = prior_of(problem.family.parts[i], stated[i], reason)
            information[i, i] += (sizes[i] / needed[names[i]].sd) ** 2
    return needed


def _order(names: tuple[str, ...]) -> list[int]:
    """Constants, the one that gets a prior first leading."""
    moving = [name for name in names if moves_membrane(name)][::-1]
    last = [*filter(is_gap, names), PERMITTIVITY]
    return [names.index(n) for n in (*_LEAST_KNOWN, *moving, *last) if n in names]


def findings(problem: SensorProblem, constants: np.ndarray, inflation: float) -> list[str]:
    """What the data don't determine, in words.

    The constants are the fitted ones, SI [p]; inflation is a factor on standard errors.
    """
    names = problem.family.names
    information = problem.information(constants) / inflation**2
    if problem.correlation is not None:
        return _barely_told(problem, information, constants)
    alone = bounds_of(information)
    open_ = {name for name, error in zip(names, alone, strict=True) if not error < OPEN}
    open_ |= {name for name, prior in problem.priors.items() if not prior.given}
    pair = {name for name in names if name == PERMITTIVITY or is_gap(name)}
    found = []
    if (
        PERMITTIVITY in pair
        and any(map(is_gap, open_))
        and _only_the_ratio(problem, information, constants, pair)
    ):
        others = sorted(open_ - pair)
        why = "one static state in one fluid: " if is_static(problem) else ""
        found.append(
            f"{why}only the ratio {PERMITTIVITY}/{GAP} is determined"
            + (f" (with {', '.join(others)} as assumed)" if others else "")
            + "; vary a known displacement or load, or add a log in a fluid of known "
            "permittivity (air), to tell them apart"
        )
        open_ -= pair
    values, vectors = np.linalg.eigh(information)
    for name in sorted(open_):
        i = names.index(name)
        weak = vectors[:, np.argmax(np.abs(vectors[i]) / np.sqrt(np.abs(values) + 1e-30))]
        partners = [
            other
            for other, share in zip(names, weak, strict=True)
            if other != name and abs(share) > 0.1
        ]
        trade = f"; it trades against {', '.join(partners)}" if partners else ""
        found.append(f"{name} is not determined{trade}")
    return found


def _barely_told(
    problem: SensorProblem, information: np.ndarray, constants: np.ndarray
) -> list[str]:
    """Constants of a unit of which the presses tell little beyond the drawing."""
    before = np.linalg.inv(problem.prior_information(constants))
    after = np.linalg.inv(information + problem.prior_information(constants))
    left = np.sqrt(np.diag(after) / np.diag(before))
    names = [
        name
        for name, share in zip(problem.family.names, left, strict=True)
        if share > _BARELY and not is_press_error(name)
    ]
    gains = [name for name in names if is_gain(name)]
    if len(gains) > 1:
        names = [name for name in names if name not in gains]
        names.append(f"the gains of {len(gains)} channels")
    return (
        [f"the presses tell little beyond the drawing of {', '.join(names)}"] if names else []
    )


def _only_the_ratio(
    problem: SensorProblem, information: np.ndarray, constants: np.ndarray, pair: set[str]
) -> bool:
    """Whether the permittivity is known where gaps are, and open where they are.

    All other constants are as the skin file says.
    """
    if is_static(problem):
        return True
    names = problem.family.names
    sizes = problem.relative_sizes(constants)
    held = information.copy()
    for name in set(names) - pair:
        i = names.index(name)
        held[i, i] += (sizes[i] / prior_of(problem.family.parts[i], None, "").sd) ** 2
    permittivity = names.index(PERMITTIVITY)
    alone = bounds_of(held)[permittivity]
    for name in pair - {PERMITTIVITY}:
        held[names.index(name), names.index(name)] += _FIXED**2
    return bool(bounds_of(held)[permittivity] < OPEN and not alone < OPEN)


def log_contributions(
    problem: SensorProblem, constants: np.ndarray, inflation: float, data: SensorData
) -> list[dict[str, Any]]:
    """Standard errors that each log and each fluid would give alone, without priors.

    The constants are the fitted ones, SI [p]; inflation is a factor on standard errors.
    """
    here = problem.readings
    rows: list[tuple[str, np.ndarray]] = []
    if len(data.files) > 1:
        rows += [(file.path, here.log == k) for k, file in enumerate(data.files)]
    known = np.isfinite(np.asarray(problem.model.permittivity))[here.state]
    if known.any() and not known.all():
        rows += [("oil alone", ~known), ("known fluid alone", known)]
    rows.append(("all", np.ones(len(here.state), bool)))
    sizes = problem.relative_sizes(constants)
    found = []
    for name, frames in rows:
        errors = bounds_of(problem.information(constants, frames)) * inflation
        told = [
            float(error * size) if error < OPEN else None
            for error, size in zip(errors, sizes, strict=True)
        ]
        found.append(
            {
                "logs": name,
                "frames": int((here.used.any(0) & frames).sum()),
                "states": len(np.unique(here.state[frames])),
                "standard_errors": dict(zip(problem.family.names, told, strict=True)),
            }
        )
    return found
