"""Relaxation and softening: stresses against closed forms, constants found within intervals."""

import hashlib
import json
import math
import pathlib
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import integrate
from typer.testing import CliRunner

from fitting.cli.app import app
from fitting.material.experiments.datasets import load_dataset
from fitting.material.experiments.history import (
    History,
    histories,
    thinned_history,
    with_history,
)
from fitting.material.fit.comparison import choose_prony_terms
from fitting.material.fit.fit import _THIN_HISTORY, fit_material
from suas_jax.config import ConfigError, scene_from_dict
from suas_jax.constitutive import MooneyRivlin, NeoHookean, build_law
from suas_jax.constitutive.relaxation import (
    Inelastic,
    OgdenRoxburgh,
    PronySeries,
    largest_before,
)

G, TAU = np.array([0.2, 0.15]), np.array([0.5, 20.0])
SERIES = PronySeries(jnp.asarray(G), jnp.asarray(TAU))
MU = 0.5e6  # instantaneous
LONG_TERM = MU * (1.0 - G.sum())


def written(file: pathlib.Path, head: str, *columns: np.ndarray) -> pathlib.Path:
    rows = ("".join(f"{x:.9g}," for x in row)[:-1] for row in zip(*columns, strict=True))
    file.write_text(head + "\n" + "\n".join(rows) + "\n")
    return file


def history(mode: str, file: pathlib.Path) -> History:
    return histories([with_history(load_dataset(mode, file))])


def ramp_and_hold(stretch: float, ramp: float) -> tuple[np.ndarray, np.ndarray]:
    time = np.concatenate([np.linspace(0.0, ramp, 11), ramp + np.logspace(-2.0, 2.3, 60)])
    return time, 1.0 + (stretch - 1.0) * np.minimum(time / ramp, 1.0)


def neo_hookean_relaxing(time: np.ndarray, ramp: float) -> np.ndarray:
    """Nominal stress in tension to a strain of 50 % that is then held.

    The branches' own differential equations are solved: with s = dev τ/λ² of the
    instantaneous law, branch i follows q' = g_i s' − q/τ_i, and fades once the strain is held.
    """

    def pulled(t: np.ndarray) -> np.ndarray:
        x = 1.0 + 0.5 * np.minimum(t / ramp, 1.0)
        tau = MU * (x**2 - 1.0 / x)
        return np.array([2.0 / 3.0 * tau / x**2, -tau / 3.0 * x])

    def rate(t: float, q: np.ndarray) -> np.ndarray:
        h = 1e-6 * ramp
        slope = (pulled(t) - pulled(t - h)) / h
        return np.concatenate(
            [g * slope - q[2 * i : 2 * i + 2] / TAU[i] for i, g in enumerate(G)]
        )

    loading = time <= ramp
    found = integrate.solve_ivp(
        rate, (0.0, ramp), np.zeros(4), dense_output=True, rtol=1e-8, atol=1.0
    ).sol
    fading = np.exp(-(time[~loading] - ramp) / np.repeat(TAU, 2)[:, None])
    q = np.concatenate([found(time[loading]), found(ramp)[:, None] * fading], axis=1)
    s = (1.0 - G.sum()) * pulled(time) + q[:2] + q[2:]
    x = 1.0 + 0.5 * np.minimum(time / ramp, 1.0)
    return np.asarray(x * s[0] - s[1] / x**2)


def test_convolution_of_steps_and_ramps_is_exact() -> None:
    time = jnp.array([0.0, 0.3, 0.9, 2.0, 2.0, 5.0])
    elapsed, begins = jnp.diff(time, prepend=0.0), jnp.arange(6) == 0
    step = SERIES.relaxed(elapsed, begins, jnp.ones((6, 1)))[:, 0]
    np.testing.assert_allclose(step, SERIES.modulus(time), rtol=1e-12)
    ramp = SERIES.relaxed(elapsed, begins, time[:, None])[:, 0]
    closed = (1 - G.sum()) * time + sum(
        g * tau * -jnp.expm1(-time / tau) for g, tau in zip(G, TAU, strict=True)
    )
    np.testing.assert_allclose(ramp, closed, rtol=1e-12)
    # Another history begins: nothing of the first is left.
    twice = SERIES.relaxed(
        jnp.tile(elapsed, 2), jnp.tile(begins, 2), jnp.tile(time[:, None], (2, 1))
    )
    np.testing.assert_allclose(twice[6:, 0], closed, rtol=1e-12)


