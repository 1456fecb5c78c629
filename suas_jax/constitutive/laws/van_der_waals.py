"""The van der Waals law."""

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from suas_jax.config.laws.van_der_waals import VanDerWaalsSpec
from suas_jax.constitutive.base import AbstractLaw, constant
from suas_jax.constitutive.deformation import AbstractDeformation

_SMALL, _TERMS = 0.1, 16
# Below this x the root of it has no derivative that counts.
_AT_REST = 1e-30


class VanDerWaals(AbstractLaw):
    """A network of limited stretch whose chains attract each other (Kilian 1981).

    Ψ = μ {−L [log(1 − η) + η] − ⅔ a (x/2)^(3/2)},   η = √(x/L),   L = λ_m² − 3
    x = (1 − β)(I₁ − 3) + β(I₂ − 3)

    H.-G. Kilian, Equation of state of real networks, Polymer 22 (1981), 209-217, in the form of
    Abaqus. Beyond x = L there is no energy: it is not a number there. The third derivative by
    strain is not defined at rest.

    Example:
        `VanDerWaals(0.4e6, 10.0, 0.25, 0.05).shear_modulus`  (0.4 MPa)

    Attributes:
        mu: shear modulus μ [Pa], shape [*lanes].
        lambda_m: locking stretch λ_m, shape [*lanes].
        a: interaction of the chains, shape [*lanes].
        beta: share of the second invariant β, shape [*lanes].

    Raises:
        ValueError: a constant is not positive and finite.
    """

    spec = VanDerWaalsSpec
    has_limit = True

    mu: Float[Array, "*lanes"]
    lambda_m: Float[Array, "*lanes"]
    a: Float[Array, "*lanes"]
    beta: Float[Array, "*lanes"]

    def __init__(
        self, mu: ArrayLike, lambda_m: ArrayLike, a: ArrayLike, beta: ArrayLike
    ) -> None:
        self.mu, self.lambda_m = constant(mu), constant(lambda_m)
        self.a, self.beta = constant(a), constant(beta)

    def energy(self, deformation: AbstractDeformation) -> Float[Array, "..."]:
        """Ψ of the network with its interaction [J/m³]."""
        x = (1.0 - self.beta) * deformation.I1_minus_3 + self.beta * deformation.I2_minus_3
        root = jnp.sqrt(jnp.maximum(x, _AT_REST))
        eta = root / jnp.sqrt(self.lambda_m**2 - 3.0)
        # −L (log(1 − η) + η) = x h(η) and (x/2)^(3/2): what multiplies x is one half at rest.
        return self.mu * x * (_locking(eta) - self.a * root / (3.0 * 2.0**0.5))

    @property
    def shear_modulus(self) -> Float[Array, "*lanes"]:
        """Small-strain shear modulus μ [Pa]."""
        return self.mu + 0.0 * (self.lambda_m + self.a + self.beta)


def _locking(eta: Float[Array, "..."]) -> Float[Array, "..."]:
    """h(η) = −(log(1 − η) + η)/η² = ½ + η/3 + η²/4 + ..., with all its digits."""
    near = eta < _SMALL
    small = jnp.where(near, eta, 0.0)
    series = jnp.zeros_like(small)
    for power in reversed(range(_TERMS)):
        series = series * small + 1.0 / (power + 2.0)
    far = jnp.where(near, 0.5, eta)
    return jnp.where(near, series, -(jnp.log1p(-far) + far) / far**2)
