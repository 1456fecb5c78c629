"""Loads on a pad whose membrane remembers, frame after frame, without a solve.

What an elastic pad would need for the dent of now is the load's elastic equivalent E. With
gamma_i, tau_i of `fitting.inverse_load.memory.series`, at every place by itself::

    F = E + sum_i gamma_i R_i,   dR_i/dt + R_i / tau_i = dE/dt

Over a step in which E changes linearly this is F = (1 + sum gamma_i m_i) E + c, where the past
says c, and m_i = (1 - exp(-x)) / x, x = dt / tau_i. A place that nothing presses any more has
F = 0: its E is the dent that is left. The table of elastic states reads all E together; that
dents of different shapes relax alike, place by place, is what this leaves out (`_LEFT_OUT`).

These are the states of `suas_jax.constitutive.relaxation` in NumPy: frames go without JAX.
"""

from typing import NamedTuple

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.fit.selection import Selection
from fitting.inverse_load.fit.systematic import AbstractSystematicErrors
from fitting.inverse_load.memory.series import AbstractMemoryFollower, LoadMemory
from fitting.inverse_load.pad.interpolant import WHOLE, PadInterpolant

_SAME = 2e-3  # distance within which loads press the same place [m]
_MOST = 200  # dents that are remembered, the largest ones
_LEAST = 1e-3  # load below which a dent is forgotten, over the largest dent's
_LEFT_OUT = 0.1  # standard deviation of what dents read, relative
_ROUNDS = 3  # of a frame's fit and of what the past reads beside its loads
_SETTLED = 0.2  # change of a reading between rounds that ends them, in its noise


class Dents(NamedTuple):
    """What is left of loads at some places."""

    # of the contacts that made them, whose forces do not count [place, WHOLE]
    shape: Floats
    load: Floats  # E at the last frame [place] [N]
    states: Floats  # R_i [place, term] [N]

    @classmethod
    def unpressed(cls, shape: Floats, terms: int) -> "Dents":
        """Places that nothing has pressed."""
        return cls(shape, np.zeros(len(shape)), np.zeros((len(shape), terms)))


class Answer(NamedTuple):
    """How dents answer a load at the end of a step: F = share E + rest."""

    fade: Floats  # exp(-x) [term]
    mean: Floats  # m_i [term]
    share: float
    rest: Floats  # c [place] [N]

    @classmethod
    def of(cls, dents: Dents, gamma: Floats, tau: Floats, elapsed: float) -> "Answer":
        """That a time after the last frame [s]."""
        x = elapsed / tau
        fade = np.exp(-x)
        mean = np.where(x > 0, -np.expm1(-x) / np.where(x > 0, x, 1.0), 1.0)
        past = fade * dents.states - mean * dents.load[:, None]
        return cls(fade, mean, float(1 + gamma @ mean), past @ gamma)

    def after(self, dents: Dents, force: Floats) -> Dents:
        """Dents at the end of the step, under forces [place] [N]."""
        load = (force - self.rest) / self.share
        change = (load - dents.load)[:, None]
        return dents._replace(load=load, states=self.fade * dents.states + self.mean * change)


class PadMemoryErrors(AbstractSystematicErrors):
    """Errors of the inputs, of the shares that relax, and of what this memory leaves out."""

    def __init__(self, base: AbstractSystematicErrors, memory: LoadMemory) -> None:
        self._base = base
        own = tuple(f"relaxation {k}" for k in range(len(memory.errors)))
        self.names = (*base.names, *own, "dents")
        self.at(np.zeros((len(own) + 1, base.rest.shape[1])))

    def at(self, left: Floats) -> None:
        """Take what each error of the memory does to a frame's readings [error, channel]."""
        self._left = left
        self.rest = np.concatenate([self._base.rest, left])

    def slopes(self, best: Explanations, per_contact: int, contacts: int) -> Floats:
        """See the base class."""
        base = self._base.slopes(best, per_contact, contacts)
        own = np.broadcast_to(self._left, (len(best), *self._left.shape))
        return np.concatenate([base, own], 1)

    def unexplained(self, best: Explanations, per_contact: int) -> Floats | None:
        """See the base class."""
        return self._base.unexplained(best, per_contact)


