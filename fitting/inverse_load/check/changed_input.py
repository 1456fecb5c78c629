"""One number of a skin file, fitted to the frames of a log with their contacts.

Far from the file's value readings are no longer linear in it, and what is linear there would
be blamed on another input: the contacts are fitted anew at every value that is tried.

The membrane of a pad moves alike whatever gap, permittivity and scale are, and with its
displacement w over a taxel 1 / (SO - stray) = a + b w: readings of a pad that differs in one of
them become those that the file's pad would have had, and are fitted as any other.
"""

import abc
import functools

import numpy as np
from scipy.optimize import minimize_scalar

from fitting.arrays import Floats
from fitting.inverse_load.check.verdict import Gain
from fitting.inverse_load.estimator import LoadEstimator
from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.fit.section_errors import changed_skin
from fitting.inverse_load.fit.section_fitter import SectionFitter
from fitting.inverse_load.pad.rest import GapLine, gap_line
from fitting.inverse_load.search.table import rest_readings
from suas_jax.config.input_errors import scaled_input

_FINE = 1e-3  # accuracy of the change
_SHARES = (1.0, 0.8, 0.6)  # of the contacts' forces, where fits start
_LOST = 100.0  # chi2 that a frame is charged whose contact is not found

FURTHEST = 0.3
"""Relative change of an input that is tried."""
ELECTRICAL = ("geometry.oil_gap", "oil.relative_permittivity", "electrodes.lsb")
"""The inputs, by TOML path."""
_NEARLY_FURTHEST = FURTHEST - 2 * _FINE
_BEFORE = 0.9  # share of that change, at which chi2 is compared with that there
_STEP = 0.01  # relative, for slopes


class AbstractInputFit(abc.ABC):
    """Fits of single contacts at other values of one input."""

    def __init__(
        self,
        estimator: LoadEstimator,  # of the skin
        y: Floats,  # channels as the file's skin has them [frame, channel]
        weight: Floats,  # their inverse variances [frame, channel]
        fit: Explanations,  # the contacts with the file's numbers
    ) -> None:
        self._estimator, self._y, self._weight, self._fit = estimator, y, weight, fit
        self._lost = fit.chi2 + _LOST

    @abc.abstractmethod
    def chi2(self, path: str, change: float) -> float:
        """Sum of the frames' chi2 with an input changed, contacts fitted anew."""

    def best(self, gained: Gain) -> Gain:
        """The change of an input that explains most, and what it takes off chi2.

        `gained`: what its change would do to first order, relative too.
        """
        if self._falls_on(gained):
            return gained._replace(chi2=0.0)
        found = minimize_scalar(
            lambda change: self.chi2(gained.name, change),
            bounds=(-FURTHEST, FURTHEST),
            method="bounded",
            options={"xatol": _FINE},
        )
        if abs(found.x) > _NEARLY_FURTHEST:
            return gained._replace(chi2=0.0)
        decrease = float(self._fit.chi2.sum()) - float(found.fun)
        return gained._replace(chi2=decrease, change=float(found.x))

    def _falls_on(self, gained: Gain) -> bool:
        """Whether chi2 still falls where an input is changed furthest: something else is wrong.

        Downhill is where the change to first order leads.
        """
        end = float(np.copysign(_NEARLY_FURTHEST, gained.change))
        last = self.chi2(gained.name, end)
        if last >= self._fit.chi2.sum():
            return False
        return last <= self.chi2(gained.name, _BEFORE * end)


class SectionInputFit(AbstractInputFit):
    """Fits on a skin in plane strain, at other values of any of its inputs."""

    def chi2(self, path: str, change: float) -> float:
        """See the base class."""
        own, fitter = self._estimator, self._estimator.selection.fitter
        assert isinstance(fitter, SectionFitter)
        skin = changed_skin(own.spec, own.skin, scaled_input(own.spec, path, 1 + change))
        there = SectionFitter(
            skin, fitter.table, direction=False, live=fitter.live, most_contacts=1
        )
        y = self._y
        if own.rest is not None:  # readings count from those of the skin at rest
            y = y + rest_readings(skin) - own.model_rest
        y = np.where(self._weight > 0, y, 0.0)
        left, chi2 = np.arange(len(y)), self._lost.copy()
        for share in _SHARES:  # of the force: under a smaller gap all of it may pass the wall
            start = self._fit.parameters[left, : fitter.per_contact] * [1.0, share]
            states = self._fit.rows(left).state
            found = there.fit(y[left], self._weight[left], start, states, 1).chi2
            known = np.isfinite(found)
            chi2[left[known]] = found[known]
            left = left[~known]
            if not left.size:
                break
        return float(chi2.sum())


class ElectricalFit(AbstractInputFit):
    """Fits on a pad, at other values of one of its electrical inputs."""

    @functools.cached_property
    def _own(self) -> GapLine:
        return gap_line(self._estimator.spec, {})

    def slopes(self, path: str) -> Floats:
        """Derivative of the channels by the logarithm of an input [frame, channel]."""
        by = np.zeros_like(self._fit.so)
        there = self._changed(path, _STEP)
        so = self._fit.so[:, :-1]
        by[:, :-1] = (self._own.seen_by(there, so) - so) / _STEP
        if self._estimator.rest is not None:  # readings count from rest
            rest = self._estimator.model_rest
            by[:, :-1] -= (self._own.seen_by(there, rest) - rest) / _STEP
        return by

    def chi2(self, path: str, change: float) -> float:
        """See the base class."""
        there, estimator = self._changed(path, change), self._estimator
        used = self._weight[:, :-1] > 0
        so = self._y[:, :-1]
        if estimator.rest is not None:
            rest = estimator.model_rest
            so = so - rest + self._own.seen_by(there, rest)
        so = np.where(used, so, there.stray + 1 / there.at)
        y, weight = self._y.copy(), self._weight.copy()
        back = there.seen_by(self._own, so)
        y[:, :-1] = np.where(used, back, 0.0)
        stretch = (so - there.stray) / (back - self._own.stray)
        weight[:, :-1] *= (there.slope / self._own.slope * stretch**2) ** 2
        fitter = estimator.selection.fitter
        start = self._fit.parameters[:, : fitter.per_contact]
        found = fitter.fit(y, weight, start, self._fit.state, 1).chi2
        return float(np.where(np.isfinite(found), found, self._lost).sum())

    def _changed(self, path: str, change: float) -> GapLine:
        spec = self._estimator.spec
        return gap_line(spec, scaled_input(spec, path, 1 + change))
