"""What is made of fitted loads, against closed forms: verdicts, statuses, evidence, ranges."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats
from skins import shaped

from fitting.cli.force_range import _section_rows
from fitting.force_range import bound as force_bound
from fitting.force_range import pad as pad_range
from fitting.force_range.bound import ForceRange, least_errors, smallest_told
from fitting.force_range.inputs import contact_deviation
from fitting.inverse_load import frame_posterior
from fitting.inverse_load.check import changed_input, section_log, skin_file
from fitting.inverse_load.check.changed_input import AbstractInputFit
from fitting.inverse_load.check.verdict import (
    FEWEST,
    WIDTH,
    Gain,
    ModelVerdict,
    gain_of,
    verdict_of,
)
from fitting.inverse_load.drift import Drift, DriftDensities, ReadingWeights, zero_of_readings
from fitting.inverse_load.estimate.assessment import LoadAssessment
from fitting.inverse_load.estimate.estimate import Contact, LoadEstimate, load_array
from fitting.inverse_load.estimate.measured_pressure import contradicted, with_doubts
from fitting.inverse_load.estimate.place import ContactPlaces, PlaceShift
from fitting.inverse_load.fit.explanation import Alternative
from fitting.inverse_load.fit.load_posterior import AbstractLoadPosterior
from fitting.inverse_load.fit.selection import Selection
from fitting.inverse_load.frames import untouched
from fitting.inverse_load.live.filter import LoadFilter
from fitting.inverse_load.pad.fitter import PadFitter
from suas_jax.config import continuous_inputs, input_errors, load_skin
from suas_jax.config.input_errors import STIFFNESS
from suas_jax.config.schema_calibration import CalibrationSpec, PlaceShiftSpec
from suas_jax.config.sections.circle import CircleSpec
from suas_jax.skin.plain import plain_geometry
from tests.stand_ins import (
    AT_REST,
    TAXELS,
    DimpleFitter,
    DimpleNodes,
    dimple_readings,
    explanations,
)

RNG = np.random.default_rng(0)
SLOPES = RNG.normal(size=(2, 6))  # of six readings by two parameters
WEIGHT = np.array([1.0, 4.0, 0.25, 1.0, 2.0, 1.0])


# --- verdicts -----------------------------------------------------------------------------


def test_gain_of_an_input_is_that_of_fitting_it_with_every_contact() -> None:
    frames = 3
    weight, residual = np.tile(WEIGHT, (frames, 1)), RNG.normal(size=(frames, 6))
    jacobian, slopes = RNG.normal(size=(frames, 2, 6)), RNG.normal(size=(frames, 6))
    found = gain_of("m", slopes, weight, residual, jacobian)
    columns = np.zeros((6 * frames, 2 * frames + 1))
    for k in range(frames):
        columns[6 * k : 6 * k + 6, 2 * k : 2 * k + 2] = jacobian[k].T
        columns[6 * k : 6 * k + 6, -1] = slopes[k]
    root = np.sqrt(weight).ravel()[:, None]
    wanted = residual.ravel()[:, None]
    left_without = np.linalg.lstsq(root * columns[:, :-1], root * wanted, None)[1]
    whole, left = np.linalg.lstsq(root * columns, root * wanted, None)[:2]
    assert found.chi2 == pytest.approx(float((left_without - left).item()), rel=1e-9)
    assert found.change == pytest.approx(float(whole[-1].item()), rel=1e-9)
    covariance = np.linalg.inv((root * columns).T @ (root * columns))
    assert found.error == pytest.approx(np.sqrt(covariance[-1, -1]), rel=1e-9)
    # What is not used or not known takes no part.
    slopes[0, 0], weight[0, 0] = np.nan, 0.0
    assert np.isfinite(gain_of("m", slopes, weight, residual, jacobian).chi2)
    nothing = gain_of("m", 0 * slopes, weight, residual, jacobian)
    assert nothing == Gain(0.0, "m", 0.0, np.inf)


def test_verdict_names_the_best_input_and_those_that_explain_as_much() -> None:
    best = Gain(400.0, "geometry.oil_gap", 0.05, 0.004)
    near, far = (Gain(400.0 - less, "oil.x", 0.1, 0.01) for less in (24.0, 26.0))
    found = verdict_of([best, near, far], chi2=1000.0, dof=301)
    assert (found.chi2_per_dof, found.explained) == (1000.0 / 301, 2.0)
    assert (found.name, found.change, found.error) == ("geometry.oil_gap", 0.05, 0.004)
    assert found.others == (near,)
    # Of a large rest, a fiftieth is as good as the same.
    assert verdict_of([best, near, far], chi2=2000.0, dof=301).others == (near, far)
    assert found.text == (
        "the skin file doesn't explain the log (chi2 per dof 3.32); it would do so better with "
        "the oil_gap in [geometry] changed by +5.0 +- 0.4 % (chi2 per dof 2.00); as well with "
        "the x in [oil] changed by +10.0 +- 1.0 %"
    )


@pytest.mark.parametrize(
    ("verdict", "text"),
    [
        (ModelVerdict(1.02, True), "the skin file explains the log (chi2 per dof 1.02)"),
        (
            ModelVerdict(3.0, False),
            "the skin file doesn't explain the log (chi2 per dof 3.00), and no single input of "
            "it would",
        ),
        (
            ModelVerdict(3.0, False, explained=1.1, shift=-1),
            "the skin file doesn't explain the log (chi2 per dof 3.00); it would with the "
            "readings moved by -1 taxels: a column too many or missing, or another order "
            "(chi2 per dof 1.10)",
        ),
        (
            ModelVerdict(3.0, False, WIDTH, 0.0203, explained=1.2),
            "the skin file doesn't explain the log (chi2 per dof 3.00); it would with contacts "
            "that press an arc of some 20 mm (chi2 per dof 1.20)",
        ),
        (
            ModelVerdict(3.0, False, WIDTH, 0.0203, explained=2.5),
            "the skin file doesn't explain the log (chi2 per dof 3.00); it would do so better "
            "with contacts that press an arc of some 20 mm (chi2 per dof 2.50)",
        ),
        (
            ModelVerdict(1.0, False, STIFFNESS, 0.123, 0.00045),
            "the measured forces or pressures ask for the stiffness changed by "
            "+12.30 +- 0.04 %; the readings alone can't show it, and this log can't tell "
            "whether material, thickness, filling, mounting or temperature is behind it",
        ),
        (
            ModelVerdict(1.19, False, "geometry.oil_gap", -0.02, 0.003, 1.01),
            "the oil_gap in [geometry] changed by -2.0 +- 0.3 % would explain the log better "
            "(chi2 per dof 1.01 instead of 1.19)",
        ),
    ],
)
def test_verdicts_in_words(verdict: ModelVerdict, text: str) -> None:
    assert verdict.text == text.replace("stiffness", STIFFNESS)


def test_what_sets_a_skin_file_right() -> None:
    def command(**changes: Any) -> str:
        return dataclasses.replace(ModelVerdict(3.0, False), **changes).command("s.toml", "log")

    assert command(shift=1).startswith("compare the order of the taxels in s.toml")
    assert command(name="geometry.oil_gap") == "suas fit sensor s.toml log --fit gap"
    assert command(name="geometry.width") == command() == ""
    # What a zero leaves open, readings that count from rest do not need.
    gap, thick = (
        ModelVerdict(3.0, False, name).command("s.toml", "log", zeroed=True)
        for name in ("geometry.oil_gap", "geometry.thickness")
    )
    assert gap.startswith("suas invert s.toml log --baseline FILE")
    assert thick == "suas fit sensor s.toml log --joint"


class Parabola(AbstractInputFit):
    """Chi2 that is least at a given change."""

    def __init__(self, lowest: float) -> None:
        self._lowest, self.tried = lowest, 0
        fit: Any = SimpleNamespace(chi2=np.array([100.0, self.chi2("", 0.0) - 100.0]))
        none: Any = None
        super().__init__(none, none, none, fit)
        self.tried = 0

    def chi2(self, path: str, change: float) -> float:
        """100 and what the change is off."""
        self.tried += 1
        return 100.0 + 6000.0 * (change - self._lowest) ** 2


def test_best_change_of_an_input_is_where_the_contacts_leave_least() -> None:
    start = Gain(1.0, "geometry.oil_gap", 0.5, 0.01)
    found = Parabola(0.1).best(start)
    assert found.change == pytest.approx(0.1, abs=2e-3)
    assert found.chi2 == pytest.approx(60.0, abs=0.1)
    assert found.error == 0.01
    # Where chi2 falls on to the end of what is tried, something else is wrong: two tries tell.
    wrong = Parabola(0.5)
    assert wrong.best(start).chi2 == 0.0
    assert wrong.tried == 2
    # Near that end, or on the other side of what is true to first order, it is still found.
    assert Parabola(0.28).best(start).change == pytest.approx(0.28, abs=2e-3)
    assert Parabola(-0.1).best(start).change == pytest.approx(-0.1, abs=2e-3)
    assert Parabola(0.1)._lost.tolist() == [200.0, 160.0]


def test_an_input_is_tried_with_less_force_where_all_of_it_leaves_no_state(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Readings are 2 counts above rest: 4 as in the file, 7 with the input changed."""
    tried: list[list[float]] = []

    class Fitter:
        per_contact, live, table = 2, False, None

        def __init__(self, skin: Any, table: Any, **_: Any) -> None:
            self.rest = skin

        def fit(self, y: Any, weight: Any, start: Any, state: Any, contacts: int) -> Any:
            tried.append(start[:, 1].tolist())
            chi2 = (weight * (y - self.rest) ** 2).sum(1)
            return SimpleNamespace(chi2=np.where(start[:, 1] > 5.0, np.nan, chi2))

    monkeypatch.setattr(changed_input, "SectionFitter", Fitter)
    monkeypatch.setattr(changed_input, "scaled_input", lambda spec, path, factor: factor)
    monkeypatch.setattr(changed_input, "changed_skin", lambda spec, skin, to: 7.0 * to / 1.1)
    monkeypatch.setattr(changed_input, "rest_readings", lambda skin: np.full(3, skin))
    estimator: Any = SimpleNamespace(
        spec=None, skin=None, rest=np.zeros(3), model_rest=np.full(3, 4.0)
    )
    estimator.selection = SimpleNamespace(fitter=Fitter(None, None))
    fit: Any = SimpleNamespace(
        chi2=np.zeros(3),
        parameters=np.array([[0.0, 4.0], [0.0, 6.0], [0.0, 20.0]]),
        rows=lambda rows: SimpleNamespace(state=None),
    )
    own = changed_input.SectionInputFit(estimator, np.full((3, 3), 6.0), np.eye(3), fit)
    # Two frames are 2 counts from rest, and the third's contact is not found.
    assert own.chi2("geometry.thickness", 0.1) == pytest.approx(2 * 2.0**2 + 100.0)
    assert tried == [[4.0, 6.0, 20.0], pytest.approx([4.8, 16.0]), pytest.approx([12.0])]


