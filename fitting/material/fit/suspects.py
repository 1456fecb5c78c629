"""Artefacts that a fit shows: which one explains the pattern of the residuals.

The law is fitted again with each data set's slack, force offset or machine stiffness free, with
slack and force offset both, as of a preload under which force and travel were set to zero, and
with its strains in percent; an artefact is named if what remains is noise.
"""

import dataclasses
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from scipy import stats

from fitting.material.experiments.artefacts import Suspect, force_of, percent_suspect, travel_of
from fitting.material.experiments.data_checks import returns
from fitting.material.experiments.free_zero import KINDS, Zero, can_be_freed
from fitting.material.experiments.measurements import PATHS, Dataset, StressTest
from fitting.material.experiments.prediction import mode_factors
from fitting.material.fit.noise import Noise, judged_residuals, noise_of, with_noise
from fitting.material.fit.problem import MaterialProblem, pose, predicted_readings
from fitting.material.laws.blocks import TestZeros
from fitting.material.laws.parameters import Family, block_of
from fitting.statistics.least_squares import minimise, solved_by_scipy
from fitting.statistics.residuals import by_theta, sensitivity

_CHANCE = 1e-4
_NAMES = {
    "slack": ("slack", "the specimen was slack by"),
    "force": ("force offset", "the load cell is off by"),
    "machine": ("machine stiffness", "the machine gives way, with a stiffness of"),
}
# Of these one at least must be free; the last pair is that of a preload.
_FREED = (*((kind,) for kind in KINDS), ("slack", "force"))
_PERCENT_BETTER = 4.0
_LONG = 1.5
_FARTHEST = 200.0  # of parameters, beyond which exponentials overflow


def zeros_of(sets: Sequence[Dataset], kinds: Sequence[str]) -> tuple[Zero, ...]:
    """The unknown zeros of all tests that can have them. Raises ValueError: no test can."""
    found = [
        Zero(kind, i, label)
        for i, data in enumerate(sets)
        if can_be_freed(data)
        for kind in kinds
        for label in ([""] if kind == "machine" else dict.fromkeys(data.specimen))
    ]
    if not found:
        raise ValueError(
            "--zero: uniaxial, equibiaxial or pure_shear tests have zeros that can be found"
        )
    return tuple(found)


def with_zeros(family: Family, sets: Sequence[Dataset], zeros: Sequence[Zero]) -> Family:
    """A family with the zeros of tests as further unknowns."""
    labels = []
    for zero in zeros:
        name = {"slack": "slack", "force": "force_zero", "machine": "machine"}[zero.kind]
        same = [z for z in zeros if z.kind == zero.kind]
        labels.append(name if len(same) == 1 else f"{name}_{same.index(zero) + 1}")
    start = tuple(_start(sets[zero.test], zero) for zero in zeros)
    zeros_block = TestZeros(tuple(zero.kind for zero in zeros), tuple(labels), start)
    return dataclasses.replace(family, beside=(*family.beside, zeros_block))


def _start(data: Dataset, zero: Zero) -> float:
    """A slack specimen's first guess: where a line through the first loads meets zero."""
    assert isinstance(data, StressTest)
    if zero.kind != "slack":
        return 0.0
    rows = data.specimen == zero.specimen
    stretch, size = data.stretch_1[rows], np.abs(data.value[rows])
    order = np.argsort(np.abs(np.log(stretch)), kind="stable")
    stretch, size = stretch[order], size[order]
    part = (size > 0.05 * size.max()) & (size < 0.35 * size.max())
    if part.sum() < 2 or np.ptp(stretch[part]) == 0.0:
        return 0.0
    slope, value = np.polyfit(stretch[part], size[part], 1)
    lag = -value / slope - 1.0 if slope != 0.0 else 0.0
    widest = float(np.max(np.abs(stretch - 1.0)))
    return float(np.clip(lag, -0.5 * widest, 0.5 * widest)) / 0.05


