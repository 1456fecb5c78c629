"""Selection of a frame's loads: how many contacts, which of two modes, which taxels are faulty.

Every contact beyond the first adds a penalty to chi2, and so does every taxel that is left
out. The explanation of lowest score wins, as with an information criterion; others than one
contact are only tried where it leaves more than noise.

What errors of the skin's inputs explain is no further contact, and no faulty taxel
(`fitting.inverse_load.fit.loads_and_errors`).
"""

import time
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from fitting.arrays import Flags, Floats, Rows
from fitting.inverse_load.fit.doubts import Doubts, FaultyTaxels
from fitting.inverse_load.fit.explanation import (
    PLAUSIBLE,
    UNSETTLED,
    UNUSUAL,
    AbstractLoadFitter,
    Alternative,
    Attempt,
    Explanations,
)
from fitting.inverse_load.fit.loads_and_errors import SUSPECT, LoadsAndErrors
from fitting.inverse_load.fit.several_contacts import Pulls, SeveralContacts
from fitting.inverse_load.fit.systematic import AbstractSystematicErrors
from fitting.inverse_load.search.base import AbstractNodeSearch
from fitting.steps import Steps, finished
from suas_jax.equilibrium.state import State
from suas_jax.runtime.compiling import COMPILE_TIME

_TRIALS = 32  # frames in doubt that are reconsidered before many others


