"""Explanations of frames by loads, and what fits them whatever the dimension.

An explanation says how well loads fit a frame; of several the cheapest is taken. The number
of contacts of a fit is given; `fitting.inverse_load.fit.selection` finds it. A skin in plane
strain has its fitter in `section_fitter`, a pad in `fitting.inverse_load.pad.fitter`.
"""

import abc
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from fitting.arrays import Flags, Floats, Rows
from fitting.inverse_load.model.contact_parameters import ContactParameters
from fitting.steps import Steps, finished
from suas_jax.equilibrium.state import State

PLAUSIBLE = 0.05
"""p-value of chi2 above which no further contact is sought."""
UNSETTLED = 0.1
"""Decrease of chi2 that is still predicted for a fit that has not converged."""
PRIOR_OF_TANGENT = 0.3
"""Standard deviation of a tangential component over the inward force, where not told."""
TOLD = 0.7
"""Of a prior's standard deviation, beyond which readings tell nothing."""
UNUSUAL = 25e-3
"""Extent of a contact beyond which two are tried even where it explains a frame [m]."""
_UNKNOWN = 1e300  # chi2 of what could not be solved


@dataclass(frozen=True)
class Explanations:
    """One explanation a frame; arrays lead with the frame."""

    score: Floats  # chi2, and what further contacts and taxels left out count
    chi2: Floats  # weighted sum of squares; infinite where nothing was found
    contacts: NDArray[np.int64]  # their number
    parameters: Floats  # all angles, all forces, all turns; padded with NaN
    jacobian: Floats  # derivatives of the readings by them, likewise [frame, parameter, taxel]
    information: Floats  # J^T W J, likewise
    predicted_decrease: Floats  # of chi2, by one more step
    pressure: Floats  # of the oil [Pa]
    min_gap: Floats  # between membrane and wall [m]
    so: Floats  # the model's readings [counts]
    # unknowns of the equilibrium [frame, dof, station]; on a pad, of which none is solved, all
    # parameters of the fit, those eliminated among them [frame, 1, parameter]
    q: Floats
    weight: Floats  # inverse variances, zero where a taxel is left out [1/counts^2]
    # of the readings, by errors of the skin's inputs that were fitted with the loads: they are
    # then part of `so` and `chi2`, and zero where none were [frame, taxel] [counts]
    shift: Floats
    # what was fitted along beside the parameters, and eliminated from jacobian and information:
    # values and standard deviations [frame, contact, quantity, 2]; NaN where not told. On a
    # section the length of the arc that a single contact presses [m].
    beside: Floats
    # what it does to readings: with J its derivatives of them and L L^T its information, priors
    # included, L^-1 J [frame, row, taxel]; rows of zeros where there is less of it
    eliminated: Floats
    # derivatives of the readings by the parameters, what is eliminated held [frame, parameter,
    # taxel]
    held: Floats

    def __len__(self) -> int:
        return len(self.chi2)

    def rows(self, frames: Rows) -> "Explanations":
        """Those of some frames."""
        return Explanations(*(getattr(self, field.name)[frames] for field in fields(self)))

    def penalised(self, penalty: Floats | float) -> "Explanations":
        """The same with a penalty added to the scores."""
        return replace(self, score=self.score + penalty)

    def with_frames(self, frames: Rows, other: "Explanations", rows: Rows) -> "Explanations":
        """These, but for some frames, whose explanations are rows of others."""
        changed = {}
        for field in fields(self):
            array = getattr(self, field.name).copy()
            array[frames] = getattr(other, field.name)[rows]
            changed[field.name] = array
        return Explanations(**changed)

    def cheapest(self, frames: Rows, candidates: "Explanations") -> tuple["Explanations", Rows]:
        """The explanation of lowest score of every frame, and which frames changed.

        Candidates are other explanations, and `frames` says which frame each of them explains;
        a frame may have several or none.
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

    @classmethod
    def of_frames(cls, parts: Sequence["Explanations"]) -> "Explanations":
        """Those of several groups of frames, one group after the other."""
        return cls(
            *(np.concatenate([getattr(p, field.name) for p in parts]) for field in fields(cls))
        )

    def joined(self, other: "Explanations") -> "Explanations":
        """These and others."""
        return Explanations.of_frames([self, other])

    @property
    def state(self) -> State:
        """The equilibria, a lane a frame."""
        ones = np.ones(len(self))
        return State(np.moveaxis(self.q, 0, -1), self.pressure, ones)  # type: ignore[arg-type]

    @property
    def absorbed(self) -> Flags:
        """Whether errors of the skin's inputs were fitted with the loads [frame]."""
        return np.asarray((self.shift != 0).any(1))

    @property
    def wide(self) -> Flags:
        """Frames with a contact that is unusually wide along arc or axis [frame]."""
        extents = self.beside[:, :, :2, 0].reshape(len(self), -1)
        return np.asarray(np.nan_to_num(extents).max(1, initial=0.0) > UNUSUAL)

    def used(self) -> NDArray[np.int64]:
        """Taxels that were fitted [frame]."""
        return np.asarray((self.weight > 0).sum(1))

    def p_value(self, per_contact: int) -> Floats:
        """Probability of a chi2 as large, were the explanation right [frame]."""
        dof = np.maximum(self.used() - per_contact * self.contacts, 1)
        value = np.where(np.isfinite(self.chi2), self.chi2, _UNKNOWN)
        return np.asarray(chdtrc(dof, value))


