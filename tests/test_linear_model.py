"""Statistics of a linear model with Gaussian noise, whose answers stand in textbooks."""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float
from scipy import stats

from fitting.statistics.identifiability import describe, uncertainty
from fitting.statistics.residuals import AbstractResiduals

X = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
Y = np.array([1.1, 2.9, 5.2, 6.8, 9.1])
LINE = np.stack([np.ones(5), X], 1)


class Two(NamedTuple):
    """Two constants that are their own parameters."""

    names: tuple[str, ...] = ("C1", "C2")
    units: tuple[str, ...] = ("Pa", "Pa")

    def constants(self, theta: Array) -> Array:
        """Constants from parameters."""
        return theta

    def unconstrained(self, constants: Array) -> Array:
        """Parameters from constants."""
        return constants


class Linear(AbstractResiduals):
    """Readings that are linear in the constants: y = A c."""

    value: Float[Array, " n"]
    inverse_scale: Float[Array, " n"]
    matrix: Float[Array, "n p"]

    family: Two = eqx.field(static=True, default=Two())

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


@pytest.mark.parametrize("intercept", [1.0, 1.2])
def test_a_held_constant_takes_no_degree_of_freedom(intercept: float) -> None:
    slope = X @ (Y - intercept) / (X @ X)
    constants = np.array([intercept, slope])
    found = uncertainty(linear(LINE, Y), constants, known_noise=False, held=("C1",))
    # The first reading, at x = 0, says nothing of the slope but all of the noise.
    assert found.dof == 4
    noise = np.sqrt(np.sum((Y - LINE @ constants) ** 2) / 4)
    assert found.noise == pytest.approx(noise, rel=1e-12)
    np.testing.assert_allclose(found.standard_errors, [0.0, noise / np.sqrt(X @ X)], rtol=1e-10)
    np.testing.assert_allclose(found.correlation, np.diag([0.0, 1.0]), atol=1e-12)


def test_constants_that_cancel_are_not_told_apart_however_large_they_are() -> None:
    # Only the sum of both enters; each is 10^12 times as large as the readings.
    alike = np.stack([X + 1.0, X + 1.0], 1)
    constants = np.array([2.0**40, 1.0 - 2.0**40])
    found = uncertainty(linear(alike, X + 1.0), constants, known_noise=False)
    assert len(found.unidentifiable) == 1
    assert found.unidentifiable[0].startswith("C1 - C2 (free")
    assert found.spare == 1


def test_where_a_law_cannot_follow_the_test_the_likelihood_is_none() -> None:
    model = linear(LINE, Y)
    constants = jnp.asarray([1.0, 2.0])
    assert float(model.log_likelihood(constants)) == float(model.log_likelihood(constants, 1.0))
    assert model.log_likelihood(constants.at[1].set(jnp.nan)) == -jnp.inf


def test_readings_that_are_not_used_say_nothing() -> None:
    model = linear(LINE, np.where(X < 4.0, Y, 1e6))
    masked = Linear(model.value, model.inverse_scale.at[4].set(0.0), model.matrix)
    assert masked.used.tolist() == [True] * 4 + [False]
    line = stats.linregress(X[:4], Y[:4])
    found = uncertainty(masked, np.array([line.intercept, line.slope]), known_noise=False)
    assert found.dof == 2
    np.testing.assert_allclose(
        found.standard_errors, [line.intercept_stderr, line.stderr], rtol=1e-10
    )
    # Intercept and slope pull against each other: -mean(x) / sqrt(mean(x^2)).
    assert found.correlation[0, 1] == pytest.approx(-1.5 / np.sqrt(3.5), rel=1e-10)


def test_interval_with_one_or_no_degree_of_freedom() -> None:
    for readings in (3, 2):
        found = uncertainty(
            linear(LINE[:readings], Y[:readings]), np.array([1.1, 2.0]), known_noise=False
        )
        assert found.dof == readings - 2
        assert (found.spare == 0) == (readings == 3)
        assert found.quantile(0.95) == pytest.approx(12.706, abs=5e-4)  # tables, one degree


