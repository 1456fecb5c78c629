"""The pad's thin shell: one energy behind residual and tangent, limits, references."""

import dataclasses
import functools
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from skins import find, half_cylinder, quick, shaped

from suas_jax.config import BodyLoadSpec, continuous_inputs
from suas_jax.constitutive.base import AbstractLaw
from suas_jax.constitutive.laws.mooney_rivlin import MooneyRivlin
from suas_jax.constitutive.laws.ogden import Ogden
from suas_jax.equilibrium.balance import Problem, State
from suas_jax.equilibrium.equilibrium import differentiable
from suas_jax.figures.vtu import _pad_grid
from suas_jax.mechanics.pad.faces import Faces, face_displacement, unbent
from suas_jax.mechanics.pad.fibres import energy_density, layers, resultants
from suas_jax.mechanics.pad.loads import pad_load_points
from suas_jax.mechanics.pad.mid_surface import Rest, Surface, components, surface
from suas_jax.mechanics.pad.net import Net, NetTopology
from suas_jax.mechanics.pad.pad import Pad
from suas_jax.mechanics.shell.shell import Shell
from suas_jax.mesh.pad_plan import PadPlan, footprint, mirror_planes, plan_pad
from suas_jax.numerics.bspline import SplineAxis
from suas_jax.scene.parts import skin_parts
from suas_jax.skin.body import Body
from suas_jax.skin.geometry import Sheet, SkinGeometry
from suas_jax.skin.loads import LoadPoints, PadLoad, PadLoadPoints
from suas_jax.skin.oils.incompressible import IncompressibleOil
from suas_jax.skin.prestress import Growth
from suas_jax.skin.wall import RigidLimit, Wall

ONE = jnp.ones(1)
SKIN = half_cylinder()
EPDM = MooneyRivlin(20.7e6 * ONE, -4.4e6 * ONE, 77e3 * ONE)
RUBBER = Ogden(jnp.array([[31.5e6], [60e3], [-500e3]]), jnp.array([[1.3], [5.0], [-2.0]]))


def patch(angle: float, axial: float, force: float, **more: float) -> PadLoad:
    """A radial load on 6 x 6 mm unless told otherwise; angle in degrees."""
    numbers = {"turn": 0.0, "tilt": 0.0} | more
    if "diameter" not in more:
        numbers = {"arc": 6e-3, "length": 6e-3} | numbers
    lanes = {key: x * ONE for key, x in numbers.items()}
    return PadLoad(np.deg2rad(angle) * ONE, axial * ONE, force * ONE, **lanes)


def pad_under(
    loads: list[PadLoad], elements: tuple[int, int] | None = None, fold: bool = True
) -> Pad:
    """The paper's pad under loads."""
    plan = plan_pad(
        np.pi / 2,
        0.123,
        58.25e-3,
        1.5e-3,
        [footprint(load, 59e-3) for load in loads],
        elements=elements,
        mirrored=mirror_planes(loads) if fold else (False, False),
    )
    return built(plan, loads)


@quick
def built(plan: PadPlan, loads: list[PadLoad]) -> Pad:
    """The paper's pad on a mesh."""
    return Pad.build(SKIN, EPDM, plan, loads)


net_of = quick(Net.of)
load_points = quick(pad_load_points)
volume_change = quick(lambda pad, q: pad.volume_change(q))
strain_energy = quick(lambda mechanics, q: mechanics.strain_energy(q))


def trapped(pad: Pad | Shell) -> Problem:
    return Problem(pad, IncompressibleOil(), 0 * ONE)


THICK = half_cylinder(radius=0.056, thickness=4e-3, oil_gap=2e-4)


def small_pad(arc: SplineAxis, axial: SplineAxis, law: AbstractLaw) -> Pad:
    """A thick pad of few uneven elements with forces all over it."""
    rng = np.random.default_rng(0)

    def breaks(axis: SplineAxis, extent: float) -> np.ndarray:
        x = np.linspace(-extent, 0 if axis.right == "mirror" else extent, axis.elements + 1)
        x[1:-1] += 0.05 * extent * rng.uniform(-1, 1, axis.elements - 1)
        return x[:, None]

    points = PadLoadPoints(
        jnp.asarray(rng.uniform(-1.2, -0.1, (5, 1))),
        jnp.asarray(rng.uniform(-0.05, -0.01, (5, 1))),
        jnp.asarray(rng.normal(size=(3, 5, 1))),
    )
    angles, positions = (jnp.asarray(breaks(*x)) for x in ((arc, 1.4), (axial, 0.06)))
    net = net_of(NetTopology(arc, axial), THICK.section, angles, positions)
    return Pad(law, THICK.section, net, points, 1e-4 * ONE, None, None, ())


CASES = {
    "whole": (SplineAxis(4), SplineAxis(3), EPDM),
    "sliding ends, half, kinked": (
        SplineAxis(3, right="mirror", multiplicity=(1, 2)),
        SplineAxis(6, "mirror", "mirror"),
        EPDM,
    ),
}

