"""Verdict of a log on the skin file of a section: does it describe that section?

One contact hardly shows a wrong gap where readings count from a baseline; many contacts share
it (see `verdict`). A column too many shifts all readings by a taxel, and wide contacts leave a
pattern that no input does. A stiffness is seen by nothing but a known force or the oil's
measured pressure: at the same readings both are in proportion to it.
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import chdtrc

from fitting.arrays import Flags, Floats
from fitting.inverse_load.check.changed_input import SectionInputFit
from fitting.inverse_load.check.verdict import (
    FEWEST,
    GAIN,
    LARGER,
    USABLE,
    WIDTH,
    Gain,
    ModelVerdict,
    gain_of,
    verdict_of,
)
from fitting.inverse_load.estimate.estimate import LoadEstimate
from fitting.inverse_load.estimator import LoadEstimator
from fitting.inverse_load.fit.explanation import UNSETTLED, Attempt, Explanations
from fitting.inverse_load.fit.section_errors import InputSlopes
from fitting.inverse_load.fit.wide_contact import LENGTH, WideContactFitter
from fitting.steps import finished
from suas_jax.config.input_errors import DEFAULTS, STIFFNESS, default_errors

_MOST = 64  # frames that are looked at
_SURE = 1e-4  # p-value of chi2 of all frames below which something is wrong
# relative, of an input that is named where noise explains the log: less may be the model's own
# error. Where noise does not, a small change explains more than a large one of another input.
_LEAST_CHANGE = 5e-3
_SHIFTS = (-2, -1, 1, 2)
_FRAMES_SHIFTED = 16
_BETTER = 0.5  # share of chi2 that a shift may leave to be named
_SIGMAS = 4.0  # of a stiffness that is named
_LEAST_STIFFNESS = 0.01  # relative
_SEEN_WIDE = 1 / 3  # share of wide contacts that speaks of widths
_NARROW = 2 / 3  # share of the single contacts that must be lines


def section_verdict(
    estimator: LoadEstimator,  # of a skin in plane strain
    so: Floats,  # readings [frame, taxel] [counts]
    faulty: Flags,  # taxels known to be faulty [frame, taxel]
    estimates: Sequence[LoadEstimate],
    *,
    pressure: Floats | None = None,  # measured of the oil [frame] [Pa]; None where it was not
    force: Floats | None = None,
) -> ModelVerdict | None:
    """Look at the contacts of a log; None where too few are single and no cause is seen.

    The known force is that of the one contact [frame] [N]; it is NaN where there is none.
    """
    touched = [i for i, e in enumerate(estimates) if e.status in USABLE]
    single = [i for i in touched if len(estimates[i].contacts) < 2]
    usable = [
        i for i in single if not any(c.spread or c.arc_force for c in estimates[i].contacts)
    ]
    # Where many contacts are seen to be wide, others are, too light for it to show.
    few = len(usable) < max(FEWEST, _NARROW * len(single))
    frames = np.array(touched if few else usable, np.intp)
    if len(frames) < FEWEST:
        return None
    frames = frames[np.linspace(0, len(frames) - 1, min(_MOST, len(frames))).astype(int)]
    y, weight = estimator.weigh(so[frames], faulty[frames])
    fit = _single(estimator, y, weight)
    # The fits of a changed input go on from these: one that has not settled would settle
    # there, and the input would seem to explain it.
    known = np.isfinite(fit.chi2) & (fit.predicted_decrease <= UNSETTLED)
    if known.sum() < FEWEST:
        return None
    frames, y, weight, fit = (
        frames[known],
        y[known],
        weight[known],
        fit.rows(known.nonzero()[0]),
    )
    dof = int((weight > 0).sum()) - 2 * len(frames)
    chi2 = float(fit.chi2.sum())
    noise = chdtrc(dof, chi2) > _SURE or chi2 < LARGER * dof
    if not noise:
        shifted = _shifted(estimator, y, weight, chi2 / dof)
        if shifted is not None:
            return shifted
    # A shift makes one contact look like several or like a wide one; where few are left to
    # judge the skin by, that and their widths are all that is looked for.
    named = [] if few else _explaining(estimator, y, weight, fit, noise=bool(noise))
    if named or not noise:
        wide = _wide(estimator, y, weight, fit)
        seen = len(single) - len(usable) > _SEEN_WIDE * len(touched)
        if wide.chi2 > max([GAIN, *(x.chi2 for x in named)]) and (seen or not few):
            explained = (chi2 - wide.chi2) / dof
            return ModelVerdict(chi2 / dof, False, WIDTH, wide.change, explained=explained)
    if few:
        return None
    if named:
        return verdict_of(named, chi2, dof)
    for measured, model in ((force, fit.parameters[:, 1]), (pressure, fit.pressure)):
        ratio = None if measured is None else _ratio(measured[frames], model)
        if ratio is not None:
            return ModelVerdict(chi2 / dof, False, STIFFNESS, ratio[0] - 1, ratio[1])
    return ModelVerdict(chi2 / dof, bool(noise))


def _single(estimator: LoadEstimator, y: Floats, weight: Floats) -> Explanations:
    """Fits of one contact, the skin's inputs as written."""
    nodes, fitter = estimator.selection.nodes, estimator.selection.fitter
    first, _ = nodes.nearest(y, weight)
    start = nodes.near(y, weight, first)
    return fitter.fit(y, weight, start, nodes.states(first), 1)


