"""One contract for every material law."""

import dataclasses
import inspect
import tomllib
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from skins import rotation

from suas_jax.config import (
    ArrudaBoyceSpec,
    CarrollSpec,
    GentSpec,
    LawSpec,
    MooneyRivlinSpec,
    NeoHookeanSpec,
    OgdenSpec,
    PolynomialSpec,
    YeohSpec,
    scene_from_dict,
)
from suas_jax.constitutive import (
    LAWS,
    AbstractLaw,
    ArrudaBoyce,
    Gent,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    Polynomial,
    Yeoh,
    build_law,
)
from suas_jax.constitutive.deformation import FibreStretch, LogStretches, PlaneStrain
from suas_jax.constitutive.deformation_gradient import GeneralDeformation

TABLE_1 = ([6.3e5, 0.012e5, -0.1e5], [1.3, 5.0, -2.0])


class Case(NamedTuple):
    """A law, its modulus, and the textbook formula of its stress.

    `share(x, i1, i2)` is the part of σ_i + p that belongs to the stretch x.
    """

    material: LawSpec
    modulus: float
    share: Callable[[np.ndarray, float, float], np.ndarray]

    @property
    def law(self) -> AbstractLaw:
        """The law itself."""
        return build_law(self.material)


CASES = {
    "carroll": Case(
        CarrollSpec(A=0.15e6, B=40.0, C=95e3),
        2 * 0.15e6 + 216 * 40.0 + 95e3 / 3**0.5,
        lambda x, i1, i2: 2 * (0.15e6 + 4 * 40.0 * i1**3) * x**2 - 95e3 / i2**0.5 * x**-2,
    ),
    "neo-hookean": Case(NeoHookeanSpec(mu=4.2e5), 4.2e5, lambda x, i1, i2: 4.2e5 * x**2),
    "mooney-rivlin": Case(
        MooneyRivlinSpec(C1=20.7e6, C2=-4.4e6, C3=77e3),
        32.6e6,
        lambda x, i1, i2: 2 * 20.7e6 * x**2 - 2 * (-4.4e6 + 2 * 77e3 * (i2 - 3)) * x**-2,
    ),
    "yeoh": Case(
        YeohSpec(C1=0.2e6, C2=-2e3, C3=50.0),
        0.4e6,
        lambda x, i1, i2: 2 * (0.2e6 - 2 * 2e3 * (i1 - 3) + 3 * 50.0 * (i1 - 3) ** 2) * x**2,
    ),
    "gent": Case(
        GentSpec(mu=400_000.7, Jm=30.0),
        400_000.7,
        lambda x, i1, i2: 400_000.7 * 30.0 / (30.0 - i1 + 3) * x**2,
    ),
    "arruda-boyce": Case(
        ArrudaBoyceSpec(mu=0.3e6, lambda_m=3.0),
        0.3e6 * (1 + 3 / 45 + 99 / 175 / 3**4 + 513 / 875 / 3**6 + 42039 / 67375 / 3**8),
        lambda x, i1, i2: (
            2
            * 0.3e6
            * x**2
            * (
                1 / 2
                + 2 / 20 * i1 / 9
                + 3 * 11 / 1050 * (i1 / 9) ** 2
                + 4 * 19 / 7000 * (i1 / 9) ** 3
                + 5 * 519 / 673750 * (i1 / 9) ** 4
            )
        ),
    ),
    "polynomial": Case(
        PolynomialSpec(
            C10=2e5,
            C01=1e4,
            C20=-3e3,
            C11=2e3,
            C02=1e3,
            C30=100.0,
            C21=200.0,
            C12=300.0,
            C03=400.0,
        ),
        4.2e5,
        lambda x, i1, i2: (
            2
            * x**2
            * (
                2e5
                - 6e3 * (i1 - 3)
                + 2e3 * (i2 - 3)
                + 300 * (i1 - 3) ** 2
                + 400 * (i1 - 3) * (i2 - 3)
                + 300 * (i2 - 3) ** 2
            )
            - 2
            * x**-2.0
            * (
                1e4
                + 2e3 * (i1 - 3)
                + 2e3 * (i2 - 3)
                + 200 * (i1 - 3) ** 2
                + 600 * (i1 - 3) * (i2 - 3)
                + 1200 * (i2 - 3) ** 2
            )
        ),
    ),
    "ogden": Case(
        OgdenSpec(mu=TABLE_1[0], alpha=TABLE_1[1], convention="mu/alpha"),
        4.225e5,
        lambda x, i1, i2: sum(m * x**a for m, a in zip(*TABLE_1, strict=True)),
    ),
    "ogden, one term": Case(
        OgdenSpec(mu=(-3e5,), alpha=(-1.7,), convention="mu/alpha"),
        2.55e5,
        lambda x, i1, i2: -3e5 * x**-1.7,
    ),
}
STATES = {
    "rest": np.ones(3),
    "equibiaxial": np.array([1.25, 1.25, 1.25**-2]),
    "uniaxial": np.array([1.8, 1.8**-0.5, 1.8**-0.5]),
    "general": np.array([1.4, 0.9, 1.0 / (1.4 * 0.9)]),
    "swollen": np.array([1.4, 0.9, 1.1]),
}


