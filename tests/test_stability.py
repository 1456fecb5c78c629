"""Windows of Drucker stability, against an independent Hessian and the paper's material."""

import jax
import numpy as np
import pytest
from scipy.optimize import brentq

from suas_jax.constitutive import (
    MooneyRivlin,
    NeoHookean,
    Ogden,
    Yeoh,
    drucker_modulus,
    stable_range,
)

C1, C2, C3 = 20.7e6, -4.4e6, 77e3
EPDM = MooneyRivlin(C1, C2, C3)
TABLE_1 = Ogden([6.3e5, 0.012e5, -0.1e5], [1.3, 5.0, -2.0])


def mooney_rivlin_hessian(l1: float, l2: float, c2: float = C2) -> np.ndarray:
    """∂²Ψ̃/∂e_i∂e_j of Eq. 23 by hand: I₁ = Σexp(2e), I₂ = Σexp(−2e), e₃ = −e₁ − e₂."""
    squares = np.array([l1, l2, 1.0 / (l1 * l2)]) ** 2
    basis = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, -1.0]])
    slope_2 = -2.0 * basis.T @ (1.0 / squares)
    curve_1 = 4.0 * basis.T @ np.diag(squares) @ basis
    curve_2 = 4.0 * basis.T @ np.diag(1.0 / squares) @ basis
    excess = np.sum(1.0 / squares) - 3.0
    return (
        C1 * curve_1
        + (c2 + 2.0 * C3 * excess) * curve_2
        + 2.0 * C3 * np.outer(slope_2, slope_2)
    )


STATES = [(1.0, 1.0), (1.3, 1.3), (2.0, 2.0**-0.5), (2.5, 1.0), (0.6, 1.4), (3.5, 0.9)]


@pytest.mark.parametrize("state", STATES)
def test_modulus_is_the_smallest_stiffness(state: tuple[float, float]) -> None:
    hessian = mooney_rivlin_hessian(*state)
    # Stiffness of unit isochoric strains: the metric of (e₁, e₂) is that of Σe² over all three.
    metric = np.array([[2.0, 1.0], [1.0, 2.0]])
    values = np.linalg.eigvals(np.linalg.solve(metric, hessian))
    got = drucker_modulus(EPDM, *state)
    np.testing.assert_allclose(
        got, 0.5 * np.min(values), rtol=1e-12, atol=1e-14 * np.max(np.abs(values))
    )
    # Its sign is that of the plain 2 × 2 matrix.
    assert (got > 0.0) == bool(np.all(np.linalg.eigvalsh(hessian) > 0.0))


@pytest.mark.parametrize("law", [NeoHookean(4e5), EPDM, Yeoh(2e5, -2e3, 50.0), TABLE_1])
def test_modulus_at_rest_and_numbering_of_directions(law: object) -> None:
    np.testing.assert_allclose(drucker_modulus(law, 1.0, 1.0), law.shear_modulus, rtol=1e-14)
    l1, l2 = 1.7, 0.8
    l3 = 1.0 / (l1 * l2)
    values = [drucker_modulus(law, *pair) for pair in [(l1, l2), (l2, l3), (l3, l1), (l2, l1)]]
    np.testing.assert_allclose(values, values[0], rtol=1e-12)


RATIOS = {"uniaxial": -0.5, "equibiaxial": 1.0, "planar": 0.0}


def first_loss(mode: str, bracket: tuple[float, float], c2: float = C2) -> float:
    def smallest(stretch: float) -> float:
        hessian = mooney_rivlin_hessian(stretch, stretch ** RATIOS[mode], c2)
        return float(np.linalg.eigvalsh(hessian)[0])

    return brentq(smallest, *bracket, xtol=1e-14)


@pytest.mark.parametrize(
    ("mode", "side", "published", "bracket"),
    [
        ("uniaxial", 1, 2.24, (2.0, 2.5)),
        ("planar", 1, 2.42, (2.2, 2.8)),
        ("equibiaxial", 0, 0.67, (0.6, 0.8)),
    ],
)
def test_the_papers_epdm(
    mode: str, side: int, published: float, bracket: tuple[float, float]
) -> None:
    got = float(stable_range(EPDM, mode)[side])
    np.testing.assert_allclose(got, first_loss(mode, bracket), rtol=1e-10)
    assert abs(got - published) < 0.006


def test_the_papers_epdm_recovers_in_planar_extension() -> None:
    end = first_loss("planar", (3.0, 3.5))
    assert abs(end - 3.23) < 0.005
    stretches = np.array([end - 1e-6, end + 1e-6])
    below, above = np.asarray(drucker_modulus(EPDM, stretches, np.ones(2)))
    assert below < 0.0 < above
    # Symmetric in tension and compression: stretches (λ, 1, 1/λ) are the same set.
    low, high = stable_range(EPDM, "planar")
    np.testing.assert_allclose(low * high, 1.0, rtol=1e-10)


@pytest.mark.parametrize("mode", list(RATIOS))
def test_a_stable_law_reaches_the_limits(mode: str) -> None:
    for law in (NeoHookean(4e5), TABLE_1):
        np.testing.assert_array_equal(stable_range(law, mode, (0.25, 4.0)), [0.25, 4.0])


def test_lanes_and_derivatives_of_the_window() -> None:
    c2 = np.array([C2, -4.0e6, 0.0])
    low, high = stable_range(MooneyRivlin(C1, c2, C3), "uniaxial")
    expected = [first_loss("uniaxial", (1.5, 6.0), value) for value in c2[:2]]
    np.testing.assert_allclose(high, [*expected, 10.0], rtol=1e-10)
    assert low.shape == (3,)

    def end(value: jax.Array) -> jax.Array:
        return stable_range(MooneyRivlin(C1, value, C3), "uniaxial")[1]

    step = 1e2
    expected_slope = (
        first_loss("uniaxial", (2.0, 2.5), C2 + step)
        - first_loss("uniaxial", (2.0, 2.5), C2 - step)
    ) / (2.0 * step)
    np.testing.assert_allclose(jax.grad(end)(C2), expected_slope, rtol=1e-6)


def test_bad_requests_are_refused() -> None:
    with pytest.raises(ValueError, match="unknown mode"):
        stable_range(EPDM, "torsion")
    with pytest.raises(ValueError, match="0 < low < 1 < high"):
        stable_range(EPDM, "planar", (1.1, 2.0))