class PadMemoryFollower(AbstractMemoryFollower):
    """Follows what the membrane of one pad remembers."""

    errors: PadMemoryErrors

    def __init__(
        self,
        memory: LoadMemory,  # of the membrane
        interpolant: PadInterpolant,  # of the pad's elastic states, by long-term constants
        selection: Selection,  # that explains its frames, beside these errors
        errors: PadMemoryErrors,
        noise: float,  # standard deviation of a reading [counts]
    ) -> None:
        self._memory, self._interpolant, self._noise = memory, interpolant, noise
        self.selection, self.errors = selection, errors
        # To first order oil and loads relax alike: without loads it is at rest.
        self.pressure = interpolant.table.rest_pressure
        self.forget()

    def forget(self) -> None:
        """See the base class."""
        self._dents = Dents.unpressed(np.zeros((0, WHOLE)), len(self._memory.tau))
        self._after: Dents | None = None  # at the end of the frame; None where not explained
        self._time = self._now = -np.inf  # of the last frame that was explained, of this one
        self._contacts = np.zeros((0, WHOLE))  # that the frame is taken to have
        self._round = 0
        self._shift = np.zeros(len(self._interpolant.rest))
        self.errors.at(np.zeros((len(self._memory.errors) + 1, len(self._shift))))
        self.selection.forget()

    def before(self, time: float) -> Floats:
        """See the base class: the frame is first taken to have the contacts of the last one."""
        if self._after is not None:
            self._dents, self._time = self._after, self._now
        if time < self._now:
            self.forget()
        self._now = time if np.isfinite(time) else max(self._now, 0.0)
        self._after, self._round = None, 0
        self._look()
        return self._shift

    def again(self) -> Floats | None:
        """See the base class."""
        self._round += 1
        if self._after is None or self._round >= _ROUNDS:
            return None
        before = self._shift
        self._look()
        settled = np.abs(self._shift - before)[:-1].max() < _SETTLED * self._noise
        return None if settled else self._shift

    def after(self, best: Explanations | None) -> None:
        """See the base class."""
        if best is None:
            self._after = None
            return
        count = int(best.contacts[0])
        self._take(best.q[0, 0, : WHOLE * count].reshape(WHOLE, count).T)

    def untouched(self) -> None:
        """See the base class."""
        self._take(np.zeros((0, WHOLE)))

    def _take(self, contacts: Floats) -> None:
        self._contacts, dents = contacts, self._dents
        apart = self._distance(contacts, dents)
        new = contacts[(apart > _SAME).all(1)]
        more = Dents.unpressed(new, len(self._memory.tau))
        dents = Dents(*map(np.concatenate, zip(dents, more, strict=True)))
        force = np.zeros(len(dents.load))
        if len(contacts):
            np.add.at(force, self._distance(contacts, dents).argmin(1), contacts[:, 2])
        after = self._answer(dents, self._memory.gamma).after(dents, force)
        size = np.maximum(np.abs(after.load), np.abs(after.states).max(1, initial=0.0))
        kept = np.argsort(-size)[:_MOST]
        kept = kept[size[kept] > _LEAST * size.max(initial=0.0)]
        self._after = Dents(*(x[kept] for x in after))

    def _look(self) -> None:
        """Find what the past leaves beside the contacts, and what errors do to it."""
        contacts, dents, memory = self._contacts, self._dents, self._memory
        apart = self._distance(contacts, dents) / self._interpolant.table.diameter
        near = np.maximum(1 - apart, 0.0)
        near = near / np.maximum(near.sum(0), 1.0)  # share of a dent that is under a contact
        shares = [memory.gamma, *(memory.gamma + by for by in memory.errors)]
        loads = np.concatenate([contacts, dents.shape])[None].repeat(1 + len(shares), 0)
        loads[0, len(contacts) :, 2] = 0.0  # an elastic pad under the contacts alone
        for k, gamma in enumerate(shares):
            answer = self._answer(dents, gamma)
            left = -answer.rest / answer.share
            under = contacts[:, 2] / answer.share + near @ left
            loads[1 + k, :, 2] = np.concatenate([under, (1 - near.sum(0)) * left])
        elastic, now, *others = self._interpolant.summed(loads)
        self._shift = now - elastic
        moved = [other - now for other in others]
        self.errors.at(np.stack([*moved, _LEFT_OUT * self._shift]))

    def _answer(self, dents: Dents, gamma: Floats) -> Answer:
        elapsed = self._now - self._time if np.isfinite(self._time) else 0.0
        return Answer.of(dents, gamma, self._memory.tau, elapsed)

    def _distance(self, contacts: Floats, dents: Dents) -> Floats:
        """On the outer face [contact, place] [m]."""
        apart = (contacts[:, None, :2] - dents.shape[None, :, :2]) * self._interpolant.metres
        return np.asarray(np.hypot(*np.moveaxis(apart, -1, 0)))
