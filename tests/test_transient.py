"""A section in motion: closed forms of small motions, volume, statics as a limit."""

import tomllib
from typing import Any

import jax
import numpy as np
import pytest
import scipy.linalg
from skins import built, quick
from test_cli import SCENES

from suas_jax import load_scene, scene_from_dict, solve, with_inputs, with_solve
from suas_jax.config import SceneSpec
from suas_jax.config.schema_load import EnvironmentSpec
from suas_jax.dynamics import history
from suas_jax.dynamics.course import Course, history_of
from suas_jax.dynamics.driven import FACTOR
from suas_jax.dynamics.film import Film, film_of
from suas_jax.dynamics.history import history_sweep
from suas_jax.dynamics.inertia import densities_of, inertia_of
from suas_jax.dynamics.motion import MovingSection, Sampling, free_unknowns, motion_of
from suas_jax.dynamics.pad import pad_inertia, pad_motion
from suas_jax.scene.build import plan_for
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.program import inputs_of
from suas_jax.scene.sweep import SweepError

TAP = SCENES / "tap.toml"
TIME = [0.0, 0.0, 0.02, 0.05, 0.1]


def tapped(force: float = 5.0, viscosity: str = "50 cSt") -> SceneSpec:
    data = tomllib.loads(TAP.read_text(encoding="utf-8"))
    data["oil"]["viscosity"] = viscosity
    scene = scene_from_dict(data, base=SCENES)
    scene = with_inputs(scene, {"load.0.force": force})
    return with_solve(scene, model="shell", elements=16)


def swung(force: float, **how: str) -> list[dict[str, Any]]:
    """After a step of the load, which half of its time later goes back."""
    given = history_of(TIME, force_N=[0.0, force, force, force / 2, force / 2])
    return history_sweep(tapped(force, **how), given).points


@pytest.fixture(scope="module")
def small() -> list[dict[str, Any]]:
    return swung(1e-3)


def exact(force: float) -> list[float]:
    """Displacement under the load of small motions, by exponentials of matrices."""
    scene = tapped(1e-9)
    motion, given = motion_of(solve(scene)), densities_of(scene)
    inertia = inertia_of(motion.outline, motion.moved, motion.section, motion.water, given)
    crown = np.argmin(np.abs(motion.outline.faces[1, 0]))
    read = -motion.moved[1, 1, crown]
    return swinging(scene, (16,), (inertia, motion), read, force)


def swinging(
    scene: SceneSpec,
    counts: tuple[int, ...],
    moves: Any,
    read: np.ndarray,
    force: float,
    time: list[float] = TIME,
) -> list[float]:
    """What a history makes of a reading of the unknowns, inertia and motion being given."""
    inertia, motion = moves
    basis = scipy.linalg.null_space(motion.volume[None])
    mass, damping, stiffness = (
        basis.T @ np.asarray(x) @ basis
        for x in (inertia.mass, inertia.damping, motion.stiffness)
    )
    problem = built(scene, plan_for(scene, "shell", counts), inputs_of(scene))
    shell: Any = problem.mechanics
    zero = np.zeros(1)
    load = quick(lambda shell: shell.assemble(shell.rest(), zero, zero).load)(shell)
    unit = basis.T @ np.ravel(load)[free_unknowns(shell)] / 1e-9
    n = len(mass)
    # Displacements, velocities, force and its rate.
    system = np.zeros((2 * n + 2, 2 * n + 2))
    system[:n, n : 2 * n] = np.eye(n)
    system[n : 2 * n, :n] = -np.linalg.solve(mass, stiffness)
    system[n : 2 * n, n : 2 * n] = -np.linalg.solve(mass, damping)
    system[n : 2 * n, 2 * n] = np.linalg.solve(mass, unit)
    system[2 * n, 2 * n + 1] = 1.0
    read = read @ basis
    y = np.zeros(2 * n + 2)
    y[2 * n] = force
    found = [0.0, 0.0]
    for k in (2, 3, 4):
        duration = time[k] - time[k - 1]
        y[2 * n + 1] = -force / 2 / duration if k == 3 else 0.0
        y = scipy.linalg.expm(duration * system) @ y
        found.append(float(read @ y[:n]))
    return found


