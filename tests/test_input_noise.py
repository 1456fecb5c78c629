"""Errors of known forces and displacements, and zeros that are off, in a skin's calibration."""

import dataclasses
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from test_sensor_formulas import logged

from fitting.cli.fit_sensor import _input_noise, _prior
from fitting.sensor.fit import assumptions
from fitting.sensor.fit.calibrate import fit_sensor
from fitting.sensor.fit.input_noise import InputErrors, InputNoise, noise_sentences, settled
from fitting.sensor.fit.residuals import SensorResiduals
from fitting.sensor.fit.result import SensorFit
from fitting.sensor.fit.suspects import OFFSET, ZeroOff, sentence
from fitting.sensor.logs.data import SensorData, _means, load_sensor_data
from fitting.sensor.logs.known_loads import KnownLoads
from fitting.sensor.logs.shared_errors import SharedErrors, apart
from fitting.sensor.model.constants import FORCE_ZERO, TOUCH, SensorFamily, named
from fitting.sensor.model.counts import SensorModel, parts_of
from fitting.sensor.report.skin_file import calibrated_skin
from fitting.sensor.report.summary import sensor_report
from fitting.sensor.shapes.deformations import deform
from fitting.sensor.shapes.state_programs import Moving
from suas_jax.config import continuous_inputs, load_skin

SKIN = Path(__file__).parent.parent / "configs/skins/suas.toml"
SPEC = load_skin(SKIN)
PERMITTIVITY, GAP, ANGLE = 2.35, 5.2e-3, 20.0
RNG = np.random.default_rng(4)


# --- formulas -----------------------------------------------------------------------------


def shared(taxels: int = 3, states: int = 4) -> SharedErrors:
    """Of two loads; the first state is exact."""
    deviation = RNG.uniform(0.2, 2.0, (2, states))
    deviation[:, 0] = 0.0
    return SharedErrors(RNG.normal(size=(2, taxels, states)), deviation)


