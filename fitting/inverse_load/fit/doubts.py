"""Doubts about frames: further contacts that one may hide, and taxels that stand out as faulty.

One contact is doubted where its fit is poor, by chi2, or where its residuals hold the pattern
of a further one, by a score test. In a stream a doubt counts once the frame before gave it.

A frame that nothing explains is fitted again without the taxels that stand out, each of which
counts against the fit: first by one contact, from the table's node that explains all but the
worst taxels best, then by as many contacts as its best explanation has. One contact that
explains the others ends the search where none of these holds a further contact's pattern.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from fitting.arrays import Flags, Floats, Rows
from fitting.inverse_load.fit.covariance import whitened
from fitting.inverse_load.fit.explanation import AbstractLoadFitter, Attempt, Explanations
from fitting.inverse_load.fit.loads_and_errors import SUSPECT
from fitting.inverse_load.search.base import AbstractNodeSearch
from fitting.steps import Steps

_ALIKE = 0.7  # cosine of two patterns of one contact
_LEAST_OWN = 0.02  # share of a pattern's square that nothing else is taken to do

HELD = 0.5
"""Share of what taxels that stand out add to chi2 that a contact must explain."""
OUTLIER = 4.5
"""Standard deviations of the residual of a taxel that is left out."""
_MOST_OUTLIERS = 0.2  # share of the taxels
_TRIMMED_FITS = 3


class _Doubt(NamedTuple):
    """Why one contact may not explain a frame of a stream."""

    place: int | None  # of the pattern of one more contact that its residuals hold
    poor: bool  # whether the fit is poor


class Doubts:
    """Tells which frames one contact may not explain."""

    def __init__(
        self,
        fitter: AbstractLoadFitter,
        nodes: AbstractNodeSearch,  # coarse search for one contact, which knows the patterns
        penalty: float,  # chi2 that a further contact must gain
        most_contacts: int,
    ) -> None:
        self._live, self._per_contact = fitter.live, fitter.per_contact
        self._nodes = nodes
        self._penalty, self._most_contacts = penalty, most_contacts
        self._last = _Doubt(None, False)

    def forget(self) -> None:
        """Live: let nothing of the frames so far count for the next."""
        self._last = _Doubt(None, False)

    def hinted(self, y: Any, best: Explanations) -> Flags:
        """Frames whose residuals hold the pattern of one more contact (a score test).

        With r the residuals of one contact, J its derivatives by all that was fitted and s the
        pattern of a further one, chi2 falls to first order by (s^T W r)^2 over what is left of
        s^T W s beside J. A width and a tangential force do much of what a light contact nearby
        does.
        """
        return self.of_one_more(y, best).max(1) > self._penalty

    def of_one_more(self, y: Any, best: Explanations) -> Floats:
        """By how much chi2 falls with one more contact, to first order [frame, place]."""
        if self._most_contacts < 2:
            return np.zeros((len(y), 1))
        residual = np.where(best.weight > 0, y - best.so, 0.0)
        along, size = self._nodes.score(residual, best.weight)
        own = slice(0, self._per_contact)
        fitted = whitened(best.jacobian[:, own], best.information[:, own, own])
        others = best.eliminated[:, best.eliminated.any((0, 2))]
        fitted = np.concatenate([fitted, others], 1)
        taken = self._nodes.within(fitted, best.weight)
        return np.maximum(along, 0.0) ** 2 / np.maximum(size - taken, _LEAST_OWN * size)

    def hidden(self, y: Any, weight: Any, best: Explanations) -> Flags:
        """Frames of which a taxel that was left out may hold one more contact.

        Each is looked at beside the taxels that were fitted: a contact moves its neighbours,
        too, and then takes off chi2 most of what the taxel adds. Weights are of all taxels.
        """
        frame, taxel = np.nonzero((weight > 0) & (best.weight == 0))
        own = best.rows(frame)
        every = np.arange(len(frame))
        own.weight[every, taxel] = weight[frame, taxel]
        added = weight[frame, taxel] * (y[frame, taxel] - own.so[every, taxel]) ** 2
        taken = self.of_one_more(y[frame], own).max(1, initial=0.0)
        return np.isin(np.arange(len(y)), frame[taken > HELD * added])

    def of(self, y: Any, best: Explanations) -> Flags:
        """Frames that one contact may not explain.

        Readings are [frame, taxel] [counts], the best explanations those by one contact.
        """
        if self._live:
            return self._lasting(y, best)
        return (best.p_value(self._per_contact) < SUSPECT) | self.hinted(y, best)

    def _lasting(self, y: Any, best: Explanations) -> Flags:
        """Live: doubts that the frame before gave, too, or that are too strong for noise.

        Noise gives a hint to every twentieth frame and a poor fit to every five-hundredth,
        whose search on a pad takes as long as many frames; another contact stays.
        """
        gain = self.of_one_more(y, best)[0]
        hinted = gain.max() > self._penalty
        p_value = float(best.p_value(self._per_contact)[0])
        now = _Doubt(int(gain.argmax()) if hinted else None, p_value < SUSPECT)
        before, self._last = self._last, now
        alike = False
        if before.place is not None and now.place is not None:
            one, other = self._nodes.signatures[[before.place, now.place]]
            alike = one @ other > _ALIKE * np.sqrt((one @ one) * (other @ other))
        poor = p_value < SUSPECT / 100 or (before.poor and now.poor)
        return np.array([alike or poor])


@dataclass(frozen=True)
class FaultyTaxels:
    """Explains frames without their faulty taxels."""

    nodes: AbstractNodeSearch  # states of one contact
    # fits frames, each contact beyond the first with its penalty
    fit: Callable[[Attempt], Steps[Explanations]]
    per_contact: int  # parameters of a contact
    most_contacts: int  # to tell apart

    def explained_without(
        self, y: Any, weight: Any, frames: Any, best: Explanations
    ) -> Steps[Explanations]:
        """Fit frames without the taxels that stand out, each counted against the fit.

        Readings are [frame, taxel] [counts], weights inverse variances, zero where a taxel is
        not used [frame, taxel]. The frames are those that are fitted; `best` explains all
        frames.
        Returns the explanations, with those of the frames where they are cheaper.
        """
        every, most = (y, weight), most_left_out(weight[frames])
        y, weight = y[frames], weight[frames]
        # One contact without many taxels may leave less than several with a spike.
        for count in range(2, self.most_contacts + 1):
            suspect = best.p_value(self.per_contact)[frames] < SUSPECT / 10
            rows = np.flatnonzero((best.contacts[frames] == count) & suspect)
            if not rows.size:
                continue
            width = self.per_contact * count
            for _ in range(2):
                so = best.so[frames[rows]]
                start = best.parameters[frames[rows]][:, :width]
                states = self.nodes.states(self.nodes.nearest_to(start, count))
                kept = inliers(y[rows], weight[rows], so)
                found = yield from self.fit(Attempt(y[rows], kept, start, states, count))
                best = self._if_cheaper(frames[rows], weight[rows], best, found, most[rows])
        suspect = best.p_value(self.per_contact)[frames] < SUSPECT / 10
        if not suspect.any():
            return best
        return (yield from self.by_one(*every, frames[suspect], best))

    def by_one(
        self, y: Any, weight: Any, frames: Any, best: Explanations
    ) -> Steps[Explanations]:
        """The same by one contact."""
        y, weight = y[frames], weight[frames]
        most = most_left_out(weight)
        yield "trimmed search"
        node, trimmed = _least_trimmed(self.nodes, y, weight, most)
        start, states = self.nodes.loads[node], self.nodes.states(node)
        for _ in range(_TRIMMED_FITS):
            found = yield from self.fit(Attempt(y, trimmed, start, states, 1))
            trimmed = inliers(y, weight, found.so)
            better = found.parameters[:, : start.shape[1]]
            start = np.where(np.isfinite(found.chi2)[:, None], better, start)
        return self._if_cheaper(frames, weight, best, found, most)

    def _if_cheaper(
        self, frames: Any, weight: Any, best: Explanations, found: Explanations, most: Any
    ) -> Explanations:
        """The fits of some frames where they are cheaper, taxels left out counted."""
        left_out = (weight > 0).sum(1) - found.used()
        rows = np.flatnonzero(left_out <= most)
        candidates = found.penalised(left_out * OUTLIER**2).rows(rows)
        return best.cheapest(frames[rows], candidates)[0]


def most_left_out(weight: Any) -> Floats:
    """How many taxels may be left out [frame]."""
    return np.maximum(1, np.floor(_MOST_OUTLIERS * (weight > 0).sum(1)))


def inliers(y: Any, weight: Any, so: Any) -> Floats:
    """Weights without the taxels that stand out from a model.

    `y` and `so` are what was read and what the model reads [frame, taxel] [counts]; all taxels
    stand out where `so` is not finite. Weights are inverse variances, zero where a taxel is not
    used [frame, taxel].
    """
    residual = np.abs(np.where(np.isfinite(so), y - so, np.inf))
    limit = np.where(weight > 0, OUTLIER / np.sqrt(np.where(weight > 0, weight, 1.0)), 0.0)
    return np.where(residual < limit, weight, 0.0)


def _least_trimmed(
    nodes: AbstractNodeSearch, y: Any, weight: Any, most: Any
) -> tuple[Rows, Floats]:
    """Nodes that explain all but the worst taxels best (least trimmed squares).

    Nodes are states of one contact. Readings are [frame, taxel] [counts], weights inverse
    variances, zero where a taxel is not used [frame, taxel]; at most `most` taxels may be left
    out [frame].
    Returns the node of every frame, and weights without its worst taxels [frame, taxel].
    """
    trimmed, node = weight.copy(), np.zeros(len(y), int)
    for k in range(len(y)):
        squares = weight[k] * (y[k] - nodes.readings) ** 2
        squares[:, weight[k] <= 0] = np.inf
        squares[~nodes.known] = np.inf
        keep = int((weight[k] > 0).sum() - most[k])
        node[k] = np.partition(squares, keep - 1)[:, :keep].sum(1).argmin()
        own = squares[node[k]]
        trimmed[k, own > np.partition(own, keep - 1)[keep - 1]] = 0.0
    return node, trimmed
