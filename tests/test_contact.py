"""The wall holds the membrane: against an independent solution, and by its own laws.

tests/data/contact2d.csv: finite elements (FElupe, Taylor-Hood, three graded meshes) with the
exact conditions of contact at the nodes, checked there with an augmented Lagrangian and with
CalculiX; its header says how well.
"""

import dataclasses
from functools import partial
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from skins import GEOMETRY, WIDTH, find, line, problem_of, quick, reference_rows, scene

from suas_jax.config import (
    ConfigError,
    SceneSpec,
    continuous_inputs,
    scene_from_dict,
    with_inputs,
    with_solve,
)
from suas_jax.equilibrium.balance import Problem, State
from suas_jax.equilibrium.correction import corrected_contact
from suas_jax.equilibrium.equilibrium import equilibrium, smallest_gap
from suas_jax.equilibrium.equilibrium_path import path
from suas_jax.mechanics.contact.face import ContactState, contact_pressure
from suas_jax.scene import assessment
from suas_jax.scene.contact_zone import contact_zone
from suas_jax.scene.forward import forward
from suas_jax.scene.loads import Loads
from suas_jax.scene.observables import short_circuits
from suas_jax.scene.parts import skin_parts
from suas_jax.scene.report import wall_force_error
from suas_jax.scene.skin import Skin, skin_of
from suas_jax.scene.solve import Solution, solve
from suas_jax.skin.wall import RigidLimit, SoftLayer, Wall

SHELL, SOLID = (32, 0), (128, 2)
LAYER = {"thickness": "0.5 mm", "stiffness": "2 MPa"}


def references() -> dict[str, dict[str, float]]:
    rows = reference_rows("contact2d.csv")
    return {f"{row['case']} {row['force_N']}": _numbers(row) for row in rows}


def _numbers(row: dict[str, str]) -> dict[str, float]:
    return {k: float(v) for k, v in row.items() if v and k not in ("case", "target", "law")}


def wall_of(spec: SceneSpec) -> Wall:
    wall = skin_parts(spec, continuous_inputs(spec)).wall
    assert wall is not None
    return wall


def held(spec: SceneSpec, mesh: tuple[int, int], **more: Any) -> Problem:
    """The discrete problem with the wall."""
    problem = problem_of(spec, *mesh, **more)
    mechanics = problem.mechanics.with_wall(wall_of(spec))
    return dataclasses.replace(problem, mechanics=mechanics)


@quick
def contact_of(problem: Problem, state: State) -> ContactState:
    assert problem.mechanics.wall is not None
    return problem.mechanics.contact(state.q, problem.mechanics.wall)


def wall_report(spec: SceneSpec, contact: ContactState) -> dict[str, Any]:
    geometry = skin_parts(spec, continuous_inputs(spec)).geometry
    return jax.tree.map(lambda x: float(x[0]), contact_zone(contact, geometry))


def pressed(case: str, force: float) -> SceneSpec:
    return scene(line(0 if case == "A" else 45, force))


@pytest.mark.parametrize("mesh", [SHELL, SOLID])
@pytest.mark.parametrize("case", ["A 90", "A 120", "A 240", "B 40", "B 50", "B 80"])
def test_the_reference_is_met(case: str, mesh: tuple[int, int]) -> None:
    expected = references()[case]
    spec = pressed(case[0], expected["force_N"])
    problem = held(spec, mesh)
    found = find(problem)
    assert found.result[0] == 0
    contact = contact_of(problem, found.state)
    wall = wall_report(spec, contact)
    tolerance = 1e-2 if mesh == SHELL else 2e-3
    pressure, load = expected["oil_pressure_Pa"], expected["force_N"]
    assert abs(found.state.pressure[0] / pressure - 1) < tolerance
    assert abs(wall["force_N"] - expected["contact_force_N"]) < tolerance * load
    if mesh == SOLID:
        ends = [expected["contact_from_deg"], expected["contact_to_deg"]]
        np.testing.assert_allclose(wall["angle_deg"], ends, atol=0.2)
        angle = jnp.array([expected["load_angle_deg"]]) * np.pi / 180
        inner = problem.mechanics.at_angle(found.state.q, angle).inner_displacement[:, 0, 0, 0]
        inward = -np.array([np.sin(angle[0]), np.cos(angle[0])])
        moved = expected["inner_displacement_along_load_m"]
        assert abs(float(inward @ inner) / moved - 1) < 2e-3
    # What is left of the rigid limit: far below the gap of 5 mm.
    assert -1e-6 < float(contact.gap.min()) < 0


