"""The best design within bounds and limits: sequential quadratic programming from many starts.

The worst place decides a goal, which is not a smooth function of the design. A further
variable t takes its place::

    minimise t   with   f_k(x) / f_0 <= t at every place k,   g_k(x) / limit >= 1

(for a goal to be large, t is maximised below every f_k). All of it is smooth, and the
multipliers say what each limit costs.
"""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np
import scipy.optimize
from scipy.stats import qmc

from fitting.arrays import Floats
from fitting.datasheet.words import WORDS
from fitting.design.problem import Outcome, Problem
from fitting.design.want import Limit, OwnLimit, Want
from fitting.workers import in_float64

_STEPS = 80
# Designs of one search at most, for each variable and one more; and those of them without a
# state. Beside these the search has no slope to go by, and creeps.
_TRIED, _LOST = 30, 12
# Beginnings of one search, each half of the way from a start without a state to the skin file's
# design; the first is the start.
_BEGINNINGS = 5
_KEPT = 1e-5  # share by which a limit may be missed
_ACTIVE = 1e-4  # share within which a limit counts as reached
_AGREE = 2e-3  # relative difference of goals that agree


class Trial(NamedTuple):
    """Where a search from one start ended."""

    start: Floats  # its variables, between 0 and 1
    x: Floats  # those of its end
    goal: float  # the figure there, the worst over the region; NaN where limits are not kept
    message: str  # how it ended
    multipliers: Floats  # of the goal at every place, then of the limits
    first: Outcome  # figures at the start, whose goal is the scale of the search
    last: Outcome  # figures at the end
    calls: int  # designs evaluated on the way


class Price(NamedTuple):
    """A limit or a bound that holds the design."""

    name: str  # of the figure or the variable
    least: bool  # whether it is a lower one
    value: float  # of the limit, SI; of a bound, as the file has it
    place: int | None  # index of the place; None for a bound
    # relative change of the goal by a relative change of the limit; of a bound, by the whole
    # range of the variable. Above zero where the limit makes the goal worse.
    price: float
    purpose: str = ""  # of a limit that the search has itself; empty of one of the file


class Found(NamedTuple):
    """The best design."""

    x: Floats  # its variables, between 0 and 1
    goal: float  # the worst over the region there
    start: Outcome  # figures of the skin to start from, its variables moved into their bounds
    before: float  # the goal there
    trials: tuple[Trial, ...]  # all searches, the best first
    prices: tuple[Price, ...]  # what holds it
    agreeing: int  # searches that ended with the same goal
    calls: int  # designs evaluated by all of them


class Kept(Protocol):
    """Searches that ended before: `fitting.design.resume.KeptSearches`."""

    def known(self, want: Want, start: Floats) -> Trial | None:
        """The search from a start, if it has ended."""

    def add(self, want: Want, trial: Trial) -> None:
        """Keep one that has."""


def search(
    problem: Problem,
    progress: Callable[[int, float], None] = lambda done, goal: None,
    workers: Executor | None = None,
    kept: Kept | None = None,
) -> Found:
    """Search from every start; `progress` hears how many are done, and the best goal so far.

    Raises ValueError: no start leads to a design that keeps the limits.
    """
    want = problem.want
    sampler = qmc.LatinHypercube(len(want.variables), seed=want.seed)
    starts = [want.start, *sampler.random(want.starts - 1)]
    trials = keeping(want, best_first(problem, want, starts, progress, workers, kept))
    best = trials[0]
    agreeing = sum(abs(t.goal / best.goal - 1) < _AGREE for t in trials)
    start = next(t.first for t in trials if np.array_equal(t.start, starts[0]))
    calls = sum(t.calls for t in trials)
    held = tuple(_prices(want, best))
    before = worst(want, start)
    return Found(best.x, best.goal, start, before, tuple(trials), held, agreeing, calls)


def best_first(
    problem: Problem,
    want: Want,  # what is wanted of the problem's figures
    starts: Iterable[Floats],
    progress: Callable[[int, float], None] = lambda done, goal: None,
    workers: Executor | None = None,
    kept: Kept | None = None,
) -> list[Trial]:
    """Searches from starts, the best first; those whose design breaks a limit come last."""
    sign = -1.0 if want.maximise else 1.0
    trials: list[Trial] = []
    run = (partial if workers is None else in_float64)(_tried, problem, want)
    starts = list(starts)
    before = [None if kept is None else kept.known(want, start) for start in starts]
    missing = [s for s, trial in zip(starts, before, strict=True) if trial is None]
    anew = iter(map(run, missing) if workers is None else workers.map(run, missing))
    for trial in before:
        if trial is None:
            trial = next(anew)
            if kept is not None:
                kept.add(want, trial)
        trials.append(trial)
        progress(len(trials), sign * min(sign * t.goal for t in trials))
    return sorted(trials, key=lambda t: (np.isnan(t.goal), sign * t.goal))


