"""Posterior of a frame's loads on a skin: prior, likelihood, distances."""

import abc
from typing import TYPE_CHECKING

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.search.base import AbstractNodeSearch

if TYPE_CHECKING:
    from fitting.statistics.log_probability import LogProbability, NumpyBatch


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
