"""Stress of any mode as the tests leave it, whatever the law: one band.

An isotropic rubber that keeps its volume reads, in every homogeneous test,

    P = A α(I₁) + B β(I₂) + δ,   α = ∂W/∂I₁,   β = ∂W/∂I₂,

with A and B known from the deformation (Rivlin). A test of one mode tells the sum along its
path and little of its parts; laws that follow it equally well differ elsewhere by any amount.
So α is a law's, averaged over all laws that are stable where it is asked, by their evidence,
with what none of them follows beside it (`fitting.material.fit.stress_process`). Where several
modes are measured, the readings say what α and β are.
"""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np
from jaxtyping import Float
from scipy import linalg, stats

from fitting.material.experiments.measurements import PATHS, Dataset, StressTest
from fitting.material.experiments.prediction import mode_factors
from fitting.material.fit.fitted_law import FittedLaw
from fitting.material.fit.stress_process import (
    EXPONENT,
    RISES,
    SECOND,
    First,
    Part,
    Readings,
    Rows,
    States,
    along,
    conditioned,
    covariance_of,
    mean_of,
    reaches,
)

_REPEATS = 0.03  # how closely tests of two modes repeat, beside 1.5 times the readings' noise
_NOISES = 1.5
# Deviation of where a test's stretch begins, from its range: grips, slack, a sheet that sags.
_ZERO, _LONGEST = 0.01, 1.0
_SHARES = (0.05, 0.15, 0.4)  # of α beside a law's
_NOISE = (0.003, 0.006, 0.012, 0.025, 0.05, 0.1)
_NOISE_STATED = (0.7, 1.0, 1.5, 2.5, 5.0)
_MOST_ROWS, _PSEUDO = 120, 12
_FAR = 12.0  # log evidence below the best that is nothing
_GRID = 64
_ASKED, _NEAR = 15, 1.5  # stretches on either side of rest, and how they crowd there


class Band(NamedTuple):
    """Nominal stress of a mode with its uncertainty."""

    stretch: np.ndarray  # λ, shape [n]
    nominal: np.ndarray  # middle of the interval [Pa], shape [n]
    half_width: np.ndarray  # half width of the interval [Pa], shape [n]
    law: np.ndarray  # what the fitted law says [Pa], shape [n]


@dataclasses.dataclass(frozen=True)
class Belief:
    """What the tests of a fit say of the stress in any mode."""

    readings: Readings  # that were fitted
    modulus: float  # μ that makes sizes [Pa]
    parts: tuple[Part, ...]  # of the average, the most evident first
    measured: frozenset[str]  # modes whose own readings stand
    repeats: float  # relative deviation between tests of two modes
    reach: float  # largest stretch of the data

    @classmethod
    def of(cls, fits: Sequence[FittedLaw]) -> Self:
        """From fits of several laws to the same data, the one to be told of first."""
        fit = fits[0]
        stated = fit.problem.kind in ("noise", "estimated")
        readings = _readings_of(fit, _NOISE[0] if stated else 1.0)
        scales = fit.problem.residuals.scales
        modulus, strain = float(np.asarray(scales.stress)), float(np.asarray(scales.strain))
        constant = First(np.zeros(1), np.full(1, 0.5 * modulus), 1, "")
        firsts = [constant, *(_first_of(each, modulus) for each in fits)]
        parts = [
            part
            for first in firsts
            if first.x.size and reaches(first, readings.states.i1)
            for share in _SHARES
            for rise in RISES
            for noise in (_NOISE_STATED if stated else _NOISE)
            if (part := conditioned(readings, modulus, first, share, rise, noise)) is not None
        ]
        parts.sort(key=lambda part: -part.evidence)
        kept = [p for p in parts if p.evidence > parts[0].evidence - _FAR or not p.first.title]
        best = parts[0]
        size = np.maximum(np.abs(readings.value), 1e-300)
        noise = float(np.median(best.noise * readings.scale / size))
        scatter = fit.specimens.mean_error if fit.specimens is not None else 0.0
        repeats = float(np.sqrt(_REPEATS**2 + (_NOISES * noise) ** 2 + scatter**2))
        return cls(
            readings,
            modulus,
            tuple(kept),
            measured_modes(fit.sets),
            repeats,
            float(np.exp(strain)),
        )

    def stress(self, mode: str, stretch: Rows, up_to: float | None = None) -> tuple[Rows, Rows]:
        """Mean and standard deviation of a mode's nominal stress [Pa], each [n].

        `up_to`: largest stretch of the test that would read it; None for that of the data.
        """
        factors = nominal_factors(mode, stretch)
        if mode in self.measured:
            return self.reading(factors)
        return self.of_another_test(factors, self.reach if up_to is None else up_to)

    def of_another_test(
        self, factors: Float[np.ndarray, "4 n"], up_to: float
    ) -> tuple[Rows, Rows]:
        """Readings of a test that was not made, up to a stretch, as `reading`.

        Its specimen and machine differ, and its stretch begins elsewhere.
        """
        both = np.hstack([factors, begun_elsewhere(factors, up_to)])
        (mean, moved), (deviation, _) = (np.split(x, 2) for x in self.reading(both))
        return mean, np.sqrt(deviation**2 + (self.repeats * mean) ** 2 + (moved - mean) ** 2)

    def reading(self, factors: Float[np.ndarray, "4 n"]) -> tuple[Rows, Rows]:
        """Mean and standard deviation of the rubber's own in homogeneous states [Pa] [n]."""
        asked = States.of(factors)
        parts = [part for part in self.parts if reaches(part.first, asked.i1)]
        # The weight of all sizes of the constant law keeps the average from being empty.
        evidence = np.array([part.evidence for part in parts])
        weights = np.exp(evidence - evidence.max())
        weights /= weights.sum()
        means, squares = [], []
        both = self.readings.states.and_(asked)
        count = len(self.readings.value)
        for part in parts:
            mean = mean_of(both, self.modulus, part.first)[count:]
            cross = covariance_of(both, self.modulus, part.first, part.share, part.rise)
            solved = linalg.solve_triangular(part.root, cross[:count, count:], lower=True)
            mean = mean + solved.T @ part.weights
            variance = np.diagonal(cross)[count:] - np.sum(solved**2, axis=0)
            means.append(mean)
            squares.append(np.maximum(variance, 0.0) + mean**2)
        mean = weights @ np.array(means)
        variance = np.maximum(weights @ np.array(squares) - mean**2, 0.0)
        return mean, np.sqrt(variance)

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