def test_small_motions_are_those_of_the_closed_form(small: list[dict[str, Any]]) -> None:
    moved = [p["loads"][0]["displacement_m"] for p in small]
    wanted = exact(1e-3)
    largest = max(np.abs(wanted))
    # What the shell leaves out is added as in statics.
    np.testing.assert_allclose(moved, wanted, rtol=0, atol=3e-3 * largest)


def test_a_row_at_which_loads_jump_tells_them_before_anything_moves(
    small: list[dict[str, Any]],
) -> None:
    load = small[1]["loads"][0]
    assert load["force_N"] == pytest.approx(1e-3)
    assert load["displacement_m"] == 0.0


@pytest.mark.long  # a program of loads that are not one factor
def test_what_the_shell_leaves_out_does_not_show_before_it_moves() -> None:
    around = {"environment": EnvironmentSpec(temperature="20 degC")}
    warm = {"temperature_degC": [20.0] * 3}
    given = history_of([0.0, 0.0, 1e-6], force_N=[0.0, 5.0, 5.0], **warm)
    point = history_sweep(tapped().model_copy(update=around), given).points[1]
    assert point["loads"][0]["force_N"] == 5.0
    assert point["max_displacement_m"] < 1e-12


def test_a_large_swing_keeps_the_oil_and_comes_to_rest_where_statics_has_it() -> None:
    given = history_of([0.0, 0.0, 0.05, 2e3], force_N=[0.0, 5.0, 5.0, 5.0])
    points = history_sweep(tapped(), given).points
    assert all(abs(p["volume_residual"]) < 1e-10 for p in points)
    held = solve(tapped()).report
    for key in ("max_displacement_m", "oil_pressure_Pa", "min_gap_m"):
        assert points[-1][key] == pytest.approx(held[key], rel=1e-6), key
    # Half of the swing goes beyond it.
    assert points[2]["loads"][0]["displacement_m"] != pytest.approx(
        held["loads"][0]["displacement_m"], rel=0.05
    )


@pytest.mark.long  # thousands of steps; the closed form is above
def test_a_blow_over_thin_oil_is_followed_until_it_has_faded() -> None:
    given = history_of([0.0, 0.0, 1.0, 1e3], force_N=[0.0, 5.0, 5.0, 5.0])
    points = history_sweep(tapped(viscosity="5 cSt"), given).points
    held = solve(tapped()).report["oil_pressure_Pa"]
    assert points[2]["time_steps"] > 5_000
    assert abs(points[2]["oil_pressure_Pa"] / held - 1) > 1e-2  # it rings
    assert points[-1]["oil_pressure_Pa"] == pytest.approx(held, rel=1e-6)


def test_what_moves_has_the_derivative_that_short_steps_need() -> None:
    # Thick, on fine elements: the mass of its turning fibres counts.
    scene = with_solve(with_inputs(tapped(), {"geometry.thickness": 3e-3}), elements=40)
    inputs, plan = inputs_of(scene), plan_for(scene, "shell", (40,))
    shell: Any = built(scene, plan, inputs).mechanics
    geometry = scene_parts(scene, inputs).skin.geometry
    sampling = quick(Sampling.of)(shell, geometry)
    rest, length, free = shell.rest(), np.asarray(1e-6), free_unknowns(shell)
    moving = MovingSection(quick(Sampling.near)(sampling, rest), sampling, densities_of(scene))
    wanted = quick(lambda moving: moving.stiffness(0 * rest, length, free))(moving)

    def force(q: Any) -> Any:
        return moving.force(q, (q - rest) / length, moving.still, length)[0]

    along = quick(lambda way: jax.jvp(force, (rest,), (way,))[1])
    for seed in range(3):
        own = np.random.default_rng(seed).normal(size=len(free))
        way = np.zeros(rest.size)
        way[free] = own
        found = along(way.reshape(rest.shape)).reshape(-1)[free]
        assert np.linalg.norm(found - wanted @ own) < 1e-9 * np.linalg.norm(found)


