"""Contacts on a pad from readings: table and spline, bounds, pairs, faults, oil pressure."""

import json
import pickle
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest
from scipy.stats import binom, chi2
from typer.testing import CliRunner

from fitting.cli.app import app
from fitting.cli.options import pad_settings
from fitting.force_range.pad import range_from_table
from fitting.inverse_load.check.skin_file import model_verdict
from fitting.inverse_load.estimator import LoadEstimator
from fitting.inverse_load.field.forward import FieldForward, FieldNodes
from fitting.inverse_load.fit.covariance import covariance_of
from fitting.inverse_load.fit.detection import PadDetector
from fitting.inverse_load.frame_posterior import frame_posterior, likely_modes
from fitting.inverse_load.live.filter import LoadFilter
from fitting.inverse_load.pad import parts as pad_parts
from fitting.inverse_load.pad.columns import ACROSS, LEVELS, Column, Columns, largest_forces
from fitting.inverse_load.pad.fitter import PadFitter
from fitting.inverse_load.pad.interpolant import PadInterpolant
from fitting.inverse_load.pad.parts import pad_table_of
from fitting.inverse_load.pad.solved import patch_points
from fitting.inverse_load.pad.spline import TensorSpline
from fitting.inverse_load.pad.table import PadResolution, PadTable
from fitting.inverse_load.pad.table_build import force_surplus, mirror_images
from fitting.inverse_load.report.text import posterior_json
from fitting.sensor.fit.calibrate import fit_sensor
from fitting.sensor.logs.data import load_sensor_data
from fitting.sensor.logs.known_loads import KnownLoads
from fitting.sensor.shapes import scene_states
from fitting.sensor.shapes.scene_states import SceneStates, Solved
from fitting.statistics.posterior import Settings
from fitting.steps import finished
from fitting.workers import LocalWorkers
from suas_jax.config import SkinSpec, continuous_inputs, load_skin
from suas_jax.config.input_errors import STIFFNESS
from suas_jax.runtime import compiled
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.forward import forward
from suas_jax.scene.loads import Loads
from suas_jax.scene.pad_levels import PadReadings
from suas_jax.scene.skin import Skin, skin_of
from suas_jax.simulation.load_path import load_path
from suas_jax.simulation.pad_frames import pad_capacitances
from tests.chains import assert_chain_agrees_with_the_mode

DIAMETER = 12e-3
ELEMENTS = (8, 8)
RESOLUTION = PadResolution(ELEMENTS, 14e-3, (3, 3))
MANY = 100  # columns, so that they share the table's compiled program
# A thick, small pad: fields so smooth that few elements and places resolve them. Its taxels
# lie in no symmetric order.
SKIN = """
[geometry]
inner_radius = "57.5 mm"
thickness = "5 mm"
half_angle = "60 deg"
width = "100 mm"
oil_gap = "5 mm"
ends = "clamped"
[material]
law = "neo-hookean"
mu = "2 MPa"
[oil]
model = "incompressible"
relative_permittivity = 2.2
[electrodes]
lsb = "0.1 fF"
noise = 2.0
taxels = [
TAXELS
]
"""
UNORDERED = [
    (a + 1.7 * k - 3, z + a / 30)
    for a in np.linspace(-45, 45, 7)
    for k, z in enumerate(np.linspace(-38, 36, 5))
]
ORDERED = [(a, z) for a in range(-45, 46, 15) for z in range(-36, 37, 18)]


def small_pad(places: Sequence[tuple[float, float]] = UNORDERED) -> str:
    """File of the pad with taxels at places [deg], [mm]."""
    rows = [f'{{ angle = "{a:.3f} deg", axial = "{z:.3f} mm" }},' for a, z in places]
    return SKIN.replace("TAXELS", "\n".join(rows))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pad")
    (folder / "skin.toml").write_text(small_pad())
    return folder


@pytest.fixture(scope="module")
def spec(folder: Path) -> SkinSpec:
    return load_skin(folder / "skin.toml")


@pytest.fixture(scope="module")
def patch() -> Iterator[pytest.MonkeyPatch]:
    with pytest.MonkeyPatch.context() as patch:
        yield patch


@pytest.fixture(scope="module")
def skin(spec: SkinSpec, patch: pytest.MonkeyPatch) -> Skin:
    # What follows runs a few times: compiled quickly.
    quick = {**compiled.OPTIONS, "xla_backend_optimization_level": 0}
    patch.setattr(compiled, "OPTIONS", quick)
    return skin_of(spec, elements=ELEMENTS, contact=False)


@pytest.fixture(scope="module")
def table(spec: SkinSpec, skin: Skin) -> PadTable:
    assert skin.elements == ELEMENTS  # which compiles quickly
    return pad_table_of(spec, DIAMETER, RESOLUTION)


@pytest.fixture(scope="module")
def estimator(
    spec: SkinSpec, skin: Skin, table: PadTable, patch: pytest.MonkeyPatch
) -> LoadEstimator:
    patch.setattr(pad_parts, "_table", lambda *_: table)
    patch.setattr(pad_parts, "_skin_maker", lambda *_: lambda: skin)
    return LoadEstimator(spec, diameter=DIAMETER, most_contacts=1, pressure_noise=20.0)


Solve = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


