"""Formulas of fitting a law against closed forms: intervals, noise, specimens, histories."""

import dataclasses
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from fitting.material.data.errors import DataError
from fitting.material.experiments.artefacts import curve_suspects
from fitting.material.experiments.free_zero import FreeZero, idle, smoothed, toe_end
from fitting.material.experiments.history import (
    HistoryTest,
    _corners,
    _pulled,
    _pushed,
    _states,
    thinned_history,
    with_history,
)
from fitting.material.experiments.measurements import PATHS, Origin
from fitting.material.experiments.prediction import mode_factors, padded, shear_factors
from fitting.material.experiments.timing import Stated
from fitting.material.experiments.volumetric import VolumetricTest
from fitting.material.fit.bulk_modulus import (
    BulkModulus,
    compressibility_remark,
    fit_bulk_modulus,
)
from fitting.material.fit.comparison import Comparison, undetermined_term
from fitting.material.fit.intervals import _ends, _normal, _Search
from fitting.material.fit.noise import Noise, estimated_noise, noise_remark, with_noise
from fitting.material.fit.preparation import window_of
from fitting.material.fit.problem import _scales_of, reading_scale, shared_error
from fitting.material.fit.specimens import (
    Specimens,
    of_typical_specimen,
    scatter_between,
    specimens_of,
)
from fitting.material.fit.suspects import _in_percent, _may_be_percent, zero_in_units
from fitting.material.laws.blocks import Relaxation, Softening
from fitting.material.laws.parameters import Constant, Family, Scales
from fitting.statistics.noise_model import NoiseModel
from suas_jax.constitutive.laws.neo_hookean import NeoHookean
from tests.skins import quick
from tests.stand_ins import MU, neo_hookean, tension
from tests.test_linear_model import LINE, Y

RNG = np.random.default_rng(0)


# --- intervals ----------------------------------------------------------------------------


def test_normal_intervals_of_one_sign_are_even_in_the_logarithm() -> None:
    constants, half = np.array([2.0, -4.0, 3.0]), np.array([1.0, 2.0, 0.5])
    found = _normal(constants, half, np.array([True, True, False]))
    by = np.exp(0.5)
    np.testing.assert_allclose(found[0], [2 / by, -4 * by, 2.5], rtol=1e-12)
    np.testing.assert_allclose(found[1], [2 * by, -4 / by, 3.5], rtol=1e-12)


