"""Sensor calibration on synthetic logs: other models' truth, faults, what can't be known."""

import dataclasses
import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from skins import shaped
from typer.testing import CliRunner

from benchmarks.sensor_calibration import press, study
from fitting.cli.app import app
from fitting.report.description import ReportTable
from fitting.sensor.fit.calibrate import fit_sensor
from fitting.sensor.fit.result import SensorFit
from fitting.sensor.logs.data import NoCalibration, load_sensor_data
from fitting.sensor.model.constants import FILL, MOUNTING, PATHS, naming
from fitting.sensor.report.skin_file import calibrated_skin
from fitting.sensor.report.summary import described, sensor_report
from suas_jax.config import (
    SkinSpec,
    UncertainQuantity,
    continuous_inputs,
    input_errors,
    load_skin,
    with_solve,
)
from suas_jax.config.input_errors import as_assembled
from suas_jax.config.oils.vented import VentedOilSpec
from suas_jax.runtime.compiled import jit
from suas_jax.scene.forward import forward
from suas_jax.scene.loads import Loads
from suas_jax.scene.skin import skin_of
from suas_jax.scene.solve import solve

ROOT = Path(__file__).parent.parent
SKIN = ROOT / "configs/skins/suas.toml"
PERMITTIVITY, GAP, AIR = 2.35, 5.2e-3, 1.0006
FRAMES = 500

runner = CliRunner()


@pytest.fixture(scope="module")
def truth() -> dict[str, np.ndarray]:
    """Counts of the solid model at known displacements and forces."""
    displacement = np.repeat(np.linspace(0.0, 3e-3, 100), FRAMES // 100)
    force, so = press(displacement)
    return {"displacement": displacement, "force": force, "so": so}


@pytest.fixture(scope="module")
def reference(
    truth: dict[str, np.ndarray], tmp_path_factory: pytest.TempPathFactory
) -> SensorFit:
    """The calibration from a clean log, by the shell."""
    folder = tmp_path_factory.mktemp("clean")
    log = write_log(folder / "a.csv", truth["so"], known(truth, "displacement"))
    return fitted(log, model="shell")


@pytest.fixture(scope="module")
def corrected(
    truth: dict[str, np.ndarray], tmp_path_factory: pytest.TempPathFactory
) -> SensorFit:
    """The same, its shapes corrected by the solid."""
    folder = tmp_path_factory.mktemp("corrected")
    return fitted(write_log(folder / "a.csv", truth["so"], known(truth, "displacement")))


def write_log(
    path: Path,
    so: np.ndarray,
    columns: dict[str, Any] | None = None,
    *,
    header: str = "",
    seed: int = 0,
    change: Callable[[np.ndarray, np.random.Generator], np.ndarray] | None = None,
) -> Path:
    """An SO log with noise of two counts, written as another program would."""
    random = np.random.default_rng(seed)
    counts = np.rint(so + 2.0 * random.standard_normal(so.shape))
    if change is not None:
        counts = change(counts, random)
    counts = counts.clip(0, 65535).astype(int)
    names = ["t_host_s", "t_device_s", "seq", "module"]
    names += [f"so_{k + 1}" for k in range(len(so))] + list(columns or {})
    rows = [",".join(names)]
    for i in range(so.shape[1]):
        known = [str(np.broadcast_to(v, so.shape[1])[i]) for v in (columns or {}).values()]
        rows.append(
            ",".join(
                [f"{i / 50:.6f}", f"{i / 50}", f"{i}", "0", *map(str, counts[:, i]), *known]
            )
        )
    path.write_text(
        f"# format: suas-so-log\n# scale: 0.305 fF\n{header}" + "\n".join(rows) + "\n"
    )
    return path


def known(truth: dict[str, np.ndarray], kind: str) -> dict[str, Any]:
    if kind == "force":
        return {"load_0_force_N": truth["force"], "load_0_angle_deg": 20.0}
    return {"load_0_displacement_mm": 1e3 * truth["displacement"], "load_0_angle_deg": 20.0}


def fitted(*logs: Path, fluids: tuple[str, ...] = (), **options: Any) -> SensorFit:
    data = load_sensor_data(load_skin(SKIN), logs, fluids=fluids)
    return fit_sensor(data, **options)


def value(fit: SensorFit, name: str) -> tuple[float, float]:
    i = fit.family.names.index(name)
    return float(fit.constants[i]), float(fit.uncertainty.standard_errors[i])


@pytest.mark.parametrize(
    "model", ["reference", pytest.param("corrected", marks=pytest.mark.long)]
)
def test_solid_truth_at_known_displacement(model: str, request: pytest.FixtureRequest) -> None:
    """Gap to 0.1 %, permittivity to 0.5 %, on a mesh that the truth is not from; no prior."""
    fit: SensorFit = request.getfixturevalue(model)
    gap, gap_error = value(fit, "oil_gap")
    permittivity, permittivity_error = value(fit, "relative_permittivity")
    assert abs(gap / GAP - 1) < 1e-3
    assert abs(permittivity / PERMITTIVITY - 1) < 5e-3
    assert abs(gap - GAP) < 4 * gap_error
    assert abs(permittivity - PERMITTIVITY) < 4 * permittivity_error
    assert not fit.priors
    assert not fit.findings
    assert fit.status == "converged"


def test_standard_errors_are_the_cramer_rao_bound(truth: dict, reference: SensorFit) -> None:
    """The bound in closed form, for plates: C = eps A / d."""
    # A parallel plate's counts follow from the gap alone: d = k / SO, so that d SO / d gap
    # = -SO / d and d SO / d eps = SO / eps, footprint averages aside.
    so = truth["so"]
    rest = so[:, :1]
    d = GAP * rest / so
    jacobian = np.stack([so / PERMITTIVITY, -so / d], -1).reshape(-1, 2)
    sigma = np.sqrt(2.0**2 + 1 / 12)
    bound = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian))) * sigma
    assert reference.uncertainty.standard_errors == pytest.approx(bound, rel=0.05)


