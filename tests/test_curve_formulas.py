"""What the curve of a material's test says by itself: cycles, breaks, units, zeros."""

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fitting.material import calibration
from fitting.material.experiments.artefacts import curve_suspects
from fitting.material.experiments.data_checks import (
    _jumps,
    _unit_doubts,
    branches,
    contradictions,
    refuse_without_information,
    warnings_of,
)
from fitting.material.experiments.history import HistoryTest
from fitting.material.experiments.indentation_curve import _is_smooth, nodes_of
from fitting.material.experiments.measurements import Origin, joined, mode_named
from fitting.material.experiments.preview import _column, _test
from fitting.material.experiments.scatter import departures
from fitting.material.experiments.selection import (
    _failure,
    _turning_points,
    before_break,
    broken,
    half_cycles,
    in_cycle,
    loadings,
    spiked,
    thinned,
    without_spikes,
)
from fitting.material.experiments.volumetric import VolumetricTest
from fitting.material.fit.bulk_modulus import _Fitted
from fitting.material.fit.comparison import Comparison
from tests.stand_ins import neo_hookean, tension

OUT, BACK = np.linspace(1.0, 2.0, 11), np.linspace(1.9, 1.1, 9)


def test_a_series_turns_where_it_comes_back_by_more_than_noise() -> None:
    h = np.array([0.0, 1.0, 2.0, 1.96, 3.0, 1.0, 0.0, 2.0])
    assert _turning_points(h, 0.05) == [0, 4, 6, 7]
    assert _turning_points(h, 0.03) == [0, 2, 3, 4, 6, 7]
    assert _turning_points(-h, 0.05) == [0, 4, 6, 7]
    assert _turning_points(np.array([0.0, 1.0, 2.0]), 0.05) == [0, 2]
    found = half_cycles(np.concatenate([OUT, BACK, OUT]))
    assert [half.outward for half in found] == [True, False, True]
    assert [len(half.rows) for half in found] == [11, 10, 10]
    assert found[0].rows.tolist() == list(range(11))
    shuffled = np.random.default_rng(0).permutation(60) * 1.0
    assert len(half_cycles(shuffled)) == 1
    assert len(half_cycles(np.array([0.0, 1.0, 0.0, 1.0, 0.0]))) == 1  # too short


def test_loadings_are_chosen_by_their_number() -> None:
    stretch = np.concatenate([OUT, BACK, OUT, BACK, 0.9 + OUT[:9]])
    test = tension(stretch)
    cycles = loadings(test)
    assert [len(rows) for (rows) in cycles[0]] == [11, 10 + 0, 9]
    for which, rows in (("first", cycles[0][0]), ("2", cycles[0][1]), ("last", cycles[0][2])):
        np.testing.assert_array_equal(in_cycle(test, which).line, rows)
    assert in_cycle(test, "all") is test
    for wrong, text in (("4", "has 3 loadings"), ("0", "allowed"), ("best", "allowed")):
        with pytest.raises(ValueError, match=text):
            in_cycle(test, wrong)


def test_a_specimen_has_failed_where_its_stress_falls_and_stays_low() -> None:
    size = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 3.9, 3.0, 1.0, 0.5])
    assert _failure(size) == 6  # 3.9 of 4 is still whole, 3 is not
    assert _failure(np.append(size, 3.0)) is None  # it came back
    assert _failure(np.array([0.1, 0.01, 1.0, 2.0])) is None
    stretch = np.linspace(1.0, 1.8, 9)
    test = tension(stretch, 1e6 * size)
    assert np.flatnonzero(broken(test)).tolist() == [6, 7, 8]
    from_its_end = test.select(np.arange(9)[::-1])
    assert np.flatnonzero(broken(from_its_end)).tolist() == [0, 1, 2]
    assert before_break(test).size == 6
    whole = tension(stretch)
    assert before_break(whole) is whole
    (suspect,) = curve_suspects(test)
    assert suspect.kind == "break"
    assert suspect.size == pytest.approx(stretch[6])
    assert "3 readings from line 6 on" in suspect.evidence
    assert suspect.text.endswith("mend it with --cut-break")


def noisy(n: int = 200, deviation: float = 1e3) -> Any:
    stretch = np.linspace(1.0, 3.0, n)
    return stretch, neo_hookean(stretch) + deviation * np.random.default_rng(3).normal(size=n)


