"""The posterior of contacts on a pad, on the interpolant of its tables."""

import numpy as np
from numpy.typing import NDArray

from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.fit.load_posterior import AbstractLoadPosterior
from fitting.inverse_load.pad.fitter import PadFitter
from fitting.inverse_load.search.base import AbstractNodeSearch
from fitting.statistics.log_probability import NumpyBatch

_SAME = 1e-3  # distance below which two contacts are the same [m]
_MIRRORS = np.array([[-1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])


class PadPosterior(AbstractLoadPosterior):
    """The posterior of contacts on one pad: even over place and force.

    Several contacts are solved at the mode; what the sum of single ones leaves out there is
    taken as the same for all samples.

    Args:
        fitter: of the pad.
        nodes: its coarse search.
    """

    def __init__(self, fitter: PadFitter, nodes: AbstractNodeSearch) -> None:
        super().__init__(nodes, 2, fitter.squares.prior_volume(), _SAME, _MIRRORS)
        self._fitter = fitter

    def log_probability(self, y: NDArray[np.float64], mode: Explanations) -> NumpyBatch:
        """See the base class."""
        count, fitter = int(mode.contacts[0]), self._fitter
        centre = mode.parameters[0, : fitter.per_contact * count]
        pull = bool(centre[fitter.parameters.rows("force", count)][0] < 0)
        correction = fitter.correction(centre, count)
        weight = mode.weight[:1]

        def log_probability(points: NDArray[np.float64]) -> NDArray[np.float64]:
            low, high = fitter.squares.bounds(points, count, pull)
            inside = ((points >= low) & (points <= high)).all(1)
            within = np.clip(points, low, high)
            chi2 = fitter.squares.chi2(y[None], weight, within, count, correction)
            return np.where(inside, -chi2 / 2, -np.inf)

        return NumpyBatch(log_probability)
