"""Shape functions of one element: what they interpolate, and their derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from suas_jax.numerics.polynomials import (
    gauss_legendre,
    hermite,
    lagrange_slopes,
    lagrange_weights,
    with_derivatives,
)

XI = np.linspace(0, 1, 11)


def test_hermite_shapes_are_one_where_they_belong_and_zero_elsewhere() -> None:
    ends = np.array([0.0, 1.0])
    values, slopes = hermite(ends), hermite(ends, 1)
    at_stations = np.stack([values[:, 0], slopes[:, 0], values[:, 1], slopes[:, 1]])
    np.testing.assert_array_equal(at_stations, np.eye(4))


@pytest.mark.parametrize("derivative", range(4))
def test_hermite_reproduces_every_cubic(derivative: int) -> None:
    cubic = np.polynomial.Polynomial([0.3, -1.2, 0.7, 2.1])
    slope = cubic.deriv()
    nodal = [cubic(0.0), slope(0.0), cubic(1.0), slope(1.0)]
    got = sum(n * v for n, v in zip(hermite(XI, derivative), nodal, strict=True))
    want = (cubic.deriv(derivative) if derivative else cubic)(XI)
    np.testing.assert_allclose(got, want, rtol=0, atol=2e-14)


@pytest.mark.parametrize("derivative", [1, 2, 3])
def test_derivatives_are_those_of_the_shapes(derivative: int) -> None:
    for i, got in enumerate(hermite(XI, derivative)):
        slope = jax.vmap(jax.grad(lambda x, i=i: hermite(x, derivative - 1)[i]))(
            jnp.asarray(XI)
        )
        np.testing.assert_allclose(got, slope, rtol=0, atol=1e-13)


@pytest.mark.parametrize("points", range(1, 7))
def test_quadrature_is_exact_to_its_degree_and_no_further(points: int) -> None:
    x, w = gauss_legendre(points, 0.5, 2.0)
    assert np.all(np.diff(x) > 0)
    errors = [
        abs(np.sum(w * x**k) / ((2.0 ** (k + 1) - 0.5 ** (k + 1)) / (k + 1)) - 1)
        for k in range(2 * points + 1)
    ]
    assert max(errors[:-1]) < 1e-14
    assert errors[-1] > 1e-9


def test_points_of_the_unit_interval_are_the_default() -> None:
    x, w = gauss_legendre(3)
    np.testing.assert_allclose(x, 0.5 + 0.5 * np.sqrt(0.6) * np.array([-1, 0, 1]), rtol=1e-14)
    np.testing.assert_allclose(w, np.array([5, 8, 5]) / 18, rtol=1e-14)


@pytest.mark.parametrize("degree", range(5))
def test_slopes_of_polynomials_through_points_are_exact(degree: int) -> None:
    points = np.array([-0.3, 0.0, 0.4, 1.1, 2.0])
    slopes = degree * points ** max(degree - 1, 0)
    np.testing.assert_allclose(lagrange_slopes(points) @ points**degree, slopes, atol=1e-12)
    powers = [jnp.asarray(float(k == degree)) for k in range(6)]
    bend = degree * (degree - 1) * 0.7 ** max(degree - 2, 0)
    wanted = 0.7**degree, degree * 0.7 ** max(degree - 1, 0), bend
    np.testing.assert_allclose(with_derivatives(powers, jnp.asarray(0.7)), wanted, atol=1e-12)
    weights = lagrange_weights(points, 0.7)
    np.testing.assert_allclose(weights @ points**degree, 0.7**degree, atol=1e-12)
