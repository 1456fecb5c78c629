"""The Ogden law, and the two conventions in which its constants are published."""

import functools
from collections.abc import Callable
from typing import Any, ClassVar, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.config.law import LawSpec
from suas_jax.config.laws.ogden import OgdenSpec
from suas_jax.constitutive.base import AbstractLaw, Constants, constants, known
from suas_jax.constitutive.deformation import AbstractDeformation

CONVENTIONS = ("mu/alpha", "2mu/alpha^2")


class Ogden(AbstractLaw):
    """Ogden's law in principal stretches (Eq. 11), the `mu/alpha` convention.

    Ψ = Σ_p μ_p/α_p (λ₁^α_p + λ₂^α_p + λ₃^α_p − 3),   2μ = Σ_p μ_p α_p,   μ_p α_p > 0

    The condition on every term is the paper's Eq. 12. It makes every term's energy
    positive, so that the sum never cancels. Constants published with 2μ_p/α_p² in
    front of each term go through `Ogden.from_convention`.

    Example:
        `Ogden([6.3e5, 0.012e5, -0.1e5], [1.3, 5.0, -2.0])`  (Table I, μ = 0.4225 MPa)

    Attributes:
        mu: μ_p [Pa], shape [terms, *lanes]; a number is one term.
        alpha: α_p, shape [terms, *lanes]; lanes may be left out where they agree.

    Raises:
        ValueError: mu and alpha have different numbers of terms, none, or a term with
            μ_p α_p ≤ 0.
    """

    spec = OgdenSpec
    in_stretches: ClassVar[bool] = True

    mu: Float[Array, " terms *lanes"] = eqx.field(converter=constants)
    alpha: Float[Array, " terms *lanes"] = eqx.field(converter=constants)

    @classmethod
    def of_material(cls, material: LawSpec, value: Callable[[str], Any]) -> Self:
        """Build the law of a [material] table, in the convention that it states."""
        assert isinstance(material, OgdenSpec)
        terms = range(len(material.mu))
        mu = [value(f"mu.{p}") for p in terms]
        alpha = [value(f"alpha.{p}") for p in terms]
        return cls.from_convention(mu, alpha, material.convention)

    def __check_init__(self) -> None:
        _check_terms(self.mu, self.alpha)

    @classmethod
    def from_convention(cls, mu: Constants, alpha: Constants, convention: str) -> Self:
        """Build the law from constants published in either convention.

        Args:
            mu: μ_p [Pa], shape [terms, *lanes].
            alpha: α_p, shape [terms, *lanes].
            convention: "mu/alpha", where Ψ = Σ μ_p/α_p (...) (Eq. 11), or "2mu/alpha^2",
                where Ψ = Σ 2μ_p/α_p² (...) and μ = Σ μ_p.

        Returns:
            The law; differentiable with respect to `mu` and `alpha`.

        Raises:
            ValueError: the convention is unknown, or the constants are refused.
        """
        if convention not in CONVENTIONS:
            raise ValueError(
                f"Ogden law: unknown convention {convention!r}; it is one of {CONVENTIONS}"
            )
        mus, alphas = constants(mu), constants(alpha)
        if convention == "mu/alpha":
            return cls(mus, alphas)
        _check_terms(mus, alphas, sign_of="mu")
        terms = zip(mus, alphas, strict=True)
        return cls(constants([2.0 * m / a for m, a in terms]), alphas)

    def energy(self, deformation: AbstractDeformation) -> Float[Array, "..."]:
        """Ψ = Σ μ_p/α_p (λ₁^α_p + λ₂^α_p + λ₃^α_p − 3) [J/m³]."""
        # A loop over the few terms, not an axis: the lanes stay the trailing axes, and
        # no array larger than the deformation itself is formed.
        sums = deformation.power_sums_minus_3(list(self.alpha))
        terms = zip(self.mu, self.alpha, sums, strict=True)
        return functools.reduce(
            jnp.add, [mu / alpha * power_sum for mu, alpha, power_sum in terms]
        )

    @property
    def shear_modulus(self) -> Float[Array, "*lanes"]:
        """Small-strain shear modulus μ = ½ Σ μ_p α_p [Pa] (Eq. 12)."""
        terms = zip(self.mu, self.alpha, strict=True)
        return 0.5 * functools.reduce(jnp.add, [mu * alpha for mu, alpha in terms])


def _check_terms(mu: Array, alpha: Array, sign_of: str = "mu*alpha") -> None:
    """Raise on unequal or empty lists, and on terms that break Eq. 12.

    With `sign_of="mu"` the constants are in the 2μ/α² convention, where Eq. 12 reads
    μ_p > 0 and α_p ≠ 0.
    """
    if mu.shape[0] != alpha.shape[0]:
        raise ValueError(
            f"Ogden law: mu has {mu.shape[0]} terms and alpha has {alpha.shape[0]}; "
            "they must have the same number"
        )
    if mu.shape[0] == 0:
        raise ValueError("Ogden law: at least one term is needed")
    try:
        jnp.broadcast_shapes(mu.shape[1:], alpha.shape[1:])
    except ValueError as error:
        raise ValueError(
            f"Ogden law: the lanes of mu {mu.shape[1:]} and alpha {alpha.shape[1:]} "
            "do not broadcast"
        ) from error
    mus, alphas = known(mu), known(alpha)
    if mus is None or alphas is None:
        return
    for term, (m, a) in enumerate(zip(mus, alphas, strict=True)):
        product = m * a if sign_of == "mu*alpha" else m * np.abs(a)
        if not np.all(np.isfinite(product) & (product > 0)):
            raise ValueError(
                f"Ogden law: term {term} has mu = {m} Pa and alpha = {a}; "
                f"{sign_of} must be positive and finite, and alpha not zero (Eq. 12)"
            )
