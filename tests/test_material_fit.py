"""Material fits: published data, known truths, convergence, coverage, misfit."""

import dataclasses
import functools
import pathlib

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize
from scipy import stats

from fitting.material.experiments.artefacts import curve_suspects
from fitting.material.experiments.bulge import Bulge
from fitting.material.experiments.datasets import load_dataset
from fitting.material.experiments.measurements import Dataset
from fitting.material.experiments.prediction import Homogeneous, mode_factors, shear_factors
from fitting.material.fit import comparison as comparison_of_laws
from fitting.material.fit.comparison import compare_laws
from fitting.material.fit.fit import fit_material
from fitting.material.fit.problem import pose
from fitting.material.fit.search import NoFit, refuse_without_stiffness
from fitting.material.laws.parameters import Constant, Family, Scales
from fitting.material.laws.registry import family
from fitting.material.report.summary import material_report
from fitting.statistics.diagnostics import misfit
from fitting.statistics.least_squares import minimise
from fitting.statistics.residuals import sensitivity
from suas_jax.config import LAWS
from suas_jax.constitutive import (
    AbstractLaw,
    Gent,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    balloon_pressure,
    inflated_diaphragm,
    simple_shear,
    uniaxial,
)
from suas_jax.constitutive.deformation import AbstractDeformation

DATA = pathlib.Path(__file__).parent.parent / "configs" / "data"
TABLE_1 = np.array([6.3e5, 0.012e5, -0.1e5, 1.3, 5.0, -2.0])
TRELOAR = ("uniaxial", "equibiaxial", "pure_shear")


@pytest.fixture(scope="module")
def treloar() -> list[Dataset]:
    return [load_dataset(mode, DATA / f"treloar1944_{mode}.csv") for mode in TRELOAR]


def made_by(law: AbstractLaw, sets: list[Dataset], noise: float, seed: int) -> list[Dataset]:
    """The same tests, read from a law with relative Gaussian noise."""
    rng = np.random.default_rng(seed)
    made = []
    for data in sets:
        test = pose([data], family("neo-hookean"), "absolute").residuals.experiments[0]
        exact = np.asarray(test.predict(law))[: data.size]
        sigma = noise * np.abs(exact)
        value = exact + sigma * rng.standard_normal(data.size)
        made.append(dataclasses.replace(data, value=value, sigma=sigma))
    return made


@pytest.mark.parametrize("kind", ["relative", pytest.param("absolute", marks=pytest.mark.long)])
def test_ogden_on_treloar_matches_scipy_and_beats_table_1(
    treloar: list[Dataset], kind: str
) -> None:
    law = family("ogden", 3)
    residuals = pose(treloar, law, kind).residuals
    fit = fit_material(treloar, law, residual=kind)
    assert fit.status == "converged"
    published = residuals.of_constants(jnp.asarray(TABLE_1))
    assert fit.cost < 0.5 * float(jnp.sum(published**2))
    value = jax.jit(lambda theta: residuals(theta))
    slope = jax.jit(jax.jacfwd(lambda theta: residuals(theta)))
    rng = np.random.default_rng(5)
    best = np.inf
    for start in law.random(rng, 12):
        start[:3] += rng.uniform(-4.0, 0.0, 3) - np.abs(start[3:])
        with np.errstate(over="ignore"):
            found = scipy.optimize.least_squares(
                value, start, slope, x_scale="jac", max_nfev=300
            )
        best = min(best, found.cost)
    assert fit.cost <= best * (1.0 + 1e-6)


@pytest.mark.long  # a program; what is not measured in test_material_formulas
def test_a_single_mode_leaves_other_modes_to_the_band(treloar: list[Dataset]) -> None:
    report = material_report(fit_material(treloar[:1], "ogden", 3))
    # The law itself is thousands of times off there; the band over laws holds a third.
    warnings = " ".join(report["warnings"])
    assert "not measured, predicted from uniaxial (95 %)" in warnings
    assert "the law itself leaves the 95 % band" in warnings


def test_plane_strain_determines_the_sum_of_c1_and_c2(treloar: list[Dataset]) -> None:
    made = made_by(MooneyRivlin(2e5, 3e4), treloar[2:], 0.01, 0)
    fit = fit_material(made, "mooney-rivlin", 2)
    assert fit.uncertainty.unidentifiable == ("C1 - C2 (free by any amount)",)
    np.testing.assert_allclose(fit.constants.sum(), 2.3e5, rtol=0.01)
    assert fit.uncertainty.condition_number > 1e10