def test_words_of_a_calibration_name_every_constant_with_its_prior_or_none(
    reference: SensorFit,
) -> None:
    report = sensor_report(reference)

    def priors() -> dict[str, str]:
        tables = [x for x in described(report, reference) if isinstance(x, ReportTable)]
        return {row[0]: row[-1] for table in tables for row in table.rows}

    assert priors() == dict.fromkeys(report["parameters"], "none")
    report["priors"] = {"oil_gap": {"mean": GAP, "sd": 1e-4, "reason": "given"}}
    stated = priors()
    assert stated.pop("oil_gap").endswith("+- 100 um: given")
    assert set(stated.values()) == {"none"}


@pytest.mark.long  # 16 fits; the bound above
def test_coverage_on_seeded_experiments(reference: SensorFit) -> None:
    """Short version of the benchmark: z-scores of 16 experiments look standard normal."""
    fits = study(16, steps=100, like=reference)
    z = np.array(
        [
            (fit.constants - [PERMITTIVITY, GAP]) / fit.uncertainty.standard_errors
            for fit in fits
        ]
    )
    # A chi-square of 16 lies between 4.5 and 34.5 with a probability of 0.993.
    assert np.all(((z**2).sum(0) > 4.5) & ((z**2).sum(0) < 34.5))


@pytest.mark.long  # forces and the material together
def test_known_force_and_joint_material(truth: dict, tmp_path: Path) -> None:
    """Material and electrical constants at once; what plane strain hides is said."""
    log = write_log(tmp_path / "a.csv", truth["so"], known(truth, "force"))
    fit = fitted(
        log,
        model="shell",
        fit=["permittivity", "gap", "material.C1", "material.C2", "material.C3"],
    )
    gap, error = value(fit, "oil_gap")
    assert abs(gap - GAP) < 4 * error
    assert error < 5e-3 * GAP
    stiffness = value(fit, "material.C1")[0] + value(fit, "material.C2")[0]
    assert stiffness == pytest.approx(16.3e6, rel=0.03)
    assert {"material.C2", "material.C3"} <= fit.priors.keys()
    assert "material.C1" not in fit.priors
    assert any("trades against material.C" in text for text in fit.findings)


