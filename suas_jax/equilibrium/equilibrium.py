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
from jaxtyping import Array, Bool, Int

from suas_jax.equilibrium.balance import (
    Problem,
    State,
    imbalance,
    is_stable,
    omitted_forces,
    residual,
    unknowns_of,
)
from suas_jax.equilibrium.continuation import LoadStepping
from suas_jax.equilibrium.load_path import Found, follow, from_rest_to_pressure, settled
from suas_jax.equilibrium.outcomes import index_of
from suas_jax.equilibrium.validity import kept_in_domain, room_for_bodies
from suas_jax.mechanics.base import AbstractMechanics
from suas_jax.numerics.array_types import LaneCounts, Lanes, StationVector
from suas_jax.numerics.bordered_solve import (
    BorderedVector,
    eliminate,
    solve_bordered,
    solve_near,
)
from suas_jax.numerics.lanes import for_some, in_chunks, on_cpu
from suas_jax.skin.wall import Wall

# Unknowns, over all lanes, that go through the loop together: few enough that the arrays
# made of them stay in cache. Measured: with 32 elements, chunks of 64 lanes took a third of
# the time per lane that chunks of 128 took. An accelerator wants all that its memory takes.
_CHUNK, _CHUNK_ACCELERATED = 8192, 2**21
# Lanes at the wall that are solved together: they differ more than free ones.
_HELD, _HELD_ACCELERATED = 4, 64


class Equilibrium(NamedTuple):
    """A solved state and how it was found; every entry has a lane axis."""

    state: State  # the equilibrium, or the last one before a failure
    level: Lanes  # 1 where all of the load (or of the wanted pressure) is on
    result: Int[Array, " lane"]  # index of the outcome, see `suas_jax.equilibrium.outcomes`
    iterations: LaneCounts  # Newton corrections taken, retries included
    smallest_pivot: Lanes  # smallest relative pivot met on the way
    # whether it is stable, see `is_stable`; without a meaning where the oil pressure is given
    stable: Bool[Array, " lane"]
    # first-order effect on the unknowns of what the mechanics leaves out, without derivatives;
    # None where it was not asked for or nothing is left out
    change: BorderedVector | None = None

    @classmethod
    def of(cls, problem: Problem, found: Found) -> "Equilibrium":
        """Name what was found. `found`: its root."""
        result = found.result
        if problem.oil_pressure is not None:
            fixed = jax.lax.stop_gradient(problem.oil_pressure)
            pressure = found.level + (problem.oil_pressure - fixed)
            state = State(found.y.stations, pressure, found.border)
            # From a rest that buckles the way leads back through it, to reversed loads.
            turned = (result == 0) & (found.border < 0)
            result = jnp.where(turned, index_of("unreachable_pressure"), result)
        else:
            state = State(found.y.stations, found.border, found.level)
        stable = is_stable(problem, found.negative)
        return cls(state, found.level, result, found.iterations, found.smallest_pivot, stable)

    @property
    def outcome(self) -> Int[Array, " lane"]:
        """The `result`, or `unstable` where it is an equilibrium that no membrane stays in."""
        left = (self.result == 0) & ~self.stable
        return jnp.where(left, index_of("unstable"), self.result).astype(self.result.dtype)


class _Root(NamedTuple):
    """What was found, and `Equilibrium.change`."""

    found: Found
    change: BorderedVector | None


