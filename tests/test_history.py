"""Loads over time: the update in closed form, an independent program's creep, limits, files."""

import csv
import dataclasses
import itertools
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from scipy.integrate import quad
from skins import built, quick
from test_cli import SCENES, suas

from suas_jax import continuous_inputs, load_scene, solve, with_inputs, with_solve
from suas_jax.config import BodyLoadSpec, SceneSpec
from suas_jax.config.schema_load import EnvironmentSpec
from suas_jax.constitutive.relaxation import Past, PronySeries, Response
from suas_jax.dynamics import history, steps
from suas_jax.dynamics.course import Course, history_of, read_history
from suas_jax.dynamics.driven import DrivenSkin, Travels, _under_forces, answering
from suas_jax.dynamics.film import Film
from suas_jax.dynamics.history import history_sweep
from suas_jax.dynamics.history_gradient import point_asked, require_derivatives
from suas_jax.equilibrium.balance import State
from suas_jax.equilibrium.equilibrium import Equilibrium
from suas_jax.equilibrium.load_path import Found
from suas_jax.equilibrium.outcomes import NAMES, index_of
from suas_jax.mechanics.pad.pad import Pad
from suas_jax.numerics.bordered_solve import BorderedVector
from suas_jax.scene.build import Structure, plan_for
from suas_jax.scene.program import inputs_of
from suas_jax.scene.sweep import SweepError
from suas_jax.scene.travel import POWER

STILL = Film(False, "")
HOLD = SCENES / "hold.toml"
DATA = Path(__file__).parent / "data" / "creep2d.csv"
SERIES = PronySeries(jnp.array([0.15, 0.10]), jnp.array([0.5, 10.0]))
deviator = quick(lambda membrane, q: membrane.deviator(q))


def total(past: Past) -> float:
    """Stress of a past of one number."""
    return float(SERIES.long_term_share * past.stress[0] + jnp.sum(past.parts))


def stepped(times: np.ndarray, stress: Any) -> Past:
    past = Past.none(SERIES, (1,))
    for begin, end in itertools.pairwise(times):
        past = past.after(SERIES, jnp.asarray(end - begin), jnp.array([stress(end)]))
    return past


def test_a_stress_that_grows_evenly_needs_one_step() -> None:
    one = total(stepped(np.array([0.0, 3.0]), lambda t: 2 * t))
    closed = sum(g * tau * -np.expm1(-3 / tau) for g, tau in zip(*SERIES_NUMBERS, strict=True))
    assert one == pytest.approx(2 * (0.75 * 3 + closed), rel=1e-12)
    assert total(stepped(np.linspace(0, 3, 8), lambda t: 2 * t)) == pytest.approx(
        one, rel=1e-12
    )


SERIES_NUMBERS = ((0.15, 0.10), (0.5, 10.0))


@pytest.mark.parametrize(
    ("file", "model", "counts"),
    [
        (HOLD, "shell", (4,)),
        (HOLD, "solid", (4, 1)),
        (SCENES / "pad_crown.toml", "shell", (6, 6)),
    ],
)
def test_forces_of_what_the_past_leaves_are_those_of_its_energy(
    file: Path, model: str, counts: Any
) -> None:
    scene = load_scene(file)
    problem = built(scene, plan_for(scene, model, counts))
    membrane: Any = problem.mechanics
    random = np.random.default_rng(1)
    q = jnp.asarray(2e-4 * random.standard_normal(membrane.rest().shape))
    stress = deviator(membrane, q)
    past = Past(stress, jnp.stack([0.1 * stress, 0.05 * stress[::-1]]))
    problem = answering(problem, past.seen(SERIES, jnp.asarray(0.2)))
    membrane = problem.mechanics
    given = jnp.full(1, 3e3), jnp.ones(1)

    @eqx.filter_jit
    def both(membrane: Any, q: Any, along: Any) -> Any:
        def force(q: Any) -> Any:
            return membrane.assemble(q, *given).residual

        slope = jax.grad(lambda q: membrane.potential(q, *given).sum())(q)
        a = membrane.assemble(q, *given)
        along = jnp.where(a.residual != 0, along, 0.0)  # what is held has no force
        return a.residual, slope, jax.jvp(force, (q,), (along,))[1], a.tangent.mv(along)

    along = jnp.asarray(random.standard_normal(q.shape))
    force, slope, change, product = (np.asarray(x) for x in both(membrane, q, along))
    free = force != 0
    for found, wanted in ((force, slope), (product, change)):
        error = np.abs(found - wanted)[free].max()
        assert error < 1e-9 * np.abs(found).max()


