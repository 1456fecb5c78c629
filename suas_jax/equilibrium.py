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
from jaxtyping import Array, Int, PyTree

from suas_jax._types import LaneCounts, Lanes, StationVector
from suas_jax.continuation import LoadStepping
from suas_jax.linear_solve import (
    BlockElimination,
    BorderedBlockTridiagonal,
    BorderedVector,
    eliminate,
)
from suas_jax.mechanics.base import AbstractMechanics
from suas_jax.oil import AbstractOil
from suas_jax.results import index_of

# Lanes that go through the loop together: few enough that their arrays stay in cache.
_CHUNK = 128


class Problem(eqx.Module):
    """Everything an equilibrium depends on; differentiable in every leaf.

    Attributes:
        mechanics: the membrane with its line loads.
        oil: how the oil answers.
        external_pressure: uniform pressure on the outer face above ambient [Pa].
        oil_pressure: wanted oil pressure [Pa], all loads scaled by one factor until it is
            reached; None where the loads are given as they are.
    """

    mechanics: AbstractMechanics
    oil: AbstractOil
    external_pressure: Lanes
    oil_pressure: Lanes | None = None


class State(NamedTuple):
    """Membrane unknowns, oil pressure above ambient [Pa] and factor on the loads."""

    q: StationVector
    pressure: Lanes
    factor: Lanes


class Equilibrium(NamedTuple):
    """A solved state and how it was found; every entry has a lane axis.

    Attributes:
        state: the equilibrium, or the last one before a failure.
        level: 1 where all of the load (or of the wanted pressure) is on.
        result: index of the outcome, see `suas_jax.results`.
        iterations: Newton corrections taken, retries included.
        smallest_pivot: smallest relative pivot met on the way.
    """

    state: State
    level: Lanes
    result: Int[Array, " lane"]
    iterations: LaneCounts
    smallest_pivot: Lanes


def _loads_given(
    problem: Problem, y: BorderedVector, factor: Lanes
) -> tuple[BorderedVector, BorderedBlockTridiagonal]:
    """Residual and tangent with the oil's pressure as border unknown."""
    mechanics, oil = problem.mechanics, problem.oil
    oil_pressure = jnp.zeros_like(factor) if y.border is None else y.border
    net = oil_pressure - factor * problem.external_pressure
    a = mechanics.assemble(y.stations, net, factor)
    if y.border is None:
        operator = BorderedBlockTridiagonal(a.diagonal, a.upper, None, None)
        return BorderedVector(a.residual, None), operator
    film = mechanics.film_volume
    defect = oil.expansion(oil_pressure, film) - a.volume_change
    corner = oil.compliance(oil_pressure, film)
    operator = BorderedBlockTridiagonal(a.diagonal, a.upper, -a.volume_gradient, corner)
    return BorderedVector(a.residual, defect), operator


def _pressure_given(
    problem: Problem, y: BorderedVector, oil_pressure: Lanes
) -> tuple[BorderedVector, BorderedBlockTridiagonal]:
    """Residual and tangent with the load factor as border unknown."""
    mechanics, oil = problem.mechanics, problem.oil
    factor = y.border
    net = oil_pressure - factor * problem.external_pressure
    a = mechanics.assemble(y.stations, net, factor)
    defect = oil.expansion(oil_pressure, mechanics.film_volume) - a.volume_change
    column = problem.external_pressure * a.volume_gradient - a.load
    operator = BorderedBlockTridiagonal(
        a.diagonal, a.upper, column, jnp.zeros_like(defect), row=-a.volume_gradient
    )
    return BorderedVector(a.residual, defect), operator


def residual(
    problem: Problem, y: BorderedVector, level: Lanes
) -> tuple[BorderedVector, BorderedBlockTridiagonal]:
    """Residual of the equilibrium at a load level and its derivative.

    Args:
        problem: membrane, oil, loads.
        y: displacement and border unknown.
        level: factor on the loads where they are given, oil pressure [Pa] where that is.

    Returns:
        The residual and the operator that is its derivative by y.
    """
    given = _loads_given if problem.oil_pressure is None else _pressure_given
    return given(problem, y, level)


