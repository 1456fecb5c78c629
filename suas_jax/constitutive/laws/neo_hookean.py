"""The neo-Hookean law."""

import equinox as eqx
from jaxtyping import Array, Float

from suas_jax.config.laws.neo_hookean import NeoHookeanSpec
from suas_jax.constitutive.base import AbstractLaw, constant
from suas_jax.constitutive.deformation import AbstractDeformation


class NeoHookean(AbstractLaw):
    """One constant, the shear modulus.

    Ψ = μ/2 (I₁ − 3)

    Example:
        `NeoHookean(32.6e6).energy(FibreStretch(0.1))`

    Attributes:
        mu: shear modulus μ [Pa], shape [*lanes].

    Raises:
        ValueError: μ is not positive and finite.
    """

    spec = NeoHookeanSpec

    mu: Float[Array, "*lanes"] = eqx.field(converter=constant)

    def energy(self, deformation: AbstractDeformation) -> Float[Array, "..."]:
        """Ψ = μ/2 (I₁ − 3) [J/m³]."""
        return 0.5 * self.mu * deformation.I1_minus_3

    @property
    def shear_modulus(self) -> Float[Array, "*lanes"]:
        """Small-strain shear modulus μ [Pa]."""
        return self.mu