@pytest.mark.parametrize("readings", [1, 2])
def test_no_more_readings_than_constants_leave_everything_open(readings: int) -> None:
    constants = np.array([1.0, 2.0])
    matrix = np.array([[1.0, 1.0], [1.0, -1.0]])[:readings]
    found = uncertainty(linear(matrix, matrix @ constants), constants, known_noise=False)
    everything, *combinations = found.unidentifiable
    assert everything == f"everything: {readings} readings for 2 constants"
    assert len(combinations) == 2
    assert found.spare == len(found.unidentifiable)


@pytest.mark.parametrize("angle", [0.3, 1.0, np.pi / 2])
def test_condition_number_of_two_columns_is_the_cotangent_of_half_their_angle(
    angle: float,
) -> None:
    matrix = np.array([[1.0, np.cos(angle)], [0.0, np.sin(angle)], [0.0, 0.0]])
    constants = np.array([5.0, 5.0])
    found = uncertainty(linear(matrix, matrix @ constants), constants, known_noise=False)
    assert found.condition_number == pytest.approx(1 / np.tan(angle / 2), rel=1e-10)


def test_a_constant_without_effect_is_free_by_any_amount() -> None:
    matrix = np.stack([X + 1.0, np.zeros(5)], 1)
    for value, size in ((0.0, 1.0), (40.0, 40.0)):
        found = uncertainty(
            linear(matrix, 3.0 * (X + 1.0)), np.array([3.0, value]), known_noise=False
        )
        assert found.unidentifiable == (f"C2 (free by any amount of {size:.3g} Pa)",)
        assert found.condition_number == np.inf


def test_the_free_combination_is_named_with_its_shares() -> None:
    for ratio, name in ((0.5, "0.5 C1 - C2"), (-2.0, "C1 + 0.5 C2"), (100.0, "C1")):
        alike = np.stack([X + 1.0, ratio * (X + 1.0)], 1)
        stress = linear(alike, 1e5 * (X + 1.0))
        found = uncertainty(stress, np.array([1e5, 0.0]), known_noise=False)
        assert found.unidentifiable[0].startswith(f"{name} (free by ")


def test_what_hardly_acts_and_cancels_is_still_wholly_correlated() -> None:
    alike = 1e-60 * np.stack([X + 1.0, X + 1.0], 1)
    found = uncertainty(linear(alike, X + 1.0), np.array([5e59, 5e59]), known_noise=False)
    assert found.correlation[0, 1] == pytest.approx(-1.0, abs=1e-6)


@pytest.mark.parametrize("alike", [False, True])
def test_noise_that_differs_between_readings(alike: bool) -> None:
    """Constants fitted as if all noise were the same; their covariance is A diag(s^2) A^T."""
    matrix = np.stack([X + 1.0, X + 1.0], 1) if alike else LINE
    ratio = np.array([1.0, 2.0, 1.0, 4.0, 1.0])
    constants = np.linalg.lstsq(matrix, Y, rcond=None)[0]
    found = uncertainty(linear(matrix, Y), constants, known_noise=False, noise_ratio=ratio)
    # The noise is what least squares weighed by it leaves.
    weighed = matrix / ratio[:, None]
    left = Y / ratio - weighed @ np.linalg.lstsq(weighed, Y / ratio, rcond=None)[0]
    assert found.noise == pytest.approx(np.sqrt(np.sum(left**2) / 3), rel=1e-9)
    by_reading = np.linalg.pinv(matrix)
    expected = found.noise**2 * by_reading @ np.diag(ratio**2) @ by_reading.T
    along = np.ones(2) if alike else np.array([1.0, 2.0])  # what the data know
    known = np.sqrt(along @ expected @ along)
    assert found.spread_of(along) == pytest.approx(known, rel=1e-6)


def at_an_angle(angle: float) -> np.ndarray:
    """Four readings; the two columns are unit vectors that enclose an angle."""
    half = np.array([[1.0, np.cos(angle)], [0.0, np.sin(angle)]])
    return np.vstack([half, half]) / np.sqrt(2.0)