def test_neighbours_predict_a_cubic_and_show_noise_as_it_is() -> None:
    x = np.cumsum(np.random.default_rng(0).uniform(0.5, 1.5, 30))
    departed = departures(x, 2.0 + x - 3.0 * x**2 + 0.5 * x**3)[0]
    np.testing.assert_allclose(departed[np.isfinite(departed)], 0.0, atol=1e-7)
    even = departures(np.arange(9.0), np.zeros(9))[1]
    assert even[4] == pytest.approx(np.sqrt(1 + 34 / 36))  # weights -1/6, 2/3, 2/3, -1/6
    assert even[0] == pytest.approx(np.sqrt(1 + 16 + 36 + 16 + 1))  # 4, -6, 4, -1
    turned = departures(np.array([0.0, 1, 2, 3, 2, 1, 0, -1, -2, -3]), np.zeros(10))[0]
    assert np.flatnonzero(np.isfinite(turned)).tolist() == [5, 6, 7, 8, 9]
    assert np.isnan(departures(x[:4], x[:4])[0]).all()


@pytest.mark.parametrize("deviation", [1e2, 1e3, 1e4])
def test_the_floor_of_relative_residuals_follows_the_scatter_near_rest(
    deviation: float,
) -> None:
    test = tension(*noisy(4000, deviation))
    least = 0.01 * np.median(np.abs(test.value))
    assert test.least_floor == pytest.approx(least)
    assert test.floor == pytest.approx(max(50 * deviation, least), rel=0.1)
    few = tension(*noisy(30, deviation))  # the smallest quarter are too few
    assert few.floor == few.least_floor
    shares = neo_hookean(test.coordinate) * np.random.default_rng(0).choice([0.99, 1.01], 4000)
    assert tension(test.coordinate, shares).floor < 0.4 * np.median(shares)


@pytest.mark.parametrize("places", [[1], [5], [100], [198], [3, 90]])
def test_a_spike_is_named_and_left_out(places: list[int]) -> None:
    stretch, value = noisy()
    value[places] += 5e4 + 0.3 * value[places]
    test = tension(stretch, value)
    assert np.flatnonzero(spiked(test)).tolist() == places
    assert without_spikes(test).line.tolist() == np.delete(np.arange(200), places).tolist()
    (suspect,) = curve_suspects(test)
    assert (suspect.kind, suspect.size) == ("spike", len(places))
    assert f"on line {', '.join(map(str, places))}" in suspect.text
    assert suspect.text.endswith("mend it with --cut-spikes")


def test_steps_kinks_digits_and_cycles_are_no_spikes() -> None:
    stretch, value = noisy()
    back = np.concatenate([stretch, stretch[-2::-1]])
    curves = {
        "noise": (stretch, value),
        "step": (stretch, value + 5e4 * (stretch > 2.0)),
        "break": (stretch, np.where(stretch < 2.9, value, 1e4)),
        "slack": (stretch, np.where(stretch < 1.2, 10.0 * np.arange(200) % 7.0, value)),
        "digits": (stretch, np.round(value / 2e4) * 2e4),
        "cycle": (back, np.concatenate([value, 0.8 * value[-2::-1]])),
        "few": (stretch[::6], value[::6] + 5e4 * (np.arange(34) == 3)),
    }
    for name, curve in curves.items():
        test = tension(*curve)
        assert not spiked(test).any(), name
        assert without_spikes(test) is test


def test_the_end_of_slack_is_no_spike() -> None:
    stretch = np.linspace(1.0, 3.0, 300)
    slack = neo_hookean(np.maximum(stretch - 0.1, 1.0))
    for seed in range(20):  # of which noise lets some stand out
        noise = 150.0 * np.random.default_rng(seed).normal(size=300)
        assert not spiked(tension(stretch, slack + noise)).any()


def test_unloading_lies_lower_by_its_loss() -> None:
    stretch = np.concatenate([OUT, BACK])
    value = neo_hookean(stretch) * np.where(np.arange(20) < 11, 1.0, 0.7)
    test = tension(stretch, value)
    found = branches(test)
    assert np.flatnonzero(found.unloading).tolist() == list(range(11, 20))
    assert found.loss == pytest.approx(0.3, rel=1e-6)
    (text,) = warnings_of(test)
    assert "9 readings (lines 11 to 19) are an unloading branch, 30 % lower" in text
    assert not branches(tension(OUT)).unloading.any()


def test_a_second_loading_that_is_softer_is_preconditioning() -> None:
    stretch = np.concatenate([OUT, BACK, OUT])
    for softer, kinds in ((0.10, ["preconditioning"]), (0.01, [])):
        value = neo_hookean(stretch) * np.where(np.arange(31) < 20, 1.0, 1 - softer)
        found = [s.kind for s in curve_suspects(tension(stretch, value))]
        assert found == kinds


