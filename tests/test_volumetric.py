"""Bulk moduli from volumetric tests: closed form, units, intervals, and use in cards."""

import json
import pathlib

import jax
import numpy as np
import pytest
from typer.testing import CliRunner

from fitting.cli.app import app
from fitting.material.data.errors import DataError
from fitting.material.experiments.datasets import load_dataset
from fitting.material.experiments.volumetric import VolumetricTest
from fitting.material.fit.bulk_modulus import ENERGY, OTHER_ENERGY, fit_bulk_modulus

K = 2.1e9
RATIO = np.linspace(1.0, 0.95, 41)[1:]
PRESSURE = K * (1.0 - RATIO)
TENSION = pathlib.Path(__file__).parent.parent / "configs/data/treloar1944_uniaxial.csv"


def written(file: pathlib.Path, head: str, *columns: np.ndarray, comments: str = "") -> str:
    pairs = zip(*(column.tolist() for column in columns), strict=True)
    rows = "".join(",".join(map(repr, row)) + "\n" for row in pairs)
    file.write_text(f"{comments}{head}\n{rows}")
    return str(file)


def loaded(file: str) -> VolumetricTest:
    test = load_dataset("volumetric", file)
    assert isinstance(test, VolumetricTest)
    return test


def test_pressure_is_the_derivative_of_the_energy() -> None:
    slope = jax.vmap(jax.grad(lambda J: -0.5 * K * (J - 1.0) ** 2))(RATIO)
    np.testing.assert_allclose(slope, PRESSURE, rtol=1e-12)


FORMS = {
    "volume_ratio,pressure_MPa": (RATIO, PRESSURE / 1e6),
    "J,Pressure [GPa]": (RATIO, PRESSURE / 1e9),
    "volumetric_strain_%,pressure_bar": (100 * (RATIO - 1.0), PRESSURE / 1e5),
    # Compression that a file counts as positive strain.
    "Volumetric strain [%],Pressure [psi]": (100 * (1.0 - RATIO), PRESSURE / 6894.757293168361),
    "volumetric_compression,pressure_kPa": (1.0 - RATIO, PRESSURE / 1e3),
    "relative_volume,hydrostatic_pressure_MPa": (RATIO, PRESSURE / 1e6),
    "Volumenstauchung [%],Druck [bar]": (100 * (1.0 - RATIO), PRESSURE / 1e5),
    # A piston of 20 mm on a specimen of 10 mm; compression is negative, or positive.
    "displacement_mm,force_kN": (10 * (RATIO - 1.0), -PRESSURE * np.pi * 1e-4 / 1e3),
    "Displacement (mm),Force (N)": (10 * (1.0 - RATIO), PRESSURE * np.pi * 1e-4),
    "strain,nominal_stress_MPa": (RATIO - 1.0, -PRESSURE / 1e6),
}


@pytest.mark.parametrize("head", FORMS)
def test_exact_data_recover_the_bulk_modulus(head: str, tmp_path: pathlib.Path) -> None:
    comments = "# diameter: 20 mm\n# length: 10 mm\n"
    file = written(tmp_path / "v.csv", head, *FORMS[head], comments=comments)
    found = fit_bulk_modulus([loaded(file)])
    assert np.isclose(found.value, K, rtol=1e-9)
    assert not found.misfit.significant


@pytest.mark.parametrize("kind", ["relative", "absolute"])
def test_intervals_cover_the_truth(kind: str, tmp_path: pathlib.Path) -> None:
    rng = np.random.default_rng(7)
    exact = loaded(written(tmp_path / "v.csv", "J,pressure_Pa", RATIO, PRESSURE))
    size = 0.02 * PRESSURE if kind == "relative" else np.full(len(RATIO), 0.01 * PRESSURE[-1])
    inside, misfits = np.zeros(2), 0
    for _ in range(200):
        noisy = exact.__class__(
            **{**vars(exact), "value": PRESSURE + size * rng.normal(size=len(RATIO))}
        )
        found = fit_bulk_modulus([noisy], kind)
        ends = np.array([found.interval(level) for level in (0.6827, 0.95)])
        inside += (ends[:, 0] < K) & (ends[:, 1] > K)
        misfits += found.misfit.significant
    assert 0.60 < inside[0] / 200 < 0.76
    assert 0.90 < inside[1] / 200 < 0.99
    assert misfits < 10