assemble = quick(lambda pad, q, p, f: pad.assemble(q, p, f))
omitted = quick(lambda pad, q, f: pad.omitted_gradient(q, f))
product = quick(lambda tangent, v: tangent.mv(v))
products_of = quick(lambda tangent, directions: jax.vmap(tangent.mv)(directions))
solve = quick(lambda tangent, right: tangent.solve(right).solution)


@quick
def gradients(pad: Pad, q: jax.Array, p: jax.Array, f: jax.Array) -> tuple[jax.Array, ...]:
    """Gradients of the potential, the volume and the work."""
    return (
        jax.grad(lambda q: pad.potential(q, p, f)[0])(q),
        jax.grad(lambda q: pad.volume_change(q)[0])(q),
        jax.grad(lambda q: pad.work(q)[0])(q),
    )


@quick
def products(
    pad: Pad, q: jax.Array, p: jax.Array, f: jax.Array, directions: jax.Array
) -> jax.Array:
    """The potential's Hessian times directions."""
    gradient = jax.grad(lambda q: pad.potential(q, p, f)[0])
    return jax.lax.map(lambda v: jax.jvp(gradient, (q,), (v,))[1], directions)


def state_of(pad: Pad, size: float) -> tuple[jax.Array, jax.Array, np.ndarray]:
    """A random state, directions, and what is free."""
    free = pad.topology.free[..., None]
    rng = np.random.default_rng(1)
    q = jnp.asarray(rng.uniform(-1, 1, free.shape) * size * free)
    return q, jnp.asarray(rng.uniform(-1, 1, (3, *free.shape)) * free), free


PRESSURE, FACTOR = jnp.array([2e4]), jnp.array([1.7])


@pytest.mark.long  # derivatives of each net; those with the wall below hold them
@pytest.mark.parametrize("name", CASES)
def test_residual_and_tangent_come_from_the_potential(name: str) -> None:
    pad = small_pad(*CASES[name])
    q, directions, free = state_of(pad, 2e-3)
    got = assemble(pad, q, PRESSURE, FACTOR)
    expected = gradients(pad, q, PRESSURE, FACTOR)
    for a, b in zip((got.residual, got.volume_gradient, got.load), expected, strict=True):
        np.testing.assert_allclose(a, b * free, rtol=0, atol=1e-12 * np.max(np.abs(b)))
    np.testing.assert_allclose(got.volume_change, volume_change(pad, q), rtol=1e-12)
    for v in directions:
        ahead, back = (
            assemble(pad, q + h * v, PRESSURE, FACTOR).residual for h in (1e-8, -1e-8)
        )
        wanted = (ahead - back) / 2e-8
        scale = np.max(np.abs(wanted))
        np.testing.assert_allclose(product(got.tangent, v), wanted, rtol=0, atol=1e-7 * scale)


def test_a_factor_on_the_loads_scales_what_they_do_where_the_membrane_thins() -> None:
    """Curves and tables follow one pad through factors; scenes have them in their forces."""
    pad = small_pad(*CASES["whole"])
    q, _, _ = state_of(pad, 2e-4)
    stronger = dataclasses.replace(pad.points, force=FACTOR * pad.points.force)
    found = omitted(pad, q, FACTOR)
    np.testing.assert_allclose(
        found, omitted(dataclasses.replace(pad, points=stronger), q, ONE), rtol=1e-12
    )
    # The part of the loads is proportional to their factor, and felt.
    free, once = omitted(pad, q, 0 * ONE), omitted(pad, q, ONE)
    scale = np.max(np.abs(found))
    np.testing.assert_allclose(found, free + FACTOR * (once - free), atol=1e-12 * scale)
    assert np.max(np.abs(once - free)) > 1e-9 * scale


PLACES_OF_SHEETS = ((0.0, 0.3, 1.0), (0.0, 0.4, 0.7, 1.0))


def test_the_energy_that_is_reported_has_one_number_a_lane() -> None:
    """As derivatives by name ask for: two axes are a column over the taxels."""
    pad = small_pad(*CASES["whole"])
    q = jnp.zeros((*pad.topology.free.shape, 1))
    stored = eqx.filter_eval_shape(lambda pad, q: pad.around(q).stored_energy(q), pad, q)
    assert stored.shape == (1,)


def sheet(mean: float, change: float) -> Sheet:
    """A length that varies along the arc and along the axis."""
    values = mean + change * np.random.default_rng(3).uniform(-1, 1, (3, 4, 1))
    return Sheet(PLACES_OF_SHEETS, jnp.asarray(values), 0.12 * ONE)


