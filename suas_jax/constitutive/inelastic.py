"""An elastic law with the relaxation and the softening of its stress."""

from jaxtyping import Array, Float

from suas_jax.constitutive.base import AbstractLaw
from suas_jax.constitutive.deformation import AbstractDeformation
from suas_jax.constitutive.relaxation import PronySeries
from suas_jax.constitutive.softening import OgdenRoxburgh


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
