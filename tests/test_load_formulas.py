"""Formulas of load estimation against closed forms, on a skin that is one line of NumPy."""

import dataclasses
import itertools
from concurrent.futures import Future
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats
from scipy.optimize import least_squares

from fitting.arrays import Floats
from fitting.cli.invert_log import _verdict
from fitting.inverse_load.check import section_log
from fitting.inverse_load.fit import left_out
from fitting.inverse_load.fit.bounded_selection import BoundedSelection
from fitting.inverse_load.fit.covariance import covariance_of, inverse
from fitting.inverse_load.fit.detection import (
    ArcDetector,
    PadDetector,
    false_alarm_rate,
    without_errors,
)
from fitting.inverse_load.fit.doubts import (
    Doubts,
    FaultyTaxels,
    _least_trimmed,
    inliers,
)
from fitting.inverse_load.fit.explanation import (
    PLAUSIBLE,
    PRIOR_OF_TANGENT,
    Attempt,
    widened,
)
from fitting.inverse_load.fit.left_out import LeftOutOfContacts
from fitting.inverse_load.fit.loads_and_errors import SUSPECT, LoadsAndErrors, _best
from fitting.inverse_load.fit.lone_taxels import LoneTaxels
from fitting.inverse_load.fit.other_stiffness import beyond_first_order, less_told
from fitting.inverse_load.fit.section_errors import (
    SectionErrors,
    changed_skin,
    skin_tangents,
)
from fitting.inverse_load.fit.section_fitter import SectionFitter
from fitting.inverse_load.fit.section_least_squares import (
    Fit,
    Target,
    _last_step,
    _step,
)
from fitting.inverse_load.fit.selection import Selection
from fitting.inverse_load.fit.several_contacts import Pulls
from fitting.inverse_load.fit.systematic import (
    AbstractSystematicErrors,
    ErrorsOfFrames,
    of_shared_places,
)
from fitting.inverse_load.fit.tabulated_changes import TabulatedChanges, _filled, most_alike
from fitting.inverse_load.fit.wide_contact import WideContactFitter
from fitting.inverse_load.model.contact_parameters import SECTION, SECTION_WITH_DIRECTION
from fitting.inverse_load.model.evaluation import Evaluation, filled_up
from fitting.inverse_load.search import table as load_table
from fitting.inverse_load.search.base import _scaled
from fitting.inverse_load.search.section import NodeSearch
from fitting.inverse_load.search.table import LoadTable
from fitting.steps import Budget, Search, Steps, finished
from suas_jax.config import continuous_inputs, load_skin
from suas_jax.config.geometry import AlongSpec
from suas_jax.equilibrium.equilibrium import State
from suas_jax.scene.skin import skin_of
from tests import stand_ins
from tests.skins import quick
from tests.stand_ins import (
    AT_REST,
    TAXELS,
    DimpleFitter,
    DimpleNodes,
    dimple_readings,
    explanations,
)

SKINS = Path(__file__).parents[1] / "configs" / "skins"
RNG = np.random.default_rng(0)
SLOPES = RNG.normal(size=(2, 6))  # of six readings by two parameters
WEIGHT = np.array([1.0, 4.0, 0.25, 1.0, 2.0, 1.0])


# --- covariance and explanations ----------------------------------------------------------


def test_covariance_is_the_inverse_of_the_information_in_any_units() -> None:
    information = (SLOPES * WEIGHT) @ SLOPES.T
    for units in ((1.0, 1.0), (1e-9, 1e12)):
        scale = np.diag(units)
        found = inverse((scale @ information @ scale)[None])[0]
        expected = np.linalg.inv(information) / np.outer(units, units)
        np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_what_nothing_determines_has_no_bound_and_takes_nothing_from_the_rest() -> None:
    found = inverse(np.array([[[4.0, 0.0], [0.0, 0.0]], [[0.0, 0.0], [0.0, 9.0]]]))
    np.testing.assert_allclose(found[0], [[0.25, 0.0], [0.0, np.inf]], rtol=1e-9)
    np.testing.assert_allclose(found[1], [[np.inf, 0.0], [0.0, 1 / 9]], rtol=1e-9)


def test_covariances_of_one_and_two_contacts_fill_their_own_part() -> None:
    information = np.full((2, 4, 4), np.nan)
    information[0, :2, :2] = np.diag([4.0, 1.0])
    information[1] = np.diag([1.0, 2.0, 4.0, 5.0])
    best = explanations(np.zeros((2, 4)), contacts=[1, 2], information=information)
    found = covariance_of(best, 2)
    np.testing.assert_allclose(found[0, :2, :2], np.diag([0.25, 1.0]), rtol=1e-9)
    assert np.isnan(found[0, 2:]).all()
    np.testing.assert_allclose(found[1], np.diag([1.0, 0.5, 0.25, 0.2]), rtol=1e-9)


def test_p_value_is_that_of_chi_square_with_the_readings_in_use() -> None:
    weight = np.ones((3, 10))
    weight[:, :2] = 0.0
    best = explanations(
        np.zeros((3, 4)),
        contacts=[1, 2, 2],
        weight=weight,
        so=np.zeros((3, 10)),
        chi2=[7.0, 7.0, np.inf],
    )
    assert best.used().tolist() == [8, 8, 8]
    np.testing.assert_allclose(best.p_value(2), [*stats.chi2.sf(7.0, [6, 4]), 0.0], rtol=1e-12)
    few = explanations(np.zeros((1, 4)), so=np.zeros((1, 2)), chi2=3.0)  # no degree is left
    np.testing.assert_allclose(few.p_value(4), stats.chi2.sf(3.0, 1), rtol=1e-12)


def test_the_cheapest_of_several_candidates_of_a_frame_wins() -> None:
    now = explanations(np.zeros((3, 1)), chi2=[5.0, 5.0, 5.0])
    others = explanations([[1.0], [2.0], [3.0], [4.0]], chi2=[4.0, 3.0, 3.5, 6.0])
    best, changed = now.cheapest(np.array([2, 2, 2, 0]), others)
    assert changed.tolist() == [2]
    assert best.parameters[:, 0].tolist() == [0.0, 0.0, 2.0]
    assert best.score.tolist() == [5.0, 5.0, 3.0]
    # With a penalty of two it is not cheaper.
    same, changed = now.cheapest(np.array([2, 2, 2, 0]), others.penalised(2.0))
    assert not changed.size
    assert same is now
    assert now.penalised(2.0).score.tolist() == [7.0, 7.0, 7.0]
    assert now.penalised(2.0).chi2.tolist() == [5.0, 5.0, 5.0]


def test_explanations_are_joined_and_widened() -> None:
    one, two = explanations([[1.0]]), explanations([[2.0], [3.0]], chi2=[1.0, 2.0])
    both = one.joined(two)
    assert len(both) == 3
    assert both.parameters[:, 0].tolist() == [1.0, 2.0, 3.0]
    assert both.rows(np.array([2])).chi2.tolist() == [2.0]
    found = widened(np.ones((2, 1, 1, 3)), 2, 2)
    assert found.shape == (2, 2, 2, 3)
    assert np.isfinite(found[:, 0, 0]).all()
    assert np.isnan(found[:, 1]).all()


# --- detection ----------------------------------------------------------------------------


@pytest.mark.parametrize("z", [-1.0, 0.0, 2.5, 6.0])
def test_rate_of_false_alarms_is_that_of_the_tube_formula(z: float) -> None:
    length, area = 3.0, 2.0
    bounded = max(z, 0.0)
    expected = (length / (2 * np.pi) + area * bounded / (2 * np.pi) ** 1.5) * np.exp(
        -(bounded**2) / 2
    ) + stats.norm.sf(z)
    found = false_alarm_rate(np.array(z), np.array(length), np.array(area))
    assert found == pytest.approx(min(expected, 1.0), rel=1e-12)


def test_length_of_patterns_on_a_circle_is_their_angle_whatever_they_weigh() -> None:
    turn = np.linspace(0.0, 1.2, 9)
    patterns = np.stack([np.cos(turn), np.sin(turn)], 1)
    weight = np.array([4.0, 0.25])
    detector = ArcDetector(patterns / np.sqrt(weight) * np.linspace(1, 5, 9)[:, None])
    size = np.linspace(1, 5, 9)[None]
    length, area = detector.extent(weight[None], size)
    np.testing.assert_allclose(length, 1.2, rtol=1e-12)
    np.testing.assert_array_equal(area, 0.0)


def test_a_light_contact_has_the_significance_of_its_size() -> None:
    patterns = np.array([[3.0, 0.0], [0.0, 2.0]])
    detector = ArcDetector(patterns)
    weight = np.array([[4.0, 1.0], [4.0, 0.0]])
    found = detector.test(np.array([[0.5, 0.7], [-0.5, np.nan]]), weight)
    # sqrt(w) times the reading, along the better of both axes.
    np.testing.assert_allclose(found.statistic, [1.0, -1.0], rtol=1e-12)
    length = [np.pi / 2, np.pi / 2]
    np.testing.assert_allclose(
        found.p_value[0],
        false_alarm_rate(found.statistic, np.array(length), np.zeros(2))[0],
        rtol=1e-12,
    )


def test_threshold_is_where_the_rate_is_reached() -> None:
    turn = np.linspace(0.0, 1.5, 20)
    detector = ArcDetector(2.0 * np.stack([np.cos(turn), np.sin(turn)], 1))
    for rate in (1e-2, 1e-6):
        z = detector.threshold(rate)
        found = false_alarm_rate(np.array(z), np.array(1.5), np.array(0.0))
        assert float(found) == pytest.approx(rate, rel=1e-9)


def test_area_and_edge_of_patterns_on_a_sphere() -> None:
    """A patch of the unit sphere between two parallels: area and edge are known."""
    height, width = 0.3, 0.4
    up, round_ = np.linspace(-height / 2, height / 2, 31), np.linspace(0, width, 41)
    a, b = np.meshgrid(up, round_, indexing="ij")
    patterns = np.stack([np.cos(a) * np.cos(b), np.cos(a) * np.sin(b), np.sin(a)], -1)
    detector = PadDetector(3.0 * patterns.reshape(-1, 3), (31, 41))
    assert detector.channels == 3
    length, area = detector.extent(np.ones((1, 3)), np.full((1, 31 * 41), 3.0))
    np.testing.assert_allclose(area, 2 * width * np.sin(height / 2), rtol=1e-3)
    edge = 2 * height + 2 * width * np.cos(height / 2)
    np.testing.assert_allclose(length, edge / 2, rtol=1e-3)


ERRORS = np.array([[2.0, 0.0, 0.5], [0.0, 1.0, -0.3]])
THREE = np.array([[1.0, 4.0, 0.25]])


def test_what_errors_explain_is_taken_off_as_by_their_covariance() -> None:
    """W - R^T R is the inverse of the noise's covariance with the errors' S^T S added."""
    change = np.array([[0.3, -0.2, 1.0]])
    left, root = without_errors(change, THREE, ERRORS)
    whole = np.linalg.inv(np.diag(1 / THREE[0]) + ERRORS.T @ ERRORS)
    np.testing.assert_allclose(np.diag(THREE[0]) - root[0].T @ root[0], whole, rtol=1e-10)
    np.testing.assert_allclose(THREE[0] * left[0], whole @ change[0], rtol=1e-10)


