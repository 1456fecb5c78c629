"""Stress relaxation and softening of a rubber beside an elastic law.

In the generalised Maxwell model the second Piola-Kirchhoff stress S of the instantaneous law,
its deviator pulled back, fades by a Prony series (Simo 1987), in every direction of the
undeformed material alike::

    S(t) = ∫ G(t − s) dS₀(s),   G(t) = 1 − Σ g_i (1 − exp(−t/τ_i))

At a strain that is held, the stress is the elastic one times G; after a long time it is that of
the law with all its stress constants times 1 − Σ g_i.

Below its largest load before, a rubber's stress is that of the elastic law times (the Mullins
effect; Ogden and Roxburgh 1999, width as in Abaqus)

    η = 1 − erf((W_max − W)/(m + β W_max))/r

with W the law's energy and W_max the largest of its past. On first loading η is one.

J. C. Simo, On a fully three-dimensional finite-strain viscoelastic damage model, Computer
Methods in Applied Mechanics and Engineering 60 (1987), 153-173.

R. W. Ogden, D. G. Roxburgh, A pseudo-elastic model for the Mullins effect in filled rubber,
Proceedings of the Royal Society A 455 (1999), 2861-2877.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from suas_jax.constitutive.base import AbstractLaw
from suas_jax.constitutive.deformation import AbstractDeformation

_SHORT = 1e-6


class PronySeries(eqx.Module):
    """Normalised relaxation modulus, G(t) = 1 − Σ g_i (1 − exp(−t/τ_i))."""

    g: Float[Array, " terms"]  # shares of the instantaneous stress that relax, shape [terms]
    tau: Float[Array, " terms"]  # relaxation times τ_i [s], shape [terms]

    @property
    def long_term_share(self) -> Float[Array, ""]:
        """Long-term over instantaneous modulus, 1 − Σ g_i."""
        return 1.0 - jnp.sum(self.g)

    def modulus(self, time: Float[Array, "..."]) -> Float[Array, "..."]:
        """G(t) for times since a step of strain [s], any shape."""
        faded = -jnp.expm1(-time[..., None] / self.tau)
        return 1.0 - jnp.sum(self.g * faded, axis=-1)

    def over(self, elapsed: Array) -> tuple[Float[Array, " terms"], Float[Array, " terms"]]:
        """What is left of a stress after a time, and of one that has grown evenly during it.

        `elapsed`: the time [s]; zero leaves all of either.
        Returns exp(−x) and (1 − exp(−x))/x with x = t/τ.
        """
        x = elapsed / self.tau
        short = x < _SHORT
        safe = jnp.where(short, 1.0, x)
        return jnp.exp(-x), jnp.where(short, 1.0 - 0.5 * x, -jnp.expm1(-safe) / safe)

    def relaxed(
        self,
        elapsed: Float[Array, " n"],  # time since the row before [s], shape [n]; zero is a step
        # where another history begins: the material is at rest before, and the row is reached
        # by a step, or held since `elapsed`, shape [n]
        begins: Bool[Array, " n"],
        history: Float[Array, "n k"],  # S₀, shape [n, k]
    ) -> Float[Array, "n k"]:
        """Convolve stress histories, ∫ G(t − s) dS₀(s), with G.

        Exact for stresses that change linearly between the given times.
        """

        def advance(
            carry: tuple[Array, Array], row: tuple[Array, Array, Array]
        ) -> tuple[tuple[Array, Array], Array]:
            parts, before = carry
            dt, begin, now = row
            parts = jnp.where(begin, 0.0, parts)
            change = now - jnp.where(begin, 0.0, before)
            fade, mean = self.over(dt)
            # A first row is reached by a step, and then held.
            share = jnp.where(begin, fade, mean)
            parts = fade[:, None] * parts + (self.g * share)[:, None] * change
            return (parts, now), self.long_term_share * now + jnp.sum(parts, axis=0)

        columns = history.shape[1]
        start = (jnp.zeros((len(self.g), columns)), jnp.zeros(columns))
        _, found = jax.lax.scan(advance, start, (elapsed, begins, history))
        return found


class Past(NamedTuple):
    """What a material remembers: stresses at the end of a step."""

    # S₀ of the instantaneous law, its deviator pulled back [Pa]
    stress: Float[Array, " *shape"]
    parts: Float[Array, "terms *shape"]  # what is left of it, a term each: the Q_i of Simo [Pa]

    @classmethod
    def none(cls, series: PronySeries, shape: tuple[int, ...]) -> "Past":
        """Of a material that has always been at rest."""
        return cls(jnp.zeros(shape), jnp.zeros((*series.g.shape, *shape)))

    def after(self, series: PronySeries, elapsed: Array, stress: Array) -> "Past":
        """The past at the end of a step over which S₀ has changed linearly."""
        fade, mean = (_over(x, self.parts) for x in series.over(elapsed))
        growth = _over(series.g, self.parts) * mean * (stress - self.stress)
        return Past(stress, fade * self.parts + growth)

    def seen(self, series: PronySeries, elapsed: Array) -> "Response":
        """How the material answers at the end of a step."""
        fade, mean = series.over(elapsed)
        lost = jnp.sum(series.g * mean)
        return Response(
            series.long_term_share + lost,
            jnp.sum(_over(fade, self.parts) * self.parts, 0) - lost * self.stress,
        )

    def relaxed(self, series: PronySeries) -> "Response":
        """The stress of now, with the stiffness that has relaxed as far as the stress has.

        It is the instantaneous one in a material that has just been loaded, and the long-term
        one where the strain has been held for long.
        """
        now = series.long_term_share * self.stress + jnp.sum(self.parts, 0)
        size = jnp.sum(self.stress**2)
        ratio = jnp.sum(now * self.stress) / jnp.where(size > 0, size, 1.0)
        share = jnp.clip(jnp.where(size > 0, ratio, 1.0), series.long_term_share, 1.0)
        return Response(share, now - share * self.stress)

    def disturbed(self, series: PronySeries) -> "Response":
        """The stress of now, with the stiffness that small motions meet before it fades.

        As `relaxed`, but of a material that has just been released, whose stress has not
        relaxed but changed its sign, the instantaneous one.
        """
        remembered = jnp.sum(self.parts, 0)
        size, left = jnp.sum(self.stress**2), jnp.sum(remembered**2)
        ratio = jnp.sqrt(jnp.where(size > 0, left / jnp.where(size > 0, size, 1.0), jnp.inf))
        share = jnp.minimum(series.long_term_share + ratio, 1.0)
        now = series.long_term_share * self.stress + remembered
        return Response(share, now - share * self.stress)


class Response(NamedTuple):
    """Stress S = share S₀ + rest: what a step makes of an instantaneous law."""

    share: Float[Array, ""]  # of the instantaneous stress
    rest: Float[Array, " *shape"]  # what the past adds, whatever the strain [Pa]


def _over(terms: Array, parts: Array) -> Array:
    """A number a term, to multiply stresses with."""
    return terms.reshape(-1, *(1,) * (parts.ndim - 1))


class OgdenRoxburgh(eqx.Module):
    """Softening of Ogden and Roxburgh."""

    r: Float[Array, ""]  # 1/r is the largest share of the stress that is lost; greater than one
    m: Float[Array, ""]  # energy below W_max over which it is lost [J/m³]
    beta: Float[Array, ""]  # how much that energy grows with W_max

    def factor(
        self, energy: Float[Array, "..."], largest: Float[Array, "..."]
    ) -> Float[Array, "..."]:
        """η for an energy and the largest one before [J/m³], any shape."""
        width = self.m + self.beta * largest
        return 1.0 - jax.lax.erf((largest - energy) / width) / self.r


def largest_before(energy: Float[Array, " n"], begins: Bool[Array, " n"]) -> Float[Array, " n"]:
    """Largest energy of each history up to and including a row.

    `energy`: W in the order of time, histories one after the other, shape [n]. `begins`: where
    another history begins, shape [n].
    """

    def later(before: Array, row: tuple[Array, Array]) -> tuple[Array, Array]:
        now, begin = row
        largest = jnp.where(begin, now, jnp.maximum(before, now))
        return largest, largest

    _, found = jax.lax.scan(later, jnp.zeros_like(energy[0]), (energy, begins))
    return found


class Inelastic(AbstractLaw):
    """A law whose stress relaxes and softens.

    As a law it is the long-term elastic one of the virgin material, the source of all stress:
    relaxation starts from this law over 1 − Σ g_i.
    """

    elastic: AbstractLaw  # the long-term law
    relaxation: PronySeries | None = None  # None where the stress does not relax
    softening: OgdenRoxburgh | None = None  # None where it does not soften

    def energy(self, deformation: AbstractDeformation) -> Float[Array, "..."]:
        """Ψ of the long-term law of the virgin material [J/m³]."""
        return self.elastic.energy(deformation)

    @property
    def shear_modulus(self) -> Float[Array, "..."]:
        """Long-term small-strain shear modulus [Pa]."""
        return self.elastic.shear_modulus
