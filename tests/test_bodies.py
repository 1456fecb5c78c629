"""Rigid bodies on a section: against an independent continuum, and by their own laws.

tests/data/indenter2d.csv: finite elements under a rigid cylinder; its header says how well.
"""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from skins import (
    EPDM,
    GEOMETRY,
    LAWS,
    WIDTH,
    built,
    find,
    line,
    problem_of,
    quick,
    reference_rows,
    scene,
    shaped,
)

from fitting.cli.sweep import friction_note
from suas_jax.config import (
    BodyLoadSpec,
    ConfigError,
    SceneSpec,
    continuous_inputs,
    scene_from_dict,
    with_inputs,
    with_solve,
)
from suas_jax.equilibrium.balance import Problem, State
from suas_jax.equilibrium.correction import corrected_touch
from suas_jax.equilibrium.equilibrium import Equilibrium, differentiable
from suas_jax.equilibrium.friction import equilibrium_with_friction
from suas_jax.equilibrium.outcomes import NAMES, index_of
from suas_jax.equilibrium.validity import final_result, room_for_bodies
from suas_jax.mechanics.contact.face import BodyContact
from suas_jax.mechanics.registry import MODELS
from suas_jax.mesh.section import measures
from suas_jax.numerics.lanes import number
from suas_jax.scene import build, choice
from suas_jax.scene.assessment import _SHARPEST
from suas_jax.scene.build import plan_for
from suas_jax.scene.contact_zone import (
    _resolved,
    body_observables,
    error_by_bodies,
    error_by_penetration,
    error_by_squeezing,
    touched_by_bodies,
)
from suas_jax.scene.force_search import under_forces
from suas_jax.scene.indentation import IndentationCurve, Point
from suas_jax.scene.loads import loads_of
from suas_jax.scene.parts import scene_parts, skin_parts
from suas_jax.scene.program import prepared, run_program, structure_of
from suas_jax.scene.solve import Solution, check_bodies, report_with, solve
from suas_jax.scene.sweep import SweepError, sweep
from suas_jax.scene.travel import shares_of_travel
from suas_jax.skin.body import Grip
from suas_jax.skin.body_shapes import AbstractShape, Box, Plate, Round, Wedge
from suas_jax.skin.section import outward
from suas_jax.skin.wall import Wall

CYLINDER = {"shape": "cylinder", "radius": "10 mm"}
PLATE = {"shape": "plate"}


def body(angle: float, depth: float, **shape: Any) -> dict[str, Any]:
    """A body; angle in degrees, depth in millimetres."""
    place = {"angle": f"{angle} deg", "depth": f"{depth!r} mm"}
    return {"kind": "body", **place, **(shape or CYLINDER)}


def pad_scene(load: dict[str, Any]) -> SceneSpec:
    """The paper's skin with clamped ends under one load."""
    geometry = {**GEOMETRY, "ends": "clamped"}
    oil = {"model": "incompressible"}
    tables = {"geometry": geometry, "material": LAWS["neo-hookean"], "oil": oil}
    return scene_from_dict({**tables, "load": [load]})


def references(angle: float) -> list[dict[str, float]]:
    rows = reference_rows("indenter2d.csv")
    found = [{k: float(v) for k, v in r.items() if _is_number(v)} for r in rows]
    return [row for row in found if row["angle_deg"] == angle]


def _is_number(text: str) -> bool:
    return text.replace("e-", "").replace(".", "").replace("-", "").isdigit()


@quick
def touched(problem: Problem, state: State) -> tuple[BodyContact, Array]:
    """Contact with the first body, and the energy that strain and contact store [J/m]."""
    mechanics = problem.mechanics
    stored = mechanics.strain_energy(state.q) + mechanics.contact_energy(state.q, state.factor)
    return mechanics.touched(state.q, mechanics.bodies[0].placed(state.factor)), stored


def pressed(
    spec: SceneSpec, *mesh: int, slid: tuple[float, ...] = ()
) -> tuple[dict[str, float], float, float]:
    """What the first body does, the oil's pressure [Pa], the energy stored [J/m]."""
    problem = problem_of(spec, *mesh)
    if slid:
        problem = built(spec, plan_for(spec, "solid", mesh, slid))
    found = find(problem)
    assert found.result[0] == 0
    contact, stored = touched(problem, found.state)
    geometry = skin_parts(spec, continuous_inputs(spec)).geometry
    own = problem.mechanics.bodies[0]
    report = body_observables(contact, own, found.state.factor, geometry)
    numbers = {key: float(np.asarray(x)[0]) for key, x in report.items()}
    return numbers, float(found.state.pressure[0]), float(stored[0])


def test_the_solid_meets_the_reference_off_the_crown() -> None:
    """Force, its tilt as the skin slides beneath, oil pressure, place of contact."""
    for row in references(30)[1::2]:
        found, pressure, _ = pressed(scene(body(30, 1e3 * row["d_m"])), 128, 2)
        assert abs(found["force_N"] / row["force_radial_N"] - 1) < 4e-3
        assert abs(pressure / row["oil_pressure_Pa"] - 1) < 1e-3
        tilt = row["force_tangential_N"]
        assert abs(found["tangential_force_N"] - tilt) < 0.03 * abs(tilt)
        middle = (found["contact_from_m"] + found["contact_to_m"]) / 2
        assert abs(middle - (row["contact_from_m"] + row["contact_to_m"]) / 2) < 1e-4
        # Without friction nothing turns a round body about its centre.
        assert abs(found["moment_Nm"]) < 1e-12 * row["force_radial_N"]
        assert found["zones"] == 1


@pytest.mark.long  # two meshes of the solid; the test before holds the reference
def test_elements_beneath_the_material_that_is_touched_turn_no_force() -> None:
    """The solid's mesh follows what has slid beneath the body, from a first solve."""
    for row in references(30)[2:]:
        spec, tilt = scene(body(30, 1e3 * row["d_m"])), row["force_tangential_N"]
        first = pressed(spec, 64, 1)[0]
        along = (first["contact_from_m"] + first["contact_to_m"]) / 2
        place = along / (measures(spec).size + spec.geometry.mean_thickness / 2)
        found, pressure, _ = pressed(spec, 128, 2, slid=(place,))
        assert abs(found["tangential_force_N"] - tilt) < 4e-3 * abs(tilt)
        assert abs(found["force_N"] / row["force_radial_N"] - 1) < 1e-3
        assert abs(pressure / row["oil_pressure_Pa"] - 1) < 1e-3


def test_the_force_is_what_the_stored_energy_grows_by() -> None:
    """Action equals reaction: under trapped oil all work of the travel is stored."""
    step = 1e-3  # [mm]
    force = pressed(scene(body(30, 3.0)), 128, 2)[0]["force_N"]
    low, high = (pressed(scene(body(30, 3.0 + s * step)), 128, 2)[2] for s in (-1, 1))
    assert abs((high - low) / (2e-3 * step) * WIDTH / force - 1) < 1e-5


@functools.cache
def on_the_crown(depth: float) -> Solution:
    return solve(with_solve(scene(body(0, depth)), model="shell", elements=32))


def test_the_shell_meets_the_reference_within_its_stated_error() -> None:
    for row in references(0)[::2]:
        report = on_the_crown(1e3 * row["d_m"]).report
        load = report["loads"][0]
        apart = load["force_N"] / row["force_radial_N"] - 1
        assert abs(apart) < min(4e-3, report["error_estimate"])
        assert abs(report["oil_pressure_Pa"] / row["oil_pressure_Pa"] - 1) < 4e-3
        assert (
            abs(load["inner_displacement_m"] - row["inner_displacement_m"]) < 5e-3 * row["d_m"]
        )
        assert abs(load["tangential_force_N"]) < 1e-9 * load["force_N"]
        # Narrower than an element, than the thickness, and than the reference tells at first.
        apart = load["contact_half_width_m"] / row["contact_half_width_m"] - 1
        assert abs(apart) < 0.05 + 1.5 * row["err_contact_half_width_m"] / 2e-4
        assert abs(load["max_contact_pressure_Pa"] / row["max_pressure_Pa"] - 1) < 0.05
        assert load["contact_resolved"]
        assert report["status"] == "converged"
        assert report["stable"]


@pytest.mark.long  # a mesh and its errors of an ellipse; the next one holds the circle
def test_elements_under_a_body_shear_where_it_touches() -> None:
    """A mid-line that shears has a kink there, which only a station lets elements have.

    Off the crown of an ellipse the material that is touched is a millimetre from where the body
    comes in; the solid's answer is that of 384 x 4 elements, sure to 1e-4.
    """
    tables = {
        "geometry": {
            "section": "ellipse",
            "inner_semi_axes": ["49.7 mm", "40.8 mm"],
            "half_angle": "90 deg",
            "thickness": "1.84 mm",
            "oil_gap": "5 mm",
            "width": "100 mm",
        },
        "material": {"law": "neo-hookean", "mu": "0.8 MPa"},
        "oil": {"model": "incompressible"},
        "load": [
            {
                "kind": "body",
                "shape": "cylinder",
                "radius": "11.7 mm",
                "arc": "15.9 mm",
                "depth": "2.42 mm",
            }
        ],
    }
    report = solve(with_solve(scene_from_dict(tables), model="shell")).report
    of_force = report["loads"][0]["force_N"] / 0.90645 - 1
    of_pressure = report["oil_pressure_Pa"] / 432.18 - 1
    assert max(abs(of_force), abs(of_pressure)) < min(1e-3, report["error_estimate"])


