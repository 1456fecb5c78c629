"""Formulas of a skin as it was built, and of the next press, against closed forms."""

import dataclasses
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import tomlkit
from scipy.stats import multivariate_normal
from typer.testing import CliRunner

from fitting.calibration import next_press
from fitting.calibration.next_press import Candidates, force_errors, planned, told_by
from fitting.calibration.plan import Press
from fitting.calibration.plan_figure import plot_plan
from fitting.cli.app import app
from fitting.inverse_load.settings import MODEL_ERROR as ESTIMATOR_ERROR
from fitting.inverse_load.settings import PAD_MODEL_ERROR
from fitting.sensor.fit.calibrate import _as_built
from fitting.sensor.fit.priors import hierarchical
from fitting.sensor.fit.residuals import Prior, SensorProblem, SensorResiduals
from fitting.sensor.fit.search import search
from fitting.sensor.fit.sensor_posterior import sample_sensor
from fitting.sensor.fit.settling import settled_shapes
from fitting.sensor.logs.data import SensorData
from fitting.sensor.logs.known_loads import KnownLoads
from fitting.sensor.logs.readings import LoggedCounts, averaged, held_presses
from fitting.sensor.model.as_built import (
    FORCE_ERROR,
    GAIN_ERROR,
    MODEL_ERROR,
    Alike,
    PlaceErrors,
    as_built,
    as_built_deviations,
    as_built_names,
    is_gain,
    press_errors,
    shift_of_loads,
)
from fitting.sensor.model.constants import (
    STIFFNESS,
    SensorConstant,
    SensorFamily,
    named,
    with_constants,
)
from fitting.sensor.model.counts import SensorModel, parts_of
from fitting.sensor.report.skin_file import _set_as_built
from fitting.sensor.shapes.scene_states import SceneStates
from fitting.sensor.shapes.state_programs import TaxelFace
from fitting.statistics.posterior import Settings
from fitting.statistics.residuals import AbstractResiduals
from suas_jax.config import UncertainQuantity, continuous_inputs, load_skin
from suas_jax.config.input_errors import input_errors
from suas_jax.config.schema_calibration import CalibrationSpec
from suas_jax.sensing.taxels import DISC, by_taxel
from suas_jax.skin.plain import plain_geometry

RNG = np.random.default_rng(0)
ROOT = Path(__file__).parent.parent
SKIN = load_skin(ROOT / "configs/skins/suas.toml")
PAD = load_skin(ROOT / "configs/skins/suas-pad.toml")
# Twenty taxels of it: no formula knows how many there are.
PART = PAD.model_copy(
    update={
        "electrodes": PAD.electrodes.model_copy(update={"modules": PAD.electrodes.modules[:2]})
    }
)
RADIUS = float(plain_geometry(SKIN.geometry).section.size[0])  # [m]


def test_a_skin_as_built_has_the_drawing_s_values() -> None:
    for spec, nodes in ((SKIN, 5), (PAD, 9)):
        own = as_built(spec)
        inputs = continuous_inputs(own)
        names = as_built_names(own)
        taxels = sum(own.electrodes.taxels_by_module.values())
        assert len(names) == 4 + 2 * nodes + taxels
        before = continuous_inputs(spec)
        for name in names:
            value = named(own, name).size if name != "mounting" else 0.0
            if name.startswith("geometry."):
                assert value == before[".".join(name.split(".")[:2])] == inputs[name]
            elif "gain" in name:
                assert inputs[name] == 1.0
        assert as_built(own) == own  # tables and gains that there are stay
        changed = inputs | {names[-1]: 1.02}
        gain = np.asarray(by_taxel(own.electrodes, changed, "gain", 1.0)).reshape(-1)
        np.testing.assert_allclose(gain, np.r_[np.ones(taxels - 1), 1.02])


