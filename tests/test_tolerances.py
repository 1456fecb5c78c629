"""Tolerances of a skin file: how they are written, what a solve makes of them."""

import copy
import math
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from skins import CASE_B, GEOMETRY

from suas_jax.config import (
    ConfigError,
    SceneSpec,
    SkinSpec,
    UncertainQuantity,
    continuous_inputs,
    input_errors,
    load_scene,
    load_skin,
    scene_from_dict,
    with_inputs,
)
from suas_jax.config.input_errors import DEFAULTS, STIFFNESS, as_assembled
from suas_jax.config.schema_calibration import CalibrationSpec
from suas_jax.config.tolerance import parse_uncertain
from suas_jax.scene.gradient import gradient
from suas_jax.scene.solve import Solution, solve
from suas_jax.scene.uncertainty import uncertainty

SKIN: dict[str, Any] = {
    "geometry": GEOMETRY,
    "material": {"law": "mooney-rivlin", "C1": "20.7 MPa", "C2": "-4.4 MPa", "C3": "77 kPa"},
    "oil": {"model": "incompressible", "relative_permittivity": 2.2},
    "electrodes": {"taxels": [{"angle": "-20 deg"}, {"angle": "10 deg"}]},
}
LOAD = {"kind": "line", "angle": "0 deg", "force": "12 N"}


def scene(**changes: dict[str, Any]) -> Any:
    """The scene of one load at the crown, with keys of its tables changed."""
    tables = copy.deepcopy(SKIN)
    for name, table in changes.items():
        tables[name] |= table
    return scene_from_dict({**tables, "load": [LOAD], "solve": {"elements": 16}})


@pytest.mark.parametrize(
    ("text", "dimension", "value", "deviation"),
    [
        ("20.7 MPa +- 10 %", "stress", 20.7e6, 2.07e6),
        ("-4.4 MPa +- 10 %", "stress", -4.4e6, 0.44e6),
        ("1.50 mm +- 0.03 mm", "length", 1.5e-3, 3e-5),
        ("1.50 +- 0.03 mm", "length", 1.5e-3, 3e-5),
        ("(1.50 +- 0.03) mm", "length", 1.5e-3, 3e-5),
        ("1.5 mm ± 30 um", "length", 1.5e-3, 3e-5),
        ("1.5 mm +/- 0", "length", 1.5e-3, 0.0),
        ("-30 deg +- 0.1 deg", "angle", -math.pi / 6, math.pi / 1800),
        ("2.2 +- 0.1", "number", 2.2, 0.1),
        ("2.2 +- 5%", "number", 2.2, 0.11),
        ("0.05 % +- 0.02 %", "number", 5e-4, 2e-4),  # its own unit, no share
        ("0 mm +- 0.1 mm", "length", 0.0, 1e-4),
    ],
)
def test_a_quantity_carries_one_standard_deviation(
    text: str, dimension: Any, value: float, deviation: float
) -> None:
    found = parse_uncertain(text, dimension)
    assert float(found) == pytest.approx(value, rel=1e-12)
    assert found.deviation == pytest.approx(deviation, rel=1e-12)
    for same in (pickle.loads(pickle.dumps(found)), copy.deepcopy(found)):
        assert (same, same.deviation) == (found, found.deviation)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1.5 mm +- -0.1 mm", "negative"),
        ("1.5 mm +- 0.1", "after +-: the unit is missing"),
        ("1.5 mm +- 0.1 MPa", '"MPa" is a unit of'),
        ("1.5 mm +- lots", "after +-"),
        ("1.5 mm +- 0.1 mm +- 0.2 mm", "one standard deviation"),
        ("0 mm +- 10 %", "share of zero"),
        ("1.5 mm +-", "after +-"),
        ("+- 0.1 mm", "is empty"),
    ],
)
def test_what_is_no_tolerance_is_refused_with_its_reason(text: str, message: str) -> None:
    with pytest.raises(ConfigError) as error:
        scene(geometry={"thickness": text})
    assert message in str(error.value)
    assert "geometry.thickness" in str(error.value)


def test_specifications_keep_deviations_and_compare_by_value() -> None:
    plain, stated = scene(), scene(geometry={"oil_gap": "5 mm +- 2 %"})
    assert plain == stated
    gap = stated.skin.geometry.oil_gap
    assert isinstance(gap, UncertainQuantity)
    assert gap.deviation == pytest.approx(1e-4)
    inputs = continuous_inputs(stated)
    assert inputs == continuous_inputs(plain)
    assert type(inputs["geometry.oil_gap"]) is float
    # A value that is replaced has no deviation, the others keep theirs.
    other = with_inputs(stated, {"geometry.thickness": 1.6e-3})
    errors = input_errors(other)
    gap = errors.directions[errors.names.index("geometry.oil_gap")]
    assert gap[errors.paths.index("geometry.oil_gap")] == pytest.approx(1e-4)
    assert "geometry.thickness" in errors.assumed


