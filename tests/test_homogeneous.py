"""Closed forms of material testing, against formulas and integrators written here."""

import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from skins import ALPHA, MU, ogden

from suas_jax.constitutive import (
    AbstractLaw,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    Yeoh,
    balloon_pressure,
    biaxial,
    equibiaxial,
    planar,
    simple_shear,
    tube,
    uniaxial,
)

OGDEN = Ogden(MU, ALPHA)
EPDM = (20.7e6, -4.4e6, 77e3)
YEOH = (0.2e6, -2e3, 50.0)


def from_invariants(slopes: Callable) -> Callable:
    """Cauchy stresses from ∂Ψ/∂I₁ and ∂Ψ/∂I₂ (Rivlin)."""

    def stresses(l1: np.ndarray, l2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        l3 = 1.0 / (l1 * l2)
        w1, w2 = slopes(l1**2 + l2**2 + l3**2, l1**-2.0 + l2**-2.0 + l3**-2.0)
        return (
            2.0 * (l1**2 - l3**2) * (w1 + w2 * l2**2),
            2.0 * (l2**2 - l3**2) * (w1 + w2 * l1**2),
        )

    return stresses


LAWS: dict[str, tuple[AbstractLaw, Callable]] = {
    "neo-hookean": (NeoHookean(4e5), from_invariants(lambda i1, i2: (2e5, 0.0))),
    "mooney-rivlin": (
        MooneyRivlin(*EPDM),
        from_invariants(lambda i1, i2: (EPDM[0], EPDM[1] + 2 * EPDM[2] * (i2 - 3))),
    ),
    "yeoh": (
        Yeoh(*YEOH),
        from_invariants(
            lambda i1, i2: (YEOH[0] + 2 * YEOH[1] * (i1 - 3) + 3 * YEOH[2] * (i1 - 3) ** 2, 0.0)
        ),
    ),
    "ogden": (OGDEN, ogden),
}
STRETCHES = np.array([0.3, 0.75, 0.99, 1.01, 1.5, 3.0, 7.0])


@pytest.fixture(params=list(LAWS))
def material(request: pytest.FixtureRequest) -> tuple[AbstractLaw, Callable]:
    return LAWS[request.param]


@pytest.mark.parametrize(
    ("mode", "second"),
    [
        (uniaxial, lambda x: x**-0.5),
        (equibiaxial, lambda x: x),
        (planar, lambda x: np.ones_like(x)),
    ],
)
def test_one_parameter_modes(material: tuple, mode: Callable, second: Callable) -> None:
    law, textbook = material
    expected, across = textbook(STRETCHES, second(STRETCHES))
    if mode is uniaxial:
        np.testing.assert_allclose(across, 0.0, atol=1e-12 * np.max(np.abs(expected)))
    stress = mode(law, STRETCHES)
    np.testing.assert_allclose(stress.cauchy, expected, rtol=2e-12)
    np.testing.assert_allclose(stress.nominal, expected / STRETCHES, rtol=2e-12)


def test_biaxial(material: tuple) -> None:
    law, textbook = material
    l1, l2 = np.array([0.8, 1.2, 2.0])[:, None], np.array([0.9, 1.3, 3.1])
    expected = textbook(l1, l2)
    scale = np.max(np.abs(expected))
    for got, cauchy, stretch in zip(biaxial(law, l1, l2), expected, (l1, l2), strict=True):
        np.testing.assert_allclose(got.cauchy, cauchy, rtol=1e-12, atol=1e-14 * scale)
        np.testing.assert_allclose(
            got.nominal, cauchy / stretch, rtol=1e-12, atol=1e-14 * scale
        )


def test_simple_shear(material: tuple) -> None:
    law, textbook = material
    gamma = np.array([-1.5, -0.1, 0.2, 1.0, 3.0])
    # Principal stretches of simple shear, and the principal stresses turned back.
    stretch = 0.5 * gamma + np.sqrt(1.0 + 0.25 * gamma**2)
    first, second = textbook(stretch, 1.0 / stretch)
    angle = 0.5 * np.arctan2(2.0, gamma)
    expected = (
        (first - second) * np.sin(angle) * np.cos(angle),
        first * np.cos(angle) ** 2 + second * np.sin(angle) ** 2,
        first * np.sin(angle) ** 2 + second * np.cos(angle) ** 2,
    )
    scale = np.max(np.abs(first))
    for got, value in zip(simple_shear(law, gamma), expected, strict=True):
        np.testing.assert_allclose(got, value, rtol=1e-11, atol=1e-14 * scale)


def test_simple_shear_of_mooney_rivlin_in_closed_form() -> None:
    gamma = np.array([0.0, 1e-9, 0.3, -2.0])
    stress = simple_shear(MooneyRivlin(3e5, 1e5), gamma)
    np.testing.assert_allclose(stress.shear, 8e5 * gamma, rtol=1e-14)
    np.testing.assert_allclose(stress.along, 6e5 * gamma**2, rtol=1e-13, atol=1e-19)
    np.testing.assert_allclose(stress.across, -2e5 * gamma**2, rtol=1e-13, atol=1e-19)
    slope = jax.vmap(jax.grad(lambda g: simple_shear(OGDEN, g).shear))(jnp.array([0.0]))
    np.testing.assert_allclose(slope, 4.225e5, rtol=1e-14)


@pytest.mark.parametrize("strain", [1e-9, -1e-8, 1e-6])
def test_small_strains(material: tuple, strain: float) -> None:
    law, _ = material
    mu, stretch = float(law.shear_modulus), 1.0 + strain
    h = math.log1p(stretch - 1.0)
    for mode, factor in ((uniaxial, 3.0), (equibiaxial, 6.0), (planar, 4.0)):
        got = mode(law, stretch).cauchy
        # The next term of the expansion is of relative size |strain|, with a factor of a few.
        np.testing.assert_allclose(got, factor * mu * h, rtol=4 * abs(strain) + 1e-14)
    assert uniaxial(law, 1.0).nominal == 0.0


def test_lanes_and_gradients() -> None:
    lanes = Ogden(jnp.asarray(MU)[:, None] * jnp.array([1.0, 2.0]), ALPHA)
    got = uniaxial(lanes, STRETCHES[:, None])
    expected = uniaxial(OGDEN, STRETCHES).nominal[:, None] * np.array([1.0, 2.0])
    np.testing.assert_allclose(got.nominal, expected, rtol=1e-13)
    slope = jax.grad(lambda mu: equibiaxial(Ogden(mu, ALPHA), 1.7).nominal)(jnp.asarray(MU))
    expected = (1.7**ALPHA - 1.7 ** (-2.0 * ALPHA)) / 1.7
    np.testing.assert_allclose(slope, expected, rtol=1e-13)


def balloon(stretch: np.ndarray) -> np.ndarray:
    """Eq. 15 for Table I with H/R = 0.01."""
    return 0.02 * sum(
        m * (stretch ** (a - 3.0) - stretch ** (-2.0 * a - 3.0))
        for m, a in zip(MU, ALPHA, strict=True)
    )


def test_balloon_and_its_limit_point() -> None:
    np.testing.assert_allclose(
        balloon_pressure(OGDEN, STRETCHES, 0.01), balloon(STRETCHES), rtol=1e-12
    )

    def slope(stretch: float) -> float:
        return sum(
            m
            * ((a - 3.0) * stretch ** (a - 4.0) + (2.0 * a + 3.0) * stretch ** (-2.0 * a - 4.0))
            for m, a in zip(MU, ALPHA, strict=True)
        )

    expected = brentq(slope, 1.1, 2.0, xtol=1e-14)
    of_law = jax.jit(jax.grad(lambda x: balloon_pressure(OGDEN, x, 0.01)))
    got = brentq(lambda x: float(of_law(x)), 1.1, 2.0, xtol=1e-14)
    np.testing.assert_allclose(got, expected, rtol=1e-12)
    # It is a maximum, and the pressure has a minimum later on.
    assert float(of_law(expected - 0.01)) > 0.0 > float(of_law(expected + 0.01))
    assert float(of_law(6.0)) > 0.0


def test_tube_of_neo_hookean_in_closed_form() -> None:
    mu, A, B = 4e5, 0.02, 0.05
    a_stretch = np.array([0.8, 1.2, 2.5])[:, None]
    z_stretch = np.array([0.7, 1.0, 1.6])
    got = tube(NeoHookean(mu), a_stretch, z_stretch, A, B)
    a = a_stretch * A
    b = np.sqrt(a**2 + (B**2 - A**2) / z_stretch)
    swelling = 0.5 * (a**2 - A**2 / z_stretch) * (1.0 / a**2 - 1.0 / b**2)
    pressure = mu / z_stretch * (np.log(a * B / (b * A)) + swelling)
    np.testing.assert_allclose(got.pressure, pressure, rtol=1e-12, atol=1e-13 * mu)


def tube_by_quadrature(a_stretch: float, z: float, A: float, B: float) -> tuple[float, float]:
    """Pressure and resultant axial force of Table I from the stress across the wall."""
    a = a_stretch * A

    def excess(r: float) -> tuple[float, float]:
        R = math.sqrt(A**2 + z * (r**2 - a**2))
        hoop, axial = ogden(np.float64(r / R), np.float64(z))
        return float(hoop), float(axial)  # less the radial stress

    b = math.sqrt(a**2 + (B**2 - A**2) / z)
    options = {"epsabs": 0.0, "epsrel": 1e-13, "limit": 200}
    pressure = quad(lambda r: excess(r)[0] / r, a, b, **options)[0]

    def radial(r: float) -> float:
        return -quad(lambda x: excess(x)[0] / x, r, b, epsabs=1e-9, epsrel=1e-12)[0]

    force = quad(lambda r: 2.0 * math.pi * r * (excess(r)[1] + radial(r)), a, b, epsrel=1e-11)[
        0
    ]
    return pressure, force


@pytest.mark.parametrize(
    ("a_stretch", "z_stretch", "ratio"), [(1.5, 1.2, 1.3), (2.5, 0.9, 2.0), (0.8, 1.1, 10.0)]
)
def test_tube_against_adaptive_quadrature(
    a_stretch: float, z_stretch: float, ratio: float
) -> None:
    A = 0.01
    got = tube(OGDEN, a_stretch, z_stretch, A, ratio * A)
    pressure, force = tube_by_quadrature(a_stretch, z_stretch, A, ratio * A)
    np.testing.assert_allclose(got.pressure, pressure, rtol=1e-12)
    np.testing.assert_allclose(got.axial_force, force, rtol=1e-9)
    reduced = got.axial_force - math.pi * (a_stretch * A) ** 2 * got.pressure
    np.testing.assert_allclose(got.reduced_axial_force, reduced, rtol=1e-12)


def test_tube_limits() -> None:
    # Not inflated and stretched by λ^(−1/2) all round: uniaxial tension of the wall.
    z = 1.4
    got = tube(OGDEN, z**-0.5, z, 0.01, 0.03)
    stress = uniaxial(OGDEN, z)
    np.testing.assert_allclose(got.pressure, 0.0, atol=1e-9)
    area = math.pi * (0.03**2 - 0.01**2)
    np.testing.assert_allclose(got.axial_force, stress.nominal * area, rtol=1e-12)
    # Small inflation, length held: Lamé's incompressible tube.
    small = 1e-9
    got = tube(OGDEN, 1.0 + small, 1.0, 0.01, 0.03)
    expected = 2.0 * 4.225e5 * ((1.0 + small) - 1.0) * (1.0 - 1.0 / 9.0)
    np.testing.assert_allclose(got.pressure, expected, rtol=1e-8)
    # Thin wall: p = H/R dΨ/dλ / λ.
    thin = tube(OGDEN, 1.5, 1.0, 1.0, 1.0 + 1e-6)
    hoop = planar(OGDEN, 1.5).cauchy
    np.testing.assert_allclose(thin.pressure, 1e-6 * hoop / 1.5**2, rtol=3e-6)
