"""The general polynomial law in the invariants I₁ and I₂."""

import equinox as eqx
from jaxtyping import Array, Float

from suas_jax.config.laws.polynomial import PolynomialSpec
from suas_jax.constitutive.base import AbstractLaw, constant
from suas_jax.constitutive.deformation import AbstractDeformation


class Polynomial(AbstractLaw):
    """All products of I₁ − 3 and I₂ − 3 up to the third degree (Rivlin and Saunders 1951).

    Ψ = Σ_{1 ≤ i+j ≤ 3} C_ij (I₁ − 3)^i (I₂ − 3)^j

    Mooney-Rivlin, Yeoh, Biderman and Signorini's law are special cases.

    Example:
        `Polynomial(C10=0.17e6, C01=5e3, C30=40.0).shear_modulus`  (0.35 MPa)

    Attributes:
        C10: ..., each C_ij [Pa], shape [*lanes]; those left out are zero.

    Raises:
        ValueError: the modulus 2 (C₁₀ + C₀₁) is not positive and finite, or another
            constant is not finite.
    """

    spec = PolynomialSpec

    C10: Float[Array, "*lanes"] = eqx.field(converter=constant)
    C01: Float[Array, "*lanes"] = eqx.field(converter=constant, default=0.0)
    C20: Float[Array, "*lanes"] = eqx.field(converter=constant, default=0.0)
    C11: Float[Array, "*lanes"] = eqx.field(converter=constant, default=0.0)
    C02: Float[Array, "*lanes"] = eqx.field(converter=constant, default=0.0)
    C30: Float[Array, "*lanes"] = eqx.field(converter=constant, default=0.0)
    C21: Float[Array, "*lanes"] = eqx.field(converter=constant, default=0.0)
    C12: Float[Array, "*lanes"] = eqx.field(converter=constant, default=0.0)
    C03: Float[Array, "*lanes"] = eqx.field(converter=constant, default=0.0)

    def energy(self, deformation: AbstractDeformation) -> Float[Array, "..."]:
        """Ψ = Σ C_ij (I₁ − 3)^i (I₂ − 3)^j [J/m³]."""
        x, y = deformation.I1_minus_3, deformation.I2_minus_3
        without_y = (self.C10 + (self.C20 + self.C30 * x) * x) * x
        first = self.C01 + (self.C11 + self.C21 * x) * x
        second = self.C02 + self.C12 * x
        return without_y + (first + (second + self.C03 * y) * y) * y

    @property
    def shear_modulus(self) -> Float[Array, "*lanes"]:
        """Small-strain shear modulus 2 (C₁₀ + C₀₁) [Pa]."""
        return 2.0 * (self.C10 + self.C01)
