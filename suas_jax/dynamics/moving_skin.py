"""A section in motion: its film, its own mass and the water outside, over half a step in time.

The unknowns q of the membrane and the oil's mean pressure p obey ::

    Y' d(m Y dq/dt)/dt + C(q) dq/dt + f(q, past) - p dV/dq - loads(t) = 0,   V(q) = V_oil(p)

where Y(q) makes flows of velocities (`suas_jax.dynamics.inertia`), and f is the force of a
membrane that may remember. The oil's own acceleration is that of what flows, v dv/ds included.

Either half of a step (`suas_jax.dynamics.tr_bdf2`) is one kind of equation ::

    dq/dt = (q - q_b) / c,   dv/dt = (Y dq/dt - v_b) / c

with what is known before it. Newton's method solves it with one dense inverse for as many
steps as it is good for. Volume is kept as in statics: it is one of the equations.
"""

from typing import NamedTuple, Self

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from suas_jax.constitutive.relaxation import Response
from suas_jax.dynamics.driven import DrivenSkin, Values, answering, membrane_of
from suas_jax.dynamics.inertia import (
    THINNEST_FILM,
    Densities,
    Flow,
    Outline,
    Weights,
    densities_of,
    flow_of,
    weights_of,
)
from suas_jax.dynamics.motion import Near, Sampling, dense, free_unknowns
from suas_jax.equilibrium.balance import Problem, State, border_of, imbalance
from suas_jax.mechanics.shell.shell import Shell
from suas_jax.numerics.array_types import StationVector
from suas_jax.numerics.bordered_solve import BorderedVector

_MOST_CORRECTIONS = 20
_EXACT = 1e-12  # correction of the volume that does not count, over the film's


class Inverse(NamedTuple):
    """An inverse of the equations' derivative, and the step that it was made for."""

    matrix: Float[Array, "equation equation"]
    step: Float[Array, ""]


class Half(NamedTuple):
    """An end of half a step."""

    state: State  # unknowns and pressure
    velocity: StationVector  # of the unknowns
    flow: Flow  # velocities of oil and faces
    rate: Flow  # of the flow
    corrections: Int[Array, ""]  # that it took
    ratio: Float[Array, ""]  # of the last two of them
    good: Bool[Array, ""]  # whether it was found


class Base(NamedTuple):
    """What is known before half a step, and how long it is."""

    q: StationVector  # unknowns that a velocity adds to
    flow: Flow  # that a rate adds to
    length: Float[Array, ""]  # c of the module [s]


