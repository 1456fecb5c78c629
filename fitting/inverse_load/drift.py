"""Readings less what drifts at rest, and how much each counts.

The readings at rest wander about the baseline: each taxel's by itself, all together, and in
proportion to themselves (a gain). They are followed in frames without contact. With d the drift
of the readings at rest [counts] and P its covariance, a random walk over a time t, and the mean
of n quiet frames with noise s^2::

    P -> P + t (q_taxel^2 I + q_common^2 1 1^T + q_gain^2 r r^T)
    P^-1 -> P^-1 + W,   d -> d + P W (y - r - d),    W = n / s^2

P is kept as diag(a) + F F^T, which the walk, and looks at all taxels, leave it to be (F spans 1
and r then). With b = a / (1 + a W) a look costs no more than a frame::

    F -> (b / a) F (1 + F^T diag(W b / a) F)^(-1/2),    a -> b

Where taxels are missing F gains columns; the weakest are counted to a.

In contact only P grows: what a contact does to far taxels is signal. Nothing is clipped.

A reading's variance is the converter's noise, its rounding (1/12), a baseline's own error, that
of the drift taken off, and the model's error in terms of the change from rest.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fitting.arrays import Flags, Floats, Rows
from fitting.inverse_load.fit.detection import AbstractDetector, Detection, without_errors
from fitting.inverse_load.fit.doubts import HELD, inliers, most_left_out
from suas_jax.acquisition.taxel_faults import saturated
from suas_jax.config import SkinSpec

_BLOCK = 32  # frames of a log whose drift is one
_QUIET = 0.05  # p-value above which a frame is taken for one without contact
_SHARED = 4  # columns of F

ROUNDING = 1 / 12  # variance of a converter's rounding [counts^2]
_PRESSURE_ERROR = 2e-2  # of a section's model and its mesh, relative


class DriftCovariance(NamedTuple):
    """Covariance diag(a) + F F^T of a drift."""

    own: Floats  # of each taxel by itself, a [taxel] [counts^2]
    shared: Floats  # patterns over all taxels, F [taxel, column] [counts]

    @property
    def variance(self) -> Floats:
        """Its diagonal [taxel] [counts^2]."""
        return np.asarray(self.own + (self.shared**2).sum(1))

    def plus(self, other: "DriftCovariance") -> "DriftCovariance":
        """The sum, with as few columns as are kept."""
        shared = np.concatenate([self.shared, other.shared], 1)
        turn = np.linalg.eigh(shared.T @ shared)[1]
        turned = shared @ turn[:, ::-1]
        rest = (turned[:, _SHARED:] ** 2).sum(1)
        return DriftCovariance(self.own + other.own + rest, turned[:, :_SHARED])

    def learned(self, weight: Floats, residual: Floats) -> tuple["DriftCovariance", Floats]:
        """The covariance after a look, and the change of the drift [taxel].

        Weights are inverse variances of what was read, zero where nothing was [taxel]; the
        residual is what was read less the drift [taxel].
        """
        kept = 1 / (1 + self.own * weight)
        inner = np.eye(self.shared.shape[1])
        inner = inner + self.shared.T @ ((weight * kept)[:, None] * self.shared)
        half = np.linalg.inv(np.linalg.cholesky(inner))
        shared = kept[:, None] * self.shared @ half.T
        pull = weight * residual
        change = self.own * kept * pull + shared @ (shared.T @ pull)
        return DriftCovariance(self.own * kept, shared), change


@dataclass(frozen=True)
class DriftDensities:
    """How fast readings at rest wander, and how far they may have before the first frame."""

    taxel: float = 0.05  # of each taxel by itself [counts / sqrt(s)]
    common: float = 0.15  # of all together [counts / sqrt(s)]
    gain: float = 3e-4  # of the gain [1 / sqrt(s)]
    # seconds of such a walk between the baseline and the first frame [s]
    before: float = 1200.0

    def walk(self, rest: Floats, seconds: float) -> DriftCovariance:
        """Covariance of the walk over a time."""
        own = np.full(len(rest), seconds * self.taxel**2)
        shared = np.stack([np.full(len(rest), self.common), self.gain * rest], 1)
        return DriftCovariance(own, np.sqrt(seconds) * shared)


@dataclass(frozen=True)
class Drift:
    """Drift of the readings at rest, frame by frame."""

    # to be taken off the readings [frame, taxel] [counts]; zero until a frame without contact
    # has been seen
    offset: Floats
    variance: Floats  # of it [frame, taxel] [counts^2]; likewise

    def rows(self, frames: slice | Rows) -> "Drift":
        """That of some frames."""
        return Drift(self.offset[frames], self.variance[frames])

    def sizes(self) -> list[tuple[float, float]]:
        """Mean and largest over the taxels, frame by frame [counts]."""
        mean = self.offset.mean(1)
        at = np.abs(self.offset).argmax(1)
        largest = self.offset[range(len(at)), at]
        return list(zip(mean.tolist(), largest.tolist(), strict=True))


class PastOfFrames(NamedTuple):
    """What earlier frames say of some frames; None where it is not followed."""

    drift: Drift | None = None  # of the readings at rest
    moved: Floats | None = None  # that may be motion of the film [frame, taxel] [counts]

    def rows(self, frames: slice | Rows) -> "PastOfFrames":
        """Of some of them."""
        drift = None if self.drift is None else self.drift.rows(frames)
        return PastOfFrames(drift, None if self.moved is None else self.moved[frames])


class DriftFollower:
    """Follows the readings at rest of one skin."""

    def __init__(
        self,
        rest: Floats,  # readings at rest that frames count from [taxel] [counts]
        noise_variance: float,  # of a reading [counts^2]
        # tells contact from noise, by the taxels alone where it knows of more
        detector: AbstractDetector,
        densities: DriftDensities | None = None,  # of the random walk
        # frames of a stream that are taken together; one follows at once, more cost less where
        # there are many taxels
        gathered: int = 1,
    ) -> None:
        self._rest, self._noise, self._detector = rest, noise_variance, detector
        self._densities = densities or DriftDensities()
        self._gathered = gathered
        self._waiting: list[tuple[float, Floats]] = []
        self.drift = np.zeros(len(rest))
        self.covariance = self._densities.walk(rest, self._densities.before)
        self.known = False
        """Whether a frame without contact has been seen."""
        self._time: float | None = None

    def follow(self, time: Floats, change: Floats) -> Drift:
        """Take frames; return the drift in each of them.

        Times are [frame] [s]; changes are readings less those at rest [frame, taxel] [counts],
        NaN where missing.
        """
        drift, variance = np.zeros_like(change), np.zeros_like(change)
        for begin in range(0, len(change), _BLOCK):
            part = slice(begin, begin + _BLOCK)
            self._waiting += zip(time[part].tolist(), change[part], strict=True)
            if len(change) > 1 or len(self._waiting) >= self._gathered:
                times, changes = zip(*self._waiting, strict=True)
                self._waiting = []
                self._walked(float(np.nanmean(times)))
                self._quiet(np.array(changes))
            if self.known:
                drift[part], variance[part] = self.drift, self.covariance.variance
        return Drift(drift, variance)

    def _walked(self, now: float) -> None:
        if self._time is not None and now > self._time:
            walked = self._densities.walk(self._rest, now - self._time)
            self.covariance = self.covariance.plus(walked)
        self._time = now

    def _chi2(self, left: Floats, weight: Floats) -> Floats:
        """What no shared drift explains of what is left [frame]."""
        rest, _ = without_errors(left * (weight > 0), weight, self.covariance.shared.T)
        return np.asarray((weight * rest * left).sum(1))

    def _quiet(self, change: Floats) -> None:
        """Learn from the frames without contact among some."""
        used = np.isfinite(change)
        left = np.where(used, change - self.drift, 0.0)
        own, shared = self.covariance
        weight = used / (self._noise + own)
        beside = ((0, 0), (0, self._detector.channels - len(self._rest)))

        def tested(weights: Floats) -> Detection:
            return self._detector.test(*(np.pad(x, beside) for x in (left, weights, shared.T)))

        test = tested(weight)
        quiet = test.p_value > _QUIET
        # Of a channel that jumped the others still tell: no push does what it alone shows.
        shown = used.any(1, keepdims=True)
        apart = left - np.nanmedian(np.where(shown, change - self.drift, 0.0), 1)[:, None]
        sound = inliers(apart, weight, np.zeros_like(apart)) > 0
        off = used & ~sound
        few = off.any(1) & (off.sum(1) <= most_left_out(weight)) & ~quiet
        if few.any():
            chi2, of_sound = (self._chi2(left, x) for x in (weight, weight * sound))
            few &= np.maximum(test.statistic, 0.0) ** 2 < HELD * (chi2 - of_sound)
        if few.any():
            few &= tested(weight * sound).p_value > _QUIET
            used, quiet = used & (sound | ~few[:, None]), quiet | few
        count = (used & quiet[:, None]).sum(0)
        if not count.any():
            return
        mean = (left * (used & quiet[:, None])).sum(0) / np.maximum(count, 1)
        self.covariance, moved = self.covariance.learned(count / self._noise, mean)
        self.drift = self.drift + moved
        self.known = True


@dataclass(frozen=True)
class ReadingWeights:
    """What turns readings into the model's, with inverse variances."""

    zero: Floats  # what is taken off readings [taxel] [counts]; NaN: the taxel is not used
    variance: Floats  # of a reading, without the model's error [taxel] [counts^2]
    model_rest: Floats  # the model's readings at rest [taxel] [counts]
    model_error: float  # relative error of the model's change of readings
    pressure_noise: float  # of a measured oil pressure [Pa]; infinite where there is none
    beside: bool  # whether contacts are fitted to it, as on a pad, where it is the last column

    @property
    def taxels(self) -> int:
        """Number of taxels in the layout."""
        return len(self.model_rest)

    def change_from_rest(self, so: Floats, faulty: Flags) -> Floats:
        """Readings less those at rest [frame, taxel]; NaN where a taxel can't be used."""
        used = np.isfinite(so) & (so > 0) & ~saturated(so) & ~faulty
        return np.where(used, so - self.zero - self.model_rest, np.nan)

    def weigh(
        self,
        so: Floats,  # readings [frame, taxel] [counts]; NaN where missing
        faulty: Flags | None = None,  # taxels known to be faulty [frame, taxel]
        pressure: Floats | None = None,  # measured of the oil [frame] [Pa]; NaN where missing
        drift: Drift | None = None,  # of the readings at rest
    ) -> tuple[Floats, Floats]:
        """Readings as the model has them, and their inverse variances.

        Returns readings [counts] and inverse variances [1/counts^2], both zero where a taxel is
        missing, saturated (0 or full scale) or faulty. On a pad the last column is the oil's
        pressure [Pa], [1/Pa^2].
        """
        y, variance = so - self.zero, self.variance
        if drift is not None:
            y, variance = y - drift.offset, variance + drift.variance
        used = np.isfinite(y) & ~saturated(so)
        if faulty is not None:
            used &= ~faulty
        y = np.where(used, y, 0.0)
        change = np.where(used, y - self.model_rest, 0.0)
        weight = used / (variance + (self.model_error * change) ** 2)
        if not self.beside:
            return y, weight
        p, own = self.of_pressure(pressure, len(so))
        return np.column_stack([y, p]), np.column_stack([weight, own])

    def of_pressure(self, pressure: Floats | None, frames: int) -> tuple[Floats, Floats]:
        """A measured pressure [frame] [Pa], and inverse variances, zero where it is missing."""
        p = np.full(frames, np.nan) if pressure is None else np.asarray(pressure, float)
        known = np.isfinite(p) & np.isfinite(self.pressure_noise)
        p = np.where(known, p, 0.0)
        sigma = self.pressure_noise if np.isfinite(self.pressure_noise) else 1.0
        error = self.model_error if self.beside else _PRESSURE_ERROR
        return p, known / (sigma**2 + (error * p) ** 2)


def zero_of_readings(
    spec: SkinSpec, model_rest: Floats, rest: Floats | None, rest_variance: Floats | float
) -> tuple[Floats, Floats]:
    """What is taken off readings to compare them with the model, and its variance.

    The skin's calibration may have offsets. Readings at rest are the model's, `model_rest`, and
    those of a baseline, `rest` [taxel] [counts]; without a baseline (None) readings are
    absolute. `rest_variance` is the variance of `rest` [counts^2].
    Raises ValueError: a calibration has offsets for another number of taxels.
    """
    if rest is not None:
        return rest - model_rest, np.asarray(rest_variance, float)
    taxels, record = len(model_rest), spec.calibration
    if record is None or not record.offsets:
        return np.zeros(taxels), np.zeros(taxels)
    errors = record.offset_errors or np.zeros(taxels)
    return np.array(record.offsets_of(taxels), float), np.nan_to_num(np.square(errors))
