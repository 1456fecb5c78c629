"""From one load to another: along the path of equilibria, and on to the wall.

Without contact one run of `LoadStepping` does it. The wall is stiff and its contact zones
are tiny, so Newton's method finds them only from nearby: the load goes on against a soft
wall first, which is then stiffened at the full load, stride by stride, to its own law. A start
close to the solution, such as the last point of a curve, is tried as it is before; if that
fails, the path begins at rest.
"""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool, Int

from suas_jax.equilibrium.balance import Problem, State, border_of, residual
from suas_jax.equilibrium.continuation import LoadStepping, select
from suas_jax.equilibrium.outcomes import index_of
from suas_jax.mechanics.base import AbstractMechanics
from suas_jax.numerics.array_types import LaneCounts, Lanes
from suas_jax.numerics.bordered_solve import BorderedBlockTridiagonal, BorderedVector

# Stiffness of the wall that loads come on against, as the logarithm of a share of its own;
# and the strides of that logarithm in which it is stiffened.
_SOFTEST = -5.0
_LONGEST, _SHORTEST = 1.0, 1 / 16
_HARDER = 2.0  # added to the former where the way from there is lost
_MOST_ROUNDS = 150
_GROWTH_STEPS = 4  # in which a membrane comes to its free size
_ATTEMPT, _LOAD, _STIFFEN = range(3)
# Wanted error of a state against a softer wall, relative to the displacement.
_SOFT_RTOL = 1e-5


class Found(NamedTuple):
    """Where the path has led, and how; every entry has a lane axis."""

    y: BorderedVector  # the state, an equilibrium
    level: Lanes  # its load level
    result: Int[Array, " lane"]  # index of the outcome
    iterations: LaneCounts  # Newton corrections taken
    smallest_pivot: Lanes  # smallest relative pivot met
    negative: LaneCounts  # negative eigenvalues of the bordered tangent at the state
    # of the last correction, at the state or as near to it as Newton's method was before that;
    # None where it is not at hand
    tangent: BorderedBlockTridiagonal | None = None

    @property
    def border(self) -> Lanes:
        """The border unknown; see `border_of`."""
        return border_of(self.y)


def step_to(
    problem: Problem,
    y: BorderedVector,
    start: Lanes,
    target: Lanes,
    stepping: LoadStepping,
    pressure_given: Bool[Array, ""] | None = None,
) -> Found:
    """Follow the path of equilibria from one level to another, in all lanes."""

    def fn(y: BorderedVector, args: Any) -> tuple[BorderedVector, BorderedBlockTridiagonal]:
        (problem, pressure_given), (level, tangent_level), _ = args
        return residual(problem, y, level, pressure_given, tangent_level)

    known = problem, pressure_given
    return _stepped(fn, known, problem.mechanics, y, (start, target), stepping)


def _stepped(
    fn: Callable[..., Any],
    known: Any,
    mechanics: AbstractMechanics,
    y: BorderedVector,
    levels: tuple[Lanes, Lanes],
    stepping: LoadStepping,
) -> Found:
    """Follow the roots of a function from one level to another; see `LoadStepping`."""
    start, target = levels
    solution: optx.Solution = optx.root_find(
        fn,
        stepping,
        y,
        args=(known, (target, start), mechanics),
        has_aux=True,
        max_steps=stepping.max_steps,
        throw=False,
    )
    end = solution.state
    result = jnp.where(end.done, end.result, index_of("max_steps"))
    tangent = solution.aux if mechanics.corrected else None
    return Found(
        end.good, end.good_level, result, end.total, end.smallest_pivot, end.negative, tangent
    )


def settled(
    problem: Problem,
    lanes: int,
    stepping: LoadStepping,
    finished: Bool[Array, " lane"] | None = None,  # lanes of which the rest is not wanted
) -> Found:
    """The state at rest, without loads.

    Of a skin that carries stress the undeformed state is none. The forces that would hold it
    there are taken away step by step, against a soft wall as the loads that follow. The
    membrane comes to its free size in a few such paths: held undeformed at that size at once it
    may be past buckling, from where Newton's method ends anywhere, though the skin is stable.
    """
    shape = problem.mechanics.rest()
    zero = jnp.zeros(lanes, shape.dtype)
    shape = jnp.broadcast_to(shape, (*shape.shape[:-1], lanes))
    y = BorderedVector(shape, zero if problem.oil.trapped else None)
    none = jnp.zeros(lanes, jnp.int32)
    if not problem.prestressed:
        return Found(y, zero, none, none, jnp.full_like(zero, jnp.inf), none)
    if problem.mechanics.touches:
        mechanics = problem.mechanics.softened(jnp.full(1, 10.0**_SOFTEST))
        problem = dataclasses.replace(problem, mechanics=mechanics)

    def fn(y: BorderedVector, args: Any) -> tuple[BorderedVector, BorderedBlockTridiagonal]:
        (problem, held), (level, _), _ = args
        found, operator = residual(problem, y, 0 * level)
        return jax.tree.map(lambda a, b: a - (1 - level) * b, found, held), operator

    stepping = dataclasses.replace(stepping, finished=finished)
    growth = problem.mechanics.growth

    def grown(found: Found, share: Array) -> tuple[Found, None]:
        some = problem
        if growth is not None:
            part = problem.mechanics.with_growth(jax.tree.map(lambda g: share * g, growth))
            some = dataclasses.replace(problem, mechanics=part)
        held, _ = residual(some, found.y, zero)
        ahead = _stepped(fn, (some, held), some.mechanics, found.y, (zero, zero + 1), stepping)
        total = found.iterations + ahead.iterations
        return ahead._replace(iterations=total, tangent=None), None

    begin = Found(y, zero, none, none, jnp.full_like(zero, jnp.inf), none)
    steps = 1 if growth is None else _GROWTH_STEPS
    found, _ = jax.lax.scan(grown, begin, jnp.arange(1, steps + 1) / steps)
    lost = jnp.where(found.result == 0, 0, index_of("unstable")).astype(found.result.dtype)
    return found._replace(level=zero, result=lost, tangent=None)


