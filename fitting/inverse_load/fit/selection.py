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
from typing import Any, NamedTuple

import jax
import numpy as np

from fitting.arrays import Flags, Floats, Rows
from fitting.inverse_load.fit.covariance import covariance_of
from fitting.inverse_load.fit.doubts import Doubts, FaultyTaxels
from fitting.inverse_load.fit.explanation import UNSETTLED, AbstractLoadFitter, Explanations
from fitting.inverse_load.fit.loads_and_errors import SUSPECT, LoadsAndErrors
from fitting.inverse_load.fit.systematic import AbstractSystematicErrors
from fitting.inverse_load.fit.wide_contact import UNUSUAL
from fitting.inverse_load.search.base import AbstractNodeSearch, PairSearch, Start
from fitting.steps import Steps, finished
from suas_jax.equilibrium.equilibrium import State
from suas_jax.runtime.compiled import COMPILED

FELT = 2.0
"""Standard deviations of a force that is there beside others."""
PLAUSIBLE = 0.05
"""p-value of chi2 above which no further contact is sought."""
_TRIALS = 32  # frames in doubt that are reconsidered before many others


class Alternative(NamedTuple):
    """A second explanation of a frame that one contact explains."""

    chi2: float  # of the fit
    parameters: Floats  # of the contacts
    information: Floats  # J^T W J
    contacts: int  # their number: another place of one, or two for a wide one


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
        self._pairs: PairSearch | None = None
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
        self._doubts = Doubts(self.fitter, self.nodes, self.penalty, most)
        self._faulty = FaultyTaxels(self.nodes, self._fit_several, per_contact, most)

    def forget(self) -> None:
        """Live: let nothing of the frames so far count for the next."""
        self.last = None
        self._doubts.forget()
        if self.most_contacts > 1:
            self.of_one.forget()

    @cached_property
    def of_one(self) -> "Selection":
        """The same for one contact, with errors of the inputs, a width and faulty taxels."""
        beside = self.errors, self.wide_fitter
        return Selection(self.fitter, self.nodes, self.penalty, 1, *beside)

    def untouched(self) -> None:
        """Live: take a frame that nothing touches."""

    @property
    def pairs(self) -> PairSearch:
        """The search for several contacts, made when first needed."""
        if self._pairs is None:
            self._pairs = self.nodes.several()
        return self._pairs

    def explain(
        self, y: Floats, weight: Floats
    ) -> tuple[Explanations, list[Alternative | None]]:
        """The best explanation of every frame, and its second mode where there is one.

        Readings are [frame, taxel] [counts], weights inverse variances, zero where a taxel is
        not used [frame, taxel].
        """
        return finished(self.steps(y, weight))

    def steps(
        self, y: Floats, weight: Floats
    ) -> Steps[tuple[Explanations, list[Alternative | None]]]:
        """`explain`, in steps."""
        self.seconds = np.zeros(len(y))
        self.known = None
        followed = yield from self._followed(y, weight)
        if followed is not None:
            self.last = followed
            return followed, (yield from self._or_pairs(y, followed, [None]))
        first, second = self.nodes.nearest(y, weight)
        best = yield from self._single(y, weight, first)
        best, others = yield from self._second_modes(y, weight, second, best)
        best = yield from self._or_light_pulls(y, weight, best, others)
        doubtful = self._doubts.of(y, best)
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
        return best, (yield from self._or_pairs(y, best, others))

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
            begin = time.perf_counter() - COMPILED.seconds
            own = (y[group], weight[group], best.rows(group), doubtful[group])
            parts.append((yield from self._reconsidered(*own)))
            spent = time.perf_counter() - COMPILED.seconds - begin
            self.seconds[group] = spent / len(group)
        found = Explanations.of_frames(parts)
        return best.with_frames(frames, found, np.arange(len(frames)))

    def _or_pairs(
        self, y: Any, best: Explanations, others: list[Alternative | None]
    ) -> Steps[list[Alternative | None]]:
        """Second modes, or two contacts for one that is wide where these are cheaper."""
        yield "pairs for one that is wide"
        rows, pairs = self.fitter.pairs_for_wide(y, best)
        for k, i in enumerate(rows.tolist()):
            other = others[i]
            if other is None or pairs.chi2[k] < other.chi2:
                others[i] = _mode(pairs, k)
        return others

    def _reconsidered(
        self, y: Any, weight: Any, best: Explanations, doubtful: Flags
    ) -> Steps[Explanations]:
        """The best explanation of frames that one contact may not explain, or errors may."""
        frames = np.arange(len(y))
        best, narrow = yield from self._or_wide(y, weight, frames, best)
        # A pull looks like several contacts around it, which take far longer to try.
        suspect = self._p_value(best) < SUSPECT
        best = yield from self._or_pulled(y, weight, frames[suspect], best)
        pulled = best.parameters[:, self.fitter.parameters.rows("force", 1)][:, 0] < 0
        pulled &= (best.contacts == 1) & (self._p_value(best) >= PLAUSIBLE)
        best = yield from self._more_contacts(
            y, weight, narrow[(doubtful & ~pulled)[narrow]], best
        )
        bad = frames[self._p_value(best) < SUSPECT / 10]
        if bad.size:
            best = yield from self._faulty.explained_without(y, weight, bad, best)
        return best

    def _errors_first(
        self, y: Any, weight: Any, doubtful: Flags, best: Explanations
    ) -> Steps[Explanations]:
        """What further contacts have to beat: frames in doubt with errors of the inputs."""
        rows = np.flatnonzero(doubtful & ~best.absorbed & np.isfinite(best.chi2))
        if not rows.size:
            return best
        own = best.rows(rows)
        start = own.parameters[:, : self.fitter.per_contact]
        how = start, own.state, 1, own.shift
        found = yield from self._loads.beside_errors(y[rows], weight[rows], *how)
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
        found = yield from self.fitter.steps(y, weight, start, state, 1)
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
        found = yield from self._loads.fit(y[frames], weight[frames], start, state, 1)
        apart = self.nodes.apart(found.parameters, best.parameters[frames])
        rows = np.flatnonzero(apart & np.isfinite(found.chi2))
        better = found.chi2[rows] < best.chi2[frames[rows]]
        for k, wins in zip(rows, better, strict=True):
            i = int(frames[k])
            others[i] = _mode(best, i) if wins else _mode(found, int(k))
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
        found = yield from self._loads.fit(
            y[frames], weight[frames], start, own.state, 1, fitter=self.wide_fitter
        )
        cost = np.log(np.maximum((weight[frames] > 0).sum(1), 2))
        settled = found.predicted_decrease <= UNSETTLED
        found = found.penalised(np.where(settled, cost, np.inf))
        best, wide = best.cheapest(frames, found)
        explained = np.zeros(len(y), bool)
        explained[wide] = self._p_value(best)[wide] >= PLAUSIBLE
        explained[wide] &= best.beside[wide, 0, 0, 0] < UNUSUAL
        own = best.rows(frames)
        more = self._doubts.of_one_more(y[frames], own).max(1)
        explained[frames] &= more <= self.penalty
        explained[frames] |= self.fitter.left_to_shape(y[frames], own, more)
        return best, frames[~explained[frames]]

    # --- more contacts ----------------------------------------------------------------

    def _more_contacts(
        self, y: Any, weight: Any, frames: Any, best: Explanations
    ) -> Steps[Explanations]:
        last = self.last
        if last is not None and last.contacts[0] > 1 and not self._gone(y, weight, last):
            best, frames = yield from self._as_before(y, weight, frames, best)
        for count in range(2, self.most_contacts + 1):
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
            suspect = self._p_value(best)[at] < SUSPECT
            to_beat = best.score[at] - (count - 1) * self.penalty
            to_beat = np.where(suspect, np.inf, to_beat)
            given = at, left[at], weight[at], parameters, count, to_beat
            kept = yield from self.fitter.screened(*given)
            if not kept.size:
                break
            at, parameters = at[kept], parameters[kept]
            state = jax.tree.map(lambda x, rows=kept: x[..., rows], state)
            begin = parameters, state, count, best.shift[at]
            found = yield from self._fit_several(y[at], weight[at], *begin, frame=at)
            best, improved = best.cheapest(at, found)
            best = yield from self._without_weakest(y, weight, at, found, best)
            frames = improved[self._p_value(best)[improved] < PLAUSIBLE]
        return best

    def _fit_several(
        self,
        y: Any,
        weight: Any,
        start: Any,
        state: State,
        count: int,
        shift: Floats | None = None,
        frame: Rows | None = None,
    ) -> Steps[Explanations]:
        """Fits by some contacts, each beyond the first with its penalty, all of them told.

        A contact whose force readings do not determine, all others free, fits what a wrong
        model leaves, whatever that is. Where errors of the inputs move the readings, by a shift
        [frame, taxel], they are fitted, too, unless loads alone do. `frame` says which frame a
        row is of, where a frame has several.
        """
        found = yield from self._loads.fit(y, weight, start, state, count, frame=frame)
        if shift is not None:
            unsure = ~self._told(found) | (self._p_value(found) < PLAUSIBLE)
            rows = np.flatnonzero(shift.any(1) & unsure)
            if rows.size:
                near = jax.tree.map(lambda x: x[..., rows], state)
                given = y[rows], weight[rows], start[rows], near, count, shift[rows]
                own = None if frame is None else frame[rows]
                other = yield from self._loads.beside_errors(*given, own)
                found, _ = found.cheapest(rows, other)
        cost = (count - 1) * self.penalty
        return found.penalised(np.where(self._told(found), cost, np.inf))

    def _told(self, found: Explanations) -> Flags:
        """Whether all forces are, where there are several [frame]."""
        one = int(found.contacts[0]) == 1
        return np.asarray(one | (self._significance(found).min(1) >= FELT**2))

    def _significance(self, found: Explanations) -> Floats:
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

    def _followed(self, y: Any, weight: Any) -> Steps[Explanations | None]:
        """Live: as many contacts as before, two or more, where they explain the readings."""
        last = self.last
        if last is None or last.contacts[0] < 2 or self._gone(y, weight, last):
            return None
        count = int(last.contacts[0])
        start = self._predicted(y, weight, last)
        found = yield from self._fit_several(y, weight, start, last.state, count, last.shift)
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
        given = y, weight, start, self.last.state, count, best.shift
        found = yield from self._fit_several(*given)
        best, improved = best.cheapest(frames, found)
        if improved.size:
            frames = improved[self._p_value(best) < SUSPECT]
        return best, frames

    def _without_weakest(
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
        kept[np.arange(len(rows)), self._significance(found).argmin(1)] = False
        columns = found.parameters[:, : count * self.fitter.per_contact]
        start = columns.reshape(len(rows), -1, count).transpose(0, 2, 1)[kept]
        start = start.reshape(len(rows), count - 1, -1).transpose(0, 2, 1)
        start = start.reshape(len(rows), -1)
        begin = start, found.state, count - 1, found.shift
        fewer = yield from self._fit_several(y[at], weight[at], *begin)
        return best.cheapest(at, fewer)[0]

    # --- pulls ------------------------------------------------------------------------

    def pulled(self, y: Floats, weight: Floats) -> Explanations:
        """The best explanation of every frame by one force that pulls outwards."""
        return finished(self._pull(y, weight))

    def _pull(self, y: Floats, weight: Floats) -> Steps[Explanations]:
        change = np.where(weight > 0, y - self.nodes.rest, 0.0)
        along, size = self.nodes.score(-change, weight)
        place = np.where(along > 0, along**2 / size, -np.inf).argmax(1)
        frame = np.arange(len(y))
        force = -np.maximum(along[frame, place] / size[frame, place], 0.0)
        start = np.concatenate([self.nodes.places[place], force[:, None]], 1)
        rest = self.nodes.rest_states(len(y))
        return (yield from self._loads.fit(y, weight, start, rest, 1, pull=True))

    def _or_light_pulls(
        self, y: Any, weight: Any, best: Explanations, others: list[Alternative | None]
    ) -> Steps[Explanations]:
        """A pull in the place of a push, whatever that leaves; or a frame's second mode.

        A light one reads much as a push does whose bulge lies where it pulls. To first order it
        must leave no more than the push does, but for the penalty.
        """
        change = np.where(weight > 0, y - self.nodes.rest, 0.0)
        along, size = self.nodes.score(-change, weight)
        left = (weight * change**2).sum(1) - (np.maximum(along, 0.0) ** 2 / size).max(1)
        frames = np.flatnonzero(left < best.chi2 + self.penalty)
        if not frames.size:
            return best
        found = yield from self._pull(y[frames], weight[frames])
        cost = np.where(self._p_value(found) >= SUSPECT, self.penalty, np.inf)
        best, pulled = best.cheapest(frames, found.penalised(cost))
        for k, i in enumerate(frames.tolist()):
            other = others[i]
            if i in pulled:
                others[i] = None
            elif other is None or found.chi2[k] < other.chi2:
                others[i] = _mode(found, k)
        return best

    def _or_pulled(
        self, y: Any, weight: Any, frames: Any, best: Explanations
    ) -> Steps[Explanations]:
        """A pull in the place of contacts that push; its penalty is that of two.

        One that, to first order, leaves more than half of what is beyond noise is not tried.
        """
        used = weight[frames] > 0
        change = np.where(used, y[frames] - self.nodes.rest, 0.0)
        along, size = self.nodes.score(-change, weight[frames])
        gain = (np.maximum(along, 0.0) ** 2 / size).max(1)
        frames = frames[2 * gain > (weight[frames] * change**2).sum(1) - used.sum(1)]
        if frames.size:
            found = yield from self._pull(y[frames], weight[frames])
            best, _ = best.cheapest(frames, found.penalised(self.penalty))
        return best


def _trials(frames: Rows) -> tuple[Rows, Rows]:
    """Some frames spread evenly over many, and the others; all of them where they are few."""
    if len(frames) <= 2 * _TRIALS:
        return frames, frames[:0]
    some = np.linspace(0, len(frames) - 1, _TRIALS).round().astype(int)
    return frames[some], np.delete(frames, some)


def _mode(explanations: Explanations, i: int) -> Alternative:
    return Alternative(
        float(explanations.chi2[i]),
        explanations.parameters[i].copy(),
        explanations.information[i].copy(),
        int(explanations.contacts[i]),
    )
