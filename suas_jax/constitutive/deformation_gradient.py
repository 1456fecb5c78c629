"""A state of deformation given by its whole gradient, as an isotropic material law sees it.

The other states, in `deformation`, come with stretches or with the invariants of a plane. Here
there are nine components and no stretch at hand. Invariants follow from the deviator of C and
power sums from trace functions of it, so that small strains keep their digits and stretches
may coincide.
"""

import abc

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from suas_jax.constitutive.deformation import AbstractDeformation
from suas_jax.numerics.analytic import exp_minus_1_minus_x
from suas_jax.numerics.spectral import trace_function


class AbstractGeneralState(AbstractDeformation):
    """A general three-dimensional state; only its isochoric part counts.

    With C = Fᵀ F = (1 + g) (1 + d), d traceless, and Δ = det(1 + d) = 1 − d:d/2 + det d,

        I₁ − 3 = 3 (Δ^(−1/3) − 1),    I₂ − 3 = 3 (Δ^(−2/3) − 1) − Δ^(−2/3) d:d/2,

    and power sums are trace functions of d. First and second derivatives with respect
    to C are exact at coincident stretches; a third one is not defined there.
    """

    @property
    @abc.abstractmethod
    def strain(self) -> Float[Array, "3 3 *batch"]:
        """C − 1, small strains with all their digits."""

    @property
    @abc.abstractmethod
    def log_det(self) -> Float[Array, "*batch"]:
        """Log det C, which need not be accurate near rest."""

    @property
    def I1_minus_3(self) -> Float[Array, "*batch"]:
        """J^(−2/3) tr C − 3."""
        _, _, log_delta = self._split()
        return 3.0 * jnp.expm1(-log_delta / 3.0)

    @property
    def I2_minus_3(self) -> Float[Array, "*batch"]:
        """J^(2/3) tr C⁻¹ − 3."""
        _, second, log_delta = self._split()
        two_thirds = -2.0 / 3.0 * log_delta
        return 3.0 * jnp.expm1(two_thirds) + second * jnp.exp(two_thirds)

    def power_sum_minus_3(self, alpha: ArrayLike) -> Float[Array, "..."]:
        """Σλ̄_i^α − 3."""
        d, _, log_delta = self._split()
        shape = jnp.broadcast_shapes(jnp.shape(alpha), d.shape[2:])
        half = jnp.broadcast_to(0.5 * jnp.asarray(alpha, d.dtype), shape)
        ones = (1,) * (len(shape) + 2 - d.ndim)
        d = jnp.broadcast_to(d.reshape(3, 3, *ones, *d.shape[2:]), (3, 3, *shape))
        # With y the mean of n log(1 + d), Σexp(x_i − y) − 3 = e^−y (Σψ(x_i) − 3ψ(y)):
        # the parts linear in the strain have been taken out of both sides.
        y = half * log_delta / 3.0
        return jnp.exp(-y) * (
            trace_function(_excess_of_power, (half,), d) - 3.0 * exp_minus_1_minus_x(y)
        )

    def _split(self) -> tuple[Array, Array, Array]:
        """Return d, its second invariant −d:d/2, and log Δ."""
        G = self.strain
        third = (G[0, 0] + G[1, 1] + G[2, 2]) / 3.0
        deviator = G - third * _unit(G)
        d = deviator / (1.0 + third)
        second = -0.5 * jnp.sum(d * d, axis=(0, 1))
        change = second + determinant(d)
        # At large strain Δ is a small difference of these, but not of det F and tr C.
        large = change < -0.5
        from_det = self.log_det - 3.0 * jnp.log1p(third)
        log_delta = jnp.where(large, from_det, jnp.log1p(jnp.where(large, 0.0, change)))
        return d, second, log_delta


class DeformationGradient(AbstractGeneralState):
    """A state given by F."""

    # deformation gradient ∂x_i/∂X_j (Eq. 4), shape [3, 3, *batch], det F > 0
    F: Float[Array, "3 3 *batch"]

    @property
    def strain(self) -> Float[Array, "3 3 *batch"]:
        """C − 1 formed from F − 1, which is exact near rest."""
        H = self.F - _unit(self.F)
        return H + jnp.swapaxes(H, 0, 1) + jnp.einsum("ki...,kj...->ij...", H, H)

    @property
    def log_det(self) -> Float[Array, "*batch"]:
        """See the base class."""
        return 2.0 * jnp.log(determinant(self.F))


class RightCauchyGreen(AbstractGeneralState):
    """A state given by C."""

    # of C − 1: 11, 22, 33, 12, 13, 23, the last three those of either side
    entries: Float[Array, "6 *batch"]

    @property
    def strain(self) -> Float[Array, "3 3 *batch"]:
        """C − 1."""
        return self.entries[np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])]

    @property
    def log_det(self) -> Float[Array, "*batch"]:
        """See the base class."""
        return jnp.log(determinant(self.strain + _unit(self.strain)))


def _unit(matrix: Float[Array, "3 3 *batch"]) -> Float[np.ndarray, "3 3 *one"]:
    return np.eye(3, dtype=matrix.dtype).reshape(3, 3, *(1,) * (matrix.ndim - 2))


def determinant(A: Float[Array, "3 3 *batch"]) -> Float[Array, "*batch"]:
    """Determinant, by the first row: no factorisation, exact derivatives of any order."""
    return (
        A[0, 0] * (A[1, 1] * A[2, 2] - A[1, 2] * A[2, 1])
        + A[0, 1] * (A[1, 2] * A[2, 0] - A[1, 0] * A[2, 2])
        + A[0, 2] * (A[1, 0] * A[2, 1] - A[1, 1] * A[2, 0])
    )


def _excess_of_power(parameters: tuple[Array, ...], a: Array) -> Array:
    """(1 + a)^n − 1 − n log(1 + a), the part of a power that is quadratic in a."""
    (n,) = parameters
    return exp_minus_1_minus_x(n * jnp.log1p(a))
