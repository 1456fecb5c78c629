"""Derivatives of the general deformation, where principal stretches coincide and apart."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from skins import rotation

from suas_jax.constitutive.deformation_gradient import GeneralDeformation
from suas_jax.numerics.spectral import divided_difference, matrix_function

STATES = {
    "rest": [1.0, 1.0, 1.0],
    "scaled": [1.2, 1.2, 1.2],
    "equibiaxial": [1.3, 1.3, 1.3**-2],
    "uniaxial": [2.0, 2.0**-0.5, 2.0**-0.5],
    "nearly equal": [1.3, 1.3 * (1 + 1e-9), 0.6],
    "below the switch": [1.0, 1.2247, 0.8],
    "above the switch": [1.0, 1.2248, 0.8],
    "apart": [0.5, 1.1, 2.5],
}


def power_sum(alpha: jax.Array, F: jax.Array) -> jax.Array:
    return GeneralDeformation.of_gradient(F).power_sum_minus_3(alpha)


def power_sum_by_products(alpha: int, F: jax.Array) -> jax.Array:
    """The same for even exponents, as the trace of products: no eigenvalues."""
    C = F.T @ F
    power = jnp.linalg.matrix_power(C if alpha > 0 else jnp.linalg.inv(C), abs(alpha) // 2)
    return jnp.linalg.det(C) ** (-alpha / 6.0) * jnp.trace(power) - 3.0


SPECTRAL = jax.jit(
    lambda alpha, F: (
        jax.grad(power_sum, 1)(alpha, F),
        jax.hessian(power_sum, 1)(alpha, F),
        jax.jacfwd(jax.jacfwd(power_sum, 1), 1)(alpha, F),
    )
)
PRODUCTS = jax.jit(
    lambda alpha, F: (
        power_sum_by_products(alpha, F),
        jax.grad(power_sum_by_products, 1)(alpha, F),
        jax.hessian(power_sum_by_products, 1)(alpha, F),
    ),
    static_argnums=0,
)


@pytest.mark.parametrize("alpha", [2, 4, -2, -4])
@pytest.mark.parametrize("state", list(STATES))
def test_gradient_form_has_exact_first_and_second_derivatives(alpha: int, state: str) -> None:
    F = jnp.asarray(rotation(5) @ np.diag(STATES[state]) @ rotation(6))
    value, slope, curvature = PRODUCTS(alpha, F)
    scale = 1.0 + abs(float(value))
    gradient, hessian, forward_hessian = SPECTRAL(float(alpha), F)
    np.testing.assert_allclose(gradient, slope, rtol=1e-12, atol=2e-13 * scale)
    np.testing.assert_allclose(hessian, curvature, rtol=1e-11, atol=1e-12 * scale)
    np.testing.assert_allclose(forward_hessian, curvature, rtol=1e-11, atol=1e-12 * scale)


def test_invariants_of_the_gradient_form_differentiate_like_its_power_sums() -> None:
    F = jnp.asarray(rotation(5) @ np.diag([1.4, 0.9, 1.1]) @ rotation(6))
    for invariant, alpha in (("I1_minus_3", 2), ("I2_minus_3", -2)):
        hessian = jax.hessian(
            lambda F, name=invariant: getattr(GeneralDeformation.of_gradient(F), name)
        )
        np.testing.assert_allclose(
            jax.jit(hessian)(F), PRODUCTS(alpha, F)[2], rtol=1e-11, atol=1e-12
        )


MIXED = jax.jit(
    lambda alpha, F: (
        jax.grad(power_sum)(alpha, F),
        jax.jacfwd(jax.grad(power_sum, 1), 0)(alpha, F),
        jax.jacrev(jax.grad(power_sum, 0), 1)(alpha, F),
    )
)


@pytest.mark.parametrize("state", ["rest", "equibiaxial", "apart"])
def test_exponent_is_differentiable_together_with_the_gradient(state: str) -> None:
    stretches = np.array(STATES[state]) / np.prod(STATES[state]) ** (1 / 3)
    alpha = 3.0
    by_exponent, *mixed = MIXED(alpha, jnp.diag(jnp.asarray(stretches)))
    np.testing.assert_allclose(
        by_exponent, np.sum(np.log(stretches) * stretches**alpha), rtol=1e-12, atol=1e-15
    )
    # d/dα of the stress P = (α λ^α − mean) / λ on the diagonal.
    growth = stretches**alpha * (1.0 + alpha * np.log(stretches))
    expected = np.diag((growth - growth.mean()) / stretches)
    for got in mixed:
        np.testing.assert_allclose(got, expected, rtol=1e-12, atol=2e-14)


def test_divided_differences_of_powers() -> None:
    n = 1.7
    d = np.array([0.0, 1e-12, 1e-6, 0.1, 0.4, 0.41, 1.0, 4.0])
    a, b = np.full_like(d, 0.9), 0.9 * np.exp(-d)
    with np.errstate(invalid="ignore"):
        ratio = np.where(d == 0.0, n, np.sinh(0.5 * n * d) / np.sinh(0.5 * d))
    expected = (a * b) ** (0.5 * (n - 1.0)) * ratio
    got = divided_difference(
        lambda p, x: (1.0 + x) ** p[0], (jnp.array(n),), jnp.asarray(a - 1), jnp.asarray(b - 1)
    )
    np.testing.assert_allclose(got, expected, rtol=3e-15)


def test_matrix_function_is_the_matrix_square() -> None:
    A = np.array([[0.3, 0.1, 0.0], [0.1, -0.2, 0.05], [0.0, 0.05, 0.1]])
    dA = np.array([[1.0, 2.0, 0.5], [2.0, -1.0, 0.3], [0.5, 0.3, 0.7]])
    square = lambda A: matrix_function(lambda _, x: x * x, (), A)  # noqa: E731
    value, slope = jax.jvp(square, (jnp.asarray(A),), (jnp.asarray(dA),))
    np.testing.assert_allclose(value, A @ A, atol=1e-16)
    np.testing.assert_allclose(slope, A @ dA + dA @ A, atol=1e-15)
