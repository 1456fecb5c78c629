"""Explanations of frames by loads: how well they fit, and least squares in batches."""

import abc
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from fitting.inverse_load.fit.least_squares import FIT_PROGRAMS, SETTLED, Fit, Target
from fitting.inverse_load.model.contact_parameters import (
    SECTION,
    SECTION_WITH_DIRECTION,
    ContactParameters,
)
from fitting.inverse_load.search.table import LANES, LoadTable, edge_margin
from suas_jax.equilibrium.equilibrium import State
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.forward import Skin

# A few lanes need more steps than most: together they fill fewer batches.
_FIRST_STEPS, _MORE_STEPS = 2, 30
_UNKNOWN = 1e300  # chi2 of what could not be solved


@dataclass(frozen=True)
class Explanations:
    """One explanation a frame; arrays lead with the frame.

    Attributes:
        score: chi2, and what further contacts and taxels left out count.
        chi2: weighted sum of squares; infinite where nothing was found.
        contacts: their number.
        parameters: all angles, all forces, all turns; padded with NaN.
        jacobian: derivatives of the readings by them, likewise [frame, parameter, taxel].
        information: J^T W J, likewise.
        predicted_decrease: of chi2, by one more step.
        pressure: of the oil [Pa].
        min_gap: between membrane and wall [m].
        so: the model's readings [counts].
        q: unknowns of the equilibrium [frame, dof, station].
        weight: inverse variances, zero where a taxel is left out [1/counts^2].
        absorbed: whether errors of the skin's inputs were fitted with the loads: they are then
            part of `so` and `chi2`.
        spread: length of the arc that a single contact was found to press, and its standard
            deviation [frame, 2] [m]; NaN where contacts are taken as lines. Jacobian and
            information are those with the spread fitted along.
    """

    score: NDArray[np.float64]
    chi2: NDArray[np.float64]
    contacts: NDArray[np.int64]
    parameters: NDArray[np.float64]
    jacobian: NDArray[np.float64]
    information: NDArray[np.float64]
    predicted_decrease: NDArray[np.float64]
    pressure: NDArray[np.float64]
    min_gap: NDArray[np.float64]
    so: NDArray[np.float64]
    q: NDArray[np.float64]
    weight: NDArray[np.float64]
    absorbed: NDArray[np.bool_]
    spread: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.chi2)

    def rows(self, frames: NDArray[np.intp]) -> "Explanations":
        """Those of some frames."""
        return Explanations(*(getattr(self, field.name)[frames] for field in fields(self)))

    def penalised(self, penalty: NDArray[np.float64] | float) -> "Explanations":
        """The same with a penalty added to the scores."""
        return replace(self, score=self.score + penalty)

    def with_frames(
        self, frames: NDArray[np.intp], other: "Explanations", rows: NDArray[np.intp]
    ) -> "Explanations":
        """These, but for some frames, whose explanations are rows of others."""
        changed = {}
        for field in fields(self):
            array = getattr(self, field.name).copy()
            array[frames] = getattr(other, field.name)[rows]
            changed[field.name] = array
        return Explanations(**changed)

    def cheapest(
        self, frames: NDArray[np.intp], candidates: "Explanations"
    ) -> tuple["Explanations", NDArray[np.intp]]:
        """The explanation of lowest score of every frame, and which frames changed.

        Args:
            frames: what each candidate explains; a frame may have several or none.
            candidates: other explanations.
        """
        rows = np.flatnonzero(candidates.score < self.score[frames])
        rows = rows[np.argsort(-candidates.score[rows], kind="stable")]  # cheapest last
        chosen = {int(frames[row]): int(row) for row in rows}
        if not chosen:
            return self, np.zeros(0, np.intp)
        changed = np.array(sorted(chosen), np.intp)
        return self.with_frames(
            changed, candidates, np.array([chosen[i] for i in changed])
        ), changed

    def joined(self, other: "Explanations") -> "Explanations":
        """These and others."""
        names = [field.name for field in fields(self)]
        return Explanations(
            *(np.concatenate([getattr(self, n), getattr(other, n)]) for n in names)
        )

    @property
    def state(self) -> State:
        """The equilibria, a lane a frame."""
        ones = np.ones(len(self))
        return State(np.moveaxis(self.q, 0, -1), self.pressure, ones)  # type: ignore[arg-type]

    def used(self) -> NDArray[np.int64]:
        """Taxels that were fitted [frame]."""
        return np.asarray((self.weight > 0).sum(1))

    def p_value(self, per_contact: int) -> NDArray[np.float64]:
        """Probability of a chi2 as large, were the explanation right [frame]."""
        dof = np.maximum(self.used() - per_contact * self.contacts, 1)
        value = np.where(np.isfinite(self.chi2), self.chi2, _UNKNOWN)
        return np.asarray(chdtrc(dof, value))


