"""Designs between two goals: none is better by one figure without being worse by the other.

The ends are the best designs by either figure. Between them the second figure becomes a limit,
whose values are spread evenly, and each search begins at the designs beside it (Haimes et al.
1971, the epsilon-constraint method)::

    best goal   with   figure >= its values between both ends   (<= where small is good)
"""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from fitting.arrays import Floats
from fitting.datasheet.words import WORDS
from fitting.design.problem import Problem
from fitting.design.search import Found, Kept, Trial, best_first, keeping, worst
from fitting.design.want import Limit

_GIVEN = 1e-3  # share of the second figure's best that the last point gives up


class FrontPoint(NamedTuple):
    """A design of the front."""

    x: Floats  # its variables, between 0 and 1
    goal: float  # the goal, the worst over the region
    other: float  # the second figure, the worst over the region


def front(
    problem: Problem,
    found: Found,  # the best design by the goal
    progress: Callable[[int], None] = lambda done: None,  # hears how many points are known
    kept: Kept | None = None,
) -> tuple[list[FrontPoint], int]:
    """The front, from the best design by the goal to the best by the second figure.

    A value between them that no search keeps is left out, and so is a design that another one
    betters by both figures. Returns how many designs were evaluated, too. Raises ValueError: no
    design keeps the limits.
    """
    want = problem.want
    assert want.front is not None
    key, points = want.front
    least = WORDS[key].least
    turned = dataclasses.replace(want, goal=key, maximise=least)

    def point(end: Trial) -> FrontPoint:
        return FrontPoint(end.x, worst(want, end.last), worst(turned, end.last))

    known = [point(found.trials[0])]
    progress(1)
    starts = [found.x, *(t.start for t in found.trials)]
    trials = keeping(turned, best_first(problem, turned, starts, kept=kept))
    far, calls = trials[0], sum(t.calls for t in trials)
    # Of all designs as good by the second figure, the best by the goal.
    values = np.linspace(known[0].other, far.goal, points)[1:]
    values[-1] = far.goal * (1 - np.sign(far.goal - known[0].other) * _GIVEN)
    last = far.x
    for value in values:
        limits = *want.limits, Limit(key, float(value), least)
        limited = dataclasses.replace(want, limits=limits)
        trials = best_first(problem, limited, [known[-1].x, last], kept=kept)
        calls += sum(t.calls for t in trials)
        if np.isfinite(trials[0].goal):
            known.append(point(trials[0]))
            progress(len(known))
    return undominated(known, maximise=want.maximise), calls


def undominated(points: list[FrontPoint], *, maximise: bool) -> list[FrontPoint]:
    """The points that no later one betters by the goal, and the first, which is best by it.

    Later points are better by the second figure. A search that ended early may have stopped
    short of a design that one under a harder limit found.
    """
    goals = np.array([point.goal for point in points]) * (-1 if maximise else 1)
    best = np.minimum.accumulate(goals[::-1])[::-1]  # from each point on
    return [p for k, p in enumerate(points) if k == 0 or goals[k] <= best[k]]
