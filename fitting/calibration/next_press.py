"""Where to press next: the presses that make forces over the skin known best.

A unit's constants c (`fitting.sensor.model.as_built`) are known to within a covariance C. A
press k whose place and force x_k are known to within S adds, with J = dy/dc and L = dy/dx of
the readings' change y from rest and their inverse variances W (Fisher), ::

    I_k = J^T W J - J^T W L (L^T W L + S^-1)^-1 L^T W J,     C <- (C^-1 + I_k)^-1

A contact found later by the same taxels, nothing known of its place and force, has at best the
covariance (Cramer and Rao) ::

    V = (L^T W L - L^T W J (C^-1 + J^T W J)^-1 J^T W L)^-1

The next press is the one that leaves the smallest mean of the force's relative variance over
the skin (A-criterion), with the exact derivatives of the shapes at the skin as its file has it.
On pads the gains of hundreds of channels count as noise that every press draws anew, so that
they are planned as quickly as sections: the stated errors are the larger for it.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from fitting.arrays import Floats
from fitting.calibration.plan import Press, edge_of, place_name, settable
from fitting.inverse_load.zero.update import force_deviations
from fitting.sensor.fit.priors import as_built_priors
from fitting.sensor.logs.data import SensorData
from fitting.sensor.logs.known_loads import KnownLoads
from fitting.sensor.model.as_built import (
    GAIN_ERROR,
    MODEL_ERROR,
    PLACE_ERROR,
    as_built,
    as_built_names,
    is_gain,
    press_errors,
)
from fitting.sensor.model.constants import (
    STIFFNESS,
    SensorConstant,
    SensorFamily,
    named,
    starting_values,
)
from fitting.sensor.model.counts import SensorModel
from fitting.sensor.shapes.shapes import ShapeSolver
from suas_jax.config import SkinSpec
from suas_jax.runtime.compiled import COMPILED, require_float64
from suas_jax.skin.plain import angles_at

_ARC, _AXIAL = 15, 5  # candidates along the arc and, on pads, along the axis
_PAD_ARC = 7
_REACH = 0.8  # of the half angle and of the half length
_FORCES = (0.5, 1.0)  # of the largest force
_READ = 50  # frames that a press is the mean of


class Candidates(NamedTuple):
    """What presses would tell."""

    presses: tuple[Press, ...]  # places and forces
    by_constant: Floats  # J of the readings' change from rest [press, taxel, constant]
    by_press: Floats  # L, by places and, last, by the relative force [press, taxel, kind]
    weight: Floats  # W, inverse variances of the mean readings of a known press [press, taxel]
    weight_once: Floats  # the same of single frames, of contacts that are found [press, taxel]
    press_information: Floats  # S^-1 [press, kind]
    covariance: Floats  # C of the constants before any press [constant, constant]


class Plan(NamedTuple):
    """Presses in their order, and what they leave open."""

    presses: tuple[Press, ...]  # where to press
    # median relative standard deviation of a force over the skin before the first press and
    # after each
    accuracy: tuple[float, ...]
    errors: Floats  # the same of every candidate, likewise [press, candidate]
    candidates: tuple[Press, ...]  # what was chosen from

    @property
    def text(self) -> str:
        """For a person: a line a press."""
        lines = [f"forces over the skin, median: {100 * self.accuracy[0]:.2g} % before"]
        for k, (press, error) in enumerate(zip(self.presses, self.accuracy[1:], strict=True)):
            lines.append(f"{k + 1}. press {press.text}: {100 * error:.2g} % afterwards")
        return "\n".join(lines)

    def report(self) -> dict[str, Any]:
        """For `--json`; SI units, angles in degrees."""
        return {
            "force_error_before": self.accuracy[0],
            "presses": [
                press.report() | {"force_error_after": error}
                for press, error in zip(self.presses, self.accuracy[1:], strict=True)
            ],
        }


def told_by(candidates: Candidates) -> Floats:
    """I_k of every press, its place and force left open as far as they are [press, p, p]."""
    found = []
    for J, L, w, known in zip(*candidates[1:4], candidates.press_information, strict=True):
        both = (J * w[:, None]).T @ L
        own = (L * w[:, None]).T @ L + np.diag(known)
        found.append((J * w[:, None]).T @ J - both @ np.linalg.solve(own, both.T))
    return np.array(found)


def force_errors(candidates: Candidates, information: Floats) -> Floats:
    """Least relative standard deviation of every candidate's force, if it were found [press].

    Candidates are contacts over the skin, the information is C^-1 of the constants [p, p].
    """
    J, L = (x.swapaxes(1, 2) for x in (candidates.by_constant, candidates.by_press))
    return force_deviations(J, L, candidates.weight_once, information)


def planned(candidates: Candidates, most: int, accuracy: float = 0.0) -> Plan:
    """Choose presses one by one, each the one that helps most.

    Each candidate is there once: equal presses would share one place error. At most `most`
    presses are chosen; choosing stops where the median relative standard deviation of forces
    has come down to `accuracy`.
    """
    information = np.asarray(np.linalg.inv(candidates.covariance), float)
    told = told_by(candidates)
    errors = [force_errors(candidates, information)]
    chosen: list[int] = []
    while len(chosen) < min(most, len(told)) and np.median(errors[-1]) > accuracy:
        left = [k for k in range(len(told)) if k not in chosen]
        each = {k: force_errors(candidates, information + told[k]) for k in left}
        best = min(left, key=lambda k: float(np.mean(each[k] ** 2)))
        chosen.append(best)
        information = information + told[best]
        errors.append(each[best])
    return Plan(
        tuple(candidates.presses[k] for k in chosen),
        tuple(float(np.median(own)) for own in errors),
        np.array(errors),
        candidates.presses,
    )


def candidates_of(
    spec: SkinSpec,  # the skin, with electrodes; a calibration as built counts as what is known
    force: float,  # the largest [N]
    place_error: float = PLACE_ERROR,  # standard deviation of the places [m]
    progress: Callable[[str], None] = lambda text: None,
) -> Candidates:
    """Presses over a skin as its file has it, of half a force and all of it.

    Raises NoCalibration: the skin has no equilibrium under one of them.
    Raises Float64Error: float64 is off.
    """
    require_float64()
    presses = _places(spec, force)
    own = as_built(spec)
    pad = spec.geometry.dimension == 3
    names = [name for name in as_built_names(own) if not (pad and is_gain(name))]
    errors = press_errors(own, len(presses), place_error)
    parts = (*(named(own, name) for name in names), *errors)
    # What the shell leaves out changes what presses tell by 1 %, and takes as long again.
    solver = _solver(own, presses, SensorFamily(parts), progress, whole_slopes=False)
    start = starting_values(parts, [solver.stated(part.name) for part in parts])
    model = solver.at(start).model
    progress("what presses would tell")
    so, slope = (np.asarray(x) for x in COMPILED.run(_sensitivity, model, jnp.asarray(start)))
    change = np.nan_to_num(so[:, :-1] - so[:, -1:]).T
    J = np.nan_to_num(slope[:, :, : len(names)])
    # The errors of press k stand behind the constants, kind by kind.
    count = len(presses)
    at = len(names) + np.arange(len(errors)).reshape(-1, count)  # [kind, press]
    by_press = slope[:, np.arange(count), at].transpose(2, 0, 1)
    reading = spec.sensing.noise**2 + 1 / 12
    share = MODEL_ERROR[spec.geometry.dimension] ** 2 + pad * GAIN_ERROR**2
    shared = share * change**2
    known = np.isfinite(so[:, :-1].T)
    return Candidates(
        presses,
        np.moveaxis(J[:, :-1] - J[:, -1:], 1, 0),
        np.nan_to_num(by_press),
        np.where(known, 1 / (2 * reading / _READ + shared), 0.0),
        np.where(known, 1 / (reading + shared), 0.0),
        np.array([part.size for part in errors]).reshape(-1, count).T ** -2,
        _known_so_far(spec, parts[: len(names)], start[: len(names)]),
    )


def _known_so_far(spec: SkinSpec, parts: Sequence[SensorConstant], stated: Floats) -> Floats:
    """Covariance of the constants: of a calibration as built, else what the drawing allows."""
    record, names = spec.calibration, [part.name for part in parts]
    if record is not None and set(names) <= set(record.parameters):
        at = [record.parameters.index(name) for name in names]
        # A stiffness is a factor on the file's own material from here on.
        units = (record.values[i] if record.parameters[i] == STIFFNESS else 1.0 for i in at)
        unit = np.array([*units])
        return np.array(record.covariance)[np.ix_(at, at)] / np.outer(unit, unit)
    priors, correlation = as_built_priors(spec, parts, stated)
    deviations = np.array([priors[name].sd for name in names])
    return np.asarray(correlation * np.outer(deviations, deviations))


def _solver(
    spec: SkinSpec,
    presses: Sequence[Press],
    family: SensorFamily,
    progress: Callable[[str], None],
    *,
    whole_slopes: bool = True,
) -> ShapeSolver:
    """Of shapes under all presses, and at rest."""
    angles = angles_at(spec.geometry, presses[0].by, np.array([p.place for p in presses]))
    rows = angles, [p.force for p in presses], [p.axial or 0.0 for p in presses]
    angle, force, axial = (np.append(row, 0.0)[None] for row in rows)
    zero, count = np.zeros_like(angle), len(presses)
    loads = KnownLoads.pushes(angle, force, axial)
    oil = np.full(count + 1, np.nan)
    none = zero[0].astype(int)
    data = SensorData(spec, zero, zero[0], none, none, loads, oil, (), (), (), True)
    return ShapeSolver(
        data,
        loads,
        oil,
        family,
        None,
        air="skin",
        model="shell",
        progress=progress,
        pressed=range(count),
        whole_slopes=whole_slopes,
    )


@eqx.filter_jit
def _sensitivity(model: SensorModel, constants: Array) -> tuple[Array, Array]:
    return model.so(constants), jax.jacfwd(model.so)(constants)


def _places(spec: SkinSpec, force: float) -> tuple[Press, ...]:
    """Candidates over a skin."""
    edge, by = edge_of(spec)[0], place_name(spec)
    pad = spec.geometry.dimension == 3
    arc = _REACH * edge * np.linspace(-1, 1, _PAD_ARC if pad else _ARC)
    half = spec.geometry.width / 2
    axial: Sequence[float | None] = [None]
    if pad:
        axial = [settable(z, "arc") for z in _REACH * half * np.linspace(-1, 1, _AXIAL)]
    places = [settable(float(s), by) for s in arc]
    return tuple(
        Press(s, share * force, z, by) for share in _FORCES for s in places for z in axial
    )
