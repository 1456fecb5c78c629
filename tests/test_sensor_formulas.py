"""Formulas of a skin's calibration against closed forms: priors, noise, outliers, warnings."""

import dataclasses
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fitting.sensor.fit import assumptions, checks, priors
from fitting.sensor.fit.residuals import Prior, SensorProblem, bounds_of
from fitting.sensor.fit.result import _ratio, _taken_out
from fitting.sensor.fit.search import _kept, _no_counts, _spread
from fitting.sensor.logs.data import NoCalibration, _forget_idle_places, load_sensor_data
from fitting.sensor.logs.known_inputs import check_known, fluid_name, permittivities
from fitting.sensor.logs.readings import ROUNDING, LoggedCounts, _first_noise, measured_noise
from fitting.sensor.model.constants import (
    SensorConstant,
    SensorFamily,
    is_gap,
    law_constants,
    moves_membrane,
    named,
)
from fitting.sensor.report.skin_file import _layers, _text
from fitting.sensor.shapes.deformations import place_text
from suas_jax.config import UncertainQuantity, load_skin
from suas_jax.config.inelastic import RelaxationSpec
from suas_jax.config.sections.circle import CircleSpec
from suas_jax.config.sections.spline import SplineSpec
from suas_jax.skin.plain import angles_at, plain_geometry

ROOT = Path(__file__).parent.parent

RNG = np.random.default_rng(0)
PERMITTIVITY = SensorConstant("relative_permittivity", "1", 2.0)
GAP = SensorConstant("oil_gap", "m", 5e-3)
SCALE = SensorConstant("lsb", "F", 1e-16)
STRAY = SensorConstant("stray", "F", 2e-14, False, 0.0)
LAYERS = SensorConstant("layers", "m", 2e-3, False, 0.0)
C1 = SensorConstant("material.C1", "Pa", 3e5)


def logged(frames: int = 60, taxels: int = 3, **changes: Any) -> LoggedCounts:
    """Readings of two logs, a second a frame, noise of two counts."""
    half = frames // 2
    log = np.repeat([0, 1], [half, frames - half])
    fields: dict[str, Any] = {
        "so": np.full((taxels, frames), 1000.0),
        "state": np.arange(frames) // 10,
        "log": log,
        "time": np.concatenate([np.arange(half), np.arange(frames - half)]) * 1.0,
        "sigma": np.full((taxels, frames), 2.0),
        "present": np.ones((taxels, frames), bool),
        "used": np.ones((taxels, frames), bool),
        "offsets": False,
        "drifting": False,
        "logs": 2,
    }
    return LoggedCounts(**{**fields, **changes})


class Linear:
    """A problem whose readings are linear in the logarithms of its constants.

    Attributes:
        rows: derivatives of the readings over their noise [taxel, frame, constant].
    """

    def __init__(self, parts: Any, rows: np.ndarray, readings: Any = None, **given: Prior):
        self.family, self.rows, self.priors = SensorFamily(tuple(parts)), rows, given
        self.readings = readings or logged(rows.shape[1], rows.shape[0])
        self.correlation = None
        self.left = np.zeros(rows.shape[:2])
        self.model: Any = SimpleNamespace(permittivity=np.full(100, np.nan), gap_of=None)

    def information(self, constants: Any, frames: Any = None) -> np.ndarray:
        """J^T J."""
        rows = self.rows if frames is None else self.rows[:, frames]
        return np.asarray(np.einsum("tfi,tfj->ij", rows, rows))

    def relative_sizes(self, constants: Any) -> np.ndarray:
        """As the problem itself has them."""
        return SensorProblem.relative_sizes(self, constants)  # type: ignore[arg-type]

    def prior_information(self, constants: Any) -> np.ndarray:
        """As the problem itself has it."""
        return SensorProblem.prior_information(self, constants)  # type: ignore[arg-type]

    def standardised(self, constants: Any) -> np.ndarray:
        """What is left, in units of the noise."""
        return self.left

    def predicted(self, constants: Any) -> np.ndarray:
        """What the model reads."""
        return self.readings.so + self.left * self.readings.sigma


def problem(parts: Any, rows: np.ndarray, readings: Any = None, **given: Prior) -> Any:
    """The same, as any problem."""
    return Linear(parts, rows, readings, **given)


def test_residuals_are_predicted_less_measured_counts_in_units_of_the_noise() -> None:
    here = logged(6, 2)
    off = RNG.normal(size=here.so.shape)
    own: Any = SimpleNamespace(readings=here, predicted=lambda _: here.so + off)
    found = SensorProblem.standardised(own, np.ones(2))
    np.testing.assert_allclose(found, np.where(here.present, off / here.sigma, 0.0))


def test_natural_sizes_of_stray_and_layers_are_those_of_a_taxel_and_its_oil() -> None:
    spec = load_skin(ROOT / "configs/skins/suas.toml")
    gap, permittivity = spec.geometry.mean_gap, spec.oil.relative_permittivity
    assert permittivity is not None
    assert named(spec, "layers").size == pytest.approx(gap / permittivity)
    taxel = 8.854e-12 * permittivity * 4e-3**2 / gap
    assert named(spec, "stray").size == pytest.approx(taxel)
    assert not named(spec, "stray").positive


# --- bounds and priors --------------------------------------------------------------------


