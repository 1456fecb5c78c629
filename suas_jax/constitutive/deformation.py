"""How a state of deformation is presented to a material law.

An isotropic, incompressible law asks for two things: the invariants I₁ − 3 and I₂ − 3,
and the power sum λ₁^α + λ₂^α + λ₃^α − 3. Each class here answers from the numbers that
its mechanics has at hand.

Every answer is the *difference from rest*, written without cancellation: it is
quadratic in the strain, so a strain of 1e-9 gives 1e-18 to full relative accuracy. One
identity does most of it. With λ₁λ₂λ₃ = 1 and E_i^± = λ_i^±α − 1,

    Σλ_i^α − 3 = E₁⁻ E₂⁻ − E₁⁺ E₁⁻ − E₂⁺ E₂⁻.

No class knows a law, and nothing here perturbs a strain to keep stretches apart.
"""

import abc
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from suas_jax.numerics.analytic import asinh_sqrt_squared, cosh_sqrt_minus_1


class AbstractDeformation(eqx.Module):
    """A state of deformation, as an isotropic law sees it.

    Arrays may have any shape; law constants broadcast against their trailing axes.
    Where a state can change volume its isochoric part is meant, F̄ = J^(−1/3) F.
    """

    @property
    @abc.abstractmethod
    def I1_minus_3(self) -> Float[Array, "..."]:
        """First invariant less its value at rest, Σλ_i² − 3 (Eq. 21)."""

    @property
    @abc.abstractmethod
    def I2_minus_3(self) -> Float[Array, "..."]:
        """Second invariant less its value at rest, Σλ_i⁻² − 3 (Eq. 21)."""

    @abc.abstractmethod
    def power_sum_minus_3(self, alpha: ArrayLike) -> Float[Array, "..."]:
        """λ₁^α + λ₂^α + λ₃^α − 3.

        `alpha`: the exponent, of a shape that broadcasts against the deformation.
        Returns an array of the broadcast shape.
        """

    def power_sums_minus_3(self, alphas: Sequence[ArrayLike]) -> list[Float[Array, "..."]]:
        """The same for several exponents, what they share computed once."""
        return [self.power_sum_minus_3(alpha) for alpha in alphas]


class FibreStretch(AbstractDeformation):
    """Plane strain, incompressible, one fibre: stretches (λ, 1/λ, 1).

    The lumped shell's state. In plane strain I₁ = I₂; with e = λ² − 1,

        I₁ − 3 = e²/(1 + e),    Σλ_i^α − 3 = (exp(x) − 1)² exp(−x),  x = α/2 log(1 + e).
    """

    green: Float[Array, "..."]  # e = λ² − 1, any shape; twice the Green strain. Must exceed −1

    @property
    def I1_minus_3(self) -> Float[Array, "..."]:
        """λ² + λ⁻² − 2."""
        return self.green * self.green / (1.0 + self.green)

    @property
    def I2_minus_3(self) -> Float[Array, "..."]:
        """λ² + λ⁻² − 2, the same as I₁ − 3 in plane strain."""
        return self.I1_minus_3

    def power_sum_minus_3(self, alpha: ArrayLike) -> Float[Array, "..."]:
        """λ^α + λ^−α − 2."""
        x = 0.5 * jnp.asarray(alpha) * jnp.log1p(self.green)
        t = jnp.expm1(x)
        return t * t * jnp.exp(-x)