def test_known_noise_gives_the_inverse_of_the_normal_matrix() -> None:
    constants = np.array([1.0, 2.0])
    for inflation in (1.0, 2.5):
        found = uncertainty(linear(LINE, Y), constants, known_noise=True, inflation=inflation)
        expected = inflation**2 * np.linalg.inv(LINE.T @ LINE)
        np.testing.assert_allclose(found.covariance, expected, rtol=1e-10)
        np.testing.assert_allclose(found.root @ found.root.T, expected, rtol=1e-10)
        assert found.noise == 1.0


def test_inflation_widens_intervals_of_estimated_noise_in_proportion() -> None:
    narrow, wide = (
        uncertainty(linear(LINE, Y), np.array([1.0, 2.0]), known_noise=False, inflation=k)
        for k in (1.0, 3.0)
    )
    np.testing.assert_allclose(wide.standard_errors, 3 * narrow.standard_errors, rtol=1e-12)
    assert wide.noise == narrow.noise
    np.testing.assert_allclose(wide.correlation, narrow.correlation, rtol=1e-10)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 50.0])
def test_a_direction_is_free_from_one_half_of_its_natural_size_on(scale: float) -> None:
    """Its spread is that of the noise over its singular value, in units of the readings."""
    angle, columns = 0.3, np.array([1.0, 4.0]) * scale
    matrix, constants = at_an_angle(angle) * columns, 5.0 / columns
    size = 10.0 * np.cos(angle / 2)  # of the readings
    share = 1.0 / (size * np.sqrt(2.0) * np.sin(angle / 2))  # 0.479
    readings = linear(matrix, matrix @ constants)
    wide = f"C1 - 0.25 C2 (free by +-{200 * share:.3g} %)"
    for inflation, named in ((1.0, ()), (2.0, (wide,))):
        found = uncertainty(readings, constants, known_noise=True, inflation=inflation)
        np.testing.assert_allclose(found.sizes, size / columns, rtol=1e-12)
        np.testing.assert_allclose(
            found.singular_values, size * np.sqrt([1 + np.cos(angle), 1 - np.cos(angle)])
        )
        assert found.unidentifiable == named
        assert found.spare == 0  # the noise alone leaves none


@pytest.mark.parametrize(("angle", "free"), [(1e-4, True), (2e-4, False)])
@pytest.mark.parametrize("size", [0.01, 1.0, 1e5])
def test_exact_readings_are_taken_for_known_to_a_ten_thousandth(
    angle: float, free: bool, size: float
) -> None:
    matrix, constants = at_an_angle(angle), np.array([size, size])
    found = uncertainty(linear(matrix, matrix @ constants), constants, known_noise=False)
    assert found.dof == 2
    # A ten thousandth of a typical one of four readings over the smaller singular value.
    share = 100 * 0.5e-4 / (np.sqrt(2.0) * np.sin(angle / 2))
    assert found.unidentifiable == ((f"C1 - C2 (free by +-{share:.3g} %)",) if free else ())
    assert found.spare == int(free)


@pytest.mark.parametrize("size", [1.0, 2.0**20])
def test_a_reading_that_any_constants_meet_is_none(size: float) -> None:
    """Such as the first row of a test, at rest; rounding may leave a trace of a slope."""
    for row in (0.0, 1e-12):
        matrix = np.vstack([at_an_angle(2e-4), [row, -row]])
        constants = np.array([size, size])
        found = uncertainty(linear(matrix, matrix @ constants), constants, known_noise=False)
        assert found.dof == 2


@pytest.mark.parametrize("readings", [1, 2])
def test_noise_that_differs_between_no_more_readings_than_constants(readings: int) -> None:
    matrix, ratio = np.array([[100.0, 50.0], [20.0, -70.0]])[:readings], np.array([1.0, 3.0])
    constants = np.array([1.0, 2.0])
    found = uncertainty(
        linear(matrix, matrix @ constants),
        constants,
        known_noise=True,
        noise_ratio=ratio[:readings],
    )
    spread = found.spread_of(matrix)  # of the readings, which are met exactly
    np.testing.assert_allclose(spread, ratio[:readings], rtol=1e-6)


