"""Carroll's law."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from suas_jax.config.laws.carroll import CarrollSpec
from suas_jax.constitutive.base import AbstractLaw, constant
from suas_jax.constitutive.deformation import AbstractDeformation

_ROOT_3 = 3.0**0.5


class Carroll(AbstractLaw):
    """Three terms that follow uniaxial and equibiaxial data at once (Carroll 2011).

    Ψ = A (I₁ − 3) + B (I₁⁴ − 81) + C (√I₂ − √3)

    M. M. Carroll, A strain energy function for vulcanized rubbers, Journal of Elasticity 103
    (2011), 173-187. In plane strain I₁ = I₂, so that C softens what A alone would give.

    Example:
        `Carroll(0.15e6, 0.31, 95e3).shear_modulus`  (0.355 MPa)

    Attributes:
        A: A [Pa], shape [*lanes].
        B: B [Pa], shape [*lanes].
        C: C [Pa], shape [*lanes].

    Raises:
        ValueError: a constant is not positive and finite.
    """

    spec = CarrollSpec

    A: Float[Array, "*lanes"] = eqx.field(converter=constant)
    B: Float[Array, "*lanes"] = eqx.field(converter=constant)
    C: Float[Array, "*lanes"] = eqx.field(converter=constant)

    def energy(self, deformation: AbstractDeformation) -> Float[Array, "..."]:
        """Ψ = A (I₁ − 3) + B (I₁⁴ − 81) + C (√I₂ − √3) [J/m³]."""
        x, y = deformation.I1_minus_3, deformation.I2_minus_3
        # By powers of x and with the difference of roots, so that small strains keep digits.
        quartic = (108.0 + (54.0 + (12.0 + x) * x) * x) * x
        return self.A * x + self.B * quartic + self.C * y / (jnp.sqrt(3.0 + y) + _ROOT_3)

    @property
    def shear_modulus(self) -> Float[Array, "*lanes"]:
        """Small-strain shear modulus 2A + 216B + C/√3 [Pa]."""
        return 2.0 * self.A + 216.0 * self.B + self.C / _ROOT_3
