"""A state of deformation given by its whole gradient, as an isotropic material law sees it.

The other states, in `deformation`, come with stretches or with the invariants of a plane. Here
there are nine components and no stretch at hand. Invariants follow from the deviator of C and
power sums from trace functions of it, so that small strains keep their digits and stretches
may coincide.

Entries of matrices are separate arrays: to index a stacked one is an operation of the compiled
program, and each derivative adds further ones.
"""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from suas_jax.constitutive.deformation import AbstractDeformation
from suas_jax.numerics.analytic import exp_minus_1_minus_x
from suas_jax.numerics.spectral import trace_function

# Entries of a symmetric matrix, and where they are listed.
Entries = Sequence[Float[Array, "*batch"]]
ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
_MATRIX = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])


class GeneralDeformation(AbstractDeformation):
    """A general three-dimensional state; only its isochoric part counts.

    With C = Fᵀ F = (1 + g) (1 + d), d traceless, and Δ = det(1 + d) = 1 − d:d/2 + det d,

        I₁ − 3 = 3 (Δ^(−1/3) − 1),    I₂ − 3 = 3 (Δ^(−2/3) − 1) − Δ^(−2/3) d:d/2,

    and power sums are trace functions of d. First and second derivatives with respect
    to C are exact at coincident stretches; a third one is not defined there.
    """

    deviator: Entries  # d
    second: Float[Array, "*batch"]  # −d:d/2
    log_delta: Float[Array, "*batch"]

    @classmethod
    def of_gradient(cls, F: Float[Array, "3 3 *batch"]) -> "GeneralDeformation":
        """That of a deformation gradient ∂x_i/∂X_j (Eq. 4), of positive determinant."""
        unit = np.eye(3, dtype=F.dtype).reshape(3, 3, *(1,) * (F.ndim - 2))
        strain = green(F - unit)
        deviator, second, change = _split(strain)
        # At large strain Δ is a small difference of these, but not of det F and tr C.
        large = change < -0.5
        by_det = 2.0 * jnp.log(determinant(F)) - 3.0 * jnp.log1p(sum(strain[:3]) / 3.0)
        small = jnp.log1p(jnp.where(large, 0.0, change))
        return cls(deviator, second, jnp.where(large, by_det, small))

    @classmethod
    def of_strain(cls, strain: Entries) -> "GeneralDeformation":
        """That of the entries of C − 1, those beside the diagonal as either side has them."""
        deviator, second, change = _split(strain)
        return cls(deviator, second, jnp.log1p(change))

    @property
    def I1_minus_3(self) -> Float[Array, "*batch"]:
        """J^(−2/3) tr C − 3."""
        return 3.0 * jnp.expm1(-self.log_delta / 3.0)

    @property
    def I2_minus_3(self) -> Float[Array, "*batch"]:
        """J^(2/3) tr C⁻¹ − 3."""
        two_thirds = -2.0 / 3.0 * self.log_delta
        return 3.0 * jnp.expm1(two_thirds) + self.second * jnp.exp(two_thirds)

    def power_sum_minus_3(self, alpha: ArrayLike) -> Float[Array, "..."]:
        """Σλ̄_i^α − 3."""
        shape = jnp.broadcast_shapes(jnp.shape(alpha), self.log_delta.shape)
        half = jnp.broadcast_to(0.5 * jnp.asarray(alpha, self.log_delta.dtype), shape)
        entries = jnp.stack([jnp.broadcast_to(x, shape) for x in self.deviator])
        # With y the mean of n log(1 + d), Σexp(x_i − y) − 3 = e^−y (Σψ(x_i) − 3ψ(y)):
        # the parts linear in the strain have been taken out of both sides.
        y = half * self.log_delta / 3.0
        return jnp.exp(-y) * (
            trace_function(_excess_of_power, (half,), entries[_MATRIX])
            - 3.0 * exp_minus_1_minus_x(y)
        )


def _split(strain: Entries) -> tuple[list[Array], Array, Array]:
    """Entries of d, its second invariant −d:d/2, and Δ − 1."""
    third = (strain[0] + strain[1] + strain[2]) / 3.0
    scale = 1.0 / (1.0 + third)
    d = [x * scale for x in (*(x - third for x in strain[:3]), *strain[3:])]
    second = -0.5 * (d[0] ** 2 + d[1] ** 2 + d[2] ** 2) - d[3] ** 2 - d[4] ** 2 - d[5] ** 2
    a, b, c, e, f, g = d
    return d, second, second + a * (b * c - g * g) + e * (2.0 * f * g - e * c) - f * f * b


def green(H: Float[Array, "3 3 *batch"]) -> list[Float[Array, "*batch"]]:
    """Entries of C − 1 = H + Hᵀ + Hᵀ H from H = F − 1, small strains with all their digits."""
    rows = [list(row) for row in H]
    return [rows[i][j] + rows[j][i] + sum(row[i] * row[j] for row in rows) for i, j in ENTRIES]


def determinant(A: Float[Array, "3 3 *batch"]) -> Float[Array, "*batch"]:
    """Determinant, by the first row: no factorisation, exact derivatives of any order."""
    (a, b, c), (d, e, f), (g, h, i) = A
    return a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g)


def _excess_of_power(parameters: tuple[Array, ...], a: Array) -> Array:
    """(1 + a)^n − 1 − n log(1 + a), the part of a power that is quadratic in a."""
    (n,) = parameters
    return exp_minus_1_minus_x(n * jnp.log1p(a))