def test_bounds_are_the_inverse_s_diagonal_and_infinite_along_what_is_not_seen() -> None:
    information = np.array([[4.0, 1.0, 0.0], [1.0, 9.0, 0.0], [0.0, 0.0, 0.0]])
    expected = np.sqrt(np.diag(np.linalg.inv(information[:2, :2])))
    np.testing.assert_allclose(bounds_of(information), [*expected, np.inf], rtol=1e-10)
    ratio = np.array([[1.0, -1.0], [-1.0, 1.0]])  # only their ratio is seen
    assert bounds_of(ratio).tolist() == [np.inf, np.inf]


def test_sizes_are_values_of_what_is_positive_and_natural_sizes_of_the_rest() -> None:
    one = problem([PERMITTIVITY, STRAY], np.ones((1, 4, 2)))
    found = one.relative_sizes(np.array([2.5, 1e-15]))
    np.testing.assert_allclose(found, [2.5, 2e-14])


def test_information_counts_readings_in_relative_sizes(monkeypatch: Any) -> None:
    """Of readings a frame each; priors, which come after the readings, are left out."""
    jacobian = RNG.normal(size=(2 * 6 + 2, 2))
    module = "fitting.sensor.fit.residuals.sensitivity"
    monkeypatch.setattr(module, lambda residuals, constants: (None, jacobian))
    here = logged(6, 2)
    own: Any = SimpleNamespace(
        residuals=lambda: None,
        readings=here,
        relative_sizes=lambda constants: np.array([2.0, 10.0]),
    )
    rows = jacobian[:12] * [2.0, 10.0]
    found = SensorProblem.information(own, np.ones(2))
    np.testing.assert_allclose(found, rows.T @ rows, rtol=1e-12)
    some = np.arange(6) < 2
    rows = rows[np.tile(some, 2)]
    found = SensorProblem.information(own, np.ones(2), some)
    np.testing.assert_allclose(found, rows.T @ rows, rtol=1e-12)


@pytest.mark.parametrize(
    ("part", "share"),
    [(PERMITTIVITY, 0.1), (GAP, 0.05), (SCALE, 0.01), (STRAY, 0.1), (LAYERS, 0.1), (C1, 0.1)],
)
def test_prior_has_the_tolerance_of_the_file_or_the_usual_one(
    part: SensorConstant, share: float
) -> None:
    found = priors.prior_of(part, 1.1 * part.size, "because")
    assert (found.mean, found.reason, found.given) == (1.1 * part.size, "because", False)
    assert found.sd == pytest.approx(share * part.size)
    assert priors.prior_of(part, None, "").mean == (part.size if part.positive else 0.0)
    stated = UncertainQuantity(1.1 * part.size, 0.02 * part.size)
    found = priors.prior_of(part, stated, "because")
    assert found.sd == pytest.approx(0.02 * part.size)
    assert found.reason == "because; the skin file states its tolerance"
    exact = UncertainQuantity(part.size, 0.0)
    assert priors.prior_of(part, exact, "").sd == pytest.approx(1e-6 * part.size)
    assert dataclasses.replace(found, reason="given by --prior").given


def test_a_constant_open_by_more_than_a_twentieth_gets_a_prior() -> None:
    """Its standard error from n readings of slope s is 1 / (s sqrt(n))."""
    constants = np.array([2.0])
    for error, asked in ((0.051, True), (0.049, False)):
        one = problem([PERMITTIVITY], np.full((1, 60, 1), 1 / (error * np.sqrt(60))))
        needed = priors.needed_priors(one, constants, [2.0])
        assert list(needed) == (["relative_permittivity"] if asked else [])
    # Beside a prior of 10 % another constant is no better known than a fifth.
    rows = np.zeros((1, 60, 2))
    rows[0, ::2, 0], rows[0, 1::2, 1] = 100.0, 1 / (0.19 * np.sqrt(30))
    given = {"relative_permittivity": Prior(2.0, 0.2, "given")}
    one = problem([PERMITTIVITY, C1], rows, **given)
    assert not priors.needed_priors(one, np.array([2.0, 3e5]), [2.0, 3e5])
    rows[0, 1::2, 1] *= 0.9
    assert list(priors.needed_priors(one, np.array([2.0, 3e5]), [2.0, 3e5])) == ["material.C1"]


def test_scale_and_stray_get_priors_before_gap_and_permittivity() -> None:
    names = ("oil_gap.0", "relative_permittivity", "material.a", "material.b", "stray", "lsb")
    order = [names[i] for i in priors._order((*names, "layers"))[1:]]
    assert order == [
        "stray",
        "lsb",
        "material.b",
        "material.a",
        "oil_gap.0",
        "relative_permittivity",
    ]
    # All three trade against each other: one prior is enough for the ratio of the others.
    direction = np.array([1.0, 1.0, -1.0])
    rows = 100.0 * np.ones((1, 60, 1)) * direction
    one = problem([SCALE, PERMITTIVITY, GAP], rows)
    needed = priors.needed_priors(one, np.array([1e-16, 2.0, 5e-3]), [1e-16, 2.0, 5e-3])
    assert list(needed) == ["lsb", "oil_gap"]
    assert needed["lsb"].reason == "the logs leave it open"