def _explaining(
    estimator: LoadEstimator, y: Floats, weight: Floats, fit: Explanations, *, noise: bool
) -> list[Gain]:
    """Inputs whose change explains much, the best first; their changes are relative."""
    candidates = default_errors(estimator.input_errors.spec)
    model = InputSlopes(candidates, estimator.skin)
    slopes = model.by_errors(fit.parameters[:, :2], fit.state, 1)
    if estimator.rest is not None:
        slopes = slopes - model.at_rest()
    residual = np.where(weight > 0, y - fit.so, 0.0)
    found, fits = [], SectionInputFit(estimator, y, weight, fit)
    for e, name in enumerate(candidates.names):
        if name == STIFFNESS or name not in DEFAULTS:  # what no readings show
            continue
        gained = gain_of(name, slopes[:, e], weight, residual, fit.jacobian[:, :2])
        share = DEFAULTS[name]
        gained = gained._replace(change=share * gained.change, error=share * gained.error)
        # Where noise explains the log, no input is far off.
        if not noise or gained.chi2 > GAIN:
            gained = fits.best(gained)
        found.append(gained)
    least = _LEAST_CHANGE if noise else 0.0
    return sorted((x for x in found if x.chi2 > GAIN and abs(x.change) > least), reverse=True)


def _wide(estimator: LoadEstimator, y: Floats, weight: Floats, fit: Explanations) -> Gain:
    """What widths of the contacts take off chi2 beyond what a number each does by chance."""
    fitter = estimator.selection.wide_fitter
    if not isinstance(fitter, WideContactFitter):
        return Gain(0.0, WIDTH, 0.0, np.inf)
    asked = Attempt(y, weight, fit.parameters[:, :2], fit.state, 1)
    wide = finished(fitter.freed(asked, [LENGTH]))
    gained = np.maximum(np.nan_to_num(fit.chi2 - wide.chi2, neginf=0.0), 0.0)
    length = float(np.median(wide.beside[gained > 0, 0, 0, 0])) if gained.any() else 0.0
    return Gain(float(gained.sum()) - len(gained), WIDTH, length, np.inf)


def _shifted(
    estimator: LoadEstimator, y: Floats, weight: Floats, own: float
) -> ModelVerdict | None:
    """A shift of the readings by whole taxels that explains them far better."""
    some = np.linspace(0, len(y) - 1, min(_FRAMES_SHIFTED, len(y))).astype(int)
    change = np.where(weight > 0, y - estimator.model_rest, 0.0)[some]
    found = []
    for shift in _SHIFTS:
        moved, used = np.roll(change, shift, 1), np.roll(weight[some], shift, 1)
        # What the shift brings in from the other end belongs to no taxel.
        edge = slice(None, shift) if shift > 0 else slice(shift, None)
        used[:, edge] = 0.0
        fit = _single(estimator, moved + estimator.model_rest, used)
        dof = int((used > 0).sum()) - 2 * len(some)
        chi2 = float(np.where(np.isfinite(fit.chi2), fit.chi2, 1e9).sum())
        found.append((chi2 / max(dof, 1), shift))
    left, shift = min(found)
    if left > min(_BETTER * own, LARGER):
        return None
    return ModelVerdict(own, False, explained=left, shift=shift)


def _ratio(measured: Floats, model: Floats) -> tuple[float, float] | None:
    """Measured over model and its standard error, where they differ for certain."""
    used = np.isfinite(measured) & np.isfinite(model) & (measured > 0) & (model > 0)
    if used.sum() < FEWEST:
        return None
    ratio = measured[used] / model[used]
    weight = measured[used] ** 2  # errors are nearly the same in all frames
    mean = float((weight * ratio).sum() / weight.sum())
    scatter = float((weight**2 * (ratio - mean) ** 2).sum() ** 0.5 / weight.sum())
    if abs(mean - 1) < max(_SIGMAS * scatter, _LEAST_STIFFNESS):
        return None
    return mean, scatter