def test_a_skin_that_states_nothing_has_the_defaults_and_says_so() -> None:
    errors = input_errors(scene())
    assert errors.names == errors.assumed == tuple(DEFAULTS)
    assert "no tolerances" in errors.text
    # What hands decide moves a force most, and counts where loads are estimated.
    assert "mounting" not in errors.text
    assert "mounting 0.05 %, fill 0.3 %" in input_errors(as_assembled(scene())).text
    own = continuous_inputs(scene())
    row = errors.directions[errors.names.index(STIFFNESS)]
    stiffness = dict(zip(errors.paths, row, strict=True))
    for name in ("C1", "C2", "C3"):  # all constants together: C2 is negative
        expected = DEFAULTS[STIFFNESS] * own[f"material.{name}"]
        assert stiffness[f"material.{name}"] == pytest.approx(expected)


def test_a_table_has_the_default_of_its_length_all_over() -> None:
    table = {"arc": [0, 0.5, 1], "value": ["1.2 mm", "1.8 mm", "1.4 mm"]}
    for key in ("thickness", "oil_gap"):
        errors = input_errors(scene(geometry={key: table}))
        assert errors.names == errors.assumed == tuple(DEFAULTS)
        row = errors.directions[errors.names.index(f"geometry.{key}")]
        own = dict(zip(errors.paths, row, strict=True))
        found = [own[f"geometry.{key}.value.{k}"] for k in range(3)]
        np.testing.assert_allclose(found, [0.036e-3, 0.054e-3, 0.042e-3])
    exact = table | {"value": ["1.2 mm +- 0", "1.8 mm", "1.4 mm"]}
    assert "geometry.thickness" not in input_errors(scene(geometry={"thickness": exact})).names


def test_a_stated_tolerance_takes_the_place_of_its_own_default_alone() -> None:
    errors = input_errors(scene(oil={"relative_permittivity": "2.2 +- 0.1"}))
    stated = "oil.relative_permittivity"
    assert errors.names == (stated, *(name for name in DEFAULTS if name != stated))
    assert errors.assumed == errors.names[1:]
    assert "permittivity" not in errors.text
    size = errors.directions[0, errors.paths.index(stated)]
    assert size == pytest.approx(0.1)
    exact = input_errors(scene(geometry={"thickness": "1.5 mm +- 0"}))
    assert exact.names == tuple(name for name in DEFAULTS if name != "geometry.thickness")
    modulus = input_errors(scene(material={"C1": "20.7 MPa +- 1 %"}))
    assert STIFFNESS not in modulus.names


def test_deviations_of_a_material_may_be_correlated() -> None:
    matrix = [[1.0, -0.9], [-0.9, 1.0]]
    material = {
        "C1": "20.7 MPa +- 2 MPa",
        "C2": "-4.4 MPa +- 2 MPa",
        "correlation": {"of": ["C1", "C2"], "matrix": matrix},
    }
    given = scene(material=material)
    errors = input_errors(given)
    total = errors.directions.T @ errors.directions
    order = [errors.paths.index(f"material.{key}") for key in ("C1", "C2")]
    np.testing.assert_allclose(total[np.ix_(order, order)], 4e12 * np.array(matrix))
    assert STIFFNESS not in errors.names
    # What is written is read again.
    table = given.skin.material.table()
    again = input_errors(scene(material=table))
    np.testing.assert_allclose(again.directions, errors.directions, rtol=1e-9)
    assert continuous_inputs(given).keys() == continuous_inputs(scene()).keys()


def test_errors_of_constants_that_are_known_together_have_a_name_each() -> None:
    constants = {"C1": "20 MPa +- 1 MPa", "C2": "-4 MPa +- 1 MPa", "C3": "1 MPa +- 1 MPa"}
    matrix = [[1.0, 0.5, 0.5], [0.5, 1.0, 0.0], [0.5, 0.0, 1.0]]
    together = {"of": list(constants), "matrix": matrix}
    errors = input_errors(scene(material=constants | {"correlation": together}))
    of_material = [name for name in errors.names if name.startswith("material")]
    assert len(set(of_material)) == 3