@pytest.mark.long  # programs for logs at rest; rank in test_sensor_formulas
def test_one_static_log_determines_the_ratio_only(truth: dict, tmp_path: Path) -> None:
    rest = np.repeat(truth["so"][:, :1], 300, 1)
    fit = fitted(write_log(tmp_path / "a.csv", rest), model="shell")
    assert any("only the ratio" in text and "one static" in text for text in fit.findings)
    assert fit.ratio is not None
    ratio, error = fit.ratio
    assert ratio == pytest.approx(PERMITTIVITY / GAP, abs=4 * error)
    assert error < 1e-3 * ratio
    assert list(fit.priors) == ["oil_gap"]
    assert value(fit, "oil_gap") == pytest.approx((5e-3, 0.05 * 5e-3), rel=1e-3)
    # The uncertainty that the prior leaves is honest about the truth.
    permittivity, spread = value(fit, "relative_permittivity")
    assert abs(permittivity - PERMITTIVITY) < 2 * spread
    assert not np.isfinite(fit.alone).any()


@pytest.mark.long  # programs for logs at rest; priors in test_sensor_formulas
def test_an_open_constant_has_the_tolerance_of_the_skin_file(
    truth: dict, tmp_path: Path
) -> None:
    rest = np.repeat(truth["so"][:, :1], 300, 1)
    log = write_log(tmp_path / "a.csv", rest)
    spec = load_skin(SKIN)
    for deviation, wanted in ((1e-4, 1e-4), (0.0, 1e-6 * spec.geometry.oil_gap)):
        gap = UncertainQuantity(spec.geometry.oil_gap, deviation)
        geometry = spec.geometry.model_copy(update={"oil_gap": gap})
        stated = spec.model_copy(update={"geometry": geometry})
        fit = fit_sensor(load_sensor_data(stated, [log]), model="shell")
        assert fit.priors["oil_gap"].sd == pytest.approx(wanted)
        assert value(fit, "oil_gap")[1] == pytest.approx(wanted, rel=1e-3)


@pytest.mark.long  # programs for two logs; fluids in test_sensor_formulas
def test_air_adds_the_gap(truth: dict, tmp_path: Path) -> None:
    rest = np.repeat(truth["so"][:, :1], 300, 1)
    oil = write_log(tmp_path / "oil.csv", rest)
    air = write_log(
        tmp_path / "air.csv", rest * AIR / PERMITTIVITY, seed=1, header="# fluid: air\n"
    )
    fit = fitted(oil, air, model="shell")
    for name, true in (("relative_permittivity", PERMITTIVITY), ("oil_gap", GAP)):
        found, error = value(fit, name)
        assert abs(found - true) < 4 * error
        assert error < 2e-3 * true
    assert not fit.priors
    tells = {row["logs"]: row["standard_errors"] for row in fit.contributions}
    assert tells["oil alone"] == {"relative_permittivity": None, "oil_gap": None}
    assert tells["known fluid alone"]["relative_permittivity"] is None
    assert tells["known fluid alone"]["oil_gap"] > 0


