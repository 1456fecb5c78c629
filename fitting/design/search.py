"""The best design within bounds and limits: sequential quadratic programming from many starts.

The worst place decides a goal, which is not a smooth function of the design. A further
variable t takes its place::

    minimise t   with   f_k(x) / f_0 <= t at every place k,   g_k(x) / limit >= 1

(for a goal to be large, t is maximised below every f_k). All of it is smooth, and the
multipliers say what each limit costs.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.optimize
from scipy.stats import qmc

from fitting.arrays import Floats
from fitting.design.problem import Outcome, Problem
from fitting.design.want import Limit

_STEPS, _TOLERANCE = 80, 1e-7
_KEPT = 1e-5  # share by which a limit may be missed
_ACTIVE = 1e-4  # share within which a limit counts as reached
_AGREE = 2e-3  # relative difference of goals that agree


class Trial(NamedTuple):
    """Where a search from one start ended."""

    start: Floats  # its variables, between 0 and 1
    x: Floats  # those of its end
    goal: float  # the figure there, the worst over the region; NaN where limits are not kept
    message: str  # how it ended


class Price(NamedTuple):
    """A limit or a bound that holds the design."""

    name: str  # of the figure or the variable
    least: bool  # whether it is a lower one
    value: float  # of the limit, SI; of a bound, as the file has it
    place: int | None  # index of the place; None for a bound
    # relative change of the goal by a relative change of the limit; of a bound, by the whole
    # range of the variable. Above zero where the limit makes the goal worse.
    price: float


class Found(NamedTuple):
    """The best design."""

    x: Floats  # its variables, between 0 and 1
    goal: float  # the worst over the region there
    before: float  # the same of the skin to start from, its variables moved into their bounds
    trials: tuple[Trial, ...]  # all searches, the best first
    prices: tuple[Price, ...]  # what holds it
    agreeing: int  # searches that ended with the same goal


def search(
    problem: Problem, progress: Callable[[int, float], None] = lambda done, goal: None
) -> Found:
    """Search from every start; `progress` hears how many are done, and the best goal so far.

    Raises ValueError: no start leads to a design that keeps the limits.
    """
    want = problem.want
    sampler = qmc.LatinHypercube(len(want.variables), seed=want.seed)
    starts = [want.start, *sampler.random(want.starts - 1)]
    sign = -1.0 if want.maximise else 1.0
    trials: list[Trial] = []
    programs = []
    for i, start in enumerate(starts):
        program = _Program(problem)
        trials.append(program.solve(start))
        programs.append(program)
        best = min(sign * t.goal for t in trials) if trials else np.nan
        progress(i + 1, sign * best)
    order = np.argsort([sign * t.goal for t in trials], kind="stable")  # NaN last
    best = trials[order[0]]
    if not np.isfinite(best.goal):
        raise ValueError(
            "no design within the bounds keeps the limits from any start: "
            + "; ".join(dict.fromkeys(t.message for t in trials))
            + "; widen a bound, relax a limit, or try more starts"
        )
    agreeing = sum(abs(t.goal / best.goal - 1) < _AGREE for t in trials)
    program = programs[order[0]]
    before = worst(problem, problem(want.start))
    ordered = tuple(trials[i] for i in order)
    return Found(best.x, best.goal, before, ordered, program.prices(best), agreeing)


def worst(problem: Problem, outcome: Outcome) -> float:
    """The goal of a design; NaN where a state was not found."""
    if not outcome.found:
        return float("nan")
    values = outcome.values[problem.want.goal]
    return float(values.min() if problem.want.maximise else values.max())


class _Program:
    """One search: the problem as SciPy takes it, variables and t."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self.want = problem, problem.want
        self._last: tuple[Floats, Outcome] | None = None
        self._known: Outcome | None = None
        self._scale = 1.0
        self._multipliers = np.zeros(0)

    def solve(self, start: Floats) -> Trial:
        """Search from a start."""
        first = self._outcome(start)
        if not first.found:
            return Trial(start, start, float("nan"), "a state was not found at the start")
        self._scale = abs(worst(self.problem, first)) or 1.0
        t = worst(self.problem, first) / self._scale
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
            options={"maxiter": _STEPS, "ftol": _TOLERANCE},
        )
        x = np.clip(found.x[:-1], 0.0, 1.0)
        outcome = self._outcome(x)
        kept = outcome.found and self._rows(outcome, x, 0.0)[0].min(initial=1.0) > -_KEPT
        self._multipliers = np.asarray(found.multipliers)
        goal = worst(self.problem, outcome) if kept else float("nan")
        return Trial(start, x, goal, str(found.message))

    def prices(self, trial: Trial) -> tuple[Price, ...]:
        """What holds a design that this search found."""
        x, outcome = trial.x, self._outcome(trial.x)
        places = len(self.problem.angle)
        limits, slopes = self._rows(outcome, x, 0.0)
        goal = trial.goal / self._scale
        found = []
        own = self._multipliers[places:]  # the first are those of the goal's places
        row = 0
        for limit in self.want.limits:
            for k in range(len(outcome.values[limit.key])):
                if limits[row] < _ACTIVE and own[row] > 0:
                    price = float(own[row] / goal)
                    found.append(Price(limit.key, limit.least, limit.value, k, price))
                row += 1
        # Of the Lagrangian at a bound: what a step across it would gain.
        rows = np.concatenate([self._goal_rows(outcome)[1], slopes])
        pull = self._multipliers @ rows
        for i, variable in enumerate(self.want.variables):
            for side, value in ((0.0, variable.low), (1.0, variable.high)):
                if abs(x[i] - side) < _ACTIVE and pull[i] != 0:
                    price = float(abs(pull[i]) / goal)
                    found.append(Price(variable.name, side == 0.0, value, None, price))
        return tuple(found)

    def _outcome(self, x: Floats) -> Outcome:
        if self._last is None or not np.array_equal(self._last[0], x):
            self._last = (np.array(x), self.problem(np.clip(x, 0.0, 1.0)))
        return self._last[1]

    def _goal_rows(self, outcome: Outcome) -> tuple[Floats, Floats]:
        """The goal at every place over its scale, signed so that t is on the other side."""
        sign = 1.0 if self.want.maximise else -1.0
        key = self.want.goal
        return (
            sign * outcome.values[key] / self._scale,
            sign * outcome.slopes[key] / self._scale,
        )

    def _rows(self, outcome: Outcome, x: Floats, excess: float) -> tuple[Floats, Floats]:
        """Limits, zero or more where they are kept, and their derivatives."""
        values, slopes = [np.zeros(0)], [np.zeros((0, len(x)))]
        for limit in self.want.limits:
            value, slope = _row(limit, outcome)
            values.append(value - excess)
            slopes.append(slope)
        return np.concatenate(values), np.concatenate(slopes)

    def _constraints(self, z: Floats) -> tuple[Floats, Floats]:
        """All of them with t; a design without a state looks worse than the last with one."""
        outcome = self._outcome(z[:-1])
        excess = 0.0 if outcome.found else 1.0
        if outcome.found:
            self._known = outcome
        assert self._known is not None
        goal, by_goal = self._goal_rows(self._known)
        sign = -1.0 if self.want.maximise else 1.0
        limits, by_limits = self._rows(self._known, z[:-1], excess)
        values = np.concatenate([goal + sign * z[-1] - excess, limits])
        rows = np.concatenate([by_goal, by_limits])
        by_t = np.concatenate([np.full(len(goal), sign), np.zeros(len(limits))])
        return values, np.column_stack([rows, by_t])


def _row(limit: Limit, outcome: Outcome) -> tuple[Floats, Floats]:
    """One limit over the places."""
    share = outcome.values[limit.key] / limit.value - 1
    slope = outcome.slopes[limit.key] / limit.value
    return (share, slope) if limit.least else (-share, -slope)