@pytest.mark.parametrize(
    ("stretch", "modulus", "words"),
    [
        (2.5, 9.7e6, "kgf/cm2 labelled MPa"),  # 60.6 MPa at the longest stretch
        (2.5, 2.9e6, None),
        (2.1, 3.1e6, "does not usually stretch to 2.1"),
        (1.9, 3.1e6, None),
        (2.0, 99.0, "softer than any rubber"),
        (2.0, 101.0, None),
    ],
)
def test_units_are_doubted_where_rubber_is_too_stiff_long_or_soft(
    stretch: float, modulus: float, words: str | None
) -> None:
    x = np.linspace(1.0, stretch, 30)
    test = tension(x, neo_hookean(x) * modulus / 3e5)
    assert test.modulus == pytest.approx(modulus, rel=1e-6)
    found = _unit_doubts(test)
    assert len(found) == (words is not None)
    if words:
        assert words in found[0]


def test_a_jump_of_the_stiffness_by_six_is_two_units() -> None:
    x = np.linspace(1.1, 2.0, 10)
    for factor, doubts in ((5.9, 0), (6.1, 1)):
        value = neo_hookean(x) * np.where(np.arange(10) < 6, 1.0, factor)
        found = _jumps(tension(x, value))
        assert len(found) == doubts
    assert "from line 5 to line 6 the stiffness changes by a factor of 6.1;" in found[0]


def test_files_three_times_as_stiff_contradict_each_other() -> None:
    x = np.linspace(1.0, 2.0, 20)

    def named(file: str, factor: float) -> Any:
        return dataclasses.replace(tension(x, factor * neo_hookean(x)), file=file)

    assert contradictions([named("a", 1.0), named("b", 2.9)]) == []
    (text,) = contradictions([named("a", 1.0), named("b", 3.1)])
    assert text.startswith("b: the unit is doubtful: its initial stiffness is 3.1 times above")
    (text,) = contradictions([named("a", 1.0), named("b", 1.1), named("c", 0.1)])
    assert text.startswith("c: the unit is doubtful: its initial stiffness is 10 times below")
    assert "kgf/cm2 labelled MPa makes a factor of 10.2" in text


def test_tests_that_say_nothing_are_refused() -> None:
    with pytest.raises(ValueError, match="every reading is at rest"):
        refuse_without_information(tension([1.0, 1.0], [0.0, 1.0]))
    with pytest.raises(ValueError, match="every reading is zero"):
        refuse_without_information(tension([1.0, 2.0], [5.0, 0.0]))
    refuse_without_information(tension([1.0, 2.0]))


def test_signs_opposite_to_the_strain_are_named() -> None:
    x = np.linspace(1.0, 2.0, 9)
    assert "sign opposite to their strain" in warnings_of(tension(x, -neo_hookean(x)))[0]
    dropped = tension(x, dropped={"no number": 2, "below zero": 1})
    assert warnings_of(dropped) == ["a.csv: rows left out: 2 (no number), 1 (below zero)"]


def test_compression_listed_as_positive_is_named() -> None:
    strain = np.linspace(0.0, 0.4, 20)
    listed = tension(1 + strain, -neo_hookean(1 - strain))
    (text,) = warnings_of(listed)
    assert "reads as compression" in text
    assert "compressive strain=NAME" in text
    # An offset of the force makes no compression of a tensile curve, nor does slack.
    off = tension(1 + strain, neo_hookean(1 + strain) - 2e4)
    slack = tension(1 + strain, neo_hookean(np.maximum(1 + strain - 0.04, 1.0)))
    for sound in (tension(1 + strain), tension(1 - strain), tension(1 + 5 * strain), off):
        assert warnings_of(sound) == []
    assert "reads as compression" not in " ".join(warnings_of(slack))
    # Of a button that is squeezed by a little the curve says less than the sizes.
    little, sizes = 1 + strain / 8, {"length": 12.5e-3, "area": 6.6e-4}
    assert warnings_of(tension(little, -neo_hookean(1 - strain / 8))) == []
    button = tension(little, origin=Origin("displacement", "mm", "", **sizes))
    assert "reads as compression" in warnings_of(button)[0]