@pytest.mark.parametrize("counts", [(6, 10), (10, 6)])
def test_what_a_quarter_remembers_is_what_the_whole_does(counts: tuple[int, int]) -> None:
    scene = load_scene(SCENES / "pad_crown.toml")
    plan = plan_for(scene, "shell", counts)
    part, whole = (built(scene, mesh).mechanics for mesh in (steps.followed_part(plan), plan))
    assert isinstance(part, Pad)
    assert isinstance(whole, Pad)
    assert part.parts == 4
    free = jnp.asarray(part.topology.free)[..., None]
    q = jnp.asarray(2e-4 * np.random.default_rng(1).standard_normal(free.shape)) * free
    stress = deviator(part, q)
    found = quick(Pad.mirrored_stress)(part, jnp.stack([stress, 2 * stress]))
    wanted = deviator(whole, quick(Pad.mirrored)(part, q))
    shear = np.abs(wanted[2]).max()
    np.testing.assert_allclose(found[0], wanted, rtol=0, atol=1e-9 * shear)
    np.testing.assert_allclose(found[1], 2 * wanted, rtol=0, atol=2e-9 * shear)
    # Of an elastic membrane.
    nothing = quick(Pad.mirrored_stress)(part, jnp.zeros((0, *stress.shape)))
    assert nothing.shape == (0, *wanted.shape)


@pytest.mark.parametrize("warm", [False, True])
@pytest.mark.parametrize(
    ("file", "counts"),
    # A pad's forces of the past are those of its energy, above.
    [(HOLD, (4,)), pytest.param(SCENES / "pad_crown.toml", (6, 6), marks=pytest.mark.long)],
)
def test_all_of_the_stress_remembered_balances_what_the_law_does(
    file: Path, counts: Any, warm: bool
) -> None:
    scene = load_scene(file)
    if warm:  # a membrane that is too large for its seat
        grows = {"material": scene.material.model_copy(update={"expansion": 1.6e-4})}
        warmth = {"environment": EnvironmentSpec(temperature="60 degC")}
        scene = scene.model_copy(update=grows | warmth)
    inputs = continuous_inputs(scene)
    problem = built(scene, plan_for(scene, "shell", counts), inputs)
    membrane: Any = problem.mechanics
    assert problem.prestressed == warm
    random = np.random.default_rng(1)
    q = jnp.asarray(2e-4 * random.standard_normal(membrane.rest().shape))
    remembered = Response(jnp.asarray(0.0), deviator(membrane, q))
    given = jnp.full(1, 3e3), jnp.ones(1)
    residual = quick(lambda membrane: membrane.assemble(q, *given).residual)
    same = np.asarray(residual(answering(problem, remembered).mechanics))
    own = np.asarray(residual(membrane))
    np.testing.assert_allclose(same, own, rtol=0, atol=1e-10 * np.abs(own).max())


def test_the_update_is_of_order_two() -> None:
    exact = 0.75 * 4.0 + sum(
        quad(lambda s, g=g, tau=tau: g * 2 * s * np.exp(-(2 - s) / tau), 0, 2)[0]
        for g, tau in zip(*SERIES_NUMBERS, strict=True)
    )

    def error(count: int) -> float:
        return abs(total(stepped(np.linspace(0, 2, count + 1), lambda t: t**2)) - exact)

    assert error(16) < 1e-3
    assert error(16) / error(32) == pytest.approx(4.0, rel=0.02)


def test_what_a_step_says_of_the_stress_is_what_the_past_then_has() -> None:
    past = stepped(np.array([0.0, 0.2, 0.5]), lambda t: np.sin(3 * t))
    response = past.seen(SERIES, jnp.asarray(0.3))
    after = past.after(SERIES, jnp.asarray(0.3), jnp.array([0.7]))
    assert float(response.share * 0.7 + response.rest[0]) == pytest.approx(total(after))
    relaxed = after.relaxed(SERIES)
    assert float(relaxed.share * 0.7 + relaxed.rest[0]) == pytest.approx(total(after))
    at_once = past.after(SERIES, jnp.asarray(0.0), past.stress)
    np.testing.assert_allclose(at_once.parts, past.parts)


def test_stiffness_of_a_held_material_relaxes_and_that_of_a_released_one_does_not() -> None:
    held = stepped(np.array([0.0, 1e-3, 1e3]), lambda t: 1.0)
    assert float(held.disturbed(SERIES).share) == pytest.approx(0.75, rel=1e-12)
    released = held.after(SERIES, jnp.asarray(0.0), jnp.array([0.2]))
    response = released.disturbed(SERIES)
    assert float(response.share) == 1.0
    assert float(response.share * 0.2 + response.rest[0]) == pytest.approx(total(released))


@pytest.mark.parametrize("x", [1e-4, 0.02, 0.04, 1.0, 50.0])
def test_weight_of_a_bend(x: float) -> None:
    wanted = quad(lambda v: np.exp(-x * (1 - v)) * (v - 0.5), 0, 1)[0]
    assert float(steps.bend_weight(jnp.asarray(x))) == pytest.approx(wanted, rel=2e-3)


