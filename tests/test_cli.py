"""`suas solve` and `suas sweep` as a program and as a person meet them."""

import csv
import json
import math
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from fitting.cli.app import app
from fitting.cli.solve import _print_report, _wall, place_text
from fitting.cli.sweep import _print_curve
from fitting.json_text import json_text
from suas_jax.config import load_scene
from suas_jax.scene import report_keys
from suas_jax.scene.report_keys import REPORT_KEYS
from suas_jax.scene.sweep import _COLUMNS, Sweep

SCENES = Path(__file__).parent.parent / "configs" / "scenes"
CASE_A, CASE_B = str(SCENES / "case_a.toml"), str(SCENES / "case_b.toml")
KEYS = {
    "model": str,
    "status": str,
    "message": str,
    "rtol_met": bool,
    "loads": list,
    "oil_pressure_Pa": float,
    "max_displacement_m": float,
    "min_gap_m": float,
    "min_gap_angle_deg": float,
    "wall_contact": bool,
    "strain_energy_J": float,
    "stretch_min": float,
    "stretch_max": float,
    "stable": bool,
    "material_stable": bool,
    "volume_residual": float,
    "error_estimate": float,
    "discretisation_error": float,
    "model_error": float,
    "iterations": int,
    "unknowns": int,
    "taxels": list,
    "timings_s": dict,
}
LOAD_KEYS = {"angle_deg", "arc_position_m", "force_N", "displacement_m", "inner_displacement_m"}


def suas(*arguments: str, status: int = 0) -> Any:
    """Run the command line in this process."""
    result = CliRunner().invoke(app, list(arguments))
    assert result.exit_code == status, result.output
    return result


@pytest.fixture(scope="module")
def case_b() -> dict[str, Any]:
    return json.loads(suas("solve", CASE_B, "--json").stdout)


@pytest.fixture(scope="module")
def by_gap() -> dict[str, float]:
    """Derivatives of the smallest gap."""
    found = json.loads(suas("solve", CASE_B, "--json", "--gradient", "min_gap_m").stdout)
    gradient: dict[str, float] = found["gradient"]
    return gradient


def test_json_has_the_contract_s_keys(case_b: dict[str, Any]) -> None:
    assert {key: type(case_b[key]) for key in KEYS} == KEYS
    assert list(case_b) == [key for key in REPORT_KEYS if key in case_b]
    assert set(case_b["loads"][0]) >= LOAD_KEYS
    assert set(case_b["loads"][0]) <= set(report_keys.LOAD_KEYS)
    assert set(case_b["taxels"][0]) == set(report_keys.TAXEL_KEYS) - {"arc_m"}
    assert set(case_b["timings_s"]) == {"compile", "solve"}
    assert case_b["status"] == "converged"
    assert case_b["rtol_met"]
    assert case_b["error_estimate"] <= 1e-3


def test_json_has_one_zero_and_no_infinity() -> None:
    tree = {"force_N": -0.0, "points": [-0.0, math.nan, -math.inf, -1e-300], "n": 0}
    told = '{"force_N": 0.0, "points": [0.0, null, null, -1e-300], "n": 0}'
    assert json_text(tree) == told


def test_case_b_is_the_paper_s(case_b: dict[str, Any]) -> None:
    load = case_b["loads"][0]
    assert load["force_N"] == pytest.approx(20.7, rel=3e-3)
    assert load["angle_deg"] == pytest.approx(45)
    assert load["arc_position_m"] == pytest.approx(math.radians(45) * 59e-3)
    assert case_b["oil_pressure_Pa"] == pytest.approx(10e3, rel=1e-12)
    assert abs(case_b["volume_residual"]) < 1e-10


@pytest.mark.long  # the program of derivatives; README's code runs one
def test_gradient_names_every_input_of_the_file(by_gap: dict[str, float]) -> None:
    wanted = {"geometry.thickness", "material.C1", "load.0.angle", "solve.oil_pressure"}
    assert wanted <= set(by_gap)
    # The gap shrinks as the wanted pressure grows.
    assert by_gap["solve.oil_pressure"] < 0


