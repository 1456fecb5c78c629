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

from suas_jax.equilibrium.state import State
from suas_jax.mechanics.base import AbstractMechanics, Assembly, largest
from suas_jax.numerics.array_types import LaneCounts, Lanes
from suas_jax.numerics.bordered_solve import BorderedBlockTridiagonal, BorderedVector, eliminate
from suas_jax.skin.oil import AbstractOil
from suas_jax.skin.prestress import ContainedOil


class Problem(eqx.Module):
    """Everything an equilibrium depends on; differentiable in every leaf."""

    mechanics: AbstractMechanics  # the membrane with its line loads
    oil: AbstractOil  # how the oil answers
    external_pressure: Lanes  # uniform pressure on the outer face above ambient [Pa]
    # wanted oil pressure [Pa], all loads scaled by one factor until it is reached; None where
    # the loads are given as they are
    oil_pressure: Lanes | None = None

    @property
    def prestressed(self) -> bool:
        """Whether rest is another state than the undeformed one."""
        return self.mechanics.growth is not None or isinstance(self.oil, ContainedOil)


def controls(
    y: BorderedVector, level: Lanes, pressure_given: Bool[Array, ""] | None
) -> tuple[Lanes, Lanes]:
    """Oil pressure and load factor: one is the level, the other the border unknown."""
    if y.border is None:
        return jnp.zeros_like(level), level
    if pressure_given is None:
        return y.border, level
    given = pressure_given
    return jnp.where(given, level, y.border), jnp.where(given, y.border, level)


def _defect(problem: Problem, pressure: Lanes, volume_change: Lanes) -> Lanes:
    """Volume that the oil takes up less the one that the membrane encloses."""
    return problem.oil.expansion(pressure, problem.mechanics.film_volume) - volume_change


def imbalance(
    problem: Problem,
    y: BorderedVector,
    level: Lanes,
    pressure_given: Bool[Array, ""] | None = None,
) -> BorderedVector:
    """The residual alone, for derivatives: no tangent is assembled; see `residual`.

    Under friction its derivatives are those of the whole, the bound's change among them.
    """
    pressure, factor = controls(y, level, pressure_given)
    mechanics = problem.mechanics.held(y.stations, factor)
    net = pressure - factor * problem.external_pressure
    force, volume_change = mechanics.imbalance(y.stations, net, factor)
    if y.border is None:
        return BorderedVector(force, None)
    return BorderedVector(force, _defect(problem, pressure, volume_change))


def omitted_forces(
    problem: Problem,
    y: BorderedVector,
    level: Lanes,
    pressure_given: Bool[Array, ""] | None = None,
) -> BorderedVector:
    """Derivative dE/dy of the energy that the mechanics leaves out.

    It enters the balance of forces alone: neither the volume nor the wanted pressure changes.
    """
    factor = controls(y, level, pressure_given)[1]
    gradient = problem.mechanics.omitted_gradient(y.stations, factor)
    assert gradient is not None
    return BorderedVector(gradient, None if y.border is None else jnp.zeros_like(y.border))


def residual(
    problem: Problem,
    y: BorderedVector,  # displacement and border unknown
    level: Lanes,  # factor on the loads where they are given, oil pressure [Pa] where that is
    pressure_given: Bool[Array, ""] | None = None,
    tangent_level: Lanes | None = None,
) -> tuple[BorderedVector, BorderedBlockTridiagonal]:
    """Residual of the equilibrium at a load level and its derivative.

    `pressure_given`: where true the level is the pressure and the border unknown the factor;
    None if that is nowhere so. `tangent_level`: level at which the derivative is taken, if not
    the residual's own.
    Returns the residual and the operator that is its derivative by y.
    """
    mechanics, external = problem.mechanics, problem.external_pressure
    pressure, factor = controls(y, level, pressure_given)
    if tangent_level is None:
        a = mechanics.assemble(y.stations, pressure - factor * external, factor)
        force = a.residual
    else:
        at_pressure, at_factor = controls(y, tangent_level, pressure_given)
        a = mechanics.assemble(y.stations, at_pressure - at_factor * external, at_factor)
        more = factor - at_factor
        more_pressure = pressure - at_pressure - more * external
        force = a.residual - more_pressure * a.volume_gradient - more * a.load
        if a.by_travel is not None:
            force = force - more * a.by_travel
    operator = operator_of(problem, a, None if y.border is None else pressure, pressure_given)
    if y.border is None:
        return BorderedVector(force, None), operator
    defect = _defect(problem, pressure, a.volume_change)
    return BorderedVector(force, defect), operator


def operator_of(
    problem: Problem,
    a: Assembly,  # the membrane at the state
    pressure: Lanes | None,  # of the oil; None where it is vented
    pressure_given: Bool[Array, ""] | None = None,  # see `residual`
) -> BorderedBlockTridiagonal:
    """Derivative of the residual from an assembly of the membrane."""
    if pressure is None:
        return BorderedBlockTridiagonal(a.tangent, None, None)
    by_pressure = -a.volume_gradient
    compliance = problem.oil.compliance(pressure, problem.mechanics.film_volume)
    if pressure_given is None:
        return BorderedBlockTridiagonal(a.tangent, by_pressure, compliance)
    by_factor = problem.external_pressure * a.volume_gradient - a.load
    column = jnp.where(pressure_given, by_factor, by_pressure)
    corner = jnp.where(pressure_given, 0.0, compliance)
    return BorderedBlockTridiagonal(a.tangent, column, corner, row=by_pressure)


