"""Formulas of statistics against closed forms: noise, misfit, profiles, chains, steps."""

import dataclasses
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from fitting.material.fit.search import _box, _solve, minimise_in_box
from fitting.material.fit.specimens import scatter_between
from fitting.material.laws.parameters import Constant, Family, Scales, SumBlock
from fitting.statistics.chain import Posterior, _round_up
from fitting.statistics.diagnostics import (
    _basis,
    _patterns,
    _smoothed,
    information_criteria,
    misfit,
)
from fitting.statistics.least_squares import (
    Minima,
    _is_minimum,
    _minimum,
    compressed,
    judged,
    minimise_one_by_one,
)
from fitting.statistics.log_probability import Batch, Gaussian, NumpyBatch, _expansion, laplace
from fitting.statistics.noise_model import (
    NoiseModel,
    _both,
    _deviation,
    _differences,
    _likelihood,
    estimate_noise,
)
from fitting.statistics.posterior import Settings, _change, _tau, _walkers, sample
from fitting.statistics.profile import constrained, profile_end
from tests.skins import quick
from tests.test_linear_model import LINE, X, Y, linear

RNG = np.random.default_rng(0)


# --- noise --------------------------------------------------------------------------------


def test_differences_from_the_line_through_the_neighbours() -> None:
    along = np.array([0.0, 1.0, 3.0, 3.0, 4.0])
    error = 2.0 + 3.0 * along
    d, w = _differences(error, along)
    np.testing.assert_allclose(d, 0.0, atol=1e-12)
    np.testing.assert_allclose(w, [2 / 3, 0.0, 1.0], rtol=1e-12)
    error[1] += 0.5
    np.testing.assert_allclose(_differences(error, along)[0], [0.5, 0.0, 0.0], atol=1e-12)
    _, w = _differences(np.ones(3), np.zeros(3))  # three readings at one place
    assert w.tolist() == [0.5]


def test_deviation_of_differences_is_that_of_a_sum() -> None:
    w, sigma = np.array([0.25]), np.array([2.0, 3.0, 4.0])
    expected = np.sqrt(9.0 + (0.25 * 2) ** 2 + (0.75 * 4) ** 2)
    np.testing.assert_allclose(_deviation(w, sigma), expected, rtol=1e-12)


def test_likelihood_at_the_best_scale_is_the_normal_density() -> None:
    d, shape = RNG.normal(size=9), np.linspace(1, 3, 9)
    value, scale = _likelihood(d, shape)
    assert scale == pytest.approx(np.sqrt(np.mean((d / shape) ** 2)), rel=1e-12)
    density = stats.norm.logpdf(d, scale=scale * shape).sum() + 4.5 * np.log(2 * np.pi)
    assert value == pytest.approx(density, rel=1e-12)


@pytest.mark.parametrize(
    ("kind", "a", "b"), [("absolute", 0.1, 0.0), ("relative", 0.0, 0.02), ("both", 0.05, 0.02)]
)
def test_noise_is_found_with_its_kind(kind: str, a: float, b: float) -> None:
    """Its two parts within twice their standard errors of 3,000 readings."""
    n = 3000
    size = np.linspace(0.5, 20.0, n)
    rng = np.random.default_rng(1)
    error = np.hypot(a, b * size) * rng.normal(size=n) + np.sin(size)  # a wrong law is smooth
    weight = np.ones(n)
    found = estimate_noise(error, size, 0.02 * size, np.arange(n, dtype=float), weight)
    assert found is not None
    assert found.kind == kind
    assert found.absolute == pytest.approx(a, rel=0.1)
    assert found.relative == pytest.approx(b, rel=0.1)
    assert found.excludes_assumed == (kind != "relative")
    np.testing.assert_allclose(
        found.deviation(size), np.hypot(found.absolute, found.relative * size)
    )
    if kind != "both":
        # A reading that is the mean of four has half of its noise.
        mean = estimate_noise(error / 2, size, 0.02 * size, 1.0 * np.arange(n), 4 * weight)
        assert mean is not None
        assert mean.absolute == pytest.approx(found.absolute, rel=0.05)
        assert mean.relative == pytest.approx(found.relative, rel=0.05)


def test_gain_of_a_noise_model_is_over_the_assumed_one() -> None:
    n = 400
    size, error = np.full(n, 2.0), np.random.default_rng(1).normal(size=n)
    along, weight = np.arange(n) * 1.0, np.ones(n)
    found = estimate_noise(error, size, np.full(n, 5.0), along, weight)
    assert found is not None
    # A factor of the assumed noise is none: all readings have one size.
    assert found.gain == pytest.approx(0.0, abs=1e-9)
    assert not found.excludes_assumed
    tilted = estimate_noise(error, size, np.linspace(1, 2, n), along, weight)
    assert tilted is not None
    d, w = _differences(error, along)
    same, _ = _likelihood(d, _deviation(w, np.ones(n)))
    other, _ = _likelihood(d, _deviation(w, np.linspace(1, 2, n)))
    assert tilted.gain == pytest.approx(same - other, rel=0.02)


