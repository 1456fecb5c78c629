"""Equilibrium of membrane, loads and oil, and its exact derivatives.

The unknowns are the membrane's displacement and one border unknown: the oil's pressure
when the loads are given, the common factor on the loads when the pressure is given (the
paper's procedure). Optimistix drives Newton's method to the root; differentiation never
looks inside, it solves one more linear system with the tangent at the root::

    r(y, a) = 0   =>   dy = -(dr/dy)^-1 (dr/da) da
"""

import dataclasses
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int

from suas_jax.equilibrium.balance import Problem, State, border_of, residual
from suas_jax.equilibrium.continuation import LoadStepping
from suas_jax.equilibrium.outcomes import index_of
from suas_jax.numerics.array_types import LaneCounts, Lanes, StationVector
from suas_jax.numerics.bordered_solve import (
    BlockElimination,
    BorderedBlockTridiagonal,
    BorderedVector,
)
from suas_jax.numerics.lanes import in_chunks

# Unknowns, over all lanes, that go through the loop together: few enough that the arrays
# made of them stay in cache. Measured: with 32 elements, chunks of 64 lanes took a third of
# the time per lane that chunks of 128 took.
_CHUNK = 8192


class Equilibrium(NamedTuple):
    """A solved state and how it was found; every entry has a lane axis.

    Attributes:
        state: the equilibrium, or the last one before a failure.
        level: 1 where all of the load (or of the wanted pressure) is on.
        result: index of the outcome, see `suas_jax.equilibrium.outcomes`.
        iterations: Newton corrections taken, retries included.
        smallest_pivot: smallest relative pivot met on the way.
    """

    state: State
    level: Lanes
    result: Int[Array, " lane"]
    iterations: LaneCounts
    smallest_pivot: Lanes


class _Found(NamedTuple):
    y: BorderedVector
    level: Lanes
    result: Int[Array, " lane"]
    iterations: LaneCounts
    smallest_pivot: Lanes

    @property
    def border(self) -> Lanes:
        return border_of(self.y)


def _step_to(
    problem: Problem,
    y: BorderedVector,
    start: Lanes,
    target: Lanes,
    stepping: LoadStepping,
    pressure_given: Bool[Array, ""] | None = None,
) -> _Found:
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
    return _Found(end.good, end.good_level, result, end.total, end.smallest_pivot)


def _solve_lanes(problem: Problem, start: State | None, stepping: LoadStepping) -> _Found:
    lanes = max(x.shape[-1] for x in jax.tree.leaves((problem, start)))
    rest = problem.mechanics.rest()
    rest = jnp.broadcast_to(rest, (*rest.shape[:-1], lanes))
    zero = jnp.zeros(lanes, rest.dtype)
    if problem.oil_pressure is None:
        border = zero if problem.oil.trapped else None
        y, level = BorderedVector(rest, border), zero
        if start is not None:
            y = BorderedVector(start.q, None if border is None else start.pressure)
            level = start.factor
        return _step_to(problem, y, level, zero + 1, stepping)
    wanted = jnp.broadcast_to(problem.oil_pressure, zero.shape)
    # The pressure grows with the square of the factor: a step longer than the
    # displacement could land on the branch of the opposite sign.
    careful = dataclasses.replace(stepping, largest_step=1.0)
    if start is not None:
        y = BorderedVector(start.q, start.factor)
        return _step_to(problem, y, start.pressure, wanted, careful, jnp.array(True))
    return _from_rest_to_pressure(problem, rest, wanted, careful)


def _from_rest_to_pressure(
    problem: Problem, rest: StationVector, wanted: Lanes, careful: LoadStepping
) -> _Found:
    """Reach an oil pressure from rest.

    At rest the pressure is stationary in the load factor, so two stages are needed: away
    from rest under growing loads until the pressure has the wanted sign, then along the
    pressure with the factor unknown. Both run through one loop, traced once.
    """

    def stage(carry: State, pressure_given: Bool[Array, ""]) -> tuple[State, _Found]:
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
        found = _step_to(problem, y, level, target, stepping, pressure_given)
        other, level = found.border, found.level
        factor = jnp.where(pressure_given, other, level)
        pressure = jnp.where(pressure_given, level, other)
        return State(found.y.stations, pressure, factor), found

    start = State(rest, jnp.zeros_like(wanted), jnp.zeros_like(wanted))
    _, found = jax.lax.scan(stage, start, jnp.array([False, True]))
    failed = jnp.any(found.result != 0, 0)
    last = jax.tree.map(lambda x: x[-1], found)
    return last._replace(
        result=jnp.where(failed, index_of("unreachable_pressure"), 0),
        iterations=jnp.sum(found.iterations, 0),
        smallest_pivot=jnp.min(found.smallest_pivot, 0),
    )