def searched(exponential: bool) -> tuple[_Search, Any]:
    """A straight line's residuals, by its constants or by their logarithms."""
    best = np.linalg.lstsq(LINE, Y, rcond=None)[0]

    def mapped(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return (np.exp(x), np.diag(np.exp(x))) if exponential else (x, np.eye(2))

    def at(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        c, slope = mapped(x)
        return LINE @ c - Y, LINE @ slope

    theta = np.log(best) if exponential else best
    none: Any = None
    _, s, vt = np.linalg.svd(at(theta)[1], full_matrices=False)
    return _Search(none, best, at, mapped, theta), (s, vt)


def test_ends_of_a_linear_constant_are_its_half_width_away() -> None:
    search, svd = searched(exponential=False)
    for i in range(2):
        quantity: Any = lambda x, i=i: (float(x[i]), np.eye(2)[i])  # noqa: E731
        found = _ends(search, quantity, 0.3, search.constants[i], False, svd)
        assert found is not None
        ends, is_open = found
        np.testing.assert_allclose(ends, search.constants[i] + np.array([-0.3, 0.3]), atol=3e-3)
        assert not is_open.any()
    assert _ends(search, lambda x: (0.0, np.zeros(2)), 0.3, 1.0, False, svd) is None


def test_ends_of_a_logarithm_are_those_of_the_likelihood_and_positive() -> None:
    """In the constant itself the line's likelihood is Gaussian: ends there are even."""
    search, svd = searched(exponential=True)
    slope = search.constants[1]
    deviation = np.sqrt(np.linalg.inv(LINE.T @ LINE)[1, 1])
    quantity: Any = lambda x: (float(x[1]), np.array([0.0, 1.0]))  # noqa: E731
    for share in (1.0, 2.0):
        found = _ends(search, quantity, share * deviation, slope, True, svd)
        assert found is not None
        expected = slope + share * deviation * np.array([-1.0, 1.0])
        np.testing.assert_allclose(found[0], expected, rtol=0.02)
        below = _ends(search, quantity, share * deviation, -slope, True, svd)
        assert below is not None
        np.testing.assert_allclose(below[0], -found[0][::-1], rtol=1e-12)
    # Where the data never exclude zero the end is open.
    wide = _ends(search, quantity, 20 * slope, slope, True, svd)
    assert wide is not None
    assert wide[0][0] == 0.0
    assert wide[1].tolist() == [True, False]


# --- noise and scales ---------------------------------------------------------------------


def test_shared_error_makes_residuals_independent_again() -> None:
    e = np.array([0.5, -1.0, 2.0])
    d = shared_error(e)
    whitening = np.eye(3) - np.outer(d, d)
    covariance = np.eye(3) + np.outer(e, e)
    np.testing.assert_allclose(whitening @ covariance @ whitening, np.eye(3), atol=1e-12)
    assert shared_error(np.zeros(2)).tolist() == [0.0, 0.0]


def test_scales_are_own_sizes_with_a_floor_a_mean_square_or_the_noise() -> None:
    test = tension(
        [1.0, 1.001, 1.5, 2.0], [0.0, 1e3, 3e5, 4e5], companion=np.array([0, 0, 0, 5e5])
    )
    floor = 0.01 * 3e5
    np.testing.assert_allclose(
        reading_scale(test, [test], "relative"), [floor, floor, 3e5, 5e5]
    )
    square = np.sqrt(np.mean(test.value**2))
    np.testing.assert_allclose(reading_scale(test, [test], "absolute"), square)
    stated = dataclasses.replace(test, sigma=np.full(4, 7.0))
    np.testing.assert_allclose(reading_scale(stated, [stated], "noise"), 7.0)
    other = dataclasses.replace(test, measure="pressure", value=10 * test.value)
    np.testing.assert_allclose(test.absolute_scale([test, other]), square)
    assert dataclasses.replace(test, measure="difference").floor == pytest.approx(0.05 * 3e5)
    assert tension([1.0], [0.0]).floor == 1.0


def test_sizes_of_the_data_are_their_modulus_and_largest_invariants() -> None:
    found = _scales_of([tension(np.linspace(1.0, 2.0, 20)), tension([0.5, 1.0])])
    assert float(found.stress) == pytest.approx(MU, rel=1e-6)
    assert float(found.i1) == pytest.approx(4 + 2 / 2 - 3, rel=1e-9)
    assert float(found.i2) == pytest.approx(max(1 / 4 + 2 * 2, 4 + 2 * 0.5) - 3, rel=1e-9)
    assert float(found.strain) == pytest.approx(np.log(2), rel=1e-9)


def test_noise_of_a_test_is_that_of_a_reading_of_weight_one() -> None:
    x = np.linspace(1.1, 3.0, 900)
    error = 500.0 * RNG.normal(size=900)
    weight = np.full(900, 4.0)
    test = tension(x, weight=weight)
    inverse = np.sqrt(weight) / test.value
    found = estimated_noise(test, error / 2, test.value, inverse)
    assert found is not None
    assert found.kind == "absolute"
    assert found.absolute == pytest.approx(500.0, rel=0.06)
    assert found.excludes_assumed
    assert estimated_noise(test, error, test.value, 0 * inverse) is None
    both = dataclasses.replace(test, direction=np.repeat([1, 2], 450))
    assert estimated_noise(both, error, test.value, inverse) is None
    noise = Noise((found,), np.ones(900), True)
    (weighed,) = with_noise([test], noise, [test.value])
    np.testing.assert_allclose(weighed.sigma, found.absolute)
    with pytest.raises(ValueError, match="--residual estimated needs some 12 readings"):
        with_noise([test], Noise((None,), np.ones(900), False), [test.value])
    remark = noise_remark([test], noise, "relative")
    assert remark.startswith(
        f"the noise is not relative: a.csv: {found.absolute / 1e6:.2g} MPa"
    )


# --- specimens ----------------------------------------------------------------------------


def test_factor_of_a_specimen_is_least_squares_of_its_readings() -> None:
    x = np.tile(np.linspace(1.2, 2.0, 9), 2)
    specimen = np.repeat(np.array(["A", "B"], object), 9)
    noise = 1 + 0.01 * RNG.normal(size=18)
    value = neo_hookean(x) * np.where(specimen == "A", 1.1, 0.9) * noise
    predicted, inverse = neo_hookean(x), 1 / neo_hookean(x)
    r = (predicted - value) * inverse
    residuals: Any = SimpleNamespace(value=value, inverse_scale=inverse)

    def of_first(count: int) -> Any:
        part = tension(x[:count], value[:count], specimen=specimen[:count])
        return SimpleNamespace(residuals=residuals, tests=[(part, np.arange(count))])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "fitting.material.fit.specimens.readings", lambda residuals, c: (predicted, r)
        )
        found = specimens_of(of_first(18), np.ones(1))
        again = specimens_of(of_first(18), np.ones(1), np.array([2.0, 1.0]))
        assert specimens_of(of_first(14), np.ones(1)) is not None
        assert specimens_of(of_first(13), np.ones(1)) is None
    assert found is not None
    own = (value / predicted).reshape(2, 9)
    factors = own.mean(1)
    errors = own.std(1, ddof=1) / np.sqrt(9) / factors
    np.testing.assert_allclose(found.errors, errors, rtol=1e-9)
    logs = np.log(factors)
    weight = 1 / (errors**2 + np.var(logs))
    expected = np.exp(logs - (weight * logs).sum() / weight.sum())
    np.testing.assert_allclose(found.factors, expected, rtol=1e-9)
    assert found.differ
    assert again is not None
    assert again.factors[0] / again.factors[1] == pytest.approx(
        2 * expected[0] / expected[1], rel=1e-6
    )
    test = tension(x, value, specimen=specimen)
    (typical,) = of_typical_specimen([test], found)
    np.testing.assert_allclose(typical.value, value / np.repeat(expected, 9), rtol=1e-9)


def test_a_further_specimen_scatters_by_student_s_t() -> None:
    values = np.log([0.9, 1.0, 1.0, 1.1])
    scatter = scatter_between(values, np.full(4, 1e-5))
    reach = np.std(values, ddof=1) * np.sqrt(1.25) * stats.t.ppf(0.975, 3)
    assert scatter.further == pytest.approx(reach, rel=0.01)
    labels = tuple(("a.csv", name) for name in "ABCD")
    one = Specimens(labels, ("uniaxial",) * 4, np.exp(values), np.full(4, 0.01), scatter)
    assert one.mean_error == pytest.approx(np.std(values, ddof=1) / 2, rel=1e-3)
    report = one.report(2e6)
    np.testing.assert_allclose(
        report["next_specimen_95_Pa"], 2e6 * np.exp([-reach, reach]), rtol=0.01
    )
    assert report["specimens"][3]["shear_modulus_Pa"] == pytest.approx(2.2e6)
    assert report["specimens"][0]["standard_error"] == pytest.approx(0.009)
    assert not dataclasses.replace(one, scatter=scatter._replace(chance=0.011)).differ


@pytest.mark.parametrize(
    ("tau", "count"), [(0.0, 3), (0.005, 3), (0.05, 3), (0.0, 8), (0.05, 8)]
)
def test_a_further_specimen_lies_in_its_interval(tau: float, count: int) -> None:
    rng, error, inside = np.random.default_rng(0), 0.005, []
    for _ in range(200):
        own = tau * rng.standard_normal(count + 1)
        found = scatter_between(
            own[1:] + error * rng.standard_normal(count), np.full(count, error)
        )
        assert found.further > 0.0
        inside.append(abs(own[0] - found.mean) <= found.further)
    assert np.mean(inside) > 0.9  # of 200 at 95 %: 180 or fewer in 0.1 %


# --- laws compared ------------------------------------------------------------------------


def fit(title: str, cost: float, **changes: Any) -> Any:
    """A fit of ten readings with two constants, noise known."""
    fields: dict[str, Any] = {
        "cost": cost,
        "criteria": (2 * cost, 2 * cost),
        "status": "converged",
        "misfit": SimpleNamespace(autocorrelation=0.0, significant=False),
        "problem": SimpleNamespace(
            residuals=SimpleNamespace(used=np.ones(100, bool)), kind="noise"
        ),
        "family": SimpleNamespace(title=title, size=2, law_name=title),
        "uncertainty": SimpleNamespace(spare=0, condition_number=1.0, unidentifiable=()),
        "instabilities": lambda margin: [],
        "constants": np.ones(2),
        "known_noise": True,
    }
    return SimpleNamespace(**{**fields, **changes})


def test_correlated_residuals_leave_fewer_readings() -> None:
    def number(rho: float, readings: int = 100) -> float:
        closest = fit("a", 1.0, misfit=SimpleNamespace(autocorrelation=rho, significant=False))
        other = fit("b", 2.0, misfit=SimpleNamespace(autocorrelation=0.9, significant=True))
        other.problem.residuals.used = np.ones(readings, bool)
        return Comparison((other, closest), {}).effective_number

    assert number(0.5) == pytest.approx(100 * 0.5 / 1.5)
    assert number(0.19) == 100.0  # within two standard errors
    assert number(0.21) == pytest.approx(100 * 0.79 / 1.21)
    assert number(-0.5) == 100.0
    assert number(0.99, 1000) == pytest.approx(1000 * 0.03 / 1.97)
    assert number(0.99) == 5.0  # three more than the closest law's constants
    assert number(0.99, 4) == pytest.approx(4.0)  # and no more than there are


# --- Prony terms --------------------------------------------------------------------------

LAW = Family("neo-hookean", (Constant("mu"),), NeoHookean)


@pytest.mark.parametrize(
    ("shares", "times", "errors", "reason"),
    [
        ([0.2, 0.1], [1.0, 10.0], [0.01, 0.049], ""),
        ([0.2, 0.1], [1.0, 10.0], [0.01, 0.051], "the share 0.1 of the term of 10 s is not"),
        ([0.2, 0.1], [0.034, 10.0], [0.01, 0.01], ""),
        ([0.2, 0.1], [0.033, 10.0], [0.01, 0.01], "a term of 0.033 s lies outside"),
        ([0.2, 0.1], [1.0, 299.0], [0.01, 0.01], ""),
        ([0.2, 0.1], [1.0, 301.0], [0.01, 0.01], "a term of 301 s lies outside"),
        ([0.2, 0.1], [1.51, 1.0], [0.01, 0.01], ""),
        ([0.2, 0.1], [1.49, 1.0], [0.01, 0.01], "terms of 1 and 1.49 s are one"),
    ],
)
def test_prony_terms_that_the_data_do_not_determine(
    shares: list[float], times: list[float], errors: list[float], reason: str
) -> None:
    """Known to half of the share, within three times the times measured, 1.5 apart."""
    family = dataclasses.replace(LAW, beside=(Relaxation(2),))
    x = np.full(1001, 1.5)
    clock = np.linspace(0.0, 100.0, 1001)
    test = tension(x, time=clock, kind=HistoryTest)
    one: Any = SimpleNamespace(
        family=family,
        sets=[test],
        constants=np.array([MU, *shares, *times]),
        uncertainty=SimpleNamespace(standard_errors=np.array([1.0, *errors, 0.0, 0.0])),
    )
    assert window_of([test], 2) == (pytest.approx(0.1), 100.0)
    found = undetermined_term(one)
    assert found.startswith(reason) if reason else not found


def test_shares_times_and_softening_are_logarithms() -> None:
    beside = (Relaxation(2, (0.1, 1000.0)), Softening())
    family = dataclasses.replace(LAW, beside=beside)
    scales = Scales(2e5, 4.0, 9.0, 1.0)
    theta = jnp.array([0.1, -1.0, 0.5, 2.0, -3.0, 0.2, -0.3, 0.4])
    found = np.asarray(quick(family.constants, jax.jit)(theta, scales))
    share = np.exp([-1.0, 0.5])
    expected = [2e5 * np.exp(0.1), *(share / (1 + share.sum())), np.exp(2.0), np.exp(-3.0)]
    expected += [1 + np.exp(0.2), np.exp(-0.3) * 0.5 * 2e5 * 4.0, np.exp(0.4)]
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    back = np.asarray(quick(family.unconstrained, jax.jit)(jnp.asarray(found), scales))
    np.testing.assert_allclose(back, theta, rtol=1e-9)
    ordered = family.ordered(found)
    np.testing.assert_allclose(ordered[1:5], [found[2], found[1], found[4], found[3]])
    assert family.prior_deviation.tolist() == [3.0, 3.0, 3.0, 10.0, 10.0, 3.0, 3.0, 3.0]
    assert family.names[1:] == (
        "relaxation.g.0",
        "relaxation.g.1",
        "relaxation.tau.0",
        "relaxation.tau.1",
        "softening.r",
        "softening.m",
        "softening.beta",
    )
    assert family.units == ("Pa", "1", "1", "s", "s", "1", "Pa", "1")
    assert family.title == "neo-hookean + 2 Prony terms + Mullins softening"
    rng = np.random.default_rng(0)
    starts = np.concatenate([block.random(rng, 6) for block in beside], axis=1)
    assert starts.shape == (6, 7)
    np.testing.assert_allclose(starts[0, :2], np.log(0.25))
    even = np.log(0.1) + np.array([0.25, 0.75]) * np.log(1e4)
    np.testing.assert_allclose(starts[0, 2:4], even, atol=1e-12)
    np.testing.assert_allclose(starts[1, 2:4], even - 0.125 * np.log(1e4), atol=1e-12)
    assert (np.diff(starts[:, 2:4], axis=1) > 0).all()
    low, high = family.signs(found, {})
    assert low.tolist() == [0.0] * 8
    assert (high == np.inf).all()


# --- histories ----------------------------------------------------------------------------


def test_pulled_back_stresses_are_f_inverse_dev_tau_f_inverse_transposed() -> None:
    """Pushed forward they give the reading, whatever the two Kirchhoff stresses are."""
    test = tension([1.3, 2.0], kind=HistoryTest)
    x = np.stack([test.stretch_1, test.stretch_2])
    e1, e2, pull = _pulled(test, x)
    np.testing.assert_allclose(np.exp([e1, e2]), x, rtol=1e-12)
    push, tau = _pushed(test), np.array([3.0, -1.0])
    for k in range(2):
        deviator = np.array([tau[0], tau[1], 0.0]) - tau.sum() / 3
        stretches = np.array([x[0, k], x[1, k], 1 / (x[0, k] * x[1, k])])
        np.testing.assert_allclose(pull[k] @ tau, deviator / stretches**2, rtol=1e-12)
        reading = test.factors[2, k] * tau[0] + test.factors[3, k] * tau[1]
        assert push[k] @ (pull[k] @ tau) == pytest.approx(reading, rel=1e-12)


def test_pulled_back_stresses_of_simple_shear_read_the_shear_stress() -> None:
    shear = np.array([0.4, 2.0])
    factors = np.stack(shear_factors(shear))
    test = tension(
        np.exp(factors[0]),
        np.ones(2),
        kind=HistoryTest,
        mode="simple_shear",
        measure="shear",
        coordinate=shear,
        factors=factors,
    )
    _, _, pull = _pulled(test, np.stack([shear, 0 * shear]))
    tau = np.array([3.0, -1.0])
    reading = np.einsum("nk,nkj,j->n", _pushed(test), pull, tau)
    np.testing.assert_allclose(reading, factors[2] * tau[0] + factors[3] * tau[1], rtol=1e-12)


def states_of(stretch: Any, time: Any, ramp: float = np.nan) -> tuple[Any, ...]:
    origin = Origin("strain", "strain", "", ramp=ramp)
    clock = np.asarray(time, float)
    test = tension(stretch, time=clock, kind=HistoryTest, origin=origin)
    x, elapsed, begins, at = _states(test, np.arange(len(clock)))
    return x, elapsed, begins, at


def test_a_history_is_followed_in_steps_of_a_twentieth() -> None:
    x, elapsed, begins, at = states_of([1.0, 1.21, 1.21], [0.0, 10.0, 12.0])
    steps = int(np.ceil(np.log(1.21) / 0.05))
    assert at.tolist() == [0, steps, steps + 1]
    np.testing.assert_allclose(x[0, : steps + 1], np.linspace(1.0, 1.21, steps + 1), rtol=1e-12)
    np.testing.assert_allclose(elapsed, [0.0, *[10.0 / steps] * steps, 2.0], rtol=1e-12)
    assert np.flatnonzero(begins).tolist() == [0]
    # Without times only the order counts.
    x, elapsed, begins, at = states_of([1.0, 1.2, 1.1], [np.nan] * 3)
    assert (elapsed == 1e30).all()
    assert at.tolist() == [0, 1, 2]


def test_what_went_before_a_held_strain_is_the_stated_ramp_or_the_rate() -> None:
    held = [1.5] * 3
    # A ramp that fits in before the first reading begins at time zero.
    x, elapsed, _, at = states_of(held, [2.0, 3.0, 9.0], ramp=1.5)
    assert x[0, 0] == 1.0
    assert elapsed.sum() == pytest.approx(9.0)
    assert elapsed[: np.argmax(np.isclose(x[0], 1.5)) + 1].sum() == pytest.approx(1.5)
    # One that doesn't ends there.
    _, elapsed, _, _ = states_of(held, [1.0, 3.0, 9.0], ramp=1.5)
    assert elapsed.sum() == pytest.approx(9.0 + 1.5)
    # From a clock that begins at its first reading: it ends at that.
    _, elapsed, _, _ = states_of(held, [0.0, 3.0, 9.0], ramp=1.5)
    assert elapsed.sum() == pytest.approx(9.0 + 1.5)
    # Without one the strain was there at once, at time zero.
    x, elapsed, _, at = states_of(held, [2.0, 3.0, 9.0])
    assert elapsed.tolist() == [2.0, 1.0, 6.0]
    assert at.tolist() == [0, 1, 2]
    # A test that begins while it deforms came at that rate.
    x, elapsed, _, at = states_of([1.2, 1.3], [5.0, 6.0])
    assert x[0, 0] == 1.0
    rate = np.log(1.3 / 1.2)
    assert elapsed[: at[0] + 1].sum() == pytest.approx(np.log(1.2) / rate)


def test_a_test_is_of_relaxation_where_most_readings_hold_the_strain() -> None:
    held = tension([1.0, 1.5, 1.5, 1.501], time=np.arange(4.0), kind=HistoryTest)
    assert held.is_relaxation
    assert not tension(
        [1.0, 1.5, 1.5, 1.502], time=np.arange(4.0), kind=HistoryTest
    ).is_relaxation
    assert not tension([1.0, 1.5, 1.5, 1.501], kind=HistoryTest).is_relaxation
    some = tension([1.0, 1.1, 1.2], time=np.array([0.0, np.nan, 1.0]))
    assert with_history(some).size == 2


def test_corners_of_a_history_are_where_straight_lines_leave_it() -> None:
    clock = np.arange(101.0)
    x = np.interp(clock, [0, 30, 70, 100], [0, 1, 1, 0.5])
    found = np.flatnonzero(_corners(clock, np.stack([x, x]))).tolist()
    assert found == [0, 30, 70, 100]
    quick_test = np.flatnonzero(_corners(1e-3 * clock, np.stack([x, x]))).tolist()
    assert quick_test == found  # however fast it is
    # A hundredth of the span is not a corner.
    assert (
        np.flatnonzero(_corners(clock, np.stack([x + 0.009 * (clock == 50), x]))).tolist()
        == found
    )
    assert 50 in np.flatnonzero(_corners(clock, np.stack([x + 0.011 * (clock == 50), x])))


def test_thinned_histories_keep_means_and_weights() -> None:
    clock = np.linspace(0.0, 100.0, 501)
    stretch = np.interp(clock, [0, 20, 100], [1.0, 2.0, 2.0])
    test = tension(stretch, time=clock, kind=HistoryTest)
    few = thinned_history(test, 100)
    assert few.size < 100
    assert few.weight.sum() == pytest.approx(501)
    for name in ("value", "time", "coordinate"):
        mean = (few.weight * getattr(few, name)).sum()
        assert mean == pytest.approx(getattr(test, name).sum(), rel=1e-9)
    assert few.time[0] == 0.0
    assert few.time[-1] == 100.0
    assert thinned_history(test, 0) is thinned_history(test, 501) is test


@pytest.mark.parametrize(
    ("text", "rate"),
    [
        ("0.1 1/s", 0.1),
        ("5 %/min", 0.05 / 60),
        ("2 /h", 2 / 3600),
        ("3 min^-1", 3 / 60),
        ("1e-3 mm/mm/s", 1e-3),
    ],
)
def test_times_follow_from_a_rate_of_strain(text: str, rate: float) -> None:
    strain = np.array([0.0, 0.2, 0.5, 0.1])
    found = Stated("f", {}, {"strain_rate": text}).times(strain)
    np.testing.assert_allclose(found, np.array([0.0, 0.2, 0.5, 0.9]) / rate, rtol=1e-9)


def test_stated_times_and_strains_of_a_test() -> None:
    nothing = Stated("f", {}, {})
    assert Stated("f", {"hold_strain": "50 %"}, {}).held_stretch() == pytest.approx(1.5)
    both = Stated("f", {"strain": "0.5"}, {"stretch": "1.2"})
    assert both.held_stretch() == pytest.approx(1.2)
    assert nothing.held_stretch() is None
    assert Stated("f", {"rise_time": "100 ms"}, {}).ramp() == pytest.approx(0.1)
    assert np.isnan(nothing.ramp())
    assert np.isnan(nothing.times(np.ones(2))).all()
    with pytest.raises(DataError):
        Stated("f", {}, {"strain": "-1.0"}).held_stretch()
    for ramp in ("-1 s", "fast"):
        with pytest.raises(DataError):
            Stated("f", {}, {"ramp": ramp}).ramp()
    for rate in ("0 1/s", "0.1", "fast 1/s"):
        with pytest.raises(DataError):
            Stated("f", {}, {"strain_rate": rate}).times(np.ones(2))


# --- states and artefacts -----------------------------------------------------------------


def test_factors_of_modes_and_of_shear_read_the_work_s_derivatives() -> None:
    stretch = np.array([1.5])
    for mode, ratio, directions in (
        ("uniaxial", -0.5, 1),
        ("equibiaxial", 1.0, 2),
        ("planar", 0.0, 1),
    ):
        e1, e2, c1, c2 = mode_factors(mode, stretch)
        np.testing.assert_allclose([e1[0], e2[0]], [np.log(1.5), ratio * np.log(1.5)])
        np.testing.assert_allclose([c1[0], c2[0]], [1 / directions, ratio / directions])
    shear = np.array([0.7])
    h, minus, one, other = shear_factors(shear)
    np.testing.assert_allclose(2 * np.sinh(h), shear)
    np.testing.assert_allclose(minus, -h)
    np.testing.assert_allclose([one, other], [0.5 / np.cosh(h), -0.5 / np.cosh(h)])
    assert [len(padded(np.ones(n))) for n in (1, 64, 65, 128, 129)] == [64, 64, 128, 128, 256]


def test_slack_ends_where_readings_begin_to_rise() -> None:
    x = np.linspace(0.0, 1.0, 101)
    y = np.maximum(x - 0.305, 0.0)
    assert idle(x, y, y.max()) == pytest.approx(0.31, abs=0.021)
    assert idle(x, x, 1.0) is None
    shuffled = RNG.permutation(101)
    assert idle(x[shuffled], y[shuffled], y.max()) == pytest.approx(0.31, abs=0.021)
    assert idle(x, np.maximum(x - 0.015, 0.0), 1.0) is None  # two hundredths of the way


def test_a_toe_ends_where_the_curve_is_steepest() -> None:
    stretch = np.linspace(0.0, 1.0, 400)
    y = np.where(stretch < 0.2, 2.5 * stretch**2, stretch - 0.1)
    y = np.where(stretch > 0.35, 0.25 + 0.7 * (stretch - 0.35), y)
    end = toe_end(np.log1p(stretch), y)
    assert end is not None
    assert 0.15 < np.expm1(end) < 0.4
    assert toe_end(np.log1p(stretch), 1 - np.exp(-2 * stretch)) is None
    assert toe_end(np.log1p(stretch), stretch**2) is None  # it never becomes less steep


def test_smoothing_keeps_a_law_and_drops_its_scatter() -> None:
    x = np.linspace(1.02, 2.5, 200)
    test = tension(x)
    np.testing.assert_allclose(smoothed(test, test.value), test.value, rtol=1e-6)
    noisy = test.value * (1 + 0.02 * RNG.normal(size=200))
    off = smoothed(test, noisy) / test.value - 1
    assert np.sqrt(np.mean(off**2)) < 0.008


def test_free_zeros_shift_stretch_and_force() -> None:
    """Y = P(measured - s - k (y - o)) + o; a slack specimen carries nothing."""
    one, nominal = jnp.ones(3), jnp.array([1e5, 2e5, 0.0])
    measured = jnp.array([1.5, 2.0, 1.01])
    test = FreeZero(
        measured,
        nominal,
        -0.5 * one,
        one,
        -0.5 * one,
        one,
        one,
        jnp.array([[0] * 3, [1] * 3, [2] * 3]),
        jnp.zeros(3),
    )
    zeros = np.array([0.02, 3e3, 1e-7])
    law = NeoHookean(jnp.asarray(MU))
    found = np.asarray(quick(FreeZero.predict)(test.shifted(jnp.asarray(zeros)), law))
    stretch = np.maximum(np.asarray(measured) - 0.02 - 1e-7 * (np.asarray(nominal) - 3e3), 1.0)
    np.testing.assert_allclose(found, neo_hookean(stretch) + 3e3, rtol=1e-9)


def test_zeros_in_the_units_of_the_test() -> None:
    sized = tension([1.0, 2.0], origin=Origin("strain", "e", "", length=0.05, area=2e-5))
    plain = tension([1.0, 2.0])
    for kind, value, expected, unit in (
        ("slack", 0.02, 1.0, "mm"),
        ("force", 1e4, 0.2, "N"),
        ("machine", 1e-8, 1e-3 * 2e-5 / (0.05 * 1e-8), "N/mm"),
    ):
        size, error, found = zero_in_units(kind, value, 0.1 * value, sized)
        assert found == unit
        np.testing.assert_allclose([size, error], [expected, 0.1 * expected], rtol=1e-12)
    assert zero_in_units("slack", 0.02, 0.01, plain) == (0.02, 0.01, "of the length")
    assert zero_in_units("force", 2e6, 1e6, plain) == (2.0, 1.0, "MPa")
    np.testing.assert_allclose(zero_in_units("machine", 1e-6, 1e-7, plain)[:2], [1.0, 0.1])


@pytest.mark.parametrize("squeezed", [False, True])
@pytest.mark.parametrize(
    ("mode", "slope", "stress"),
    [
        ("uniaxial", 3.0, lambda x: 2 * (x - x**-2) * (2e5 + 5e4 / x)),
        ("equibiaxial", 6.0, lambda x: 2 * (x - x**-5) * (2e5 + 5e4 * x**2)),
        ("pure_shear", 4.0, lambda x: 2 * (x - x**-3) * (2e5 + 5e4)),
    ],
)
def test_an_offset_at_rest_is_found_by_mooney_s_terms(
    mode: str, slope: float, stress: Any, squeezed: bool
) -> None:
    """Mooney-Rivlin rubber of 0.5 MPa, its stresses off by 20 kPa, away from rest positive."""
    stretch = np.linspace(1.0, 0.8 if squeezed else 1.4, 40)
    side = -1.0 if squeezed else 1.0
    noise = 1e2 * RNG.normal(size=40)
    for offset in (2e4, -2e4):
        value = stress(stretch) + side * offset + noise
        factors = mode_factors(PATHS[mode], stretch, "nominal")
        test = tension(stretch, value, mode=mode, factors=factors)
        found = {x.kind: x for x in curve_suspects(test)}
        assert found["force offset"].size == pytest.approx(side * offset / 1e6, rel=0.02)
        assert found["slack"].size == pytest.approx(-offset / (slope * 5e5), rel=0.02)
        slack = found["slack"].size
        told = f"at a strain of {slack:.3g}," if offset < 0 else f"stretched by {-slack:.3g} "
        assert told in found["slack"].evidence
        # A fifth of what is found is no scatter: five standard errors are certain.
        louder = tension(stretch, value + 5 * noise, mode=mode, factors=factors)
        assert "force offset" in {x.kind for x in curve_suspects(louder)}
        # Readings below zero are none of a specimen that hangs slack.
        assert next(iter(found)) == "force offset"
        if offset < 0:
            kept = test.select(value * side > 0)
            assert next(x.kind for x in curve_suspects(kept)) == "slack"


def test_strains_in_percent_are_found_by_their_size() -> None:
    long = tension(1.0 + np.array([0.1, 1.6]))
    assert _may_be_percent(long)
    assert not _may_be_percent(tension(1.0 + np.array([0.1, 1.4])))
    percent = {"origin": Origin("strain", "e", "%")}
    assert _may_be_percent(tension(1.0 + np.array([0.01, 0.05]), **percent))
    assert not _may_be_percent(tension(1.0 + np.array([0.01, 0.07]), **percent))
    moved = _in_percent(long)
    np.testing.assert_allclose(moved.coordinate, [1.001, 1.016], rtol=1e-12)
    np.testing.assert_allclose(moved.factors[2], 1 / moved.coordinate, rtol=1e-12)
    larger = _in_percent(tension(1.0 + np.array([0.01, 0.05]), **percent))
    np.testing.assert_allclose(larger.coordinate, [2.0, 6.0], rtol=1e-9)


# --- bulk modulus -------------------------------------------------------------------------


def compressed(value: Any, ratio: Any) -> VolumetricTest:
    found: VolumetricTest = tension(
        np.asarray(ratio), value, kind=VolumetricTest, mode="volumetric", measure="pressure"
    )
    return found


def test_bulk_modulus_is_the_weighted_mean_of_pressure_over_compression() -> None:
    ratio = np.linspace(0.97, 0.999, 30)
    pressure = 2e9 * (1 - ratio) * (1 + 0.002 * RNG.normal(size=30))
    found = fit_bulk_modulus([compressed(pressure, ratio)], "absolute")
    unit = 1 - ratio
    expected = unit @ pressure / (unit @ unit)
    assert found.value == pytest.approx(expected, rel=1e-9)
    rest = pressure - expected * unit
    if found.misfit.inflation == 1.0 and not found.noise.excluded:
        error = np.sqrt(rest @ rest / 29 / (unit @ unit))
        assert found.standard_error == pytest.approx(error, rel=1e-6)
    relative = fit_bulk_modulus([compressed(pressure, ratio)], "relative")
    assert relative.value == pytest.approx(np.mean(pressure / unit), rel=1e-6)
    low, high = found.interval(0.95)
    half = found.standard_error * stats.t.ppf(0.975, found.dof)
    np.testing.assert_allclose([low, high], [found.value - half, found.value + half])
    assert found.dof == 29
    np.testing.assert_allclose(found.predict(ratio), found.value * unit)


def test_poisson_s_ratio_and_the_remark_of_a_soft_bulk() -> None:
    none: Any = None
    one = BulkModulus((), 3e7, 1e5, np.inf, "noise", none, none, ())
    k, g = 3e7, 1.1e6
    assert one.poisson_ratio(g) == pytest.approx((3 * k - 2 * g) / (2 * (3 * k + g)), rel=1e-12)
    assert compressibility_remark(one, 1.0e6) == []
    (remark,) = compressibility_remark(one, 1.01e6)
    assert "29.7 shear moduli only" in remark
    low, high = one.interval(0.6827)
    np.testing.assert_allclose(high - low, 2e5 * stats.norm.ppf(0.84135), rtol=1e-9)
    assert dataclasses.replace(one, standard_error=1e9).interval(0.95)[0] == 0.0
    for dof in (0, 1):
        low, high = dataclasses.replace(one, standard_error=1e3, dof=dof).interval(0.95)
        assert (high - low) / 2e3 == pytest.approx(12.706, abs=5e-4)  # tables, one degree


def test_model_of_noise_in_words() -> None:
    models = {
        "relative": NoiseModel(0.0, 0.012, "relative", 20.0),
        "both": NoiseModel(2e4, 0.012, "both", 20.0),
    }
    for kind, text in (("relative", "1.2 % (relative)"), ("both", "1.2 % and 0.02 MPa (both)")):
        noise = Noise((models[kind],), np.ones(1), True)
        assert text in noise_remark([tension([1.0])], noise, "absolute")
