"""A skin in motion, and one step of it, of order two: TR-BDF2.

A trapezoidal rule and a backward difference let what is too fast for a step fade (M. E. Hosea,
L. F. Shampine, Applied Numerical Mathematics 20 (1996), 21-37); after a jump of the loads,
where no acceleration is known, the steps are those of the diagonally implicit method with the
same c.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import Any, NamedTuple, Self

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from suas_jax.constitutive.relaxation import Past, Response
from suas_jax.dynamics.driven import DrivenSkin, Travels, Values, answering, membrane_of
from suas_jax.dynamics.half_step import Base, Half, Inverse, SkinAtMoment
from suas_jax.dynamics.inertia import Densities, densities_of
from suas_jax.equilibrium.balance import State
from suas_jax.numerics.array_types import StationVector

_FORCE, _MOST_FORCES = 1e-8, 8  # relative error of a force, and most repetitions
_SHARE = 1.5  # of a force, at most
LENGTH = 1 - 1 / math.sqrt(2)
"""Of the c of either half, over the step."""
_EXACT_STEP = 1e-9  # correction that does not count, over the largest displacement


@dataclasses.dataclass(frozen=True)
class MovingSkin:
    """A skin in motion."""

    skin: DrivenSkin  # whose values change
    given: Densities  # densities and viscosity
    outside: Float[Array, "harmonic harmonic"]  # added mass of a pad's water

    @classmethod
    def of(cls, skin: DrivenSkin, outside: Float[Array, "harmonic harmonic"]) -> Self:
        """With the densities and the viscosity of its inputs."""
        own = skin.inputs
        given = densities_of(skin.scene.scene)._replace(
            oil=jnp.asarray(own["oil.density"]),
            viscosity=jnp.asarray(own["oil.viscosity"]),
            membrane=jnp.asarray(own["material.density"]),
        )
        return cls(skin, given, outside)

    @property
    def pressed(self) -> tuple[int, ...]:
        """Which of the bodies forces press."""
        bodies = [i for i, x in enumerate(self.skin.scene.scene.loads) if x.kind == "body"]
        return tuple(bodies.index(i) for i in self.skin.pressed)

    def size(self, q: StationVector) -> Array:
        """Largest displacement among unknowns [m]."""
        return jnp.max(jnp.abs(q[:2] if self.skin.plan.dimension == 2 else q))

    def at(self, values: Values, response: Response) -> SkinAtMoment:
        """The skin at some values, answering as its past has it."""
        parts, problem = self.skin.parts(values, self.skin.no_travels)
        problem, level = answering(problem, response), self.skin.level(values)
        geometry = parts.skin.geometry
        return SkinAtMoment(problem, level, geometry, self.given, self.outside, self.pressed)

    def half(
        self,
        values: Values,  # at its end
        past: Past,  # what the material remembers
        elapsed: Array,  # since then [s]
        base: Base,  # what is known before it
        last: Half,  # to begin with
        exact: Array,  # size of a displacement that does not count [m]
    ) -> Half:
        """The end of half a step, bodies carrying the forces that reports tell.

        These have the first-order effect of what the membrane's model leaves out, the ones that
        balance have not: their ratio is found by repetition, and hardly changes.
        """
        series = self.skin.series
        moment = self.at(values, past.seen(series, elapsed))
        if not self.pressed:
            return moment.found(base, last, exact, last.share)
        wanted = jnp.stack(
            [jnp.reshape(values[f"load.{i}.force"], ()) for i in self.skin.pressed]
        )
        scale = wanted / moment.scale
        one = jnp.where(wanted > 0, wanted, 1.0)

        def attempt(at: tuple[Half, Array, Array]) -> tuple[Half, Array, Array]:
            half, _, tries = at
            half = moment.found(base, half, exact, half.share * scale)
            travels = self.skin.no_travels._replace(length=half.travel)
            parts, problem = self.skin.parts(values, travels)
            stress = membrane_of(problem).deviator(half.state.q)
            after = past.after(series, elapsed, stress).relaxed(series)
            told = self.skin.forces(parts, answering(problem, after), half.state)
            wrong = jnp.where(wanted > 0, (wanted - told) / one, 0.0)
            share = jnp.clip(half.share + wrong, 1 / _SHARE, _SHARE)
            return half._replace(share=share), jnp.max(jnp.abs(wrong)), tries + 1

        def going(at: tuple[Half, Array, Array]) -> Array:
            half, wrong, tries = at
            return (wrong > _FORCE) & half.good & (tries < _MOST_FORCES)

        start = last._replace(good=jnp.asarray(True)), jnp.ones(()), jnp.zeros((), jnp.int32)
        half, _, _ = jax.lax.while_loop(going, attempt, start)
        return half

    def stress(self, values: Values, q: StationVector) -> Array:
        """Instantaneous stress that the material remembers [Pa]."""
        return membrane_of(self.skin.problem(values, self.skin.no_travels)).deviator(q)


class Moving(NamedTuple):
    """Where a skin in motion has come to."""

    time: Float[Array, ""]  # [s]
    step: Float[Array, ""]  # that is tried next [s]
    values: Values  # that the history changes
    travels: Travels  # of bodies that forces press
    share: Float[Array, " body"]  # see `Half`
    state: State  # unknowns and pressure
    velocity: StationVector  # of the unknowns
    flow: Any  # velocities of oil and faces
    rate: Any  # of the flow
    outside: Float[Array, "harmonic harmonic"]  # added mass of a pad's water
    past: Past  # what the material remembers
    jumped: Bool[Array, ""]  # whether the rate is not known, as after a jump
    inverse: Inverse  # made last
    error: Float[Array, ""]  # sum of the errors of the steps
    largest: Float[Array, ""]  # displacement so far, or what counts as one [m]
    stress: Float[Array, ""]  # largest instantaneous one so far [Pa]
    iterations: Int[Array, " lane"]  # corrections since the last row
    steps: Int[Array, ""]  # since then, those included that were too long
    result: Int[Array, " lane"]  # index of the outcome


class _Stages(NamedTuple):
    """The two halves of a step, in shares of it."""

    end: Float[Array, " half"]  # where a half ends
    first: Float[Array, " half"]  # weight of the rates at the begin of the step
    before: Float[Array, " half"]  # of those at the end of the half before
    # weights of the rates at begin, middle and end in the error of the step: those of the step
    # less those of order three
    wrong: Float[Array, " rate"]


def _stages(middle: float, first: tuple[float, float], before: tuple[float, float]) -> _Stages:
    own = np.array([first[1], before[1], LENGTH])
    cubic = np.array([0.0, 1 / (6 * middle), (2 - 3 * middle) / 6]) / (1 - middle)
    cubic[0] = 1 - np.sum(cubic)
    rows = [middle, 1.0], first, before, own - cubic
    return _Stages(*(jnp.asarray(x) for x in rows))


# TR-BDF2; and the two stages of order two that need no rate of the flow at the begin.
_GOING = (2 * LENGTH, (LENGTH, 0.5 - LENGTH / 2), (0.0, 0.5 - LENGTH / 2))
_STARTING = (LENGTH, (0.0, 0.0), (0.0, 1 - LENGTH))


class Trial(NamedTuple):
    """A step that was tried."""

    half: Half  # its end
    past: Past  # what the material then remembers
    wrong: StationVector  # error of the unknowns
    # of the instantaneous stress over the step, its second
    # derivative times the square of the step [Pa]
    bend: Float[Array, ""]
    stress: Float[Array, ""]  # instantaneous one at its end [Pa]
    good: Bool[Array, ""]  # whether both halves were found


def tried(
    moving: MovingSkin, now: Moving, step: Array, values: Callable[[Array], Values]
) -> Trial:
    """Both halves of a step."""
    series = moving.skin.series
    stages = jax.tree.map(
        lambda a, b: jnp.where(now.jumped, a, b), _stages(*_STARTING), _stages(*_GOING)
    )
    exact = _EXACT_STEP * now.largest
    none = jnp.zeros((), jnp.int32)
    begin = Half(
        *(now.state, now.velocity, now.flow, now.rate, now.travels.length, now.share),
        *(none, now.inverse, jnp.asarray(True)),
    )

    def based(x: Any, first: Any, before: Any, weights: tuple[Array, Array]) -> Any:
        a, b = (step * w for w in weights)
        return jax.tree.map(lambda x, y, z: x + a * y + b * z, x, first, before)

    def visit(carry: tuple[Half, Past, Array], stage: _Stages) -> Any:
        last, past, time = carry
        elapsed = (stage.end - time) * step
        weights = stage.first, stage.before
        base = Base(
            based(now.state.q, now.velocity, last.velocity, weights),
            based(now.flow, now.rate, last.rate, weights),
            LENGTH * step,
        )
        given = values(stage.end)
        found = moving.half(given, past, elapsed, base, last, exact)
        found = found._replace(good=found.good & last.good)
        stress = moving.stress(given, found.state.q)
        past = past.after(series, elapsed, stress)
        return (found, past, stage.end), (found.velocity, stress)

    halves = stages._replace(wrong=jnp.zeros(2))
    carry, (velocities, stresses) = jax.lax.scan(visit, (begin, now.past, 0 * step), halves)
    end, past, _ = carry
    rates = jnp.concatenate([now.velocity[None], velocities])
    wrong = step * jnp.tensordot(stages.wrong, rates, 1)
    moment = moving.at(values(jnp.ones(())), now.past.seen(series, step))
    wrong = moment.lasting(end, wrong)
    middle = stages.end[0]
    slopes = (
        (stresses[0] - now.past.stress) / middle,
        (stresses[1] - stresses[0]) / (1 - middle),
    )
    bend = 2 * jnp.max(jnp.abs(slopes[1] - slopes[0]))
    return Trial(end, past, wrong, bend, jnp.max(jnp.abs(stresses[1])), end.good)
