"""The Gent law."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from suas_jax.config.laws.gent import GentSpec
from suas_jax.constitutive.base import AbstractLaw, constant
from suas_jax.constitutive.deformation import AbstractDeformation


class Gent(AbstractLaw):
    """Limited chain extensibility: the stress grows without bound at I₁ − 3 = J_m (Gent 1996).

    Ψ = −μ J_m/2 log(1 − (I₁ − 3)/J_m)

    Neo-Hookean for J_m → ∞. Beyond the locking stretch there is no energy: it is not a
    number there.

    Example:
        `Gent(0.4e6, 80.0).shear_modulus`  (0.4 MPa)

    Attributes:
        mu: shear modulus μ [Pa], shape [*lanes].
        Jm: J_m, the largest I₁ − 3, shape [*lanes].

    Raises:
        ValueError: μ or J_m is not positive and finite.
    """

    spec = GentSpec
    has_limit = True

    mu: Float[Array, "*lanes"] = eqx.field(converter=constant)
    Jm: Float[Array, "*lanes"] = eqx.field(converter=constant)

    def energy(self, deformation: AbstractDeformation) -> Float[Array, "..."]:
        """Ψ = −μ J_m/2 log(1 − (I₁ − 3)/J_m) [J/m³]."""
        return -0.5 * self.mu * self.Jm * jnp.log1p(-deformation.I1_minus_3 / self.Jm)

    @property
    def shear_modulus(self) -> Float[Array, "*lanes"]:
        """Small-strain shear modulus μ [Pa]."""
        return self.mu * jnp.ones_like(self.Jm)