def test_one_static_state_tells_permittivity_over_gap_alone() -> None:
    here = logged(60, 1, state=np.zeros(60, int))
    rows = np.tile(100.0 * np.eye(2), (30, 1))[None]  # patterns would tell both
    one = problem([PERMITTIVITY, GAP], rows, here)
    assert priors.is_static(one)
    needed = priors.needed_priors(one, np.array([2.0, 5e-3]), [2.0, 5e-3])
    assert list(needed) == ["oil_gap"]
    assert "one static state in one fluid" in needed["oil_gap"].reason
    moving = problem([PERMITTIVITY, GAP], rows)
    assert not priors.is_static(moving)
    assert not priors.needed_priors(moving, np.array([2.0, 5e-3]), [2.0, 5e-3])


def test_findings_name_what_trades_and_what_is_only_a_ratio() -> None:
    constants = np.array([2.0, 5e-3, 3e5])
    rows = np.zeros((1, 60, 3))
    rows[0, :, 0], rows[0, :, 1], rows[0, ::2, 2] = 100.0, -100.0, 50.0
    (ratio,) = priors.findings(problem([PERMITTIVITY, GAP, C1], rows), constants, 1.0)
    assert ratio.startswith("only the ratio relative_permittivity/oil_gap is determined; vary")
    rows[0, ::3, 0] = 60.0  # now both are seen, and all are known
    assert priors.findings(problem([PERMITTIVITY, GAP, C1], rows), constants, 1.0) == []
    # Wider errors leave them open again; two others trade.
    rows = np.zeros((1, 60, 2))
    rows[0, :, 0], rows[0, :, 1] = 3.0, -3.0
    rows[0, 0, 0] = 3.5
    found = priors.findings(problem([SCALE, C1], rows), constants[[0, 2]], 1.0)
    assert found == [
        "lsb is not determined; it trades against material.C1",
        "material.C1 is not determined; it trades against lsb",
    ]


def test_each_log_contributes_its_own_bound() -> None:
    data: Any = SimpleNamespace(files=[SimpleNamespace(path="a"), SimpleNamespace(path="b")])
    rows = np.full((1, 60, 1), 10.0)
    rows[0, :30] = 0.1
    one = problem([PERMITTIVITY], rows)
    one.model.permittivity = np.where(np.arange(6) < 2, 1.0, np.nan)
    found = priors.log_contributions(one, np.array([2.0]), 1.5, data)
    assert [row["logs"] for row in found] == ["a", "b", "oil alone", "known fluid alone", "all"]
    assert [row["frames"] for row in found] == [30, 30, 40, 20, 60]
    assert [row["states"] for row in found] == [3, 3, 4, 2, 6]
    errors = [row["standard_errors"]["relative_permittivity"] for row in found]
    assert errors[0] is None
    assert errors[1] == pytest.approx(1.5 * 2.0 / np.sqrt(3000))
    assert errors[4] == pytest.approx(1.5 * 2.0 / np.sqrt(3000 + 0.3))


# --- readings -----------------------------------------------------------------------------


@pytest.mark.parametrize("drifting", [False, True])
@pytest.mark.parametrize("offsets", [False, True])
def test_offsets_and_drifts_are_taken_out_by_least_squares(
    offsets: bool, drifting: bool
) -> None:
    here = logged(40, 2, offsets=offsets, drifting=drifting)
    here.used[0, 5:9] = False
    columns = here.columns()
    expected = [np.ones(40)] if offsets else []
    if drifting:
        expected += [np.where(here.log == k, here.time, 0.0) for k in range(2)]
    assert here.extras == columns.shape[1] == len(expected)
    np.testing.assert_array_equal(columns, np.array(expected).T.reshape(40, -1))
    errors, weight = RNG.normal(size=(2, 40)), RNG.uniform(0.5, 1.0, size=(2, 40))
    found, spread = here.taken_out(errors, weight)
    used = here.used[0]
    w = np.sqrt(weight[0, used]) / 2.0
    if here.extras:
        solution = np.linalg.lstsq(columns[used] * w[:, None], errors[0, used] * w, None)[0]
        np.testing.assert_allclose(found[0], solution, rtol=1e-9)
        normal = np.linalg.inv((columns[used] * w[:, None]).T @ (columns[used] * w[:, None]))
        np.testing.assert_allclose(spread[0], np.sqrt(np.diag(normal)), rtol=1e-9)
    # The basis projects the same on the same.
    basis = here.basis(here.sigma)
    assert basis.shape == (2, 40, here.extras)
    weighed = columns * np.where(here.used[0], 0.5, 0.0)[:, None]
    np.testing.assert_allclose(basis[0] @ (basis[0].T @ weighed), weighed, atol=1e-9)
    np.testing.assert_allclose(basis[0].T @ basis[0], np.eye(here.extras), atol=1e-9)
    assert not basis[0, 5:9].any()