def test_measured_over_model_weighs_large_readings_most() -> None:
    model = np.linspace(1.0, 10.0, 10)
    measured = 1.3 * model
    measured[0] = 1.2
    found = section_log._ratio(measured, model)
    assert found is not None
    weight = measured**2
    mean = (weight * measured / model).sum() / weight.sum()
    error = np.sqrt((weight**2 * (measured / model - mean) ** 2).sum()) / weight.sum()
    np.testing.assert_allclose(found, [mean, error], rtol=1e-12)
    assert section_log._ratio(1.009 * model, model) is None  # one per cent at least
    assert section_log._ratio(1.011 * model, model) is not None
    scattered = np.where(np.arange(10) % 2, 1.4, 0.8) * model
    assert section_log._ratio(scattered, model) is None  # within four deviations
    assert section_log._ratio(measured[:7], model[:7]) is None  # eight at least
    measured[3] = np.nan
    measured[4] = -1.0
    measured[5] = 0.0
    assert section_log._ratio(measured, model) is None


@pytest.mark.parametrize("noise", [False, True])
def test_what_explains_a_log_is_named_however_small(
    monkeypatch: pytest.MonkeyPatch, noise: bool
) -> None:
    slopes, none = RNG.normal(scale=100, size=(10, 2, 6)), SimpleNamespace()
    errors = SimpleNamespace(names=("geometry.thickness", "electrodes.lsb"))
    model = SimpleNamespace(by_errors=lambda *_: slopes)
    monkeypatch.setattr(section_log, "default_errors", lambda _: errors)
    monkeypatch.setattr(section_log, "InputSlopes", lambda *_: model)
    as_given = SimpleNamespace(best=lambda gain: gain)
    monkeypatch.setattr(section_log, "SectionInputFit", lambda *_: as_given)
    estimator: Any = SimpleNamespace(
        input_errors=SimpleNamespace(spec=none), skin=none, rest=None
    )
    fit: Any = SimpleNamespace(
        parameters=np.zeros((10, 2)), state=none, so=0.0, jacobian=RNG.normal(size=(10, 2, 6))
    )
    # 0.3 of one per cent of the scale, and a share of the thickness beside it.
    y = 0.3 * slopes[:, 1] + 0.4 * slopes[:, 0]
    named = section_log._explaining(estimator, y, np.ones_like(y), fit, noise=noise)
    changes = {x.name: x.change for x in named}
    assert changes["geometry.thickness"] == pytest.approx(0.4 * 0.03, rel=0.5)
    assert ("electrodes.lsb" in changes) is not noise


@pytest.mark.parametrize(
    ("frames", "taxels", "chi2_per_dof", "right"),
    # Of few readings chance leaves more; of many no model is right to the last digit.
    [(12, 5, 1.0, True), (12, 5, 1.5, True), (12, 5, 3.5, False), (64, 40, 1.15, True)],
)
def test_a_file_is_right_that_leaves_noise_in_the_fits_that_have_settled(
    monkeypatch: pytest.MonkeyPatch, frames: int, taxels: int, chi2_per_dof: float, right: bool
) -> None:
    lost = 4
    chi2, left = np.full(frames, (taxels - 2) * chi2_per_dof), np.zeros(frames)
    chi2[lost], left[lost] = 1_000.0, 700.0

    def rows(index: np.ndarray) -> SimpleNamespace:
        return SimpleNamespace(
            chi2=chi2[index], parameters=np.zeros((len(index), 2)), pressure=None
        )

    fit = SimpleNamespace(chi2=chi2, predicted_decrease=left, rows=rows)
    monkeypatch.setattr(section_log, "_single", lambda *_: fit)
    monkeypatch.setattr(section_log, "_shifted", lambda *_: None)
    monkeypatch.setattr(section_log, "_explaining", lambda *_, noise: [])
    monkeypatch.setattr(section_log, "_wide", lambda *_: Gain(0.0, "width", 0.0, np.inf))
    estimator: Any = SimpleNamespace(weigh=lambda so, _: (so, np.ones_like(so)))
    contact = SimpleNamespace(spread=False, arc_force=None)
    estimates: Any = [SimpleNamespace(status="ok", contacts=[contact])] * frames
    so = np.zeros((frames, taxels))
    found = section_log.section_verdict(
        estimator, so, so > 0, estimates, pressure=None, force=None
    )
    assert found is not None
    assert found.right is right
    assert found.chi2_per_dof == pytest.approx(chi2_per_dof)


