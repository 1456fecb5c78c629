"""Equilibria of the shell: the published case, its limits, and how failures are named."""

from types import SimpleNamespace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from skins import (
    EPDM,
    WIDTH,
    built,
    check,
    converged,
    find,
    inner_displacement,
    line,
    problem_of,
    quick,
    reference_rows,
    scene,
    status,
)

from suas_jax.config import continuous_inputs
from suas_jax.equilibrium.balance import volume_residual
from suas_jax.equilibrium.equilibrium import Equilibrium, equilibrium
from suas_jax.equilibrium.load_path import Found
from suas_jax.equilibrium.outcomes import NAMES, index_of
from suas_jax.mechanics.shell.shape import mirrored
from suas_jax.numerics.bordered_solve import BorderedVector
from suas_jax.scene.build import build_problem, plan_for

OGDEN = {
    "law": "ogden",
    "mu": ["0.63 MPa", "1.2 kPa", "-10 kPa"],
    "alpha": [1.3, 5.0, -2.0],
    "convention": "mu/alpha",
}
ROWS = reference_rows("arch.csv")
CASES = {"A": 0.0, "B": 45.0}
either_case = pytest.mark.parametrize("case", CASES)


# Against independent finite-element solutions of the continuum.


def force_tolerance(row: dict[str, str]) -> float:
    """What a shell without transverse shear can leave out."""
    if row["case"] in ("small-radius-60deg", "ogden-spread-load"):
        return 3e-3
    if row["case"] == "A" and float(row["oil_pressure_Pa"]) < 1e4:
        return 1.5e-3
    return 5e-4


def test_reference_is_complete() -> None:
    cases = [row["case"] for row in ROWS]
    assert (cases.count("A"), cases.count("B"), len(cases)) == (6, 6, 15)


@pytest.mark.parametrize(
    "row", ROWS, ids=lambda row: f"{row['case']}, {row['oil_pressure_Pa']} Pa"
)
def test_converged_shell_reproduces_the_continuum(row: dict[str, str]) -> None:
    number = {k: float(v) for k, v in row.items() if k not in ("case", "law", "load_direction")}
    arc = number["load_spread_m"]
    spec = scene(
        line(number["load_angle_deg"], 1.0, **({"spread": f"{arc} m"} if arc else {})),
        material=OGDEN if row["law"].startswith("ogden") else EPDM,
        oil_pressure=number["oil_pressure_Pa"],
        inner_radius=number["inner_radius_m"],
        thickness=number["thickness_m"],
        half_angle=float(np.deg2rad(number["half_angle_deg"])),
        width=number["width_m"],
    )
    problem = problem_of(spec, 97)
    state = converged(problem).state
    tolerance = force_tolerance(row)
    assert float(state.factor[0]) == pytest.approx(number["force_N"], rel=tolerance)

    angle = np.deg2rad(number["load_angle_deg"])
    moved = inner_displacement(problem.mechanics, state.q, jnp.array([angle]))
    inward = -float(moved[0] * np.sin(angle) + moved[1] * np.cos(angle))
    within = 1e-2 if arc else 3e-3  # a soft, thick membrane thins under the spread load
    assert inward == pytest.approx(number["inner_displacement_along_load_m"], rel=within)


# Refinement.


@pytest.mark.long  # three meshes; the continuum above
@either_case
def test_displacement_and_pressure_converge_with_the_fourth_power(case: str) -> None:
    spec = scene(line(CASES[case], 2.0))
    plan = plan_for(spec, "shell", (15,))
    values = []
    for _ in range(3):
        problem = built(spec, plan)
        state = converged(problem).state
        values.append([float(state.pressure[0]), float(problem.mechanics.work(state.q)[0])])
        (plan,) = plan.comparisons()
    steps = np.abs(np.diff(values, axis=0))
    rates = np.log2(steps[:-1] / steps[1:])
    assert np.all(rates > 3.7)
    assert np.all(steps[-1] / np.abs(values[-1]) < 1e-4)


# Trapped, incompressible.

# Odd, so that the crown's load has a single point like any other: one program for both.
ELEMENTS = 33
FORCES = (1e-6, 1e-3, 0.3, 5.0, 24.4, 82.8, 200.0)


@either_case
@pytest.mark.parametrize("force", FORCES)
def test_trapped_oil_carries_every_load(case: str, force: float) -> None:
    problem = problem_of(scene(line(CASES[case], force)), ELEMENTS)
    found = converged(problem)
    assert float(found.level[0]) == 1.0
    assert abs(float(volume_residual(problem, found.state)[0])) < 1e-12
    after = check(problem, found.state)
    assert bool(after.stable[0])
    # Another Newton correction changes nothing.
    size = float(problem.mechanics.displacement_size(found.state.q)[0])
    left = problem.mechanics.displacement_size(after.correction.q - found.state.q)
    assert float(left[0]) < 1e-10 * size
    # The oil is squeezed, and the load does positive work.
    assert float(found.state.pressure[0]) > 0
    assert float(problem.mechanics.work(found.state.q)[0]) > 0