@pytest.mark.long  # the program of derivatives; test_gradients
def test_gradient_is_the_difference_of_two_solves(
    by_gap: dict[str, float], tmp_path: Path
) -> None:
    gaps = []
    for angle in (44.9, 45.1):
        scene = (SCENES / "case_b.toml").read_text(encoding="utf-8")
        scene = scene.replace('"45 deg"', f'"{angle} deg"')
        scene = scene.replace("../skins", str(SCENES.parent / "skins"))
        path = tmp_path / f"{angle}.toml"
        path.write_text(scene, encoding="utf-8")
        gaps.append(json.loads(suas("solve", str(path), "--json").stdout)["min_gap_m"])
    slope = (gaps[1] - gaps[0]) / math.radians(0.2)
    assert by_gap["load.0.angle"] == pytest.approx(slope, rel=1e-4)


def test_places_are_told_as_the_section_tells_them() -> None:
    """On a straight piece of a path one angle is many places."""
    row = {"bulge_angle_deg": 90.0, "bulge_arc_m": -31.1234e-3}
    assert place_text(row, "bulge_", 3, by_arc=True) == "-31.1 mm along the arc"
    assert place_text(row, "bulge_", 3, by_arc=False) == "90 deg"
    wall = {
        "angle_deg": [-1e-12, 4.0],
        "arc_m": [-2e-3, 2e-3],
        "force_N": 1.5,
        "force_error_N": 0.1,
    }
    assert _wall(wall, by_arc=True) == "carries 1.5 N to 0.1 N, from -2 to 2 mm along the arc"
    assert _wall(wall, by_arc=False) == "carries 1.5 N to 0.1 N, from 0 to 4 deg"