def follow(
    problem: Problem,
    y: BorderedVector,  # equilibrium to start from
    start: Lanes,  # its load level
    target: Lanes,  # level to reach
    stepping: LoadStepping,
    pressure_given: Bool[Array, ""] | None = None,  # see `balance.residual`
    *,
    # whether the start may be close enough for Newton's method as it is
    near: Bool[Array, "..."] | bool,
    finished: Bool[Array, " lane"] | None = None,  # lanes that stay where they are
    # where paths begin anew under given loads; None for the undeformed state
    rest: BorderedVector | None = None,
    rest_level: Lanes | float = 0.0,  # its load level
    # lanes that start at the target's own equilibrium without the wall: the wall comes in
    # softly there
    through: Bool[Array, " lane"] | None = None,
) -> Found:
    """Follow the path, to the wall and against it if the membrane has one, and under bodies."""
    if not problem.mechanics.touches:
        stepping = dataclasses.replace(stepping, finished=finished)
        return step_to(problem, y, start, target, stepping, pressure_given)
    none = jnp.zeros(target.shape, jnp.int32)
    begin = Found(y, start, none, none, jnp.full_like(target, jnp.inf), none)
    if finished is None:
        finished = jnp.zeros(target.shape, bool)
    goal = jnp.where(finished, start, target)
    phase = none + jnp.where(near, _ATTEMPT, _LOAD).astype(none.dtype)
    anew = None if rest is None else (rest, rest_level + 0 * target)
    attempt = jnp.zeros_like(target)
    if through is not None:
        attempt = jnp.where(through, _SOFTEST, attempt)
        phase = jnp.where(through, _ATTEMPT, phase).astype(phase.dtype)
    known = stepping, pressure_given
    return _to_the_wall(problem, begin, goal, phase, finished, *known, anew, attempt)


class _Standing(NamedTuple):
    """How far each lane is on its way to the wall."""

    found: Found  # the last equilibrium, with the corrections it took
    phase: LaneCounts  # an attempt as it is, loading against a soft wall, or stiffening it
    # logarithm of the stiffness, as a share of the wall's own, that loads come on against
    softest: Lanes
    reached: Lanes  # the same of the last equilibrium
    stride: Lanes  # of the next stiffening
    done: Bool[Array, " lane"]  # whether the lane has ended
    rounds: Int[Array, ""]  # of the loop


