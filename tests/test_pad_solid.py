"""The pad as a solid: one potential behind residual and tangent, rest, the section's solid."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from skins import find, half_cylinder, quick

from suas_jax.constitutive.base import AbstractLaw
from suas_jax.constitutive.deformation_gradient import GeneralDeformation, green
from suas_jax.constitutive.laws.mooney_rivlin import MooneyRivlin
from suas_jax.constitutive.laws.ogden import Ogden
from suas_jax.equilibrium.balance import Problem
from suas_jax.mechanics.pad.model import PadMesh
from suas_jax.mechanics.pad.net import Net, NetTopology
from suas_jax.mechanics.pad_solid.model import PAD_SOLID, PadSolid
from suas_jax.mechanics.pad_solid.points import dilatation, levels, shapes_at, thickness
from suas_jax.mechanics.solid.solid import Solid
from suas_jax.mesh.pad_plan import PadPlan, plan_pad
from suas_jax.numerics.bspline import SplineAxis
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.loads import LoadPoints, PadLoadPoints
from suas_jax.skin.oils.incompressible import IncompressibleOil
from suas_jax.skin.prestress import Growth

ONE = jnp.ones(1)
EPDM = MooneyRivlin(20.7e6 * ONE, -4.4e6 * ONE, 77e3 * ONE)
RUBBER = Ogden(jnp.array([[31.5e6], [60e3], [-500e3]]), jnp.array([[1.3], [5.0], [-2.0]]))
THICK = half_cylinder(radius=0.056, thickness=4e-3)
GROWN = Growth(*(jnp.array([x]) for x in (-1e-3, 2e-3, 5e-3)))


def solid(
    geometry: SkinGeometry,
    law: AbstractLaw,
    axes: tuple[SplineAxis, SplineAxis],
    breaks: tuple[np.ndarray, np.ndarray],
    points: PadLoadPoints,
    degree: int,
) -> PadSolid:
    """A pad on a mesh of one's own."""
    angles, axial = (jnp.asarray(x)[:, None] for x in breaks)
    net = quick(Net.of)(NetTopology(*axes, degree), geometry.section, angles, axial)
    film = geometry.film_area * geometry.width
    own = (law, geometry.section, net, points, film, None, geometry.growth, ())
    return PadSolid(*own, layers=degree + 1)


def small_solid(growth: Growth | None) -> PadSolid:
    """A thick half pad of few uneven elements, with forces all over it."""
    rng = np.random.default_rng(0)
    points = PadLoadPoints(
        jnp.asarray(rng.uniform(-1.2, -0.1, (5, 1))),
        jnp.asarray(rng.uniform(-0.05, -0.01, (5, 1))),
        jnp.asarray(rng.normal(size=(3, 5, 1))),
    )
    axes = SplineAxis(4), SplineAxis(3, right="mirror")
    breaks = np.array([-1.4, -0.6, 0.1, 0.7, 1.4]), np.array([-0.06, -0.045, -0.02, 0.0])
    geometry = dataclasses.replace(THICK, growth=growth)
    return solid(geometry, EPDM, axes, breaks, points, 2)


@quick
def assembled(
    pad: PadSolid, q: jax.Array, p: jax.Array, f: jax.Array, v: jax.Array
) -> tuple[jax.Array, ...]:
    """Residual, tangent times a direction, volume gradient, negative eigenvalues."""
    a = pad.assemble(q, p, f)
    negative = a.tangent.solve(v[:, None]).negative
    return a.residual, a.tangent.mv(v), a.volume_gradient, negative


@quick
def differentiated(
    pad: PadSolid, q: jax.Array, p: jax.Array, f: jax.Array, v: jax.Array
) -> tuple[jax.Array, ...]:
    """The same from the potential alone, by JAX."""
    gradient = jax.grad(lambda q: pad.potential(q, p, f)[0])
    residual, along = jax.jvp(gradient, (q,), (v,))
    return residual, along, jax.grad(lambda q: pad.volume_change(q)[0])(q)


@pytest.fixture(scope="module")
def pads() -> dict[bool, PadSolid]:
    return {grown: small_solid(GROWN if grown else None) for grown in (False, True)}