def test_a_zone_that_lies_flat_ends_in_the_thickness() -> None:
    """As in the solid: 0.3 mm at 2 mm of travel, 6 mm at 4; pressed hardest at its ends."""

    def strip_of(depth: float) -> list[float]:
        problem = problem_of(scene(body(0, depth, **PLATE)), 64)
        return [float(x[0]) for x in strip(problem, find(problem).state)]

    half, pressure, told = strip_of(2.0)
    assert told
    assert abs(half - 0.33e-3) < 0.03e-3
    assert abs(pressure - 1.45e5) < 0.1e5
    half, pressure, told = strip_of(4.0)
    assert told
    assert abs(half - 6.1e-3) < 0.1e-3
    assert abs(pressure - 8.2e4) < 0.4e4


@quick
def strip(problem: Problem, state: State) -> Any:
    body = problem.mechanics.bodies[0].placed(state.factor)
    return problem.mechanics.strip(state.q, body)


@pytest.mark.long  # with walls; scenes are named before they are solved, below
def test_a_shell_between_two_rigid_surfaces_has_no_answer() -> None:
    """Its error exceeds what it says; against a soft layer the layer gives way instead."""

    @quick
    def error(problem: Problem, state: State) -> Array:
        return error_by_squeezing(problem, state, touched_by_bodies(problem, state))

    def squeezed(**layer: Any) -> float:
        spec = scene(body(0, 5.1))
        free = problem_of(spec, 32)
        wall = skin_parts(spec, continuous_inputs(spec)).wall
        assert wall is not None
        if layer:
            thickness, stiffness = (jnp.full(1, x) for x in layer.values())
            wall = Wall.of(
                wall.geometry, free.mechanics.law.shear_modulus, (thickness, stiffness)
            )
        problem = eqx.tree_at(lambda p: p.mechanics, free, free.mechanics.with_wall(wall))
        return float(error(problem, find(problem).state)[0])

    assert squeezed() > 1
    assert squeezed(thickness=1e-3, stiffness=1e5) < 1e-2


@pytest.mark.parametrize(
    ("angle", "depth", "outcome", "tight"),
    [
        (30, 4.0, None, False),
        (30, 5.5, None, True),
        (30, 8.0, "squeezed", True),
        (30, 16.0, "squeezed", True),  # the face lies nearer to the body's other side
        (30, 300.0, "squeezed", True),
        (85, 2.0, "body_on_clamp", False),
    ],
)
def test_a_travel_that_ends_in_wall_or_clamp_is_named_before_it_is_solved(
    angle: float, depth: float, outcome: str | None, tight: bool
) -> None:
    spec = scene(body(angle, depth))
    problem = problem_of(spec, 32)
    wall = skin_parts(spec, continuous_inputs(spec)).wall
    held = dataclasses.replace(problem, mechanics=problem.mechanics.with_wall(wall))
    lost, room = quick(room_for_bodies)(held)
    assert int(lost[0]) == (index_of(outcome) if outcome else 0)
    assert bool(room[0]) is tight


def _room(load: dict[str, Any], *, pad: bool = False) -> float:
    """Travel below which a body is not refused [mm]: the one that the refusal states."""
    deep = load | {"depth": "30 mm"}
    spec = pad_scene(deep) if pad else scene(deep)
    with pytest.raises(ConfigError, match="clamped edge") as refused:
        check_bodies(spec)
    (mistake,) = refused.value.mistakes
    assert mistake.key == "load.0.depth"
    size, unit = mistake.advice.split("less than ")[1].split()[:2]
    most = float(size) * {"mm": 1.0, "um": 1e-3}[unit]
    check_bodies(with_inputs(spec, {"load.0.depth": 0.99e-3 * most}))
    with pytest.raises(ConfigError, match="clamped edge"):
        solve(with_inputs(spec, {"load.0.depth": 1.02e-3 * most}))
    return most


def test_a_travel_over_a_clamped_edge_is_refused_at_once() -> None:
    """By closed forms: the edge lies beside the body, and below its tip."""
    outer = float(GEOMETRY["inner_radius"].split()[0]) + 1.5
    apart = np.radians(10.0)
    beside, below = outer * np.sin(apart), outer * (1 - np.cos(apart))
    assert _room(body(80, 0.0, **PLATE)) == pytest.approx(below, rel=5e-3)
    ball = 20.0
    round_ = below + ball - np.sqrt(ball**2 - beside**2)
    load = body(-80, 0.0, shape="cylinder", radius="20 mm")
    assert _room(load) == pytest.approx(round_, rel=5e-3)
    dragged = below + ball - np.sqrt(ball**2 - (beside - 1.0) ** 2)
    assert _room(load | {"drag": "-1 mm"}) == pytest.approx(dragged, rel=5e-3)
    ball, end = 60.0, float(GEOMETRY["width"].split()[0]) / 2 - 50.0
    load = body(0, 0.0, shape="sphere", radius="60 mm") | {"axial": "50 mm"}
    wanted = ball - np.sqrt(ball**2 - end**2)
    assert _room(load, pad=True) == pytest.approx(wanted, rel=5e-3)


def test_travels_of_one_skin_are_judged_at_once() -> None:
    """As those of an indentation curve: the skin has one lane, its body's travel has many."""
    spec = scene(body(30, 4.0))
    problem = problem_of(spec, 32)
    wall = skin_parts(spec, continuous_inputs(spec)).wall
    mechanics = problem.mechanics.with_wall(wall)
    (one,) = mechanics.bodies
    many = dataclasses.replace(one, travel=jnp.array([4e-3, 5.5e-3, 8e-3]))
    held = dataclasses.replace(mechanics, bodies=(many,))
    lost, room = quick(room_for_bodies)(dataclasses.replace(problem, mechanics=held))
    assert lost.tolist() == [0, 0, index_of("squeezed")]
    assert room.tolist() == [False, True, True]


def test_a_small_body_does_not_pass_through_a_skin_that_it_goes_into_deep() -> None:
    """Deeper than its radius: a soft law that lets it in has to push the skin back its way."""
    small = body(-48.416, 2.7134, shape="cylinder", radius="2.696 mm")
    sizes = {"inner_radius": 0.034403, "thickness": 0.9775e-3, "oil_gap": 0.006355}
    found = find(problem_of(scene(small, **sizes), 32))
    assert found.result[0] == 0
    shape = Round(jnp.full(1, 2e-3), endless=True)
    for deep in (1e-4, 1e-3, 3e-3, 9e-3):
        place = jnp.array([[1e-5], [deep]])
        assert float(shape.straight_distance(place)[0]) == pytest.approx(-deep, abs=1e-6)


def test_skin_deep_in_a_small_box_is_pushed_back_the_way_it_came() -> None:
    """A pin of 2 x 2 mm, 1 mm in, was pushed aside with no force: `converged`."""
    box = Box((jnp.full(1, 2e-3), jnp.full(1, 3e-3)), jnp.full(1, 9e-4))
    for deep in (1e-4, 1e-3, 3e-3):
        place = jnp.array([[5e-5], [0.0], [deep]])
        assert float(box.straight_distance(place)[0]) == pytest.approx(-deep, rel=1e-9)
    assert bool(box.is_beyond(place)[0])


def test_skin_behind_a_small_body_is_pushed_back_by_its_own_law_too() -> None:
    """To which Newton's method may come from far: a thin rod passed through the skin."""
    problem = problem_of(scene(body(0, 2.0, shape="cylinder", radius="0.2 mm")), 32)
    own = problem.mechanics.softened(jnp.ones(1)).bodies[0]
    tip = own.origin + own.way
    behind, beside = tip + 2e-3 * own.frame[-1], tip + 2e-4 * own.along + 2e-4 * own.frame[-1]
    assert float(own.placed(1.0).gap(behind)[0]) == pytest.approx(-2e-3, rel=1e-3)
    assert float(own.placed(1.0).gap(beside)[0]) == pytest.approx(0, abs=1e-9)


def test_a_tip_that_points_of_the_skin_catch_on_is_named() -> None:
    """A rod of 0.02 mm held the skin 30 degrees off the crown as if friction did."""
    for radius, status in (("0.02 mm", "sharp_body"), ("0.5 mm", "converged")):
        spec = scene(body(0, 1.0, shape="cylinder", radius=radius))
        report = solve(with_solve(spec, model="shell", elements=32)).report
        assert report["status"] == status


