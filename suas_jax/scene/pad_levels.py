"""Readings of a pad along rising loads: what a table of solved states is made of.

Each state starts from a polynomial through the ones before and, where a column beside this one
has been solved, from what that polynomial left out there: on meshes that move with the load,
states of neighbours are alike. One tangent then does for a state: it is assembled at the start
(two thirds of the cost of a correction), its factors serve the corrections that follow, the
omitted energy and derivatives by tangential forces.
"""

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from suas_jax.equilibrium.balance import Problem, State, border_of, imbalance, residual
from suas_jax.equilibrium.continuation import LoadStepping
from suas_jax.equilibrium.load_path import settled
from suas_jax.equilibrium.validity import kept_in_domain
from suas_jax.mechanics.pad.net import NetTopology
from suas_jax.mechanics.pad.net_lane import Place
from suas_jax.mechanics.pad.pad import KnownFace, Pad
from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.block_banded import BlockBanded
from suas_jax.numerics.bordered_solve import BorderedBlockTridiagonal, BorderedVector, eliminate
from suas_jax.scene.loads import Loads
from suas_jax.scene.skin import Skin
from suas_jax.sensing.taxels import DISC

# Sizes of corrections, in terms of the displacement.
_CLOSE = 1e-2  # of the first one by a state's last tangent, which then is its own to as much
_SETTLED = 1e-6  # by the last correction of all
_CONTRACTS = 0.2  # ratio of corrections by one tangent above which another is assembled
_MOST_TANGENTS, _MOST_CORRECTIONS = 12, 6  # of a state, and by one tangent


class PadReadings(NamedTuple):
    """What a pad says about its loads at several levels of them."""

    # continuous sensor output [counts]; NaN where the membrane touches the electrode
    so: Float[Array, "level taxel"]
    pressure: Float[Array, " level"]  # of the oil, above ambient [Pa]
    min_gap: Float[Array, " level"]  # smallest between membrane and wall [m]
    found: Bool[Array, " level"]  # whether the equilibrium was found
    # derivatives of `so` and, last, of the pressure by a force on the same patch along growing
    # angles, and by one along the axis [1/N]; NaN where not asked for
    across: Float[Array, "level 2 channel"]


class Ahead(NamedTuple):
    """What a column's states were ahead of where they started: where its neighbours start."""

    # rest itself, then what extrapolation left out [level and rest, ...]
    states: BorderedVector
    known: Bool[Array, ""]  # whether they are known


class _Solved(NamedTuple):
    """Where Newton's method stands."""

    y: BorderedVector
    operator: BorderedBlockTridiagonal  # the last tangent, with its factors
    first: Array  # size of the first correction by it, in terms of the displacement
    last: Array  # of the last one
    tangents: Array  # assembled so far
    done: Array  # whether the state is found


def _solved(problem: Problem, start: BorderedVector, level: Lanes) -> _Solved:
    """Newton's method from a state nearby; its factors serve as long as they contract."""
    size = problem.mechanics.displacement_size

    def corrected(
        operator: BorderedBlockTridiagonal, y: BorderedVector, r: BorderedVector
    ) -> tuple[BorderedVector, Array]:
        step = eliminate(operator, r).solution
        new = jax.tree.map(lambda a, b: a - b, y, step)
        whole = jnp.maximum(size(new.stations), jnp.finfo(float).tiny)
        return new, jnp.max(size(step.stations) / whole)

    def again(at: _Solved) -> _Solved:
        r, operator = residual(problem, at.y, level)
        operator = _with_factors(operator)
        y, first = corrected(operator, at.y, r)

        def chord(carry: tuple[Any, ...]) -> tuple[Any, ...]:
            y, _, before, count = carry
            new, now = corrected(operator, y, imbalance(problem, y, level))
            better = now < before
            y = jax.tree.map(lambda a, b: jnp.where(better, a, b), new, y)
            return y, before, now, count + 1

        def going(carry: tuple[Any, ...]) -> Array:
            _, before, now, count = carry
            contracts = (now < _CONTRACTS * before) & (first <= _CLOSE)
            return (now > _SETTLED) & contracts & (count < _MOST_CORRECTIONS)

        begin = y, jnp.full_like(first, jnp.inf), first, jnp.array(1)
        y, _, last, _ = jax.lax.while_loop(going, chord, begin)
        done = (first <= _CLOSE) & (last <= _SETTLED)
        return _Solved(y, operator, first, last, at.tangents + 1, done)

    def going(at: _Solved) -> Array:
        return ~at.done & (at.tangents < _MOST_TANGENTS)

    def tangent(y: BorderedVector) -> BorderedBlockTridiagonal:
        return _with_factors(residual(problem, y, level)[1])

    infinite = jnp.array(jnp.inf)
    empty = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(tangent, start))
    begin = _Solved(start, empty, infinite, infinite, jnp.array(0), jnp.array(False))
    return jax.lax.while_loop(going, again, begin)


