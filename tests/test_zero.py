"""Known weights: the update against Gaussian conditioning, presses in logs, the file."""

import tomllib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fitting.inverse_load.readings import _scale_note
from fitting.inverse_load.zero import from_log, update
from fitting.inverse_load.zero import zero as zero_module
from fitting.inverse_load.zero.from_log import zero_from_log
from fitting.inverse_load.zero.presses import (
    FORCE_ERROR,
    PLACE_ERROR,
    PressedFrames,
    frames_of_presses,
    known_press,
)
from fitting.inverse_load.zero.zero import Gaussian, Zero, conditioned
from fitting.inverse_load.zero.zero_file import (
    aged,
    read_zero,
    skin_with_zero,
    zero_file_of,
    zero_text,
    zeroed,
)
from suas_jax.config import ConfigError, InputErrors, UncertainQuantity, input_errors, load_skin
from suas_jax.config.inelastic import RelaxationSpec
from suas_jax.config.input_errors import STIFFNESS, WARMTH, as_assembled, stresses_of, value_of
from suas_jax.config.schema_calibration import CalibrationSpec

ROOT = Path(__file__).parent.parent / "configs/skins"
SKIN, PAD, ARC = (ROOT / f"{n}.toml" for n in ("suas", "suas-pad", "suas-flat-topped"))
GEOMETRY = load_skin(SKIN).geometry


def test_update_is_gaussian_conditioning() -> None:
    rng = np.random.default_rng(0)
    root, jacobian = rng.normal(size=(4, 4)), rng.normal(size=(7, 4))
    prior = Gaussian(rng.normal(size=4), root @ root.T)
    variance = rng.uniform(0.1, 2.0, 7)
    y = rng.normal(size=7)
    # Of the joint distribution of x and y: mean and covariance of x given y.
    across = prior.covariance @ jacobian.T
    total = jacobian @ across + np.diag(variance)
    mean = prior.mean + across @ np.linalg.solve(total, y - jacobian @ prior.mean)
    covariance = prior.covariance - across @ np.linalg.solve(total, across.T)
    at = rng.normal(size=4)  # anywhere: the model is linear
    found = conditioned(prior, at, jacobian, y - jacobian @ at, 1 / variance)
    assert found.mean == pytest.approx(mean)
    assert found.covariance == pytest.approx(covariance)


def test_what_was_not_measured_says_nothing() -> None:
    prior = Gaussian(np.array([1.0, 2.0]), np.diag([1.0, 4.0]))
    none = np.zeros(3)
    found = conditioned(prior, np.zeros(2), np.ones((3, 2)), none, none)
    assert found.mean == pytest.approx(prior.mean)
    assert found.covariance == pytest.approx(prior.covariance)


def test_presses_are_read_with_their_deviations() -> None:
    press = known_press("500 g at 10 deg", GEOMETRY)
    assert press.force == pytest.approx(0.5 * 9.80665)
    assert press.angle == pytest.approx(np.deg2rad(10))
    assert press.force_deviation == pytest.approx(FORCE_ERROR * press.force)
    assert press.angle_deviation == pytest.approx(PLACE_ERROR / 57.5e-3, rel=0.05)
    stated = known_press("5 N +- 0.1 N at 0 deg +- 2 deg", GEOMETRY)
    assert stated.force_deviation == pytest.approx(0.1)
    assert stated.angle_deviation == pytest.approx(np.deg2rad(2))
    along = known_press("0.5 kg at arc 10 mm", GEOMETRY)
    assert along.angle == pytest.approx(10 / 57.5)


