"""Every way to present a deformation gives the same numbers, exactly and smoothly."""

import decimal
import math
from collections.abc import Callable
from decimal import Decimal

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from skins import rotation

from suas_jax.constitutive.deformation import (
    AbstractDeformation,
    FibreStretch,
    LogStretches,
    PlaneStrain,
)
from suas_jax.constitutive.deformation_gradient import GeneralDeformation
from suas_jax.numerics.analytic import (
    asinh_sqrt_squared,
    cosh_sqrt_minus_1,
    exp_minus_1_minus_x,
)

ALPHAS = [2.0, -2.0, 1.3, 5.0, 0.1, -7.3]
# XLA's log1p is wrong by up to 2.7e-14 for arguments between -0.4142 and -0.3758.
LOG1P = 6e-14


def exact_power_sum(stretches: list[float], alpha: float) -> float:
    """Isochoric Σλ^α − 3 in fifty digits."""
    with decimal.localcontext(decimal.Context(prec=50)):
        numbers = [Decimal(float(stretch)) for stretch in stretches]
        volume = math.prod(numbers, start=Decimal(1))
        scale = (-volume.ln() / 3).exp()
        return float(sum((scale * number) ** Decimal(alpha) for number in numbers) - 3)


def exact_stretch(stretch: float) -> tuple[float, float]:
    """λ² − 1 and log λ of a stretch, rounded once."""
    with decimal.localcontext(decimal.Context(prec=50)):
        return float(Decimal(stretch) ** 2 - 1), float(Decimal(stretch).ln())


@jax.jit
def answers(state: AbstractDeformation) -> jax.Array:
    """I₁ − 3, I₂ − 3 and the power sums of ALPHAS, in this order."""
    sums = [state.power_sum_minus_3(alpha) for alpha in ALPHAS]
    return jnp.stack([state.I1_minus_3, state.I2_minus_3, *sums])


EXPONENTS = [2.0, -2.0, *ALPHAS]


def all_forms(stretch: float) -> dict[str, AbstractDeformation]:
    """The state (λ, 1/λ, 1) in every form that can hold it."""
    green, log = (jnp.asarray(value) for value in exact_stretch(stretch))
    F = rotation(1) @ np.diag([stretch, 1.0 / stretch, 1.0]) @ rotation(2)
    return {
        "fibre": FibreStretch(green),
        "plane": PlaneStrain.from_displacement_gradient(
            jnp.diag(jnp.array([stretch - 1.0, 1.0 / stretch - 1.0]))
        ),
        "invariants": PlaneStrain.from_invariants(stretch**2 + stretch**-2, 1.0),
        "log": LogStretches(log, -log),
        "log, other directions": LogStretches(-log, jnp.zeros(())),
        "gradient": GeneralDeformation.of_gradient(jnp.asarray(F)),
    }


@pytest.mark.parametrize("stretch", [0.4, 0.8, 1.3, 3.0])
def test_all_forms_agree(stretch: float) -> None:
    expected = [stretch**alpha + stretch**-alpha - 2.0 for alpha in EXPONENTS]
    for name, state in all_forms(stretch).items():
        np.testing.assert_allclose(answers(state), expected, rtol=2e-12, err_msg=name)


@pytest.mark.parametrize(
    ("l1", "l2"),
    [(0.5, 0.6), (0.5, 2.5), (0.756, 0.798), (1.0, 1.001), (1.7, 0.6), (1.7, 1.7), (2.5, 0.95)],
)
def test_forms_that_hold_a_change_of_volume_agree(l1: float, l2: float) -> None:
    expected = [exact_power_sum([l1, l2, 1.0], alpha) for alpha in EXPONENTS]
    F = rotation(3) @ np.diag([l1, l2, 1.0]) @ rotation(4)
    H = jnp.diag(jnp.array([l1 - 1.0, l2 - 1.0]))
    for state, rtol in [
        (PlaneStrain.from_displacement_gradient(H), LOG1P),
        # The rotated F knows its strain no better than rounding of its entries allows.
        (
            GeneralDeformation.of_gradient(jnp.asarray(F)),
            1e-10 if abs(l2 - l1) < 0.01 else 1e-13,
        ),
    ]:
        np.testing.assert_allclose(answers(state), expected, rtol=rtol, err_msg=str(state))


