"""From one load to another: along the path of equilibria, and on to the wall.

Without contact one run of `LoadStepping` does it. The wall is stiff and its contact zones
are tiny, so Newton's method finds them only from nearby: the load goes on against a soft
wall first, which is then stiffened at the full load, step by step, to its own law. A start
close to the solution, such as the last point of a curve, is tried as it is before; if that
fails, the path begins at rest.
"""

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Int

from suas_jax.equilibrium.balance import Problem, State, border_of, residual
from suas_jax.equilibrium.continuation import LoadStepping
from suas_jax.equilibrium.outcomes import index_of
from suas_jax.numerics.array_types import LaneCounts, Lanes, StationVector
from suas_jax.numerics.bordered_solve import BorderedBlockTridiagonal, BorderedVector

# Shares of the rigid limit's stiffness that the wall goes through. Longer strides (30, 100)
# save little and lose some of the scenes.
_STIFFENING = (1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0)
# Wanted error of a state against a softer wall, relative to the displacement.
_SOFT_RTOL = 1e-5


class Found(NamedTuple):
    """Where the path has led, and how; every entry has a lane axis.

    Attributes:
        y: the state, an equilibrium.
        level: its load level.
        result: index of the outcome.
        iterations: Newton corrections taken.
        smallest_pivot: smallest relative pivot met.
    """

    y: BorderedVector
    level: Lanes
    result: Int[Array, " lane"]
    iterations: LaneCounts
    smallest_pivot: Lanes

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

    solution: optx.Solution = optx.root_find(
        fn,  # type: ignore[arg-type]
        stepping,
        y,
        args=((problem, pressure_given), (target, start), problem.mechanics),
        has_aux=True,
        max_steps=stepping.max_steps,
        throw=False,
    )
    end = solution.state
    result = jnp.where(end.done, end.result, index_of("max_steps"))
    return Found(end.good, end.good_level, result, end.total, end.smallest_pivot)


def follow(
    problem: Problem,
    y: BorderedVector,
    start: Lanes,
    target: Lanes,
    stepping: LoadStepping,
    pressure_given: Bool[Array, ""] | None = None,
    *,
    near: bool,
    finished: Bool[Array, " lane"] | None = None,
) -> Found:
    """Follow the path, to the wall and on if the membrane has one.

    Args:
        problem: membrane, oil and loads.
        y: equilibrium to start from.
        start: its load level.
        target: level to reach.
        stepping: settings of the load stepping.
        pressure_given: see `balance.residual`.
        near: whether the start may be close enough for Newton's method as it is.
        finished: lanes that stay where they are.
    """
    if problem.mechanics.wall is None:
        stepping = dataclasses.replace(stepping, finished=finished)
        return step_to(problem, y, start, target, stepping, pressure_given)
    factors = np.array(((1.0,) if near else ()) + _STIFFENING)
    attempt = np.array(((True,) if near else ()) + (False,) * len(_STIFFENING))
    none = jnp.zeros(target.shape, jnp.int32)
    begin = Found(y, start, none, none, jnp.full_like(target, jnp.inf))
    if finished is None:
        finished = jnp.zeros(target.shape, bool)
    stages = (jnp.asarray(factors), jnp.asarray(attempt))
    goals = jnp.where(finished, start, target)
    return _stiffened(problem, begin, goals, stages, stepping, pressure_given, finished)


_Standing = tuple[Found, Lanes, Bool[Array, " lane"]]


