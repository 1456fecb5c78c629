"""Frames that several contacts, or a pull, explain better than one contact.

Contacts are added one by one, from pairs of a table and from the score of one more beside those
that are known; each beyond the first counts against the fit. A contact whose force readings do
not determine, all others free, fits what a wrong model leaves, whatever that is.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from fitting.arrays import Flags, Floats, Rows
from fitting.inverse_load.fit.covariance import covariance_of
from fitting.inverse_load.fit.explanation import (
    PLAUSIBLE,
    AbstractLoadFitter,
    Alternative,
    Attempt,
    Explanations,
)
from fitting.inverse_load.fit.loads_and_errors import SUSPECT, LoadsAndErrors
from fitting.inverse_load.search.base import AbstractNodeSearch, PairSearch, Start
from fitting.steps import Steps
from suas_jax.equilibrium.state import State

FELT = 2.0
"""Standard deviations of a force that is there beside others."""

_CHOICES = 2  # of the starts of a frame, where not all are worth a fit


@dataclass(frozen=True)
class SeveralContacts:
    """Explains frames by up to so many contacts.

    Readings are [frame, taxel] [counts], weights inverse variances, zero where a taxel is not
    used [frame, taxel].
    """

    fitter: AbstractLoadFitter  # least squares on the skin
    loads: LoadsAndErrors  # the same beside errors of the inputs, where these are needed
    nodes: AbstractNodeSearch  # states of one contact
    penalty: float  # chi2 that a further contact must gain
    most: int  # contacts to tell apart

    @cached_property
    def pairs(self) -> PairSearch:
        """The search for several contacts, made when first needed."""
        return self.nodes.several()

    def added(
        self, y: Any, weight: Any, frames: Rows, best: Explanations, most: int | None = None
    ) -> Steps[Explanations]:
        """Frames by two contacts, and by more where these leave more than noise."""
        for count in range(2, (most or self.most) + 1):
            enough = (weight[frames] > 0).sum(1) > count * self.fitter.per_contact
            frames = frames[enough]
            starts = []
            for i in frames:
                starts.append((yield from self._starts(y[i], weight[i], best, i, count)))
            at = np.repeat(frames, [len(s) for s in starts])
            left = y - best.shift  # by errors, if there are any
            if not at.size:
                break
            parameters = np.array([row[0] for s in starts for row in s])
            state = self.nodes.states(np.array([row[1] for s in starts for row in s]))
            suspect = best.p_value(self.fitter.per_contact)[at] < SUSPECT
            to_beat = best.score[at] - (count - 1) * self.penalty
            to_beat = np.where(suspect, np.inf, to_beat)
            rows, improved = np.arange(len(at)), np.zeros(0, np.intp)
            for _ in range(_CHOICES):
                own = at[rows]
                given = own, left[own], weight[own], parameters[rows], count, to_beat[rows]
                kept = rows[(yield from self.fitter.screened(*given))]
                if not kept.size:
                    break
                own, begin = at[kept], State(*(x[..., kept] for x in state))
                asked = Attempt(y[own], weight[own], parameters[kept], begin, count)
                found = yield from self.fit(asked, best.shift[own], own)
                best, more = best.cheapest(own, found)
                improved = np.union1d(improved, more)
                best = yield from self.without_weakest(y, weight, own, found, best)
                # What looked best may end where a contact is not told: then another start.
                told = np.isin(at[rows], own[np.isfinite(found.score)])
                rows = np.setdiff1d(rows[~told], kept)
                if not rows.size:
                    break
            frames = improved[best.p_value(self.fitter.per_contact)[improved] < PLAUSIBLE]
        return best

    def fit(
        self, asked: Attempt, shift: Floats | None = None, frame: Rows | None = None
    ) -> Steps[Explanations]:
        """Fits by some contacts, each beyond the first with its penalty, all of them told.

        A contact whose force readings do not determine, all others free, fits what a wrong
        model leaves, whatever that is. Where errors of the inputs move the readings, by a shift
        [frame, taxel], they are fitted, too, unless loads alone do. `frame` says which frame a
        row is of, where a frame has several.
        """
        found = yield from self.loads.fit(asked, frame=frame)
        if shift is not None:
            unsure = ~self._told(found) | (found.p_value(self.fitter.per_contact) < PLAUSIBLE)
            rows = np.flatnonzero(shift.any(1) & unsure)
            if rows.size:
                own = None if frame is None else frame[rows]
                given = asked.rows(rows), shift[rows], own
                other = yield from self.loads.beside_errors(*given)
                found, _ = found.cheapest(rows, other)
        cost = (asked.contacts - 1) * self.penalty
        return found.penalised(np.where(self._told(found), cost, np.inf))

    def _told(self, found: Explanations) -> Flags:
        """Whether all forces are, where there are several [frame]."""
        one = int(found.contacts[0]) == 1
        return np.asarray(one | (self.significance(found).min(1) >= FELT**2))

    def significance(self, found: Explanations) -> Floats:
        """Squares of forces over their variances, of one number of contacts [frame, contact].

        To first order they are what chi2 rises by without the contact, all others fitted anew.
        """
        count = int(found.contacts[0])
        rows = self.fitter.parameters.rows("force", count)
        covariance = covariance_of(found, self.fitter.per_contact)
        variance = np.diagonal(covariance, axis1=1, axis2=2)[:, rows]
        return np.asarray(found.parameters[:, rows] ** 2 / variance)

    def _starts(
        self, y: Any, weight: Any, best: Explanations, i: int, count: int
    ) -> Steps[list[Start]]:
        """Where fits of a frame by so many contacts begin; a third is added to two."""
        y, so = y - best.shift[i], best.so[i] - best.shift[i]
        starts: list[Start] = []
        if count == 2:
            starts = yield from self.pairs.of_two(y, weight)
        if int(best.contacts[i]) != count - 1 or (count == 2 and not best.absorbed[i]):
            return starts
        return starts + self.pairs.of_one_more(y, weight, best.parameters[i], so, count - 1)

    def without_weakest(
        self, y: Any, weight: Any, at: Rows, found: Explanations, best: Explanations
    ) -> Steps[Explanations]:
        """Frames again, from fits by one contact that is not told beside others."""
        count = int(found.contacts[0])
        least = found.chi2 + (count - 1) * self.penalty
        rows = np.flatnonzero(np.isinf(found.score) & (least < best.score[at]))
        if not rows.size:
            return best
        found, at = found.rows(rows), at[rows]
        kept = np.ones((len(rows), count), bool)
        kept[np.arange(len(rows)), self.significance(found).argmin(1)] = False
        columns = found.parameters[:, : count * self.fitter.per_contact]
        start = columns.reshape(len(rows), -1, count).transpose(0, 2, 1)[kept]
        start = start.reshape(len(rows), count - 1, -1).transpose(0, 2, 1)
        start = start.reshape(len(rows), -1)
        asked = Attempt(y[at], weight[at], start, found.state, count - 1)
        fewer = yield from self.fit(asked, found.shift)
        return best.cheapest(at, fewer)[0]


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