def test_places_of_presses_are_told_as_scenes_tell_them() -> None:
    ellipse = load_skin(ROOT / "suas-ellipse.toml").geometry
    press = known_press("5 N at 40 deg +- 1 deg", ellipse)
    low, high = (known_press(f"5 N at {t} deg", ellipse) for t in (39, 41))
    assert press.place == pytest.approx(np.deg2rad(40))
    # The model's angle grows with the arc, by another rate than that of the ellipse.
    assert press.angle_deviation == pytest.approx((high.angle - low.angle) / 2, rel=1e-3)
    assert abs(press.angle_deviation / np.deg2rad(1) - 1) > 0.02
    assert known_press("5 N at arc 12 mm", load_skin(ARC).geometry).place == pytest.approx(
        12e-3
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("500 g", "FORCE at PLACE"),
        ("500 V at 0 deg", "force"),
        ("-5 N at 0 deg", "above zero"),
        ("5 N at 95 deg", "beyond the clamps of the skin, at -90 deg and 90 deg"),
        ("5 N at 0 deg, 20 mm", "no place along the axis"),
    ],
)
def test_presses_that_cannot_be_are_refused(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        known_press(text, GEOMETRY)


def test_angles_are_refused_where_a_section_has_none() -> None:
    geometry = load_skin(ARC).geometry
    if geometry.has_angle:
        pytest.skip("the section has angles")
    with pytest.raises(ValueError, match="arc 12 mm"):
        known_press("5 N at 0 deg", geometry)


def test_frames_of_presses_are_the_held_parts_in_order() -> None:
    rng = np.random.default_rng(2)
    patterns = np.array([[30.0, 10.0, -5.0], [-5.0, 10.0, 30.0]])
    level = np.zeros((60, 2))
    level[10:25, 0] = level[35:55, 1] = 1.0
    so = 1000 + level @ patterns + rng.normal(size=(60, 3))
    frames = frames_of_presses(so, patterns, 1.0)
    assert frames.rest.tolist() == list(range(10))
    assert frames.began == [10, 35]
    assert [run[0] for run in frames.pressed] == [15, 41]
    assert all(run[-1] < end for run, end in zip(frames.pressed, (24, 54), strict=True))
    # A light touch before is no rest, and a pull between both no press.
    level[3:6, 0], level[28:33] = 0.3, -1.0
    so = 1000 + level @ patterns + rng.normal(size=(60, 3))
    frames = frames_of_presses(so, patterns, 1.0)
    assert (frames.rest.tolist(), frames.began) == ([0, 1, 2, 6, 7, 8, 9], [10, 35])
    with pytest.raises(ValueError, match="holds 2 presses, but 3"):
        frames_of_presses(so, patterns[[0, 1, 0]], 1.0)
    with pytest.raises(ValueError, match="at rest before the first press"):
        frames_of_presses(np.concatenate([so[:2], so[10:]]), patterns, 1.0)
    # Readings hardly see a press on the crown of a flat-topped skin.
    with pytest.raises(ValueError, match=r"press 2 should change readings by 3\.0 counts at"):
        frames_of_presses(so, np.vstack([patterns, patterns[1] / 10])[[0, 2, 1]], 1.0)


@pytest.mark.parametrize(("deviation", "notes"), [(2.7e-18, 0), (1e-19, 1)])
def test_a_scale_that_a_zero_hardly_knows_agrees_with_the_headers(
    deviation: float, notes: int
) -> None:
    spec = load_skin(SKIN)
    lsb = 0.988 * spec.sensing.lsb
    found = CalibrationSpec(parameters=("electrodes.lsb",), covariance=((deviation**2,),))
    electrodes = spec.sensing.model_copy(update={"lsb": lsb})
    spec = spec.model_copy(update={"electrodes": electrodes, "calibration": found})
    assert len(_scale_note({"scale": "0.305 fF"}, spec)) == notes


@pytest.mark.parametrize("pad", [False, True])
def test_presses_in_columns_are_read_as_those_in_words(pad: bool) -> None:
    spec = load_skin(PAD if pad else SKIN)
    force = np.repeat([0.0, 4.9, 0.0, 7.3], 10)
    angle, axial = np.repeat([0.0, 0.3, 0.3, -0.2], 10), np.repeat([0.0, 0.011], 20)
    columns = {(0, "force"): force, (0, "angle"): angle} | (
        {(0, "axial"): axial} if pad else {}
    )
    log: Any = SimpleNamespace(path="log.csv", known=SimpleNamespace(values=columns))
    presses, frames = from_log._told_in_columns(spec, log, 8e-3 if pad else None)
    assert frames.rest.tolist() == list(range(10))
    assert frames.began == [10, 30]
    found = np.array([press.quantities for press in presses])
    own = [angle[[10, 30]], *([axial[[10, 30]]] if pad else []), force[[10, 30]]]
    np.testing.assert_allclose(found, np.array(own).T, rtol=1e-8)
    assert [press.diameter for press in presses] == ([8e-3] * 2 if pad else [0.0] * 2)
    columns[0, "direction"] = np.where(force > 5, 0.1, 0.0)
    with pytest.raises(ValueError, match=r"load_0_direction_deg is 5\.73 deg; a zero takes"):
        from_log._told_in_columns(spec, log, None)
    columns[1, "force"] = force
    with pytest.raises(ValueError, match="found beside it: load 1: force"):
        from_log._told_in_columns(spec, log, None)


def test_every_press_has_its_own_place_and_force() -> None:
    """Readings of press k move with the errors and with its own quantities alone."""
    rng = np.random.default_rng(3)
    by_press, by_error = rng.normal(size=(2, 3, 5)), rng.normal(size=(2, 4, 5))
    none = np.zeros(5), np.zeros((4, 5))
    jacobian = update._jacobian(update._Model(np.zeros((2, 5)), by_press, by_error, *none))
    e, x = rng.normal(size=4), rng.normal(size=(2, 3))
    moved = [e @ by_error[k] + x[k] @ by_press[k] for k in range(2)]
    np.testing.assert_allclose(jacobian @ np.concatenate([e, x.ravel()]), np.ravel(moved))


class Linear:
    """Readings of two presses that are linear in three errors, and in place and force."""

    def __init__(self, errors: Any, presses: Any, share: Any) -> None:
        rng = np.random.default_rng(7)
        self.by_error = 30 * rng.normal(size=(2, 3, 8))
        self.by_press = np.array([300.0, 20.0])[:, None] * rng.normal(size=(2, 2, 8))
        self.known = np.array([press.quantities for press in presses])
        # At rest all taxels move alike, by what the first two errors do together.
        self.rest_by_error = np.array([4.0, 3.0, 0.0])[:, None] * np.ones(8)

    def at(self, e: Any, x: Any) -> Any:  # noqa: D102
        change = np.einsum("e,pet->pt", e, self.by_error)
        change = change + np.einsum("pq,pqt->pt", x, self.by_press)
        rest = 100 + e @ self.rest_by_error
        return update._Model(change, self.by_press, self.by_error, rest, self.rest_by_error)


@pytest.mark.parametrize(("misfit", "status"), [(0.0, "ok"), (3.5, "poor_fit"), (40.0, "")])
def test_a_zero_is_the_posterior_of_its_presses(
    monkeypatch: pytest.MonkeyPatch, misfit: float, status: str
) -> None:
    """Conditioning of a linear model, its covariance as large as the misfit asks for."""
    monkeypatch.setattr(update, "PressModel", Linear)
    presses = tuple(known_press(f"{f} N at {a} deg", GEOMETRY) for f, a in ((5, 10), (9, -20)))
    errors: Any = [None] * 3
    rng, model = np.random.default_rng(8), Linear(errors, presses, 1.0)
    true, unsure = np.array([0.5, -1.0, 0.3]), np.array([0.03, 0.01])
    change = model.at(true, model.known).change + misfit * rng.normal(size=(2, 8))
    change[1, 3] = np.nan
    variance = rng.uniform(1.0, 4.0, (2, 8))
    readings = update.PressReadings(change, variance, np.ones(2), unsure)
    if not status:
        with pytest.raises(ValueError, match="no inputs within the tolerances"):
            update.zero_of(errors, presses, readings, 1e-2)
        return
    zero = update.zero_of(errors, presses, readings, 1e-2)
    weight = 1 / (variance + (1e-2 * change) ** 2)
    weight[1, 3] = change[1, 3] = 0.0
    deviations = np.array([press.deviations for press in presses])
    # A share of the force that nobody knows reads as a force that nobody knows.
    deviations[:, 1] = np.hypot(deviations[:, 1], [0.03 * 5, 0.01 * 9])
    prior = Gaussian(
        np.append(np.zeros(3), model.known), np.diag(np.append(np.ones(3), deviations**2))
    )
    at = model.at(np.zeros(3), model.known)
    residual = np.where(weight > 0, change - at.change, 0.0)
    jacobian = update._jacobian(at)
    found = conditioned(prior, prior.mean, jacobian, residual.ravel(), weight.ravel())
    left = residual.ravel() - jacobian @ (found.mean - prior.mean)
    ratio = float(weight.ravel() @ left**2) / (15 - 4)  # readings less places and forces
    assert zero.status == status
    assert zero.chi2_per_dof == pytest.approx(ratio)
    scale = ratio if status == "poor_fit" else 1.0
    own = scale * found.covariance[:3, :3]
    assert zero.posterior.mean == pytest.approx(found.mean[:3])
    assert zero.posterior.covariance == pytest.approx(own)
    told = [(zero.before, np.eye(3), weight), (zero.after, own, weight)]
    for name, share in (("half", 0.5), ("twice", 2.0)):
        x = found.mean[3:].reshape(2, 2) * [1.0, share]
        other = 1 / (variance + (1e-2 * model.at(found.mean[:3], x).change) ** 2)
        told.append((zero.after_at[name] * x[:, 1] / (5, 9), own, other * (weight > 0)))
    for of, covariance, weights in told:
        for k, force in enumerate((5, 9)):
            both = np.concatenate([model.by_error[k], model.by_press[k]])
            information = (both * weights[k]) @ both.T
            information[:3, :3] += np.linalg.inv(covariance)
            deviation = np.linalg.inv(information)[-1, -1] ** 0.5
            assert of[k] == pytest.approx(deviation / force)


def test_readings_at_rest_count_where_the_inputs_explain_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """They hold the errors that changes do not show; an offset of one taxel says nothing.

    The errors leave 5 counts open there, a scale that wanders until the zero is used 1.
    """
    monkeypatch.setattr(update, "PressModel", Linear)
    presses = (known_press("5 N at 10 deg", GEOMETRY), known_press("9 N at 0 deg", GEOMETRY))
    errors: Any = [None] * 3
    model, true = Linear(errors, presses, 1.0), np.array([0.6, -0.8, 0.3])
    change = model.at(true, model.known).change

    def zero_at(rest: Any) -> Zero:
        given = change, np.full((2, 8), 1e8), np.ones(2), np.zeros(2)  # presses tell nothing
        return update.zero_of(errors, presses, update.PressReadings(*given, rest, 0.01), 1e-4)

    for rest, told in ((np.full(8, 110.0), 10.0), (100 + 8.0 * np.eye(8)[3], 0.0), (None, 0.0)):
        zero = zero_at(rest)
        assert zero.at_rest == (told > 0)
        mean = zero.posterior.mean @ model.rest_by_error[:, 0]
        walked = 1200 * (3e-4 * 100) ** 2  # of a gain of 3e-4 / sqrt(s) in 20 minutes
        assert mean == pytest.approx(told * 25 / (25 + walked), abs=0.02)
        assert zero.rest_factor == (pytest.approx(1.1) if told else None)
    another_oil = zero_at(np.full(8, 150.0))
    assert (another_oil.at_rest, another_oil.rest_factor) == (False, 1.5)
    missing = zero_at(np.array([110.0, np.nan] * 4))
    assert missing.posterior.mean == pytest.approx(
        zero_at(np.full(8, 110.0)).posterior.mean, abs=0.02
    )


def test_a_step_beyond_all_states_is_halved() -> None:
    """Of 8 the model has states up to 3: half of a half of the way is the first with one."""

    def at(e: Any, x: Any) -> str:
        if e[0] > 3.0:
            raise ValueError
        return "state"

    model: Any = SimpleNamespace(known=np.zeros((1, 1)), at=at)
    reached, state = update._moved(model, np.zeros(2), np.array([8.0, 0.4]), 1)
    assert (reached.tolist(), state) == ([2.0, 0.1], "state")


def test_a_creeping_press_has_a_share_of_its_force(monkeypatch: pytest.MonkeyPatch) -> None:
    """Readings are 7 F^2 of the force that acts, whose share of the known one is 0.8."""

    def run(function: Any, skin: Any, loads: Any, state: Any, by_skin: Any, by: Any) -> Any:
        return (14 * loads.force * by.force)[:, 0][:, None]

    def forward(skin: Any, loads: Any) -> Any:
        return SimpleNamespace(solved=True, so=7 * loads.force**2, state=None)

    monkeypatch.setattr(update, "forward", forward)
    monkeypatch.setattr(update, "COMPILED", SimpleNamespace(run=run))
    monkeypatch.setattr(update, "changed_skin", lambda spec, skin, inputs: skin)
    monkeypatch.setattr(
        update, "skin_tangents", lambda s, skin, p, d: update._zeros(skin, len(d))
    )
    errors = input_errors(as_assembled(load_skin(SKIN)))
    model = update.PressModel(errors, [known_press("5 N at 0 deg", GEOMETRY)], 0.8)
    found = model.at(np.zeros(len(errors)), model.known)
    assert found.change.item() == pytest.approx(7 * (0.8 * 5) ** 2)
    assert found.by_press[0, -1].item() == pytest.approx(14 * (0.8 * 5) * 0.8)


def test_means_of_presses_know_their_frames_and_their_creep() -> None:
    """Of one relaxing term the load is 1 - g exp(-t (1 - g) / tau) of the constant one."""
    spec, g, tau = load_skin(SKIN), 0.2, 30.0
    relaxation = RelaxationSpec(g=(UncertainQuantity(g, 0.01),), tau=(tau,))
    material = spec.material.model_copy(update={"relaxation": relaxation})
    rng = np.random.default_rng(5)
    so, time = rng.normal(100, 1, (12, 3)), np.arange(12.0)
    so[8, 1] = np.nan
    frames = PressedFrames(np.arange(4), [np.array([7, 8, 9, 10])], [5])
    found = from_log._averaged(spec.model_copy(update={"material": material}), so, time, frames)
    mean = [np.nanmean(column[7:11]) - column[:4].mean() for column in so.T]
    assert found.change[0] == pytest.approx(mean)
    assert spec.electrodes is not None
    noise = spec.electrodes.noise**2 + 1 / 12
    assert found.variance[0] == pytest.approx(noise * (1 / np.array([4, 3, 4]) + 1 / 4))
    assert found.rest == pytest.approx(so[:4].mean(0))
    assert found.rest_variance == pytest.approx(np.full(3, noise / 4))

    def share(g: float) -> float:
        return float((1 - g * np.exp(-np.arange(2.0, 6.0) * (1 - g) / tau)).mean())

    assert found.share[0] == pytest.approx(share(g))
    slope = (share(g + 1e-6) - share(g - 1e-6)) / 2e-6
    expected = 0.01 * abs(slope) / share(g)
    assert found.share_deviation == pytest.approx([expected], rel=0.05)


def test_no_mean_of_a_press_takes_off_what_rounding_to_steps_does() -> None:
    """With steps of 16 and noise of 2 a mean of 900 readings is off by up to 8 counts."""
    spec, rng = load_skin(SKIN), np.random.default_rng(5)
    rest, change = rng.uniform(100, 199, 40), rng.uniform(0, 99, 40)
    true = np.repeat([rest, rest + change], 900, 0)
    so = 16 * np.rint((true + rng.normal(0, 2, (1800, 40))) / 16)
    frames = PressedFrames(np.arange(900), [np.arange(900, 1800)], [900])
    found = from_log._averaged(spec, so, np.arange(1800.0), frames)
    assert found.variance.min() > 2 * 255 / 12
    assert 0.3 < ((found.change - change) ** 2 / found.variance).mean() < 1.5


def made_up(skin: Path) -> Zero:
    """A zero of a skin with another mean and covariance of its errors."""
    rng = np.random.default_rng(4)
    errors = input_errors(as_assembled(load_skin(skin)))
    root = 0.2 * rng.normal(size=(len(errors), len(errors)))
    posterior = Gaussian(rng.normal(size=len(errors)), root @ root.T)
    press = known_press("500 g at 0 deg", GEOMETRY)
    return Zero(errors, posterior, (press,), np.array([0.14]), np.array([0.005]), 1.0, "ok")


def test_causes_are_told_by_kind_in_their_own_units(tmp_path: Path) -> None:
    text = SKIN.read_text().replace('"1.5 mm"', '"1.5 mm +- 0.06 mm"')
    skin = tmp_path / "skin.toml"
    skin.write_text(text)
    zero = made_up(skin)
    told = {cause.name: cause for cause in zero.causes}
    assert set(told) == {
        "stiffness",
        "filling",
        "mounting",
        "thickness",
        "gap",
        "permittivity",
        "scale",
    }
    moved = dict(zip(zero.errors.paths, zero.values, strict=True))
    assert told["thickness"].change == pytest.approx(moved["geometry.thickness"] / 1.5e-3 - 1)
    assert told["thickness"].before == pytest.approx(0.04)
    # Of all constants of the rubber, whatever their signs.
    assert told["stiffness"].before == pytest.approx(0.1)
    own = stresses_of(zero.errors.spec)
    for path, value in own.items():
        assert told["stiffness"].change == pytest.approx(moved[path] / value - 1)
    k = zero.errors.names.index("geometry.mounting")
    deviation = 5e-4 * zero.posterior.covariance[k, k] ** 0.5
    assert told["mounting"].deviation == pytest.approx(deviation)
    assert told["mounting"].text.endswith("% of the length")
    moved_most = [abs(cause.change) / cause.before for cause in zero.causes]
    assert moved_most == sorted(moved_most, reverse=True)


def test_an_uneven_sheet_is_one_cause() -> None:
    """Errors of a calibration mix its constants: told is what they do to the sheet's mean."""
    nodes = [f"geometry.thickness.value.{k}" for k in range(3)]
    sizes = np.array([1e-3, 2e-3, 3e-3])
    paths = (*nodes, "oil.fill")
    directions = np.array([[1e-5, 2e-5, -3e-5, 1e-4], [4e-5, 0.0, 1e-5, -2e-4]])
    names = ("calibration, a above all", "calibration, b above all")
    inputs: Any = dict(zip(paths, [*sizes, 1.0], strict=True))
    errors = InputErrors(paths, directions, names, (), inputs)
    posterior = Gaussian(np.array([0.5, -1.0]), np.array([[0.3, 0.1], [0.1, 0.6]]))
    zero = Zero(errors, posterior, (), np.zeros(0), np.zeros(0), 1.0, "ok")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(zero_module, "value_of", lambda spec, path: spec[path])
        found = {cause.name: cause for cause in zero.causes}
    assert set(found) == {"thickness", "filling"}
    total = directions[:, :3].sum(1) / sizes.sum()
    sheet = found["thickness"]
    assert sheet.change == pytest.approx(posterior.mean @ total)
    assert sheet.deviation == pytest.approx(np.sqrt(total @ posterior.covariance @ total))
    assert sheet.before == pytest.approx(np.sqrt(total @ total))
    assert sheet.text == "thickness -0.83 ± 0.65 %"


def test_a_zero_written_and_read_is_what_estimates_assume(tmp_path: Path) -> None:
    skin, log = tmp_path / "skin.toml", tmp_path / "log.csv"
    skin.write_bytes(SKIN.read_bytes())
    log.write_text("readings\n")
    zero = made_up(skin)
    path = zero_file_of(skin)
    path.write_text(zero_text(zero, skin, log))
    record = read_zero(path, skin)
    assert record.standard_errors == pytest.approx(np.sqrt(np.diag(zero.covariance)))
    row = tomllib.loads(path.read_text())["press"][0]
    assert (row["force_deviation_before"], row["force_deviation_after"]) == ("14 %", "0.5 %")
    spec = zeroed(load_skin(skin), record)
    for name, value in zip(zero.errors.paths, zero.values, strict=True):
        assert value_of(spec, name) == pytest.approx(value)
    found = input_errors(as_assembled(spec))
    assert found.assumed == ()
    order = [found.paths.index(name) for name in zero.errors.paths]
    columns = found.directions[:, order]
    size = np.sqrt(np.diag(zero.covariance))
    scale = np.outer(size, size)
    assert columns.T @ columns / scale == pytest.approx(zero.covariance / scale, abs=1e-4)


def test_a_zero_of_another_skin_or_another_file_is_refused(tmp_path: Path) -> None:
    skin, log = tmp_path / "skin.toml", tmp_path / "log.csv"
    skin.write_bytes(SKIN.read_bytes())
    log.write_text("readings\n")
    path, text = zero_file_of(skin), zero_text(made_up(skin), skin, log)
    for changed, message in (
        (text.replace("[zero]", "[other]"), "other"),
        (text.replace("values = [", "values = [nan, "), "finite entries"),
        ("[geometry]\n", "geometry"),
    ):
        path.write_text(changed)
        with pytest.raises(ConfigError, match=message):
            read_zero(path, skin)
    path.write_text(text)
    skin.write_text(skin.read_text() + "# changed\n")
    with pytest.raises(ConfigError, match="run suas zero again"):
        read_zero(path, skin)


def test_a_zero_in_the_place_of_its_skin_file_is_named(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("readings\n")
    path = tmp_path / "zeroed.toml"
    path.write_text(zero_text(made_up(SKIN), SKIN, log))
    with pytest.raises(ConfigError, match="give the skin file, and this with --zero"):
        skin_with_zero(path)


def test_presses_on_a_pad_have_a_place_along_its_axis() -> None:
    geometry = load_skin(PAD).geometry
    press = known_press("500 g at 10 deg, 20 mm +- 0.5 mm", geometry, diameter=8e-3)
    assert press.quantities == pytest.approx((np.deg2rad(10), 20e-3, 0.5 * 9.80665))
    assert press.deviations[1] == pytest.approx(0.5e-3)
    assert press.diameter == pytest.approx(8e-3)
    assert known_press("5 N at arc 3 mm, 0 mm", geometry).axial_deviation == PLACE_ERROR
    edge = 1e3 * float(geometry.width) / 2 - 3.0  # of a fingertip of 6 mm [mm]
    known_press(f"5 N at 0 deg, {edge - 0.01} mm", geometry)
    for text, message in (
        ("5 N at 0 deg", "place along the axis is needed"),
        (f"5 N at 0 deg, {edge + 0.01} mm", "does not lie on the pad"),
        ("5 N at 0 deg, 5 N", "5 N"),
    ):
        with pytest.raises(ValueError, match=message):
            known_press(text, geometry)


@pytest.mark.parametrize("known", [(), ("5 N at 0 deg",)])
def test_a_zero_of_another_fluid_is_refused(tmp_path: Path, known: tuple[str, ...]) -> None:
    """Air between skin and wall answers otherwise than the oil, and reads less."""
    names = ",".join(f"so_{k + 1}" for k in range(8))
    top = f"# format: suas-so-log\n# fluid: air\nt_host_s,t_device_s,seq,module,{names}"
    log = tmp_path / "air.csv"
    log.write_text("\n".join([top, *(f"{i},{i},{i},0" + ",75" * 8 for i in range(9))]) + "\n")
    with pytest.raises(ValueError, match=r'air.csv: its fluid is "air"'):
        zero_from_log(load_skin(SKIN), log, known)


# Compiles readings under presses with their derivatives, the simulation, and an estimator.
@pytest.mark.long
def test_one_weight_sets_the_forces_right(tmp_path: Path) -> None:
    from typer.testing import CliRunner

    from fitting import LoadEstimator, readings_of
    from fitting.cli.commands import app
    from suas_jax import read_log
    from suas_jax.simulation.simulated_log import simulate_log, write_simulated_log

    text = SKIN.read_text()
    skin = tmp_path / "skin.toml"
    skin.write_text(text)
    # What nobody measured: less oil, a softer rubber.
    true = text.replace('model = "incompressible"', 'model = "incompressible"\nfill = 0.998')
    material = 'law = "mooney-rivlin"\nC1 = "19.2 MPa"\nC2 = "-4.08 MPa"\nC3 = "71.5 kPa"'
    (tmp_path / "true.toml").write_text(true.replace('preset = "epdm-paper"', material))
    (tmp_path / "scene.toml").write_text(
        'skin = "true.toml"\n[[load]]\nkind = "line"\nangle = "0 deg"\nforce = "10 N"\n'
    )
    logs = {}
    for name, rows in (
        ("weight", [(0, 0, 0), (1, 0, 0), (1.1, 10, 0), (4, 10, 0)]),
        ("use", [(0, 10, 0), (1, 10, 0), (2, 10, 30), (3, 5, 0), (4, 14, 0)]),
    ):
        path = tmp_path / f"{name}_path.csv"
        lines = "\n".join(",".join(map(str, row)) for row in rows)
        head = "# scene: scene.toml\nt_s,loads.0.force_N,loads.0.angle_deg\n"
        path.write_text(f"{head}{lines}\n")
        logs[name] = tmp_path / f"{name}.csv"
        log = simulate_log(path, rate=20.0, seed=5, settings={"noise": 0.5})
        write_simulated_log(log, logs[name], path)
    run = CliRunner().invoke(
        app, ["zero", str(skin), str(logs["weight"]), "--known", "10 N at 0 deg"]
    )
    assert run.exit_code == 0, run.output
    assert "half as large ones to" in run.output
    record = read_zero(zero_file_of(skin), skin)
    spec = load_skin(skin)
    readings = readings_of(read_log(logs["use"]), spec, None)
    place = np.interp(readings.time, [0, 1, 2, 3, 4], [0, 0, 30, 0, 0])
    force = np.interp(readings.time, [0, 1, 2, 3, 4], [10, 10, 10, 5, 14])
    for own, least, most in ((spec, 0.1, 0.5), (zeroed(spec, record), 0.003, 0.02)):
        found = LoadEstimator(own, noise=0.5).estimate(readings.so)
        told = np.array([e.contacts[0].force for e in found])
        deviation = np.array([e.contacts[0].deviation("force") for e in found])
        error = told - force
        here = (np.abs(place) < 1) & (np.abs(force - 10) < 0.1)
        assert least < deviation[here].mean() / 10 < most
        assert (np.abs(error) < 3 * deviation).mean() > 0.97
    assert np.abs(error[here]).mean() / 10 < 0.02  # with the zero
    assert deviation[~here].mean() > deviation[here].mean()  # and less sure elsewhere


# Compiles the readings of a pad under presses with their derivatives.
@pytest.mark.long
def test_one_weight_sets_a_pad_s_forces_right_where_it_stood() -> None:
    errors = input_errors(as_assembled(load_skin(PAD)))
    press = known_press("10 N at 0 deg, 0 mm", errors.spec.geometry)
    # A softer rubber than the file's: readings tell F / C alone, so that the modulus, known to
    # 10 % of the file's, leaves more than that of a force.
    e = np.array([0.8 * (-1) ** (k + 1) for k in range(len(errors))])
    assert e[errors.names.index(STIFFNESS)] < 0
    true = update.PressModel(errors, [press])
    change = true.at(e, true.known).change
    readings = update.PressReadings(change, np.full_like(change, 0.1), np.ones(1))
    zero = update.zero_of(errors, (press,), readings, 1e-2)
    assert zero.before[0] > 0.1
    assert zero.after[0] < 0.02
    # What the zero leaves of the errors does not move the force it was found with.
    now = true.at(zero.posterior.mean, true.known)
    assert np.abs(now.change - change).max() < 0.02 * np.abs(change).max()
    # Derivatives of the readings by the errors, against differences.
    for k in range(len(errors)):
        step = 1e-3 * np.eye(len(errors))[k]
        high, low = (true.at(e + s * step, true.known).change for s in (1, -1))
        by = true.at(e, true.known).by_error[0, k]
        assert np.abs((high - low)[0] / 2e-3 - by).max() < 1e-3 * np.abs(by).max() + 1e-4


def test_an_old_zero_knows_less_of_forces_where_nothing_tells_the_temperature() -> None:
    """The variance of a temperature that walks at random grows with time, to its tolerance."""
    spec = load_skin(SKIN)
    names = ("oil.fill", "environment.temperature")
    covariance = ((1e-6, 2e-4), (2e-4, 0.25))
    record = CalibrationSpec(
        parameters=names,
        values=(1.0, 290.0),
        covariance=covariance,
        taken="2026-01-01T10:00:00+00:00",
    )
    zeroed_spec = spec.model_copy(update={"calibration": record})

    def grown(begin: str, lasts: float = 0.0) -> float:
        found, said = aged(zeroed_spec, begin, lasts)
        assert found.calibration is not None
        own = np.array(found.calibration.covariance)
        assert own[0, 0] == covariance[0][0]
        assert own[0, 1] == covariance[0][1]
        assert bool(said) == (own[1, 1] > covariance[1][1])
        return float(own[1, 1]) - covariance[1][1]

    assert grown("2026-01-01T10:00:00+00:00") == 0.0
    assert grown("2026-01-01T10:15:00+00:00") == pytest.approx(WARMTH**2 / 4)
    assert grown("2026-01-01T10:00:00+00:00", 900.0) == pytest.approx(WARMTH**2 / 4)
    # A log from before the zero is farther away where it begins.
    for lasts in (0.0, 900.0, 1800.0):
        assert grown("2026-01-01T09:45:00+00:00", lasts) == pytest.approx(WARMTH**2 / 4)
    assert grown("2026-01-03T10:00:00+00:00") == pytest.approx(WARMTH**2)
    # Where nothing tells the time, it may be any.
    for unknown in ("", "yesterday", "2026-01-01T12:00:00"):
        assert grown(unknown) == pytest.approx(WARMTH**2)
        assert "start_time" in aged(zeroed_spec, unknown)[1][0]
    assert aged(spec, "2026-01-03T10:00:00+00:00") == (spec, [])