def test_an_outlier_says_nothing_of_how_noise_grows() -> None:
    n = 300
    size, weight = np.linspace(1, 2, n), np.ones(n)
    error = np.random.default_rng(1).normal(size=n)
    plain = estimate_noise(error, size, weight, np.arange(n) * 1.0, weight)
    error[150] += 1e4
    found = estimate_noise(error, size, weight, np.arange(n) * 1.0, weight)
    assert plain is not None
    assert found is not None
    middle = size[150:151]
    assert found.deviation(middle)[0] < 1.3 * plain.deviation(middle)[0]


def test_noise_of_few_or_exact_readings_is_unknown() -> None:
    size = np.linspace(1, 2, 12)
    error = np.random.default_rng(1).normal(size=12)
    along, one = np.arange(12.0), np.ones(12)
    assert estimate_noise(error, size, one, along, one) is not None
    assert estimate_noise(*(x[1:] for x in (error, size, one, along, one))) is None
    assert estimate_noise(0 * error, size, one, along, one) is None
    assert estimate_noise(1e-10 * error, size, one, along, one) is None


@pytest.mark.parametrize(("gain", "excluded"), [(8.1, False), (8.2, True)])
def test_assumed_noise_is_excluded_at_one_in_a_thousand(gain: float, excluded: bool) -> None:
    # chi-square of one degree reaches 10.83 so often; the gain is 3/2 times too large.
    assert stats.chi2.isf(1e-3, 1) * 1.5 / 2 == pytest.approx(8.12, abs=0.01)
    assert NoiseModel(1.0, 0.0, "absolute", gain).excludes_assumed == excluded


def test_both_parts_of_the_noise_maximise_the_likelihood() -> None:
    n = 60
    size, thin = np.linspace(0.1, 10, n), np.linspace(1, 2, n)
    w = np.full(n - 2, 0.5)
    d = RNG.normal(size=n - 2) * _deviation(w, thin * np.hypot(0.5, 0.1 * size))
    value, (a, b) = _both(d, w, size, thin, 1.0, 0.2)

    def likelihood(a: float, b: float) -> float:
        sigma = _deviation(w, thin * np.hypot(a, b * size))
        return float(-np.sum(np.log(sigma)) - 0.5 * np.sum((d / sigma) ** 2))

    assert value == pytest.approx(likelihood(a, b), rel=1e-12)
    for factor in (0.97, 1.03):
        assert likelihood(a * factor, b) < value
        assert likelihood(a, b * factor) < value


# --- misfit -------------------------------------------------------------------------------


def test_runs_are_counted_test_by_test_and_zeros_have_no_sign() -> None:
    paths = [np.array([1.0, 2.0, -1.0, 0.0, -2.0, 3.0]), np.array([1.0, 1.0]), np.array([5.0])]
    found = misfit(paths, 1, known_noise=False)
    assert found.runs == 3 + 1
    assert found.expected_runs == 1 + 4 / 2 + 1 + 1 / 2
    z = (4 - 4.5 + 0.5) / np.sqrt(5 / 4)
    assert found.runs_p == pytest.approx(stats.norm.cdf(z), rel=1e-12)
    assert found.dof == 9 - 1
    products = (1 * 2 + 2 * -1 + -1 * -2 + -2 * 3) + 1
    squares = (1 + 4 + 1 + 4 + 9) * 4 / 5 + 2 * 1 / 2
    assert found.autocorrelation == pytest.approx(products / squares, rel=1e-12)
    assert np.isnan(found.chi_square)
    assert np.isnan(found.chi_square_p)


def test_chi_square_of_known_noise_widens_by_its_root() -> None:
    rng = np.random.default_rng(4)
    r = 2.0 * rng.normal(size=60)
    found = misfit([r], 2, known_noise=True)
    assert found.chi_square == pytest.approx(r @ r, rel=1e-12)
    assert found.chi_square_p == pytest.approx(stats.chi2.sf(r @ r, 58), rel=1e-9)
    assert found.significant
    assert found.inflation == pytest.approx(np.sqrt(r @ r / 58), rel=1e-12)
    assert f"chi-square is {r @ r:.4g} for 58 degrees of freedom" in found.description
    fine = misfit([r / 2], 2, known_noise=True)
    assert (fine.significant, fine.inflation, fine.description) == (False, 1.0, "")


