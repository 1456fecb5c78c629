"""What the stress that a skin carries at rest does to its stiffness.

With the tangents K at rest and K0 of the same skin without stress, the eigenvalues s of

    (K0 - K) v = s K0 v

say how much softer each mode is. The largest is the stress's share of what buckles the skin,
to first order; where all modes are stiffened it is that of the one stiffened most. A few steps
of Lanczos's method, which needs one more solve with K0 each, find it.
"""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from suas_jax.equilibrium.balance import Problem, State, operator_of
from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.bordered_solve import BorderedBlockTridiagonal, BorderedVector, eliminate

_STEPS = 10
_NOTICED = 0.01  # share of the stiffening of other modes at which softening is told


class StressEffect(NamedTuple):
    """What stress at rest does."""

    share: Lanes  # of what buckles the skin; negative where it is stiffened
    stiffness_change: Lanes  # of what small loads of the given pattern meet, relative


def stress_effect(problem: Problem, rest: State) -> StressEffect:
    """Compare a skin at rest with the same one without stress.

    `problem`: membrane, oil, and the loads whose stiffness is wanted. `rest`: the state at
    rest, of the whole membrane.
    """
    trapped = problem.oil.trapped
    pressure, zero = rest.pressure, jnp.zeros_like(rest.pressure)
    stressed = problem.mechanics.with_wall(None)
    free = stressed.with_growth(None)

    def tangent(q: Array, net: Lanes, *, grown: bool) -> tuple[BorderedBlockTridiagonal, Array]:
        a = (stressed if grown else free).assemble(q, net, zero)
        operator = operator_of(
            dataclasses.replace(problem, oil_pressure=None), a, pressure if trapped else None
        )
        return operator, a.load

    own, load = tangent(rest.q, pressure, grown=True)
    fitting, _ = tangent(jnp.zeros_like(rest.q), zero, grown=False)

    def solve(operator: BorderedBlockTridiagonal, right: BorderedVector) -> BorderedVector:
        return eliminate(operator, right).solution

    border = zero if trapped else None
    pull = BorderedVector(jnp.broadcast_to(load, rest.q.shape), border)
    change = _dot(pull, solve(fitting, pull)) / _dot(pull, solve(own, pull)) - 1
    noise = jax.random.normal(jax.random.key(0), rest.q.shape[:-1])[..., None]
    start = BorderedVector(noise + jnp.zeros_like(rest.q), border)
    start = solve(fitting, _plus(fitting.mv(start), own.mv(start), -1.0))
    basis: list[BorderedVector] = []
    images: list[BorderedVector] = []
    softer: list[BorderedVector] = []
    for _ in range(_STEPS):
        for v, image in zip(basis, images, strict=True):
            start = _plus(start, v, -_dot(start, image))
        size = jnp.sqrt(jnp.abs(_dot(start, fitting.mv(start))))
        v = jax.tree.map(lambda x, size=size: x / size, start)
        basis.append(v)
        images.append(fitting.mv(v))
        softer.append(_plus(images[-1], own.mv(v), -1.0))
        start = solve(fitting, softer[-1])
    matrix = jnp.stack([jnp.stack([_dot(v, w) for w in softer], -1) for v in basis], -2)
    symmetric = (matrix + jnp.swapaxes(matrix, -1, -2)) / 2
    modes = jnp.linalg.eigvalsh(symmetric)
    least, most = modes[..., 0], modes[..., -1]
    return StressEffect(jnp.where(most > -_NOTICED * least, most, least), change)


def _dot(a: BorderedVector, b: BorderedVector) -> Lanes:
    found = jnp.sum(a.stations * b.stations, (0, 1))
    return found if a.border is None or b.border is None else found + a.border * b.border


def _plus(a: BorderedVector, b: BorderedVector, factor: Array | float) -> BorderedVector:
    return jax.tree.map(lambda x, y: x + factor * y, a, b)