def test_noise_is_that_of_all_taxels_unless_one_s_is_clearly_another() -> None:
    here = logged(400, 3)
    here.so[:] += 0.5  # no whole counts
    errors = RNG.normal(size=(3, 400)) * np.array([[2.0], [2.0], [6.0]])
    found = measured_noise(here, errors, constants=2)
    half = here.log == 0
    together = np.sqrt((errors[:, half] ** 2).sum() / (600 - 2))
    single = np.sqrt((errors[:, half] ** 2).sum(1) / 200)
    assert single[2] / together > 1.5
    np.testing.assert_allclose(found[2, 0], single[2], rtol=1e-12)
    expected = [x if x / together < 0.67 else together for x in single[:2]]
    np.testing.assert_allclose(found[:2, 0], expected, rtol=1e-12)
    # Too few readings: what was assumed.
    few = logged(8, 2)
    np.testing.assert_array_equal(measured_noise(few, np.zeros((2, 8)), 1), 2.0)
    # Whole counts have no less noise than rounding makes.
    whole = measured_noise(logged(400, 3), 1e-9 * errors, 2)
    np.testing.assert_allclose(whole, 1 / np.sqrt(12))
    fraction = measured_noise(here, 1e-9 * errors, 2)
    np.testing.assert_allclose(fraction, 1e-4 * 1000.5)


def test_noise_to_start_from_is_stated_or_that_of_second_differences() -> None:
    def first(noise: float, so: np.ndarray) -> np.ndarray:
        data: Any = SimpleNamespace(spec=SimpleNamespace(sensing=SimpleNamespace(noise=noise)))
        return _first_noise(data, so)

    so = np.cumsum(np.ones((2, 5000)), 1) + 3.0 * RNG.normal(size=(2, 5000))
    np.testing.assert_allclose(first(2.0, so), np.hypot(2.0, ROUNDING))
    np.testing.assert_allclose(first(0.0, so), np.hypot(3.0, ROUNDING), rtol=0.05)
    np.testing.assert_allclose(first(0.0, so[:, :2]), ROUNDING)


def test_outliers_are_beyond_five_deviations_of_the_spread() -> None:
    r = RNG.normal(size=(4, 1000))
    assert _spread(r) == pytest.approx(1.0, abs=0.03)
    assert _spread(0 * r) == 1e-3
    r[0, 3], r[1, 4] = 5.3, 4.7
    r *= 1.0 / _spread(r)
    r[0, 3], r[1, 4] = 5.01, 4.99
    present = np.ones(r.shape, bool)
    present[3, 9] = False
    r[3, 9] = 100.0
    kept = _kept(r, present)
    assert np.argwhere(present & ~kept).tolist() == [[0, 3]]
    # A taxel that mostly disagrees is given up, but not where most taxels do.
    r[2, :501] = 50.0
    kept = _kept(r, present)
    assert not kept[2].any()
    assert kept[1].all()
    r[1, :501] = 50.0
    np.testing.assert_array_equal(_kept(r, present), present)
    # Small residuals are compared with a deviation of one.
    assert _kept(np.full((1, 9), 1e-3) + 4.9 * np.eye(9)[:1], np.ones((1, 9), bool)).all()


# --- checks -------------------------------------------------------------------------------

SPEC: Any = SimpleNamespace(
    oil=SimpleNamespace(relative_permittivity=2.0), sensing=SimpleNamespace(noise=2.0)
)
DATA: Any = SimpleNamespace(paths="log.csv", spec=SPEC)


@pytest.mark.parametrize(
    ("permittivity", "gap", "doubts", "refused"),
    [
        (3.9, 5e-3, 0, None),
        (4.1, 5e-3, 1, None),
        (1.01, 5e-3, 0, None),
        (0.95, 5e-3, 1, None),
        (0.85, 5e-3, 0, "which no oil has"),
        (8.1, 5e-3, 0, "times the skin file's"),
        (2.0, 14.9e-3, 0, None),
        (2.0, 15.1e-3, 0, "a gap of 15.1 mm"),
        (2.0, 1.7e-3, 0, None),
        (2.0, 1.6e-3, 0, "a gap of 1.6 mm"),
    ],
)
def test_constants_far_from_the_file_s_are_doubted_and_farther_ones_refused(
    permittivity: float, gap: float, doubts: int, refused: str | None
) -> None:
    one = problem([PERMITTIVITY, GAP], np.ones((3, 60, 2)))
    constants = np.array([permittivity, gap])
    if refused is None:
        assert len(checks.check_agreement(one, constants, DATA)) == doubts
    else:
        with pytest.raises(NoCalibration, match=refused):
            checks.check_agreement(one, constants, DATA)


def test_taxels_that_differ_by_a_third_are_of_another_layout() -> None:
    for share, refused in ((0.28, False), (0.32, True)):
        one = problem([PERMITTIVITY], np.ones((3, 60, 1)))
        model = 1000.0 / np.array([[1 - share], [1.0], [1 + share]])
        one.predicted = lambda constants, model=model: np.broadcast_to(model, (3, 60))
        if refused:
            with pytest.raises(NoCalibration, match="from 68 to 132 % of what"):
                checks._refuse_another_layout(one, np.ones(1), DATA)
        else:
            checks._refuse_another_layout(one, np.ones(1), DATA)


def test_changes_that_the_model_leaves_by_a_third_are_not_this_skin_s() -> None:
    one = problem([PERMITTIVITY], np.ones((3, 60, 1)))
    wave = np.sin(np.arange(60) * np.pi / 15)  # of mean zero, mean square one half
    one.readings.so[:] += 2.0 * 100.0 * wave
    for share, refused in ((0.29, False), (0.31, True)):
        one.left = np.tile(share * 100.0 * wave, (3, 1))
        if refused:
            with pytest.raises(NoCalibration, match="the counts change by 70"):
                checks._refuse_unexplained(one, np.ones(1), DATA)
        else:
            checks._refuse_unexplained(one, np.ones(1), DATA)
    # Within five deviations of the noise nothing is refused.
    one.readings.so[:] = 1000.0
    one.left = np.tile(4.9 * np.sqrt(2) * wave, (3, 1))
    checks._refuse_unexplained(one, np.ones(1), DATA)