@pytest.mark.parametrize("layers", [0, 2])
def test_no_library_that_waits_for_threads_is_called(layers: int) -> None:
    """Two of LAPACK's for stacks of matrices, on two cores, wait for each other for ever."""
    text = find.lower(problem_of(scene(line(20, 5.0)), 8, layers)).as_text()
    assert "stablehlo.while" in text
    assert "lapack" not in text


@either_case
def test_pulling_lowers_the_pressure_of_the_linear_response(case: str) -> None:
    push, pull = (
        converged(problem_of(scene(line(CASES[case], f)), ELEMENTS)).state
        for f in (1e-9, -1e-9)
    )
    np.testing.assert_allclose(pull.pressure, -push.pressure, rtol=1e-7)
    np.testing.assert_allclose(
        pull.q, -push.q, rtol=0, atol=1e-7 * float(jnp.max(jnp.abs(push.q)))
    )


@either_case
@pytest.mark.parametrize("force", [1.0, 24.4, 120.0])
def test_force_and_pressure_control_agree(case: str, force: float) -> None:
    given_force = converged(problem_of(scene(line(CASES[case], force)), ELEMENTS)).state
    plan = plan_for(scene(line(CASES[case], force)), "shell", (ELEMENTS,))
    spec = scene(line(CASES[case], 3.0), oil_pressure=float(given_force.pressure[0]))
    given_pressure = converged(built(spec, plan)).state
    np.testing.assert_allclose(given_pressure.factor * 3.0, force, rtol=1e-9)
    # In pressure control p is given, and the volume is what must come out.
    controlled = built(spec, plan)
    assert abs(float(volume_residual(controlled, given_pressure)[0])) < 1e-12
    np.testing.assert_allclose(
        given_pressure.q,
        given_force.q,
        rtol=0,
        atol=1e-9 * float(jnp.max(jnp.abs(given_force.q))),
    )


@pytest.mark.long  # two more meshes; half arcs in test_shell
@pytest.mark.parametrize("force", [1e-3, 24.4, 150.0])
def test_half_an_arc_equals_the_whole(force: float) -> None:
    spec = scene(line(0, force))
    whole = converged(problem_of(spec, 32)).state
    half = converged(problem_of(spec, 32, half=True)).state
    np.testing.assert_allclose(half.pressure, whole.pressure, rtol=1e-9)
    largest = float(jnp.max(jnp.abs(whole.q)))
    np.testing.assert_allclose(mirrored(half.q), whole.q, rtol=0, atol=1e-9 * largest)


def test_work_of_the_loads_is_stored_as_strain_energy() -> None:
    # W = F u - integral of u dF, with u(F) at Gauss points: exact up to rounding.
    force = 20.0
    spec = scene(line(45, force))
    plan, inputs = plan_for(spec, "shell", (ELEMENTS,)), continuous_inputs(spec)
    nodes, weights = np.polynomial.legendre.leggauss(24)
    # The path starts like a straight line and stiffens on the scale of a newton: points
    # gather there.
    t = (nodes + 1) / 2
    forces = jnp.asarray(np.append(force * t**2, force))
    weights = force * t * weights

    @quick
    def along(forces: jax.Array) -> Any:
        def one(force: jax.Array) -> Any:
            problem = build_problem(spec, plan, {**inputs, "load.0.force": force})
            found = equilibrium(problem)
            work = problem.mechanics.work(found.state.q) * WIDTH / force
            return work[0], problem.mechanics.strain_energy(found.state.q)[0], found.result[0]

        return jax.vmap(one)(forces)

    moved, energy, result = (np.asarray(x) for x in along(forces))
    assert np.all(result == 0)
    work = force * moved[-1] - np.sum(weights * moved[:-1])
    assert energy[-1] * WIDTH == pytest.approx(work, rel=1e-7)


# Oil.


def test_vented_arch_reaches_a_limit_point() -> None:
    loads = {}
    for force in (5.0, 13.0, 13.5, 14.0, 20.0, 200.0):
        problem = problem_of(scene(line(0, force), oil={"model": "vented"}), ELEMENTS)
        loads[force] = (problem, find(problem))
    displacement = 0.0
    for force, (problem, found) in loads.items():
        assert float(found.state.pressure[0]) == 0.0
        reached = float(found.level[0]) * force
        if force <= 13.5:
            assert status(found) == "converged"
        else:
            assert status(found) == "limit_point"
            assert 13.5 < reached < 14.1
            np.testing.assert_allclose(reached, float(loads[14.0][1].level[0]) * 14, rtol=1e-6)
        # The state reported is on the path before the limit: stable, not beyond the snap.
        assert bool(check(problem, found.state).stable[0])
        crown = float(problem.mechanics.displacement_size(found.state.q)[0])
        assert displacement < crown < 0.030
        displacement = crown - 1e-6
    assert displacement > 0.021