def test_a_pull_on_a_pad_says_nothing_of_the_file() -> None:
    # Frames are fitted again as pushes: what that leaves of a pull was blamed on the file.
    fitter = PadFitter.__new__(PadFitter)
    estimator: Any = SimpleNamespace(selection=SimpleNamespace(fitter=fitter), direction=False)
    pushes = [LoadEstimate(True, (Contact(0.1, 2.0, None, None),), status="ok")] * (FEWEST - 1)
    pull = LoadEstimate(True, (Contact(0.1, -2.0, None, None),), status="no_convergence")
    so = np.zeros((FEWEST, 5))
    assert skin_file.model_verdict(estimator, so, so > 0, None, [*pushes, pull]) is None


@pytest.mark.parametrize("shift", [-2, -1, 1, 2])
def test_readings_moved_by_a_column_are_found_out(shift: int) -> None:
    y = dimple_readings([[-0.3, 12.0], [0.0, 9.0], [0.25, 12.0]])
    moved = np.roll(y - AT_REST, -shift, 1) + AT_REST
    selection = Selection(DimpleFitter(), DimpleNodes(), 20.0, 1)
    estimator: Any = SimpleNamespace(model_rest=AT_REST, selection=selection)
    weight = np.ones_like(y)
    found = section_log._shifted(estimator, moved, weight, 50.0)
    assert found is not None
    assert found.shift == shift
    assert found.chi2_per_dof == 50.0
    assert found.explained < 0.1
    # A shift must explain far better than none.
    assert section_log._shifted(estimator, moved, weight, 2 * found.explained) is not None
    assert section_log._shifted(estimator, moved, weight, 1.9 * found.explained) is None


# --- weighing and drift -------------------------------------------------------------------


def test_readings_are_weighed_by_noise_drift_and_the_model_s_own_error() -> None:
    weights = ReadingWeights(
        zero=np.array([10.0, 20.0, np.nan]),
        variance=np.array([4.0, 9.0, 1.0]),
        model_rest=np.array([1000.0, 1000.0, 1000.0]),
        model_error=0.01,
        pressure_noise=50.0,
        beside=False,
    )
    assert weights.taxels == 3
    so = np.array([[1210.0, 1020.0, 1000.0], [65535.0, np.nan, 1.0]])
    y, weight = weights.weigh(so)
    assert y.tolist() == [[1200.0, 1000.0, 0.0], [0.0, 0.0, 0.0]]
    np.testing.assert_allclose(weight, [[1 / (4 + 4), 1 / 9, 0.0], [0.0, 0.0, 0.0]])
    drift = Drift(np.array([[5.0, 0.0, 0.0]]), np.array([[2.0, 0.0, 0.0]]))
    y, weight = weights.weigh(so[:1], np.array([[False, True, False]]), drift=drift)
    assert y.tolist() == [[1195.0, 0.0, 0.0]]
    np.testing.assert_allclose(weight, [[1 / (6 + 1.95**2), 0.0, 0.0]])
    change = weights.change_from_rest(so, np.zeros((2, 3), bool))
    np.testing.assert_array_equal(change, [[200.0, 0.0, np.nan], [np.nan] * 3])


def test_a_measured_pressure_is_one_more_channel() -> None:
    weights = ReadingWeights(np.zeros(1), np.ones(1), np.full(1, 1e3), 0.01, 50.0, True)
    so = np.full((3, 1), 1000.0)
    y, weight = weights.weigh(so, pressure=np.array([3000.0, np.nan, -3000.0]))
    assert y[:, 1].tolist() == [3000.0, 0.0, -3000.0]
    np.testing.assert_allclose(weight[:, 1], [1 / (2500 + 900), 0.0, 1 / (2500 + 900)])
    assert weights.weigh(so)[1][:, 1].tolist() == [0.0] * 3
    never = dataclasses.replace(weights, pressure_noise=np.inf)
    assert never.weigh(so, pressure=np.full(3, 1.0))[1][:, 1].tolist() == [0.0] * 3


def test_a_pressure_speaks_against_contacts_beyond_what_their_forces_leave_open() -> None:
    covariance = np.diag([1e-4, 0.5**2])
    contacts = (Contact(0.0, 6.0, None, covariance), Contact(0.5, 4.0, None, covariance))
    estimate = LoadEstimate(True, contacts, 2000.0, status="ok")
    # Both forces are known to 10 %, together: 200 Pa, and the measurement to 20 Pa.
    limit, weight = 3.5 * np.hypot(200, 20), np.array([1.0, 20.0**-2])
    for off, doubted in ((0.99 * limit, False), (-1.01 * limit, True)):
        channels = np.array([1000.0, 2000.0 + off])
        assert contradicted(estimate, channels, weight) == doubted
        (found,) = with_doubts([estimate], channels[None], weight[None])
        assert found.status == ("ambiguous" if doubted else "ok")
    assert not contradicted(estimate, np.zeros(2), np.zeros(2))


def test_zero_of_readings_is_the_baseline_s_or_the_calibration_s() -> None:
    rest = np.array([1000.0, 1001.0])
    spec: Any = SimpleNamespace(calibration=None)
    zero, variance = zero_of_readings(spec, rest, np.array([1010.0, 1005.0]), 0.5)
    assert zero.tolist() == [10.0, 4.0]
    assert variance.tolist() == 0.5
    assert [x.tolist() for x in zero_of_readings(spec, rest, None, 0.5)] == [[0.0, 0.0]] * 2
    spec.calibration = CalibrationSpec(offsets=(3.0, -2.0), offset_errors=(0.5, np.nan))
    zero, variance = zero_of_readings(spec, rest, None, 0.5)
    assert zero.tolist() == [3.0, -2.0]
    assert variance.tolist() == [0.25, 0.0]
    spec.calibration = CalibrationSpec(offsets=(3.0,))
    with pytest.raises(ValueError, match="1 numbers for the skin's 2 taxels"):
        zero_of_readings(spec, rest, None, 0.5)


def test_walk_of_the_readings_at_rest_grows_with_time() -> None:
    rest = np.array([1000.0, 2000.0])
    found = DriftDensities(taxel=0.1, common=0.2, gain=1e-3, before=1.0).walk(rest, 3.0)
    own, shared = 0.01 * np.eye(2), 0.04 + 1e-6 * np.outer(rest, rest)
    whole = np.diag(found.own) + found.shared @ found.shared.T
    np.testing.assert_allclose(whole, 3 * (own + shared), rtol=1e-12)


def test_sizes_of_a_drift_are_mean_and_largest() -> None:
    drift = Drift(np.array([[1.0, -5.0, 1.0], [2.0, 2.0, 2.0]]), np.zeros((2, 3)))
    assert drift.sizes() == [(-1.0, -5.0), (2.0, 2.0)]
    assert drift.rows(slice(1, 2)).sizes() == [(2.0, 2.0)]