class _Found(NamedTuple):
    y: BorderedVector
    level: Lanes
    result: Int[Array, " lane"]
    iterations: LaneCounts
    smallest_pivot: Lanes


def _step_to(
    problem: Problem, y: BorderedVector, start: Lanes, target: Lanes, stepping: LoadStepping
) -> _Found:
    """Follow the path of equilibria from one level to another, in all lanes."""

    def fn(y: BorderedVector, args: Any) -> tuple[BorderedVector, BorderedBlockTridiagonal]:
        problem, level, _ = args
        return residual(problem, y, level)

    solution = optx.root_find(
        fn,
        stepping,
        y,
        args=(problem, target, problem.mechanics.length_scale),
        options={"level": start},
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
    # The pressure grows with the square of the factor: a long step would land on the
    # branch of the opposite sign.
    stepping = dataclasses.replace(stepping, largest_step=1.0)
    if start is not None:
        y = BorderedVector(start.q, start.factor)
        return _step_to(problem, y, start.pressure, wanted, stepping)
    # At rest the pressure is stationary in the load factor: move away from it first.
    loads = dataclasses.replace(problem, oil_pressure=None)
    away = dataclasses.replace(
        stepping,
        first_radius=0.5,
        largest_step=float("inf"),
        until=lambda y: y.border * jnp.sign(wanted) > 0,
        max_steps=60,
    )
    first = _step_to(loads, BorderedVector(rest, zero), zero, zero + 1e30, away)
    found = _step_to(
        problem, BorderedVector(first.y.stations, first.level), first.y.border, wanted, stepping
    )
    unreachable = (first.result != 0) | (found.result != 0)
    return found._replace(
        result=jnp.where(unreachable, index_of("unreachable_pressure"), 0),
        iterations=first.iterations + found.iterations,
        smallest_pivot=jnp.minimum(first.smallest_pivot, found.smallest_pivot),
    )


def _merge(x: Array, batched: bool, size: int, lanes: int) -> Array:
    """Move a batch axis into the lanes; what is not batched stays shared."""
    if batched:
        x = jnp.moveaxis(x, 0, -2)
        x = jnp.broadcast_to(x, (*x.shape[:-1], lanes))
        return x.reshape(*x.shape[:-2], size * lanes)
    if x.shape[-1] == 1:
        return x
    x = jnp.broadcast_to(x[..., None, :], (*x.shape[:-1], size, lanes))
    return x.reshape(*x.shape[:-2], size * lanes)


def _find(problem: Problem, start: State | None, stepping: LoadStepping) -> _Found:
    """Solve all lanes in chunks; `jax.vmap` adds lanes instead of a batch axis."""

    @jax.custom_batching.custom_vmap
    def find(arguments: tuple[Problem, State | None]) -> _Found:
        leaves, tree = jax.tree.flatten(arguments)
        lanes = max(x.shape[-1] for x in leaves)
        if lanes <= _CHUNK:
            return _solve_lanes(*arguments, stepping)
        chunks = -(-lanes // _CHUNK)
        size = -(-lanes // chunks)

        def split(x: Array) -> Array:
            padded = jnp.concatenate([x, x[..., : chunks * size - lanes]], -1)
            return jnp.moveaxis(padded.reshape(*x.shape[:-1], chunks, size), -2, 0)

        shared = [x.shape[-1] == 1 for x in leaves]
        own = [split(x) for x, s in zip(leaves, shared, strict=True) if not s]

        def one(own: list[Array]) -> _Found:
            rest = iter(own)
            mixed = [x if s else next(rest) for x, s in zip(leaves, shared, strict=True)]
            return _solve_lanes(*jax.tree.unflatten(tree, mixed), stepping)

        found = jax.lax.map(one, own)

        def join(x: Array) -> Array:
            x = jnp.moveaxis(x, 0, -2)
            return x.reshape(*x.shape[:-2], chunks * size)[..., :lanes]

        return jax.tree.map(join, found)

    @find.def_vmap
    def _(size: int, batched: Any, arguments: Any) -> tuple[_Found, Any]:
        lanes = max(x.shape[-1 ] for x in jax.tree.leaves(arguments))
        merged = jax.tree.map(lambda x, b: _merge(x, b, size, lanes), arguments, batched[0])
        found = find(merged)

        def unmerge(x: Array) -> Array:
            return jnp.moveaxis(x.reshape(*x.shape[:-1], size, lanes), -2, 0)

        found = jax.tree.map(unmerge, found)
        return found, jax.tree.map(lambda _: True, found)

    return find((problem, start))


@eqx.filter_custom_jvp
def _root(problem: Problem, start: State | None, stepping: LoadStepping) -> _Found:
    return _find(problem, start, stepping)


@_root.def_jvp
def _(primals: Any, tangents: Any) -> tuple[_Found, _Found]:
    problem, start, stepping = primals
    t_problem, _, _ = tangents
    found = _root(problem, start, stepping)
    level = jax.lax.stop_gradient(found.level)
    _, operator = residual(problem, found.y, level)
    # The wanted pressure enters as the level.
    if problem.oil_pressure is not None:
        level = level + (problem.oil_pressure - jax.lax.stop_gradient(problem.oil_pressure))

    def at_root(problem: Problem) -> BorderedVector:
        reached = level
        if problem.oil_pressure is not None:
            fixed = jax.lax.stop_gradient(problem.oil_pressure)
            reached = level + (problem.oil_pressure - fixed)
        return residual(problem, found.y, reached)[0]

    _, change = eqx.filter_jvp(at_root, (problem,), (t_problem,))
    right = jax.tree.map(jnp.negative, change)
    dy = lx.linear_solve(operator, right, BlockElimination(), throw=False).value
    nothing = jax.tree.map(lambda _: None, found)
    return found, nothing._replace(y=dy)


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
    found = _root(problem, start, stepping or LoadStepping())
    lanes = found.level.shape
    if problem.oil_pressure is not None:
        fixed = jax.lax.stop_gradient(problem.oil_pressure)
        pressure = found.level + (problem.oil_pressure - fixed)
        state = State(found.y.stations, pressure, found.y.border)
    else:
        pressure = found.y.border
        if pressure is None:
            pressure = jnp.zeros(lanes, found.level.dtype)
        state = State(found.y.stations, pressure, found.level)
    return Equilibrium(
        state, found.level, found.result, found.iterations, found.smallest_pivot
    )


def corrected(problem: Problem, state: State) -> State:
    """One Newton correction of a state under the problem's full load.

    Args:
        problem: membrane, oil and loads.
        state: a state near the equilibrium.
    """
    if problem.oil_pressure is not None:
        y = BorderedVector(state.q, state.factor)
        r, operator = residual(problem, y, problem.oil_pressure)
        change = eliminate(operator, r).solution
        return state._replace(q=state.q - change.stations, factor=y.border - change.border)
    y = BorderedVector(state.q, state.pressure if problem.oil.trapped else None)
    r, operator = residual(problem, y, state.factor)
    change = eliminate(operator, r).solution
    if change.border is None:
        return state._replace(q=state.q - change.stations)
    return state._replace(
        q=state.q - change.stations, pressure=state.pressure - change.border
    )


class Verification(NamedTuple):
    """What the tangent at a state says.

    Attributes:
        stable: positive tangent on the constraint surface.
        volume_residual: relative to the film's volume.
        force_residual: largest unbalanced force relative to the largest load or support.
    """

    stable: Array
    volume_residual: Lanes
    force_residual: Lanes


def verify(problem: Problem, state: State) -> Verification:
    """Check an equilibrium: stability under the given loads, constraint, force balance.

    Args:
        problem: membrane, oil and loads.
        state: the state to check.
    """
    problem = dataclasses.replace(problem, oil_pressure=None)
    border = state.pressure if problem.oil.trapped else None
    r, operator = residual(problem, BorderedVector(state.q, border), state.factor)
    negative = eliminate(operator, r).negative
    volume = jnp.zeros_like(state.pressure)
    if r.border is not None:
        volume = r.border / problem.mechanics.film_volume
    axes = (0, 1)
    reference = jnp.max(jnp.abs(r.stations), axes)
    return Verification(negative == (1 if problem.oil.trapped else 0), volume, reference)
