"""Loads on a membrane that remembers, frame after frame.

Before a frame the past says what nothing pressing would read; the loads are what explains the
rest, and the membrane's state with them is what the next frame remembers. A frame that nothing
explains leaves no state: the step goes on to the next one.
"""

import numpy as np

from fitting.arrays import Floats, Rows
from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.fit.other_stiffness import AbstractSectionErrors
from fitting.inverse_load.fit.section_fitter import SectionFitter
from fitting.inverse_load.fit.selection import Selection
from fitting.inverse_load.fit.wide_contact import WideContactFitter
from fitting.inverse_load.memory.remembering import (
    AT_FIRST,
    EXPECTED,
    UNDER_LOADS,
    Expected,
    RememberingSkin,
    Series,
)
from fitting.inverse_load.memory.series import AbstractMemoryFollower, LoadMemory
from fitting.inverse_load.search.section import NodeSearch
from fitting.inverse_load.search.table import LoadTable
from suas_jax.constitutive.relaxation import Past
from suas_jax.equilibrium.state import State
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.skin import Skin


class RememberingNodes(NodeSearch):
    """States of the table, displaced by what the past leaves."""

    def __init__(self, skin: Skin, table: LoadTable) -> None:
        super().__init__(skin, table)
        self.left: Floats | None = None
        """Unknowns that the past leaves without loads [dof, station, 1]."""

    def states(self, node: Rows) -> State:
        """See the base class."""
        return self._displaced(super().states(node))

    def rest_states(self, frames: int) -> State:
        """See the base class."""
        return self._displaced(super().rest_states(frames))

    def _displaced(self, state: State) -> State:
        if self.left is None:
            return state
        ones = np.ones(np.shape(state.pressure))
        return State(state.q + self.left, state.pressure, ones)  # type: ignore[arg-type]


class RememberedErrors(AbstractSectionErrors):
    """Errors of the inputs, and of the shares of the stress that relax.

    `base` are the errors of the inputs, None for none; `memory` is the membrane's.
    """

    def __init__(
        self, base: AbstractSectionErrors | None, memory: LoadMemory, taxels: int
    ) -> None:
        self._base = base
        own = tuple(f"relaxation {k}" for k in range(len(memory.errors)))
        self.names = (() if base is None else base.names) + own
        known = np.zeros(0, bool) if base is None else base.of_membrane
        self.of_membrane = np.append(known, np.ones(len(own), bool))
        self._rest = np.zeros((0, taxels)) if base is None else base.rest
        self.skin: RememberingSkin | None = None
        self._now: Expected | None = None
        self.rest = np.concatenate([self._rest, np.zeros((len(own), taxels))])

    def at(self, now: Expected, skin: RememberingSkin) -> None:
        """Take the frame whose errors are asked for."""
        self._now, self.skin = now, skin
        self.rest = np.concatenate([self._rest, np.asarray(now.slopes)])

    def slopes(self, best: Explanations, per_contact: int, contacts: int) -> Floats:
        """See the base class."""
        assert self._now is not None
        width = per_contact * contacts
        rows = [np.zeros((len(self._now.by_error), best.so.shape[1]))] * len(best)
        for k in range(len(best) if self._now.by_error else 0):
            own = best.rows(np.array([k]))
            parameters = own.parameters[:, :width].T
            found = COMPILED.run(
                UNDER_LOADS[contacts], self.skin, self._now.by_error, parameters, own.state
            )
            rows[k] = np.asarray(found)
        own_slopes = np.stack(rows)
        if self._base is None:
            return own_slopes
        base = self._base.slopes(best, per_contact, contacts)
        return np.concatenate([base, own_slopes], 1)


class MemoryFollower(AbstractMemoryFollower):
    """Follows what the membrane of one section remembers."""

    errors: RememberedErrors

    def __init__(
        self,
        memory: LoadMemory,  # of the membrane
        skin: Skin,  # with the long-term constants
        table: LoadTable,  # of its solved states
        errors: AbstractSectionErrors | None,  # of its inputs; None for none
        *,
        direction: bool,  # whether directions of contacts are free
        most_contacts: int,
        penalty: float,  # chi2 that a further contact must gain
    ) -> None:
        self._skin, self._rest_so = skin, table.rest
        self._series = Series(memory.gamma, memory.tau, memory.errors)  # type: ignore[arg-type]
        self.errors = RememberedErrors(errors, memory, len(table.rest))
        self._fitter = SectionFitter(
            skin, table, direction=direction, live=True, most_contacts=most_contacts
        )
        self._wide = None
        if not direction:
            self._wide = WideContactFitter(skin, table, live=True, most_contacts=most_contacts)
        self._nodes = RememberingNodes(skin, table)
        self.selection = Selection(
            self._fitter, self._nodes, penalty, most_contacts, self.errors, self._wide
        )
        self._time = self._at = self._stood = 0.0
        self.forget()

    def forget(self) -> None:
        """See the base class."""
        self._now: Expected | None = None
        self._past: Past | None = None
        self.selection.forget()

    def before(self, time: float) -> Floats:
        """See the base class."""
        if self._past is None or time < self._time:
            self.forget()
            self._begin(time)
        now = time if np.isfinite(time) else self._time
        found = self._expected(now)
        if int(found.result) or not np.isfinite(np.asarray(found.so)).all():
            self.forget()
            self._begin(now)
            found = self._expected(now)
        self._now, self.pressure = found, float(found.pressure)
        shift = np.asarray(found.so) - self._rest_so
        skin = RememberingSkin(self._skin, found.response, shift)  # type: ignore[arg-type]
        self._fitter.skin = skin  # type: ignore[assignment]
        if self._wide is not None:
            self._wide.skin = skin  # type: ignore[assignment]
        self._nodes.left = np.asarray(found.state.q)
        self.errors.at(found, skin)
        self._at = now
        return shift

    def after(self, best: Explanations | None) -> None:
        """See the base class."""
        if best is not None:
            self._take(best.q[0])

    def untouched(self) -> None:
        """See the base class: the state is what the past leaves."""
        assert self._now is not None
        self._take(np.asarray(self._now.state.q)[..., 0])

    def _take(self, q: Floats) -> None:
        """Take the unknowns of the frame [dof, station]."""
        assert self._now is not None
        self._past = self._now.past
        self._stood, self._time = self._at - self._time, self._at
        self._last, self._start = q[..., None], self._now.state

    def _begin(self, time: float) -> None:
        past, state, _ = COMPILED.run(AT_FIRST, self._skin)
        terms = len(self._series.gamma)
        stress = np.asarray(past.stress)
        self._past = Past(stress, np.zeros((terms, *stress.shape)))  # type: ignore[arg-type]
        self._stood, self._time = 0.0, time if np.isfinite(time) else 0.0
        self._last, self._start = np.asarray(state.q), state

    def _expected(self, time: float) -> Expected:
        stood, elapsed = np.asarray(self._stood), np.asarray(time - self._time)
        found: Expected = COMPILED.run(
            EXPECTED,
            self._skin,
            self._series,
            self._past,
            stood,
            self._last,
            elapsed,
            self._start,
        )
        return found