# --- filter -------------------------------------------------------------------------------


def estimate(angle: float, force: float, systematic: Any = None) -> LoadEstimate:
    """One contact with a covariance of 1e-4 rad^2 and 4 N^2."""
    return LoadEstimate(
        True, (Contact(angle, force, None, np.diag([1e-4, 4.0]), systematic=systematic),)
    )


def test_filter_is_kalman_s_with_constant_velocity() -> None:
    follower, dt = LoadFilter(angle_density=2.0, force_density=300.0), 0.1
    follower.feed(1.0, estimate(0.1, 5.0))
    (found,) = follower.feed(1.0 + dt, estimate(0.11, 6.0))
    assert found.covariance is not None
    for k, (density, rate, noise, values) in enumerate(
        ((2.0, 1.0, 1e-4, (0.1, 0.11)), (300.0, 400.0, 4.0, (5.0, 6.0)))
    ):
        move = np.array([[1.0, dt], [0.0, 1.0]])
        driven = density * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        before = move @ np.diag([noise, rate]) @ move.T + driven
        gain = before[:, 0] / (before[0, 0] + noise)
        mean = values[0] + gain[0] * (values[1] - values[0])
        variance = before[0, 0] * (1 - gain[0])
        assert (found.angle, found.force)[k] == pytest.approx(mean, rel=1e-10)
        assert found.covariance[k, k] == pytest.approx(variance, rel=1e-9)


def test_filter_leaves_what_a_calibration_leaves_open() -> None:
    follower, shared = LoadFilter(), np.diag([0.0, 3.0])
    for k in range(40):
        (found,) = follower.feed(0.01 * k, estimate(0.1, 5.0, shared))
    assert found.covariance is not None
    assert 3.0 < found.covariance[1, 1] < 4.0


def test_filter_begins_a_track_beyond_five_deviations_and_at_no_covariance_none() -> None:
    follower = LoadFilter()
    follower.feed(0.0, estimate(0.1, 5.0))
    (other,) = follower.feed(0.0, estimate(0.1 + 0.0708, 5.0))  # sqrt(2) deviations make 5
    assert other.angle == pytest.approx(0.1708)
    (same,) = follower.feed(0.0, estimate(0.1708 + 0.07, 5.0))
    assert same.angle == pytest.approx(0.1708 + 0.035)
    unknown = LoadEstimate(True, (Contact(0.1, 5.0, None, None),))
    assert follower.feed(1.0, unknown) == []
    assert follower.feed(1.0, LoadEstimate(None)) == []


def test_filter_follows_a_pad_s_axial_position() -> None:
    follower = LoadFilter()
    noise = np.diag([1e-4, 1e-6, 4.0])

    def frame(axial: float) -> LoadEstimate:
        return LoadEstimate(True, (Contact(0.1, 5.0, None, noise, axial=axial),))

    follower.feed(0.0, frame(0.0))
    (found,) = follower.feed(0.1, frame(1e-3))
    before = 1e-6 + 3.5e-3 * (0.1**2 + 0.1**3 / 3)
    gain = before / (before + 1e-6)
    assert found.axial == pytest.approx(gain * 1e-3, rel=1e-9)
    assert found.covariance is not None
    assert found.covariance[1, 1] == pytest.approx(before * (1 - gain), rel=1e-9)


# --- estimates ----------------------------------------------------------------------------


CIRCLE = CircleSpec(
    inner_radius=58.5e-3, half_angle=1.5, thickness=1.5e-3, width=0.1, oil_gap=5e-3
)
ROUND = ContactPlaces.of(CIRCLE, plain_geometry(CIRCLE))
"""Places on a skin of 60 mm."""


@pytest.mark.parametrize("section", ["ellipse", "path"])
def test_a_contact_s_place_is_the_one_that_scenes_state(section: str) -> None:
    """By the section itself; slopes by differences, which covariances are scaled by."""
    half = [{"line": "15 mm"}, {"radius": "35 mm", "angle": "80 deg"}, {"line": "9 mm"}]
    shapes: dict[str, dict[str, Any]] = {
        "ellipse": {"inner_semi_axes": ["57.5 mm", "40 mm"], "half_angle": "85 deg"},
        "path": {"path": half, "start": "80 deg", "mirror": True},
    }
    spec = shaped({"section": section, **shapes[section]}).geometry
    geometry = plain_geometry(spec)
    places, at = ContactPlaces.of(spec, geometry), np.linspace(-1.4, 1.4, 23)
    exact, angle = geometry.section, jnp.asarray(at)[:, None]
    assert places.arc(at) == pytest.approx(np.asarray(exact.arc(angle))[:, 0], abs=1e-9)
    told = {"ellipse": exact.given_angle, "path": exact.arc}[section](angle)
    assert places.estimated(at) == pytest.approx(np.asarray(told)[:, 0], abs=1e-9)
    step = 1e-4
    slope = (places.estimated(at + step) - places.estimated(at - step)) / (2 * step)
    assert places.slope(at) == pytest.approx(slope, rel=1e-5)
    # What presses were felt to be off by is taken off places; the clamp stays where it is.
    even = PlaceShiftSpec(angles=(0.0,), shifts=(0.02,), covariance=((1e-6,),))
    told = ContactPlaces.of(spec, geometry, PlaceShift(even))
    for name in ("angle", "arc", "outer_arc", "inner_arc", "estimated"):
        assert getattr(told, name)(at + 0.02) == pytest.approx(getattr(places, name)(at))
    assert told.edge == places.edge
    kind = {"ellipse": "angle", "path": "arc"}[section]
    assert told.from_place(kind, told.estimated(at)) == pytest.approx(at, abs=1e-6)


def test_a_shift_along_the_arc_is_taken_off_and_put_on_again() -> None:
    """Between its places by straight lines, as its covariance is; even beyond them."""
    covariance = np.array([[4e-4, 1e-4], [1e-4, 9e-4]])
    record = PlaceShiftSpec(
        angles=(-1.0, 1.0), shifts=(0.02, -0.04), covariance=tuple(map(tuple, covariance))
    )
    shift, at = PlaceShift(record), np.array([-1.3, -1.0, 0.5, 1.0, 1.2])
    expected = [0.02, 0.02, -0.025, -0.04, -0.04]
    assert shift.felt(at) - at == pytest.approx(expected)
    assert shift.taken_off(shift.felt(at)) == pytest.approx(at)
    weights = np.array([[0.25, 0.75], [1.0, 0.0]])
    own = shift.covariance(shift.felt(np.array([[0.5, -1.2]])))[0]
    assert own == pytest.approx(weights @ covariance @ weights.T)
    for wrong, said in (
        ({"shifts": (0.02, -3.0)}, "ascending order"),
        ({"shifts": (0.02,)}, "2 are needed, one for each of angles"),
        ({"covariance": ((1.0, np.nan), (0.0, 1.0))}, "finite"),
    ):
        with pytest.raises(ValueError, match=said):
            PlaceShiftSpec(**record.model_dump() | wrong)


class FarNodes(DimpleNodes):
    """Nodes of which every taxel is near."""

    def distance(self, a: Any, b: Any) -> np.ndarray:
        """None."""
        return np.zeros(len(a))