def test_drift_is_what_grows_with_time_beside_the_load() -> None:
    n = 80
    here = logged(n, 2, log=np.zeros(n, int), time=np.arange(n) * 1.0, logs=1)
    load = np.sin(np.arange(n) / 3.0)
    here.so[:] += 100.0 * load
    one = problem([PERMITTIVITY], np.ones((2, n, 1)), here)
    noise = np.random.default_rng(1).normal(size=(2, n))
    one.left = noise
    one.predicted = lambda constants: 1000.0 + 100.0 * np.tile(load, (2, 1))
    assert checks.drift_warning(one, np.ones(1)) == ""
    one.left = noise + np.array([[0.0], [0.05]]) * here.time
    text = checks.drift_warning(one, np.ones(1))
    assert text.startswith("readings drift with time (")
    size = np.linalg.norm(here.time - here.time.mean())
    expected = 0.05 * size  # over a noise of one
    assert float(text.split("(")[1].split()[0]) == pytest.approx(expected, rel=0.2)
    # Where the load itself grows with time no drift is claimed.
    one.predicted = lambda constants: 1000.0 + np.tile(here.time, (2, 1))
    assert checks.drift_warning(one, np.ones(1)) == ""


def test_taxels_disagree_beyond_three_standard_errors_of_their_means() -> None:
    one = problem([PERMITTIVITY], np.ones((3, 64, 1)))
    one.readings = logged(64, 3)
    for z, warned in ((2.9, False), (3.1, True)):
        one.left = np.full((3, 64), z / 8.0) * np.array([[1.0], [-1.0], [1.0]])
        text = checks.disagreement_warning(one, np.ones(1))
        assert bool(text) == warned
    assert "the worst by 0.775 counts" in text
    assert checks.noise_warning(np.full((3, 1), 3.9), DATA) == ""
    assert "scatter by 4.1 counts" in checks.noise_warning(np.full((3, 1), 4.1), DATA)


def test_powers_of_the_load_span_what_counts_change_with() -> None:
    load = np.linspace(-1, 1, 30)
    so = 1000 + np.outer([1.0, 2.0], load)
    found = checks._powers_of_load(so)
    assert found.shape == (30, 7)
    expected = np.abs(load)[:, None] ** np.arange(7)
    np.testing.assert_allclose(np.abs(found), expected, atol=1e-9)
    assert checks._powers_of_load(np.full((2, 5), 1000.0)).tolist() == [[1.0]] * 5


def test_a_constant_far_from_its_prior_is_told() -> None:
    given = {PERMITTIVITY.name: Prior(2.2, 0.05, ""), GAP.name: Prior(5e-3, 2e-4, "")}
    one = problem([PERMITTIVITY, GAP], np.ones((1, 4, 2)), **given)
    assert not assumptions.pulled_warning(one, np.array([2.35, 4.4e-3]))
    text = assumptions.pulled_warning(one, np.array([2.51, 4.4e-3]))
    assert f"{PERMITTIVITY.name} is 6.2 standard deviations" in text
    assert "others" not in text
    assert "1 others" in assumptions.pulled_warning(one, np.array([2.51, 4.0e-3]))


@pytest.mark.parametrize("rest", [0, 60])
def test_exchanged_taxels_are_named(rest: int) -> None:
    load = np.concatenate([np.zeros(rest), np.linspace(0.0, 1.0, 40)])
    predicted = 200.0 + np.outer([10.0, 90.0, 150.0, 40.0], load)
    for order, told in (([0, 2, 1, 3], "0.2 and 0.3"), ([1, 2, 0, 3], ""), ([0, 1, 2, 3], "")):
        so = predicted[order] + 2.0 * RNG.normal(size=predicted.shape)
        # At rest, where all taxels read alike, none is left out.
        used = np.equal(order, range(4))[:, None] | (np.arange(load.size) < rest)
        readings = SimpleNamespace(
            so=so, sigma=np.full(so.shape, 2.0), present=~np.isnan(so), used=used, offsets=False
        )
        one: Any = SimpleNamespace(readings=readings, predicted=lambda constants: predicted)
        data: Any = SimpleNamespace(spec=load_skin(ROOT / "configs/skins/suas.toml"))
        text = checks.exchanged_warning(one, np.ones(2), data)
        assert told in text if told else not text


def test_taxels_that_should_read_alike_are_not_called_exchanged() -> None:
    # Of a log that tells no load, eighty pairs of taxels that are left out were named.
    predicted = np.full((4, 20), 300.0)
    so = predicted + RNG.normal(size=predicted.shape)
    readings = SimpleNamespace(
        so=so,
        sigma=np.ones(so.shape),
        present=~np.isnan(so),
        used=np.zeros(so.shape, bool),
        offsets=False,
    )
    one: Any = SimpleNamespace(readings=readings, predicted=lambda constants: predicted)
    data: Any = SimpleNamespace(spec=load_skin(ROOT / "configs/skins/suas.toml"))
    assert not checks.exchanged_warning(one, np.ones(2), data)


