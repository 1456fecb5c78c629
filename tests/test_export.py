"""Material cards, read back by each program's published energy: the stress is the same.

The readers here are written from the programs' manuals and share nothing with the writer.
"""

import json
import pathlib
import re
import runpy
import tomllib

import jax.numpy as jnp
import numpy as np
import pytest
from typer.testing import CliRunner

from fitting.cli.app import app
from fitting.material.cards.card import card, left_out
from fitting.material.cards.settings import CardError, CardSettings
from suas_jax.config import (
    ArrudaBoyceSpec,
    GentSpec,
    LawSpec,
    MooneyRivlinSpec,
    NeoHookeanSpec,
    OgdenSpec,
    YeohSpec,
    scene_from_dict,
)
from suas_jax.config.inelastic import RelaxationSpec, SofteningSpec
from suas_jax.constitutive import ArrudaBoyce, build_law, uniaxial
from suas_jax.constitutive.deformation import LogStretches
from suas_jax.constitutive.relaxation import OgdenRoxburgh

TABLE_1 = OgdenSpec(mu=(6.3e5, 0.012e5, -0.1e5), alpha=(1.3, 5.0, -2.0), convention="mu/alpha")
LAWS: dict[str, LawSpec] = {
    "ogden": TABLE_1,
    # Of the same energy, in the other convention.
    "ogden, 2mu/alpha^2": OgdenSpec(
        mu=(4.095e5, 3e3, 1e4), alpha=(1.3, 5.0, -2.0), convention="2mu/alpha^2"
    ),
    "neo-hookean": NeoHookeanSpec(mu=3e5),
    "mooney-2": MooneyRivlinSpec(C1=2e5, C2=5e4),
    "mooney-3": MooneyRivlinSpec(C1=20.7e6, C2=-4.4e6, C3=77e3),
    "yeoh": YeohSpec(C1=2e5, C2=-1e4, C3=5e2),
}
STRETCH = np.array([0.7, 1.1, 1.5, 2.2])


def nominal(energy: object, stretch: np.ndarray) -> np.ndarray:
    """Uniaxial nominal stress dW(l, l^-1/2, l^-1/2)/dl by central differences."""
    h = 1e-5

    def along(x: np.ndarray) -> np.ndarray:
        return energy(x, x**-0.5, x**-0.5)  # type: ignore[operator]

    return (along(stretch + h) - along(stretch - h)) / (2 * h)


def powers(pairs: list[tuple[float, float]]) -> object:
    """Sum of a_p (l1^b_p + l2^b_p + l3^b_p - 3)."""
    return lambda x, y, z: sum(a * (x**b + y**b + z**b - 3) for a, b in pairs)


