"""Whether a state that Newton's method ended at is one that a membrane can be in.

Newton's method looks at the size of its corrections alone. A correction that jumps over the
pole of a law's energy, or through a fibre of no length, can end at a root of the equations that
is not a state at all. So every state found is judged once more by itself.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from suas_jax.equilibrium.balance import Problem, State, forces_in_balance, volume_residual
from suas_jax.equilibrium.outcomes import PATH_ENDS, index_of
from suas_jax.mechanics.base import AbstractMechanics, largest
from suas_jax.numerics.array_types import Lanes, StationVector
from suas_jax.skin.wall import SoftLayer

# Of the forces that balance one another, and of the film's volume. Rounding alone leaves
# 2e-9 of a load a tenth of a degree from a clamp, where elements are shortest.
_UNBALANCED = 1e-8
# On a wall, whose stiffness meets Newton's last correction: 1e-12 of the displacement of a soft
# membrane, 7e-15 m, left 1.2e-6.
_UNBALANCED_ON_A_WALL = 1e-5
# What is left of a state that has come back to rest, as when a body leaves the skin [N, N/m].
_NOTHING = 1e-60
_VOLUME = 1e-9
# Of a thickness: how deep a body lies over an edge, which no load takes away from it.
ON_CLAMP = 1e-3


def room_for_bodies(problem: Problem) -> tuple[Int[Array, " lane"], Bool[Array, " lane"]]:
    """What the travels of bodies say before anything is solved.

    `problem`: membrane with bodies at full travel, wall, oil and loads.
    Returns the index of the outcome where no membrane can be in equilibrium: a body lies on a
    clamped edge, or reaches into the wall. And whether less than the membrane's thickness is
    left between a body and the wall.
    """
    mechanics, rest = problem.mechanics, problem.mechanics.rest()
    thickness = mechanics.length_scale
    lost, tight = jnp.zeros(thickness.shape, jnp.int32), jnp.zeros(thickness.shape, bool)
    wall = mechanics.wall
    for body in mechanics.bodies:
        there = mechanics.touched(rest, body.placed(1.0))
        if wall is not None:
            layer = wall.law.thickness if isinstance(wall.law, SoftLayer) else 0.0
            room = wall.geometry.gap(there.angle, there.axial) + layer + thickness
            # Points deeper in a body than its radius are near its other side again.
            left = jnp.minimum(jnp.min(room + there.gap, (0, 1)), body.tip_over(wall, layer))
            lost = jnp.where(left < 0, index_of("squeezed"), lost)
            tight |= left < thickness
        deep = there._replace(gap=there.gap + ON_CLAMP * thickness)
        lost = jnp.where(deep.on_clamp, index_of("body_on_clamp"), lost)
    return lost, tight


def validity(
    problem: Problem,
    state: State,  # claimed to be its equilibrium
    forces: tuple[Lanes, Lanes],
    stretch_min: Lanes,  # smallest stretch of a fibre
    energy: Lanes,  # strain energy
    in_domain: Bool[Array, " lane"],
) -> Int[Array, " lane"]:
    """Judge a state: finite, in the law's domain, with length left, in balance.

    `forces`: the largest that nothing balances, and the size of those that balance.
    `in_domain`: whether the law has an energy on both faces, which lie outside of the points
    that the strain energy is a sum over.
    Returns the index of the outcome: zero where the state is valid, else what is wrong with it.
    """
    error, scale = forces
    allowed = _UNBALANCED_ON_A_WALL if problem.mechanics.touches else _UNBALANCED
    volume = jnp.abs(volume_residual(problem, state))
    found = jnp.zeros(error.shape, jnp.int32)
    # The last that applies names the state: an energy that is none explains the rest.
    for wrong, name in (
        (~(volume <= _VOLUME), "volume_not_kept"),
        (~(error <= allowed * scale + _NOTHING), "unbalanced"),
        (~(stretch_min > 0), "inverted"),
        (~(jnp.isfinite(energy) & in_domain), "outside_material_domain"),
    ):
        found = jnp.where(wrong, index_of(name), found)
    return found


def final_result(
    result: Int[Array, " lane"], verdict: Int[Array, " lane"]
) -> Int[Array, " lane"]:
    """The outcome of a solve, judged.

    A path ends where skin slips off a tip that is sharper than its mesh resolves.

    `result`: index of how the solve ended. `verdict`: index of what its state is.
    """
    ended = jnp.isin(result, jnp.array([index_of(name) for name in PATH_ENDS]))
    slipped = ended & (verdict == index_of("sharp_body"))
    return jnp.where((result == 0) | slipped, verdict, result)


def force_balance(problem: Problem, state: State) -> tuple[Lanes, Lanes]:
    """Largest force that nothing balances, and the size of those that balance."""
    net = state.pressure - state.factor * problem.external_pressure
    a = problem.mechanics.assemble(state.q, net, state.factor)
    return largest(a.residual), forces_in_balance(problem, state, a)


def kept_in_domain(
    mechanics: AbstractMechanics, q: StationVector, result: Int[Array, " lane"]
) -> Int[Array, " lane"]:
    """The outcome of a solve, unless a face lies beyond the law's limit.

    Energies are summed up between the faces, where a membrane is strained most.

    `q`: the unknowns found. `result`: index of the outcome.
    """
    if not mechanics.law.has_limit:
        return result
    inside = mechanics.shape(jax.lax.stop_gradient(q)).in_domain(mechanics.law)
    lost = (result == 0) & ~inside
    return jnp.where(lost, index_of("outside_material_domain"), result)