@partial(quick)
def consistency(problem: Problem, state: State, direction: Array) -> tuple[Array, ...]:
    mechanics, (q, p, f) = problem.mechanics, state
    assembled = mechanics.assemble(q, p, f)
    gradient = jax.grad(lambda q: jnp.sum(mechanics.potential(q, p, f)))(q)
    ahead, behind = (mechanics.assemble(q + s * direction, p, f).residual for s in (1, -1))
    return (
        assembled.residual,
        gradient,
        assembled.tangent.mv(direction),
        (ahead - behind) / 2,
        mechanics.contact_energy(q),
    )


# The meshes of the references: states are found by the same programs.
@pytest.mark.parametrize(
    ("mesh", "layer"),
    [
        (SHELL, LAYER),
        (SOLID, None),
        pytest.param(SHELL, None, marks=pytest.mark.long),
        pytest.param(SOLID, LAYER, marks=pytest.mark.long),
    ],
)
def test_force_and_stiffness_are_derivatives_of_the_energy(
    mesh: tuple[int, int], layer: dict[str, str] | None
) -> None:
    spec = scene(line(20, 120))
    if layer is not None:
        spec = with_layer(spec, **layer)
    problem = held(spec, mesh)
    state = find(problem).state
    rng = np.random.default_rng(0)
    direction = 1e-10 * rng.standard_normal(state.q.shape)
    direction[:, [0, -1]] = 0
    if mesh[1]:
        direction[2 * (2 * mesh[1] + 1) :] = 0  # pressures and nodes between stations
    # Pressed a little further on, where nothing is in balance.
    state = state._replace(q=state.q * 1.0001)
    residual, gradient, product, difference, energy = consistency(
        problem, state, jnp.asarray(direction)
    )
    inner = (slice(None), slice(1, -1))
    assert energy[0] > 0
    size = float(jnp.abs(residual[inner]).max())
    np.testing.assert_allclose(residual[inner], gradient[inner], atol=1e-10 * size)
    size = float(jnp.abs(product[inner]).max())
    np.testing.assert_allclose(product[inner], difference[inner], atol=1e-6 * size)


def test_every_element_that_touches_pushes() -> None:
    """Few are worked out at a time: here more than that touch."""
    problem = held(scene(line(20, 30)), SHELL)
    pad, factor = problem.mechanics, jnp.ones(1)
    pressed = find(dataclasses.replace(problem, mechanics=pad.with_wall(None))).state
    q, assemble = 40 * pressed.q, quick(type(pad).assemble)
    assert int(jnp.sum(jnp.any(pad.contact(q, pad.wall).gap < 0, 0))) > 4
    there = assemble(pad, q, pressed.pressure, factor)
    force, volume = quick(type(pad).imbalance)(pad, q, pressed.pressure, factor)
    free = assemble(pad.with_wall(None), q, pressed.pressure, factor)
    size = float(jnp.abs(force - free.residual).max())
    assert size > 0
    np.testing.assert_allclose(there.residual, force, atol=1e-12 * size)
    np.testing.assert_allclose(there.volume_change, volume, rtol=1e-13)


def with_layer(spec: SceneSpec, thickness: str, stiffness: str) -> SceneSpec:
    table = spec.model_dump(exclude_unset=True, by_alias=True)
    return SceneSpec(**table, wall={"layer": {"thickness": thickness, "stiffness": stiffness}})


def test_a_soft_layer_pushes_by_its_strain() -> None:
    thickness, stiffness = jnp.array([5e-4]), jnp.array([2e6])
    rigid = RigidLimit.of(jnp.array([32.6e6]), jnp.array([1.5e-3]))
    layer = SoftLayer(thickness, stiffness, rigid)
    strain = np.array([0.1, 0.5, 0.9])[:, None]
    pressure = contact_pressure(layer, -strain * thickness)
    np.testing.assert_allclose(pressure, stiffness * strain, rtol=6e-3)
    # Beneath it the rigid wall: no more than its stiffness lets through.
    assert contact_pressure(layer, -1.01 * thickness)[0] > 10 * stiffness[0]