def _with_factors(operator: BorderedBlockTridiagonal) -> BorderedBlockTridiagonal:
    assert isinstance(operator.tangent, BlockBanded)
    return dataclasses.replace(operator, tangent=operator.tangent.factorised())


def _responses(
    problem: Problem, loads: Loads, skin: Skin, found: _Solved, level: Lanes
) -> tuple[BorderedVector, BorderedVector]:
    """What the omitted energy changes, and tangential forces of 1 N on the patch [2, ...].

    With K the tangent and w_T the work of such a force, dq/dT = K^-1 dw_T/dq.
    """
    q = found.y.stations
    free = problem.mechanics.free[..., None]  # type: ignore[attr-defined]
    omitted = problem.mechanics.omitted_gradient(q, level)
    one, zero = jnp.ones_like(loads.force), jnp.zeros_like(loads.force)
    quarter = jnp.pi / 2 * one
    rights = [jnp.zeros_like(q) if omitted is None else omitted]
    for turn, tilt in ((quarter, zero), (zero, quarter)):
        unit = skin.problem(dataclasses.replace(loads, force=one, turn=turn, tilt=tilt))
        pad = unit.mechanics
        assert isinstance(pad, Pad)
        rights.append(jax.grad(lambda q, pad=pad: jnp.sum(pad.work(q)))(q) * free)
    border = None if found.y.border is None else jnp.zeros((3, *found.y.border.shape))
    both = BorderedVector(jnp.stack(rights), border)
    solved = jax.vmap(lambda right: eliminate(found.operator, right).solution)(both)
    first, rest = (jax.tree.map(lambda x, i=i: x[i], solved) for i in (0, slice(1, None)))
    return first, rest


def readings_along(
    skin: Skin,  # the pad, with a mesh
    loads: Loads,  # patches in one lane, with their largest forces
    levels: Float[Array, " level"],  # factors on the forces, in the order to visit
    # of the states before, rest first, in the state that the next one starts from, see
    # `extrapolation`
    weights: Float[Array, "level level"],
    # levels at which derivatives by tangential forces are wanted
    across: Bool[Array, " level"],
    ahead: Ahead,  # of columns beside this one
) -> tuple[PadReadings, BorderedVector]:
    """Readings along a path of loads that starts at rest, and what is ahead of neighbours."""
    problem = skin.problem(loads)
    more = jax.tree.map(jnp.asarray, ahead.states)
    steps = jnp.arange(-1, len(levels)), jnp.append(0.0, levels), jnp.append(False, across)
    weights = jnp.concatenate([jnp.zeros((1, len(levels))), weights])
    if problem.prestressed:  # rest is another state to visit, and takes a dozen steps to find
        rest = jax.tree.map(lambda x: x[0], more)
        rest = jax.lax.cond(
            ahead.known, lambda: rest, lambda: settled(problem, 1, LoadStepping()).y
        )
        more = jax.tree.map(lambda x, first: x.at[0].set(first), more, rest)
    sensing = _Sensing.of(skin, problem)
    places = tuple(jnp.zeros((len(levels), x.size)) for x in sensing.rays)
    history = jax.tree.map(lambda x: jnp.zeros_like(x[1:]), more)

    def visit(carry: tuple[Any, ...], step: tuple[Array, ...]) -> tuple[Any, Any]:
        index, level, wanted, weight, more = step
        base, beside = (
            jax.tree.map(lambda x: jnp.tensordot(weight, x, 1), past) for past in carry
        )
        found = _solved(problem, jax.tree.map(jnp.add, base, more), level[None])
        change, slopes = _responses(problem, loads, skin, found, level[None])
        shown = jax.tree.map(jnp.add, found.y, change)
        state = State(shown.stations, border_of(shown), level[None])
        read, moved = sensing.read(state, found, slopes, beside, wanted)

        def onwards(past: Array, now: Array) -> Array:
            now = jnp.where(read.found, now, 0.0)
            return jax.lax.dynamic_update_index_in_dim(past, now, index + 1, 0)

        missed = jax.tree.map(lambda a, b: jnp.where(read.found, a - b, 0.0), found.y, base)
        return jax.tree.map(onwards, carry, (found.y, moved)), (read, missed)

    path: Any = (*steps, weights, more)
    if problem.prestressed:
        _, (read, missed) = jax.lax.scan(visit, (history, places), path)
        return jax.tree.map(lambda x: x[1:], read), missed
    path = jax.tree.map(lambda x: x[1:], path)
    _, (read, missed) = jax.lax.scan(visit, (history, places), path)
    return read, jax.tree.map(lambda x: jnp.concatenate([0 * x[:1], x]), missed)