def test_correlated_residuals_widen_by_the_root_of_fewer_readings() -> None:
    """An autoregressive series of correlation rho: sqrt((1 + rho) / (1 - rho))."""
    rng, n = np.random.default_rng(2), 2000
    noise, r = rng.normal(size=n), np.zeros(n)
    for i in range(1, n):
        r[i] = 0.6 * r[i - 1] + noise[i]
    found = misfit([r], 3, known_noise=False)
    assert found.autocorrelation == pytest.approx(0.6, abs=0.05)
    rho = found.autocorrelation
    rho += 4 * (1 + rho) / n
    assert found.inflation == pytest.approx(np.sqrt((1 + rho) / (1 - rho)), rel=1e-12)
    # Below two standard errors of a correlation nothing is widened.
    free = misfit([noise], 3, known_noise=False)
    assert abs(free.autocorrelation) < 2 / np.sqrt(n)
    assert free.inflation == 1.0
    # Residuals that are rounding have no pattern, whatever they do.
    exact = misfit([np.ones(50)], 1, known_noise=False, exact=1.0)
    assert (exact.significant, exact.inflation) == (False, 1.0)
    assert misfit([np.ones(50)], 1, known_noise=False, exact=0.99).significant
    # At most as if the correlation were 0.97.
    most = misfit([np.linspace(1, 1.1, 50)], 1, known_noise=False)
    assert most.inflation == pytest.approx(np.sqrt(1.97 / 0.03), rel=1e-12)


def bent(known: bool) -> tuple[Any, Any, float]:
    """Noise with a parabola on it, beside a constant and a slope that were fitted."""
    n, rng = 40, np.random.default_rng(5)
    x = np.linspace(-1, 1, n)
    J = np.stack([np.ones(n), x], 1)
    r = rng.normal(size=n) + 4.0 * (x**2 - 1 / 3)
    r = r - J @ np.linalg.lstsq(J, r, rcond=None)[0]
    return r, J, n


@pytest.mark.parametrize("known", [False, True])
def test_smooth_patterns_are_a_test_of_lack_of_fit(known: bool) -> None:
    """Two more columns than the constants: the F test of nested models, or chi-square."""
    r, J, n = bent(known)
    p, ratio = _patterns([(r, J)], known)
    x = np.linspace(-1, 1, n)
    whole = np.stack([np.ones(n), x, x**2, x**3], 1)
    left = r - whole @ np.linalg.lstsq(whole, r, rcond=None)[0]
    explained, rest = r @ r - left @ left, left @ left
    if known:
        expected, share = stats.chi2.sf(explained, 2), explained / 2
    else:
        expected = stats.f.sf(explained / 2 / (rest / (n - 4)), 2, n - 4)
        share = explained / 2 / (r @ r / (n - 2))
    assert p == pytest.approx(expected, rel=1e-6)
    assert ratio == pytest.approx(share, rel=1e-8)
    found = misfit([r], 2, known_noise=known, smooth=[(r, J)])
    assert found.significant
    assert found.pattern_p == p
    assert found.inflation >= np.sqrt(ratio)
    assert "residuals bend smoothly along the tests" in found.description


def test_one_loud_reading_is_no_pattern() -> None:
    rng, flagged, bent = np.random.default_rng(0), 0, 0
    slope = np.linspace(0.0, 1.0, 40)[:, None]  # at rest a modulus moves nothing
    for _ in range(200):
        r = rng.standard_normal(40)
        r[0] *= 30.0
        flagged += misfit([r], 1, known_noise=False, smooth=[(r, slope)]).significant
        r[0] /= 30.0
        r += 2.0 * np.linspace(-1.0, 1.0, 40)
        bent += misfit([r], 1, known_noise=False, smooth=[(r, slope)]).significant
    assert flagged <= 6  # a chance of 1 % each for runs and patterns; 10 in 0.3 %
    assert bent >= 190


def test_patterns_need_readings_to_spare() -> None:
    r, J = RNG.normal(size=7), np.ones((7, 1))
    assert np.isnan(_patterns([(r, J)], False)[0])
    assert np.isfinite(_patterns([(RNG.normal(size=8), np.ones((8, 1)))], False)[0])
    full = np.vander(np.linspace(-1, 1, 30), 4)
    assert np.isnan(_patterns([(RNG.normal(size=30), full)], False)[0])  # constants follow all


def test_derivatives_are_smoothed_where_readings_are_enough() -> None:
    n = 48
    x = np.linspace(-1, 1, n)
    noisy = (x**3 + 0.1 * np.sign(np.sin(40 * x)))[:, None]
    design = np.polynomial.chebyshev.chebvander(x, 10)
    fitted = design @ np.linalg.lstsq(design, noisy, rcond=None)[0]
    np.testing.assert_allclose(_smoothed(noisy), fitted, rtol=1e-9, atol=1e-12)
    few = noisy[:15]
    assert _smoothed(few) is few
    assert _smoothed(noisy[:16]) is not noisy


def test_basis_of_columns_and_its_dimension() -> None:
    columns = np.array([[1.0, 1.0, 0.0], [0.0, 1e-12, 1.0], [0.0, 0.0, 0.0]])
    basis, rank = _basis(columns)
    assert rank == 2
    np.testing.assert_allclose(basis @ basis.T, np.diag([1.0, 1.0, 0.0]), atol=1e-9)
    assert _basis(np.zeros((3, 0)))[1] == 0
    # What counts as rounding grows with the longest column.
    assert _basis(1e4 * np.eye(3)[:, :2] * [1.0, 1e-11])[1] == 1