@pytest.mark.long  # two fits; published data of three modes above
@pytest.mark.parametrize(
    ("mode", "file"),
    [
        ("biaxial", "kawabata1981_general_biaxial.csv"),
        ("biaxial_difference", "jones_treloar1975_biaxial_difference.csv"),
    ],
)
def test_published_biaxial_data_are_fitted(mode: str, file: str) -> None:
    report = material_report(fit_material([load_dataset(mode, DATA / file)], "ogden", 2))
    assert report["status"] == "converged"
    assert (
        report["modes"][mode]["rms_MPa"] < {"biaxial": 0.015, "biaxial_difference": 0.07}[mode]
    )
    assert report["modes"][mode]["n"] == {"biaxial": 234, "biaxial_difference": 167}[mode]


@pytest.mark.parametrize(
    "law",
    [
        name if name in ("carroll", "gent") else pytest.param(name, marks=pytest.mark.long)
        for name in LAWS
        if name != "ogden"
    ],
)
def test_exact_data_recover_the_constants(treloar: list[Dataset], law: str) -> None:
    chosen = family(law)
    scales = pose(treloar, chosen, "relative").residuals.scales
    theta = np.linspace(-0.15, 0.1, chosen.size)
    truth = np.asarray(chosen.constants(jnp.asarray(theta), scales))
    made = made_by(chosen.law(jnp.asarray(truth)), treloar, 0.0, 0)
    residuals = pose(made, chosen, "relative").residuals
    starts = chosen.random(np.random.default_rng(0), 16)
    found = minimise(residuals, starts)
    assert found.converged[0]
    constants = np.asarray(chosen.constants(jnp.asarray(found.theta[0]), residuals.scales))
    np.testing.assert_allclose(constants, truth, rtol=1e-5, atol=1e-6 * abs(truth).max())


@pytest.mark.parametrize("law", list(LAWS))
def test_bijections_invert_and_keep_sign_conditions(law: str) -> None:
    chosen = family(law, LAWS[law].most_terms())
    scales = Scales(*map(jnp.asarray, (4e5, 50.0, 20.0, 2.0)))
    rng = np.random.default_rng(2)
    for theta in rng.normal(0.0, 2.0, (20, chosen.size)):
        constants = chosen.constants(jnp.asarray(theta), scales)
        built = chosen.law(constants)  # refuses constants that break its conditions
        assert float(built.shear_modulus) > 0.0
        np.testing.assert_allclose(
            chosen.unconstrained(constants, scales), theta, rtol=1e-9, atol=1e-9
        )


def test_readings_of_all_tests_are_those_of_the_closed_forms() -> None:
    law = Ogden(TABLE_1[:3], TABLE_1[3:])
    stretch = np.array([0.7, 1.3, 2.2])

    def read(factors: tuple[np.ndarray, ...]) -> np.ndarray:
        return np.asarray(Homogeneous(*map(jnp.asarray, factors)).predict(law))

    np.testing.assert_allclose(
        read(mode_factors("uniaxial", stretch)), uniaxial(law, stretch).cauchy, rtol=1e-13
    )
    shear = np.array([-0.5, 0.2, 1.7])
    np.testing.assert_allclose(
        read(shear_factors(shear)), simple_shear(law, shear).shear, rtol=1e-13
    )


def test_balloon_file_is_read_as_the_balloon_formula(tmp_path: pathlib.Path) -> None:
    law = NeoHookean(4e5)
    stretch = np.linspace(1.1, 2.5, 12)
    pressure = np.asarray(balloon_pressure(law, stretch, 0.3 / 20))
    file = tmp_path / "balloon.csv"
    rows = "".join(f"{20 * s},{p / 100}\n" for s, p in zip(stretch, pressure, strict=True))
    file.write_text(
        f"# rest_radius: 20 mm\n# thickness: 0.3 mm\nradius_mm,pressure_mbar\n{rows}"
    )
    fit = fit_material([load_dataset("balloon", file)], "neo-hookean", starts=4)
    np.testing.assert_allclose(fit.constants, 4e5, rtol=1e-8)
    file.write_text(file.read_text().replace("radius_mm,", "diameter [mm],"))
    halved = load_dataset("balloon", file).stretch_1
    np.testing.assert_allclose(halved, stretch / 2, rtol=1e-12)