def test_condition_number_is_that_of_the_largest_and_the_smallest() -> None:
    found = uncertainty(linear(LINE, Y), np.array([1.0, 2.0]), known_noise=True)
    three = dataclasses.replace(found, singular_values=np.array([6.0, 3.0, 0.5]))
    assert three.condition_number == 12.0


def test_directions_seen_with_more_noise_are_freer() -> None:
    angle, ratio = 0.3, np.array([1.0, 5.0, 2.0, 3.0])
    matrix, constants = at_an_angle(angle), np.array([5.0, 5.0])
    found = uncertainty(
        linear(matrix, matrix @ constants), constants, known_noise=True, noise_ratio=ratio
    )
    by_reading = np.linalg.pinv(matrix)
    covariance = by_reading @ np.diag(ratio**2) @ by_reading.T
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-10)
    apart = np.array([1.0, -1.0]) / np.sqrt(2.0)
    share = np.sqrt(apart @ covariance @ apart) / (10 * np.cos(angle / 2))
    assert found.unidentifiable == (f"C1 - C2 (free by +-{100 * share:.3g} %)",)
    assert found.spare == 1


def test_an_error_that_all_constants_share_is_added_to_their_covariance() -> None:
    found = uncertainty(linear(LINE, Y), np.array([1.1, 2.0]), known_noise=False)
    error = np.array([0.3, -0.02])
    whole = found.with_error(error)
    covariance = found.covariance + np.outer(error, error)
    np.testing.assert_allclose(whole.covariance, covariance, rtol=1e-12)
    np.testing.assert_allclose(np.diag(whole.correlation), 1.0, rtol=1e-12)
    expected = covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1])
    assert whole.correlation[0, 1] == pytest.approx(expected, rel=1e-12)
    slopes = np.array([[1.0, 0.0], [1.0, 3.0], [0.0, -2.0]])
    spread = np.sqrt(np.einsum("ni,ij,nj->n", slopes, covariance, slopes))
    np.testing.assert_allclose(whole.spread_of(slopes), spread, rtol=1e-10)


@pytest.mark.parametrize(
    ("units", "direction", "sizes", "text"),
    [
        (("Pa", "Pa"), [1.0, 0.05], [3.0, 3.0], "C1 (free by +-50 % of 3 Pa)"),
        (("Pa", "Pa"), [0.6, -0.8], [1.0, 10.0], "0.075 C1 - C2 (free by +-50 %)"),
        (("Pa", "Pa"), [-0.6, 0.8], [1.0, 10.0], "0.075 C1 - C2 (free by +-50 %)"),
        (("Pa", "Pa"), [0.6, 0.8], [1.0, 100.0], "C2 (free by +-50 % of 100 Pa)"),
        (("Pa", "Pa"), [0.7, 0.7], [200.0, 200.0], "C1 + C2 (free by +-50 %)"),
        (("Pa", "1"), [-0.6, 0.8], [1e5, 2.0], "0.75 dC1/1e+05 - dC2/2 (free by +-50 %)"),
        (("Pa", "1"), [0.02, -1.0], [1e5, 2.0], "C2 (free by +-50 % of 2 1)"),
    ],
)
def test_a_free_direction_in_words(
    units: tuple[str, str], direction: list[float], sizes: list[float], text: str
) -> None:
    """Stresses in pascals, the smallest fiftieth left out; others in relative changes."""
    found = describe(("C1", "C2"), units, np.array(direction), np.array(sizes), 0.5)
    assert found == text


@pytest.mark.parametrize(
    ("spread", "text"), [(0.123, "+-12.3 %"), (9899.5, "+-9.9e+05 %"), (9900.5, "any amount")]
)
def test_ten_thousand_times_the_size_is_any_amount(spread: float, text: str) -> None:
    found = describe(("C1",), ("Pa",), np.ones(1), np.ones(1), spread)
    assert found == f"C1 (free by {text} of 1 Pa)"
