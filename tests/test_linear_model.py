"""Statistics of a linear model with Gaussian noise, whose answers stand in textbooks."""

import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float
from scipy import stats

from fitting.statistics.identifiability import uncertainty
from fitting.statistics.residuals import AbstractResiduals

X = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
Y = np.array([1.1, 2.9, 5.2, 6.8, 9.1])
LINE = np.stack([np.ones(5), X], 1)


class Linear(AbstractResiduals):
    """Readings that are linear in the constants: y = A c."""

    value: Float[Array, " n"]
    inverse_scale: Float[Array, " n"]
    matrix: Float[Array, "n p"]

    @property
    def names(self) -> tuple[str, ...]:
        """As `AbstractResiduals.names`."""
        return ("C1", "C2")

    @property
    def units(self) -> tuple[str, ...]:
        """As `AbstractResiduals.units`."""
        return ("Pa", "Pa")

    def constants(self, theta: Array) -> Array:
        """As `AbstractResiduals.constants`."""
        return theta

    def unconstrained(self, constants: Array) -> Array:
        """As `AbstractResiduals.unconstrained`."""
        return constants

    def of_constants(self, constants: Array) -> Array:
        """As `AbstractResiduals.of_constants`."""
        return (self.matrix @ constants - self.value) * self.inverse_scale


def linear(matrix: np.ndarray, value: np.ndarray) -> Linear:
    return Linear(jnp.asarray(value), jnp.ones(len(value)), jnp.asarray(matrix))


def test_log_likelihood_is_the_normal_density_of_the_used_readings() -> None:
    model = linear(LINE, Y)
    model = Linear(model.value, model.inverse_scale.at[4].set(0.0), model.matrix)
    constants, size = np.array([1.0, 2.0]), 4
    for noise in (0.1, 0.5, 3.0):
        density = stats.norm.logpdf(Y - LINE @ constants, scale=noise)[:size].sum()
        found = float(model.log_likelihood(jnp.asarray(constants), noise))
        assert found == pytest.approx(density + 0.5 * size * np.log(2 * np.pi), rel=1e-12)


def test_interval_of_a_straight_line_is_student_s() -> None:
    line = stats.linregress(X, Y)
    found = uncertainty(
        linear(LINE, Y), np.array([line.intercept, line.slope]), known_noise=False
    )
    assert found.dof == 3
    errors = [line.intercept_stderr, line.stderr]
    np.testing.assert_allclose(found.standard_errors, errors, rtol=1e-10)
    # Tables of Student's t: 3.182 for 95 % and 5.841 for 99 %, three degrees of freedom.
    assert found.quantile(0.95) == pytest.approx(3.182, abs=5e-4)
    assert found.quantile(0.99) == pytest.approx(5.841, abs=5e-4)


def test_a_held_constant_takes_no_degree_of_freedom() -> None:
    slope = X @ (Y - 1.0) / (X @ X)  # through a given intercept
    constants = np.array([1.0, slope])
    found = uncertainty(linear(LINE, Y), constants, known_noise=False, held=("C1",))
    # The first reading, at x = 0, says nothing of the slope but all of the noise.
    assert found.dof == 4
    noise = np.sqrt(np.sum((Y - LINE @ constants) ** 2) / 4)
    assert found.noise == pytest.approx(noise, rel=1e-12)
    np.testing.assert_allclose(found.standard_errors, [0.0, noise / np.sqrt(X @ X)], rtol=1e-10)


def test_constants_that_cancel_are_not_told_apart_however_large_they_are() -> None:
    # Only the sum of both enters; each is 10^12 times as large as the readings.
    alike = np.stack([X + 1.0, X + 1.0], 1)
    constants = np.array([2.0**40, 1.0 - 2.0**40])
    found = uncertainty(linear(alike, X + 1.0), constants, known_noise=False)
    assert len(found.unidentifiable) == 1
    assert found.unidentifiable[0].startswith("C1 - C2 (free")
    assert found.spare == 1