def test_strains_that_would_stretch_a_specimen_too_far_are_in_percent() -> None:
    for longest, kinds in ((19.9, []), (20.1, ["percent"])):
        x = np.linspace(1.0, longest, 12)
        found = [s.kind for s in curve_suspects(tension(x))]
        assert found == kinds
    stated = tension(x, origin=Origin("strain", "strain_%", "%"))
    assert curve_suspects(stated) == []


@pytest.mark.parametrize("offset", [1e4, -1e4])
def test_a_curve_that_misses_zero_has_another_zero(offset: float) -> None:
    x = np.linspace(1.02, 1.5, 40)
    found = curve_suspects(tension(x, neo_hookean(x) + offset))
    assert {suspect.kind for suspect in found} == {"slack", "force offset"}
    assert curve_suspects(tension(x)) == []


def test_thinned_curves_keep_weights_and_means() -> None:
    x = np.linspace(1.0, 2.0, 400)
    test = tension(x, sigma=np.full(400, 3.0))
    few = thinned(test, 100)
    assert few.size == 50
    assert few.weight.sum() == 400.0
    np.testing.assert_allclose(few.sigma, 3.0)
    for name in ("value", "coordinate"):
        total = (few.weight * getattr(few, name)).sum()
        assert total == pytest.approx(getattr(test, name).sum(), rel=1e-12)
    assert few.line[0] == 0
    assert thinned(test, 0) is thinned(test, 400) is test
    steps = np.diff(np.log(few.coordinate))
    np.testing.assert_allclose(steps, np.log(2) / 50, rtol=0.3)


def test_series_of_one_file_are_joined() -> None:
    a, b = tension([1.0, 2.0], dropped={"x": 1}), tension([3.0], dropped={"x": 2, "y": 1})
    b = dataclasses.replace(b, file="b.csv", warnings=("w",))
    both = joined([a, dataclasses.replace(a, warnings=("w",)), b])
    assert both.coordinate.tolist() == [1.0, 2.0, 1.0, 2.0, 3.0]
    assert both.factors.shape == (4, 5)
    assert both.dropped == {"x": 4, "y": 1}
    assert both.warnings == ("w",)
    assert both.file == "a.csv"
    kept = both.select(both.coordinate > 1.5)
    assert kept.factors.shape == (4, 3)
    assert mode_named("planar") == "pure_shear"
    with pytest.raises(ValueError, match='did you mean "uniaxial"'):
        mode_named("uniaxal")


def test_preview_counts_numbers_and_readings() -> None:
    table: Any = SimpleNamespace(
        names=["strain_%", "what"],
        cells=np.array([[1.0, np.nan], [3.0, np.nan], [np.nan, np.nan]]),
        file="a.csv",
    )
    entry = _column(table, 0)
    assert (entry["number"], entry["numbers"], entry["missing"]) == (1, 2, 1)
    assert (entry["min"], entry["max"], entry["quantity"]) == (1.0, 3.0, "strain")
    empty = _column(table, 1)
    assert (empty["min"], empty["max"], empty["quantity"]) == (None, None, None)
    test = tension(np.concatenate([OUT, BACK, OUT]))
    report = _test(test)
    (specimen,) = report["specimens"]
    assert (specimen["loadings"], specimen["first_line"], specimen["last_line"]) == (2, 0, 30)
    assert (report["abscissa_min"], report["abscissa_max"]) == (1.0, 2.0)
    assert report["shear_modulus_Pa"] == pytest.approx(3e5, rel=1e-9)
    assert report["stress_max_Pa"] == pytest.approx(float(neo_hookean(np.array(2.0))))


def test_a_logarithmic_energy_has_the_pressure_of_its_derivative() -> None:
    """-K ln(J) / J, the derivative of K/2 ln(J)^2."""
    ratio = np.linspace(0.8, 0.99, 20)
    value = -2e9 * np.log(ratio) / ratio
    test = tension(ratio, value, kind=VolumetricTest, mode="volumetric", measure="pressure")
    found = _Fitted.of([test], "relative", logarithmic=True)
    assert found.value == pytest.approx(2e9, rel=1e-9)
    assert found.square < 1e-15
    assert _Fitted.of([test], "relative").square > 1e-3