def test_laws_say_nothing_while_the_gap_is_open() -> None:
    rigid = RigidLimit.of(jnp.array([32.6e6]), jnp.array([1.5e-3]))
    for law in (rigid, SoftLayer(jnp.array([5e-4]), jnp.array([2e6]), rigid)):
        gap = jnp.array([[1e-3], [1e-9], [0.0]])
        assert not law.energy(gap).any()
        assert not contact_pressure(law, gap).any()


def test_a_stiff_layer_is_a_rigid_wall_and_a_soft_one_gives_way() -> None:
    spec = pressed("B", 60.0)
    rigid = find(held(spec, SHELL))
    results = []
    for stiffness in ("2 MPa", "2000 MPa"):
        layered = with_layer(spec, "0.5 mm", stiffness)
        problem = held(layered, SHELL)
        found = find(problem)
        assert found.result[0] == 0
        gap = smallest_gap(problem.mechanics, found.state.q, wall_of(layered))
        results.append((float(found.state.pressure[0]), float(gap[0])))
    (soft, soft_gap), (stiff, stiff_gap) = results
    assert abs(stiff / float(rigid.state.pressure[0]) - 1) < 1e-3
    assert soft > stiff  # the oil goes on taking load while the layer gives way
    assert -5e-4 < soft_gap < 10 * stiff_gap < 0


@partial(quick)
def along(problem: Problem, levels: Array) -> Any:
    return path(problem, levels)


def test_the_wall_pushes_even_where_what_a_shell_leaves_out_lifts_the_membrane() -> None:
    """Contacts of two points: the first order lifts both, or one, off a wall of 1 Pa/m."""
    gap = jnp.array([[[-1.0, -4.0]], [[0.5, -1.0]]])  # [point, element, lane] [m]

    def contact(q: Array, wall: object) -> ContactState:
        seen, ones = gap + q, jnp.ones_like(gap)
        return ContactState(ones, ones, seen, jnp.maximum(-seen, 0.0), ones)

    mechanics: Any = SimpleNamespace(wall=object(), corrected=True, contact=contact)
    root, shown = (State(jnp.full(2, q), *[jnp.zeros(2)] * 2) for q in (0.0, 2.0))
    found = corrected_contact(mechanics, shown, root)
    carried = jnp.sum(found.area * found.pressure, (0, 1))
    # Of what stays in contact the points add up to what balances the other forces.
    np.testing.assert_allclose(carried, [0.0, (4 - 2) + (1 - 2)])


@pytest.mark.long  # the program of a path; from rest in the references above
def test_lift_off_leads_back_along_the_same_curve() -> None:
    problem = held(pressed("B", 100.0), SHELL)
    levels = [0.2, 0.39, 0.6, 1.9, 0.6, 0.39, 0.2]
    found = along(problem, jnp.array(levels))
    assert not np.any(found.result)
    pressure = np.asarray(found.state.pressure)[:, 0]
    np.testing.assert_allclose(pressure[:3], pressure[:3:-1], rtol=1e-9)
    # Straight from rest, and from a state in contact: no memory of the way.
    straight = find(problem)
    np.testing.assert_allclose(
        straight.state.pressure, found_at(problem, found.state, 3), rtol=1e-9
    )
    assert pressure[3] < pressure[2]  # the wall takes the load


def found_at(problem: Problem, states: State, k: int) -> Array:
    """Oil pressure at full load, from one of the states of a path."""
    start = jax.tree.map(lambda x: x[k], states)
    return near(problem, start).state.pressure


@partial(quick)
def near(problem: Problem, start: State) -> Any:
    return equilibrium(problem, start)


@pytest.mark.long  # two programs; force and stiffness above, test_gradients
def test_derivatives_are_those_of_the_solution_in_contact() -> None:
    def quantities(force: Array, angle: Array) -> Array:
        spec = pressed("B", 60.0)
        skin = skin_parts(spec, continuous_inputs(spec))
        problem = _problem(skin, Loads.line(angle, force))
        state = equilibrium(problem).state
        contact = problem.mechanics.contact(state.q, problem.mechanics.wall)
        wall = contact_zone(contact, skin.geometry)
        return jnp.stack([state.pressure[0] / 1e4, wall["force_N"][0] / 10])

    at = (jnp.array(60.0), jnp.array(np.deg2rad(44.0)))
    run = quick(quantities)
    exact = quick(jax.jacfwd(quantities, (0, 1)))(*at)
    for i, step in enumerate((1e-3, 3e-7)):
        shifted = [[x + s * step * (i == k) for k, x in enumerate(at)] for s in (1, -1)]
        difference = (run(*shifted[0]) - run(*shifted[1])) / (2 * step)
        np.testing.assert_allclose(exact[i], difference, rtol=1e-3, atol=1e-7)