@pytest.mark.parametrize(
    ("correlation", "message"),
    [
        ({"of": ["C1"], "matrix": [[1.0, 0.5]]}, "1 rows of as many numbers"),
        ({"of": ["C1", "C2"], "matrix": [[1.0, 2.0], [2.0, 1.0]]}, "symmetric"),
        ({"of": ["C1", "mu.3"], "matrix": [[1.0, 0.0], [0.0, 1.0]]}, '"mu.3" is not a number'),
    ],
)
def test_correlations_that_are_none_are_refused(correlation: Any, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        scene(material={"correlation": correlation})


def test_a_calibration_of_what_the_file_lacks_is_refused() -> None:
    record = CalibrationSpec(parameters=("mounting",), values=(0.0,), covariance=((1e-8,),))
    with pytest.raises(ValueError, match=r"\[geometry\] has no mounting: add the value"):
        input_errors(scene().skin.model_copy(update={"calibration": record}))


def test_a_calibration_joins_what_is_stated() -> None:
    covariance = np.array([[4e-10, 3e-8], [3e-8, 9e-4]])
    record = CalibrationSpec(
        parameters=("oil_gap", "relative_permittivity"),
        values=(5e-3, 2.2),
        covariance=tuple(map(tuple, covariance.tolist())),
    )
    given = scene(material={"C1": "20.7 MPa +- 10 %"}).skin
    errors = input_errors(given.model_copy(update={"calibration": record}))
    assert set(errors.assumed) == {"geometry.thickness"}
    total = errors.directions.T @ errors.directions
    order = [errors.paths.index(p) for p in ("geometry.oil_gap", "oil.relative_permittivity")]
    np.testing.assert_allclose(total[np.ix_(order, order)], covariance, rtol=1e-9)
    assert "material.C1" in errors.names
    # What is written counts where a quantity is both calibrated and written with +-.
    written = scene(geometry={"oil_gap": "5 mm +- 1 %"}).skin
    errors = input_errors(written.model_copy(update={"calibration": record}))
    total = errors.directions.T @ errors.directions
    order = [errors.paths.index(p) for p in ("geometry.oil_gap", "oil.relative_permittivity")]
    expected = np.diag([5e-5**2, covariance[1, 1]])
    np.testing.assert_allclose(total[np.ix_(order, order)], expected, rtol=1e-9, atol=1e-20)


@pytest.fixture(scope="module")
def solution() -> Solution:
    table = load_scene(CASE_B).model_dump(exclude_unset=True, by_alias=True)
    table["geometry"] |= {"thickness": "1.5 mm +- 3 %", "oil_gap": "5 mm +- 2 %"}
    table["material"] |= {"C1": "20.7 MPa +- 10 %"}
    table["oil"] |= {"relative_permittivity": "2.2 +- 4 %"}
    return solve(SceneSpec(**table))


def test_the_band_of_an_output_is_that_of_its_derivatives(solution: Solution) -> None:
    errors, inputs = input_errors(solution.scene), continuous_inputs(solution.scene)

    def so(path: str, by: float) -> float:
        moved = with_inputs(solution.scene, {path: inputs[path] * (1 + by)})
        return float(solve(moved).report["taxels"][5]["so"])

    h = 1e-4
    slopes = {p: (so(p, h) - so(p, -h)) / (2 * h * inputs[p]) for p in errors.paths}
    expected = np.linalg.norm(errors.directions @ np.array(list(slopes.values())))
    assert uncertainty(solution, errors)["taxels.5.so"] == pytest.approx(expected, rel=1e-4)


@pytest.mark.long  # the program of derivatives; differences above
def test_the_band_of_an_output_is_that_of_the_exact_derivatives(solution: Solution) -> None:
    path = "taxels.5.so"
    errors = input_errors(solution.scene)
    slopes = gradient(solution, path)
    by_input = np.array([slopes[p] for p in errors.paths])
    expected = np.linalg.norm(errors.directions @ by_input)
    assert uncertainty(solution, errors)[path] == pytest.approx(expected, rel=1e-4)


def test_a_soft_batch_of_rubber_moves_outputs_within_their_band(solution: Solution) -> None:
    band = uncertainty(solution, input_errors(solution.scene))
    softer = with_inputs(solution.scene, {"material.C1": 20.7e6 - 2.07e6})
    moved = solve(softer).report["loads"][0]["force_N"]
    change = abs(moved - solution.report["loads"][0]["force_N"])
    assert 0.5 * change < band["loads.0.force_N"] < 2 * change


def test_presets_and_skins_of_the_project_can_be_loaded_with_tolerances(tmp_path: Path) -> None:
    text = (Path(__file__).parent.parent / "configs/skins/suas.toml").read_text()
    text = text.replace('{ angle = "-70 deg",', '{ angle = "-70 deg +- 0.2 deg",')
    file = tmp_path / "skin.toml"
    file.write_text(text)
    skin: SkinSpec = load_skin(file)
    assert "electrodes.taxels.0.angle" in input_errors(skin).names


@pytest.mark.long  # a scene at its crown; the band of an output is above
def test_two_equal_bulges_do_not_make_their_place_uncertain() -> None:
    pressed = scene_from_dict(
        {**SKIN, "load": [{**LOAD, "angle": "0 deg +- 1 deg"}], "solve": {"elements": 16}}
    )
    found = solve(pressed)
    assert found.report["bulge_angle_deg"] < -30  # the first of two
    # The load's error makes the one or the other bulge the larger, and moves neither far.
    assert uncertainty(found, input_errors(pressed))["bulge_angle_deg"] < 1