def test_the_best_law_is_stable_converged_determined_and_of_least_aicc(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fit(title: str, times: float = 1.0, **changes: Any) -> Any:
        fields: dict[str, Any] = {
            "family": SimpleNamespace(title=title),
            "status": "converged",
            "stress": lambda stretches: (times * middle, None),
            "uncertainty": SimpleNamespace(spare=0),
            "instabilities": lambda margin: [],
        }
        return SimpleNamespace(**{**fields, **changes})

    # One mode was not measured; its 95 % band is 5 % wide on either side.
    middle = np.array([1.0, 2.0])
    band = {"equibiaxial": (np.array([1.1, 1.2]), middle, 0.05 * middle)}
    monkeypatch.setattr(Comparison, "_bands", band)
    good, second = fit("good"), fit("second", times=1.04)
    strange, stranger = fit("strange", times=1.1), fit("stranger", times=0.5)
    unstable = fit("unstable", instabilities=lambda margin: ["shear"] if margin == 0.1 else [])
    lost = fit("lost", status="not_converged")
    open_ = fit("open", uncertainty=SimpleNamespace(spare=2))
    every = (unstable, lost, open_, good, second)
    found = Comparison(every, {})
    assert found.best is good
    assert Comparison(every, {}, {"good": "too far"}).best is second
    assert Comparison((unstable, lost, open_), {}).best is open_
    assert Comparison((unstable, lost), {}).best is lost
    assert found.against(unstable) == ["unstable: shear"]
    assert found.against(lost) == ["no start converged"]
    assert found.against(open_) == ["2 combinations of constants not determined"]
    assert found.against(good) == []
    assert found.against(second) == []
    assert Comparison((stranger, strange, good), {}).best is good
    assert Comparison((stranger, strange), {}).best is strange
    none = fit("none", times=-1.0)  # no stress of a stretched rubber
    assert Comparison((none, stranger), {}).best is stranger
    assert found.against(strange) == [
        "equibiaxial, not measured: 1.1 times the middle of the 95 % band"
    ]


def test_a_test_that_remembers_is_only_asked_for_its_length() -> None:
    x = np.linspace(1.0, 21, 9)
    assert [s.kind for s in curve_suspects(tension(x, kind=HistoryTest))] == ["percent"]
    wave = tension(np.concatenate([OUT, BACK]), kind=HistoryTest)
    assert curve_suspects(wave) == []


@pytest.mark.parametrize(
    ("low", "high", "remarks"),
    [
        (0.6, 1.4, []),
        (0.45, 1.4, ["from 0.450 to 1.400", "by up to 2.222, the data reach"]),
        (0.6, 2.4, ["from 0.600 to 2.400", "by up to 2.400, the data reach"]),
        (0.51, 1.4, ["by up to 1.961, the data reach 1.800"]),
        (None, None, []),
    ],
)
def test_a_scene_is_compared_with_the_stretches_of_the_data(
    low: float | None, high: float | None, remarks: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    report = {"status": "converged", "stretch_min": low, "stretch_max": high}
    solved = SimpleNamespace(report={**report, "material_stable": True, "message": "m"})
    monkeypatch.setattr("suas_jax.scene.solve.solve", lambda scene: solved)
    monkeypatch.setattr(calibration, "load_scene", lambda path: path)
    monkeypatch.setattr(calibration, "with_material", lambda scene, fit: scene)
    fit: Any = SimpleNamespace(
        stable={"pure_shear": (0.5, 2.0)}, sets=[tension([1.0, 1.2]), tension([1.0, 1.8])]
    )
    place: Any = "scene.toml"
    summary, found = calibration.compare_with_scene(fit, place)
    assert (summary["stretch_min"], summary["stretch_max"]) == (low, high)
    assert len(found) == len(remarks)
    for text, words in zip(found, remarks, strict=True):
        assert words in text
    solved.report["status"] = "unstable"
    assert calibration.compare_with_scene(fit, place)[1][0] == "scene.toml: m"


def test_an_indentation_between_few_solved_travels_is_a_polynomial_of_their_roots() -> None:
    """F = a d^1.5 + b d^3, of degree 6 in the root, is exact; a wall's kink is none."""
    travel = np.append(np.linspace(0, 4e-3, 41), 1e-3)

    def force(d: np.ndarray) -> np.ndarray:
        return 2e4 * d**1.5 + 1e8 * d**3

    levels, weight = nodes_of(travel, 13)
    assert len(levels) == 13
    np.testing.assert_allclose(weight @ force(levels), force(travel), rtol=1e-10, atol=1e-12)
    assert _is_smooth(levels, force(levels)[None])
    assert not _is_smooth(levels, np.maximum(force(levels), force(np.array(3e-3)))[None])
    few, alone = nodes_of(travel[::10], 13)
    np.testing.assert_array_equal(few, np.unique(travel[::10]))
    np.testing.assert_allclose(alone @ few, travel[::10])
