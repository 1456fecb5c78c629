"""Inverse load estimation: where contacts are, how strong, and how sure, from readings.

::

    readings -> contact or not                              `detection`
             -> nearest states of a table                   `table`, `search`
             -> least squares with exact derivatives        `model`, `explanation`
             -> number of contacts, faulty taxels           `pairs`, `selection`
             -> covariances, statuses                       `calibration`, `report`

Readings are compared with the skin's own model in counts. A reading's variance is the
converter's noise, its rounding (1/12), a baseline's own error, and the model's error: the
lumped shell is within MODEL_ERROR of the continuum, in terms of the change from rest.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from fitting.inverse_load.estimate.assessment import POOR, LoadAssessment
from fitting.inverse_load.estimate.estimate import STATUS, Contact, LoadEstimate
from fitting.inverse_load.fit.detection import Detector, threshold
from fitting.inverse_load.fit.explanation import LoadFitter
from fitting.inverse_load.fit.selection import Alternative, Selection
from fitting.inverse_load.search.nearest import NodeSearch
from fitting.inverse_load.search.table import LoadTable, table_of
from suas_jax.config import SkinSpec
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.forward import Skin, skin_of

if TYPE_CHECKING:
    from fitting.inverse_load.fit.calibration import CalibrationUncertainty

__all__ = ["FULL_SCALE", "MODEL_ERROR", "STATUS", "Contact", "LoadEstimate", "LoadEstimator"]

MODEL_ERROR = 2.5e-3
"""Error of the shell's change of readings, relative (`benchmarks/inverse_load.py`)."""
FULL_SCALE = 65535
MOST_CONTACTS = 3

_FEWEST_TAXELS = 4
_BLOCK = 2048  # frames whose explanations are sought together


