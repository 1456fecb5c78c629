"""The parts of an estimator, whatever the dimension."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fitting.inverse_load.estimate.assessment import AbstractLoadAssessment
from fitting.inverse_load.fit.detection import AbstractDetector
from fitting.inverse_load.fit.explanation import AbstractLoadFitter, Explanations
from fitting.inverse_load.search.base import AbstractNodeSearch


class SystematicErrors(Protocol):
    """Errors of estimates that are the same in every frame."""

    @property
    def rest_variance(self) -> NDArray[np.float64]:
        """Variance of the model's readings at rest [taxel, counts^2]."""

    def covariance(self, best: Explanations, per_contact: int) -> NDArray[np.float64]:
        """Covariances of the parameters, padded as the information is."""


@dataclass(frozen=True)
class EstimationParts:
    """The parts of an estimator, for one skin.

    Attributes:
        rest: the model's readings at rest [taxel] [counts].
        detector: tells contact from noise.
        nodes: where fits begin.
        fitter: fits loads to readings.
        assessment: turns fits into estimates.
        trials: readings of one and of two contacts, to compile or load what they need.
        systematic: errors that all frames share, such as what the skin file's calibration
            leaves open; None where nothing is known of them.
    """

    rest: NDArray[np.float64]
    detector: AbstractDetector
    nodes: AbstractNodeSearch
    fitter: AbstractLoadFitter
    assessment: AbstractLoadAssessment
    trials: tuple[NDArray[np.float64], NDArray[np.float64]]
    systematic: "SystematicErrors | None" = None