class HeldFibre(AbstractDeformation):
    """One fibre of an incompressible body that is held at a given length along the axis.

    Stretches are (λ_a^(−1/2) x, λ_a^(−1/2)/x, λ_a). With e = x² − 1, M = −α/2 log λ_a and the
    power sum S of `FibreStretch`,

        Σλ_i^α − 3 = e^M S + 2 e^M + e^(−2M) − 3.
    """

    green: Float[Array, "..."]  # e, any shape; must exceed −1
    axial: Float[Array, "..."]  # log λ_a, which broadcasts against it

    @property
    def I1_minus_3(self) -> Float[Array, "..."]:
        """See the class, α = 2."""
        return self._sum(-self.axial)

    @property
    def I2_minus_3(self) -> Float[Array, "..."]:
        """See the class, α = −2."""
        return self._sum(self.axial)

    def _sum(self, mean: Array) -> Array:
        fibre = FibreStretch(self.green)
        return jnp.exp(mean) * fibre.I1_minus_3 + _area_change(mean)

    def power_sum_minus_3(self, alpha: ArrayLike) -> Float[Array, "..."]:
        """See the class."""
        mean = -0.5 * jnp.asarray(alpha) * self.axial
        own = FibreStretch(self.green).power_sum_minus_3(alpha)
        return jnp.exp(mean) * own + _area_change(mean)


class PlaneStrain(AbstractDeformation):
    """Plane strain with a change of area: in-plane stretches λ₁, λ₂ and a third of one.

    The solid's state. Any isotropic law depends on I = F:F and J = det F of the plane;
    stored are the combinations that vanish at rest and are accurate near it. The energy
    is differentiated with respect to these two fields:

        m = I − 2J = (λ₁ − λ₂)²,   j = J − 1;   ∂Ψ/∂I = Ψ_m,   ∂Ψ/∂J = Ψ_j − 2Ψ_m.

    With λ₁,₂ = √J exp(±η) and M = α/6 log J the isochoric power sum is

        2 e^M (cosh αη − 1) + (e^M − 1)² (2 e^M + 1) e^(−2M).

    Stretches coincide at m = 0, where η ~ √m; cosh αη is analytic there and computed
    from η² alone, so derivatives of every order are exact, with no switch of formula.
    """

    distortion: Float[Array, "..."]  # m = I − 2J ≥ 0, any shape
    dilatation: Float[Array, "..."]  # j = J − 1 > −1, any shape

    @classmethod
    def from_displacement_gradient(cls, H: Float[Array, "2 2 *batch"]) -> "PlaneStrain":
        """Build the state from H = F − 1, without loss for small strains.

        `H`: displacement gradient ∂u_i/∂X_j, shape [2, 2, *batch].
        """
        distortion = (H[0, 0] - H[1, 1]) ** 2 + (H[0, 1] + H[1, 0]) ** 2
        dilatation = H[0, 0] + H[1, 1] + (H[0, 0] * H[1, 1] - H[0, 1] * H[1, 0])
        return cls(distortion, dilatation)

    @classmethod
    def from_invariants(cls, I: ArrayLike, J: ArrayLike) -> "PlaneStrain":  # noqa: E741
        """Build the state from I = F:F and J = det F of the plane, any shape."""
        return cls(jnp.asarray(I) - 2.0 * jnp.asarray(J), jnp.asarray(J) - 1.0)

    @property
    def I1_minus_3(self) -> Float[Array, "..."]:
        """J^(−2/3) (I + 1) − 3."""
        third = jnp.log1p(self.dilatation) / 3.0
        return self.distortion * jnp.exp(-2.0 * third) + _area_change(third)

    @property
    def I2_minus_3(self) -> Float[Array, "..."]:
        """J^(−4/3) (I + J²) − 3."""
        third = jnp.log1p(self.dilatation) / 3.0
        return self.distortion * jnp.exp(-4.0 * third) + _area_change(-third)

    def power_sum_minus_3(self, alpha: ArrayLike) -> Float[Array, "..."]:
        """J^(−α/3) (λ₁^α + λ₂^α + 1) − 3."""
        return self.power_sums_minus_3([alpha])[0]

    def power_sums_minus_3(self, alphas: Sequence[ArrayLike]) -> list[Float[Array, "..."]]:
        """See the base class."""
        eta_squared = asinh_sqrt_squared(0.25 * self.distortion / (1.0 + self.dilatation))
        return _power_sums(alphas, eta_squared, jnp.log1p(self.dilatation) / 6.0)