class OnAPad(DimpleNodes):
    """Nodes on a cylinder of 60 mm."""

    def distance(self, a: Any, b: Any) -> np.ndarray:
        """Along arc and axis."""
        return np.asarray(np.hypot(0.06 * (a - b)[..., 0], (a - b)[..., 1]))


class Fitter(DimpleFitter):
    """A skin whose wall is reached at 20 N (1 + angle), and may be with 0.1 mm left."""

    edge = np.array([0.5])
    wall_gap = 1e-4


def assessed(
    parameters: Any,
    deviation: float = 0.1,
    *,
    contacts: int = 1,
    chi2: float = 11.0,
    other: Alternative | None = None,
    full_scale: bool = False,
    systematic: Any = None,
    nodes: Any = None,
    **fields: Any,
) -> LoadEstimate:
    """The estimate of one frame of 13 taxels, forces with a deviation, angles of 0.01 rad."""
    x = np.atleast_2d(np.asarray(parameters, float))
    sigma = np.repeat([0.01, deviation], contacts)
    best = explanations(
        x,
        contacts=contacts,
        so=np.zeros((1, 13)),
        information=np.diag(1 / sigma**2)[None],
        chi2=chi2,
        **fields,
    )
    one = LoadAssessment(Fitter(), nodes or FarNodes(), ROUND, TAXELS[:, None])
    shared = None if systematic is None else np.diag(systematic)[None]
    (found,) = one.estimates(best, [other], np.full((1, 13), full_scale), shared)
    return found


def test_an_estimate_has_the_fit_s_covariance_and_chi2_per_degree_of_freedom() -> None:
    found = assessed([0.2, 5.0], systematic=[0.0, 0.16])
    (contact,) = found.contacts
    assert (found.status, found.chi2_per_dof) == ("ok", 1.0)
    assert contact.arc_position == pytest.approx(0.012)
    assert contact.covariance is not None
    assert contact.noise_covariance is not None
    np.testing.assert_allclose(np.diag(contact.covariance), [1e-4, 0.17], rtol=1e-9)
    np.testing.assert_allclose(np.diag(contact.noise_covariance), [1e-4, 0.01], rtol=1e-9)
    assert contact.deviation("force") == pytest.approx(np.sqrt(0.17))
    assert found.at_least is None
    # A poor fit widens the noise's part by its ratio.
    poor = assessed([0.2, 5.0], chi2=55.0)
    assert poor.status == "poor_fit"
    assert poor.contacts[0].covariance is not None
    assert poor.contacts[0].covariance[1, 1] == pytest.approx(0.05)


MODE = Alternative(15.0, np.array([-0.3, 4.0]), np.diag([1e4, 100.0]), 1)


@pytest.mark.parametrize(
    ("status", "parameters", "options"),
    [
        ("ok", [0.2, 5.0], {}),
        ("no_convergence", [0.2, 5.0], {"chi2": np.inf}),
        ("no_convergence", [0.2, 5.0], {"predicted_decrease": np.array([0.11])}),
        ("ok", [0.2, 5.0], {"predicted_decrease": np.array([0.09])}),
        ("poor_fit", [0.2, 5.0], {"chi2": stats.chi2.isf(0.9e-4, 11)}),
        ("ok", [0.2, 5.0], {"chi2": stats.chi2.isf(1.1e-4, 11)}),
        ("model_mismatch", [0.2, 5.0], {"chi2": 99.1}),
        ("poor_fit", [0.2, 5.0], {"chi2": 98.9}),
        ("wall_contact", [0.2, 5.0], {"chi2": 99.1, "full_scale": True}),
        ("wall_contact", [0.0, 19.61], {"chi2": 99.1}),
        ("model_mismatch", [0.0, 5.0], {"chi2": 705.0, "deviation": 1.0}),  # at least 0 N
        ("wall_contact", [0.2, 5.0], {"full_scale": True}),
        ("wall_contact", [0.2, 5.0], {"min_gap": np.full(1, 0.9e-4)}),
        ("ok", [0.2, 5.0], {"min_gap": np.full(1, 1.1e-4)}),
        ("wall_contact", [0.0, 19.61], {}),  # within 2 deviations and 1 % of 20 N
        ("ok", [0.0, 19.59], {}),
        ("at_edge", [0.5, 5.0], {}),
        ("at_edge", [0.5, 5.0], {"predicted_decrease": np.array([0.11])}),
        ("no_convergence", [0.5, 5.0], {"predicted_decrease": np.array([0.11]), "chi2": 60.0}),
        ("pull", [0.2, -5.0], {}),
        ("ambiguous", [0.2, 5.0], {"other": MODE}),
        ("ok", [0.2, 5.0], {"other": MODE._replace(chi2=17.1)}),
        ("imprecise", [0.2, 5.0], {"deviation": 1.01}),
        ("ok", [0.2, 5.0], {"deviation": 0.99}),
    ],
)
def test_statuses_and_their_thresholds(
    status: str, parameters: list[float], options: dict[str, Any]
) -> None:
    assert assessed(parameters, **options).status == status


def test_no_error_is_stated_where_a_fit_ends_on_its_bound() -> None:
    for angle, known in ((0.499, True), (0.5, False)):
        (contact,) = assessed([angle, 5.0], systematic=[0.0, 0.16]).contacts
        assert (contact.covariance is not None) is known
        assert (contact.systematic is not None) is known


@pytest.mark.parametrize(
    ("place", "distance"),
    [([0.0, 0.0], -0.024), ([0.0, 0.05], 0.02), ([0.6, 0.03], 0.012), ([0.5, 0.06], 0.0306)],
)
def test_distance_of_a_place_beyond_the_taxels(place: list[float], distance: float) -> None:
    """Of a rectangle of +-0.4 rad at 60 mm by +-30 mm, one corner of which is not used."""
    corners = np.array([[-0.4, -0.03], [-0.4, 0.03], [0.4, -0.03], [0.4, 0.03], [0.5, 0.06]])
    one = LoadAssessment(Fitter(), OnAPad(), ROUND, corners)
    found = one._beyond(np.array(place), np.array([True] * 4 + [False]))
    assert found == pytest.approx(distance, rel=1e-2)


@pytest.mark.parametrize(("beyond", "status"), [(0.074, "ok"), (0.076, "at_edge")])
def test_a_contact_beyond_the_taxels_is_at_an_edge(beyond: float, status: str) -> None:
    """By more than half of 0.15 rad, within which contacts are one."""
    used = np.where(TAXELS < 0.25, 1.0, 0.0)  # the last at 0.2
    nodes = DimpleNodes()
    found = assessed([0.2 + beyond, 5.0], nodes=nodes, weight=used, chi2=5.0)
    assert found.status == status
    assert (found.contacts[0].covariance is None) == (status == "at_edge")


