"""The inflated diaphragm, against shooting in Cartesian form and against Hencky's limit."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from skins import ALPHA, MU, ogden

from suas_jax.constitutive import NeoHookean, Ogden, inflated_diaphragm
from suas_jax.constitutive.specimens import diaphragm

OGDEN = Ogden(MU, ALPHA)


def diaphragm_by_shooting(apex: float, R0: float, H: float) -> tuple[float, float, float]:
    """Pressure, height and rim slope of Table I: Cartesian form, tension as unknown."""

    def nominal(l1: float, l2: float) -> tuple[float, float]:
        first, second = ogden(np.float64(l1), np.float64(l2))
        return first / l1, second / l2

    def meridional(tension: float, l2: float) -> float:
        return brentq(lambda l1: nominal(l1, l2)[0] - tension, 0.2, 20.0, xtol=1e-15)

    centre, _ = nominal(apex, apex)

    def integrate(p: float) -> np.ndarray:
        def rates(R: float, y: np.ndarray) -> list[float]:
            r, _, radial, lift = y  # RP₁cos φ and RP₁sin φ: the momentum balance itself
            tension, hoop = math.hypot(radial, lift) / R, r / R
            l1 = meridional(tension, hoop)
            cos, sin = radial / (R * tension), lift / (R * tension)
            _, second = nominal(l1, hoop)
            return [l1 * cos, l1 * sin, second - p / H * r * l1 * sin, p / H * r * l1 * cos]

        start = 1e-6 * R0
        slope = p / H * apex**2 / (2.0 * centre) * start
        first = [apex * start, 0.0, start * centre, start * centre * slope]
        solution = solve_ivp(
            rates, (start, R0), first, method="DOP853", rtol=3e-11, atol=1e-16, max_step=R0 / 4
        )
        return solution.y[:, -1]

    guess = float(inflated_diaphragm(OGDEN, apex, R0, H).pressure)
    p = brentq(lambda p: integrate(p)[0] / R0 - 1.0, 0.99 * guess, 1.013 * guess, rtol=1e-10)
    _, height, radial, lift = integrate(p)
    return p, height, math.atan2(lift, radial)


@pytest.mark.parametrize("apex", [1.1, 2.5])
def test_diaphragm_against_shooting(apex: float) -> None:
    got = inflated_diaphragm(OGDEN, apex, 0.05, 1e-3)
    np.testing.assert_allclose(
        np.array(got), diaphragm_by_shooting(apex, 0.05, 1e-3), rtol=2e-9
    )


def test_diaphragm_scales_and_broadcasts() -> None:
    apex = jnp.array([1.05, 1.5, 3.0])
    law = NeoHookean(4e5)
    one = inflated_diaphragm(law, apex, 1.0, 1.0)
    both = inflated_diaphragm(law, apex, jnp.array([[0.05], [0.2]]), 1e-3)
    ratio = 1e-3 / np.array([[0.05], [0.2]])
    np.testing.assert_allclose(both.pressure, one.pressure * ratio, rtol=1e-14)
    np.testing.assert_allclose(both.apex_height[1], 0.2 * one.apex_height, rtol=1e-14)
    np.testing.assert_allclose(both.rim_slope[0], one.rim_slope, rtol=1e-14)
    assert not np.any(np.isfinite(inflated_diaphragm(law, jnp.array([0.9, 1.0]), 1.0, 1.0)[0]))


def test_diaphragm_does_not_depend_on_where_integration_starts(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # The series beside the apex leaves an error of fourth order in the starting radius.
    law, apex = NeoHookean(4e5), jnp.array(1.5)
    near = jax.jit(lambda x: diaphragm._unit_diaphragm(law, x))(apex)
    monkeypatch.setattr(diaphragm, "_START", 2e-3)
    far = jax.jit(lambda x: diaphragm._unit_diaphragm(law, x))(apex)
    np.testing.assert_allclose(near, far, rtol=3e-11)


def test_diaphragm_at_small_pressure() -> None:
    """A flat membrane under little pressure: p ~ δ^(3/2), height ~ δ^(1/2)."""
    small, smaller = (inflated_diaphragm(OGDEN, 1.0 + d, 1.0, 1.0) for d in (4e-8, 1e-8))
    np.testing.assert_allclose(small.pressure / smaller.pressure, 8.0, rtol=1e-6)
    np.testing.assert_allclose(small.apex_height / smaller.apex_height, 2.0, rtol=1e-6)
    modulus = 3.0 * 4.225e5
    factor = smaller.apex_height / (smaller.pressure / modulus) ** (1.0 / 3.0)
    np.testing.assert_allclose(factor, hencky_deflection(), rtol=1e-6)


def hencky_deflection() -> float:
    """w₀ / (R (pR/EH)^(1/3)) of Hencky's clamped membrane, Poisson's ratio one half.

    Equilibrium Nw′ = −r/2 and compatibility N″ + 3N′/r + 1/(8N²) = 0 of the radial
    tension N, with no hoop strain at the rim: N′ + N/2 = 0.
    """

    def integrate(centre: float) -> np.ndarray:
        start = 1e-4
        first = [centre - start**2 / (64 * centre**2), -start / (32 * centre**2), 0.0]
        return solve_ivp(
            lambda r, y: [y[1], -3.0 * y[1] / r - 0.125 / y[0] ** 2, 0.5 * r / y[0]],
            (start, 1.0),
            first,
            method="DOP853",
            rtol=1e-12,
            atol=1e-15,
        ).y[:, -1]

    def rim(centre: float) -> float:
        tension, slope, _ = integrate(centre)
        return slope + 0.5 * tension

    return float(integrate(brentq(rim, 0.35, 1.0, xtol=1e-13))[2])


@pytest.mark.long
def test_diaphragm_gradients() -> None:
    def pressure(apex: jax.Array, law: Ogden) -> jax.Array:
        return inflated_diaphragm(law, apex, 0.05, 1e-3).pressure

    apex, step = 1.8, 1e-4
    by_apex, by_law = jax.jit(jax.grad(pressure, (0, 1)))(apex, OGDEN)
    expected = (pressure(apex + step, OGDEN) - pressure(apex - step, OGDEN)) / (2.0 * step)
    np.testing.assert_allclose(by_apex, expected, rtol=1e-7)
    # Pressure is homogeneous of degree one in the moduli.
    np.testing.assert_allclose(jnp.sum(by_law.mu * OGDEN.mu), pressure(apex, OGDEN), rtol=1e-11)
    moved = [Ogden(MU, ALPHA + np.array([0, s * step, 0])) for s in (1, -1)]
    expected = (pressure(apex, moved[0]) - pressure(apex, moved[1])) / (2.0 * step)
    np.testing.assert_allclose(by_law.alpha[1], expected, rtol=1e-6)