def test_bulges_of_a_height_have_the_pressure_of_the_inflated_membrane() -> None:
    law = MooneyRivlin(2e5, 3e4)
    exact = inflated_diaphragm(law, jnp.array([1.02, 1.2, 1.6, 3.0]), 1.0, 0.03)
    bulge = Bulge(jnp.asarray(exact.apex_height), jnp.full(4, 0.03))
    np.testing.assert_allclose(bulge.predict(law), exact.pressure, rtol=1e-9)


@pytest.mark.long  # a program of another law; the largest height in test_diaphragm
def test_bulges_have_no_pressure_at_heights_that_a_law_does_not_reach() -> None:
    """A soft law's membrane bulges to a largest height, beyond which it has no equilibrium."""
    bulge = Bulge(jnp.array([0.9, 1.0, 1.3]), jnp.full(3, 0.03))
    found = bulge.predict(Ogden(4e5, 1.0))
    np.testing.assert_array_equal(np.isfinite(found), [True, True, False])


@pytest.mark.long  # a program; derivatives of the diaphragm in test_diaphragm
def test_derivatives_of_bulges_are_those_of_their_pressures() -> None:
    chosen, constants = family("ogden", 2), np.array([6.3e5, -1e4, 1.3, -2.0])
    bulge = Bulge(jnp.array([0.3, 0.8]), jnp.full(2, 0.03))
    linearised = jax.jit(lambda c: bulge.linearised(chosen, c))
    _, slope = linearised(jnp.asarray(constants))
    for i, size in enumerate(constants):
        moved = [constants + step * size * np.eye(4)[i] for step in (1e-5, -1e-5)]
        high, low = (linearised(jnp.asarray(c))[0] for c in moved)
        np.testing.assert_allclose(slope[:, i], (high - low) / (2e-5 * size), rtol=1e-6)


def bulge_file(tmp_path: pathlib.Path, law: AbstractLaw, count: int) -> pathlib.Path:
    """A bulge test of a law with 1 % noise."""
    exact = inflated_diaphragm(law, np.exp(np.linspace(0.02, 0.75, count)), 40e-3, 1.5e-3)
    noise = 1.0 + 0.01 * np.random.default_rng(1).standard_normal(count)
    file = tmp_path / "bulge.csv"
    rows = "".join(
        f"{1e3 * float(h)},{1e-3 * float(p) * e}\n"
        for h, p, e in zip(exact.apex_height, exact.pressure, noise, strict=True)
    )
    file.write_text(
        f"# radius: 40 mm\n# thickness: 1.5 mm\napex_height_mm,pressure_kPa\n{rows}"
    )
    return file


@pytest.mark.long  # two fits of bulges; their pressures above
def test_bulge_tests_determine_the_law(tmp_path: pathlib.Path) -> None:
    """Also where the law is written as Ogden's: μ_p α_p / 2 of exponents ±2 are 2C₁ and 2C₂."""
    data = [load_dataset("bulge", bulge_file(tmp_path, MooneyRivlin(2e5, 3e4), 20))]
    fit = fit_material(data, "mooney-rivlin", 2)
    assert fit.status == "converged"
    low, high = fit.intervals(0.95)
    assert np.all((low < [2e5, 3e4]) & (high > [2e5, 3e4]))
    other = fit_material(data, "ogden", 2)
    assert other.status == "converged"
    assert fit.cost * 0.9 < other.cost < fit.cost
    np.testing.assert_allclose(other.shear_modulus()[0], fit.shear_modulus()[0], rtol=0.02)


@pytest.mark.long  # a fit of bulges; their pressures above
def test_a_valley_of_bulge_tests_is_followed_to_its_bottom(tmp_path: pathlib.Path) -> None:
    """Two terms that one curve hardly tells apart: the truth costs more than the minimum."""
    truth = Ogden(np.array([6.3e5, -1e5]), np.array([1.3, -2.0]))
    fit = fit_material([load_dataset("bulge", bulge_file(tmp_path, truth, 20))], "ogden", 2)
    assert fit.status == "converged"
    exact = fit.problem.residuals.of_constants(jnp.array([6.3e5, -1e5, 1.3, -2.0]))
    assert fit.cost < 0.5 * float(jnp.sum(exact**2))


