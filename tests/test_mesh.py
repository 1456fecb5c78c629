"""Where stations go, and what loads put on the elements."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from skins import half_cylinder, quick

from suas_jax.mesh.plan import MeshPlan, load_points, plan_mesh
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.loads import LineLoad, LoadPoints
from suas_jax.skin.section import outward, tangent

HALF = np.pi / 2
LAYER = 0.12


SKIN = half_cylinder()
OUTER = float(SKIN.outer_size[0])
points_of = quick(load_points)


def load(
    angle: float, force: float = 7.0, turn: float = 0.0, spread: float | None = None
) -> LineLoad:
    arc = None if spread is None else np.array([spread])
    return LineLoad(np.array([angle]), np.array([force]), np.array([turn]), arc)


def plan_of(
    loads: list[LineLoad], elements: int, *, symmetric: bool = False, layer: float = LAYER
) -> MeshPlan:
    numbers = [-HALF, HALF]
    for one in loads:
        numbers += [float(x[0]) for x in one.breakpoints(SKIN.section)]
    spread = [one.spread is not None for one in loads]
    return plan_mesh(numbers, spread, elements, layer, symmetric=symmetric)


def placed(
    plan: MeshPlan, loads: list[LineLoad], geometry: SkinGeometry = SKIN
) -> tuple[np.ndarray, np.ndarray, LoadPoints]:
    """Angles of the stations and of the load points, and the points."""
    found = points_of(plan, geometry, loads)
    angles, every = jax.tree.map(np.asarray, found)
    used = plan.loaded
    assert not np.any(every.force[:, ~used])
    points = LoadPoints(every.select[:, used], every.xi[used], every.force[:, used])
    element = np.argmax(points.select, 0)[:, 0]
    assert np.array_equal(np.sum(points.select, 0)[:, 0], np.ones(len(element)))
    xi = points.xi[:, 0]
    start, end = angles[element, 0], angles[element + 1, 0]
    return angles[:, 0], start + xi * (end - start), points


@pytest.mark.parametrize("elements", [2, 3, 7, 16, 33])
def test_counts_ends_and_order(elements: int) -> None:
    loads = [load(0.6)]
    plan = plan_of(loads, elements)
    angles, _, _ = placed(plan, loads)
    assert plan.elements == elements == len(angles) - 1
    np.testing.assert_allclose(angles[[0, -1]], [-HALF, HALF], rtol=0, atol=1e-15)
    assert np.all(np.diff(angles) > 0)


def test_every_load_has_a_station() -> None:
    loads = [load(0.6), load(-0.3), load(0.9, spread=0.005)]
    plan = plan_of(loads, 12)
    angles, where, points = placed(plan, loads)
    half = 0.005 / (2 * OUTER)
    for wanted in (0.6, -0.3, 0.9 - half, 0.9 + half):
        assert np.min(np.abs(angles - wanted)) < 1e-14
    np.testing.assert_allclose(where[:2], [0.6, -0.3], rtol=0, atol=1e-14)
    assert set(np.round(np.asarray(points.xi)[:2, 0], 12)) <= {0.0, 1.0}


@pytest.mark.parametrize("elements", [2, 8, 20])
@pytest.mark.parametrize(
    "angles",
    [(), (0.0,), (-0.5, 0.5), (-0.9, 0.0, 0.9), (-0.5, -0.5, 0.5, 0.5)],
    ids=lambda a: f"{len(a)} loads",
)
def test_symmetric_loads_have_symmetric_stations(
    elements: int, angles: tuple[float, ...]
) -> None:
    loads = [load(a) for a in angles]
    plan = plan_of(loads, elements, symmetric=True)
    stations = plan.stations @ plan.values
    np.testing.assert_allclose(stations, -stations[::-1], rtol=0, atol=1e-15)
    assert plan.elements == elements
    # Symmetric in the breakpoints, too: a wider skin keeps the mesh symmetric.
    wider = np.array([-1.2 * HALF, 1.2 * HALF, *angles])
    np.testing.assert_allclose(
        plan.stations @ wider, -(plan.stations @ wider)[::-1], rtol=0, atol=1e-15
    )


def test_elements_shrink_towards_layers() -> None:
    plan = plan_of([load(0.4)], 32, layer=0.03)
    widths = np.diff(plan.stations @ plan.values)
    at = np.argmin(np.abs(plan.stations @ plan.values - 0.4))
    for part in (widths[:at], widths[at:]):  # from clamp to load, from load to clamp
        middle = len(part) // 2
        assert np.all(np.diff(part[:middle]) > 0)
        assert np.all(np.diff(part[middle:]) < 0)
        assert part[middle] > 1.5 * part[0]
    plan = plan_of([load(0.0)], 32, layer=50.0)
    even = np.diff(plan.stations @ plan.values)
    assert np.ptp(even) < 0.02 * np.mean(even)


def test_half_is_the_left_half() -> None:
    loads = [load(-0.5, 3.0), load(0.0, 8.0), load(0.5, 3.0)]
    plan = plan_of(loads, 12, symmetric=True)
    half = plan.half()
    assert half.symmetric
    assert not plan.symmetric
    assert half.elements == 6
    angles, where, points = placed(half, loads)
    np.testing.assert_array_equal(half.stations, plan.stations[:7])
    assert abs(angles[-1]) < 1e-15
    # The crown's load is shared between the halves; the right one's is left out.
    vectors = np.asarray(points.force)[:, :, 0]
    size = {-0.5: 0.0, 0.0: 0.0}
    for angle, force in zip(where, vectors.T, strict=True):
        size[round(float(angle), 9)] += float(np.hypot(*force))
    width = 0.123
    assert size == pytest.approx({-0.5: 3.0 / width, 0.0: 4.0 / width}, rel=1e-13)


@pytest.mark.parametrize("spread", [0.002, 0.02])
def test_half_of_a_spread_load_carries_half_of_it(spread: float) -> None:
    loads = [load(0.0, 8.0, spread=spread)]
    for elements in (2, 4, 10, 32):
        half = plan_of(loads, elements, symmetric=True).half()
        _, where, points = placed(half, loads)
        total = np.sum(points.force, 1)[:, 0]
        np.testing.assert_allclose(total, [0, -4.0 / 0.123], rtol=1e-13, atol=1e-13)
        assert np.all(where < 0)


def test_refinement_divides_every_element() -> None:
    loads = [load(0.6), load(-0.2, spread=0.01)]
    plan = plan_of(loads, 9)
    fine = plan.refined()
    coarse_angles, _, coarse = placed(plan, loads)
    angles, where, points = placed(fine, loads)
    assert fine.elements == 18
    np.testing.assert_array_equal(angles[::2], coarse_angles)
    middle = (coarse_angles[1:] + coarse_angles[:-1]) / 2
    np.testing.assert_allclose(angles[1::2], middle, rtol=0, atol=1e-15)
    for p in (coarse, points):
        of_first = np.asarray(p.force)[:, :1, 0].sum(1)
        np.testing.assert_allclose(of_first, -7 / 0.123 * outward(0.6), rtol=1e-13)
        rest = np.asarray(p.force)[:, 1:, 0].sum(1)
        np.testing.assert_allclose(rest, -7 / 0.123 * outward(-0.2), rtol=1e-13)
    assert abs(where[0] - 0.6) < 1e-14


def test_close_breakpoints_share_a_station() -> None:
    loads = [load(0.3), load(0.3 + 1e-5), load(HALF - 1e-6)]
    angles, where, _ = placed(plan_of(loads, 10), loads)
    assert np.min(np.diff(angles)) > 1e-3
    # Loads stay where they are, not where the station is.
    np.testing.assert_allclose(where, [0.3, 0.3 + 1e-5, HALF - 1e-6], rtol=0, atol=1e-14)


@pytest.mark.parametrize("apart", [0.003, 0.01, 0.02])
def test_loads_close_together_do_not_gather_short_elements(apart: float) -> None:
    """Those are so stiff that rounding leaves forces on them that nothing balances."""
    plan = plan_of([load(0.2), load(0.2 + apart), load(-0.7), load(1.1)], 64)
    angles = plan.stations @ plan.values
    assert np.min(np.diff(angles)) > 0.999 * min(apart, 0.025 * LAYER)
    assert np.min(np.abs(angles - 0.2 - apart)) < 1e-12


def test_more_breakpoints_than_elements() -> None:
    angles = np.linspace(-1.2, 1.2, 9)
    loads = [load(a) for a in angles]
    plan = plan_of(loads, 4)
    assert plan.elements == 4
    _, where, points = placed(plan, loads)
    np.testing.assert_allclose(where, angles, rtol=0, atol=1e-14)
    assert np.all((np.asarray(points.xi) >= 0) & (np.asarray(points.xi) <= 1))


@pytest.mark.parametrize("twin", [None, 0.02])
def test_coinciding_loads_add_up(twin: float | None) -> None:
    loads = [load(0.5, 3.0), load(0.5, 4.0, turn=0.2, spread=twin)]
    for elements in (1, 2, 8, 15):
        _, where, points = placed(plan_of(loads, elements), loads)
        want = -(3.0 * outward(0.5) + 4.0 * outward(0.3)) / 0.123
        np.testing.assert_allclose(np.sum(points.force, 1)[:, 0], want, rtol=1e-13)
        if twin is None:
            np.testing.assert_allclose(where, 0.5, rtol=0, atol=1e-14)


def test_single_element() -> None:
    loads = [load(0.4), load(-0.1, spread=0.01)]
    plan = plan_of(loads, 1)
    angles, where, points = placed(plan, loads)
    assert len(angles) == 2
    assert abs(where[0] - 0.4) < 1e-15
    total = -7 / 0.123 * (outward(0.4) + outward(-0.1))
    np.testing.assert_allclose(np.sum(points.force, 1)[:, 0], total, rtol=1e-13)
    none = plan_of([], 1)
    assert points_of(none, SKIN, [])[1].force.shape[1] == 0


@pytest.mark.parametrize("elements", [1, 2, 5, 16, 31])
@pytest.mark.parametrize("spread", [0.001, 0.02, 0.08])
def test_spread_load_has_the_force_and_the_resultant_of_its_arc(
    elements: int, spread: float
) -> None:
    angle, force, turn = 0.25, 7.0, 0.3
    loads = [load(angle, force, turn, spread)]
    _, where, points = placed(plan_of(loads, elements), loads)
    vectors = np.asarray(points.force)[:, :, 0]
    direction = -np.asarray(outward(angle - turn))
    sizes = direction @ vectors
    np.testing.assert_allclose(vectors, direction[:, None] * sizes, rtol=0, atol=1e-12)
    assert np.all(sizes > 0)
    np.testing.assert_allclose(np.sum(sizes), force / 0.123, rtol=1e-13)
    # Moments of the arc's uniform density about its middle: exact up to the cubic.
    half = spread / (2 * OUTER)
    for power in range(6):
        got = np.sum(sizes * (where - angle) ** power) / np.sum(sizes) / half**power
        want = 0.0 if power % 2 else 1 / (power + 1)
        assert abs(got - want) < 1e-12
    assert np.all(np.abs(where - angle) < half)


def test_direction_turns_counter_clockwise_from_the_inward_radial() -> None:
    for angle, turn in itertools.product((-0.7, 0.0, 0.4), (-0.2, 0.0, 1.0)):
        got = np.asarray(load(angle, turn=turn).direction(SKIN.section))[:, 0]
        inward = -np.asarray(outward(angle))
        c, s = np.cos(turn), np.sin(turn)
        want = np.array([[c, -s], [s, c]]) @ inward
        np.testing.assert_allclose(got, want, rtol=0, atol=1e-15)
    vertical = LineLoad(jnp.array([0.4]), jnp.ones(1), jnp.zeros(1), None, vertical=True)
    np.testing.assert_array_equal(vertical.direction(SKIN.section)[:, 0], [0, -1])


def test_tangent_and_normal_frame() -> None:
    angle = jnp.linspace(-1, 1, 5)
    t, n = tangent(angle), outward(angle)
    np.testing.assert_allclose(jax.vmap(jax.jacfwd(outward))(angle).T, t, rtol=0, atol=1e-15)
    np.testing.assert_allclose(jnp.sum(t * n, 0), 0, atol=1e-16)


@pytest.mark.parametrize("spread", [None, 0.01])
def test_load_points_move_smoothly_with_the_inputs(spread: float | None) -> None:
    # The plan is held: stations and points must follow every input exactly.
    at = [load(0.5, spread=spread), load(-0.2)]
    plan = plan_of(at, 9)
    half = 0.0 if spread is None else spread / (2 * OUTER)

    for shift in (-0.03, 1e-7, 0.05):
        moved = [load(0.5 + shift, spread=spread), load(-0.2)]
        angles, where, points = placed(plan, moved)
        assert np.all(np.diff(angles) > 0)
        for end in (-half, half):
            assert np.min(np.abs(angles - (0.5 + shift + end))) < 1e-14
        assert abs(where[-1] + 0.2) < 1e-14
        sizes = np.asarray(points.force)[:, :-1, 0].T @ -np.asarray(outward(0.5 + shift))
        centre = np.sum(sizes * where[:-1]) / np.sum(sizes)
        assert abs(centre - (0.5 + shift)) < 1e-13
    wider = half_cylinder(half_angle=HALF + 0.05)
    angles, where, _ = placed(plan, at, wider)
    np.testing.assert_allclose(angles[[0, -1]], [-HALF - 0.05, HALF + 0.05], atol=1e-15)
    assert abs(where[-1] + 0.2) < 1e-14


def test_a_load_on_anothers_station_has_an_unbiased_derivative() -> None:
    # Two loads at one angle: the second may move either way, so it pulls on both sides.
    loads = [load(0.5), load(0.5)]
    plan = plan_of(loads, 8)
    _, where, points = placed(plan, loads)
    sizes = np.hypot(*np.asarray(points.force)[:, :, 0])
    np.testing.assert_allclose(sizes, np.array([1, 0.5, 0.5]) * 7 / 0.123, rtol=1e-13)
    elements = np.argmax(np.asarray(points.select), 0)[:, 0]
    assert elements[2] == elements[1] + 1
    np.testing.assert_allclose(where, 0.5, rtol=0, atol=1e-14)


def test_meshes_under_spread_loads_differ_in_numbers_alone() -> None:
    # Whatever differs in shape is compiled anew.
    plans = [
        plan_of([load(angle, spread=spread)], 32)
        for angle in (-0.7, 0.1, 0.5)
        for spread in (0.004, 0.007, 0.011)
    ]
    shapes = {tuple(x.shape for x in jax.tree.leaves(plan)) for plan in plans}
    covered = {int(plan.loaded.sum()) for plan in plans}
    assert len(covered) > len(shapes) == 1