def test_a_tip_that_comes_through_between_points_is_named() -> None:
    """A ball of 1 nm, 1 mm deep in a pad, was `converged` without force."""
    for radius, between, catches in (("1e-9 m", True, True), ("10 mm", False, False)):
        spec = scene(body(0, 1.0, shape="cylinder", radius=radius))
        (tip,) = problem_of(spec, 8).mechanics.bodies
        placed, beside = tip.placed(1.0), jnp.array([-1e-4, 1e-4])[:, None]
        for off, through in ((0.0, between), (-1e-2, False)):  # where it was, and pushed away
            face = tip.origin[:, None] + off * tip.frame[-1][:, None]
            place = (face + beside * tip.along[:, None])[..., None, :]
            gap = placed.gap(place)
            area = jnp.full(gap.shape, 4e-8)
            at = BodyContact(gap, place, gap, gap, place, area, gap)
            assert bool(at.passed_by(placed)[0]) == through
        # Points of a pad 0.2 mm apart.
        touching = at._replace(gap=gap - 1.0)
        turn = touching.turn_between_points(placed.body.shape.curvature)
        assert bool(turn[0] > _SHARPEST) == catches
    ended, sharp = index_of("limit_point"), index_of("sharp_body")
    outcomes = jnp.array([0, ended, ended, index_of("squeezed")])
    verdicts = jnp.array([sharp, sharp, index_of("unbalanced"), sharp])
    assert final_result(outcomes, verdicts).tolist() == [
        sharp,
        sharp,
        ended,
        index_of("squeezed"),
    ]


def test_a_body_off_the_skin_leaves_it_at_rest() -> None:
    report = on_the_crown(-1.0).report
    load = report["loads"][0]
    assert report["status"] == "converged"
    assert load["force_N"] == load["contact_area_m2"] == load["zones"] == 0
    assert report["max_displacement_m"] < 1e-15


@quick
def _slope_of_shift(problem: Problem, q: Array) -> Array:
    """Derivative of the sum of what a body's gap shifts by, by every unknown."""
    mechanics = problem.mechanics
    body = mechanics.bodies[0].placed(1.0)
    return jax.grad(lambda q: jnp.sum(mechanics.gap_shift(q, body)))(q)


def test_a_body_off_the_skin_leaves_the_derivatives_of_other_loads() -> None:
    problem = problem_of(scene(line(20.0, 5.0), body(0, -1.0)), 8)
    # Any state of a skin that other loads move: it need not be an equilibrium.
    moved = 1e-5 * np.random.default_rng(0).standard_normal(problem.mechanics.rest().shape)
    slope = _slope_of_shift(problem, jnp.asarray(moved))
    assert bool(jnp.all(jnp.isfinite(slope)))


def test_a_curve_s_travels_are_inwards_wherever_the_scene_keeps_its_bodies() -> None:
    assert shares_of_travel({"a": -5e-4}) == {"a": 1.0}
    assert shares_of_travel({"a": 1e-3, "b": -2e-3}) == {"a": 1.0, "b": -2.0}
    assert shares_of_travel({"a": 0.0, "b": -1e-3}) == {"a": 1.0, "b": 1.0}
    away = with_inputs(on_the_crown(3.0).scene, {"load.0.depth": -5e-4})
    (point,) = sweep(away, depths=[3e-3]).points
    known = on_the_crown(3.0).report["loads"][0]
    assert point["loads"][0]["force_N"] == pytest.approx(known["force_N"], rel=1e-8)


def test_indentation_curves_go_there_and_back() -> None:
    spec = on_the_crown(4.0).scene
    depths = np.array([0.0, 1e-3, 3e-3, 1e-3, 0.0])
    points = sweep(spec, depths=depths).points
    force = np.array([p["loads"][0]["force_N"] for p in points])
    np.testing.assert_allclose(force[3:], force[[1, 0]], rtol=1e-8)
    alone = on_the_crown(3.0).report
    assert abs(force[2] / alone["loads"][0]["force_N"] - 1) < 1e-8
    assert abs(points[2]["error_estimate"] / alone["error_estimate"] - 1) < 1e-3
    with pytest.raises(SweepError, match="--depth"):
        sweep(spec, forces=[1.0])
    with pytest.raises(SweepError, match="depth"):
        sweep(scene(line(0, 1.0)), depths=depths)


class _Known(IndentationCurve):
    """A curve whose forces are known: on the coarser mesh too large by their travel [mm]."""

    def follow(
        self, depths: Sequence[float], counts: tuple[int, ...], starts: Any = None
    ) -> list[Point]:
        del starts
        if counts != self.plan.counts:
            COARSE.extend(depths)
        more = 0.0 if counts == self.plan.counts else 1.5
        shown = [
            {
                "loads": [{"force_N": 1 + more * 1e3 * depth}],
                "oil_pressure_Pa": 0.0,
                "max_displacement_m": 1.0,
            }
            for depth in depths
        ]
        lost = [int(round(1e3 * depth) in LOST and more > 0) for depth in depths]
        return [Point(x, {"result": k}, None) for x, k in zip(shown, lost, strict=True)]


COARSE: list[float] = []
LOST = [9]  # travels that the coarser mesh does not solve [mm]


def test_a_curves_mesh_error_is_told_at_nine_travels() -> None:
    """Between them the larger one counts; one that the coarser mesh loses is no witness."""
    spec = scene(body(0, 4.0))
    plan = plan_for(spec, "shell", (32,))
    known = _Known(spec, {}, MODELS[2]["shell"], plan, wall=False)
    depths = 1e-3 * np.array([*range(18), 5.0, -1.0])
    errors = known._mesh_errors(depths, known.follow(depths, plan.counts))
    np.testing.assert_allclose(1e3 * np.array(COARSE), range(1, 18, 2))
    wanted = np.array([1, 1, 3, 3, 5, 5, 7, 7, *[11] * 4, 13, 13, 15, 15, 17, 17, 5, 1])
    np.testing.assert_allclose(errors, wanted, rtol=1e-12)


def test_a_curve_s_end_that_the_coarser_mesh_does_not_reach_has_no_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(globals(), "LOST", [15, 17])
    spec = scene(body(0, 4.0))
    plan = plan_for(spec, "shell", (32,))
    known = _Known(spec, {}, MODELS[2]["shell"], plan, wall=False)
    depths = 1e-3 * np.arange(18.0)
    errors = known._mesh_errors(depths, known.follow(depths, plan.counts))
    assert np.isfinite(errors[:14]).all()
    assert np.isnan(errors[14:]).all()


class _Polynomial(IndentationCurve):
    """A curve of known states, which takes note of how far a solve starts from its own."""

    def _solved(
        self, depth: float, counts: tuple[int, ...], start: State | None, *, wall: bool
    ) -> Point:
        x = np.array([depth, np.sqrt(depth)])  # [mm]; of the travel and of its root
        q = jnp.asarray(1 - 2 * x + 3 * x**2 - x**3)
        OFF[depth] = np.full(2, np.nan) if start is None else np.asarray(start.q - q)
        return Point({}, {"result": 0}, State(q, jnp.zeros(1), jnp.ones(1)))


OFF: dict[float, np.ndarray] = {}


def test_points_of_a_pads_curve_start_from_the_states_around_them() -> None:
    """Cubics through four of them: of the travel in order, of its root between a few."""
    spec = pad_scene(body(0, 2.0, shape="sphere", radius="10 mm"))
    plan = plan_for(spec, "shell", (8, 8))
    curve = _Polynomial(spec, {"load.0.depth": 1.0}, MODELS[3]["shell"], plan, wall=False)
    travels = np.arange(41) / 4
    found = curve._filled(travels)
    in_order = [0.0, 0.25, *np.arange(5, 41, 5) / 4]
    assert found
    assert sorted(OFF) == travels.tolist()
    for travel, point in zip(travels, found, strict=True):
        np.testing.assert_allclose(point.part.q[0], np.polyval([-1, 3, -2, 1], travel))
        if travel not in in_order:
            np.testing.assert_allclose(OFF[travel][1], 0, atol=1e-9)
    for travel in in_order[6:]:  # even steps are behind it
        np.testing.assert_allclose(OFF[travel][0], 0, atol=1e-9)
    assert curve._filled(travels[::-1]) == []
    assert curve._filled(travels[:9]) == []


@pytest.mark.parametrize(("beside", "from_rest"), [([], True), ([line(20, 1.0)], False)])
def test_a_curve_that_lets_go_ends_at_rest(
    beside: list[dict[str, Any]], from_rest: bool
) -> None:
    """From the state before, what is left is rounding: forces that nothing balances."""
    spec = scene(body(0, 2.0), *beside)
    plan = plan_for(spec, "shell", (32,))
    curve = _Polynomial(spec, {"load.0.depth": 1.0}, MODELS[2]["shell"], plan, wall=False)
    curve.follow(np.array([0.5, 0.25, 0.0]), plan.counts)
    assert np.isfinite(OFF[0.25]).all()
    assert np.isnan(OFF[0.0]).all() == from_rest


