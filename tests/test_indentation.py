"""A body that is pressed into a skin: its curve tells the material, its travel the readings."""

import csv
import json
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from fitting.material.data.errors import DataError
from fitting.material.experiments.datasets import load_dataset
from fitting.material.experiments.skin_curve import ratio_of
from fitting.material.experiments.skin_readings import DISPLACEMENT, PRESSURE, IndentationTest
from fitting.material.fit.fit import fit_material
from fitting.material.fit.noise import on_smooth_scale
from fitting.material.fit.problem import Residuals, readings, shared_error
from fitting.material.report.skin_inputs import effect_of, inputs_report, weighed_change
from fitting.sensor.fit.calibrate import fit_sensor
from fitting.sensor.logs.data import load_sensor_data
from suas_jax.config import continuous_inputs, load_scene, load_skin, with_inputs, with_solve
from suas_jax.scene.solve import solve
from suas_jax.scene.sweep import sweep

ROOT = Path(__file__).parent.parent
SCENE, SKIN = ROOT / "configs/scenes/body.toml", ROOT / "configs/skins/suas.toml"
SHEAR_MODULUS = 2 * (20.7e6 - 4.4e6)


def written(folder: Path, header: str, *rows: str) -> Path:
    file = folder / "press.csv"
    file.write_text("\n".join((header, *rows)))
    return file


def loaded(file: Path, scene: Path = SCENE, **options: Any) -> IndentationTest:
    data = load_dataset("indentation", file, scene=scene, **options)
    assert isinstance(data, IndentationTest)
    return data


def test_travels_and_forces_are_read(tmp_path: Path) -> None:
    rows = ("-0.1,0.1,0", "0,0.2,0", "0.5,1.5,400", "1.0,3.25,1000")
    data = loaded(written(tmp_path, "travel_mm,force_N,oil_pressure_Pa", *rows))
    np.testing.assert_allclose(data.drive, [0.5e-3, 1e-3] * 2)
    np.testing.assert_allclose(data.value, [1.5, 3.25, 400.0, 1000.0])
    assert data.channel.tolist() == [DISPLACEMENT] * 2 + [PRESSURE] * 2
    assert "2 rows before first touch" in " ".join(data.warnings)


def test_the_table_of_a_sweep_is_read(tmp_path: Path) -> None:
    """Its travel, not the displacement of the material that stands beside it."""
    names = "force_N,loads.0.depth_m,loads.0.displacement_m,loads.0.force_N,oil_pressure_Pa"
    data = loaded(written(tmp_path, names, "1.5,5e-4,4e-4,1.5,400"))
    np.testing.assert_allclose(data.drive, 5e-4)
    np.testing.assert_allclose(data.value, [1.5, 400.0])


def test_the_machine_takes_its_share_of_the_travel(tmp_path: Path) -> None:
    data = loaded(written(tmp_path, "travel_mm,force_N", "1.0,4"), machine_stiffness="10 N/mm")
    np.testing.assert_allclose(data.drive, 0.6e-3)


@pytest.mark.parametrize(
    ("scene", "header", "row", "wanted"),
    [
        ("case_a.toml", "travel_mm,force_N", "1,1", 'kind = "body"'),
        ("body.toml", "force_N,time_s", "1,1", "travel_mm"),
        ("body.toml", "travel_mm,time_s", "1,1", "force_N"),
        ("body.toml", "travel_mm,force_N", "-1,1", "no row"),
    ],
)
def test_what_is_missing_is_named(
    scene: str, header: str, row: str, wanted: str, tmp_path: Path
) -> None:
    with pytest.raises(DataError, match=wanted):
        loaded(written(tmp_path, header, row), SCENE.parent / scene)


def test_readings_of_rest_do_not_tell_the_size_of_the_modulus() -> None:
    """A skin of cold oil: no force before the touch, and a pressure of the other sign."""
    channel = np.repeat([DISPLACEMENT, PRESSURE], 5)
    force, pressure = np.array([0.0, 0, 0, 0.5, 2]), np.array([-23.0, -23, -22, -5, 60])
    stiff = np.concatenate([1.5 * force, 1.5 * pressure])
    assert ratio_of(stiff, np.concatenate([force, pressure]), channel) == 1.5
    assert np.isnan(ratio_of(stiff, np.zeros(10), channel))  # of a body that never touches


