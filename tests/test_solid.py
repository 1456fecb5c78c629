"""The continuum: its element, its exact condensation, and an independent reference."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from skins import (
    EPDM,
    GEOMETRY,
    built,
    check,
    find,
    half_cylinder,
    inner_displacement,
    line,
    problem_of,
    quick,
    reference_rows,
    scene,
    shaped,
    status,
)

from suas_jax.config import continuous_inputs, scene_from_dict, with_inputs, with_solve
from suas_jax.constitutive.laws.neo_hookean import NeoHookean
from suas_jax.constitutive.specimens.inflation import tube
from suas_jax.figures.section import plot_solid
from suas_jax.mechanics.solid.layout import Layout
from suas_jax.mechanics.solid.model import SOLID
from suas_jax.mechanics.solid.solid import Solid
from suas_jax.numerics.bordered_solve import BorderedBlockTridiagonal, BorderedVector, eliminate
from suas_jax.scene.build import plan_for
from suas_jax.scene.solve import Solution, solve
from suas_jax.skin.loads import LoadPoints


def solid_of(half: bool = False, elements: int = 4, layers: int = 2) -> Solid:
    mechanics = problem_of(scene(line(0, 24.0)), elements, layers, half=half).mechanics
    assert isinstance(mechanics, Solid)
    return mechanics


def used(solid: Solid) -> np.ndarray:
    """One where a vector's entry is an unknown, zero where it is held or fills a gap."""
    mask = np.ones(solid.rest().shape)
    mask[: solid.layout.dof] = solid._mask()
    mask[solid.layout.dof :, -1] = 0
    return mask


def sizes(solid: Solid) -> np.ndarray:
    """Plausible sizes of the unknowns: displacements [m], pressures [Pa]."""
    size = np.full(solid.rest().shape, 2e-5)
    size[2 * solid.layout.dof :] = 1e6
    return size * used(solid)


mirrored = quick(Solid.mirrored)
to_comparison_mesh = quick(Solid.to_comparison_mesh)
volume_errors = quick(lambda solid, q: (solid.dilatation(q), solid.volume_change(q)))
work_and_energy = quick(lambda solid, q: (solid.work(q), solid.strain_energy(q)))


def random_state(solid: Solid, seed: int = 0) -> jax.Array:
    values = np.random.default_rng(seed).normal(size=solid.rest().shape)
    return jnp.asarray(values * sizes(solid))


@pytest.mark.parametrize("half", [False, True])
def test_residual_and_tangent_are_derivatives_of_the_potential(half: bool) -> None:
    solid = solid_of(half)
    pressure, factor = jnp.array([1e4]), jnp.array([0.7])

    def both(q: jax.Array, x: jax.Array) -> list[tuple[jax.Array, jax.Array]]:
        def gradient(q: jax.Array) -> jax.Array:
            return jax.grad(lambda q: solid.potential(q, pressure, factor)[0])(q) * used(solid)

        found = solid.assemble(q, pressure, factor)
        want, product = jax.jvp(gradient, (q,), (x,))
        by_volume = jax.grad(lambda q: solid.volume_change(q)[0])(q) * used(solid)
        return [
            (found.residual, want),
            (found.tangent.mv(x), product),
            (found.volume_gradient, by_volume),
        ]

    dof = solid.layout.dof
    for got, want in quick(both)(random_state(solid), random_state(solid, 1)):
        for rows in (slice(0, dof), slice(dof, 2 * dof), slice(2 * dof, None)):
            scale = float(jnp.max(jnp.abs(want[rows]))) or 1.0
            np.testing.assert_allclose(got[rows], want[rows], rtol=0, atol=1e-13 * scale)


