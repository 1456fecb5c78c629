"""A skin in plane strain whose membrane remembers, as fits of loads need it.

The membrane's stress at the end of a step of time is a share of the elastic one and a rest that
the past leaves (`fitting.inverse_load.memory.series`), so a frame is an equilibrium like any
other, of a skin with another response. Its loads are the true ones; the dent that a load before
has left is part of the response, and no load. This is the model of `suas simulate`, frame by
frame: the stress changes linearly between frames.
"""

from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from fitting.inverse_load.model.evaluation import loads_from
from suas_jax.constitutive.relaxation import Past, PronySeries, Response
from suas_jax.dynamics.driven import answering, membrane_of
from suas_jax.equilibrium.balance import Problem, State
from suas_jax.equilibrium.correction import corrected
from suas_jax.equilibrium.equilibrium import differentiable, equilibrium
from suas_jax.numerics.array_types import StationVector
from suas_jax.scene.loads import Loads
from suas_jax.scene.skin import Skin
from suas_jax.sensing.electrodes import Electrodes, Readings
from suas_jax.sensing.taxels import Taxels
from suas_jax.skin.geometry import SkinGeometry


class ShiftedElectrodes(eqx.Module):
    """Electrodes whose readings count from others."""

    electrodes: Electrodes  # the skin's
    shift: Float[Array, " taxel"]  # taken off the readings [counts]

    @property
    def taxels(self) -> Taxels:
        """Of the electrodes."""
        return self.electrodes.taxels

    def read(self, mechanics: Any, q: StationVector) -> Readings:
        """See `Electrodes.read`."""
        found = self.electrodes.read(mechanics, q)
        return found._replace(so=found.so - self.shift[:, None])


class RememberingSkin(eqx.Module):
    """A skin with a past; where fits take a `Skin`, they take this one as well."""

    skin: Skin  # with the long-term constants of its file
    response: Response  # what its membrane answers with now
    # what the past leaves of the readings when nothing presses [counts]
    shift: Float[Array, " taxel"]

    @property
    def geometry(self) -> SkinGeometry:
        """Of the skin."""
        return self.skin.geometry

    @property
    def elements(self) -> int | tuple[int, int]:
        """Of its mesh."""
        return self.skin.elements

    @property
    def electrodes(self) -> ShiftedElectrodes:
        """With readings as a skin without a past has them, to first order."""
        return ShiftedElectrodes(self.skin.electrodes, self.shift)

    def problem(self, loads: Loads) -> Problem:
        """See `Skin.problem`."""
        return answering(self.skin.problem(loads), self.response)


class Series(NamedTuple):
    """`LoadMemory` as a program takes it; attributes as there."""

    gamma: Float[Array, " term"]
    tau: Float[Array, " term"]
    errors: Float[Array, "error term"]

    @property
    def states(self) -> PronySeries:
        """Of the states R_i, which do not depend on the shares that relax."""
        return PronySeries(jnp.ones_like(self.tau), self.tau)


class Expected(NamedTuple):
    """What the past leaves at a frame, if nothing presses."""

    past: Past  # up to the frame before: S and the R_i, of the long-term constants [Pa]
    response: Response  # of the membrane in this frame
    by_error: tuple[Response, ...]  # its change by every error of the series
    so: Float[Array, " taxel"]  # readings [counts]
    slopes: Float[Array, "error taxel"]  # their change by every error [error, taxel]
    state: State  # of the membrane
    pressure: Array  # of the oil [Pa]
    result: Array  # index of the outcome, zero where it was found


def response_of(series: Series, gamma: Array, past: Past, elapsed: Array) -> Response:
    """How the membrane answers at the end of a step; linear in gamma, but for the one.

    The series is the membrane's, for its times; gamma are shares [term]. The past is that at
    the begin of the step, its parts are the R_i; the step takes `elapsed` [s].
    """
    fade, mean = series.states.over(elapsed)
    left = jnp.tensordot(gamma * fade, past.parts, 1)
    rest = left - jnp.sum(gamma * mean) * past.stress
    return Response(1 + jnp.sum(gamma * mean), rest)


def at_first(skin: Skin) -> tuple[Past, State, Array]:
    """A membrane that has been at rest for long: its past without terms, state, readings."""
    none = jnp.zeros((1, 1))
    problem = skin.problem(Loads(none, none, none, none[0]))
    found = equilibrium(problem, None, omitted=True)
    _, shown, shell = corrected(problem, found.state, found.change)
    stress = membrane_of(problem).deviator(found.state.q)
    so = skin.electrodes.read(shell, shown.q).so[:, 0]
    return Past(stress, jnp.zeros((0, *stress.shape))), found.state, so


def expected(
    skin: Skin,  # with the long-term constants
    series: Series,  # of its membrane
    past: Past,  # before the frame before
    stood: Array,  # time that the step to the frame before took [s]
    last: StationVector,  # unknowns of the frame before [dof, station, 1]
    elapsed: Array,  # since then [s]
    start: State,  # a state nearby
) -> Expected:
    """What a frame would be without loads."""
    none = jnp.zeros((1, 1))
    problem = skin.problem(Loads(none, none, none, none[0]))
    past = past.after(series.states, stood, membrane_of(problem).deviator(last))
    response = response_of(series, series.gamma, past, elapsed)
    by_error = []
    for row in series.errors:
        moved = response_of(series, row, past, elapsed)
        by_error.append(Response(moved.share - 1, moved.rest))
    held = answering(problem, response)
    found = equilibrium(held, start, omitted=True)
    state = jax.lax.stop_gradient(found.state)
    _, shown, shell = corrected(held, state, found.change)
    so = skin.electrodes.read(shell, shown.q).so[:, 0]
    slopes = [_slope(skin, problem, response, one, state)[:, 0] for one in by_error]
    taxels = so.shape[0]
    rows = jnp.stack(slopes) if slopes else jnp.zeros((0, taxels))
    given = past, response, tuple(by_error), so, rows
    return Expected(*given, state, shown.pressure[0], found.outcome[0])


def _slope(
    skin: Skin, problem: Problem, response: Response, along: Response, state: State
) -> Float[Array, "taxel lane"]:
    """Change of readings as the response of a membrane changes, its loads held."""

    def so(response: Response) -> Array:
        held = answering(problem, response)
        return skin.electrodes.read(held.mechanics, differentiable(held, state).q).so

    return jax.jvp(so, (response,), (along,))[1]


def under_loads(
    skin: RememberingSkin,  # as fitted
    along: tuple[Response, ...],  # see `Expected.by_error`
    parameters: Float[Array, "parameter lane"],  # of the contacts, see `loads_from`
    state: State,  # their equilibrium
    contacts: int,
) -> Float[Array, "error taxel"]:
    """Change of readings under loads by every error of the series."""
    problem = skin.skin.problem(loads_from(parameters, contacts))
    return jnp.stack(
        [_slope(skin.skin, problem, skin.response, one, state)[:, 0] for one in along]
    )


AT_FIRST = eqx.filter_jit(at_first)
EXPECTED = eqx.filter_jit(expected)
UNDER_LOADS = {k: eqx.filter_jit(partial(under_loads, contacts=k)) for k in (1, 2, 3)}