class _Sensing(NamedTuple):
    """What reads a pad's states: rays that are known, and where on the membrane they ended."""

    skin: Skin
    problem: Problem
    rays: Place  # of all taxels [ray]

    @classmethod
    def of(cls, skin: Skin, problem: Problem) -> "_Sensing":
        rays = skin.electrodes.taxels.rays(DISC, skin.geometry)
        whole = [jnp.broadcast_arrays(*ray) for ray in rays]
        angle, axial = (jnp.concatenate([ray[k] for ray in whole])[:, 0] for k in (0, 1))
        return cls(skin, problem, (angle, axial))

    def read(
        self,
        state: State,
        found: _Solved,
        slopes: BorderedVector,  # of the state by tangential forces [2, ...]
        beside: Place,  # of the material points from their rays, nearly
        wanted: Array,  # whether derivatives by tangential forces are
    ) -> tuple[PadReadings, Place]:
        """Readings of a state in one lane, and places of the material points from their rays.

        A search along 7 rays of each taxel, as `forward` does it, costs more than the state.
        """
        mechanics, electrodes = self.problem.mechanics, self.skin.electrodes
        assert isinstance(mechanics, Pad)
        lane, q = mechanics.one_lane(), state.q[..., 0]
        near = self.rays[0] + beside[0], self.rays[1] + beside[1]
        at = lane.on_rays(q, *self.rays, near)

        def so(heights: Array) -> Array:
            return electrodes.read_face(KnownFace(heights[:, None])).so[..., 0]

        def derived(_: None) -> Array:
            moved = [lane.heights_moved(q, at, d[..., 0]) for d in slopes.stations]
            by = jnp.stack([jax.jvp(so, (at.height,), (d,))[1] for d in moved])
            border = jnp.zeros((2, 1)) if slopes.border is None else slopes.border
            return jnp.concatenate([by, border], 1)

        values = so(at.height)

        def unknown(_: None) -> Array:
            return jnp.full((2, len(values) + 1), jnp.nan)

        gap = mechanics.shape(state.q).smallest_gap(self.skin.geometry).value
        solved = found.done & jnp.all(jnp.isfinite(state.q))
        outcome = kept_in_domain(mechanics, state.q, (~solved[None]).astype(jnp.int32))
        across = jax.lax.cond(wanted, derived, unknown, None)
        readings = PadReadings(values, state.pressure[0], gap[0], outcome[0] == 0, across)
        return readings, (at.place[0] - self.rays[0], at.place[1] - self.rays[1])


def nothing_ahead(skin: Skin, levels: int) -> Ahead:
    """Of a column that nothing beside it is known of; the pad has a mesh."""
    assert skin.mesh is not None
    plan = jax.tree.map(lambda x: x[..., 0], skin.mesh)
    shape = NetTopology(*plan.axes).free.shape
    border = np.zeros((levels + 1, 1)) if skin.oil.trapped else None
    states = BorderedVector(np.zeros((levels + 1, *shape, 1)), border)  # type: ignore[arg-type]
    return Ahead(states, np.array(False))  # type: ignore[arg-type]


def extrapolation(levels: np.ndarray) -> np.ndarray:
    """Weights of earlier states in a cubic polynomial at the next of the levels to visit.

    A row a level, a column for rest and each level but the last.
    """
    weights = np.zeros((len(levels), len(levels)))
    places = np.concatenate([[0.0], levels])
    for i, level in enumerate(levels):
        used = range(max(0, i - 3), i + 1)
        for k in used:
            others = [places[j] for j in used if j != k]
            weights[i, k] = np.prod([(level - x) / (places[k] - x) for x in others])
    return weights