@pytest.mark.parametrize("known", [False, True])
def test_information_criteria_are_akaike_s_and_schwarz_s(known: bool) -> None:
    square, n, p = 7.0, 20, 3
    deviance = square if known else n * np.log(square / n)
    k = p if known else p + 1
    aicc, bic = information_criteria(square, n, p, known_noise=known)
    assert aicc == pytest.approx(deviance + 2 * k + 2 * k * (k + 1) / (n - k - 1), rel=1e-12)
    assert bic == pytest.approx(deviance + k * np.log(n), rel=1e-12)
    assert information_criteria(square, k + 1, p, known_noise=known)[0] == np.inf
    assert np.isfinite(information_criteria(square, k + 2, p, known_noise=known)[0])


# --- scatter between groups ---------------------------------------------------------------


def test_scatter_of_equal_errors_is_what_their_variance_exceeds() -> None:
    values, error = np.array([1.0, 2.0, 4.0, 7.0]), 0.5
    found = scatter_between(values, np.full(4, error))
    variance = values.var(ddof=1)
    assert found.mean == pytest.approx(3.5)
    assert found.deviation == pytest.approx(np.sqrt(variance - error**2), rel=1e-9)
    assert found.mean_error == pytest.approx(np.sqrt(variance / 4), rel=1e-9)
    q = 3 * variance
    for end, share in ((found.low, 0.975), (found.high, 0.025)):
        expected = np.sqrt(q / stats.chi2.ppf(share, 3) - error**2)
        assert end == pytest.approx(expected, rel=1e-9)
    assert found.chance == pytest.approx(stats.chi2.sf(q / error**2, 3), rel=1e-9)


def test_groups_no_more_different_than_their_errors_do_not_scatter() -> None:
    found = scatter_between(np.array([1.0, 1.1]), np.array([1.0, 2.0]))
    assert found.deviation == found.low == 0.0
    weight = np.array([1.0, 0.25])
    assert found.mean == pytest.approx((1.0 + 0.275) / 1.25)
    assert found.mean_error == pytest.approx(1 / np.sqrt(weight.sum()))
    # Exact groups scatter by what they differ.
    exact = scatter_between(np.array([1.0, 2.0, 3.0]), np.zeros(3))
    assert exact.deviation == pytest.approx(1.0, rel=1e-6)


# --- profiles -----------------------------------------------------------------------------


