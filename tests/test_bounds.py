"""What is asked for is bounded: an answer at once, never a hang or a full memory."""

import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from fitting import load_dataset
from suas_jax.acquisition.log.log_file import group_frames, read_log, sequence_notes
from suas_jax.config import load_scene, parse_quantity
from suas_jax.config.csv_table import read_csv_table
from suas_jax.config.errors import ConfigError, show

SCENE = Path(__file__).parent.parent / "configs" / "scenes" / "case_b.toml"


@pytest.fixture(autouse=True)
def _at_once() -> Iterator[None]:
    """Each of these takes milliseconds, or minutes where a bound is missing."""
    begin = time.process_time()
    yield
    assert time.process_time() - begin < 5.0


@pytest.mark.parametrize(
    "text",
    [
        "1 m**9**9**9",
        "1 m^99",
        "1 m^10",
        "1 m^1e9",
        "1 m^0.5",
        "1 m2.5",
        "1 (m^9)^9^9",
        "1 " + "m" * 100_000,
        "1 " + "m " * 60,
        "1 " + "(" * 50 + "m" + ")" * 50,
        "1 m" + " " * 190 + "!",
        "1" * 100_000 + " m",
        "1e999999999 m",
        "9" * 190 + "e9999999 m",
    ],
)
def test_quantities_that_are_none(text: str) -> None:
    with pytest.raises(ValueError, match="length"):
        parse_quantity(text, "length")


@pytest.mark.parametrize(
    ("text", "kind", "value"),
    [
        ("1 N/(mm^2)", "stress", 1e6),
        ("1 N mm^-2", "stress", 1e6),
        ("1 N·m⁻²", "stress", 1.0),
        ("1 N*mm**(-2)", "stress", 1e6),
        ("1 (N/mm)/mm", "stress", 1e6),
        ("1 kg m^-1 s^-2", "stress", 1.0),
        ("1 kN/m3", "specific weight", 1e3),
        ("2 mm m^9/m^9", "length", 2e-3),
    ],
)
def test_quantities_as_people_write_them(text: str, kind: str, value: float) -> None:
    assert parse_quantity(text, kind) == pytest.approx(value, rel=1e-14)  # type: ignore[arg-type]


LOAD = '\n[[load]]\nkind = "line"\nangle = "1 deg"\nforce = "1 N"\n'
TEXTS = {
    "a." * 20_000 + "b = 1": "more than 12 parts",
    "[" + "a." * 20_000 + "b]": "more than 12 parts",
    "x = {" + "a . " * 20_000 + "b = 1}": "more than 12 parts",
    '"a"' + '."a"' * 20_000 + " = 1": "more than 12 parts",
    "x = " + "[" * 5_000 + "]" * 5_000: "nested too deeply",
    "x = " + "[" * 50 + "]" * 50: "nested too deeply",
    "\n".join(f"a{i} = 1" for i in range(20_000)): "more than 2000 keys",
    "x = [" + "1," * 100_000 + "]": "unknown key",
    "x = " + "9" * 5_000: "thousands of digits",
    "a" * 100_000 + " = 1": "unknown key",
    " " * 1_000_000: "empty",
    '"' * 100_000: "not valid TOML",
    "#" + "x" * 3_000_000: "at most 3 MB",
}


@pytest.mark.parametrize("text", TEXTS, ids=lambda text: text[:12])
def test_files_that_are_no_scenes(tmp_path: Path, text: str) -> None:
    file = tmp_path / "scene.toml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=TEXTS[text]) as error:
        load_scene(file)
    assert len(str(error.value)) < 110_000


def test_a_long_value_is_shown_in_short() -> None:
    assert len(show([list(range(10**6))] * 10)) == 60
    assert len(show({str(k): {"a": [1] * 10**6} for k in range(10)})) == 60


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        (LOAD * 2000, "2001 loads; at most 64"),
        ("\n[solve]\nelements = 100000000\n", "at most 20000"),
        ("\n[solve]\nmesh = [100000, 100000]\n", "at most 20000"),
        ('\n[material]\nlaw = "ogden"\nconvention = "mu/alpha"\nalpha = ['
         + "1.0," * 1000 + "]\nmu = [" + '"1 Pa",' * 1000 + "]\n", "at most 16"),
        ('\n[electrodes]\nlayout = "list"\ntaxels = ['
         + '{ angle = "0 deg" },' * 5000 + "]\n", "at most 2000"),
        ('\n[electrodes]\nlayout = "roboskin"\nmodules = ['
         + '{ angle = "0 deg" },' * 500 + "]\n", "at most 200"),
    ],
)  # fmt: skip
def test_scenes_larger_than_any(tmp_path: Path, extra: str, message: str) -> None:
    file = tmp_path / "scene.toml"
    skin = SCENE.parent.parent / "skins" / "suas.toml"
    file.write_text(f'skin = "{skin}"\n{LOAD}{extra}')
    with pytest.raises(ConfigError, match=message):
        load_scene(file)


def written_log(path: Path, rows: list[str], taxels: int = 1) -> Path:
    names = ",".join(f"so_{k + 1}" for k in range(taxels))
    path.write_text("\n".join([f"t_host_s,t_device_s,seq,module,{names}", *rows, ""]))
    return path


def test_modules_that_no_skin_has_are_refused(tmp_path: Path) -> None:
    rows = [f"{i},{i},{i},{i},5" for i in range(20_000)]
    log = read_log(written_log(tmp_path / "a.csv", rows))
    with pytest.raises(ValueError, match="20000 different module numbers; at most 1024"):
        group_frames(log)