def test_contact_with_the_wall_comes_from_its_energy() -> None:
    """Of a membrane and a film that vary along the axis, too."""
    free_pad = small_pad(*CASES["sliding ends, half, kinked"])
    free_pad = dataclasses.replace(free_pad, relief=sheet(4e-3, 1e-3).beyond_mean())
    q, directions, free = state_of(free_pad, 2e-3)
    law = RigidLimit(1e9 * ONE, 1e-4 * ONE)
    uneven = dataclasses.replace(THICK, gap_along=sheet(2e-4, 1e-4))
    pad = free_pad.with_wall(Wall(uneven, law))
    gap = quick(lambda pad, q: pad.contact(q, pad.wall).gap)(pad, q)
    assert 0.05 < np.mean(gap < 0) < 0.95
    without = assemble(free_pad, q, PRESSURE, FACTOR)
    got = assemble(pad, q, PRESSURE, FACTOR)
    wanted, *others = gradients(pad, q, PRESSURE, FACTOR)
    change = np.max(np.abs(got.residual - without.residual))
    np.testing.assert_allclose(got.residual, wanted * free, rtol=0, atol=1e-11 * change)
    for a, b in zip((got.volume_gradient, got.load), others, strict=True):
        np.testing.assert_allclose(a, b * free, rtol=0, atol=1e-12 * np.max(np.abs(b)))
    moved = products_of(got.tangent, directions)
    expected = products(pad, q, PRESSURE, FACTOR, directions) * free
    scale = np.max(np.abs(expected))
    np.testing.assert_allclose(moved, expected, rtol=0, atol=1e-11 * scale)


# Friction's program holds what is left without it.
@pytest.mark.parametrize("friction", [pytest.param(None, marks=pytest.mark.long), 0.4])
def test_contact_with_a_body_comes_from_its_energy(friction: float | None) -> None:
    """A turned box and the half pad: forces, stiffness, and forces by the body's travel.

    Friction has an energy where its bound is known, here that of another state.
    """
    free_pad = small_pad(*CASES["sliding ends, half, kinked"])
    q, directions, free = state_of(free_pad, 2e-3)
    given = {"shape": "box", "size": (0.03, 0.05), "edge": 0.004, "angle": -0.4, "depth": 3e-3}
    numbers = {"size.0": 0.03, "size.1": 0.05, "edge": 0.004, "turn": 0.3, "depth": 3e-3}
    if friction is not None:
        more = {"friction": friction, "drag": 2e-3, "drag_axial": -1e-3}
        given, numbers = given | more, numbers | more
    spec = BodyLoadSpec(**given)
    law, places = RigidLimit(1e9 * ONE, 1e-4 * ONE), (-0.4 * ONE, -0.02 * ONE)
    box = Body.of(spec, THICK.section, places, lambda key: numbers[key] * ONE, law)
    pad = free_pad.with_bodies([box])
    if friction is not None:
        pad = quick(lambda pad, q: pad.gripped(q, FACTOR))(pad, 1.1 * q)
        assert np.max(pad.bodies[0].grip.bound) > 0
    contact = quick(lambda pad, q: pad.touched(q, pad.bodies[0].placed(FACTOR)))(pad, q)
    assert 0.01 < np.mean(contact.gap < 0) < 0.95
    without = assemble(free_pad, q, PRESSURE, FACTOR)
    got = assemble(pad, q, PRESSURE, FACTOR)
    energy = quick(jax.grad(lambda q, pad: jnp.sum(pad.contact_energy(q, FACTOR))))
    wanted = energy(q, pad) * free
    scale = np.max(np.abs(wanted))
    np.testing.assert_allclose(got.contact, wanted, rtol=0, atol=1e-11 * scale)
    np.testing.assert_allclose(
        got.residual - without.residual, wanted, rtol=0, atol=1e-10 * scale
    )
    step = 1e-6
    ahead, back = (assemble(pad, q, PRESSURE, FACTOR + s * step).contact for s in (1, -1))
    by_travel = -(ahead - back) / (2 * step)
    np.testing.assert_allclose(
        got.by_travel, by_travel, rtol=0, atol=1e-5 * np.max(np.abs(by_travel))
    )
    moved = products_of(got.tangent, directions)
    expected = products(pad, q, PRESSURE, FACTOR, directions) * free
    scale = np.max(np.abs(expected))
    np.testing.assert_allclose(moved, expected, rtol=0, atol=1e-10 * scale)
    # The sum of what the points push is what the body feels.
    along = jnp.einsum("ij,jabl->iabl", box.frame[..., 0], contact.force)
    assert float(jnp.sum(along[2])) > 0


