"""The lumped shell: one energy behind residual and tangent, and exact solutions."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from skins import LAWS, built, line, problem_of, quick, scene

from suas_jax.constitutive.deformation import LogStretches
from suas_jax.mechanics.section import SectionShape
from suas_jax.mechanics.shell.shell import Shell
from suas_jax.numerics.bordered_solve import BorderedBlockTridiagonal, BorderedVector, eliminate
from suas_jax.scene.build import plan_for

ELEMENTS = 4
TURNED = line(20, 5, direction="35 deg")
SPREAD = line(-15, 9, spread="8 mm")
CASES = {
    "mooney-rivlin, whole arc": ("mooney-rivlin", False, [TURNED, SPREAD]),
    "ogden, half arc": ("ogden", True, [line(0, 5), line(-18, 3), line(18, 3)]),
    "yeoh, whole arc": ("yeoh", False, [SPREAD]),
    "neo-hookean, half arc": ("neo-hookean", True, [line(0, 9, spread="8 mm")]),
}
# Both kinds of law, both kinds of arc; the other two compile programs of their own.
shell_cases = pytest.mark.parametrize(
    "name",
    [
        *list(CASES)[:2],
        *(pytest.param(name, marks=pytest.mark.long) for name in list(CASES)[2:]),
    ],
)


def shell_of(name: str, half_angle: float = np.pi / 2, elements: int = ELEMENTS) -> Shell:
    law, half, loads = CASES[name]
    spec = scene(*loads, material=LAWS[law], half_angle=half_angle)
    return problem_of(spec, 2 * elements if half else elements, half=half).mechanics


def free_of(shell: Shell) -> np.ndarray:
    """What clamps and the crown of a half leave free, stated by hand."""
    free = np.ones((4, shell.angles.shape[0], 1), bool)
    free[[0, 1, 3], 0] = False
    free[[0, 3] if shell.elements.symmetric else [0, 1, 3], -1] = False
    return free


def random_state(shell: Shell, size: float, seed: int) -> jax.Array:
    """Displacements and slopes of a relative size, with their bounds kept."""
    noise = np.random.default_rng(seed).uniform(-1, 1, (4, shell.angles.shape[0], 1))
    scale = np.array([0.01, 0.01, 1.0, 1.0])[:, None, None]
    return jnp.asarray(size * scale * noise * free_of(shell))


solve = quick(eliminate)
strain_energy = quick(lambda shell, q: shell.strain_energy(q))
volume_change = quick(lambda shell, q: shell.volume_change(q))
work = quick(lambda shell, q: shell.work(q))
assemble = quick(lambda shell, q, p, f: shell.assemble(q, p, f))


@quick
def by_differentiation(shell: Shell, q: jax.Array, p: jax.Array, f: jax.Array) -> tuple:
    def potential(q: jax.Array) -> jax.Array:
        return shell.potential(q, p, f)[0]

    return (
        jax.grad(potential)(q),
        jax.hessian(potential)(q),
        jax.grad(lambda q: shell.volume_change(q)[0])(q),
        jax.grad(lambda q: shell.work(q)[0])(q),
    )


@shell_cases
@pytest.mark.parametrize("half_angle", [0.5, np.pi / 2, 2.0])
def test_residual_and_tangent_come_from_the_potential(name: str, half_angle: float) -> None:
    shell = shell_of(name, half_angle)
    free = free_of(shell)
    stations = shell.angles.shape[0]
    p, f = jnp.array([2e4]), jnp.array([1.7])
    for size, seed in ((0.0, 0), (0.03, 1), (0.15, 2)):
        q = random_state(shell, size, seed)
        got = assemble(shell, q, p, f)
        residual, hessian, volume, load = by_differentiation(shell, q, p, f)
        for a, b in ((got.residual, residual), (got.volume_gradient, volume), (got.load, load)):
            want = np.where(free, b, 0)
            # Displacements and slopes have units of their own.
            length = float(shell.elements.lengths[0, 0])
            largest = np.max(np.abs(want[:2]))
            np.testing.assert_allclose(a[:2], want[:2], rtol=0, atol=1e-12 * largest)
            largest = max(length * largest, np.max(np.abs(want[2:])))
            np.testing.assert_allclose(a[2:], want[2:], rtol=0, atol=1e-12 * largest)
        hessian = np.asarray(hessian)[:, :, 0, :, :, 0]
        mask = free[:, :, 0]
        hessian = hessian * mask[:, :, None, None] * mask[None, None]
        fixed = np.einsum("as,ab,st->asbt", ~mask, np.eye(4), np.eye(stations))
        hessian = hessian + fixed
        built = np.zeros_like(hessian)
        for s in range(stations):
            built[:, s, :, s] = got.tangent.diagonal[:, :, s, 0]
        for s in range(stations - 1):
            built[:, s, :, s + 1] = got.tangent.upper[:, :, s, 0]
            built[:, s + 1, :, s] = got.tangent.upper[:, :, s, 0].T
        scale = np.sqrt(np.abs(np.einsum("asas->as", hessian)))
        error = np.abs(built - hessian) / (scale[:, :, None, None] * scale[None, None])
        assert np.max(error) < 1e-12
        np.testing.assert_allclose(
            got.volume_change, volume_change(shell, q), rtol=1e-12, atol=1e-20
        )


@shell_cases
def test_rest_is_free_of_stress_to_the_last_digit(name: str) -> None:
    shell = shell_of(name)
    rest = shell.rest()
    got = assemble(shell, rest, jnp.zeros(1), jnp.zeros(1))
    assert np.all(np.asarray(got.residual) == 0)
    assert np.all(np.asarray(got.volume_change) == 0)
    assert np.all(np.asarray(strain_energy(shell, rest)) == 0)
    # The radial unit vector is rounded, and so is the work at rest.
    scale = float(shell.section.mean_thickness[0]) * np.max(np.abs(shell.points.force))
    assert abs(float(work(shell, rest)[0])) < 1e-15 * scale
    assert shell.unknowns() == free_of(shell).sum()


# Rigid motion.


def moved(shell: Shell, q: jax.Array, turn: float, shift: np.ndarray) -> jax.Array:
    """The same state turned and shifted as a whole."""
    angles = np.asarray(shell.angles)[:, 0]
    t = np.stack([np.cos(angles), -np.sin(angles)])
    n = np.stack([np.sin(angles), np.cos(angles)])
    x = np.asarray(shell.section.size) * n + np.asarray(q)[:2, :, 0]
    slope = np.array(q)[2:, :, 0]
    for end in (0, -1):  # kept along the tangent and the normal there
        slope[:, end] = t[:, end] * slope[0, end] + n[:, end] * slope[1, end]
    matrix = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    u = matrix @ x + shift[:, None] - np.asarray(shell.section.size) * n
    slope = matrix @ (t + slope) - t
    for end in (0, -1):
        slope[:, end] = t[:, end] @ slope[:, end], n[:, end] @ slope[:, end]
    return jnp.asarray(np.concatenate([u, slope]))[:, :, None]


def test_energy_does_not_see_a_shift() -> None:
    shell = shell_of("mooney-rivlin, whole arc")
    q = random_state(shell, 0.05, 3)
    energy = strain_energy(shell, q)
    shifted = strain_energy(shell, moved(shell, q, 0.0, np.array([0.3, -0.2])))
    np.testing.assert_allclose(shifted, energy, rtol=1e-12)


def test_energy_of_a_rotation_vanishes_with_refinement() -> None:
    # The turned reference arc is not a cubic: what is left is an error of interpolation.
    energies = []
    spec = scene(line(20, 5))
    plan = plan_for(spec, "shell", (8,))
    for _ in range(3):
        shell = built(spec, plan).mechanics
        turned = moved(shell, shell.rest(), 1.0, np.zeros(2))
        energies.append(float(strain_energy(shell, turned)[0]))
        (plan,) = plan.comparisons()
    rates = np.log2(np.array(energies[:-1]) / energies[1:])
    assert np.all(rates > 5.5)
    stretched = shell_of("mooney-rivlin, whole arc")
    unit = strain_energy(stretched, random_state(stretched, 0.01, 4))
    assert energies[-1] < 1e-5 * float(unit[0])


# The section: a fibre formula against integration through an incompressible annulus.


@pytest.mark.parametrize("thickness", [0.0015, 0.01])
@pytest.mark.parametrize("law", LAWS)
def test_section_energy_is_that_of_an_incompressible_annulus(
    law: str, thickness: float
) -> None:
    spec = scene(line(0, 5), material=LAWS[law], thickness=thickness)
    shell = problem_of(spec, 2).mechanics
    at_crown = shell.section.frame(jnp.zeros((1, 1)))
    radius = float(shell.section.size[0])
    nodes, weights = np.polynomial.legendre.leggauss(40)
    outer = radius + thickness * nodes / 2
    for current, opening in ((1.15, 1.0), (0.9, 1.0), (1.05, 0.8), (1.0, 1.3)):
        # A sector of mid-radius r, its angle scaled by b: b (rho^2 - r^2) = P^2 - R^2.
        r = current * radius
        rho = np.sqrt(r**2 + (outer**2 - radius**2) / opening)
        hoop = jnp.log(jnp.asarray(opening * rho / outer))[:, None]
        energy = np.asarray(shell.law.energy(LogStretches(hoop, 0 * hoop)))[:, 0]
        want = np.sum(weights * thickness / 2 * energy * outer / radius)
        stretch = (opening * current) ** 2 - 1
        curvature = (opening - 1) / radius
        at = (jnp.full((1, 1, 1), stretch), jnp.full((1, 1, 1), curvature))
        fine = dataclasses.replace(shell, layers=12).fibres(at_crown).energy(*at)
        np.testing.assert_allclose(fine[0, 0], want, rtol=1e-11)
        three = shell.fibres(at_crown).energy(*at)
        np.testing.assert_allclose(three[0, 0], want, rtol=3e-10 if thickness < 0.002 else 3e-5)


# The enclosed volume.


sampled = quick(Shell.profile)


def area(points: np.ndarray) -> float:
    """Signed area between a line of points and the origin, clockwise positive."""
    x, y = points
    return float(np.sum(y[:-1] * x[1:] - x[:-1] * y[1:])) / 2


@pytest.mark.parametrize("name", ["mooney-rivlin, whole arc", "ogden, half arc"])
@pytest.mark.parametrize("size", [0.004, 0.02])
def test_enclosed_volume_is_the_area_under_the_inner_face(name: str, size: float) -> None:
    # Elements short enough that four points integrate the reference normal to rounding.
    shell = shell_of(name, elements=16)
    q = random_state(shell, size, 5)

    def change(samples: int) -> float:
        shape = sampled(shell, q, samples)
        rest = np.asarray(shape.rest)[..., 0]
        now = rest + np.asarray(shape.inner_displacement)[..., 0]
        # Samples run fastest; at a station the face may jump along the normal.
        rest, now = (x.transpose(0, 2, 1).reshape(2, -1) for x in (rest, now))
        return area(now) - area(rest)

    # Polygons converge with the square of the sample distance.
    extrapolated = (4 * change(2000) - change(1000)) / 3
    got = float(volume_change(shell, q)[0])
    assert abs(extrapolated - got) < 1e-9 * abs(got)
    assert abs(got) > 1e-3 * float(shell.film_volume[0])


# Small displacements of a clamped circular arch, by Castigliano's theorem.


def arch(radius: float, half_angle: float, section: np.ndarray) -> tuple[float, float, float]:
    """Crown deflection and oil pressure under a unit crown force; the arch alone.

    Statics of the right half: with the crown's thrust n, moment m and shear 1/2, and a
    pressure p inside,

        N = n cos a - sin a / 2 + p R (1 - cos a),
        M = m + R (sin a / 2 + n (1 - cos a)) - p R^2 (1 - cos a).

    The complementary energy is stationary in n and m, and in p if the volume is kept.

    Args:
        radius: of the mid-line.
        half_angle: from the crown to a clamp.
        section: stiffness of the section against mid-line strain and rotation per length.

    Returns:
        Deflection with the oil vented, with the oil trapped, and the trapped pressure.
    """
    nodes, weights = np.polynomial.legendre.leggauss(60)
    a = half_angle * (nodes + 1) / 2
    w = radius * half_angle * weights / 2
    one_less = 1 - np.cos(a)
    normal = np.stack([np.cos(a), 0 * a, radius * one_less, -np.sin(a) / 2])
    moment = np.stack(
        [radius * one_less, 1 + 0 * a, -(radius**2) * one_less, radius * np.sin(a) / 2]
    )
    forces = np.stack([normal, moment])  # [N or M, (n, m, p, unit force), point]
    flexibility = np.einsum("g,aig,ab,bjg->ij", w, forces, np.linalg.inv(section), forces)

    def deflection(unknowns: int) -> tuple[float, np.ndarray]:
        # Scaled so that moments and pressures don't spoil the conditioning.
        scale = np.array([1.0, radius, 1 / radius])[:unknowns]
        k = scale[:, None] * flexibility[:unknowns, :unknowns] * scale
        x = -scale * np.linalg.solve(k, scale * flexibility[:unknowns, 3])
        # Half of the force does work in each half: the deflection is twice the half's.
        return 2 * (flexibility[3, 3] + flexibility[3, :unknowns] @ x), x

    vented, _ = deflection(2)
    trapped, x = deflection(3)
    return vented, trapped, float(x[2])


def section_stiffness(modulus: float, radius: float, thickness: float) -> np.ndarray:
    """Fibre strain (e + m b) / (1 + Z/R)^2 with m = Z + Z^2 / (2R), integrated."""
    nodes, weights = np.polynomial.legendre.leggauss(40)
    z = thickness * nodes / 2
    shell = 1 + z / radius
    strain = np.stack([1 / shell**2, (z + z**2 / (2 * radius)) / shell**2])
    return modulus * np.einsum("g,ag,bg->ab", weights * thickness / 2 * shell, strain, strain)


def linear_response(thickness: float, half_angle: float, elements: int) -> tuple:
    """Crown deflection and pressure per line force, from the tangent at rest."""
    spec = scene(
        line(0, 1.23e-6),
        material={"law": "neo-hookean", "mu": "1 MPa"},
        thickness=thickness,
        half_angle=half_angle,
    )
    shell = problem_of(spec, elements, half=True).mechanics
    shell = dataclasses.replace(shell, layers=8)
    a = assemble(shell, shell.rest(), jnp.zeros(1), jnp.zeros(1))
    line_force = 1e-5
    corner = jnp.zeros(1)
    open_ = BorderedBlockTridiagonal(a.tangent, None, None)
    shut = BorderedBlockTridiagonal(a.tangent, -a.volume_gradient, corner)
    vented = solve(open_, BorderedVector(a.load, None)).solution
    trapped = solve(shut, BorderedVector(a.load, jnp.zeros(1))).solution
    crown = [-float(x.stations[1, -1, 0]) / line_force for x in (vented, trapped)]
    return *crown, float(trapped.border[0]) / line_force


@pytest.mark.long  # three meshes; the limit of the ring below
@pytest.mark.parametrize("half_angle", [0.8, np.pi / 2])
@pytest.mark.parametrize("thickness", [0.0015, 0.006])
def test_small_displacements_are_those_of_the_exact_arch(
    half_angle: float, thickness: float
) -> None:
    radius = 0.0575 + thickness / 2
    want = np.array(arch(radius, half_angle, section_stiffness(4e6, radius, thickness)))
    errors = []
    for elements in (32, 64, 128):
        got = np.array(linear_response(thickness, half_angle, elements))
        errors.append(np.max(np.abs(got / want - 1)))
    assert errors[-1] < 1e-6
    assert np.all(np.log2(np.array(errors[:-1]) / errors[1:]) > 3.9)


def test_thin_limit_is_the_classical_ring() -> None:
    # Extension E't and bending E't^3/12 without coupling, E' = 4 mu, from which the shell
    # differs by the order of (t/R)^2.
    differences = []
    for thickness in (0.006, 0.003, 0.0015):
        radius = 0.0575 + thickness / 2
        classical = 4e6 * np.diag([thickness, thickness**3 / 12])
        want = np.array(arch(radius, np.pi / 2, classical))
        got = np.array(linear_response(thickness, np.pi / 2, 128))
        differences.append(np.max(np.abs(got / want - 1)))
    assert differences[-1] < 1e-3
    np.testing.assert_allclose(
        np.log2(np.divide(differences[:-1], differences[1:])), 2, atol=0.1
    )


def test_the_largest_value_is_the_same_in_the_mirror():
    # Elements share the sample at their ends. Here it is both elements' largest sample, while
    # the parabola of the second, 0.97 - 0.3 x - 0.27 x^2 about its middle one, rises higher.
    values = jnp.array([[0.2, 1.0], [0.9, 0.97], [1.0, 0.4]])[..., None]
    places = jnp.array([[0.0, 2.0], [1.0, 3.0], [2.0, 4.0]])[..., None]
    for sign, order in ((1, slice(None)), (-1, slice(None, None, -1))):
        top, place = SectionShape.peak(values[order, order], sign * places[order, order])
        x = -0.3 / (2 * 0.27)
        assert top[0] == pytest.approx(0.97 - 0.3 * x - 0.27 * x**2, rel=1e-14)
        assert sign * place[0] == pytest.approx(3 + x, rel=1e-14)