@pytest.mark.long  # a fit of bulges; bounds below
def test_bounds_without_a_bulge_of_the_measured_height_are_named(
    tmp_path: pathlib.Path,
) -> None:
    data = [load_dataset("bulge", bulge_file(tmp_path, MooneyRivlin(2e5, 3e4), 6))]
    with pytest.raises(NoFit, match="--bound leaves no constants with finite stresses"):
        fit_material(data, "ogden", 1, bounds={"alpha.0": (1.0, 1.02)}, starts=16)


def test_a_user_defined_energy_is_fitted(treloar: list[Dataset]) -> None:
    class Hencky(AbstractLaw):
        mu: jax.Array

        def energy(self, deformation: AbstractDeformation) -> jax.Array:
            small = 1e-2
            return self.mu / small**2 * deformation.power_sum_minus_3(small)

        @property
        def shear_modulus(self) -> jax.Array:
            return self.mu

    made = made_by(Hencky(jnp.asarray(3e5)), treloar, 0.0, 0)
    fit = fit_material(made, Family("hencky", (Constant("mu"),), Hencky), starts=4)
    np.testing.assert_allclose(fit.constants, 3e5, rtol=1e-8)


@pytest.mark.long  # 40 fits; intervals in test_statistics_formulas
@pytest.mark.parametrize("kind", ["relative", "noise"])
def test_intervals_cover_the_truth(treloar: list[Dataset], kind: str) -> None:
    truth = np.array([1.9e5, -1.8e3, 44.0])
    law = family("yeoh", 3)
    hits: dict[float, list[np.ndarray]] = {0.6827: [], 0.95: []}
    for seed in range(40):
        made = made_by(law.law(jnp.asarray(truth)), treloar, 0.02, seed)
        fit = fit_material(made, law, residual=kind, starts=16)
        for level, found in hits.items():
            low, high = fit.intervals(level)
            found.append((fit.status == "converged") & (low <= truth) & (truth <= high))
    # Binomial with 40 draws of three constants: two standard deviations are 9 % and 4 %.
    assert abs(np.mean(hits[0.6827]) - 0.6827) < 0.1
    assert abs(np.mean(hits[0.95]) - 0.95) < 0.05


@pytest.mark.parametrize("correlation", [0.0, 0.5])
def test_correlated_noise_widens_intervals_as_much_as_it_costs(correlation: float) -> None:
    """A line through 60 readings: its slope scatters by the factor that misfit states."""
    rng = np.random.default_rng(2)
    x = np.linspace(0.5, 1.5, 60)
    inside, factors = 0, []
    for _ in range(400):
        e = rng.standard_normal(60)
        for i in range(1, 60):
            e[i] = correlation * e[i - 1] + np.sqrt(1.0 - correlation**2) * e[i]
        slope = float(x @ e) / float(x @ x)
        r = e - slope * x
        found = misfit([r], 1, known_noise=False, smooth=[(r, x[:, None])])
        error = found.inflation * np.sqrt(float(r @ r) / 59 / float(x @ x))
        factors.append(found.inflation)
        inside += abs(slope) < stats.t.ppf(0.975, 59) * error
        assert bool(found.description) == (found.inflation > 1.0)
    assert 0.90 < inside / 400 < 0.98
    expected = np.sqrt((1.0 + correlation) / (1.0 - correlation))
    assert 0.95 * expected < np.median(factors) < 1.15 * expected


@pytest.mark.parametrize("kind", ["relative", "noise"])
def test_a_wrong_law_is_reported_and_widens_intervals(
    treloar: list[Dataset], kind: str
) -> None:
    truth = Ogden(TABLE_1[:3], TABLE_1[3:])
    made = made_by(truth, treloar, 0.01, 1)
    fit = fit_material(made, "neo-hookean", residual=kind, starts=4)
    assert fit.misfit.significant
    assert fit.misfit.inflation > 2.0
    (low,), (high,) = fit.intervals(0.95)
    assert low < float(truth.shear_modulus) < high
    right = fit_material(made, "ogden", 3, residual=kind)
    assert not right.misfit.significant