def test_places_of_known_loads_are_told_as_scenes_tell_them() -> None:
    circle = load_skin(ROOT / "configs/skins/suas.toml").geometry
    points = ((-0.04, 0.0), (-0.022, 0.027), (0.0, 0.03), (0.02, 0.024), (0.038, 0.0))
    size = {"thickness": 1.2e-3, "width": 0.06, "oil_gap": 3e-3}
    spline = SplineSpec(section="spline", points=points, **size)
    assert place_text(plain_geometry(circle).section, np.deg2rad(30)) == "30 deg"
    angle = float(angles_at(spline, "arc", np.array([-25e-3]))[0])
    assert place_text(plain_geometry(spline).section, angle) == "arc -25 mm"


def test_what_a_fit_leaves_out_is_listed_taxel_by_taxel() -> None:
    taxel = SimpleNamespace(layout="list")
    electrodes: Any = SimpleNamespace(
        taxel_names=((0,) * 4, (1, 2, 3, 4)), noise=2.0, **vars(taxel)
    )
    one = problem([PERMITTIVITY], np.ones((4, 10, 1)), logged(10, 4))
    here = one.readings
    touching = np.zeros((4, 10), bool)
    touching[0, :3] = True
    here.present[0] = here.used[0] = False
    here.used[1] = False
    here.used[2, :2] = False
    data: Any = SimpleNamespace(spec=SimpleNamespace(sensing=electrodes))
    found = checks.masked_taxels(one, touching, data)
    assert [(m.taxel, m.frames, m.whole) for m in found] == [
        (1, 3, True),
        (2, 10, True),
        (3, 2, False),
    ]


# --- judgement ----------------------------------------------------------------------------


def test_error_of_permittivity_over_gap_is_first_order_s() -> None:
    one = problem([PERMITTIVITY, GAP], np.ones((1, 60, 2)))
    one.model.inputs = {"geometry.oil_gap": 4e-3}
    covariance = np.array([[0.04, 3e-5], [3e-5, 1e-8]])
    judged: Any = SimpleNamespace(covariance=covariance)
    found = _ratio(one, np.array([2.0, 5e-3]), judged)
    assert found is not None
    gradient = np.array([1 / 5e-3, -2.0 / 25e-6])
    expected = (400.0, np.sqrt(gradient @ covariance @ gradient))
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    alone = problem([PERMITTIVITY], np.ones((1, 60, 1)))
    alone.model.inputs = {"geometry.oil_gap": 4e-3}
    judged.covariance = covariance[:1, :1]
    np.testing.assert_allclose(_ratio(alone, np.array([2.0]), judged), [500.0, 50.0])
    alone.model.gap_of = (0,)
    assert _ratio(alone, np.array([2.0]), judged) is None


def test_offsets_and_drifts_are_reported_and_silent_taxels_have_none() -> None:
    here = logged(20, 2, offsets=True, drifting=True)
    here.used[1] = False
    one = problem([PERMITTIVITY], np.ones((2, 20, 1)), here)
    drift = np.where(here.log == 0, 0.5, -0.25) * here.time
    one.predicted = lambda constants: here.so - 7.0 - drift
    offsets, rates = _taken_out(one, np.ones(1))
    assert offsets is not None
    assert rates is not None
    np.testing.assert_allclose(offsets[0], [7.0, np.nan], rtol=1e-9)
    np.testing.assert_allclose(rates[0], [0.5, -0.25], rtol=1e-9)
    assert np.isnan(offsets[1, 1])
    assert _taken_out(problem([PERMITTIVITY], np.ones((2, 20, 1))), np.ones(1)) == (None, None)


# --- constants and files ------------------------------------------------------------------


def test_constants_are_exponentials_of_what_is_positive() -> None:
    family = SensorFamily((PERMITTIVITY, STRAY))
    theta = np.array([0.3, -1.5])
    found = np.asarray(family.constants(theta))
    np.testing.assert_allclose(found, [2 * np.exp(0.3), -3e-14], rtol=1e-12)
    np.testing.assert_allclose(np.asarray(family.unconstrained(found)), theta, rtol=1e-10)
    assert family.floors.tolist() == [-np.inf, 0.0]
    assert is_gap("oil_gap.0.3")
    assert not is_gap("oil_gaps")
    assert moves_membrane("material.C1")
    assert not moves_membrane("C1")


def test_layers_keep_their_shares_of_thickness_over_permittivity() -> None:
    layer = SimpleNamespace
    spec: Any = SimpleNamespace(
        sensing=SimpleNamespace(
            layers=[
                layer(thickness=100e-6, relative_permittivity=4.0),
                layer(thickness=50e-6, relative_permittivity=2.0),
            ]
        )
    )
    found = _layers(spec, 100e-6)  # twice what there is
    assert [row["thickness"] for row in found] == ["200 um", "100 um"]
    assert _layers(spec, 0.0) == []
    spec.sensing.layers = []
    assert _layers(spec, 3e-6) == [{"thickness": "3 um", "relative_permittivity": 1.0}]
    assert _text(1.23456789012345, "mm") == "1.23456789012 mm"
    assert _text(2.5, "") == 2.5


