"""The Mooney-Rivlin law, in the three-constant form used for the skin's EPDM."""

import equinox as eqx
from jaxtyping import Array, Float

from suas_jax.config.laws.mooney_rivlin import MooneyRivlinSpec
from suas_jax.constitutive.base import AbstractLaw, constant
from suas_jax.constitutive.deformation import AbstractDeformation


class MooneyRivlin(AbstractLaw):
    """Mooney-Rivlin law with a second-order term in I₂ (Eq. 23).

    Ψ = C₁ (I₁ − 3) + C₂ (I₂ − 3) + C₃ (I₂ − 3)²

    The paper's EPDM has C₁ = 20.7 MPa, C₂ = −4.4 MPa, C₃ = 77 kPa. With C₂ < 0 the law
    is stable in a window of stretches only: see `stability.stable_range`. In plane
    strain I₁ = I₂, so that C₁ and C₂ act through their sum alone.

    Example:
        `MooneyRivlin(20.7e6, -4.4e6, 77e3).shear_modulus`  (32.6 MPa)

    Attributes:
        C1: C₁ [Pa], shape [*lanes].
        C2: C₂ [Pa], shape [*lanes].
        C3: C₃ [Pa], shape [*lanes].

    Raises:
        ValueError: the modulus 2 (C₁ + C₂) is not positive and finite, or C₃ is not
            finite.
    """

    spec = MooneyRivlinSpec

    C1: Float[Array, "*lanes"] = eqx.field(converter=constant)
    C2: Float[Array, "*lanes"] = eqx.field(converter=constant, default=0.0)
    C3: Float[Array, "*lanes"] = eqx.field(converter=constant, default=0.0)

    def energy(self, deformation: AbstractDeformation) -> Float[Array, "..."]:
        """Ψ = C₁ (I₁ − 3) + C₂ (I₂ − 3) + C₃ (I₂ − 3)² [J/m³]."""
        i2 = deformation.I2_minus_3
        return self.C1 * deformation.I1_minus_3 + (self.C2 + self.C3 * i2) * i2

    @property
    def shear_modulus(self) -> Float[Array, "*lanes"]:
        """Small-strain shear modulus 2 (C₁ + C₂) [Pa]."""
        return 2.0 * (self.C1 + self.C2)