def fit_suspects(
    problem: MaterialProblem, constants: np.ndarray, noise: Noise
) -> list[Suspect]:
    """Artefacts that explain a misfit: those that leave only noise, the best first."""
    if any(not can_be_freed(data) for data in problem.sets):
        return []
    family, known = problem.residuals.family, problem.kind == "noise"
    if not known and all(model is not None for model in noise.models):
        # What is weighed by another noise shows other patterns than the artefact's.
        weighed = with_noise(problem.sets, noise, predicted_readings(problem, constants))
        problem = dataclasses.replace(pose(weighed, family, "noise"), kind="estimated")
    sets, kind_posed = problem.sets, "noise" if problem.kind == "estimated" else problem.kind

    def refitted(changed: Sequence[Dataset]) -> float:
        points = family.random(np.random.default_rng(0), 16)
        return float(minimise(pose(changed, family, kind_posed).residuals, points).cost[0])

    found: list[tuple[float, Suspect]] = []
    for i, data in enumerate(sets):
        assert isinstance(data, StressTest)
        if _may_be_percent(data):
            cost = refitted(sets)
            other = refitted([*sets[:i], _in_percent(data), *sets[i + 1 :]])
            if other * _PERCENT_BETTER < cost:
                times = np.sqrt(cost / max(other, 1e-300))
                text = f"the law follows the data {times:.3g} times closer then"
                found.append((other, percent_suspect(data, text)))
                continue
        # A loop between loading and unloading is the material's: no zero mends it.
        if block_of(family, TestZeros) is not None or returns(data):
            continue
        zeros = tuple(zero._replace(test=i) for zero in zeros_of([data], KINDS))
        free = pose(sets, with_zeros(family, sets, zeros), kind_posed, zeros=zeros)
        free = dataclasses.replace(free, kind=problem.kind)
        _, cost, _ = _refit_with(free, constants, np.zeros(len(zeros), dtype=bool))
        size = len(constants)
        least = cost
        for kinds in _FREED:
            part = np.array([zero.kind in kinds for zero in zeros])
            point, lower, error = _refit_with(free, constants, part)
            free_zeros, errors = point[size:][part], error[size:][part]
            count = int(free.residuals.used.sum()) - size - int(part.sum())
            before = least if len(kinds) > 1 else cost
            if kinds != ("machine",):
                least = min(least, lower)
            if count < 3 or not lower < before:
                continue
            more = part.sum() // len(kinds)  # zeros beyond those of the fit before
            gain = (before - lower) / more / max(lower / count, 1e-300)
            if kinds == ("machine",) and free_zeros[0] <= 0.0:
                continue  # nothing is stiffer than rigid
            if len(kinds) > 1 and not _tared(data, zeros, point[size:]):
                continue
            if stats.f.sf(gain, more, count) >= _CHANCE:
                continue
            own = noise_of(free, point)
            if not judged_residuals(free, point, own, known_noise=known).significant:
                # More zeros follow the same noise more closely.
                judged = lower * np.exp(2.0 * part.sum() / count)
                if len(kinds) > 1:
                    found.append((judged, _preloaded(data, free_zeros, errors)))
                else:
                    found.append((judged, _named(kinds[0], data, free_zeros, errors)))
    return [suspect for _, suspect in sorted(found, key=lambda pair: pair[0])]