def test_a_step_starts_where_a_parabola_leads() -> None:
    """Through three states at uneven times; in a row's first step along a line."""

    def at(time: float) -> State:
        return State(
            *(jnp.array([x + y * time - time**2]) for x, y in ((1, 2), (3, -1), (0, 5)))
        )

    def after(smooth: float) -> Any:
        first, second = (
            steps._pace((at(a), None), (at(b), None), jnp.asarray(b - a))
            for a, b in ((0.2, 0.5), (0.5, 0.6))
        )
        before: Any = SimpleNamespace(pace=first, smooth=jnp.asarray(smooth))
        bend = steps._bend(before, second[0], jnp.asarray(0.1))
        own = {"last": jnp.asarray(0.1), "smooth": jnp.asarray(smooth and 0.1)}
        length = jnp.zeros(0)
        pace, travels = (second[0], length), Travels(length, jnp.zeros((0, 0)))
        now: Any = SimpleNamespace(state=at(0.6), travels=travels, pace=pace, bend=bend, **own)
        return steps._expected(now, jnp.asarray(0.15))[0]

    for found, exact, line in zip(after(0.3), at(0.75), after(0.0), strict=True):
        assert float(found[0]) == pytest.approx(float(exact[0]), rel=1e-12)
        assert float(line[0]) == pytest.approx(float(exact[0]) + 0.15 * 0.25, rel=1e-12)


@pytest.mark.parametrize(
    ("before", "after", "share"),
    [
        ((100.0, 0.0), (0.0, 0.0), 0.0),  # a ramp that ends: the state that it led to stays
        ((100.0, 0.0), (40.0, 5.0), 0.4),
        ((100.0, 0.0), (900.0, 0.0), 1.0),  # no farther than the pace leads
        ((100.0, 0.0), (-50.0, 0.0), -0.5),
        ((0.0, 0.0), (3.0, 1.0), 1.0),  # it crept
        ((0.0, 0.0), (0.0, 0.0), 1.0),
    ],
)
def test_a_pace_goes_on_as_far_as_loads_do(
    before: tuple[float, float], after: tuple[float, float], share: float
) -> None:
    """A path of two states under 2 N (of the solid) left its stable one as a load was held."""

    def values(own: tuple[float, float], size: float = 1.0) -> dict[str, Array]:
        return {key: jnp.asarray(size * x) for key, x in zip("ab", own, strict=True)}

    class Now(NamedTuple):
        drive: dict[str, Array]
        last: Array = jnp.asarray(0.1)
        smooth: Array = jnp.asarray(0.1)
        pace: Array = jnp.array([3.0, -1.0])
        iterations: Array = jnp.zeros(1, int)
        steps: Array = jnp.asarray(4)

    begin, length = (2.0, 1.0), 0.02
    final = tuple(x + length * y for x, y in zip(begin, after, strict=True))
    row = steps.Rows(
        *map(jnp.asarray, (1.0, 1.0 + length)), values(begin), values(final), jnp.asarray(True)
    )
    now: Any = Now(values(before))
    found: Any = steps.entered(now, row)
    np.testing.assert_allclose(found.pace, share * now.pace, atol=1e-12)
    assert (float(found.last), float(found.smooth)) == (pytest.approx(0.1), 0.0)


def test_the_next_step_allows_for_errors_that_grow() -> None:
    """Errors go with the square of steps: four times one allows for half the step."""

    def growth(made: float, smooth: float = 0.1, error: float = 1e-6) -> float:
        own = {"smooth": jnp.asarray(smooth), "made": jnp.asarray(made)}
        now: Any = SimpleNamespace(last=jnp.asarray(0.1), **own)
        return float(steps._growth(now, *map(jnp.asarray, (0.1, error, 1e-6))))

    assert growth(1e-6) == pytest.approx(0.9)
    assert growth(1e-6 / 4) == pytest.approx(0.45)
    assert growth(4e-6) == growth(0.0) == growth(1e-6 / 4, smooth=0.0) == pytest.approx(0.9)
    assert growth(1e-8, error=4e-6) == pytest.approx(0.45)  # too long as it is


def table(file: Path) -> list[dict[str, float]]:
    lines = [line for line in file.read_text().splitlines() if not line.startswith("#")]
    return [{k: float(v) for k, v in row.items()} for row in csv.DictReader(lines)]


@pytest.fixture(scope="module")
def reference() -> list[dict[str, float]]:
    return table(DATA)


@pytest.fixture(scope="module")
def held(reference: list[dict[str, float]], tmp_path_factory: Any) -> list[dict[str, Any]]:
    file = tmp_path_factory.mktemp("history") / "hold.csv"
    rows = [f"{row['t_s']},{row['force_N']}" for row in reference]
    file.write_text("\n".join(["t_s,force_N", "0,0", *rows]))
    found = json.loads(suas("sweep", str(HOLD), "--history", str(file), "--json").stdout)
    points: list[dict[str, Any]] = found["points"]
    return points


