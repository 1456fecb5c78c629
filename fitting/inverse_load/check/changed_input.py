"""One number of a skin file, fitted to the frames of a log with their contacts.

Far from the file's value readings are no longer linear in it, and what is linear there would
be blamed on another input: the contacts are fitted anew at every value that is tried.
"""

import abc

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from fitting.inverse_load.check.verdict import Gain
from fitting.inverse_load.estimator import LoadEstimator
from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.fit.section_errors import changed_skin
from fitting.inverse_load.fit.section_fitter import SectionFitter
from fitting.inverse_load.search.table import rest_readings
from suas_jax.config.input_errors import value_of

_FURTHEST = 0.3  # relative change that is tried
_FINE = 1e-3  # accuracy of the change
_SHARES = (1.0, 0.8, 0.6)  # of the contacts' forces, where fits start
_LOST = 100.0  # chi2 that a frame is charged whose contact is not found


class AbstractInputFit(abc.ABC):
    """Fits of single contacts at other values of one input.

    Args:
        estimator: of the skin.
        y: channels as the file's skin has them [frame, channel].
        weight: their inverse variances [frame, channel].
        fit: the contacts with the file's numbers.
    """

    def __init__(
        self,
        estimator: LoadEstimator,
        y: NDArray[np.float64],
        weight: NDArray[np.float64],
        fit: Explanations,
    ) -> None:
        self._estimator, self._y, self._weight, self._fit = estimator, y, weight, fit
        self._lost = fit.chi2 + _LOST

    @abc.abstractmethod
    def chi2(self, path: str, change: float) -> float:
        """Sum of the frames' chi2 with an input changed, contacts fitted anew.

        Args:
            path: of the input.
            change: relative.
        """

    def best(self, gained: Gain) -> Gain:
        """The change of an input that explains most, and what it takes off chi2.

        Args:
            gained: what its change would do to first order, relative too.
        """
        found = minimize_scalar(
            lambda change: self.chi2(gained.name, change),
            bounds=(-_FURTHEST, _FURTHEST),
            method="bounded",
            options={"xatol": _FINE},
        )
        if abs(found.x) > _FURTHEST - 2 * _FINE:  # chi2 falls on: something else is wrong
            return gained._replace(chi2=0.0)
        decrease = float(self._fit.chi2.sum()) - float(found.fun)
        return gained._replace(chi2=decrease, change=float(found.x))


class SectionInputFit(AbstractInputFit):
    """Fits on a skin in plane strain, at other values of any of its inputs."""

    def chi2(self, path: str, change: float) -> float:
        """See the base class."""
        own, fitter = self._estimator, self._estimator.selection.fitter
        assert isinstance(fitter, SectionFitter)
        value = (1 + change) * value_of(own.spec, path)
        skin = changed_skin(own.spec, own.skin, {path: value})
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
