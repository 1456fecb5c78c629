"""Whether a skin file describes the pad that a log was taken on?

A wrong thickness, gap, permittivity or stiffness leaves residuals of its own shape in every
frame. With r the residuals of single contacts, J and s their derivatives by the contact and by
an input m, W the weights, and s' = s - J (J^T W J)^-1 J^T W s what no contact explains::

    dm = sum s'^T W r / sum s'^T W s',    gain in chi2 = (sum s'^T W r)^2 / sum s'^T W s'

The input of largest gain is named. A stiffness scales forces and pressures alike, so readings
alone never show it; a measured oil pressure does.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from fitting.inverse_load.estimate.estimate import LoadEstimate
from fitting.inverse_load.estimator import LoadEstimator
from fitting.inverse_load.pad.fitter import PadFitter
from fitting.inverse_load.pad.input_errors import solved_channels
from fitting.inverse_load.pad.table import rest_readings
from suas_jax.config import continuous_inputs
from suas_jax.scene.pad_forward import pad_skin_of

_FEWEST = 8  # single contacts that a verdict needs
_MOST = 12  # frames that are solved again
_SURE = 1e-4  # p-value of chi2 of all frames below which something is wrong
_LARGER = 1.2  # chi2 per degree of freedom that the model's own error may leave
_GAIN = 25.0  # least gain in chi2 of an input that is named
_STEP = 0.02  # relative change of an input
_PATHS = ("geometry.thickness", "geometry.oil_gap", "oil.relative_permittivity")
STIFFNESS, DIAMETER = "stiffness of the material", "diameter of the contacts"


@dataclass(frozen=True)
class ModelVerdict:
    """What a log says about its skin file.

    Attributes:
        chi2_per_dof: over the frames that were looked at.
        right: whether noise explains that.
        name: of the input that would explain it best; None where none does.
        change: of that input, relative.
        error: standard deviation of the change.
        explained: chi2 per degree of freedom with that change.
    """

    chi2_per_dof: float
    right: bool
    name: str | None = None
    change: float = float("nan")
    error: float = float("nan")
    explained: float = float("nan")

    @property
    def text(self) -> str:
        """The verdict in a sentence."""
        if self.right:
            return f"the skin file explains the log (chi2 per dof {self.chi2_per_dof:.2f})"
        begin = f"the skin file doesn't explain the log (chi2 per dof {self.chi2_per_dof:.2f})"
        if self.name is None:
            return f"{begin}, and no single input of it would"
        return (
            f"{begin}; it would with the {self.name} changed by {100 * self.change:+.1f} "
            f"+- {100 * self.error:.1f} % (chi2 per dof {self.explained:.2f})"
        )


def model_verdict(
    estimator: LoadEstimator,
    so: NDArray[np.float64],
    faulty: NDArray[np.bool_],
    pressure: NDArray[np.float64] | None,
    estimates: Sequence[LoadEstimate],
) -> ModelVerdict | None:
    """Look at the single contacts of a log; None where they are too few.

    Args:
        estimator: of a pad.
        so: readings [frame, taxel] [counts].
        faulty: taxels known to be faulty [frame, taxel].
        pressure: measured of the oil [frame] [Pa]; None where it was not.
        estimates: of the frames.
    """
    fitter = estimator.selection.fitter
    assert isinstance(fitter, PadFitter)
    usable = ("ok", "poor_fit", "model_mismatch", "imprecise", "ambiguous")
    frames = np.array([i for i, e in enumerate(estimates) if e.status in usable], np.intp)
    if len(frames) < _FEWEST:
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

    def gains(slopes: dict[str, NDArray[np.float64]]) -> list[_Gain]:
        return [_gain(name, s, weight, residual, jacobian) for name, s in slopes.items()]

    # A stiffer pad shows what less force does, at more pressure.
    stiffer = -parameters[:, 2:3] * jacobian[:, 2]
    stiffer[:, -1] += fit.so[:, -1]
    found = gains({STIFFNESS: stiffer})
    noise = chdtrc(dof, chi2) > _SURE or chi2 < _LARGER * dof
    if noise and found[0].chi2 < _GAIN:
        return ModelVerdict(chi2 / dof, True)
    best = max(found + gains(_slopes(estimator, parameters)))
    if best.chi2 < _GAIN:
        return ModelVerdict(chi2 / dof, False)
    explained = (chi2 - best.chi2) / (dof - 1)
    return ModelVerdict(chi2 / dof, False, best.name, best.change, best.error, explained)


class _Gain(NamedTuple):
    """What a change of an input takes off chi2."""

    chi2: float
    name: str
    change: float
    error: float


def _gain(
    name: str, slopes: NDArray, weight: NDArray, residual: NDArray, jacobian: NDArray
) -> _Gain:
    """The best change of an input, contacts fitted anew to first order."""
    slopes = np.where((weight > 0) & np.isfinite(slopes), slopes, 0.0)
    top, size = 0.0, 0.0
    for w, r, s, j in zip(weight, residual, slopes, jacobian, strict=True):
        information = (j * w) @ j.T
        left = s - np.linalg.lstsq(information, (j * w) @ s, rcond=None)[0] @ j
        top, size = top + float(left @ (w * r)), size + float(left @ (w * left))
    if size <= 0:
        return _Gain(0.0, name, 0.0, float("inf"))
    return _Gain(top**2 / size, name, top / size, size**-0.5)


def _slopes(
    estimator: LoadEstimator, parameters: NDArray[np.float64]
) -> dict[str, NDArray[np.float64]]:
    """Derivatives of the channels by the logarithms of inputs [frame, channel]."""
    skin, diameter = estimator.skin, estimator.diameter or float("nan")
    slots = max(estimator.most_contacts, 2)  # as the estimator's own program has
    known = continuous_inputs(estimator.spec)
    base = solved_channels(skin, parameters, diameter, slots)
    rest = rest_readings(skin)
    slopes = {}
    for path in _PATHS:
        changed = pad_skin_of(
            estimator.spec,
            {path: (1 + _STEP) * known[path]},
            elements=skin.elements,
            contact=False,
        )
        by = (solved_channels(changed, parameters, diameter, slots) - base) / _STEP
        if estimator.rest is not None:  # readings count from rest
            by[:, :-1] -= (rest_readings(changed) - rest) / _STEP
        slopes[path.replace("_", " ")] = by
    if estimator.diameter is not None:
        wider = solved_channels(skin, parameters, (1 + 10 * _STEP) * diameter, slots)
        slopes[DIAMETER] = (wider - base) / (10 * _STEP)
    return slopes
