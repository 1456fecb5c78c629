"""The equations of equilibrium, and what they say about a state.

At a state of balance the membrane's internal forces, the oil's net pressure and the loads
cancel, and the enclosed volume is the one that the oil's law gives::

    f(u) - (p - a p_e) dV/du - a w(u) = 0,     V_oil(p) - V(u) = 0

with the pressure p, the external pressure p_e and the factor a on the loads w.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from suas_jax.mechanics.base import AbstractMechanics
from suas_jax.numerics.array_types import Lanes, StationVector
from suas_jax.numerics.bordered_solve import BorderedBlockTridiagonal, BorderedVector, eliminate
from suas_jax.skin.oil import AbstractOil


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


def residual(
    problem: Problem,
    y: BorderedVector,
    level: Lanes,
    pressure_given: Bool[Array, ""] | None = None,
    tangent_level: Lanes | None = None,
) -> tuple[BorderedVector, BorderedBlockTridiagonal]:
    """Residual of the equilibrium at a load level and its derivative.

    Args:
        problem: membrane, oil, loads.
        y: displacement and border unknown.
        level: factor on the loads where they are given, oil pressure [Pa] where that is.
        pressure_given: where true the level is the pressure and the border unknown the
            factor; None if that is nowhere so.
        tangent_level: level at which the derivative is taken, if not the residual's own.

    Returns:
        The residual and the operator that is its derivative by y.
    """
    mechanics, oil = problem.mechanics, problem.oil
    external = problem.external_pressure

    def controls(level: Lanes) -> tuple[Lanes, Lanes]:
        """Oil pressure and load factor."""
        if y.border is None:
            return jnp.zeros_like(level), level
        if pressure_given is None:
            return y.border, level
        given = pressure_given
        return jnp.where(given, level, y.border), jnp.where(given, y.border, level)

    pressure, factor = controls(level)
    if tangent_level is None:
        a = mechanics.assemble(y.stations, pressure - factor * external, factor)
        force = a.residual
    else:
        at_pressure, at_factor = controls(tangent_level)
        a = mechanics.assemble(y.stations, at_pressure - at_factor * external, at_factor)
        more = factor - at_factor
        more_pressure = pressure - at_pressure - more * external
        force = a.residual - more_pressure * a.volume_gradient - more * a.load
    if y.border is None:
        operator = BorderedBlockTridiagonal(a.tangent, None, None)
        return BorderedVector(force, None), operator
    film = mechanics.film_volume
    defect = oil.expansion(pressure, film) - a.volume_change
    by_pressure, compliance = -a.volume_gradient, oil.compliance(pressure, film)
    if pressure_given is None:
        operator = BorderedBlockTridiagonal(a.tangent, by_pressure, compliance)
    else:
        by_factor = external * a.volume_gradient - a.load
        column = jnp.where(pressure_given, by_factor, by_pressure)
        corner = jnp.where(pressure_given, 0.0, compliance)
        operator = BorderedBlockTridiagonal(a.tangent, column, corner, row=by_pressure)
    return BorderedVector(force, defect), operator


def border_of(y: BorderedVector) -> Lanes:
    """The border unknown of a state; zero, as a vented oil's pressure, where there is none."""
    return jnp.zeros(y.stations.shape[-1:]) if y.border is None else y.border


class Verification(NamedTuple):
    """What the tangent at a state says under given loads.

    Attributes:
        stable: positive tangent on the constraint surface.
        correction: the state after one more Newton correction.
        omitted: change of the state, to first order, by the energy that the mechanics
            leaves out; None where it leaves out nothing.
    """

    stable: Bool[Array, " lane"]
    correction: State
    omitted: State | None


def verify(problem: Problem, state: State) -> Verification:
    """Test the stability of a state and how far it is from equilibrium.

    Args:
        problem: membrane, oil and loads, possibly on a finer mesh than the state's.
        state: the state to check.
    """
    border = state.pressure if problem.oil.trapped else None
    r, operator = residual(problem, BorderedVector(state.q, border), state.factor)
    inertia = 1 if problem.oil.trapped else 0

    def moved(change: BorderedVector) -> State:
        return State(
            state.q - change.stations, state.pressure - border_of(change), state.factor
        )

    omitted = problem.mechanics.omitted_gradient(state.q)
    if omitted is None:
        solved = eliminate(operator, r)
        return Verification(solved.negative == inertia, moved(solved.solution), None)
    relaxed = BorderedVector(omitted, None if border is None else jnp.zeros_like(border))
    both = jax.tree.map(lambda *x: jnp.stack(x), r, relaxed)
    solved = jax.vmap(lambda right: eliminate(operator, right))(both)
    first, second = (jax.tree.map(lambda x, i=i: x[i], solved) for i in (0, 1))
    change = State(second.solution.stations, border_of(second.solution), state.factor)
    return Verification(first.negative == inertia, moved(first.solution), change)


def volume_residual(problem: Problem, state: State) -> Lanes:
    """Volume that the oil's law leaves unexplained, relative to the film's volume."""
    if not problem.oil.trapped:
        return jnp.zeros_like(state.pressure)
    film = problem.mechanics.film_volume
    expansion = problem.oil.expansion(state.pressure, film)
    return (problem.mechanics.volume_change(state.q) - expansion) / film
