"""Doubts about what a calibration took as given: inputs that it holds, and priors."""

import numpy as np

from fitting.sensor.fit.residuals import SensorProblem
from fitting.sensor.logs.data import SensorData
from fitting.sensor.model.constants import (
    GAP,
    PATHS,
    STIFFNESS,
    THICKNESS,
    SensorFamily,
    is_gap,
)
from suas_jax.config.input_errors import input_errors, stresses_of
from suas_jax.config.inputs import given_inputs

_EXACT = 1e-3  # share of the membrane's stiffness that nobody has to be told of
_PULLED = 4.0  # standard deviations of a prior
_MODEL, _CONTRADICTION = 0.02, 2.0  # relative error of the model; deviations that are told


def exact_membrane_warning(family: SensorFamily, data: SensorData) -> str:
    """A warning where forces tell the gap by a stiffness that is taken as exact, or nothing."""
    by_force = bool(np.nan_to_num(data.loads.force).any())
    by_travel = bool(np.isfinite(data.loads.displacement).any() or data.loads.bodies)
    if not by_force or by_travel or not any(map(is_gap, family.names)):
        return ""
    shares = _stiffness_shares(family, data)
    told = {k: f"{k}, known to {100 * x:.2g} %" for k, x in shares.items() if x > _EXACT}
    if not told:
        return ""
    more = ",thickness" * ("thickness" in told) + " --joint" * ("material" in told)
    names = dict.fromkeys(GAP if is_gap(name) else name for name in family.names)
    option = f"--fit {','.join(names)}{more}"
    if PATHS[THICKNESS] not in given_inputs(data.spec):
        option = "--fit as-built"  # a table is not one number
    return (
        f"known forces tell the gap by the membrane's stiffness, which is taken as exact "
        f"({'; '.join(told.values())}): the gap may be off by more than its interval says; "
        f"{option} finds what is not exact, too, and known displacements don't need it"
    )


def _stiffness_shares(family: SensorFamily, data: SensorData) -> dict[str, float]:
    """Relative deviations of thickness and material, those of them that are not fitted."""
    values, errors = given_inputs(data.spec), input_errors(data.spec)
    held = {
        "thickness": [path for path in values if path.startswith(PATHS[THICKNESS])],
        "material": list(stresses_of(data.spec)),
    }
    fitted = {name.partition(".")[0] for name in family.names}
    shares: dict[str, float] = {}
    for what, paths in held.items():
        columns = [errors.paths.index(path) for path in paths if path in errors.paths]
        if what in fitted or STIFFNESS in fitted or not columns:
            continue
        size = sum(float(values[path]) for path in paths)
        shares[what] = float(np.linalg.norm(errors.directions[:, columns].sum(1))) / abs(size)
    return shares


def contradiction_warning(
    family: SensorFamily, data: SensorData, force: np.ndarray, displacement: np.ndarray
) -> str:
    """A warning where known forces and displacements don't belong together, or nothing.

    Forces and displacements are those of the model, under what is used of each load
    [load, state].
    """
    if data.unused is None:
        return ""
    states = data.loads.states
    by_travel = np.isfinite(data.loads.displacement)
    kinds = {
        "forces": (by_travel, force[:, :states], "displacements", "N", 1.0),
        "displacements": (~by_travel, displacement[:, :states], "forces", "mm", 1e3),
    }
    for name, (here, model, other, unit, size) in kinds.items():
        own = here & np.isfinite(data.unused) & (model != 0)
        if not own.any():
            continue
        told, model = data.unused[own], model[own]
        factor = float(told @ model / (model @ model))
        shares = list(_stiffness_shares(family, data).values())
        usual = float(np.linalg.norm([*shares, _MODEL]))
        if abs(factor - 1) <= _CONTRADICTION * usual:
            continue
        worst = int(np.argmax(np.abs(model)))
        return (
            f"known {name} are {factor:.3g} times those that the known {other} ask of the "
            f"model ({size * told[worst]:.3g} {unit} for {size * model[worst]:.3g} {unit}), "
            f"{100 * usual:.2g} % are usual: check units and scales of both, thickness and "
            "material; one of them is wrong, and the constants with it if it is the one that "
            f"is used ({other})"
        )
    return ""


def elastic_warning(data: SensorData) -> str:
    """A warning where known forces press a membrane that creeps, or nothing."""
    material, series = data.spec.material, data.spec.material.relaxation
    if series is None or not np.nan_to_num(data.loads.force).any():
        return ""
    share = series.long_term_share
    slow, fast = f"{max(series.tau):g} s", f"{min(series.tau):g} s"
    off, well = f"{100 * (1 / share - 1):.2g} % too far", f"held for several times {slow}"
    if material.response == "instantaneous":
        off, well = f"{100 * (1 - share):.2g} % too little", f"much shorter than {fast}"
    return (
        f"[material] relaxation: known forces dent the model as the {material.response} "
        f"constants say, up to {off} where presses are not {well}; only --fit relaxation "
        "follows the creep, and known displacements hardly feel it"
    )


def pulled_warning(problem: SensorProblem, constants: np.ndarray) -> str:
    """A warning where a constant is far from its prior, which pulls it, or nothing."""
    found = dict(zip(problem.family.names, constants.tolist(), strict=True))
    off = {
        name: abs(found[name] - prior.mean) / prior.sd for name, prior in problem.priors.items()
    }
    far = [name for name, size in off.items() if size > _PULLED]
    if not far:
        return ""
    worst = max(far, key=off.__getitem__)
    more = f", and {len(far) - 1} others are farther than {_PULLED:g}" if far[1:] else ""
    return (
        f"{worst} is {off[worst]:.2g} standard deviations from its prior{more}: priors "
        "pull what was found, and intervals don't allow for it; state in the skin file what "
        'this unit may have, such as relative_permittivity = "2.6 +- 10 %"'
    )