def widened(values: NDArray[np.float64], *sizes: int) -> NDArray[np.float64]:
    """Arrays by frame with NaN for the parameters that a fit doesn't have.

    Args:
        values: a frame first, then one axis or more over parameters.
        sizes: that these axes should have.
    """
    whole = np.full((len(values), *sizes, *values.shape[1 + len(sizes) :]), np.nan)
    whole[tuple(slice(n) for n in values.shape)] = values
    return whole


class AbstractLoadFitter(abc.ABC):
    """Least squares for any number of frames, on one skin.

    Attributes:
        parameters: of a contact.
        live: whether frames come one by one.
    """

    parameters: ContactParameters
    live: bool

    @property
    def per_contact(self) -> int:
        """Number of parameters of a contact."""
        return self.parameters.per_contact

    @abc.abstractmethod
    def fit(
        self,
        y: NDArray[np.float64],
        weight: NDArray[np.float64],
        start: NDArray[np.float64],
        state: State,
        contacts: int,
        *,
        pull: bool = False,
    ) -> Explanations:
        """Fit frames.

        Args:
            y: readings [frame, taxel] [counts].
            weight: inverse variances [frame, taxel].
            start: parameters [frame, parameter]; those after the forces may be left out.
            state: equilibria near there, a lane a frame.
            contacts: their number.
            pull: seek forces that pull outwards instead of those that push.
        """

    @abc.abstractmethod
    def inside(self, parameters: NDArray[np.float64], contacts: int) -> NDArray[np.float64]:
        """Parameters [frame, parameter] with those beyond their bounds on them."""

    def screened(
        self,
        frames: NDArray[np.intp],
        y: NDArray[np.float64],
        weight: NDArray[np.float64],
        start: NDArray[np.float64],
        contacts: int,
        to_beat: NDArray[np.float64],
    ) -> NDArray[np.intp]:
        """Starting points of several contacts that are worth a fit, all unless told otherwise.

        Args:
            frames: of the starting points; a frame may have several [start].
            y: readings [start, taxel].
            weight: inverse variances [start, taxel].
            start: parameters [start, parameter].
            contacts: their number.
            to_beat: chi2 of a fit that would be no better than what is known [start].
        """
        return np.arange(len(start))