def _problem(skin: Any, loads: Loads) -> Problem:
    """A shell on an even mesh that loads slide over."""
    return Skin(skin.geometry, skin.law, skin.oil, skin.electrodes, skin.wall).problem(loads)


TAXELS = {
    "taxels": [{"angle": f"{a} deg", "diameter": "4 mm"} for a in (-40, 0, 43.4)],
    "lsb": "0.305 fF",
}


def sensing(layers: list[dict[str, Any]], contact: bool = True) -> SceneSpec:
    base = scene(line(45, 60), oil={"model": "incompressible", "relative_permittivity": 2.2})
    table = base.model_dump(exclude_unset=True, by_alias=True)
    electrodes = TAXELS | {"layers": layers}
    return SceneSpec(**table, electrodes=electrodes, wall={"contact": contact})


@pytest.fixture(scope="module")
def in_contact() -> Solution:
    layers = [{"thickness": "50 um", "relative_permittivity": 3.3}]
    return solve(with_solve(sensing(layers), model="shell", elements=SHELL[0]))


@pytest.mark.long  # two whole programs; the zone and the force in the references above
def test_a_scene_at_the_wall_reports_it(in_contact: Solution) -> None:
    report = in_contact.report
    assert report["status"] == "converged"
    assert in_contact.wall
    assert report["wall_contact"]
    assert abs(report["min_gap_m"]) <= report["gap_tolerance_m"] < 5e-6
    wall = report["wall"]
    assert 20 < wall["force_N"] < 25
    assert wall["axial_m"] == [-WIDTH / 2, WIDTH / 2]
    assert wall["angle_deg"][0] < report["min_gap_angle_deg"] < wall["angle_deg"][1]
    extent = np.deg2rad(wall["angle_deg"][1] - wall["angle_deg"][0]) * 0.0525 * WIDTH
    np.testing.assert_allclose(wall["area_m2"], extent, rtol=1e-9)


@pytest.mark.long  # as above; layers in test_sensing
def test_a_taxel_in_contact_keeps_its_series_layers(in_contact: Solution) -> None:
    far, _, under = in_contact.report["taxels"]
    plate = 8.8541878188e-12 * np.pi * 2e-3**2 / (50e-6 / 3.3)
    # The film is gone at the middle of the electrode only: less than the layers alone.
    assert 0.2 * plate < under["capacitance_F"] < plate
    assert under["so"] < 65535
    assert far["so"] < 200


def test_between_closed_points_of_the_wall_a_taxel_without_layers_has_no_reading() -> None:
    """A film of 18 nm, where the face is known to 4 um, read 24 million counts."""
    gap = jnp.array([[1.8e-8], [0.0], [4.1e-6], [4.3e-6], [5e-3]])
    farads = 1e-16 / gap
    found = short_circuits(
        {"gap_m": gap, "capacitance_F": farads, "so": farads / 3e-16}, jnp.array([4.2e-6])
    )
    for name in ("capacitance_F", "so"):
        np.testing.assert_array_equal(
            np.isnan(found[name])[:, 0], [True, True, True, False, False]
        )
    np.testing.assert_array_equal(found["capacitance_F"][3:], farads[3:])
    np.testing.assert_array_equal(found["gap_m"], gap)


@pytest.mark.long  # programs of both models
def test_where_the_shell_does_not_meet_rtol_at_the_wall_the_solid_does() -> None:
    expected = references()["A 90"]
    spec = with_solve(pressed("A", 90.0), model="auto", rtol=2e-3)
    report = solve(spec).report
    assert "Solid chosen: the corrected shell's model error" in report["message"]
    assert report["model"] == "solid"
    assert report["rtol_met"]
    pressure, force = report["oil_pressure_Pa"], report["wall"]["force_N"]
    assert pressure == pytest.approx(expected["oil_pressure_Pa"], rel=2e-3)
    assert force == pytest.approx(expected["contact_force_N"], abs=2e-3 * 90)


