"""The fitter of contacts on a pad: least squares on the interpolant, and what that leaves out.

A fit begins with the table's discs under radial forces, and goes on with extents and directions
free. Several contacts are solved where the fit ends, the interpolant is corrected by what it
left out, and the fit goes on until it moves no more: its end is exact but for the interpolant's
slopes.
"""

from collections.abc import Callable
from concurrent.futures import Executor
from typing import TYPE_CHECKING, Any

import numpy as np

from fitting.arrays import Flags, Floats, Rows
from fitting.inverse_load.fit.explanation import (
    UNUSUAL,
    AbstractLoadFitter,
    Attempt,
    Explanations,
    widened,
)
from fitting.inverse_load.pad.facts import PadShape
from fitting.inverse_load.pad.interpolant import (
    ASKEW,
    MOST,
    PLAIN,
    WHOLE,
    Correction,
    PadInterpolant,
    extents,
)
from fitting.inverse_load.pad.marginal import BESIDE, Told, beside
from fitting.inverse_load.pad.pad_least_squares import (
    PRIOR,
    STEPS,
    PadFit,
    PadLeastSquares,
    step_of,
)
from fitting.inverse_load.pad.solved import SolvedContacts, near
from fitting.steps import Steps, finished
from suas_jax.equilibrium.state import State

if TYPE_CHECKING:
    from suas_jax.scene.skin import Skin

_FEW = 1  # steps of a fit that is to be quick
_ROUNDS = 4  # of solving several contacts and fitting again
# Share of the change of readings that discs in the place of a wide contact leave out, by the
# logarithm of its relief: of solved discs of 40 to 80 mm a half of it, of two fingers more.
_SHAPE = 0.06
_SLENDER = 0.6  # where fits of slender contacts begin
_PAIR = 4.0  # diameters of discs beyond which a contact may be two of them
_MOVED = 0.1  # standard deviations below which a round is the last
_SOLVED = 9.0  # chi2 per reading up to which solving a wide contact may explain a frame


