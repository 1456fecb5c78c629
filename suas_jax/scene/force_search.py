"""The travels at which bodies that are pressed or pulled along by a force carry it.

Forces grow with travels close to a power law: Newton's method in the logarithms of both (of
travels their arcsinh, as other loads may bulge the skin towards a body), with Broyden's
derivatives; those across the approach, which friction carries, as shares of it.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Array

from suas_jax.config import SceneSpec
from suas_jax.equilibrium.balance import State
from suas_jax.equilibrium.outcomes import index_of
from suas_jax.numerics.lanes import number
from suas_jax.scene.build import Inputs
from suas_jax.scene.travel import (
    FIRST,
    LEAST,
    LONGEST,
    POWER,
    Driven,
    Solved,
    driven_by_force,
    on_the_way,
)

_TOLERANCE = 1e-11  # of a force
_LOOSE = 1e-9  # where rounding leaves no more
_MOST_RUNS = 60
_WIDER = 1.25  # growth of the longest step from run to run, once one has led too far
_PROBE, _ACROSS = 1e-3, 0.3  # drag to learn from, and longest step of it, in thicknesses
_LEVEL = 1e-3  # least share of the normal force that a thickness of drag is taken to add
_SETTLED = 0.1  # largest error of forces along the approach, over those across
# Steps of bodies that are found together, their halvings, the longest one and the travel that
# tells slopes, in thicknesses.
_MOST_TOGETHER, _HALVINGS, _FARTHEST, _PROBED = 30, 6, 1.0, 1e-3
# The same travel across, over that; the error below which drags are found so, too: points turn
# to where they are dragged one by one, which differences of far runs do not tell.
_FINER, _NEAR, _LEAST_FORCE = 1e-2, 0.1, 1e-300
_PATIENCE = 12  # runs without progress after which a body slides, or goes no further
# Longest step ahead on a plane through known states, over those between these; and least width
# of what spans it, over the longest.
_AHEAD, _PLANE = 2.0, 1e-2
_CLOSER = 0.9  # of the span between two drags, which is progress, too


class _Search(NamedTuple):
    """What is sought: travels, as numbers of the size of one, for forces, likewise."""

    driven: list[Driven]
    wanted: np.ndarray
    length: float

    @classmethod
    def of(
        cls, driven: list[Driven], inputs: Inputs, length: float
    ) -> "tuple[_Search, np.ndarray]":
        """A search, and the numbers of the travels to begin with."""
        wanted = np.array([number(inputs[d.path(d.force)]) for d in driven])
        known = np.array([number(inputs.get(d.path(d.travel), 0.0)) / length for d in driven])
        search = cls(driven, wanted, length)
        begin = np.arcsinh(np.where(known, known, FIRST) / LEAST)
        return search, np.where(search.across, known, begin)

    @property
    def across(self) -> np.ndarray:
        """Which are across the approach."""
        return np.array([d.across for d in self.driven], bool)

    def gone(self, x: np.ndarray) -> np.ndarray:
        """Travels from the numbers, in lengths."""
        return np.where(self.across, x, LEAST * np.sinh(np.where(self.across, 0.0, x)))

    def travels(self, x: np.ndarray) -> dict[str, np.ndarray]:
        """Inputs of the program from the numbers."""
        return {
            d.path(d.travel): np.asarray(self.length * v)
            for d, v in zip(self.driven, self.gone(x), strict=True)
        }

    def apart(self, report: dict[str, Any]) -> np.ndarray | None:
        """How far the forces are from those wanted; None where a body does not touch."""
        loads = report["loads"]
        pressed = [number(loads[d.load]["force_N"]) for d in self.driven]
        if not all(force > 0 for force in pressed):
            return None
        found = [d.of(report, d.force) for d in self.driven]
        return np.array(
            [
                (f - w) / n if d.across else np.log(f / w)
                for d, f, w, n in zip(self.driven, found, self.wanted, pressed, strict=True)
            ]
        )

    def ends(
        self, x: np.ndarray, y: np.ndarray, known: tuple[np.ndarray, np.ndarray], settled: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        """Numbers known to be too small and too large, after one more run.

        `x`: its numbers. `y`: its errors. `known`: the ends before it. `settled`: whether the
        forces along the approach are nearly as wanted.
        """
        # Forces across grow with the drag, in a straight line until points slide; that of one
        # body grows with its travel, at once much faster where the wall is reached.
        grows = (self.across & settled) | (len(x) == 1)
        low = np.where(grows & (y < 0), x, known[0])
        high = np.where(grows & (y > 0), x, known[1])
        # A force that falls with the travel for a while says which end holds no longer. One
        # across that falls as points slide has what is wanted between the two all the same.
        crossed = ~self.across & (low >= high)
        low = np.where(crossed & (y > 0), -np.inf, low)
        return low, np.where(crossed & (y < 0), np.inf, high)

    def stepped(
        self,
        x: np.ndarray,
        step: np.ndarray,
        ends: tuple[np.ndarray, np.ndarray],
        slow: bool,  # whether the last step has left much of the error
        trust: float,  # share of the longest step
    ) -> np.ndarray:
        """A step no longer than what is trusted, between those known to be too far.

        Of one travel that are ends, and their middle does where a step was slow. Those of
        several have been ends beside what the others were then, and serve where one was slow.
        """
        most = trust * np.array([_ACROSS if d.across else LONGEST for d in self.driven])
        new, (low, high) = x + np.clip(step, -most, most), np.sort(ends, 0)
        outside = (new <= low) | (new >= high)
        outside = outside | slow if len(x) == 1 else outside & slow
        known = np.isfinite(low) & np.isfinite(high)
        middle = (np.where(known, low, 0.0) + np.where(known, high, 0.0)) / 2
        return np.where(outside & known & (step != 0), middle, new)


def under_forces(
    scene: SceneSpec,
    inputs: Inputs,  # travels among them are where to begin
    start: State,
    run: Callable[[Inputs, State], Solved],
    *,
    # end with a run whose face lies in a wall that is left out before bodies carry their forces
    until_wall: bool = False,
    # end with a first run that fails: its travels are those of a solution on another mesh
    refined: bool = False,
    # derivatives of the errors by the numbers of the travels, from another mesh: a search
    # writes its own into the outcome
    slopes: np.ndarray | None = None,
) -> Solved:
    """Solve a scene whose bodies carry given forces, by runs with given travels."""
    every = driven_by_force(scene)
    none = {d.path(d.travel): np.zeros(()) for d in every}
    loaded = [d for d in every if d.across or number(inputs[d.path(d.force)]) > 0]
    search, x = _Search.of(loaded, inputs, scene.geometry.mean_thickness)
    across = search.across
    best: tuple[float, Solved, np.ndarray] | None = None
    before: tuple[np.ndarray, np.ndarray] | None = None
    past: list[tuple[np.ndarray, State]] = []
    known, idle = slopes is not None, 0  # given slopes serve so far; runs without progress
    slope = np.diag(np.where(across, 0.0, POWER)) if slopes is None else slopes
    unprobed = [] if known else [k for k, d in enumerate(loaded) if d.across]
    low, high = np.full(len(x), -np.inf), np.full(len(x), np.inf)
    # step before a force is known, share of the longest after it; last failure
    pace, trust, blocked = 0.0, 1.0, index_of("no_convergence")
    for _ in range(_MOST_RUNS):
        gone = search.gone(x)
        near = _begun(scene, past, gone, start, across)
        found = run({**inputs, **none, **search.travels(x)}, near)
        pushed = [d for d in every if d not in loaded and d.of(found[0], d.force) > 0]
        if pushed:  # by a skin that comes out to meet them: they are taken away
            none |= {d.path(d.travel): np.asarray(-scene.geometry.width) for d in pushed}
            continue
        y = search.apart(found[0])
        failure = int(number(found[-1]["result"]))
        if failure != 0 or y is None:
            blocked = failure or blocked
            if failure and refined and best is None:
                return found
            idle += best is not None
            if idle > _PATIENCE:
                break
            # Not touched yet, or too far at once; once both are known, between the two.
            pace = _pace(pace, failed=failure != 0)
            if before is None:
                x = np.where(across, x, x + pace)
            else:
                x, trust = (x + before[0]) / 2, trust / 2
            continue
        if until_wall and number(found[0]["wall_contact"]) and (y[~across] < 0).all():
            return found
        error = float(np.max(np.abs(y), initial=0.0))
        past = [*past[-len(x) :], (gone, found[3])]
        idle = 0 if best is None or error < 0.98 * best[0] else idle + 1
        slow = best is not None and error > best[0] / 2
        known, trust = known and not slow, min(1.0, _WIDER * trust)
        if best is None or error < best[0]:
            best = error, found, y
        elif best[0] < _LOOSE:
            break
        if error < _TOLERANCE or idle > _PATIENCE:
            break
        if before is not None:
            dx, dy = x - before[0], y - before[1]
            if not dx.any():  # ends that rounding no longer parts
                break
            slope = slope + np.outer(dy - slope @ dx, dx) / (dx @ dx)
        before = x, y
        # What a drag does is judged where the forces along the approach are as wanted: they
        # change it as much.
        missed = np.abs(y)
        settled = missed[~across].max(initial=0.0) <= _SETTLED * missed[across].max(initial=0.0)
        span = high - low
        low, high = search.ends(x, y, (low, high), settled)
        # With two drags each changes both forces: closer ends of one are no progress.
        if across.sum() == 1 and (high - low < _CLOSER * span)[across]:
            idle = 0
        free = ~across | settled | known
        probe = next((k for k in unprobed if free[k] and slope[k, k] == 0), None)
        if probe is None:
            unbounded = across & ~(np.isfinite(low) & np.isfinite(high)) & ~known
            x = search.stepped(x, _step(slope, y, free, unbounded), (low, high), slow, trust)
        else:  # what a drag does is not known yet
            unprobed.remove(probe)
            x = x - np.copysign(_PROBE, y[probe]) * np.eye(len(x))[probe]
    if best is None:
        return found
    best[1][-1]["slopes"] = slope
    fixed = {**inputs, **none}
    return _ended(search, best, blocked, lambda gone, near: run({**fixed, **gone}, near))


def _pace(before: float, *, failed: bool) -> float:
    """The next step where no force is known: inwards until bodies touch, back if too far."""
    way = -1.0 if failed else 1.0
    return way * (abs(before) or 1.0) * (0.5 if way * before < 0 else 1.0)


def _begun(
    scene: SceneSpec,
    past: list[tuple[np.ndarray, State]],  # see `_ahead`
    gone: np.ndarray,  # likewise
    start: State,
    across: np.ndarray,
) -> State:
    """Where a run begins: near what is known, a lone body on its way from there."""
    near, there = _ahead(past, gone) if past else (start, gone)
    # The depth of one that is pressed by a force stands before its drags.
    if len(scene.bodies) == 1 and not across.all() and gone[0]:
        near = on_the_way(scene, near, there[0] / gone[0])
    return near


def _ahead(
    past: list[tuple[np.ndarray, State]],  # travels, in lengths, and states found there
    gone: np.ndarray,  # travels that are wanted
) -> tuple[State, np.ndarray]:
    """What lies next to them on the plane through the last ones: a state and its travels."""
    last = past[-1][0]
    rows = np.array([x - last for x, _ in past[:-1]]).reshape(-1, len(gone))
    size = np.abs(rows).max(0, initial=0.0)
    size[size == 0] = 1.0
    shares = np.linalg.lstsq((rows / size).T, (gone - last) / size, rcond=_PLANE)[0]
    if not (np.abs(shares) <= _AHEAD).all():
        shares = 0 * shares

    def between(*x: Array) -> Array:
        return x[-1] + sum(s * (a - x[-1]) for s, a in zip(shares, x[:-1], strict=True))

    return jax.tree.map(between, *(state for _, state in past)), last + shares @ rows


def _ended(
    search: _Search,
    best: tuple[float, Solved, np.ndarray],  # error, solution, errors of the forces
    blocked: int,  # index of the outcome where the search went no further
    run: Callable[[Mapping[str, np.ndarray], State], Solved],  # by travels
) -> Solved:
    """What a search has found, or why it has not."""
    error, found, y = best
    if error <= _LOOSE:
        return found
    if len(y) > 1 and (error < _NEAR or not search.across.any()):
        together = _together(search, found, run)
        if together is not None:
            return together
    slides = (search.across & (np.abs(y) == error)).any()
    found[-1]["result"] = np.asarray([index_of("sliding") if slides else blocked])
    return found


def _together(
    search: _Search, found: Solved, run: Callable[[Mapping[str, np.ndarray], State], Solved]
) -> Solved | None:
    """A solution where forces depend on one another's travels more than on their own.

    The skin that one dents meets the other: forces are nearly alike unless the travels are far
    apart, one of them perhaps negative, where no logarithm goes. Newton's method in travels and
    forces themselves, by differences, from the best of the search; None where it fails.
    """
    driven, wanted, length = search
    probed = _PROBED * np.where(search.across, _FINER, 1.0)

    def missed(report: dict[str, Any]) -> np.ndarray:
        apart = np.array([d.of(report, d.force) for d in driven]) - wanted
        pressed = [number(report["loads"][d.load]["force_N"]) for d in driven]
        return apart / np.maximum(np.where(search.across, pressed, wanted), _LEAST_FORCE)

    def at(gone: np.ndarray) -> tuple[Solved, np.ndarray]:
        rows = zip(driven, length * gone, strict=True)
        there = run({d.path(d.travel): np.asarray(x) for d, x in rows}, found[3])
        lost = number(there[-1]["result"]) != 0
        return there, np.full(len(gone), np.inf) if lost else missed(there[0])

    gone = np.array([d.of(found[0], d.travel) for d in driven]) / length
    y = missed(found[0])
    for _ in range(_MOST_TOGETHER):
        probes = [at(gone + row)[1] for row in np.diag(probed)]
        slope = (np.stack(probes, 1) - y[:, None]) / probed
        if not np.isfinite(slope).all() or np.linalg.matrix_rank(slope) < len(y):
            return None
        step = -np.linalg.solve(slope, y)
        step *= min(1.0, _FARTHEST / np.abs(step).max())
        for share in 0.5 ** np.arange(_HALVINGS):
            there, its = at(gone + share * step)
            if np.abs(its).max() < np.abs(y).max():
                break
        else:
            break
        found, gone, y = there, gone + share * step, its
        if np.abs(y).max() < _TOLERANCE:
            break
    return found if np.abs(y).max() < _LOOSE else None


def _step(
    slope: np.ndarray,  # derivatives of the forces' errors by the numbers of the travels
    y: np.ndarray,  # these errors
    free: np.ndarray,  # whether a travel may change
    unbounded: np.ndarray,  # whether it is a drag whose ends are not known, which has to rise
) -> np.ndarray:
    """Newton's step; a drag whose ends are not known goes where its force has to change."""
    rising = np.where(unbounded, np.maximum(slope.diagonal(), _LEVEL), slope.diagonal())
    matrix = slope + np.diag(rising - slope.diagonal())

    def solved() -> np.ndarray:
        step = np.zeros(len(y))
        # Derivatives that differences have learnt may be singular.
        step[free] = np.linalg.lstsq(matrix[np.ix_(free, free)], -y[free])[0]
        return step

    step = solved()
    # Where points slide, a little drag changes nothing: derivatives are those of other travels.
    slides = unbounded & (step * y > 0)
    if slides.any():
        matrix[slides] = matrix[:, slides] = 0.0
        matrix[slides, slides] = rising[slides]
        step = solved()
    return step