@pytest.mark.parametrize(
    ("loads", "force", "expected"),
    [
        # The wall carries little of what would have to be exact at first contact.
        ([{"force_N": 18.0}, {"force_N": -2.0}, {"pressure_Pa": 5.0}], 0.9, 0.1),
        ([{"pressure_Pa": 5.0}], 3.0, 0.015),
    ],
)
def test_the_walls_force_is_as_unsure_as_the_load_at_first_contact(
    loads: list[dict[str, float]], force: float, expected: float
) -> None:
    report = {"loads": loads, "wall": {"force_N": force}}
    assert wall_force_error(report, 5e-3) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("own", "shown", "missed"),
    [
        (1e-4, 2e-4, 0.0),  # open in both
        (1e-4, -3e-6, 3e-6),  # the first-order effect alone reaches the wall
        (-1e-7, -8e-6, 7.9e-6),  # and takes a face in contact into it
        (-1e-7, 5e-6, 5.1e-6),  # or off it
    ],
)
def test_a_face_that_misses_the_wall_counts_as_an_error(
    own: float, shown: float, missed: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(assessment, "smallest_gap", lambda *_: jnp.full(1, own))
    spec = pressed("B", 60.0)
    problem = held(spec, SHELL)
    state = State(problem.mechanics.rest(), jnp.zeros(1), jnp.ones(1))
    error = assessment.error_beyond_wall(problem, state, jnp.full(1, shown), jnp.full(1, 5e-3))
    assert error[0] == pytest.approx(2 * missed / 5e-3)


@pytest.mark.long  # the error's programs on two meshes
@pytest.mark.parametrize("elements", [32, 64])
def test_the_stated_error_of_a_shell_in_contact_is_above_the_true_one(elements: int) -> None:
    expected = references()["Bp 60"]
    load = line(45, expected["force_N"], spread="2 mm")
    found = solve(with_solve(scene(load), model="shell", elements=elements)).report
    true = abs(found["oil_pressure_Pa"] / expected["oil_pressure_Pa"] - 1)
    assert true < found["error_estimate"] < 10 * true


@pytest.mark.long  # the error's programs on the references' mesh
@pytest.mark.parametrize("case", ["A 90", "A 240", "B 40", "B 80"])
def test_the_walls_force_is_within_its_stated_error(case: str) -> None:
    expected = references()[case]
    spec = pressed(case[0], expected["force_N"])
    wall = solve(with_solve(spec, model="shell", elements=SHELL[0])).report["wall"]
    off = abs(wall["force_N"] - expected["contact_force_N"])
    assert off < wall["force_error_N"] < 0.02 * expected["force_N"]


@pytest.fixture(scope="module")
def passed_through() -> Solution:
    return solve(with_solve(sensing([], contact=False), model="shell", elements=SHELL[0]))


@pytest.mark.long  # a whole program; the same without wall in test_solution
def test_without_contact_the_membrane_passes(passed_through: Solution) -> None:
    report = passed_through.report
    assert not passed_through.wall
    assert report["wall_contact"]
    assert report["wall"] is None
    assert report["gap_tolerance_m"] is None
    assert report["min_gap_m"] < -5e-4
    assert "contact = false" in report["message"]


@pytest.mark.long  # as above
def test_an_open_gap_needs_no_wall(in_contact: Solution) -> None:
    solution = solve(with_inputs(in_contact.scene, {"load.0.force": 20.0}))
    assert not solution.wall
    assert not solution.report["wall_contact"]
    assert solution.report["wall"] is None
    assert solution.report["gap_tolerance_m"] == 0.0
    # The wall is there all the same, and changes nothing.
    with_it = find(held(pressed("B", 20.0), SHELL))
    np.testing.assert_allclose(solution.state.pressure, with_it.state.pressure, rtol=1e-9)


@pytest.mark.long  # programs of four lanes and of one; test_skin has lanes
def test_lanes_meet_the_wall_each_for_itself() -> None:
    spec = sensing([])
    skin = skin_of(spec)
    run = quick(forward)
    angles, forces = np.deg2rad([45.0, 45.0, 0.0, 20.0]), np.array([20.0, 60.0, 150.0, 100.0])
    found = run(skin, Loads.line(angles, forces))
    assert not np.any(found.result)
    np.testing.assert_array_equal(np.asarray(found.wall_force) > 0, [False, True, True, True])
    assert not np.isfinite(found.so[2, 1])  # nothing parts taxel and membrane there
    # Slid while in contact, from neighbour to neighbour.
    state = jax.tree.map(lambda x: x[..., 2:3], found.state)
    for degrees in (5.0, 10.0, 15.0, 20.0):
        last = run(skin, Loads.line(np.deg2rad(degrees), 100.0), state)
        assert last.result[0] == 0
        state = last.state
    np.testing.assert_allclose(last.oil_pressure[0], found.oil_pressure[3], rtol=1e-8)
    np.testing.assert_allclose(last.wall_force[0], found.wall_force[3], rtol=1e-6)


@pytest.mark.parametrize(
    ("wall", "key"),
    [
        ({"contact": "yes"}, "wall.contact"),
        ({"contct": True}, "wall.contct"),
        ({"layer": {"thickness": "0.5 mm"}}, "wall.layer.stiffness"),
        ({"layer": {"thickness": "60 mm", "stiffness": "1 MPa"}}, "wall.layer.thickness"),
        ({"contact": False, "layer": LAYER}, "wall.layer"),
    ],
)
def test_a_wrong_wall_is_named(wall: dict[str, Any], key: str) -> None:
    table = {
        "geometry": GEOMETRY,
        "material": {"law": "neo-hookean", "mu": "3 MPa"},
        "oil": {"model": "incompressible"},
        "wall": wall,
    }
    with pytest.raises(ConfigError, match=key.replace(".", r"\.")):
        scene_from_dict(table)


@pytest.mark.long  # a batch with its derivatives and the wall; the bound's formula below
def test_the_range_of_forces_ends_at_the_wall() -> None:
    from fitting.force_range.bound import BEYOND, LADDER, force_range

    electrodes = {
        "taxels": [{"angle": f"{a} deg", "diameter": "4 mm"} for a in range(-70, 71, 20)],
        "noise": 2.0,
    }
    base = sensing([])
    table = base.model_dump(exclude_unset=True, by_alias=True) | {"electrodes": electrodes}
    found = force_range(SceneSpec(**table).skin, angles=3)
    middle = found.force[1]
    # The reference's first contact at the crown; the corrected shell's is within 0.2 %.
    assert abs(found.first_contact[1] / 82.82 - 1) < 4e-3
    np.testing.assert_allclose(middle, found.first_contact[1] * np.array(LADDER + BEYOND))
    before, after = found.force_error[1, len(LADDER) - 1], found.force_error[1, -1]
    assert 0 < before < 0.02 * middle[len(LADDER) - 1]
    assert after > 20 * before  # nearly all further force goes to the wall unseen
    assert not found.wall_force[1, : len(LADDER)].any()
    wall = found.wall_force[1, -1] / (middle[-1] - found.first_contact[1])
    assert abs(wall - 1) < 0.02
    # A file that knows how its skin was filled and mounted leaves less open.
    known = {"geometry": {"mounting": "0 % +- 0"}, "oil": {"fill": "1 +- 0"}}
    stated = table | {key: table[key] | own for key, own in known.items()}
    less = force_range(SceneSpec(**stated).skin, angles=3)
    np.testing.assert_allclose(less.first_contact, found.first_contact, rtol=1e-9)
    assert 0.5 * found.deviation < less.deviation < 0.9 * found.deviation


def test_the_bound_is_that_of_a_straight_line() -> None:
    from fitting.force_range.bound import least_errors

    # Offset and slope of a line through n points at unit spacing and unit noise.
    x = np.arange(10.0)
    offset, slope = least_errors(np.stack([np.ones(10), x]), np.ones(10))
    spread = ((x - x.mean()) ** 2).sum()
    assert float(slope) == pytest.approx(1 / np.sqrt(spread))
    assert float(offset) == pytest.approx(np.sqrt(1 / 10 + x.mean() ** 2 / spread))


@pytest.mark.long  # two whole programs; unreachable pressures in test_equilibrium
def test_a_pressure_that_the_wall_keeps_out_of_reach_is_named() -> None:
    """A thin membrane touches at 8.2 kPa; beyond, the wall takes whatever is added."""
    thin = scene(line(0.0, 20.0), oil_pressure=10e3, thickness=0.5e-3)
    wanted = with_solve(thin, model="shell", elements=32)
    assert solve(wanted).report["status"] == "unreachable_pressure"
