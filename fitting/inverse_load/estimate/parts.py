"""The parts of an estimator, whatever the dimension."""

import abc
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.estimate.assessment import LoadAssessment
from fitting.inverse_load.fit.detection import AbstractDetector
from fitting.inverse_load.fit.explanation import AbstractLoadFitter, Explanations
from fitting.inverse_load.fit.systematic import AbstractSystematicErrors
from fitting.inverse_load.search.base import AbstractNodeSearch

if TYPE_CHECKING:
    from fitting.statistics.log_probability import LogProbability, NumpyBatch
    from suas_jax.scene.skin import Skin


class AbstractLoadPosterior(abc.ABC):
    """The posterior of contacts on one skin."""

    def __init__(
        self,
        nodes: AbstractNodeSearch,  # which know distances
        places: int,  # coordinates of a place
        volume: float,  # of one contact's parameters under their prior
        same: float,  # distance below which two contacts are the same
        mirrors: Floats,  # signs of the coordinates of mirror places [image, coordinate]
    ) -> None:
        self.nodes, self.volume = nodes, volume
        self._places, self._same, self._mirrors = places, same, mirrors

    @abc.abstractmethod
    def log_probability(self, y: Floats, mode: Explanations) -> "LogProbability | NumpyBatch":
        """The posterior of as many contacts as a mode has, but for a constant.

        `y`: readings as the model has them [channel]. `mode`: a fit of them.
        """

    def places(self, parameters: Floats, contacts: int) -> Floats:
        """Places [contact, coordinate] from parameters, all of a name together."""
        return parameters[: self._places * contacts].reshape(self._places, contacts).T

    def same(self, a: Floats, b: Floats) -> bool:
        """Whether as many contacts are at the same places [contact, coordinate]."""
        return self._near(a, b, self._same)

    def mirrored(self, a: Floats, b: Floats) -> bool:
        """Whether contacts are at the mirror places of others, roughly."""
        return any(self._near(a * signs, b, self.nodes.separate) for signs in self._mirrors)

    def apart(self, places: Floats) -> bool:
        """Whether all contacts lie apart from one another."""
        between = self.nodes.distance(places[:, None], places[None])
        return bool((between[np.triu_indices(len(places), 1)] > self.nodes.separate / 2).all())

    def _near(self, a: Floats, b: Floats, limit: float) -> bool:
        close = self.nodes.distance(a[:, None], b[None]) < limit
        return bool(close.any(0).all() and close.any(1).all())


class Film(Protocol):
    """Readings of taxels under an even film."""

    def film(self, so: Floats) -> Floats:
        """Gaps [frame, taxel] [m], but for a constant, that give readings [counts].

        NaN where a reading is missing.
        """

    def readings(self, film: Floats) -> Floats:
        """Readings under such gaps [..., taxel] [counts]."""


@dataclass(frozen=True)
class EstimationParts:
    """The parts of an estimator, for one skin."""

    make_skin: "Callable[[], Skin]"  # its model, made when first needed
    film: Film  # what its taxels read under even films, by which taps are told
    table: Any  # of its solved states
    rest: Floats  # the model's readings at rest [taxel] [counts]
    rest_pressure: float  # of the oil [Pa]
    detector: AbstractDetector  # tells contact from noise
    nodes: AbstractNodeSearch  # where fits begin
    fitter: AbstractLoadFitter  # fits loads to readings
    assessment: LoadAssessment  # turns fits into estimates
    # readings of one and of two contacts, to compile or load what they need
    trials: tuple[Floats, Floats]
    posterior: AbstractLoadPosterior  # of a frame's loads
    # errors that all frames share: those of the skin file's numbers, and the model's own; None
    # where there are none
    systematic: AbstractSystematicErrors | None = None
    # fits one contact of unknown width; None where there is no such model
    wide_fitter: AbstractLoadFitter | None = None