def test_faults_are_listed_and_do_not_bias(
    truth: dict, reference: SensorFit, tmp_path: Path
) -> None:
    def broken(counts: np.ndarray, random: np.random.Generator) -> np.ndarray:
        counts[3, 100:] = counts[3, 100]
        counts[5] = 65535
        counts[1, random.random(FRAMES) < 0.03] += 300
        return counts

    fit = fitted(
        write_log(tmp_path / "a.csv", truth["so"], known(truth, "displacement"), change=broken),
        like=reference,
    )
    reasons = {m.taxel: m.reason for m in fit.masked}
    assert reasons[4].startswith("stuck")
    assert reasons[6].startswith("saturated")
    assert reasons[2] == "outliers"
    assert set(reasons) == {2, 4, 6}
    for name, true in (("relative_permittivity", PERMITTIVITY), ("oil_gap", GAP)):
        found, error = value(fit, name)
        assert abs(found - true) < 4 * error
        assert error < 2e-3 * true


@pytest.mark.long  # `forward`; the formulas' tests leave frames out
def test_frames_whose_membrane_lies_on_the_wall_are_left_out(tmp_path: Path) -> None:
    """The shapes know no wall: what it holds reads otherwise at taxels away from it, too."""
    force = np.linspace(0.0, 90.0, 60)  # 38 N bring the membrane to the wall
    loads = Loads.line(np.full(60, np.pi / 4), force)
    output = jit(forward)(skin_of(load_skin(SKIN)), loads)
    so, gap = np.asarray(output.readings.so), np.asarray(output.min_gap)
    columns = {"load_0_force_N": force, "load_0_angle_deg": 45.0}
    log = write_log(tmp_path / "a.csv", np.nan_to_num(so, nan=65535.0), columns)
    fit = fitted(log, model="shell")
    for name, true in (("relative_permittivity", 2.2), ("oil_gap", 5e-3)):
        found, error = value(fit, name)
        assert abs(found - true) < 3 * error
    assert not fit.problem.readings.used[:, gap < 1e-4].any()


@pytest.mark.long  # programs with drift; test_drift
def test_drift_is_taken_out(truth: dict, reference: SensorFit, tmp_path: Path) -> None:
    """Loading and unloading, so that drift and load differ."""
    order = np.concatenate([np.arange(0, FRAMES, 2), np.arange(FRAMES - 1, 0, -2)])
    turned = {key: x[..., order] for key, x in truth.items()}
    rate = np.linspace(-1.0, 2.0, 8)[:, None]

    def drifting(counts: np.ndarray, random: np.random.Generator) -> np.ndarray:
        counts[1, 5::25] += 400
        return np.rint(counts + rate * np.arange(len(order)) / 50)

    log = write_log(
        tmp_path / "a.csv", turned["so"], known(turned, "displacement"), change=drifting
    )
    fit = fitted(log, like=reference)
    assert any("drift" in text for text in fit.warnings)
    assert fit.drift is not None
    assert fit.drift[:, 0] == pytest.approx(rate[:, 0], abs=0.2)
    # Outliers beside the drift don't take the taxel's other readings with them.
    assert 20 <= fit.outliers <= 22
    gap, error = value(fit, "oil_gap")
    assert abs(gap - GAP) < 4 * error
    assert error < 5e-3 * GAP


@pytest.mark.long  # a chain
def test_posterior_agrees_with_the_bound(reference: SensorFit) -> None:
    """Two well-known constants: the posterior is the Gaussian of the least squares."""
    from fitting.sensor.fit.sensor_posterior import sample_sensor
    from fitting.statistics.posterior import Settings

    _, report = sample_sensor(reference, Settings(walkers=16, steps=1000, check=250))
    for i, name in enumerate(reference.family.names):
        error = reference.uncertainty.standard_errors[i]
        assert report["mean"][name] == pytest.approx(reference.constants[i], abs=0.2 * error)
        assert report["standard_deviations"][name] == pytest.approx(error, rel=0.15)