def begun_elsewhere(
    factors: Float[np.ndarray, "4 n"], up_to: float
) -> Float[np.ndarray, "4 n"]:
    """Factors of readings whose stretch begins one standard deviation further on."""
    e = factors[:2]
    longest = np.max(np.abs(e), axis=0)
    ahead = _ZERO * min(up_to - 1.0, _LONGEST) / np.where(longest > 0.0, longest, np.inf)
    return np.concatenate([e * (1.0 + ahead), factors[2:]])


def asked_stretches(fit: FittedLaw, mode: str, up_to: float | None) -> np.ndarray:
    """Stretches at which a mode is told: those of the data, or as far as is asked for."""
    if up_to is not None:
        log = np.log(up_to) * _steps(_ASKED)
        return np.exp(np.concatenate([-log[::-1], log]))
    largest = float(np.asarray(fit.problem.residuals.scales.strain))
    end = 0.5 * largest if mode == "equibiaxial" else largest  # as far, by the third stretch
    return 1.0 + np.expm1(end) * _steps(2 * _ASKED)


def _steps(count: int) -> Float[np.ndarray, " n"]:
    """Shares of a range, to its end; a band bends most near rest."""
    return (np.arange(1, count + 1) / count) ** _NEAR


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
    return mode_factors(PATHS[mode], stretch, "nominal")


def _readings_of(fit: FittedLaw, share: float) -> Readings:
    """Readings of a fit's homogeneous tests; of others, what the law says of their range.

    `share`: of what the law says, the unit that its noise is counted in.
    """
    inverse = np.asarray(fit.problem.residuals.inverse_scale)
    parts = []
    for (data, place), misfit in zip(fit.problem.tests, fit.misfits(), strict=True):
        if isinstance(data, StressTest) and not data.follows_history:
            used = inverse[place] > 0.0
            # A zero that was found with the law moves the reading, not the law.
            law = fit.stress(data.factors)[0]
            value = law - misfit
            reach = float(np.exp(np.max(np.abs(data.states))))
            ahead = fit.stress(begun_elsewhere(data.factors, reach))[0] - law
            # Each specimen begins where it does.
            own = data.specimen[:, None] == np.unique(data.specimen)
            shared = (own * ahead[:, None])[used].T
            states = States.of(data.factors[:, used])
            part = Readings(states, value[used], 1.0 / inverse[place][used], shared)
            parts.append(_fewer(part, means=data.is_curve))
            continue
        mode = _mode_of(data)
        log = np.linspace(float(data.states[0].min()), float(data.states[0].max()), _PSEUDO)
        log = log[np.abs(log) > 1e-9]
        factors = nominal_factors(mode, np.exp(log))
        value, slope = fit.stress(factors)
        shared = (slope @ fit.uncertainty.root).T
        states = States.of(factors)
        scale = share * np.maximum(np.abs(value), 1e-300)
        parts.append(Readings(states, value, scale, shared))
    whole = parts[0]
    for part in parts[1:]:
        shared = linalg.block_diag(whole.shared, part.shared)
        whole = Readings(
            whole.states.and_(part.states),
            np.append(whole.value, part.value),
            np.append(whole.scale, part.scale),
            shared,
        )
    return whole


def _fewer(readings: Readings, *, means: bool) -> Readings:
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

    states, value, scale, shared = readings
    scale = mean(scale) / np.sqrt(number)
    shared = np.stack([*map(mean, shared)])
    return Readings(States(*map(mean, states)), mean(value), scale, shared)


def _first_of(fit: FittedLaw, modulus: float) -> First:
    """α of a law along the mode that was measured, as far as the law is stable."""
    data = fit.sets[0]
    mode = _mode_of(data)
    side = -1.0 if -data.states[0].min() > 2.0 * data.states[0].max() else 1.0
    # At rest a law of one modulus; beyond, up to a stretch of 20.
    log = side * np.geomspace(0.005, 3.0, _GRID)
    stretch = np.exp(log)
    states = States.of(nominal_factors(mode, stretch))
    with np.errstate(all="ignore"):
        stress, _ = fit.stress(nominal_factors(mode, stretch))
        second = SECOND[0] * 0.5 * modulus * (states.i2 / 3.0) ** EXPONENT
        alpha = (stress - states.b * second) / states.a + SECOND[0] * 0.5 * modulus
    low, high = fit.stable[mode]
    sound = np.isfinite(alpha) & (alpha > 0.0) & (stretch > low) & (stretch < high)
    end = len(sound) if sound.all() else int(np.argmin(sound))
    return First(along(states.i1)[:end], alpha[:end], fit.family.law_size, fit.family.title)
