"""The SO log: what is written reads back; what is broken is named or dropped, never guessed."""

import math
import os
import resource
import signal
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from suas_jax.acquisition.log.log_file import (
    LineWriteError,
    LogFileError,
    LogWriter,
    group_frames,
    log_header,
    read_log,
)

COLUMNS = "t_host_s,t_device_s,seq,module,so_1,so_2"
ROWS = [
    "0.01,0.010,0,0,13675,13680",
    "0.01,0.010,0,1,14000,14001",
    "0.02,0.020,1,0,13676,13681",
    "0.02,0.020,1,1,14002,14003",
]


def write(path: Path, text: str | bytes) -> Path:
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def log_text(rows: list[str], columns: str = COLUMNS) -> str:
    return "# skin: a.toml\n" + "\n".join([columns, *rows]) + "\n"


counts = st.one_of(st.none(), st.integers(0, 65535))
row = st.tuples(
    st.floats(0, 1e6),
    st.one_of(st.just(math.nan), st.floats(0, 1e9)),
    st.integers(0, 2**32),
    st.integers(0, 31),
    st.lists(counts, min_size=1, max_size=3),
    st.tuples(st.integers(0, 9)),
)


@settings(max_examples=60, deadline=None)
@given(rows=st.lists(row, max_size=12))
def test_what_is_written_reads_back(rows, tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "a.csv"
    with LogWriter(path, log_header(skin="a: b.toml"), taxels=3, flags=("lost",)) as log:
        for each in rows:
            log.write(*each)
    back = read_log(path)
    assert back.header["skin"] == "a: b.toml"
    assert len(back) == len(rows)
    for i, (t_host, t_device, seq, module, so, flags) in enumerate(rows):
        assert back.t_host[i] == pytest.approx(t_host, abs=1e-6)
        np.testing.assert_equal(back.t_device[i], t_device)
        assert (back.seq[i], back.module[i]) == (seq, module)
        expected = [math.nan if c is None else c for c in so] + [math.nan] * (3 - len(so))
        np.testing.assert_equal(back.so[i], expected)
        assert back.flags["lost"][i] == flags[0]


@settings(max_examples=200, deadline=None)
@given(cut=st.integers(0, 2000))
def test_cut_at_any_byte_loses_the_last_line_only(cut, tmp_path_factory):
    text = log_text(ROWS).encode()
    cut %= len(text) + 1
    head = text[:cut]
    path = write(tmp_path_factory.mktemp("log") / "a.csv", head)
    whole_lines = head.count(b"\n")
    if whole_lines < 2:
        with pytest.raises(LogFileError, match="no line of column names"):
            read_log(path)
        return
    back = read_log(path)
    # The line that was cut may survive only if it is the true one, whole.
    complete = len(back) - (whole_lines - 2)
    assert complete in (0, 1)
    for i in range(len(back)):
        assert [*back.so[i]] == [float(x) for x in ROWS[i].split(",")[4:]]
    if complete:
        assert head.endswith(ROWS[len(back) - 1].encode())


def test_other_hands(tmp_path):
    text = (
        "\ufeff# made by: something else\r\n\r\n"
        "module,seq,so_2,so_1,t_host_s,t_device_s,room\r\n"
        "# a remark\r\n0,7,,13675.5,0.5,,warm\r\n"
        "module,seq,so_2,so_1,t_host_s,t_device_s,room\r\n"
        '1,7,nan,"2",0.5,1e-3,cold\r\n'
    )
    log = read_log(write(tmp_path / "a.csv", text))
    assert log.header == {"made by": "something else"}
    np.testing.assert_equal(log.so, [[13675.5, math.nan], [2.0, math.nan]])
    np.testing.assert_equal(log.t_device, [math.nan, 1e-3])
    assert log.flags["room"].tolist() == ["warm", "cold"]


def test_an_empty_cell_is_no_zero_but_in_the_recorder_s_own_flags(tmp_path):
    rows = ["0.01,0.010,0,0,13675,13680,,4", "0.02,0.020,1,0,13675,13680,1,"]
    text = log_text(rows, f"{COLUMNS},lost,load_0_force_N")
    flags = read_log(write(tmp_path / "a.csv", text)).flags
    assert flags["lost"].tolist() == [0, 1]
    assert flags["load_0_force_N"].tolist() == ["4", ""]


def test_what_a_second_header_in_the_file_says_otherwise_is_kept(tmp_path):
    text = log_text(ROWS) + log_text(ROWS).replace("a.toml", "b.toml")
    log = read_log(write(tmp_path / "a.csv", text))
    assert log.header == {"skin": "a.toml"}
    assert log.restated == {"skin": "b.toml"}


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("0.03,0.03,2,0,13x75,1", ["line 7", "column so_1", '"13x75"']),
        ("0.03,0.03,2,0,1,70000", ["line 7", "column so_2", "65535"]),
        ("0.03,0.03,2,0,-1,1", ["line 7", "column so_1", "0 to 65535"]),
        ("0.03,0.03,2,0,inf,1", ["line 7", "column so_1"]),
        ("0.03,0.03,2,0,1_0,1", ["line 7", "column so_1"]),
        ("0.03,0.03,2.5,0,1,1", ["line 7", "column seq", "whole number"]),
        ("0.03,0.03,,0,1,1", ["line 7", "column seq"]),
        ("0.03,0.03,2,-1,1,1", ["line 7", "column module"]),
        ("later,0.03,2,0,1,1", ["line 7", "column t_host_s"]),
        ("0.03,0.03,2,0,1", ["line 7", "ends before column so_2"]),
        ("0.03,0.03,2,0,1,1,1", ["line 7", "after the last column, so_2"]),
        ("0.03,0.03,2,0,\0,1", ["line 7", "zero bytes"]),
    ],
)
def test_a_malformed_row_is_named(row, words, tmp_path):
    path = write(tmp_path / "a.csv", log_text([*ROWS, row, *ROWS]))
    with pytest.raises(LogFileError) as error:
        read_log(path)
    for word in ["a.csv", *words]:
        assert word in str(error.value)


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ("t_host_s,seq,module,so_1", "no column t_device_s"),
        ("t_host_s,t_device_s,seq,module", "so_1, so_2"),
        ("t_host_s,t_device_s,seq,module,so_1,so_3", "without a hole"),
        ("t_host_s,t_device_s,seq,module,so_1,so_1", "named twice: so_1"),
        ("t_host_s;t_device_s;seq;module;so_1", "put commas between fields"),
    ],
)
def test_wrong_columns_are_named(columns, words, tmp_path):
    with pytest.raises(LogFileError, match="line 2") as error:
        read_log(write(tmp_path / "a.csv", log_text([], columns)))
    assert words in str(error.value)