def border_of(y: BorderedVector) -> Lanes:
    """The border unknown of a state; zero, as a vented oil's pressure, where there is none."""
    return jnp.zeros(y.stations.shape[-1:]) if y.border is None else y.border


def unknowns_of(
    problem: Problem, state: State
) -> tuple[BorderedVector, Lanes, Bool[Array, ""] | None]:
    """A state as unknowns, level and whether the pressure is what is given."""
    if problem.oil_pressure is not None:
        return BorderedVector(state.q, state.factor), state.pressure, jnp.array(True)
    border = state.pressure if problem.oil.trapped else None
    return BorderedVector(state.q, border), state.factor, None


def state_of(problem: Problem, y: BorderedVector, level: Lanes) -> State:
    """The inverse of `unknowns_of`."""
    if problem.oil_pressure is not None:
        return State(y.stations, level, border_of(y))
    return State(y.stations, border_of(y), level)


def is_stable(problem: Problem, negative: LaneCounts) -> Bool[Array, " lane"]:
    """Whether a tangent under given loads is positive where the oil keeps its volume.

    `negative`: its negative eigenvalues; the border of trapped oil brings one of them.
    """
    return negative == int(problem.oil.trapped)


class Verification(NamedTuple):
    """What the tangent at a state says under given loads."""

    stable: Bool[Array, " lane"]  # positive tangent on the constraint surface
    correction: State  # the state after one more Newton correction
    unbalanced: Lanes  # largest force that nothing balances
    balanced: Lanes  # size of the forces that balance one another; see `forces_in_balance`


def verify(
    problem: Problem, state: State, *, omitted: bool = True
) -> tuple[Verification, State | None]:
    """Test the stability of a state and how far it is from equilibrium.

    `problem`: membrane, oil and loads, possibly on a finer mesh than the state's. `omitted`:
    whether the effect of the omitted energy is wanted.
    Returns the verdict, and the change of the state, to first order, by the energy that the
    mechanics leaves out; None where it leaves out nothing.
    """
    mechanics = problem.mechanics
    trapped = problem.oil.trapped
    net = state.pressure - state.factor * problem.external_pressure
    a = mechanics.assemble(state.q, net, state.factor)
    defect = _defect(problem, state.pressure, a.volume_change) if trapped else None
    operator = operator_of(problem, a, state.pressure if trapped else None)
    right = BorderedVector(a.residual, defect)
    pull = mechanics.omitted_gradient(state.q, state.factor) if omitted else None
    change = None
    if pull is None:
        solved = eliminate(operator, right)
    else:
        relaxed = BorderedVector(pull, None if defect is None else jnp.zeros_like(defect))
        both = jax.tree.map(lambda *x: jnp.stack(x), right, relaxed)
        pair = jax.vmap(lambda right: eliminate(operator, right))(both)
        solved, second = (jax.tree.map(lambda x, i=i: x[i], pair) for i in (0, 1))
        if problem.oil_pressure is not None:  # the loads change, not the pressure
            own = operator_of(problem, a, state.pressure, jnp.array(True))
            second = eliminate(own, relaxed)
        zero = jnp.zeros_like(state.pressure)
        change = state_of(problem, second.solution, zero)
    better = State(
        state.q - solved.solution.stations,
        state.pressure - border_of(solved.solution),
        state.factor,
    )
    verdict = Verification(
        is_stable(problem, solved.negative),
        better,
        largest(a.residual),
        forces_in_balance(problem, state, a),
    )
    return verdict, change


def forces_in_balance(problem: Problem, state: State, a: Assembly) -> Lanes:
    """Size of the forces that balance one another, in the unknowns' generalised forces.

    Largest entries of the loads and of the pressures, each for itself, and the strain energy
    over the displacement (which sees loads that a clamp takes over at once), added up.
    """
    size = problem.mechanics.displacement_size(state.q)
    energy = problem.mechanics.strain_energy(state.q)
    scale = jnp.where(size > 0, energy / jnp.where(size > 0, size, 1.0), 0.0)
    scale += largest(state.factor * a.load)
    scale += largest(state.pressure * a.volume_gradient)
    if a.contact is not None:
        scale += largest(a.contact)
    return scale + largest(state.factor * problem.external_pressure * a.volume_gradient)


def volume_residual(problem: Problem, state: State) -> Lanes:
    """Volume that the oil's law leaves unexplained, relative to the film's volume."""
    if not problem.oil.trapped:
        return jnp.zeros_like(state.pressure)
    change = problem.mechanics.volume_change(state.q)
    return -_defect(problem, state.pressure, change) / problem.mechanics.film_volume