def test_a_plate_opens_from_a_point_to_one_patch() -> None:
    """Of 0.4 mm at 2 mm, of 6 mm at 4 mm: then a tenth stiffer than a cylinder."""
    small, _, _ = pressed(scene(body(0, 2.0, **PLATE)), 64)
    large, pressure, _ = pressed(scene(body(0, 4.0, **PLATE)), 64)
    assert small["contact_half_width_m"] < 0.6e-3
    assert abs(large["contact_half_width_m"] - 6.1e-3) < 0.5e-3
    assert small["zones"] == large["zones"] == 1
    assert abs(large["force_N"] / references(0)[-1]["force_radial_N"] - 1.1) < 0.01
    assert pressure > 17e3


def solved_on_pad(load: dict[str, Any]) -> tuple[float, float, float]:
    """Force [N], oil pressure [Pa] and displacement under one load in a pad's middle [m]."""
    spec = pad_scene(load)
    _, meshes, inputs, rest = prepared(spec, "shell", (16, 12))
    static = structure_of(spec, wall=False)
    *_, state, outcome = run_program(static, meshes, inputs, rest, once=True, judged=False)
    assert number(outcome["result"]) == 0
    own = scene_parts(spec, inputs)
    pad = build.problem_of(own, meshes.solved).mechanics
    acting = (own.bodies or own.forces)[0]
    under = number(jnp.abs(pad.under(state.q, [acting]).mid_displacement[1]))
    force = float(load.get("force", "0 N").split()[0])
    if pad.bodies:
        contact = pad.touched(state.q, pad.bodies[0].placed(state.factor))
        force = pad.parts * number(jnp.sum(contact.force[1], (0, 1)))
    return abs(force), number(state.pressure), under


@pytest.mark.long  # two programs of pads
def test_a_ball_without_size_is_a_point_load() -> None:
    """A patch of 0.2 mm with the ball's force: same oil pressure, same travel."""
    apart = []
    for radius in (4.0, 1.0, 0.25):
        ball = {"shape": "sphere", "radius": f"{radius} mm"}
        force, pressure, _ = solved_on_pad(body(0, 1.0, **ball))
        patch = {"kind": "patch", "angle": "0 deg", "diameter": "0.2 mm"}
        _, under_patch, moved = solved_on_pad({**patch, "force": f"{force!r} N"})
        apart.append((abs(pressure / under_patch - 1), abs(moved / 1e-3 - 1)))
    by_pressure, by_travel = np.array(apart).T
    assert (by_pressure[1:] < 1e-4).all()
    assert by_pressure[0] > by_pressure[1:].max()
    assert by_travel[-1] < 5e-3, by_travel


@pytest.mark.long  # a program of the solid
def test_a_thick_soft_skin_on_its_wall_answers_a_ball_as_hertz_says() -> None:
    """With the factor of a layer: Dimitriadis et al., Biophys. J. 82 (2002) 2798.

    It is incompressible and lies on its base without sticking to it. The ball first takes the
    film away. No shell will do: its normals keep their length.
    """
    radius, thickness, modulus, film, travel = 20e-3, 10e-3, 0.1e6, 0.02e-3, 0.4e-3
    spec = scene_from_dict(
        {
            "geometry": {
                "inner_radius": "200 mm",
                "thickness": "10 mm",
                "half_angle": "20 deg",
                "width": "140 mm",
                "oil_gap": "0.02 mm",
                "ends": "clamped",
            },
            "material": {"law": "neo-hookean", "mu": "0.1 MPa"},
            "oil": {"model": "vented"},
            "load": [body(0, 0.4, shape="sphere", radius="20 mm")],
        }
    )
    _, meshes, inputs, rest = prepared(spec, "solid", (32, 32, 3))
    static = structure_of(spec, wall=True)
    report, *_, outcome = run_program(static, meshes, inputs, rest, once=True, judged=False)
    assert number(outcome["result"]) == 0
    curvatures = 1 / radius + 1 / (200e-3 + thickness), 1 / radius
    effective, depth = 1 / np.sqrt(np.prod(curvatures)), travel - film
    share = np.sqrt(effective * depth) / thickness
    hertz = 16 / 3 * modulus * np.sqrt(effective) * depth**1.5
    factor = np.polyval([0.0048, 0.386, 0.781, 0.884, 1.0], share)
    assert factor > 1.25
    assert abs(number(report["loads"][0]["force_N"]) / (hertz * factor) - 1) < 0.03


held = quick(equilibrium_with_friction)


def _on_body(problem: Problem, state: State) -> Array:
    """Force per width of the skin on the first body [N/m]."""
    mechanics, body = problem.mechanics, problem.mechanics.bodies[0]
    contact = mechanics.touched(state.q, body.placed(state.factor))
    return jnp.sum(contact.force, (1, 2))[:, 0]


on_body = quick(_on_body)


@functools.cache
def dragged(friction: float, drag: float = 0.0) -> tuple[float, float, float]:
    """Forces along the approach and across it [N/m], and the oil's pressure [Pa]."""
    table = body(30, 2.0) | {"friction": friction, "drag": f"{drag!r} mm"}
    problem = problem_of(scene(table), 64, 2)
    zero = jnp.zeros(1)
    found = held(problem, State(problem.mechanics.rest(), zero, zero))
    assert found.result[0] == 0
    out = np.asarray(problem.mechanics.bodies[0].frame)[..., 0]
    force = -out @ np.asarray(on_body(problem, found.state))
    return -float(force[1]), float(force[0]), float(found.state.pressure[0])


def test_friction_goes_from_none_to_sticking() -> None:
    """The skin slides by 0.9 mm beneath the cylinder without, and not at all with much."""
    free, pressure, _ = pressed(scene(body(30, 2.0)), 64, 2)
    normal, across, its_pressure = dragged(1e-9)
    assert abs(normal * WIDTH / free["force_N"] - 1) < 1e-7
    assert abs(across * WIDTH - free["tangential_force_N"]) < 1e-7 * free["force_N"]
    assert abs(its_pressure / pressure - 1) < 1e-7
    tilt = -free["tangential_force_N"] / free["force_N"]
    for friction in (0.1, 0.3):
        normal, across, _ = dragged(friction)
        # Coulomb's ratio, along the surface of a cylinder that touches beside its tip.
        assert 0.85 * friction < across / normal < friction
        assert abs(across / normal - (friction - tilt)) < 0.01
    sticks, firmly = dragged(3.0), dragged(10.0)
    np.testing.assert_allclose(sticks, firmly, rtol=5e-3)
    assert firmly[0] > 2 * normal


@pytest.mark.long
@pytest.mark.parametrize(
    ("geometry", "load"),
    [
        (
            {"inner_radius": 0.0603556, "thickness": 0.53145e-3, "oil_gap": 4.79006e-3},
            {"radius": "40.6248 mm", "friction": 0.05856218}
            | {"angle": "-13.5866 deg", "depth": "4.5965 mm"},
        ),
        (
            {"inner_radius": 0.0627374, "thickness": 0.44641e-3, "oil_gap": 6.17619e-3},
            {"radius": "39.1644 mm", "friction": 0.39786463}
            | {"angle": "-44.6590 deg", "depth": "2.50443 mm"},
        ),
    ],
)
def test_friction_on_a_thin_skin_has_its_own_bound(
    geometry: dict[str, float], load: dict[str, Any]
) -> None:
    """Beneath a body that is stiff against it: to the digits that the state gives the bound."""
    problem = problem_of(scene({"kind": "body", "shape": "cylinder"} | load, **geometry), 64)
    zero = jnp.zeros(1)
    found = held(problem, State(problem.mechanics.rest(), zero, zero))
    assert found.result[0] == 0
    first = problem.mechanics.gripped(found.state.q, found.state.factor)
    again = held(problem, found.state)
    second = problem.mechanics.gripped(again.state.q, again.state.factor)
    bounds = [np.asarray(m.bodies[0].grip.bound) for m in (first, second)]
    assert np.abs(bounds[1] - bounds[0]).sum() < 1e-7 * bounds[0].sum()


class _Held(eqx.Module):
    """A stand-in for a body, or for a membrane under one, held by bounds of friction."""

    grip: Grip | None
    has_friction: bool = eqx.field(static=True, default=True)

    @property
    def bodies(self) -> tuple["_Held"]:
        return (self,)

    def with_bodies(self, bodies: Sequence["_Held"]) -> "_Held":
        return bodies[0]

    def holding(self, grip: Grip | None) -> "_Held":
        return _Held(grip)

    def gripped(self, q: Array, factor: Array) -> "_Held":
        return _Held(Grip(q, factor))