def test_fields_have_a_common_and_a_smooth_part() -> None:
    """C = s^2 (1 + exp(-|x - x'|^2 / (2 l^2))), of the file's own deviation where stated."""
    thickness = UncertainQuantity(1.5e-3, 0.015e-3)
    geometry = SKIN.geometry.model_copy(update={"thickness": thickness})
    drawing = SKIN.model_copy(update={"geometry": geometry})
    own = as_built(drawing)
    parts = [named(own, name) for name in as_built_names(own)]
    deviations, correlation = as_built_deviations(drawing, parts)
    names = [part.name for part in parts]
    i, j = (names.index(f"geometry.thickness.value.{k}") for k in (1, 3))
    covariance = correlation[i, j] * deviations[names[i]] * deviations[names[j]]
    expected = 0.015e-3**2 * (1 + np.exp(-(0.5**2) / (2 * 0.25**2)))
    assert covariance == pytest.approx(expected, rel=1e-12)
    gap = names.index("geometry.oil_gap.value.0")
    assert deviations[names[gap]] == pytest.approx(np.sqrt(2) * 0.03 * 5e-3)
    assert correlation[i, gap] == 0.0
    assert np.linalg.eigvalsh(correlation).min() > 0


@pytest.mark.parametrize(("true", "m"), [(0.03, 4), (0.001, 4)])
def test_presses_tell_what_their_forces_scatter_by(true: float, m: int) -> None:
    """The most probable deviation, against the marginal likelihood of the same readings."""
    count, noise = 12, 0.004
    skin = as_built(SKIN)
    forces = press_errors(skin, count, 1e-3)[count:]
    parts = (named(skin, STIFFNESS), *forces)
    random = np.random.default_rng(5)
    slope = np.concatenate([np.ones((count, 1)), np.eye(count)], 1)
    errors = true * random.normal(size=count)
    read = slope @ np.append(1.05, errors) + noise * random.normal(size=count)

    class Linear(eqx.Module):
        family: SensorFamily = eqx.field(static=True)

        def so(self, constants: Any) -> Any:
            return (slope @ constants)[None]

        def so_with_slopes(self, constants: Any) -> Any:
            return self.so(constants), jnp.asarray(slope.T[:, None])

    readings: Any = SimpleNamespace(
        so=read[None],
        used=np.ones((1, count), bool),
        sigma=np.full((1, count), noise),
        state=np.arange(count),
        basis=lambda sigma: np.zeros((1, count, 0)),
        whitening=lambda weight: None,
    )
    deviations = [0.1, *(part.size for part in forces)]
    means = np.append(1.0, np.zeros(count))
    priors = {
        part.name: Prior(*row, "given")
        for part, *row in zip(parts, means, deviations, strict=True)
    }
    model: Any = Linear(SensorFamily(parts))
    problem = SensorProblem(model, readings, priors, np.eye(len(parts)))
    before = np.diag(np.array(deviations) ** 2)
    gain = before @ slope.T @ np.linalg.inv(slope @ before @ slope.T + noise**2 * np.eye(count))
    found = hierarchical(problem, means + gain @ (read - slope @ means)).priors

    def cost(t: float) -> float:
        own = 0.1**2 * np.ones((count, count)) + (noise**2 + t**2) * np.eye(count)
        told = multivariate_normal(np.full(count, 1.0), own).logpdf(read)
        return -told + m * (np.log(t) + FORCE_ERROR**2 / (2 * t**2))

    tried = np.geomspace(1e-3, 0.1, 2000)
    best = tried[np.argmin([cost(t) for t in tried])]
    assert {found[part.name].sd for part in forces} == {found["push.0"].sd}
    assert found["push.0"].sd == pytest.approx(best, rel=0.01)
    assert found[STIFFNESS] == priors[STIFFNESS]


def test_gains_tell_their_own_deviation() -> None:
    """Repeated, one step of expectation and maximisation finds the deviation drawn from."""
    true, error = 0.02, 0.005
    read = true * RNG.normal(size=4000) + error * RNG.normal(size=4000)
    names = ["stiffness", *(f"electrodes.taxels.{k}.gain" for k in range(4000))]
    (gains,) = Alike.of(names)
    assert gains.rows[[0, -1]].tolist() == [1, 4000]
    t = 0.1
    for _ in range(200):
        share = t**2 / (t**2 + error**2)
        variance = np.full(len(read), share * error**2)
        t = gains.shared_deviation(share * read, variance)
    assert t == pytest.approx(true, rel=0.04)