def test_an_input_that_is_wrong_moves_the_modulus_as_least_squares_says() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.standard_normal((2, 30))
    found = effect_of(a, b, noise=0.7)
    both = np.stack([a, b], 1)
    covariance = 0.7**2 * np.linalg.inv(both.T @ both)
    np.testing.assert_allclose(found.joint_error, np.sqrt(covariance[1, 1]), rtol=1e-12)
    moved = np.linalg.lstsq(a[:, None], -b, rcond=None)[0]
    np.testing.assert_allclose(found.modulus_change, moved[0], rtol=1e-12)
    assert effect_of(a, 0 * b, 1.0) == (0.0, 0.0, None)


def test_errors_that_readings_share_weigh_inputs_and_modulus_alike() -> None:
    value, noise = np.linspace(0.5, 8.0, 20), 0.01
    sigma, error = noise * value, 0.04 * value
    none: Any = None
    residuals = Residuals(
        (),
        jnp.asarray(value),
        jnp.asarray(1 / sigma),
        none,
        jnp.asarray(shared_error(error / sigma))[None],
        none,
    )
    inverse = np.linalg.inv(np.diag(sigma**2) + np.outer(error, error))
    place, slope = np.arange(20), value**1.5
    a, b = (weighed_change(residuals, place, x) for x in (value, slope))
    found = effect_of(a, b, 1.0)
    expected = -(value @ inverse @ slope) / (value @ inverse @ value)
    np.testing.assert_allclose(found.modulus_change, expected, rtol=1e-10)
    # An input that scales all readings is the modulus, whatever they share.
    alike = effect_of(a, weighed_change(residuals, place, 2.2 * value), 1.0)
    assert alike.modulus_change == pytest.approx(-2.2, rel=1e-12)


def test_noise_of_readings_is_no_pattern_of_derivatives_whatever_they_share() -> None:
    """Over shares of predictions a modulus moves all readings alike."""
    none: Any = None
    noise, share = 0.01, 0.04
    predicted = np.linspace(0.5, 8.0, 12)
    value = predicted * (1 + noise * np.random.default_rng(2).normal(size=12))
    shared = shared_error(np.full(12, share / noise))[None]
    scale = jnp.asarray(1 / (noise * value))
    residuals = Residuals((), jnp.asarray(value), scale, none, jnp.asarray(shared), none)
    r, slope = (
        np.asarray(residuals.weighed(jnp.asarray(x))) for x in (predicted - value, predicted)
    )
    found, J = on_smooth_scale(residuals, [np.arange(12)], r, slope[:, None])
    np.testing.assert_allclose(J, J[0, 0], rtol=1e-12)
    covariance = np.diag((noise * predicted) ** 2) + share**2 * np.outer(predicted, predicted)
    misfit = predicted - value
    assert found @ found == pytest.approx(misfit @ np.linalg.inv(covariance) @ misfit)


def log_of(folder: Path, so: np.ndarray, columns: dict[str, np.ndarray]) -> Path:
    names = [f"so_{k + 1}" for k in range(len(so))]
    head = ["t_host_s", "t_device_s", "seq", "module", *names, *columns]
    file = folder / "log.csv"
    with file.open("w", newline="") as out:
        rows = csv.writer(out)
        rows.writerow(head)
        for k, counts in enumerate(so.T):
            own = (f"{c:.6f}" for c in counts)
            rows.writerow([0.1 * k, 0.1 * k, k, 0, *own, *(c[k] for c in columns.values())])
    return file


@pytest.mark.parametrize(
    ("columns", "wanted"),
    [
        ({"load_0_depth_mm": 1.0, "load_0_angle_deg": 0.0}, "load_0_radius_mm"),
        ({"load_0_radius_mm": 1.0, "load_0_angle_deg": 0.0, "load_0_force_N": 1}, "_depth_mm"),
        (
            {
                "load_0_depth_mm": 1.0,
                "load_0_radius_mm": 5.0,
                "load_0_angle_deg": 0.0,
                "load_1_force_N": 1.0,
                "load_1_angle_deg": 20.0,
            },
            "one kind at a time",
        ),
        ({"load_0_depth_mm": 9.0, "load_0_radius_mm": 5.0, "load_0_angle_deg": 0.0}, "oil gap"),
    ],
)
def test_bodies_of_a_log_that_say_too_little(
    columns: dict[str, float], wanted: str, tmp_path: Path
) -> None:
    taxels = len(load_skin(SKIN).electrodes.taxels)  # type: ignore[union-attr]
    so = 1000.0 + np.arange(3 * taxels).reshape(taxels, 3)
    log = log_of(tmp_path, so, {k: np.full(3, x) for k, x in columns.items()})
    with pytest.raises(ValueError, match=wanted):
        load_sensor_data(load_skin(SKIN), [log])


