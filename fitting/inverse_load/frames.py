"""Estimates of frames, each by itself: contact or none, loads, and how sure they are."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import chdtrc

from fitting.arrays import Flags, Floats, Rows
from fitting.inverse_load.drift import Drift, ReadingWeights
from fitting.inverse_load.estimate.assessment import POOR
from fitting.inverse_load.estimate.estimate import LoadEstimate
from fitting.inverse_load.estimate.measured_pressure import with_doubts
from fitting.inverse_load.estimate.parts import EstimationParts
from fitting.inverse_load.film_motion import covariance_by_motion, mostly_motion, told_moving
from fitting.inverse_load.fit.detection import without_errors
from fitting.inverse_load.fit.doubts import OUTLIER, inliers, most_left_out
from fitting.inverse_load.fit.explanation import Alternative, Explanations
from fitting.inverse_load.fit.selection import Selection
from fitting.inverse_load.fit.systematic import (
    AbstractSystematicErrors,
    of_scattered_forces,
    of_shared_places,
)
from fitting.steps import Steps
from suas_jax.acquisition.log.data import MAX_COUNT
from suas_jax.acquisition.taxel_faults import saturated
from suas_jax.config.schema_calibration import CalibrationSpec
from suas_jax.runtime.compiling import COMPILE_TIME

if TYPE_CHECKING:
    from fitting.inverse_load.discrepancy import ReadingDiscrepancy
    from fitting.inverse_load.field.fallback import FieldFallback
    from fitting.inverse_load.memory.series import AbstractMemoryFollower

FULL_SCALE = MAX_COUNT
_FEWEST_TAXELS = 4
_DRIFTING = 3.0  # counts of drift beyond which a status says so


@dataclass
class FrameEstimator:
    """Estimates frames of one skin."""

    parts: EstimationParts  # of the skin
    weights: ReadingWeights  # readings as the model has them, weighed
    selection: Selection  # finds what explains a frame
    false_alarm: float  # rate at which noise alone may be called a contact
    # what presses showed of the unit beyond the model; None where they showed nothing
    discrepancy: "ReadingDiscrepancy | None"
    record: CalibrationSpec | None  # of the unit; None where it was not calibrated
    # told where contacts explain a frame poorly; made with the first such frame
    load_field: "Callable[[], FieldFallback | None]"

    def batch(
        self,
        so: Floats,
        faulty: Flags,
        pressure: Floats | None,
        drift: Drift | None,
        moved: Floats | None = None,
        memory: "AbstractMemoryFollower | None" = None,
        shift: Floats | float = 0.0,
    ) -> list[LoadEstimate]:
        """Estimates of some frames; of one, with what its membrane remembers."""
        begin, compiling = time.perf_counter(), COMPILE_TIME.seconds
        selection = self.selection if memory is None else memory.selection
        systematic = self.parts.systematic if memory is None else memory.errors
        y, weight = self.weights.weigh(so, faulty, pressure, drift)
        y = np.where(weight > 0, y - shift, 0.0)
        taxels = slice(len(self.parts.rest))
        measured = None
        if not self.weights.beside:
            measured = np.array(self.weights.of_pressure(pressure, len(so)))
        change = np.where(weight > 0, y - self.parts.nodes.rest, 0.0)
        count = (weight[:, taxels] > 0).sum(1)
        enough = count >= max(_FEWEST_TAXELS, self.parts.fitter.per_contact + 1)
        errors = None if systematic is None else systematic.rest
        test = self.parts.detector.test(change, weight, errors)
        touched = enough & (test.p_value < self.false_alarm)
        results: list[LoadEstimate] = [LoadEstimate(None)] * len(so)
        alone = np.zeros(len(so))
        chi2_rest = chi2_at_rest(change, weight, errors)
        at_rest = chdtrc(np.maximum(count, 1), chi2_rest) > POOR
        kept = self._but_for_spikes(change, weight, errors, touched | enough & ~at_rest)
        spiked = (kept != (weight > 0)).any(1)
        if spiked.any():
            weight, touched = np.where(kept, weight, 0.0), touched & ~spiked
            chi2_rest = chi2_at_rest(change, weight, errors)
            at_rest |= spiked
        oil = self.parts.rest_pressure if memory is None else memory.pressure
        for i in np.flatnonzero(~touched):
            ratio = float(chi2_rest[i] / max(int(count[i]), 1))
            used = weight[i, taxels] > 0
            results[i] = untouched(so[i], used, bool(enough[i]), ratio, oil)
        full_scale = (so >= FULL_SCALE) & ~faulty
        if not touched.any():
            selection.untouched()
        moving = np.zeros(len(so), bool)
        if moved is not None:
            moving = mostly_motion(moved, change[:, taxels])
        for group, kind in (
            (touched & ~moving, "pressed"),
            (touched & moving, "moving"),
            (enough & ~touched & ~at_rest, "pulled"),
        ):
            index = np.flatnonzero(group)
            if index.size:
                own_motion = None if moved is None else moved[index]
                own_frames = y[index], weight[index], full_scale[index], own_motion
                beside = None if measured is None else measured[:, index]
                how = kind, beside
                best, found = self._explained(selection, systematic, *own_frames, *how)
                for i, estimate in zip(index, found, strict=True):
                    results[i] = estimate
                if kind != "pulled":
                    alone[index] = selection.seconds
                if memory is not None:
                    told = results[0].contacts and results[0].status != "coarse"
                    memory.after(best if told else None)
        if memory is not None and results[0].contact is False:
            memory.untouched()
        if moved is not None:
            results = told_moving(results, moved, change[:, taxels])
        if drift is not None:
            results = [drifting(e, *d) for e, d in zip(results, drift.sizes(), strict=True)]
        spent = time.perf_counter() - begin - (COMPILE_TIME.seconds - compiling)
        shared = max(spent - alone.sum(), 0.0) / len(so)
        own = (shared + alone).tolist()
        return [replace(result, latency=s) for result, s in zip(results, own, strict=True)]

    def _explained(
        self,
        selection: Selection,
        systematic: AbstractSystematicErrors | None,
        y: Any,
        weight: Any,
        full_scale: Any,
        moved: Floats | None,
        kind: str,  # pressed, moving or pulled
        # oil pressure [Pa] and its inverse variance [2, frame], where no channel has it
        measured: Floats | None = None,
        # what explains them, where that has been sought already
        found: tuple[Explanations, list[Alternative | None]] | None = None,
        *,
        still: bool = True,  # whether readings are not means over a motion
    ) -> tuple[Explanations, list[LoadEstimate]]:
        """Estimates of frames that are not at rest, all of one kind."""
        discrepancy, left = self.discrepancy if kind == "pressed" else None, None
        others: list[Alternative | None]
        if found is not None:
            best, others = found
        elif discrepancy is not None:
            y, weight, left, best, others = discrepancy.explain(selection, y, weight)
        elif kind != "pressed":
            fit = selection.pulled if kind == "pulled" else selection.one_contact
            best, others = fit(y, weight), [None] * len(y)
        else:
            best, others = selection.explain(y, weight)
        if kind == "pressed" and selection.coarse:
            return best, [self.parts.assessment.so_far(best)]
        still = still and kind == "pressed"
        best, own = selection.fitter.with_left_out(best, y, still=still)
        per_contact = self.parts.fitter.per_contact
        parts = []
        if systematic is not None:
            parts.append(systematic.covariance(best, y, per_contact))
        record = self.record
        shift = self.parts.assessment.along.shift
        if shift.known:
            parts.append(of_shared_places(best, per_contact, shift.covariance))
        if record is not None and record.force_scatter:
            parameters = self.parts.fitter.parameters
            parts.append(of_scattered_forces(best, parameters, record.force_scatter**2))
        if discrepancy is not None and left is not None:
            parts.append(discrepancy.of_loads(best, left, per_contact))
        covariance = sum(parts[1:], parts[0]) if parts else None
        if moved is not None:
            motion = covariance_by_motion(best, moved, per_contact)
            own = motion if own is None else own + motion
        assess = self.parts.assessment.estimates
        told = assess(best, others, full_scale, covariance, own)
        if measured is not None:
            y, weight = (np.column_stack(x) for x in zip((y, weight), measured, strict=True))
        asked = kind != "moving" and selection is self.selection
        field = self.load_field() if asked else None
        if field is not None:
            told = field.told(told, best, y, weight)
        return best, with_doubts(told, y, weight)

    def _but_for_spikes(
        self, change: Floats, weight: Floats, errors: Floats | None, asked: Flags
    ) -> Flags:
        """Which readings count [frame, channel]: all, or those of frames that rest but for few.

        Beside the others, which rest, the price of each is less than what a light push or pull
        leaves that takes more off than noise does at the stated rate. Changes are from rest
        [frame, channel], as their inverse variances; errors of the inputs change them [error,
        channel].
        """
        sound, used = inliers(change, weight, np.zeros_like(change)) > 0, weight > 0
        off = used.sum(1) - sound.sum(1)
        rows = np.flatnonzero(asked & (off > 0) & (off <= most_left_out(weight)))
        if not rows.size:
            return used

        def left(row: Rows, weights: Floats) -> tuple[Floats, Floats]:
            """Chi2 beside the best light push or pull, and how likely noise is as good."""
            own = change[row]
            tests = [self.parts.detector.test(x, weights, errors) for x in (own, -own)]
            taken = np.maximum(*(np.maximum(x.statistic, 0.0) ** 2 for x in tests))
            p_value = np.minimum(*(x.p_value for x in tests))
            return chi2_at_rest(own, weights, errors) - taken, p_value

        rest, p_value = left(rows, weight[rows] * sound[rows])
        quiet = p_value >= self.false_alarm
        rows, rest = rows[quiet], rest[quiet]
        at, taxel = np.nonzero(used[rows] & ~sound[rows])
        with_one = weight[rows[at]] * sound[rows[at]]
        with_one[np.arange(len(at)), taxel] = weight[rows[at], taxel]
        dearer = left(rows[at], with_one)[0] < rest[at] + OUTLIER**2
        rows = np.delete(rows, at[dearer])
        used[rows] = sound[rows]
        return used

    @cached_property
    def _of_changes(self) -> tuple[Selection, AbstractSystematicErrors | None]:
        """What explains changes from rest by one contact, beside which errors."""
        errors = self.parts.systematic
        errors = None if errors is None else errors.from_rest()
        return replace(self.selection.of_one, errors=errors), errors

    def alone(self, y: Floats, weight: Floats) -> Steps[tuple[LoadEstimate, Floats]]:
        """A frame of changes from rest, and its parameters; no load where none is felt.

        y is the model's readings at rest plus the changes; no frame came before.
        """
        of_one, errors = self._of_changes
        test = self.parts.detector.test(y - self.parts.nodes.rest, weight, None)
        if test.p_value[0] >= self.false_alarm:
            return LoadEstimate(False), np.zeros(0)
        of_one.forget()
        found = None
        if self.discrepancy is None:
            found = yield from of_one.steps(y, weight)
        frame = y, weight, np.zeros((1, len(self.parts.rest)), bool), None
        best, told = self._explained(
            of_one, errors, *frame, "pressed", found=found, still=False
        )
        return told[0], best.parameters[0]


def chi2_at_rest(change: Any, weight: Any, errors: Floats | None) -> Floats:
    """Weighted squares of the change from rest that no error of the inputs explains."""
    left = change
    if errors is not None and errors.any():
        left, _ = without_errors(change, weight, errors)
    return np.asarray((weight * left * change).sum(1))


def drifting(estimate: LoadEstimate, mean: float, largest: float) -> LoadEstimate:
    """An estimate with the drift that was taken off its readings."""
    names = {"no_contact": "drifting", "ok": "ok_drifted"}
    far = abs(largest) > _DRIFTING
    status = names.get(estimate.status, estimate.status) if far else estimate.status
    return replace(estimate, status=status, drift=(mean, largest))


def untouched(so: Any, used: Any, enough: bool, ratio: float, pressure: float) -> LoadEstimate:
    """The estimate of a frame that shows no contact, or has too few readings to show one.

    Readings are [taxel] [counts]; the ratio is chi2 per degree of freedom, the
    pressure that of the oil at rest [Pa].
    """
    missing = tuple(np.flatnonzero(~used).tolist())
    if not enough:
        present = so[np.isfinite(so)]
        at_limits = present.size and saturated(present).all()
        status = "saturated" if at_limits else "too_few_taxels"
        return LoadEstimate(None, status=status, left_out=missing)
    return LoadEstimate(False, (), pressure, False, ratio, "no_contact", missing)