class InPlaneStrain(AbstractDeformation):
    """Incompressible, given by the metric in a plane; the stretch across it follows.

    The state of a fibre of a thin shell. With the metric C = 1 + e of the plane (2 × 2, by
    unit vectors at rest) the third stretch is det C^(−1/2). Stored are the invariants of
    e, τ = tr e and ν = det e; with d = det C − 1 = τ + ν,

        I₁ − 3 = d²/(1 + d) − ν,    I₂ − 3 = (d² − ν)/(1 + d).

    With λ₁,₂ = (1 + d)^(1/4) exp(±η) and M = α/4 log(1 + d) the power sum is

        2 e^M (cosh αη − 1) + (e^M − 1)² (2 e^M + 1) e^(−2M),

    where sinh² η = (λ₁ − λ₂)² / (4 √(1 + d)) is analytic in τ and ν also where stretches
    coincide: derivatives of every order are exact.
    """

    trace: Float[Array, "..."]  # τ, any shape
    determinant: Float[Array, "..."]  # ν, any shape; 1 + τ + ν must be positive

    @property
    def I1_minus_3(self) -> Float[Array, "..."]:
        """Tr C + 1/det C − 3."""
        d = self.trace + self.determinant
        return d * d / (1.0 + d) - self.determinant

    @property
    def I2_minus_3(self) -> Float[Array, "..."]:
        """Det C + tr C/det C − 3."""
        d = self.trace + self.determinant
        return (d * d - self.determinant) / (1.0 + d)

    def power_sum_minus_3(self, alpha: ArrayLike) -> Float[Array, "..."]:
        """λ₁^α + λ₂^α + (λ₁λ₂)^−α − 3."""
        return self.power_sums_minus_3([alpha])[0]

    def power_sums_minus_3(self, alphas: Sequence[ArrayLike]) -> list[Float[Array, "..."]]:
        """See the base class."""
        d = self.trace + self.determinant
        root = jnp.sqrt(1.0 + d)
        # (λ₁² − λ₂²)² / (λ₁ + λ₂)²
        distortion = (self.trace * self.trace - 4.0 * self.determinant) / (
            2.0 + self.trace + 2.0 * root
        )
        eta_squared = asinh_sqrt_squared(0.25 * distortion / root)
        return _power_sums(alphas, eta_squared, jnp.log1p(d) / 4.0)


class LogStretches(AbstractDeformation):
    """Incompressible, given by two principal logarithmic strains; the third is −e₁ − e₂."""

    e1: Float[Array, "..."]  # log λ₁, any shape
    e2: Float[Array, "..."]  # log λ₂, any shape

    @property
    def I1_minus_3(self) -> Float[Array, "..."]:
        """Σλ_i² − 3."""
        return self.power_sum_minus_3(2.0)

    @property
    def I2_minus_3(self) -> Float[Array, "..."]:
        """Σλ_i⁻² − 3."""
        return self.power_sum_minus_3(-2.0)

    def power_sum_minus_3(self, alpha: ArrayLike) -> Float[Array, "..."]:
        """Σλ_i^α − 3."""
        x1, x2 = jnp.asarray(alpha) * self.e1, jnp.asarray(alpha) * self.e2
        u1, u2 = jnp.expm1(-x1), jnp.expm1(-x2)
        return u1 * u2 - u1 * jnp.expm1(x1) - u2 * jnp.expm1(x2)


def _power_sums(alphas: Sequence[ArrayLike], eta_squared: Array, mean: Array) -> list[Array]:
    """Σλ_i^α − 3 of stretches exp(m ± η), m the mean of their logarithms, and exp(−2m)."""
    sums = []
    for alpha in alphas:
        a = jnp.asarray(alpha)
        x = a * mean
        apart = cosh_sqrt_minus_1(a * a * eta_squared)
        sums.append(2.0 * jnp.exp(x) * apart + _area_change(x))
    return sums


def _area_change(x: Array) -> Array:
    """2 e^x + e^(−2x) − 3: the power sum of a state with two equal stretches."""
    t = jnp.expm1(x)
    return t * t * (2.0 * t + 3.0) * jnp.exp(-2.0 * x)
