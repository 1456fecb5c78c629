"""Doubts about a calibration: logs of another skin, drift, taxels that disagree."""

import itertools

import numpy as np

from fitting.sensor.fit.priors import is_static
from fitting.sensor.fit.residuals import SensorProblem
from fitting.sensor.logs.data import NoCalibration, SensorData
from fitting.sensor.logs.log import Masked
from fitting.sensor.model.constants import PERMITTIVITY, is_gap

# A taxel-to-taxel misfit beyond this is not a tolerance of assembly.
_ANOTHER_SKIN = 0.3
# What is left of the counts' changes, and by how many standard deviations of the noise.
_UNEXPLAINED, _BEYOND_NOISE = 0.3, 5.0
_PLAUSIBLE = (0.9, 200.0)
_FACTORS = {PERMITTIVITY: 4.0, "gap": 3.0}
_DOUBTFUL = 2.0
_DRIFTING = 5.0
_PART_LEFT = 0.1  # of a taxel's readings
_FOLLOWS = 3.0  # standard deviations of the noise that a taxel's readings are off
_DRIFT_FRAMES, _POWERS = 20, 7
# Share of the time's course that must differ from the load's.
_TIME_APART = 0.2
_DISAGREEING = 3.0
_NOISY = 2.0


def check_agreement(
    problem: SensorProblem, constants: np.ndarray, data: SensorData
) -> list[str]:
    """Refuse logs that don't follow the skin's model at all.

    The constants are the fitted ones, SI [p].
    Returns what is doubtful but not refused.
    Raises NoCalibration: the logs are of another skin, or units are mixed up.
    """
    if not problem.readings.offsets:
        _refuse_another_layout(problem, constants, data)
    _refuse_unexplained(problem, constants, data)
    family = problem.family
    doubts = []
    for i, name in enumerate(family.names):
        factor = constants[i] / family.parts[i].size
        if name == PERMITTIVITY and not _PLAUSIBLE[0] < constants[i] < _PLAUSIBLE[1]:
            raise NoCalibration(
                f"{data.paths}: the counts ask for a relative permittivity of "
                f"{constants[i]:.3g}, which no oil has: {_CHECK_ELECTRODES}"
            )
        stated = data.spec.oil.relative_permittivity is not None
        if name == PERMITTIVITY and stated and name not in problem.priors:
            most = _FACTORS[PERMITTIVITY]
            if not 1 / most < factor < most:
                raise NoCalibration(
                    f"{data.paths}: the counts ask for a relative permittivity of "
                    f"{constants[i]:.3g}, {factor:.2g} times the skin file's: "
                    f"{_CHECK_ELECTRODES}; if the oil is such a one, put a rough value into "
                    "oil.relative_permittivity"
                )
            if not 1 / _DOUBTFUL < factor < _DOUBTFUL:
                doubts.append(
                    f"the permittivity found is {factor:.2g} times the skin file's: check "
                    "electrodes.lsb and the electrodes' diameters"
                )
        open_ = name in problem.priors or is_static(problem)
        if is_gap(name) and not open_ and not 1 / _FACTORS["gap"] < factor < _FACTORS["gap"]:
            raise NoCalibration(
                f"{data.paths}: the counts ask for a gap of {1e3 * constants[i]:.3g} mm, "
                f"{factor:.2g} times the skin file's: check the units of the known "
                "displacements or forces, and that the log belongs to this skin"
            )
    return doubts


_CHECK_ELECTRODES = (
    "check electrodes.lsb, stray and the electrodes' diameters in the skin file, the units of "
    "the log and of the known inputs, and that the log belongs to this skin"
)


def _refuse_another_layout(
    problem: SensorProblem, constants: np.ndarray, data: SensorData
) -> None:
    here = problem.readings
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.where(here.used, here.so / problem.predicted(constants), np.nan)
    found = np.array([np.nanmedian(row) for row in ratio if np.isfinite(row).any()])
    if len(found) > 2 and np.median(np.abs(found / np.median(found) - 1)) > _ANOTHER_SKIN:
        raise NoCalibration(
            f"{data.paths}: the taxels read from {100 * found.min():.0f} to "
            f"{100 * found.max():.0f} % of what this skin's model says: another "
            "skin, another layout, or known inputs in other units"
        )


def _refuse_unexplained(
    problem: SensorProblem, constants: np.ndarray, data: SensorData
) -> None:
    """Compare what changes in the counts with what the model leaves of the changes."""
    here = problem.readings
    r = problem.standardised(constants)
    changes, left = [], []
    for so, sigma, row, used in zip(here.so, here.sigma, r, here.used, strict=True):
        if used.sum() > 1:
            changes.append((so[used] - so[used].mean()) / sigma[used])
            left.append(row[used] - row[used].mean())
    if not left:
        return
    change, rest = (float(np.sqrt(np.mean(np.concatenate(x) ** 2))) for x in (changes, left))
    if rest > max(_BEYOND_NOISE, _UNEXPLAINED * change):
        raise NoCalibration(
            f"{data.paths}: the counts change by {change:.3g} standard deviations of their "
            f"noise, and {rest:.3g} of that are not what this skin would read: check the known "
            "inputs with their units and their time, and that the log belongs to this skin"
        )


