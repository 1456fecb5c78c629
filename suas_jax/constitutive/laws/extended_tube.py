"""The extended tube law."""

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from suas_jax.config.laws.extended_tube import ExtendedTubeSpec
from suas_jax.constitutive.base import AbstractLaw, constant
from suas_jax.constitutive.deformation import AbstractDeformation


class ExtendedTube(AbstractLaw):
    """Crosslinks of limited stretch, and chains confined to a tube (Kaliske, Heinrich 1999).

    Ψ = G_c/2 [(1 − δ²)x/(1 − δ²x) + log(1 − δ²x)] + 2G_e/β² Σ (λ_i^−β − 1),   x = I₁ − 3

    M. Kaliske, G. Heinrich, An extended tube-model for rubber elasticity, Rubber Chemistry and
    Technology 72 (1999), 602-632. Beyond x = 1/δ² there is no energy: it is not a number there.

    Example:
        `ExtendedTube(0.19e6, 0.2e6, 0.09, 0.2).shear_modulus`  (0.387 MPa)

    Attributes:
        Gc: modulus of the crosslinks G_c [Pa], shape [*lanes].
        Ge: modulus of the tube G_e [Pa], shape [*lanes].
        delta: inextensibility δ, shape [*lanes].
        beta: release of the confinement β, shape [*lanes].

    Raises:
        ValueError: a constant is not positive and finite.
    """

    spec = ExtendedTubeSpec
    has_limit = True

    Gc: Float[Array, "*lanes"]
    Ge: Float[Array, "*lanes"]
    delta: Float[Array, "*lanes"]
    beta: Float[Array, "*lanes"]

    def __init__(self, Gc: ArrayLike, Ge: ArrayLike, delta: ArrayLike, beta: ArrayLike) -> None:
        self.Gc, self.Ge = constant(Gc), constant(Ge)
        self.delta, self.beta = constant(delta), constant(beta)

    def energy(self, deformation: AbstractDeformation) -> Float[Array, "..."]:
        """Ψ of crosslinks and tube [J/m³]."""
        x, share = deformation.I1_minus_3, self.delta**2
        room = 1.0 - share * x
        # Beyond the limit the quotient alone would be a number again.
        links = (1.0 - share) * x / room + jnp.log1p(-share * x)
        tube = deformation.power_sum_minus_3(-self.beta)
        return 0.5 * self.Gc * links + 2.0 * self.Ge / self.beta**2 * tube

    @property
    def shear_modulus(self) -> Float[Array, "*lanes"]:
        """Small-strain shear modulus G_c (1 − 2δ²) + G_e [Pa]."""
        return self.Gc * (1.0 - 2.0 * self.delta**2) + self.Ge + 0.0 * self.beta