class Body(NamedTuple):
    """A skin at some values, its membrane answering as its past has it."""

    problem: Problem  # membrane, oil and loads
    level: Float[Array, " lane"]  # factor on the loads
    sampling: Sampling  # of the membrane
    given: Densities  # densities and viscosity

    @property
    def shell(self) -> Shell:
        """The membrane."""
        return self.sampling.shell

    def force(
        self, near: Near, base: Base, y: BorderedVector
    ) -> tuple[BorderedVector, StationVector, Flow, Flow]:
        """What nothing balances at a trial state, and velocity, flow and rate there."""
        velocity = (y.stations - base.q) / base.length
        at = near.outline(y.stations)

        def moved(velocity: Array) -> Flow:
            return flow_of(at, near.push(velocity), self.sampling.water)

        flow = moved(velocity)
        flow = flow._replace(film=flow.film / at.film)
        rate = jax.tree.map(lambda a, b: (a - b) / base.length, flow, base.flow)
        weights = self.weights(at)
        pulls = jax.tree.map(jnp.multiply, weights.mass, rate)
        speed = jnp.pad(flow.film, 1) ** 2
        carried = self.given.oil / 2 * jnp.diff((speed[1:] + speed[:-1]) / 2)
        film = at.film * (pulls.film + weights.damping * flow.film) + carried
        (own,) = jax.linear_transpose(moved, velocity)(pulls._replace(film=film))
        found = imbalance(self.problem, y, self.level)
        free = self.shell.elements.free()
        found = found._replace(stations=free * (found.stations + own))
        return found, velocity, flow, rate

    def weights(self, at: Outline) -> Weights:
        """Of the squares of flows."""
        return weights_of(at, self.sampling.section, self.sampling.water, self.given)

    def inverse(self, state: State, velocity: StationVector, length: Array) -> Inverse:
        """Of the derivative of `force` for steps of a length, at a state."""
        free, near = free_unknowns(self.shell), self.sampling.near(state.q)
        net = state.pressure - self.level * self.problem.external_pressure
        a = self.shell.assemble(state.q, net, self.level)
        moved, weights = near.by_unknowns(free), self.weights(near.at)
        flow = flow_of(near.at, jnp.moveaxis(moved, 0, -1), self.sampling.water)
        passing = flow_of(near.at, near.push(velocity), self.sampling.water).film
        film = near.at.film
        closes = jnp.where(near.at.gap > THINNEST_FILM, near.closing(moved), 0.0).T
        closes = (closes[1:] + closes[:-1]) / 2
        by_flow = weights.mass.film / length**2 + weights.damping / length
        by_film = -(weights.mass.film / length + 3 * weights.damping) * passing / film
        rows = by_flow[:, None] * flow.film + by_film[:, None] * closes
        middle = flow.membrane[1].reshape(-1, len(free))
        mass = jnp.sum(weights.mass.membrane, 0).ravel()
        matrix = dense(a.tangent, free) + flow.film.T @ rows
        matrix += middle.T @ ((mass / length**2)[:, None] * middle)
        matrix += flow.water.T @ ((weights.mass.water / length**2)[:, None] * flow.water)
        border = -a.volume_gradient.reshape(-1)[free]
        corner = self.problem.oil.compliance(state.pressure, self.shell.film_volume)
        whole = jnp.block([[matrix, border[:, None]], [border, corner]])
        return Inverse(jnp.linalg.inv(whole), length)

    def found(self, base: Base, guess: State, inverse: Inverse, exact: Array) -> Half:
        """The end of half a step, by Newton's method with an inverse at hand.

        `base`: what is known before it. `guess`: unknowns and pressure to begin with.
        `inverse`: made nearby. `exact`: size of a displacement that does not count [m].
        """
        free, near = free_unknowns(self.shell), self.sampling.near(guess.q)
        volume = self.shell.film_volume[0]

        def correct(at: _Newton) -> _Newton:
            wrong, *_ = self.force(near, base, at.y)
            defect, pressure = border_of(wrong), border_of(at.y)
            right = jnp.append(wrong.stations.reshape(-1)[free], defect)
            change = inverse.matrix @ right
            step = jnp.zeros(at.y.stations.size).at[free].set(change[:-1])
            step = step.reshape(at.y.stations.shape)
            y = BorderedVector(at.y.stations - step, pressure - change[-1:])
            size = jnp.max(jnp.abs(step[:2]))
            counts = (at.taken > 0) & (at.size > exact)
            ratio = jnp.where(counts, size / at.size, at.ratio)
            left = jnp.where(at.taken > 0, jnp.minimum(ratio, 1.0), 1.0)
            done = (left * size <= exact) & (left * jnp.abs(defect[0]) <= _EXACT * volume)
            lost = ~jnp.isfinite(size) | (counts & (ratio > 0.9) & ~done)
            return _Newton(y, size, ratio, at.taken + 1, done, lost)

        def going(at: _Newton) -> Array:
            return ~at.done & ~at.lost & (at.taken < _MOST_CORRECTIONS)

        never, none = jnp.asarray(False), 0.0 * base.length
        y = BorderedVector(guess.q, guess.pressure)
        start = _Newton(y, none, none, jnp.zeros((), jnp.int32), never, never)
        end = jax.lax.while_loop(going, correct, start)
        _, velocity, flow, rate = self.force(near, base, end.y)
        state = State(end.y.stations, border_of(end.y), self.level)
        return Half(state, velocity, flow, rate, end.taken, end.ratio, end.done)


class _Newton(NamedTuple):
    """Newton's method on its way."""

    y: BorderedVector
    size: Float[Array, ""]
    ratio: Float[Array, ""]
    taken: Int[Array, ""]
    done: Bool[Array, ""]
    lost: Bool[Array, ""]


class MovingSkin(NamedTuple):
    """A skin in motion."""

    skin: DrivenSkin  # whose values change
    given: Densities  # densities and viscosity

    @classmethod
    def of(cls, skin: DrivenSkin) -> Self:
        """With the densities and the viscosity of its inputs."""
        own = skin.inputs
        given = densities_of(skin.scene.scene)._replace(
            oil=jnp.asarray(own["oil.density"]),
            viscosity=jnp.asarray(own["oil.viscosity"]),
            membrane=jnp.asarray(own["material.density"]),
        )
        return cls(skin, given)

    def at(self, values: Values, response: Response) -> Body:
        """The skin at some values, answering as its past has it."""
        parts, problem = self.skin.parts(values, self.skin.no_travels)
        problem = answering(problem, response)
        shell = problem.mechanics
        assert isinstance(shell, Shell)
        sampling = Sampling.of(shell, parts.skin.geometry)
        return Body(problem, self.skin.level(values), sampling, self.given)

    def stress(self, values: Values, q: StationVector) -> Array:
        """Instantaneous stress that the material remembers [Pa]."""
        return membrane_of(self.skin.problem(values, self.skin.no_travels)).deviator(q)
