"""Simulated logs and their conversion: what is written is what the model says."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from skins import PAPER, quick
from test_cli import SCENES
from typer.testing import CliRunner

from fitting.cli.app import app
from fitting.cli.simulate import _tell
from fitting.sensor.logs.data import load_sensor_data
from suas_jax.acquisition.log.convert import convert, to_xarray
from suas_jax.acquisition.log.log_file import SoLog, group_frames, read_log
from suas_jax.config import load_scene, with_inputs
from suas_jax.config.inelastic import RelaxationSpec
from suas_jax.config.schema_load import EnvironmentSpec, PatchLoadSpec, PressureLoadSpec
from suas_jax.scene.forward import forward
from suas_jax.scene.loads import Loads, loads_of
from suas_jax.scene.skin import skin_of
from suas_jax.simulation.capacitances import _ELEMENTS, _loads, capacitances
from suas_jax.simulation.load_path import LoadPath, load_path
from suas_jax.simulation.simulated_log import NotKnownInputsError, true_loads

SCENE = f"""{PAPER}
[electrodes]
lsb = "0.02 fF"
layout = "roboskin"
modules = [ {{ angle = "-20 deg" }}, {{ angle = "20 deg", rotation = "180 deg" }} ]
[[load]]
kind = "line"
angle = "0 deg"
force = "8 N"
"""
PATH = """# scene: scene.toml
# pressed, then slid
t_s,loads.0.force_N,loads.0.angle_deg
0,0,-30

1,10,-30
2,10,30
"""


def suas(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(app, [str(a) for a in arguments])
    return result.exit_code, result.output


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("simulate")
    (folder / "scene.toml").write_text(SCENE)
    (folder / "palm.toml").write_text(SCENE + 'spread = "20 mm"\n')
    (folder / "path.csv").write_text(PATH)
    return folder


@pytest.fixture(scope="module")
def played(folder: Path) -> SoLog:
    status, output = suas("simulate", folder / "path.csv", "-o", folder / "played.csv")
    assert status == 0, output
    return read_log(folder / "played.csv")


def counts_of(log: SoLog) -> np.ndarray:
    """Counts [frame, module, taxel] of a log with two modules."""
    frames = group_frames(log)
    return np.stack([frames.of_module(k) for k in range(2)], 1)


@pytest.mark.long  # the program of a path; what is written and read is here
def test_a_path_is_played_as_the_model_has_it(folder: Path, played: SoLog) -> None:
    frames = group_frames(played)
    so = counts_of(played)
    assert so.shape == (21, 2, 10)
    np.testing.assert_allclose(frames.t_device, np.arange(21) / 10, atol=1e-12)
    skin = skin_of(load_path(folder / "path.csv").scene, elements=_ELEMENTS)
    t = np.array([0.0, 0.5, 1.0, 1.5, 2.0])
    angle, force = np.interp(t, [0, 1, 2], [-30, -30, 30]), np.interp(t, [0, 1], [0, 10])
    want = quick(forward)(skin, Loads.line(np.deg2rad(angle), force)).so
    counts = so[::5].reshape(5, 20)
    assert np.all(np.abs(counts - np.asarray(want).T) <= 0.5 + 1e-6)  # rounded, nothing else
    assert played.header["scale"] == "0.02 fF"


def test_a_simulated_log_carries_its_true_loads(folder: Path, played: SoLog) -> None:
    """They are the path's, and what `suas fit sensor` takes for known inputs."""
    frames = group_frames(played)
    path = load_path(folder / "path.csv")
    true = path.at(frames.t_device)
    first = np.searchsorted(played.seq, frames.seq)
    for key in ("force_N", "angle_deg"):
        written = played.flags[f"load_0_{key}"].astype(float)[first]
        np.testing.assert_allclose(written, true[f"loads.0.{key}"], atol=1e-7)
    data = load_sensor_data(path.scene.skin, [folder / "played.csv"])
    np.testing.assert_allclose(data.loads.force[0][data.state], true["loads.0.force_N"])
    assert not [text for text in data.warnings if "no known loads" in text]
    # The path says the same; one that says something else is refused.
    load_sensor_data(path.scene.skin, [folder / "played.csv"], [folder / "path.csv"])
    other = folder / "other.csv"
    other.write_text(PATH.replace("2,10,30", "2,11,30"))
    with pytest.raises(ValueError, match="with other values"):
        load_sensor_data(path.scene.skin, [folder / "played.csv"], [other])


