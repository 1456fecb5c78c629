"""A section in motion: its film, its own mass and the water outside, step by step through time.

The unknowns q of the membrane and the oil's mean pressure p obey ::

    Y' d(m Y dq/dt)/dt + C(q) dq/dt + f(q, past) - p dV/dq - loads(t) = 0,   V(q) = V_oil(p)

where Y(q) makes flows of velocities (`suas_jax.dynamics.inertia`), and f is the force of a
membrane that may remember. The oil's own acceleration is that of what flows, v dv/ds included.

Steps are those of TR-BDF2, a trapezoidal rule and a backward difference, of order two, that let
what is too fast for a step fade (M. E. Hosea, L. F. Shampine, Applied Numerical Mathematics 20
(1996), 21-37); after a jump of the loads, where no acceleration is known, those of the
diagonally implicit method with the same c. Either half is one kind of equation ::

    dq/dt = (q - q_b) / c,   dv/dt = (Y dq/dt - v_b) / c

with what is known before it. Newton's method solves it with one dense inverse for as many
steps as it is good for. Volume is kept as in statics: it is one of the equations.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from suas_jax.constitutive.relaxation import Past, Response
from suas_jax.dynamics.driven import (
    DrivenSkin,
    Travels,
    Values,
    answering,
    membrane_of,
)
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
from suas_jax.dynamics.steps import MOST_STEPS, Rows, begun, bend_weight, observed_at
from suas_jax.equilibrium.balance import Problem, State, border_of, imbalance
from suas_jax.equilibrium.outcomes import index_of
from suas_jax.mechanics.shell.shell import Shell
from suas_jax.numerics.array_types import StationVector
from suas_jax.numerics.bordered_solve import BorderedVector

# Of the c of either half, over the step.
_LENGTH = 1 - 1 / math.sqrt(2)
_MOST_CORRECTIONS = 20
# Of a correction that does not count, over the largest displacement; of the film's volume.
_EXACT_STEP, _EXACT = 1e-9, 1e-12
_SLOW = 0.75  # ratio of corrections from which on an inverse is made anew
_OTHER_STEP = 0.2  # difference of steps that an inverse serves
_LONGER, _WORTH, _SHORTER = 4.0, 2.5, 0.2  # of the next step
_SMALLEST = 1e-12  # step over a row at which the history is given up


class Inverse(NamedTuple):
    """An inverse of the equations' derivative, and the step that it was made for."""

    matrix: Float[Array, "equation equation"]
    step: Float[Array, ""]


class Moving(NamedTuple):
    """Where a skin in motion has come to.

    Attributes:
        time: [s].
        step: that is tried next [s].
        values: that the history changes.
        travels: none.
        state: unknowns and pressure.
        velocity: of the unknowns.
        flow: velocities of oil and faces.
        rate: of the flow.
        past: what the material remembers.
        jumped: whether the rate is not known, as after a jump.
        inverse: made last.
        error: sum of the errors of the steps.
        largest: displacement so far, or what counts as one [m].
        stress: largest instantaneous one so far [Pa].
        iterations: corrections since the last row.
        steps: since then, those included that were too long.
        result: index of the outcome.
    """

    time: Float[Array, ""]
    step: Float[Array, ""]
    values: Values
    travels: Travels
    state: State
    velocity: StationVector
    flow: Flow
    rate: Flow
    past: Past
    jumped: Bool[Array, ""]
    inverse: Inverse
    error: Float[Array, ""]
    largest: Float[Array, ""]
    stress: Float[Array, ""]
    iterations: Int[Array, " lane"]
    steps: Int[Array, ""]
    result: Int[Array, " lane"]


class Half(NamedTuple):
    """An end of half a step.

    Attributes:
        state: unknowns and pressure.
        velocity: of the unknowns.
        flow: velocities of oil and faces.
        rate: of the flow.
        corrections: that it took.
        ratio: of the last two of them.
        good: whether it was found.
    """

    state: State
    velocity: StationVector
    flow: Flow
    rate: Flow
    corrections: Int[Array, ""]
    ratio: Float[Array, ""]
    good: Bool[Array, ""]