@pytest.mark.long  # a gap for each taxel
def test_gaps_of_single_taxels(truth: dict, reference: SensorFit, tmp_path: Path) -> None:
    """Electrodes at different heights, and what a pair of log and skin file says of them."""
    data = load_sensor_data(
        load_skin(SKIN),
        [write_log(tmp_path / "a.csv", truth["so"], known(truth, "displacement"))],
    )
    # A plate's counts at a gap smaller by h: SO d / (d - h).
    gap = GAP * truth["so"][:, :1] / truth["so"]
    height = np.linspace(-0.2e-3, 0.2e-3, 8)[:, None]
    raised = dataclasses.replace(data, so=np.rint(data.so * gap / (gap - height)))
    # One gap for all does not follow these counts; under a steady ramp that is not a drift.
    shared = fit_sensor(raised, like=reference)
    assert shared.drift is None
    assert any("--gap taxel" in text for text in shared.warnings)
    fit = fit_sensor(raised, gaps="taxel", like=reference)
    single = np.array([value(fit, f"oil_gap.0.{k + 1}") for k in range(8)])
    assert np.all(np.abs(single[:, 0] - (GAP - height[:, 0])) < 5 * single[:, 1])
    assert np.all(single[:, 1] < 1e-2 * GAP)


def test_logs_of_another_skin_are_refused(
    truth: dict, reference: SensorFit, tmp_path: Path
) -> None:
    """Counts at other times than the known inputs, and counts of another scale."""
    columns = known(truth, "displacement")
    turned = write_log(tmp_path / "turned.csv", truth["so"][:, ::-1], columns)
    with pytest.raises(NoCalibration, match=r"turned.csv: .* not what this skin would read"):
        fitted(turned, like=reference)
    scaled = write_log(tmp_path / "scaled.csv", 10 * truth["so"], columns)
    with pytest.raises(NoCalibration, match=r"scaled.csv: .* 11 times the skin file's"):
        fitted(scaled, like=reference)


def test_columns_that_are_not_understood_are_named(truth: dict, tmp_path: Path) -> None:
    log = write_log(tmp_path / "a.csv", truth["so"][:, :30], {"weight_g": 5.0, "stuck": 0})
    (warning,) = load_sensor_data(load_skin(SKIN), [log]).warnings
    assert warning.endswith("not understood: weight_g")


@pytest.mark.long  # programs with a bound; bounds in test_sensor_formulas
def test_stray_capacitance_is_never_negative(
    truth: dict, reference: SensorFit, tmp_path: Path
) -> None:
    """Counts that ask for less stray than none: held at zero, said, and usable."""
    log = write_log(tmp_path / "a.csv", truth["so"] - 3.0, known(truth, "displacement"))
    fit = fitted(log, fit=["permittivity", "gap", "stray"], like=reference)
    assert fit.held == ("stray",)
    assert value(fit, "stray")[0] == 0.0
    assert any("stray stopped at zero" in text for text in fit.warnings)
    # The others are where they are without it, their errors know of it.
    alone = fitted(log, like=reference)
    for name in alone.family.names:
        assert value(fit, name)[0] == pytest.approx(value(alone, name)[0], rel=1e-4)
        assert value(fit, name)[1] > 1.2 * value(alone, name)[1]
    skin = tmp_path / "new.toml"
    skin.write_text(calibrated_skin(SKIN, fit))
    assert load_skin(skin).electrodes.stray == 0.0  # type: ignore[union-attr]


