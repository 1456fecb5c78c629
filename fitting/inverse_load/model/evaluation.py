"""The forward model as load estimation needs it: readings, exact derivatives, smallest gap.

One evaluation continues a neighbouring equilibrium to new loads and differentiates it by
all of them. Columns of the Jacobian lie side by side with the lanes: each is one more lane
of the same linear problem, in the memory order the mechanics is fastest in.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from fitting.arrays import Floats
from suas_jax.equilibrium.balance import verify
from suas_jax.equilibrium.correction import corrected
from suas_jax.equilibrium.equilibrium import State, differentiable, equilibrium
from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.polynomials import gauss_legendre
from suas_jax.scene.error_estimate import bounded
from suas_jax.scene.loads import SPREAD_POINTS, Loads
from suas_jax.scene.skin import Skin

NARROWEST = 1e-3
"""Arc that a contact presses at least where it is not a line [m]."""


class NoRestError(ValueError):
    """The skin has no stable state at rest, from which loads would be told."""

    def __init__(self) -> None:
        super().__init__(
            "the skin has no stable state at rest: what it carries before anything touches it "
            "buckles it, so that loads can't be told; look at fill, mounting, temperature and "
            "depth with suas solve"
        )


class Evaluation(NamedTuple):
    """What the model says about some loads, lane by lane."""

    # continuous sensor output [counts]; NaN where the membrane touches the wall
    so: Float[Array, "taxel lane"]
    # derivatives of `so` by the parameters [counts/rad, counts/N, counts/rad]
    jacobian: Float[Array, "parameter taxel lane"]
    pressure: Lanes  # of the oil, above ambient [Pa]
    min_gap: Lanes  # between membrane and wall [m]
    state: State  # the shell's equilibrium, to start a neighbouring one from
    # index of the outcome, 0 where converged and within what the model knows (see
    # `suas_jax.equilibrium.outcomes`)
    result: Int[Array, " lane"]


def loads_from(parameters: Float[Array, "parameter lane"], contacts: int) -> Loads:
    """Loads from parameters: all angles [rad], all forces [N], and all turns [rad] if free."""
    angle, force = parameters[:contacts], parameters[contacts : 2 * contacts]
    turn = parameters[2 * contacts :]
    turn = turn if turn.shape[0] else jnp.zeros_like(angle)
    return Loads(angle, force, turn, jnp.zeros_like(angle[0]))


def wide_load(parameters: Float[Array, "parameter lane"], skin: Skin) -> Loads:
    """One load of one direction, even over an arc of the outer face.

    The parameters are the angle of its middle [rad], the inward force [N], the square of the
    arc's length [m^2], in which readings are nearly linear, and the tangential force over the
    inward one, along growing angles.
    """
    angle, force, square, tangent = parameters
    points, weights = gauss_legendre(SPREAD_POINTS, -1.0, 1.0)
    section, along = skin.geometry.section, jnp.asarray(points)[:, None] * jnp.sqrt(square) / 2
    middle = angle + jnp.zeros_like(along)
    places = section.moved(middle, along, section.thickness(middle) / 2)
    # The force has one direction, that in the middle: elsewhere it is turned back.
    turn = jnp.arctan(tangent) + section.direction(places) - section.direction(middle)
    force = force * jnp.sqrt(1 + tangent**2)
    return Loads(places, force * jnp.asarray(weights)[:, None] / 2, turn, jnp.zeros_like(angle))


# Most fits after the first are of a few frames, and lanes without one cost as much: 10,000
# frames take half the processor time that they take with 128 lanes.
FRAMES = 32
"""Lanes of a program for frames of a log."""
CONTACTS = 3
"""Contacts of a program for any number up to it: those that are not there have no force."""


def filled_up(parameters: Floats, count: int) -> Floats:
    """Parameters of `CONTACTS` contacts [row, parameter], of those of fewer."""
    rows = len(parameters)
    whole = np.zeros((rows, parameters.shape[1] // count, CONTACTS))
    whole[..., :count] = parameters.reshape(rows, -1, count)
    return whole.reshape(rows, -1)


def in_batches(
    run: Callable[[Floats, State], ArrayLike], parameters: Floats, state: State, lanes: int
) -> Floats:
    """What a program of so many lanes finds for any number of frames [frame, ...].

    `run` has parameters [parameter, lane] and neighbouring equilibria, a lane a frame, and
    returns an array whose last axis is the lane; `parameters` lead with the frame.
    """
    parts = []
    for begin in range(0, len(parameters), lanes):
        pick = np.minimum(np.arange(begin, begin + lanes), len(parameters) - 1)
        there = jax.tree.map(lambda x, i=pick: np.asarray(x)[..., i], state)
        parts.append(np.moveaxis(np.asarray(run(parameters[pick].T, there)), -1, 0))
    return np.concatenate(parts)[: len(parameters)]


def at_rest(skin: Skin, lanes: int) -> State:
    """The undeformed state, in lanes."""
    zero = jnp.zeros(lanes)
    assert isinstance(skin.elements, int)  # a section's
    return State(jnp.zeros((4, skin.elements + 1, lanes)), zero, zero)


def evaluate(
    skin: Skin,
    parameters: Float[Array, "parameter lane"],  # see `loads_from`, or `wide_load`
    start: State,  # a neighbouring equilibrium, or rest
    contacts: int,
    *,
    wide: bool = False,  # whether they are one load over an arc
) -> Evaluation:
    """Readings of some loads and their exact derivatives."""

    def loads(parameters: Array) -> Loads:
        return wide_load(parameters, skin) if wide else loads_from(parameters, contacts)

    problem = skin.problem(loads(parameters))
    found = equilibrium(problem, start, omitted=True)
    state = jax.lax.stop_gradient(found.state)
    _, shown, shell = corrected(problem, state, found.change)
    result = bounded(problem, state, shown, found.outcome).result
    min_gap = shell.shape(shown.q).smallest_gap(skin.geometry).value
    readings = skin.electrodes.read(shell, shown.q).so

    jacobian = _derivatives(skin, loads, parameters, state)
    return Evaluation(readings, jacobian, shown.pressure, min_gap, state, result)


def _derivatives(
    skin: Skin, loads: Callable[[Array], Loads], parameters: Array, state: State
) -> Float[Array, "parameter taxel lane"]:
    """Derivatives of readings in equilibrium by the parameters of the loads."""
    count, lanes = parameters.shape

    def beside(values: Array) -> Array:
        return jnp.concatenate([values] * count, -1)

    tiled = jax.tree.map(beside, state)

    def so(parameters: Array) -> Array:
        problem = skin.problem(loads(parameters))
        return skin.electrodes.read(problem.mechanics, differentiable(problem, tiled).q).so

    # Lane block k carries the derivative by parameter k.
    units = jnp.repeat(jnp.eye(count, dtype=parameters.dtype), lanes, axis=1)
    _, columns = jax.jvp(so, (beside(parameters),), (units,))
    return jnp.moveaxis(columns.reshape(-1, count, lanes), 1, 0)


def _read(
    skin: Skin, angle: Array, force: Array, start: State
) -> tuple[Array, Array, State, Array]:
    problem = skin.problem(Loads(angle[None], force[None], 0 * angle[None], 0 * angle))
    found = equilibrium(problem, start, omitted=True)
    root, shown, shell = corrected(problem, found.state, found.change)
    result = bounded(problem, root, shown, found.outcome).result
    min_gap = shell.shape(shown.q).smallest_gap(skin.geometry).value
    return skin.electrodes.read(shell, shown.q).so, min_gap, root, result


def _stable_at_rest(skin: Skin, state: State) -> Bool[Array, " lane"]:
    zero = jnp.zeros_like(state.pressure)
    problem = skin.problem(Loads(zero[None], zero[None], zero[None], zero))
    return verify(problem, state, omitted=False)[0].stable


def _slopes_of_one(
    skin: Skin, angle: Lanes, force: Lanes, state: State
) -> Float[Array, "parameter taxel lane"]:
    zero, narrow = jnp.zeros_like(angle), jnp.full_like(angle, NARROWEST**2)

    def wide(square: Float[Array, "1 lane"]) -> Loads:
        return wide_load(jnp.stack([angle, force, square[0], zero]), skin)

    line = jnp.stack([angle, force, zero])
    by_line = _derivatives(skin, lambda x: loads_from(x, 1), line, state)
    return jnp.concatenate([by_line, _derivatives(skin, wide, narrow[None], state)])


def _slopes_beside(
    skin: Skin, parameters: Float[Array, "parameter lane"], state: State
) -> Float[Array, "parameter taxel lane"]:
    zero = jnp.zeros((CONTACTS, parameters.shape[-1]))

    def loads(others: Float[Array, "parameter lane"]) -> Loads:
        # Columns of the Jacobian lie side by side with the lanes.
        lines = jnp.tile(parameters, others.shape[-1] // parameters.shape[-1])
        tangent, square = others[:CONTACTS], others[CONTACTS:]
        rows = jnp.stack([lines[:CONTACTS], lines[CONTACTS:], square, tangent])
        arcs = [wide_load(rows[:, k], skin) for k in range(CONTACTS)]
        angle, force, turn = (
            jnp.concatenate([getattr(arc, name) for arc in arcs])
            for name in ("angle", "force", "turn")
        )
        return Loads(angle, force, turn, jnp.zeros_like(angle[0]))

    return _derivatives(skin, loads, jnp.concatenate([zero, zero + NARROWEST**2]), state)


rest_program = eqx.filter_jit(_stable_at_rest)
"""Whether a skin is stable in its state at rest, in lanes."""
read_program = eqx.filter_jit(_read)
"""Readings, smallest gap, state and result of one radial load a lane, without derivatives."""
slopes_program = eqx.filter_jit(_slopes_of_one)
"""Derivatives of readings in equilibrium by one radial load's angle, force and direction, and
by the square of the arc that it presses [counts/m^2]."""
slopes_beside_program = eqx.filter_jit(_slopes_beside)
"""Derivatives of readings in equilibrium under `CONTACTS` radial loads by all tangential forces
over inward ones [counts], then by the squares of all arcs that are pressed [counts/m^2]."""