def keeping(want: Want, trials: list[Trial]) -> list[Trial]:
    """The same searches. Raises ValueError: none of them keeps the limits; says how near."""
    if np.isfinite(trials[0].goal):
        return trials
    missed = [_missed(want, t.last) for t in trials if t.last.found]
    nearest = [max(limits) for limits in missed if limits]
    why = min(nearest)[1] if nearest else "; ".join(dict.fromkeys(t.message for t in trials))
    raise ValueError(
        f"no design within the bounds keeps the limits from any start: {why}; "
        "widen a bound, relax a limit, or try more starts"
    )


def _missed(want: Want, outcome: Outcome) -> list[tuple[float, str]]:
    """Limits that a design does not keep: by what share, and in words."""
    found = []
    for limit in want.limits:
        share, word = _row(limit, outcome)[0], WORDS[limit.key]
        if not share.min() > -_KEPT:
            value = float(outcome.values[limit.key][share.argmin()])
            side = "at least" if limit.least else "at most"
            needed = "asked for"
            if isinstance(limit, OwnLimit):
                needed = f"needed, which {limit.purpose}"
            text = (
                f"the {word.title.lower()} is {word.told(value)} in the design that comes "
                f"nearest, {side} {word.told(limit.value)} is {needed}"
            )
            found.append((-float(share.min()), text))
    return found


def _tried(problem: Problem, want: Want, start: Floats) -> Trial:
    return _Program(problem, want).solve(start)


def worst(want: Want, outcome: Outcome) -> float:
    """The goal of a design; NaN where a state was not found."""
    if not outcome.found:
        return float("nan")
    values = outcome.values[want.goal]
    return float(values.min() if want.maximise else values.max())


class _EndedError(Exception):
    """Ends a search that gets nowhere; says why."""


class _Program:
    """One search: the problem as SciPy takes it, variables and t."""

    def __init__(self, problem: Problem, want: Want) -> None:
        self.problem, self.want = problem, want
        self._last: tuple[Floats, Outcome] | None = None
        self._known: Outcome | None = None
        self._scale = 1.0
        self._calls = self._lost = 0
        self._best: tuple[float, Floats, Outcome] | None = None  # goal and design, limits kept

    def solve(self, start: Floats) -> Trial:
        """Search from a start, or from where towards the skin file's own design a state is."""
        begin = start
        for _ in range(_BEGINNINGS):
            first = self._outcome(begin)
            if first.found or np.array_equal(start, self.want.start):
                break
            begin = (begin + self.want.start) / 2
        none = np.zeros(0)
        if not first.found:
            why = "the start has no state, or its taxels do not tell a figure"
            return Trial(start, start, float("nan"), why, none, first, first, self._calls)
        self._scale, self._lost = _scale(self.want, first), 0
        try:
            x, why, multipliers = self._minimised(begin, first)
            last = self._outcome(x)
            goal = self._kept_goal(last)
        except _EndedError as ended:
            x, why, multipliers, last, goal = begin, str(ended), none, first, float("nan")
        if np.isnan(goal) and self._best is not None:
            (goal, x, last), multipliers = self._best, none
        return Trial(start, x, goal, why, multipliers, first, last, self._calls)

    def _minimised(self, start: Floats, first: Outcome) -> tuple[Floats, str, Floats]:
        """Variables of the end, how it ended, and multipliers of all constraints there."""
        t = worst(self.want, first) / self._scale
        sign = -1.0 if self.want.maximise else 1.0
        gradient = np.append(np.zeros(len(start)), sign)
        found = scipy.optimize.minimize(
            lambda z: (sign * z[-1], gradient),
            np.append(start, t),
            jac=True,
            method="SLSQP",
            bounds=[*((0.0, 1.0) for _ in start), (None, None)],
            constraints={
                "type": "ineq",
                "fun": lambda z: self._constraints(z)[0],
                "jac": lambda z: self._constraints(z)[1],
            },
            options={"maxiter": _STEPS, "ftol": self.problem.tolerance},
        )
        x = np.clip(found.x[:-1], 0.0, 1.0)
        return x, str(found.message), np.asarray(found.multipliers)

    def _kept_goal(self, outcome: Outcome) -> float:
        """The goal of a design; NaN where it breaks a limit or a state was not found."""
        kept = outcome.found and _limits(self.want, outcome)[0].min(initial=1.0) > -_KEPT
        return worst(self.want, outcome) if kept else float("nan")

    def _outcome(self, x: Floats) -> Outcome:
        if self._last is not None and np.array_equal(self._last[0], x):
            return self._last[1]
        if self._lost >= _LOST:
            raise _EndedError(f"was ended beside {_LOST} designs that buckle or have no state")
        if self._calls >= _TRIED * (len(x) + 1):
            raise _EndedError(f"was ended after {self._calls} designs")
        outcome = self.problem(np.clip(x, 0.0, 1.0))
        self._last = (np.array(x), outcome)
        self._calls += 1
        self._lost += not outcome.found
        goal, sign = self._kept_goal(outcome), -1.0 if self.want.maximise else 1.0
        if np.isfinite(goal) and (self._best is None or sign * goal < sign * self._best[0]):
            self._best = goal, np.clip(x, 0.0, 1.0), outcome
        return outcome

    def _constraints(self, z: Floats) -> tuple[Floats, Floats]:
        """All of them with t; a design without a state looks worse than the last with one."""
        outcome = self._outcome(z[:-1])
        excess = 0.0 if outcome.found else 1.0
        if outcome.found:
            self._known = outcome
        assert self._known is not None
        goal, by_goal = _goals(self.want, self._known, self._scale)
        sign = -1.0 if self.want.maximise else 1.0
        limits, by_limits = _limits(self.want, self._known)
        values = np.concatenate([goal + sign * z[-1], limits]) - excess
        rows = np.concatenate([by_goal, by_limits])
        by_t = np.concatenate([np.full(len(goal), sign), np.zeros(len(limits))])
        return values, np.column_stack([rows, by_t])