def test_what_errors_share_is_told_by_their_posterior() -> None:
    """Against the joint posterior of what is shared and all errors, from the same readings."""
    own, at = 0.01, np.array([-0.9, 0.3])
    angle = np.array([-1.0, -0.6, -0.55, 0.2, 0.5, 0.9])
    count = len(angle)
    every = np.concatenate([angle, at])
    near = np.exp(-((every[:, None] - every) ** 2) / (2 * 0.35**2))
    # A ruler's zero, and a bar that stands askew: alike all over, and smooth along the arc.
    shared = own**2 + 0.0085**2 * (1 + near)
    prior = shared[:count, :count] + own**2 * np.eye(count)
    skin = as_built(SKIN)
    errors = press_errors(SKIN, count, own * RADIUS)
    parts = [*(named(skin, name) for name in as_built_names(skin)), *errors]
    deviations, correlation = as_built_deviations(SKIN, parts, angle)
    sd = np.array([deviations[part.name] for part in errors[:count]])
    alike = correlation[-2 * count :, -2 * count :]
    np.testing.assert_allclose(alike[:count, :count] * np.outer(sd, sd), prior, rtol=1e-12)
    np.testing.assert_array_equal(alike[count:], np.eye(2 * count)[count:])  # of forces
    slope, noise = RNG.normal(size=(9, count)), 0.002
    read = slope @ (0.014 + own * RNG.normal(size=count)) + noise * RNG.normal(size=9)
    covariance = np.linalg.inv(slope.T @ slope / noise**2 + np.linalg.inv(prior))
    found = covariance @ slope.T @ read / noise**2
    # Jointly Gaussian: readings, and what is shared at the places.
    whole = slope @ prior @ slope.T + noise**2 * np.eye(9)
    across = shared[count:, :count] @ slope.T
    gain = across @ np.linalg.inv(whole)
    m, left = PlaceErrors(angle, own).shared(found, covariance, at)
    np.testing.assert_allclose(m, gain @ read, rtol=1e-7)
    np.testing.assert_allclose(left, shared[count:, count:] - gain @ across.T, rtol=1e-7)


def test_loads_to_come_are_off_as_presses_were_or_not_at_all() -> None:
    """Errors after half is taken off: of draws of what was shared, and of none."""
    m, own = np.array([-0.7, 0.1]), np.array([[0.04, 0.01], [0.01, 0.09]])
    mean, covariance = shift_of_loads(m, own)
    as_presses = RNG.multivariate_normal(m, own, 400_000) - mean
    second = as_presses.T @ as_presses / len(as_presses)
    np.testing.assert_allclose(covariance, second, atol=2e-3)
    straight = np.outer(mean, mean)
    assert np.linalg.eigvalsh(covariance - straight).min() >= 0


def test_stiffness_is_a_factor_and_errors_of_presses_are_no_inputs() -> None:
    inputs = continuous_inputs(SKIN)
    names = ("stiffness", "place.0", "push.0", "fill")
    found = with_constants(SKIN, inputs, names, (1.1, 0.5, 0.5, 1.01))
    assert found["material.C1"] == 1.1 * inputs["material.C1"]
    changed = {k for k in found if found[k] != inputs.get(k)}
    assert changed == {"material.C1", "material.C2", "material.C3", "oil.fill"}


def test_errors_of_presses_are_known_places_and_forces() -> None:
    parts = press_errors(PAD, 2, 1e-3)
    assert [p.name for p in parts] == [
        f"{k}.{i}" for k in ("place", "axial", "push") for i in (0, 1)
    ]
    assert parts[0].size == pytest.approx(1e-3 / 58.25e-3)  # mid-line
    assert (parts[2].size, parts[5].size) == (1e-3, FORCE_ERROR)
    with pytest.raises(ValueError, match="--place-error"):
        press_errors(PAD, 2, 0.0)
    assert {2: ESTIMATOR_ERROR, 3: PAD_MODEL_ERROR} == MODEL_ERROR