def polynomial(values: list[float], degree: int) -> object:
    """C10, C01, C20, C11, C02, ... as Abaqus, CalculiX and ANSYS list them."""

    def energy(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        i1 = x**2 + y**2 + z**2 - 3
        i2 = (x * y) ** 2 + (y * z) ** 2 + (z * x) ** 2 - 3
        terms, k = 0.0, 0
        for total in range(1, degree + 1):
            for j in range(total + 1):
                terms = terms + values[k] * i1 ** (total - j) * i2**j
                k += 1
        return np.asarray(terms)

    return energy


def numbers(text: str) -> list[float]:
    return [float(x) for x in re.split(r"[,\s]+", text.strip()) if x]


def read_abaqus(text: str) -> object:
    head, _, body = text.partition("*HYPERELASTIC, ")[2].partition("\n")
    count, values = int(head.split("N=")[1]), numbers(body)
    if head.startswith("OGDEN"):
        return powers(
            [
                (2 * values[2 * p] / values[2 * p + 1] ** 2, values[2 * p + 1])
                for p in range(count)
            ]
        )
    return polynomial(values, count)


def read_ansys(text: str) -> object:
    kind = re.search(r"TB,HYPER,1,1,(\d+),(\w+)", text)
    assert kind
    values = [
        float(x) for line in re.findall(r"TBDATA,\d+,(.*)", text) for x in line.split(",")
    ]
    if kind[2] == "OGDEN":
        pairs = [(values[2 * p], values[2 * p + 1]) for p in range(int(kind[1]))]
        return powers([(mu / alpha, alpha) for mu, alpha in pairs])
    if kind[2] == "NEO":
        return powers([(0.5 * values[0], 2.0)])
    return polynomial(values, int(kind[1]))


def read_febio(text: str) -> object:
    found = {key: float(value) for key, value in re.findall(r"<(\w+)>([^<]+)</", text)}
    if 'type="Ogden"' in text:
        count = sum(key.startswith("c") for key in found)
        pairs = [(found[f"c{i}"], found[f"m{i}"]) for i in range(1, count + 1)]
        return powers([(c / m**2, m) for c, m in pairs])
    return powers([(found["c1"], 2.0), (found["c2"], -2.0)])


def read_comsol(text: str) -> object:
    found = {
        key: float(value.replace("[Pa]", ""))
        for key, value in (line.split(" ") for line in text.splitlines()[1:])
    }
    if "mu_1" in found:
        pairs = [(found[f"mu_{i}"], found[f"alpha_{i}"]) for i in (1, 2, 3)]
        return powers([(mu / alpha, alpha) for mu, alpha in pairs])
    order = ["C10", "C01", "C20", "C11", "C02", "C30"]
    return polynomial([found.get(key, 0.0) for key in order] + [0.0] * 3, 3)


def read_lsdyna(text: str) -> object:
    lines = [line for line in text.splitlines() if not line.startswith("$")]
    title, name, first, *rows = lines
    assert name == "membrane"
    fields = [first[i : i + 10] for i in range(0, len(first), 10)]
    assert (int(fields[0]), float(fields[1]), int(fields[3])) == (1, 1100.0, 0)
    assert 0.4999 < float(fields[2]) < 0.5
    values = [numbers(row) for row in rows]
    if title == "*MAT_OGDEN_RUBBER_TITLE":
        return powers([(m / a, a) for m, a in zip(*values, strict=True) if a])
    assert title == "*MAT_HYPERELASTIC_RUBBER_TITLE"
    c10, c01, c11, c20, c02, c30 = values[0]
    return polynomial([c10, c01, c20, c11, c02, c30, 0.0, 0.0, 0.0], 3)


READERS = {
    "lsdyna": read_lsdyna,
    "abaqus": read_abaqus,
    "calculix": read_abaqus,
    "ansys": read_ansys,
    "febio": read_febio,
    "comsol": read_comsol,
}


@pytest.mark.parametrize("program", READERS)
@pytest.mark.parametrize("name", LAWS)
def test_stress_survives_the_round_trip(name: str, program: str) -> None:
    law = LAWS[name]
    if program == "febio" and name in ("mooney-3", "yeoh"):
        with pytest.raises(CardError, match="febio is offered for"):
            card(law, program)
        return
    expected = np.asarray(uniaxial(build_law(law), jnp.asarray(STRETCH)).nominal)
    for units, pascal in (("SI", 1.0), ("mm-N-MPa", 1e-6)):
        density = 1100.0 if units == "SI" else 1100e12
        text = card(law, program, CardSettings(units, density=density))
        text = text.replace("[MPa]", "[Pa]")
        text = re.sub(r"\*DENSITY\n.*\n|    <density>.*\n", "", text)
        stress = nominal(READERS[program](text), STRETCH)
        assert np.allclose(stress, pascal * expected, rtol=1e-6)


BULK_MODULUS = 2.1e9


def bulk_of(program: str, text: str, shear_modulus: float) -> float:
    """Bulk modulus of a card, by each program's manual, in the card's unit of stress."""
    if program in ("abaqus", "calculix"):
        kind, _, body = text.partition("*HYPERELASTIC, ")[2].partition("\n")
        values, count = numbers(body), int(kind.split("N=")[1])
        # D1 to DN come last; the volume's energy is (J - 1)^2/D1 if the others are zero.
        assert values[len(values) - count + 1 :] == [0.0] * (count - 1)
        return 2.0 / values[-count]
    if program == "ansys":
        kind = re.search(r"TB,HYPER,1,1,(\d+),", text)
        assert kind
        rows = re.findall(r"TBDATA,\d+,(.*)", text)
        return 2.0 / [float(x) for line in rows for x in line.split(",")][-int(kind[1])]
    if program == "febio":
        return float(re.findall(r"<k>([^<]+)</k>", text)[0])
    if program == "comsol":
        return float(re.findall(r"kappa (\S+)\[", text)[0])
    if program == "felupe":
        return float(re.findall(r"^bulk = (\S+)$", text, re.MULTILINE)[0])
    first = [line for line in text.splitlines() if not line.startswith("$")][2]
    poisson = float(first[20:30])
    return 2.0 * shear_modulus * (1.0 + poisson) / (3.0 * (1.0 - 2.0 * poisson))


@pytest.mark.parametrize("program", [*READERS, "felupe"])
@pytest.mark.parametrize("name", ["ogden", "neo-hookean", "mooney-2"])
def test_the_bulk_modulus_survives_the_round_trip(name: str, program: str) -> None:
    law = LAWS[name]
    modulus = float(build_law(law).shear_modulus)
    for units, pascal in (("SI", 1.0), ("mm-N-MPa", 1e-6)):
        settings = CardSettings(units, density=1100.0, bulk_modulus=BULK_MODULUS)
        found = bulk_of(program, card(law, program, settings), pascal * modulus)
        # LS-DYNA has Poisson's ratio in ten columns.
        tolerance = 1e-4 if program == "lsdyna" else 1e-9
        assert np.isclose(found, pascal * BULK_MODULUS, rtol=tolerance)
    with pytest.raises(CardError, match="--bulk-modulus"):
        CardSettings(bulk_modulus=-1.0)


def test_a_refused_card_stops_no_report(tmp_path: pathlib.Path) -> None:
    data = pathlib.Path(__file__).parent.parent / "configs/data/treloar1944_uniaxial.csv"
    good, bad = tmp_path / "a.inp", tmp_path / "b.feb"
    options = ["--export", f"abaqus={good}", "--export", f"febio={bad}", "--card-name", "skin"]
    options += ["--card-units", "mm-N-MPa", "--density", "1100", "--json"]
    command = ["fit", "material", "--law", "yeoh", "--data", f"uniaxial={data}", *options]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 0
    report = json.loads(result.stdout)
    assert [bool(entry["message"]) for entry in report["cards"]] == [False, True]
    assert any("febio is offered for" in text for text in report["warnings"])
    text = good.read_text()
    assert "NAME=SKIN" in text
    assert "*DENSITY\n1.1e-09\n" in text
    assert not bad.exists()
    result = CliRunner().invoke(app, [*command, "--card-units", "cgs"])
    assert result.exit_code == 2


@pytest.mark.parametrize("name", LAWS)
def test_toml_card_is_a_material_table(name: str) -> None:
    law = LAWS[name]
    table = tomllib.loads(card(law, "toml"))
    skin = pathlib.Path(__file__).parent.parent / "configs" / "skins" / "suas.toml"
    scene = tomllib.loads(skin.read_text()) | table
    scene.pop("electrodes", None)
    read = scene_from_dict(scene | {"load": []}).material
    assert read.model_fields_set - {"law"} == law.model_fields_set
    for key in law.declared():
        assert np.allclose(getattr(read, key), getattr(law, key), rtol=1e-12)


ARRUDA_BOYCE = ArrudaBoyceSpec(mu=3e5, lambda_m=3.0)
GENT = GentSpec(mu=3e5, Jm=60.0)


@pytest.mark.parametrize("program", ["abaqus", "calculix"])
def test_arruda_boyce_is_the_five_term_series_of_the_manual(program: str) -> None:
    text = card(ARRUDA_BOYCE, program)
    mu, limit, _ = numbers(text.partition("ARRUDA-BOYCE\n")[2])
    series = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)

    def energy(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        i1 = x**2 + y**2 + z**2
        parts = [
            c / limit ** (2 * i) * (i1 ** (i + 1) - 3 ** (i + 1)) for i, c in enumerate(series)
        ]
        return mu * np.sum(parts, axis=0)

    expected = np.asarray(uniaxial(ArrudaBoyce(3e5, 3.0), jnp.asarray(STRETCH)).nominal)
    assert np.allclose(nominal(energy, STRETCH), expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("law", "program"),
    [(ARRUDA_BOYCE, "ansys"), (ARRUDA_BOYCE, "febio")]
    + [(GENT, program) for program in ("abaqus", "calculix", "ansys", "febio")],
)
def test_a_program_without_the_law_refuses_it_by_name(law: LawSpec, program: str) -> None:
    with pytest.raises(CardError, match=f"no card for the law {law.law}; {program} is offered"):
        card(law, program)


def test_unknown_program_is_named() -> None:
    with pytest.raises(CardError, match="allowed: abaqus"):
        card(TABLE_1, "nastran")


RELAXING = {
    "relaxation": RelaxationSpec(g=(0.2, 0.15), tau=(0.5, 20.0)),
    "softening": SofteningSpec(r=1.8, m=5e4, beta=0.1),
}


@pytest.mark.parametrize("program", ["abaqus", "ansys", "febio", "lsdyna"])
def test_instantaneous_and_long_term_stress_of_a_card_with_relaxation(program: str) -> None:
    law = TABLE_1.model_copy(update={"relaxation": RELAXING["relaxation"]})
    text = card(law, program, CardSettings(density=1100.0))
    slow = np.asarray(uniaxial(build_law(law), jnp.asarray(STRETCH)).nominal)
    if program == "abaqus":
        assert "MODULI=LONG TERM" in text
        own, _, series = text.partition("*VISCOELASTIC, TIME=PRONY\n")
        g, _, tau = np.array([numbers(line) for line in series.splitlines()]).T
        stress = nominal(read_abaqus(own.replace(", MODULI=LONG TERM", "")), STRETCH)
        long_term = stress
    elif program == "ansys":
        own, _, series = text.partition("TB,PRONY")
        g, tau = np.array(numbers(series.partition("TBDATA,1,")[2])).reshape(-1, 2).T
        long_term = nominal(read_ansys(own), STRETCH) * (1.0 - g.sum())
    elif program == "febio":
        found = dict(re.findall(r"<([gt]\d)>([^<]+)</", text))
        shares = np.array([float(found["g1"]), float(found["g2"])])
        g, tau = shares / (1.0 + shares.sum()), [float(found["t1"]), float(found["t2"])]
        outer, inner = text.split("<elastic")
        assert all("<density>1100</density>" in part for part in (outer, inner))
        text = re.sub(r"<density>.*?</density>", "", text)
        long_term = nominal(
            read_febio(re.sub(r"<g\d>.*?</g\d>|<t\d>.*?</t\d>", "", text)), STRETCH
        )
    else:
        *lines, first, second = text.splitlines()
        moduli, rates = np.array([numbers(first), numbers(second)]).T
        long_term = nominal(read_lsdyna("\n".join(lines)), STRETCH)
        g, tau = moduli / (0.4225e6 / 0.65), 1.0 / rates
    np.testing.assert_allclose(long_term, slow, rtol=1e-6)
    np.testing.assert_allclose(g, [0.2, 0.15], rtol=1e-6)
    np.testing.assert_allclose(tau, [0.5, 20.0], rtol=1e-6)


def test_softening_in_cards_is_in_their_units() -> None:
    law = TABLE_1.model_copy(update=RELAXING)
    settings = CardSettings("mm-N-MPa", density=1100.0)
    for program, mark in (("abaqus", "*MULLINS EFFECT\n"), ("ansys", "PSE2\nTBDATA,1,")):
        values = numbers(card(law, program, settings).partition(mark)[2])
        np.testing.assert_allclose(values, [1.8, 0.05, 0.1])
    read = scene_table(card(law, "toml", settings))
    assert read.softening == law.softening
    assert read.relaxation == law.relaxation
    for program in ("calculix", "felupe", "lsdyna", "febio"):
        assert left_out(law, program)
        assert "without" in card(law, program, settings)


def scene_table(text: str) -> LawSpec:
    """The material of a [material] table."""
    skin = pathlib.Path(__file__).parent.parent / "configs" / "skins" / "suas.toml"
    return scene_from_dict(tomllib.loads(skin.read_text()) | tomllib.loads(text)).material


FELUPE_LAWS: dict[str, LawSpec] = {**LAWS, "arruda-boyce": ARRUDA_BOYCE}


@pytest.mark.parametrize("name", FELUPE_LAWS)
def test_felupe_gives_the_fitted_stress_back(name: str, tmp_path: pathlib.Path) -> None:
    pytest.importorskip("felupe", reason="FElupe is not installed")
    pytest.importorskip("tensortrax", reason="tensortrax is not installed")
    file = tmp_path / "card.py"
    softening = RELAXING["softening"]
    elastic = FELUPE_LAWS[name]
    for law in (elastic, elastic.model_copy(update={"softening": softening})):
        file.write_text(card(law, "felupe"))
        umat = runpy.run_path(str(file))["umat"]
        expected = np.asarray(uniaxial(build_law(law), jnp.asarray(STRETCH)).nominal)
        F = np.zeros((3, 3, 1, len(STRETCH)))
        F[0, 0, 0], F[1, 1, 0], F[2, 2, 0] = STRETCH, STRETCH**-0.5, STRETCH**-0.5
        state = np.zeros((1, 1, len(STRETCH)))
        factor = 1.0
        if law.softening is not None:
            energy = build_law(law).energy(
                LogStretches(*(jnp.log(F[i, i, 0]) for i in range(2)))
            )
            state = state + 2.0 * np.max(np.asarray(energy))
            factor = OgdenRoxburgh(softening.r, softening.m, softening.beta).factor(
                energy, jnp.asarray(state[0, 0])
            )
        stress = umat.gradient([F, state])[0]
        free = stress[2, 2, 0] * F[2, 2, 0] / F[0, 0, 0]
        np.testing.assert_allclose(stress[0, 0, 0] - free, factor * expected, rtol=1e-6)