def test_command_writes_a_skin_that_can_be_solved(truth: dict, tmp_path: Path) -> None:
    log = write_log(tmp_path / "a.csv", truth["so"], known(truth, "displacement"))
    target, figure = tmp_path / "new.toml", tmp_path / "fit.png"
    result = runner.invoke(
        app,
        [
            "fit",
            "sensor",
            str(SKIN),
            str(log),
            "--json",
            "--model",
            "shell",
            "-o",
            str(target),
            "--plot",
            str(figure),
        ],
    )
    assert result.exit_code == 0, result.output
    report = json.loads(result.stdout)
    assert report["status"] == "converged"
    assert report["units"] == {"relative_permittivity": "1", "oil_gap": "m"}
    assert figure.stat().st_size > 10_000
    table = tomllib.loads(target.read_text())["calibration"]
    assert table["covariance"] == report["covariance"]
    assert table["logs"][0]["sha256"] == report["logs"][0]["sha256"]
    spec = load_skin(target)
    assert spec.geometry.oil_gap == pytest.approx(report["parameters"]["oil_gap"], rel=1e-9)
    assert not any(key.startswith("calibration") for key in continuous_inputs(spec))
    # It is a skin like any other.
    scene = tmp_path / "scene.toml"
    scene.write_text('skin = "new.toml"\n')
    solved = runner.invoke(app, ["solve", str(scene), "--json"])
    assert solved.exit_code == 0, solved.output
    rest = json.loads(solved.stdout)["taxels"][0]["so"]
    assert rest == pytest.approx(truth["so"][0, 0], rel=1e-3)
    # And it is not overwritten unasked.
    again = runner.invoke(app, ["fit", "sensor", str(SKIN), str(log), "-o", str(target)])
    assert again.exit_code == 2
    assert "exists" in again.output


def test_known_inputs_in_a_second_file(truth: dict, tmp_path: Path) -> None:
    log = write_log(tmp_path / "a.csv", truth["so"])
    time = np.arange(FRAMES) / 50
    rows = [f"{t},{1e3 * d},20" for t, d in zip(time, truth["displacement"], strict=True)]
    inputs = tmp_path / "press.csv"
    inputs.write_text(
        "t_s,loads.0.displacement_mm,loads.0.angle_deg\n" + "\n".join(rows) + "\n"
    )
    data = load_sensor_data(load_skin(SKIN), [log], inputs=[inputs])
    assert data.loads.displacement[0, data.state] == pytest.approx(truth["displacement"])
    assert data.files[0].inputs is not None
    late = tmp_path / "late.csv"
    late.write_text("t_s,load_0_force_N,load_0_angle_deg\n5000,1,20\n6000,2,20\n")
    with pytest.raises(ValueError, match="don't overlap"):
        load_sensor_data(load_skin(SKIN), [log], inputs=[late])


BAD: list[tuple[str, dict[str, Any], str]] = [
    ("layout", {"rows": 6}, "another layout"),
    ("saturated", {"change": lambda c, r: 0 * c + 65535}, "all 8 taxels are saturated"),
    ("empty", {"frames": 0}, "empty"),
    (
        "unit",
        {"columns": {"load_0_displacement_m": 1.5, "load_0_angle_deg": 20.0}},
        "check the unit",
    ),
    ("bare", {"columns": {"load_0_force": 1.5, "load_0_angle_deg": 20.0}}, "unit is missing"),
    ("angle", {"columns": {"load_0_force_N": 1.5}}, "load_0_angle_deg"),
    ("scale", {"header": "# scale: 2.88 fF\n", "own": True}, "units are mixed up"),
    ("fluid", {"columns": {"fluid": "water"}}, 'fluid "water"'),
    ("kilonewton", {"columns": {"load_0_force_kN": 9.0, "load_0_angle_deg": 20.0}}, "units"),
    ("micrometre", {"um": True}, "check"),
]


@pytest.mark.parametrize(
    ("name", "what", "message"),
    [
        # A press of kilonewtons is solved before it is refused, by a program of its own.
        pytest.param(*x, id=x[0], marks=pytest.mark.long if x[0] == "kilonewton" else ())
        for x in BAD
    ],
)
def test_bad_input_is_named_and_nothing_written(
    name: str, what: dict[str, Any], message: str, truth: dict, tmp_path: Path
) -> None:
    so = truth["so"][: what.get("rows", 8), :: 1 if what.get("um") else 10]
    so = so[:, : what.get("frames")]
    columns = what.get("columns")
    if what.get("um"):
        columns = {
            "load_0_displacement_um": 1e3 * truth["displacement"],
            "load_0_angle_deg": 20.0,
        }
    log = write_log(
        tmp_path / f"{name}.csv",
        so,
        columns,
        header=what.get("header", ""),
        change=what.get("change"),
    )
    if what.get("own"):
        log.write_text(log.read_text().replace("# scale: 0.305 fF\n", "", 1))
    target = tmp_path / "new.toml"
    result = runner.invoke(
        app, ["fit", "sensor", str(SKIN), str(log), "--model", "shell", "-o", str(target)]
    )
    assert result.exit_code == 2
    assert message in result.output.replace("\n", " ")
    assert str(log) in result.output.replace("\n", "")
    assert not target.exists()


