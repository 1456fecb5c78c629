"""Scenes on sections other than circles: an independent reference, derivatives."""

from typing import Any

import jax.numpy as jnp
import pytest
from skins import reference_rows, shaped

from suas_jax.config import ConfigError, SceneSpec, continuous_inputs, with_inputs, with_solve
from suas_jax.equilibrium.balance import Problem, State
from suas_jax.mesh.section import measures
from suas_jax.scene.gradient import gradient
from suas_jax.scene.program import inputs_of
from suas_jax.scene.solve import solve
from suas_jax.scene.sway import shifted
from suas_jax.skin.loads import LineLoad

ROWS = [r for r in reference_rows("profile2d.csv") if r["section"] == "a_ellipse_b40"]
ELLIPSE = {
    "section": "ellipse",
    "inner_semi_axes": ["57.5 mm", "40 mm"],
    "half_angle": "90 deg",
}


def at_arc(arc: float, force: float) -> dict[str, Any]:
    """A line load; arc in metres, force in newtons."""
    return {"kind": "line", "arc": f"{arc!r} m", "force": f"{force} N"}


def compared(row: dict[str, str], **solve_table: Any) -> dict[str, float]:
    """Relative errors of what a row of the reference tells."""
    spec = shaped(
        ELLIPSE,
        at_arc(float(row["load_arc_from_crown_m"]), 1.0),
        wall={"contact": False},
        solve={"oil_pressure": f"{row['oil_pressure_Pa']} Pa"},
    )
    report = solve(with_solve(spec, **solve_table)).report
    assert report["status"] == "converged"
    under = report["loads"][0]
    pairs = {
        "force_N": under["force_N"],
        "inner_displacement_along_load_m": under["inner_displacement_m"],
        "max_inner_displacement_m": report["max_displacement_m"],
        "max_bulge_m": report["bulge_m"],
    }
    errors = {name: abs(found / float(row[name]) - 1) for name, found in pairs.items()}
    errors["min_gap_m"] = abs(report["min_gap_m"] - float(row["min_gap_m"])) / 5e-3
    return errors


def rows_and_long_ones() -> list[Any]:
    """Loads at the crown make a program of their own, of half the arc."""
    marks = {True: [pytest.mark.long], False: []}
    return [
        pytest.param(
            row, marks=marks[float(row["load_arc_from_crown_m"]) == 0], id=row["force_N"]
        )
        for row in ROWS
    ]


@pytest.mark.parametrize("row", rows_and_long_ones())
def test_the_shell_is_the_continuum_on_an_ellipse(row: dict[str, str]) -> None:
    errors = compared(row, model="shell", elements=96)
    assert max(errors.values()) < 2e-3, errors


@pytest.mark.long
@pytest.mark.parametrize("row", ROWS, ids=lambda row: row["force_N"])
def test_the_solid_is_the_continuum_on_an_ellipse(row: dict[str, str]) -> None:
    errors = compared(row, model="solid", mesh=(192, 2))
    assert max(errors.values()) < 2e-4, errors


def differences(spec: SceneSpec, quantity: str, inputs: tuple[str, ...]) -> float:
    """Derivative of a displacement, by central differences, when inputs grow alike."""
    numbers = continuous_inputs(spec)
    step = 1e-4 * abs(numbers[inputs[0]])
    ends = [
        solve(with_inputs(spec, {name: numbers[name] + sign * step for name in inputs}))
        for sign in (1, -1)
    ]
    up, down = (float(end.report["loads"][0][quantity]) for end in ends)
    return (up - down) / (2 * step)


