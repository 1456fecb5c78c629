"""Newton's method with adaptive load steps, as an Optimistix root finder.

The load grows from the level of the starting state to full. Every step starts with the
tangent at the last equilibrium: there the residual is linear in the load level, so the
first Newton correction is a step along the path, cut to a trusted displacement (the
radius). Newton then returns to the path; if it does not contract, the step is taken
again with a smaller radius. All lanes advance independently inside one loop.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx
from jaxtyping import Array, Bool, Int, PyTree

from suas_jax.equilibrium.outcomes import index_of
from suas_jax.mechanics.base import AbstractMechanics
from suas_jax.numerics.array_types import LaneCounts, Lanes
from suas_jax.numerics.bordered_solve import BlockElimination, BorderedVector


def _small(mechanics: AbstractMechanics) -> float:
    """Correction after which a state may count as found, relative to its displacement.

    A stiff body makes much of a small one, and may touch elsewhere after it.
    """
    return 1e-9 if mechanics.bodies else 1e-4


class SteppingState(NamedTuple):
    """Where each lane stands."""

    level: Lanes  # load level of the current trial
    base: BorderedVector  # where this step started: an equilibrium, or a state near the path
    base_level: Lanes  # its load level
    good: BorderedVector  # last equilibrium
    good_level: Lanes  # its load level
    # whether every step has to end at an equilibrium, as after a failure
    strict: Bool[Array, " lane"]
    radius: Lanes  # trusted displacement of the next step [m]
    tried: Lanes  # displacement of this step's first correction [m]
    correction: Lanes  # size of the last Newton correction [m]
    inner: LaneCounts  # Newton corrections taken in this step
    total: LaneCounts  # Newton corrections taken in all
    negative: LaneCounts  # negative eigenvalues of the tangent at the last equilibrium
    smallest_pivot: Lanes  # smallest relative pivot met
    result: Int[Array, " lane"]  # index of the outcome
    done: Bool[Array, " lane"]  # whether the lane has ended


def select(keep: Bool[Array, " lane"], a: Any, b: Any) -> Any:
    """Trees of arrays, the first where a lane is to keep it."""
    return jax.tree.map(lambda x, y: jnp.where(keep, x, y), a, b)


class LoadStepping(optx.AbstractRootFinder):
    """Newton with load steps controlled by displacement.

    `args` of the root-find is a triple: anything the function needs, the levels to reach
    and to start from, and the mechanics, which measures displacements. The function is
    called with the levels at which its residual and its tangent are wanted and returns
    ``(residual, operator)``; the residual must be affine in the level. (The tangent is
    not: a dead load has a stiffness of its own, and that of a load still far away would
    send the first step of a path astray.)
    """

    # wanted size of the remaining error relative to the displacement
    rtol: float | Array = 1e-12  # type: ignore[assignment]
    atol: float = 0.0  # not used: displacement has no scale of its own at tiny loads
    # displacement trusted in the first step, in length scales of the mechanics
    first_radius: float | Array = 4.0
    # displacement of a step relative to that of the state it starts from
    largest_step: float | Array = math.inf
    contraction: float = 5.0  # largest accepted ratio of successive corrections
    # accepted error of a state on the way, relative to the step to it
    path_tolerance: float = 1e-2
    max_inner: int = 12  # Newton corrections before a step is given up
    # step relative to the load level at which the path counts as ended
    smallest_step: float = 1e-7
    # trusted displacement, in units of the length, at which Newton's method counts as failed
    smallest_radius: float | Array = 1e-6
    max_steps: int = 400  # Newton corrections before the slowest lane is given up
    finished: Bool[Array, " lane"] | None = None  # lanes that stay as they are
    # accepts a state early (and ends the lane) where it returns true
    until: Callable[[BorderedVector], Array] | None = None
    norm: Callable[[PyTree], Array] = optx.max_norm

    def init(
        self,
        fn: Callable,
        y: BorderedVector,
        args: PyTree,
        options: dict[str, Any],
        f_struct: PyTree,
        aux_struct: PyTree,
        tags: frozenset[object],
    ) -> SteppingState:
        """Start at the equilibrium `y` of the lower level."""
        _, (target, start), mechanics = args
        length = mechanics.length_scale
        lane = y.stations.shape[-1:]
        dtype = y.stations.dtype
        zeros, counts = jnp.zeros(lane, dtype), jnp.zeros(lane, jnp.int32)
        level = jnp.broadcast_to(start, lane).astype(dtype)
        size = mechanics.displacement_size(y.stations)
        radius = jnp.maximum(self.first_radius * length, size)
        return SteppingState(
            level=jnp.broadcast_to(target, lane).astype(dtype),
            base=y,
            base_level=level,
            good=y,
            good_level=level,
            strict=jnp.zeros(lane, bool),
            radius=jnp.broadcast_to(radius, lane),
            tried=zeros,
            correction=zeros,
            inner=counts,
            total=counts,
            negative=counts,
            smallest_pivot=jnp.full(lane, jnp.inf, dtype),
            result=counts,
            done=jnp.zeros(lane, bool) if self.finished is None else self.finished,
        )

    def step(
        self,
        fn: Callable,
        y: BorderedVector,
        args: PyTree,
        options: dict[str, Any],
        state: SteppingState,
        tags: frozenset[object],
    ) -> tuple[BorderedVector, SteppingState, PyTree]:
        """One Newton correction, then accept, repeat or retry the load step."""
        problem, (target, _), mechanics = args
        length = mechanics.length_scale
        first = state.inner == 0
        tangent_level = jnp.where(first, state.base_level, state.level)
        residual, operator = fn(y, (problem, (state.level, tangent_level), mechanics))
        solved = lx.linear_solve(operator, residual, BlockElimination(), throw=False)
        cut, size, way = self._cut(mechanics, state, solved.value)
        level = state.base_level + cut * (state.level - state.base_level)
        level = jnp.where(first & (cut < 1), level, state.level)
        trial = jax.tree.map(lambda a, b: a - cut * b, y, solved.value)

        # Newton contracts quadratically: e_next ~ size^3 / previous^2.
        ratio = jnp.where(first, 1.0, size / state.correction)
        scale = mechanics.displacement_size(trial.stations)
        fine = jnp.isfinite(size) & jnp.isfinite(scale)
        if mechanics.law.has_limit:
            fine &= jnp.isfinite(mechanics.strain_energy(trial.stations))
        expected = size * jnp.minimum(ratio, 1.0) ** 2
        settled = (expected <= self.rtol * scale) & (size <= _small(mechanics) * scale)
        # At the limit of the arithmetic corrections stop shrinking.
        stagnant = ~first & (ratio > 0.25) & (size <= 1e-8 * scale)
        equilibrium = fine & (settled | stagnant | (size <= 1e-16 * length)) & (way == 0)
        # On the way it is enough to be near the path, compared with the step along it:
        # the next step's first correction starts from the residual that is left. This
        # saves a quarter of all corrections. Should it lead astray, as it may close to a
        # limit point, the lane goes back to its last equilibrium and becomes strict.
        tried = jnp.where(first, jnp.maximum(size, way), state.tried)
        near = ~first & (expected <= self.path_tolerance * tried) & (size <= 0.1 * tried)
        near = fine & near & ~state.strict & (level != target)
        inner = state.inner + 1
        converged = equilibrium | near
        grows = ~first & (ratio > self.contraction) & (size > 1e-6 * scale)
        failed = ~converged & (~fine | grows | (inner >= self.max_inner))

        # An equilibrium: make it the new start, and try for the full load.
        step = jnp.abs(level - state.base_level)
        easy, hard = inner <= jnp.where(near, 4, 5), inner >= jnp.where(near, 6, 8)
        grown = jnp.where(easy, 2.0, jnp.where(hard, 0.7, 1.2)) * state.radius
        reached = level == target
        if self.until is not None:
            reached = reached | self.until(trial)
        # The step failed: forget it and trust a quarter of its first displacement.
        shrunk = 0.25 * jnp.where(jnp.isfinite(tried), tried, state.radius)
        tiny = self.smallest_step * jnp.abs(level)
        exhausted = failed & (shrunk < self.smallest_radius * length)
        stuck = equilibrium & ~reached & (step < tiny)

        live = ~state.done
        accept, retry = live & converged, live & failed
        settle = accept & (equilibrium | reached)
        result = jnp.where(stuck, index_of("limit_point"), state.result)
        result = jnp.where(exhausted, index_of("no_convergence"), result)
        new = SteppingState(
            level=jnp.where(accept | retry, target, level),
            base=select(accept, trial, select(retry, state.good, state.base)),
            base_level=jnp.where(
                accept, level, jnp.where(retry, state.good_level, state.base_level)
            ),
            good=select(settle, trial, state.good),
            good_level=jnp.where(settle, level, state.good_level),
            strict=state.strict | retry,
            radius=jnp.where(accept, grown, jnp.where(retry, shrunk, state.radius)),
            tried=tried,
            correction=jnp.maximum(size, way),
            inner=jnp.where(accept | retry, 0, inner),
            total=state.total + 1,
            negative=jnp.where(accept, solved.stats["negative"], state.negative),
            smallest_pivot=jnp.minimum(state.smallest_pivot, solved.stats["smallest_pivot"]),
            result=result,
            done=(accept & (reached | stuck)) | (live & exhausted),
        )
        new = select(live, new, state)
        trial = select(live & ~failed, trial, new.base)
        return trial, new, operator

    def _cut(
        self, mechanics: AbstractMechanics, state: SteppingState, correction: BorderedVector
    ) -> tuple[Lanes, Lanes, Lanes]:
        """Share of a correction that is trusted; its displacement and bodies' travel then [m].

        A body that does not touch yet moves nothing: its own way is a step, too.
        """
        first = state.inner == 0
        size = mechanics.displacement_size(correction.stations)
        step = jnp.where(first, jnp.abs(state.level - state.base_level), 0.0)
        reach = jnp.maximum(size, step * mechanics.travel)
        size_of_state = mechanics.displacement_size(state.base.stations)
        relative = self.largest_step * jnp.maximum(size_of_state, 1e-300)
        radius = jnp.minimum(state.radius, relative)
        cut = jnp.where(first & (reach > 0), jnp.minimum(1, radius / reach), 1)
        return cut, cut * size, cut * step * mechanics.travel

    def terminate(
        self,
        fn: Callable,
        y: BorderedVector,
        args: PyTree,
        options: dict[str, Any],
        state: SteppingState,
        tags: frozenset[object],
    ) -> tuple[Bool[Array, ""], optx.RESULTS]:
        """Stop when every lane has ended; outcomes are kept per lane in the state."""
        return jnp.all(state.done), optx.RESULTS.successful  # type: ignore[return-value]

    def postprocess(
        self,
        fn: Callable,
        y: BorderedVector,
        aux: PyTree,
        args: PyTree,
        options: dict[str, Any],
        state: SteppingState,
        tags: frozenset[object],
        result: optx.RESULTS,
    ) -> tuple[BorderedVector, PyTree, dict[str, Any]]:
        """Return the last equilibrium of every lane."""
        return state.good, aux, {}