def _scale(want: Want, first: Outcome) -> float:
    """What a search divides the goal by: its size at the start."""
    return abs(worst(want, first)) or 1.0


def _prices(want: Want, trial: Trial) -> Iterator[Price]:
    """What holds the design that a search found."""
    if not trial.multipliers.size:  # of a search that was ended, which has none
        return
    x, outcome, scale = trial.x, trial.last, _scale(want, trial.first)
    goals, by_goal = _goals(want, outcome, scale)
    limits, by_limits = _limits(want, outcome)
    goal = abs(trial.goal) / scale
    own = trial.multipliers[len(goals) :]  # the first are those of the goal's places
    row = 0
    for limit in want.limits:
        for k in range(len(outcome.values[limit.key])):
            if limits[row] < _ACTIVE and own[row] > 0:
                purpose = limit.purpose if isinstance(limit, OwnLimit) else ""
                price = float(own[row] / goal)
                yield Price(limit.key, limit.least, limit.value, k, price, purpose)
            row += 1
    # Of the Lagrangian at a bound: what a step across it would gain.
    pull = trial.multipliers @ np.concatenate([by_goal, by_limits])
    for i, variable in enumerate(want.variables):
        for side, value in ((0.0, variable.low), (1.0, variable.high)):
            if abs(x[i] - side) < _ACTIVE and pull[i] != 0:
                yield Price(variable.name, side == 0.0, value, None, float(abs(pull[i]) / goal))


def _goals(want: Want, outcome: Outcome, scale: float) -> tuple[Floats, Floats]:
    """The goal at every place over a scale, signed so that t is on the other side."""
    size = scale if want.maximise else -scale
    return outcome.values[want.goal] / size, outcome.slopes[want.goal] / size


def _limits(want: Want, outcome: Outcome) -> tuple[Floats, Floats]:
    """Limits, zero or more where they are kept, and their derivatives."""
    values, slopes = [np.zeros(0)], [np.zeros((0, len(want.variables)))]
    for limit in want.limits:
        value, slope = _row(limit, outcome)
        values.append(value)
        slopes.append(slope)
    return np.concatenate(values), np.concatenate(slopes)


def _row(limit: Limit, outcome: Outcome) -> tuple[Floats, Floats]:
    """One limit over the places."""
    slope = outcome.slopes[limit.key] / limit.value
    return limit.margin(outcome.values[limit.key]), slope if limit.least else -slope