@pytest.mark.long  # two meshes of `forward`; a log's capacitances are those of its scenes above
def test_a_soft_skin_is_simulated_on_a_fine_mesh(folder: Path) -> None:
    """With the 32 elements that `forward` takes, readings are off by 4e-4."""
    soft = SCENE.replace('preset = "epdm-paper"', 'law = "neo-hookean"\nmu = "1.5 MPa"')
    (folder / "soft.toml").write_text(soft)
    scene = load_scene(folder / "soft.toml")
    time, angle, force = np.arange(3.0), np.array([7.0, -21, 33]), np.array([0.3, 0.45, 0.6])
    columns = {"loads.0.angle_deg": angle, "loads.0.force_N": force}
    found = capacitances(LoadPath(scene, time, columns), time)
    fine = skin_of(scene, elements=256, contact=False)
    want = quick(forward)(fine, Loads.line(np.deg2rad(angle), force)).readings.capacitance
    np.testing.assert_allclose(found, np.asarray(want).T, rtol=1.5e-4)


@pytest.mark.long  # of compressible oil; test_prestress.py has surroundings of single scenes
def test_a_path_warms_and_sinks_the_skin(folder: Path) -> None:
    """Frames are those of the scene in their surroundings, whose columns the log has."""
    grows = SCENE.replace("[oil]", 'expansion = "EPDM"\n[oil]\nbulk_modulus = "1.1 GPa"')
    grows = grows.replace('"incompressible"', '"compressible"')
    (folder / "warm.toml").write_text(grows)
    path = folder / "warm.csv"
    rows = "t_s,temperature_degC,water_depth_m\n0,20,0\n1,10,100\n"
    path.write_text(f"# scene: warm.toml\n{rows}")
    status, output = suas("simulate", path, "-o", folder / "warmed.csv", "--rate", 2)
    assert status == 0, output
    flags = read_log(folder / "warmed.csv").flags
    for name, wanted in (("temperature_degC", [20, 15, 10]), ("water_depth_m", [0, 50, 100])):
        np.testing.assert_allclose(flags[name][::2].astype(float), wanted)
    found = capacitances(load_path(path), np.array([0.0, 0.5, 1.0]))
    scene = load_scene(folder / "warm.toml")
    for k, (warm, deep) in enumerate(((293.15, 0.0), (288.15, 50.0), (283.15, 100.0))):
        around = EnvironmentSpec(temperature=warm, depth=deep)
        own = scene.model_copy(update={"environment": around})
        alone = capacitances(LoadPath(own, np.zeros(1), {}), np.zeros(1))
        np.testing.assert_allclose(found[k], alone[0], rtol=1e-9)
    assert np.abs(found[2] / found[0] - 1).max() > 1e-3


@pytest.mark.parametrize(
    ("column", "message"),
    [("temperature_degC,285", "-40 to 120"), ("water_depth_m,-3", "0 to 11000")],
)
def test_impossible_surroundings_are_refused(folder: Path, column: str, message: str) -> None:
    name, value = column.split(",")
    (folder / "bad.csv").write_text(f"# scene: scene.toml\nt_s,{name}\n0,{value}\n")
    with pytest.raises(ValueError, match=f'"{name}": {value}: {message} is allowed'):
        load_path(folder / "bad.csv")