@dataclass
class Selection:
    """Finds the best explanation of frames that something touches."""

    fitter: AbstractLoadFitter  # least squares on the skin
    nodes: AbstractNodeSearch  # coarse search for one contact
    penalty: float  # chi2 that a further contact must gain
    most_contacts: int  # to tell apart
    # of the skin's inputs; None where they are known exactly
    errors: AbstractSystematicErrors | None = None
    # least squares for one contact of unknown width; None where contacts have no width to find
    wide_fitter: AbstractLoadFitter | None = None

    def __post_init__(self) -> None:
        self._loads = LoadsAndErrors(self.fitter, self.errors)
        self.last: Explanations | None = None
        """Live: what explained the last frame that was touched; the next one begins there."""
        self.known: Explanations | None = None
        """What is known of the frames so far, while their search goes on."""
        self.coarse = False
        """Live: whether the last frame's time was spent before its search ended."""
        self.searched = False
        """Whether more than one contact was tried for the frames."""
        self._past: Flags = np.zeros(0, bool)
        """Frames that one contact, inputs as written, explains poorly, and beyond the wall."""
        self.seconds: Floats = np.zeros(0)
        """Time spent on each frame of the last call beyond one contact [s]."""
        per_contact, most = self.fitter.per_contact, self.most_contacts
        self.doubts = Doubts(self.fitter, self.nodes, self.penalty, most)
        own = self._loads, self.nodes, self.penalty
        self.pulls = Pulls(*own, per_contact)
        self.several = SeveralContacts(self.fitter, *own, most)
        self._faulty = FaultyTaxels(self.nodes, self.several.fit, per_contact, most)

    def forget(self) -> None:
        """Live: let nothing of the frames so far count for the next."""
        self.last = None
        self.doubts.forget()
        if self.most_contacts > 1:
            self.of_one.forget()

    @cached_property
    def of_one(self) -> "Selection":
        """The same for one contact, with errors of the inputs, a width and faulty taxels."""
        beside = self.errors, self.wide_fitter
        return Selection(self.fitter, self.nodes, self.penalty, 1, *beside)

    def untouched(self) -> None:
        """Live: take a frame that nothing touches."""

    def explain(
        self, y: Floats, weight: Floats
    ) -> tuple[Explanations, list[Alternative | None]]:
        """The best explanation of every frame, and its second mode where there is one.

        Readings are [frame, taxel] [counts], weights inverse variances, zero where a taxel is
        not used [frame, taxel].
        """
        return finished(self.steps(y, weight))

    def pulled(self, y: Floats, weight: Floats) -> Explanations:
        """The best explanation of every frame by one force that pulls outwards."""
        return finished(self.pulls.fit(y, weight))

    def one_contact(self, y: Floats, weight: Floats) -> Explanations:
        """A single contact that explains every frame best, however much it leaves."""
        self.seconds = np.zeros(len(y))
        node, _ = self.nodes.nearest(y, weight)
        start = self.nodes.near(y, weight, node)
        return self.fitter.roughly(Attempt(y, weight, start, self.nodes.states(node), 1))

    def steps(
        self, y: Floats, weight: Floats
    ) -> Steps[tuple[Explanations, list[Alternative | None]]]:
        """`explain`, in steps."""
        self.seconds = np.zeros(len(y))
        self.known = None
        followed = yield from self._followed(y, weight)
        if followed is not None:
            self.last = followed
            return followed, (yield from self._or_pairs(y, weight, followed, [None]))
        first, second = self.nodes.nearest(y, weight)
        best = yield from self._single(y, weight, first)
        best, others = yield from self._second_modes(y, weight, second, best)
        best = yield from self.pulls.or_light(y, weight, best, others)
        doubtful = self.doubts.of(y, best)
        best = yield from self._without_spikes(y, weight, doubtful, best)
        self.known = best
        best = yield from self._errors_first(y, weight, doubtful, best)
        yield "pairs for one that is wide"
        rows, pairs = self.fitter.pairs_for_wide(y, best)
        doubtful[rows] |= pairs.chi2 < best.chi2[rows] - self.penalty
        # What errors of the inputs explain may be a width as well.
        frames = np.flatnonzero(doubtful | best.absorbed)
        first, rest = _trials(frames)
        best = yield from self._each_reconsidered(y, weight, first, doubtful, best)
        # A model that explains none of many frames, by whatever loads, is wrong: so it is for
        # the others, and their search would take seconds a frame.
        if rest.size and (self._p_value(best)[first] >= SUSPECT).any():
            best = yield from self._each_reconsidered(y, weight, rest, doubtful, best)
        best = self._or_at_wall(best)
        if self.fitter.live:
            self.last = best if np.isfinite(best.chi2[0]) else None
        self.searched = bool(frames.size)
        return best, (yield from self._or_pairs(y, weight, best, others))

    def _or_at_wall(self, best: Explanations) -> Explanations:
        """The same, without the gap where more than what is told may have closed it.

        A membrane that touches the wall beside the taxels reads as no load does that the model
        knows, without a wall: one contact ends beyond it, and errors of the inputs, a further
        contact or a taxel that is left out take up the rest. They are believed where the
        membrane stays clear of the wall.
        """
        closed = self._past & (best.min_gap < self.fitter.little_gap)
        return replace(
            best, min_gap=np.where(closed, np.minimum(best.min_gap, 0), best.min_gap)
        )

    def _each_reconsidered(
        self, y: Any, weight: Any, frames: Rows, doubtful: Flags, best: Explanations
    ) -> Steps[Explanations]:
        """Some frames reconsidered: all at once, or one after another where these take long."""
        if not frames.size:
            return best
        groups = np.split(frames, len(frames) if self.fitter.alone else 1)
        parts = []
        for group in groups:
            begin = time.perf_counter() - COMPILE_TIME.seconds
            own = (y[group], weight[group], best.rows(group), doubtful[group])
            parts.append((yield from self._reconsidered(*own)))
            spent = time.perf_counter() - COMPILE_TIME.seconds - begin
            self.seconds[group] = spent / len(group)
        found = Explanations.of_frames(parts)
        return best.with_frames(frames, found, np.arange(len(frames)))

    def _or_pairs(
        self, y: Any, weight: Any, best: Explanations, others: list[Alternative | None]
    ) -> Steps[list[Alternative | None]]:
        """Second modes, or two contacts for a wide or turned one where these are cheaper."""
        yield "pairs for one that is wide"
        rows, pairs = self.fitter.pairs_for_wide(y, best)
        for k, i in enumerate(rows.tolist()):
            others[i] = Alternative.cheaper(others[i], pairs, k)
        rows = np.flatnonzero((best.contacts == 1) & self.fitter.turned(best))
        if rows.size and self.most_contacts > 1:
            anything = replace(best, score=np.full(len(best), np.inf))
            pairs = yield from self.several.added(y, weight, rows, anything, 2)
            for i in rows[pairs.contacts[rows] == 2].tolist():
                others[i] = Alternative.cheaper(others[i], pairs, i)
        return others

    def _reconsidered(
        self, y: Any, weight: Any, best: Explanations, doubtful: Flags
    ) -> Steps[Explanations]:
        """The best explanation of frames that one contact may not explain, or errors may."""
        frames = np.arange(len(y))
        best, narrow = yield from self._or_wide(y, weight, frames, best)
        # A pull looks like several contacts around it, which take far longer to try.
        implausible = self._p_value(best) < PLAUSIBLE
        best = yield from self.pulls.or_pulled(y, weight, frames[implausible], best)
        pulled = best.parameters[:, self.fitter.parameters.rows("force", 1)][:, 0] < 0
        pulled &= (best.contacts == 1) & (self._p_value(best) >= PLAUSIBLE)
        narrow = narrow[(doubtful & ~pulled)[narrow]]
        last = self.last
        if last is not None and last.contacts[0] > 1 and not self._gone(y, weight, last):
            best, narrow = yield from self._as_before(y, weight, narrow, best)
        best = yield from self.several.added(y, weight, narrow, best)
        bad = frames[self._p_value(best) < SUSPECT / 10]
        if bad.size:
            best = yield from self._faulty.explained_without(y, weight, bad, best)
        return best

    def _without_spikes(
        self, y: Any, weight: Any, doubtful: Flags, best: Explanations
    ) -> Steps[Explanations]:
        """Frames in doubt that one contact explains but for single taxels; no doubt is left.

        Nothing else is tried for them: beside a spike it takes a second a frame.
        """
        rows = np.flatnonzero(doubtful & (self._p_value(best) < SUSPECT / 10))
        if not rows.size:
            return best
        found = (yield from self._faulty.by_one(y, weight, rows, best)).rows(rows)
        left_out = found.used() < (weight[rows] > 0).sum(1)
        plain = np.flatnonzero(left_out & (self._p_value(found) >= PLAUSIBLE))
        own = rows[plain]
        plain = plain[~self.doubts.hidden(y[own], weight[own], found.rows(plain))]
        doubtful[rows[plain]] = False
        return best.with_frames(rows[plain], found, plain)

    def _errors_first(
        self, y: Any, weight: Any, doubtful: Flags, best: Explanations
    ) -> Steps[Explanations]:
        """What further contacts have to beat: frames in doubt with errors of the inputs."""
        rows = np.flatnonzero(doubtful & ~best.absorbed & np.isfinite(best.chi2))
        if not rows.size:
            return best
        own = best.rows(rows)
        start = own.parameters[:, : self.fitter.per_contact]
        asked = Attempt(y[rows], weight[rows], start, own.state, 1)
        found = yield from self._loads.beside_errors(asked, own.shift)
        return best.cheapest(rows, found)[0]

    def _single(self, y: Any, weight: Any, node: Any) -> Steps[Explanations]:
        """One contact, from the nearest nodes or, live, from the last frame if nearer."""
        last = self.last
        if last is None or last.contacts[0] > 1 or not self._nearer(y, weight, node, last):
            return (yield from self._from_node(y, weight, node))
        start = self._predicted(y, weight, last)
        found = yield from self._one(y, weight, start, last.state)
        if self._p_value(found)[0] >= SUSPECT:
            return found
        other = yield from self._from_node(y, weight, node)
        return found.cheapest(np.zeros(1, np.intp), other)[0]

    def _nearer(self, y: Any, weight: Any, node: Any, last: Explanations) -> bool:
        """Live: whether an earlier frame is nearer than the nearest nodes."""
        before = (weight * (y - last.so) ** 2).sum()
        return bool(before < (weight * (y - self.nodes.readings[node]) ** 2).sum())

    def _from_node(self, y: Any, weight: Any, node: Any) -> Steps[Explanations]:
        """One contact, from nodes of the table."""
        start = self.nodes.near(y, weight, node)
        return (yield from self._one(y, weight, start, self.nodes.states(node)))

    def _one(self, y: Any, weight: Any, start: Any, state: State) -> Steps[Explanations]:
        """One contact, from somewhere; the first thing that is known of a frame."""
        found = yield from self.fitter.steps(Attempt(y, weight, start, state, 1))
        self._past = (found.min_gap <= 0) & (self._p_value(found) < SUSPECT)
        self.known = self.known or found
        return (yield from self._loads.or_errors(y, weight, found, self.fitter))

    def _predicted(self, y: Any, weight: Any, last: Explanations) -> Floats:
        """Live: parameters from an earlier frame's by its own derivatives."""
        count = int(last.contacts[0])
        width = self.fitter.per_contact * count
        jacobian = np.where(weight > 0, last.jacobian[0, :width], 0.0)
        weighted = jacobian * weight
        information = weighted @ jacobian.T + 1e-12 * np.diag((weighted * jacobian).sum(1))
        residual = np.where(weight > 0, y - last.so, 0.0)[0]
        step = np.linalg.lstsq(information, weighted @ residual)[0]
        return self.fitter.inside(last.parameters[:, :width] + step, count)

    def _p_value(self, best: Explanations) -> Floats:
        return best.p_value(self.fitter.per_contact)

    def _second_modes(
        self, y: Any, weight: Any, second: Any, best: Explanations
    ) -> Steps[tuple[Explanations, list[Alternative | None]]]:
        """The better of two modes of every frame, and the other where there is one."""
        others: list[Alternative | None] = [None] * len(y)
        frames = np.flatnonzero(second >= 0)
        if not frames.size:
            return best, others
        node = second[frames]
        start = self.nodes.near(y[frames], weight[frames], node)
        state = self.nodes.states(node)
        asked = Attempt(y[frames], weight[frames], start, state, 1)
        found = yield from self._loads.fit(asked)
        apart = self.nodes.apart(found.parameters, best.parameters[frames])
        rows = np.flatnonzero(apart & np.isfinite(found.chi2))
        better = found.chi2[rows] < best.chi2[frames[rows]]
        for k, wins in zip(rows, better, strict=True):
            i = int(frames[k])
            others[i] = Alternative.of(best, i) if wins else Alternative.of(found, int(k))
        rows = rows[better]
        return best.with_frames(frames[rows], found, rows), others

    # --- wide contacts ------------------------------------------------------------------

    def _or_wide(
        self, y: Any, weight: Any, frames: Rows, best: Explanations
    ) -> Steps[tuple[Explanations, Rows]]:
        """One wide contact where it is cheaper; and the frames that ask for more than that.

        A width is one more parameter, and costs Schwarz's criterion. A fit that has not settled
        explains nothing: its frame is left to the others.
        """
        if self.wide_fitter is None:
            return best, frames
        own = best.rows(frames)
        start = own.parameters[:, : self.fitter.per_contact]
        asked = Attempt(y[frames], weight[frames], start, own.state, 1)
        found = yield from self._loads.fit(asked, fitter=self.wide_fitter)
        cost = np.log(np.maximum((weight[frames] > 0).sum(1), 2))
        settled = found.predicted_decrease <= UNSETTLED
        found = found.penalised(np.where(settled, cost, np.inf))
        best, wide = best.cheapest(frames, found)
        explained = np.zeros(len(y), bool)
        explained[wide] = self._p_value(best)[wide] >= PLAUSIBLE
        explained[wide] &= ~(best.beside[wide, 0, 0, 0] >= UNUSUAL)
        own = best.rows(frames)
        more = self.doubts.of_one_more(y[frames], own).max(1)
        explained[frames] &= more <= self.penalty
        explained[frames] |= self.fitter.left_to_shape(y[frames], own, more)
        return best, frames[~explained[frames]]

    # --- more contacts ----------------------------------------------------------------

    def _followed(self, y: Any, weight: Any) -> Steps[Explanations | None]:
        """Live: as many contacts as before, two or more, where they explain the readings."""
        last = self.last
        if last is None or last.contacts[0] < 2 or self._gone(y, weight, last):
            return None
        count = int(last.contacts[0])
        start = self._predicted(y, weight, last)
        asked = Attempt(y, weight, start, last.state, count)
        found = yield from self.several.fit(asked, last.shift)
        new_errors = found.absorbed[0] and not last.absorbed[0]
        if self._p_value(found)[0] < PLAUSIBLE or new_errors:
            return None
        return found if np.isfinite(found.score[0]) else None

    def _gone(self, y: Any, weight: Any, last: Explanations) -> bool:
        """Live: whether an earlier frame's contacts leave more than any single one does.

        To first order: a touch elsewhere, whose fits from there end nowhere.
        """
        width = self.fitter.per_contact * int(last.contacts[0])
        step = self._predicted(y, weight, last) - last.parameters[:, :width]
        there = last.so + (step @ np.nan_to_num(last.jacobian[0, :width]))
        node, _ = self.nodes.nearest(y, weight)
        return not self._nearer(y, weight, node, replace(last, so=there))

    def _as_before(
        self, y: Any, weight: Any, frames: Any, best: Explanations
    ) -> Steps[tuple[Explanations, Rows]]:
        """Live: as many contacts as before, where they were; what is left to explain."""
        assert self.last is not None
        count = int(self.last.contacts[0])
        start = self._predicted(y, weight, self.last)
        asked = Attempt(y, weight, start, self.last.state, count)
        found = yield from self.several.fit(asked, best.shift)
        best, improved = best.cheapest(frames, found)
        if improved.size:
            frames = improved[self._p_value(best) < SUSPECT]
        return best, frames


def _trials(frames: Rows) -> tuple[Rows, Rows]:
    """Some frames spread evenly over many, and the others; all of them where they are few."""
    if len(frames) <= 2 * _TRIALS:
        return frames, frames[:0]
    some = np.linspace(0, len(frames) - 1, _TRIALS).round().astype(int)
    return frames[some], np.delete(frames, some)
