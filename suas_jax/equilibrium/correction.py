"""The first-order effect of the energy that a mechanics leaves out, with its derivatives.

A thin shell is the minimum of a potential P; what it leaves out (transverse shear) would make
it the minimum of P - E. To first order in E the state changes by::

    x = K^-1 dE/dy,   K = d^2 P/dy^2

one more substitution with the tangent at hand. Its derivative by the inputs a follows from
h = dE/dy - K x = 0, held along the equilibrium::

    dx = K^-1 (dh/da da + dh/dy dy)   with x kept

where K x is the residual's directional derivative, so no tangent is differentiated.
"""

import dataclasses
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from suas_jax.equilibrium.balance import (
    Problem,
    State,
    controls,
    imbalance,
    omitted_forces,
    residual,
    state_of,
    unknowns_of,
)
from suas_jax.equilibrium.equilibrium import differentiable
from suas_jax.mechanics.base import AbstractMechanics
from suas_jax.mechanics.contact.face import BodyContact, ContactState
from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.bordered_solve import BorderedVector, solve_bordered
from suas_jax.skin.body import Body

Given = Bool[Array, ""] | None


class Corrected(NamedTuple):
    """An equilibrium, and the same with the effect of what its mechanics leaves out."""

    root: State  # the equilibrium
    state: State  # the one to report: the equilibrium itself where nothing is left out
    mechanics: AbstractMechanics  # the membrane, to read `state` with


def uncorrected(problem: Problem, state: State) -> Corrected:
    """A known equilibrium as it is, differentiable by every leaf of the problem."""
    root = differentiable(problem, state)
    return Corrected(root, root, problem.mechanics)


def corrected(problem: Problem, state: State, known: BorderedVector | None = None) -> Corrected:
    """Add the effect of what its mechanics leaves out to a known equilibrium.

    The result is differentiable by every leaf of the problem.

    `state`: their equilibrium. `known`: `Equilibrium.change`, if it has been found with the
    equilibrium.
    """
    plain = uncorrected(problem, state)
    root, mechanics = plain.root, plain.mechanics
    if not mechanics.corrected:
        return plain
    y, level, given = unknowns_of(problem, root)
    change = _change(problem, y, level, given, known)
    moved = jax.tree.map(lambda a, b: a + b, y, change)
    return Corrected(root, state_of(problem, moved, level), mechanics.around(root.q))


def _solved(
    problem: Problem, y: BorderedVector, level: Lanes, given: Given, right: BorderedVector
) -> BorderedVector:
    operator = residual(problem, y, level, given)[1]
    return solve_bordered(operator, right)


@eqx.filter_custom_jvp
def _change(
    problem: Problem,
    y: BorderedVector,
    level: Lanes,
    given: Given,
    known: BorderedVector | None,
) -> BorderedVector:
    if known is not None:
        return known
    return _solved(problem, y, level, given, omitted_forces(problem, y, level, given))


@_change.def_jvp
def _(primals: Any, tangents: Any) -> tuple[BorderedVector, BorderedVector]:
    problem, y, level, given, _ = primals
    change = _change(*primals)

    def unexplained(problem: Problem, y: BorderedVector, level: Lanes) -> BorderedVector:
        mechanics = problem.mechanics.held(y.stations, controls(y, level, given)[1])
        held = dataclasses.replace(problem, mechanics=mechanics)

        def force(y: BorderedVector) -> BorderedVector:
            return imbalance(held, y, level, given)

        along = jax.jvp(force, (y,), (change,))[1]
        return jax.tree.map(lambda a, b: a - b, omitted_forces(problem, y, level, given), along)

    value, right = eqx.filter_jvp(unexplained, (problem, y, level), tangents[:3])
    right = jax.tree.map(lambda v, t: jnp.zeros_like(v) if t is None else t, value, right)
    return change, _solved(problem, y, level, given, right)


def corrected_touch(
    mechanics: AbstractMechanics, body: Body, shown: State, root: State | None
) -> BodyContact:
    """Contact with a body: where the equilibrium has it, with a force of first order.

    To first order a zone far narrower than an element slides from point to point of the face,
    which turns the force by more than the change itself does. So the force keeps the
    equilibrium's direction; it is zero where the change would turn it round.

    `shown`: the state to report. `root`: the equilibrium, where it is another.
    """
    placed = body.placed(shown.factor)
    if root is None or not mechanics.corrected:
        return mechanics.touched(shown.q, placed)
    if body.friction is not None:  # whose bound the first-order change keeps
        placed = body.holding(mechanics.grip(root.q, placed)).placed(shown.factor)
    change, shift = shown.q - root.q, mechanics.gap_shift(root.q, placed)
    shift = jnp.zeros_like(root.pressure) if shift is None else shift

    def push(q: Array, shift: Array) -> Lanes:
        return jnp.sum(mechanics.pushed(q, placed, shift) * body.frame[-1], 0)

    own, more = jax.jvp(push, (root.q, jnp.zeros_like(shift)), (change, shift))
    share = jnp.where(own == 0, 0.0, more / jnp.where(own == 0, 1.0, own))
    ratio = jnp.maximum(1 + share, 0.0)  # bodies push
    at = mechanics.touched(root.q, placed)
    return at._replace(pressure=ratio * at.pressure, force=ratio * at.force)


def corrected_contact(
    mechanics: AbstractMechanics, shown: State, root: State | None
) -> ContactState:
    """Contact with the mechanics' own wall, to first order where the state is.

    `shown`: the state to report. `root`: the equilibrium, where it is another.
    """
    wall = mechanics.wall
    assert wall is not None
    if root is None or not mechanics.corrected:
        return mechanics.contact(shown.q, wall)
    # A wall so stiff makes much of what is of second order in a displacement.
    # The face is the one that the tangent knows, which `around` would tell apart.
    change = shown.q - root.q
    at, along = jax.jvp(lambda q: mechanics.contact(q, wall), (root.q,), (change,))
    near = jax.tree.map(lambda a, b: a + b, at, along)
    # Below zero at a point where it is: the sum balances the other forces to first order. A
    # sum below zero says that all of the contact goes with what is left out.
    pressure = jnp.where(at.gap < 0, near.pressure, 0.0)
    lasts = jnp.sum(near.area * pressure, (0, 1)) > 0
    return near._replace(pressure=jnp.where(lasts, pressure, 0.0))