def test_frames_of_equal_weights_are_tested_as_each_alone() -> None:
    random = np.random.default_rng(8)
    detector = PadDetector(random.normal(size=(4, 3)), (2, 2))
    change = random.normal(size=(5, 3)) * np.array([[0.5], [1.0], [2.0], [9.0], [99.0]])
    weight = np.repeat(THREE[:1], 5, 0)
    together = detector.test(change, weight, ERRORS)
    for k in range(5):
        alone = detector.test(change[k : k + 1], weight[k : k + 1], ERRORS)
        np.testing.assert_allclose(together.p_value[k], alone.p_value[0], rtol=1e-3)
    # What is beyond doubt is told as something above its rate, far below any that is asked for.
    assert together.statistic[-1] > 10
    assert together.p_value[-1] < 1e-18


def test_errors_are_fitted_beside_the_two_best_fits_of_a_frame() -> None:
    chi2 = np.array([9.0, 5.0, 1.0, 3.0, 2.0, 8.0, 4.0, 7.0])
    frame = np.array([0, 0, 1, 0, 1, 2, 0, 1])
    found, every = SimpleNamespace(chi2=chi2), np.arange(8)
    np.testing.assert_array_equal(_best(every, found, frame), [2, 3, 4, 5, 6])  # type: ignore[arg-type]
    np.testing.assert_array_equal(_best(every[:3], found, frame), [0, 1, 2])  # type: ignore[arg-type]
    assert _best(every[:0], found, frame).size == 0  # type: ignore[arg-type]
    np.testing.assert_array_equal(_best(every, found, None), every)  # type: ignore[arg-type]


@pytest.mark.parametrize("pad", [False, True])
def test_significance_with_errors_of_the_inputs(pad: bool) -> None:
    patterns = RNG.normal(size=(4, 3))
    detector = PadDetector(patterns, (2, 2)) if pad else ArcDetector(patterns)
    change = np.array([[0.3, -0.2, 1.0]])
    found = detector.test(change, THREE, ERRORS)
    whole = np.linalg.inv(np.diag(1 / THREE[0]) + ERRORS.T @ ERRORS)
    size = np.sqrt(np.einsum("pi,ij,pj->p", patterns, whole, patterns))
    expected = (patterns @ whole @ change[0] / size).max()
    # Pads' patterns, of hundreds of taxels, are of single precision.
    np.testing.assert_allclose(found.statistic, expected, rtol=1e-6 if pad else 1e-10)
    unit = (np.linalg.cholesky(whole).T @ (patterns / size[:, None]).T).T
    if pad:
        sides = [np.linalg.norm(unit[i] - unit[j]) for i, j in ((0, 1), (2, 3), (0, 2), (1, 3))]
        length, area = sum(sides) / 2, cell_area(unit)
    else:
        cosine = np.clip((unit[1:] * unit[:-1]).sum(1), -1, 1)
        length, area = float(np.arccos(cosine).sum()), 0.0
    rate = false_alarm_rate(np.array(expected), np.array(length), np.array(area))
    np.testing.assert_allclose(found.p_value, rate, rtol=1e-6 if pad else 1e-9)


def cell_area(unit: np.ndarray) -> float:
    """Mean area of the two ways to cut a cell of four patterns in triangles."""
    total = 0.0
    for i, j, k in itertools.combinations(range(4), 3):
        a, b = unit[j] - unit[i], unit[k] - unit[i]
        total += 0.5 * np.sqrt((a @ a) * (b @ b) - (a @ b) ** 2)
    return float(total / 2)


# --- systematic errors --------------------------------------------------------------------


class KnownErrors(AbstractSystematicErrors):
    """Errors whose slopes are given."""

    def __init__(self, slopes: np.ndarray, own: np.ndarray | None = None) -> None:
        self.names = tuple(f"e{k}" for k in range(len(slopes)))
        self.rest = np.zeros_like(slopes)
        self._slopes, self._own = slopes, own

    def slopes(self, best: Any, per_contact: int, contacts: int) -> np.ndarray:
        """The same in all frames."""
        return np.repeat(self._slopes[None], len(best), 0)

    def unexplained(self, best: Any, per_contact: int) -> np.ndarray | None:
        """As given."""
        return self._own


def test_an_error_that_all_places_share_moves_them_alike() -> None:
    """Of two contacts the distance stays as it is, and their middle has its deviation."""
    best: Any = SimpleNamespace(
        contacts=np.array([1, 2]), information=np.zeros((2, 4, 4)), parameters=np.ones((2, 4))
    )
    one, two = of_shared_places(
        best, 2, lambda angle: np.full((*angle.shape, angle.shape[1]), 0.04)
    )
    np.testing.assert_array_equal(one[:2, :2], [[0.04, 0.0], [0.0, 0.0]])
    assert np.isnan(one[2:]).all()
    apart, middle = np.array([1.0, -1, 0, 0]), np.array([0.5, 0.5, 0, 0])
    assert apart @ two @ apart == 0.0
    assert middle @ two @ middle == pytest.approx(0.04)
    assert not two[2:].any()


ERROR_SLOPES = RNG.normal(size=(2, 6))
RESIDUAL = RNG.normal(size=6)


def test_errors_of_a_frame_are_those_of_least_squares_with_the_loads() -> None:
    """Loads and errors fitted at once, each error weighed by its own deviation of one."""
    best = explanations([[0.1, 3.0]], so=np.zeros((1, 6)), jacobian=[SLOPES], weight=WEIGHT)
    found = KnownErrors(ERROR_SLOPES).of(best, RESIDUAL[None], 2)
    both = np.vstack([SLOPES, ERROR_SLOPES])
    information = (both * WEIGHT) @ both.T
    whole = np.linalg.inv(information + np.diag([0.0, 0.0, 1.0, 1.0]))
    x = whole @ (both * WEIGHT) @ RESIDUAL
    np.testing.assert_allclose(found.likely[0], x[2:], rtol=1e-9)
    np.testing.assert_allclose(found.spread[0], whole[2:, 2:], rtol=1e-9)
    loads = np.linalg.solve(information[:2, :2], (SLOPES * WEIGHT) @ RESIDUAL)
    np.testing.assert_allclose(loads - found.gain[0] @ found.likely[0], x[:2], rtol=1e-8)
    left = RESIDUAL - loads @ SLOPES
    rest = RESIDUAL - x @ both
    decrease = WEIGHT @ left**2 - WEIGHT @ rest**2 - (x[2:] ** 2).sum()
    np.testing.assert_allclose(found.decrease, decrease, rtol=1e-7)
    pull = (ERROR_SLOPES - found.gain[0].T @ SLOPES) * WEIGHT @ RESIDUAL
    np.testing.assert_allclose(found.pull[0], pull, rtol=1e-9)


def test_errors_are_those_of_least_squares_with_what_was_eliminated_under_a_prior() -> None:
    """An extent that a prior holds was fitted along; the second error is a stiffness."""
    other, prior = RNG.normal(size=6), 4.0
    errors = np.stack([ERROR_SLOPES[0], 0.1 * 3.0 * SLOPES[1]])
    own = WEIGHT @ other**2 + prior
    share = (SLOPES * WEIGHT) @ other / own
    information = (SLOPES * WEIGHT) @ SLOPES.T - own * np.outer(share, share)
    fitted = np.vstack([SLOPES, other])
    whole = (fitted * WEIGHT) @ fitted.T + np.diag([0.0, 0.0, prior])
    rest = RESIDUAL - np.linalg.solve(whole, (fitted * WEIGHT) @ RESIDUAL) @ fitted
    best = explanations(
        [[0.1, 3.0]],
        so=np.zeros((1, 6)),
        jacobian=[SLOPES - np.outer(share, other)],
        weight=WEIGHT,
        information=information[None],
        eliminated=(other / np.sqrt(own))[None, None],
        held=SLOPES[None],
    )
    found = KnownErrors(errors).of(best, rest[None], 2)
    every = np.vstack([fitted, errors])
    joint = np.linalg.inv((every * WEIGHT) @ every.T + np.diag([0.0, 0.0, prior, 1.0, 1.0]))
    x = joint @ (every * WEIGHT) @ RESIDUAL
    np.testing.assert_allclose(found.spread[0], joint[3:, 3:], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found.likely[0], x[3:], rtol=1e-9, atol=1e-12)
    covariance = np.linalg.inv(information) + found.gain[0] @ found.spread[0] @ found.gain[0].T
    np.testing.assert_allclose(covariance, joint[:2, :2], rtol=1e-9)
    # A stiffness is a share of the force, and shows in nothing else.
    np.testing.assert_allclose(found.gain[0, :, 1], [0.0, 0.3], atol=1e-12)
    np.testing.assert_allclose(found.spread[0, 1], [0.0, 1.0], atol=1e-12)


@pytest.mark.parametrize("absorbed", [False, True])
def test_covariance_by_errors_is_their_spread_and_shift_carried_to_the_loads(
    absorbed: bool,
) -> None:
    best = explanations(
        [[0.1, 3.0]],
        so=np.zeros((1, 6)),
        jacobian=[SLOPES],
        weight=WEIGHT,
        shift=np.full((1, 6), float(absorbed)),
    )
    errors = KnownErrors(ERROR_SLOPES)
    told = errors.of(best, RESIDUAL[None], 2)
    second = told.spread[0]
    if not absorbed:
        second = second + np.outer(told.likely[0], told.likely[0])
    expected = told.gain[0] @ second @ told.gain[0].T
    found = errors.covariance(best, RESIDUAL[None], 2)
    np.testing.assert_allclose(found[0], expected, rtol=1e-10)
    own = np.diag([3.0, 5.0])[None]
    more = KnownErrors(ERROR_SLOPES, own).covariance(best, RESIDUAL[None], 2)
    np.testing.assert_allclose(more[0], expected + own[0], rtol=1e-10)


def test_many_frames_of_several_numbers_of_contacts_keep_their_places() -> None:
    contacts = np.where(np.arange(200) % 3 == 0, 2, 1)
    wide = RNG.normal(size=(200, 4, 6))
    wide[contacts == 1, 2:] = np.nan
    information = np.full((200, 4, 4), np.nan)
    for k, count in enumerate(contacts):
        own = wide[k, : 2 * count]
        information[k, : 2 * count, : 2 * count] = (own * WEIGHT) @ own.T
    best = explanations(
        np.zeros((200, 4)),
        contacts=contacts,
        so=np.zeros((200, 6)),
        jacobian=wide,
        weight=np.tile(WEIGHT, (200, 1)),
        information=information,
    )
    y = RNG.normal(size=(200, 6))
    errors = KnownErrors(ERROR_SLOPES)
    found = errors.covariance(best, y, 2)
    for k in (0, 1, 130, 199):
        one = np.array([k])
        alone = errors.covariance(best.rows(one), y[one], 2)[0]
        np.testing.assert_allclose(found[k], alone, rtol=1e-9)
        width = 2 * contacts[k]
        assert np.isfinite(found[k, :width, :width]).all()
        assert np.isnan(found[k, width:]).all()