def test_binary_is_no_log(tmp_path):
    with pytest.raises(LogFileError, match="not UTF-8"):
        read_log(write(tmp_path / "a.csv", b"\x89PNG\n\xff\xfe\n"))


def test_zero_bytes_after_a_power_cut(tmp_path):
    log = read_log(write(tmp_path / "a.csv", log_text(ROWS).encode() + b"\0" * 512))
    assert len(log) == 4
    assert "512 zero bytes" in log.notes[0]


def test_an_existing_log_is_not_overwritten_unasked(tmp_path):
    path = write(tmp_path / "a.csv", log_text(ROWS))
    with pytest.raises(FileExistsError, match="--overwrite"):
        LogWriter(path, log_header())
    assert len(read_log(path)) == 4
    with LogWriter(path, log_header(), overwrite=True):
        pass
    assert len(read_log(path)) == 0


def test_rotation_reads_back_as_one_log(tmp_path):
    path = tmp_path / "a.csv"
    write(tmp_path / "a.part2.csv", "somebody else's file\n")
    with LogWriter(path, log_header(), taxels=2, rotate_bytes=600, flush_interval=0.0) as log:
        for i in range(40):
            log.write(0.01 * i, 0.01 * i, i, 0, [i, i])
        log.widen(3)
        log.write(0.5, 0.5, 40, 0, [40, 40, 40])
    assert len(list(tmp_path.iterdir())) > 4
    back = read_log(path)
    assert back.seq.tolist() == list(range(41))
    np.testing.assert_equal(back.so[:, 2], [math.nan] * 40 + [40])
    assert len(read_log(path, follow=False)) < 41


def test_frames():
    """Interleaved buses, a missing module, a duplicate, a counter that starts again."""
    rows = [
        (0, 0, 0), (0, 1, 0), (1, 0, 0), (0, 2, 0), (1, 2, 0), (1, 0, 1),
        (0, 0, 0), (0, 1, 0), (0, 2, 0),
    ]  # fmt: skip
    seq, module, duplicate = np.array(rows).T
    from suas_jax.acquisition.log.log_file import SoLog

    so = np.arange(9.0)[:, None]
    log = SoLog(Path("a"), {}, so[:, 0], so[:, 0], seq, module, so, {"duplicate": duplicate})
    frames = group_frames(log)
    assert frames.seq.tolist() == [0, 1, 0]
    assert frames.modules.tolist() == [0, 1, 2]
    expected = [[0, 1, 3], [2, math.nan, 4], [6, 7, 8]]
    found = np.stack([frames.of_module(k)[:, 0] for k in range(3)], 1)
    np.testing.assert_equal(found, expected)
    assert frames.t_host.tolist() == [0, 2, 6]


def test_a_killed_writer_loses_at_most_the_last_flush(tmp_path):
    path = tmp_path / "a.csv"
    program = (
        "import sys, time; from pathlib import Path\n"
        "from suas_jax.acquisition.log.log_file import *\n"
        "log = LogWriter(Path(sys.argv[1]), log_header(), taxels=10, flush_interval=0.05)\n"
        "i = 0\n"
        "while True:\n"
        "    log.write(i * 1e-3, i * 1e-3, i, 0, [i % 65536] * 10)\n"
        "    print(i, flush=True); i += 1; time.sleep(1e-3)\n"
    )
    writer = subprocess.Popen(
        [sys.executable, "-c", program, str(path)],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parent.parent)},
    )
    assert writer.stdout
    for line in writer.stdout:
        if int(line) == 400:
            break
    writer.send_signal(signal.SIGKILL)
    writer.wait()
    last = int(line)
    writer.stdout.close()
    back = read_log(path)
    assert back.notes == ()
    assert back.seq.tolist() == list(range(len(back)))
    # 0.05 s at under 1000 rows a second, doubled for a busy machine.
    assert len(back) > last - 100


