"""Readings of a pad along rising loads: what a table of solved states is made of.

Each state starts from a polynomial through the ones before. The last Newton correction's
factors serve the omitted energy, too, so a state costs little more than its corrections.
"""

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from suas_jax.equilibrium.balance import Problem, State, border_of, residual
from suas_jax.equilibrium.continuation import LoadStepping
from suas_jax.equilibrium.load_path import settled
from suas_jax.equilibrium.validity import kept_in_domain
from suas_jax.mechanics.pad.pad import Pad
from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.bordered_solve import BorderedVector, eliminate
from suas_jax.scene.loads import Loads
from suas_jax.scene.skin import Skin

# Displacement by the last Newton correction before the shear is added, relative.
_CLOSE = 1e-2
_MOST_CORRECTIONS = 12
_SMALL = 1e-3  # tangential force of differences, in terms of the loads'


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


def _with_shear(
    problem: Problem, y: BorderedVector, level: Lanes
) -> tuple[State, BorderedVector, Bool[Array, " lane"]]:
    """Newton's method from a state nearby, and the first-order effect of the omitted energy.

    The last correction's factors serve the omitted energy, too. Returns the state with what
    the shell leaves out, the shell's own, and whether it was found.
    """
    mechanics = problem.mechanics

    def omitted(y: BorderedVector) -> Array:
        found = mechanics.omitted_gradient(y.stations, level)
        return jnp.zeros_like(y.stations) if found is None else found

    def body(carry: tuple[Any, ...]) -> tuple[Any, ...]:
        y, _, last, count, _ = carry
        r, operator = residual(problem, y, level)
        more = jax.lax.cond(jnp.all(last), omitted, lambda y: jnp.zeros_like(y.stations), y)
        border = None if r.border is None else jnp.zeros_like(r.border)
        both = jax.tree.map(lambda *x: jnp.stack(x), r, BorderedVector(more, border))
        solved = jax.vmap(lambda right: eliminate(operator, right).solution)(both)
        first, second = (jax.tree.map(lambda x, i=i: x[i], solved) for i in (0, 1))
        new = jax.tree.map(lambda a, b: a - b, y, first)
        size = mechanics.displacement_size(first.stations)
        scale = mechanics.displacement_size(new.stations)
        close = size <= _CLOSE * scale
        changed = jax.tree.map(jnp.add, new, second)
        return new, changed, close, count + 1, last & close

    def going(carry: tuple[Any, ...]) -> Array:
        _, _, _, count, done = carry
        return ~jnp.all(done) & (count < _MOST_CORRECTIONS)

    no = jnp.zeros(y.stations.shape[-1:], bool)
    y, changed, _, _, done = jax.lax.while_loop(going, body, (y, y, no, jnp.array(0), no))
    state = State(changed.stations, border_of(changed), level)
    return state, y, done & jnp.all(jnp.isfinite(changed.stations), (0, 1))


def readings_along(
    skin: Skin,  # the pad, with a mesh
    loads: Loads,  # patches in one lane, with their largest forces
    levels: Float[Array, " level"],  # factors on the forces, in the order to visit
    # of the states before, rest first, in the state that the next one starts from, see
    # `extrapolation`
    weights: Float[Array, "level level"],
    # levels at which derivatives by tangential forces are wanted
    across: Bool[Array, " level"],
) -> PadReadings:
    """Readings along a path of loads that starts at rest."""
    problem = skin.problem(loads)
    rest = settled(problem, 1, LoadStepping()).y
    history = jax.tree.map(lambda x: jnp.zeros((len(levels), *x.shape)).at[0].set(x), rest)

    def visit(history: BorderedVector, step: tuple[Array, ...]) -> tuple[Any, PadReadings]:
        index, level, weight, wanted = step
        start = jax.tree.map(lambda x: jnp.tensordot(weight, x, 1), history)
        state, y, found = _with_shear(problem, start, level[None])
        kept = jax.tree.map(
            lambda h, x: jax.lax.dynamic_update_index_in_dim(h, x, index + 1, 0), history, y
        )
        read = _read(skin, problem, state, found)

        def derived(_: None) -> Array:
            return _across(skin, loads, y, State(state.q, state.pressure, level[None]))

        def unknown(_: None) -> Array:
            return jnp.full_like(read.across, jnp.nan)

        return kept, read._replace(across=jax.lax.cond(wanted, derived, unknown, None))

    steps = (jnp.arange(len(levels)), levels, weights, across)
    return jax.lax.scan(visit, history, steps)[1]


def _read(skin: Skin, problem: Problem, state: State, found: Array) -> PadReadings:
    """The readings of a state in one lane."""
    so = skin.electrodes.read(problem.mechanics, state.q).so[..., 0]
    gap = problem.mechanics.shape(state.q).smallest_gap(skin.geometry).value
    outcome = kept_in_domain(problem.mechanics, state.q, (~found).astype(jnp.int32))
    unknown = jnp.zeros((2, len(so) + 1))
    return PadReadings(so, state.pressure[0], gap[0], outcome[0] == 0, unknown)


def _across(skin: Skin, loads: Loads, y: BorderedVector, state: State) -> Array:
    """Derivatives of readings and pressure by tangential forces [force, channel].

    With K the tangent and w_T the work of a force of 1 N, dq/dT = K^-1 dw_T/dq; readings are
    taken at q + e dq/dT, e a thousandth of the load, whose search for the point over each taxel
    is dear to differentiate. `y` is the shell's state, `state` has what the shell leaves out.
    """
    one, zero = jnp.ones_like(loads.force), jnp.zeros_like(loads.force)
    quarter = jnp.pi / 2 * one
    problem, rights = skin.problem(loads), []
    for turn, tilt in ((quarter, zero), (zero, quarter)):
        unit = skin.problem(dataclasses.replace(loads, force=one, turn=turn, tilt=tilt))
        mechanics = unit.mechanics
        assert isinstance(mechanics, Pad)
        by = jax.grad(lambda q, pad=mechanics: jnp.sum(pad.work(q)))(y.stations)
        rights.append(by * mechanics.topology.free[..., None])
    _, operator = residual(problem, y, state.factor)
    border = None if y.border is None else jnp.zeros((2, *y.border.shape))
    both = BorderedVector(jnp.stack(rights), border)
    slopes = jax.vmap(lambda right: eliminate(operator, right).solution)(both)
    step = _SMALL * jnp.abs(loads.force[0, 0])

    def read(q: Array) -> Array:
        return skin.electrodes.read(problem.mechanics, q).so[..., 0]

    so = [(read(state.q + step * d) - read(state.q)) / step for d in slopes.stations]
    pressure = jnp.zeros((2, 1)) if slopes.border is None else slopes.border
    return jnp.concatenate([jnp.stack(so), pressure], 1)


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
