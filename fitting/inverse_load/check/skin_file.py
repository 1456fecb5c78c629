"""Verdict of a log on the skin file of a pad: does it describe that pad?

A wrong thickness, gap, permittivity or stiffness leaves residuals of its own shape in every
frame; the input of largest gain is named (see `verdict`). A stiffness scales forces and
pressures alike, so readings alone never show it; a measured oil pressure does.
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import chdtrc

from fitting.arrays import Flags, Floats
from fitting.inverse_load.check.changed_input import ELECTRICAL, FURTHEST, ElectricalFit
from fitting.inverse_load.check.verdict import (
    FEWEST,
    GAIN,
    LARGER,
    USABLE,
    Gain,
    ModelVerdict,
    gain_of,
    verdict_of,
)
from fitting.inverse_load.estimate.estimate import LoadEstimate
from fitting.inverse_load.estimator import LoadEstimator
from fitting.inverse_load.pad.fitter import PadFitter
from fitting.inverse_load.pad.stiffening import solved_channels
from suas_jax.config.input_errors import STIFFNESS, scaled_input
from suas_jax.scene.skin import skin_of

_MOST = 12  # frames that are solved again
_SURE = 1e-4  # p-value of chi2 of all frames below which something is wrong
_STEP = 0.02  # relative change of an input
_THICKNESS = "geometry.thickness"
_LEAST_CHANGE = 1e-2  # relative, of an input that is named where noise explains the log


def model_verdict(
    estimator: LoadEstimator,  # of a pad
    so: Floats,  # readings [frame, taxel] [counts]
    faulty: Flags,  # taxels known to be faulty [frame, taxel]
    pressure: Floats | None,  # measured of the oil [frame] [Pa]; None where it was not
    estimates: Sequence[LoadEstimate],
) -> ModelVerdict | None:
    """Look at the single contacts of a log; None for too few, or with free directions."""
    fitter = estimator.selection.fitter
    assert isinstance(fitter, PadFitter)
    if estimator.direction:  # the readings' few hints are taken by the directions
        return None
    frames = np.flatnonzero([_pushed_alone(estimate) for estimate in estimates])
    if len(frames) < FEWEST:
        return None
    frames = frames[np.linspace(0, len(frames) - 1, min(_MOST, len(frames))).astype(int)]
    own = None if pressure is None else pressure[frames]
    y, weight = estimator.weigh(so[frames], faulty[frames], own)
    nodes = estimator.selection.nodes
    first, _ = nodes.nearest(y, weight)
    fit = fitter.fit(y, weight, nodes.loads[first], nodes.states(first), 1)
    dof = int((weight > 0).sum()) - fitter.per_contact * len(frames)
    chi2 = float(fit.chi2.sum())
    width = fitter.per_contact
    parameters, jacobian = fit.parameters[:, :width], fit.jacobian[:, :width]
    residual = np.where(weight > 0, y - fit.so, 0.0)

    def gained(name: str, slopes: Floats) -> Gain:
        return gain_of(name, slopes, weight, residual, jacobian)

    # A stiffer pad shows what less force does, at more pressure.
    stiffer = -parameters[:, 2:3] * jacobian[:, 2]
    stiffer[:, -1] += fit.so[:, -1]
    found = [gained(STIFFNESS, stiffer)]
    fits = ElectricalFit(estimator, y, weight, fit)
    for path in ELECTRICAL:
        own_gain = gained(path, fits.slopes(path))
        if own_gain.chi2 > GAIN:
            own_gain = fits.best(own_gain)
        found.append(own_gain)
    noise = chdtrc(dof, chi2) > _SURE or chi2 < LARGER * dof
    if not noise:
        found += [gained(name, by) for name, by in _slopes(estimator, parameters).items()]
    least = _LEAST_CHANGE if noise else 0.0
    named = [x for x in found if x.chi2 > GAIN and least < abs(x.change) < FURTHEST]
    if named:
        return verdict_of(sorted(named, reverse=True), chi2, dof)
    return ModelVerdict(chi2 / dof, bool(noise))


def _pushed_alone(estimate: LoadEstimate) -> bool:
    """Whether one push may explain a frame; what is left of a pull is not the file's fault."""
    alone = estimate.status in USABLE and len(estimate.contacts) < 2
    return alone and not any(contact.force < 0 for contact in estimate.contacts)


def _slopes(estimator: LoadEstimator, parameters: Floats) -> dict[str, Floats]:
    """Derivatives of the channels by the logarithms of inputs [frame, channel]."""
    skin, diameter = estimator.skin, estimator.diameter or float("nan")
    slots = max(estimator.most_contacts, 2)  # as the estimator's own program has
    base = solved_channels(skin, parameters, diameter, slots)
    inputs = scaled_input(estimator.spec, _THICKNESS, 1 + _STEP)
    changed = skin_of(estimator.spec, inputs, elements=skin.elements, contact=False)
    thicker = solved_channels(changed, parameters, diameter, slots)
    return {_THICKNESS: (thicker - base) / _STEP}