@pytest.mark.long  # twelve fits; misfit in test_statistics_formulas
def test_lack_of_fit_distinguishes_two_similar_laws(treloar: list[Dataset]) -> None:
    # Both agree to about the noise; residuals of the wrong one bend along the tests.
    truth = Gent(3e5, 90.0)
    said = np.zeros(2, dtype=int)
    for seed in range(6):
        made = made_by(truth, treloar, 0.02, seed)
        for i, law in enumerate(("yeoh", "gent")):
            fit = fit_material(made, law, residual="noise", starts=16)
            said[i] += fit.misfit.significant
    assert said[0] >= 3  # 74 % of 50 in the benchmark
    assert said[1] <= 1


@pytest.mark.long  # three fits; criteria in test_statistics_formulas
def test_laws_are_ranked_by_information(treloar: list[Dataset]) -> None:
    made = made_by(MooneyRivlin(2e5, 3e4), treloar, 0.01, 4)
    candidates = (("neo-hookean", 1), ("mooney-rivlin", 2), ("ogden", 1))
    comparison = compare_laws(made, candidates, starts=16)
    assert comparison.best.family.title == "mooney-rivlin-2"
    aicc = [row["aicc"] for row in comparison.table]
    assert aicc == sorted(aicc)


@pytest.mark.parametrize(
    ("law", "constants", "says"),
    [
        (("mooney-rivlin", 2), [1e5, -1e5], "must be positive and finite, got 0.0"),
        (("mooney-rivlin", 2), [1e5, 0.01 - 1e5], "its shear modulus is 0.02 Pa"),
        (("ogden", 1), [1e-300, 1e-300], "must be positive"),
        (("gent", 1), [1.0, 100.0], "its shear modulus is 1 Pa"),
    ],
)
def test_a_law_without_stiffness_at_rest_is_no_answer(
    treloar: list[Dataset], law: tuple[str, int], constants: list[float], says: str
) -> None:
    chosen = family(*law)
    with pytest.raises(NoFit, match=f"^{chosen.title}: .*{says}"):
        refuse_without_stiffness(treloar, chosen, np.array(constants))


def test_a_law_that_is_soft_at_rest_is_an_answer(treloar: list[Dataset]) -> None:
    least = 1e-3 * min(data.modulus for data in treloar)
    refuse_without_stiffness(treloar, family("neo-hookean"), np.array([1.001 * least]))
    refuse_without_stiffness(treloar, family("mooney-rivlin", 2), np.array([2e5, -1.9e5]))


def silicone(folder: pathlib.Path) -> Dataset:
    """A soft silicone that softens first and stiffens up to a stretch of 17."""
    stretch = np.linspace(1.0, 17.0, 40)
    stress = 12.0 * (1.0 - np.exp(-(stretch - 1.0) / 0.8)) + 0.27 * (stretch - 1.0) ** 3
    rows = (f"{x:.6g},{y:.6g}" for x, y in zip(stretch, stress, strict=True))
    file = folder / "silicone.csv"
    file.write_text("\n".join(["stretch,nominal_stress_kPa", *rows]), encoding="utf-8")
    return load_dataset("uniaxial", file)


def test_auto_answers_where_a_law_has_no_stiffness_at_rest(tmp_path: pathlib.Path) -> None:
    data = silicone(tmp_path)
    laws = (("mooney-rivlin", 2), ("yeoh", 3))
    comparison = compare_laws([data], laws, starts=16)
    assert "without stiffness at rest" in comparison.failed["mooney-rivlin-2"]
    assert comparison.best.family.title == "yeoh"
    assert float(comparison.best.law.shear_modulus) == pytest.approx(data.modulus, rel=0.5)
    assert all(np.isfinite(row["aicc"]) for row in comparison.table)


def test_a_stretch_of_a_soft_silicone_is_no_mistaken_percent(tmp_path: pathlib.Path) -> None:
    assert curve_suspects(silicone(tmp_path)) == []