def _find(problem: Problem, start: State | None, stepping: LoadStepping) -> _Found:
    """Solve all lanes in chunks; `jax.vmap` adds lanes instead of a batch axis."""
    rest = problem.mechanics.rest()
    chunk = max(4, _CHUNK * rest.shape[-1] // rest.size)

    def solve(arguments: tuple[Problem, State | None]) -> _Found:
        problem, start = arguments
        return _solve_lanes(problem, start, stepping)

    return in_chunks(solve, (problem, start), chunk)


def _implicit(problem: Problem, found: _Found, t_problem: Problem) -> _Found:
    """Tangent of a root by the implicit function theorem."""
    level = jax.lax.stop_gradient(found.level)
    given = None if problem.oil_pressure is None else jnp.array(True)
    _, operator = residual(problem, found.y, level, given)

    def at_root(problem: Problem) -> BorderedVector:
        reached = level
        if problem.oil_pressure is not None:  # it enters as the level
            fixed = jax.lax.stop_gradient(problem.oil_pressure)
            reached = level + (problem.oil_pressure - fixed)
        return residual(problem, found.y, reached, given)[0]

    value, change = eqx.filter_jvp(at_root, (problem,), (t_problem,))
    # An equation that the perturbed inputs don't enter has the tangent None.
    right = jax.tree.map(lambda v, t: jnp.zeros_like(v) if t is None else -t, value, change)
    dy = lx.linear_solve(operator, right, BlockElimination(), throw=False).value
    nothing = jax.tree.map(lambda _: None, found)
    return nothing._replace(y=dy)


@eqx.filter_custom_jvp
def _root(problem: Problem, start: State | None, stepping: LoadStepping) -> _Found:
    return _find(problem, start, stepping)


@_root.def_jvp
def _(primals: Any, tangents: Any) -> tuple[_Found, _Found]:
    found = _root(*primals)
    return found, _implicit(primals[0], found, tangents[0])


@eqx.filter_custom_jvp
def _known(problem: Problem, found: _Found) -> _Found:
    return found


@_known.def_jvp
def _(primals: Any, tangents: Any) -> tuple[_Found, _Found]:
    found = _known(*primals)
    return found, _implicit(primals[0], found, tangents[0])


def _outcome(problem: Problem, found: _Found) -> Equilibrium:
    """Name what was found."""
    if problem.oil_pressure is not None:
        fixed = jax.lax.stop_gradient(problem.oil_pressure)
        pressure = found.level + (problem.oil_pressure - fixed)
        state = State(found.y.stations, pressure, found.border)
    else:
        state = State(found.y.stations, found.border, found.level)
    return Equilibrium(state, found.level, found.result, found.iterations, found.smallest_pivot)


def equilibrium(
    problem: Problem, start: State | None = None, stepping: LoadStepping | None = None
) -> Equilibrium:
    """Find the equilibrium connected to the undeformed state (or to a given one).

    Differentiable in forward and reverse mode, to any order, by every leaf of the
    problem; `jax.vmap` over any leaf advances the batch in lanes. Never raises for a
    problem without solution: the result names the failure.

    Args:
        problem: membrane, oil and loads.
        start: an equilibrium of the same membrane to continue from.
        stepping: settings of the load stepping.

    Returns:
        The state with its outcome; derivatives flow through `state`.
    """
    return _outcome(problem, _root(problem, start, stepping or LoadStepping()))


def differentiable(problem: Problem, state: State) -> State:
    """Give a state that is known to be an equilibrium its derivatives, without solving.

    Args:
        problem: membrane, oil and loads that the state belongs to.
        state: its equilibrium, as `equilibrium` found it.

    Returns:
        The same state; derivatives by the problem's leaves flow through it.
    """
    if problem.oil_pressure is not None:
        y, level = BorderedVector(state.q, state.factor), state.pressure
    else:
        y = BorderedVector(state.q, state.pressure if problem.oil.trapped else None)
        level = state.factor
    count = jnp.zeros(level.shape, jnp.int32)
    return _outcome(problem, _known(problem, _Found(y, level, count, count, level))).state


def path(
    problem: Problem, levels: Float[Array, " point"], start: State | None = None
) -> Equilibrium:
    """Equilibria along a path of loads, each continued from the one before.

    Args:
        problem: membrane, oil and loads; one lane.
        levels: factors on the loads or, where the problem has a wanted oil pressure, oil
            pressures [Pa], of one sign, in the order to visit.
        start: equilibrium to start from; at rest where not given.

    Returns:
        Equilibria with a leading axis over the points. After a failure the last state is
        repeated with the failure's result.
    """
    stepping = LoadStepping()
    pressures = problem.oil_pressure is not None

    def visit(carry: tuple[State, Array], level: Array) -> tuple[Any, Equilibrium]:
        state, failed = carry
        level = jnp.broadcast_to(level, state.factor.shape)
        if pressures:
            careful = dataclasses.replace(stepping, largest_step=1.0)
            y = BorderedVector(state.q, state.factor)
            given = jnp.array(True)
            root = _step_to(problem, y, state.pressure, level, careful, given)
            found = _outcome(problem, root)
            found = found._replace(state=found.state._replace(pressure=found.level))
        else:
            border = state.pressure if problem.oil.trapped else None
            y = BorderedVector(state.q, border)
            found = _outcome(problem, _step_to(problem, y, state.factor, level, stepping))
        result = jnp.where(failed != 0, failed, found.result)
        state = jax.tree.map(lambda a, b: jnp.where(failed != 0, a, b), state, found.state)
        return (state, result), found._replace(state=state, result=result)

    rest = problem.mechanics.rest()
    zero = jnp.zeros(rest.shape[-1:], rest.dtype)
    result = jnp.zeros(rest.shape[-1:], jnp.int32)
    if start is None and pressures:
        first = equilibrium(dataclasses.replace(problem, oil_pressure=zero + levels[0]))
        start, result = first.state, first.result
    elif start is None:
        start = State(rest, zero, zero)
    return jax.lax.scan(visit, (start, result), levels)[1]