def recorded(path: Path, rows: range, **options) -> LogWriter:
    """Append rows of two taxels at 100 Hz."""
    header = log_header(start_time=datetime(2025, 11, 21, tzinfo=UTC), frame_format="cobs")
    with LogWriter(path, header, flags=("lost",), append=True, **options) as log:
        for k in rows:
            log.write(log.elapsed + 0.01 * k, 0.01 * k, k, 0, (k, 2 * k), (0,))
    return log


def test_a_recording_goes_on_in_the_same_file(tmp_path):
    path = tmp_path / "a.csv"
    first = recorded(path, range(5))
    assert not first.resumed
    before = path.read_bytes()
    second = recorded(path, range(3))
    assert second.resumed
    assert path.read_bytes().startswith(before)
    log = read_log(path)
    assert log.seq.tolist() == [0, 1, 2, 3, 4, 0, 1, 2]
    # Years lie between the header's start and now.
    assert log.t_host[5] > log.t_host[4] + 1e5
    assert len(group_frames(log)) == 8


def test_a_line_that_was_cut_off_is_taken_out_when_a_recording_goes_on(tmp_path):
    path = tmp_path / "a.csv"
    recorded(path, range(5))
    with path.open("ab") as file:
        file.write(b"0.07,0.07,7,0,1")
    log = recorded(path, range(8, 10))
    assert "0.07,0.07,7,0,1" in log.notes[0]
    assert read_log(path).seq.tolist() == [0, 1, 2, 3, 4, 8, 9]


def test_a_recording_goes_on_behind_the_last_part(tmp_path):
    path = tmp_path / "a.csv"
    recorded(path, range(40), rotate_bytes=400, flush_interval=0.0)
    parts = list(tmp_path.glob("a*.csv"))
    assert len(parts) > 2
    second = recorded(path, range(40, 80), rotate_bytes=400, flush_interval=0.0)
    assert second.path not in parts
    assert read_log(path).seq.tolist() == list(range(80))


def test_a_host_clock_that_was_set_back_does_not_turn_time(tmp_path):
    path = tmp_path / "a.csv"
    header = log_header(start_time=datetime(2199, 1, 1, tzinfo=UTC))
    for _ in range(2):
        with LogWriter(path, header, append=True) as log:
            log.write(log.elapsed + 5.0, 0.0, 1, 0, (1,))
    assert read_log(path).t_host.tolist() == [5.0, 10.0]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a,b\n1,2\n", "no SO log"),
        ("# start_time: now\nt_host_s,t_device_s,seq,module,so_1,lost\n", "start_time"),
        (
            "# start_time: 2025-11-21T00:00:00+00:00\nt_host_s,t_device_s,seq,module,so_1\n",
            "lost",
        ),
        (
            "# start_time: 2025-11-21T00:00:00+00:00\n# scale: 1 fF\n"
            "t_host_s,t_device_s,seq,module,so_1,lost\n",
            "scale is 1 fF",
        ),
        (
            "# start_time: 2025-11-21T00:00:00+00:00\n"
            "t_host_s,t_device_s,seq,module,so_1,lost\n# continued_in: gone.csv\n",
            "gone.csv",
        ),
    ],
)
def test_what_can_not_be_appended_to_is_left_alone(text, words, tmp_path):
    path = write(tmp_path / "a.csv", text)
    with pytest.raises(LogFileError, match=words):
        recorded(path, range(3))
    assert path.read_text() == text


def test_two_programs_never_write_one_log(tmp_path):
    path = tmp_path / "a.csv"
    header = log_header()
    with LogWriter(path, header, taxels=1) as log:
        with pytest.raises(OSError, match=f"process {os.getpid()} is writing"):
            LogWriter(path, header, append=True)
        log.write(0.0, 0.0, 1, 0, (1,))
    assert len(read_log(path)) == 1


@pytest.mark.parametrize("limit", [1000, 1005, 1017])
def test_a_full_disk_ends_with_a_whole_row(limit, tmp_path):
    """A limit on the file's size stands for a full disk."""
    path = tmp_path / "a.csv"
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    log = LogWriter(path, log_header(), taxels=2, flush_interval=10.0)
    for k in range(100):
        log.write(0.01 * k, 0.01 * k, k, 0, (k, 2 * k))
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limits[1]))
    try:
        with pytest.raises(LineWriteError) as error:
            log.flush()
        log.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert error.value.filename == str(path)
    back = read_log(path)
    assert not back.notes
    assert len(back) == 100 - log.unwritten > 10
    assert path.stat().st_size <= limit