def test_a_load_over_an_arc_changes_its_force(folder: Path) -> None:
    (folder / "palm.csv").write_text("# scene: palm.toml\nt_s,loads.0.force_N\n0,0\n1,8\n")
    path = load_path(folder / "palm.csv")
    section = skin_of(path.scene).geometry.section
    found = _loads(path, np.array([0.0, 0.25]), section)
    wanted = loads_of(with_inputs(path.scene, {"load.0.force": 2.0}))
    np.testing.assert_allclose(found.force[:, 0], 0.0)
    for name in ("angle", "force", "turn"):
        own, other = getattr(found, name)[:, 1], getattr(wanted, name)[:, 0]
        np.testing.assert_allclose(own, other, rtol=1e-14, err_msg=name)


def test_true_loads_of_every_kind() -> None:
    scene = load_scene(Path("configs/scenes/two_contacts.toml"))
    turned = scene.loads[1].model_copy(update={"direction": "vertical", "angle": 0.5})
    scene = scene.model_copy(update={"loads": (scene.loads[0], turned)})
    columns = true_loads(scene, [6.0, 12.0], {"loads.0.force_N": np.array([1.0, 2.0])}, 2)
    assert columns["load_0_force_N"].tolist() == [1.0, 2.0]
    assert columns["load_1_force_N"].tolist() == [12.0, 12.0]
    assert columns["load_1_direction_deg"] == pytest.approx(np.rad2deg([0.5, 0.5]))
    assert "load_0_direction_deg" not in columns
    pressed = PressureLoadSpec(pressure=1e3)
    for load, word in (
        (pressed, "a pressure"),
        (turned.model_copy(update={"spread": 5e-3}), "spread"),
    ):
        with pytest.raises(NotKnownInputsError, match=word):
            true_loads(scene.model_copy(update={"loads": (load,)}), [0.0], {}, 2)
    pad = load_scene(Path("configs/scenes/pad_crown.toml"))
    disc = PatchLoadSpec(angle=0.1, axial=2e-3, diameter=6e-3, force=5.0)
    found = true_loads(pad.model_copy(update={"loads": (disc,)}), [5.0], {}, 1)
    assert found["load_0_axial_mm"].tolist() == [2.0]
    assert found["load_0_diameter_mm"].tolist() == [6.0]


def test_noise_drift_and_faults_are_as_asked(folder: Path, played: SoLog) -> None:
    options = ("--noise", 2, "--missing", 0.2, "--drop", 0.1, "--stuck", "1.3@0.5")
    status, output = suas(
        "simulate", folder / "path.csv", "-o", folder / "noisy.csv", "--seed", 7, "--rate",
        100, *options,
    )  # fmt: skip
    assert status == 0, output
    log = read_log(folder / "noisy.csv")
    frames, so = group_frames(log), counts_of(log)
    assert len(frames) == pytest.approx(201 * 0.9, abs=20)
    assert np.isnan(so).mean() == pytest.approx(0.2, abs=0.03)
    late = so[frames.t_device >= 0.5, 1, 2]
    assert np.unique(late[~np.isnan(late)]).size == 1
    assert log.flags["lost"].sum() > 0
    clean = counts_of(played)[::10]
    both = np.isin(np.round(frames.t_device, 6), [0.0, 1.0, 2.0])
    at = np.round(frames.t_device[both]).astype(int)
    rest = so[both] - clean[at]
    rest[:, 1, 2] = np.nan
    assert np.nanstd(rest) == pytest.approx(2.0, abs=0.7)
    again = folder / "again.csv"
    suas("simulate", folder / "path.csv", "-o", again, "--seed", 7, "--rate", 100, *options)
    np.testing.assert_array_equal(read_log(again).so, log.so)


def test_a_calibrated_unit_has_its_offsets(folder: Path, played: SoLog) -> None:
    offsets = [10.0 * k - 50.0 for k in range(20)]
    table = f"[calibration]\noffsets = {offsets}\n"
    (folder / "unit.toml").write_text(SCENE + table)
    (folder / "unit.csv").write_text(PATH.replace("scene.toml", "unit.toml"))
    status, output = suas("simulate", folder / "unit.csv", "-o", folder / "unit_log.csv")
    assert status == 0, output
    moved = counts_of(read_log(folder / "unit_log.csv")) - counts_of(played)
    np.testing.assert_array_equal(moved.reshape(-1, 20), np.tile(offsets, (21, 1)))


