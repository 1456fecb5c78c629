"""The equilibrium path: states at growing loads, or oil pressures, one after the other.

Each state is continued from the one before. After a failure, and once a membrane that no wall
holds has gone beyond a given one, the last state is repeated.
"""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from suas_jax.equilibrium.balance import Problem, State
from suas_jax.equilibrium.continuation import LoadStepping
from suas_jax.equilibrium.equilibrium import Equilibrium, equilibrium, smallest_gap
from suas_jax.equilibrium.load_path import follow, settled
from suas_jax.mechanics.base import AbstractMechanics
from suas_jax.numerics.array_types import StationVector
from suas_jax.numerics.bordered_solve import BorderedVector
from suas_jax.skin.wall import Wall

# How far a path without a wall goes beyond it, relative to its length per angle.
_BEYOND = 1e-4


def beyond_wall(
    mechanics: AbstractMechanics, q: StationVector, wall: Wall
) -> Bool[Array, " lane"]:
    """Whether a membrane that no wall holds has gone too far beyond a given one."""
    return smallest_gap(mechanics, q, wall) < -_BEYOND * wall.geometry.wall_size


def path(
    problem: Problem,  # membrane, oil and loads; one lane
    levels: Float[Array, " point"],
    start: State | None = None,  # equilibrium to start from; at rest where not given
    end: Wall | None = None,
) -> Equilibrium:
    """Equilibria along a path of loads, each continued from the one before.

    `levels`: factors on the loads or, where the problem has a wanted oil pressure, oil
    pressures [Pa], of one sign, in the order to visit. `end`: a wall at which a membrane that
    no wall holds has gone too far: the first state beyond it is the last, and is repeated.
    Returns equilibria with a leading axis over the points. After a failure the last state is
    repeated with the failure's result.
    """
    stepping = LoadStepping()
    pressures = problem.oil_pressure is not None

    def visit(carry: tuple[State, Array, Array], level: Array) -> tuple[Any, Equilibrium]:
        state, failed, beyond = carry
        finished = (failed != 0) | beyond
        level = jnp.broadcast_to(level, state.factor.shape)
        if pressures:
            careful = dataclasses.replace(stepping, largest_step=1.0)
            y = BorderedVector(state.q, state.factor)
            given = jnp.array(True)
            root = follow(
                problem, y, state.pressure, level, careful, given, near=True, finished=finished
            )
            found = Equilibrium.of(problem, root)
            found = found._replace(state=found.state._replace(pressure=found.level))
        else:
            border = state.pressure if problem.oil.trapped else None
            y = BorderedVector(state.q, border)
            root = follow(
                problem,
                y,
                state.factor,
                level,
                stepping,
                near=True,
                finished=finished,
                rest=begin,
            )
            found = Equilibrium.of(problem, root)
        result = jnp.where(failed != 0, failed, found.result)
        state = jax.tree.map(lambda a, b: jnp.where(failed != 0, a, b), state, found.state)
        if end is not None:
            beyond = beyond | beyond_wall(problem.mechanics, state.q, end)
        return (state, result, beyond), found._replace(state=state, result=result)

    rest = problem.mechanics.rest()
    zero = jnp.zeros(rest.shape[-1:], rest.dtype)
    result = jnp.zeros(rest.shape[-1:], jnp.int32)
    if start is None:
        start = State(rest, zero, zero)
    begin = None
    if problem.prestressed and not pressures:
        idle = start.factor == 0
        found = settled(problem, rest.shape[-1], stepping, ~idle)
        own = State(found.y.stations, found.border, zero)
        start = jax.tree.map(lambda a, b: jnp.where(idle, a, b), own, start)
        begin, result = found.y, jnp.where(idle, found.result, result).astype(result.dtype)
    if pressures:  # From rest the first one is reached by growing loads.

        def first() -> tuple[State, Array]:
            wanted = dataclasses.replace(problem, oil_pressure=zero + levels[0])
            found = equilibrium(wanted)
            return found.state, found.result.astype(result.dtype)

        at_rest, given = jnp.all(start.factor == 0), (start, result)
        start, result = jax.lax.cond(at_rest, first, lambda: given)
    return jax.lax.scan(visit, (start, result, jnp.zeros_like(result, bool)), levels)[1]