@dataclass
class LoadEstimator:
    """Estimates loads on one skin; made once, used for any number of frames.

    Args:
        spec: the skin.
        direction: free the contacts' directions; radial otherwise.
        false_alarm: rate at which noise alone may be called a contact.
        noise: standard deviation of a reading [counts]; the skin file's if None.
        model_error: relative error of the model's change of readings.
        rest: readings at rest [taxel, counts], as a baseline has them: readings count from
            there. None: readings are absolute, less the offsets that a calibration wrote
            into the skin file. NaN: the taxel is not used.
        rest_variance: variance of `rest` [taxel, counts^2].
        most_contacts: contacts to tell apart at most, 1 to 3.
        live: compile for single frames instead of batches.
        progress: called with what is being done.

    Raises:
        ValueError: an argument or the skin's electrodes can't be used.
    """

    spec: SkinSpec
    direction: bool = False
    false_alarm: float = 0.01
    noise: float | None = None
    model_error: float = MODEL_ERROR
    rest: NDArray[np.float64] | None = None
    rest_variance: NDArray[np.float64] | float = 0.0
    most_contacts: int = MOST_CONTACTS
    live: bool = False
    progress: Callable[[str], None] = lambda text: None
    skin: Skin = field(init=False)
    table: LoadTable = field(init=False)

    def __post_init__(self) -> None:
        self._check()
        self.skin = skin_of(self.spec, contact=False)
        assert self.spec.electrodes is not None
        noise = self.spec.electrodes.noise if self.noise is None else self.noise
        if not (np.isfinite(noise) and noise >= 0):
            raise ValueError(f"noise = {noise}: zero or more counts are needed")
        self.reading_noise = float(noise)
        self.table = table_of(self.spec, self.skin, self.progress)
        # A converter's rounding is noise, too.
        self._zero, uncertain = self._zero_of_readings()
        self._variance = noise**2 + 1 / 12 + uncertain
        self.calibration = self._calibration()
        if self.calibration is not None:
            self._variance = self._variance + self.calibration.rest_variance
        self._detector = Detector(self.table.signatures)
        self._fitter = LoadFitter(
            self.skin,
            self.table,
            direction=self.direction,
            live=self.live,
            most_contacts=self.most_contacts,
        )
        # What a further contact must gain: as rare as a tenth of a false alarm, and never
        # less than Schwarz's criterion asks for two parameters.
        one = np.ones((1, self.taxels))
        everywhere = float(self._detector.test(0 * one, one).length[0])
        penalty = threshold(self.false_alarm / 10, everywhere) ** 2
        self.selection = Selection(
            self._fitter,
            NodeSearch(self.table),
            max(penalty, 2 * np.log(self.taxels)),
            self.most_contacts,
        )
        self._report = LoadAssessment(
            np.asarray(self.skin.electrodes.taxels.angle)[:, 0],
            float(self.skin.geometry.outer_radius[0]),
            self._fitter.edge,
            self.table,
            direction=self.direction,
        )

    def _check(self) -> None:
        if not 0 < self.false_alarm < 0.5:
            raise ValueError(
                f"false_alarm = {self.false_alarm:g}: a rate above 0 and below 0.5 is needed"
            )
        if not 1 <= self.most_contacts <= MOST_CONTACTS:
            raise ValueError(
                f"most_contacts = {self.most_contacts}: 1 to {MOST_CONTACTS} are possible"
            )
        if not (np.isfinite(self.model_error) and self.model_error >= 0):
            raise ValueError(f"model_error = {self.model_error:g}: zero or more is needed")

    def _zero_of_readings(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """What is taken off readings to compare them with the model, and its variance."""
        if self.rest is not None:
            return self.rest - self.table.rest, np.asarray(self.rest_variance, float)
        record = self.spec.calibration
        if record is None or not record.offsets:
            return np.zeros(self.taxels), np.zeros(self.taxels)
        if len(record.offsets) != self.taxels:
            raise ValueError(
                f"[calibration] offsets: {len(record.offsets)} numbers for the skin's "
                f"{self.taxels} taxels"
            )
        errors = record.offset_errors or np.zeros(self.taxels)
        return np.array(record.offsets, float), np.nan_to_num(np.square(errors))

    def _calibration(self) -> "CalibrationUncertainty | None":
        record = self.spec.calibration
        if record is None or not record.covariance:
            return None
        from fitting.inverse_load.fit.calibration import CalibrationUncertainty

        return CalibrationUncertainty(
            self.spec, self.skin, from_rest=self.rest is not None, live=self.live
        )

    @property
    def taxels(self) -> int:
        """Number of taxels in the layout."""
        return len(self.table.rest)

    def weigh(
        self, so: NDArray[np.float64], faulty: NDArray[np.bool_] | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Readings as the model has them, and their inverse variances.

        Args:
            so: readings [frame, taxel] [counts]; NaN where missing.
            faulty: taxels known to be faulty [frame, taxel].

        Returns:
            Readings [counts] and inverse variances [1/counts^2], both zero where a taxel is
            missing, saturated (0 or full scale) or faulty.
        """
        y = so - self._zero
        used = np.isfinite(y) & (so < FULL_SCALE) & (so > 0)
        if faulty is not None:
            used &= ~faulty
        y = np.where(used, y, 0.0)
        change = np.where(used, y - self.table.rest, 0.0)
        return y, used / (self._variance + (self.model_error * change) ** 2)

    def estimate(
        self,
        so: NDArray[np.float64],
        faulty: NDArray[np.bool_] | None = None,
        done: Callable[[int], None] = lambda frames: None,
    ) -> list[LoadEstimate]:
        """Estimate the loads of frames.

        Args:
            so: readings [frame, taxel] [counts]; NaN where missing. Readings of 0 and of
                full scale are saturated and left out.
            faulty: taxels known to be faulty [frame, taxel].
            done: called with the number of frames estimated so far.

        Raises:
            ValueError: the readings don't have a column for every taxel.
        """
        so = np.asarray(so, float)
        if so.ndim != 2 or so.shape[1] != self.taxels:
            raise ValueError(
                f"readings of shape {so.shape}: [frame, {self.taxels}] is needed, one column "
                "a taxel of the layout"
            )
        if faulty is None:
            faulty = np.zeros(so.shape, bool)
        size = 1 if self.live else _BLOCK
        found: list[LoadEstimate] = []
        for begin in range(0, len(so), size):
            part = slice(begin, begin + size)
            found += self._batch(so[part], faulty[part])
            done(len(found))
        return found

    def forget(self) -> None:
        """Live: start the next frame from the table instead of from the last frame."""
        self.selection.last = None

    def _batch(self, so: NDArray[np.float64], faulty: NDArray[np.bool_]) -> list[LoadEstimate]:
        begin, compiling = time.perf_counter(), COMPILED.seconds
        y, weight = self.weigh(so, faulty)
        change = np.where(weight > 0, y - self.table.rest, 0.0)
        count = (weight > 0).sum(1)
        enough = count >= max(_FEWEST_TAXELS, (3 if self.direction else 2) + 1)
        test = self._detector.test(change, weight)
        touched = enough & (test.p_value < self.false_alarm)
        results: list[LoadEstimate] = [LoadEstimate(None)] * len(so)
        chi2_rest = (weight * change**2).sum(1)
        at_rest = chdtrc(np.maximum(count, 1), chi2_rest) > POOR
        for i in np.flatnonzero(~touched):
            ratio = float(chi2_rest[i] / max(int(count[i]), 1))
            results[i] = _untouched(so[i], weight[i] > 0, bool(enough[i]), ratio)
        full_scale = (so >= FULL_SCALE) & ~faulty
        for index, pulled in (
            (np.flatnonzero(touched), False),
            (np.flatnonzero(enough & ~touched & ~at_rest), True),
        ):
            if index.size:
                found = self._explained(y[index], weight[index], full_scale[index], pulled)
                for i, estimate in zip(index, found, strict=True):
                    results[i] = estimate
        spent = time.perf_counter() - begin - (COMPILED.seconds - compiling)
        spent /= len(so)
        return [replace(result, latency=spent) for result in results]

    def _explained(
        self, y: Any, weight: Any, full_scale: Any, pulled: bool
    ) -> list[LoadEstimate]:
        """Estimates of frames that are not at rest, whether pressed or pulled."""
        if pulled:
            best = self.selection.pulled(y, weight)
            others: list[Alternative | None] = [None] * len(y)
        else:
            best, others = self.selection.explain(y, weight)
        systematic = None
        if self.calibration is not None:
            systematic = self.calibration.covariance(best, 3 if self.direction else 2)
        return self._report.estimates(best, others, full_scale, systematic)


def _untouched(so: Any, used: Any, enough: bool, ratio: float) -> LoadEstimate:
    missing = tuple(np.flatnonzero(~used).tolist())
    if not enough:
        present = so[np.isfinite(so)]
        saturated = present.size and ((present >= FULL_SCALE) | (present <= 0)).all()
        status = "saturated" if saturated else "too_few_taxels"
        return LoadEstimate(None, status=status, left_out=missing)
    return LoadEstimate(False, (), 0.0, False, ratio, "no_contact", missing)