def _stiffened(
    problem: Problem,
    begin: Found,
    target: Lanes,
    stages: tuple[Array, Array],
    stepping: LoadStepping,
    pressure_given: Bool[Array, ""] | None,
    finished: Bool[Array, " lane"],
) -> Found:
    """One wall after another, from the state and level that the last one has left.

    Args:
        problem: membrane, oil and loads.
        begin: where to start.
        target: level to reach.
        stages: of each wall, the share of the rigid limit's stiffness, and whether it is
            but an attempt, whose first failure leads back to rest and to the next wall.
        stepping: settings of the load stepping.
        pressure_given: see `balance.residual`.
        finished: lanes that stay where they are.
    """
    wall = problem.mechanics.wall
    assert wall is not None
    rest = BorderedVector(problem.mechanics.rest(), None)

    def stage(carry: _Standing, settings: tuple[Array, Array]) -> tuple[_Standing, None]:
        before, goal, finished = carry
        factor, attempt = settings
        careful = dataclasses.replace(
            stepping,
            rtol=jnp.where(factor < 1, _SOFT_RTOL, stepping.rtol),
            smallest_radius=jnp.where(attempt, jnp.inf, stepping.smallest_radius),
            finished=finished,
        )
        mechanics = problem.mechanics.with_wall(wall.softened(factor))
        softer = dataclasses.replace(problem, mechanics=mechanics)
        after = step_to(softer, before.y, before.level, goal, careful, pressure_given)
        failed = ~attempt & (after.result != 0)
        # A limit point of the load is no failure to find the state before it.
        stuck = failed & (after.result != index_of("limit_point"))
        result = jnp.where(failed & (before.result == 0), after.result, before.result)
        solved = attempt & (after.result == 0)
        y, level = after.y, after.level
        if pressure_given is None:
            # Under given loads the path from rest is always there; under a given pressure it
            # has no beginning, and the last equilibrium has to do.
            begin = (rest if y.border is None else rest._replace(border=0 * level), 0 * level)
            y, level = jax.tree.map(
                lambda a, b: jnp.where(attempt & ~solved, a, b), begin, (y, level)
            )
        after = Found(
            y,
            level,
            result,
            before.iterations + after.iterations,
            jnp.minimum(before.smallest_pivot, after.smallest_pivot),
        )
        goal = jnp.where(attempt, goal, after.level)
        return (after, goal, finished | solved | stuck), None

    return jax.lax.scan(stage, (begin, target, finished), stages)[0][0]


def from_rest_to_pressure(
    problem: Problem, rest: StationVector, wanted: Lanes, careful: LoadStepping
) -> Found:
    """Reach an oil pressure from rest.

    At rest the pressure is stationary in the load factor, so two stages are needed: away
    from rest under growing loads until the pressure has the wanted sign, then along the
    pressure with the factor unknown. Both run through one loop, traced once.
    """
    wall = problem.mechanics.wall
    soft = problem
    if wall is not None:
        mechanics = problem.mechanics.with_wall(wall.softened(jnp.asarray(_STIFFENING[0])))
        soft = dataclasses.replace(problem, mechanics=mechanics)

    def stage(carry: State, pressure_given: Bool[Array, ""]) -> tuple[State, Found]:
        stations, pressure, factor = carry
        border = jnp.where(pressure_given, factor, pressure)
        level = jnp.where(pressure_given, pressure, factor)
        stepping = dataclasses.replace(
            careful,
            first_radius=jnp.where(pressure_given, careful.first_radius, 0.5),
            largest_step=jnp.where(pressure_given, careful.largest_step, jnp.inf),
            until=lambda y: ~pressure_given & (border_of(y) * jnp.sign(wanted) > 0),
        )
        target = jnp.where(pressure_given, wanted, 1e30)
        y = BorderedVector(stations, border)
        found = step_to(soft, y, level, target, stepping, pressure_given)
        other, level = found.border, found.level
        factor = jnp.where(pressure_given, other, level)
        pressure = jnp.where(pressure_given, level, other)
        return State(found.y.stations, pressure, factor), found

    start = State(rest, jnp.zeros_like(wanted), jnp.zeros_like(wanted))
    _, found = jax.lax.scan(stage, start, jnp.array([False, True]))
    failed = jnp.any(found.result != 0, 0)
    last = jax.tree.map(lambda x: x[-1], found)
    last = last._replace(
        result=jnp.where(failed, index_of("unreachable_pressure"), 0),
        iterations=jnp.sum(found.iterations, 0),
        smallest_pivot=jnp.min(found.smallest_pivot, 0),
    )
    if wall is None:
        return last
    rest_of_stages = jnp.asarray(_STIFFENING[1:])
    stages = (rest_of_stages, jnp.zeros(rest_of_stages.shape, bool))
    given = jnp.array(True)
    return _stiffened(problem, last, last.level, stages, careful, given, failed)