@pytest.mark.parametrize(
    ("shape", "depth"),
    [
        ({"shape": "sphere", "radius": 3e-4}, 2e-3),  # between the points that bound the others
        ({"shape": "sphere", "radius": 0.01}, -8e-3),  # nowhere near
        ({"shape": "cylinder", "radius": 5e-3, "length": 0.04}, 2e-3),
        ({"shape": "box", "size": (0.3, 0.3), "edge": 1e-3}, 0.04),  # over most of the pad
    ],
)
def test_points_far_from_a_body_are_left_out_without_loss(
    shape: dict[str, Any], depth: float
) -> None:
    pad = small_pad(*CASES["sliding ends, half, kinked"])
    q, _, _ = state_of(pad, 1e-3)
    spec = BodyLoadSpec(**shape, angle=-0.4, depth=depth)
    given: dict[str, Any] = {"turn": 0.3, "depth": depth} | shape
    given |= {f"size.{i}": x for i, x in enumerate(shape.get("size", ()))}
    places = (-0.43 * ONE, -0.021 * ONE)
    law = RigidLimit(1e9 * ONE, 1e-4 * ONE)
    body = Body.of(spec, THICK.section, places, lambda key: given[key] * ONE, law)
    placed = body.placed(ONE)

    def at_all(pad: Pad, q: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
        face = pad.one_lane().face_against(placed, q[..., 0])
        every = face.points(face.elements)
        found = every.touched()
        return every.energy(), jnp.min(found.gap), jnp.sum(found.force, (1, 2))

    energy, lowest, force = quick(at_all)(pad, q)
    touched = quick(lambda pad, q: pad.touched(q, placed))(pad, q)
    np.testing.assert_allclose(touched.gap.min(), lowest, rtol=1e-12)
    np.testing.assert_allclose(np.sum(touched.force, (1, 2))[:, 0], force, rtol=1e-12)
    pushed = quick(lambda pad, q: jax.jvp(lambda q: pad.pushed(q, placed), (q,), (q,)))(pad, q)
    np.testing.assert_allclose(pushed[0][:, 0], force, rtol=1e-12)
    moved = quick(lambda pad, q: jax.jvp(lambda q: at_all(pad, q)[2], (q,), (q,))[1])(pad, q)
    np.testing.assert_allclose(pushed[1][:, 0], moved, rtol=1e-9)
    got = quick(lambda pad, q: pad.contact_energy(q))(pad.with_bodies([body]), q)
    np.testing.assert_allclose(got[0], energy, rtol=1e-12)
    assert (lowest > 0) == (float(energy) == 0)


@pytest.mark.long  # second derivatives of another net; those with the wall above
def test_the_tangent_is_the_hessian_to_the_last_digits() -> None:
    pad = small_pad(*CASES["whole"])
    for size in (0.0, 2e-3):
        q, directions, free = state_of(pad, size)
        got = products_of(assemble(pad, q, PRESSURE, FACTOR).tangent, directions)
        wanted = products(pad, q, PRESSURE, FACTOR, directions) * free
        np.testing.assert_allclose(got, wanted, rtol=0, atol=1e-12 * np.max(np.abs(wanted)))


def test_rest_is_free_of_stress_to_the_last_digit() -> None:
    pad = small_pad(*CASES["whole"])
    got = assemble(pad, pad.rest(), 0 * ONE, 0 * ONE)
    assert np.all(np.asarray(got.residual) == 0)
    assert np.all(np.asarray(got.volume_change) == 0)
    assert np.all(np.asarray(strain_energy(pad, pad.rest())) == 0)


def test_tiny_displacements_lose_no_digits() -> None:
    pad = small_pad(*CASES["whole"])
    free = pad.topology.free[..., None]
    v = jnp.asarray(np.random.default_rng(1).uniform(-1, 1, free.shape) * free)
    tangent = assemble(pad, pad.rest(), 0 * ONE, 0 * ONE).tangent
    got = assemble(pad, 1e-12 * v, 0 * ONE, 0 * ONE)
    linear = np.asarray(product(tangent, v))
    error = np.max(np.abs(np.asarray(got.residual) * 1e12 - linear)) / np.max(np.abs(linear))
    assert error < 1e-8


# Points: what the energy of a fibre is a function of.


def random_derivatives(size: float) -> np.ndarray:
    scale = size * np.array([0.06, 1.0, 1.0, 300.0, 300.0, 300.0])[:, None, None]
    return np.random.default_rng(2).uniform(-1, 1, (6, 3, 7)) * scale


def density(u: np.ndarray, angle: np.ndarray, law: AbstractLaw = EPDM) -> np.ndarray:
    @quick
    def energy(law: AbstractLaw, u: jax.Array, angle: jax.Array) -> jax.Array:
        s = surface(list(u), Rest.of(SKIN.section, angle))
        return energy_density(law, s, layers(3, s.rest, None))

    return np.asarray(energy(law, jnp.asarray(u), jnp.asarray(angle)))


@pytest.mark.parametrize("law", [EPDM, pytest.param(RUBBER, marks=pytest.mark.long)])
def test_resultants_are_derivatives_of_the_energy(law: AbstractLaw) -> None:
    rest = Rest.of(SKIN.section, jnp.linspace(-1.5, 1.5, 7))
    fibres = layers(3, rest, None)

    def energy(six: jax.Array, s: Surface) -> jax.Array:
        rows = [x[None] for x in six]
        s = s._replace(metric=components(rows[:3]), bending=components(rows[3:]))
        return energy_density(law, s, fibres)[0]

    @quick
    def both(u: jax.Array) -> tuple[jax.Array, ...]:
        s = surface(list(u), rest)
        six = jnp.stack([*s.metric, *s.bending])
        found = resultants(law, s, fibres)
        one = jax.tree.map(lambda x: x[..., :1], s)
        gradient = jax.vmap(jax.grad(energy), (1, None), 1)(six, one)
        hessian = jax.vmap(jax.hessian(energy), (1, None), 2)(six, one)
        rows = jnp.stack([jnp.stack(row) for row in found.second])
        return jnp.stack(found.first), gradient, rows, hessian

    # Per unit of strain and of curvature times thickness.
    unit = np.array([1.0] * 3 + [1 / float(SKIN.thickness[0])] * 3)[:, None]
    for size in (1e-9, 0.1):
        first, gradient, second, hessian = both(jnp.asarray(random_derivatives(size)))
        scale = np.max(np.abs(gradient) * unit)
        np.testing.assert_allclose(first * unit, gradient * unit, rtol=0, atol=1e-11 * scale)
        square = unit[:, None] * unit
        scale = np.max(np.abs(hessian) * square)
        np.testing.assert_allclose(
            second * square, hessian * square, rtol=0, atol=1e-11 * scale
        )


@pytest.mark.parametrize("law", [EPDM, RUBBER])
def test_rigid_motions_cost_no_energy(law: AbstractLaw) -> None:
    angle = np.linspace(-1.5, 1.5, 7)
    sine, cosine, zero = np.sin(angle), np.cos(angle), np.zeros(7)
    radius = float(SKIN.mid_size[0])
    n, t = np.stack([sine, cosine, zero]), np.stack([cosine, -sine, zero])
    z = np.stack([zero, zero, zero + 1])
    rest = np.stack([radius * n, t, z, -n / radius, 0 * n, 0 * n])
    axis = np.array([0.3, -1.1, 0.7])
    cross = np.cross(np.eye(3), axis)
    size = np.linalg.norm(axis)
    turn = (
        np.eye(3) + np.sin(size) / size * cross + (1 - np.cos(size)) / size**2 * cross @ cross
    )
    u = random_derivatives(0.05)
    turned = np.einsum("cd,kdp->kcp", turn, rest + u) - rest
    np.testing.assert_allclose(density(turned, angle, law), density(u, angle, law), rtol=1e-10)
    still = density(np.einsum("cd,kdp->kcp", turn, rest) - rest, angle, law)
    assert np.max(np.abs(still)) < 1e-20 * float(law.shear_modulus[0])


@pytest.mark.parametrize("law", [EPDM, RUBBER])
def test_in_plane_strain_a_fibre_is_the_section_s(law: AbstractLaw) -> None:
    u, angle = random_derivatives(0.1), np.linspace(-1.5, 1.5, 7)
    u[[2, 4, 5]] = 0
    u[:, 2] = 0
    section = LoadPoints(jnp.zeros((1, 0, 1)), jnp.zeros((0, 1)), jnp.zeros((2, 0, 1)))
    ends = jnp.array([[-1.0], [1.0]])
    shell = Shell.build(SKIN, law, ends, section, symmetric=False)
    sine, cosine, radius = np.sin(angle), np.cos(angle), float(SKIN.mid_size[0])
    r1 = np.stack([cosine, -sine]) + u[1, :2]
    r2 = u[3, :2] - np.stack([sine, cosine]) / radius
    a = np.sum(r1**2, 0)
    curvature = (r2[0] * r1[1] - r2[1] * r1[0]) / a - 1 / radius
    fibres = shell.fibres(SKIN.section.frame(jnp.asarray(angle)[:, None]))
    wanted = fibres.energy(*(jnp.asarray(x)[:, None] for x in (a - 1, curvature)))
    np.testing.assert_allclose(density(u, angle, law), wanted.reshape(-1), rtol=1e-9)


# The pad between sliding ends.


def test_a_membrane_is_the_same_from_any_surface_in_it() -> None:
    """A tube that widens: from its middle, and from a surface nearer to its inner face."""
    inner, thick, nearer, widened = 56e-3, 4e-3, 1e-3, 57e-3

    def energy(radius: float, below: float) -> tuple[np.ndarray, np.ndarray]:
        """Per angle, and the displacement of the outer face."""
        section = half_cylinder(radius - below, 2 * below).section
        now = np.sqrt(widened**2 + radius**2 - inner**2)  # keeps the volume below it
        sine, cosine = np.sin(0.4), np.cos(0.4)
        out, by_arc = (now - radius), (now - radius) / radius
        rows = np.zeros((6, 3, 1))
        rows[0, :2, 0] = out * sine, out * cosine
        rows[1, :2, 0] = by_arc * cosine, -by_arc * sine
        rows[3, :2, 0] = -by_arc / radius * sine, -by_arc / radius * cosine
        rest = Rest.of(section, jnp.array([0.4]), thick - 2 * below)
        s, fibres = surface(list(jnp.asarray(rows)), rest), layers(8, rest, None)
        moved = jnp.stack(face_displacement(s, rest.above, None)[0])
        return np.asarray(radius * energy_density(EPDM, s, fibres)), np.asarray(moved)

    middle, other = (energy(inner + below, below) for below in (thick / 2, nearer))
    np.testing.assert_allclose(other[0], middle[0], rtol=1e-9)
    np.testing.assert_allclose(other[1], middle[1], rtol=1e-9)
    outer = np.sqrt(widened**2 + (inner + thick) ** 2 - inner**2) - inner - thick
    np.testing.assert_allclose(np.linalg.norm(middle[1]), outer, rtol=1e-9)


LEANING: dict[str, Any] = {
    "section": "ellipse",
    "inner_semi_axes": ["57.5 mm", "45 mm"],
    "half_angle": "70 deg",
    "thickness": {"arc": [0, 0.4, 1], "value": ["1.5 mm", "1.2 mm", "1.8 mm"]},
}


def leaning() -> SkinGeometry:
    """An elliptic skin of uneven thickness whose edges don't point down."""
    spec = shaped(LEANING)
    return quick(lambda inputs: skin_parts(spec, inputs).geometry)(continuous_inputs(spec))


def leaning_by_sheets() -> SkinGeometry:
    """The same, its table and its gap written as tables along the axis as well."""
    even = {"axial": [0, 0.4, 1]}
    rows = [[value] * 3 for value in LEANING["thickness"]["value"]]
    tables = {
        "thickness": LEANING["thickness"] | even | {"value": rows},
        "oil_gap": {"arc": [0, 1], "value": [["5 mm"] * 3] * 2} | even,
        "ends": "clamped",
    }
    spec = shaped(LEANING | tables)
    return quick(lambda inputs: skin_parts(spec, inputs).geometry)(continuous_inputs(spec))


def grown() -> SkinGeometry:
    """The paper's skin with a membrane too short for its seat, too wide and too thick."""
    growth = Growth(*(jnp.array([x]) for x in (-1e-3, 2e-3, 5e-3)))
    return dataclasses.replace(half_cylinder(), growth=growth)


@pytest.mark.parametrize(
    "skin",
    # Each has programs of its own: `grown` holds the half-cylinder; tests/test_sections.py has
    # what `leaning` and sheets give of the mid-line.
    [
        pytest.param(half_cylinder, marks=pytest.mark.long),
        pytest.param(leaning, marks=pytest.mark.long),
        grown,
        pytest.param(leaning_by_sheets, marks=pytest.mark.long),
    ],
)
def test_a_line_load_between_sliding_ends_is_the_section_s_shell(
    skin: Callable[[], SkinGeometry],
) -> None:
    """Knots doubled, the splines along the arc are the section's Hermite elements."""
    geometry = skin()
    elements, gauss, per_width = 12, 5, 100.0
    angles = jnp.linspace(-np.pi / 2, np.pi / 2, elements + 1)[:, None]
    at, turn = 0.35, 0.5
    element = int(np.searchsorted(angles[:, 0], at) - 1)
    xi = (at - angles[element, 0]) / (angles[element + 1, 0] - angles[element, 0])
    force = per_width * jnp.array([-np.sin(at - turn), -np.cos(at - turn)])
    points = LoadPoints(
        jnp.eye(elements)[:, [element], None], xi * jnp.ones((1, 1)), force[:, None, None]
    )
    shell = Shell.build(geometry, EPDM, angles, points, symmetric=False)
    shell = dataclasses.replace(shell, gauss=gauss)
    axial = jnp.linspace(-0.0615, 0.0615, 4)[:, None]
    x, w = np.polynomial.legendre.leggauss(2)
    places = (axial[:-1] + jnp.diff(axial, axis=0) * (x + 1) / 2).reshape(-1, 1)
    shares = (jnp.diff(axial, axis=0) * w / 2).reshape(-1)
    forces = jnp.concatenate([force, jnp.zeros(1)])[:, None] * shares
    topology = NetTopology(
        SplineAxis(elements, multiplicity=(2,) * (elements - 1)),
        SplineAxis(3, "mirror", "mirror"),
    )
    pad = Pad(
        EPDM,
        geometry.section,
        net_of(topology, geometry.section, angles, axial),
        PadLoadPoints(at * jnp.ones_like(places), places, forces[..., None]),
        geometry.film_area * geometry.width,
        None,
        geometry.growth,
        (),
        gauss=gauss,
        relief=geometry.relief,
    )
    section, whole = find(trapped(shell)), find(trapped(pad))
    pressure = float(section.state.pressure[0])
    assert abs(pressure) > 1000
    np.testing.assert_allclose(whole.state.pressure, pressure, rtol=1e-9)
    np.testing.assert_allclose(
        strain_energy(pad, whole.state.q),
        strain_energy(shell, section.state.q) * geometry.width,
        rtol=1e-9,
    )


# The paper's pad.

PLACES = [
    patch(17.3, -13e-3, 3.0, turn=0.3, tilt=0.2),
    patch(-33, 21e-3, 3.0, diameter=8e-3, tilt=-0.4),
    dataclasses.replace(patch(25, 5e-3, 4.0, length=50e-3, turn=-0.2), arc=None),
]


def idle(loads: list[PadLoad]) -> list[PadLoad]:
    """The same loads without force: other scenes share one program with these."""
    return [dataclasses.replace(load, force=0 * ONE) for load in loads]


def plan_of(loads: list[PadLoad]) -> PadPlan:
    """24 x 20 elements of the whole pad."""
    places = [footprint(load, 59e-3) for load in loads]
    return plan_pad(np.pi / 2, 0.123, 58.25e-3, 1.5e-3, places, elements=(24, 20))


def solved(pad: Pad, start: State | None = None) -> State:
    """The equilibrium, from one nearby where that is known."""
    near = State(pad.rest(), 0 * ONE, 0 * ONE)
    if start is not None:
        near = start
    found = find(trapped(pad), near)
    assert int(found.result[0]) == 0
    return found.state


@functools.cache
def crown(force: float) -> tuple[Pad, jax.Array, jax.Array]:
    pad = pad_under([patch(0, 0, force)])
    found = find(trapped(pad))
    assert int(found.result[0]) == 0
    return pad, found.state.q, found.state.pressure


at_places = quick(lambda pad, q, angle, axial: pad.faces(q, angle, axial))


@pytest.mark.parametrize("name", CASES)
def test_a_grid_of_samples_is_what_its_places_are(name: str) -> None:
    pad = small_pad(*CASES[name])
    q, _, _ = state_of(pad, 1e-3)
    grid = quick(lambda pad, q: pad.sampled(q, 3))(pad, q)
    at_each = at_places(pad, q, *(x.reshape(-1, 1) for x in (grid.angle, grid.axial)))
    for got, wanted in zip(grid, at_each, strict=True):
        np.testing.assert_allclose(got.reshape(wanted.shape), wanted, rtol=1e-9, atol=1e-14)


def test_a_correction_stretches_the_faces_and_does_not_bend_them() -> None:
    inner, outer, stretched, bent = np.random.default_rng(4).normal(size=(4, 3, 5, 1))
    none = jnp.zeros((5, 1))

    def faces(inner: np.ndarray, outer: np.ndarray, energy: float) -> Faces:
        still = (jnp.zeros((3, 5, 1)),) * 3
        strains = jnp.asarray(inner), jnp.asarray(outer)
        return Faces(none, none, *still, *strains, none + energy)

    equilibrium = faces(inner, outer, 1.0)
    shown = faces(inner + stretched - bent, outer + stretched + bent, 2.0)
    found = unbent(shown, equilibrium)
    np.testing.assert_allclose(found.inner_strain, inner + stretched, atol=1e-14)
    np.testing.assert_allclose(found.outer_strain, outer + stretched, atol=1e-14)
    np.testing.assert_array_equal(found.energy_density, 1.0)


def test_what_a_pad_writes_for_paraview_is_around_its_equilibrium() -> None:
    """As its report is: a correction of rest bends nothing and stores no energy."""
    pad = small_pad(*CASES["whole"])
    q = 1e-5 * np.random.default_rng(2).normal(size=(*pad.topology.free.shape, 1))

    def written(pad: Pad, rest: jax.Array, q: jax.Array) -> Faces:
        state, shown = (SimpleNamespace(q=x) for x in (rest, q))
        return _pad_grid(SimpleNamespace(mechanics=pad), state, shown)[0]

    found = quick(written)(pad, 0 * q, q * pad.topology.free[..., None])
    assert np.abs(found.inner_strain).max() > 1e-6
    np.testing.assert_allclose(found.inner_strain, found.outer_strain, atol=1e-15)
    np.testing.assert_array_equal(found.energy_density, 0.0)


@pytest.mark.long  # a fine net is solved; splines in test_bspline
def test_a_finer_mesh_holds_the_same_deformation() -> None:
    pad, q, _ = crown(6.0)
    plan = plan_pad(
        np.pi / 2, 0.123, 58.25e-3, 1.5e-3, [footprint(patch(0, 0, 6.0), 59e-3)],
        mirrored=(True, True),
    )  # fmt: skip
    finer = built(plan.refined(), [patch(0, 0, 6.0)])
    angle, axial = (jnp.asarray(x)[:, None] for x in ([-1.2, -0.3, -0.01], [-0.05, -0.02, 0]))
    coarse = at_places(pad, q, angle, axial).mid_displacement
    fine = at_places(
        finer, quick(Pad.to_comparison_mesh)(pad, q, plan.refined().elements), angle, axial
    ).mid_displacement
    # Next to the curved ends the tangential control values obey the clamp of their mesh.
    np.testing.assert_allclose(fine, coarse, rtol=0, atol=1e-4 * np.max(np.abs(coarse)))


def test_heights_along_rays_are_those_of_the_deformed_face() -> None:
    pad = small_pad(*CASES["whole"])
    q, directions, _ = state_of(pad, 2e-4)
    rng = np.random.default_rng(3)
    angle = jnp.asarray(rng.uniform(-1.3, 1.3, (20, 1)))
    axial = jnp.asarray(rng.uniform(-0.055, 0.055, (20, 1)))
    moved = np.asarray(at_places(pad, q, angle, axial).inner_displacement)[:, :, 0]
    inner, place = 56e-3, np.asarray(angle)[:, 0]
    x, y = inner * np.sin(place) + moved[0], inner * np.cos(place) + moved[1]
    polar, along = np.arctan2(x, y)[:, None], (np.asarray(axial)[:, 0] + moved[2])[:, None]
    got = quick(Pad.height_at)(pad, q, jnp.asarray(polar), jnp.asarray(along))
    np.testing.assert_allclose(inner + got[:, 0], np.hypot(x, y), rtol=1e-9)
    # The same from places nearby, and what a further displacement does to them.
    by, step = directions[0], 1e-7

    def followed(pad: Pad, q: jax.Array, by: jax.Array, near: Any) -> tuple[jax.Array, ...]:
        lane = pad.one_lane()
        at = lane.on_rays(q[..., 0], jnp.asarray(polar)[:, 0], jnp.asarray(along)[:, 0], near)
        return at.height, lane.heights_moved(q[..., 0], at, by[..., 0])

    near = jnp.asarray(place + 1e-3), jnp.asarray(np.asarray(axial)[:, 0] - 1e-4)
    height, slope = quick(followed)(pad, q, by, near)
    np.testing.assert_allclose(height, got[:, 0], rtol=0, atol=1e-5 * 5e-3)
    ahead, back = (
        quick(Pad.height_at)(pad, q + s * by, jnp.asarray(polar), jnp.asarray(along))[:, 0]
        for s in (step, -step)
    )
    wanted = (ahead - back) / (2 * step)
    np.testing.assert_allclose(slope, wanted, rtol=0, atol=2e-3 * np.abs(wanted).max())

    # Other points come to lie on the rays, which derivatives of every order have to know.
    def twice(pad: Pad, q: jax.Array, by: jax.Array) -> tuple[jax.Array, jax.Array]:
        def once(share: jax.Array) -> jax.Array:
            def height(share: jax.Array) -> jax.Array:
                return pad.height_at(q + share * by, jnp.asarray(polar), jnp.asarray(along))

            return jax.jvp(height, (share,), (jnp.ones(()),))[1][:, 0]

        return jax.jvp(once, (jnp.zeros(()),), (jnp.ones(()),))

    first, second = quick(twice)(pad, q, by)
    np.testing.assert_allclose(first, wanted, rtol=0, atol=1e-5 * np.abs(wanted).max())
    ahead, back = (quick(twice)(pad, q + s * by, by)[0] for s in (step, -step))
    bent = (ahead - back) / (2 * step)
    np.testing.assert_allclose(second, bent, rtol=0, atol=1e-5 * np.abs(bent).max())


@pytest.mark.long
def test_displacements_converge_with_the_order_of_the_splines() -> None:
    load = patch(0, 0, 1.0, arc=40e-3, length=40e-3)

    def compliance(count: int) -> float:
        pad = pad_under([load], (count, count))
        at_rest = assemble(pad, pad.rest(), 0 * ONE, ONE)
        moved = solve(at_rest.tangent, at_rest.load[:, None])
        return float(jnp.sum(moved[:, 0] * at_rest.load))

    coarse, fine, best = compliance(12), compliance(18), compliance(30)
    # The patch ends inside elements, which costs half an order.
    assert abs(fine / best - 1) < abs(coarse / best - 1) / 1.5**3.5
    assert abs(fine / best - 1) < 2e-2


# Loads.


@pytest.mark.parametrize("load", PLACES)
def test_forces_add_up_to_the_load(load: PadLoad) -> None:
    points = load_points(plan_of([load]), SKIN, [load])
    total = np.sum(np.asarray(points.force), 1)
    np.testing.assert_allclose(
        total, load.force * load.direction(SKIN.section), rtol=1e-12, atol=1e-15
    )
    share = (
        np.asarray(points.force)[1] / np.asarray(load.force * load.direction(SKIN.section))[1]
    )
    centre = [np.sum(share * np.asarray(x), 0) for x in (points.angle, points.axial)]
    np.testing.assert_allclose(centre, [load.angle, load.axial], rtol=1e-12)


@pytest.mark.long
def test_derivatives_by_place_and_size_are_those_of_differences() -> None:
    plan = plan_of(PLACES)
    state = solved(built(plan, PLACES))

    @quick
    def change(loads: list[PadLoad], along: list[PadLoad]) -> jax.Array:
        def pressure(loads: list[PadLoad]) -> jax.Array:
            pad = Pad.build(SKIN, EPDM, plan, loads)
            return differentiable(trapped(pad), state).pressure

        return eqx.filter_jvp(pressure, (loads,), (along,))[1]

    def pressure(loads: list[PadLoad]) -> float:
        return float(solved(built(plan, loads), state).pressure[0])

    zero = jax.tree.map(jnp.zeros_like, PLACES)
    for which, name, step in (
        (0, "angle", 1e-5),
        (0, "axial", 1e-6),
        (0, "length", 1e-5),
        (1, "angle", 1e-5),
        (1, "diameter", 1e-5),
        (2, "axial", 1e-5),
    ):
        along = eqx.tree_at(lambda x, w=which, n=name: getattr(x[w], n), zero, ONE)
        ahead, back = (
            eqx.apply_updates(PLACES, jax.tree.map(lambda d, h=h: h * d, along))
            for h in (step, -step)
        )
        wanted = (pressure(ahead) - pressure(back)) / (2 * step)
        np.testing.assert_allclose(change(PLACES, along), wanted, rtol=1e-6)