def drift_warning(problem: SensorProblem, constants: np.ndarray) -> str:
    """A warning where taxels' residuals grow with time beyond their noise, or nothing.

    What is common to time and load is the model's misfit and no drift: where the load grows
    steadily the two can't be told apart, and no drift is claimed.
    """
    here = problem.readings
    r = problem.standardised(constants)
    so = problem.predicted(constants)
    worst = 0.0
    for k in range(here.logs):
        log = here.log == k
        load = _powers_of_load(np.nan_to_num(so[:, log]))
        for row, used in zip(r[:, log], here.used[:, log], strict=True):
            if used.sum() < _DRIFT_FRAMES:
                continue
            x, y = here.time[log][used], row[used]
            q, _ = np.linalg.qr(load[used])
            alone = x - q @ (q.T @ x)
            spread = max(np.std(np.diff(y)) / np.sqrt(2), 1e-6)
            size = np.linalg.norm(alone)
            if size > _TIME_APART * np.linalg.norm(x - x.mean()):
                worst = max(worst, abs(alone @ y) / size / spread)
    if worst <= _DRIFTING:
        return ""
    loaded = len(np.unique(here.state)) > 1
    return (
        f"readings drift with time ({worst:.0f} standard errors in the worst taxel): a "
        "steady drift of every taxel is estimated and taken out"
        + ("" if loaded else "; or the skin was not at rest")
    )


def _powers_of_load(so: np.ndarray) -> np.ndarray:
    """What counts change with: powers of their first principal component, and two more.

    Counts are the predicted ones [taxel, frame].
    Returns the columns, the first constant [frame, column].
    """
    centred = so - so.mean(1, keepdims=True)
    _, size, components = np.linalg.svd(centred, full_matrices=False)
    own = components[:3][size[:3] > 1e-9 * np.abs(so).max(initial=1e-300)]
    if not len(own):
        return np.ones((so.shape[1], 1))
    scaled = own[0] / np.abs(own[0]).max()
    return np.column_stack([scaled[:, None] ** np.arange(_POWERS), *own[1:]])


def disagreement_warning(problem: SensorProblem, constants: np.ndarray) -> str:
    """A warning where taxels disagree by more than their noise explains, or nothing."""
    here = problem.readings
    r = problem.standardised(constants)
    means, expected = [], []
    for row, used in zip(r, here.used, strict=True):
        if used.sum() >= 5:
            means.append(float(row[used].mean()))
            expected.append(1 / np.sqrt(used.sum()))
    if len(means) < 2:
        return ""
    z = np.array(means) / np.array(expected)
    if np.sqrt(np.mean(z**2)) < _DISAGREEING:
        return ""
    worst = means[int(np.argmax(np.abs(z)))] * float(np.nanmedian(here.sigma))
    return (
        "taxels differ from the model by more than their noise (the worst by "
        f"{worst:.3g} counts in the mean): gaps or electrodes that differ, a load at rest, or "
        "offsets; --gap taxel finds a gap for each, --baseline or --offsets takes out what is "
        "constant"
    )


def exchanged_warning(problem: SensorProblem, constants: np.ndarray, data: SensorData) -> str:
    """A warning where taxels read as each other should, not as themselves, or nothing.

    Those count of which a part is left out, and that should read apart: at rest most taxels
    read alike.
    """
    here, so = problem.readings, problem.predicted(constants)
    modules, numbers = data.spec.sensing.taxel_names
    left = (here.present & ~here.used).sum(1)
    out = np.flatnonzero(left > _PART_LEFT * here.present.sum(1))

    def off(read: np.ndarray, i: int, k: int) -> float:
        """How far taxel i is from what taxel k should read, in deviations."""
        error = ((read[i] - so[k]) / here.sigma[i])[here.present[i]]
        error = error - error.mean() * here.offsets
        return float(np.sqrt(np.mean(error**2)))

    pairs = [
        f"{modules[i]}.{numbers[i]} and {modules[k]}.{numbers[k]}"
        for i, k in itertools.combinations(out.tolist(), 2)
        if max(off(here.so, i, k), off(here.so, k, i)) < _FOLLOWS
        and off(so, i, k) > 2 * _FOLLOWS
    ]
    if not pairs:
        return ""
    return (
        f"taxels {', '.join(pairs)} read as each other should: their wires, or their places "
        "in [electrodes], are exchanged; exchange them there"
    )


def noise_warning(noise: np.ndarray, data: SensorData) -> str:
    """A warning where residuals are much more than the stated noise, or nothing."""
    stated, found = data.spec.sensing.noise, float(np.nanmedian(noise))
    if not stated > 0 or found < _NOISY * max(stated, 1.0):
        return ""
    return (
        f"readings scatter by {found:.3g} counts about the model, electrodes.noise says "
        f"{stated:.3g}: noise, or a model that is not this skin's"
    )


def wall_warning(touching: np.ndarray) -> str:
    """A warning of frames left out as the membrane touches the wall [taxel, frame], or none."""
    frames = int(touching.any(0).sum())
    if not frames:
        return ""
    return (
        f"{frames} of {touching.shape[1]} frames are left out: their known loads bring the "
        "membrane to the wall, or nearly; lighter presses count"
    )


def masked_taxels(
    problem: SensorProblem, touching: np.ndarray, data: SensorData
) -> list[Masked]:
    """What the fit itself left out.

    `touching` are the readings of taxels that the membrane touches [taxel, frame]; the data
    name the taxels.
    """
    modules, numbers = data.spec.sensing.taxel_names
    here = problem.readings
    found = []
    for i, (m, k) in enumerate(zip(modules, numbers, strict=True)):
        close, present = int(touching[i].sum()), int(here.present[i].sum())
        if close:
            whole = not present
            found.append(Masked(m, k, "the membrane touches the wall", close, whole, ""))
        left = present - int(here.used[i].sum())
        if left and left == present:
            reason = "disagrees with the model and the others"
            found.append(Masked(m, k, reason, left, True, ""))
        elif left:
            found.append(Masked(m, k, "outliers", left, False, ""))
    return found