def test_priors_are_correlated_in_residuals_and_in_information() -> None:
    """Sum of squares of the priors' residuals is the Mahalanobis distance."""
    parts = tuple(SensorConstant(f"electrodes.taxels.{k}.gain", "1", 1.0) for k in range(3))
    a = RNG.normal(size=(3, 3))
    covariance = a @ a.T + np.eye(3)
    sd = np.sqrt(np.diag(covariance))
    priors = {p.name: Prior(1.0, s, "given") for p, s in zip(parts, sd, strict=True)}

    class Silent(eqx.Module):
        family: SensorFamily = eqx.field(static=True)

        def so(self, constants: Any) -> Any:
            return jnp.zeros((2, 1))

    readings: Any = SimpleNamespace(
        so=np.zeros((2, 1)),
        used=np.ones((2, 1), bool),
        sigma=np.ones((2, 1)),
        state=np.zeros(1, int),
        basis=lambda sigma: np.zeros((2, 1, 0)),
        whitening=lambda weight: None,
    )
    model: Any = Silent(SensorFamily(parts))
    problem = SensorProblem(model, readings, priors, covariance / np.outer(sd, sd))
    at = np.array([1.2, 0.9, 1.4])
    residuals: SensorResiduals = problem.residuals()
    r = np.asarray(residuals.of_constants(jnp.asarray(at)))
    expected = (at - 1) @ np.linalg.solve(covariance, at - 1)
    assert float(r @ r) == pytest.approx(expected, rel=1e-10)
    information = problem.prior_information(at)
    np.testing.assert_allclose(
        information / np.outer(at, at), np.linalg.inv(covariance), rtol=1e-9
    )


def test_means_of_frames_are_by_state_and_log() -> None:
    loads = KnownLoads.pushes(np.zeros((1, 2)), np.array([[0.0, 5.0]]))
    so = np.array([[1.0, 3.0, 10.0, 12.0, 30.0], [1.0, np.nan, np.nan, np.nan, 4.0]])
    log, state = np.array([0, 0, 0, 0, 1]), np.array([0, 0, 1, 1, 1])
    data = SensorData(
        SKIN, so, np.arange(5.0), log, state, loads, np.full(2, np.nan), (), (), ()
    )
    found, count = averaged(data)
    np.testing.assert_array_equal(found.so[0], [2.0, 11.0, 30.0])
    np.testing.assert_array_equal(np.isnan(found.so[1]), [True, True, False])
    np.testing.assert_array_equal(count, [2, 2, 1])
    np.testing.assert_array_equal(found.state, [0, 1, 2])  # each press has errors of its own
    with pytest.raises(ValueError, match="without load"):
        averaged(dataclasses.replace(data, state=np.ones(5, int)))


def test_frames_on_the_way_to_a_press_are_left_out() -> None:
    """Held forces count with their mean: two at one place, one at another, none on the way."""
    force = np.array([0, 2.5, 5, 5.01, 5.02, 7, 9, 9, 9, 4, 0, 3, 0])
    angle = np.where(np.arange(13) < 11, 0.1, 0.3)
    loads = KnownLoads.pushes(angle[None], force[None])
    none = np.zeros(13)
    data = SensorData(
        SKIN, np.arange(13.0)[None], np.arange(13.0), none.astype(int), np.arange(13), loads,
        none + np.nan, (), (), (),
    )  # fmt: skip
    found = held_presses(data)
    np.testing.assert_allclose(found.loads.force[0], [0, 0, 0, 5.01, 9, 3])
    np.testing.assert_allclose(found.loads.angle[0, 3:], [0.1, 0.1, 0.3])
    np.testing.assert_array_equal(found.state, [0, 3, 3, 3, 4, 4, 4, 1, 5, 2])
    np.testing.assert_array_equal(found.so[0], [0, 2, 3, 4, 6, 7, 8, 10, 11, 12])
    assert "3 frames" in found.warnings[-1]
    assert held_presses(found).warnings == found.warnings


def test_a_press_off_the_pad_is_refused_before_it_is_solved() -> None:
    loads = KnownLoads.pushes(
        np.zeros((1, 2)), np.array([[0.0, 5.0]]), axial=np.array([[0.0, 0.07]])
    )
    with pytest.raises(ValueError, match=r"known load\.0\.axial: .*clamped end at 61\.5 mm"):
        SceneStates(PAD, loads)


def test_shapes_are_linear_in_common_constants_and_in_each_state_s_own() -> None:
    """The face moves by slopes times changes; a press's error moves its own state only."""
    family = SensorFamily(
        tuple(SensorConstant(n, "1", 1.0, False) for n in ("fill", "place.0", "place.1"))
    )

    class Face(eqx.Module):
        heights: Any

    slope = Face(jnp.asarray(RNG.normal(size=(2, 4, 3))))
    model = SensorModel(
        {}, Face(jnp.zeros((4, 3))), slope, jnp.zeros(3), jnp.zeros(3), None,  # type: ignore[arg-type]
        SKIN, family, (0,), None, ((1, -1, 2),),
    )  # fmt: skip
    assert model.shaping == [0, 1, 2]
    moved = model._face(jnp.array([0.5, 2.0, 3.0])).heights  # type: ignore[attr-defined]
    own = np.asarray(slope.heights)
    expected = 0.5 * own[0] + own[1] * [2.0, 0.0, 3.0]
    np.testing.assert_allclose(moved, expected, rtol=1e-12)
    jacobian = jax.jacfwd(lambda c: model._face(c).heights)(jnp.zeros(3))  # type: ignore[attr-defined]
    assert not np.asarray(jacobian)[:, :2, 2].any()