def test_at_the_wall_a_force_is_bounded_from_below() -> None:
    """95 % one-sided: 1.645 deviations less than the force, or than that of first contact.

    Noise adds to a force, errors that all frames share multiply it.
    """
    for force, bound in ((19.9, 19.9), (25.0, 20.0)):
        found = assessed([0.0, force], 0.5)
        assert found.status == "wall_contact"
        assert found.at_least == pytest.approx(bound - 1.645 * 0.5, rel=1e-4)
        assert found.contacts[0].covariance is None
    for shared in (0.5, 30.0):
        found = assessed([0.0, 25.0], 1e-6, systematic=[0.0, shared**2])
        assert found.at_least == pytest.approx(20 * np.exp(-1.645 * shared / 20), rel=1e-4)
    both = assessed([0.0, 25.0], 0.5, systematic=[0.0, 0.24])
    assert both.at_least == pytest.approx(20 - np.hypot(1.645 * 0.5, 0.78966), rel=1e-4)
    two = assessed([0.0, 0.1, 15.0, 3.0], 0.5, contacts=2, full_scale=True)
    assert two.at_least == pytest.approx(18.0 - 1.645 * np.sqrt(0.5), rel=1e-4)
    # One contact alone may bound better than both.
    sure = assessed([0.0, 0.1, 15.0, 0.1], 0.5, contacts=2, full_scale=True)
    assert sure.at_least == pytest.approx(15.0 - 1.645 * 0.5, rel=1e-4)
    assert len(sure.contacts) == 1  # the other's force is not twice its error
    assert len(two.contacts) == 2


def test_an_ambiguous_frame_has_its_other_load_beside() -> None:
    found = assessed([0.2, 5.0], other=MODE)
    (other,) = found.alternatives
    assert (other.angle, other.force) == (-0.3, 4.0)
    assert other.covariance is not None
    np.testing.assert_allclose(np.diag(other.covariance), [1e-4, 0.01], rtol=1e-9)


def test_a_wide_contact_is_ambiguous_where_two_explain_it_as_well() -> None:
    pair = Alternative(15.0, np.array([0.1, 0.3, 2.0, 3.0]), np.diag([1e4, 1e4, 1e2, 1e2]), 2)
    found = assessed([0.2, 5.0], other=pair)
    assert found.status == "ambiguous"
    assert [c.force for c in found.alternatives] == [2.0, 3.0]
    assert [c.angle for c in found.alternatives] == [0.1, 0.3]


def test_a_contact_is_imprecise_beyond_what_anybody_wants() -> None:
    def contact(**sigma: float) -> Contact:
        names = ("angle", "axial", "force", "direction", "tilt")
        small = {"angle": 1e-3, "axial": 1e-4, "force": 0.1, "direction": 0.01, "tilt": 0.01}
        both = small | sigma
        covariance = np.diag([both[name] ** 2 for name in names])
        return Contact(0.1, -5.0, 0.1, covariance, axial=0.0, tilt=0.1)

    assert not contact().imprecise
    limits = {"angle": np.deg2rad(2), "axial": 2e-3, "force": 1.0}
    limits |= {"direction": np.deg2rad(10), "tilt": np.deg2rad(10)}
    for name, limit in limits.items():
        assert not contact(**{name: 0.99 * limit}).imprecise
        assert contact(**{name: 1.01 * limit}).imprecise
        assert contact(**{name: 0.0}).imprecise
    # What is the same in all frames is not a frame's fault.
    shared = np.diag([0.0, 4.0])
    own = np.diag([1e-6, 1e-2])
    assert not Contact(0.1, 5.0, None, own + shared, systematic=shared).imprecise
    assert Contact(0.1, 5.0, None, own + shared).imprecise
    assert Contact(0.1, 5.0, None, None).imprecise
    assert np.isnan(Contact(0.1, 5.0, None, None).deviation("force"))


def test_loads_of_a_frame_are_an_array_with_their_covariances() -> None:
    own = np.arange(9.0).reshape(3, 3)
    contacts = (Contact(0.1, 5.0, 0.3, own), Contact(0.2, 6.0, None, None))
    found = load_array(contacts, ("angle", "force", "direction"))
    assert found["angle_rad"].tolist() == [0.1, 0.2]
    assert found["force_N"].tolist() == [5.0, 6.0]
    np.testing.assert_array_equal(found["direction_rad"], [0.3, np.nan])
    np.testing.assert_array_equal(found["covariance"][0], own)
    assert np.isnan(found["covariance"][1]).all()
    fewer = load_array(contacts[:1], ("force", "axial"))
    np.testing.assert_array_equal(fewer["covariance"][0], [[own[1, 1], np.nan], [np.nan] * 2])


# --- posterior ----------------------------------------------------------------------------


class Flat(AbstractLoadPosterior):
    """A prior even over a volume."""

    def log_probability(self, y: Any, mode: Any) -> Any:
        """Not needed."""
        raise NotImplementedError


def stand_in_estimator(volume: float = 50.0) -> Any:
    """What evidence and names of modes ask of an estimator."""
    selection = SimpleNamespace(fitter=DimpleFitter())
    posterior = Flat(DimpleNodes(), 1, volume, 0.02, np.array([[-1.0]]))
    return SimpleNamespace(selection=selection, posterior=posterior)


def mode(parameters: Any, sigma: Any, chi2: float = 3.0) -> Any:
    """One explanation with these deviations."""
    count = len(parameters) // 2
    information = np.diag(1 / np.square(sigma))[None]
    return explanations([parameters], contacts=count, information=information, chi2=chi2)


def test_evidence_of_a_mode_is_its_gaussian_integral_over_the_prior() -> None:
    estimator = stand_in_estimator()
    one = mode([0.1, 5.0], [0.01, 0.2])
    expected = np.exp(-1.5) * 2 * np.pi * 0.01 * 0.2 / 50.0
    assert np.exp(frame_posterior._log_evidence(estimator, one)) == pytest.approx(expected)
    two = mode([0.1, 0.4, 5.0, 6.0], [0.01, 0.02, 0.2, 0.1])
    expected = np.exp(-1.5) * (2 * np.pi) ** 2 * (0.01 * 0.02 * 0.2 * 0.1) * 2 / 50.0**2
    assert np.exp(frame_posterior._log_evidence(estimator, two)) == pytest.approx(expected)
    # A mode is not wider than its prior.
    wide = mode([0.1, 5.0], [10.0, 100.0])
    assert frame_posterior._log_evidence(estimator, wide) == pytest.approx(-1.5)


def test_probabilities_of_a_frame_s_modes_are_shares_of_their_evidence() -> None:
    estimator = stand_in_estimator()
    estimator.selection = Selection(DimpleFitter(), DimpleNodes(), 20.0, 2)
    y = dimple_readings([-0.25, 0.3, 8.0, 7.0], 2)
    weight = np.full((1, 13), 4e-4)  # so noisy that either contact may be all there is
    found, probability = frame_posterior.likely_modes(estimator, y, weight)
    rows = [found.rows(np.array([i])) for i in range(len(found))]
    log = np.array([frame_posterior._log_evidence(estimator, one) for one in rows])
    assert len(log) > 1
    np.testing.assert_allclose(probability, np.exp(log) / np.exp(log).sum(), rtol=1e-9)
    assert (np.diff(probability) <= 0).all()
    with pytest.raises(ValueError, match="determine no load"):
        frame_posterior.likely_modes(estimator, y, 0 * weight)


def test_modes_are_distinct_where_contacts_are_felt_and_apart() -> None:
    estimator = stand_in_estimator()
    sigma = [0.01, 0.01, 1.0, 1.0]
    for parameters, distinct in (
        ([0.1, 0.4, 5.0, 2.1], True),
        ([0.1, 0.4, 5.0, 1.9], False),
        ([0.1, 0.176, 5.0, 5.0], True),
        ([0.1, 0.174, 5.0, 5.0], False),
    ):
        assert frame_posterior._distinct(estimator, mode(parameters, sigma)) == distinct
    assert frame_posterior._distinct(estimator, mode([0.1, 0.5], [0.01, 1.0]))  # one alone
    assert not frame_posterior._distinct(estimator, mode([0.1, 5.0], [np.inf, 1.0]))


