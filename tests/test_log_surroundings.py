"""A log's temperature: read from its columns, and what of a skin goes with it."""

from pathlib import Path

import numpy as np
import pytest

from fitting.inverse_load.readings import readings_of
from fitting.sensor.logs.data import load_sensor_data
from fitting.surroundings import log_surroundings, spec_at
from suas_jax.acquisition.log.log_file import read_log
from suas_jax.config import (
    SkinSpec,
    UncertainQuantity,
    continuous_inputs,
    load_scene,
    load_skin,
)
from suas_jax.config.input_errors import as_assembled, input_errors
from suas_jax.config.schema_load import EnvironmentSpec
from suas_jax.scene.parts import skin_parts
from suas_jax.sensing.electrodes import warmed_permittivity

SKIN = Path(__file__).parent.parent / "configs/skins/suas.toml"
DEEP_SEA = SKIN.parent.parent / "scenes/deep_sea.toml"
TAXELS, EXPANSION = 8, 9.6e-4


@pytest.fixture(scope="module")
def spec() -> SkinSpec:
    """The paper's skin, whose oil grows with warmth."""
    found = load_skin(SKIN)
    oil = found.oil.model_copy(update={"expansion": EXPANSION})
    return found.model_copy(update={"oil": oil})


def log_of(folder: Path, head: str, columns: str, *rows: str) -> Path:
    names = ",".join(f"so_{k + 1}" for k in range(TAXELS))
    lines = [*head.splitlines(), f"t_host_s,t_device_s,seq,module,{names},{columns}"]
    for k, row in enumerate(rows):
        counts = ",".join(str(1000 + k + i) for i in range(TAXELS))
        lines.append(f"{k},{k},{k},0,{counts},{row}")
    file = folder / "log.csv"
    file.write_text("\n".join(lines) + "\n")
    return file


def test_permittivity_goes_with_the_density() -> None:
    """Clausius and Mossotti; to first order de = -(e - 1)(e + 2)/3 dV/V."""
    e, growth = np.array([2.7]), np.array([1e-4])
    found = np.asarray(warmed_permittivity(e, growth))
    np.testing.assert_allclose((found - e) / growth, -(e - 1) * (e + 2) / 3, rtol=1e-3)
    dense, thin = (np.asarray(warmed_permittivity(e, np.array([g]))) for g in (-0.01, 30.0))
    assert dense > e
    np.testing.assert_allclose(thin, 1.0, atol=1e-12)  # nothing is left between the plates


def test_a_plain_column_moves_sizes_and_permittivity(spec: SkinSpec, tmp_path: Path) -> None:
    log = log_of(tmp_path, "", "temperature_degC", "29.5", "30.5", "30")
    data = load_sensor_data(spec, [log])
    warm = data.spec.environment
    assert warm is not None
    assert isinstance(warm.temperature, UncertainQuantity)
    np.testing.assert_allclose(warm.temperature, 303.15)
    np.testing.assert_allclose(
        warm.temperature.deviation, np.hypot(np.std([29.5, 30.5, 30]), 0.5)
    )
    told = "30 degC (column temperature_degC, 29.5 to 30.5): oil has grown"
    assert any(told in text for text in data.warnings)
    parts = skin_parts(data.spec, continuous_inputs(data.spec))
    grown = np.log1p(10 * EXPANSION)
    wanted = warmed_permittivity(np.array([2.2]), np.array([grown]))
    np.testing.assert_allclose(parts.sensing().permittivity, wanted, rtol=1e-12)
    read = readings_of(read_log(log), spec, None)
    assert read.surroundings.temperature is not None
    np.testing.assert_allclose(read.surroundings.temperature.mean, 303.15)


def test_a_known_temperature_takes_the_place_of_the_usual_tolerance(spec: SkinSpec) -> None:
    columns = {"temperature_degC": ["30"] * 3}
    found, _ = log_surroundings(columns, {}, spec, "log")
    path = "environment.temperature"
    deviations = []
    for own in (spec, spec_at(spec, found, "log")[0]):
        errors = input_errors(as_assembled(own))
        column = errors.directions[:, errors.paths.index(path)]
        deviations.append(float(np.linalg.norm(column)))
    np.testing.assert_allclose(deviations, [5.0, 0.5])