@pytest.mark.long  # a scene of its own; saturation in test_sensing
def test_a_taxel_that_touches_reads_full_scale(folder: Path) -> None:
    (folder / "hard.csv").write_text(
        "# scene: scene.toml\nt_s,loads.0.angle_deg,loads.0.force_N\n0,20,5\n1,20,200\n"
    )
    log = folder / "hard.log.csv"
    status, output = suas("simulate", folder / "hard.csv", "-o", log, "--bits", 16)
    assert status == 0
    assert "the membrane touches taxels in" in output
    so = counts_of(read_log(log))
    assert so[0].max() < so[-1].max() == 2**16 - 1
    assert so[-1, 0].max() < 2**16 - 1  # of the triangle 40 degrees away


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t_s,loads.0.force_N\n0,1\n", "'# scene: FILE' is missing"),
        ("# scene: scene.toml\nt_s,loads.1.force_N\n0,1\n", "K below 1"),
        ("# scene: scene.toml\nt_s,loads.0.pressure_Pa\n0,1\n", "a line load has force_N"),
        ("# scene: scene.toml\nt_s,loads.0.force_N\n0,1\n1,x\n", "line 4, column loads.0.f"),
        ("# scene: scene.toml\nt_s,loads.0.force_N\n0,1\n-1,2\n", "line 4, column t_s"),
        ("# scene: scene.toml\nt_s,loads.0.force_N\n0,1,2\n", "3 fields for 2 columns"),
        ("# scene: scene.toml\nt_s,loads.0.angle_deg\n0,91\n", "leaves the skin"),
        ("# scene: no.toml\nt_s,loads.0.force_N\n0,1\n", "no.toml"),
        ("# scene: palm.toml\nt_s,loads.0.angle_deg\n0,1\n", "its force_N may change"),
    ],
)
def test_what_is_wrong_with_a_path_is_named(folder: Path, text: str, message: str) -> None:
    (folder / "bad.csv").write_text(text)
    status, output = suas("simulate", folder / "bad.csv", "-o", folder / "bad.log.csv")
    assert status == 2
    assert message in output.replace("\n", " ")
    assert not (folder / "bad.log.csv").exists()


def test_a_log_is_never_overwritten_unasked(folder: Path, played: SoLog) -> None:
    before = (folder / "played.csv").read_bytes()
    status, output = suas("simulate", folder / "path.csv", "-o", folder / "played.csv")
    assert status == 2
    assert "--overwrite" in output
    assert (folder / "played.csv").read_bytes() == before


@pytest.mark.parametrize("ending", [".parquet", ".nc"])
def test_logs_survive_conversion_both_ways(folder: Path, ending: str) -> None:
    source = folder / f"holes{ending}.csv"
    source.write_text(
        "# format: suas-so-log\n# scale: 0.305 fF\n# note: a, b: c\n"
        "t_host_s,t_device_s,seq,module,so_1,so_2,so_3,lost,remark\n"
        "0.000000,0.1,5,0,13675,,65535,0,a\n0.100000,,6,2,1,0,2,1,b\n"
    )
    there, back = folder / f"holes{ending}", folder / f"back{ending}.csv"
    for a, b in ((source, there), (there, back)):
        status, output = suas("convert", a, b)
        assert status == 0, output
    assert back.read_bytes() == source.read_bytes()
    status, output = suas("convert", source, there)
    assert status == 2
    assert "--overwrite" in output


def test_a_log_as_a_data_set(played: SoLog) -> None:
    data = to_xarray(played)
    assert dict(data.sizes) == {"row": 42, "taxel": 10}
    assert data["so"].attrs["units"] == "counts"
    np.testing.assert_array_equal(data["so"].sel(taxel=10), played.so[:, 9])


