"""An electrical number of a pad's skin file, fitted to the frames of a log with their contacts.

The membrane moves alike whatever gap, permittivity and scale are, and with its displacement w
over a taxel 1 / (SO - stray) = a + b w: readings of a pad that differs in one of them become
those that the file's pad would have had, and are fitted as any other.
"""

import functools

import numpy as np
from numpy.typing import NDArray

from fitting.inverse_load.check.changed_input import AbstractInputFit
from fitting.inverse_load.pad.input_errors import gap_line
from suas_jax.config.input_errors import value_of

ELECTRICAL = ("geometry.oil_gap", "oil.relative_permittivity", "electrodes.lsb")
"""The inputs, by TOML path."""
_Line = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
_STEP = 0.01  # relative, for slopes


class ElectricalFit(AbstractInputFit):
    """Fits on a pad, at other values of one of its electrical inputs."""

    @functools.cached_property
    def _own(self) -> _Line:
        return gap_line(self._estimator.spec, {})

    def slopes(self, path: str) -> NDArray[np.float64]:
        """Derivative of the channels by the logarithm of an input [frame, channel]."""
        by = np.zeros_like(self._fit.so)
        there = self._changed(path, _STEP)
        by[:, :-1] = (
            _moved(self._fit.so[:, :-1], self._own, there) - self._fit.so[:, :-1]
        ) / _STEP
        if self._estimator.rest is not None:  # readings count from rest
            rest = self._estimator.model_rest
            by[:, :-1] -= (_moved(rest, self._own, there) - rest) / _STEP
        return by

    def chi2(self, path: str, change: float) -> float:
        """See the base class."""
        there, estimator = self._changed(path, change), self._estimator
        used = self._weight[:, :-1] > 0
        so = self._y[:, :-1]
        if estimator.rest is not None:
            rest = estimator.model_rest
            so = so - rest + _moved(rest, self._own, there)
        so = np.where(used, so, there[0] + 1 / there[1])
        y, weight = self._y.copy(), self._weight.copy()
        back = _moved(so, there, self._own)
        y[:, :-1] = np.where(used, back, 0.0)
        stretch = there[2] / self._own[2] * ((so - there[0]) / (back - self._own[0])) ** 2
        weight[:, :-1] *= stretch**2
        fitter = estimator.selection.fitter
        start = self._fit.parameters[:, : fitter.per_contact]
        found = fitter.fit(y, weight, start, self._fit.state, 1).chi2
        return float(np.where(np.isfinite(found), found, self._lost).sum())

    def _changed(self, path: str, change: float) -> _Line:
        spec = self._estimator.spec
        return gap_line(spec, {path: (1 + change) * value_of(spec, path)})


def _moved(so: NDArray[np.float64], one: _Line, other: _Line) -> NDArray[np.float64]:
    """Readings of one pad as another one has them where its membrane is."""
    displacement = (1 / np.maximum(so - one[0], 1e-9) - one[1]) / one[2]
    return np.asarray(other[0] + 1 / (other[1] + other[2] * displacement))
