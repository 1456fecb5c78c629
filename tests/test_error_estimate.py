"""The stated error, its parts, and the model that `auto` chooses by it."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jaxtyping import Array

from benchmarks.error_estimate import true_error
from suas_jax.config import SceneSpec, continuous_inputs, with_solve
from suas_jax.equilibrium.balance import State
from suas_jax.mechanics.model import AbstractPlan
from suas_jax.scene.build import Structure, problem_of
from suas_jax.scene.gradient import gradient, gradient_error_estimate
from suas_jax.scene.observables import observe
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.program import inputs_of
from suas_jax.scene.report import plain
from suas_jax.scene.solve import solve
from suas_jax.scene.sweep import sweep
from tests.skins import line, quick, scene

# Light load on a thick and on a thin skin of the same structure: one compiled program.
SCENES: dict[str, SceneSpec] = {
    "case B": scene(line(45, 20.669)),
    "light": scene(line(20, 1.0)),
    "thick": scene(line(-35, 10.0), thickness=0.004),
    "thin": scene(line(60, 3.0), thickness=0.0005),
    "tight": scene(line(60, 20.64), inner_radius=0.04),
}


# Of 128 x 4 elements; a long test solves them again.
TRUTHS: dict[str, dict[str, Any]] = json.loads(
    (Path(__file__).parent / "data/fine_meshes.json").read_text()
)["solid"]


def test_numbers_of_reports_have_no_negative_zero() -> None:
    """Of a body off the skin the force is the sum of none, its sign changed."""
    told = plain({"force_N": np.array([-0.0]), "counts": np.array([0]), "name": "-0"})
    assert str(told) == "{'counts': 0, 'force_N': 0.0, 'name': '-0'}"


@pytest.mark.long  # a fine solid
@pytest.mark.parametrize("name", SCENES)
def test_the_truths_are_those_of_a_fine_mesh(name: str) -> None:
    found = solve(with_solve(SCENES[name], model="solid", mesh=(128, 4))).report
    assert true_error(TRUTHS[name], found) < 1e-8


@pytest.fixture(scope="module")
def shells() -> dict[str, dict[str, Any]]:
    coarse = {"model": "shell", "elements": 16}  # as other files solve such scenes
    return {name: solve(with_solve(spec, **coarse)).report for name, spec in SCENES.items()}


@pytest.mark.parametrize("name", SCENES)
def test_the_stated_error_of_the_shell_is_above_the_true_one_and_near(
    name: str, shells: dict[str, Any]
) -> None:
    true = true_error(shells[name], TRUTHS[name])
    assert true < shells[name]["error_estimate"] < 20 * true


def test_a_pressure_that_trapped_oil_takes_over_has_no_relative_error_of_nothing() -> None:
    pressed = scene({"kind": "pressure", "pressure": "1 kPa"})
    report = solve(with_solve(pressed, model="shell", elements=16)).report
    assert report["max_displacement_m"] < 1e-15
    assert report["oil_pressure_Pa"] == pytest.approx(1e3, rel=1e-12)
    assert report["error_estimate"] < 1e-3


@pytest.mark.long  # two more meshes of another scene
def test_the_stated_error_under_a_pressure_alone_is_above_the_true_one_and_near() -> None:
    # On few elements most of it is that of the correction's effect on the largest displacement.
    pressed = scene(
        {"kind": "pressure", "pressure": "1 kPa"}, oil={"model": "vented"}, thickness=0.0025
    )
    few, many = (solve(with_solve(pressed, model="shell", elements=n)).report for n in (16, 64))
    true = abs(few["max_displacement_m"] / many["max_displacement_m"] - 1)
    assert true < few["discretisation_error"] < 10 * true


@pytest.mark.long  # derivatives on two meshes, and their errors
@pytest.mark.parametrize("path", ["loads.0.displacement_m", "oil_pressure_Pa"])
@pytest.mark.parametrize("name", ["case B", "light", "thick"])
def test_the_stated_error_of_a_gradient_is_above_the_true_one_and_near(
    name: str, path: str
) -> None:
    """On a coarse mesh, whose error is that of the mesh."""
    spec = SCENES[name]
    inputs = continuous_inputs(spec)
    coarse, fine = (
        solve(with_solve(spec, model="shell", elements=count)) for count in (16, 64)
    )
    there, here = (gradient(solution, path) for solution in (fine, coarse))
    effect, error = (
        np.linalg.norm([values[k] * inputs[k] for k in inputs])
        for values in (there, {k: here[k] - there[k] for k in inputs})
    )
    stated = gradient_error_estimate(coarse, path)
    assert stated is not None
    assert error < stated * effect < 10 * error


@pytest.mark.long  # two more meshes
def test_the_model_error_does_not_depend_on_the_mesh() -> None:
    coarse, fine = (
        solve(with_solve(SCENES["case B"], model="shell", elements=count)).report
        for count in (32, 64)
    )
    assert coarse["model_error"] == pytest.approx(fine["model_error"], rel=0.25)
    # Of fourth order the equilibrium, of first the correction.
    assert coarse["discretisation_error"] > 2 * fine["discretisation_error"]
    for report in (coarse, fine):
        parts = report["discretisation_error"] + report["model_error"]
        assert report["error_estimate"] == pytest.approx(parts)


def test_a_thinner_membrane_is_more_of_a_shell(shells: dict[str, Any]) -> None:
    order = [shells[name]["model_error"] for name in ("thin", "case B", "thick")]
    assert order == sorted(order)


@pytest.mark.long  # every mesh on the way
def test_a_thousandth_takes_the_shell() -> None:
    report = solve(with_solve(SCENES["case B"], model="auto", rtol=1e-3)).report
    assert report["model"] == "shell"
    assert report["rtol_met"]
    assert "shell chosen" in report["message"]
    assert true_error(report, TRUTHS["case B"]) < 1e-3


@pytest.mark.long  # every mesh of both models on the way
def test_a_tight_tolerance_takes_the_solid_and_says_why() -> None:
    report = solve(with_solve(SCENES["case B"], model="auto", rtol=1e-4)).report
    assert report["model"] == "solid"
    assert report["rtol_met"]
    assert report["model_error"] == 0
    assert "Solid chosen" in report["message"]
    assert "leaves the mesh too little of rtol 1.0e-04" in report["message"]
    assert true_error(report, TRUTHS["case B"]) < 1e-4


def test_a_forced_shell_admits_that_it_misses_the_tolerance() -> None:
    coarse = {"model": "shell", "elements": 16}
    report = solve(with_solve(SCENES["case B"], rtol=1e-4, **coarse)).report
    assert report["model"] == "shell"
    assert report["status"] == "converged"
    assert not report["rtol_met"]
    assert "exceeds rtol" in report["message"]


@pytest.mark.long  # a curve of the shell on two meshes or more
def test_a_curve_meets_a_tolerance_close_to_the_shell_s_own_error() -> None:
    spec = SCENES["thick"]
    coarse = sweep(with_solve(spec, model="shell", rtol=0.5), forces=[10.0]).points[0]
    rtol = (coarse["model_error"] + coarse["error_estimate"]) / 2
    assert coarse["model_error"] < rtol < coarse["error_estimate"]
    assert sweep(with_solve(spec, model="auto", rtol=rtol), forces=[10.0]).points[0]["rtol_met"]


def test_no_load_has_no_error() -> None:
    report = solve(scene(line(45, 0))).report
    assert report["error_estimate"] == 0
    assert np.all([load["displacement_m"] == 0 for load in report["loads"]])


@quick
def observed(
    structure: Structure, plan: AbstractPlan, inputs: dict[str, Array], state: State
) -> dict[str, Any]:
    """What is observed of a state without any correction."""
    parts = scene_parts(structure.scene, inputs)
    return observe(parts, problem_of(parts, plan), state)


@pytest.mark.long  # a program for the lumped state; its error is stated above
@pytest.mark.parametrize("name", SCENES)
def test_the_correction_takes_most_of_the_shell_s_error_away(name: str) -> None:
    spec = with_solve(SCENES[name], model="shell", elements=64)
    solution = solve(spec)
    lumped = plain(observed(Structure(spec), solution.plan, inputs_of(spec), solution.state))
    before = true_error(lumped, TRUTHS[name])
    assert true_error(solution.report, TRUTHS[name]) < max(before / 3, 3e-4)
    for key in ("displacement_m", "inner_displacement_m"):
        reports = (lumped, solution.report, TRUTHS[name])
        raw, better, true = (report["loads"][0][key] for report in reports)
        assert abs(better - true) < max(abs(raw - true) / 2, 3e-4 * abs(true))