@pytest.fixture(scope="module")
def solved(skin: Skin, table: PadTable) -> Solve:
    """Readings and pressures under contacts [contact, (angle, axial, force)], solved each."""
    images, where = mirror_images(skin)
    columns = Columns(images, DIAMETER, lambda *_: None, MANY)

    def of(contacts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found = columns.solve(contacts[:, :2], contacts[:, 2], LEVELS[LEVELS != 0])
        assert found.found.all()
        return found.so[:, -1, where[0]], found.pressure[:, -1]

    return of


@pytest.fixture(scope="module")
def contacts() -> np.ndarray:
    """Places and forces of single contacts [contact, (angle, axial, force)]."""
    random = np.random.default_rng(4)
    low, high = [-0.6, -0.03, 2.0], [0.6, 0.03, 12.0]
    return random.uniform(low, high, (16, 3))


@pytest.fixture(scope="module")
def singles(contacts: np.ndarray, solved: Solve) -> tuple[np.ndarray, np.ndarray]:
    return solved(contacts)


def noisy(so: np.ndarray, seed: int) -> np.ndarray:
    return np.round(so + np.random.default_rng(seed).normal(0, 2, so.shape))


def test_the_spline_is_exact_for_cubics_and_so_are_its_derivatives() -> None:
    def cubic(x: Any, y: Any) -> np.ndarray:
        return np.stack([x**3 * y + y**3 - 2 * x, 1 + x * y**2], -1)

    x, y = np.linspace(0, 1, 6) ** 1.4, np.linspace(-2, 1, 5)
    spline = TensorSpline.through((x, y), cubic(x[:, None], y[None]))
    at = np.array([0.03, 0.4, 1.1]), np.array([-1.9, 0.2, 1.05])
    value, slope = spline(*at)
    np.testing.assert_allclose(value, cubic(*at), rtol=1e-12)
    by_x = np.stack([3 * at[0] ** 2 * at[1] - 2, at[1] ** 2], -1)
    by_y = np.stack([at[0] ** 3 + 3 * at[1] ** 2, 2 * at[0] * at[1]], -1)
    np.testing.assert_allclose(slope, np.stack([by_x, by_y], 1), rtol=1e-11, atol=1e-12)


@pytest.mark.long  # the table of a pad; formulas of it in test_pad_formulas
def test_mirrored_quarters_are_what_a_solve_says(table: PadTable, solved: Solve) -> None:
    interpolant = PadInterpolant(table)
    place = np.array([table.angle[-2], table.axial[-3]])
    signs = np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)])
    share = LEVELS[5]
    force = share * interpolant.largest(*(signs * place).T)
    loads = np.concatenate([signs * place, force[:, None]], 1)
    so, pressure = solved(loads)
    found = interpolant(loads, 1).readings
    change = np.abs(so - table.rest).max()
    np.testing.assert_allclose(found[:, :-1], so, atol=2e-4 * change)
    np.testing.assert_allclose(found[:, -1], pressure, rtol=2e-4)


def test_more_force_makes_up_for_a_coarse_mesh() -> None:
    levels = LEVELS[LEVELS != 0]
    missing = np.array([0.001, 0.003])[:, None] * (1 + 0.5 * np.abs(levels))

    def column(levels: np.ndarray) -> Column:
        stiffening = levels - 0.2 * levels**2  # [place, level]
        so = 250 + stiffening[..., None] * np.array([80.0, 10.0, -6.0])
        return Column(so, stiffening, stiffening, np.ones(stiffening.shape, bool))

    coarse, fine = column(levels * np.ones((2, 1))), column(levels * (1 + missing))
    # Slopes over so wide steps of the force are good to a few per cent.
    np.testing.assert_allclose(force_surplus(coarse, fine, levels), missing, rtol=0.12)
    fine.found[:, -1] = False
    fine.so[0, 2] = np.nan  # at the wall
    found = force_surplus(coarse, fine, levels)
    np.testing.assert_array_equal(found[:, -1], found[:, -2])
    assert found[0, 2] == found[0, 1]
    strange = column(1.3 * levels * np.ones((2, 1)))  # no mesh is that much too stiff
    np.testing.assert_array_equal(force_surplus(coarse, strange, levels), 0.05)


class _Pickling(ThreadPoolExecutor):
    """What passes between processes, without the processes."""

    def submit(self, function: Any, /, *arguments: Any) -> Any:  # type: ignore[override]
        """As processes get it, in which float64 is off until a function asks for it."""
        sent = pickle.dumps((function, arguments))
        jax.config.update("jax_enable_x64", False)
        received = pickle.loads(sent)
        jax.config.update("jax_enable_x64", True)
        return super().submit(received[0], *received[1])