def test_negative_eigenvalues_are_those_on_the_surface_of_all_constraints() -> None:
    # The pressures bring one negative eigenvalue each, the oil one more: only what is
    # left over says something about stability. Dense eigenvalues are the judge.
    solid = solid_of(elements=6, layers=1)
    constraints = 3 * solid.layout.layers * solid.layout.elements

    @quick
    def squeezed(pressure: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Inertia under a pressure from outside, carried by stress: one linear step."""
        zero = jnp.zeros(1)
        first = solid.assemble(solid.rest(), -pressure, zero)
        step = first.tangent.solve(first.residual[:, None]).solution[:, 0]
        a = solid.assemble(solid.rest() - step, -pressure, zero)
        operator = BorderedBlockTridiagonal(a.tangent, -a.volume_gradient, zero)
        right = BorderedVector(jnp.ones(solid.rest().shape), jnp.ones(1))
        return eliminate(operator, right).negative, operator.as_matrix()

    counts = set()
    for pressure in (0.0, 3e4, 1.5e5, 5e5):
        found, matrix = squeezed(jnp.array([pressure]))
        scale = 1 / np.sqrt(np.max(np.abs(matrix), 0))
        eigenvalues = np.linalg.eigvalsh(np.asarray(matrix) * scale[:, None] * scale)
        assert int(found[0]) == np.sum(eigenvalues < 0) - constraints
        counts.add(int(found[0]))
    assert 1 in counts  # stable with the oil trapped
    assert len(counts) >= 3  # and really unstable states among those tested


def test_condensation_solves_the_whole_system() -> None:
    solid = solid_of(elements=6)
    scale = jnp.asarray(np.where(sizes(solid) > 0, sizes(solid), 1))

    @quick
    def errors(q: jax.Array, x: jax.Array) -> list[jax.Array]:
        a = solid.assemble(q, jnp.array([1e4]), jnp.ones(1))
        operator = BorderedBlockTridiagonal(a.tangent, -a.volume_gradient, jnp.zeros(1))
        want = BorderedVector(x, jnp.array([3e3]))
        solved = eliminate(operator, operator.mv(want)).solution
        # What is left is rounding in a slender body: one more solve removes it.
        rest = jax.tree.map(jnp.subtract, operator.mv(want), operator.mv(solved))
        more = jax.tree.map(jnp.add, solved, eliminate(operator, rest).solution)
        return [jnp.max(jnp.abs((y.stations - x) / scale)) for y in (solved, more)]

    once, twice = errors(0.2 * random_state(solid), random_state(solid, 2))
    assert once < 1e-5
    assert twice < 1e-9


@pytest.mark.long  # a fine mesh; condensation above
def test_slender_elements_keep_their_digits() -> None:
    # 60 times as long as high: in the nodes' own displacements nothing of the answer was left.
    spec = scene(line(0, 8.0), thickness=0.5e-3)
    solid = problem_of(spec, 96, 6, half=True).mechanics

    @quick
    def lost(factor: jax.Array) -> jax.Array:
        a = solid.assemble(solid.rest(), jnp.zeros(1), factor)
        x = a.tangent.solve(a.residual[:, None]).solution[:, 0]
        rest = a.tangent.solve((a.tangent.mv(x) - a.residual)[:, None]).solution[:, 0]
        return solid.displacement_size(rest) / solid.displacement_size(x)

    assert float(lost(jnp.ones(1))[0]) < 1e-3


def test_patch_test() -> None:
    # A homogeneous isochoric deformation under constant pressure is an exact solution on
    # any mesh: no force on nodes inside, no change of volume.
    solid = solid_of(elements=5, layers=2)
    layout = solid.layout
    F = np.array([[1.2, 0.3], [-0.1, (1 - 0.03) / 1.2]])
    assert np.linalg.det(F) == pytest.approx(1)

    def rows(x: jax.Array) -> jax.Array:
        moved = jnp.einsum("ij,jnel->inel", F - np.eye(2), x)
        return jnp.swapaxes(moved, 0, 1).reshape(-1, *x.shape[2:])

    pressures = jnp.zeros((3, layout.layers, layout.elements, 1)).at[0].set(4e6)
    inside = jnp.concatenate([rows(solid.middles), pressures.reshape(-1, *pressures.shape[2:])])
    q = layout.joined(rows(solid.stations), inside)
    zero = jnp.zeros(1)
    r, change = quick(lambda q: (solid.assemble(q, zero, zero).residual, solid.dilatation(q)))(
        q
    )
    outer, middle = r[: layout.dof], r[layout.dof : 2 * layout.dof]
    scale = float(jnp.max(jnp.abs(r[: layout.dof])))
    assert scale > 1e3  # the faces do carry it
    np.testing.assert_allclose(outer[2:-2, 1:-1], 0, atol=1e-12 * scale)
    np.testing.assert_allclose(middle[2:-2, :-1], 0, atol=1e-12 * scale)
    np.testing.assert_allclose(change, 0, atol=1e-13)


@quick
def inflated_sector(
    across: np.ndarray,  # as long as there are elements through the thickness
) -> tuple[jax.Array, jax.Array]:
    """Errors of a thick sector whose ends move as in an inflated tube, on an even mesh.

    Returns:
        Largest error of a nodal displacement, relative to the displacement of the inner
        face, and of that face's stretch.
    """
    inner, outer, half, stretch = 1.0, 1.6, np.pi / 4, 1.25
    layers, elements = len(across), 4 * len(across)
    law = NeoHookean(jnp.ones(1))
    geometry = half_cylinder(inner, outer - inner, half, 1.0, 0.1)
    angles = jnp.linspace(-half, half, elements + 1)[:, None]
    nothing = LoadPoints(jnp.zeros((elements, 0, 1)), jnp.zeros((0, 1)), jnp.zeros((2, 0, 1)))
    solid = Solid.build(geometry, law, angles, nothing, layers=layers, symmetric=False)
    layout = solid.layout

    def moved(x: jax.Array) -> jax.Array:
        """Radial displacement at constant r^2 - R^2, which preserves volume."""
        factor = jnp.sqrt(1 + (stretch**2 - 1) * inner**2 / jnp.sum(x**2, 0)) - 1
        return jnp.swapaxes(factor * x, 0, 1).reshape(-1, *x.shape[2:])

    between = moved(solid.middles)
    pressures = jnp.zeros((3 * layers, *between.shape[1:]))
    exact = layout.joined(moved(solid.stations), jnp.concatenate([between, pressures]))
    pressure = tube(law, stretch, 1.0, inner, outer).pressure.reshape(1)

    def newton(q: jax.Array, _: None) -> tuple[jax.Array, None]:
        a = solid.assemble(q, pressure, jnp.zeros(1))
        return q - a.tangent.solve(a.residual[:, None]).solution[:, 0], None

    found, _ = jax.lax.scan(newton, exact, None, length=8)
    error = jnp.max(jnp.abs(found - exact)[: 2 * layout.dof]) / (stretch - 1)
    inner_stretch = solid.profile(found, 4).inner_stretch
    return error, jnp.max(jnp.abs(inner_stretch - stretch))


def test_converges_at_the_rate_of_its_shape_functions() -> None:
    # Biquadratic displacements are good to the third order. Stretches recovered from them
    # must not fall behind; those of the elements themselves would, at second order.
    coarse, fine = (np.array(inflated_sector(np.zeros(n))) for n in (1, 2))
    assert np.all(coarse < 1e-3)
    assert np.all(np.log2(coarse / fine) > 2.8)


def test_stretches_of_a_path_know_nothing_of_its_jumps_of_curvature() -> None:
    # Length of the inner face per angle jumps with it, by the thickness over twice the radius.
    path = [{"line": "10 mm"}, {"radius": "12 mm", "angle": "90 deg"}, {"line": "8 mm"}]
    spec = shaped({"section": "path", "path": path, "mirror": True})
    solid = problem_of(spec, 32, 2).mechanics
    assert isinstance(solid, Solid)

    def moved(x: jax.Array) -> jax.Array:
        """10 % longer sideways, of the same area."""
        change = jnp.array([0.1, 1 / 1.1 - 1]).reshape(2, *[1] * (x.ndim - 1)) * x
        return jnp.swapaxes(change, 0, 1).reshape(-1, *x.shape[2:])

    between = moved(solid.middles)
    pressures = jnp.zeros((3 * solid.layers, *between.shape[1:]))
    q = solid.layout.joined(moved(solid.stations), jnp.concatenate([between, pressures]))
    drawn = quick(lambda q: solid.profile(q, 2))
    profile = drawn(q)
    across, up = solid.section.frame(profile.angle).tangent
    expected = jnp.hypot(1.1 * across, up / 1.1)
    np.testing.assert_allclose(profile.inner_stretch, expected, atol=1e-3)
    np.testing.assert_allclose(drawn(0 * q).inner_stretch, 1, rtol=1e-12)


@pytest.fixture(scope="module")
def solved() -> dict[str, tuple]:
    """Every line-loaded reference case under its pressure, on 128 x 2 elements."""
    found = {}
    for row in reference_rows("arch.csv"):
        if float(row["load_spread_m"]) > 0:
            continue
        spec = scene(
            line(float(row["load_angle_deg"]), 1.0),
            material=EPDM,
            oil_pressure=float(row["oil_pressure_Pa"]),
            inner_radius=float(row["inner_radius_m"]),
            thickness=float(row["thickness_m"]),
        )
        problem = problem_of(spec, 128, 2)
        result = find(problem)
        assert status(result) == "converged"
        found[f"{row['case']}-{row['oil_pressure_Pa']}"] = (row, problem, result.state)
    return found


def test_reference_force_and_displacement(solved: dict[str, tuple]) -> None:
    for row, problem, state in solved.values():
        force, own_error = float(row["force_N"]), float(row["force_err_N"])
        # Twice the wanted error where the radius is small and this mesh coarse.
        allowed = (4e-4 if float(row["inner_radius_m"]) < 0.05 else 2e-4) * force
        assert float(state.factor[0]) == pytest.approx(force, abs=allowed + own_error)
        angle = np.deg2rad([float(row["load_angle_deg"])])
        inward = -np.array([np.sin(angle[0]), np.cos(angle[0])])
        moved = float(inward @ inner_displacement(problem.mechanics, state.q, angle))
        wanted = float(row["inner_displacement_along_load_m"])
        assert moved == pytest.approx(wanted, rel=2e-4)


def test_incompressible_in_every_element(solved: dict[str, tuple]) -> None:
    for _, problem, state in solved.values():
        dilatation, volume = volume_errors(problem.mechanics, state.q)
        assert np.max(np.abs(dilatation)) < 1e-10
        assert abs(float(volume[0])) < 1e-10 * float(problem.mechanics.film_volume[0])


def test_pressure_does_not_oscillate(solved: dict[str, tuple]) -> None:
    # Away from load and clamps mean pressures vary slowly: a checkerboard would show as a
    # second difference of the size of the pressure itself.
    _, problem, state = solved["A-10000"]
    _, p = problem.mechanics.layout.gather(state.q)
    mean = np.asarray(p)[0, :, :, 0]
    angle = np.asarray(problem.mechanics.angles)[:, 0]
    away = (np.abs(angle[1:-2]) > 0.2) & (np.abs(angle[1:-2]) < 1.4)
    second = np.diff(mean, 2, axis=1)[:, away]
    assert np.max(np.abs(second)) < 0.02 * np.max(np.abs(mean[:, 1:-1][:, away]))


@pytest.mark.long  # two more meshes; derivatives of a half above
def test_half_an_arc_gives_the_same(solved: dict[str, tuple]) -> None:
    spec = scene(line(0, 24.0))
    whole, half = (problem_of(spec, 32, 2, half=half) for half in (False, True))
    states = [find(problem).state for problem in (whole, half)]
    np.testing.assert_allclose(states[1].pressure, states[0].pressure, rtol=1e-9)
    dof = whole.mechanics.layout.dof
    want, unfolded = np.asarray(states[0].q), np.asarray(mirrored(half.mechanics, states[1].q))
    size = np.max(np.abs(want[:dof]))
    np.testing.assert_allclose(unfolded[: 2 * dof], want[: 2 * dof], rtol=0, atol=1e-8 * size)


@pytest.mark.long  # the comparison meshes; reference above
def test_estimated_error_covers_the_true_one(solved: dict[str, tuple]) -> None:
    row, problem, state = solved["B-10000"]
    spec = scene(line(45, 1.0))
    plan = plan_for(scene(line(45, 1.0), oil_pressure=1e4), "solid", (128, 2))
    estimate = 0.0
    for coarse, share in zip(plan.comparisons(), problem.mechanics.error_shares, strict=True):
        q = to_comparison_mesh(problem.mechanics, state.q, coarse.counts)
        checked = check(built(spec, coarse), state._replace(q=q))
        assert bool(checked.stable[0])
        difference = abs(float((checked.correction.pressure / state.pressure - 1)[0]))
        estimate += 2 * share * difference
    true = abs(float(state.factor[0]) / float(row["force_N"]) - 1)
    assert true < estimate < 20 * true


@pytest.mark.long  # another mesh; that of the shell in test_equilibrium
def test_work_of_the_loads_is_stored_as_energy() -> None:
    # Trapped oil does no work: the load's work along the path is all there is. The
    # trapezoidal rule's error goes with the square of the step: extrapolate.
    spec = scene(line(45, 16.0))
    plan, inputs = plan_for(spec, "solid", (32, 2)), continuous_inputs(spec)
    levels = np.linspace(0, 1, 17)
    moved, energy = [0.0], 0.0
    for level in levels[1:]:
        problem = built(spec, plan, {**inputs, "load.0.force": 16.0 * level})
        state = find(problem).state
        work, stored = work_and_energy(problem.mechanics, state.q)
        moved.append(float(work[0]) / level)
        energy = float(stored[0])
    fine, coarse = (np.trapezoid(levels[::k], moved[::k]) for k in (1, 2))
    assert (4 * fine - coarse) / 3 == pytest.approx(energy, rel=1e-3)


@pytest.mark.long
def test_shell_and_solid_agree_in_the_thin_limit() -> None:
    # Under a load without a point of its own the shell's error falls with thickness.
    differences = []
    for thickness in (6e-3, 3e-3):
        force = 16.0 * (thickness / 1.5e-3) ** 3
        spec = scene(line(0, force, spread="40 mm"), thickness=thickness)
        pair = problem_of(spec, 128, 2), problem_of(spec, 64)
        solid, shell = (float(find(problem).state.pressure[0]) for problem in pair)
        differences.append(abs(solid / shell - 1))
    assert differences[0] < 2e-2
    assert differences[1] < 0.5 * differences[0]


@pytest.mark.parametrize("across", [False, True])
@pytest.mark.parametrize("half", [False, True])
def test_a_state_carried_to_a_finer_mesh_is_the_same_deformation(
    half: bool, across: bool
) -> None:
    spec = scene(line(0, 24.0))
    fine = plan_for(spec, "solid", (16, 4))
    coarse = fine.comparisons()[across]
    solid = built(spec, coarse).mechanics
    assert isinstance(solid, Solid)
    q = random_state(solid)
    if half:  # the left half of a state that is its own mirror image
        q = mirrored(solid, q[:, : coarse.counts[0] // 2 + 1])
    target = fine.reduced() if half else fine
    finer = built(spec, target).mechanics
    found = SOLID.carried(np.asarray(q), coarse, target)
    assert found.shape == finer.rest().shape
    counts = coarse.reduced().counts if half else coarse.counts
    back = np.asarray(to_comparison_mesh(finer, found, counts))
    kept = np.asarray(q)[:, : back.shape[1]].copy()
    kept[solid.layout.dof :, -1] = 0  # the last station has no column
    size = sizes(solid).max((1, 2))[:, None, None]
    np.testing.assert_allclose(back / size, kept / size, atol=1e-12)


@pytest.mark.long  # two fine meshes; states carried above
def test_a_refined_solve_starts_from_the_coarser_mesh() -> None:
    spec = scene(line(30, 1.0), thickness=4e-4)
    refined = solve(with_solve(spec, model="solid", rtol=2.2e-3))  # 64 x 2 misses it
    assert refined.plan.counts == (96, 4)
    given = solve(with_solve(spec, model="solid", mesh=(96, 4)))
    assert refined.report["iterations"] < given.report["iterations"]
    for key in ("oil_pressure_Pa", "max_displacement_m", "strain_energy_J"):
        assert refined.report[key] == pytest.approx(given.report[key], rel=1e-9)


@pytest.fixture(scope="module")
def trapped() -> Solution:
    return solve(with_solve(scene(line(40, 12.0)), model="solid", mesh=(32, 2)))


def test_the_stretch_through_the_thickness_is_drawn_where_its_nodes_are(
    trapped: Solution,
) -> None:
    (drawn,) = plot_solid(trapped).axes[2].lines
    nodes = 1.5 * Layout(32, 2).heights  # mm; those of two layers are drawn twice
    np.testing.assert_allclose(np.unique(np.round(drawn.get_ydata(), 9)), nodes, atol=1e-8)


def test_scene_of_a_solid_reports_like_the_shell(trapped: Solution) -> None:
    shell = solve(with_solve(trapped.scene, model="shell", elements=16, mesh=None))
    assert trapped.report["model"] == "solid"
    assert trapped.report.keys() == shell.report.keys()
    for key in ("oil_pressure_Pa", "max_displacement_m", "min_gap_m", "strain_energy_J"):
        assert trapped.report[key] == pytest.approx(shell.report[key], rel=2e-2)
    assert trapped.report["stable"]


@pytest.mark.long  # the program of derivatives; differentiated equilibria in test_gradients
def test_gradient_of_a_solid_is_that_of_differences() -> None:
    from suas_jax.scene.gradient import gradient

    table = {
        "geometry": GEOMETRY,
        "material": EPDM,
        "oil": {"model": "compressible", "bulk_modulus": "5 MPa"},
        "load": [{"kind": "line", "angle": "40 deg", "force": "12 N"}],
        "solve": {"model": "solid", "mesh": [32, 2]},
    }
    found = solve(scene_from_dict(table))
    got = gradient(found, "oil_pressure_Pa")
    inputs = continuous_inputs(found.scene)
    assert got.keys() == inputs.keys()
    for name in ("geometry.thickness", "material.C1", "load.0.angle", "oil.bulk_modulus"):
        step = 2e-5 * inputs[name]
        ends = [
            solve(with_inputs(found.scene, {name: inputs[name] + sign * step}))
            for sign in (1, -1)
        ]
        up, down = (end.report["oil_pressure_Pa"] for end in ends)
        assert got[name] == pytest.approx((up - down) / (2 * step), rel=1e-5)


def test_between_elements_the_slope_of_displacements_is_the_mean_of_both() -> None:
    solid = solid_of()
    q, angle = random_state(solid), jnp.asarray(solid.angles[2])
    moved = quick(lambda angle: solid.at_angle(q, angle).inner_displacement[:, 0, 0])
    _, slope = jax.jvp(moved, (angle,), (jnp.ones_like(angle),))
    sides = [(moved(angle + h) - moved(angle)) / h for h in (-1e-6, 1e-6)]
    assert np.abs(sides[1] - sides[0]).max() > 0.1 * np.abs(slope).max()  # they differ
    np.testing.assert_allclose(slope, (sides[0] + sides[1]) / 2, rtol=1e-5)


@pytest.mark.parametrize(
    ("excess", "finer"),
    [((1.2, 0.1), (384, 6)), ((0.1, 1.4), (256, 6)), ((1.5, 0.9), (384, 8))],
)
def test_meshes_are_refined_where_their_error_is(
    excess: tuple[float, float], finer: tuple[int, int]
) -> None:
    assert SOLID.finer((256, 4), excess) == finer
    assert SOLID.finer((1024, 8), excess) is None
    assert SOLID.finer((768, 8), excess) == (1024, 8)  # the most there may be
