"""Forces that pull the skin outwards, in the place of contacts that push.

A light pull reads much as a push does whose bulge lies where it pulls.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.fit.explanation import Alternative, Attempt, Explanations
from fitting.inverse_load.fit.loads_and_errors import SUSPECT, LoadsAndErrors
from fitting.inverse_load.search.base import AbstractNodeSearch
from fitting.steps import Steps


@dataclass(frozen=True)
class Pulls:
    """Explains frames by one force that pulls outwards.

    Readings are [frame, taxel] [counts], weights inverse variances, zero where a taxel is not
    used [frame, taxel].
    """

    loads: LoadsAndErrors  # fits loads, beside errors of the inputs where these are needed
    nodes: AbstractNodeSearch  # states of one contact
    penalty: float  # chi2 that a further contact must gain
    per_contact: int  # parameters of a contact

    def fit(self, y: Floats, weight: Floats) -> Steps[Explanations]:
        """The best explanation of every frame by one force that pulls outwards."""
        along, size, _ = self._score(y, weight)
        place = np.where(along > 0, along**2 / size, -np.inf).argmax(1)
        frame = np.arange(len(y))
        force = -np.maximum(along[frame, place] / size[frame, place], 0.0)
        start = np.concatenate([self.nodes.places[place], force[:, None]], 1)
        rest = self.nodes.rest_states(len(y))
        return (yield from self.loads.fit(Attempt(y, weight, start, rest, 1, pull=True)))

    def or_light(
        self, y: Any, weight: Any, best: Explanations, others: list[Alternative | None]
    ) -> Steps[Explanations]:
        """A pull in the place of a push, whatever that leaves; or a frame's second mode.

        A light one reads much as a push does whose bulge lies where it pulls. To first order it
        must leave no more than the push does, but for the penalty.
        """
        along, size, whole = self._score(y, weight)
        left = whole - (np.maximum(along, 0.0) ** 2 / size).max(1)
        frames = np.flatnonzero(left < best.chi2 + self.penalty)
        if not frames.size:
            return best
        found = yield from self.fit(y[frames], weight[frames])
        cost = np.where(found.p_value(self.per_contact) >= SUSPECT, self.penalty, np.inf)
        best, pulled = best.cheapest(frames, found.penalised(cost))
        for k, i in enumerate(frames.tolist()):
            others[i] = None if i in pulled else Alternative.cheaper(others[i], found, k)
        return best

    def or_pulled(
        self, y: Any, weight: Any, frames: Any, best: Explanations
    ) -> Steps[Explanations]:
        """A pull in the place of contacts that push; its penalty is that of two.

        One that, to first order, leaves more than half of what is beyond noise is not tried.
        """
        along, size, whole = self._score(y[frames], weight[frames])
        gain = (np.maximum(along, 0.0) ** 2 / size).max(1)
        frames = frames[2 * gain > whole - (weight[frames] > 0).sum(1)]
        if frames.size:
            found = yield from self.fit(y[frames], weight[frames])
            best, _ = best.cheapest(frames, found.penalised(self.penalty))
        return best

    def _score(self, y: Floats, weight: Floats) -> tuple[Floats, Floats, Floats]:
        """Scores of light pulls [frame, place], as of `nodes.score`, and chi2 at rest."""
        change = np.where(weight > 0, y - self.nodes.rest, 0.0)
        return *self.nodes.score(-change, weight), (weight * change**2).sum(1)