@dataclasses.dataclass
class _Rubbed:
    """A stand-in for a problem."""

    mechanics: _Held


@pytest.mark.parametrize("rate", [0.2, 0.8, 0.95, -0.9])
def test_bounds_of_friction_that_hardly_contract_are_found(
    rate: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As under a rough body that is dragged, of which a round leaves four fifths of the change.

    By a stand-in for the solve, whose bounds follow those held at known rates.
    """
    rates, one = jnp.array([[rate], [0.3], [-0.2]]), jnp.ones(1)
    limit = jnp.array([[2.0], [1.0], [0.5]])

    def solve(problem: Any, start: State) -> Equilibrium:
        grip = problem.mechanics.grip
        state = start._replace(q=limit + rates * (grip.bound - limit), factor=one)
        nothing = jnp.zeros(1, int)
        return Equilibrium(state, one, nothing, nothing, one, one > 0)

    monkeypatch.setattr("suas_jax.equilibrium.friction.equilibrium", solve)
    problem: Any = _Rubbed(_Held(None))
    found = equilibrium_with_friction(problem, State(0 * limit, 0 * one, 0 * one))
    assert found.result[0] == 0
    np.testing.assert_allclose(found.state.q, limit, rtol=1e-8)


def test_letting_go_under_friction_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    rubbed, smooth = scene(body(0, 2.0) | {"friction": 0.3}), scene(body(0, 2.0))
    assert friction_note(rubbed, [0.0, 1e-3, 2e-3]) == friction_note(smooth, [2e-3, 0.0]) == {}
    assert friction_note(rubbed, None) == {}
    assert not capsys.readouterr().err
    assert "let go" in friction_note(rubbed, [0.0, 2e-3, 1e-3])["friction_note"]
    assert "let go" in capsys.readouterr().err


def test_a_body_dragged_either_way_pulls_the_skin_along() -> None:
    """By all that friction holds, once it slides."""
    normal, across, _ = dragged(0.3, 0.5)
    opposite, back, _ = dragged(0.3, -1.5)
    for n, t, way in ((normal, across, 1), (opposite, back, -1)):
        assert n > 0
        assert 0.25 < way * t / n < 0.35


@quick
def force_along(problem: Problem, state: State, change: Problem) -> Array:
    """Derivative of that force along a change of the problem [N/m]."""

    def force(problem: Problem) -> Array:
        return _on_body(problem, differentiable(problem, state))

    return eqx.filter_jvp(force, (problem,), (change,))[1]


@pytest.mark.parametrize("key", ["friction", "travel", "drag"])
def test_derivatives_under_friction_know_that_its_bound_changes(key: str) -> None:
    problem = problem_of(scene(body(20, 2.0) | {"friction": 0.3, "drag": "0.2 mm"}), 24)
    zero = jnp.zeros(1)

    def where(p: Problem) -> Array:
        value: Array = getattr(p.mechanics.bodies[0], key)
        return value

    def solved(factor: float) -> tuple[Problem, Array]:
        moved = eqx.tree_at(where, problem, factor * where(problem))
        found = held(moved, State(problem.mechanics.rest(), zero, zero))
        assert found.result[0] == 0
        return moved, found.state

    step = 1e-4
    forces = [np.asarray(on_body(*solved(1 + s * step))) for s in (-1, 1)]
    _, state = solved(1.0)
    arrays = eqx.filter(problem, eqx.is_inexact_array)
    change = eqx.tree_at(where, jax.tree.map(jnp.zeros_like, arrays), where(problem))
    slope = np.asarray(force_along(problem, state, change))
    difference = (forces[1] - forces[0]) / (2 * step)
    np.testing.assert_allclose(
        slope, difference, rtol=0, atol=1e-4 * np.max(np.abs(difference))
    )


def _answer(
    start: Any,
    *,
    result: str = "converged",
    ends: tuple[float, float] = (-1.0, 1.0),  # of the contact [m]
    pressure: float = 1.0,
    error: float = np.nan,
) -> Any:
    """What a stand-in for the solve of a mesh says."""
    one = np.ones(1)
    named = {"force_N": one, "depth_m": one}
    named |= {"contact_from_m": ends[0] * one, "contact_to_m": ends[1] * one}
    report = {
        "loads": [named],
        "oil_pressure_Pa": pressure * one,
        "max_displacement_m": one,
        "discretisation_error": error * one,
        "model_error": 0 * one,
        "wall_contact": np.zeros(1, bool),
        "stable": np.ones(1, bool),
    }
    outcome = {"result": np.array([index_of(result)]), "level": one}
    return report, start, start, start, outcome


@pytest.mark.parametrize("lost", ["travels_given", "refined"])
def test_an_error_whose_comparison_fails_is_not_stated(
    lost: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a stand-in for the solve: one mesh has no state at the travel found, or at all."""

    def run(static: Any, meshes: Any, inputs: Any, start: Any, **options: Any) -> Any:
        del static, meshes, inputs
        return _answer(start, result="no_convergence" if options.get(lost) else "converged")

    monkeypatch.setattr(choice, "run_program", run)
    load = _by_force(20, 2.0) if lost == "travels_given" else body(20, 2.0)
    spec = with_solve(scene(load), model="shell", elements=16)
    found, _ = choice.choose(spec, once=True)
    assert found.converged
    assert np.isnan(found.mesh_error)
    assert not found.outcome["compared"]


def test_a_force_has_the_mesh_of_its_travel(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a stand-in: a coarse mesh tells a force's travel, and so the place, a little off."""

    def meshes(place: float) -> list[np.ndarray]:
        slid: list[np.ndarray] = []

        def run(static: Any, meshes: Any, inputs: Any, start: Any, **options: Any) -> Any:
            del static, inputs, options
            slid.append(meshes.whole.arc.slid)
            return _answer(start, ends=(place - 5e-5, place + 5e-5), error=0.0)

        monkeypatch.setattr(choice, "run_program", run)
        monkeypatch.setattr(choice, "carried", lambda *args: None)
        spec = with_solve(scene(body(20, 2.0)), model="shell", elements=32)
        choice.choose(spec, once=True)
        return slid

    by_travel, by_force = meshes(5e-4), meshes(5.02e-4)
    assert np.max(by_travel[-1]) > 0
    np.testing.assert_array_equal(by_force, by_travel)


def test_a_mesh_that_hardly_helps_is_the_last(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a stand-in whose pressure goes on by as much from mesh to mesh; and one that ends."""

    def meshes_of(order: float) -> list[int]:
        tried: list[int] = []

        def run(static: Any, meshes: Any, inputs: Any, start: Any, **options: Any) -> Any:
            del static, inputs, options
            tried.append(meshes.whole.counts[0])
            levels = range(int(np.log2(tried[-1])))
            return _answer(start, pressure=sum((0.5**order) ** k for k in levels))

        monkeypatch.setattr(choice, "run_program", run)
        monkeypatch.setattr(choice, "carried", lambda *args: None)
        choice.choose(with_solve(scene(body(20, 2.0)), model="shell"), once=True)
        return tried

    assert max(meshes_of(0.5)) == 64
    assert max(meshes_of(1.0)) == 512


def test_travels_are_found_from_forces() -> None:
    """Two bodies that feel each other, by a stand-in for the solve."""
    spec = scene(*(_by_force(angle, 1.0) for angle in (-30, 30)))
    inputs = {"load.0.force": np.asarray(3.0), "load.1.force": np.asarray(20.0)}
    runs = []

    def run(inputs: Any, start: Any) -> Any:
        d = np.array([float(inputs[f"load.{i}.depth"]) for i in (0, 1)]) * 1e3
        force = 2 * d**1.7 * (1 + 0.1 * d[::-1])
        runs.append(d)
        loads = [
            {"force_N": np.array([f]), "depth_m": np.array([x])}
            for f, x in zip(force, d, strict=True)
        ]
        return {"loads": loads}, start, start, start, {"result": np.zeros(1)}

    report, *_ = under_forces(spec, inputs, START, run)
    found = [float(load["force_N"][0]) for load in report["loads"]]
    np.testing.assert_allclose(found, [3.0, 20.0], rtol=1e-10)
    assert len(runs) < 25


START = State(*[np.zeros(1)] * 3)


def test_a_step_that_leads_nowhere_is_not_tried_again_at_once() -> None:
    """By a stand-in of two bodies beside a wall, which is solved from near travels alone."""
    spec = scene(*(_by_force(angle, 1.0) for angle in (-30, 30)))
    inputs = {"load.0.force": np.asarray(15.0), "load.1.force": np.asarray(20.0)}
    known, runs = [np.zeros(2)], []

    def run(inputs: Any, start: Any) -> Any:
        depth = np.array([1e3 * float(inputs[f"load.{i}.depth"]) for i in (0, 1)])
        pressed = depth + 0.15 * depth[::-1]
        force = 2 * pressed**1.7 + 50 * np.maximum(pressed - 1.5, 0) ** 1.5
        lost = depth.max() > 1 and np.abs(depth - known[0]).max() > 0.3
        runs.append(lost)
        if not lost:
            known[0] = depth
        rows = zip(force[:, None], depth[:, None] / 1e3, strict=True)
        loads = [{"force_N": f, "depth_m": d} for f, d in rows]
        result = np.array([index_of("no_convergence") * lost])
        return {"loads": loads}, start, start, start, {"result": result}

    report, *_, outcome = under_forces(spec, inputs, START, run)
    assert outcome["result"][0] == 0
    found = [load["force_N"][0] for load in report["loads"]]
    np.testing.assert_allclose(found, [15.0, 20.0], rtol=1e-10)
    assert sum(runs) < 8  # 16 if each run were followed by as long a step as the first
    assert len(runs) < 25


def _searched(
    force: float,
    answer: Callable[[float], tuple[float, str]],  # force [N] and result at a depth [mm]
    told: Callable[[float], dict[str, Any]] = lambda depth: {},  # what else is reported
    depth: float | None = None,  # to begin with [m]
    **options: Any,
) -> tuple[dict[str, Any], str, list[float]]:
    """A force's travel by a stand-in for the solve: report, result, depths tried [mm]."""
    inputs, runs = {"load.0.force": np.asarray(force)}, []
    if depth is not None:
        inputs["load.0.depth"] = np.asarray(depth)

    def run(inputs: Any, start: Any) -> Any:
        runs.append(1e3 * float(inputs["load.0.depth"]))
        carried, result = answer(runs[-1])
        load = {"force_N": np.array([carried]), "depth_m": np.array([runs[-1] / 1e3])}
        report = {"loads": [load], **told(runs[-1])}
        return report, start, start, start, {"result": np.array([index_of(result)])}

    spec = scene(_by_force(20, 2.0))
    report, *_, outcome = under_forces(spec, inputs, START, run, **options)
    return report, NAMES[int(outcome["result"][0])], runs


@pytest.mark.parametrize("force", [0.3, 1e-4, 0.0])
def test_a_body_that_the_skin_comes_out_to_meet_is_drawn_back(force: float) -> None:
    """By a stand-in whose skin bulges, so that a force is met before first touch."""
    bulge, tried, depth = 1.1, 0, None  # mm
    for _ in range(2):  # from first touch, and from the travel that was found
        report, result, runs = _searched(
            force, lambda x: (2 * max(x + bulge, 0.0) ** 1.2, "converged"), depth=depth
        )
        assert result == "converged"
        assert report["loads"][0]["force_N"][0] == pytest.approx(force, rel=1e-9)
        depth, tried = report["loads"][0]["depth_m"][0], tried + len(runs)
    assert tried < 50


def test_a_travel_is_found_between_no_touch_and_too_far() -> None:
    """By a stand-in that touches late and has no answer soon after: one step leads past."""
    touch, deepest = 0.5, 0.6  # mm

    def answer(depth: float) -> tuple[float, str]:
        if depth > deepest:
            return 0.0, "beyond_model"
        return 2 * max(depth - touch, 0.0), "converged"

    report, result, runs = _searched(0.01, answer)
    assert result == "converged"
    assert report["loads"][0]["force_N"][0] == pytest.approx(0.01, rel=1e-9)
    assert len(runs) < 25, runs


def test_bodies_that_press_the_skin_onto_one_another_are_found_together() -> None:
    """By a stand-in: 6 and 4 N need one of them beyond its first touch."""
    inputs = {f"load.{i}.force": np.asarray(force) for i, force in enumerate((6.0, 4.0))}
    runs = []

    def run(inputs: Any, start: Any) -> Any:
        depth = np.array([1e3 * float(inputs[f"load.{i}.depth"]) for i in range(2)])
        both, apart = depth.sum(), depth[0] - depth[1]
        runs.append(depth)
        forces = np.maximum(3.0 * both + 0.3 * apart * np.array([1.0, -1.0]), 0.0)
        rows = zip(forces[:, None], depth[:, None] / 1e3, strict=True)
        loads = [{"force_N": f, "depth_m": d} for f, d in rows]
        return {"loads": loads}, start, start, start, {"result": np.zeros(1)}

    spec = scene(_by_force(-20, 6.0), _by_force(20, 4.0))
    report, *_, outcome = under_forces(spec, inputs, START, run)
    assert outcome["result"][0] == 0
    told = [(load["force_N"][0], 1e3 * load["depth_m"][0]) for load in report["loads"]]
    sides = [(6.0, 5 / 6 + 5 / 3), (4.0, 5 / 6 - 5 / 3)]
    np.testing.assert_allclose(told, sides, rtol=1e-9)
    assert len(runs) < 100


def test_a_refined_solve_whose_first_run_fails_is_given_up() -> None:
    """Runs on the finest solid take minutes, and each of a dozen travels fails alike."""
    _, result, runs = _searched(2.0, lambda depth: (0.0, "no_convergence"), refined=True)
    assert result == "no_convergence"
    assert len(runs) == 1


def test_the_effect_of_what_a_shell_leaves_out_never_pulls_on_a_body() -> None:
    """A contact of 3 N of which the first order takes 1 N, 2 N, or 4 N away."""
    out = jnp.array([[0.0], [1.0]])
    frame, at = jnp.stack([out[::-1], out]), jnp.ones((1, 1, 1))

    def contact(q: Array, body: object) -> BodyContact:
        push = 3.0 - q[None, None]
        return BodyContact(at, 0 * at, -at, push, push * out[:, None, None], at)

    own: Any = SimpleNamespace(placed=lambda factor: own, friction=None, frame=frame)
    mechanics: Any = SimpleNamespace(
        corrected=True,
        touched=contact,
        pushed=lambda q, body, shift: jnp.sum(contact(q, body).force, (1, 2)),
        gap_shift=lambda q, body: None,
        per_width=False,
    )
    mechanics.bodies, mechanics.omitted_margin = (own,), 0.2
    mechanics.section = SimpleNamespace(size=jnp.zeros(1))
    skin = SimpleNamespace(geometry=SimpleNamespace(width=1.0))
    parts: Any = SimpleNamespace(skin=skin, forces=[], external_pressure=jnp.zeros(1))
    for taken, left, error in ((1.0, 2.0, 0.1), (2.0, 1.0, 0.4), (4.0, 0.0, 20.0)):
        root, shown = (State(jnp.full(1, q), *[jnp.ones(1)] * 2) for q in (0.0, taken))
        touch = corrected_touch(mechanics, own, shown, root)
        assert float(touch.force[1].sum()) == pytest.approx(left)
        report = {
            "oil_pressure_Pa": jnp.ones(1),
            "loads": [{"force_N": touch.force[1].sum((0, 1)), "depth_m": 1}],
        }
        known: Any = SimpleNamespace(mechanics=mechanics)
        found = error_by_bodies(parts, known, [contact(root.q, own)], report)
        assert float(found[0]) == pytest.approx(error)


def test_how_deep_a_skin_lies_in_a_body_is_part_of_the_error() -> None:
    """By two points, of 1 N at 1 um and 3 N at 2 um, under a travel of 0.1 mm."""
    deep, push = 1e-6 * jnp.array([1.0, 2.0]), jnp.array([1.0, 3.0])
    none, gap, pressure = (x[:, None, None] for x in (0 * deep, -deep, push))
    at = BodyContact(none, none, gap, pressure, none, jnp.ones((2, 1, 1)))
    own = SimpleNamespace(travel=jnp.full(1, 2e-4), drag=None)
    mechanics = SimpleNamespace(bodies=(own,))
    problem: Any = SimpleNamespace(mechanics=mechanics, prestressed=False)
    state, moved = State(jnp.zeros(1), jnp.zeros(1), jnp.full(1, 0.5)), jnp.full(1, 1e-3)
    for forces, size in (([], 1e-4), ([own], 1e-3)):
        parts: Any = SimpleNamespace(forces=forces, pressures=[])
        report = {"max_displacement_m": moved}
        found = error_by_penetration(parts, problem, state, [at], report)
        assert float(found["penetration_error"][0]) == pytest.approx(2 * 1.75e-6 / size)
    # In a skin at rest, between its points, or dragged off it.
    off = at._replace(gap=-gap, pressure=0 * gap)
    for drag, error in ((None, 2 * (1 + 1e-2)), (jnp.zeros((2, 1)), 0.0)):
        own.drag, parts.forces = drag, []
        found = error_by_penetration(parts, problem, state, [off], report)
        assert float(found["penetration_error"][0]) == pytest.approx(error)


def test_a_force_that_no_travel_carries_is_given_up_soon() -> None:
    """By a stand-in that is squeezed at a travel before it carries the force."""
    deepest, carried = 3.007, 1.961

    def answer(depth: float) -> tuple[float, str]:
        result = "squeezed" if depth > deepest else "converged"
        return carried * (depth / deepest) ** 2.2, result

    report, result, runs = _searched(2.0, answer)
    assert result == "squeezed"
    # Still the travel before which the skin holds.
    assert report["loads"][0]["depth_m"][0] * 1e3 == pytest.approx(deepest, rel=1e-3)
    assert len(runs) < 35


@pytest.mark.parametrize(("force", "passed"), [(2.0, True), (0.5, False)])
def test_a_search_without_the_wall_ends_where_the_face_passes_it(
    force: float, passed: bool
) -> None:
    """By a stand-in whose face lies in the wall from 1 mm and 1 N on, see `until_wall`."""
    report, _, runs = _searched(
        force,
        lambda depth: (depth, "converged"),
        lambda depth: {"wall_contact": np.array([depth >= 1])},
        until_wall=True,
    )
    assert bool(report["wall_contact"][0]) is passed
    assert sum(depth >= 1 for depth in runs[:-1]) == 0
    if not passed:
        assert report["loads"][0]["force_N"][0] == pytest.approx(force, rel=1e-9)


def test_a_travel_is_found_where_the_wall_takes_the_force() -> None:
    """By a stand-in whose force grows a hundred times faster from a travel on."""
    touch = 3.0266

    def answer(depth: float) -> tuple[float, str]:
        return 1.98 * (depth / touch) ** 2.5 + 400 * max(depth - touch, 0.0), "converged"

    report, result, runs = _searched(2.0, answer)
    assert result == "converged"
    assert abs(report["loads"][0]["force_N"][0] / 2.0 - 1) < 1e-9
    assert len(runs) < 25, runs


@pytest.mark.parametrize(
    ("turn", "grip", "lean"),
    [(0.0, 8.0, 0.0), (0.5, 8.0, 0.0), (1.5, 40.0, 0.0), (0.5, 40.0, 0.5)],
    ids=["at the crown", "on a slope", "slid there", "softer as it is dragged"],
)
def test_drags_are_found_from_tangential_forces(turn: float, grip: float, lean: float) -> None:
    """By a stand-in that sticks and then slides; more than it holds has a name.

    On a slope the travel itself drags, until all points slide: a little drag changes nothing.
    """

    def solved(across: float) -> Any:
        table = _by_force(0, 5.0) | {"tangential_force": f"{across!r} N", "friction": 0.3}
        spec = scene(table)

        def run(inputs: Any, start: Any) -> Any:
            depth, drag = (1e3 * float(inputs[f"load.0.{key}"]) for key in ("depth", "drag"))
            share = 0.3 * np.tanh(grip * (drag + turn * (depth - 1)))
            force = 2 * depth**1.7 * (1 - lean * share)
            along = share * force
            values = {"force_N": force, "tangential_force_N": along}
            values |= {"depth_m": depth / 1e3, "drag_m": drag / 1e3}
            load = {key: np.array([x]) for key, x in values.items()}
            return {"loads": [load]}, start, start, start, {"result": np.zeros(1)}

        inputs = {k: np.asarray(v) for k, v in continuous_inputs(spec).items()}
        return under_forces(spec, inputs, START, run)

    for wanted in (-1.2, -0.3):
        report, *_, outcome = solved(wanted)
        assert outcome["result"][0] == 0
        (load,) = report["loads"]
        assert abs(load["force_N"][0] / 5 - 1) < 1e-9
        assert abs(load["tangential_force_N"][0] / wanted - 1) < 1e-9
    outcome = solved(2.0)[-1]
    assert outcome["result"][0] == index_of("sliding")


def test_drags_are_found_where_points_turn_one_by_one() -> None:
    """By a stand-in of a ball on a pad, whose points have slid outward as it came in."""
    table = {"kind": "body", "shape": "sphere", "radius": "8 mm", "angle": "20 deg"}
    pulls = {"tangential_force": "0.02 N", "tangential_force_axial": "0.01 N"}
    spec = pad_scene(table | pulls | {"force": "0.1 N", "friction": 0.3, "axial": "5 mm"})
    offset = np.array([[20.0, 3.0], [-11.0, 15.0], [4.0, -14.0], [-16.0, -5.0]])  # [um]

    def run(inputs: Any, start: Any) -> Any:
        keys = ("depth", "drag", "drag_axial")
        depth, *drag = (1e6 * float(inputs[f"load.0.{key}"]) for key in keys)
        force, slip = 0.06 * (depth / 1e3) ** 1.7, drag + offset * (depth / 1e3)
        size = np.sqrt((slip**2).sum(1, keepdims=True) + 1.5**2)
        along, across = 0.3 * force * (slip / size).mean(0)
        values = {"force_N": force, "depth_m": depth / 1e6}
        values |= {"tangential_force_N": along, "drag_m": drag[0] / 1e6}
        values |= {"tangential_force_axial_N": across, "drag_axial_m": drag[1] / 1e6}
        load = {key: np.array([x]) for key, x in values.items()}
        return {"loads": [load]}, start, start, start, {"result": np.zeros(1)}

    inputs = {k: np.asarray(v) for k, v in continuous_inputs(spec).items()}
    report, *_, outcome = under_forces(spec, inputs, START, run)
    assert outcome["result"][0] == 0
    (load,) = report["loads"]
    for key, wanted in (("", 0.02), ("_axial", 0.01)):
        assert abs(load[f"tangential_force{key}_N"][0] - wanted) < 1e-10


def test_a_finer_mesh_goes_on_with_what_a_coarser_one_told_of_travels() -> None:
    """By stand-ins a little softer than one another whose states are the travels themselves."""
    table = _by_force(0, 5.0) | {"tangential_force": "0.6 N", "friction": 0.3}
    spec = scene(table)
    inputs = {k: np.asarray(v) for k, v in continuous_inputs(spec).items()}
    tried, slopes, counts = [], None, []
    for stiffness in (2.0, 1.9):

        def run(inputs: Any, start: State, stiffness: float = stiffness) -> Any:
            depth, drag = (1e3 * float(inputs[f"load.0.{key}"]) for key in ("depth", "drag"))
            force = stiffness * depth**1.7
            along = 0.3 * force * np.tanh(8.0 * (drag + 0.2 * (depth - 1)))
            values = {"force_N": force, "tangential_force_N": along}
            values |= {"depth_m": depth / 1e3, "drag_m": drag / 1e3}
            load = {key: np.array([x]) for key, x in values.items()}
            tried.append((np.array([depth, drag]), start))
            found = State(tried[-1][0], *[np.ones(1)] * 2)
            return {"loads": [load]}, found, found, found, {"result": np.zeros(1)}

        tried.clear()
        report, *_, outcome = under_forces(spec, inputs, START, run, slopes=slopes)
        (load,), slopes = report["loads"], outcome["slopes"]
        assert abs(load["force_N"][0] / 5 - 1) < 1e-9
        assert abs(load["tangential_force_N"][0] / 0.6 - 1) < 1e-9
        inputs |= {f"load.0.{key}": load[f"{key}_m"][0] for key in ("depth", "drag")}
        counts.append(len(tried))
    assert counts[1] <= 7 < counts[0]
    for travels, start in tried[4:]:  # on the plane through the last three, where they span one
        assert start.q == pytest.approx(travels, rel=1e-3)
        assert start.factor[0] == pytest.approx(1, rel=1e-3)


def _by_force(angle: float, force: float) -> dict[str, Any]:
    table = body(angle, 0.0) | {"force": f"{force!r} N"}
    return {key: value for key, value in table.items() if key != "depth"}


def test_a_gradient_s_error_under_bodies_is_told_by_the_coarser_mesh(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By a stand-in whose force grows a tenth faster there, along each input alike."""
    from suas_jax.scene import gradient

    spec = scene(body(20, 2.0))
    known = continuous_inputs(spec)
    meshes = [SimpleNamespace(counts=(count,)) for count in (32, 64)]

    def report_with(_: Any, inputs: Any, *, judged: bool) -> Any:
        moved = sum(inputs[key] / value - 1 for key, value in known.items() if value)
        return {"oil_pressure_Pa": 3.0 + (2.0 if judged else 2.2) * moved}

    def stated(coarsest: Any) -> float | None:
        solution: Any = SimpleNamespace(
            scene=spec,
            plan=meshes[1],
            coarsest=SimpleNamespace(plan=coarsest),
            report={"model_error": 0.01},
        )
        return gradient.gradient_error_estimate(solution, "oil_pressure_Pa")

    monkeypatch.setattr(gradient, "report_with", report_with)
    assert stated(meshes[0]) == pytest.approx(0.01 + 2 / 3 * 0.1)
    assert stated(meshes[1]) is None


@pytest.mark.long  # programs of a scene by force; the search is in the test before
def test_travel_from_force_inverts_force_from_travel() -> None:
    known = on_the_crown(2.0)
    force = known.report["loads"][0]["force_N"]
    other = solve(with_solve(scene(_by_force(0, force)), model="shell", elements=32))
    load = other.report["loads"][0]
    assert abs(load["depth_m"] / 2e-3 - 1) < 1e-8
    assert abs(load["force_N"] / force - 1) < 1e-10
    assert other.report["error_estimate"] == pytest.approx(known.report["error_estimate"], 1e-6)


@pytest.mark.long  # a program of derivatives
def test_derivatives_of_the_force_are_those_of_differences() -> None:
    from suas_jax.scene.gradient import gradient

    spec = with_solve(scene(body(30, 2.0)), model="shell", elements=64)
    solution = solve(spec)
    slopes = gradient(solution, "loads.0.force_N")
    inputs = continuous_inputs(spec)
    for path in ("load.0.radius", "load.0.angle", "load.0.depth", "geometry.thickness"):
        step = 1e-3 * inputs[path]  # the radius hardly matters: less is rounding of the force
        # On its own mesh: that of another solve follows what is touched there.
        low, high = (
            report_with(solution, {path: inputs[path] + s * step}, judged=True) for s in (-1, 1)
        )
        assert low is not None
        assert high is not None
        difference = (high["loads"][0]["force_N"] - low["loads"][0]["force_N"]) / (2 * step)
        assert abs(slopes[path] / difference - 1) < 1e-4
    (row,) = (r for r in references(30) if r["d_m"] == 2e-3)
    tilt = row["force_tangential_N"] / row["force_radial_N"]
    load = solution.report["loads"][0]
    assert abs(load["tangential_force_N"] / load["force_N"] / tilt - 1) < 0.02


def _lane(*numbers: float) -> list[Array]:
    return [jnp.full(1, x) for x in numbers]


SHAPES: list[AbstractShape] = [
    Round(*_lane(0.01), endless=True),
    Round(*_lane(0.01), False, *_lane(0.02)),
    Round(*_lane(0.01), endless=False),
    Wedge(*_lane(0.002, 1.2)),
    Box((jnp.full(1, 0.02), jnp.full(1, 0.03)), jnp.full(1, 0.004)),
    Plate(),
]


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
def test_a_shape_is_a_distance_from_its_surface(shape: AbstractShape) -> None:
    """Zero on the surface, one per length away from it, along one normal without a kink."""
    random = np.random.default_rng(0)
    across = jnp.asarray(random.uniform(-0.009, 0.009, (2, 200, 1)))
    height = shape.height(across)
    inside = jnp.isfinite(height)
    surface = jnp.concatenate([across, jnp.where(inside, height, 0.0)[None]])
    np.testing.assert_allclose(jnp.where(inside, shape.distance(surface), 0.0), 0, atol=1e-16)

    def normal(place: Array) -> Array:
        return jax.grad(lambda x: jnp.sum(shape.distance(x)))(place)

    out = normal(surface)
    size = jnp.sqrt(jnp.sum(out**2, 0))
    np.testing.assert_allclose(jnp.where(inside, size, 1.0), 1, rtol=1e-12)
    away = surface + 1e-3 * out
    np.testing.assert_allclose(jnp.where(inside, shape.distance(away), 1e-3), 1e-3, rtol=1e-9)
    assert float(shape.distance(jnp.zeros((3, 1)))[0]) == 0


def test_first_touch_lies_beside_the_ray_where_the_skin_is_hollow() -> None:
    """A plate over a hollow crown rests on its shoulders, a slim body goes in between them."""
    points = [[-0.05, 0.0], [-0.03, 0.03], [0.0, 0.025], [0.03, 0.03], [0.05, 0.0]]
    texts = [[f"{x!r} m", f"{y!r} m"] for x, y in points]
    geometry = {"section": "spline", "points": texts}

    def rise(**shape: Any) -> float:
        table = {"kind": "body", "arc": "0 mm", "depth": "1 mm", **shape}
        spec = shaped(geometry, table, material=EPDM)

        @quick
        def over_crown(inputs: dict[str, Any]) -> Array:
            parts, crown = scene_parts(spec, inputs), jnp.zeros(1)
            section = parts.skin.geometry.section
            face = section.mid_line(crown)[1] + section.thickness(crown) / 2
            return parts.bodies[0].origin[1] - face

        return float(over_crown(continuous_inputs(spec))[0])

    assert rise(**PLATE) > 4e-3
    assert abs(rise(shape="cylinder", radius="2 mm")) < 1e-9


@pytest.mark.parametrize(
    "shape",
    [
        {"shape": "box", "size": ["25 mm", "15 mm"], "turn": "45 deg"},
        {"shape": "cylinder", "radius": "3 mm", "length": "30 mm", "turn": "60 deg"},
    ],
)
def test_a_turned_body_touches_a_hollow_pad_where_its_travel_begins(
    shape: dict[str, Any],
) -> None:
    """With a corner or an end; it stood 0.07 mm off the skin, 0.09 mm in it at other places."""
    points = [["-50 mm", "0 mm"], ["-30 mm", "30 mm"], ["0 mm", "25 mm"]]
    points += [["30 mm", "30 mm"], ["50 mm", "0 mm"]]
    geometry = {"section": "spline", "points": points, "ends": "clamped"}
    table = {"kind": "body", "arc": "0 mm", "depth": "1 mm", **shape}
    spec = shaped(geometry, table, material=EPDM)

    @quick
    def deepest(inputs: dict[str, Any]) -> Array:
        parts = scene_parts(spec, inputs)
        section, over = parts.skin.geometry.section, parts.bodies[0]
        angle, axial = jnp.meshgrid(
            jnp.linspace(-0.5, 0.5, 801), jnp.linspace(-2e-2, 2e-2, 801)
        )
        places = angle.reshape(-1, 1) * section.half_angle
        face = section.mid_line(places) + section.thickness(places) / 2 * outward(
            section.direction(places)
        )
        return jnp.min(over.placed(0.0).gap(jnp.stack([*face, axial.reshape(-1, 1)])))

    assert abs(float(deepest(continuous_inputs(spec)))) < 2e-6


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"shape": "sphere"}, "load.0.shape"),
        ({"radius": None}, "load.0.radius"),
        ({"force": "3 N"}, "load.0.depth"),
        ({"depth": None}, "load.0.depth"),
        ({"friction": -0.3}, "load.0.friction"),
        ({"tangential_force": "1 N"}, "load.0.tangential_force"),
        ({"drag": "1 mm", "tangential_force": "1 N", "friction": 0.3}, "load.0.drag"),
        ({"drag_axial": "1 mm"}, "load.0.drag_axial"),
        ({"turn": "10 deg"}, "load.0.turn"),
        ({"opening": "60 deg"}, "load.0.opening"),
        ({"angle": "95 deg"}, "load.0.angle"),
        ({"depht": "1 mm"}, "load.0.depht"),
    ],
)
def test_what_is_no_body_is_refused_by_its_key(changes: dict[str, Any], key: str) -> None:
    table = body(30, 1.0) | changes
    table = {k: v for k, v in table.items() if v is not None}
    with pytest.raises(ConfigError) as caught:
        scene(table)
    assert [mistake.key for mistake in caught.value.mistakes] == [key]


def test_what_knows_dead_forces_alone_says_so() -> None:
    with pytest.raises(ValueError, match="dead forces"):
        loads_of(scene(body(0, 1.0)))
    with pytest.raises(ConfigError, match="own depth"):
        scene(body(0, 1.0), oil_pressure=1e3)
    assert isinstance(scene(body(0, 1.0)).loads[0], BodyLoadSpec)


@pytest.mark.long  # a curve on a pad
def test_a_pad_stores_what_a_ball_does_on_it() -> None:
    """To a few per cent: kinks of the first-order correction are no strains."""
    spec = pad_scene(body(0, 1.0, shape="sphere", radius="10 mm"))
    spec = with_solve(spec, model="shell")
    points = sweep(spec, depths=np.linspace(0, 1e-3, 9).tolist()).points
    depth, force = np.array(
        [[p["loads"][0][k] for k in ("depth_m", "force_N")] for p in points]
    ).T
    work = np.sum((force[1:] + force[:-1]) / 2 * np.diff(depth))
    assert points[-1]["strain_energy_J"] == pytest.approx(work, rel=0.03)


@pytest.mark.parametrize(("along", "across", "told"), [(40, 40, True), (40, 20, False)])
def test_a_zone_on_a_pad_is_resolved_by_points_along_arc_and_axis(
    along: int, across: int, told: bool
) -> None:
    """Any number of points along one of them do not tell how wide it is."""
    rows, columns = np.ogrid[-30:30, -30:30]
    inside = (2 * rows / along) ** 2 + (2 * columns / across) ** 2 < 1
    gap = jnp.asarray(np.where(inside, -1e-6, 1e-6))[..., None]
    vector, none = jnp.zeros((3, *gap.shape)), jnp.zeros_like(gap)
    contact = BodyContact(none, vector, gap, none, vector, none, axial=none)
    assert bool(_resolved(contact)[0]) is told