def test_noise_of_another_kind_than_assumed_is_allowed_for(tmp_path: pathlib.Path) -> None:
    rng = np.random.default_rng(3)
    exact = loaded(written(tmp_path / "v.csv", "J,pressure_Pa", RATIO, PRESSURE))
    inside = 0
    for _ in range(100):
        value = PRESSURE + 0.01 * PRESSURE[-1] * rng.normal(size=len(RATIO))
        found = fit_bulk_modulus([exact.__class__(**{**vars(exact), "value": value})])
        low, high = found.interval(0.95)
        inside += low < K < high
    assert inside >= 88


def test_another_energy_is_a_misfit_that_is_named(tmp_path: pathlib.Path) -> None:
    rng = np.random.default_rng(5)
    pressure = -K * np.log(RATIO) / RATIO * (1.0 + 0.002 * rng.normal(size=len(RATIO)))
    found = fit_bulk_modulus(
        [loaded(written(tmp_path / "v.csv", "J,p_MPa", RATIO, pressure / 1e6))]
    )
    assert found.misfit.significant
    (text,) = [text for text in found.remarks if OTHER_ENERGY in text]
    assert ENERGY in text
    assert abs(float(text.rpartition("K = ")[2].split()[0]) - 2100.0) < 10.0


def test_what_is_wrong_is_named(tmp_path: pathlib.Path) -> None:
    file = written(tmp_path / "a.csv", "volume_ratio,pressure_MPa", -RATIO, PRESSURE / 1e6)
    with pytest.raises(DataError, match="is impossible: it must be greater"):
        loaded(file)
    file = written(tmp_path / "b.csv", "time_s,pressure_MPa", RATIO, PRESSURE / 1e6)
    with pytest.raises(DataError, match="volumetric_strain_%"):
        loaded(file)
    file = written(tmp_path / "c.csv", "volume_ratio,pressure_kPa", RATIO, PRESSURE / 1e6)
    assert "another unit" in loaded(file).warnings[-1]


def test_beside_a_law_it_reaches_report_page_and_cards(tmp_path: pathlib.Path) -> None:
    file = written(tmp_path / "v.csv", "volume_ratio,pressure_MPa", RATIO, PRESSURE / 1e6)
    card, page, figure = (tmp_path / name for name in ("a.inp", "a.html", "a.png"))
    command = ["fit", "material", "--law", "neo-hookean", "--starts", "4", "--json"]
    command += ["--data", f"volumetric={file}"]
    options = ["--data", f"uniaxial={TENSION}", "--export", f"abaqus={card}"]
    options += ["--card-units", "mm-N-MPa", "--report", str(page), "--plot", str(figure)]
    result = CliRunner().invoke(app, command + options)
    assert result.exit_code == 0, result.output
    report = json.loads(result.stdout)
    found = report["bulk_modulus_Pa"]
    assert found["low95"] <= K * (1 + 1e-9)
    assert np.isclose(found["value"], K)
    assert report["modes"]["volumetric"]["n"] == len(RATIO)
    assert report["covariance_order"] == ["mu"]
    poisson = report["volumetric"]["poisson_ratio"]
    g = report["shear_modulus_Pa"]["value"]
    assert np.isclose(2.0 * g * (1.0 + poisson) / (3.0 * (1.0 - 2.0 * poisson)), K)
    values = card.read_text().split("\n")[-2].split(", ")
    assert np.isclose(float(values[-1]), 2.0 / (K / 1e6))
    assert "bulk modulus K" in page.read_text()
    assert figure.exists()
    alone = CliRunner().invoke(app, [*command, "--report", str(page), "--overwrite"])
    assert alone.exit_code == 0, alone.output
    assert json.loads(alone.stdout)["law"] is None
    refused = CliRunner().invoke(app, [*command, "--export", f"abaqus={tmp_path / 'b.inp'}"])
    assert refused.exit_code == 2