@pytest.mark.long  # the table of a pad; formulas of it in test_pad_formulas
@pytest.mark.parametrize("executor", [_Pickling, LocalWorkers])
def test_workers_solve_what_this_process_does(
    skin: Skin,
    solved: Solve,
    contacts: np.ndarray,
    executor: Callable[[int], Executor],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("suas_jax.runtime.settings.configure", lambda: None)
    images, where = mirror_images(skin)
    few = contacts[:6]  # more than a worker is sent at once
    done: list[int] = []
    with executor(2) as workers:
        columns = Columns(images, DIAMETER, lambda k, _: done.append(k), MANY, workers)
        found = columns.solve(few[:, :2], few[:, 2], LEVELS[LEVELS != 0])
    assert done[-1] == len(few)
    np.testing.assert_allclose(found.so[:, -1, where[0]], solved(few)[0], rtol=1e-12)


@pytest.mark.long  # the table of a pad; formulas of it in test_pad_formulas
def test_columns_beside_one_another_read_what_each_reads_alone(
    skin: Skin, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: Any) -> None:
        raise AssertionError("a state was not found from its neighbours'")

    monkeypatch.setattr("fitting.inverse_load.pad.columns.forward", refused)
    columns, levels = Columns(skin, DIAMETER, lambda *_: None, MANY), LEVELS[LEVELS != 0]
    places, force = np.array([[0.3, 0.0], [0.3, 6e-3], [0.3, 12e-3]]), np.array([15.0, 16, 17])
    across = np.ones(3, bool)
    alone, line = (columns.solve(places, force, levels, None, across, k) for k in (1, 3))
    assert line.found.all()
    rest = np.asarray(forward(skin, Loads.patch(0.0, 0.0, 0.0, DIAMETER)).so)[:, 0]
    for a, b in ((alone.so - rest, line.so - rest), (alone.pressure, line.pressure)):
        np.testing.assert_allclose(b, a, rtol=0, atol=2e-4 * np.abs(a).max())
    slopes = [x.across[:, list(ACROSS)] for x in (alone, line)]
    np.testing.assert_allclose(
        slopes[1], slopes[0], rtol=0, atol=1e-2 * np.abs(slopes[0]).max()
    )
    assert not np.array_equal(alone.so[1], line.so[1])  # they start elsewhere


@pytest.mark.long  # the table of a pad; formulas of it in test_pad_formulas
def test_slopes_of_the_interpolant_are_its_own(table: PadTable) -> None:
    interpolant = PadInterpolant(table, 0.0625)
    whole = [(0.3, -0.2), (0.01, 0.02), (4.0, 6.0), (20e-3, 9e-3), (0.2, -0.1)]
    x = np.array([sum([*whole, (0.0, 0.0), (0.0, 0.0)], ())])
    exact = interpolant(x, 2).jacobian[0]
    for k, h in enumerate(1e-6 * np.repeat([1, 0.05, 5, 0.01, 1, 1, 1], 2)):
        d = h * np.eye(14)[k]
        ahead, behind = (interpolant(x + s * d, 2).readings[0] for s in (1, -1))
        slope = (ahead - behind) / (2 * h)
        # A wide contact's centre moves with the slope of the largest force, which is held.
        error = 1e-6 if k >= 10 else 3e-2
        np.testing.assert_allclose(exact[k], slope, rtol=1e-5, atol=error * abs(slope).max())


@pytest.mark.long  # the table of a pad; formulas of it in test_pad_formulas
@pytest.mark.parametrize(("turn", "tilt"), [(0.05, 0.0), (0.0, 0.05)])
def test_slopes_by_tangential_forces_are_those_of_solved_states(
    skin: Skin, table: PadTable, turn: float, tilt: float
) -> None:
    """At places that know them, in a quarter of the pad that is solved and in its images."""
    interpolant = PadInterpolant(table, float(skin.geometry.outer_size[0]))
    for i, k in ((-2, -2), (1, -2), (1, 1)):
        angle, axial = table.across_angle[i], table.across_axial[k]
        inward = LEVELS[4] * float(interpolant.largest(*np.array([[angle], [axial]]))[0])
        force = inward / (np.cos(turn) * np.cos(tilt))
        straight, turned = (
            np.asarray(forward(skin, Loads.patch(angle, axial, f, DIAMETER, along, out)).so)[
                :, 0
            ]
            for f, along, out in ((inward, 0.0, 0.0), (force, turn, tilt))
        )
        tangents = np.tan(turn), np.tan(tilt) / np.cos(turn)
        x = np.array([[angle, axial, inward, DIAMETER, 0.0, *tangents]])
        plain = np.array([[angle, axial, inward, DIAMETER, 0.0, 0.0, 0.0]])
        change = interpolant(x, 1).readings[0, :-1] - interpolant(plain, 1).readings[0, :-1]
        expected = turned - straight
        # Under the load itself the table leaves out the shear that a tangential force adds.
        np.testing.assert_allclose(change, expected, atol=0.3 * np.abs(expected).max())
        assert np.corrcoef(change, expected)[0, 1] > 0.95


@pytest.mark.long  # the table of a pad; formulas of it in test_pad_formulas
def test_single_contacts_reach_their_bound(
    estimator: LoadEstimator, contacts: np.ndarray, singles: tuple[np.ndarray, np.ndarray]
) -> None:
    so = np.tile(singles[0], (8, 1))
    found = estimator.estimate(noisy(so, 0))
    assert {len(e.contacts) for e in found} == {1}
    wrong = []
    for estimate, true in zip(found, np.tile(contacts, (8, 1)), strict=True):
        (c,) = estimate.contacts
        assert c.covariance is not None
        assert c.names == ("angle", "axial", "force")
        spread = np.sqrt(np.diag(c.covariance))
        wrong.append((np.array([c.angle, c.axial, c.force]) - true) / spread)
    scaled = np.array(wrong)
    assert (np.sqrt((scaled**2).mean(0)) < 1.2).all()
    # Extents and tangents that might be there widen what is stated of such discs.
    assert (np.abs(scaled) < 1.96).mean() >= 0.90
    assert 0.85 < np.mean([e.chi2_per_dof for e in found]) < 1.15


@pytest.mark.long  # the table of a pad; formulas of it in test_pad_formulas
def test_a_contact_lighter_than_those_tabulated_is_found_where_it_is(
    estimator: LoadEstimator, table: PadTable
) -> None:
    random = np.random.default_rng(8)
    angle, axial = random.uniform([[-0.7], [-0.035]], [[0.7], [0.035]], (2, 200))
    share = np.exp(random.uniform(np.log(0.01), np.log(LEVELS[LEVELS > 0][0]), 200))
    force = share * np.exp(table.largest(angle, axial)[0][:, 0])
    contacts = np.stack([angle, axial, force], 1)
    fitter = estimator.selection.fitter
    assert isinstance(fitter, PadFitter)
    so = fitter.interpolant(contacts, 1).readings[:, : estimator.taxels]
    found, _ = estimator.selection.explain(*estimator.weigh(so))
    # Without noise the right place is where nothing is left.
    np.testing.assert_allclose(found.chi2, 0, atol=1e-3)
    np.testing.assert_allclose(found.parameters[:, :3], contacts, rtol=0.02, atol=1e-3)


class _EndingPaths:
    """Gaps that close at a force of one newton, on paths that end early if steps are long."""

    def __init__(self, skin: Skin) -> None:
        self.skin = skin

    def solve(self, places: np.ndarray, force: np.ndarray, levels: np.ndarray) -> Column:
        x = force[:, None] * levels
        gap = float(self.skin.geometry.oil_gap[0]) * (1 - 2 * x / (1 + np.maximum(x, 0)))
        found = (x < 0.5) | (force[:, None] < 1.1)
        return Column(np.zeros((*x.shape, 1)), np.zeros(x.shape), gap, found)


def test_a_path_that_ends_early_is_tried_with_shorter_steps(skin: Skin) -> None:
    probes = np.linspace(0, 1, 3), np.linspace(0, 1, 2)
    cap, touch = largest_forces(_EndingPaths(skin), probes)  # type: ignore[arg-type]
    # 5 % of the gap are left at 0.95 / 1.05 N, where the path's levels are coarse.
    np.testing.assert_allclose(cap, 0.95 / 1.05, rtol=0.03)
    np.testing.assert_allclose(touch, 1.0, rtol=0.03)


@pytest.mark.long  # compiles the columns of another pad
def test_a_pad_that_lacks_oil_is_tabulated_to_its_wall(spec: SkinSpec) -> None:
    oil = spec.oil.model_copy(update={"fill": 0.999})
    skin = skin_of(spec.model_copy(update={"oil": oil}), elements=ELEMENTS, contact=False)
    columns = Columns(skin, DIAMETER, lambda *_: None, MANY)
    unloaded = forward(skin, Loads.patch(0.0, 0.0, 0.0, DIAMETER))
    rest, pressure = columns.rest()
    np.testing.assert_allclose(rest, np.asarray(unloaded.so)[:, 0], rtol=1e-9)
    assert pressure < -1.0
    assert pressure == pytest.approx(float(unloaded.oil_pressure[0]), rel=1e-9)
    middle = np.zeros(1)
    cap, _ = largest_forces(columns, (middle, middle))
    levels = LEVELS[LEVELS != 0]
    found = columns.solve(np.zeros((1, 2)), cap.reshape(-1), levels)
    left = found.min_gap[0, -1] / spec.geometry.mean_gap
    assert 0.03 < left < 0.08  # a twentieth


@pytest.mark.long  # 15 s to compile; random pads are a study of their own
def test_a_state_that_a_path_does_not_find_is_solved_from_rest(
    skin: Skin, monkeypatch: pytest.MonkeyPatch
) -> None:
    columns = Columns(skin, DIAMETER, lambda *_: None, MANY)
    place, force, levels = np.array([[0.2, 0.01]]), np.array([8.0]), LEVELS[LEVELS != 0]
    whole = columns.solve(place, force, levels)
    run = COMPILED.run

    def losing_one(function: Any, *arguments: Any, **settings: Any) -> Any:
        found = run(function, *arguments, **settings)
        if not isinstance(found, PadReadings):
            return found
        return found._replace(found=found.found.at[3].set(False), so=found.so.at[3].set(0.0))

    monkeypatch.setattr(COMPILED, "run", losing_one)
    mended = columns.solve(place, force, levels)
    assert mended.found.all()
    np.testing.assert_allclose(mended.so, whole.so, rtol=1e-7)
    np.testing.assert_allclose(mended.min_gap, whole.min_gap, rtol=1e-7)


@pytest.mark.long  # the table of a pad; formulas of it in test_pad_formulas
def test_pairs_are_sought_with_forces_between_those_tabulated(
    estimator: LoadEstimator, table: PadTable
) -> None:
    random = np.random.default_rng(9)
    fitter = estimator.selection.fitter
    assert isinstance(fitter, PadFitter)
    angle = random.uniform([0.1, -0.6], [0.6, -0.1], (30, 2))
    axial = random.uniform(-0.03, 0.03, (30, 2))
    cap = np.exp(table.largest(angle.reshape(-1), axial.reshape(-1))[0]).reshape(30, 2)
    force = random.uniform(0.15, 0.35, (30, 2)) * cap
    contacts = np.concatenate([angle, axial, force], 1)
    so = fitter.interpolant(contacts, 2).readings[:, : estimator.taxels]
    y, weight = estimator.weigh(so)
    left = []
    for k in range(30):
        starts = np.array(
            [s for s, _ in finished(estimator.selection.several.pairs.of_two(y[k], weight[k]))]
        )
        rows = [np.tile(x[k], (len(starts), 1)) for x in (y, weight)]
        fit = finished(fitter.squares.steps(*rows, starts, 2, None, False))
        left.append(fit.chi2.min())
    np.testing.assert_allclose(left, 0, atol=1e-3)


@pytest.mark.long  # the table of a pad; formulas of it in test_pad_formulas
def test_drift_of_a_pad_is_taken_off_before_contacts_are_sought(
    estimator: LoadEstimator,
    spec: SkinSpec,
    contacts: np.ndarray,
    singles: tuple[np.ndarray, np.ndarray],
) -> None:
    rest = estimator.model_rest
    settings: dict[str, Any] = {"diameter": DIAMETER, "most_contacts": 1, "rest": rest}
    following = LoadEstimator(spec, follow_drift=True, **settings)
    fixed = LoadEstimator(spec, **settings)
    quiet, time = 512, np.arange(512 + len(contacts)) / 10
    drift = np.minimum(time / time[quiet], 1)[:, None] * (4 + 0.01 * rest)
    so = noisy(np.concatenate([np.tile(rest, (quiet, 1)), singles[0]]) + drift, 8)
    found = following.estimate(so, time=time)
    assert sum(bool(e.contact) for e in found[:quiet]) < 0.03 * quiet
    # Where the drift is left in, it is taken for contacts.
    assert sum(bool(e.contact) for e in fixed.estimate(so[quiet // 2 : quiet])) > 40
    scaled = []
    for estimate, true in zip(found[quiet:], contacts, strict=True):
        (c,) = estimate.contacts
        assert c.covariance is not None
        spread = np.sqrt(np.diag(c.covariance))
        scaled.append((np.array([c.angle, c.axial, c.force]) - true) / spread)
    assert np.sqrt(np.square(scaled).mean()) < 1.3
    mean, _ = found[-1].drift or (0.0, 0.0)
    assert abs(mean - drift[-1].mean()) < 0.5
    # A stream, frame by frame, learns from 32 at a time.
    live = LoadEstimator(spec, follow_drift=True, **settings)
    for k in range(448, 512):
        (last,) = live.estimate(so[k : k + 1], time=time[k : k + 1])
    assert last.drift is not None
    assert abs(last.drift[0] - drift[480:512].mean()) < 0.7


@pytest.mark.long  # the table of a pad; formulas of it in test_pad_formulas
def test_the_range_of_a_pad_is_the_bound_of_its_readings(
    estimator: LoadEstimator, skin: Skin, table: PadTable
) -> None:
    fitter = estimator.selection.fitter
    assert isinstance(fitter, PadFitter)
    found = range_from_table(table, estimator.along, np.zeros((0, 2)), (5, 3), 2.0)
    place = found.angle[3], found.axial[1]
    # The inverse of the information that the estimator's own weights and slopes hold.
    own = fitter.interpolant(np.array([[*place, found.force[3, 1, 6]]]), 1)
    weight = estimator.weigh(own.readings[:, :-1])[1][0, :-1]
    jacobian = own.jacobian[0, :, :-1]
    covariance = np.linalg.inv((jacobian * weight) @ jacobian.T)
    np.testing.assert_allclose(found.error[:, 3, 1, 6], np.sqrt(np.diag(covariance)), rtol=1e-6)
    # A contact is told from where its force is five times its error.
    told = found.smallest[3, 1]
    slopes = fitter.interpolant(np.array([[*place, told]]), 1).jacobian[0, :, :-1]
    spread = np.sqrt(np.linalg.inv(slopes @ slopes.T * weight.max())[2, 2])
    assert spread == pytest.approx(0.2 * told, rel=0.1)
    # The wall is where a solved state has no gap left.
    columns = Columns(mirror_images(skin)[0], DIAMETER, lambda *_: None, MANY)
    touch = np.array([found.first_contact[3, 1]])
    (gap,) = columns.solve(np.array([place]), touch, LEVELS[LEVELS != 0]).min_gap[:, -1]
    assert abs(gap) < 0.05 * float(skin.geometry.oil_gap[0])


@pytest.mark.long  # the table of a pad; formulas of it in test_pad_formulas
def test_measured_pressure_adds_to_the_force(
    estimator: LoadEstimator, contacts: np.ndarray, singles: tuple[np.ndarray, np.ndarray]
) -> None:
    so, pressure = singles
    measured = pressure + np.random.default_rng(2).normal(0, 20, len(pressure))
    without = estimator.estimate(noisy(so, 5))
    found = estimator.estimate(noisy(so, 5), pressure=measured)
    for a, b, true in zip(without, found, contacts, strict=True):
        spread = b.contacts[0].deviation("force")
        assert spread < a.contacts[0].deviation("force")
        assert abs(b.contacts[0].force - true[2]) < 4 * spread


@pytest.mark.long  # the table of a pad; formulas of it in test_pad_formulas
def test_posterior_agrees_with_the_covariance(
    estimator: LoadEstimator, singles: tuple[np.ndarray, np.ndarray]
) -> None:
    so, pressure = noisy(singles[0][0], 5), float(singles[1][0])
    settings = Settings(steps=1500, walkers=16)
    (mode,) = frame_posterior(estimator, so, settings=settings, pressure=pressure)
    assert_chain_agrees_with_the_mode(mode)
    shown = posterior_json([mode])["modes"][0]["loads"][0]
    assert shown["axial_m"]["mean"] == pytest.approx(mode.parameters[1], abs=1e-3)
    # The measured pressure is part of what is known of the force.
    without, _ = likely_modes(estimator, *estimator.weigh(so[None]))
    assert mode.covariance[2, 2] < covariance_of(without, 3)[0, 2, 2]


ALONE = """
import sys

import numpy as np

from fitting import LoadEstimator
from fitting.inverse_load.pad.table import PadResolution
from suas_jax import load_skin

skin, readings, diameter, *numbers = sys.argv[1:]
along, across, spacing, *probes = (float(x) for x in numbers)
resolution = PadResolution((int(along), int(across)), spacing, tuple(int(x) for x in probes))
estimator = LoadEstimator(
    load_skin(skin),
    diameter=float(diameter),
    most_contacts=1,
    pressure_noise=20.0,
    live=True,
    follow_drift=True,
    rest=np.load(readings)[0],
    resolution=resolution,
)
estimator.warm_up()
found = estimator.estimate(np.load(readings), time=np.arange(2.0))
assert not {"jax", "equinox"} & set(sys.modules)
assert found[0].contact is False
(contact,) = found[1].contacts
print(contact.angle, contact.axial, contact.force)
"""


@pytest.mark.long  # the table of a pad; formulas of it in test_pad_formulas
def test_frames_of_one_contact_need_no_jax_once_the_table_is_kept(
    estimator: LoadEstimator,
    folder: Path,
    contacts: np.ndarray,
    singles: tuple[np.ndarray, np.ndarray],
) -> None:
    readings = np.stack([estimator.model_rest, singles[0][0]])
    np.save(folder / "readings.npy", readings)
    numbers = DIAMETER, *ELEMENTS, RESOLUTION.spacing, *RESOLUTION.probes
    own = folder / "skin.toml", folder / "readings.npy", *numbers
    done = subprocess.run(
        [sys.executable, "-c", ALONE, *map(str, own)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    kind: dict[str, Any] = {"diameter": DIAMETER, "pressure_noise": 20.0, "most_contacts": 1}
    kind |= {"rest": readings[0], "live": True, "follow_drift": True}
    here = LoadEstimator(estimator.spec, **kind).estimate(readings, time=np.arange(2.0))
    (contact,) = here[1].contacts
    expected = contact.angle, contact.axial, contact.force
    np.testing.assert_allclose([float(x) for x in done.stdout.split()], expected, rtol=1e-9)


@pytest.mark.long  # the table of a pad; formulas of it in test_pad_formulas
def test_two_contacts_are_told_apart(estimator: LoadEstimator, skin: Skin) -> None:
    true = np.array([(-0.35, -0.012, 6.0), (0.3, 0.015, 5.0)])
    found = forward(skin, Loads.patch(*true.T[..., None], DIAMETER))
    assert not int(found.result[0])
    several = LoadEstimator(
        estimator.spec, diameter=DIAMETER, most_contacts=2, pressure_noise=20.0
    )
    for estimate in several.estimate(noisy(np.asarray(found.so).T, 3)):
        assert estimate.status == "ok"
        assert len(estimate.contacts) == 2
        for contact, place in zip(estimate.contacts, true, strict=True):
            assert contact.covariance is not None
            off = np.array([contact.angle, contact.axial, contact.force]) - place
            assert off @ np.linalg.solve(contact.covariance, off) < 25


@pytest.mark.long  # the table of a pad; formulas of it in test_pad_formulas
def test_a_strap_is_told_by_a_solved_state_and_many_fingers_are_not_sure(
    estimator: LoadEstimator, skin: Skin
) -> None:
    told = np.array([0.1, 0.0, 25.0, 31e-3, -1.1, 0.0, 0.0])  # 93 by 10 mm
    places, share = patch_points(told, float(skin.geometry.outer_size[0]))
    model = FieldForward(skin, FieldNodes.at(skin, places))
    strap = noisy(np.asarray(model.state(25.0 * share, model.rest()).so)[None], 3)
    (found,) = estimator.estimate(strap)
    (contact,) = found.contacts
    assert found.status == "ok"
    assert contact.force == pytest.approx(25, rel=0.04)
    assert contact.axial_extent is not None
    assert contact.axial_extent[0] == pytest.approx(93e-3, rel=0.05)
    # The interpolant's discs over a box alone leave more.
    fitter = estimator._parts.fitter
    assert isinstance(fitter, PadFitter)
    y, weight = estimator.weigh(strap)
    alone = finished(fitter.squares.steps(y, weight, told[None], 1, None, False))
    solved = found.chi2_per_dof * (len(y[0]) - 1 - fitter.per_contact)
    assert alone.chi2[0] > solved + 15
    discs = [[-0.5, -0.025], [0.5, -0.02], [0.0, 0.0], [-0.4, 0.03], [0.45, 0.028]]
    fingers = forward(skin, Loads.patch(*np.array(discs).T[..., None], 5.0, DIAMETER))
    (many,) = estimator.estimate(noisy(np.asarray(fingers.so).T, 3))
    assert many.status not in ("ok", "imprecise")


@pytest.mark.long  # likewise
def test_a_direction_is_estimated_as_well_as_the_readings_tell(
    estimator: LoadEstimator, spec: SkinSpec
) -> None:
    free = LoadEstimator(spec, direction=True, diameter=DIAMETER, most_contacts=1)
    assert free.names == ("angle", "axial", "force", "direction", "tilt")
    true = np.array([-0.3, 0.012, 14.0, 0.35, -0.3])
    fitter = free.selection.fitter
    assert isinstance(fitter, PadFitter)
    solved = forward(free.skin, Loads.patch(*true[:3], DIAMETER, *true[3:]))
    so = np.asarray(solved.so).T
    (found,) = free.estimate(noisy(so, 3))
    (contact,) = found.contacts
    assert contact.covariance is not None
    off = np.array([getattr(contact, name) for name in free.names]) - true
    assert off @ np.linalg.solve(contact.covariance, off) < chi2.ppf(0.999, 5)
    turn = contact.deviation("direction")
    assert turn < np.deg2rad(4)
    assert contact.deviation("tilt") > turn  # along the axis the membrane is stiffer
    # Where it is not asked for, the force along the arc is told beside.
    (beside,) = estimator.estimate(noisy(so, 3))
    assert beside.contacts[0].arc_force is not None
    value, deviation = beside.contacts[0].arc_force
    assert abs(value - 14 * np.cos(-0.3) * np.sin(0.35)) < 4 * deviation


@pytest.mark.long  # the table of a pad; formulas of it in test_pad_formulas
def test_faulty_taxels_are_left_out(
    estimator: LoadEstimator, contacts: np.ndarray, singles: tuple[np.ndarray, np.ndarray]
) -> None:
    so = noisy(singles[0], 6)
    so[:, [3, 11, 17]] = np.nan
    faulty = np.zeros(so.shape, bool)
    so[:, 20] = 900.0
    faulty[:, 20] = True
    for estimate, true in zip(estimator.estimate(so, faulty), contacts, strict=True):
        assert estimate.left_out == (3, 11, 17, 20)
        (c,) = estimate.contacts
        assert abs(c.force - true[2]) < 5 * c.deviation("force")


@pytest.mark.long  # the table of a pad; formulas of it in test_pad_formulas
@pytest.mark.parametrize(
    ("path", "name", "within"),
    [
        ("geometry.oil_gap", "geometry.oil_gap", 4e-3),
        ("oil.relative_permittivity", "oil.relative_permittivity", 4e-3),
        ("material.mu", STIFFNESS, 15e-3),
    ],
)
def test_a_wrong_skin_file_is_noticed(
    estimator: LoadEstimator,
    spec: SkinSpec,
    contacts: np.ndarray,
    path: str,
    name: str,
    within: float,
) -> None:
    true = skin_of(
        spec, {path: 1.06 * continuous_inputs(spec)[path]}, elements=ELEMENTS, contact=False
    )
    columns = Columns(mirror_images(true)[0], DIAMETER, lambda *_: None, MANY)
    where = mirror_images(true)[1][0]
    found = columns.solve(contacts[:, :2], contacts[:, 2], LEVELS[LEVELS != 0])
    so, pressure = noisy(found.so[:, -1, where], 11), found.pressure[:, -1]
    faulty = np.zeros(so.shape, bool)
    estimates = estimator.estimate(so, faulty, pressure=pressure)
    verdict = model_verdict(estimator, so, faulty, pressure, estimates)
    assert verdict is not None
    assert not verdict.right
    found_change = {verdict.name: verdict.change, **{x.name: x.change for x in verdict.others}}
    assert found_change[name] == pytest.approx(0.06, abs=within)
    assert verdict.explained < verdict.chi2_per_dof


@pytest.mark.long  # the table of a pad; formulas of it in test_pad_formulas
def test_a_right_skin_file_is_not_suspected(
    estimator: LoadEstimator, singles: tuple[np.ndarray, np.ndarray]
) -> None:
    so, faulty = noisy(singles[0], 12), np.zeros(singles[0].shape, bool)
    estimates = estimator.estimate(so, faulty, pressure=singles[1])
    verdict = model_verdict(estimator, so, faulty, singles[1], estimates)
    assert verdict is not None
    assert verdict.right


@pytest.mark.long  # the table of a pad; formulas of it in test_pad_formulas
def test_at_the_wall_a_force_that_acts_at_least_is_stated(
    estimator: LoadEstimator, table: PadTable, solved: Solve
) -> None:
    # Beyond first contact the wall takes the rest: the readings are those of first contact.
    place = np.array([0.2, 0.01])
    (touch,) = table.first_contact_at(*place[:, None])
    (found,) = estimator.estimate(noisy(solved(np.array([[*place, touch]]))[0], 8))
    assert found.wall_contact
    assert found.status == "wall_contact"
    assert found.at_least is not None
    assert 0.6 * touch < found.at_least < touch
    (contact,) = found.contacts
    assert contact.covariance is None
    assert contact.angle == pytest.approx(place[0], abs=0.01)


@pytest.mark.long  # the table of a pad; formulas of it in test_pad_formulas
def test_a_pull_is_named(estimator: LoadEstimator, solved: Solve) -> None:
    so, _ = solved(np.array([[0.2, 0.01, -2.0]]))
    (found,) = estimator.estimate(noisy(so, 8))
    assert found.status == "pull"
    assert found.contacts[0].force == pytest.approx(-2.0, abs=0.5)


@pytest.mark.long  # the table of a pad; formulas of it in test_pad_formulas
def test_noise_alone_is_called_a_contact_at_the_stated_rate(estimator: LoadEstimator) -> None:
    frames = 3000
    rest = np.tile(estimator.model_rest, (frames, 1))
    change = noisy(rest, 1) - rest
    detector = estimator._parts.detector
    assert isinstance(detector, PadDetector)
    weight = np.full((frames, estimator.taxels + 1), 1 / (4 + 1 / 12))
    weight[:, -1] = 0.0
    test = detector.test(np.column_stack([change, np.zeros(frames)]), weight)
    for rate in (0.01, 0.05):
        alarms = int((test.p_value < rate).sum())
        # The tube formula is an upper bound, close where it is small.
        assert binom.ppf(1e-3, frames, 0.6 * rate) <= alarms
        assert alarms <= binom.ppf(0.999, frames, rate)


@pytest.mark.long  # the table of a pad; formulas of it in test_pad_formulas
def test_the_filter_follows_the_axial_position(
    estimator: LoadEstimator, singles: tuple[np.ndarray, np.ndarray], contacts: np.ndarray
) -> None:
    track = LoadFilter(angle_density=1e-4, force_density=1e-2, axial_density=1e-8)
    found = estimator.estimate(noisy(np.tile(singles[0][:1], (60, 1)), 7))
    for k, estimate in enumerate(found):
        (smooth,) = track.feed(0.01 * k, estimate)
    assert smooth.axial is not None
    assert smooth.deviation("axial") < 0.5 * estimate.contacts[0].deviation("axial")
    assert abs(smooth.axial - contacts[0, 1]) < 4 * smooth.deviation("axial")


@pytest.mark.long  # the table of a pad; formulas of it in test_pad_formulas
def test_json_of_a_log(
    folder: Path, estimator: LoadEstimator, singles: tuple[np.ndarray, np.ndarray]
) -> None:
    rows = noisy(singles[0][:2], 9).astype(int)
    names = [f"so_{k + 1}" for k in range(rows.shape[1])]
    lines = [",".join(["t_host_s,t_device_s,seq,module", *names, "oil_pressure_Pa"])]
    for k, row in enumerate(rows):
        lines.append(",".join(map(str, [k, k, k, 0, *row, f"{singles[1][k]:.1f}"])))
    (folder / "log.csv").write_text("\n".join(lines) + "\n")
    options = ["--json", "--diameter", "12 mm", "--pressure-noise", "20 Pa", "--contacts", "1"]
    arguments = ["invert", str(folder / "skin.toml"), str(folder / "log.csv"), *options]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    frames = [json.loads(line) for line in result.stdout.splitlines()]
    assert len(frames) == 2
    (load,) = frames[0]["loads"]
    assert {"angle_deg", "axial_m", "force_N", "covariance"} <= load.keys()
    assert np.array(load["covariance"]).shape == (3, 3)
    assert frames[0]["oil_pressure_Pa"] == pytest.approx(singles[1][0], abs=80)


COLUMNS = "t_host_s,t_device_s,seq,module," + ",".join(f"so_{k + 1}" for k in range(35))
COUNTS = ",160" * 35
FRAME = f"{COLUMNS}\n0,0,0,0{COUNTS}\n"


@pytest.mark.parametrize(
    ("log", "options", "words"),
    [
        (FRAME, ["--diameter", "6"], "--diameter"),
        (FRAME, ["--diameter", "90 mm"], "diameter"),
        (FRAME, ["--pressure-noise", "0 Pa"], "pressure_noise"),
        (FRAME, ["--noise", "-1"], "noise"),
        (FRAME, ["--workers", "tcp://localhost:8786"], "--trust-network"),
        (FRAME, ["--posterior", "7"], "no such frame; the log has 0 to 0"),
        (FRAME, ["--plot", "figure.xyz"], "figure.xyz"),
        (COLUMNS + "\n", [], "no frame in it"),
        (FRAME.replace("0,0,0,0", "0,0,0,3"), [], "module 3 is none of the skin's"),
        ("t_host_s,t_device_s,seq,module,so_1\n0,0,0,0,160\n", [], "module 0 has 1 taxels"),
        (FRAME.replace("seq", "number"), [], "seq"),
        (f"{FRAME}0,0,1,0{COUNTS}\n".replace("160", "much", 1), [], "much"),
        ("", [], "log.csv"),
    ],
)
def test_nothing_is_solved_for_logs_and_options_that_are_refused(
    folder: Path,
    tmp_path: Path,
    log: str,
    options: list[str],
    words: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def never(*arguments: object) -> None:
        pytest.fail("the table is made")

    monkeypatch.setattr(pad_parts, "_table", never)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "log.csv").write_text(log)
    result = CliRunner().invoke(app, ["invert", str(folder / "skin.toml"), "log.csv", *options])
    assert result.exit_code == 2, result.output
    assert words in result.output


@pytest.mark.long  # the table of a pad; formulas of it in test_pad_formulas
def test_a_path_on_a_pad_is_what_single_solves_say(folder: Path, solved: Solve) -> None:
    (folder / "path.toml").write_text(
        'skin = "skin.toml"\n[solve]\nelements = [8, 8]\n[[load]]\nkind = "patch"\n'
        'angle = "0 deg"\ndiameter = "12 mm"\nforce = "6 N"\n'
    )
    (folder / "path.csv").write_text(
        "# scene: path.toml\nt_s,loads.0.axial_m,loads.0.angle_deg,loads.0.force_N\n"
        "0,-0.009,10,6\n1,-0.009,10,4\n2,0.012,-8,6\n"
    )
    time = np.array([0.0, 0.5, 1.0, 2.0])
    found = pad_capacitances(load_path(folder / "path.csv"), time)
    angle = np.deg2rad([10, 10, 10, -8])
    contacts = np.stack([angle, [-0.009, -0.009, -0.009, 0.012], [6, 5, 4, 6]], 1)
    so, _ = solved(contacts)
    np.testing.assert_allclose(found, 0.1e-15 * so, rtol=2e-4)


@pytest.mark.long  # the table of a pad; formulas of it in test_pad_formulas
def test_known_pokes_calibrate_the_electrodes_of_a_pad(
    folder: Path, spec: SkinSpec, contacts: np.ndarray, solved: Solve, patch: pytest.MonkeyPatch
) -> None:
    patch.setattr(scene_states, "PAD_ELEMENTS", ELEMENTS)
    pokes = contacts[:4]
    so, _ = solved(pokes)
    stray, scale = 40.0, 1.07
    counts = noisy(stray + scale * np.repeat(so, 8, 0), 3)
    names = [f"so_{k + 1}" for k in range(so.shape[1])]
    known = ["load_0_angle_rad", "load_0_axial_mm", "load_0_force_N", "load_0_diameter_mm"]
    lines = [",".join(["t_host_s,t_device_s,seq,module", *names, *known])]
    for k, row in enumerate(counts.astype(int)):
        angle, axial, force = pokes[k // 8]
        lines.append(",".join(map(str, [k, k, k, 0, *row, angle, 1e3 * axial, force, 12])))
    (folder / "pokes.csv").write_text("\n".join(lines) + "\n")
    data = load_sensor_data(spec, [folder / "pokes.csv"])
    found = fit_sensor(data, fit=("permittivity", "stray"))
    named = dict(zip(found.problem.family.names, found.constants, strict=True))
    assert named["relative_permittivity"] == pytest.approx(2.2 * scale, rel=2e-3)
    assert named["stray"] == pytest.approx(stray * 0.1e-15, rel=0.05)


@pytest.mark.long  # the table of a pad; formulas of it in test_pad_formulas
def test_a_known_displacement_is_met(spec: SkinSpec, patch: pytest.MonkeyPatch) -> None:
    patch.setattr(scene_states, "PAD_ELEMENTS", ELEMENTS)
    one = np.ones((1, 1))
    unknown = np.nan * one
    place = (0.3 * one, 0 * one)

    inputs = continuous_inputs(spec)

    def deformed(force: np.ndarray, displacement: np.ndarray) -> Solved:
        inner, axial = np.array([True]), -0.01 * one
        none = (0 * one, 0 * one)
        loads = KnownLoads(*place, force, displacement, inner, axial, DIAMETER * one, *none)
        states = SceneStates(spec, loads)
        return states.solve(np.arange(1), loads, inputs, {}, (), None)

    given = deformed(5.0 * one, unknown)
    again = deformed(unknown, given.displacement)
    assert again.force[0, 0] == pytest.approx(5.0, rel=1e-3)
    np.testing.assert_allclose(again.face.heights, given.face.heights, atol=1e-6)


@pytest.mark.long  # the program of solved contacts; searches in steps in test_load_formulas
def test_two_contacts_of_a_stream_are_told_as_without_a_budget_after_some_frames(
    spec: SkinSpec, estimator: LoadEstimator
) -> None:
    assert estimator.taxels  # its table serves both
    settings: dict[str, Any] = {"diameter": DIAMETER, "most_contacts": 2, "live": True}
    free = LoadEstimator(spec, **settings)
    bounded = LoadEstimator(spec, **settings, budget=5e-3)
    fitter = free.selection.fitter
    assert isinstance(fitter, PadFitter)
    x = np.array([0.45, -0.4, 0.012, -0.015, 8.0, 6.0])
    readings = fitter.interpolant(x[None], 2, fitter.correction(x, 2)).readings[:, :-1]
    so = noisy(np.tile(readings, (400, 1)), 5)
    free.warm_up()
    bounded.warm_up()
    (whole,) = free.estimate(so[:1])
    assert (whole.status, len(whole.contacts)) == ("ok", 2)
    (first,) = bounded.estimate(so[:1])
    assert first.status == "coarse"
    assert len(first.contacts) == 1
    assert first.contacts[0].covariance is None
    told = [first]
    for k in range(1, len(so)):
        time.sleep(5e-3)  # a stream is not faster
        told += bounded.estimate(so[k : k + 1])
        if told[-1].status != "coarse":
            break
    assert {estimate.status for estimate in told[:-1]} == {"coarse"}
    assert told[-1].status == "ok"
    for c, other in zip(told[-1].contacts, whole.contacts, strict=True):
        assert c.covariance is not None
        spread = 4 * np.sqrt(np.diag(c.covariance))
        apart = [c.angle - other.angle, c.axial - other.axial, c.force - other.force]  # type: ignore[operator]
        assert (np.abs(apart) < spread).all()
    # Lifted, and gone: the next touch begins with nothing known.
    (gone,) = bounded.estimate(noisy(free.model_rest[None], 6))
    assert gone.status == "no_contact"


def test_a_budget_is_for_live_frames_of_pads(spec: SkinSpec) -> None:
    for settings in ({"budget": 0.02}, {"budget": 0.0, "live": True}):
        with pytest.raises(ValueError, match="budget"):
            LoadEstimator(spec, **settings)  # type: ignore[arg-type]
    assert pad_settings(None, None, "20 ms") == {"budget": pytest.approx(0.02)}
    with pytest.raises(ValueError, match='--budget "20 mm"'):
        pad_settings(None, None, "20 mm")