def _solve_lanes(
    problem: Problem,
    start: State | None,
    stepping: LoadStepping,
    through: Bool[Array, " lane"] | None = None,
) -> Found:
    lanes = max(x.shape[-1] for x in jax.tree.leaves((problem, start)))
    going = None if start is None or problem.oil_pressure is not None else start.factor != 0
    rest = settled(problem, lanes, stepping, going)
    zero, lost = rest.level, rest.result != 0 if problem.prestressed else None
    tight = None
    if problem.mechanics.bodies and problem.oil_pressure is None:
        hopeless, tight = room_for_bodies(problem)
        rest = rest._replace(result=jnp.where(hopeless != 0, hopeless, rest.result))
        lost = rest.result != 0
    if problem.oil_pressure is None:
        y, level = rest.y, zero
        near: Bool[Array, " lane"] | bool = False
        if start is not None and going is not None:
            y = BorderedVector(start.q, None if y.border is None else start.pressure)
            level, near = start.factor, going
            if problem.prestressed:
                y = jax.tree.map(lambda a, b: jnp.where(near, a, b), y, rest.y)
        begin = rest.y if problem.prestressed else None
        found = follow(
            problem,
            y,
            level,
            zero + 1,
            stepping,
            near=near,
            finished=lost,
            rest=begin,
            through=through,
        )
        if tight is not None:
            result = jnp.where((found.result != 0) & tight, index_of("squeezed"), found.result)
            found = found._replace(result=result)
        return found if lost is None else _after(rest, found)
    wanted = jnp.broadcast_to(problem.oil_pressure, zero.shape)
    # The pressure grows with the square of the factor: a step longer than the
    # displacement could land on the branch of the opposite sign.
    careful = dataclasses.replace(stepping, largest_step=1.0)
    if start is not None:
        y = BorderedVector(start.q, start.factor)
        return follow(problem, y, start.pressure, wanted, careful, jnp.array(True), near=True)
    at_rest = State(rest.y.stations, rest.border, zero)
    found = from_rest_to_pressure(problem, at_rest, wanted, careful)
    return found if lost is None else _after(rest, found)


def _after(rest: Found, found: Found) -> Found:
    """What was found from a state at rest: nothing where there is none."""
    result = jnp.where(rest.result != 0, rest.result, found.result)
    return found._replace(result=result, iterations=found.iterations + rest.iterations)