def test_creep_is_that_of_an_independent_program(
    held: list[dict[str, Any]], reference: list[dict[str, float]]
) -> None:
    assert held[0]["t_s"] == 0.0
    assert held[0]["max_displacement_m"] < 1e-15
    for point, row in zip(held[1:], reference, strict=True):
        assert point["status"] == "converged"
        assert point["t_s"] == row["t_s"]
        assert point["loads"][0]["force_N"] == pytest.approx(row["force_N"])
        moved = point["loads"][0]["inner_displacement_m"]
        assert moved == pytest.approx(row["inner_displacement_m"], rel=1.2e-3)
        assert point["oil_pressure_Pa"] == pytest.approx(row["oil_pressure_Pa"], rel=5e-4)
        assert point["bulge_m"] == pytest.approx(row["max_bulge_m"], rel=1.2e-3)
        assert point["min_gap_m"] == pytest.approx(row["min_gap_m"], rel=6e-4)
        assert abs(point["volume_residual"]) < 1e-12
        assert point["stable"]


def follow(time: list[float], force: list[float]) -> list[dict[str, Any]]:
    given = history_of(time, force_N=force)
    return history_sweep(load_scene(HOLD), given).points


QUANTITIES = ("oil_pressure_Pa", "max_displacement_m", "min_gap_m", "bulge_m", "stretch_max")


def test_a_jump_is_instantaneous_and_a_long_hold_the_long_term_law() -> None:
    long_term = with_solve(load_scene(HOLD), model="shell", elements=64)
    given = history_of([0.0, 0.0, 1e4], factor=[0.0, 1.0, 1.0])
    course = Course.of(long_term, given)
    for place, scene in ((1, with_inputs(long_term, INSTANTANEOUS)), (2, long_term)):
        solution = solve(scene)
        # Meshes are graded by the law: on that of the solution.
        errors = history._Errors(solution.plan, 0.0, 0.0)
        point = history._Follower(course, errors, STILL).points()[place]
        for key in QUANTITIES:
            assert point[key] == pytest.approx(solution.report[key], rel=1e-8), key


