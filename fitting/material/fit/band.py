"""Stress of any mode as the tests leave it, whatever the law: one band.

An isotropic rubber that keeps its volume reads, in every homogeneous test,

    P = A α(I₁) + B β(I₂) + δ,   α = ∂W/∂I₁,   β = ∂W/∂I₂,

with A and B known from the deformation (Rivlin). A test of one mode tells the sum along its
path and little of its parts; laws that follow it equally well differ elsewhere by any amount.
So α is a law's, averaged over all laws that are stable where it is asked, by their evidence,
with a Gaussian process beside it for what none of them follows; β is that of rubbers,
b (μ/2) √(3/I₂) with `SECOND`, and a process beside it; δ is what depends on both invariants.
Where several modes are measured, the readings say what α and β are.

`SECOND` and the other scales were set on Treloar (1944), Kawabata (1981) and Meunier (2008).
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol, Self

import numpy as np
from jaxtyping import Float
from scipy import linalg, stats

from fitting.material.experiments.measurements import PATHS, Dataset
from fitting.material.experiments.prediction import mode_factors
from fitting.material.experiments.stress_tests import StressTest
from fitting.material.fit.problem import MaterialProblem
from fitting.material.fit.specimens import Specimens
from fitting.material.laws.parameters import AbstractFamily
from fitting.statistics.identifiability import Uncertainty

Rows = Float[np.ndarray, " n"]

SECOND = (0.15, 0.08)
"""Share b of the shear modulus that I₂ carries in rubbers at rest: mean and deviation."""
_VARIES = 0.05  # of b along I₂
_BOTH = 0.06  # δ over the stress, fully where I₁ is 4
_REPEATS = 0.03  # how closely tests of two modes repeat, beside 1.5 times the readings' noise
_NOISES = 1.5
# Of α beside a law's: one of these shares, its length in log(I₁ - 2.7), and growth by I₁.
_SHARES, _LENGTH, _GROWTH = (0.05, 0.15, 0.4), 0.8, 0.03
_LENGTH_2, _LENGTH_BOTH = 1.0, 0.5
_OFFSET = 0.3
_NOISE = (0.003, 0.006, 0.012, 0.025, 0.05, 0.1)
_NOISE_STATED = (0.7, 1.0, 1.5, 2.5, 5.0)
_MOST_ROWS, _PSEUDO = 120, 12
_FAR = 12.0  # log evidence below the best that is nothing
_EXPONENT = -0.5
_GRID = 64
_ASKED = 10  # stretches on either side of rest


class Band(NamedTuple):
    """Nominal stress of a mode with its uncertainty.

    Attributes:
        stretch: λ, shape [n].
        nominal: middle of the interval [Pa], shape [n].
        half_width: half width of the interval [Pa], shape [n].
        law: what the fitted law says [Pa], shape [n].
    """

    stretch: np.ndarray
    nominal: np.ndarray
    half_width: np.ndarray
    law: np.ndarray


class FittedLaw(Protocol):
    """What is needed of a fit; see `MaterialFit`."""

    @property
    def sets(self) -> tuple[Dataset, ...]:
        """The data."""
        ...

    @property
    def problem(self) -> MaterialProblem:
        """The residuals."""
        ...

    @property
    def family(self) -> AbstractFamily:
        """The law's family."""
        ...

    @property
    def uncertainty(self) -> Uncertainty:
        """Covariance of the constants."""
        ...

    @property
    def specimens(self) -> Specimens | None:
        """Factors of several specimens."""
        ...

    @property
    def stable(self) -> Mapping[str, tuple[float, float]]:
        """Stretches around one in which the law is stable, by mode."""
        ...

    def misfits(self) -> list[np.ndarray]:
        """Predicted less measured readings of each data set [Pa]."""
        ...

    def stress(self, factors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The law's readings at e₁, e₂, c₁, c₂, and derivatives by its constants."""
        ...


class _States(NamedTuple):
    """What readings are made of: A, B and both invariants, each [n]."""

    a: Rows
    b: Rows
    i1: Rows
    i2: Rows

    @classmethod
    def of(cls, factors: Float[np.ndarray, "4 n"]) -> Self:
        """From (e₁, e₂, c₁, c₂) of each reading."""
        e1, e2, c1, c2 = factors
        x, y, z = np.exp(2.0 * e1), np.exp(2.0 * e2), np.exp(-2.0 * (e1 + e2))
        a = 2.0 * (c1 * (x - z) + c2 * (y - z))
        b = 2.0 * (c1 * (1.0 / z - 1.0 / x) + c2 * (1.0 / z - 1.0 / y))
        return cls(a, b, x + y + z, 1.0 / x + 1.0 / y + 1.0 / z)

    def and_(self, other: Self) -> Self:
        """These, then others."""
        return type(self)(*map(np.concatenate, zip(self, other, strict=True)))


class _Readings(NamedTuple):
    """Readings [Pa], the size of their noise, errors that they share [k, n], where they are."""

    states: _States
    value: Rows
    scale: Rows
    shared: Float[np.ndarray, "k n"]


class _First(NamedTuple):
    """α of one law along its invariant: log(I₁ - 2.7) and α + b μ/2 [Pa], up to an I₁.

    A law that is not stable from some I₁ on has no α there.
    """

    x: np.ndarray
    alpha: np.ndarray
    constants: int
    title: str

    def at(self, i1: Rows) -> Rows:
        """α + b μ/2 [Pa]."""
        return np.interp(_along(i1), self.x, self.alpha)


class _Part(NamedTuple):
    """One law with one size of what is beside it, conditioned on the readings."""

    first: _First
    share: float
    noise: float
    evidence: float
    root: np.ndarray
    weights: np.ndarray


@dataclasses.dataclass(frozen=True)
class Belief:
    """What the tests of a fit say of the stress in any mode.

    Attributes:
        readings: that were fitted.
        modulus: μ that makes sizes [Pa].
        parts: of the average, the most evident first.
        measured: modes whose own readings stand.
        repeats: relative deviation between tests of two modes.
    """

    readings: _Readings
    modulus: float
    parts: tuple[_Part, ...]
    measured: frozenset[str]
    repeats: float

    @classmethod
    def of(cls, fits: Sequence[FittedLaw]) -> Self:
        """From fits of several laws to the same data, the one to be told of first."""
        fit = fits[0]
        readings = _readings_of(fit)
        modulus = float(np.asarray(fit.problem.residuals.scales.stress))
        stated = fit.problem.kind in ("noise", "estimated")
        constant = _First(np.zeros(1), np.full(1, 0.5 * modulus), 1, "")
        firsts = [constant, *(_first_of(each, modulus) for each in fits)]
        parts = [
            part
            for first in firsts
            if first.x.size and _reaches(first, readings.states.i1)
            for share in _SHARES
            for noise in (_NOISE_STATED if stated else _NOISE)
            if (part := _conditioned(readings, modulus, first, share, noise)) is not None
        ]
        parts.sort(key=lambda part: -part.evidence)
        kept = [p for p in parts if p.evidence > parts[0].evidence - _FAR or not p.first.title]
        best = parts[0]
        size = np.maximum(np.abs(readings.value), 1e-300)
        noise = float(np.median(best.noise * readings.scale / size))
        scatter = fit.specimens.mean_error if fit.specimens is not None else 0.0
        repeats = float(np.sqrt(_REPEATS**2 + (_NOISES * noise) ** 2 + scatter**2))
        return cls(readings, modulus, tuple(kept), measured_modes(fit.sets), repeats)

    def stress(self, mode: str, stretch: Rows) -> tuple[Rows, Rows]:
        """Mean and standard deviation of a mode's nominal stress [Pa], each [n]."""
        other = 0.0 if mode in self.measured else self.repeats
        return self.reading(nominal_factors(mode, stretch), other)

    def reading(self, factors: Float[np.ndarray, "4 n"], other: float) -> tuple[Rows, Rows]:
        """Mean and standard deviation of readings of homogeneous states [Pa], each [n].

        Args:
            factors: e₁, e₂, c₁, c₂ of each.
            other: by how much another test differs, relative; `repeats` of one not measured.
        """
        asked = _States.of(factors)
        parts = [part for part in self.parts if _reaches(part.first, asked.i1)]
        # The weight of all sizes of the constant law keeps the average from being empty.
        evidence = np.array([part.evidence for part in parts])
        weights = np.exp(evidence - evidence.max())
        weights /= weights.sum()
        means, squares = [], []
        both = self.readings.states.and_(asked)
        count = len(self.readings.value)
        for part in parts:
            mean = _mean(both, self.modulus, part.first)[count:]
            cross = _covariance(both, self.modulus, part.first, part.share)
            solved = linalg.solve_triangular(part.root, cross[:count, count:], lower=True)
            mean = mean + solved.T @ part.weights
            variance = np.diagonal(cross)[count:] - np.sum(solved**2, axis=0)
            means.append(mean)
            squares.append(np.maximum(variance, 0.0) + mean**2)
        mean = weights @ np.array(means)
        variance = np.maximum(weights @ np.array(squares) - mean**2, 0.0)
        return mean, np.sqrt(variance + (other * mean) ** 2)

    def weights(self) -> dict[str, float]:
        """Share of each law in the average, by title, largest first."""
        best = self.parts[0].evidence
        found: dict[str, float] = {}
        for part in self.parts:
            title = part.first.title or "none of them"
            found[title] = found.get(title, 0.0) + float(np.exp(part.evidence - best))
        whole = sum(found.values())
        ordered = sorted(found.items(), key=lambda pair: -pair[1])
        return {title: share / whole for title, share in ordered}


def half_width(deviation: Rows, level: float = 0.95) -> Rows:
    """Half width of an interval from a standard deviation."""
    return float(stats.norm.ppf(0.5 + 0.5 * level)) * deviation


def asked_stretches(fit: FittedLaw, mode: str, up_to: float | None) -> np.ndarray:
    """Stretches at which a mode is told: those of the data, or as far as is asked for."""
    if up_to is not None:
        log = np.log(up_to) * np.arange(-_ASKED, _ASKED + 1) / _ASKED
        return np.exp(log[log != 0.0])
    largest = float(np.asarray(fit.problem.residuals.scales.strain))
    end = 0.5 * largest if mode == "equibiaxial" else largest  # as far, by the third stretch
    return np.linspace(1.0, np.exp(end), 2 * _ASKED + 1)[1:]


def measured_modes(sets: Sequence[Dataset]) -> frozenset[str]:
    """Modes of one stretch that the data hold readings of."""
    found: set[str] = set()
    for data in sets:
        if data.mode in ("biaxial", "biaxial_difference"):
            found |= set(PATHS)
        found.add(_mode_of(data))
    return frozenset(found & set(PATHS))


def _mode_of(data: Dataset) -> str:
    """The mode of one stretch that a test is, or is closest to."""
    if data.mode in ("balloon", "bulge"):
        return "equibiaxial"
    return data.mode if data.mode in PATHS else "pure_shear"


def nominal_factors(mode: str, stretch: Rows) -> np.ndarray:
    """(e₁, e₂, c₁, c₂) that read the nominal stress of a mode, each [n]."""
    e1, e2, c1, c2 = mode_factors(PATHS[mode], stretch)
    return np.stack([e1, e2, c1 / stretch, c2 / stretch])


def _along(i1: Rows) -> Rows:
    return np.log(i1 - 3.0 + _OFFSET)


def _readings_of(fit: FittedLaw) -> _Readings:
    """Readings of a fit's homogeneous tests; of others, what the law says of their range."""
    inverse = np.asarray(fit.problem.residuals.inverse_scale)
    parts = []
    for data, place, misfit in zip(fit.sets, fit.problem.places, fit.misfits(), strict=True):
        if isinstance(data, StressTest) and not data.follows_history:
            used = inverse[place] > 0.0
            # A zero that was found with the law moves the reading, not the law.
            value = fit.stress(data.factors)[0] - misfit
            states = _States.of(data.factors[:, used])
            none = np.zeros((0, int(used.sum())))
            part = _Readings(states, value[used], 1.0 / inverse[place][used], none)
            parts.append(_fewer(part, means=data.is_curve))
            continue
        mode = _mode_of(data)
        log = np.linspace(float(data.states[0].min()), float(data.states[0].max()), _PSEUDO)
        log = log[np.abs(log) > 1e-9]
        factors = nominal_factors(mode, np.exp(log))
        value, slope = fit.stress(factors)
        shared = (slope @ fit.uncertainty.root).T
        states = _States.of(factors)
        parts.append(_Readings(states, value, np.maximum(np.abs(value), 1e-300), shared))
    whole = parts[0]
    for part in parts[1:]:
        shared = linalg.block_diag(whole.shared, part.shared)
        whole = _Readings(
            whole.states.and_(part.states),
            np.append(whole.value, part.value),
            np.append(whole.scale, part.scale),
            shared,
        )
    return whole


def _fewer(readings: _Readings, *, means: bool) -> _Readings:
    """Means of neighbouring readings of a curve, or single ones, where there are many."""
    count = len(readings.value)
    size = -(-count // _MOST_ROWS)
    if size == 1:
        return readings
    order = np.lexsort((readings.states.a, readings.states.i1))
    runs = np.empty(count, dtype=int)
    runs[order] = np.arange(count) // size
    number = np.bincount(runs) if means else np.ones(-(-count // size))
    kept = np.arange(count) if means else order[::size]

    def mean(values: np.ndarray) -> np.ndarray:
        return np.bincount(runs[kept], values[kept]) / number

    states, value, scale, _ = readings
    scale = mean(scale) / np.sqrt(number)
    return _Readings(_States(*map(mean, states)), mean(value), scale, np.zeros((0, len(scale))))


def _first_of(fit: FittedLaw, modulus: float) -> _First:
    """α of a law along the mode that was measured, as far as the law is stable."""
    data = fit.sets[0]
    mode = _mode_of(data)
    side = -1.0 if -data.states[0].min() > 2.0 * data.states[0].max() else 1.0
    # At rest a law of one modulus; beyond, up to a stretch of 20.
    log = side * np.geomspace(0.005, 3.0, _GRID)
    stretch = np.exp(log)
    states = _States.of(nominal_factors(mode, stretch))
    with np.errstate(all="ignore"):
        stress, _ = fit.stress(nominal_factors(mode, stretch))
        second = SECOND[0] * 0.5 * modulus * (states.i2 / 3.0) ** _EXPONENT
        alpha = (stress - states.b * second) / states.a + SECOND[0] * 0.5 * modulus
    low, high = fit.stable[mode]
    sound = np.isfinite(alpha) & (alpha > 0.0) & (stretch > low) & (stretch < high)
    end = len(sound) if sound.all() else int(np.argmin(sound))
    return _First(_along(states.i1)[:end], alpha[:end], fit.family.law_size, fit.family.title)


def _reaches(first: _First, i1: Rows) -> bool:
    """Whether a law is stable wherever it is asked; the constant one is."""
    return not first.title or float(_along(np.max(i1))) <= float(first.x[-1])


def _conditioned(
    readings: _Readings, modulus: float, first: _First, share: float, noise: float
) -> _Part | None:
    """A law with what is beside it, after the readings; None where numbers fail."""
    states = readings.states
    covariance = _covariance(states, modulus, first, share)
    covariance = covariance + np.diag((noise * readings.scale) ** 2)
    covariance += readings.shared.T @ readings.shared
    # Nothing is known to better than rounding.
    covariance[np.diag_indices_from(covariance)] *= 1.0 + 1e-9
    try:
        root = linalg.cholesky(covariance, lower=True)
    except linalg.LinAlgError:
        return None
    off = readings.value - _mean(states, modulus, first)
    weights = linalg.solve_triangular(root, off, lower=True)
    evidence = -0.5 * float(weights @ weights) - float(np.log(np.diagonal(root)).sum())
    evidence -= 0.5 * first.constants * float(np.log(len(off)))
    return _Part(first, share, noise, evidence, root, weights)


def _mean(states: _States, modulus: float, first: _First) -> Rows:
    second = SECOND[0] * 0.5 * modulus
    alpha = first.at(states.i1) - second
    return states.a * alpha + states.b * second * (states.i2 / 3.0) ** _EXPONENT


def _covariance(states: _States, modulus: float, first: _First, share: float) -> np.ndarray:
    """Of readings, before any of them is known [Pa²]."""
    x, z = _along(states.i1), _along(states.i2)
    far_1, far_2 = (np.subtract.outer(y, y) ** 2 for y in (x, z))
    beyond = states.i1 - 3.0
    first_part = states.a * first.at(states.i1)
    second_part = states.b * 0.5 * modulus * (states.i2 / 3.0) ** _EXPONENT
    # A larger share of I₂ is a smaller one of I₁: the modulus is what was measured.
    exchanged = second_part - states.a * 0.5 * modulus
    beside = first_part * np.minimum(beyond, 1.0)
    # The stiffness as a whole is the data's; further out α may grow.
    found = np.outer(first_part, first_part) * (
        1.0
        + share**2 * np.exp(-0.5 * far_1 / _LENGTH**2)
        + _GROWTH**2 * np.outer(beyond, beyond)
    )
    found += SECOND[1] ** 2 * np.outer(exchanged, exchanged)
    along_2 = np.exp(-0.5 * far_2 / _LENGTH_2**2)
    found += _VARIES**2 * np.outer(second_part, second_part) * along_2
    near = np.exp(-0.5 * (far_1 + far_2) / _LENGTH_BOTH**2)
    found += _BOTH**2 * np.outer(beside, beside) * near
    return np.asarray(found)