class PadFitter(AbstractLoadFitter):
    """Least squares on one pad."""

    alone = True
    limit_error = 0.03  # of the table, which knows it at a few places
    beside = BESIDE

    def __init__(
        self,
        skin: "Callable[[], Skin]",  # its model, where more than the table is needed
        shape: PadShape,  # its dimensions
        interpolant: PadInterpolant,  # of its table
        told: Told,  # what is told of contacts
        *,
        live: bool,  # whether frames come one by one
        most_contacts: int,  # widest set of parameters
        # that solves several contacts while other frames are fitted; None: this thread
        aside: Executor | None = None,
    ) -> None:
        self._aside = aside
        self.interpolant, self.told, self.live = interpolant, told, live
        self.table = interpolant.table
        self.parameters = told.parameters
        self._most = most_contacts
        # largest angle [rad] and axial position [m] of a contact
        self.edge = np.array(shape.edge(self.table.diameter))
        # least squares on the interpolant alone
        self.squares = PadLeastSquares(interpolant, self.edge, direction=told.direction)
        self._radius, self._gap = shape.radius, shape.gap
        self._solved = SolvedContacts(skin, interpolant, most_contacts, shape.radius)
        self._kept: dict[int, Correction] = {}

    def steps(self, asked: Attempt) -> Steps[Explanations]:
        """See the base class; a state is what a fit nearby found, see `_found_before`."""
        y, weight, start, state, contacts, pull = asked
        start = self._found_before(start[:, : PLAIN * contacts], state, contacts)
        if contacts == 1:
            fit = yield from self.fitting(y, weight, start, 1, None, pull)
            return (yield from self._or_solved(y, weight, fit))
        fits, gaps = [], []
        for i in range(len(y)):
            row = slice(i, i + 1)
            fit, gap = yield from self._refined(y[row], weight[row], start[row], contacts)
            fits.append(fit)
            gaps.append(gap)
        joined = PadFit(*(np.concatenate(x) for x in zip(*fits, strict=True)))
        return self._gathered(joined, weight, contacts, np.array(gaps))

    def roughly(self, asked: Attempt) -> Explanations:
        """See the base class: several by the last correction, wherever it was solved."""
        y, weight, start, state, contacts, _ = asked
        kept = self._kept.get(contacts)
        start = self._found_before(start[:, : PLAIN * contacts], state, contacts)
        if contacts == 1 and not (self.live and self._near(kept, start[0], 1, live=True)):
            kept = None
        most = _FEW if self.live else STEPS
        fit = finished(self.fitting(y, weight, start, contacts, kept, most=most))
        gaps = None
        if kept is not None or contacts > 1:
            gaps = np.full(len(y), kept.min_gap if kept else self._gap)
        return self._gathered(fit, weight, contacts, gaps)

    def _found_before(self, start: Floats, state: State, contacts: int) -> Floats:
        """Where fits begin: with the extents and tangents of a fit nearby, if there was one.

        The start has places and forces [frame, parameter]. The state's unknowns are the
        parameters that a fit found [1, parameter, frame], or none; those of another number of
        contacts count for nothing.
        """
        whole = np.asarray(state.q)
        known = np.isfinite(whole).all(0).sum(0) if whole.size else np.zeros(1)
        if not (known == WHOLE * contacts).all():
            return start
        size = start.shape[1]
        return np.concatenate([start, whole[0, size : WHOLE * contacts].T], 1)

    def fitting(
        self,
        y: Any,  # readings [frame, channel]
        weight: Any,  # inverse variances [frame, channel]
        start: Any,  # PLAIN or WHOLE parameters a contact [frame, parameter]
        contacts: int,
        correction: Correction | None = None,  # of the interpolant
        pull: bool = False,  # whether forces pull outwards
        *,
        most: int = STEPS,  # steps of a frame
    ) -> Steps[PadFit]:
        """Fit all parameters, discs under radial forces first; see `PadLeastSquares.steps`."""
        given = contacts, correction, pull
        if start.shape[1] == PLAIN * contacts:
            plain = yield from self.squares.steps(y, weight, start, *given, most=most)
            start = self.squares.completed(plain.parameters, contacts)
        return (yield from self.squares.steps(y, weight, start, *given, most=most))

    def inside(self, parameters: Floats, contacts: int) -> Floats:
        """See the base class; what follows the forces is sought anew by every fit."""
        plain = parameters[:, : PLAIN * contacts]
        low, high = self.squares.bounds(plain, contacts, False)
        inside = parameters.copy()
        inside[:, : PLAIN * contacts] = np.clip(plain, low, high)
        return inside

    def screened(
        self,
        frames: Rows,
        y: Floats,
        weight: Floats,
        start: Floats,
        contacts: int,
        to_beat: Floats,
    ) -> Steps[Rows]:
        """The start of every frame from which the interpolant alone explains it best.

        None where even that is no better than what is known: the interpolant is exact for a
        contact beside one that hardly presses.
        """
        start = start[:, : PLAIN * contacts]
        fit = yield from self.squares.steps(y, weight, start, contacts, None, False)
        best = [
            rows[np.argmin(fit.chi2[rows])]
            for rows in (np.flatnonzero(frames == i) for i in np.unique(frames))
        ]
        chosen = np.array(best, np.intp)
        return chosen[fit.chi2[chosen] < to_beat[chosen]]

    def correction(self, parameters: Floats, contacts: int) -> Correction | None:
        """What the interpolant leaves out at some contacts; None for nothing, or unknown.

        The contacts' parameters have places and forces first [parameter].
        """
        if contacts == 1:
            return None
        return self._solved.correction(parameters[: PLAIN * contacts], contacts)

    # --- wide and several contacts ----------------------------------------------------

    def _or_solved(self, y: Any, weight: Any, fit: PadFit) -> Steps[Explanations]:
        """Single contacts, the wide ones among them solved where that explains as much."""
        x = fit.parameters.T
        longest = extents(x[3], x[4], x[7] if len(x) == ASKEW else 0.0).max(0)
        found = self._gathered(fit, weight, 1, None)
        if self.live and self._aside is None:  # a frame would wait for the solves
            return found
        known = fit.chi2 < _SOLVED * (weight > 0).sum(1)
        for i in np.flatnonzero((longest > UNUSUAL) & known & (x[2] > 0)).tolist():
            row, begin = slice(i, i + 1), fit.parameters[i]
            own = y[row], weight[row], begin[None]
            solved, gap = yield from self._refined(*own, 1)
            if np.isfinite(solved.chi2[0]):
                better = self._gathered(solved, weight[row], 1, np.array([gap]))
                found = found.with_frames(np.array([i]), better, np.zeros(1, np.intp))
        return found

    def _refined(
        self, y: Any, weight: Any, start: Any, contacts: int
    ) -> Steps[tuple[PadFit, float]]:
        """Fit one frame by several contacts, or a wide one, solving them on the way."""
        kept, gap = self._kept.get(contacts), 1.0
        plain = PLAIN * contacts if contacts > 1 else start.shape[1]
        # A coarse start is near enough to try what is known.
        close = self._near(kept, start[0, :plain], contacts, live=True)
        own = kept if close else None
        fit = yield from self.fitting(y, weight, start, contacts, own)
        for _ in range(_ROUNDS):
            now = fit.parameters[0, :plain]
            if kept is not None and close and self._near(kept, now, contacts, live=self.live):
                gap = kept.min_gap
                break
            found = yield from self._corrected(now, contacts)
            if found is None:
                return fit._replace(chi2=np.full(1, np.inf)), gap
            self._kept[contacts] = kept = found
            close, gap = True, found.min_gap
            before = fit.parameters[0]
            fit = yield from self.fitting(y, weight, before[None], contacts, found)
            moved = fit.parameters[0] - before
            if moved @ fit.information[0] @ moved < _MOVED**2:
                break
        return fit, gap

    def _corrected(self, now: Floats, contacts: int) -> Steps[Correction | None]:
        def correction() -> Correction | None:
            if contacts == 1:
                return self._solved.correction_of_wide(now)
            return self._solved.correction(now, contacts)

        if self._aside is None:
            return correction()
        solve = self._aside.submit(correction)
        yield solve
        return solve.result()

    def _near(self, kept: Correction | None, now: Any, contacts: int, *, live: bool) -> bool:
        return kept is not None and near(kept, now, contacts, self._radius, live=live)

    def first_contact(self, places: Floats, extents: Floats) -> Floats:
        """See the base class; a wide contact dents the membrane less.

        Extents along arc and axis [m] come first; where they are unknown (NaN), they are the
        table's.
        """
        known = np.where(np.isnan(extents[:, :2]), self.table.diameter, extents[:, :2])
        relief, _ = self.interpolant.relief((known**2 - self.table.diameter**2) / 16)
        return self.table.first_contact_at(*places.T) * relief

    def left_to_shape(self, y: Floats, best: Explanations, more: Floats) -> Flags:
        """See the base class: noise is taken off the residuals' squares."""
        extents = best.beside[:, 0, :2, 0]
        known = np.isfinite(extents).all(1) & (best.contacts == 1)
        excess = np.where(known[:, None], extents, self.table.diameter) ** 2
        relief, _ = self.interpolant.relief((excess - self.table.diameter**2) / 16)
        used = best.weight > 0
        residual = np.where(used, y - best.so, 0.0)[:, :-1]
        change = np.where(used, y - self.interpolant.rest, 0.0)[:, :-1]
        variance = 1 / np.maximum(best.weight[:, :-1].max(1), 1e-300)
        noise = used[:, :-1].sum(1) * variance
        left = np.maximum((residual**2).sum(1) - noise, more * variance)
        left = left / (change**2).sum(1)
        return np.asarray(known & (np.sqrt(left) < _SHAPE * np.log(relief)))

    def pairs_for_wide(self, y: Floats, best: Explanations) -> tuple[Rows, Explanations]:
        """See the base class: discs of half the force each, with the contact's second moments.

        They are fitted on the sum of the interpolant's single contacts: where readings cannot
        tell two from a wide one, forces are light and the sum is right to within the noise.
        """
        whole, disc = best.q[:, 0], self.table.diameter
        turn = np.nan_to_num(whole[:, ASKEW - 1]) + np.where(whole[:, 4] < 0, np.pi / 2, 0.0)
        long = whole[:, 3] * np.exp(np.abs(whole[:, 4]))
        wide = (best.contacts == 1) & (long > _PAIR * disc) & (best.parameters[:, 2] > 0)
        rows = np.flatnonzero(wide & np.isfinite(best.chi2) & (self._most > 1))
        if not rows.size:
            return rows, best.rows(rows)
        apart = np.sqrt((long[rows] ** 2 - disc**2) / 16)
        way = np.stack([np.cos(turn[rows]) / self._radius, np.sin(turn[rows])], 1)
        either = (apart[:, None] * way)[..., None] * [-1.0, 1.0]
        places = whole[rows, :2, None] + either
        forces = np.repeat(whole[rows, 2:3] / 2, 2, 1)
        start = np.concatenate([places.reshape(len(rows), -1), forces], 1)
        weight = best.weight[rows]
        fit = finished(self.squares.steps(y[rows], weight, start, 2, None, False))
        found = self.squares.judged(
            y[rows], weight, self.squares.completed(fit.parameters, 2), 2
        )
        gaps = np.full(len(rows), self._gap)  # of no account: no frame is explained by them
        return rows, self._gathered(found, weight, 2, gaps)

    def prior_volume(self) -> float:
        """Of what is told of one contact: even but for its diameter."""
        size = 4 * self.edge[0] * self.edge[1] * MOST * float(self.table.cap.mean())
        if self.told.diameter:
            size *= np.sqrt(2 * np.pi) * PRIOR[0] * self.table.diameter
        if self.told.direction:
            size *= (2 * np.pi / 3) ** 2
        return float(size)

    def _gathered(
        self, fit: PadFit, weight: Any, contacts: int, gaps: Floats | None
    ) -> Explanations:
        frames, wide = len(fit.chi2), self.per_contact * self._most
        low, high = self.squares.bounds(fit.parameters, contacts, False)
        low = np.where(fit.parameters < low, -np.inf, low)
        _, decrease = step_of(fit, low, high, np.zeros(frames))
        own = self.told.marginal(fit.parameters, fit.jacobian, fit.information, contacts)
        parameters, jacobian, information, others, held = own
        rows = (ASKEW - PLAIN) * max(self._most, contacts)
        eliminated = np.zeros((frames, rows, fit.readings.shape[1]))
        eliminated[:, : others.shape[1]] = others
        more = np.full((frames, max(self._most, contacts), len(BESIDE), 2), np.nan)
        more[:, :contacts] = beside(
            fit.parameters, fit.information, self.squares.prior, contacts
        )
        if gaps is None:  # of single contacts: below zero beyond first contact
            limit = self.first_contact(fit.parameters[:, :2], more[:, 0, :2, 0])
            gaps = self._gap * (1 - fit.parameters[:, 2] / limit)
        return Explanations(
            score=fit.chi2.copy(),
            chi2=fit.chi2.copy(),
            contacts=np.full(frames, contacts),
            parameters=widened(parameters, wide),
            jacobian=widened(jacobian, wide),
            information=widened(information, wide, wide),
            predicted_decrease=decrease,
            pressure=fit.readings[:, -1].copy(),
            min_gap=gaps,
            so=fit.readings.copy(),
            q=widened(fit.parameters, ASKEW * max(self._most, contacts))[:, None],
            weight=weight.copy(),
            shift=np.zeros_like(fit.readings),
            beside=more,
            eliminated=eliminated,
            held=widened(held, wide),
        )