def straight(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Residuals of a straight line."""
    return LINE @ x - Y, LINE


BEST = np.linalg.lstsq(LINE, Y, rcond=None)[0]


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("gradient", [[1.0, 0.0], [0.0, 1.0], [1.0, 2.5]])
def test_profile_of_a_linear_model_is_its_gaussian_interval(
    side: float, gradient: list[float]
) -> None:
    """C rises by excess where g moves by sqrt(2 excess) of its standard deviations."""
    g, excess = np.array(gradient), 1.92
    deviation = np.sqrt(g @ np.linalg.inv(LINE.T @ LINE) @ g)
    half = np.sqrt(2 * excess) * deviation
    for step in (half, 0.2 * half, 3 * half):
        found = profile_end(
            straight, lambda x: (float(g @ x), g), BEST, side, excess, step, 100 * half
        )
        assert not found.is_open
        assert found.value == pytest.approx(g @ BEST + side * half, rel=0.01 * half)


def test_profile_of_an_exponential_ends_where_its_closed_form_does() -> None:
    """R = 3 (exp(x) - 1) and g = x: the ends are log(1 -+ sqrt(2 excess) / 3)."""

    def at(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return 3 * (np.exp(x) - 1), 3 * np.exp(x)[:, None]

    for excess in (0.5, 1.9):
        for side in (-1.0, 1.0):
            end = profile_end(
                at, lambda x: (x[0], np.ones(1)), np.zeros(1), side, excess, 0.3, 20.0
            )
            expected = np.log(1 + side * np.sqrt(2 * excess) / 3)
            assert end.value == pytest.approx(expected, rel=0.01)
    # Below excess 4.5 the cost never rises so far on the left.
    end = profile_end(at, lambda x: (x[0], np.ones(1)), np.zeros(1), -1.0, 5.0, 1.0, 20.0)
    assert end == (-20.0, True)


def test_constrained_minimum_of_a_line_is_lagrange_s() -> None:
    g, wanted = np.array([1.0, 2.0]), 6.0
    theta, cost = constrained(straight, lambda x: (float(g @ x), g), BEST, wanted, 1.0, 100)
    inverse = np.linalg.inv(LINE.T @ LINE)
    expected = BEST + inverse @ g * (g @ theta - g @ BEST) / (g @ inverse @ g)
    np.testing.assert_allclose(theta, expected, rtol=1e-6)
    assert cost == pytest.approx(0.5 * np.sum((LINE @ expected - Y) ** 2), rel=1e-9)
    # The residual of weight w and the line's own, of 1 / (g inverse g), share the way.
    own = 1.0 / (g @ inverse @ g)
    assert g @ theta - g @ BEST == pytest.approx((wanted - g @ BEST) / (1.0 + own), rel=1e-6)


def test_a_value_that_the_quantity_never_has_leaves_the_end_open_or_unknown() -> None:
    quantity = lambda x: (np.tanh(x[0]), np.array([np.cosh(x[0]) ** -2, 0.0]))  # noqa: E731
    start = np.tanh(BEST[0])
    far = profile_end(straight, quantity, BEST, 1.0, 1e4, 0.5 * (1.0 - start), 5.0)
    assert far.is_open
    assert far.value == pytest.approx(1.0, abs=0.05)
    assert np.isnan(profile_end(straight, quantity, BEST, 1.0, 1e4, 2.0, 5.0).value)


# --- least squares ------------------------------------------------------------------------


def test_predicted_decrease_is_in_full_up_to_a_step_of_one() -> None:
    """Of r = (a, b) and J = diag(s, t): 1/2 a^2 if a <= s, else s a - 1/2 s^2."""
    r, J = np.array([3.0, 0.5]), np.diag([2.0, 4.0])
    cost, decrease = judged(r, J)
    assert float(cost) == pytest.approx(0.5 * 9.25)
    assert float(decrease) == pytest.approx((2 * 3 - 2 + 0.125) / 4.625)
    cost, decrease = judged(np.array([np.nan, 0.5]), J)
    assert (float(cost), float(decrease)) == (np.inf, np.inf)
    cost, decrease = judged(0 * r, J)
    assert (float(cost), float(decrease)) == (0.0, 0.0)


def test_a_minimum_has_no_decrease_left_or_nothing_but_rounding() -> None:
    cost = np.array([1.0, 1.0, 9e-20, 11e-20, np.inf])
    decrease = np.array([1e-9, 1.1e-9, 1.0, 1.0, 0.0])
    assert _is_minimum(cost, decrease, 10).tolist() == [True, False, True, False, False]


def test_starts_agree_that_share_the_lowest_cost() -> None:
    cost = np.array([1.0, 1.0 + 0.9e-6, 1.0 + 1.1e-6, 1.0])
    found = Minima(np.zeros((4, 1)), cost, np.array([1, 1, 1, 0], bool), np.zeros(4))
    assert found.agreeing == 2


def test_minima_of_a_linear_model_are_the_solution_of_its_normal_equations() -> None:
    starts = np.array([[0.0, 0.0], [5.0, -3.0], [1.0, 2.0]])
    model = linear(LINE, Y)
    square = 0.5 * np.sum((LINE @ BEST - Y) ** 2)
    found = minimise_one_by_one(model, starts)
    assert found.converged.all()
    np.testing.assert_allclose(found.theta, np.tile(BEST, (3, 1)), rtol=1e-6)
    np.testing.assert_allclose(found.cost, square, rtol=1e-9)
    assert (np.diff(found.cost) >= 0).all()


def test_a_search_ends_where_a_step_gains_too_little_and_not_before() -> None:
    def at(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rise = np.exp(theta[0])
        return np.array([rise - 2.0, 0.1]), np.array([[rise], [0.0]])

    exact, _, _ = _minimum(at, np.array([3.0]), 60, 0.0)
    near, cost, decrease = _minimum(at, np.array([3.0]), 60, 1e-6)
    assert exact[0] == pytest.approx(np.log(2.0), abs=1e-9)
    assert cost * decrease < 1e-6
    assert 1e-9 < abs(near[0] - exact[0]) < 1e-3


def test_a_step_to_where_nothing_is_a_number_is_taken_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Few of many residuals: there as many as elsewhere."""
    asked = []

    def at(_: Any, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        asked.append(theta)
        return np.where(len(asked) == 2, np.nan, LINE @ theta - Y), LINE

    monkeypatch.setattr("fitting.statistics.least_squares.by_theta", at)
    found = minimise_one_by_one(linear(LINE, Y), np.array([[3.0, 1.0]]))
    assert found.converged.all()
    np.testing.assert_allclose(found.theta[0], BEST, rtol=1e-6)


TWO = Family("two", (Constant("C1"), Constant("C2", "free")), lambda *c: None)  # type: ignore[arg-type,return-value]
FREE: dict[str, Any] = {"law_name": "two", "build": lambda *c: None}


def test_minimum_in_a_box_is_on_its_face_where_the_free_one_is_beyond() -> None:
    """The line's intercept kept above its own: the slope follows from the normal equation."""
    family = Family(**FREE, parts=(Constant("C1", "free"), Constant("C2", "free")))
    model = linear(LINE, Y)
    low = BEST[0] + 0.2
    constants, minima, stuck = minimise_in_box(
        model, family, BEST, np.array([[3.0, 1.0]]), {"C1": (low, 10.0)}
    )
    slope = X @ (Y - low) / (X @ X)
    np.testing.assert_allclose(constants, [low, slope], rtol=1e-6)
    assert stuck == ("C1",)
    assert minima.converged.all()
    assert minima.cost[0] == pytest.approx(
        0.5 * np.sum((LINE @ np.array([low, slope]) - Y) ** 2), rel=1e-9
    )
    wide, _, stuck = minimise_in_box(model, family, BEST, np.zeros((0, 2)), {"C1": (-9, 9)})
    np.testing.assert_allclose(wide, BEST, rtol=1e-6)
    assert stuck == ()


def test_decrease_in_a_box_counts_what_leads_back_into_it() -> None:
    """Stopped far from its end, the search would be judged by the step that is left."""
    model = linear(LINE, Y)
    point = np.array([8.0, -3.0])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "fitting.material.fit.search.solved_by_scipy",
            lambda f, start, **given: SimpleNamespace(x=start),
        )
        far = np.full(2, np.inf)
        constants, cost, decrease = _solve(model, point, -far, far)
        r = LINE @ point - Y
        u, s, _ = np.linalg.svd(LINE * np.abs(point), full_matrices=False)
        along = np.abs(u.T @ r)
        expected = np.where(along <= s, along**2 / 2, s * along - s**2 / 2).sum() / (r @ r / 2)
        np.testing.assert_allclose(constants, point)
        assert cost == pytest.approx(r @ r / 2)
        assert decrease == pytest.approx(expected, rel=1e-9)


def test_bounds_of_a_box_respect_the_law_s_signs() -> None:
    low, high = _box(TWO, np.ones(2), {"C1": (-5.0, 3.0), "C2": (-1.0, 1.0)})
    assert (low.tolist(), high.tolist()) == ([0.0, -1.0], [3.0, 1.0])
    with pytest.raises(ValueError, match="has no such constant; allowed: C1, C2"):
        _box(TWO, np.ones(2), {"C3": (0.0, 1.0)})
    with pytest.raises(ValueError, match="no value in it is allowed"):
        _box(TWO, np.ones(2), {"C1": (-5.0, 0.0)})


# --- parameters ---------------------------------------------------------------------------

SCALES = Scales(stress=2e5, i1=4.0, i2=9.0, strain=1.0)


def test_constants_are_exponentials_multiples_or_limits_of_their_sizes() -> None:
    parts = (
        Constant("C1"),
        Constant("k", "free", "1"),
        Constant("Jm", "above I1", "1"),
        Constant("C20", "free", "Pa", (2, 0), (0.0, 3.0)),
        Constant("C11", "positive", "Pa", (1, 1)),
        Constant("C01", "positive", "Pa", (0, 1)),
    )
    family = Family(**FREE, parts=parts)
    theta = jnp.array([0.5, -2.0, 0.3, 1.5, -1.0, 0.2])
    found = np.asarray(quick(family.constants, jax.jit)(theta, SCALES))
    expected = [
        2e5 * np.exp(0.5),
        -2.0,
        4.0 * (1 + np.exp(0.3)),
        1.5 * 2e5 / 16 * 13,
        np.exp(-1.0) * 2e5 / 36 * 13,
        2e5 * np.exp(0.2),
    ]
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    back = quick(family.unconstrained, jax.jit)(jnp.asarray(found), SCALES)
    np.testing.assert_allclose(np.asarray(back), theta, rtol=1e-10)
    assert family.prior_deviation.tolist() == [3.0, 10.0, 3.0, 10.0, 3.0, 3.0]
    assert family.theta_names == ("log(C1)", "k", "log(Jm)", "C20", "log(C11)", "log(C01)")
    low, high = family.signs(found, {})
    assert low.tolist() == [0.0, -np.inf, 0.0, -np.inf, 0.0, 0.0]
    assert (high == np.inf).all()
    starts = family.random(np.random.default_rng(0), 50)
    assert starts[0].tolist() == [0.0, 0.0, 0.0, 1.5, 0.0, 0.0]
    assert starts.shape == (50, 6)
    assert (starts[:, 3] >= 0).all()
    assert starts[:, 3].max() > 2.5
    assert np.abs(starts[:, 0]).max() <= 1.0


def test_starts_are_within_a_factor_of_e_of_the_natural_sizes() -> None:
    family = Family(**FREE, parts=(Constant("C1"),))
    starts = family.random(np.random.default_rng(0), 400)[:, 0]
    assert starts[0] == 0.0
    np.testing.assert_allclose([starts.min(), starts.max()], [-1.0, 1.0], atol=0.02)


def test_a_sum_that_is_bound_is_the_first_parameter() -> None:
    parts = (Constant("C1"), Constant("C2", "free"))
    family = Family(**FREE, parts=parts, law_block=SumBlock)
    found = np.asarray(family.constants(jnp.array([0.5, -3.0]), SCALES))
    assert found[1] == pytest.approx(-6e5)
    assert found.sum() == pytest.approx(2e5 * np.exp(0.5))
    back = family.unconstrained(jnp.asarray(found), SCALES)
    np.testing.assert_allclose(np.asarray(back), [0.5, -3.0], rtol=1e-10)
    assert family.theta_names == ("log(C1 + C2)", "C2")
    assert family.signs(found, {})[0].tolist() == [-np.inf, -np.inf]


def test_values_by_key_gather_lists() -> None:
    family = Family(**FREE, parts=(Constant("mu.0"), Constant("mu.1"), Constant("k")))
    assert family.tree([1.0, 2.0, 3.0]) == {"mu": [1.0, 2.0], "k": 3.0}
    assert family.size == family.law_size == 3


# --- chains and Laplace -------------------------------------------------------------------


def chain(steps: int = 1000, **changes: Any) -> Posterior:
    """A chain of four walkers and two parameters, tau of 10 and 15 steps."""
    rng = np.random.default_rng(0)
    samples = rng.normal(size=(steps, 4, 2)) * [1.0, 2.0] + [3.0, -1.0]
    fields: dict[str, Any] = {
        "names": ("a", "b"),
        "chain": samples,
        "log_probability": np.zeros((steps, 4)),
        "tau": np.array([10.0, 15.0]),
        "tau_change": 0.01,
        "acceptance": 0.5,
        "laplace": Gaussian(np.array([3.0, -1.0]), np.diag([1.0, 4.0])),
        "evaluations": 1,
        "seconds": 1.0,
    }
    return Posterior(**{**fields, **changes})


def test_a_chain_is_converged_at_fifty_times_the_slowest_tau() -> None:
    found = chain()
    assert found.length == pytest.approx(1000 / 15)
    assert found.converged
    assert found.burn_in == 30
    assert found.samples.shape == (970 * 4, 2)
    np.testing.assert_allclose(found.effective_samples, 970 * 4 / np.array([10.0, 15.0]))
    assert found.message.startswith(
        "converged: 1000 steps are 66.7 autocorrelation times (15.0 steps for b, the slowest; "
        "50 are needed); acceptance 0.50"
    )
    assert chain(750).converged
    short = chain(749)
    assert not short.converged
    assert short.message.endswith("; raise --steps to 900")
    moving = chain(tau_change=0.051)
    assert not moving.converged
    assert moving.message.endswith("its estimate still changed by 5.1 %; raise --steps to 2000")
    assert chain(40).burn_in == 20  # at most half of it


def test_a_chain_too_short_for_its_tau_says_so() -> None:
    found = chain(tau=np.array([10.0, np.inf]))
    assert found.length == 0.0
    assert found.burn_in == 500
    assert found.effective_samples[1] == 0.0
    assert "too few to estimate the autocorrelation time of b" in found.message


def test_chain_and_laplace_agree_within_half_a_deviation_and_a_fifth() -> None:
    assert chain().agreement["agree"]
    n = chain().effective_samples
    slack = 3 / np.sqrt(n)
    kept = chain().samples
    for by, ok in ((0.49, True), (0.51, False)):
        mean = kept.mean(0) - np.array([by + slack[0], 0.0]) * kept.std(0)
        shifted = Gaussian(mean, np.diag(kept.var(0)))
        assert chain(laplace=shifted).agreement["agree"] == ok
    for factor, ok in ((1.19, True), (1.21, False)):
        wide = kept.std(0) * np.array([1.0, factor + slack[1]])
        for deviation in (wide, kept.var(0) / wide):
            one = Gaussian(kept.mean(0), np.diag(deviation**2))
            found = chain(laplace=one).agreement
            assert found["agree"] == ok
    assert found["message"] == "not Gaussian in b: quote the quantiles of the chain"
    assert not chain(laplace=None).agreement["agree"]


def test_draws_are_of_the_chain_after_burn_in() -> None:
    found = chain()
    found.chain[:30] = 1e9
    drawn = found.draws(500, seed=1)
    assert drawn.shape == (500, 2)
    assert drawn.max() < 1e6
    assert not np.array_equal(drawn, found.draws(500, seed=2))


@pytest.mark.parametrize(
    ("value", "rounded"), [(901.0, 910), (900.0, 900), (0.3, 1), (12.0, 12), (12345.0, 13000)]
)
def test_advice_has_two_digits(value: float, rounded: int) -> None:
    assert _round_up(value) == rounded


def test_expansion_is_the_gradient_and_hessian_in_the_coordinates_of_the_root() -> None:
    hessian = -np.array([[2.0, 0.5, 0.1], [0.5, 1.0, -0.3], [0.1, -0.3, 3.0]])
    centre, slope = np.array([1.0, 2.0, 3.0]), np.array([0.3, -0.2, 0.7])
    root = np.array([[2.0, 0.0, 0.0], [0.3, 1.0, 0.0], [-0.1, 0.2, 0.5]])

    def batch(x: np.ndarray) -> np.ndarray:
        d = x - centre
        return d @ slope + 0.5 * np.einsum("ni,ij,nj->n", d, hessian, d)

    gradient, curvature = _expansion(batch, centre, root, 0.0)
    np.testing.assert_allclose(gradient, root.T @ slope, rtol=1e-9)
    np.testing.assert_allclose(curvature, root.T @ hessian @ root, rtol=1e-9)
    found = laplace(batch, Gaussian(centre, root @ root.T))
    assert found is not None
    np.testing.assert_allclose(found.covariance, np.linalg.inv(-hessian), rtol=1e-6)
    np.testing.assert_allclose(found.mean, centre - np.linalg.solve(hessian, slope), rtol=1e-6)


def test_expansion_climbs_out_of_a_hollow() -> None:
    """Log p = x^2 - x^4: hollow at zero, a maximum of curvature 4 at the root of a half."""

    def batch(x: np.ndarray) -> np.ndarray:
        return (x**2 - x**4)[:, 0]

    found = laplace(batch, Gaussian(np.array([0.1]), np.array([[1e-4]])))
    assert found is not None
    assert found.mean[0] == pytest.approx(np.sqrt(0.5), rel=1e-2)
    assert found.covariance[0, 0] == pytest.approx(0.25, rel=2e-2)
    assert laplace(batch, Gaussian(np.zeros(1), np.array([[1e-4]]))) is None


def test_batches_are_cut_and_padded_and_what_is_impossible_is_minus_infinity() -> None:
    batch = Batch(lambda x: jnp.where(x[:, 0] > 0, -(x[:, 0] ** 2), jnp.nan), 1, 4)
    points = np.array([[1.0], [2.0], [-1.0], [3.0], [4.0]])
    np.testing.assert_array_equal(batch(points), [-1.0, -4.0, -np.inf, -9.0, -16.0])
    assert batch.evaluations == 8
    plain = NumpyBatch(lambda x: np.where(x[:, 0] > 0, -x[:, 0], np.nan))
    np.testing.assert_array_equal(plain(points[1:3]), [-2.0, -np.inf])
    assert plain.evaluations == 2


def test_tau_of_an_autoregressive_chain_is_its_closed_form() -> None:
    """(1 + rho) / (1 - rho) steps; infinite for fewer than ten steps."""
    rng, rho = np.random.default_rng(0), 0.8
    x = np.zeros((20000, 4, 1))
    for k in range(1, len(x)):
        x[k] = rho * x[k - 1] + rng.normal(size=(4, 1))

    class Backend:
        def get_chain(self) -> np.ndarray:
            return x

    assert _tau(Backend(), len(x), 1)[0] == pytest.approx(9.0, rel=0.1)
    assert _tau(Backend(), 9, 1).tolist() == [np.inf]
    assert _change(np.array([10.0, 20.0]), np.array([11.0, 19.0])) == pytest.approx(0.1)
    assert _change(np.array([np.inf]), np.array([1.0])) == np.inf


def test_walkers_begin_at_possible_points_ever_closer_to_the_mean() -> None:
    start = Gaussian(np.zeros(1), np.eye(1))
    batch = NumpyBatch(lambda x: np.where(np.abs(x[:, 0]) < 0.1, 0.0, np.nan))
    points = _walkers(batch, start, 40, np.random.default_rng(0))
    assert np.abs(points).max() < 0.1
    assert len(np.unique(points)) == 40
    with pytest.raises(ArithmeticError, match="40 of 40 walkers found no possible point"):
        _walkers(NumpyBatch(lambda x: np.nan * x[:, 0]), start, 40, np.random.default_rng(0))


def test_settings_that_make_no_chain_are_refused() -> None:
    batch, start = NumpyBatch(lambda x: -(x**2).sum(1)), Gaussian(np.zeros(3), np.eye(3))
    for walkers in (4, 7):
        with pytest.raises(ValueError, match=f"--walkers {walkers}: an even number of at leas"):
            sample(batch, start, ("a", "b", "c"), Settings(walkers=walkers))
    few = Settings(walkers=6, steps=2, check=1)
    assert sample(batch, start, ("a", "b", "c"), few).samples.shape[1] == 3
    with pytest.raises(ValueError, match="--moves hop"):
        Settings(moves="hop")
    for wrong in ({"steps": 0}, {"check": 0}):
        with pytest.raises(ValueError, match="at least one"):
            Settings(**wrong)  # type: ignore[arg-type]
    assert dataclasses.replace(Settings(), steps=1, check=1).steps == 1


@pytest.mark.parametrize("n", [5, 40])
def test_residuals_are_compressed_without_a_change_of_cost_or_step(n: int) -> None:
    r, J = RNG.normal(size=n), RNG.normal(size=(n, 4))
    short, slope = compressed(r, J)
    assert len(short) == min(n, 5)
    assert short @ short == pytest.approx(r @ r, rel=1e-12)
    np.testing.assert_allclose(slope.T @ short, J.T @ r, rtol=1e-10)
    np.testing.assert_allclose(slope.T @ slope, J.T @ J, rtol=1e-10)
    nothing = np.full(n, np.nan)
    assert compressed(nothing, J)[0] is nothing