@pytest.mark.parametrize("strain", [1e-9, -1e-9, 3e-7, -2e-4, 0.01])
def test_small_strains_keep_full_relative_accuracy(strain: float) -> None:
    stretch, other = 1.0 + strain, 1.0 - 0.3 * strain
    with decimal.localcontext(decimal.Context(prec=50)):
        exact = Decimal(stretch)
        expected = [float(exact ** Decimal(a) + exact ** -Decimal(a) - 2) for a in EXPONENTS]
    green, log = (jnp.asarray(value) for value in exact_stretch(stretch))
    for state in (FibreStretch(green), LogStretches(log, -log)):
        np.testing.assert_allclose(answers(state), expected, rtol=2e-15)
    expected = [exact_power_sum([stretch, other, 1.0], alpha) for alpha in EXPONENTS]
    H = jnp.diag(jnp.array([stretch - 1.0, other - 1.0]))
    for state in (
        PlaneStrain.from_displacement_gradient(H),
        GeneralDeformation.of_gradient(jnp.diag(jnp.array([stretch, other, 1.0]))),
    ):
        np.testing.assert_allclose(answers(state), expected, rtol=4e-15)


@pytest.mark.parametrize("stretch", [3.0, 5.0, 7.6, 10.0])
def test_large_uniaxial_stretch(stretch: float) -> None:
    side = stretch**-0.5
    state = GeneralDeformation.of_gradient(jnp.diag(jnp.array([side, stretch, side])))
    expected = [exact_power_sum([stretch, side, side], alpha) for alpha in EXPONENTS]
    np.testing.assert_allclose(answers(state), expected, rtol=1e-13)


def test_displacement_gradient_is_objective() -> None:
    H = np.array([[0.1, -0.3], [0.2, 0.15]])
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    one = PlaneStrain.from_displacement_gradient(jnp.asarray(H))
    other = PlaneStrain.from_displacement_gradient(
        jnp.asarray(turn @ (np.eye(2) + H) - np.eye(2))
    )
    F = np.eye(2) + H
    l1, l2 = np.linalg.svd(F, compute_uv=False)
    np.testing.assert_allclose(one.distortion, (l1 - l2) ** 2, rtol=1e-13)
    np.testing.assert_allclose(one.dilatation, np.linalg.det(F) - 1.0, rtol=1e-14)
    np.testing.assert_allclose(other.distortion, one.distortion, rtol=1e-14)
    np.testing.assert_allclose(other.dilatation, one.dilatation, rtol=1e-14)


def along_lines(fn: Callable) -> Callable:
    """Value and four derivatives of f(x, y) along lines in five directions, compiled.

    Five directions determine every mixed derivative up to the fourth order.
    """
    directions = jnp.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, -1.0], [0.5, 1.0]])

    def one(x: jax.Array, y: jax.Array, direction: jax.Array, alpha: jax.Array) -> jax.Array:
        orders = [lambda t: fn(x + t * direction[0], y + t * direction[1], alpha)]
        for _ in range(4):
            orders.append(lambda t, f=orders[-1]: jax.jvp(f, (t,), (1.0,))[1])
        return jnp.stack([order(0.0) for order in orders])

    points = jax.vmap(one, (0, 0, None, None))
    return jax.jit(
        lambda x, y, alpha: jax.vmap(points, (None, None, 0, None))(x, y, directions, alpha)
    )


PLANE_STRAIN_LINES = along_lines(lambda m, j, alpha: PlaneStrain(m, j).power_sum_minus_3(alpha))

# λ₁^α + λ₂^α where it is elementary, in terms of s = λ₁ + λ₂, s² = I + 2J, and J: no
# root of I − 2J, which is what vanishes where the stretches coincide.
ELEMENTARY = {
    4.0: lambda s, J: (s**2 - 2 * J) ** 2 - 2 * J**2,
    6.0: lambda s, J: (s**2 - 2 * J) ** 3 - 3 * (s**2 - 2 * J) * J**2,
    -2.0: lambda s, J: (s**2 - 2 * J) / J**2,
    1.0: lambda s, J: s,
    -1.0: lambda s, J: s / J,
    3.0: lambda s, J: s**3 - 3 * J * s,
}


@pytest.mark.parametrize("alpha", list(ELEMENTARY))
def test_plane_strain_is_exact_to_fourth_order(alpha: float) -> None:
    # Distortions from coincident stretches up to λ₁/λ₂ = 60.
    m, j = jnp.meshgrid(
        jnp.array([0.0, 1e-18, 1e-6, 0.01, 0.1, 0.5, 3.0, 60.0]), jnp.array([-0.2, 0.0, 0.3])
    )
    m, j = m.ravel(), j.ravel()

    def elementary(m: jax.Array, j: jax.Array, exponent: jax.Array) -> jax.Array:
        s, J = jnp.sqrt(m + 4.0 * (1.0 + j)), 1.0 + j
        return J ** (-exponent / 3.0) * (ELEMENTARY[alpha](s, J) + 1.0) - 3.0

    got = np.asarray(PLANE_STRAIN_LINES(m, j, alpha))
    expected = np.asarray(along_lines(elementary)(m, j, alpha))
    # In some directions a derivative vanishes: compare with the largest at the point.
    scale = np.max(np.abs(expected), axis=0, keepdims=True)
    # The reference value itself is a difference of numbers of order one.
    scale[..., 0] += 1.0
    error = np.max(np.abs(got - expected) / scale, axis=(0, 1))
    assert np.all(error < [1e-13, 1e-13, 1e-12, 1e-11, 1e-11]), error


