"""A solved scene: its error estimate, its mesh, and what it does not pay for."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jaxtyping import Array

from suas_jax.config import SceneSpec, with_inputs, with_solve
from suas_jax.equilibrium.balance import Problem, State
from suas_jax.mechanics.model import Counts
from suas_jax.scene.gradient import UnknownQuantityError, gradient
from suas_jax.scene.report import _on_wall
from suas_jax.scene.report_keys import require_reported
from suas_jax.scene.solve import solve
from suas_jax.scene.sweep import sweep
from tests.skins import LAWS, WIDTH, compilations, line, program_text, scene

SCENES: dict[str, SceneSpec] = {
    "case A": scene(line(0, 24.4)),
    "case B": scene(line(45, 20.7)),
    "soft, thick, spread": scene(
        line(-25, 2, spread="8 mm"),
        material={"law": "neo-hookean", "mu": "1 MPa"},
        thickness=0.003,
    ),
}


# Of 192 elements; a long test solves them again.
TRUTHS = json.loads((Path(__file__).parent / "data/fine_meshes.json").read_text())["shell"]
# A line load on an arc without symmetry is what other files solve, too: one program for all.
names = pytest.mark.parametrize(
    "name", [x if x == "case B" else pytest.param(x, marks=pytest.mark.long) for x in SCENES]
)


def largest_error(report: dict[str, Any], truth: dict[str, Any]) -> float:
    """Relative error of what the estimate speaks of."""
    size = max(abs(load["displacement_m"]) for load in truth["loads"])
    errors = [abs(report["oil_pressure_Pa"] / truth["oil_pressure_Pa"] - 1)]
    for load, true in zip(report["loads"], truth["loads"], strict=True):
        errors.append(abs(load["displacement_m"] - true["displacement_m"]) / size)
    return max(errors)


@pytest.mark.long  # fine meshes
@pytest.mark.parametrize("name", SCENES)
def test_the_truths_are_those_of_a_fine_mesh(name: str) -> None:
    found = solve(with_solve(SCENES[name], elements=192)).report
    assert largest_error(TRUTHS[name], found) < 1e-8


@names
def test_discretisation_error_is_above_the_true_one_and_near(name: str) -> None:
    truth = TRUTHS[name]
    report = solve(with_solve(SCENES[name], elements=16)).report
    true = largest_error(report, truth)
    assert true < report["discretisation_error"] < 6 * true


def test_another_value_compiles_nothing() -> None:
    """The shear modulus had a program of its own in every solve, four times as long as that."""
    spec = with_solve(SCENES["case B"], elements=16)
    solve(spec)
    with compilations() as compiled:
        lighter = solve(with_inputs(spec, {"load.0.force": 19.0}))
    assert lighter.converged
    assert not compiled


@pytest.mark.long  # half an arc; the whole one above
def test_sixteen_elements_a_half_arc_are_within_a_thousandth() -> None:
    report = solve(with_solve(SCENES["case A"], elements=32)).report
    assert largest_error(report, TRUTHS["case A"]) < 1e-3


@pytest.mark.long  # every mesh on the way
def test_the_mesh_is_refined_until_rtol_is_met() -> None:
    report = solve(with_solve(SCENES["case A"], model="shell", rtol=3e-5)).report
    assert report["discretisation_error"] < 3e-5
    assert largest_error(report, TRUTHS["case A"]) < 3e-5


def test_a_forced_mesh_that_misses_rtol_says_so() -> None:
    report = solve(with_solve(SCENES["case B"], elements=16, rtol=1e-6)).report
    assert report["status"] == "converged"
    assert not report["rtol_met"]


def test_what_a_scene_does_not_need_is_not_solved() -> None:
    trapped = solve(with_solve(SCENES["case B"], elements=16)).report
    assert trapped["unknowns"] == 15 * 4 + 2 + 1  # stations, stretch at the clamps, pressure
    nothing = solve(scene(line(45, 0))).report
    assert (nothing["unknowns"], nothing["iterations"]) == (0, 0)
    assert nothing["max_displacement_m"] < 1e-15  # rounding of the reference place


@pytest.mark.long  # half an arc is a program of its own
def test_half_of_a_symmetric_scene_is_solved() -> None:
    half = solve(with_solve(SCENES["case A"], elements=16)).report
    assert half["unknowns"] == 7 * 4 + 1 + 2 + 1  # the crown keeps y and the stretch


@pytest.mark.long  # vented oil under a pressure is a program of its own
def test_a_path_that_ends_shows_its_last_state_and_where_stability_ended() -> None:
    """Where a path ends the effect of shear has no bound. The arch buckles at 8 D / R^3."""
    pressed = scene({"kind": "pressure", "pressure": "1 MPa"}, oil={"model": "vented"})
    found = solve(with_solve(pressed, model="shell", elements=16)).report
    assert found["status"] in ("limit_point", "no_convergence")
    assert found["max_displacement_m"] < 0.006  # the film's thickness
    stiffness, radius = 4 * 32.6e6 * 0.0015**3 / 12, 0.05825
    assert 1e6 * found["stable_factor"] == pytest.approx(8 * stiffness / radius**3, rel=0.05)
    assert "The equilibrium is unstable from 0.1" in found["message"]


@pytest.mark.long  # vented oil is a program of its own
def test_a_vented_scene_has_no_pressure_to_find() -> None:
    vented = scene(line(45, 2), oil={"model": "vented"})
    assert solve(with_solve(vented, elements=16)).report["unknowns"] == 15 * 4 + 2


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("oil_presure_Pa", 'did you mean "oil_pressure_Pa"'),
        ("loads.0.displacment_m", 'did you mean "loads.0.displacement_m"'),
        ("loads.1.displacement_m", "loads.0.displacement_m"),  # there is one load
        ("loads.displacement_m", "loads.0.displacement_m"),
        ("taxels.-1.so", "taxels.0.so"),
        ("nonsense", "use one of .*oil_pressure_Pa"),
        ("", "use one of"),
    ],
)
def test_quantities_that_no_report_has_are_refused_before_the_solve(
    path: str, words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        require_reported(path, 1)


def test_quantities_of_reports_are_known_before_the_solve() -> None:
    for path in ("oil_pressure_Pa", "wall.force_N", "loads.0.depth_m", "taxels.319.so"):
        require_reported(path, 1)


@pytest.mark.parametrize(
    ("force", "unsure", "words"),
    [
        (0.0, 4e-3, r"at first contact .* from nothing to 0\.004 N"),
        (2e-3, 4e-3, r"at first contact .* from nothing to 0\.006 N"),
        (1e-2, 4e-3, r"lies on the wall, which carries 0\.01 N to 0\.004 N\."),
        (1e-2, None, r"lies on the wall, which carries 0\.01 N\."),
    ],
)
def test_what_is_said_of_the_wall(force: float, unsure: float | None, words: str) -> None:
    assert re.search(words, _on_wall(force, unsure))


@pytest.mark.long  # as long to trace as to solve
def test_only_quantities_of_the_report_can_be_differentiated() -> None:
    solution = solve(with_solve(SCENES["case B"], elements=16))
    with pytest.raises(UnknownQuantityError, match="oil_pressure_Pa"):
        gradient(solution, "status")


@pytest.mark.long  # two scenes of their own; test_equilibrium
@pytest.mark.parametrize("law", ["mooney-rivlin", "ogden"])
def test_pressure_under_no_load_but_external_is_that_pressure(law: str) -> None:
    uniform = {"kind": "pressure", "pressure": "800 Pa"}
    report = solve(with_solve(scene(uniform, material=LAWS[law]), elements=16)).report
    assert report["oil_pressure_Pa"] == pytest.approx(800, rel=1e-9)
    assert report["max_displacement_m"] < 1e-12


@pytest.mark.long  # as long to trace as to solve; equilibria in test_equilibrium
@pytest.mark.parametrize("case", [("shell", (8,)), ("solid", (8, 2))])
def test_programs_call_no_library_that_waits_for_threads(case: tuple[str, Counts]) -> None:
    assert "lapack" not in program_text(scene(line(20, 5.0)), *case)


def pressure_and_energy(problem: Problem, state: State, shown: State) -> tuple[Array, Array]:
    """Of the oil [Pa], and strain energy per width [J/m]."""
    return shown.pressure, problem.mechanics.around(state.q).stored_energy(shown.q)


def test_a_function_of_one_s_own_reads_what_the_report_says() -> None:
    solution = solve(with_solve(SCENES["case B"], elements=16))
    pressure, energy = solution.read(pressure_and_energy)
    assert pressure[0] == pytest.approx(solution.report["oil_pressure_Pa"], rel=1e-12)
    assert energy[0] * WIDTH == pytest.approx(solution.report["strain_energy_J"], rel=1e-9)


@pytest.mark.long  # the program of a curve; a sweep in test_cli
def test_a_curve_of_several_blocks_ends_at_the_single_solve() -> None:
    """The mesh of a curve is that of its largest load."""
    spec = with_solve(SCENES["case B"], elements=16)
    points = sweep(spec, forces=np.linspace(1.0, 20.7, 10).tolist()).points
    alone = solve(spec).report
    for key in ("oil_pressure_Pa", "max_displacement_m", "error_estimate"):
        assert points[-1][key] == pytest.approx(alone[key], rel=1e-6)