THICKNESS = {
    "arc": [0, 0.25, 0.5, 0.75, 1],
    "value": ["1.6 mm", "1.3 mm", "1.5 mm", "1.3 mm", "1.6 mm"],
}
SHAPES: dict[str, tuple[dict[str, Any], float, list[tuple[str, ...]]]] = {
    # Half an arc is solved: what is moved keeps the section its own mirror image.
    "an ellipse of uneven thickness": (
        ELLIPSE | {"thickness": THICKNESS},
        0.0,
        [
            ("inner_semi_axes.0",),
            ("inner_semi_axes.1",),
            ("thickness.value.1", "thickness.value.3"),
            ("thickness.value.2",),
        ],
    ),
    "a path": (
        {
            "section": "path",
            "path": [
                {"line": "20 mm"},
                {"radius": "30 mm", "angle": "90 deg"},
                {"line": "27.5 mm"},
            ],
            "mirror": True,
        },
        0.012,
        [("path.1.radius",), ("path.0.line",)],
    ),
}


@pytest.mark.long  # derivatives of whole scenes; test_sections.py has those of the shapes
@pytest.mark.parametrize("name", [next(iter(SHAPES)), "a path"])
def test_derivatives_by_the_shape_are_those_of_differences(name: str) -> None:
    geometry, arc, moved = SHAPES[name]
    spec = with_solve(shaped(geometry, at_arc(arc, 9.0)), model="shell", elements=24)
    slopes = gradient(solve(spec), "loads.0.displacement_m")
    for keys in moved:
        paths = tuple(f"geometry.{key}" for key in keys)
        if len(paths) > 1:  # mirror images of each other
            assert slopes[paths[0]] == pytest.approx(slopes[paths[1]], rel=1e-6)
        want = differences(spec, "displacement_m", paths)
        assert sum(slopes[path] for path in paths) == pytest.approx(want, rel=1e-5), keys


TALL = ELLIPSE | {"inner_semi_axes": ["57.5 mm", "70 mm"]}


def test_loads_are_moved_aside_by_the_key_that_places_them() -> None:
    spec = shaped(ELLIPSE, at_arc(0.0, 1.0), {"kind": "pressure", "pressure": "1 kPa"})
    known = inputs_of(spec)
    moved = shifted(spec, known)
    assert {key for key in known if moved[key] != known[key]} == {"load.0.arc"}
    assert 0 < moved["load.0.arc"] < 2e-3


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"spread": "12 mm"}, r"load\.0\.spread: reaches over the clamped edge at .* mm"),
        ({"kind": "patch", "size": ["12 mm", "4 mm"]}, r"load\.0\.size: reaches over"),
        ({"kind": "patch", "diameter": "12 mm"}, r"load\.0\.diameter: reaches over"),
    ],
)
def test_wide_loads_over_a_clamp_are_refused(more: dict[str, Any], words: str) -> None:
    ends = {"ends": "clamped"} if "kind" in more else {}
    length = 0.154389  # of the inner face: half of the ellipse's circumference
    at_edge = at_arc(length / 2 - 5e-3, 1.0) | more
    with pytest.raises(ConfigError, match=words):
        measures(shaped(ELLIPSE | ends, at_edge))
    narrow = {k: "9 mm" if k != "size" else ["9 mm", "4 mm"] for k in more if k != "kind"}
    measures(shaped(ELLIPSE | ends, at_edge | more | narrow))


@pytest.mark.long  # programs of half an arc and of the whole one
def test_a_tall_ellipse_sways_under_a_load_at_its_crown() -> None:
    """An independent program: it buckles sideways at 2.6 to 2.7 N; 2.31 mm of sway at 3.6 N."""
    spec = shaped(TALL, {"kind": "line", "angle": "0 deg", "force": "3.6 N"})
    found = solve(with_solve(spec, model="shell", elements=32))
    assert found.report["stable"]
    assert 2.6 < 3.6 * found.report["stable_factor"] < 2.7
    assert "mirror images" in found.report["message"]
    crown = found.read(crown_displacement)
    assert abs(crown[0]) == pytest.approx(2.31e-3, rel=0.01)


def crown_displacement(problem: Problem, state: State, shown: State) -> Any:
    """Of the inner face on the axis of symmetry [m]."""
    del state
    at = problem.mechanics.under(shown.q, [LineLoad(*(jnp.zeros(1),) * 3)])
    return at.inner_displacement[:, 0]