def test_gains_of_all_channels_are_factors_on_their_counts() -> None:
    """One array for all of them says what the inputs one by one say."""
    spec = as_built(PART)
    names = [name for name in as_built_names(spec) if is_gain(name)]
    family = SensorFamily(tuple(named(spec, name) for name in names))
    inputs = {k: jnp.asarray(x) for k, x in continuous_inputs(spec).items()}
    rays = len(parts_of(spec, inputs)[3].taxels.rays(DISC, parts_of(spec, inputs)[0]))
    face = TaxelFace(jnp.full((rays, len(names), 1), -1e-3))
    at, gain = jnp.ones(len(names)), jnp.asarray(1 + 0.02 * RNG.normal(size=len(names)))
    model = SensorModel(inputs, face, None, at, jnp.full(1, jnp.nan), None, spec, family)
    so = eqx.filter_jit(model.so)
    even, own = so(at), so(gain)
    np.testing.assert_allclose(own, even * gain[:, None], rtol=1e-12)
    *_, electrodes = parts_of(spec, inputs | dict(zip(names, gain, strict=True)))
    np.testing.assert_allclose(electrodes.read_face(face).so, own, rtol=1e-12)
    assert continuous_inputs(spec.model_copy(
        update={"electrodes": spec.electrodes.with_equal_channels()}
    )).keys() == inputs.keys() - set(names)  # fmt: skip


def test_gains_and_errors_of_presses_share_tangents() -> None:
    """Derivatives by all constants, against one tangent for each of them."""
    spec = as_built(PART)
    gains = [name for name in as_built_names(spec) if is_gain(name)]
    own = [named(spec, name) for name in ("fill", *gains)]
    errors = [SensorConstant(f"{kind}.{k}", "1", 1.0, False) for kind in ("place", "push")
              for k in (0, 1)]  # fmt: skip
    family = SensorFamily((*own, *errors))
    inputs = {k: jnp.asarray(x) for k, x in continuous_inputs(spec).items()}
    rays = len(parts_of(spec, inputs)[3].taxels.rays(DISC, parts_of(spec, inputs)[0]))
    shape = (rays, len(gains), 3)
    face = TaxelFace(jnp.full(shape, -1e-3))
    slope = TaxelFace(jnp.asarray(1e-3 * RNG.normal(size=(3, *shape))))
    at = jnp.append(jnp.ones(len(own)), jnp.zeros(4))
    place, push = (len(own) + k for k in (0, 2))
    model = SensorModel(
        inputs, face, slope, at, jnp.full(3, jnp.nan), None, spec, family, (0,), None,
        ((place, -1, place + 1), (-1, push, push + 1)),
    )  # fmt: skip
    so, slopes = eqx.filter_jit(model.so_with_slopes)(at)
    np.testing.assert_allclose(so, eqx.filter_jit(model.so)(at), rtol=1e-12)
    single = np.moveaxis(np.asarray(jax.jit(jax.jacfwd(model.so))(at)), -1, 0)
    np.testing.assert_allclose(slopes, single, rtol=1e-10, atol=1e-10 * np.abs(single).max())
    assert np.all(np.abs(single).max((1, 2)) > 0)


@pytest.mark.parametrize("name", ["suas.toml", "suas-pad.toml"])
def test_a_skin_file_takes_tables_and_gains(name: str, tmp_path: Path) -> None:
    file = ROOT / "configs/skins" / name
    spec = as_built(load_skin(file))
    inputs = continuous_inputs(spec)
    names = [k for k in as_built_names(spec) if k.startswith(("geometry.", "electrodes."))]
    found = {k: inputs[k] * (1 + 0.01 * RNG.normal()) for k in names}
    document: Any = tomlkit.parse(file.read_text())
    _set_as_built(document, spec, found)
    (tmp_path / name).write_text(tomlkit.dumps(document))
    read = continuous_inputs(load_skin(tmp_path / name))
    np.testing.assert_allclose([read[k] for k in names], [*found.values()], rtol=1e-11)