def test_fluids_are_oil_air_or_a_permittivity() -> None:
    column = np.array(["oil", "air", "2.5", "silicone-oil"], object)
    found = permittivities(column, None, 4, "log")
    assert np.isnan(found[[0, 3]]).all()
    assert found[1] == pytest.approx(1.0, abs=1e-3)
    assert found[2] == 2.5
    assert [fluid_name(x) for x in found[:3]] == ["oil", "air", "2.5"]
    assert permittivities(None, "80", 2, "log").tolist() == [80.0, 80.0]
    for text in ("0.99", "nan", "mud"):
        with pytest.raises(ValueError, match="relative permittivity"):
            permittivities(None, text, 1, "log")
    with pytest.raises(ValueError, match="empty in some rows"):
        permittivities(np.array(["air", ""], object), None, 2, "log")
    with pytest.raises(ValueError, match="leave --fluid out"):
        permittivities(column, "air", 4, "log")


@pytest.mark.parametrize(
    ("quantity", "value", "refused"),
    [
        ("displacement", 5.99e-3, False),
        ("displacement", 6.01e-3, True),
        ("inner_displacement", -6.01e-3, True),
        ("angle", 1.49, False),
        ("angle", -1.51, True),
        ("force", 1e9, False),
    ],
)
def test_known_inputs_beyond_the_skin_are_refused(
    quantity: str, value: float, refused: bool
) -> None:
    sizes = {"inner_radius": 57.5e-3, "thickness": 1.5e-3, "width": 0.123, "oil_gap": 5e-3}
    spec: Any = SimpleNamespace(geometry=CircleSpec(half_angle=1.5, **sizes))
    values = {(0, "angle"): np.zeros(2), (0, "force"): np.ones(2)}
    values |= {(0, quantity): np.array([np.nan, value])}
    known: Any = SimpleNamespace(values=values, names=dict.fromkeys(values, "column"))
    if refused:
        with pytest.raises(ValueError, match="is beyond what the skin allows"):
            check_known(spec, known, "log")
    else:
        check_known(spec, known, "log")
    hole: Any = SimpleNamespace(values={(1, "angle"): np.zeros(1)}, names={})
    with pytest.raises(ValueError, match="numbered from 0"):
        check_known(spec, hole, "log")


def logged_inputs(file: Path, columns: str, *cells: str, head: str = "") -> Path:
    """A log of the section with known inputs in further columns."""
    names = ["t_host_s", "t_device_s", "seq", "module", *(f"so_{k}" for k in range(1, 9))]
    rows = [f"{k},{k},{k},0,{','.join(['200'] * 8)},{cell}" for k, cell in enumerate(cells)]
    file.write_text("\n".join([f"{head}{','.join(names)},{columns}", *rows]) + "\n")
    return file


@pytest.mark.parametrize(
    ("columns", "cells"),
    [
        ("load_0_force_N,load_0_angle_deg", ["4,20", ",20", "4,", "0,"]),
        (
            "load_0_force_N,load_0_angle_deg,load_0_direction_deg",
            ["4,20,30", ",20,30", "4,20,", "0,20,"],
        ),
    ],
)
def test_an_empty_cell_of_a_known_input_is_no_zero(
    columns: str, cells: list[str], tmp_path: Path
) -> None:
    spec = load_skin(ROOT / "configs/skins/suas.toml")
    data = load_sensor_data(spec, [logged_inputs(tmp_path / "a.csv", columns, *cells)])
    assert sorted(data.loads.force[0]) == [0.0, 4.0]
    assert any("2 frames without known inputs left out" in text for text in data.warnings)


def test_a_log_named_twice_is_refused() -> None:
    with pytest.raises(ValueError, match="named twice"):
        load_sensor_data(load_skin(ROOT / "configs/skins/suas.toml"), [Path("a"), Path("./a")])


def test_a_known_input_without_any_number_is_named(tmp_path: Path) -> None:
    spec = load_skin(ROOT / "configs/skins/suas.toml")
    columns = "load_0_force_N,load_0_displacement_mm,load_0_angle_deg"
    log = logged_inputs(tmp_path / "a.csv", columns, "4,,20", "8,,20")
    with pytest.raises(ValueError, match='"load_0_displacement_mm" empty; leave out'):
        load_sensor_data(spec, [log])


def test_sources_that_contradict_each_other_are_refused(tmp_path: Path) -> None:
    spec, columns = load_skin(ROOT / "configs/skins/suas.toml"), "load_0_force_N,fluid"
    first, second = "# load_0_angle_deg: 20\n", "# load_0_angle_deg: 25\n"
    one = logged_inputs(tmp_path / "a.csv", columns, "4,oil", head=f"{first}# fluid: air\n")
    with pytest.raises(ValueError, match=r"a\.csv: two sources .* name the fluid"):
        load_sensor_data(spec, [one])
    both = f"{first}# load_0_force_N: 5\n"
    one = logged_inputs(tmp_path / "a.csv", "load_0_force_N", "4", head=both)
    with pytest.raises(ValueError, match=r'a\.csv: .* by header line "load_0_force_N" and'):
        load_sensor_data(spec, [one])
    texts = [
        logged_inputs(tmp_path / "b.csv", columns, "4,oil", head=head).read_text()
        for head in (first, second)
    ]
    scales = [f"# scale: {lsb} fF\n{text}" for lsb, text in zip((0.305, 1), texts, strict=True)]
    one.write_text("".join(scales))
    with pytest.raises(ValueError, match="header scale: one count is 1 fF"):
        load_sensor_data(spec, [one])
    one.write_text("".join(texts))
    with pytest.raises(ValueError, match='is "20" and further below "25"'):
        load_sensor_data(spec, [one])