def widened(values: Floats, *sizes: int) -> Floats:
    """Arrays by frame with NaN for the parameters that a fit doesn't have.

    Values have a frame first, then one axis or more over parameters; these axes get the stated
    sizes.
    """
    whole = np.full((len(values), *sizes, *values.shape[1 + len(sizes) :]), np.nan)
    whole[tuple(slice(n) for n in values.shape)] = values
    return whole


class Alternative(NamedTuple):
    """A second explanation of a frame that one contact explains."""

    chi2: float  # of the fit
    parameters: Floats  # of the contacts
    information: Floats  # J^T W J
    contacts: int  # their number: another place of one, or two for a wide one

    @classmethod
    def of(cls, explanations: Explanations, frame: int) -> "Alternative":
        """That of a frame."""
        return cls(
            float(explanations.chi2[frame]),
            explanations.parameters[frame].copy(),
            explanations.information[frame].copy(),
            int(explanations.contacts[frame]),
        )

    @classmethod
    def cheaper(
        cls, known: "Alternative | None", explanations: Explanations, frame: int
    ) -> "Alternative":
        """That of a frame, unless the known one leaves no more."""
        if known is None or explanations.chi2[frame] < known.chi2:
            return cls.of(explanations, frame)
        return known


class Attempt(NamedTuple):
    """Frames to fit, and where from."""

    y: Floats  # readings [frame, taxel] [counts]
    weight: Floats  # inverse variances [frame, taxel]
    start: Floats  # parameters [frame, parameter]; those after the forces may be left out
    state: State  # equilibria near there, a lane a frame
    contacts: int  # their number
    pull: bool = False  # seek forces that pull outwards instead of those that push

    def rows(self, frames: Rows) -> "Attempt":
        """Some of the frames."""
        y, weight, start = (x[frames] for x in self[:3])
        state = State(*(x[..., frames] for x in self.state))
        return Attempt(y, weight, start, state, self.contacts, self.pull)


class AbstractLoadFitter(abc.ABC):
    """Least squares for any number of frames, on one skin."""

    parameters: ContactParameters  # of a contact
    live: bool  # whether frames come one by one
    alone: bool = False  # whether frames that one contact leaves in doubt are fitted one by one
    edge: Floats  # largest coordinates of a contact's place [coordinate]
    limit_error: float  # of the force of first contact, relative
    # that a membrane near the wall leaves [m]; nothing is told by it where zero
    little_gap: float = 0.0
    # up to which the wall may hold up the membrane, and readings would hardly show it [m]
    wall_gap: float = 0.0
    beside: tuple[str, ...]  # names of `Explanations.beside`

    @property
    def per_contact(self) -> int:
        """Number of parameters of a contact."""
        return self.parameters.per_contact

    @abc.abstractmethod
    def steps(self, asked: Attempt) -> Steps[Explanations]:
        """Fit frames, in steps."""

    def fit(
        self, y: Floats, weight: Floats, start: Floats, state: State, contacts: int
    ) -> Explanations:
        """Fit frames at once, by forces that push; see `Attempt`."""
        return finished(self.steps(Attempt(y, weight, start, state, contacts)))

    def roughly(self, asked: Attempt) -> Explanations:
        """Fit by what is at hand; less right, where that is quicker."""
        return finished(self.steps(asked))

    def made(self, best: Explanations) -> bool:
        """Whether single contacts were fitted by this one, where another serves most."""
        return False

    def turned(self, best: Explanations) -> Flags:
        """Frames whose tangential force was free where that of most is not [frame]."""
        return np.zeros(len(best), bool)

    def with_left_out(
        self, best: Explanations, y: Floats, *, still: bool
    ) -> tuple[Explanations, Floats | None]:
        """Explanations of readings [frame, taxel] with what their fit left out of contacts.

        Second are the covariances of the parameters by that, and by readings that bend over
        what is free; padded as the information is, None where there are none. `still`: whether
        the skin is in equilibrium.
        """
        del y, still
        return best, None

    @abc.abstractmethod
    def inside(self, parameters: Floats, contacts: int) -> Floats:
        """Parameters [frame, parameter] with those beyond their bounds on them."""

    @abc.abstractmethod
    def first_contact(self, places: Floats, extents: Floats) -> Floats:
        """Force at which the membrane under single contacts reaches the wall [contact] [N].

        `places`: of the contacts [contact, coordinate]. `extents`: what is estimated beside
        their parameters [contact, quantity].
        """

    def left_to_shape(self, y: Floats, best: Explanations, more: Floats) -> Flags:
        """Frames of one contact that leave no more than its model of wide ones leaves out.

        `y`: readings [frame, taxel]. `best`: explanations of them. `more`: what one more
        contact would take off chi2 [frame].
        """
        return np.zeros(len(best), bool)

    def pairs_for_wide(self, y: Floats, best: Explanations) -> tuple[Rows, Explanations]:
        """Frames of one wide contact, and two contacts beside one another in its place.

        `y`: readings [frame, taxel]. `best`: explanations of them.
        """
        none = np.zeros(0, np.intp)
        return none, best.rows(none)

    def screened(
        self,
        frames: Rows,  # of the starting points; a frame may have several [start]
        y: Floats,  # readings [start, taxel]
        weight: Floats,  # inverse variances [start, taxel]
        start: Floats,  # parameters [start, parameter]
        contacts: int,  # their number
        to_beat: Floats,  # chi2 of a fit that would be no better than what is known [start]
    ) -> Steps[Rows]:
        """Starts of several contacts that are worth a fit, all unless told otherwise."""
        yield "screening"
        return np.arange(len(start))