def test_loads_and_errors_end_where_fitted_at_once() -> None:
    """Where errors explain what loads don't: the smallest chi2 plus squares of the errors."""
    errors = KnownErrors(np.array([3.0 * np.cos(9 * TAXELS), 2.0 * np.sin(11 * TAXELS)]))
    truth, most_likely = np.array([0.12, 9.0]), np.array([2.0, -1.5])
    y = dimple_readings(truth) + most_likely @ errors._slopes
    weight = np.full((1, 13), 25.0)
    fitter = DimpleFitter()
    plain = fitter.fit(y, weight, truth[None], None, 1)
    found = finished(
        LoadsAndErrors(fitter, errors).fit(Attempt(y, weight, truth[None], None, 1))
    )  # type: ignore[arg-type]
    assert plain.chi2[0] > 100.0
    assert found.absorbed[0]
    assert not plain.absorbed[0]

    def cost(x: np.ndarray) -> np.ndarray:
        model = dimple_readings(x[:2])[0] + x[2:] @ errors._slopes
        return np.append(5.0 * (model - y[0]), x[2:])

    whole = least_squares(cost, np.append(truth, 0 * most_likely))
    assert found.chi2[0] == pytest.approx(2 * whole.cost, rel=0.02)
    np.testing.assert_allclose(found.parameters[0, :2], whole.x[:2], rtol=1e-2)
    np.testing.assert_allclose(
        found.so[0], dimple_readings(whole.x[:2])[0] + whole.x[2:] @ errors._slopes, atol=0.3
    )
    # What noise explains is left alone, and so is what errors don't explain.
    fits = fitter.fits
    own = dimple_readings(truth)
    good = finished(
        LoadsAndErrors(fitter, errors).fit(Attempt(own, weight, truth[None], None, 1))
    )  # type: ignore[arg-type]
    assert not good.absorbed[0]
    assert fitter.fits == fits + 1
    other = dimple_readings(truth) + 20.0 * (np.arange(13) == 3)
    bad = finished(
        LoadsAndErrors(fitter, errors).fit(Attempt(other, weight, truth[None], None, 1))
    )  # type: ignore[arg-type]
    assert not bad.absorbed[0]


# --- faulty taxels and doubts -------------------------------------------------------------


def test_taxels_beyond_four_and_a_half_deviations_stand_out() -> None:
    weight = np.array([[4.0, 4.0, 4.0, 0.0, 4.0]])
    so = np.array([[2.2, 2.3, -2.24, 0.0, np.nan]])
    kept = inliers(np.zeros((1, 5)), weight, so)
    assert kept.tolist() == [[4.0, 0.0, 4.0, 0.0, 0.0]]


def test_least_trimmed_squares_finds_the_node_behind_an_outlier() -> None:
    nodes = DimpleNodes()
    node = 3 * 8 + 1
    y = nodes.readings[[node, node]].copy()
    y[0, 6] += 5000.0
    y[1, [2, 6]] += 3000.0
    weight = np.ones((2, 13))
    weight[1, 0] = 0.0
    found, trimmed = _least_trimmed(nodes, y, weight, np.array([1.0, 2.0]))
    assert found.tolist() == [node, node]
    assert np.flatnonzero(trimmed[0] == 0).tolist() == [6]
    assert np.flatnonzero(trimmed[1] == 0).tolist() == [0, 2, 6]
    assert weight.sum() == 25.0  # the caller's own are left alone


def test_a_faulty_taxel_is_left_out_for_its_price() -> None:
    nodes, fitter = DimpleNodes(), DimpleFitter()

    def fit(asked: Attempt) -> Any:
        found = yield from fitter.steps(asked)
        return found.penalised(12.0 * (asked.contacts - 1))

    faulty = FaultyTaxels(nodes, fit, 2, 2)
    truth = np.array([[0.1, 8.0], [-0.2, 6.0]])
    y = dimple_readings(truth)
    y[0, 4] += 100.0
    weight = np.ones((2, 13))
    best = fitter.fit(y, weight, truth, None, 1)
    before = best.score.copy()
    found = finished(faulty.explained_without(y, weight, np.array([0]), best))
    np.testing.assert_allclose(found.parameters[0, :2], truth[0], rtol=1e-4)
    assert np.flatnonzero(found.weight[0] == 0).tolist() == [4]
    assert found.score[0] == pytest.approx(4.5**2, abs=1e-3)
    assert found.score[1] == before[1]
    # Three of thirteen taxels are more than a fifth.
    y[0, [2, 9]] += 300.0
    best = fitter.fit(y, weight, truth, None, 1)
    found = finished(faulty.explained_without(y, weight, np.array([0]), best))
    assert (found.weight[0] > 0).all()


def test_a_hint_is_a_penalty_in_the_residuals() -> None:
    nodes = DimpleNodes()
    doubts = Doubts(DimpleFitter(), nodes, penalty=20.0, most_contacts=2)
    pattern = nodes.signatures[10]
    weight = np.full(13, 2.0)
    unit = pattern / np.sqrt(weight @ pattern**2)
    so = dimple_readings([0.0, 5.0])
    for gain, hinted in ((19.9, False), (20.1, True)):
        best = explanations([[0.0, 5.0]], so=so, weight=weight)
        y = so + np.sqrt(gain) * unit
        assert doubts.hinted(y, best).tolist() == [hinted]
        assert doubts.hinted(so - 5 * np.sqrt(gain) * unit, best).tolist() == [False]
        # A taxel that is left out says nothing.
        out = dataclasses.replace(best, weight=np.zeros((1, 13)))
        assert doubts.hinted(y, out).tolist() == [False]
    one = Doubts(DimpleFitter(), nodes, penalty=20.0, most_contacts=1)
    assert one.hinted(so + 9 * unit, best).tolist() == [False]


def test_what_one_more_contact_takes_off_chi2_is_that_of_a_fit_of_all_together() -> None:
    """Of a linear model: told parameters, one that was eliminated, and the new force."""
    nodes = DimpleNodes()
    slopes, weight = RNG.normal(size=(3, 13)), RNG.uniform(0.5, 2.0, 13)
    root, so = np.sqrt(weight), RNG.normal(size=13)
    y = so + 3 * RNG.normal(size=13)

    def fitted(rows: np.ndarray) -> tuple[np.ndarray, float]:
        x, chi2 = np.linalg.lstsq((root * rows).T, root * (y - so))[:2]
        return so + x @ rows, float(chi2[0])

    there, least = fitted(slopes)
    own = weight @ slopes[2] ** 2
    share = (slopes[:2] * weight) @ slopes[2] / own
    best = explanations(
        [[0.0, 5.0]],
        so=there,
        weight=weight,
        jacobian=[slopes[:2] - np.outer(share, slopes[2])],
        eliminated=(slopes[2] / np.sqrt(own))[None, None],
    )
    gain = Doubts(DimpleFitter(), nodes, 20.0, 2).of_one_more(y[None], best)[0]
    for place, pattern in enumerate(nodes.signatures):
        residual = weight * (y - there)
        less = least - fitted(np.vstack([slopes, pattern]))[1]
        expected = less if pattern @ residual > 0 else 0.0
        assert gain[place] == pytest.approx(expected, rel=1e-4, abs=1e-6)


def test_doubts_of_a_recording_come_at_once_and_those_of_a_stream_twice() -> None:
    nodes = DimpleNodes()
    so = dimple_readings([0.0, 5.0])

    def frame(chi2: float, hint: int | None = None) -> tuple[Any, Any]:
        pattern = 0 * AT_REST if hint is None else nodes.signatures[hint]
        unit = pattern / max(np.sqrt(pattern @ pattern), 1e-300)
        return so + 4.5 * unit, explanations([[0.0, 5.0]], so=so, chi2=chi2)

    good, poor, awful = (stats.chi2.isf(p, 11) for p in (0.5, 1.5e-3, 1e-5))
    recording = Doubts(DimpleFitter(), nodes, 20.0, 2)
    for chi2, hint, doubted in ((good, None, 0), (poor, None, 1), (good, 4, 1)):
        assert recording.of(*frame(chi2, hint)).tolist() == [bool(doubted)]
    stream = Doubts(DimpleFitter(live=True), nodes, 20.0, 2)
    told = [
        bool(stream.of(*frame(*which))[0])
        for which in (
            (poor, None),  # the first
            (poor, None),  # the second
            (good, 4),  # a hint
            (good, 4),  # the same place
            (good, 14),  # another place
            (good, 15),  # next to it
            (awful, None),
        )
    ]
    assert told == [False, True, False, True, False, True, True]
    assert not stream.of(*frame(good, 4))[0]
    stream.forget()
    assert not stream.of(*frame(good, 4))[0]


# --- selection ----------------------------------------------------------------------------