def test_frames_of_many_modules_take_the_room_of_their_rows(tmp_path: Path) -> None:
    """Dense, 40,000 frames of 1,000 modules with 8 taxels would take 2.4 GB."""
    rows = [f"{i},{i},{i},{i % 1000},1,2,3,4,5,6,7,{i % 100}" for i in range(40_000)]
    log = read_log(written_log(tmp_path / "a.csv", rows, taxels=8))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    frames = group_frames(log)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000  # kB
    assert len(frames) == 40_000
    so = frames.of_module(7)
    np.testing.assert_array_equal(np.flatnonzero(np.isfinite(so[:, 0])) % 1000, 7)
    np.testing.assert_array_equal(so[7::1000, 7], 7)


def test_logs_that_continue_each_other_in_a_circle(tmp_path: Path) -> None:
    for name, successor in (("a", "b"), ("b", "c"), ("c", "a"), ("own", "own")):
        file = written_log(tmp_path / f"{name}.csv", ["0,0,1,0,5"])
        file.write_text(file.read_text() + f"# continued_in: {successor}.csv\n")
    for name in ("a", "own"):
        with pytest.raises(ValueError, match="not an earlier part"):
            read_log(tmp_path / f"{name}.csv")


READERS = {
    "log": (read_log, "t_host_s,t_device_s,seq,module,so_1\n0,0,1,0,5\n0,0,2,0,"),
    "table": (read_csv_table, "time_s,force_N\n0,1\n1,"),
    "material": (
        lambda file: load_dataset("uniaxial", file),
        "stretch_1,nominal_stress_MPa\n1,0\n1.1,",
    ),
}


@pytest.mark.parametrize("quote", ["", '"'])
@pytest.mark.parametrize("reader", READERS)
def test_fields_of_200000_characters(reader: str, quote: str, tmp_path: Path) -> None:
    read, text = READERS[reader]
    file = tmp_path / "long.csv"
    file.write_text(f"{text}{quote}{'1' * 200_000}{quote}\n")
    if reader == "table":  # whose numbers are judged by whom they are for
        assert len(read(file).rows[-1][1][-1]) == 200_000
        return
    with pytest.raises(ValueError, match=r'line 3, column .*"1{40,80}"') as told:
        read(file)
    assert len(str(told.value)) < 300 + len(str(file))


def test_a_remark_of_200000_characters_is_no_obstacle(tmp_path: Path) -> None:
    remark = "x" * 200_000
    file = tmp_path / "long.csv"
    file.write_text(f"stretch_1,nominal_stress_MPa,note\n1,0,{remark}\n1.1,0.1,\n1.2,0.2,\n")
    np.testing.assert_array_equal(load_dataset("uniaxial", file).value, [0, 1e5, 2e5])


def test_many_parts_are_read_as_one(tmp_path: Path) -> None:
    for part in range(1500):  # more than calls may be nested
        file = written_log(tmp_path / f"{part}.csv", [f"{part},{part},{part},0,5"])
        if part < 1499:
            file.write_text(file.read_text() + f"# continued_in: {part + 1}.csv\n")
    np.testing.assert_array_equal(read_log(tmp_path / "0.csv").seq, np.arange(1500))


@pytest.mark.parametrize(
    ("numbers", "note"),
    [
        ([1, 2, 3, 3, 4], "1 rows repeat the frame number"),
        ([1, 2, 3, 2, 1], "2 rows go back in frame numbers"),
        ([5, 4, 3, 2, 1], "4 rows go back in frame numbers"),
        ([253, 254, 255, 0, 1], None),  # a counter of 8 bits
        ([65534, 65535, 1, 2, 3], None),  # of 16 bits, one frame lost
        ([1, 2, 5, 9, 20], None),
    ],
)
def test_odd_frame_numbers_are_told(
    tmp_path: Path, numbers: list[int], note: str | None
) -> None:
    rows = [f"{i},{i},{n},0,5" for i, n in enumerate(numbers)]
    notes = sequence_notes(read_log(written_log(tmp_path / "a.csv", rows)))
    assert len(notes) == (note is not None)
    assert note is None or note in notes[0]


@pytest.mark.parametrize("clock", ["t_host_s", "t_device_s"])
def test_a_clock_that_goes_back_is_told(tmp_path: Path, clock: str) -> None:
    set_back = [0.0, 1.0, 2.0, 1.5, 2.5, 0.5]
    times = {"t_host_s": range(6), "t_device_s": range(6), clock: set_back}
    columns = zip(times["t_host_s"], times["t_device_s"], strict=True)
    rows = [f"{host},{device},{i},0,5" for i, (host, device) in enumerate(columns)]
    (note,) = sequence_notes(read_log(written_log(tmp_path / "a.csv", rows)))
    assert f"{clock} goes back, 2 times, first to 1.5 s (row 4)" in note


def test_rates_and_points_are_bounded(tmp_path: Path) -> None:
    program = f"""
import resource, sys
from typer.testing import CliRunner
from fitting.cli.app import app
resource.setrlimit(resource.RLIMIT_CPU, (30, 30))
scene, out = {str(SCENE)!r}, {str(tmp_path / "out.csv")!r}
for arguments in (
    ["sweep", scene, "--force", "0:1:1000000000"],
    ["sweep", scene, "--oil-pressure", "0:1:99999999999999999999"],
    ["simulate", scene, "-o", out, "--rate", "1e300"],
    ["simulate", scene, "-o", out, "--rate", "1e12"],
    ["simulate", scene, "-o", out, "--rate", "nan"],
    ["simulate", scene, "-o", out, "--duration", "inf"],
    ["solve", scene, "--repeat", "1000000000"],
):
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2, (arguments, result.output, result.exception)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