# --- the next press -----------------------------------------------------------------------


def candidates(presses: int = 6, taxels: int = 5, constants: int = 3) -> Candidates:
    weight = np.full((presses, taxels), 4.0)
    return Candidates(
        tuple(Press(0.1 * k, 5.0) for k in range(presses)),
        RNG.normal(size=(presses, taxels, constants)),
        RNG.normal(size=(presses, taxels, 2)),
        weight,
        weight / 2,
        np.tile([1 / 0.3**2, 1 / 0.05**2], (presses, 1)),
        np.diag([1.0, 2.0, 0.5][:constants]),
    )


def test_a_press_tells_what_is_left_of_its_readings_without_its_place() -> None:
    """I_k is J^T (W^-1 + L S L^T)^-1 J: the place's error as noise that taxels share."""
    own = candidates()
    told = told_by(own)
    for k in range(6):
        J, L = own.by_constant[k], own.by_press[k]
        noise = np.diag(1 / own.weight[k]) + L @ np.diag(1 / own.press_information[k]) @ L.T
        np.testing.assert_allclose(told[k], J.T @ np.linalg.solve(noise, J), rtol=1e-10)


def test_least_errors_of_forces_are_those_of_weighted_least_squares() -> None:
    """V is (L^T (W^-1 + J C J^T)^-1 L)^-1."""
    own = candidates()
    found = force_errors(own, np.linalg.inv(own.covariance))
    for k in range(6):
        J, L = own.by_constant[k], own.by_press[k]
        noise = np.diag(1 / own.weight_once[k]) + J @ own.covariance @ J.T
        V = np.linalg.inv(L.T @ np.linalg.solve(noise, L))
        assert found[k] == pytest.approx(np.sqrt(V[1, 1]), rel=1e-10)


def test_presses_are_planned_while_they_are_needed() -> None:
    own = candidates()
    plan = planned(own, 4)
    assert len(plan.presses) == len(set(plan.presses)) == 4
    assert list(plan.accuracy) == sorted(plan.accuracy, reverse=True)
    for drawn in (candidates() for _ in range(20)):
        # The first is the best of all single presses.
        prior = np.linalg.inv(drawn.covariance)
        single = [np.mean(force_errors(drawn, prior + told) ** 2) for told in told_by(drawn)]
        assert planned(drawn, 1).presses[0] == drawn.presses[int(np.argmin(single))]
    enough = planned(own, 6, plan.accuracy[2])
    assert len(enough.presses) == 2
    report = plan.report()["presses"]
    assert report[0] == plan.presses[0].report() | {"force_error_after": plan.accuracy[1]}
    place = pytest.approx(np.rad2deg(0.2))
    assert Press(0.2, 5.0, 0.01).report() == {
        "angle_deg": place,
        "force_N": 5.0,
        "axial_m": 0.01,
    }


