"""A skin in motion: what obeys the equations of half a step, at the values of the moment."""

import dataclasses
from typing import Self

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from suas_jax.constitutive.relaxation import Past, Response
from suas_jax.dynamics.driven import DrivenSkin, Values, answering, membrane_of
from suas_jax.dynamics.half_step import Base, Half, SkinAtMoment
from suas_jax.dynamics.inertia import Densities, densities_of
from suas_jax.numerics.array_types import StationVector

_FORCE, _MOST_FORCES = 1e-8, 8  # relative error of a force, and most repetitions
_SHARE = 1.5  # of a force, at most


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