def test_compressible_oil_obeys_its_law_and_tends_to_incompressible() -> None:
    rigid = converged(problem_of(scene(line(45, 10)), ELEMENTS)).state
    differences = []
    for modulus in (1e5, 1e8, 1e9, 1e10):
        oil = {"model": "compressible", "bulk_modulus": f"{modulus} Pa"}
        problem = problem_of(scene(line(45, 10), oil=oil), ELEMENTS)
        state = converged(problem).state
        film = float(problem.mechanics.film_volume[0])
        ratio = 1 + float(problem.mechanics.volume_change(state.q)[0]) / film
        # The logarithm loses the digits that the volume's change is smaller than 1.
        assert float(state.pressure[0]) == pytest.approx(
            -modulus * np.log(ratio), rel=1e-11, abs=1e-15 * modulus
        )
        assert abs(float(volume_residual(problem, state)[0])) < 1e-12
        differences.append(abs(float(state.pressure[0] / rigid.pressure[0]) - 1))
    assert differences[0] > 0.1
    ratios = np.divide(differences[1:-1], differences[2:])
    np.testing.assert_allclose(ratios, 10, rtol=3e-3)
    assert ratios[1] == pytest.approx(10, rel=3e-4)


def test_uniform_pressure_passes_to_incompressible_oil() -> None:
    spec = scene({"kind": "pressure", "pressure": "3 kPa"})
    problem = problem_of(spec, ELEMENTS)
    state = converged(problem).state
    assert float(state.pressure[0]) == pytest.approx(3000, rel=1e-13)
    assert float(jnp.max(jnp.abs(state.q))) < 1e-15


def test_uniform_pressure_shifts_the_oil_pressure_under_a_load() -> None:
    alone = converged(problem_of(scene(line(45, 10)), ELEMENTS)).state
    plan = plan_for(scene(line(45, 10)), "shell", (ELEMENTS,))
    spec = scene(line(45, 10), {"kind": "pressure", "pressure": "3 kPa"})
    both = converged(built(spec, plan)).state
    np.testing.assert_allclose(both.pressure, alone.pressure + 3000, rtol=1e-11)
    np.testing.assert_allclose(
        both.q, alone.q, rtol=0, atol=1e-11 * float(jnp.max(jnp.abs(alone.q)))
    )


# Failures.


def finite(found: Any) -> bool:
    return all(bool(jnp.all(jnp.isfinite(x))) for x in jax.tree.leaves(found))


@pytest.mark.parametrize(
    ("force", "pressure"),
    [(1.0, -5e3), (1.0, -1.0), (-1.0, -1e9)],
    ids=["wrong sign", "met by a pull only", "out of reach"],
)
def test_unreachable_pressure_is_named(force: float, pressure: float) -> None:
    found = find(problem_of(scene(line(0, force), oil_pressure=pressure), ELEMENTS))
    assert status(found) == "unreachable_pressure"
    assert finite(found)


@quick
def in_lanes(problem: Any, factors: jax.Array) -> Any:
    def one(factor: jax.Array) -> Any:
        scaled = eqx.tree_at(
            lambda p: p.mechanics.points.force, problem, problem.mechanics.points.force * factor
        )
        return equilibrium(scaled)

    return jax.vmap(one)(factors)


def test_failing_lanes_leave_no_trace() -> None:
    problem = problem_of(scene(line(0, 1.0), oil={"model": "vented"}), ELEMENTS)
    factors = jnp.array([3.0, 14.5, 13.0, 1e6, -40.0])
    found = in_lanes(problem, factors)
    names = [NAMES[int(i)] for i in found.result[:, 0]]
    assert names[0] == names[2] == "converged"
    assert names[1] == names[3] == "limit_point"
    assert finite(found)
    for lane in (0, 2):
        alone = converged(
            eqx.tree_at(
                lambda p: p.mechanics.points.force,
                problem,
                problem.mechanics.points.force * factors[lane],
            )
        ).state
        largest = float(jnp.max(jnp.abs(alone.q)))
        np.testing.assert_allclose(found.state.q[lane], alone.q, rtol=0, atol=1e-11 * largest)


@pytest.mark.parametrize("trapped", [False, True])
def test_a_state_is_stable_by_its_negative_pivots_and_unstable_only_if_it_converged(
    trapped: bool,
) -> None:
    """Trapped oil's equation gives the tangent one negative eigenvalue, and vented oil none."""
    failed = index_of("limit_point")
    y, level = BorderedVector(jnp.zeros((1, 5)), None), jnp.ones(5)
    negative, result = jnp.array([0, 1, 2, 0, 1]), jnp.array([0, 0, 0, failed, failed])
    oil: Any = SimpleNamespace(trapped=trapped)
    problem: Any = SimpleNamespace(oil=oil, oil_pressure=None)
    found = Equilibrium.of(problem, Found(y, level, result, negative, level, negative))
    assert found.stable.tolist() == [not trapped, trapped, False, not trapped, trapped]
    names = [NAMES[k] for k in found.outcome.tolist()]
    left = ["unstable", "converged"] if trapped else ["converged", "unstable"]
    assert names == [*left, "unstable", "limit_point", "limit_point"]
    assert found.result.tolist() == result.tolist()