def test_kinds_of_modes() -> None:
    estimator = stand_in_estimator()
    best: Any = SimpleNamespace(contacts=1, parameters=np.array([0.3, 5.0]))
    for parameters, kind in (
        ([-0.29, 4.0], "mirror"),
        ([-0.1, 4.0], "place"),
        ([0.1, 0.4, 5.0, 6.0], "contacts"),
    ):
        one = mode(parameters, [0.01] * len(parameters))
        assert frame_posterior._kind(estimator, best, one) == kind
    a, b, c = (mode([x, 0.4, 5.0, 6.0], [0.01] * 4) for x in (0.1, 0.119, 0.121))
    assert frame_posterior._same(estimator, a, b)
    assert not frame_posterior._same(estimator, a, c)
    swapped = mode([0.4, 0.1, 6.0, 5.0], [0.01] * 4)
    assert frame_posterior._same(estimator, a, swapped)
    assert not frame_posterior._same(estimator, a, mode([0.1, 5.0], [0.01] * 2))


# --- range --------------------------------------------------------------------------------


def test_least_errors_are_the_bound_of_cramer_and_rao() -> None:
    jacobian = np.stack([SLOPES, 2 * SLOPES], -1)  # [parameter, taxel, force]
    weight = np.tile(WEIGHT[:, None], (1, 2))
    found = least_errors(jacobian, weight)
    expected = np.sqrt(np.diag(np.linalg.inv((SLOPES * WEIGHT) @ SLOPES.T)))
    np.testing.assert_allclose(found, np.stack([expected, expected / 2], 1), rtol=1e-9)
    assert least_errors(jacobian, 0 * weight).tolist() == [[np.inf] * 2] * 2


def test_a_force_of_first_contact_is_as_uncertain_as_what_makes_the_gap() -> None:
    """Of a spring: gap = oil gap - force / (k thickness^3), inputs with their defaults."""
    spec = load_skin(Path(__file__).parent.parent / "configs" / "skins" / "suas.toml")
    known = continuous_inputs(spec)
    stiff, names = 1e12, ("thickness", "oil_gap")

    def smallest_gap(inputs: Mapping[str, float], force: float) -> float:
        t, gap = ({**known, **inputs}[f"geometry.{name}"] for name in names)
        assert not any(path.startswith("electrodes.") for path in inputs)
        return gap - force / (stiff * t**3)

    force = stiff * known["geometry.thickness"] ** 3 * known["geometry.oil_gap"]
    errors = input_errors(spec)
    relative = {
        name: errors.directions[:, errors.paths.index(f"geometry.{name}")]
        / known[f"geometry.{name}"]
        for name in names
    }
    # At 0.9 of the force the gap moves by 3 x 0.9 of a relative error of the thickness.
    expected = np.sqrt(np.sum((relative["oil_gap"] + 2.7 * relative["thickness"]) ** 2))
    assert contact_deviation(spec, force, smallest_gap) == pytest.approx(expected, rel=1e-5)
    assert np.isnan(contact_deviation(spec, np.nan, smallest_gap))


def test_the_smallest_force_told_lies_below_and_between_those_evaluated() -> None:
    force = np.array([1.0, 4.0, 16.0])
    even = [0.1, 0.1, 9.0]  # as by noise alone: 0.5 N is told to a fifth
    rising = [0.8, 0.4, 1.0]  # of 80 % at 1 N and 10 % at 4 N: a power of -3/2
    lost = [np.nan, 0.4, 1.0]
    found = smallest_told(np.array([force] * 4), np.array([even, rising, lost, [9.0] * 3]))
    np.testing.assert_allclose(found, [0.5, 4 ** (2 / 3), 4.0, np.nan], rtol=1e-12)


def test_range_is_from_the_first_force_told_to_the_last() -> None:
    force = np.array([[1.0, 2.0, 4.0, 8.0]] * 3)
    # The last: 2 N are told and 8 N, which lie on the wall, but not 4 N at first contact.
    error = np.array([[0.15, 0.4, 0.5, 3.0], [1.0, 1.0, 1.0, 9.0], [0.9, 0.1, 3.0, 0.1]])
    saturated = np.zeros((3, 4, 3), bool)
    saturated[0, 2:, 1] = True
    zero = np.zeros_like(force)
    found = ForceRange(
        np.array([0.0, 0.1, 0.2]),
        np.array([6.0, np.nan, 4.0]),
        np.array([1e3, np.nan, 1e3]),
        force,
        error,
        zero + 0.01,
        zero,
        saturated,
        1.0,
        True,
        ROUND,
        0.05,
    )
    assert found.told[0].tolist() == [True, True, True, False]
    between = 2 ** (1 - np.log(4) / np.log(18))  # 90 % at 1 N, 5 % at 2 N
    np.testing.assert_allclose(found.smallest, [0.75, np.nan, between], rtol=1e-12)
    np.testing.assert_array_equal(found.largest, [4.0, np.nan, 2.0])
    np.testing.assert_array_equal(found.saturation, [4.0, np.nan, np.nan])
    _, shown, note = _section_rows(found)
    assert [row[1] for row in shown] == ["6", "–", "4"]
    assert note is not None
    assert "no load there brings the membrane to the wall" in note
    rows = found.report()["angles"]
    assert rows[0]["first_contact"] == {
        "force_N": 6.0,
        "low95_N": pytest.approx(6.0 * np.exp(-0.098)),
        "high95_N": pytest.approx(6.0 * np.exp(0.098)),
        "oil_pressure_Pa": 1e3,
    }
    assert rows[1]["first_contact"] is None
    assert [p["wall_contact"] for p in rows[0]["points"]] == [False, False, False, True]
    assert [p["saturated_taxels"] for p in rows[0]["points"]] == [0, 0, 1, 1]
    assert rows[1]["angle_deg"] == pytest.approx(np.rad2deg(0.1))


@pytest.mark.parametrize(("elements", "edge"), [(40, 1.42), (30, 1.4)])
def test_places_of_a_range_end_two_thicknesses_and_an_element_from_the_clamps(
    elements: int, edge: float
) -> None:
    geometry = SimpleNamespace(half_angle=[1.5], thickness=[2e-3], mid_size=[50e-3])
    skin: Any = SimpleNamespace(geometry=geometry, elements=elements)
    np.testing.assert_allclose(force_bound.angles_over(skin, 3), [-edge, 0, edge], atol=1e-15)


def test_first_contact_is_where_the_gap_closes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of gaps 1 - F / F_0; one never closes, and some have no state from a force on."""
    # The gap of no state at all says nothing, even if it is closed.
    touch = np.array([3e-2, 7.0, 4e3, np.inf, 50.0, 5e-5, 70.0])
    last = np.array([np.inf, np.inf, np.inf, np.inf, 20.0, 1e-4, 75.0])

    def solved(skin: Any, angle: Any, force: Any) -> Any:
        gap = 1 - np.minimum(force, last) / touch
        return gap, 2 * force, None, np.where(force > last, 3, 0)

    monkeypatch.setattr(force_bound, "_solved", solved)
    skin: Any = None
    force, pressure = force_bound.first_contacts(skin, np.zeros(7))
    expected = np.array([3e-2, 7.0, 4e3, np.nan, np.nan, np.nan, 70.0])
    np.testing.assert_allclose(force, expected, rtol=1e-4)
    np.testing.assert_allclose(pressure, 2 * expected, rtol=2e-2)


def test_first_contact_is_close_enough_for_its_derivatives(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of a curved gap whose slope a search takes there: an error of 1e-4 was one of 1e-3."""
    touch = np.array([0.3, 7.0, 45.0])

    def solved(skin: Any, angle: Any, force: Any) -> Any:
        return 1 - (force / touch) ** 1.5, force, None, np.zeros(3)

    monkeypatch.setattr(force_bound, "_solved", solved)
    skin: Any = None
    found = force_bound.first_contacts(skin, np.zeros(3))[0]
    np.testing.assert_allclose(found, touch, rtol=1e-8)