# Growth is a part of its own of the same potential: one more pair of programs.
@pytest.mark.parametrize("grown", [False, pytest.param(True, marks=pytest.mark.long)])
def test_residual_and_tangent_come_from_the_potential(
    grown: bool, pads: dict[bool, PadSolid]
) -> None:
    pad, rng = pads[grown], np.random.default_rng(1)
    free = pad.topology.free[..., None]
    q, v = (jnp.asarray(rng.uniform(-1, 1, free.shape) * free) for _ in range(2))
    given = 1e-4 * q, jnp.array([2e4]), jnp.array([1.7]), v
    residual, along, gradient, _ = assembled(pad, *given)
    expected = differentiated(pad, *given)
    for found, wanted in zip((residual, along, gradient), expected, strict=True):
        wanted = np.asarray(wanted) * free
        np.testing.assert_allclose(found, wanted, atol=1e-10 * np.max(np.abs(wanted)))


def test_rest_is_free_of_stress_and_stable(pads: dict[bool, PadSolid]) -> None:
    pad = pads[False]
    rest = pad.rest()
    residual, _, _, negative = assembled(pad, rest, 0 * ONE, 0 * ONE, rest + 1)
    np.testing.assert_array_equal(residual, 0)
    assert int(negative[0]) == 0


def test_comparison_meshes_hold_the_deformation(pads: dict[bool, PadSolid]) -> None:
    """Elements halved and joined again; a degree that is not there left out."""
    pad, rng = pads[False], np.random.default_rng(2)

    def of(elements: int) -> PadSolid:
        ends = (jnp.linspace(-x, x, elements + 1)[:, None] for x in (1.4, 0.06))
        topology = NetTopology(SplineAxis(elements), SplineAxis(elements), 2)
        return dataclasses.replace(pad, net=quick(Net.of)(topology, THICK.section, *ends))

    even, finer = of(4), of(8)
    q = jnp.asarray(rng.uniform(-1, 1, even.rest().shape))
    there = even._on_other_elements(q, finer=True)
    back = finer.to_comparison_mesh(there, (4, 4, 2))
    np.testing.assert_allclose(back, q, atol=1e-12)
    place = jnp.array([[0.31]]), jnp.array([[0.012]])
    one, other = (quick(pad.faces)(x, *place) for pad, x in ((even, q), (finer, there)))
    np.testing.assert_allclose(one.inner_strain, other.inner_strain, atol=1e-9)


def on_plan(mesh: PadMesh) -> PadSolid:
    """The thick pad on a mesh, without loads."""
    nothing = PadLoadPoints(*(jnp.zeros((*x, 0, 1)) for x in ((), (), (3,))))
    breaks = 1.4 * mesh.plan.arc, 0.06 * mesh.plan.axial
    assert mesh.degree is not None
    return solid(THICK, EPDM, mesh.plan.axes, breaks, nothing, mesh.degree)


def test_a_state_is_carried_to_other_elements_and_degrees() -> None:
    """A quarter of finer elements, a degree more: nearly the same faces."""

    def plan(elements: int, mirrored: bool) -> PadPlan:
        planes = (mirrored, mirrored)
        size = (elements, elements)
        return plan_pad(1.4, 0.12, 56e-3, 4e-3, [], elements=size, mirrored=planes)

    coarse, fine = (PadMesh(plan(n, False), degree=d) for n, d in ((12, 2), (18, 3)))
    part = PadMesh(plan(18, True), degree=3)
    pad, finer, quarter = (on_plan(mesh) for mesh in (coarse, fine, part))
    topology = pad.topology
    x, z = (np.cos(np.pi / 2 * np.linspace(-1, 1, 13)) ** 2 for _ in range(2))
    size = np.array([0, 1e-3, 0, 0, -2e-3, 0, 0, -3e-3, 0, 2e-4, -1e-4])  # even in both planes
    q = topology.to_stations(jnp.asarray(x[:, None, None] * z[:, None] * size)[..., None])
    angle, axial = (jnp.asarray(np.array(p))[:, None] for p in ([-1.1, -0.3], [-0.04, -0.01]))
    faces = quick(lambda pad, q: pad.faces(q, angle, axial))
    expected = faces(pad, q)
    for mesh, target in ((fine, finer), (part, quarter)):
        moved = PAD_SOLID.carried(np.asarray(q), coarse, mesh)
        found = faces(target, jnp.asarray(moved))
        for name in ("inner_displacement", "mid_displacement", "outer_displacement"):
            np.testing.assert_allclose(
                getattr(found, name), getattr(expected, name), atol=1e-2 * 3e-3
            )
        assert moved.shape == target.rest().shape
    same = PAD_SOLID.carried(np.asarray(q), coarse, coarse)
    np.testing.assert_allclose(same, q * topology.free[..., None], atol=1e-14)