@pytest.mark.long  # a body's curve compiles a program of its own; formulas above
def test_modulus_from_another_programs_curve(tmp_path: Path) -> None:
    """An independent continuum's forces and pressures (tests/data/indenter2d.csv).

    With incompressible oil forces and pressures are proportional to the modulus.
    """
    table = Path(__file__).parent / "data" / "indenter2d.csv"
    with table.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(x for x in file if not x.startswith("#")))
    own = [r for r in rows if r["angle_deg"] == "30"]
    lines = [",".join(r[k] for k in ("d_m", "force_radial_N", "oil_pressure_Pa")) for r in own]
    header = "# noise: 0.1 %\ntravel_m,force_N,oil_pressure_Pa"
    data = loaded(written(tmp_path, header, *lines))
    fit = fit_material([data], "neo-hookean", residual="noise")
    assert fit.status == "converged"
    modulus, low, high = fit.shear_modulus()
    assert low < SHEAR_MODULUS < high
    assert abs(modulus / SHEAR_MODULUS - 1) < 2e-3
    step = 1e-3 * fit.constants
    near, far = (
        np.asarray(readings(fit.problem.residuals, fit.constants + k * step)[0]) for k in (0, 1)
    )
    np.testing.assert_allclose(far / near - 1, 1e-3, rtol=1e-5)
    # What is taken as exact, against a fit and solutions with another number.
    thick = next(x for x in inputs_report(fit) if x["input"] == "geometry.thickness")
    thicker = tmp_path / "thicker.toml"
    text = SCENE.read_text().replace("../skins", str(ROOT / "configs/skins"))
    thicker.write_text(f'{text}\n[geometry]\nthickness = "1.515 mm"\n')
    again = loaded(written(tmp_path, header, *lines), thicker)
    moved = fit_material([again], "neo-hookean", residual="noise").shear_modulus()[0] / modulus
    assert thick["modulus_change"] == pytest.approx(moved - 1, rel=0.03)
    scene = with_solve(load_scene(SCENE), model="shell", elements=32)
    thickness = continuous_inputs(scene)["geometry.thickness"]
    slope = data.as_specimen.slopes[:, data.as_specimen.inputs.index("geometry.thickness")]
    at = int(np.argmax(data.drive * (data.channel == DISPLACEMENT)))
    deep = with_inputs(scene, {"load.0.depth": float(data.drive[at])})
    # Over a step that the mesh, which is refined about the zone of each, does not govern.
    forces, shares = [], (0.98, 1.02)
    for share in shares:
        found = solve(with_inputs(deep, {"geometry.thickness": share * thickness}))
        forces.append(found.report["loads"][0]["force_N"])
    change = np.log(forces[1] / forces[0]) / np.log(shares[1] / shares[0])
    np.testing.assert_allclose(slope[at] / data.value[at], change, rtol=0.02)


@pytest.mark.long  # likewise, with its derivatives
def test_calibration_by_a_body_of_known_travel(tmp_path: Path) -> None:
    """Gap and permittivity from counts of the solid."""
    truth = with_inputs(
        with_solve(load_scene(SCENE), model="solid", mesh=[128, 2]),
        {"geometry.oil_gap": 5.2e-3, "oil.relative_permittivity": 2.35},
    )
    depths = np.linspace(0.0, 3e-3, 5)
    points = sweep(truth, depths=depths).points
    so = np.array([[taxel["so"] for taxel in point["taxels"]] for point in points]).T
    columns = {"load_0_depth_mm": 1e3 * depths, "load_0_radius_mm": np.full(5, 10.0)}
    log = log_of(tmp_path, so, {**columns, "load_0_angle_deg": np.full(5, 30.0)})
    data = load_sensor_data(load_skin(SKIN), [log])
    fit = fit_sensor(data)
    found = json.loads(json.dumps(dict(zip(fit.family.names, fit.constants, strict=True))))
    np.testing.assert_allclose(found["oil_gap"], 5.2e-3, rtol=2e-3)
    np.testing.assert_allclose(found["relative_permittivity"], 2.35, rtol=5e-3)
    force = [point["loads"][0]["force_N"] for point in points]
    np.testing.assert_allclose(np.sort(fit.force[0]), np.sort(force), rtol=3e-3, atol=1e-6)