def selected(loads: Any, noise: float = 0.0, *, live: bool = False, **options: Any) -> Any:
    """Selection, readings and weights of frames with such loads [frame, 2 k]."""
    x = np.atleast_2d(np.asarray(loads, float))
    y = dimple_readings(x, x.shape[1] // 2)
    y = y + noise * np.random.default_rng(1).normal(size=y.shape)
    settings = {"penalty": 20.0, "most_contacts": 2, **options}
    return (
        Selection(DimpleFitter(live=live), DimpleNodes(), **settings),
        y,
        np.ones_like(y),
    )


def test_one_contact_is_found_and_nothing_is_added_to_it() -> None:
    selection, y, weight = selected([[0.07, 6.0], [-0.31, 12.0]], 1.0)
    best, others = selection.explain(y, weight)
    assert best.contacts.tolist() == [1, 1]
    np.testing.assert_allclose(best.parameters[:, :2], [[0.07, 6], [-0.31, 12]], rtol=0.1)
    assert others == [None, None]


def test_two_contacts_are_told_apart_and_cost_the_penalty() -> None:
    selection, y, weight = selected([[-0.25, 0.3, 8.0, 5.0]])
    best, _ = selection.explain(y, weight)
    assert best.contacts.tolist() == [2]
    np.testing.assert_allclose(np.sort(best.parameters[0, :2]), [-0.25, 0.3], atol=1e-3)
    assert best.chi2[0] < 0.1
    assert best.score[0] - best.chi2[0] == pytest.approx(20.0)


class MisledFitter(DimpleFitter):
    """Fits one start a frame; the first pair ends where one of its forces is not told."""

    misled = False

    def screened(self, frames: Any, *_: Any) -> Any:
        """The first start of every frame."""
        yield "screening"
        return np.unique(frames, return_index=True)[1]

    def steps(self, asked: Attempt) -> Any:
        """Fit frames, and spoil the first pair."""
        found = yield from super().steps(asked)
        if asked.contacts == 2 and not self.misled:
            self.misled = True
            found.parameters[:, 3] = 0.0
        return found


def test_where_the_best_start_leads_nowhere_another_is_followed() -> None:
    selection, y, weight = selected([[-0.25, 0.3, 8.0, 5.0]])
    selection.fitter = MisledFitter()
    selection.__post_init__()
    best, _ = selection.explain(y, weight)
    assert selection.fitter.misled
    assert best.contacts.tolist() == [2]
    np.testing.assert_allclose(np.sort(best.parameters[0, :2]), [-0.25, 0.3], atol=1e-3)


class FilmFitter(DimpleFitter):
    """The same over a film of 1 mm, which a contact of 20 N closes."""

    little_gap = 5e-5

    def steps(self, asked: Attempt) -> Any:
        """Fit frames, and tell their gaps."""
        found = yield from super().steps(asked)
        force = np.nanmax(found.parameters[:, asked.contacts : 2 * asked.contacts], 1)
        return dataclasses.replace(found, min_gap=1e-3 * (1 - force / 20))


def test_what_is_left_out_near_the_wall_may_be_the_wall_itself() -> None:
    """A membrane that lies on the wall beside a taxel reads as that taxel alone were wrong."""
    selection, y, weight = selected([[0.05, 19.5], [0.05, 12.0], [0.05, 19.5]])
    selection.fitter = FilmFitter()
    selection.__post_init__()
    y[:2, 7] += 150.0  # that is 0.05 rad from the contacts
    best, _ = selection.explain(y, weight)
    assert (best.weight[:, 7] > 0).tolist() == [False, False, True]
    np.testing.assert_allclose(best.parameters[:, 1], [19.5, 12.0, 19.5], rtol=1e-3)
    np.testing.assert_allclose(best.min_gap, [0.0, 4e-4, 2.5e-5], rtol=1e-2)


@pytest.mark.parametrize("alone", [True, False])
def test_frames_in_doubt_are_fitted_alone_or_together_with_one_result(alone: bool) -> None:
    """Time beyond one contact is that of the frames that took it."""
    loads = [[-0.25, 0.3, 8.0, 5.0], [0.1, 0.1, 4.0, 0.0], [-0.4, 0.2, 5.0, 7.0]]
    selection, y, weight = selected(loads)
    selection.fitter.alone = alone
    best, _ = selection.explain(y, weight)
    assert best.contacts.tolist() == [2, 1, 2]
    places = np.sort(best.parameters[[0, 2], :2], 1)
    np.testing.assert_allclose(places, [[-0.25, 0.3], [-0.4, 0.2]], atol=1e-3)
    assert (selection.seconds > 0).tolist() == [True, False, True]
    assert (selection.seconds[0] == selection.seconds[2]) != alone


def test_of_many_frames_that_no_loads_explain_some_are_reconsidered() -> None:
    """A wrong model is wrong in every frame; two contacts in all of them are found in all."""
    selection, y, weight = selected(np.tile([[0.1, 6.0]], (70, 1)), most_contacts=1)
    best, _ = selection.explain(y + 20.0 * (-1.0) ** np.arange(len(TAXELS)), weight)
    assert (best.contacts == 1).all()
    np.testing.assert_allclose(best.chi2, best.chi2[0], rtol=1e-6)
    assert (selection.seconds > 0).sum() == 32
    selection, y, weight = selected(np.tile([[-0.25, 0.3, 8.0, 5.0]], (70, 1)))
    best, _ = selection.explain(y, weight)
    assert (best.contacts == 2).all()
    assert (selection.seconds > 0).all()


class Wide(DimpleFitter):
    """Explains every frame by one wide contact, with a step that would still lower chi2."""

    def __init__(self, decrease: float) -> None:
        super().__init__()
        self._decrease = decrease

    def steps(self, asked: Attempt) -> Any:
        """What one contact leaves is put down to its width."""
        found = yield from super().steps(asked)
        none = np.zeros(len(found))
        beside = found.beside.copy()
        beside[:, 0, 0] = 0.01, 1e-3
        return dataclasses.replace(
            found,
            score=none,
            chi2=none,
            beside=beside,
            predicted_decrease=none + self._decrease,
        )


@pytest.mark.parametrize(("decrease", "contacts"), [(0.09, 1), (0.11, 2)])
def test_a_width_that_has_not_settled_leaves_a_frame_to_two_contacts(
    decrease: float, contacts: int
) -> None:
    selection, y, weight = selected([[-0.25, 0.3, 8.0, 6.0]], wide_fitter=Wide(decrease))
    selection.doubts.of_one_more = lambda y, best: np.zeros((len(y), 1))  # type: ignore[method-assign]
    best, _ = selection.explain(y, weight)
    assert best.contacts.tolist() == [contacts]
    assert (best.predicted_decrease <= 0.1).all()


def free_of(parameters: list[float], slopes: Floats) -> tuple[WideContactFitter, Attempt]:
    """A fitter of a linear skin [parameter, taxel], and a frame of it without noise."""
    prior = np.diag([0, 0, 0, PRIOR_OF_TANGENT**-2])

    class Linear(WideContactFitter):
        def _batches(self, asked: Attempt, steps: int) -> Fit:
            del steps
            x, held = asked.start[0].copy(), self._bounds[:, 0] == self._bounds[:, 1]
            rows = np.flatnonzero(~held)
            information = slopes @ (asked.weight[0][:, None] * slopes.T) + prior
            pull = slopes @ (asked.weight[0] * (asked.y[0] - x @ slopes)) - prior @ x
            x[rows] += np.linalg.solve(information[np.ix_(rows, rows)], pull[rows])
            x = np.clip(x, *self._bounds.T)
            left = asked.y[0] - x @ slopes
            chi2 = np.array([asked.weight[0] @ left**2 + x @ prior @ x])
            none = np.zeros(1)
            state = State(np.zeros((1, 1, 1)), none, none)
            lane = (x @ slopes)[:, None], slopes[..., None], none, none + 1, state, none
            evaluation = Evaluation(*lane)  # type: ignore[arg-type]
            return Fit(
                x[:, None], evaluation, chi2, pull[:, None], information[..., None], none
            )

    fitter = object.__new__(Linear)
    fitter.live, fitter.parameters, fitter.edge = False, SECTION, np.array([1.0])
    fitter._width, fitter._radius, fitter._free = 2, 0.05, []
    fitter._all = np.array([[-1.0, 1.0], [0.0, 90.0], [1e-6, 3.6e-3], [-1.7, 1.7]])
    start, y = np.array([parameters[:2]]), np.array([parameters]) @ slopes
    return fitter, Attempt(y, np.full(y.shape, 0.25), start, State(*np.zeros((3, 1))), 1)


@pytest.mark.parametrize(("tangent", "square"), [(0.2, 1e-6), (-0.1, 1e-6), (0.0, 4e-4)])
def test_what_a_radial_line_leaves_is_a_width_or_a_tangential_force(
    tangent: float, square: float
) -> None:
    """Marginalised, each, as the inverse of the whole information has it."""
    slopes = RNG.normal(size=(4, 20)) * np.array([[500.0], [20.0], [1e5], [300.0]])
    fitter, asked = free_of([0.3, 8.0, square, tangent], slopes)
    found = finished(fitter.steps(asked))
    turned = bool(fitter.turned(found)[0])
    assert turned is (tangent != 0)
    row = 3 if turned else 2
    rows, weighted = [0, 1, row], slopes * 0.25 @ slopes.T
    weighted[3, 3] += PRIOR_OF_TANGENT**-2
    whole = np.linalg.inv(weighted[np.ix_(rows, rows)])
    np.testing.assert_allclose(np.linalg.inv(found.information[0]), whole[:2, :2], rtol=1e-6)
    taken = slopes[row] ** 2 / weighted[row, row]
    np.testing.assert_allclose(found.eliminated[0, 0] ** 2, taken, rtol=1e-6)
    value, deviation = found.beside[0, 0, 2 if turned else 0]
    if turned:
        by = np.array([0.0, tangent, 8.0])
        assert value == pytest.approx(8 * tangent, rel=0.02)
        assert deviation == pytest.approx(np.sqrt(by @ whole @ by), rel=0.02)
    else:
        assert value == pytest.approx(0.02, rel=1e-6)
        assert deviation == pytest.approx(np.sqrt(whole[2, 2]) / 0.04, rel=1e-6)


def test_fits_of_two_frames_may_take_turns() -> None:
    """A search that waits for time is gone on with after a later frame's."""
    slopes = RNG.normal(size=(4, 20)) * np.array([[500.0], [20.0], [1e5], [300.0]])
    fitter, asked = free_of([0.3, 8.0, 1e-6, 0.2], slopes)
    alone = finished(fitter.freed(asked, [3]))
    waits = fitter.freed(asked, [3])
    next(waits)
    finished(fitter.freed(asked, [2]))
    found = finished(waits)
    np.testing.assert_array_equal(found.beside, alone.beside)
    np.testing.assert_array_equal(found.information, alone.information)


def test_three_contacts_are_found_by_adding_one() -> None:
    selection, y, weight = selected([[-0.4, 0.0, 0.4, 8.0, 5.0, 6.0]], most_contacts=3)
    best, _ = selection.explain(y, weight)
    assert best.contacts.tolist() == [3]
    np.testing.assert_allclose(np.sort(best.parameters[0, :3]), [-0.4, 0.0, 0.4], atol=1e-3)
    assert best.score[0] - best.chi2[0] == pytest.approx(40.0)


def test_significance_of_a_contact_is_what_chi2_rises_by_without_it() -> None:
    """Of a model that is linear in all angles and forces."""
    slopes, x = RNG.normal(size=(4, 6)), np.array([0.1, -0.2, 3.0, 0.7])
    y = x @ slopes + RNG.normal(size=6)
    root, rows = np.sqrt(WEIGHT), [0, 1, 2]
    best, least = np.linalg.lstsq((root * slopes).T, root * y)[:2]
    without = np.linalg.lstsq((root * slopes[rows]).T, root * y)[1]
    two = explanations(best, contacts=2, jacobian=[slopes], weight=WEIGHT)
    found = selected([[0.0, 1.0]])[0].several.significance(two)
    np.testing.assert_allclose(found[0, 1], (without - least)[0], rtol=1e-9)


@pytest.mark.parametrize(("steepness", "place"), [(0.13, 0.0), (0.135, 0.1)])
def test_what_a_wrong_model_leaves_is_no_contact_that_readings_do_not_determine(
    steepness: float, place: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A device whose dimples are wider, and taxels that end beside the contact.

    Two contacts side by side take off more than their penalty, and how the force is shared
    between them nothing tells.
    """
    selection, _, weight = selected([[place, 6.0]])
    weight[:, TAXELS > 0.25] = 0.0
    monkeypatch.setattr(stand_ins, "STEEPNESS", steepness)
    y = dimple_readings([[place, 6.0]])
    monkeypatch.undo()
    start = np.array([[place - 0.05, place + 0.05, 3.0, 3.0]])
    two = finished(selection._loads.fit(Attempt(y, weight, start, None, 2)))
    best, _ = selection.explain(y, weight)
    assert best.chi2[0] > two.chi2[0] + selection.penalty
    assert best.contacts.tolist() == [1]
    np.testing.assert_allclose(best.parameters[0, :2], [place, 6.0], atol=0.35)


def test_what_errors_of_the_inputs_explain_is_no_contact_even_where_a_fit_is_not_poor() -> None:
    """An error that does what a light contact does: chi2 24 of 11, and a hint."""
    both = dimple_readings([[0.1, -0.3, 6.0, 0.5]], 2) - dimple_readings([[0.1, 6.0]])
    moved = both * np.sqrt(24.0 / (both**2).sum())
    for errors, contacts in ((None, 2), (KnownErrors(moved / 1.5), 1)):
        selection, y, weight = selected([[0.1, 6.0]], errors=errors)
        best, _ = selection.explain(y + moved, weight)
        assert best.contacts.tolist() == [contacts]
        assert best.absorbed.tolist() == [errors is not None]
    np.testing.assert_allclose(best.parameters[0, :2], [0.1, 6.0], rtol=1e-2)


def test_a_light_contact_is_found_beside_errors_of_the_inputs() -> None:
    """Errors are fitted with one contact, and so with two: else the light one counts less."""
    errors = KnownErrors(2.0 * np.array([np.cos(9 * TAXELS), np.sin(11 * TAXELS)]))
    truth = [[-0.25, 0.3, 8.0, 0.7]]
    selection, y, weight = selected(truth, errors=errors)
    best, _ = selection.explain(y + [2.0, -2.0] @ errors._slopes, weight)
    assert best.contacts.tolist() == [2]
    assert best.absorbed[0]
    order = np.argsort(best.parameters[0, :2])
    found = best.parameters[0, :4].reshape(2, 2)[:, order]
    np.testing.assert_allclose(found, np.reshape(truth, (2, 2)), rtol=0.15)


def test_a_fit_with_a_contact_too_much_leads_to_the_others() -> None:
    selection, y, weight = selected([[-0.25, 8.0]])
    start = np.array([[0.3, -0.25, 0.3, 8.0]])
    two = finished(selection.several.fit(Attempt(y, weight, start, None, 2)))
    assert two.score.tolist() == [np.inf]
    # Fewer are tried where the fit's chi2 and its penalty together are below the best score.
    for price, contacts in ((0.9, 2), (1.1, 1)):
        score = two.chi2 + price * selection.penalty
        lost = dataclasses.replace(two, chi2=score, score=score)
        asked = y, weight, np.zeros(1, int), two, lost
        found = finished(selection.several.without_weakest(*asked))
        assert found.contacts.tolist() == [contacts]
    np.testing.assert_allclose(found.parameters[0, :2], [-0.25, 8.0], rtol=1e-3)


def test_a_pull_begins_where_it_explains_most() -> None:
    def as_asked(asked: Attempt) -> Steps[Any]:
        yield from ()
        return asked

    score = np.array([[-9.0, 2.0, 3.0]]), np.array([[1.0, 1.0, 4.0]])
    nodes = SimpleNamespace(
        places=np.array([[-0.3], [0.1], [0.5]]),
        rest=np.zeros(4),
        rest_states=lambda count: None,
        score=lambda change, weight: score,
    )
    pulls = Pulls(SimpleNamespace(fit=as_asked), nodes, 20.0, 2)  # type: ignore[arg-type]
    asked: Any = finished(pulls.fit(np.zeros((1, 4)), np.ones((1, 4))))
    assert asked.start.tolist() == [[0.1, -2.0]]
    assert asked.pull


def test_a_pull_is_one_force_outwards_where_pushes_explain_nothing() -> None:
    selection, y, weight = selected([[0.1, -6.0]])
    found = selection.pulled(y, weight)
    np.testing.assert_allclose(found.parameters[0, :2], [0.1, -6.0], rtol=1e-3)
    best, _ = selection.explain(y, weight)
    assert best.parameters[0, 1] == pytest.approx(-6.0, rel=1e-3)
    assert best.score[0] == pytest.approx(20.0, abs=0.1)  # the price of two contacts


def test_a_light_pull_is_tried_where_a_push_is_not_suspect() -> None:
    """It explains what a push nearly does, and it is a second mode where it does so as well."""
    selection, y, weight = selected([[0.1, -6.0]])
    truth = selection.pulled(y, weight)
    for worse, pull, other in ((24.0, True, False), (16.0, False, True), (-3.0, False, True)):
        chi2 = np.array([truth.chi2[0] + worse])
        push = selection.fitter.fit(y, weight, np.array([[0.1, 6.0]]), None, 1)
        push = dataclasses.replace(push, chi2=chi2, score=chi2.copy())
        others: list[Any] = [None]
        best = finished(selection.pulls.or_light(y, weight, push, others))
        assert (best.parameters[0, 1] < 0) == pull
        assert (others[0] is not None) == other
    assert others[0].parameters[1] == pytest.approx(-6.0, rel=1e-3)


def test_a_pull_is_tried_where_errors_of_the_inputs_make_a_push_hardly_plausible() -> None:
    """Of 24 that a push and errors leave of 10, a pull leaves nothing, at the price of 20."""
    selection, y, weight = selected([[0.1, -6.0]])
    push = selection.fitter.fit(y, weight, np.array([[0.1, 6.0]]), None, 1)
    push = dataclasses.replace(push, chi2=np.full(1, 24.0), score=np.full(1, 24.0))
    assert SUSPECT < selection._p_value(push)[0] < PLAUSIBLE
    best = finished(selection._reconsidered(y, weight, push, np.ones(1, bool)))
    np.testing.assert_allclose(best.parameters[0, :2], [0.1, -6.0], rtol=1e-3)


def test_a_faulty_taxel_is_left_out_where_nothing_else_explains_a_frame() -> None:
    selection, y, weight = selected([[0.1, 8.0], [-0.2, 6.0]])
    y[0, 4] += 400.0
    best, _ = selection.explain(y, weight)
    assert best.contacts.tolist() == [1, 1]
    assert np.flatnonzero(best.weight[0] == 0).tolist() == [4]
    np.testing.assert_allclose(best.parameters[:, :2], [[0.1, 8.0], [-0.2, 6.0]], rtol=1e-3)


def test_a_spike_beside_one_contact_asks_for_no_search() -> None:
    """Further contacts were tried beside every spike, a second a frame."""
    selection, y, weight = selected([[0.1, 8.0], [-0.2, 6.0]])
    y[0, 0] += 400.0
    best, _ = selection.explain(y, weight)
    assert not selection.searched
    assert np.flatnonzero(best.weight[0] == 0).tolist() == [0]
    np.testing.assert_allclose(best.parameters[:, :2], [[0.1, 8.0], [-0.2, 6.0]], rtol=1e-3)


def test_taxels_left_out_may_hide_a_contact_whose_pattern_explains_them() -> None:
    selection, y, weight = selected([[0.3, 8.0], [0.3, 8.0], [0.3, 8.0]])
    y[0, 3] += 400.0
    y[1] += 4 * selection.nodes.signatures[selection.nodes.signatures[:, 3].argmax()]
    kept = inliers(y, weight, dimple_readings(np.array([[0.3, 8.0]])))
    best = selection.fitter.fit(y, kept, np.full((3, 2), [0.3, 8.0]), None, 1)
    assert ((best.weight == 0).any(1)).tolist() == [True, True, False]
    assert selection.doubts.hidden(y, weight, best).tolist() == [False, True, False]


def test_pulls_of_several_frames_are_fitted_each_from_its_own_place() -> None:
    selection, y, weight = selected([[0.1, -6.0], [-0.3, -4.0]])
    found = selection.pulled(y, weight)
    np.testing.assert_allclose(found.parameters[:, :2], [[0.1, -6.0], [-0.3, -4.0]], rtol=1e-3)


def test_a_second_mode_that_is_better_takes_the_first_s_place() -> None:
    selection, y, weight = selected([[0.0, 6.0]])
    best = selection.fitter.fit(y, weight, np.array([[0.4, 2.0]]), None, 1)
    wrong = dataclasses.replace(best, chi2=np.array([50.0]), score=np.array([50.0]))
    wrong.parameters[0, :2] = 0.4, 2.0
    node = selection.nodes.nearest_to(np.array([[0.0, 8.0]]), 1)
    found, others = finished(selection._second_modes(y, weight, node, wrong))
    np.testing.assert_allclose(found.parameters[0, :2], [0.0, 6.0], atol=1e-4)
    (other,) = others
    assert other is not None
    assert other.chi2 == 50.0
    assert other.parameters[0] == 0.4
    # The other way round the found one is the alternative, and near ones are none.
    right = selection.fitter.fit(y, weight, np.array([[0.0, 6.0]]), None, 1)
    right.parameters[0, 0] = 0.4
    same, others = finished(selection._second_modes(y, weight, node, right))
    assert same.chi2[0] <= right.chi2[0]
    right.parameters[0, 0] = 0.1
    assert finished(selection._second_modes(y, weight, node, right))[1] == [None]
    assert finished(selection._second_modes(y, weight, np.array([-1]), right)) == (
        right,
        [None],
    )


def test_prediction_of_a_stream_is_one_gauss_newton_step() -> None:
    selection, y, weight = selected([[0.1, 6.0]], live=True)
    selection.explain(y, weight)
    assert selection.last is not None
    moved = dimple_readings([0.102, 6.1])
    predicted = selection._predicted(moved, weight, selection.last)
    np.testing.assert_allclose(predicted[0], [0.102, 6.1], atol=2e-3)
    fits = selection.fitter.fits
    best, _ = selection.explain(moved, weight)
    np.testing.assert_allclose(best.parameters[0, :2], [0.102, 6.1], rtol=1e-4)
    assert selection.fitter.fits == fits + 1
    selection.forget()
    assert selection.last is None


def test_a_stream_goes_on_with_two_contacts_from_those_before() -> None:
    selection, y, weight = selected([[-0.25, 0.3, 8.0, 5.0]], live=True)
    for step in (0.0, 0.0, 0.002):
        y = dimple_readings([-0.25 + step, 0.3, 8.0, 5.0 + 10 * step], 2)
        best, _ = selection.explain(y, weight)
    assert best.contacts.tolist() == [2]
    np.testing.assert_allclose(np.sort(best.parameters[0, :2]), [-0.248, 0.3], atol=1e-4)


# --- frames in bounded time ---------------------------------------------------------------


class Clock:
    """A clock that stands still but for what is done."""

    now = 0.0

    def __call__(self) -> float:
        """The time [s]."""
        return self.now


def test_steps_are_taken_while_there_is_time_and_one_too_long_first_of_the_next_frame() -> None:
    clock = Clock()
    took = {"a": 3e-3, "b": 4e-3, "c": 30e-3, "d": 1e-3}

    def steps() -> Any:
        for name in "abacd":
            yield name
            clock.now += took[name]
        return "found"

    budget = Budget(10e-3, clock)
    first, spent = Search(steps(), budget), []
    for _ in range(4):
        budget.begin()
        begin = clock.now
        first.go_on()
        spent.append(round(1e3 * (clock.now - begin)))
    # The first time nobody knows how long a step takes; c and d begin with a frame each.
    assert spent == [40, 1, 0, 0]
    assert first.found == "found"
    second, spent = Search(steps(), budget), []
    while second.found is None:
        budget.begin()
        begin = clock.now
        second.go_on()
        spent.append(round(1e3 * (clock.now - begin)))
    assert spent == [10, 30, 1]
    # A step that is taken outside of a search counts by the same clock.
    with budget.timing("e"):
        clock.now += 11e-3
    budget.begin()
    assert budget.allows("b")
    assert not budget.allows("e")
    # What goes on by itself is waited for as long as there is time.
    slow: Future[str] = Future()

    def waiting() -> Any:
        yield slow
        return slow.result()

    third = Search(waiting(), budget)
    for _ in range(2):
        budget.begin(0.0)
        assert not third.go_on()
    slow.set_result("solved")
    assert third.go_on()
    assert third.found == "solved"
    assert finished(steps()) == "found"


class Slow(DimpleFitter):
    """A fit takes 5 ms."""

    clock: Clock

    def steps(self, asked: Attempt) -> Any:
        """Fit, and let time pass."""
        found = yield from super().steps(asked)
        self.clock.now += 5e-3
        return found


def bounded(budget: float) -> tuple[Any, Clock]:
    fitter = Slow(live=True)
    fitter.clock = clock = Clock()
    nodes = DimpleNodes()
    return BoundedSelection(fitter, nodes, 20.0, 2, budget=Budget(budget, clock)), clock


@pytest.mark.parametrize("budget", [6e-3, 9e-3, 1.0])
def test_two_contacts_of_a_stream_are_told_as_two_after_some_frames_in_time(
    budget: float,
) -> None:
    selection, clock = bounded(budget)
    weight = np.ones((1, 13))
    told = []
    for k in range(40):
        y = dimple_readings([-0.25, 0.3, 8.0 + 0.01 * k, 5.0], 2)
        selection.budget.begin()
        begin = clock.now
        best, others = selection.explain(y, weight)
        # A fit that is begun is ended, and the first says what is known.
        assert clock.now - begin <= max(budget, 5e-3) + 5e-3 + 1e-9 or budget == 1.0
        told.append((selection.coarse, int(best.contacts[0])))
        assert np.isfinite(best.chi2[0])
        assert others == [None]
    first = told.index((False, 2))
    assert told == [(True, 1)] * first + [(False, 2)] * (40 - first)
    assert (first == 0) == (budget == 1.0)
    np.testing.assert_allclose(np.sort(best.parameters[0, :2]), [-0.25, 0.3], atol=1e-3)
    # What a search was about is gone: it ends, and with it what is coarse.
    selection.forget()
    for loads, coarse in (
        ([-0.25, 0.3, 8.0, 5.0], budget < 1.0),
        ([-0.25, 0.3, 8.0, 0.0], False),
    ):
        selection.budget.begin()
        best, _ = selection.explain(dimple_readings(loads, 2), weight)
        assert selection.coarse == coarse
    assert best.contacts[0] == 1


def test_frames_of_one_contact_are_those_without_a_budget() -> None:
    selection, _ = bounded(16e-3)
    free, *_ = selected([0.1, 6.0], live=True)
    random = np.random.default_rng(3)
    for k in range(10):
        y = dimple_readings([0.1 + 0.01 * k, 6.0]) + random.normal(size=13)
        selection.budget.begin()
        one, two = (x.explain(y, np.ones((1, 13)))[0] for x in (selection, free))
        assert not selection.coarse
        np.testing.assert_array_equal(one.parameters, two.parameters)
        np.testing.assert_array_equal(one.information, two.information)


class Bending(SectionFitter):
    """One contact whose angle reads as angle + b direction^2; taxels tell a parameter each."""

    parameters = SECTION_WITH_DIRECTION
    bent = np.array([0.7, 0.0, 0.0])

    def __init__(self) -> None:
        self._bounds = np.array([[-1.5, 1.5], [0.0, 9.0], [-1.5, 1.5]])

    def _derivatives(self, asked: Attempt) -> np.ndarray:
        slopes = np.tile(np.eye(3), (len(asked.start), 1, 1))
        slopes[:, 2] += 2 * self.bent * asked.start[:, 2:]
        return slopes


@pytest.mark.parametrize("deviation", [0.02, 0.5])
def test_a_direction_hardly_known_widens_what_bends_with_it(deviation: float) -> None:
    # The angle is what is read less b d^2, whose mean square is 3 b^2 s^4 for a normal d.
    fitter, weight = Bending(), np.array([100.0, 25.0, deviation**-2])
    known = explanations([0.1, 2.0, 0.0], jacobian=np.eye(3)[None], weight=weight)
    nowhere = dataclasses.replace(
        known, chi2=np.full(1, np.inf), information=np.zeros((1, 3, 3))
    )
    found = fitter.bend(known.joined(nowhere))
    assert found is not None
    expected = np.zeros((2, 3, 3))
    expected[0, 0, 0] = 3 * 0.7**2 * deviation**4
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-20)
    # What no taxel tells has no finite error that could bend.
    blind = explanations([0.1, 2.0, 0.0], jacobian=np.diag([1.0, 1.0, 0.0])[None])
    assert not np.asarray(fitter.bend(blind)).any()


# --- search -------------------------------------------------------------------------------


def test_costs_are_weighted_squares_but_for_a_constant() -> None:
    nodes = DimpleNodes()
    y = dimple_readings([[0.05, 8.0]]) + 1.0
    weight = np.linspace(0.5, 2.0, 13)[None]
    exact = (weight * (y - nodes.readings) ** 2).sum(1)
    found = nodes.costs(y, weight)[0][0]
    np.testing.assert_allclose(found - found.min(), exact - exact.min(), rtol=1e-3, atol=0.5)


def test_nearest_node_and_the_nearest_far_from_it() -> None:
    nodes = DimpleNodes()
    weight = np.zeros((1, 13))
    weight[0, [0, 12]] = 1.0  # only the outermost taxels: both ends look alike
    y = np.tile(AT_REST, (1, 1))
    y[0, [0, 12]] = dimple_readings([0.5, 8.0])[0, 12]
    first, second = nodes.nearest(y, weight)
    assert abs(nodes.loads[first[0], 0]) == pytest.approx(0.5)
    assert nodes.loads[second[0], 0] == pytest.approx(-nodes.loads[first[0], 0])
    # All taxels: one place only.
    y = dimple_readings([0.2, 8.0])
    first, second = nodes.nearest(y, np.ones((1, 13)))
    np.testing.assert_allclose(nodes.loads[first[0]], [0.2, 8.0])
    assert second.tolist() == [-1]


@pytest.mark.parametrize("place", [0.0, 0.1, 0.35])
def test_a_light_contact_is_sought_where_it_is(place: float) -> None:
    # A tenth of the lightest node's force: a node that moves no taxel in use is nearer to its
    # readings than the one at its place.
    nodes = DimpleNodes()
    y = dimple_readings([place, 0.2])
    weight = np.ones((1, 13))
    weight[0, :4] = 0.0
    lightest = nodes.costs(y, weight)[0][0, ::3]
    assert nodes.places[lightest.argmin(), 0] < -0.3
    first, _ = nodes.nearest(y, weight)
    np.testing.assert_allclose(nodes.loads[first[0]], [place, 2.0], atol=1e-12)
    modes = nodes.minima(y[0], weight[0], 1, 1e9)
    np.testing.assert_allclose(nodes.loads[modes[0]], [place, 2.0], atol=1e-12)


def test_minima_of_a_frame_lie_apart_and_best_first() -> None:
    nodes = DimpleNodes()
    y = dimple_readings([-0.3, 0.3, 8.0, 6.0], 2)[0]
    found = nodes.minima(y, np.full(13, 1e-3), 3, 1e9)
    angles = nodes.loads[found, 0]
    assert len(found) == 3
    assert angles[0] == pytest.approx(-0.3, abs=0.051)
    assert angles[1] == pytest.approx(0.3, abs=0.051)
    assert (np.abs(np.subtract.outer(angles, angles))[np.triu_indices(3, 1)] >= 0.15).all()
    assert len(nodes.minima(y, np.ones(13), 3, 1.0)) == 1


def test_places_farther_than_the_separation_are_modes_of_their_own() -> None:
    nodes = DimpleNodes()
    a = np.array([[0.0, 1.0], [0.0, 1.0]])
    b = np.array([[0.16, 9.0], [0.14, 9.0]])
    assert nodes.apart(a, b).tolist() == [True, False]


def test_pairs_of_nodes_are_found_in_their_superposition() -> None:
    pairs = DimpleNodes().several()
    y = dimple_readings([-0.25, 0.3, 8.0, 20.0], 2)[0]
    starts = finished(pairs.of_two(y, np.ones(13)))
    parameters, strongest = starts[0]
    np.testing.assert_allclose(parameters, [-0.25, 0.3, 8.0, 20.0], rtol=1e-3)
    np.testing.assert_allclose(pairs._search.loads[strongest], [0.3, 20.0])
    assert len(starts) == 3
    for other, _ in starts[1:]:
        assert np.abs(other[:2] - parameters[:2]).max() >= 0.1
    # Forces between the nodes' are scaled from them.
    y = dimple_readings([-0.25, 0.3, 11.0, 14.0], 2)[0]
    (best, _), *_ = finished(pairs.of_two(y, np.ones(13)))
    np.testing.assert_allclose(best, [-0.25, 0.3, 11, 14], 1e-2)


def test_one_more_contact_is_sought_in_what_a_fit_leaves() -> None:
    pairs = DimpleNodes().several()
    y = dimple_readings([-0.25, 0.3, 8.0, 6.0], 2)[0]
    one = np.array([-0.25, 8.0, np.nan, np.nan])
    starts = pairs.of_one_more(y, np.ones(13), one, dimple_readings([-0.25, 8.0])[0], 1)
    parameters, strongest = starts[0]
    np.testing.assert_allclose(parameters, [-0.25, 0.3, 8.0, 6.0], rtol=1e-3)
    assert pairs._search.loads[strongest, 0] == pytest.approx(-0.25)
    assert len(starts) == 3
    assert abs(starts[1][0][1] - 0.3) >= 0.1


def test_scales_of_a_pair_are_least_squares_within_a_factor_of_two() -> None:
    patterns, measured = RNG.normal(size=(5, 7)), RNG.normal(size=7)
    products, along = patterns @ patterns.T, patterns @ measured
    wanted = patterns[0] * 1.5 + patterns[1] * 0.7
    own = np.diagonal(products)
    both = own, patterns @ wanted
    first, second, cost = _scaled(products, both, both)
    assert first[0, 1] == pytest.approx(1.5, rel=1e-9)
    assert second[0, 1] == pytest.approx(0.7, rel=1e-9)
    assert cost[0, 1] == pytest.approx(-(wanted @ wanted), rel=1e-9)
    for a, b in ((0, 1), (2, 4)):
        first, second, cost = _scaled(products, (own, along), (own, along))
        x, y = first[a, b], second[a, b]
        assert 0.5 <= x <= 2.0
        left = measured - x * patterns[a] - y * patterns[b]
        assert cost[a, b] == pytest.approx(left @ left - measured @ measured, rel=1e-9)


def quadratic_table() -> LoadTable:
    """Readings that are quadratic in angle and log force, with caps that differ by angle."""
    angles = np.linspace(-0.5, 0.5, 11)
    cap = 50.0 * np.exp(0.4 * angles)
    forces = cap[:, None] * np.geomspace(0.01, 1.0, 9)
    a, f = np.broadcast_arrays(angles[:, None], np.log(forces))
    so = np.stack(
        [1e3 + 20 * a + 30 * f + 9 * a * a + 4 * a * f + 6 * f * f, 1e3 - 50 * a * f], -1
    )
    return LoadTable(
        angles, forces, so, np.full(2, 990.0), np.zeros((11, 9, 1, 1)), 0 * forces, cap
    )


def test_taylor_terms_of_a_table_are_its_derivatives_by_angle_and_log_force() -> None:
    table = quadratic_table()
    by_angle, by_log = table.steps
    assert by_angle == pytest.approx(0.1)
    assert by_log == pytest.approx(np.log(100) / 8)
    found = table.taylor.reshape(11, 9, 6, 2)[5, 4]  # away from the table's edges
    a, f = table.angles[5], np.log(table.forces[5, 4])
    expected = [
        table.so[5, 4, 0],
        by_angle * (20 + 18 * a + 4 * f),
        by_log * (30 + 4 * a + 12 * f),
        by_angle**2 * 18,
        by_angle * by_log * 4,
        by_log**2 * 12,
    ]
    np.testing.assert_allclose(found[:, 0], expected, rtol=2e-2, atol=1e-2)
    np.testing.assert_allclose(table.signatures[5], (table.so[5, 0] - 990) / table.forces[5, 0])


def test_loads_near_a_node_are_those_of_its_taylor_polynomial() -> None:
    table = quadratic_table()
    search = object.__new__(NodeSearch)
    search._table = table
    search.loads = np.stack([np.repeat(table.angles, 9), table.forces.reshape(-1)], 1)
    angle, force = table.angles[5] + 0.03, table.forces[5, 4] * 1.2
    a, f = angle, np.log(force)
    y = [1e3 + 20 * a + 30 * f + 9 * a * a + 4 * a * f + 6 * f * f, 1e3 - 50 * a * f]
    found = search.near(np.array([y]), np.ones((1, 2)), np.array([5 * 9 + 4]))
    np.testing.assert_allclose(found[0], [angle, force], rtol=2e-2)


def test_nearest_state_of_a_section_s_table() -> None:
    table = quadratic_table()
    search = object.__new__(NodeSearch)
    search._table, search.known = table, np.ones(99, bool)
    search.known[2 * 9 + 6] = False
    wanted = np.array(
        [
            [table.angles[3] + 0.04, 9.0, 1.1 * table.forces[3, 5], 1.0],
            [table.angles[2], 9.0, table.forces[2, 6], 1.0],  # has no state: the lightest
        ]
    )
    assert search.nearest_to(wanted, 2).tolist() == [3 * 9 + 5, 2 * 9]


def touching(monkeypatch: pytest.MonkeyPatch, closes: float) -> list[float]:
    """Solves whose gap of 5 mm closes in proportion to the force, at `closes` (1 + angle)."""
    asked: list[float] = []

    def solve(skin: Any, angle: Any, force: Any, start: Any) -> Any:
        asked.extend(np.ravel(force))
        gap = 5e-3 * (1 - np.asarray(force) / (closes * (1 + np.asarray(angle))))
        return None, gap, None, np.zeros(len(gap), int)

    monkeypatch.setattr(load_table, "_solve", solve)
    return asked


def test_force_of_first_contact_is_bracketed_and_halved(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    touching(monkeypatch, 10.0)
    angles = np.array([0.0, 0.5])
    skin: Any = None
    found = load_table.first_contacts(skin, angles, np.array([9.0, 13.0]))
    np.testing.assert_allclose(found, [10.0, 15.0], rtol=1e-4)
    # Where the membrane is beyond the wall already, nothing is known.
    assert load_table.first_contacts(skin, angles[:1], np.array([11.0])).tolist() == [np.inf]


def test_largest_force_of_the_table_leaves_a_fiftieth_of_the_gap(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    touching(monkeypatch, 10.0)
    skin: Any = SimpleNamespace(geometry=SimpleNamespace(oil_gap=[5e-3]))
    found = load_table._largest_forces(skin, np.array([0.0, 0.5]))
    assert (found <= 0.98 * np.array([10.0, 15.0])).all()
    assert (found > 0.92 * np.array([10.0, 15.0])).all()


def test_table_ends_before_the_wall_also_where_the_skin_gives_way_between_probes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A dip of the force of first contact that is narrower than the probes are apart."""

    def closes(angle: Any) -> np.ndarray:
        return np.asarray(10.0 - 6.0 * np.exp(-(((np.asarray(angle) - 0.1) / 0.04) ** 2)))

    def solve(skin: Any, angle: Any, force: Any, start: Any) -> Any:
        gap = 5e-3 * (1 - np.asarray(force) / closes(angle))
        return None, gap, None, np.zeros(len(gap), int)

    monkeypatch.setattr(load_table, "_solve", solve)
    skin: Any = SimpleNamespace(geometry=SimpleNamespace(oil_gap=[5e-3]))
    angles = np.linspace(-1.5, 1.5, 151)
    found = load_table._largest_along(skin, angles)
    assert (found < closes(angles)).all()
    assert (found[np.abs(angles) > 0.5] > 9.0).all()
    limit = load_table.first_contacts(skin, angles, found)
    np.testing.assert_allclose(limit, closes(angles), rtol=1e-4)


def test_fewer_contacts_are_three_of_which_some_press_with_no_force() -> None:
    """So that one compiled program has derivatives under any number of them."""
    one, two = (
        filled_up(np.array([[0.1, 5.0]]), 1),
        np.array([[0.1, 0.2, 5.0, 6.0]]),
    )
    assert one.tolist() == [[0.1, 0, 0, 5.0, 0, 0]]
    assert filled_up(two, 2).tolist() == [[0.1, 0.2, 0, 5.0, 6.0, 0]]
    turned = np.arange(1.0, 10.0)[None]
    assert filled_up(turned, 3).tolist() == turned.tolist()


# --- least squares ------------------------------------------------------------------------


def quadratic_fit(x: list[float], gradient: list[float], information: Any) -> tuple[Fit, Any]:
    """A lane at parameters with this gradient and information, and wide bounds."""
    count = len(x)
    zero = jnp.zeros(1)
    state = State(jnp.zeros((0, 0, 1)), zero, zero)
    evaluation = Evaluation(
        jnp.zeros((2, 1)), jnp.ones((count, 2, 1)), zero, zero, state, jnp.zeros(1, int)
    )
    fit = Fit(
        jnp.array(x)[:, None],
        evaluation,
        jnp.array([7.0]),
        jnp.array(gradient)[:, None],
        jnp.array(information)[..., None],
        jnp.array([1e-3]),
    )
    bound = jnp.full((count, 1), 10.0)
    return fit, Target(jnp.zeros((2, 1)), jnp.ones((2, 1)), -bound, bound)


step_of = quick(_step, eqx.filter_jit)
last_step = quick(_last_step, eqx.filter_jit)
INFORMATION = np.array([[4.0, 1.0, 0.5], [1.0, 9.0, -0.3], [0.5, -0.3, 1e6]])
GRADIENT = [2.0, -3.0, 400.0]


@pytest.mark.parametrize("damping", [0.0, 0.7])
def test_step_of_a_fit_is_gauss_newton_s_damped_on_the_diagonal(damping: float) -> None:
    fit, target = quadratic_fit([0.0, 0.0, 0.0], GRADIENT, INFORMATION)
    step, decrease = step_of(fit, target, jnp.array([damping]))
    matrix = INFORMATION + damping * np.diag(np.diag(INFORMATION))
    expected = np.linalg.solve(matrix, GRADIENT)
    np.testing.assert_allclose(np.asarray(step)[:, 0], expected, rtol=1e-8)
    np.testing.assert_allclose(np.asarray(decrease), expected @ GRADIENT, rtol=1e-8)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_parameter_against_its_bound_is_held_there(side: float) -> None:
    gradient = [2.0 * side, -3.0, 400.0]
    fit, target = quadratic_fit([10.0 * side, 0.0, 0.0], gradient, INFORMATION)
    step, _ = step_of(fit, target, jnp.zeros(1))
    expected = np.linalg.solve(INFORMATION[1:, 1:], gradient[1:])
    np.testing.assert_allclose(np.asarray(step)[:, 0], [0.0, *expected], rtol=1e-8)


def test_last_step_is_taken_to_first_order_where_a_fit_has_settled() -> None:
    fit, target = quadratic_fit([9.9, 0.0, 0.0], GRADIENT, INFORMATION)
    step = np.linalg.solve(INFORMATION, GRADIENT)
    end = last_step(fit, target)
    moved = np.minimum(step, [0.1, 10.0, 10.0])
    np.testing.assert_allclose(
        np.asarray(end.parameters)[:, 0], moved + np.array([9.9, 0, 0]), 1e-8
    )
    np.testing.assert_allclose(np.asarray(end.evaluation.so)[:, 0], moved.sum(), rtol=1e-8)
    np.testing.assert_allclose(np.asarray(end.chi2), 7.0 - 1e-3, rtol=1e-12)
    far = fit._replace(predicted_decrease=jnp.array([1e-2]))
    same = last_step(far, target)
    np.testing.assert_array_equal(np.asarray(same.parameters), np.asarray(fit.parameters))
    np.testing.assert_array_equal(np.asarray(same.chi2), 7.0)


# --- errors of a section ------------------------------------------------------------------


def test_change_of_a_contact_that_does_most_nearly_what_an_error_does() -> None:
    jacobian = RNG.normal(size=(3, 2, 6)) * np.array([1e-3, 1e4])[:, None]
    alike = RNG.normal(size=(3, 4, 2))
    moved = alike @ jacobian
    np.testing.assert_allclose(most_alike(jacobian, moved), alike, rtol=1e-3)
    dead = jacobian.copy()
    dead[0, 1] = 0.0
    assert most_alike(dead, moved)[0, :, 1].tolist() == [0.0] * 4


def test_where_a_force_has_no_state_that_of_less_force_stands() -> None:
    values = np.array([[[1.0], [np.nan], [np.nan]], [[np.nan], [2.0], [3.0]]])
    assert _filled(values)[..., 0].tolist() == [[1.0, 1.0, 1.0], [0.0, 2.0, 3.0]]


def test_errors_under_one_contact_are_interpolated_in_angle_and_log_force() -> None:
    """S = F l(angle, log F) + (g_a, F g_f) J with l and g linear between the nodes."""
    table = quadratic_table()
    a = np.broadcast_to(table.angles[:, None], table.forces.shape)
    # Linear in the angle at equal shares of the largest force, and in the level.
    level = np.broadcast_to(np.arange(9.0), a.shape)
    left, by_a, by_f = 1 + 2 * a + 0.1 * level, 3 - a + 0.2 * level, 0.5 + a - 0.1 * level
    alike = np.stack([by_a, by_f], -1)[:, :, None]
    changes = TabulatedChanges(table, alike, left[..., None, None] * np.array([[1.0, 2.0]]))
    errors = object.__new__(SectionErrors)
    errors._changes, errors.rest = changes, np.array([[7.0, 8.0]])
    angle, force = np.array([0.13]), np.array([4.0])
    jacobian = np.array([[[1.0, -1.0], [0.3, 0.4]]])
    low, share = 6, 0.3  # 0.13 lies between 0.1 and 0.2

    def at(values: np.ndarray) -> float:
        total = 0.0
        for i, part in ((low, 1 - share), (low + 1, share)):
            exact = np.log(4.0 / table.forces[i, 0]) / table.steps[1]
            total += part * float(np.interp(exact, np.arange(9.0), values[i]))
        return total

    expected = (
        4.0 * at(left) * np.array([1.0, 2.0])
        + at(by_a) * jacobian[0, 0]
        + 4.0 * at(by_f) * jacobian[0, 1]
        + errors.rest[0]
    )
    np.testing.assert_allclose(errors.under_one(angle, force, jacobian)[0, 0], expected, 1e-9)
    # Beyond the table its outermost values stand.
    far = errors.under_one(np.array([9.0]), np.array([1e9]), 0 * jacobian)
    expected = 1e9 * left[-1, -1] * np.array([1.0, 2.0]) + errors.rest[0]
    np.testing.assert_allclose(far[0, 0], expected, rtol=1e-9)


@pytest.mark.parametrize("per_contact", [2, 3])
@pytest.mark.parametrize("contacts", [1, 2])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_regions_hold_the_loads_that_keep_a_shape(
    contacts: int, per_contact: int, sign: float
) -> None:
    """F and F (a - a0) are linear in an error, from half the stiffness to three deviations."""
    width = per_contact * contacts
    force = 8.0 * sign
    rows, gain = (contacts, 0), np.array([0.4 * force, 0.04])  # of its force and place
    parameters = np.full((1, width), force)
    shared = np.zeros((1, width, width))
    by = np.zeros(width)
    by[list(rows)] = gain
    shared[0] = np.outer(by, by)
    best = explanations(parameters, contacts=contacts)
    found = beyond_first_order(shared, best)[0]
    own, noise = np.ix_(rows, rows), np.diag([1e-3, 1e-6])
    plain, region = shared[0][own] + noise, found[own] + noise
    assert region[0, 0] - noise[0, 0] == pytest.approx((1.2 * gain[0]) ** 2)
    outside = []
    for left in (0.5, 0.8, 1.4, 2.2):
        error = (1 - left) * force / gain[0]
        off = gain * error / np.array([1.0, left])
        assert off @ np.linalg.solve(region, off) < 13.9
        outside.append(off @ np.linalg.solve(plain, off) > 13.9)
    assert any(outside)
    found[own] = 0.0
    assert not found.any()  # nothing else moves with this force


@pytest.mark.parametrize("rho", [0.05, 0.12, 0.3])
def test_regions_grow_by_what_a_reciprocal_has_beyond_first_order(rho: float) -> None:
    """1 / (1 - e) less 1 + e, e three deviations of the force either way."""
    force, gain = 8.0, np.array([0.04, rho * 8.0])
    best = explanations([[0.1, force]])
    found = beyond_first_order(np.outer(gain, gain)[None], best)[0]
    wider = (1 + 0.5 * rho) * rho  # errors that multiply
    assert found[1, 1] == pytest.approx((wider * force) ** 2)
    needed = []
    for deviations in (min(3.0, 0.5 / wider), -3.0):
        e = wider * deviations
        beyond = 1 / (1 - e) - (1 + e)
        needed.append(beyond**2 / (13.8 - deviations**2))
    slope = gain[0] / (wider * force)  # of place by force
    assert found[0, 0] == pytest.approx(gain[0] ** 2 + (slope * force) ** 2 * max(needed))


def test_places_that_errors_do_not_move_stay_as_sure() -> None:
    best = explanations([[0.1, 5.0]])
    (found,) = beyond_first_order(np.diag([1e-4, 4.0])[None], best)
    np.testing.assert_allclose(found, np.diag([1e-4, (1.2 * 2.0) ** 2]), rtol=1e-12)
    small = np.array([[[1e-6, 1e-4], [1e-4, 1e-2]]])  # a fiftieth of the force
    np.testing.assert_allclose(beyond_first_order(small, best), small, rtol=0.03)
    none = explanations([[0.1, 0.0]])
    assert not beyond_first_order(np.zeros((1, 2, 2)), none).any()


def test_frames_tell_less_of_what_makes_a_skin_stiffer() -> None:
    """An error of a quarter of the force shows as two thirds at two deviations."""
    gain = np.array([[[0.0, 0.0], [2.0, 0.0]]])  # of angle and force by two errors
    left, pull = np.array([[[3.0, 1.0], [1.0, 2.0]]]), np.array([[4.0, -1.0]])
    spread = np.linalg.inv(np.eye(2) + left)
    likely = (spread @ pull[..., None])[..., 0]
    none = np.zeros(0)
    told = ErrorsOfFrames(none, gain, left, pull, spread, likely, none)
    best, both = explanations([[0.1, 8.0]]), np.array([True, True])
    found = less_told(told, best, both)
    shown = np.diag([1 / 1.5, 1.0])
    expected = np.linalg.inv(np.eye(2) + shown @ left[0] @ shown)
    np.testing.assert_allclose(found.spread[0], expected, rtol=1e-12)
    np.testing.assert_allclose(found.likely[0], expected @ shown @ pull[0], rtol=1e-12)
    for same in (told._replace(gain=0 * gain), told):
        own = less_told(same, best, both & (same is not told))
        np.testing.assert_allclose(own.spread, spread, rtol=1e-12)


def test_tangents_of_a_skin_are_those_of_differences() -> None:
    """Of a section whose thickness is a table, along several changes of its file at once."""
    spec = load_skin(SKINS / "suas-flat-topped.toml")
    thickness = AlongSpec(arc=(0.0, 0.5, 1.0), value=(1.5e-3, 1.7e-3, 1.4e-3))
    geometry = spec.geometry.model_copy(update={"thickness": thickness})
    spec = spec.model_copy(update={"geometry": geometry})
    skin = skin_of(spec, contact=False)
    paths = ("geometry.thickness.value.1", "geometry.oil_gap", "material.C1")
    columns = np.array([[1e-4, 2e-4, 0.0], [0.0, 0.0, 1e6], [0.0, 0.0, 0.0]])
    arrays = eqx.filter(changed_skin(spec, skin, {}), eqx.is_inexact_array)
    none = jax.tree.map(lambda x: jnp.zeros((len(columns), *x.shape)), arrays)
    found = eqx.combine(skin_tangents(spec, skin, paths, columns), none)
    known = continuous_inputs(spec)

    def at(share: float, column: np.ndarray) -> Any:
        moved = {p: known[p] + share * x for p, x in zip(paths, column, strict=True)}
        return eqx.filter(changed_skin(spec, skin, moved), eqx.is_inexact_array)

    for k, column in enumerate(columns):
        ends = at(1e-3, column), at(-1e-3, column)
        for own, plus, minus in zip(*map(jax.tree.leaves, (found, *ends)), strict=True):
            wanted = (np.asarray(plus) - minus) / 2e-3
            scale = max(np.abs(wanted).max(), 1e-9 * np.abs(plus).max())
            np.testing.assert_allclose(own[k], wanted, rtol=0, atol=1e-5 * scale)


def test_what_an_estimate_left_out_says_nothing_about_the_skin_file(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stuck = np.zeros((3, 4), bool)
    stuck[0, 3] = True
    log = SimpleNamespace(
        main=SimpleNamespace(
            remembers=False,
            spec=SimpleNamespace(geometry=SimpleNamespace(dimension=2)),
        ),
        readings=SimpleNamespace(pressure=None, force=None, stuck=stuck),
        main_frames=lambda: (np.array([0, 2]), np.zeros((2, 4))),
    )
    estimates: list[Any] = [SimpleNamespace(left_out=taxels) for taxels in ((3,), (), (0, 1))]
    seen = []
    monkeypatch.setattr(section_log, "section_verdict", lambda *a, **_: seen.append(a))
    _verdict(log, estimates)  # type: ignore[arg-type]
    ((_, _, unused, own),) = seen
    assert unused.tolist() == [[False, False, False, True], [True, True, False, False]]
    assert own == [estimates[0], estimates[2]]
    assert stuck.sum() == 1


@pytest.mark.parametrize(("off", "nearer"), [(1.5, True), (-1.5, True), (2.5, False)])
def test_a_live_frame_goes_on_from_the_last_one_where_that_is_nearer(
    off: float, *, nearer: bool
) -> None:
    """By weighted squares, against the nearest node of the table, two counts off."""
    selection = object.__new__(Selection)
    selection.nodes = SimpleNamespace(readings=np.array([[9.0], [3.0]]))  # type: ignore
    last = explanations([[0.1, 5.0]], so=[[1.0 - off]])
    found = selection._nearer(np.ones((1, 1)), np.full((1, 1), 0.3), np.array([1]), last)
    assert found is nearer


# --- taxels that stand alone --------------------------------------------------------------


def lone_of(noise: float = 2.0) -> LoneTaxels:
    nodes = DimpleNodes()
    variance = np.full(13, noise**2)
    return LoneTaxels(nodes.readings, nodes.rest, nodes.stray, variance)


def test_a_spike_beside_two_contacts_is_what_no_load_explains() -> None:
    """A fit by two contacts took it for a third, or a trimmed one came before."""
    places = [[0.2, -0.25, 8.0, 6.0], [0.1, -0.4, 20.0, 2.0], [0.0, 0.0, 0.0, 0.0]]
    so = dimple_readings(places, 2) + np.random.default_rng(2).normal(0, 2.0, (3, 13))
    lone = lone_of()
    assert not lone.found(so).any()
    for taxel in range(13):
        for spike in (500.0, -500.0):
            read = so.copy()
            read[:, taxel] += spike
            found = lone.found(read)
            assert np.argwhere(found)[:, 1].tolist() == [taxel] * 3


def test_no_taxel_stands_alone_where_many_do() -> None:
    so = dimple_readings([[0.2, 8.0]])
    so[0, [0, 3, 7, 11]] += 800.0
    so[0, 5] = np.nan
    assert not lone_of().found(so).any()
    assert not lone_of().found(np.full((1, 13), np.nan)).any()
    assert lone_of().found(np.zeros((0, 13))).shape == (0, 13)  # a log without frames


def test_gaps_that_all_differ_are_no_taxel_s_own() -> None:
    so = np.stack([1.2 * AT_REST, 0.8 * AT_REST])
    assert not lone_of().found(so).any()


# --- friction and width that a fit leaves out ---------------------------------------------


@pytest.mark.parametrize("quantity", [0, 1])
def test_what_a_fit_leaves_out_is_the_mean_over_lines_and_other_contacts(quantity: int) -> None:
    """Against the density of u, p(r | u) sum_k N(u; 0, sigma_k), integrated."""
    little, usual = ((0.05, 0.3), (25e-6, 225e-6))[quantity]
    left, pull = 1.0 / little**2, 1.7 / little  # u is 1.7 +- 1 of the little by readings alone
    u = np.linspace(-8 * usual, 8 * usual, 400001)
    likelihood = np.exp(pull * u - left * u**2 / 2)
    narrow, wide = (likelihood * stats.norm.pdf(u, 0, s) for s in (little, usual))
    weights = np.array([1.0, *(np.trapezoid(x, u) for x in (narrow, wide))])
    density = (narrow + wide) / weights.sum()
    mean = np.trapezoid(density * u, u)
    variance = np.trapezoid(density * u**2, u) - mean**2
    lefts, pulls = np.zeros((1, 2, 2)), np.zeros((1, 2))
    lefts[0, quantity, quantity], pulls[0, quantity] = left, pull
    found, spread, line = left_out._mean(lefts, pulls, np.array([True]))
    assert found[0, quantity] == pytest.approx(mean, rel=1e-6)
    assert spread[0, quantity, quantity] == pytest.approx(variance, rel=1e-6)
    assert line[0] == pytest.approx(weights[0] / weights.sum(), rel=1e-6)
    # A misfit says nothing of it: all of what the prior and the readings allow.
    found, spread, line = left_out._mean(lefts, pulls, np.array([False]))
    assert (found[0, quantity], line[0]) == (0.0, 0.0)
    expected = 1 / (1 / usual**2 + left)
    assert spread[0, quantity, quantity] == pytest.approx(expected, rel=1e-9)


class Friction(LeftOutOfContacts):
    """Readings that tau changes, as place and force do in part, and no width does."""

    def __init__(self, slopes: np.ndarray) -> None:
        self._edge = 1.2
        rows = SimpleNamespace(under=lambda *_: np.stack([slopes, 0 * slopes])[None])
        self._changes = rows  # type: ignore[assignment]


@pytest.mark.parametrize("still", [True, False])
def test_friction_moves_place_and_force_as_far_as_they_do_what_it_does(still: bool) -> None:
    jacobian = np.array([[1.0, 0, 0], [0, 1.0, 0]])
    friction = Friction(np.array([0.3, -0.2, 1.0]))
    weight = np.full(3, 1e4)
    known = explanations([0.1, 2.0], jacobian=jacobian[None], weight=weight)
    y = known.so + np.array([0.0, 0.0, 0.2])  # only tau explains it
    found, covariance = friction.averaged(known, y, still=still)
    tau = 0.2 if still else 0.0
    # Its prior leaves tau a little less than read.
    np.testing.assert_allclose(found.parameters[0] - [0.1, 2.0], [-0.3 * tau, 0.2 * tau], 3e-3)
    along = np.array([-0.3, 0.2])
    expected = 1e-4 * np.outer(along, along)
    if still:
        np.testing.assert_allclose(covariance[0], expected, rtol=3e-3)
        np.testing.assert_allclose(found.so[0] - known.so[0], [0, 0, 0.2], atol=1e-3)
        value, deviation = found.beside[0, 0, -1]
        assert value == pytest.approx(0.2 * 2.04, rel=3e-3)
        assert deviation == pytest.approx(0.01 * 2.04, rel=3e-3)
    else:  # readings that would show it, but for a motion, leave less of it than of the prior
        assert 0 < covariance[0, 0, 0] < expected[0, 0]
        assert np.isnan(found.beside[0, 0, -1, 0])
    # What was free in the fit is told already.
    known.beside[0, 0, -1] = 0.5, 0.1
    same, nothing = friction.averaged(known, y, still=still)
    assert not nothing.any()
    np.testing.assert_array_equal(same.parameters, known.parameters)
    np.testing.assert_array_equal(same.beside[0, 0, -1], [0.5, 0.1])


def test_likelihoods_at_a_mode_are_those_of_friction_integrated() -> None:
    slopes, weight = np.array([0.3, -0.2, 1.0]), np.array([50.0, 20.0, 0.0])
    known = explanations([0.1, 2.0], jacobian=np.ones((1, 2, 3)), weight=weight)
    residual = np.array([0.1, 0.3, 9.0])
    tau = np.linspace(-4, 4, 400001)
    chi2 = (weight[:, None] * (residual[:, None] - slopes[:, None] * tau) ** 2).sum(0)
    for prior, (along, rare) in zip((0.05, 0.3), Friction(slopes).of_mode(known), strict=True):
        whole = np.trapezoid(stats.norm.pdf(tau, 0, prior) * np.exp(-chi2 / 2), tau)
        expected = np.log(whole) + (weight * residual**2).sum() / 2
        found = ((along @ (weight * residual)) ** 2).sum() / 2 - rare
        assert found == pytest.approx(expected, rel=1e-6)