def test_what_is_no_log_is_refused(folder: Path) -> None:
    (folder / "no.parquet").write_text("this is not a parquet file")
    (folder / "no.nc").write_text("nor this NetCDF")
    for name in ("no.parquet", "no.nc", "played.xls"):
        with pytest.raises(ValueError, match=name.replace(".", r"\.")):
            convert(folder / name, folder / "out.csv")


def test_a_skin_that_remembers_leaves_its_memory_in_a_log(folder: Path) -> None:
    constants = {"material.C1": 20.7e6, "material.C2": -4.4e6, "material.C3": 77e3}
    scene = with_inputs(load_scene(folder / "scene.toml"), constants)
    relaxation = RelaxationSpec(g=(0.2,), tau=(1.0,))
    rubber = scene.material.model_copy(update={"relaxation": relaxation})
    creeping = with_inputs(
        scene.model_copy(update={"material": rubber}),
        {k: 0.8 * x for k, x in constants.items()},
    )
    softer = creeping.model_copy(
        update={"material": rubber.model_copy(update={"relaxation": None})}
    )
    softer = with_inputs(softer, {k: 0.8 * x for k, x in constants.items()})
    time = np.array([0.0, 1e-9, 1e3, 1e3 + 1e-9])
    force, angle = np.array([0.0, 10.0, 10.0, 0.0]), np.array([5.0, 5.0, 5.0, 5.0])
    columns = {"loads.0.force_N": force, "loads.0.angle_deg": angle}
    found, at_once, for_good = (
        capacitances(LoadPath(each, time, columns), time) for each in (creeping, scene, softer)
    )
    np.testing.assert_allclose(found[:2], at_once[:2], rtol=1e-7)
    np.testing.assert_allclose(found[2], for_good[2], rtol=1e-7)
    left = np.abs(found[3] - at_once[3]).max() / np.abs(found[2] - at_once[3]).max()
    assert 0.1 < left < 0.4  # a ghost of the dent


def test_a_jump_between_frames_is_remembered_from_its_own_time(folder: Path) -> None:
    """What a held load leaves depends on how long it has been held, not on the frames."""
    scene = load_scene(folder / "scene.toml")
    relaxation = RelaxationSpec(g=(0.4,), tau=(0.05,))
    rubber = scene.material.model_copy(update={"relaxation": relaxation})
    creeping = scene.model_copy(update={"material": rubber})

    done: list[int] = []

    def read(rows: list[tuple[float, float]], frames: list[float]) -> np.ndarray:
        time, force = np.array(rows).T
        columns = {"loads.0.force_N": force, "loads.0.angle_deg": 0 * force + 5}
        path = LoadPath(creeping, time, columns)
        return capacitances(path, np.array(frames), done.append)

    late = read([(0, 0), (0.95, 0), (0.95, 8), (2, 8)], [0, 1, 2])
    soon = read([(0, 0), (0, 8), (2, 8)], [0, 0.05, 2])
    np.testing.assert_allclose(late[1:], soon[1:], rtol=2e-5)
    assert done == [3, 3]  # frames, not the rows between them
    assert np.abs(late[1] - late[2]).max() > 1e-3 * late[2].max()  # it still creeps


def test_a_log_without_the_motion_of_its_film_says_so(
    capsys: pytest.CaptureFixture[str],
) -> None:
    moving, still = load_scene(SCENES / "tap.toml"), load_scene(SCENES / "press.toml")
    pressed, held = np.array([[1e-14], [2e-14]]), np.array([[np.nan], [np.nan]])
    for scene, found in ((moving, pressed), (moving, held), (still, pressed)):
        sample: Any = SimpleNamespace(saturated=np.zeros(1, bool))
        log: Any = SimpleNamespace(scene=scene, capacitance=found, readings=[], sample=sample)
        log.untold = ""
        _tell(log, Path("tap.csv"), 10.0, written=True)
        told = "film's inertia and viscosity are left out" in capsys.readouterr().err
        assert told == (scene is moving and found is pressed)