# Another section: places by arc, a flat top, electrodes of a fine resolution.
FLAT_TOPPED = {
    "section": "path",
    "path": [{"line": "20 mm"}, {"radius": "30 mm", "angle": "90 deg"}, {"line": "27.5 mm"}],
    "mirror": True,
}
FINE = {
    "lsb": "0.003 fF",
    "taxels": [
        {"arc": f"{x} mm", "axial": "0 mm", "diameter": "4 mm"} for x in (-60, -25, 5, 20)
    ],
}
OIL = {"model": "incompressible", "relative_permittivity": 2.35}


def fine_log(path: Path, *given: Any) -> Path:
    """A log of those electrodes."""
    log = write_log(path, *given)
    log.write_text(log.read_text().replace("0.305 fF", "0.003 fF"))
    return log


@pytest.mark.long  # a section's programs; places by arc in test_health, calibrations above
def test_a_flat_topped_skin_is_calibrated_by_the_arc_of_its_loads(tmp_path: Path) -> None:
    """Against `suas solve`, whose mesh is another one."""
    forces, rows = np.array([0.0, 4.0, 8.0, 12.0]), []
    for force in forces[1:]:
        load = {"kind": "line", "arc": "12 mm", "force": f"{force} N"}
        spec = shaped(FLAT_TOPPED | {"oil_gap": "5.2 mm"}, load, electrodes=FINE, oil=OIL)
        report = solve(with_solve(spec, model="shell", elements=64)).report
        rows.append([taxel["so"] for taxel in report["taxels"]])
    rows.insert(0, [8.854187e-12 * 2.35 * np.pi * 4e-6 / 5.2e-3 / 3e-18] * 4)
    known = {"load_0_force_N": forces, "load_0_arc_mm": 12.0}
    log = fine_log(tmp_path / "a.csv", np.array(rows).T, known)
    skin = shaped(FLAT_TOPPED, electrodes=FINE, oil=OIL | {"relative_permittivity": 2.2})
    fit = fit_sensor(load_sensor_data(skin, [log]), model="shell")
    for name, true in (("relative_permittivity", 2.35), ("oil_gap", 5.2e-3)):
        assert value(fit, name)[0] == pytest.approx(true, rel=1e-3)


@pytest.mark.parametrize(
    ("columns", "text"),
    [
        ({"load_0_angle_deg": 5.0}, "load_0_arc_mm instead"),
        ({"load_0_arc_mm": 200.0}, "is beyond what the skin allows"),
        ({"load_0_arc_mm": 5.0, "load_0_angle_deg": 5.0}, "an angle and an arc"),
        ({}, "no angle and no arc"),
    ],
)
def test_places_of_known_loads_that_a_section_can_t_have(
    columns: dict[str, float], text: str, tmp_path: Path
) -> None:
    skin = shaped(FLAT_TOPPED, electrodes=FINE, oil=OIL)
    known = {"load_0_force_N": 1.0} | columns
    log = fine_log(tmp_path / "a.csv", np.full((4, 3), 900.0), known)
    with pytest.raises(ValueError, match=text):
        load_sensor_data(skin, [log])


