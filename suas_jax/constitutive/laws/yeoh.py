"""The Yeoh law."""

import equinox as eqx
from jaxtyping import Array, Float

from suas_jax.config.laws.yeoh import YeohSpec
from suas_jax.constitutive.base import AbstractLaw, constant
from suas_jax.constitutive.deformation import AbstractDeformation


class Yeoh(AbstractLaw):
    """A cubic in I₁ − 3: softening, then stiffening at large strain (Yeoh 1993).

    Ψ = C₁ (I₁ − 3) + C₂ (I₁ − 3)² + C₃ (I₁ − 3)³

    Example:
        `Yeoh(0.2e6, -2e3, 50.0).shear_modulus`  (0.4 MPa)

    Attributes:
        C1: C₁ [Pa], shape [*lanes].
        C2: C₂ [Pa], shape [*lanes].
        C3: C₃ [Pa], shape [*lanes].

    Raises:
        ValueError: C₁ is not positive and finite, or C₂ or C₃ is not finite.
    """

    spec = YeohSpec

    C1: Float[Array, "*lanes"] = eqx.field(converter=constant)
    C2: Float[Array, "*lanes"] = eqx.field(converter=constant, default=0.0)
    C3: Float[Array, "*lanes"] = eqx.field(converter=constant, default=0.0)

    def energy(self, deformation: AbstractDeformation) -> Float[Array, "..."]:
        """Ψ = C₁ (I₁ − 3) + C₂ (I₁ − 3)² + C₃ (I₁ − 3)³ [J/m³]."""
        i1 = deformation.I1_minus_3
        return (self.C1 + (self.C2 + self.C3 * i1) * i1) * i1

    @property
    def shear_modulus(self) -> Float[Array, "*lanes"]:
        """Small-strain shear modulus 2 C₁ [Pa]."""
        return 2.0 * self.C1