class LoadFitter(AbstractLoadFitter):
    """Least squares on a skin in plane strain.

    Args:
        skin: the skin.
        table: its states, which bound the forces.
        direction: whether directions are free.
        live: fit single frames, whole at once; otherwise many lanes side by side.
        most_contacts: widest set of parameters.
    """

    program = staticmethod(FIT_PROGRAMS.__getitem__)
    """The compiled fit by number of contacts."""

    def __init__(
        self, skin: Skin, table: LoadTable, *, direction: bool, live: bool, most_contacts: int
    ) -> None:
        self.skin, self.table, self.live = skin, table, live
        self.parameters = SECTION_WITH_DIRECTION if direction else SECTION
        self.edge = float(skin.geometry.half_angle[0]) - edge_margin(skin)
        self._width = self.per_contact * most_contacts
        cap = 3 * table.forces[:, -1].max()
        bounds = [(-self.edge, self.edge), (0.0, cap), (-np.pi / 2, np.pi / 2)]
        self._bounds = np.array(bounds[: self.per_contact])

    def fit(
        self,
        y: NDArray[np.float64],
        weight: NDArray[np.float64],
        start: NDArray[np.float64],
        state: State,
        contacts: int,
        *,
        pull: bool = False,
    ) -> Explanations:
        """See the base class."""
        missing = self.per_contact * contacts - start.shape[1]
        if missing > 0:
            start = np.concatenate([start, np.zeros((len(y), missing))], 1)
        if self.live and len(y) == 1:
            # The steps of one lane delay no other.
            steps = _FIRST_STEPS + _MORE_STEPS
            limits = self.limits(contacts, 1, pull)
            fit = self._run(y, weight, start, state, steps, contacts, limits)
            return self._gathered(fit, weight, contacts)
        everything = np.arange(len(y))
        limits = self.limits(contacts, self._lanes(contacts), pull)
        fit = self._batches(y, weight, start, state, _FIRST_STEPS, contacts, everything, limits)
        again = np.flatnonzero(np.isfinite(fit.chi2) & ~(fit.predicted_decrease < SETTLED))
        if again.size:
            states = jax.tree.map(lambda x: x[..., again], fit.evaluation.state)
            begin = np.asarray(fit.parameters).T[again]
            more = self._batches(y, weight, begin, states, _MORE_STEPS, contacts, again, limits)
            for whole, part in zip(jax.tree.leaves(fit), jax.tree.leaves(more), strict=True):
                whole[..., again] = part
        return self._gathered(fit, weight, contacts)

    def inside(self, parameters: NDArray[np.float64], contacts: int) -> NDArray[np.float64]:
        """See the base class."""
        low, high = np.repeat(self._bounds, contacts, 0).T
        return np.clip(parameters, low, high)

    def _lanes(self, contacts: int) -> int:
        return 1 if self.live else (LANES if contacts == 1 else LANES // 4)

    def limits(self, contacts: int, lanes: int, pull: bool) -> Any:
        """Lower and upper bounds [side, parameter, lane]."""
        bounds = self._bounds.copy()
        if pull:
            bounds[1] = -bounds[1, ::-1]
        sides = np.repeat(bounds, contacts, 0).T
        return np.repeat(sides[..., None], lanes, -1)

    def _batches(
        self,
        y: Any,
        weight: Any,
        start: Any,
        state: State,
        steps: int,
        contacts: int,
        rows: Any,
        limits: Any,
    ) -> Fit:
        """Fit some rows of y, a batch of lanes after the other, the last one filled up."""
        lanes, states = self._lanes(contacts), jax.tree.map(np.asarray, state)

        def batch(begin: int) -> Fit:
            pick = np.minimum(np.arange(begin, begin + lanes), len(rows) - 1)
            there = jax.tree.map(lambda x: x[..., pick], states)
            index = rows[pick]
            return self._run(
                y[index], weight[index], start[pick], there, steps, contacts, limits
            )

        parts = [batch(0)]  # compiles
        if len(rows) > lanes:
            # A program keeps one core busy: batches share out the others.
            with ThreadPoolExecutor(os.cpu_count()) as pool:
                parts += pool.map(batch, range(lanes, len(rows), lanes))
        return jax.tree.map(lambda *x: np.concatenate(x, -1)[..., : len(rows)].copy(), *parts)

    def _run(
        self,
        y: Any,
        weight: Any,
        start: Any,
        state: State,
        steps: int,
        contacts: int,
        limits: Any,
    ) -> Fit:
        target = Target(y.T, weight.T, *limits)
        program = self.program(contacts)
        fit = COMPILED.run(program, self.skin, target, start.T, state, np.array(steps))
        found: Fit = jax.tree.map(np.asarray, fit)
        return found

    def _gathered(self, fit: Fit, weight: Any, contacts: int) -> Explanations:
        wide = self._width
        jacobian = np.asarray(fit.evaluation.jacobian).transpose(2, 0, 1)
        information = np.asarray(fit.information).transpose(2, 0, 1)
        return Explanations(
            score=np.array(fit.chi2),
            chi2=np.array(fit.chi2),
            contacts=np.full(len(fit.chi2), contacts),
            parameters=widened(np.asarray(fit.parameters).T, wide),
            jacobian=widened(jacobian, wide),
            information=widened(information, wide, wide),
            predicted_decrease=np.array(fit.predicted_decrease),
            pressure=np.array(fit.evaluation.pressure),
            min_gap=np.array(fit.evaluation.min_gap),
            so=np.array(fit.evaluation.so.T),
            q=np.asarray(fit.evaluation.state.q).transpose(2, 0, 1).copy(),
            weight=weight.copy(),
            absorbed=np.zeros(len(fit.chi2), bool),
            spread=np.full((len(fit.chi2), 2), np.nan),
        )