@pytest.mark.parametrize("spec", [SKIN, PAD], ids=["section", "pad"])
def test_what_presses_would_tell_is_a_change_from_rest(
    spec: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of readings and slopes that are drawn: a press has errors of its own, in its own row."""
    rng, pad = np.random.default_rng(1), spec is PAD
    drawn: list[np.ndarray] = []

    def run(function: Any, model: Any, start: Any) -> list[np.ndarray]:
        presses = 70 if pad else 30
        drawn.append(rng.normal(size=(4, presses + 1)))
        drawn.append(rng.normal(size=(4, presses + 1, len(start))))
        return drawn

    solver = SimpleNamespace(stated=lambda name: 1.0, at=lambda start: SimpleNamespace(model=0))
    monkeypatch.setattr(next_press, "_solver", lambda *given, **how: solver)
    monkeypatch.setattr(next_press, "COMPILED", SimpleNamespace(run=run))
    monkeypatch.setattr(next_press, "_known_so_far", lambda *given: np.eye(2))
    found, (so, slope) = next_press.candidates_of(spec, 6.0, 2e-3), drawn
    presses = len(found.presses)
    count = found.by_constant.shape[2]
    change = so[:, :-1] - so[:, -1:]
    reading = spec.electrodes.noise**2 + 1 / 12
    share = PAD_MODEL_ERROR**2 + GAIN_ERROR**2 if pad else ESTIMATOR_ERROR**2
    np.testing.assert_allclose(1 / found.weight.T, reading / 25 + share * change**2)
    np.testing.assert_allclose(1 / found.weight_once.T, reading + share * change**2)
    for k in (0, 7, presses - 1):
        moved = slope[:, k, :count] - slope[:, -1, :count]
        np.testing.assert_allclose(found.by_constant[k], moved)
        own = slope[:, k, count + k :: presses]
        np.testing.assert_allclose(found.by_press[k], own)
    sizes = np.array([part.size for part in press_errors(as_built(spec), presses, 2e-3)])
    np.testing.assert_allclose(found.press_information.T.ravel(), 1 / sizes**2)


def test_what_is_known_of_stiffness_is_a_share_of_the_record_s() -> None:
    """The file's material is that of the record: its factor has begun at one again."""
    record = CalibrationSpec(
        parameters=("geometry.oil_gap", "stiffness", "geometry.mounting"),
        values=(5e-3, 1.25, 0.0),
        covariance=((1e-8, 2e-6, 0.0), (2e-6, 0.01, 0.0), (0.0, 0.0, 1.0)),
    )
    spec = SKIN.model_copy(update={"calibration": record})
    parts: Any = [SimpleNamespace(name=name) for name in ("stiffness", "geometry.oil_gap")]
    found = next_press._known_so_far(spec, parts, np.ones(2))
    np.testing.assert_allclose(found, [[0.01 / 1.25**2, 2e-6 / 1.25], [2e-6 / 1.25, 1e-8]])


def test_a_record_of_stiffness_moves_all_stresses_together() -> None:
    record = CalibrationSpec(
        parameters=("stiffness", "geometry.thickness.value.0"),
        values=(1.25, 1.5e-3),
        covariance=((0.01, 0.0), (0.0, 1e-10)),
    )
    own = as_built(SKIN).model_copy(update={"calibration": record})
    errors = input_errors(own)
    at = {path: np.abs(errors.directions[:, i]) for i, path in enumerate(errors.paths)}
    inputs = continuous_inputs(SKIN)
    assert at["material.C1"].max() == pytest.approx(0.1 / 1.25 * inputs["material.C1"])
    assert at["geometry.thickness.value.0"].max() == pytest.approx(1e-5)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ([], "only with --plan"),
        (["--plan", "3", "--press", "0 deg, 5 N"], "give one of them"),
        (["--plan", "3", "--place-error", "2 deg"], "--place-error"),
    ],
)
def test_a_plan_without_sense_is_refused(options: list[str], said: str) -> None:
    skin = str(ROOT / "configs/skins/suas.toml")
    found = CliRunner().invoke(app, ["calibrate", "-", skin, *options])
    assert found.exit_code == 2
    assert said in found.output.replace("\n", " ")


def test_a_pad_as_built_is_not_sampled(tmp_path: Path) -> None:
    skin = str(ROOT / "configs/skins/suas-pad.toml")
    log = tmp_path / "log.csv"
    log.write_text("")
    command = ["fit", "sensor", skin, str(log), "--fit", "as-built", "--sample"]
    found = CliRunner().invoke(app, [*command, "-o", str(tmp_path / "unit.toml")])
    assert found.exit_code == 2
    assert "too many constants to sample" in " ".join(found.output.split())


def test_known_loads_of_a_unit_stay_where_the_drawing_has_them() -> None:
    """Sections of uneven thickness count from -90 to 90 degrees, whatever they span."""
    geometry = SKIN.geometry.model_copy(update={"half_angle": np.deg2rad(60.0)})
    angle = np.deg2rad([[-40.0, 0.0, 20.0]])
    loads, none = KnownLoads.pushes(angle, np.ones((1, 3))), np.zeros(3)
    data = SensorData(
        SKIN.model_copy(update={"geometry": geometry}), np.zeros((1, 3)), none,
        none.astype(int), np.arange(3), loads, none + np.nan, (), (), (),
    )  # fmt: skip
    np.testing.assert_allclose(_as_built(data).loads.angle, 1.5 * angle, atol=1e-9)