def test_a_gap_that_is_a_table_is_no_one_constant(tmp_path: Path) -> None:
    table = {"arc": [0, 0.5, 1], "value": ["5 mm", "4 mm", "5 mm"]}
    skin = shaped(FLAT_TOPPED | {"oil_gap": table}, electrodes=FINE, oil=OIL)
    log = fine_log(tmp_path / "a.csv", np.full((4, 3), 900.0))
    with pytest.raises(ValueError, match=r"--fit oil_gap: geometry.oil_gap is a table"):
        fit_sensor(load_sensor_data(skin, [log]), model="shell")


@pytest.mark.long  # derivatives by the gap of the shapes
def test_a_gap_moves_a_membrane_whose_oil_is_a_share_more_than_its_film(tmp_path: Path) -> None:
    """1 % more of the film's volume is more oil under a wider gap, and a stiffer skin."""
    plain = load_skin(SKIN)
    skin = plain.model_copy(
        update={"oil": plain.oil.model_copy(update={"fill": 1.01})}  # kept, not fitted
    )
    angle, force = np.deg2rad([-50, -20, 0, 5, 20, 50]), np.array([0.0, 6, 10, 5, 9, 12])
    true = skin_of(skin, {"geometry.oil_gap": 5.4e-3}, contact=False)
    so = np.asarray(forward(true, Loads.line(angle, force)).so)
    columns = {
        "load_0_angle_deg": np.repeat(np.rad2deg(angle), 20),
        "load_0_force_N": np.repeat(force, 20),
    }
    log = write_log(tmp_path / "presses.csv", np.repeat(so, 20, 1), columns)
    fit = fit_sensor(load_sensor_data(skin, [log]), model="shell")
    found, error = value(fit, "oil_gap")
    assert error < 1.5e-5
    assert abs(found - 5.4e-3) < 3.5 * error


@pytest.mark.long  # derivatives by prestress; those of scenes in test_prestress
def test_ten_presses_find_filling_and_mounting(tmp_path: Path) -> None:
    """Both move forces and no baseline; the derivatives by each are told apart."""
    plain = load_skin(SKIN)
    true = {FILL: 0.997, MOUNTING: -2e-4}
    spec = naming(plain, true)
    paths = {PATHS[name]: value for name, value in true.items()}
    angle = np.deg2rad([-50, -35, -20, -10, 0, 5, 10, 20, 35, 50])
    force = np.array([0.0, 4, 6, 8, 10, 5, 7, 9, 6, 12])
    loads = Loads.line(angle, force)
    so = np.asarray(forward(skin_of(spec, paths, contact=False), loads).so)
    held = 8  # frames of each
    columns = {
        "load_0_angle_deg": np.repeat(np.rad2deg(angle), held),
        "load_0_force_N": np.repeat(force, held),
    }
    log = write_log(tmp_path / "presses.csv", np.repeat(so, held, 1), columns)
    fit = fitted(log, fit=("permittivity", "gap", FILL, MOUNTING), model="shell")
    for name, wanted in true.items():
        found, error = value(fit, name)
        assert abs(found - wanted) < 3.5 * error, name
        assert error < {FILL: 1e-3, MOUNTING: 1e-4}[name]
    text = tomllib.loads(calibrated_skin(SKIN, fit))
    assert text["oil"]["fill"] == pytest.approx(0.997, abs=2e-3)
    assert text["geometry"]["mounting"].endswith(" %")
    errors = input_errors(as_assembled(_written(tmp_path, calibrated_skin(SKIN, fit))))
    assert not {"oil.fill", "geometry.mounting"} & set(errors.names)  # the covariance has them
    assert not errors.assumed  # the presses tell the stiffness, whatever makes it so
    with pytest.raises(ValueError, match="no filling"):
        naming(plain.model_copy(update={"oil": VentedOilSpec(model="vented")}), [FILL])


def _written(folder: Path, text: str) -> SkinSpec:
    path = folder / "calibrated.toml"
    path.write_text(text)
    return load_skin(path)