def test_depth_is_read_and_used_where_something_yields(tmp_path: Path) -> None:
    log = log_of(tmp_path, "", "water_depth_m", "90", "110", "100")
    rigid = load_skin(SKIN)
    data = load_sensor_data(rigid, [log])
    assert data.spec is rigid
    assert any("bulk_modulus" in text for text in data.warnings)
    oil = load_scene(DEEP_SEA).oil.model_copy(update={"relative_permittivity": 2.2})
    soft = rigid.model_copy(update={"oil": oil})
    data = load_sensor_data(soft, [log])
    assert data.spec.environment is not None
    assert data.spec.environment.depth == pytest.approx(100.0)
    # One state stands for all of the log, which does not say what 20 m do.
    assert any("20 m do within it" in text for text in data.warnings)


def test_thermal_pads_need_their_scale(spec: SkinSpec, tmp_path: Path) -> None:
    columns = "thermal_1,thermal_2"
    bare = log_of(tmp_path, "", columns, "3220,3220", "3222,3218")
    data = load_sensor_data(spec, [bare])
    assert data.spec.environment is None
    assert any("thermal_counts_per_K" in text for text in data.warnings)
    head = "# thermal_counts_per_K: 12\n# thermal_zero: 3100"
    data = load_sensor_data(spec, [log_of(tmp_path, head, columns, "3220,3220", "3222,3218")])
    assert data.spec.environment is not None
    np.testing.assert_allclose(data.spec.environment.temperature, 303.15)


def test_what_changes_nothing_is_said_and_nonsense_is_refused(tmp_path: Path) -> None:
    rigid = load_skin(SKIN)
    data = load_sensor_data(rigid, [log_of(tmp_path, "", "temperature_degC", "4", "4")])
    assert data.spec is rigid
    assert any("changes nothing" in text for text in data.warnings)
    with pytest.raises(ValueError, match="check the column's unit"):
        load_sensor_data(rigid, [log_of(tmp_path, "", "temperature_degC", "293", "293")])
    with pytest.raises(ValueError, match="expected a number"):
        load_sensor_data(rigid, [log_of(tmp_path, "", "temperature_degC", "warm", "4")])


@pytest.mark.parametrize(
    ("name", "row"),
    [
        ("water_depth_m", ("-5", "0")),
        ("water_depth_m", ("0", "11001")),
        ("temperature_degC", ("20", "120.5")),
        # Nearer to the reference than what a skin may well meet.
        ("temperature_degC", ("-40.5", "100")),
        ("temperature_degC", ("293", "20")),
    ],
)
def test_what_no_skin_meets_is_refused(spec: SkinSpec, name: str, row: tuple[str, str]) -> None:
    with pytest.raises(ValueError, match=r"no depth of water|check the column's unit"):
        log_surroundings({name: row}, {}, spec, "log")


def test_kelvin_and_two_logs(spec: SkinSpec) -> None:
    """What two logs say is said by one after the other; of one quantity, by either."""
    warm, _ = log_surroundings({"temperature_K": ["300", "302"]}, {}, spec, "log")
    both = {"temperature_degC": ["20"], "water_depth_m": ["7"]}
    deep, _ = log_surroundings(both, {}, spec, "log")
    for pair, temperatures in (
        ((warm, deep), [300, 302, 293.15]),
        ((deep, deep), [293.15] * 2),
    ):
        found = pair[0].and_then(pair[1])
        assert found.temperature is not None
        assert found.depth is not None
        np.testing.assert_allclose(found.temperature.value, temperatures)
        assert found.depth.mean == 7.0


@pytest.mark.parametrize(("own", "said"), [(301.4, False), (298.4, True)])
def test_a_temperature_of_the_file_that_the_log_contradicts_is_told(
    spec: SkinSpec, own: float, said: bool
) -> None:
    """By more than three standard deviations, of 0.5 K."""
    around = EnvironmentSpec(temperature=own)
    found, _ = log_surroundings({"temperature_K": ["300"] * 2}, {}, spec, "log")
    _, told = spec_at(spec.model_copy(update={"environment": around}), found, "log")
    assert ("is not used" in told[0]) == said


def test_an_empty_cell_says_nothing(spec: SkinSpec, tmp_path: Path) -> None:
    columns = "temperature_degC,load_0_force_N"
    log = read_log(log_of(tmp_path, "", columns, "30,4", ",", "30,8"))
    readings = readings_of(log, spec, None)
    np.testing.assert_array_equal(readings.force, [4.0, np.nan, 8.0])
    assert readings.surroundings.temperature is not None
    assert readings.surroundings.temperature.mean == pytest.approx(303.15)
