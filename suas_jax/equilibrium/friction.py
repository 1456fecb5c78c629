"""Friction under bodies: equilibria whose bounds of friction are their own.

Coulomb's bound grows with the pressure, so its forces have no potential, and the tangent no
symmetry. At a given bound they have both. So the bound is taken from the last equilibrium,
round by round, which contracts by about the coefficient of friction. Derivatives are those of
the whole, from a series of solves with the symmetric tangent (`solve_near`).
"""

import dataclasses
import functools
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from suas_jax.equilibrium.balance import Problem, State
from suas_jax.equilibrium.equilibrium import Equilibrium, equilibrium
from suas_jax.equilibrium.outcomes import index_of
from suas_jax.mechanics.base import AbstractMechanics
from suas_jax.numerics.array_types import Lanes

_TOLERANCE = 1e-10  # of the sum of the bounds
# Where contact is stiff against the skin, as on thin ones, the bound follows the last digits of
# the state and never comes to rest within the tolerance: below this share of the sum, a change
# that has ceased to fall is theirs.
_NOISE = 1e-7
_MOST_ROUNDS = 80


def equilibrium_with_friction(problem: Problem, start: State) -> Equilibrium:
    """The equilibrium connected to the undeformed state, or to a given one.

    Without friction it is `equilibrium`'s.

    `start`: an equilibrium to continue from; where the factor is zero, rest.
    """
    mechanics = problem.mechanics
    if not mechanics.has_friction:
        return equilibrium(problem, start)

    def solve(held: AbstractMechanics, state: State) -> Equilibrium:
        return equilibrium(dataclasses.replace(problem, mechanics=held), state)

    def go(at: tuple[Any, ...]) -> tuple[Any, ...]:
        held, before, last, ended, rounds = at
        after = solve(held, before.state)
        count = before.iterations + after.iterations
        new = mechanics.gripped(after.state.q, after.state.factor)
        apart = _apart(held, new)
        settled = (apart <= _TOLERANCE) | ((apart <= _NOISE) & (apart >= last))
        return new, after._replace(iterations=count), apart, ended | settled, rounds + 1

    def going(at: tuple[Any, ...]) -> Array:
        _, found, _, ended, rounds = at
        return jnp.any(~ended & (found.result == 0)) & (rounds < _MOST_ROUNDS)

    held = mechanics.gripped(start.q, start.factor)
    shape = jax.eval_shape(solve, held, start)
    begin = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shape)._replace(state=start)
    far = jnp.full(start.factor.shape, jnp.inf)
    start_at = held, begin, far, jnp.zeros(far.shape, bool), jnp.zeros((), int)
    _, found, _, ended, _ = jax.lax.while_loop(going, go, start_at)
    lost = (found.result == 0) & ~ended
    return found._replace(result=jnp.where(lost, index_of("no_convergence"), found.result))


def _apart(a: AbstractMechanics, b: AbstractMechanics) -> Lanes:
    """Largest change of a body's bounds, relative to their sum."""
    changes = []
    for old, new in zip(a.bodies, b.bodies, strict=True):
        if old.grip is None or new.grip is None:
            continue
        axes = tuple(range(new.grip.bound.ndim - 1))
        whole = jnp.sum(new.grip.bound, axes)
        change = jnp.sum(jnp.abs(new.grip.bound - old.grip.bound), axes)
        changes.append(change / jnp.where(whole > 0, whole, 1.0))
    return functools.reduce(jnp.maximum, changes)
