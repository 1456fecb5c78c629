"""Least squares for loads and, where they leave more than noise, errors of the skin's inputs.

Each error adds its square, in standard deviations, to chi2.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fitting.arrays import Floats, Rows
from fitting.inverse_load.fit.explanation import AbstractLoadFitter, Attempt, Explanations
from fitting.inverse_load.fit.systematic import AbstractSystematicErrors
from fitting.steps import Steps

SUSPECT = 2e-3
"""p-value of chi2 below which other explanations are tried."""
_ERROR_FITS = 4  # of errors and loads in turn
_WORTH = 0.5  # share of chi2 that errors must explain, or nearly all, to be fitted
_ENDED = 0.1  # decrease of chi2 below which errors and loads have settled
_WITH_ERRORS = 2  # fits of a frame by several contacts that errors are fitted beside


@dataclass(frozen=True)
class LoadsAndErrors:
    """Fits explanations of frames by a number of contacts."""

    fitter: AbstractLoadFitter  # least squares on the skin
    # of the skin's inputs; None where they are known exactly
    errors: AbstractSystematicErrors | None

    def fit(
        self,
        asked: Attempt,
        *,
        fitter: AbstractLoadFitter | None = None,
        frame: Rows | None = None,  # that a row is of, where a frame has several
    ) -> Steps[Explanations]:
        """Fit loads, and errors of the inputs where loads alone leave more than noise."""
        fitter = fitter or self.fitter
        found = yield from fitter.steps(asked)
        own = asked.y, asked.weight, found, fitter
        return (yield from self.or_errors(*own, pull=asked.pull, frame=frame))

    def or_errors(
        self,
        y: Any,
        weight: Any,
        found: Explanations,  # by loads alone
        fitter: AbstractLoadFitter,  # that found them
        *,
        pull: bool = False,
        frame: Rows | None = None,  # that a row is of, where a frame has several
    ) -> Steps[Explanations]:
        """Errors of the inputs beside loads, where these leave more than noise."""
        if self.errors is None or not self.errors.names:
            return found
        per_contact = self.fitter.per_contact
        poor = np.isfinite(found.chi2) & (found.p_value(per_contact) < SUSPECT)
        rows = _best(np.flatnonzero(poor), found, frame)
        if not rows.size:
            return found
        own = found.rows(rows)
        yield "errors of the inputs"
        told = self.errors.of(own, y[rows] - own.so, per_contact)
        # Where errors leave most of it, another explanation is sought instead.
        left = own.chi2 - told.decrease
        explained = replace(own, chi2=left)
        worth = (left < _WORTH * own.chi2) | (explained.p_value(per_contact) >= SUSPECT)
        kept = np.flatnonzero(worth)
        if kept.size:
            rows, begin, errors = rows[kept], own.rows(kept), told.likely[kept]
            given = fitter, y[rows], weight[rows], begin, errors
            better = yield from self._with_errors(*given, pull=pull)
            found = found.cheapest(rows, better)[0]
        return found

    def beside_errors(
        self,
        asked: Attempt,
        shift: Floats,  # of the readings by errors that are about right [frame, taxel]
        frame: Rows | None = None,  # that a row is of, where a frame has several
    ) -> Steps[Explanations]:
        """Fit loads and errors of the inputs, whatever loads alone would leave."""
        y, weight = asked.y, asked.weight
        begin = yield from self.fitter.steps(asked._replace(y=y - shift))
        found = replace(begin, score=np.full(len(y), np.inf), chi2=np.full(len(y), np.inf))
        rows = _best(np.flatnonzero(np.isfinite(begin.chi2)), begin, frame)
        if self.errors is None or not self.errors.names or not rows.size:
            return found
        own, y, weight = found.rows(rows), y[rows], weight[rows]
        yield "errors of the inputs"
        told = self.errors.of(own, y - own.so, self.fitter.per_contact)
        given = self.fitter, y, weight, own, told.likely
        better = yield from self._with_errors(*given, pull=False)
        return found.with_frames(rows, better, np.arange(len(rows)))

    def _with_errors(
        self,
        fitter: AbstractLoadFitter,
        y: Any,  # readings [frame, taxel]
        weight: Any,  # inverse variances
        begin: Explanations,  # by loads alone
        errors: Any,  # most likely there, in standard deviations [frame, error]
        *,
        pull: bool,  # whether forces pull outwards
    ) -> Steps[Explanations]:
        """Loads and errors of the inputs in turn, from explanations by loads alone."""
        assert self.errors is not None
        per_contact, count = self.fitter.per_contact, int(begin.contacts[0])
        width = per_contact * count
        best, size = begin, len(self.errors.names)
        known, now = np.zeros_like(errors), begin
        slopes = self.errors.of(begin, y - begin.so, per_contact).slopes
        for _ in range(_ERROR_FITS):
            shift = np.einsum("fe,fet->ft", errors, slopes)
            start = now.parameters[:, :width]
            own = Attempt(y - shift, weight, start, now.state, count, pull)
            fit = yield from fitter.steps(own)
            cost = fit.chi2 + (errors**2).sum(1)
            fit = replace(fit, score=cost, chi2=cost, so=fit.so + shift, shift=shift)
            gained = best.score - cost
            best, _ = best.cheapest(np.arange(len(y)), fit)
            if not (gained > _ENDED).any():
                break
            known, now = errors, fit
            told = self.errors.of(fit, y - fit.so, per_contact)
            slopes = told.slopes
            step = told.spread @ (told.pull - known)[..., None]
            errors = known + step.reshape(-1, size)
        return best


def _best(rows: Rows, found: Explanations, frame: Rows | None) -> Rows:
    """The rows of lowest chi2 of every frame: beside errors, a fit takes many rounds."""
    if frame is None:
        return rows
    order = rows[np.lexsort((found.chi2[rows], frame[rows]))]
    _, first = np.unique(frame[order], return_index=True)
    rank = np.arange(len(order)) - np.repeat(first, np.diff(np.append(first, len(order))))
    return np.sort(order[rank < _WITH_ERRORS])