def test_longer_steps_differ_by_no_more_than_they_say(
    held: list[dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(history, "_STEP_SHARE", 3.0)
    rows = [(p["t_s"], p["loads"][0]["force_N"]) for p in held]
    coarse = follow(*(list(x) for x in zip(*rows, strict=True)))
    largest = max(p["max_displacement_m"] for p in held)
    assert sum(p["time_steps"] for p in coarse) < 0.6 * sum(p["time_steps"] for p in held)
    for point, fine in zip(coarse, held, strict=True):
        change = abs(point["max_displacement_m"] - fine["max_displacement_m"]) / largest
        # To leading order, and steps after a jump are too short to count.
        assert change <= 2 * (point["time_error"] + fine["time_error"])


def test_a_load_that_comes_in_a_microsecond_is_one_that_jumps() -> None:
    # What a microsecond says of the speed is nothing to go by over the day that follows.
    jumped, fast = (follow([0.0, rise, 1e5], [0.0, 20.0, 20.0]) for rise in (0.0, 1e-6))
    for one, other in zip(jumped[1:], fast[1:], strict=True):
        assert one["status"] == other["status"] == "converged"
        for key in QUANTITIES:
            error = one["time_error"] + other["time_error"] + 1e-5
            assert other[key] == pytest.approx(one[key], rel=error), key


def test_a_ramp_after_a_long_hold_is_followed_as_finely_as_any() -> None:
    """A rate that jumps at a row's begin says nothing of the hold before."""
    time, force = np.array([0.0, 0.1, 1e4, 1e4 + 1]), np.array([0.0, 20.0, 20.0, 2.0])
    fine = np.append(time[:-1], np.linspace(1e4, 1e4 + 1, 41)[1:])
    coarse, wanted = (
        follow(list(t), list(np.interp(t, time, force)))[-1] for t in (time, fine)
    )
    error = 2 * coarse["time_error"] * 3e-3  # of the largest displacement
    assert abs(coarse["max_displacement_m"] - wanted["max_displacement_m"]) < error


def test_cycles_dissipate() -> None:
    time = np.linspace(0.0, 4.0, 33)
    points = follow(list(time), list(5 - 5 * np.cos(np.pi * time)))
    force = np.array([p["loads"][0]["force_N"] for p in points])
    moved = np.array([p["loads"][0]["displacement_m"] for p in points])
    work = np.cumsum((force[1:] + force[:-1]) / 2 * np.diff(moved))
    cycles = work[15::16]
    assert np.all(np.diff(np.append(0.0, cycles)) > 0.01 * np.max(work))


# Programs of the solid; its forces have a test above.
@pytest.mark.long
def test_the_solid_creeps_like_the_independent_continuum(
    reference: list[dict[str, float]],
) -> None:
    rows = [(0.0, 0.0), *((row["t_s"], row["force_N"]) for row in reference)]
    scene = with_solve(load_scene(HOLD), model="solid", mesh=(120, 2))
    time, force = np.array(rows).T
    for point, row in zip(
        history_sweep(scene, history_of(time, force_N=force)).points[1:], reference, strict=True
    ):
        assert point["model"] == "solid"
        moved = point["loads"][0]["inner_displacement_m"]
        assert moved == pytest.approx(row["inner_displacement_m"], rel=5e-4)
        assert point["oil_pressure_Pa"] == pytest.approx(row["oil_pressure_Pa"], rel=3e-4)


# Programs with the wall; its equilibria have tests of their own.
@pytest.mark.long
def test_the_wall_holds_what_creeps_onto_it() -> None:
    points = follow([0, 0, 1e4, 1e4, 10001, 11000], [0, 80, 80, 0, 0, 0])
    assert not points[1]["wall_contact"]
    assert points[2]["wall_contact"]
    held = with_inputs(load_scene(HOLD), {"load.0.force": 80.0})
    report = solve(held).report
    assert report["model"] == points[2]["model"] == "solid"
    errors = [p["wall"]["force_error_N"] for p in (points[2], report)]
    assert abs(points[2]["wall"]["force_N"] - report["wall"]["force_N"]) < sum(errors)
    assert points[2]["oil_pressure_Pa"] == pytest.approx(report["oil_pressure_Pa"], rel=3e-4)
    # Released at once it keeps a dent, which does not buckle it, and recovers.
    assert all(p["status"] == "converged" and p["stable"] for p in points)
    left, later, end = (p["max_displacement_m"] for p in points[3:])
    assert 2e-3 < left < 3e-3
    assert 1e-3 < later < 0.7 * left
    assert end < 1e-12


# A program of a history without a past; with one, the long hold above.
@pytest.mark.long
def test_without_relaxation_a_history_is_a_curve() -> None:
    scene = load_scene(SCENES / "press.toml")
    (point,) = history_sweep(scene, history_of([5.0], factor=[1.0])).points
    report = solve(with_solve(scene, model="shell", elements=64)).report
    assert point["t_s"] == 5.0
    assert point["oil_pressure_Pa"] == pytest.approx(report["oil_pressure_Pa"], rel=1e-9)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t_s,depth_mm\n0,1\n", r'depth_mm: .* unit is another; did you mean "depth_m"\?'),
        ("t_s,force_kN\n0,1\n", r'force_kN: .*did you mean "force_N"\?'),
        ("t_ms,force_N\n0,1\n", r't_ms: .*did you mean "t_s"\?'),
        ("t_s,force_N,force_N\n0,1,1\n", "once each"),
        ("t_s\n0\n", "one of force_N"),
        ("t_s,force_N,factor\n0,1,1\n", "one of force_N"),
        ("t_s,force_N\n", "and a row"),
        ("t_s,force_N\n0,x\n", "line 2: 0,x: numbers are needed"),
        ("t_s,force_N\n1,0\n0,1\n", "line 3: t_s is less"),
    ],
)
def test_a_wrong_file_is_told_with_its_place(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "history.csv"
    file.write_text(text)
    with pytest.raises(ValueError, match=message):
        read_history(file)


def test_what_a_history_cannot_move() -> None:
    given = history_of([0.0], force_N=[1.0])
    with pytest.raises(SweepError, match="no load with a force"):
        history_sweep(load_scene(SCENES / "film.toml"), given)
    suas("sweep", str(HOLD), status=2)


@pytest.mark.parametrize("index", [0, 1])
def test_what_is_remembered_has_derivatives_by_shares_and_times(index: int) -> None:
    """Of a ramp over 3 s, in closed form."""
    g, tau = (jnp.array(x) for x in SERIES_NUMBERS)

    def stress(g: Any, tau: Any) -> Any:
        series = PronySeries(g, tau)
        past = Past.none(series, (1,))
        for end in (1.0, 1.0, 3.0):
            past = past.after(series, end - past.stress[0] / 2, jnp.array([2 * end]))
        return series.long_term_share * past.stress[0] + jnp.sum(past.parts)

    by_g, by_tau = jax.grad(stress, (0, 1))(g, tau)
    x = 3 / tau[index]
    closed = 2 * (tau[index] * -jnp.expm1(-x) - 3)
    assert float(by_g[index]) == pytest.approx(float(closed), rel=1e-9)
    slope = 2 * g[index] * (-jnp.expm1(-x) - x * jnp.exp(-x))
    assert float(by_tau[index]) == pytest.approx(float(slope), rel=1e-9)


def creeping(scene: SceneSpec) -> SceneSpec:
    """A scene whose rubber relaxes as the held press's does."""
    own = {"relaxation": load_scene(HOLD).material.relaxation}
    return scene.model_copy(update={"material": scene.material.model_copy(update=own)})


@pytest.mark.parametrize(
    ("file", "counts"), [(HOLD, (4,)), (SCENES / "pad_crown.toml", (4, 4))]
)
def test_what_a_shell_omits_relaxes_as_its_stress_does(file: Path, counts: Any) -> None:
    scene = creeping(load_scene(file))
    plan = plan_for(scene, "shell", counts)
    soft, stiff = (
        built(scene.responding(x), plan).mechanics for x in ("long-term", "instantaneous")
    )
    random = np.random.default_rng(2)
    q = jnp.asarray(1e-5 * random.standard_normal(stiff.rest().shape))
    none = jnp.zeros(jax.eval_shape(stiff.deviator, q).shape)
    response = Response(SERIES.long_term_share[None], none)
    relaxed = dataclasses.replace(stiff, response=response)
    omitted = quick(lambda membrane, q: membrane.omitted_energy(q, jnp.ones(1)))
    wanted = float(omitted(soft, q)[0])
    assert float(omitted(relaxed, q)[0]) == pytest.approx(wanted, rel=1e-10)
    assert abs(float(omitted(stiff, q)[0]) / wanted - 1) > 1e-3


# A program of a step and one of derivatives; the chain of pasts above, the balance below.
@pytest.mark.long
@pytest.mark.parametrize(
    ("file", "counts", "warm"),
    [
        (HOLD, (16,), False),
        (HOLD, (16,), True),
        (HOLD, (16, 1), False),  # the solid
        (SCENES / "pad_crown.toml", (6, 6), False),  # of which a quarter is solved
    ],
)
def test_derivatives_of_a_history_are_those_of_differences(
    file: Path, counts: Any, warm: bool
) -> None:
    solid = file == HOLD and len(counts) == 2
    how = {"mesh": counts} if solid else {"elements": counts if len(counts) > 1 else counts[0]}
    model = "solid" if solid else "shell"
    scene = with_solve(load_scene(file), model=model, rtol=0.1, **how)
    scene = creeping(scene)
    time = np.linspace(0.0, 0.12, 13)  # a step each: steps are the same for other inputs
    force = np.minimum(time / 0.1, 1.0) ** 2
    names = ["material.C1", "material.relaxation.g.0", "material.relaxation.tau.1"]
    names += ["geometry.thickness", "load.0.angle", "load.0.force"]
    values = {"factor": force}
    if warm:
        around = EnvironmentSpec(temperature="22 degC")
        grows = {"material": scene.material.model_copy(update={"expansion": 1.6e-4})}
        scene = scene.model_copy(update=grows | {"environment": around})
        values["temperature_degC"] = 22 + 5 * time
        names += ["environment.temperature", "material.expansion"]
    plan = plan_for(scene, model, counts)

    def follower(scene: SceneSpec) -> history._Follower:
        course = Course.of(scene, history_of(list(time), **values))
        return history._Follower(course, history._Errors(plan, 0.0, 0.0), STILL)

    own = follower(scene)
    points = own.points()
    assert {p["status"] for p in points} == {"converged"}
    known = continuous_inputs(own.course.scene)
    for path in ("oil_pressure_Pa", "loads.0.displacement_m"):
        slopes = own.gradient(11, path, points)
        assert slopes is not None
        assert slopes.keys() == known.keys()
        for name in names:
            if warm and name == "environment.temperature":
                continue  # moved by the history's own column
            if name == "load.0.angle" and plan.dimension == 3:
                assert abs(slopes[name]) < 1e-6
                continue  # a quarter has no place for a load beyond the crown
            step = 1e-4 * (known[name] or 1.0)
            ends = []
            for side in (-1, 1):
                moved = with_inputs(scene, {name: known[name] + side * step})
                found: Any = follower(moved).points()[11]
                for key in path.split("."):
                    found = found[int(key) if key.isdigit() else key]
                ends.append(found)
            difference = (ends[1] - ends[0]) / (2 * step)
            size = abs(points[11]["oil_pressure_Pa"] if "oil" in path else 1e-3)
            floor = 1e-8 * size / step
            assert slopes[name] == pytest.approx(difference, rel=1e-5, abs=floor), name


# A program of a pad's steps, which the derivatives above have too; the update's order above.
@pytest.mark.long
def test_a_pad_creeps_with_order_two_in_the_step() -> None:
    scene = creeping(with_solve(load_scene(SCENES / "pad_crown.toml"), rtol=0.1))
    plan = plan_for(scene, "shell", (6, 6))

    def moved(steps: int) -> float:
        time = np.linspace(0.0, 0.04, steps + 1)
        course = Course.of(scene, history_of(list(time), factor=np.sin(30 * time)))
        points = history._Follower(course, history._Errors(plan, 0.0, 0.0), STILL).points()
        assert [p["time_steps"] for p in points[1:]] == [1] * steps
        return float(points[-1]["max_displacement_m"])

    coarse, middle, fine = (moved(steps) for steps in (4, 8, 16))
    assert (coarse - middle) / (middle - fine) == pytest.approx(4.0, rel=0.1)


def test_a_history_says_why_it_has_no_derivatives(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the scene and the table say is told before anything is solved."""

    def solve(*_: Any, **__: Any) -> Any:
        raise AssertionError("solved")

    monkeypatch.setattr(history, "solve", solve)
    given = history_of([0.0, 1.0], factor=[0.0, 1.0])
    scene, pressed = load_scene(HOLD), under_a_cylinder(force="2 N")
    refused = (
        (pressed, "oil_pressure_Pa", "pressed by a force"),
        (scene, "points.1.oil_presure_Pa", '"oil_pressure_Pa"'),
        (scene, "points.2.min_gap_m", r"points\.0 to points\.1 are there"),
        (scene, "points.x.min_gap_m", r"points\.0 to points\.1 are there"),
        (scene, "points.1", r"points\.0 to points\.1 are there"),
    )
    for wrong, asked, message in refused:
        with pytest.raises(ValueError, match=message):
            history_sweep(wrong, given, asked)
    with pytest.raises(SweepError, match="film moves"):
        require_derivatives(scene, moves=True)
    assert point_asked("min_gap_m", 2, 1) == (1, "min_gap_m")
    assert point_asked("points.0.loads.0.force_N", 2, 1) == (0, "loads.0.force_N")


def under_a_cylinder(**how: Any) -> SceneSpec:
    """The references' skin under a body."""
    body = BodyLoadSpec(shape="cylinder", radius="10 mm", angle="0 deg", **how)
    scene = load_scene(HOLD).model_copy(update={"loads": (body,)})
    return with_solve(scene, model="shell", elements=64)


INSTANTANEOUS = {"material.C1": 20.7e6, "material.C2": -4.4e6, "material.C3": 77e3}


# Programs of a history under a body; what the past leaves is above, bodies in test_bodies.
@pytest.mark.long
def test_the_force_of_a_held_body_relaxes() -> None:
    scene = under_a_cylinder(depth="2 mm")
    given = history_of([0.0, 0.0, 1e4], depth_m=[0.0, 2e-3, 2e-3])
    points = history_sweep(scene, given).points
    for place, own in ((1, with_inputs(scene, INSTANTANEOUS)), (2, scene)):
        report = solve(own).report
        assert points[place]["loads"][0]["depth_m"] == 2e-3
        # Contact's own small yield goes with the law's modulus, which is the instantaneous one.
        for key in ("oil_pressure_Pa", "min_gap_m"):
            assert points[place][key] == pytest.approx(report[key], rel=1e-4), key
        force = report["loads"][0]["force_N"]
        assert points[place]["loads"][0]["force_N"] == pytest.approx(force, rel=1e-4)


# The search for travels within a step; a static one has tests of its own.
@pytest.mark.long
@pytest.mark.parametrize("bulge", [0.0, 0.7e-3])
def test_the_travel_at_which_a_force_is_carried_may_lie_before_first_touch(
    bulge: float,
) -> None:
    """By a stand-in whose skin comes out to meet the body."""
    wanted, one = jnp.array([0.3]), jnp.ones(1)

    def found(_: State, travels: Travels) -> Equilibrium:
        at = State(travels.length, one, one)
        return Equilibrium(at, one, jnp.zeros(1, int), jnp.ones(1, int), one, one > 0)

    def carried(travels: Travels, _: Equilibrium) -> Array:
        return 2.0 * jnp.maximum(1e3 * (travels.length + bulge), 0.0) ** 1.5

    expected = Travels(jnp.zeros(1), POWER * jnp.eye(1))
    start = State(jnp.zeros(1), one, one)
    best, travels = _under_forces(found, carried, start, wanted, (expected, expected), 1.5e-3)
    assert best.result[0] == 0
    depth = 1e-3 * (0.3 / 2.0) ** (1 / 1.5) - bulge
    np.testing.assert_allclose(travels.length, depth, rtol=1e-8)


@pytest.mark.long  # programs by force; what is remembered under a travel is in the tests before
def test_under_a_constant_force_a_body_goes_on() -> None:
    scene = under_a_cylinder(force="8 N")
    given = history_of([0.0, 0.0, 1e4, 1e4], force_N=[0.0, 8.0, 8.0, 0.0])
    points = history_sweep(scene, given).points
    for place, own in ((1, with_inputs(scene, INSTANTANEOUS)), (2, scene)):
        load = points[place]["loads"][0]
        assert points[place]["status"] == "converged"
        assert load["force_N"] == pytest.approx(8.0, rel=1e-8)
        wanted = solve(own).report["loads"][0]["depth_m"]
        assert load["depth_m"] == pytest.approx(wanted, rel=1e-4)
    assert points[3]["loads"][0]["force_N"] == 0.0
    assert points[3]["max_displacement_m"] > 1e-4


def warmed(scene: SceneSpec) -> SceneSpec:
    """A skin that its oil has pushed out by some micrometres."""
    around = EnvironmentSpec(temperature="22 degC")
    grows = {"oil": scene.oil.model_copy(update={"expansion": 9.6e-4}), "environment": around}
    return scene.model_copy(update=grows)


def test_before_a_history_bodies_are_off_a_skin_that_comes_out() -> None:
    scene, given = under_a_cylinder(depth="2 mm"), history_of([0.0, 1.0], depth_m=[0.0, 2e-3])
    assert Course.of(scene, given).apart == {"factor": 0.0}
    assert Course.of(warmed(scene), given).apart["load.0.depth"] < -1e-3


def test_a_body_without_a_force_is_off_the_skin() -> None:
    scene = under_a_cylinder(force="2 N")
    plan = plan_for(scene, "shell", (16,))
    skin = DrivenSkin.of(Structure(scene, wall=False), plan, inputs_of(scene), ["load.0.force"])
    for length, off in ((0.0, True), (1e-4, False), (-1e-4, False)):
        travels = skin.no_travels._replace(length=jnp.array([length]))
        (body,) = skin.parts({}, travels)[0].bodies
        assert float(body.travel[0]) == (-scene.geometry.mean_gap if off else length)


@pytest.mark.long  # programs of histories under bodies; what they begin with is above
def test_bodies_push_a_skin_that_comes_out_no_further_than_it_comes() -> None:
    found = history_sweep(
        warmed(under_a_cylinder(depth="2 mm")), history_of([0.0, 1.0], depth_m=[0.0, 1e-5])
    )
    first = found.points[0]
    assert first["status"] == "converged"
    assert 0 < first["loads"][0]["force_N"] < 0.1  # was that of a body left in the skin, 1e4
    assert first["max_displacement_m"] < 1e-4
    beside = [
        under_a_cylinder(**how).loads[0].model_copy(update={"angle": angle})
        for angle, how in ((-0.5, {"depth": "1 mm"}), (0.6, {"force": "3 N"}))
    ]
    scene = load_scene(HOLD).model_copy(update={"loads": tuple(beside)})
    given = history_of([0.0, 1.0, 2.0], depth_m=[0.0, 1e-3, 1e-3], force_N=[0.0, 0.0, 3.0])
    points = history_sweep(with_solve(scene, model="shell", elements=64), given).points
    assert {p["status"] for p in points} == {"converged"}
    waits, pressed = (p["loads"][1] for p in points[1:])
    assert waits["force_N"] == waits["depth_m"] == 0.0  # the skin comes out by 0.9 mm there
    assert waits["displacement_m"] < -5e-4
    assert pressed["force_N"] == pytest.approx(3.0, rel=1e-8)


def test_a_skin_that_buckles_at_rest_is_unstable_from_the_first_row_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    names = [("converged", True), ("limit_point", True), ("squeezed", False)]
    for name, stable in (*names, ("converged", False), ("no_convergence", False)):
        found = steps._unless_buckled(jnp.array([index_of(name)]), jnp.array([stable]))
        kept = stable or name == "squeezed"
        assert NAMES[int(found[0])] == (name if kept else "unstable")
    scene = warmed(under_a_cylinder(depth="2 mm"))
    skin = DrivenSkin.of(
        Structure(scene, wall=True), plan_for(scene, "shell", (8,)), inputs_of(scene), ()
    )
    zero, one = jnp.zeros(1), jnp.ones(1)
    problem = skin.problem({}, skin.no_travels)
    y = BorderedVector(problem.mechanics.rest(), zero)
    count = jnp.zeros(1, jnp.int32)
    lost = Found(y, zero, count + index_of("no_convergence"), count, one, count)
    monkeypatch.setattr(steps, "settled", lambda *_: lost._replace(result=count))
    monkeypatch.setattr(steps, "follow", lambda *_, **__: lost)
    assert NAMES[int(steps._unloaded(problem, one)[1][0])] == "unstable"


def test_first_contact_of_a_history_is_told_as_a_curve_s(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of a path by the arc, too: there the printed curve names places by it."""
    report = {"status": "converged", "wall_contact": True, "oil_pressure_Pa": 2e3, "t_s": 1.0}
    report |= {"loads": [{"kind": "line", "force_N": 7.0}], "min_gap_angle_deg": 90.0}
    report |= {"min_gap_arc_m": 0.05, "shown": np.zeros(1)}
    known = history._Errors(None, 0.0, 0.0)  # type: ignore[arg-type]
    monkeypatch.setattr(history._Errors, "at", lambda *_: known)
    monkeypatch.setattr(history._Follower, "points", lambda _: [report])
    rows = history_of([0.0, 1.0], force_N=[0.0, 7.0])
    found = history_sweep(load_scene(HOLD), rows, film=False)
    told = {"t_s": 1.0, "force_N": 7.0, "oil_pressure_Pa": 2e3, "angle_deg": 90.0}
    assert found.first_contact == told | {"arc_m": 0.05}