@jax.jit
def fibre_derivatives(green: jax.Array, alpha: jax.Array) -> jax.Array:
    """First to fourth derivative, by nested forward mode."""
    slope = lambda e: FibreStretch(e).power_sum_minus_3(alpha)  # noqa: E731
    orders = []
    for _ in range(4):
        slope = jax.jacfwd(slope)
        orders.append(jax.vmap(slope)(green))
    return jnp.stack(orders)


@pytest.mark.parametrize("alpha", ALPHAS)
def test_fibre_derivatives(alpha: float) -> None:
    n = 0.5 * alpha
    green = np.array([-0.5, 0.0, 1e-12, 0.3, 4.0])
    got = fibre_derivatives(green, alpha)
    for order in range(1, 5):
        up = math.prod(n - k for k in range(order))
        down = math.prod(-n - k for k in range(order))
        expected = up * (1.0 + green) ** (n - order) + down * (1.0 + green) ** (-n - order)
        # Near rest the first derivative is a difference; the energy's slope is not.
        np.testing.assert_allclose(
            got[order - 1], expected, rtol=1e-12, atol=1e-15 * np.max(np.abs(expected))
        )


def test_analytic_functions_match_their_closed_forms() -> None:
    eta = np.array([0.01, 0.3, 1.0, 2.0, 3.0])
    np.testing.assert_allclose(
        asinh_sqrt_squared(jnp.asarray(np.sinh(eta) ** 2)), eta**2, rtol=1e-14
    )
    x = np.array([0.01, 0.5, 2.0, 8.0, 20.0, 24.0])
    np.testing.assert_allclose(
        cosh_sqrt_minus_1(jnp.asarray(x**2)), 2.0 * np.sinh(0.5 * x) ** 2, rtol=1e-14
    )
    # Entire: below zero it is the cosine.
    np.testing.assert_allclose(
        cosh_sqrt_minus_1(jnp.asarray(-(x[:3] ** 2))),
        -2.0 * np.sin(0.5 * x[:3]) ** 2,
        rtol=1e-13,
    )
    y = np.array([-30.0, -1.5, 1.5, 40.0])
    np.testing.assert_allclose(exp_minus_1_minus_x(jnp.asarray(y)), np.expm1(y) - y, rtol=1e-15)
    small = np.array([-1e-9, 1e-9, 2e-5])
    series = small**2 * (0.5 + small / 6.0 + small**2 / 24.0)
    np.testing.assert_allclose(exp_minus_1_minus_x(jnp.asarray(small)), series, rtol=1e-15)
    # The two formulas meet at one.
    below, above = 1.0 - 1e-15, 1.0
    for order in range(4):
        fn: Callable = exp_minus_1_minus_x
        for _ in range(order):
            fn = jax.grad(fn)
        at = jax.jit(fn)
        np.testing.assert_allclose(at(below), at(above), rtol=1e-14)


def test_arrays_and_exponents_broadcast() -> None:
    lanes = jnp.array([1.3, 5.0, -2.0, 2.0])
    green = jnp.linspace(-0.3, 0.5, 3)[:, None]
    stretch = jnp.sqrt(1.0 + green)
    zeros = jnp.zeros_like(stretch)
    F = jnp.stack(
        [
            jnp.stack([stretch, zeros, zeros]),
            jnp.stack([zeros, 1.0 / stretch, zeros]),
            jnp.stack([zeros, zeros, zeros + 1.0]),
        ]
    )
    expected = stretch**lanes + stretch**-lanes - 2.0
    for state in (
        FibreStretch(green),
        PlaneStrain.from_displacement_gradient((F - jnp.eye(3)[:, :, None, None])[:2, :2]),
        LogStretches(jnp.log(stretch), -jnp.log(stretch)),
        GeneralDeformation.of_gradient(F),
    ):
        got = jax.jit(lambda s: s.power_sum_minus_3(lanes))(state)
        assert got.shape == (3, 4)
        np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-15)
    one = GeneralDeformation.of_gradient(F[:, :, 0, 0]).power_sum_minus_3(lanes)
    np.testing.assert_allclose(one, expected[0], rtol=1e-12)