def test_laws_that_fail_are_left_out_with_their_reasons(
    treloar: list[Dataset], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(sets: list[Dataset], law: Family, **options: object) -> object:
        if law.title == "gent":
            return dataclasses.replace(whole, minima=stuck)
        if law.title in failing:
            raise NoFit(f"{law.title}: none of 64 starts gave finite stresses")
        return whole

    whole = fit_material(treloar, "neo-hookean", starts=1)
    stuck = whole.minima._replace(converged=np.zeros_like(whole.minima.converged))
    monkeypatch.setattr(comparison_of_laws, "fit_material", fails)
    failing = {"ogden-1"}
    laws = (("gent", 1), ("ogden", 1), ("neo-hookean", 1))
    comparison = compare_laws(treloar, laws)
    assert [fit.family.title for fit in comparison.fits] == ["neo-hookean"]
    reasons = {
        "gent": "no start converged",
        "ogden-1": "none of 64 starts gave finite stresses",
    }
    assert comparison.failed == reasons
    failing.add("neo-hookean")
    with pytest.raises(NoFit, match=r"gent: no start converged; ogden-1: none.*; neo-hookean:"):
        compare_laws(treloar, laws)


def test_hard_bounds_hold_and_agree_with_scipy(treloar: list[Dataset]) -> None:
    fit = fit_material(treloar, "yeoh", bounds={"C3": (0.0, 20.0)}, starts=16)
    assert fit.bounded == ("C3",)
    np.testing.assert_allclose(fit.constants[2], 20.0, rtol=1e-6)
    residuals, size = fit.problem.residuals, np.array([1e5, 1e3, 1e1])
    found = scipy.optimize.least_squares(
        lambda q: np.asarray(residuals.of_constants(jnp.asarray(q * size))),
        [1.0, 1.0, 1.0],
        lambda q: np.asarray(sensitivity(residuals, jnp.asarray(q * size))[1]) * size,
        bounds=([0.0, -np.inf, 0.0], [np.inf, np.inf, 2.0]),
        method="dogbox",
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-12,
    )
    np.testing.assert_allclose(fit.cost, found.cost, rtol=1e-9)
    np.testing.assert_allclose(fit.constants, found.x * size, rtol=1e-5)
    with pytest.raises(ValueError, match=r"no such constant; allowed: C1, C2, C3"):
        fit_material(treloar, "yeoh", bounds={"C4": (0.0, 1.0)}, starts=16)


@pytest.mark.long
def test_random_cases_end_with_a_named_status(treloar: list[Dataset]) -> None:
    rng = np.random.default_rng(8)
    named = {"converged", "single_minimum", "not_converged"}
    for case in range(6):
        data = treloar[rng.integers(3)]
        part = data.select(np.sort(rng.permutation(data.size)[: rng.integers(1, data.size)]))
        noise = 10.0 ** rng.uniform(-3.0, 0.5)
        value = part.value * (1.0 + noise * rng.standard_normal(part.size))
        sign = rng.choice([1.0, 1.0, -1.0])
        value *= sign * 10.0 ** rng.uniform(-3.0, 3.0)
        made = dataclasses.replace(part, value=value)
        law, terms = [("ogden", 2), ("gent", 1), ("mooney-rivlin", 3)][case % 3]
        fit = functools.partial(fit_material, [made], law, terms, starts=16, seed=case)
        if sign < 0:
            with pytest.raises(ValueError, match="sign opposite to their strain"):
                fit()
            continue
        report = material_report(fit())
        assert report["status"] in named
        assert np.all(np.isfinite(report["covariance"]))


REST, PULLED = "1,0\n", "1.2,0.3\n"


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (REST * 4, "every reading is at rest"),
        ("1,0.001\n1,-0.001\n1,0.0005\n1,0\n", "every reading is at rest"),
        ("1,0\n1.2,0\n1.5,0\n", "every reading is zero"),
    ],
)
def test_data_without_information_are_refused(
    tmp_path: pathlib.Path, rows: str, message: str
) -> None:
    file = tmp_path / "a.csv"
    file.write_text("stretch_1,nominal_stress_MPa\n" + rows)
    data = load_dataset("uniaxial", file)
    with pytest.raises(ValueError, match=message):
        fit_material([data], "neo-hookean")


def test_readings_at_rest_are_no_degrees_of_freedom(tmp_path: pathlib.Path) -> None:
    """One reading of one constant has no residual: nothing is known of its accuracy."""
    file = tmp_path / "a.csv"
    file.write_text("stretch_1,nominal_stress_MPa\n" + 5 * REST + PULLED)
    fit = fit_material([load_dataset("uniaxial", file)], "neo-hookean")
    assert fit.uncertainty.dof == 0
    assert fit.uncertainty.standard_errors[0] >= (1 - 1e-9) * fit.constants[0]
    assert any("1 readings for 1 constants" in text for text in fit.uncertainty.unidentifiable)