def _to_the_wall(
    problem: Problem,
    begin: Found,  # where to start
    target: Lanes,  # level to reach
    phase: LaneCounts,  # to start with
    done: Bool[Array, " lane"],  # lanes that stay where they are
    stepping: LoadStepping,
    pressure_given: Bool[Array, ""] | None,  # see `balance.residual`
    # where paths begin once more, and at which level; see `follow`
    anew: tuple[BorderedVector, Lanes] | None = None,
    # logarithm of the stiffness, as a share of the wall's own, of attempts
    attempt: Lanes | float = 0.0,
) -> Found:
    """Attempt, load and stiffen: one loop for all lanes, whatever their phase."""
    if anew is None:
        border = None if begin.y.border is None else 0 * begin.level
        anew = BorderedVector(problem.mechanics.rest(), border), 0 * begin.level

    def go(at: _Standing) -> _Standing:
        attempts, loads, stiffens = (at.phase == k for k in (_ATTEMPT, _LOAD, _STIFFEN))
        trial = jnp.minimum(at.reached + at.stride, 0.0)
        trial = jnp.where(attempts, attempt, jnp.where(loads, at.softest, trial))
        careful = dataclasses.replace(
            stepping,
            rtol=jnp.where(trial < 0, _SOFT_RTOL, stepping.rtol),
            smallest_radius=jnp.where(loads, stepping.smallest_radius, jnp.inf),
            finished=at.done,
        )
        mechanics = problem.mechanics.softened(10.0**trial)
        softer = dataclasses.replace(problem, mechanics=mechanics)
        goal = jnp.where(stiffens, at.found.level, target)
        after = step_to(softer, at.found.y, at.found.level, goal, careful, pressure_given)
        good = after.result == 0
        # What a failed attempt or stride has found is forgotten.
        kept = good | loads
        y, level = select(kept, (after.y, after.level), (at.found.y, at.found.level))
        stride = jnp.where(good, _LONGEST, at.stride / 2)
        stride = jnp.where(good & (at.stride < _LONGEST), 1.5 * at.stride, stride)
        stride = jnp.where(stiffens, jnp.minimum(stride, _LONGEST), at.stride)
        lost = stiffens & (stride < _SHORTEST)
        again = attempts & ~good
        softest = at.softest
        if pressure_given is None:
            # Under given loads the path begins anew at rest, against a stiffer wall if it
            # was lost at a softer one, where thin membranes buckle and vented arches
            # collapse. Under a given pressure it has no beginning but the start.
            harder = (lost | (loads & ~good)) & (softest < 0)
            again, lost = again | harder, lost & ~harder
            softest = jnp.where(harder, jnp.minimum(softest + _HARDER, 0.0), softest)
            stride = jnp.where(harder, _LONGEST, stride)
            y, level = select(again, anew, (y, level))
        result = jnp.where(loads, after.result, at.found.result)
        result = jnp.where(lost, index_of("no_convergence"), result).astype(after.result.dtype)
        new = _Standing(
            Found(
                y,
                level,
                result,
                at.found.iterations + after.iterations,
                jnp.minimum(at.found.smallest_pivot, after.smallest_pivot),
                after.negative,
            ),
            jnp.where(again, _LOAD, _STIFFEN).astype(at.phase.dtype),
            softest,
            jnp.where(kept & ~attempts, trial, at.reached),
            stride,
            at.done | lost | (good & (trial >= 0)),
            at.rounds,
        )
        new = new._replace(found=select(at.done, at.found, new.found))
        return new._replace(rounds=at.rounds + 1)

    def going(at: _Standing) -> Bool[Array, ""]:
        return ~jnp.all(at.done) & (at.rounds < _MOST_ROUNDS)

    softest = jnp.full_like(target, _SOFTEST)
    longest = jnp.full_like(target, _LONGEST)
    standing = _Standing(
        begin, phase, softest, softest, longest, done, jnp.zeros((), jnp.int32)
    )
    end = jax.lax.while_loop(going, go, standing)
    result = jnp.where(end.done, end.found.result, index_of("max_steps"))
    # An equilibrium against something softer is none of the skin's.
    soft = (result != 0) & (end.reached < 0)
    y, level = select(soft, (begin.y, begin.level), (end.found.y, end.found.level))
    return end.found._replace(y=y, level=level, result=result.astype(end.found.result.dtype))


def from_rest_to_pressure(
    problem: Problem, rest: State, wanted: Lanes, careful: LoadStepping
) -> Found:
    """Reach an oil pressure from rest.

    At rest the pressure may be stationary in the load factor, so two stages are needed: away
    from rest under growing loads until the pressure goes the wanted way, then along the
    pressure with the factor unknown. Both run through one loop, traced once.
    """
    wall, way = problem.mechanics.wall, jnp.sign(wanted - rest.pressure)
    soft = problem
    if wall is not None:
        mechanics = problem.mechanics.with_wall(wall.softened(jnp.full(1, 10.0**_SOFTEST)))
        soft = dataclasses.replace(problem, mechanics=mechanics)

    def stage(carry: State, pressure_given: Bool[Array, ""]) -> tuple[State, Found]:
        stations, pressure, factor = carry
        border = jnp.where(pressure_given, factor, pressure)
        level = jnp.where(pressure_given, pressure, factor)
        stepping = dataclasses.replace(
            careful,
            first_radius=jnp.where(pressure_given, careful.first_radius, 0.5),
            largest_step=jnp.where(pressure_given, careful.largest_step, jnp.inf),
            until=lambda y: ~pressure_given & ((border_of(y) - rest.pressure) * way > 0),
        )
        target = jnp.where(pressure_given, wanted, 1e30)
        y = BorderedVector(stations, border)
        found = step_to(soft, y, level, target, stepping, pressure_given)
        other, level = found.border, found.level
        factor = jnp.where(pressure_given, other, level)
        pressure = jnp.where(pressure_given, level, other)
        return State(found.y.stations, pressure, factor), found

    _, found = jax.lax.scan(stage, rest, jnp.array([False, True]))
    failed = jnp.any(found.result != 0, 0)
    last = jax.tree.map(lambda x: x[-1], found)
    last = last._replace(
        result=jnp.where(failed, index_of("unreachable_pressure"), 0),
        iterations=jnp.sum(found.iterations, 0),
        smallest_pivot=jnp.min(found.smallest_pivot, 0),
    )
    if wall is None:
        return last
    phase = jnp.full_like(last.iterations, _STIFFEN)
    given = jnp.array(True)
    last = last._replace(tangent=None)
    return _to_the_wall(problem, last, last.level, phase, failed, careful, given)