def film(scene: SceneSpec, time: list[float], force: list[float]) -> Any:
    return film_of(Course.of(scene, history_of(time, force_N=force)))


def test_the_film_is_left_out_where_the_history_is_slow() -> None:
    fast = film(tapped(), [0.0, 0.01, 0.02], [0.0, 5.0, 0.0])
    slow = film(tapped(), [0.0, 1e6], [0.0, 5.0])
    assert fast.included
    assert not slow.included
    assert "slow against 0.0172 Hz" in slow.message
    assert film(tapped(), [0.0, 1e6], [5.0, 5.0]).included  # a jump at the first row
    assert not film(tapped(), [0.0, 1e6], [0.0, 0.0]).included


def test_what_the_film_is_not_known_for_is_told() -> None:
    plain = load_scene(SCENES / "press.toml")
    found = film(plain, [0.0, 1.0], [0.0, 1.0])
    assert not found.included
    assert "oil.density, oil.viscosity, material.density" in found.message
    data = tomllib.loads(TAP.read_text(encoding="utf-8"))
    sheet = {"arc": [0, 1], "axial": [0, 1], "value": [["1.5 mm", "1.6 mm"]] * 2}
    data["geometry"] = {"ends": "clamped", "thickness": sheet}
    data["load"] = [{"kind": "patch", "angle": "0 deg", "size": ["9 mm", "9 mm"]}]
    data["load"][0]["force"] = "5 N"
    uneven, time = scene_from_dict(data, base=SCENES), np.array([0.0, 1.0])
    found = film_of(Course(uneven, time, {FACTOR: time}, {FACTOR: 0.0}))
    assert not found.included
    assert "geometry.thickness varies along the axis" in found.message


