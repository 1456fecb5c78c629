"""Friction under bodies: equilibria whose bounds of friction are their own.

Coulomb's bound grows with the pressure, so its forces have no potential, and the tangent no
symmetry. At a given bound they have both. So the bound is taken from the last equilibrium,
round by round. A round leaves about the coefficient of friction of the change of the bound;
beneath a rough body that is dragged it leaves four fifths, and the next round goes on along the
line through the last two. Derivatives are those of the whole, by GMRES that is
preconditioned with the symmetric tangent (`solve_near`).
"""

import dataclasses
import functools
from collections.abc import Iterable
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
# Rounds go on along the line through the last two where the bound changes by less than this, as
# points come into touch before, and where they leave more than this share of the change; by at
# most so many times the last step.
_NEAR, _SLOW, _FAR = 0.1, 0.3, 20.0


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
        held, before, last, ended, rounds, missed = at
        after = solve(held, before.state)
        count = before.iterations + after.iterations
        new = mechanics.gripped(after.state.q, after.state.factor)
        apart = _apart(held, new)
        settled = (apart <= _TOLERANCE) | ((apart <= _NOISE) & (apart >= jnp.max(last, 0)))
        slow = (apart < _NEAR) & (apart > _SLOW * last[1])
        ahead, missed = _ahead(held, new, missed, slow)
        after, last = after._replace(iterations=count), jnp.stack([last[1], apart])
        return ahead, after, last, ended | settled, rounds + 1, missed

    def going(at: tuple[Any, ...]) -> Array:
        _, found, _, ended, rounds, _ = at
        return jnp.any(~ended & (found.result == 0)) & (rounds < _MOST_ROUNDS)

    held = mechanics.gripped(start.q, start.factor)
    shape = jax.eval_shape(solve, held, start)
    begin = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shape)._replace(state=start)
    far = jnp.full((2, *start.factor.shape), jnp.inf)
    none = [(x, 0 * x) for x in _bounds(held)]
    start_at = held, begin, far, jnp.zeros(far.shape[1:], bool), jnp.zeros((), int), none
    _, found, _, ended, _, _ = jax.lax.while_loop(going, go, start_at)
    lost = (found.result == 0) & ~ended
    return found._replace(result=jnp.where(lost, index_of("no_convergence"), found.result))


def _bounds(mechanics: AbstractMechanics) -> list[Array]:
    """Bounds of friction of the bodies that have any [N]."""
    return [body.grip.bound for body in mechanics.bodies if body.grip is not None]


def _sum(arrays: Iterable[Array]) -> Lanes:
    """Sum over bodies and points, lane by lane."""
    return functools.reduce(jnp.add, [jnp.sum(x, tuple(range(x.ndim - 1))) for x in arrays])


def _ahead(
    held: AbstractMechanics,  # with the bounds of a round
    new: AbstractMechanics,  # with those of the state that it found
    before: list[tuple[Array, Array]],  # of the last round: bounds found, less those held
    slow: Array,  # whether the bounds found are not near enough
) -> tuple[AbstractMechanics, list[tuple[Array, Array]]]:
    """Bounds for the next round, by Anderson's method of depth one, and what it needs then."""
    found = _bounds(new)
    missed = [x - y for x, y in zip(found, _bounds(held), strict=True)]
    turns = [x - y for x, (_, y) in zip(missed, before, strict=True)]
    square = _sum(x**2 for x in turns)
    back = _sum(x * y for x, y in zip(missed, turns, strict=True))
    back = jnp.clip(back / jnp.where(square > 0, square, 1.0), -_FAR, 0.5)
    back = jnp.where(slow, back, 0.0)
    ahead = iter(
        jnp.maximum(x - back * (x - y), 0.0) for x, (y, _) in zip(found, before, strict=True)
    )
    bodies = [
        b if b.grip is None else b.holding(b.grip._replace(bound=next(ahead)))
        for b in new.bodies
    ]
    return new.with_bodies(bodies), list(zip(found, missed, strict=True))


def _apart(a: AbstractMechanics, b: AbstractMechanics) -> Lanes:
    """Largest change of a body's bounds, relative to their sum."""
    changes = []
    for old, new in zip(_bounds(a), _bounds(b), strict=True):
        whole = _sum([new])
        changes.append(_sum([jnp.abs(new - old)]) / jnp.where(whole > 0, whole, 1.0))
    return functools.reduce(jnp.maximum, changes)
