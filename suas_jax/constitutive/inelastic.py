"""An elastic law with the relaxation of its stress, and its softening: the Mullins effect.

Below its largest load before, a rubber's stress is that of the elastic law times (Ogden and
Roxburgh 1999, width as in Abaqus)

    η = 1 − erf((W_max − W)/(m + β W_max))/r

with W the law's energy and W_max the largest of its past. On first loading η is one.

R. W. Ogden, D. G. Roxburgh, A pseudo-elastic model for the Mullins effect in filled rubber,
Proceedings of the Royal Society A 455 (1999), 2861-2877.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from suas_jax.constitutive.base import AbstractLaw
from suas_jax.constitutive.deformation import AbstractDeformation
from suas_jax.constitutive.relaxation import PronySeries


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
