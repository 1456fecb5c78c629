"""The Arruda-Boyce eight-chain law, as the series that finite-element codes use."""

import equinox as eqx
from jaxtyping import Array, Float

from suas_jax.config.laws.arruda_boyce import ArrudaBoyceSpec
from suas_jax.constitutive.base import AbstractLaw, constant
from suas_jax.constitutive.deformation import AbstractDeformation

# Series of the inverse Langevin function, C_i of Arruda and Boyce (1993), Eq. 23.
_SERIES = (1.0 / 2.0, 1.0 / 20.0, 11.0 / 1050.0, 19.0 / 7000.0, 519.0 / 673750.0)
# (3 + x)^i − 3^i by powers of x = I₁ − 3, so that small strains keep their digits.
_POWERS = (
    (1.0,),
    (6.0, 1.0),
    (27.0, 9.0, 1.0),
    (108.0, 54.0, 12.0, 1.0),
    (405.0, 270.0, 90.0, 15.0, 1.0),
)


class ArrudaBoyce(AbstractLaw):
    """Eight-chain network of Langevin chains, five terms of its series (Arruda, Boyce 1993).

    Ψ = μ Σ_{i=1..5} C_i λ_m^(2 − 2i) (I₁^i − 3^i)
    C = 1/2, 1/20, 11/1050, 19/7000, 519/673750

    μ is the rubbery modulus nkT. The modulus at small strain is larger,
    μ (1 + 3/(5λ_m²) + 99/(175λ_m⁴) + 513/(875λ_m⁶) + 42039/(67375λ_m⁸)).

    Example:
        `ArrudaBoyce(0.28e6, 5.1).shear_modulus`  (0.287 MPa)

    Attributes:
        mu: rubbery modulus μ [Pa], shape [*lanes].
        lambda_m: locking stretch of a chain λ_m, shape [*lanes].

    Raises:
        ValueError: μ or λ_m is not positive and finite.
    """

    spec = ArrudaBoyceSpec

    mu: Float[Array, "*lanes"] = eqx.field(converter=constant)
    lambda_m: Float[Array, "*lanes"] = eqx.field(converter=constant)

    def energy(self, deformation: AbstractDeformation) -> Float[Array, "..."]:
        """Ψ = μ Σ C_i λ_m^(2 − 2i) (I₁^i − 3^i) [J/m³]."""
        x = deformation.I1_minus_3
        shortness = 1.0 / self.lambda_m**2
        total = 0.0 * x
        for term, powers in zip(reversed(_SERIES), reversed(_POWERS), strict=True):
            polynomial = powers[-1] * x
            for coefficient in powers[-2::-1]:
                polynomial = (polynomial + coefficient) * x
            total = total * shortness + term * polynomial
        return self.mu * total

    @property
    def shear_modulus(self) -> Float[Array, "*lanes"]:
        """Small-strain shear modulus 2μ Σ i C_i (3/λ_m²)^(i − 1) [Pa]."""
        shortness = 1.0 / self.lambda_m**2
        total = 0.0 * shortness
        for term, powers in zip(reversed(_SERIES), reversed(_POWERS), strict=True):
            total = total * shortness + 2.0 * term * powers[0]
        return self.mu * total