def test_numbers_of_a_state_that_means_nothing_are_not_shown(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Neither of a scene, whose rows it need not have, nor in the row of a curve."""
    lost = {"status": "body_on_clamp", "model": "shell", "message": "It reaches a clamp."}
    _print_report(lost, load_scene(CASE_A))
    said = " ".join(capsys.readouterr().out.split())
    assert said == "body_on_clamp (shell) It reaches a clamp."
    point = dict.fromkeys(_COLUMNS, -1.8e5) | {"stable": True, "status": "body_on_clamp"}
    point |= {"loads": [{"kind": "line", "force_N": -1.8e5}], "wall": None}
    curve = Sweep([point], None, load_scene(CASE_A))
    _print_curve(curve)
    shown = capsys.readouterr().out
    assert "body_on_clamp" in shown
    assert "e+" not in shown


def test_a_curve_s_table_says_how_far_a_body_is_in(capsys: pytest.CaptureFixture[str]) -> None:
    """Which is another length than how far the skin has moved."""
    point = dict.fromkeys(_COLUMNS, 1.0) | {"stable": True, "status": "converged"}
    point |= {"loads": [{"kind": "body", "force_N": 5.0, "depth_m": 2.5e-3}], "wall": None}
    _print_curve(Sweep([point], None, load_scene(CASE_A)))
    shown = capsys.readouterr().out
    assert "travel [mm]" in shown
    assert " 2.5 " in shown


@pytest.mark.long  # half an arc is a program of its own; unknowns in test_shell
def test_symmetric_scene_solves_half_the_arc() -> None:
    symmetric = json.loads(suas("solve", CASE_A, "--json").stdout)
    assert symmetric["loads"][0]["force_N"] == pytest.approx(24.4, rel=3e-3)
    assert symmetric["stable"]
    assert symmetric["unknowns"] < 20 * 4


def test_table_for_a_person_has_units() -> None:
    shown = suas("solve", CASE_B).stdout
    assert all(text in shown for text in ("N at 45 deg", "mm", "kPa", "mJ", "stable"))


@pytest.mark.long  # the program of derivatives
def test_gradient_for_a_person_is_sorted_and_without_zeros() -> None:
    shown = suas("solve", CASE_B, "--gradient", "min_gap_m").stdout
    rows = [line.split("│")[1:4] for line in shown.splitlines() if line.startswith("│")]
    effects = [abs(float(effect)) for _, _, effect in rows]
    names = [name.strip() for name, _, _ in rows]
    assert effects == sorted(effects, reverse=True)
    assert all(effects)
    assert {"geometry.oil_gap", "material.C1"} <= set(names)
    assert not [name for name in names if name.startswith("electrodes")]  # act on no gap
    assert "other inputs have no effect" in shown


def test_sweep_writes_what_it_prints(tmp_path: Path) -> None:
    curve, figure = tmp_path / "curve.csv", tmp_path / "curve.svg"
    options = ("--json", "--csv", str(curve), "--plot", str(figure))
    result = suas("sweep", CASE_B, "--force", "0:30:4", *options)
    printed = json.loads(result.stdout)
    assert figure.read_text(encoding="utf-8").lstrip().startswith("<?xml")
    with curve.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["force_N"]) for row in rows] == pytest.approx([0, 10, 20, 30])
    for row, point in zip(rows, printed["points"], strict=True):
        assert float(row["oil_pressure_Pa"]) == point["oil_pressure_Pa"]
    assert printed["first_contact"] is None
    assert not any(point["wall_contact"] for point in printed["points"])
    assert printed["points"][0]["max_displacement_m"] < 1e-15


@pytest.mark.long  # curves with the wall are programs of their own; test_contact
@pytest.mark.parametrize(
    ("scene", "forces", "first"), [(CASE_A, "0:90:10", 82.8), (CASE_B, "0:40:5", 38.1)]
)
def test_first_contact_of_a_sweep(scene: str, forces: str, first: float) -> None:
    printed = json.loads(suas("sweep", scene, "--force", forces, "--json").stdout)
    assert printed["first_contact"]["force_N"] == pytest.approx(first, rel=0.01)
    touching = [point["wall_contact"] for point in printed["points"]]
    assert touching == [point["loads"][0]["force_N"] > first for point in printed["points"]]


@pytest.mark.long  # vented oil is a program of its own; limit point in test_equilibrium
def test_vented_collapse_is_a_named_failure_with_a_state(tmp_path: Path) -> None:
    scene = (SCENES / "vented.toml").read_text(encoding="utf-8")
    path = tmp_path / "collapse.toml"
    scene = scene.replace('"10 N"', '"20 N"').replace("../skins", str(SCENES.parent / "skins"))
    scene += "\n[wall]\ncontact = false\n"
    path.write_text(scene, encoding="utf-8")
    report = json.loads(suas("solve", str(path), "--json", status=3).stdout)
    assert report["status"] == "limit_point"
    assert 13.5 < report["loads"][0]["force_N"] < 14.0
    assert math.isfinite(report["max_displacement_m"])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("solve", "nowhere.toml"), ("nowhere.toml",)),
        (("solve", CASE_A, "--rtol", "-1"), ("--rtol", "-1")),
        (("solve", CASE_A, "--model", "beam"), ("--model", "beam", "shell")),
        (("solve", CASE_A, "--plot", "figure.xyz"), ("figure.xyz", "png")),
        (("solve", CASE_A, "--plot", "no/such/figure.png"), ("no/such",)),
        pytest.param(
            ("solve", CASE_B, "--gradient", "oil_presure_Pa"),
            ('mean "oil_pressure_Pa"',),
            marks=pytest.mark.long,
        ),
        (("sweep", CASE_A), ("--force", "--oil-pressure")),
        (("sweep", CASE_A, "--force", "0:30"), ("0:30", "FROM:TO:COUNT")),
        (("sweep", CASE_A, "--force", "0:30:0"), ("0:30:0", "FROM:TO:COUNT")),
        (("sweep", CASE_A, "--force", "nan:30:3"), ("--force", "finite")),
        (("sweep", CASE_A, "--force", "-5:5:3"), ("--force", "sign")),
        (("sweep", CASE_A, "--oil-pressure", "-5:10:4"), ("one sign", "got [-5.")),
    ],
)
def test_mistakes_are_answered(arguments: tuple[str, ...], words: tuple[str, ...]) -> None:
    result = suas(*arguments, status=2)
    assert result.stdout == ""
    assert all(word in result.stderr for word in words), result.stderr
    assert "Traceback" not in result.stderr


def test_version() -> None:
    assert suas("--version").stdout.startswith("suas_jax 0.")