def test_states_at_rest_have_no_place() -> None:
    nan = np.nan
    rows = {
        "angle": [0.1, 0.2, 0.3, 0.4],
        "turn": [0.0, 0.1, 0.0, 0.0],
        "force": [0.0, 5.0, nan, nan],
        "displacement": [nan, nan, 1e-3, nan],
        "axial": [0.01, 0.02, 0.03, 0.04],
        "diameter": [6e-3, 6e-3, 6e-3, 6e-3],
        "depth": [0.0, 0.0, 0.0, -1e-4],
        "radius": [0.0, 0.0, 0.0, 0.01],
    }
    table = {name: np.array([row]) for name, row in rows.items()}
    _forget_idle_places(table)
    for name in ("angle", "turn", "axial", "diameter"):
        rows[name][0] = rows[name][3] = 0.0
    assert table.keys() == rows.keys()
    for name, row in rows.items():
        np.testing.assert_array_equal(table[name], [row])


@pytest.mark.parametrize(
    ("geometry", "fit", "column", "said"),
    [
        ({}, "permittivity,gap", "load_0_force_N", ["thickness, known to 3 %", "10 %"]),
        (
            {},
            "permittivity,gap",
            "load_0_force_N",
            ["relative_permittivity,oil_gap,thickness --j"],
        ),
        ({}, "gap,thickness", "load_0_force_N", ["material", "oil_gap,thickness --joint"]),
        ({}, "gap,thickness,material.C1", "load_0_force_N", []),
        ({}, "permittivity,gap", "load_0_displacement_mm", []),
        ({}, "permittivity,scale", "load_0_force_N", []),
        ({"thickness": UncertainQuantity(1.5e-3, 3e-5)}, "gap", "load_0_force_N", ["to 2 %"]),
    ],
)
def test_forces_tell_a_gap_no_better_than_the_membrane_is_known(
    tmp_path: Path, geometry: dict[str, Any], fit: str, column: str, said: list[str]
) -> None:
    spec = load_skin(ROOT / "configs/skins/suas.toml")
    spec = spec.model_copy(update={"geometry": spec.geometry.model_copy(update=geometry)})
    cells = f"{column},load_0_angle_deg", "0,20", "1,20", "2,20"
    data = load_sensor_data(spec, [logged_inputs(tmp_path / "a.csv", *cells)])
    family = SensorFamily(tuple(named(spec, name) for name in fit.split(",")))
    text = assumptions.exact_membrane_warning(family, data)
    assert bool(text) == bool(said)
    assert all(part in text for part in said)


@pytest.mark.parametrize(
    ("response", "column", "said"),
    [
        # A dent of 3/4 grows to 1 while the stress of a held one falls from 1 to 3/4.
        ("long-term", "load_0_force_N", "33 % too far where presses are not held for several"),
        ("instantaneous", "load_0_force_N", "25 % too little where presses are not much short"),
        ("long-term", "load_0_displacement_mm", ""),
    ],
)
def test_known_forces_on_a_membrane_that_creeps_are_doubted(
    tmp_path: Path, response: str, column: str, said: str
) -> None:
    spec = load_skin(ROOT / "configs/skins/suas.toml")
    relaxation = RelaxationSpec(g=(0.15, 0.1), tau=(0.5, 10.0))
    material = {"relaxation": relaxation, "response": response}
    spec = spec.model_copy(update={"material": spec.material.model_copy(update=material)})
    cells = f"{column},load_0_angle_deg", "0,20", "1,20", "2,20"
    log = logged_inputs(tmp_path / "a.csv", *cells)
    text = assumptions.elastic_warning(load_sensor_data(spec, [log]))
    assert bool(text) == bool(said)
    assert said in text


def test_why_no_constants_give_finite_counts() -> None:
    """Exchanged columns of loads press the membrane onto the wall: frames are told."""
    so = np.full((2, 5), 300.0)
    so[1, 2:4] = np.nan  # short circuits, of readings that the log has
    so[0, 0] = np.nan  # not used
    used = np.ones((2, 5), bool)
    used[0, 0] = False
    problem: Any = SimpleNamespace(
        readings=SimpleNamespace(used=used), predicted=lambda constants: so
    )
    text = _no_counts(problem, np.ones(1))
    assert "in 2 of 5 frames (the first is number 2)" in text
    assert "no columns of loads or places are exchanged" in text
    so[:] = 300.0
    assert _no_counts(problem, np.ones(1)).startswith("no constants give finite counts; check")


def test_what_statics_leave_out_of_a_rubber_is_not_found_beside_its_law() -> None:
    skin = load_skin(ROOT / "configs/skins/suas.toml")
    told = {"density": 1150.0, "expansion": 1.6e-4, "bulk_modulus": 2e9}
    skin = skin.model_copy(update={"material": skin.material.model_copy(update=told)})
    assert law_constants(skin) == ["material.C1", "material.C2", "material.C3"]
    assert [named(skin, path).unit for path in law_constants(skin)] == ["Pa"] * 3
    with pytest.raises(
        ValueError, match=r"material.density.* unknown; allowed: .*material.C3$"
    ):
        named(skin, "material.density")
    with pytest.raises(ValueError, match='"relaxation": is found alone; allowed: '):
        named(skin, "relaxation")