def covariance(errors: SharedErrors, state: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """I + S S^T of all readings, taxel after taxel."""
    taxels, frames = sigma.shape
    found = np.eye(taxels * frames)
    for load in range(len(errors.slopes)):
        for k in range(errors.states):
            column = errors.slopes[load][:, state] * errors.deviation[load, k] / sigma
            column = np.where(state == k, column, 0.0).reshape(-1)
            found += np.outer(column, column)
    return found


def residuals_of(here: Any) -> SensorResiduals:
    """The residuals of some readings of a model without constants."""
    whitening, basis = here.whitening(), here.basis(here.sigma)
    parts = whitening.columns, whitening.root, here.untangling(basis)
    return SensorResiduals(
        family=None,
        model=None,
        state=jnp.asarray(here.state),
        value=jnp.asarray(here.so.reshape(-1)),
        inverse_scale=jnp.asarray(np.where(here.used, 1 / here.sigma, 0).reshape(-1)),
        basis=jnp.asarray(basis),
        mixing=None,
        shared=tuple(map(jnp.asarray, parts)),
    )


@pytest.mark.parametrize("offsets", [False, True])
@pytest.mark.parametrize("drifting", [False, True])
def test_least_squares_has_the_covariance_of_what_readings_share(
    offsets: bool, drifting: bool
) -> None:
    """Residuals' sum of squares, offsets and drifts are those of dense generalised squares."""
    here = logged(16, 3, offsets=offsets, drifting=drifting, state=np.arange(16) // 4)
    here = dataclasses.replace(
        here, sigma=RNG.uniform(1, 3, here.so.shape), input_errors=shared()
    )
    K = covariance(here.input_errors, here.state, here.sigma)
    whitening = here.whitening()
    assert whitening is not None
    assert whitening.log_determinant == pytest.approx(np.linalg.slogdet(K)[1])
    off = RNG.normal(size=here.so.shape)
    r = (off / here.sigma).reshape(-1)
    columns = [
        np.where(np.arange(3)[:, None] == t, column / here.sigma, 0.0).reshape(-1)
        for t in range(3)
        for column in here.columns().T
    ]
    inverse = np.linalg.inv(K)
    expected = r @ inverse @ r
    if columns:
        A = np.array(columns).T
        bound = np.linalg.pinv(A.T @ inverse @ A)
        numbers = bound @ (A.T @ inverse @ r)
        expected -= numbers @ (A.T @ inverse @ r)
        found, errors = here.taken_out(off)
        np.testing.assert_allclose(found.reshape(-1), numbers, rtol=1e-8, atol=1e-12)
        np.testing.assert_allclose(errors.reshape(-1), np.sqrt(np.diag(bound)), rtol=1e-8)
    own = residuals_of(here)._of_predicted(jnp.asarray((here.so + off).reshape(-1)))
    assert float(jnp.sum(own**2)) == pytest.approx(expected)


def test_whitened_residuals_are_independent_and_tell_the_errors() -> None:
    here = dataclasses.replace(logged(8, 3, state=np.arange(8) // 2), input_errors=shared())
    K = covariance(here.input_errors, here.state, here.sigma)
    unit = np.eye(24).reshape(24, 3, 8)
    W = np.array([here.whitened(one).reshape(-1) for one in unit]).T
    np.testing.assert_allclose(W @ K @ W.T, np.eye(24), atol=1e-10)
    # A reading that is not used is told by the others, and tells nothing.
    used = here.used.copy()
    used[1, 3] = False
    less = dataclasses.replace(here, used=used)
    r = RNG.normal(size=(3, 8))
    odd = r.copy()
    odd[1, 3] += 100.0
    np.testing.assert_allclose(less.whitened(odd)[used], less.whitened(r)[used])
    told = here.input_errors
    size = (told.slopes * told.deviation[:, None])[..., here.state] / here.sigma
    for k in range(4):
        S = np.where(here.state == k, size, 0.0).reshape(2, -1).T
        e = S.T @ np.linalg.inv(np.eye(24) + S @ S.T) @ r.reshape(-1) * told.deviation[:, k]
        np.testing.assert_allclose(here.shared(r)[:, k], e, atol=1e-12)


def test_every_stretch_of_frames_under_a_load_has_an_error_of_its_own() -> None:
    force = np.array([[0.0, 5.0]])
    loads = KnownLoads.pushes(0 * force, force)
    state = np.array([0, 1, 1, 0, 1, 1, 1, 0])
    log = np.array([0, 0, 0, 0, 0, 0, 1, 1])
    nan, so = np.full(2, np.nan), np.zeros((3, 8))
    unused = np.array([[np.nan, 2.0]])
    data = SensorData(SPEC, so, so[0], log, state, loads, nan, (), (), (), unused=unused)
    own = apart(data)
    np.testing.assert_array_equal(own.state, [0, 1, 1, 0, 2, 2, 3, 0])
    np.testing.assert_array_equal(own.loads.force, [[0, 5, 5, 5]])
    np.testing.assert_array_equal(own.unused, [[np.nan, 2, 2, 2]])
    assert own.permittivity.shape == (4,)


def test_known_loads_without_what_is_off() -> None:
    force = np.array([[0.0, 5.0, np.nan, np.nan]])
    loads = KnownLoads.pushes(0 * np.nan_to_num(force), force)
    travel = np.array([[np.nan, np.nan, 2e-3, 0.0]])
    loads = dataclasses.replace(loads, displacement=travel)
    np.testing.assert_array_equal(loads.pressed, [[False, True, True, False]])
    off = loads.zeros(1e-4, 0.3)
    np.testing.assert_allclose(off, [[0.0, 0.3, 1e-4, 0.0]])
    less = loads.less(off)
    np.testing.assert_allclose(less.force, [[0, 4.7, np.nan, np.nan]])
    np.testing.assert_allclose(less.displacement, [[np.nan, np.nan, 1.9e-3, 0]])
    more, step = loads.stepped(0)
    np.testing.assert_allclose(step, [0, 5e-3, 2e-6, 0])
    np.testing.assert_allclose(more.force[0, :2], [0, 5.005])


def test_what_else_is_told_of_line_loads_has_columns_of_its_own() -> None:
    force = np.array([[0.0, 5.0, 5.0]])
    loads = KnownLoads.pushes(np.array([[0.1, 0.1, -0.1]]), force)
    told = loads.told(3)  # amounts, places, directions
    np.testing.assert_array_equal(told["force"][:, 1], [1, 0, 0])
    np.testing.assert_array_equal(told["place"][:, 1], [0, 1, 0])
    np.testing.assert_array_equal(told["direction"], [[0] * 3, [0] * 3, [0, 1, 1]])
    assert "place" not in loads.told(1)
    moved, step = loads.turned(0, "place")
    assert step[0] == 0
    assert (np.sign(step[1:]) == [-1, 1]).all()
    np.testing.assert_allclose(moved.angle[0] - loads.angle[0], step)


def test_zeros_that_shapes_lack_already_are_not_counted_twice() -> None:
    # The derivative by a touch of 0.1 mm was taken where no equilibrium is, and zero there.
    moving = Moving.of({"thickness": 2e-3, TOUCH: 1e-4, FORCE_ZERO: 0.3})
    np.testing.assert_array_equal(moving.values, [2e-3, 0.0, 0.0])
    assert float(moving.shift(TOUCH, jnp.array([2e-3, 1e-6, 0.0]))) == 1e-6


def test_deviations_are_settled_and_read() -> None:
    assert settled(InputNoise({"force": 0.2}), InputNoise({"force": 0.201}))
    assert not settled(InputNoise({}), InputNoise({"force": 0.2}))
    assert _input_noise(None, None) is None
    assert _input_noise("200 mN", None) == {"force": 0.2}
    travel = _input_noise(None, "0.05 mm")
    assert travel == {"displacement": pytest.approx(5e-5), "depth": pytest.approx(5e-5)}
    assert _prior("touch=0 mm +- 0.1 mm") == ("touch", (0.0, pytest.approx(1e-4)))
    assert _prior("force_zero=0 N +- 0.1 N") == ("force_zero", (0.0, 0.1))


def test_errors_that_neighbours_share_are_called_no_noise() -> None:
    """A common zero, which `sentence` is about, is no order."""
    white = RNG.normal(size=(1, 40))
    smooth = np.sin(np.arange(40) / 6)[None]
    one = np.full((1, 40), 0.2)
    pushed = KnownLoads.pushes(0 * one, one)
    told = InputErrors(np.ones((1, 3, 40)), InputNoise({"force": 0.2}))
    for e, words in ((white + 3, "noise of a load cell"), (smooth, "no noise")):
        here: Any = type("Readings", (), {"input_errors": SharedErrors(told.slopes, one)})()
        here.shared = lambda r, e=e: e
        own: Any = type("Problem", (), {"readings": here})()
        own.standardised = lambda *_, **__: None
        (text,) = noise_sentences(own, np.ones(1), pushed, told)
        assert "0.2 N (standard deviation)" in text
        assert words in text
    turned = told._replace(slopes=np.ones((3, 3, 40)), noise=InputNoise({"direction": 0.05}))
    here.shared = lambda r: np.pad(0.02 + 0.05 * white, ((2, 0), (0, 0)))
    (text,) = noise_sentences(own, np.ones(1), pushed, turned)
    assert "known directions are off those that the counts show by 2.9 deg" in text
    assert "in the mean, as of friction" in text
    stated = told._replace(noise=InputNoise({"force": 0.2}, True))
    assert not noise_sentences(own, np.ones(1), pushed, stated)


def test_zeros_that_are_off_are_named_with_what_finds_them() -> None:
    family = SensorFamily((named(SPEC, "permittivity"), named(SPEC, "gap")))
    model: Any = type("Model", (), {"inputs": {"electrodes.lsb": 3.05e-16}})()
    problem: Any = type("Problem", (), {"family": family, "model": model})()
    zeros = [
        ZeroOff(TOUCH, 1e-4, 1e-5, 100.0, 0.0),
        ZeroOff(FORCE_ZERO, -0.3, 0.02, 101.0, 0.0),
        ZeroOff(OFFSET, 20.0, 2.0, 102.0, 0.0),
    ]
    text = sentence(zeros, problem)
    assert "displacements are 0.1 +- 0.01 mm too large" in text
    assert "--fit relative_permittivity,oil_gap,touch" in text
    assert "forces are 0.3 +- 0.02 N too small" in text
    assert "--fit relative_permittivity,oil_gap,force_zero" in text
    assert "20 +- 2 counts too many, an offset, or stray capacitance of 6.1 fF: --off" in text


def test_forces_that_contradict_displacements_are_told_with_their_size() -> None:
    np.testing.assert_array_equal(
        _means(np.array([[1.0, 3.0, np.nan]]), np.array([0, 0, 1]), 2), [[2.0, np.nan]]
    )
    travel = np.array([[0.0, 1e-3, 2e-3]])
    loads = KnownLoads.pushes(0 * travel, np.nan * travel)
    loads = dataclasses.replace(loads, displacement=travel)
    force, so = np.array([[0.0, 4.0, 8.0]]), np.zeros((3, 3))
    data = SensorData(SPEC, so, so[0], so[0], so[0], loads, so[0], (), (), ())
    family = SensorFamily((named(SPEC, "gap"),))
    assert not assumptions.contradiction_warning(family, data, force, travel)
    for factor, told in ((1.0, False), (1.15, False), (1.3, True)):
        own = dataclasses.replace(data, unused=factor * force)
        text = assumptions.contradiction_warning(family, own, force, travel)
        assert bool(text) == told
    assert "known forces are 1.3 times" in text
    assert "(10.4 N for 8 N)" in text


# --- made logs ----------------------------------------------------------------------------

FORCE = np.concatenate([np.zeros(12), np.linspace(0, 8, 28), np.linspace(8, 0, 20)])


@pytest.fixture(scope="module")
def truth() -> tuple[np.ndarray, np.ndarray]:
    """Counts of the shell under known forces [taxel, frame], and displacements [frame]."""
    return counts_under(0 * FORCE)


def counts_under(turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same of forces that are turned [frame] [rad]."""
    inputs = {k: jnp.asarray(v, float) for k, v in continuous_inputs(SPEC).items()}
    geometry, law, oil, _ = parts_of(SPEC, inputs)
    force = FORCE[None]
    loads = KnownLoads.pushes(np.deg2rad(ANGLE) + 0 * force, force)
    loads = dataclasses.replace(loads, turn=turn[None])
    shape = deform(loads, geometry, law, oil)
    family = SensorFamily((named(SPEC, "permittivity"), named(SPEC, "gap")))
    at, none = jnp.array([PERMITTIVITY, GAP]), jnp.full(len(FORCE), jnp.nan)
    model = SensorModel(inputs, shape.face, None, at, none, None, SPEC, family)
    return np.asarray(model.so(at)), np.where(FORCE > 0, shape.displacement[0], 0.0)


def fitted(
    path: Path, so: np.ndarray, column: str, values: np.ndarray, *names: str, **options: Any
) -> SensorFit:
    """A calibration by a log with noise of two counts."""
    counts = np.rint(so + 2 * np.random.default_rng(1).standard_normal(so.shape)).astype(int)
    rows = [
        ",".join([f"{i / 50},{i / 50},{i},0", *map(str, own), repr(float(x))])
        for i, (own, x) in enumerate(zip(counts.T, values, strict=True))
    ]
    head = ",".join(["t_host_s,t_device_s,seq,module", *(f"so_{k + 1}" for k in range(8))])
    header = f"# format: suas-so-log\n# scale: 0.305 fF\n# load_0_angle_deg: {ANGLE}\n"
    path.write_text("\n".join([f"{header}{head},{column}", *rows]) + "\n")
    data = load_sensor_data(SPEC, [path])
    return fit_sensor(data, names or ("permittivity", "gap"), model="shell", **options)


def pulls(fit: SensorFit) -> np.ndarray:
    """Errors of permittivity and gap in standard errors."""
    return (fit.constants[:2] - [PERMITTIVITY, GAP]) / fit.uncertainty.standard_errors[:2]


def test_a_load_cell_s_noise_is_found_and_counts(
    truth: tuple[np.ndarray, np.ndarray], tmp_path: Path
) -> None:
    """Forces that were taken as exact made this gap 1.2 % wrong, and cost five taxels."""
    told = FORCE + 0.5 * np.random.default_rng(3).standard_normal(len(FORCE))
    fit = fitted(tmp_path / "a.csv", truth[0], "load_0_force_N", told)
    assert fit.input_errors.noise.deviation["force"] == pytest.approx(0.5, rel=0.25)
    assert np.abs(pulls(fit)).max() < 2.0
    assert not fit.masked
    (text,) = [w for w in fit.warnings if "--force-noise" in w]
    assert "as the noise of a load cell is" in text
    assert sensor_report(fit)["input_noise"] == fit.input_errors.noise._asdict()
    stated = fitted(
        tmp_path / "a.csv", truth[0], "load_0_force_N", told, input_noise={"force": 0.1}
    )
    assert any("--force-noise states 0.1 N" in w for w in stated.warnings)


def test_friction_of_known_forces_is_found_and_counts(tmp_path: Path) -> None:
    """Forces 3 degrees off the radial counted as a load cell's noise, which they are not."""
    turn = np.deg2rad(3.0) * np.random.default_rng(5).standard_normal(len(FORCE))
    fit = fitted(tmp_path / "a.csv", counts_under(turn)[0], "load_0_force_N", FORCE)
    found = fit.input_errors.noise.deviation
    assert found["direction"] == pytest.approx(np.deg2rad(3.0), rel=0.3)
    assert not found["force"]
    assert np.abs(pulls(fit)).max() < 2.0
    assert any("as of friction" in w for w in fit.warnings)


def test_a_touch_that_is_off_is_named(
    truth: tuple[np.ndarray, np.ndarray], tmp_path: Path
) -> None:
    so, travel = truth
    told = np.where(travel > 0, 1e3 * travel + 0.15, 0.0)
    column = "load_0_displacement_mm"
    fit = fitted(tmp_path / "a.csv", so, column, told)
    assert pulls(fit)[1] > 10
    (text,) = [w for w in fit.warnings if "wrong as they stand" in w]
    assert "mm too large" in text
    assert " or if " not in text


@pytest.mark.long  # derivatives of the shapes by the touch
def test_a_touch_that_is_off_is_found(
    truth: tuple[np.ndarray, np.ndarray], tmp_path: Path
) -> None:
    so, travel = truth
    told = np.where(travel > 0, 1e3 * travel + 0.15, 0.0)
    column = "load_0_displacement_mm"
    free = fitted(tmp_path / "a.csv", so, column, told, "permittivity", "gap", "touch")
    assert np.abs(pulls(free)).max() < 3
    error = free.uncertainty.standard_errors[2]
    assert abs(free.constants[2] - 1.5e-4) < 3 * error < 1e-4
    assert "touch" in calibrated_skin(SKIN, free)


def test_an_offset_of_all_counts_is_named(
    truth: tuple[np.ndarray, np.ndarray], tmp_path: Path
) -> None:
    so, travel = truth
    fit = fitted(tmp_path / "a.csv", so + 40, "load_0_displacement_mm", 1e3 * travel)
    (text,) = [w for w in fit.warnings if "wrong as they stand" in w]
    assert "counts too many, an offset" in text
    assert "--offsets" in text
    clean = fitted(tmp_path / "a.csv", so, "load_0_displacement_mm", 1e3 * travel)
    assert not clean.warnings
    assert np.abs(pulls(clean)).max() < 3
