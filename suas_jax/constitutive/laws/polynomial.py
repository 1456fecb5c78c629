"""The general polynomial law in the invariants I₁ and I₂."""

from jaxtyping import Array, ArrayLike, Float

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

    C10: Float[Array, "*lanes"]
    C01: Float[Array, "*lanes"]
    C20: Float[Array, "*lanes"]
    C11: Float[Array, "*lanes"]
    C02: Float[Array, "*lanes"]
    C30: Float[Array, "*lanes"]
    C21: Float[Array, "*lanes"]
    C12: Float[Array, "*lanes"]
    C03: Float[Array, "*lanes"]

    def __init__(
        self,
        C10: ArrayLike,
        C01: ArrayLike = 0.0,
        C20: ArrayLike = 0.0,
        C11: ArrayLike = 0.0,
        C02: ArrayLike = 0.0,
        C30: ArrayLike = 0.0,
        C21: ArrayLike = 0.0,
        C12: ArrayLike = 0.0,
        C03: ArrayLike = 0.0,
    ) -> None:
        self.C10, self.C01 = constant(C10), constant(C01)
        self.C20, self.C11, self.C02 = constant(C20), constant(C11), constant(C02)
        self.C30, self.C21 = constant(C30), constant(C21)
        self.C12, self.C03 = constant(C12), constant(C03)

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
