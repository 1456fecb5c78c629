"""Least squares for line loads on a skin in plane strain, in batches of lanes.

Frames are lanes of one compiled program. All take a few steps; those that have not settled by
then take more, together, so that few lanes wait for the slowest.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import numpy as np

from fitting.arrays import Flags, Floats
from fitting.inverse_load.fit.covariance import inverse
from fitting.inverse_load.fit.explanation import (
    AbstractLoadFitter,
    Attempt,
    Explanations,
    widened,
)
from fitting.inverse_load.fit.left_out import LeftOutOfContacts
from fitting.inverse_load.fit.section_least_squares import FIT_PROGRAMS, SETTLED, Fit, Target
from fitting.inverse_load.model.contact_parameters import SECTION, SECTION_WITH_DIRECTION
from fitting.inverse_load.model.evaluation import FRAMES
from fitting.inverse_load.search.table import LoadTable, edge_margin
from fitting.steps import Steps
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.skin import Skin

# A few lanes need more steps than most: together they fill fewer batches.
_FIRST_STEPS, _MORE_STEPS = 2, 30
_TURNING = 4  # times as many where directions are free: far from the crown their valley bends
_LITTLE_GAP = 0.05  # share of the film
# The same where one contact explains a frame. Under two or three times the force of first
# contact the wall holds up the membrane, which then reads like a lighter contact beside it; the
# fit of that one leaves about 1 % of the film.
_WALL_GAP = 0.02
_BEND = np.deg2rad(15.0)  # most of a direction over which readings' bend is taken [rad]
_NEVER = 1e9  # stands for an infinite force of first contact [N]


class SectionFitter(AbstractLoadFitter):
    """Least squares on a skin in plane strain.

    The table's states bound the forces. Live, single frames are fitted, whole at once;
    otherwise many lanes side by side. `direction` says whether directions are free,
    `most_contacts` sets the widest set of parameters.
    """

    program = staticmethod(FIT_PROGRAMS.__getitem__)
    """The compiled fit by number of contacts."""
    limit_error = 0.01  # between the shell and the continuum
    beside = ("spread", "axial_extent", "arc_force")  # the second of pads alone

    def __init__(
        self, skin: Skin, table: LoadTable, *, direction: bool, live: bool, most_contacts: int
    ) -> None:
        self.skin, self.table, self.live = skin, table, live
        self._more_steps = _MORE_STEPS * (_TURNING if direction else 1)
        self.parameters = SECTION_WITH_DIRECTION if direction else SECTION
        self.edge = np.asarray(skin.geometry.half_angle) - edge_margin(skin)
        film = float(skin.geometry.oil_gap[0])
        self.little_gap, self.wall_gap = _LITTLE_GAP * film, _WALL_GAP * film
        self._width = self.per_contact * most_contacts
        cap = 3 * table.forces[:, -1].max()
        edge = float(self.edge[0])
        bounds = [(-edge, edge), (0.0, cap), (-np.pi / 2, np.pi / 2)]
        self._bounds = np.array(bounds[: self.per_contact])
        self.left_out = (
            None if direction else LeftOutOfContacts(skin, table, edge=edge, live=live)
        )

    def steps(self, asked: Attempt) -> Steps[Explanations]:
        """See the base class."""
        yield f"fit of {asked.contacts}"
        missing = self.per_contact * asked.contacts - asked.start.shape[1]
        if missing > 0:
            more = np.zeros((len(asked.y), missing))
            asked = asked._replace(start=np.concatenate([asked.start, more], 1))
        if self.live and len(asked.y) == 1:
            # The steps of one lane delay no other.
            fit = self._run(asked, _FIRST_STEPS + self._more_steps)
            return self._gathered(fit, asked)
        fit = self._batches(asked, _FIRST_STEPS)
        again = np.flatnonzero(np.isfinite(fit.chi2) & ~(fit.predicted_decrease < SETTLED))
        if again.size:
            begin, state = np.asarray(fit.parameters).T, fit.evaluation.state
            own = asked._replace(start=begin, state=state).rows(again)
            parts = jax.tree.leaves(self._batches(own, self._more_steps))
            for whole, part in zip(jax.tree.leaves(fit), parts, strict=True):
                whole[..., again] = part
        return self._gathered(fit, asked)

    def inside(self, parameters: Floats, contacts: int) -> Floats:
        """See the base class."""
        low, high = np.repeat(self._bounds, contacts, 0).T
        return np.clip(parameters, low, high)

    def turned(self, best: Explanations) -> Flags:
        """See the base class: they have a deviation of it, told or not."""
        return np.isfinite(best.beside[:, 0, -1, 1])

    def with_left_out(
        self, best: Explanations, y: Floats, *, still: bool
    ) -> tuple[Explanations, Floats | None]:
        """See the base class."""
        if self.left_out is None:
            return best, self.bend(best)
        return self.left_out.averaged(best, y, still=still)

    def bend(self, best: Explanations) -> Floats:
        """Covariance by what readings bend over errors of free directions, large off the crown.

        With C the covariance, w = C e / e^T C e the way of all parameters with a direction z,
        and readings that change by J w z + b z^2, parameters that are fitted to them lie off
        that way, and normal errors of variance s^2 of the direction cover it by

            d z^2 = -C J^T W b z^2,    <d z^2 (d z^2)^T> = 3 s^4 d d^T
        """
        found = np.full(best.information.shape, np.nan)
        for count in np.unique(best.contacts).tolist():
            frames, width = np.flatnonzero(best.contacts == count), self.per_contact * count
            own = best.rows(frames)
            known = inverse(own.information[:, :width, :width])
            known = np.where(np.isfinite(known), known, 0.0)
            rows = [self._bend(own, known, count, k) for k in range(2 * count, width)]
            found[frames, :width, :width] = sum(rows)
        return found

    def _bend(self, best: Explanations, covariance: Floats, count: int, k: int) -> Floats:
        """Of frames of some contacts, by the direction in row k of their parameters."""
        width = covariance.shape[1]
        variance = covariance[:, k, k, None]
        way = covariance[:, k] / np.maximum(variance, 1e-30)
        here, jacobian = (np.nan_to_num(x[:, :width]) for x in (best.parameters, best.jacobian))
        there = self.inside(here + way * np.minimum(np.sqrt(variance), _BEND), count)
        moved = self._derivatives(Attempt(best.so, best.weight, there, best.state, count))
        step = there - here
        turned = np.where(step[:, k] == 0, np.inf, step[:, k])
        bend = ((moved - jacobian) * step[..., None]).sum(1) / (2 * turned[:, None] ** 2)
        bend = np.where(best.weight > 0, np.nan_to_num(bend), 0.0)
        off = variance[..., None] * (covariance @ jacobian @ (best.weight * bend)[..., None])
        return np.asarray(3 * off @ off.transpose(0, 2, 1))

    def _derivatives(self, asked: Attempt) -> Floats:
        """Derivatives of the readings at the starts [frame, parameter, taxel]."""
        alone = self.live and len(asked.y) == 1
        fit = self._run(asked, 1) if alone else self._batches(asked, 1)
        return np.asarray(fit.evaluation.jacobian).transpose(2, 0, 1)

    def first_contact(self, places: Floats, extents: Floats) -> Floats:
        """See the base class."""
        known = np.minimum(self.table.first_contact, _NEVER)
        return np.interp(places[:, 0], self.table.angles, known)

    def limits(self, contacts: int, lanes: int, pull: bool) -> Any:
        """Lower and upper bounds [side, parameter, lane]."""
        bounds = self._bounds.copy()
        if pull:
            bounds[1] = -bounds[1, ::-1]
        sides = np.repeat(bounds, contacts, 0).T
        return np.repeat(sides[..., None], lanes, -1)

    def _batches(self, asked: Attempt, steps: int) -> Fit:
        """Fit frames, a batch of lanes after the other, the last one filled up."""
        lanes = 1 if self.live else (FRAMES if asked.contacts == 1 else FRAMES // 4)
        count = len(asked.y)
        asked = asked._replace(state=jax.tree.map(np.asarray, asked.state))

        def batch(begin: int) -> Fit:
            pick = np.minimum(np.arange(begin, begin + lanes), count - 1)
            return self._run(asked.rows(pick), steps)

        parts = [batch(0)]  # compiles
        if count > lanes:
            # A program keeps one core busy: batches share out the others.
            with ThreadPoolExecutor(os.cpu_count()) as pool:
                parts += pool.map(batch, range(lanes, count, lanes))
        return jax.tree.map(lambda *x: np.concatenate(x, -1)[..., :count].copy(), *parts)

    def _run(self, asked: Attempt, steps: int) -> Fit:
        """Fit frames, a lane each."""
        y, weight, start, state, contacts, pull = asked
        read: Any = y.T, weight.T
        target = Target(*read, *self.limits(contacts, len(y), pull))
        program = self.program(contacts)
        fit = COMPILED.run(program, self.skin, target, start.T, state, np.array(steps))
        found: Fit = jax.tree.map(np.asarray, fit)
        return found

    def _gathered(self, fit: Fit, asked: Attempt) -> Explanations:
        wide = self._width
        jacobian = np.asarray(fit.evaluation.jacobian).transpose(2, 0, 1)
        information = np.asarray(fit.information).transpose(2, 0, 1)
        return Explanations(
            score=np.array(fit.chi2),
            chi2=np.array(fit.chi2),
            contacts=np.full(len(fit.chi2), asked.contacts),
            parameters=widened(np.asarray(fit.parameters).T, wide),
            jacobian=widened(jacobian, wide),
            information=widened(information, wide, wide),
            predicted_decrease=np.array(fit.predicted_decrease),
            pressure=np.array(fit.evaluation.pressure),
            min_gap=np.array(fit.evaluation.min_gap),
            so=np.array(fit.evaluation.so.T),
            q=np.asarray(fit.evaluation.state.q).transpose(2, 0, 1).copy(),
            weight=asked.weight.copy(),
            shift=np.zeros(fit.evaluation.so.T.shape),
            beside=np.full((len(fit.chi2), wide // self.per_contact, 3, 2), np.nan),
            eliminated=np.zeros((len(fit.chi2), 2, fit.evaluation.so.shape[0])),
            held=widened(jacobian, wide),
        )