def test_the_picture_of_a_plan_counts_presses_and_writes_per_cents() -> None:
    presses = tuple(Press(x, 1.0, None, "arc") for x in (-0.02, 0.0, 0.02))
    errors = np.array([[0.18, 0.18, 0.18], [0.02, 0.05, 0.06], [0.02, 0.03, 0.04]])
    plan = next_press.Plan(presses[:2], (0.18, 0.05, 0.03), errors, presses)
    figure = plot_plan(plan)
    figure.canvas.draw()
    _, right = figure.axes
    assert {float(x) for x in right.get_xticks()} == {round(x) for x in right.get_xticks()}
    shown = [text.get_text() for text in right.get_yticklabels(which="both")]
    assert "10" in shown
    assert not [text for text in shown if "times" in text]


class _Bent(eqx.Module):
    """Counts that bend away from their tangent, which a step follows too far."""

    at: Any
    family: SensorFamily = eqx.field(static=True)
    inputs: Any = eqx.field(default_factory=dict)
    factor: Any = None
    moving: tuple[int, ...] = eqx.field(default=(0,), static=True)
    shaping: tuple[int, ...] = eqx.field(default=(0,), static=True)

    def so(self, constants: Any) -> Any:
        here, slope = jax.jvp(lambda c: jnp.arctan(20 * c), (self.at,), (constants - self.at,))
        return (here + slope)[None]

    def so_with_slopes(self, constants: Any) -> Any:
        return self.so(constants), jnp.moveaxis(jax.jacfwd(self.so)(constants), -1, 0)

    def through_the_wall(self, constants: Any) -> Any:
        return jnp.zeros(1, bool)


def test_a_step_that_would_worsen_the_fit_is_damped() -> None:
    """Steps of Gauss and Newton on arctan jump to and fro about its zero, ever farther."""
    family = SensorFamily((SensorConstant("mounting", "1", 1.0, positive=False),))
    one = np.ones((1, 1), bool)
    none = np.zeros(1, int)
    readings = LoggedCounts(
        np.zeros((1, 1)), none, none, np.zeros(1), 0.1 * one, one, one, False, False, 1
    )
    start, priors = np.array([0.1]), {"mounting": Prior(0.0, 1.0, "given")}

    def shapes_at(constants: np.ndarray) -> Any:
        return SimpleNamespace(model=_Bent(jnp.asarray(constants), family))

    solver: Any = SimpleNamespace(at=shapes_at)
    shapes = shapes_at(start)
    problem = SensorProblem(shapes.model, readings, priors, np.eye(1))
    given = problem, search(problem, start), shapes, ~one, solver, [0.0], print
    _, found, *_, steady = settled_shapes(*given)
    assert steady
    assert abs(found.constants[0]) < 1e-3  # of a deviation of 5e-3


class _Linear(AbstractResiduals):
    """Residuals that are linear in the constants."""

    value: Any
    inverse_scale: Any
    family: SensorFamily = eqx.field(static=True)
    slopes: Any

    def of_constants(self, constants: Any) -> Any:
        """See the base class."""
        return self.slopes @ constants - self.value


def test_a_sampled_unit_has_the_errors_of_presses_integrated_out() -> None:
    """The marginal of a Gaussian, with as many walkers as it needs."""
    names = ("geometry.mounting", "electrodes.taxels.0.gain", "place.0", "place.1", "push.0")
    family = SensorFamily(tuple(SensorConstant(n, "1", 1.0, positive=False) for n in names))
    random = np.random.default_rng(0)
    slopes = random.normal(size=(12, 5))
    slopes[:, 2] += slopes[:, 0]  # a place that does much the same as the mounting
    residuals = _Linear(jnp.asarray(random.normal(size=12)), jnp.ones(12), family, slopes)
    covariance = np.linalg.inv(slopes.T @ slopes)
    best = covariance @ slopes.T @ np.asarray(residuals.value)
    fit: Any = SimpleNamespace(
        family=family, residuals=residuals, constants=best, held=(),
        uncertainty=SimpleNamespace(covariance=covariance),
        misfit=SimpleNamespace(inflation=1.0),
    )  # fmt: skip
    chain, report = sample_sensor(fit, Settings(walkers=4, steps=6000, check=1000))
    assert chain.names == names[:2]
    assert report["covariance_order"] == list(names[:2])
    errors = np.sqrt(np.diag(covariance))
    for i, name in enumerate(names[:2]):
        assert report["mean"][name] == pytest.approx(best[i], abs=0.15 * errors[i])
        assert report["standard_deviations"][name] == pytest.approx(errors[i], rel=0.1)