def energy(law: AbstractLaw, F: jax.Array) -> jax.Array:
    return law.energy(GeneralDeformation.of_gradient(F))


@eqx.filter_jit
def expansion(law: AbstractLaw, F: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Energy, first Piola-Kirchhoff stress and its tangent."""
    stress = jax.jacfwd(energy, 1)
    return energy(law, F), stress(law, F), jax.jacfwd(stress, 1)(law, F)


@pytest.fixture(params=list(CASES))
def case(request: pytest.FixtureRequest) -> Case:
    return CASES[request.param]


def test_every_law_has_a_case() -> None:
    assert {case.material.law for case in CASES.values()} == set(LAWS)


@pytest.mark.parametrize("law", list(LAWS))
def test_declaration_agrees_with_the_law_itself(law: str) -> None:
    declared, built = LAWS[law].spec, LAWS[law]
    assert declared is not None
    arguments = inspect.signature(built.__init__).parameters
    assert set(arguments) - {"self"} == set(declared.declared())
    for key in declared.declared():
        field, argument = declared.model_fields[key], arguments[key]
        assert field.is_required() == (argument.default is inspect.Parameter.empty)
        assert field.is_required() or field.default == argument.default


@pytest.mark.parametrize("law", list(LAWS))
def test_examples_of_the_declaration_are_a_law(law: str) -> None:
    fields = LAWS[law].spec.model_fields
    table = tomllib.loads("\n".join(f"{k} = {f.examples[0]}" for k, f in fields.items()))
    scene = {
        "geometry": {"inner_radius": "50 mm", "thickness": "1 mm", "half_angle": "90 deg"}
        | {"width": "100 mm", "oil_gap": "5 mm"},
        "oil": {"model": "incompressible"},
    }
    material = scene_from_dict({**scene, "material": table}).material
    assert build_law(material).shear_modulus > 0.0
    assert scene_from_dict({**scene, "material": material.table()}).material == material


def test_rest_has_neither_energy_nor_stress(case: Case) -> None:
    value, stress, _ = expansion(case.law, jnp.eye(3))
    assert value == 0.0
    np.testing.assert_allclose(stress, 0.0, atol=1e-15 * case.modulus)


def test_small_strain_modulus_is_the_declared_one(case: Case) -> None:
    np.testing.assert_allclose(case.law.shear_modulus, case.modulus, rtol=1e-14)
    delta = np.eye(3)
    expected = case.modulus * (
        np.einsum("ik,jl->ijkl", delta, delta)
        + np.einsum("il,jk->ijkl", delta, delta)
        - 2.0 / 3.0 * np.einsum("ij,kl->ijkl", delta, delta)
    )
    _, _, tangent = expansion(case.law, jnp.eye(3))
    np.testing.assert_allclose(tangent, expected, atol=2e-15 * case.modulus)


@pytest.mark.parametrize("strain", [1e-9, -1e-9, 1e-7])
def test_small_strain_energy_is_relatively_accurate(case: Case, strain: float) -> None:
    # Ψ = μ/2 e² (1 − e + ...) with e = λ² − 1.
    got = case.law.energy(FibreStretch(jnp.array(strain)))
    expected = 0.5 * case.modulus * strain**2 * (1.0 - strain)
    np.testing.assert_allclose(got, expected, rtol=3e-13)


@pytest.mark.parametrize("state", list(STATES))
def test_objectivity_and_isotropy(case: Case, state: str) -> None:
    F, Q = rotation(1) @ np.diag(STATES[state]) @ rotation(2), rotation(3)
    value, stress, _ = expansion(case.law, jnp.asarray(F))
    tolerance = {"rtol": 1e-12, "atol": 3e-14 * case.modulus}
    turned, turned_stress, _ = expansion(case.law, jnp.asarray(Q @ F))
    np.testing.assert_allclose(turned, value, **tolerance)
    np.testing.assert_allclose(turned_stress, Q @ stress, **tolerance)
    other, other_stress, _ = expansion(case.law, jnp.asarray(F @ Q))
    np.testing.assert_allclose(other, value, **tolerance)
    np.testing.assert_allclose(other_stress, stress @ Q, **tolerance)


@pytest.mark.parametrize("state", list(STATES))
def test_tangent_is_symmetric(case: Case, state: str) -> None:
    F = jnp.asarray(rotation(1) @ np.diag(STATES[state]) @ rotation(2))
    _, _, tangent = expansion(case.law, F)
    np.testing.assert_allclose(
        tangent, np.transpose(tangent, (2, 3, 0, 1)), atol=1e-13 * np.max(np.abs(tangent))
    )


@pytest.mark.parametrize("state", list(STATES))
def test_stress_is_the_textbook_one(case: Case, state: str) -> None:
    stretches = STATES[state]
    volume = np.prod(stretches)
    unit = stretches / volume ** (1.0 / 3.0)
    shares = case.share(unit, np.sum(unit**2), np.sum(unit**-2.0))
    # Isochoric Kirchhoff stress is the deviator of the shares; P = τ F⁻ᵀ.
    kirchhoff = shares - shares.mean()
    left, right = rotation(1), rotation(2)
    expected = left @ np.diag(kirchhoff / stretches) @ right
    _, stress, _ = expansion(case.law, jnp.asarray(left @ np.diag(stretches) @ right))
    np.testing.assert_allclose(stress, expected, rtol=1e-12, atol=1e-13 * case.modulus)


@pytest.mark.parametrize("state", list(STATES))
def test_tangent_is_exact_where_stretches_coincide(case: Case, state: str) -> None:
    """Against the closed form in principal axes, from textbook derivatives in one stretch."""
    stretches = STATES[state]

    def slopes(x: np.ndarray) -> np.ndarray:
        unit = x / np.prod(x) ** (1.0 / 3.0)
        shares = case.share(unit, np.sum(unit**2), np.sum(unit**-2.0))
        return (shares - shares.mean()) / x

    # Complex steps: derivatives of the textbook stress to rounding error.
    step = 1e-30
    W = slopes(stretches)
    curvature = np.stack(
        [np.imag(slopes(stretches + 1j * step * np.eye(3)[k])) / step for k in range(3)], axis=1
    )
    expected = np.zeros((3, 3, 3, 3))
    for i in range(3):
        for j in range(3):
            expected[i, i, j, j] = curvature[i, j]
            if i == j:
                continue
            plus = (W[i] + W[j]) / (stretches[i] + stretches[j])
            if stretches[i] == stretches[j]:
                minus = curvature[i, i] - curvature[i, j]
            else:
                minus = (W[i] - W[j]) / (stretches[i] - stretches[j])
            expected[i, j, i, j] = 0.5 * (minus + plus)
            expected[i, j, j, i] = 0.5 * (minus - plus)
    _, _, tangent = expansion(case.law, jnp.diag(jnp.asarray(stretches)))
    np.testing.assert_allclose(tangent, expected, atol=1e-13 * np.max(np.abs(expected)))


@pytest.mark.parametrize("stretch", [0.7, 1.0, 1.6])
def test_all_deformations_give_one_energy(case: Case, stretch: float) -> None:
    other = 1.0 / stretch
    shares = [
        FibreStretch(jnp.array(stretch**2 - 1.0)),
        PlaneStrain(jnp.array((stretch - other) ** 2), jnp.array(0.0)),
        LogStretches(jnp.log(stretch), -jnp.log(stretch)),
        GeneralDeformation.of_gradient(jnp.diag(jnp.array([stretch, other, 1.0]))),
    ]
    values = np.array([case.law.energy(share) for share in shares])
    np.testing.assert_allclose(values[1:], values[0], rtol=1e-13, atol=1e-30)
    assert (values[0] > 0.0) == (stretch != 1.0)


def test_lanes_broadcast_against_trailing_axes(case: Case) -> None:
    factors = jnp.array([0.5, 1.0, 3.0])
    leaves, structure = jax.tree.flatten(case.law)
    keys = [field.name for field in dataclasses.fields(case.law)]
    is_stiffness = [case.material.unit(key) == "Pa" for key in keys]
    lanes = jax.tree.unflatten(
        structure,
        [
            leaf[..., None] * (factors if stiffness else jnp.ones(3))
            for leaf, stiffness in zip(leaves, is_stiffness, strict=True)
        ],
    )
    green = jnp.linspace(-0.3, 0.4, 5)
    together = lanes.energy(FibreStretch(green[:, None]))
    assert together.shape == (5, 3)
    one = case.law.energy(FibreStretch(green))
    np.testing.assert_allclose(together, one[:, None] * factors, rtol=1e-14)
    np.testing.assert_allclose(lanes.shear_modulus, case.modulus * factors, rtol=1e-14)
    mapped = jax.vmap(lambda law: law.energy(FibreStretch(green)), in_axes=-1, out_axes=-1)
    np.testing.assert_allclose(mapped(lanes), together, rtol=1e-14)


def test_energy_is_differentiable_in_the_constants(case: Case) -> None:
    state = GeneralDeformation.of_gradient(jnp.diag(jnp.array([1.3, 1.3, 1.3**-2])))
    slope = jax.jit(jax.grad(lambda law: law.energy(state)))(case.law)
    leaves, structure = jax.tree.flatten(case.law)
    for k, leaf in enumerate(leaves):
        flat = np.ravel(leaf)
        for i in range(flat.size):
            step = 1e-4 * max(abs(flat[i]), 1.0)
            values = []
            for sign in (1.0, -1.0):
                moved = flat.copy()
                moved[i] += sign * step
                changed = [
                    *leaves[:k],
                    jnp.asarray(moved.reshape(leaf.shape)),
                    *leaves[k + 1 :],
                ]
                values.append(float(jax.tree.unflatten(structure, changed).energy(state)))
            expected = (values[0] - values[1]) / (2.0 * step)
            got = np.ravel(jax.tree.leaves(slope)[k])[i]
            np.testing.assert_allclose(got, expected, rtol=1e-6)


def test_a_law_built_inside_a_compiled_function_is_the_same(case: Case) -> None:
    leaves = jax.tree.leaves(case.law)
    traces = []

    @jax.jit
    def build_and_evaluate(constants: list, green: jax.Array) -> jax.Array:
        traces.append(1)
        return type(case.law)(*constants).energy(FibreStretch(green))

    got = build_and_evaluate(leaves, jnp.array(0.2))
    build_and_evaluate([2.0 * leaves[0], *leaves[1:]], jnp.array(0.3))
    np.testing.assert_allclose(got, case.law.energy(FibreStretch(jnp.array(0.2))), rtol=1e-15)
    assert len(traces) == 1


def test_float32_constants_stay_float32() -> None:
    law = NeoHookean(jnp.float32(2.0))
    assert law.energy(FibreStretch(jnp.float32(0.1))).dtype == jnp.float32
    assert NeoHookean(2).mu.dtype == jnp.float64


def test_ogden_conventions() -> None:
    alpha = [1.3, 5.0, -2.0]
    published = [0.5 * m * a for m, a in zip(TABLE_1[0], alpha, strict=True)]
    law = Ogden.from_convention(published, alpha, "2mu/alpha^2")
    np.testing.assert_allclose(law.mu, TABLE_1[0], rtol=1e-15)
    np.testing.assert_allclose(law.shear_modulus, sum(published), rtol=1e-15)
    same = Ogden.from_convention(*TABLE_1, "mu/alpha")
    np.testing.assert_array_equal(same.mu, Ogden(*TABLE_1).mu)
    slope = jax.grad(lambda a: Ogden.from_convention([3e5], [a], "2mu/alpha^2").mu[0])(1.5)
    np.testing.assert_allclose(slope, -2.0 * 3e5 / 1.5**2, rtol=1e-15)


def test_ogden_terms_may_be_soft_and_their_lanes_broadcast() -> None:
    assert Ogden([1e-3, -2e-3], [2.0, -0.25]).shear_modulus == pytest.approx(1.25e-3)
    lanes = Ogden(jnp.ones((2, 3)), 2.0 * jnp.ones((2, 5, 3)))
    np.testing.assert_array_equal(lanes.shear_modulus, np.full((5, 3), 2.0))


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: NeoHookean(0.0), "mu must be positive"),
        (lambda: NeoHookean(float("nan")), "mu must be positive"),
        (lambda: MooneyRivlin(1e6, -1e6), r"2 \(C1 \+ C2\)"),
        (lambda: MooneyRivlin(1e6, 0.0, float("inf")), "C3 must be finite"),
        (lambda: Yeoh(-1.0), "C1 must be positive"),
        (lambda: Yeoh(1.0, float("nan")), "C2 must be finite"),
        (lambda: Gent(1e5, 0.0), "Jm must be positive"),
        (lambda: ArrudaBoyce(1e5, -1.0), "lambda_m must be positive"),
        (lambda: Polynomial(1e5, -2e5), r"2 \(C10 \+ C01\)"),
        (lambda: Polynomial(1e5, C03=float("nan")), "C03 must be finite"),
        (lambda: Ogden([1e5, 2e5], [1.3]), "mu has 2 terms and alpha has 1"),
        (lambda: Ogden(jnp.ones((2, 3)), jnp.ones((1, 3))), "mu has 2 terms and alpha has 1"),
        (lambda: Ogden([], []), "at least one term"),
        (lambda: Ogden([1e5, 1e3], [1.3, -2.0]), "term 1 .* must be positive"),
        (lambda: Ogden([1e5], [0.0]), "term 0"),
        (
            lambda: Ogden(jnp.ones((1, 2)), jnp.ones((1, 3))),
            r"lanes of mu \(2,\) and alpha \(3,\) do not broadcast",
        ),
        (lambda: Ogden.from_convention([1e5], [0.0], "2mu/alpha^2"), "alpha not zero"),
        (lambda: Ogden.from_convention([1e5], [2.0], "abaqus"), "unknown convention"),
        (lambda: Ogden.from_convention([-1e5], [-2.0], "2mu/alpha^2"), "mu must be positive"),
    ],
)
def test_bad_constants_are_refused(build: Callable[[], AbstractLaw], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        build()