@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_tables_through_the_thickness(degree: int) -> None:
    table, at = thickness(degree, degree + 1), levels(degree)
    np.testing.assert_allclose(shapes_at(degree, at), np.eye(degree + 1), atol=1e-12)
    np.testing.assert_allclose(at[[0, -1]], [-1, 1])
    np.testing.assert_allclose(at**degree @ table.shapes, table.eta**degree, atol=1e-12)
    slope = degree * table.eta ** (degree - 1)
    np.testing.assert_allclose(at**degree @ table.slopes, slope, atol=1e-11)
    product = (table.modes * table.weights) @ table.modes.T
    np.testing.assert_allclose(product, np.diag(2 / (2 * np.arange(degree) + 1)), atol=1e-12)


@pytest.mark.parametrize("law", [EPDM, RUBBER])
def test_a_state_by_its_metric_is_the_one_by_its_gradient(law: AbstractLaw) -> None:
    rng = np.random.default_rng(3)
    L = jnp.asarray(rng.uniform(-1, 1, (3, 3, 5)) * np.array([0, 1e-8, 1e-3, 0.1, 0.4]))
    F = L + np.eye(3)[:, :, None]
    by_gradient = law.energy(GeneralDeformation.of_gradient(F))
    by_metric = law.energy(GeneralDeformation.of_strain(green(L)))
    np.testing.assert_allclose(by_metric, by_gradient, rtol=3e-8, atol=1e-30)
    volume = np.linalg.det(np.moveaxis(np.asarray(F), -1, 0)) - 1
    np.testing.assert_allclose(dilatation(L), volume, atol=1e-15)


def test_a_line_load_between_sliding_ends_is_the_section_s_solid() -> None:
    """Plane strain: the same continuum, discretised in another way."""
    per_width, at = 900.0, 0.0
    force = per_width * jnp.array([0.0, -1.0])
    elements = 48
    ends = jnp.linspace(-np.pi / 2, np.pi / 2, elements + 1)[:, None]
    element = elements // 2
    points = LoadPoints(
        jnp.eye(elements)[:, [element], None], jnp.zeros((1, 1)), force[:, None, None]
    )
    flat = Solid.build(THICK, EPDM, ends, points, layers=4, symmetric=False)
    axial = np.linspace(-0.0615, 0.0615, 4)
    x, w = np.polynomial.legendre.leggauss(2)
    places = (axial[:-1, None] + np.diff(axial)[:, None] * (x + 1) / 2).reshape(-1, 1)
    shares = (np.diff(axial)[:, None] * w / 2).reshape(-1)
    forces = jnp.concatenate([force, jnp.zeros(1)])[:, None] * shares
    axes = SplineAxis(24), SplineAxis(3, "mirror", "mirror")
    breaks = np.pi / 2 * np.sin(np.linspace(-1, 1, 25) * np.pi / 2), axial
    loads = PadLoadPoints(at * jnp.ones_like(places), jnp.asarray(places), forces[..., None])
    pad = solid(THICK, EPDM, axes, breaks, loads, 3)
    one, other = (find(Problem(m, IncompressibleOil(), 0 * ONE)) for m in (flat, pad))
    assert int(one.result[0]) == int(other.result[0]) == 0
    np.testing.assert_allclose(other.state.pressure, one.state.pressure, rtol=3e-3)
    place = 0.6 * ONE
    moved = quick(flat.at_angle)(one.state.q, place).mid_displacement.reshape(2)
    there = quick(pad.faces)(other.state.q, place[None], 0.02 * ONE[None])
    there = there.mid_displacement[:, 0, 0]
    np.testing.assert_allclose(there[:2], moved, atol=5e-3 * np.max(np.abs(moved)))
    np.testing.assert_allclose(there[2], 0, atol=1e-12)