def test_where_the_film_moves_auto_keeps_to_the_shell(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def noted(scene: SceneSpec, counts: Any = None) -> Any:
        asked.append(scene.solve.model)
        raise SweepError("noted")

    monkeypatch.setattr(history._Errors, "at", noted)
    fast, slow = history_of([0.0, 0.01], force_N=[0.0, 5.0]), history_of([0.0], force_N=[0.0])
    auto, solid = (with_solve(tapped(), model=x, elements=None) for x in ("auto", "solid"))
    for scene, given in ((auto, fast), (auto, slow), (solid, fast)):
        with pytest.raises(SweepError, match="noted"):
            history_sweep(scene, given)
    assert asked == ["shell", "auto", "solid"]
    assert 'use solve.model = "shell"' in film_of(Course.of(solid, fast)).message


def pressed(**load: Any) -> SceneSpec:
    """The tap's skin under one body."""
    data = tomllib.loads(TAP.read_text(encoding="utf-8"))
    data["load"] = [{"kind": "body", "angle": "0 deg", **load}]
    return with_solve(scene_from_dict(data, base=SCENES), model="shell", elements=16)


@pytest.mark.long  # programs of bodies; steps in the closed forms above
def test_a_plate_that_is_driven_held_and_withdrawn() -> None:
    plate = pressed(shape="plate", depth="2 mm")
    time = [0.0, 0.01, 0.02, 2e3, 2e3 + 5e-3, 2e3 + 6e-3]
    given = history_of(time, depth_m=[0.0, 1e-3, 2e-3, 2e-3, -1e-3, -1e-3])
    found = history_sweep(plate, given)
    assert found.film is not None
    assert found.film["included"]
    assert all(p["status"] == "converged" for p in found.points)
    assert all(abs(p["volume_residual"]) < 1e-10 for p in found.points)
    _, _, driven, held, withdrawn, later = (p["loads"][0] for p in found.points)
    still = solve(plate).report
    for key in ("force_N", "contact_half_width_m"):
        assert held[key] == pytest.approx(still["loads"][0][key], rel=1e-6), key
    assert found.points[3]["oil_pressure_Pa"] == pytest.approx(
        still["oil_pressure_Pa"], rel=1e-6
    )
    assert driven["force_N"] > 1.05 * held["force_N"]  # the film has to be driven, too
    # The film is slower than the plate: the skin comes off it.
    for body, point in ((withdrawn, found.points[4]), (later, found.points[5])):
        assert body["force_N"] == 0.0
        assert body["zones"] == 0
        assert point["max_displacement_m"] > 1e-4


@pytest.mark.long  # a program of bodies that forces press; steps in the closed forms above
def test_a_cylinder_that_taps_by_force_moves_the_skin_as_the_force_does() -> None:
    """On a thin skin the radius hardly matters; and its travel stays at the skin."""
    time = [0.0, 0.005, 0.01, 0.02, 0.03, 0.04]
    force = [0.0, 5.0, 0.0, 0.0, 0.0, 0.0]
    by_body = history_sweep(
        pressed(shape="cylinder", radius="5 mm", force="5 N"), history_of(time, force_N=force)
    ).points
    by_line = history_sweep(tapped(), history_of(time, force_N=force)).points
    told = [p["loads"][0]["force_N"] for p in by_body]
    np.testing.assert_allclose(told, force, atol=5e-8)
    for key in ("max_displacement_m", "oil_pressure_Pa"):
        own, other = (np.array([p[key] for p in points]) for points in (by_body, by_line))
        np.testing.assert_allclose(own, other, atol=0.02 * np.abs(other).max())
    assert all(abs(p["volume_residual"]) < 1e-10 for p in by_body)
    assert by_body[-1]["loads"][0]["depth_m"] > 4e-4  # rests on the skin without a force
    # A body that each step lost and met again would need a thousand.
    assert sum(p["time_steps"] for p in by_body) < 600


def warm_under_a_cylinder() -> SceneSpec:
    """A skin that its oil has brought out, by 17 um."""
    scene = pressed(shape="cylinder", radius="5 mm", depth="1 mm")
    oil = scene.oil.model_copy(update={"expansion": 9.6e-4})
    around = EnvironmentSpec(temperature="22 degC")
    return scene.model_copy(update={"oil": oil, "environment": around})


@pytest.mark.parametrize(("first", "rest"), [(-1e-4, -1e-4), (1e-4, 0.0)])
def test_a_body_that_begins_off_the_skin_was_there(first: float, rest: float) -> None:
    given = history_of([0.0, 0.01], depth_m=[first, 1e-3])
    assert Course.of(warm_under_a_cylinder(), given).rest == {"load.0.depth": rest}


@pytest.mark.long  # programs of bodies; where a body begins is above
def test_before_it_moves_a_skin_that_comes_out_meets_a_driven_body_in_equilibrium(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It was as far out as without the body, which was, with 12 kN, within it."""
    warm = warm_under_a_cylinder()
    still = solve(with_inputs(warm, {"load.0.depth": 0.0}))
    assert still.report["loads"][0]["force_N"] > 0.01
    run = history.COMPILED.run

    def first(program: Any, *args: Any, **how: Any) -> Any:
        raise SweepError(str(float(run(program, *args, **how).state.pressure[0])))

    monkeypatch.setattr(history.COMPILED, "run", first)
    course = Course.of(warm, history_of([0.0, 0.01], depth_m=[0.0, 1e-3]))
    errors = history._Errors(still.plan, 0.0, 0.0, 1e-3)
    with pytest.raises(SweepError) as raised:
        history._Follower(course, errors, Film(True, "")).points()
    assert float(str(raised.value)) == pytest.approx(float(still.state.pressure[0]), rel=1e-8)


def test_a_travel_that_jumps_is_told() -> None:
    plate = pressed(shape="plate", depth="2 mm")
    found = film_of(Course.of(plate, history_of([0.0, 1.0], depth_m=[1e-3, 2e-3])))
    assert not found.included
    assert "travel jumps" in found.message


# Programs of a pad.
@pytest.mark.long
def test_small_motions_of_a_pad_are_those_of_the_closed_form() -> None:
    data = tomllib.loads(TAP.read_text(encoding="utf-8"))
    data["geometry"] = {"ends": "clamped"}
    data["load"] = [{"kind": "patch", "angle": "0 deg", "size": ["9 mm", "9 mm"]}]

    def pad(force: float) -> SceneSpec:
        data["load"][0]["force"] = f"{force} N"
        scene = scene_from_dict(data, base=SCENES)
        return with_solve(scene, model="shell", elements=(8, 8), symmetry=False)

    time = [0.0, 0.0, 0.005, 0.01, 0.02]  # a period is 33 ms
    given = history_of(time, force_N=[0.0, 1e-3, 1e-3, 5e-4, 5e-4])
    points = history_sweep(pad(1e-3), given).points
    assert all(p["status"] == "converged" for p in points)
    moved = [p["loads"][0]["displacement_m"] for p in points]
    motion = pad_motion(solve(pad(1e-9)))
    rows, columns = motion.gap.shape
    read = -motion.middle.moved[:, 1, rows // 2, columns // 2]
    inertia = pad_inertia(motion, densities_of(pad(1e-9)))
    wanted = swinging(pad(1e-9), (8, 8), (inertia, motion), read, 1e-3, time)
    # Shear beneath the patch, which the shell leaves out, is added as in statics.
    np.testing.assert_allclose(moved, wanted, rtol=0, atol=1.5e-2 * max(np.abs(wanted)))
    assert all(abs(p["volume_residual"]) < 1e-10 for p in points)
    # Under a load that comes slowly the film, kept in, lies where statics has it.
    held = solve(pad(1e-3))
    slow = Course.of(pad(1e-3), history_of([0.0, 1e5, 2e5], force_N=[0.0, 5e-4, 1e-3]))
    size = held.report["max_displacement_m"]
    errors = history._Errors(held.plan, 0.0, 0.0, size)
    end = history._Follower(slow, errors, Film(True, "")).points()[-1]
    for key in ("oil_pressure_Pa", "max_displacement_m"):
        assert end[key] == pytest.approx(held.report[key], rel=1e-6), key


@pytest.mark.long  # a program of a quarter of a pad and a body that a force presses
def test_a_ball_that_a_force_presses_on_a_pad_ends_in_equilibrium() -> None:
    data = tomllib.loads(TAP.read_text(encoding="utf-8"))
    data["geometry"] = {"ends": "clamped"}
    ball = {"kind": "body", "shape": "sphere", "radius": "10 mm", "angle": "0 deg"}
    data["load"] = [{**ball, "force": "3 N"}]
    scene = with_solve(scene_from_dict(data, base=SCENES), model="shell", elements=(8, 8))
    force = [0.0, 1.5, 3.0, 3.0]
    points = history_sweep(scene, history_of([0.0, 5e-3, 0.01, 2e3], force_N=force)).points
    assert all(p["status"] == "converged" for p in points)
    assert all(abs(p["volume_residual"]) < 1e-10 for p in points)
    np.testing.assert_allclose([p["loads"][0]["force_N"] for p in points], force, atol=1e-7)
    held, still = points[-1], solve(scene).report
    assert held["oil_pressure_Pa"] == pytest.approx(still["oil_pressure_Pa"], rel=1e-8)
    depth = [p["loads"][0]["depth_m"] for p in (*points, still)]
    assert depth[-2] == pytest.approx(depth[-1], rel=1e-8)
    assert depth[2] < 0.9 * depth[-1]  # the film is slower than the force