def _refit_with(
    free: MaterialProblem, constants: np.ndarray, part: np.ndarray
) -> tuple[np.ndarray, float, np.ndarray]:
    """Least squares with some zeros free, from the fit without: constants, cost, errors."""
    residuals = free.residuals
    size = len(constants)
    found = block_of(residuals.family, TestZeros)
    assert found is not None
    zeros, _ = found
    begin = np.append(constants, np.zeros(len(part)))
    theta = np.array(residuals.unconstrained(jnp.asarray(begin)))
    theta[size:] = np.where(part, np.asarray(zeros.start), 0.0)
    moved = np.append(np.ones(size, dtype=bool), part)

    def whole_of(x: np.ndarray) -> np.ndarray:
        whole = theta.copy()
        whole[moved] = np.clip(x, -_FARTHEST, _FARTHEST)
        return whole

    def at(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r, J = by_theta(residuals, whole_of(x))
        known = np.all(np.isfinite(J), axis=1)  # by the parameters that are held, too
        return np.where(known, r, np.nan), J[:, moved]

    none = np.zeros(int(part.sum()))
    kinds = np.array(zeros.kinds)[part]
    # A machine that takes a tenth, or a third, of the travel.
    strain = float(np.asarray(residuals.scales.strain))
    share = np.where(kinds == "machine", 2.0 * strain, 0.0)
    starts = [theta[moved], np.append(theta[:size], none)]
    if np.any(share):
        starts += [np.append(theta[:size], times * share) for times in (0.3, 1.0)]
    runs = [solved_by_scipy(at, start, 1e3, method="lm", max_nfev=40) for start in starts]
    best = min(runs, key=lambda run: run.cost)
    point = np.asarray(residuals.constants(jnp.asarray(whole_of(best.x))))
    _, J = (np.asarray(y) for y in sensitivity(residuals, jnp.asarray(point)))
    J = J[:, moved] * np.maximum(np.abs(point[moved]), 1e-300)
    spare = max(int(residuals.used.sum()) - int(moved.sum()), 1)
    covariance = np.linalg.pinv(J.T @ J) * 2.0 * best.cost / spare
    error = np.zeros(len(point))
    error[moved] = np.sqrt(np.maximum(np.diagonal(covariance), 0.0)) * np.abs(point[moved])
    return point, float(best.cost), error


def _named(kind: str, data: StressTest, values: np.ndarray, errors: np.ndarray) -> Suspect:
    worst = int(np.argmax(np.abs(values)))
    amount, accuracy, unit = zero_in_units(
        kind, float(values[worst]), float(errors[worst]), data
    )
    name, what = _NAMES[kind]
    text = (
        f"the pattern of the residuals vanishes if {what} {amount:.3g} +- {accuracy:.2g} {unit}"
    )
    option = f"--zero {kind}"
    if unit == "N/mm":
        option = f'--machine-stiffness "{amount:.3g} N/mm" (measure it) or --zero machine'
    return Suspect(name, data.file, text, option, amount, unit)


def _tared(data: StressTest, zeros: Sequence[Zero], values: np.ndarray) -> bool:
    """Whether every specimen was stretched where its travel and its force are zero."""
    side = 1.0 if np.sum(np.log(data.stretch_1)) >= 0.0 else -1.0
    pairs = zip(zeros, values, strict=True)
    return all(side * value < 0.0 for zero, value in pairs if zero.kind != "machine")


def _preloaded(data: StressTest, values: np.ndarray, errors: np.ndarray) -> Suspect:
    """The suspect of a preload; values are the specimens' slacks, then their force offsets."""
    half = len(values) // 2
    worst = half + int(np.argmax(np.abs(values[half:])))
    shown = [
        zero_in_units(kind, abs(float(values[k])), float(errors[k]), data)
        for kind, k in (("slack", worst - half), ("force", worst))
    ]
    (travel, travel_error, length), (load, load_error, unit) = shown
    text = (
        "the pattern of the residuals vanishes if force and travel were set to zero under a "
        f"preload of {load:.3g} +- {load_error:.2g} {unit}, which deformed the specimen by "
        f"{travel:.3g} +- {travel_error:.2g} {length}"
    )
    return Suspect("tared preload", data.file, text, "--zero slack --zero force", load, unit)


def zero_in_units(
    kind: str, value: float, error: float, data: Dataset
) -> tuple[float, float, str]:
    """A zero in the units of the test: its size, standard error and unit."""
    length, area = data.origin.length, data.origin.area
    if kind != "machine":
        of = travel_of if kind == "slack" else force_of
        return of(data, value)[0], *of(data, error)
    if np.isfinite(length) and np.isfinite(area) and value != 0.0:
        stiffness = 1e-3 * area / (length * value)
        return stiffness, abs(stiffness * error / value), "N/mm"
    return value * 1e6, error * 1e6, "of the length per MPa"


def _may_be_percent(data: StressTest) -> bool:
    origin = data.origin
    if origin.state != "strain" or data.measure == "cauchy":
        return False
    largest = float(np.max(np.abs(data.stretch_1 - 1.0)))
    return largest > _LONG if origin.unit != "%" else largest < 0.06


def _in_percent(data: StressTest) -> StressTest:
    """The test with its strains a hundred times smaller, or larger where they are stated so."""
    factor = 100.0 if data.origin.unit == "%" else 0.01
    stretch = np.maximum(1.0 + factor * (data.stretch_1 - 1.0), 0.05)
    factors = mode_factors(PATHS[data.mode], stretch, data.measure)
    return dataclasses.replace(data, factors=factors, coordinate=stretch)