def test_stress_at_a_constant_rate_follows_the_branches_equations(
    tmp_path: pathlib.Path,
) -> None:
    time = np.linspace(0.0, 1.0, 41)
    expected = neo_hookean_relaxing(time, 1.0)
    file = written(
        tmp_path / "rate.csv",
        "# strain_rate: 50 %/s\nstrain,nominal_stress_MPa",
        0.5 * time,
        expected / 1e6,
    )
    predicted = history("uniaxial", file).predict(Inelastic(NeoHookean(LONG_TERM), SERIES))
    np.testing.assert_allclose(predicted[:41], expected, rtol=1e-3, atol=1.0)


@pytest.mark.parametrize(
    ("mode", "names", "state"),
    [
        ("uniaxial", "stretch", (1.7,)),
        ("equibiaxial", "stretch", (1.3,)),
        ("pure_shear", "stretch", (0.8,)),
        ("biaxial", "stretch_1,stretch_2", (1.4, 1.1)),
        ("simple_shear", "shear_strain", (-0.6,)),
    ],
)
def test_every_mode_relaxes_alike_at_a_held_strain(
    tmp_path: pathlib.Path, mode: str, names: str, state: tuple[float, ...]
) -> None:
    time = np.array([0.0, 0.1, 1.0, 30.0])
    stress = "nominal_stress_1_MPa,nominal_stress_2_MPa" if mode == "biaxial" else "stress_MPa"
    if mode == "simple_shear":
        stress = "shear_stress_MPa"
    columns = [np.full(4, x) for x in state] + [np.ones(4)] * (1 + stress.count(","))
    file = written(tmp_path / "held.csv", f"time_s,{names},{stress}", time, *columns)
    test = with_history(load_dataset(mode, file))
    elastic = MooneyRivlin(0.1e6, 0.05e6)
    at_once = test.predictor(estimate=True)([test]).predict(elastic)[: test.size]
    relaxing = histories([test]).predict(Inelastic(elastic, SERIES))[: test.size]
    share = np.tile(SERIES.modulus(jnp.asarray(time)), test.size // 4) / (1 - G.sum())
    np.testing.assert_allclose(relaxing, at_once * share, rtol=1e-10)


def test_a_test_without_times_has_relaxed(tmp_path: pathlib.Path) -> None:
    stretch = np.linspace(1.0, 2.0, 9)
    file = written(tmp_path / "slow.csv", "stretch,nominal_stress_MPa", stretch, stretch - 1.0)
    law = Inelastic(NeoHookean(LONG_TERM), SERIES)
    predicted, slope = jax.jvp(
        lambda tau: history("uniaxial", file).predict(
            Inelastic(law.elastic, PronySeries(SERIES.g, tau))
        ),
        (SERIES.tau,),
        (SERIES.tau,),
    )
    np.testing.assert_allclose(predicted[:9], LONG_TERM * (stretch - stretch**-2), atol=1e-6)
    np.testing.assert_allclose(slope, 0.0, atol=1e-20)


def test_a_stated_ramp_stands_for_its_readings(tmp_path: pathlib.Path) -> None:
    time, stretch = ramp_and_hold(1.5, 0.4)
    law = Inelastic(NeoHookean(LONG_TERM), SERIES)
    names = "time_s,stretch,nominal_stress_MPa"
    whole = history("uniaxial", written(tmp_path / "a.csv", names, time, stretch, stretch))
    held = time > 0.4
    rest = (time[held] - 0.4, stretch[held], stretch[held])
    at_once = history("uniaxial", written(tmp_path / "b.csv", names, *rest))
    text = "# ramp: 400 ms\n# strain: 50 %\ntime_s,nominal_stress_MPa"
    known = history("uniaxial", written(tmp_path / "c.csv", text, rest[0], rest[2]))
    expected = whole.predict(law)[: time.size][held]
    np.testing.assert_allclose(known.predict(law)[: held.sum()], expected, rtol=2e-4)
    assert abs(at_once.predict(law)[0] / expected[0] - 1.0) > 0.03
    tests = [with_history(load_dataset("uniaxial", tmp_path / f"{k}.csv")) for k in "abc"]
    assert [test.is_loaded_at_once for test in tests] == [False, True, False]


def softened(stretch: np.ndarray, r: float, m: float, beta: float) -> np.ndarray:
    """Nominal stress of a neo-Hookean rubber in tension with the published softening."""
    energy = 0.5 * MU * (stretch**2 + 2.0 / stretch - 3.0)
    largest = np.maximum.accumulate(energy)
    eta = [
        1.0 - math.erf((top - now) / (m + beta * top)) / r
        for top, now in zip(largest, energy, strict=True)
    ]
    return np.array(eta) * MU * (stretch - stretch**-2)


def cycles() -> np.ndarray:
    parts = []
    for top in (1.3, 1.7, 2.2):
        up = np.linspace(1.0, top, 25)
        parts += [up, up[-2::-1]]
    return np.concatenate(parts)


def test_softening_is_that_of_the_published_formula(tmp_path: pathlib.Path) -> None:
    stretch = cycles()
    expected = softened(stretch, 1.8, 5e4, 0.1)
    file = written(tmp_path / "c.csv", "stretch,nominal_stress_Pa", stretch, expected)
    law = Inelastic(NeoHookean(MU), None, OgdenRoxburgh(*map(jnp.asarray, (1.8, 5e4, 0.1))))
    predicted = history("uniaxial", file).predict(law)[: len(stretch)]
    np.testing.assert_allclose(predicted, expected, rtol=1e-7, atol=1e-3)
    # Loading for the first time knows nothing of it; unloading is softer.
    virgin = MU * (stretch - stretch**-2)
    first = np.maximum.accumulate(stretch) == stretch
    np.testing.assert_allclose(predicted[first], virgin[first], rtol=1e-7, atol=1e-3)
    assert np.all(np.asarray(predicted)[~first][1:] < virgin[~first][1:] + 1e-3)


def test_largest_energy_begins_again_with_each_history() -> None:
    energy = jnp.array([1.0, 3.0, 2.0, 0.5, 0.2, 0.7])
    begins = jnp.array([True, False, False, True, False, False])
    np.testing.assert_array_equal(largest_before(energy, begins), [1, 3, 3, 0.5, 0.5, 0.7])


def lie_in_their_intervals(
    file: pathlib.Path,
    head: str,
    state: tuple[np.ndarray, ...],  # columns beside the stress
    exact: np.ndarray,  # stress [Pa]
    truth: np.ndarray,  # constants
    seed: int,
    **fitting: object,
) -> None:
    """Of 20 fits to 1 % of noise, as many as should state intervals that hold the truth."""
    rng, inside = np.random.default_rng(seed), []
    for _ in range(20):
        noisy = exact * (1.0 + 0.01 * rng.standard_normal(len(exact)))
        dataset = load_dataset("uniaxial", written(file, head, *state, noisy))
        fit = fit_material([dataset], "neo-hookean", **fitting)
        error = fit.uncertainty.standard_errors * fit.uncertainty.quantile(0.95)
        inside.append(np.abs(fit.constants - truth) < error)
    share = np.mean(inside, axis=0)
    assert np.all(share >= 0.75)
    assert 0.88 <= np.mean(share) <= 1.0


@pytest.mark.long  # 20 fits; stresses above
def test_prony_constants_lie_in_their_intervals(tmp_path: pathlib.Path) -> None:
    time, stretch = ramp_and_hold(1.5, 0.1)
    file, head, truth = tmp_path / "r.csv", "Time [s],strain,stress [Pa]", [LONG_TERM, *G, *TAU]
    exact = neo_hookean_relaxing(time, 0.1)
    state = time, stretch - 1
    lie_in_their_intervals(file, head, state, exact, np.array(truth), 1, prony=2)


@pytest.mark.long  # 20 fits; stresses above
def test_softening_constants_lie_in_their_intervals(tmp_path: pathlib.Path) -> None:
    stretch, truth = cycles(), np.array([MU, 1.8, 5e4, 0.1])
    exact, file = softened(stretch, *truth[1:]), tmp_path / "c.csv"
    head = "stretch,nominal_stress_Pa"
    lie_in_their_intervals(file, head, (stretch,), exact, truth, 2, mullins=True)


@pytest.mark.long  # a fit for each number of terms
def test_as_many_terms_as_the_data_determine(tmp_path: pathlib.Path) -> None:
    time, stretch = ramp_and_hold(1.5, 0.1)
    exact = neo_hookean_relaxing(time, 0.1)
    noisy = exact * (1.0 + 0.01 * np.random.default_rng(3).standard_normal(len(time)))
    file = written(tmp_path / "r.csv", "time_s,stretch,stress_Pa", time, stretch, noisy)
    found = choose_prony_terms([load_dataset("uniaxial", file)], "neo-hookean", None)
    assert found.best.family.title.endswith("2 Prony terms")
    assert any("Prony" in row["title"] and row["rejected"] for row in found.table)


def test_thinning_keeps_the_history(tmp_path: pathlib.Path) -> None:
    time = np.concatenate([np.linspace(0.0, 0.4, 41), 0.4 + np.linspace(0.01, 100.0, 8000)])
    stretch = 1.0 + 0.5 * np.minimum(time / 0.4, 1.0)
    file = written(tmp_path / "l.csv", "time_s,stretch,stress_Pa", time, stretch, stretch)
    whole = with_history(load_dataset("uniaxial", file))
    law = Inelastic(NeoHookean(LONG_TERM), SERIES)
    few = thinned_history(whole, 500)
    assert few.size < 400
    assert few.weight.sum() == pytest.approx(whole.size)
    predicted = histories([few]).predict(law)[: few.size]
    expected = np.interp(few.time, time, histories([whole]).predict(law)[: whole.size])
    np.testing.assert_allclose(predicted[1:], expected[1:], rtol=3e-3)


@pytest.mark.parametrize(
    ("most", "least", "largest"), [(500, 2.0, 1e9), (_THIN_HISTORY, 0.0, 0.5)]
)
def test_means_of_cycles_lie_on_them_to_far_below_their_noise(
    tmp_path: pathlib.Path, most: int, least: float, largest: float
) -> None:
    tops = np.concatenate([[top, 1.0] for top in (1.3, 1.6, 2.0, 2.4)])
    knots = np.append(1.0, tops)
    stretch = np.interp(np.linspace(0.0, 8.0, 20_000), np.arange(9.0), knots)
    stress = softened(stretch, 1.8, 5e4, 0.1)
    file = written(tmp_path / "c.csv", "stretch,nominal_stress_Pa", stretch, stress)
    few = thinned_history(with_history(load_dataset("uniaxial", file)), most)
    law = Inelastic(NeoHookean(MU), None, OgdenRoxburgh(*map(jnp.asarray, (1.8, 5e4, 0.1))))
    bias = histories([few]).predict(law)[: few.size] - few.value
    # In standard deviations of 1 % noise, over all readings.
    noise = 0.01 * np.maximum(np.abs(few.value), 0.01 * np.median(np.abs(few.value)))
    found = float(np.sqrt(np.sum(few.weight * (bias / noise) ** 2)))
    assert least <= found <= largest


SKIN = {
    "geometry": {"inner_radius": "50 mm", "thickness": "1 mm", "half_angle": "90 deg"}
    | {"width": "100 mm", "oil_gap": "5 mm"},
    "oil": {"model": "incompressible"},
}


def test_a_material_file_carries_both_elastic_responses() -> None:
    material = {"law": "ogden", "convention": "mu/alpha", "mu": ["0.3 MPa"], "alpha": [2.0]}
    relaxing = {**material, "relaxation": {"g": [0.2, 0.15], "tau": ["0.5 s", "20 s"]}}
    slow = scene_from_dict({**SKIN, "material": relaxing}).material
    fast = scene_from_dict(
        {**SKIN, "material": {**relaxing, "response": "instantaneous"}}
    ).material
    assert build_law(slow).shear_modulus == pytest.approx(0.3e6)
    assert build_law(fast).shear_modulus == pytest.approx(0.3e6 / 0.65)
    assert scene_from_dict({**SKIN, "material": fast.table()}).material == fast
    with pytest.raises(ConfigError, match="needs the relaxation of the stress"):
        scene_from_dict({**SKIN, "material": {**material, "response": "instantaneous"}})
    too_much = {"g": [0.6, 0.6], "tau": ["1 s", "2 s"]}
    with pytest.raises(ConfigError, match="sum of g must be less than 1"):
        scene_from_dict({**SKIN, "material": {**material, "relaxation": too_much}})


@pytest.mark.long  # a fit of a history; material files above
def test_the_command_writes_constants_that_a_skin_takes(tmp_path: pathlib.Path) -> None:
    time, stretch = ramp_and_hold(1.5, 0.1)
    exact = neo_hookean_relaxing(time, 0.1)
    noisy = exact * (1.0 + 0.01 * np.random.default_rng(4).standard_normal(len(time)))
    file = written(tmp_path / "r.csv", "time_s,stretch,stress_Pa", time, stretch, noisy)
    card = tmp_path / "rubber.toml"
    command = ["fit", "material", "--law", "neo-hookean", "--prony", "2", "--json"]
    command += ["--data", f"uniaxial={file}", "--export", f"toml={card}"]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.output
    report = json.loads(done.stdout)
    found = report["relaxation"]
    np.testing.assert_allclose(found["g"], G, rtol=0.1)
    np.testing.assert_allclose(found["tau_s"], TAU, rtol=0.3)
    low, high = found["intervals"]["95"]["g"][0]
    assert low < found["g"][0] < high
    modulus = found["instantaneous_shear_modulus_Pa"]
    assert modulus["low95"] < MU < modulus["high95"]
    assert report["parameters"]["mu"] == pytest.approx(LONG_TERM, rel=0.02)
    for option, value in (("--cycle", "last"), ("--branch", "loading"), ("--zero", "force")):
        refused = CliRunner().invoke(app, [*command, option, value, "--overwrite"])
        assert refused.exit_code == 2
        assert option in refused.output


@pytest.mark.long  # a fit and its page; pages in test_material_artefacts
def test_the_page_of_a_fit_needs_no_host(tmp_path: pathlib.Path) -> None:
    stretch = cycles()
    name = "<b>&cycles.csv"  # what a file is called is text, not markup
    file = written(
        tmp_path / name, "stretch,nominal_stress_Pa", stretch, softened(stretch, 1.8, 5e4, 0.1)
    )
    page = tmp_path / "page.html"
    command = ["fit", "material", "--law", "neo-hookean", "--mullins", "--report", str(page)]
    done = CliRunner().invoke(app, [*command, "--data", f"uniaxial={file}", "--json"])
    assert done.exit_code == 0, done.output
    text = page.read_text()
    assert "&lt;b&gt;&amp;cycles.csv" in text
    assert "<b>" not in text
    assert hashlib.sha256(file.read_bytes()).hexdigest() in text
    # Every address in the page is data of its own.
    assert re.findall(r'(?:src|href)="([^:"]*):', text) == ["data"]
    assert not re.search(r"<script|<link|url\(|@import", text)
    assert CliRunner().invoke(app, [*command, "--data", f"uniaxial={file}"]).exit_code == 2