def test_a_range_weighs_readings_by_noise_rounding_and_the_model_s_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of two taxels, whose readings are linear in place and force."""
    spec = load_skin(Path(__file__).parent.parent / "configs" / "skins" / "suas.toml")
    rest, slopes = np.array([200.0, 300.0]), np.array([[900.0, -400.0], [7.0, 5.0]])
    touch = np.array([10.0, np.nan, 30.0])

    def sensitivities(skin: Any, angle: Any, force: Any) -> Any:
        so = rest[:, None, None] + slopes[1][:, None, None] * force
        jacobian = np.broadcast_to(slopes[..., None, None], (2, 2, *force.shape)).copy()
        return so, jacobian, 0 * force, np.isnan(force)[None]

    def solved(skin: Any, angle: Any, force: Any) -> Any:
        so = np.tile(rest[:, None], len(angle))
        return SimpleNamespace(so=so, result=np.zeros(len(angle), int))

    monkeypatch.setattr(force_bound, "first_contacts", lambda skin, angle: (touch, touch))
    monkeypatch.setattr(force_bound, "_sensitivities", sensitivities)
    monkeypatch.setattr(force_bound, "_solved", solved)
    monkeypatch.setattr(force_bound, "_deviation", lambda *given: 0.1)
    found = force_bound.force_range(spec, 3, noise=3.0)
    force = found.force[0]
    np.testing.assert_allclose(
        force[: len(force_bound.LADDER)], 10 * np.array(force_bound.LADDER)
    )
    assert found.noise == pytest.approx(np.sqrt(9 + 1 / 12))
    variance = 9 + 1 / 12 + (force_bound.MODEL_ERROR * slopes[1][:, None] * force) ** 2
    for k in range(len(force)):
        covariance = np.linalg.inv((slopes / variance[:, k]) @ slopes.T)
        errors = found.angle_error[0, k], found.force_error[0, k]
        np.testing.assert_allclose(errors, np.sqrt(np.diag(covariance)))
    assert np.isnan(found.force_error[1]).all()


def test_what_is_unsure_of_first_contact_is_found_nearest_to_the_middle(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    spec = load_skin(Path(__file__).parent.parent / "configs" / "skins" / "suas.toml")
    asked: list[float] = []

    def deviation(spec: Any, force: float, smallest_gap: Any) -> float:
        asked.extend((force, smallest_gap({}, 2.0)))
        return 0.07

    def solved(skin: Any, angle: Any, force: Any) -> Any:
        return SimpleNamespace(min_gap=force * angle, result=0 * angle)

    monkeypatch.setattr(force_bound, "contact_deviation", deviation)
    monkeypatch.setattr(force_bound, "_solved", solved)
    angle, touch = np.array([-0.9, -0.2, 0.0, 0.1]), np.array([1.0, 2.0, np.nan, 4.0])
    assert force_bound._deviation(spec, angle, touch, lambda text: None) == 0.07
    assert asked == [4.0, pytest.approx(0.2)]


class _Plain:
    """Readings of a pad that are linear in angle, axial position and force; pressure 50 F."""

    slopes = np.array(
        [[900.0, -400.0, 70.0, 1.0], [-80.0, 500.0, 300.0, 2.0], [7.0, 5.0, 9.0, 4]]
    )
    rest = 200.0

    def __init__(self, table: Any) -> None:
        pass

    def largest(self, angle: Any, axial: Any) -> Any:
        """Forces that are tabulated."""
        return np.full(len(angle), 25.0)

    def __call__(self, loads: Any, derivatives: int) -> Any:
        """Readings and slopes, the pressure last."""
        so = self.rest + loads[:, 2:] * self.slopes[2]
        own = np.column_stack([self.slopes, [0.0, 0.0, 50.0]])
        return SimpleNamespace(
            readings=np.column_stack([so, 50 * loads[:, 2]]),
            jacobian=np.broadcast_to(own, (len(loads), 3, 5)),
        )


def test_the_range_of_a_pad_is_known_to_first_contact_and_to_its_table(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of contacts with the wall at 10 N, beyond the table, and never."""
    monkeypatch.setattr(pad_range, "PadInterpolant", _Plain)
    most = pad_range.MOST * 25.0
    touch = np.repeat([10.0, 1.5 * most, 1e9], 2)
    table: Any = SimpleNamespace(
        angle=np.array([-0.4, 0.4]),
        axial=np.array([-0.03, 0.03]),
        first_contact_at=lambda angle, axial: touch,
        rest=np.full(4, 200.0),
        diameter=6e-3,
    )
    found = pad_range.range_from_table(table, ROUND, np.zeros((0, 2)), (3, 2), 3.0)
    np.testing.assert_allclose(found.first_contact[:, 0], [10.0, 1.5 * most, np.nan])
    np.testing.assert_allclose(found.oil_pressure[:, 0], [500.0, np.nan, np.nan])
    ends = np.minimum(touch[::2], most)
    ladder = ends[:, None] * np.array(force_bound.LADDER)
    np.testing.assert_allclose(found.force[:, 1, :-1], ladder)
    assert found.reference == 3.0  # of the smallest first contact
    assert found.noise == pytest.approx(np.sqrt(9 + 1 / 12))
    slopes = _Plain.slopes
    for k, force in ((0, 3.0), (4, ladder[2, 4]), (9, ladder[2, 9])):
        place = 0 if force == 3.0 else 2
        at = found.force.shape[2] - 1 if force == 3.0 else k
        variance = 9 + 1 / 12 + (pad_range.PAD_MODEL_ERROR * slopes[2] * force) ** 2
        covariance = np.linalg.inv((slopes / variance) @ slopes.T)
        deviations = np.sqrt(np.diag(covariance))
        np.testing.assert_allclose(found.error[:, place, 1, at], deviations)
        rate = ROUND.outer_rate(np.zeros(1))[0]
        expected = np.hypot(rate * deviations[0], deviations[1])
        assert found.position_error[place, 1, at] == pytest.approx(expected)
    np.testing.assert_allclose(
        found.smallest, smallest_told(found.force[..., :-1], found.error[2][..., :-1])
    )
    row = found.report()["places"][0]
    assert [p["force_N"] for p in row["points"]] == sorted([*ladder[0], 3.0])


def test_a_frame_that_nothing_touches_has_the_oil_pressure_of_rest() -> None:
    """A skin that lacks oil has suction at rest; too few readings tell none."""
    so, used = np.full(5, 100.0), np.ones(5, bool)
    assert untouched(so, used, True, 1.0, -545.0).oil_pressure == -545.0
    assert np.isnan(untouched(so, used, False, 1.0, -545.0).oil_pressure)