class AskewFitter(PadFitter):
    """Least squares for one slender contact that lies askew, from the likelier side.

    A state that such a fit found says where another begins.
    """

    def made(self, best: Explanations) -> bool:
        """See the base class."""
        return bool((np.isfinite(best.q[:, 0]).sum(1) == ASKEW).all())

    def steps(self, asked: Attempt) -> Steps[Explanations]:
        """See the base class."""
        y, weight, start, state, contacts, pull = asked
        before = np.asarray(state.q)
        if before.size and (np.isfinite(before).all(0).sum(0) == ASKEW).all():
            begin = np.concatenate([start[:, :PLAIN], before[0, PLAIN:ASKEW].T], 1)
            fit = yield from self.squares.steps(y, weight, begin, contacts, None, pull)
            return (yield from self._or_solved(y, weight, fit))
        given = y, weight, start[:, :PLAIN], contacts, None, pull
        plain = (yield from self.fitting(*given)).parameters
        begins, left = [], []
        for turn in (-np.pi / 4, np.pi / 4):
            begin = np.concatenate([plain, np.full((len(y), 1), turn)], 1)
            begin[:, 4] = _SLENDER
            begins.append(begin)
            every = np.arange(begin.shape[1])
            left.append(self.squares.profiled(y, weight, begin, contacts, None, every))
        begin = np.where((left[1] < left[0])[:, None], begins[1], begins[0])
        fit = yield from self.squares.steps(y, weight, begin, contacts, None, pull)
        return (yield from self._or_solved(y, weight, fit))