def lanes_together(unknowns: int) -> int:
    """Lanes of one call; see `_CHUNK`. `unknowns`: of one lane."""
    return max(4, (_CHUNK if on_cpu() else _CHUNK_ACCELERATED) // unknowns)


def smallest_gap(mechanics: AbstractMechanics, q: StationVector, wall: Wall) -> Lanes:
    """Smallest gap to a wall, which needn't be the mechanics' own [m]."""
    gap = mechanics.contact(q, wall).gap
    return jnp.min(gap, tuple(range(gap.ndim - 1)))


def _solve_on_demand(
    problem: Problem, start: State | None, stepping: LoadStepping, *, omitted: bool
) -> _Root:
    """Leave the wall out where the membrane does not reach it.

    A state without the wall whose gap is open everywhere is one with it, too.
    """
    wall = problem.mechanics.wall
    free = dataclasses.replace(problem, mechanics=problem.mechanics.with_wall(None))
    root = _with_change(free, _solve_lanes(free, start, stepping), omitted=omitted)
    if wall is None:
        return root
    held = smallest_gap(free.mechanics, root.found.y.stations, wall) < 0
    through = None
    if start is None and problem.oil_pressure is None:
        start = Equilibrium.of(free, root.found).state
        through = root.found.result == 0
        start = start._replace(factor=jnp.where(through, start.factor, 0.0))

    def solve(arguments: tuple[Problem, State | None, Bool[Array, " lane"] | None]) -> _Root:
        problem, start, through = arguments
        found = _solve_lanes(problem, start, stepping, through)
        return _with_change(problem, found, omitted=omitted)

    width = _HELD if on_cpu() else _HELD_ACCELERATED
    return for_some(solve, (problem, start, through), held, root, width)


def _with_change(problem: Problem, found: Found, *, omitted: bool) -> _Root:
    """The effect of the omitted energy, by the tangent at hand if there is one."""
    operator, found = found.tangent, found._replace(tangent=None)
    if not (omitted and problem.mechanics.corrected):
        return _Root(found, None)
    given = None if problem.oil_pressure is None else jnp.array(True)
    if operator is None:
        operator = residual(problem, found.y, found.level, given)[1]
    pull = omitted_forces(problem, found.y, found.level, given)
    return _Root(found, eliminate(operator, pull).solution)


def _bounded_at(
    problem: Problem, y: BorderedVector, level: Lanes, other: BorderedVector
) -> BorderedVector:
    """The imbalance of a state whose friction is bounded as in another one."""
    mechanics = problem.mechanics.held(other.stations, level)
    return imbalance(dataclasses.replace(problem, mechanics=mechanics), y, level)


def _implicit(problem: Problem, found: Found, t_problem: Problem) -> Found:
    """Tangent of a root by the implicit function theorem."""
    level = jax.lax.stop_gradient(found.level)
    given = None if problem.oil_pressure is None else jnp.array(True)
    _, operator = residual(problem, found.y, level, given)

    def at_root(problem: Problem) -> BorderedVector:
        reached = level
        if problem.oil_pressure is not None:  # it enters as the level
            fixed = jax.lax.stop_gradient(problem.oil_pressure)
            reached = level + (problem.oil_pressure - fixed)
        return imbalance(problem, found.y, reached, given)

    value, change = eqx.filter_jvp(at_root, (problem,), (t_problem,))
    # An equation that the perturbed inputs don't enter has the tangent None.
    right = jax.tree.map(lambda v, t: jnp.zeros_like(v) if t is None else -t, value, change)
    if problem.mechanics.has_friction:
        _, by_bound = jax.linearize(lambda y: _bounded_at(problem, found.y, level, y), found.y)
        dy = solve_near(by_bound, operator, right)
    else:
        dy = solve_bordered(operator, right)
    nothing = jax.tree.map(lambda _: None, found)
    return nothing._replace(y=dy)


@eqx.filter_custom_jvp
def _root(
    problem: Problem,
    start: State | None,
    stepping: LoadStepping,
    on_demand: bool,
    omitted: bool,
) -> _Root:
    """Solve all lanes in chunks; `jax.vmap` adds lanes instead of a batch axis."""
    rest = problem.mechanics.rest()
    chunk = lanes_together(rest.size // rest.shape[-1])

    def solve(arguments: tuple[Problem, State | None]) -> _Root:
        problem, start = arguments
        if on_demand:
            return _solve_on_demand(problem, start, stepping, omitted=omitted)
        return _with_change(problem, _solve_lanes(problem, start, stepping), omitted=omitted)

    return in_chunks(solve, (problem, start), chunk)


@_root.def_jvp
def _(primals: Any, tangents: Any) -> tuple[_Root, _Root]:
    root = _root(*primals)
    along = _implicit(primals[0], root.found, tangents[0])
    return root, _Root(along, jax.tree.map(lambda _: None, root.change))


@eqx.filter_custom_jvp
def _known(problem: Problem, found: Found) -> Found:
    return found


@_known.def_jvp
def _(primals: Any, tangents: Any) -> tuple[Found, Found]:
    found = _known(*primals)
    return found, _implicit(primals[0], found, tangents[0])


def equilibrium(
    problem: Problem,
    start: State | None = None,
    stepping: LoadStepping | None = None,
    *,
    wall_on_demand: bool = False,
    omitted: bool = False,
) -> Equilibrium:
    """Find the equilibrium connected to the undeformed state (or to a given one).

    Differentiable in forward and reverse mode, to any order, by every leaf of the
    problem; `jax.vmap` over any leaf advances the batch in lanes. Never raises for a
    problem without solution: the result names the failure.

    `start`: an equilibrium of the same membrane to continue from; one at rest (factor zero) is
    where paths begin anyway. `wall_on_demand`: solve without the wall first and with it only
    where the membrane reaches it: for many lanes few of which do. `omitted`: whether the effect
    of what the mechanics leaves out is wanted, for `suas_jax.equilibrium.correction.corrected`;
    found here it costs one substitution.
    Returns the state with its outcome; derivatives flow through `state`.
    """
    stepping = stepping or LoadStepping()
    root = _root(problem, start, stepping, wall_on_demand, omitted)
    found = Equilibrium.of(problem, root.found)._replace(change=root.change)
    result = kept_in_domain(problem.mechanics, found.state.q, found.result)
    return found._replace(result=result)


def differentiable(problem: Problem, state: State) -> State:
    """Give a state that is known to be an equilibrium its derivatives, without solving.

    `problem`: membrane, oil and loads that the state belongs to. `state`: its equilibrium, as
    `equilibrium` found it.
    Returns the same state; derivatives by the problem's leaves flow through it.
    """
    y, level, _ = unknowns_of(problem, state)
    count = jnp.zeros(level.shape, jnp.int32)
    found = _known(problem, Found(y, level, count, count, level, count))
    return Equilibrium.of(problem, found).state
