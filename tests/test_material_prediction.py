"""The band of modes that were not measured holds their readings, whatever law is named."""

import dataclasses
import pathlib

import numpy as np
import pytest
from rubbers import gent_gent, made, published, test_of, unlisted

from fitting.material.calibration import calibrate
from fitting.material.experiments.measurements import PATHS
from fitting.material.fit.band import Band
from fitting.material.fit.comparison import compare_laws
from fitting.material.fit.fit import fit_material
from fitting.material.fit.result import MaterialFit
from fitting.material.report.plots import plot_material
from fitting.material.report.summary import material_report


def fitted(
    curves: dict[str, np.ndarray],
    folder: pathlib.Path,
    law: str = "yeoh",
    terms: int | None = None,
    modes: tuple[str, ...] = ("uniaxial",),
) -> MaterialFit:
    sets = [test_of(curves, mode, folder) for mode in modes]
    return fit_material(sets, law, terms, starts=16, doubt=False)


@pytest.fixture(scope="module")
def treloar(tmp_path_factory: pytest.TempPathFactory) -> MaterialFit:
    return fitted(published("treloar1944"), tmp_path_factory.mktemp("treloar"))


@pytest.mark.parametrize(
    ("name", "least"), [("treloar1944", 0.85), ("kawabata1981", 1.0), ("meunier2008", 0.65)]
)
def test_bands_from_tension_hold_published_readings(
    name: str, least: float, tmp_path: pathlib.Path
) -> None:
    """Meunier's shear starts 1.5 to 1.9 times as stiff as the same silicone in tension."""
    curves = published(name)
    fit = fitted(curves, tmp_path)
    for mode in ("equibiaxial", "pure_shear"):
        band = fit.predict(mode, curves[mode][:, 0])
        within = np.abs(curves[mode][:, 1] - band.nominal) <= band.half_width
        assert within.mean() >= least
        assert np.median(band.half_width / band.nominal) < 0.3


def test_bands_hold_rubbers_that_no_law_of_the_list_is(tmp_path: pathlib.Path) -> None:
    rng = np.random.default_rng(3)
    shares, widths = [], []
    for _ in range(4):
        curves = made(unlisted(rng), rng.uniform(1.5, 3.0), rng, 0.01)
        fit = fitted(curves, tmp_path)
        for mode in ("equibiaxial", "pure_shear"):
            band = fit.predict(mode, curves[mode][:, 0])
            shares.append(np.mean(np.abs(curves[mode][:, 1] - band.nominal) <= band.half_width))
            widths.append(np.median(band.half_width / band.nominal))
    assert np.mean(shares) > 0.9
    assert np.median(widths) < 0.2


def test_the_band_is_the_datas_not_the_laws(
    treloar: MaterialFit, tmp_path: pathlib.Path
) -> None:
    """Ogden's three terms follow tension and are gigapascals off beside it."""
    stretch = np.linspace(1.2, 4.0, 8)
    ogden = fitted(published("treloar1944"), tmp_path, "ogden", 3)
    one, other = (fit.predict("equibiaxial", stretch) for fit in (treloar, ogden))
    assert other.law[-1] > 1e3 * one.law[-1]
    assert np.all(np.abs(other.nominal - one.nominal) < np.minimum(*_halves(one, other)))
    assert np.max(other.half_width / other.nominal) < 0.5


def _halves(*bands: Band) -> tuple[np.ndarray, ...]:
    return tuple(band.half_width for band in bands)


def test_small_deformations_are_known_in_every_mode(tmp_path: pathlib.Path) -> None:
    curves = made(gent_gent(0.2, 40.0), 2.0, np.random.default_rng(1), 0.01)
    fit = fitted(curves, tmp_path)
    for mode, factor in (("uniaxial", 3.0), ("equibiaxial", 6.0), ("pure_shear", 4.0)):
        band = fit.predict(mode, np.array([0.99, 1.01]))
        exact = factor * 4e5 * np.log([0.99, 1.01])
        assert np.all(np.abs(band.nominal - exact) < band.half_width + 0.02 * np.abs(exact))
        assert np.all(band.half_width < 0.1 * np.abs(exact))


def test_a_second_mode_narrows_the_third(tmp_path: pathlib.Path) -> None:
    curves = made(gent_gent(0.3, 40.0), 2.5, np.random.default_rng(2), 0.01)
    alone = fitted(curves, tmp_path)
    both = fitted(curves, tmp_path, modes=("uniaxial", "equibiaxial"))
    stretch = np.linspace(1.5, 2.3, 4)
    wide, narrow = (fit.predict("pure_shear", stretch) for fit in (alone, both))
    assert np.all(narrow.half_width < 0.8 * wide.half_width)
    true = np.interp(stretch, *curves["pure_shear"].T)
    assert np.all(np.abs(narrow.nominal - true) < narrow.half_width)


def test_report_text_and_figure_show_the_same_band(treloar: MaterialFit) -> None:
    fit = dataclasses.replace(treloar, up_to=1.2)
    told = material_report(fit)["prediction"]["modes"]["equibiaxial"]
    assert told["stretch"][0] == pytest.approx(1 / 1.2)
    assert told["stretch"][-1] == pytest.approx(1.2)
    band = fit.predict("equibiaxial", np.array([1.2]))
    assert told["high95_Pa"][-1] == pytest.approx(float((band.nominal + band.half_width)[0]))
    axes = next(
        ax for ax in plot_material(fit).axes if ax.get_title().startswith("equibiaxial")
    )
    drawn = axes.collections[0].get_paths()[0].vertices
    at_end = drawn[np.isclose(drawn[:, 0], 1.2), 1]
    assert at_end.max() == pytest.approx(told["high95_Pa"][-1] / 1e6)
    assert at_end.min() == pytest.approx(told["low95_Pa"][-1] / 1e6)


def test_a_law_that_leaves_the_band_is_not_chosen(tmp_path: pathlib.Path) -> None:
    data = test_of(published("treloar1944"), "uniaxial", tmp_path)
    laws = (("ogden", 3), ("yeoh", 3))
    comparison = compare_laws([data], laws, starts=16)
    assert [fit.family.title for fit in comparison.fits] == ["ogden-3", "yeoh"]
    assert comparison.best.family.title == "yeoh"
    reasons = " ".join(comparison.table[0]["rejected"])
    assert "equibiaxial, not measured" in reasons
    assert "times the middle of the 95 % band" in reasons


def test_up_to_is_a_stretch(tmp_path: pathlib.Path) -> None:
    data = test_of(published("kawabata1981"), "uniaxial", tmp_path)
    with pytest.raises(ValueError, match="greater than 1 is expected"):
        calibrate([data], "neo-hookean", up_to=0.9)
    found = calibrate([data], "neo-hookean", up_to=1.1)
    assert set(found.report["prediction"]["modes"]) == set(PATHS)
    assert found.report["prediction"]["modes"]["uniaxial"]["stretch"][-1] == pytest.approx(1.1)