class _Base(NamedTuple):
    """What is known before half a step, and how long it is.

    Attributes:
        q: unknowns that a velocity adds to.
        flow: that a rate adds to.
        length: c of the module [s].
    """

    q: StationVector
    flow: Flow
    length: Float[Array, ""]


class _Body(NamedTuple):
    """A skin at some values, its membrane answering as its past has it.

    Attributes:
        problem: membrane, oil and loads.
        level: factor on the loads.
        sampling: of the membrane.
        given: densities and viscosity.
    """

    problem: Problem
    level: Float[Array, " lane"]
    sampling: Sampling
    given: Densities

    @property
    def shell(self) -> Shell:
        """The membrane."""
        return self.sampling.shell

    def force(
        self, near: Near, base: _Base, y: BorderedVector
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

    def found(self, base: _Base, guess: State, inverse: Inverse, exact: Array) -> Half:
        """The end of half a step, by Newton's method with an inverse at hand.

        Args:
            base: what is known before it.
            guess: unknowns and pressure to begin with.
            inverse: made nearby.
            exact: size of a displacement that does not count [m].
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
    """A skin in motion.

    Attributes:
        skin: whose values change.
        given: densities and viscosity.
    """

    skin: DrivenSkin
    given: Densities

    def at(self, values: Values, response: Response) -> _Body:
        """The skin at some values, answering as its past has it."""
        parts, problem = self.skin.parts(values, self.skin.no_travels)
        problem = answering(problem, response)
        shell = problem.mechanics
        assert isinstance(shell, Shell)
        sampling = Sampling.of(shell, parts.skin.geometry)
        return _Body(problem, self.skin.level(values), sampling, self.given)

    def stress(self, values: Values, q: StationVector) -> Array:
        """Instantaneous stress that the material remembers [Pa]."""
        return membrane_of(self.skin.problem(values, self.skin.no_travels)).deviator(q)


def _densities(skin: DrivenSkin) -> Densities:
    known = densities_of(skin.scene.scene)
    own = skin.inputs
    return known._replace(
        oil=jnp.asarray(own["oil.density"]),
        viscosity=jnp.asarray(own["oil.viscosity"]),
        membrane=jnp.asarray(own["material.density"]),
    )


@eqx.filter_jit
def film_at_rest(
    scene: Any, plan: Any, inputs: Any, time: Array, values: Values, scale: Array
) -> Moving:
    """A skin that has always been at rest, before it moves.

    Args:
        scene: with the instantaneous response of its material.
        plan: mesh of the whole section.
        inputs: the scene's numbers.
        time: [s].
        values: without loads.
        scale: displacement that counts [m].
    """
    skin = DrivenSkin.of(scene, plan, inputs, values)
    rest = begun(skin, time, values)
    moving = MovingSkin(skin, _densities(skin))
    body = moving.at(values, rest.past.relaxed(skin.series))
    near = body.sampling.near(rest.state.q)
    still = flow_of(near.at, near.push(0 * rest.state.q), body.sampling.water)
    size = len(free_unknowns(body.shell)) + 1
    return Moving(
        rest.time,
        rest.step,
        rest.values,
        rest.travels,
        rest.state,
        jnp.zeros_like(rest.state.q),
        still,
        still,
        rest.past,
        jnp.asarray(True),
        Inverse(jnp.zeros((size, size)), jnp.zeros(())),
        rest.error,
        jnp.asarray(scale, float),
        rest.largest,
        rest.iterations,
        rest.steps,
        rest.result,
    )


@eqx.filter_jit
def through_film(
    scene: Any, plan: Any, inputs: Any, rows: Rows, start: Moving, tolerance: Array
) -> tuple[dict[str, Any], dict[str, Array], Moving]:
    """Follow a history through some rows; as `steps.through`, of a skin in motion."""
    skin = DrivenSkin.of(scene, plan, inputs, rows.final)
    moving = MovingSkin(skin, _densities(skin))

    def visit(now: Moving, row: Rows) -> tuple[Moving, Any]:
        now = now._replace(iterations=0 * now.iterations, steps=0 * now.steps)
        apart = jnp.stack([jnp.any(now.values[k] != x) for k, x in row.first.items()])
        # What jumps moves nothing at once.
        jumps = row.end <= row.begin
        now = now._replace(
            jumped=now.jumped | jumps | jnp.any(apart),
            values=jax.tree.map(lambda a, b: jnp.where(jumps, b, a), row.first, row.final),
        )

        def going(now: Moving) -> Array:
            left = now.time < row.end
            return left & jnp.all(now.result == 0) & (now.steps < MOST_STEPS)

        now = jax.lax.while_loop(going, lambda now: _step(moving, now, row, tolerance), now)
        late = (now.time < row.end) & (now.result == 0)
        result = jnp.where(late, index_of("max_steps"), now.result)
        now = now._replace(result=result.astype(now.result.dtype))
        return now, observed_at(skin, now)

    end, (reports, outcomes) = jax.lax.scan(visit, start, rows)
    return reports, outcomes, end


class _Stages(NamedTuple):
    """The two halves of a step, in shares of it.

    Attributes:
        end: where a half ends.
        first: weight of the rates at the begin of the step.
        before: of those at the end of the half before.
        wrong: weights of the rates at begin, middle and end in the error of the step: those of
            the step less those of order three.
    """

    end: Float[Array, " half"]
    first: Float[Array, " half"]
    before: Float[Array, " half"]
    wrong: Float[Array, " rate"]


def _stages(middle: float, first: tuple[float, float], before: tuple[float, float]) -> _Stages:
    own = np.array([first[1], before[1], _LENGTH])
    cubic = np.array([0.0, 1 / (6 * middle), (2 - 3 * middle) / 6]) / (1 - middle)
    cubic[0] = 1 - np.sum(cubic)
    rows = [middle, 1.0], first, before, own - cubic
    return _Stages(*(jnp.asarray(x) for x in rows))


# TR-BDF2; and the two stages of order two that need no rate of the flow at the begin.
_GOING = (2 * _LENGTH, (_LENGTH, 0.5 - _LENGTH / 2), (0.0, 0.5 - _LENGTH / 2))
_STARTING = (_LENGTH, (0.0, 0.0), (0.0, 1 - _LENGTH))


class _Trial(NamedTuple):
    """A step that was tried.

    Attributes:
        half: its end.
        past: what the material then remembers.
        wrong: error of the unknowns.
        bend: of the instantaneous stress over the step, its second derivative times the square
            of the step [Pa].
        stress: instantaneous one at its end [Pa].
        good: whether both halves were found.
    """

    half: Half
    past: Past
    wrong: StationVector
    bend: Float[Array, ""]
    stress: Float[Array, ""]
    good: Bool[Array, ""]


def _tried(
    moving: MovingSkin,
    now: Moving,
    step: Array,
    values: Callable[[Array], Values],
    inverse: Inverse,
) -> _Trial:
    """Both halves of a step."""
    series = moving.skin.series
    stages = jax.tree.map(
        lambda a, b: jnp.where(now.jumped, a, b), _stages(*_STARTING), _stages(*_GOING)
    )
    exact = _EXACT_STEP * now.largest
    none = jnp.zeros((), jnp.int32)
    begin = Half(now.state, now.velocity, now.flow, now.rate, none, 0 * step, jnp.asarray(True))

    def based(x: Any, first: Any, before: Any, weights: tuple[Array, Array]) -> Any:
        a, b = (step * w for w in weights)
        return jax.tree.map(lambda x, y, z: x + a * y + b * z, x, first, before)

    def visit(carry: tuple[Half, Past, Array], stage: _Stages) -> Any:
        last, past, time = carry
        elapsed = (stage.end - time) * step
        weights = stage.first, stage.before
        base = _Base(
            based(now.state.q, now.velocity, last.velocity, weights),
            based(now.flow, now.rate, last.rate, weights),
            _LENGTH * step,
        )
        given = values(stage.end)
        body = moving.at(given, past.seen(series, elapsed))
        guess = last.state._replace(q=base.q + base.length * last.velocity)
        found = body.found(base, guess, inverse, exact)
        found = found._replace(
            corrections=found.corrections + last.corrections,
            ratio=jnp.maximum(found.ratio, last.ratio),
            good=found.good & last.good,
        )
        stress = moving.stress(given, found.state.q)
        past = past.after(series, elapsed, stress)
        return (found, past, stage.end), (found.velocity, stress)

    halves = stages._replace(wrong=jnp.zeros(2))
    carry, (velocities, stresses) = jax.lax.scan(visit, (begin, now.past, 0 * step), halves)
    end, past, _ = carry
    rates = jnp.concatenate([now.velocity[None], velocities])
    wrong = step * jnp.tensordot(stages.wrong, rates, 1)
    middle = stages.end[0]
    slopes = (
        (stresses[0] - now.past.stress) / middle,
        (stresses[1] - stresses[0]) / (1 - middle),
    )
    bend = 2 * jnp.max(jnp.abs(slopes[1] - slopes[0]))
    return _Trial(end, past, wrong, bend, jnp.max(jnp.abs(stresses[1])), end.good)


def _step(moving: MovingSkin, now: Moving, row: Rows, tolerance: Array) -> Moving:
    """Try a step towards the end of a row, and take it where it is short enough."""
    series, left = moving.skin.series, row.end - now.time
    wanted = jnp.minimum(now.step, left)
    step = left / jnp.ceil(left / wanted - 1e-9)

    def values(share: Array) -> Values:
        """That much of the step later."""
        over = (now.time + share * step - row.begin) / (row.end - row.begin)
        over = jnp.minimum(over, 1.0)
        return jax.tree.map(lambda a, b: a + over * (b - a), row.first, row.final)

    length = _LENGTH * step
    stale = jnp.abs(length / jnp.maximum(now.inverse.step, 1e-300) - 1) > _OTHER_STEP

    def anew() -> Inverse:
        body = moving.at(values(jnp.zeros(())), now.past.seen(series, length))
        return body.inverse(now.state, now.velocity, length)

    inverse = jax.lax.cond(stale, anew, lambda: now.inverse)
    trial = _tried(moving, now, step, values, inverse)
    end = trial.half
    largest = jnp.maximum(now.largest, jnp.max(jnp.abs(end.state.q[:2])))
    strongest = jnp.maximum(now.stress, trial.stress)
    fades = jnp.sum(series.g * bend_weight(step / series.tau))
    error = jnp.max(jnp.abs(trial.wrong[:2])) / largest
    error += fades * trial.bend / jnp.maximum(strongest, 1e-300)
    good = trial.good & (error <= tolerance)
    ratio = 0.9 * (tolerance / jnp.maximum(error, 1e-300)) ** (1 / 3)
    # A step of another length needs another inverse, so that few are worth it; and one that a
    # row cut short says little of the next.
    longer = jnp.where(ratio > _WORTH, jnp.minimum(ratio, _LONGER) * step, wanted)
    longer = jnp.where(now.step > left, jnp.maximum(longer, _finite(now.step)), longer)
    shorter = jnp.where(trial.good, jnp.maximum(ratio, _SHORTER) * step, _SHORTER * step)
    # An inverse that fails is made anew before a step is made shorter.
    shorter = jnp.where(trial.good | stale, shorter, wanted)
    poor = ~trial.good | (end.ratio > _SLOW)
    inverse = inverse._replace(step=jnp.where(poor, 0.0, inverse.step))
    ended = ~good & (shorter < _SMALLEST * (row.end - row.begin))
    result = jnp.where(ended, index_of("no_convergence"), now.result)
    tried = now._replace(
        step=shorter,
        inverse=inverse,
        iterations=now.iterations + end.corrections,
        steps=now.steps + 1,
        result=result.astype(now.result.dtype),
    )
    taken = Moving(
        jnp.where(step >= left, row.end, now.time + step),
        longer,
        values(jnp.ones(())),
        now.travels,
        end.state,
        end.velocity,
        end.flow,
        end.rate,
        trial.past,
        jnp.asarray(False),
        inverse,
        now.error + error,
        largest,
        strongest,
        tried.iterations,
        tried.steps,
        now.result,
    )
    return jax.tree.map(lambda a, b: jnp.where(good, a, b), taken, tried)


def _finite(x: Array) -> Array:
    return jnp.where(jnp.isfinite(x), x, 0.0)
