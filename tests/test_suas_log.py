"""`suas log` end to end: a simulated device on a pseudo-terminal, the program beside it."""

import contextlib
import fcntl
import itertools
import json
import os
import resource
import signal
import socket
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from suas_jax.acquisition.device.device import Device, log_readings
from suas_jax.acquisition.device.faults import Faults, parse_faults
from suas_jax.acquisition.frames.reading import Reading
from suas_jax.acquisition.frames.registry import ENCODERS, FORMATS, decoder
from suas_jax.acquisition.log.log_file import (
    LogWriter,
    SoLog,
    group_frames,
    log_header,
    read_log,
    sequence_notes,
)
from suas_jax.acquisition.log.record import FLAG_COLUMNS, totals_text
from suas_jax.acquisition.log.record import record as record_stream
from suas_jax.acquisition.ports.serial_port import SerialSource
from suas_jax.acquisition.stream import Stream

ROOT = Path(__file__).parent.parent
SUAS = [sys.executable, "-c", "from fitting.cli.app import main; main()"]
MODULES = 8


def suas(*args: object, **options) -> subprocess.Popen:
    return subprocess.Popen(
        [*SUAS, *map(str, args)],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )


def counts(seq: int, module: int) -> tuple[int, ...]:
    return tuple(13000 + (7 * seq + 13 * k + module) % 997 for k in range(10))


def device_frames(last: int, rate: float = 100.0) -> Iterator[Reading]:
    for seq in range(last):
        for module in range(MODULES):
            yield Reading(seq, seq / rate, module, counts(seq, module))


def check(log: SoLog) -> set[tuple[int, int]]:
    """Every row holds what was sent; returns the rows by frame and module."""
    for seq, module, so in zip(log.seq.tolist(), log.module.tolist(), log.so, strict=True):
        np.testing.assert_array_equal(so, counts(seq, module))
    return set(zip(log.seq.tolist(), log.module.tolist(), strict=True))


def ended(process: subprocess.Popen) -> tuple[dict, str]:
    out, err = process.communicate(timeout=20)
    assert process.returncode == 0, err
    return json.loads(out), err


def record(tmp_path, name, faults=None, last=150, encoder=None):
    """Play frames, record them, end by SIGTERM; the log, the totals, what was played."""
    path = tmp_path / "log.csv"
    with Device(encoder or name, faults, tmp_path / "port") as device:
        process = suas("log", device.port, "--format", name, "-o", path, "--json")
        device.wait_for_host()
        played = device.play(device_frames(last))
        time.sleep(0.3)
        process.send_signal(signal.SIGTERM)
        totals, _ = ended(process)
    return read_log(path), totals, played


@pytest.mark.parametrize("name", ["text", "cobs", "roboskin"])
def test_nothing_is_lost(name, tmp_path):
    if name == "roboskin":
        pytest.importorskip("can")
    log, totals, played = record(tmp_path, name)
    assert played.rows == len(log) == totals["rows"] == 150 * MODULES
    assert totals["lost_frames"] == totals["malformed"] == totals["bad_crc"] == 0
    assert totals["modules"] == list(range(MODULES))
    assert log.header["format"] == "suas-so-log"
    assert np.all(np.diff(log.t_host) >= 0)
    if name == "roboskin":
        first = group_frames(log).of_module(0)[0]
        np.testing.assert_array_equal(first, [255 - c // 256 for c in counts(0, 0)])
    else:
        assert len(check(log)) == len(log)
        np.testing.assert_allclose(log.t_device, log.seq / 100, atol=1e-9)


@pytest.mark.parametrize(("name", "encoder"), [("cobs", "cobs"), ("text", "text-checked")])
def test_corruption_is_counted_and_never_accepted(name, encoder, tmp_path):
    faults = Faults(corrupt=0.01, drop=0.01, duplicate=0.01, seed=5)
    log, totals, played = record(tmp_path, name, faults, encoder=encoder)
    check(log)
    assert len(log) == played.rows - played.damaged
    assert totals["duplicates"] == log.flags["duplicate"].sum() > 0
    sent = 150 * MODULES
    present = int((log.flags["duplicate"] == 0).sum())
    last = {module: log.seq[log.module == module].max() for module in range(MODULES)}
    tail = sum(149 - seq for seq in last.values())  # nothing came after these
    first = sum(log.seq[log.module == module].min() for module in range(MODULES))
    assert totals["lost_frames"] + tail + first == sent - present


def test_unplugged_wrapped_and_stuck(tmp_path):
    faults = parse_faults(["unplug=1.0:0.5", "clock-wrap=2.0", "stuck=2/3"])
    log, totals, played = record(tmp_path, "cobs", faults, last=300)
    assert totals["reconnects"] == 1
    assert len(log) == played.rows - played.stalled
    gap = np.diff(log.t_host).max()
    assert 0.4 < gap < 2.5
    assert totals["lost_frames"] == played.stalled
    start = log.t_device[0] - log.seq[0] / 100
    np.testing.assert_allclose(log.t_device - start, log.seq / 100, atol=1e-6)
    assert totals["stuck_taxels"] == {"2": [3]}
    assert totals["restarts"] == 0


SINGLE = [  # fault, what the totals say, what is said meanwhile
    ("clock-jump=0.5:10", {"clock_jumps": 1}, "clock jumped at frame 50"),
    ("clock-jump=0.5:-10", {"clock_jumps": 1}, "clock jumped at frame 50"),
    ("clock-jump=0.5:10:0.4", {"clock_jumps": 2}, "clock jumped at frame 90"),
    ("restart=0.5", {"restarts": MODULES}, "device restarts"),
    ("taxels=0.5:7", {"other_taxels_rows": 100 * MODULES}, "sends 7 counts instead of 10"),
]


@pytest.mark.parametrize(("fault", "totals", "sentence"), SINGLE)
def test_what_changes_is_flagged_counted_and_said(fault, totals, sentence, tmp_path):
    """The table of docs/log_format.md, in process: one pseudo-terminal, no program's start."""
    path, said = tmp_path / "log.csv", []
    with Device("cobs", parse_faults([fault]), tmp_path / "port") as device:
        stream = Stream(
            SerialSource(device.port, 115200), decoder("cobs"), "cobs", report=said.append
        )

        def play() -> None:
            device.play(device_frames(150), speed=3.0)
            time.sleep(0.5)  # for the last bytes to be read

        played = threading.Thread(target=play)
        played.start()
        found = record_stream(
            stream,
            LogWriter(path, log_header(), flags=FLAG_COLUMNS),
            on_progress=lambda: played.is_alive() or stream.stop.set(),
        )
        played.join()
    log = read_log(path)
    assert len(log) == found["rows"] == 150 * MODULES  # nothing is lost
    assert {key: found[key] for key in totals} == totals
    assert sentence in " ".join([*said, totals_text(found)])
    raw = log.flags["t_device_raw_s"].astype(float)
    frames = group_frames(log)
    if fault.startswith("clock"):
        np.testing.assert_allclose(log.t_device, log.seq / 100, atol=2e-6)
        by = float(fault.split(":")[1])
        modulus = 2**32 * 1e-6  # at which the frame's clock of 32 bits wraps
        assert np.ptp(raw - log.t_device) == pytest.approx(by % modulus, abs=1e-5)
        assert set(log.seq[log.flags["clock_jump"] == 1]) <= {50, 90}
    elif fault.startswith("taxels"):
        assert len(frames) == 50  # the others can't be placed, and are not used
        assert set(log.flags["other_taxels"][log.seq >= 50]) == {7}
        assert "came with 7 counts" in " ".join(sequence_notes(log))
    else:
        assert len(frames) == 150
        np.testing.assert_array_equal(raw, log.t_device)


def test_a_full_disk_is_named_with_the_totals(tmp_path):
    path = tmp_path / "log.csv"
    with Device("cobs", link=tmp_path / "port") as device:
        process = suas("log", device.port, "--format", "cobs", "-o", path, "--json")
        device.wait_for_host()
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (20_000, 20_000))
        device.play(device_frames(150), stopped=lambda: process.poll() is not None)
        out, err = process.communicate(timeout=20)
    assert process.returncode == 2
    totals = json.loads(out)
    assert f"{path}: File too large" in err
    assert totals["status"] == "disk_full"
    assert "--append" in totals["message"]
    log = read_log(path)
    assert not log.notes
    assert len(log) == totals["rows"] - totals["unwritten_rows"] > 100
    check(log)


def test_a_log_that_goes_on_and_a_second_logger(tmp_path):
    """Killed, then gone on with: what was recorded stays, the gap is flagged."""
    path = tmp_path / "log.csv"
    command = ("log", tmp_path / "port", "--format", "cobs", "-o", path, "--append")
    with Device("cobs", link=tmp_path / "port") as device:
        process = suas(*command, "--flush", 0.05)
        device.wait_for_host()
        device.play(device_frames(60))
        second = suas(*command)
        assert f"process {process.pid} is writing it" in second.communicate(timeout=20)[1]
        assert second.returncode == 2
        process.kill()
        process.communicate()
        kept = len(read_log(path))
        with path.open("ab") as file:
            file.write(b"0.9,0.9,99,0,13")  # a row that the kill cut off
        process = suas(*command, "--json")
        device.wait_for_host()
        device.play(r for r in device_frames(120) if r.seq >= 60)
        time.sleep(0.3)
        process.send_signal(signal.SIGTERM)
        _, err = ended(process)
    assert "cut off" in err
    log = read_log(path)
    assert len(log) == kept + 60 * MODULES
    restarts = np.flatnonzero(log.flags["restart"])
    assert restarts.tolist() == list(range(kept, kept + MODULES))
    assert np.all(np.diff(log.t_host) >= 0)
    check(log)


def test_a_log_that_is_replaced_while_it_is_recorded(tmp_path):
    """By a second logger, which is refused; by another program, which can't be."""
    path = tmp_path / "log.csv"
    with Device("cobs", link=tmp_path / "port") as device, Device("cobs") as spare:
        process = suas("log", device.port, "--format", "cobs", "-o", path, "--json")
        device.wait_for_host()
        device.play(device_frames(30))
        second = suas("log", spare.port, "--format", "cobs", "-o", path, "--overwrite")
        assert f"process {process.pid} is writing it" in second.communicate(timeout=20)[1]
        assert second.returncode == 2
        (tmp_path / "other").write_text("another program's")
        os.replace(tmp_path / "other", path)
        device.play(r for r in device_frames(60) if r.seq >= 30)
        time.sleep(0.3)
        process.send_signal(signal.SIGTERM)
        out, err = process.communicate(timeout=20)
    beside = tmp_path / "log.beside1.csv"
    assert process.returncode == 2
    totals = json.loads(out)
    assert (totals["status"], totals["beside"]) == ("file_lost", [str(beside)])
    assert f"{path}: was replaced by another file" in err
    assert str(beside) in totals["message"]
    assert path.read_text() == "another program's"
    log = read_log(beside)
    assert check(log) == {(seq, module) for seq in range(60) for module in range(MODULES)}


def test_a_plain_program_on_the_other_end(tmp_path):
    """No device of ours: an open pseudo-terminal in its initial mode, lines, --duration."""
    master, slave = os.openpty()
    path = tmp_path / "log.csv"
    process = suas(
        "log", os.ttyname(slave), "--format", "text", "--baud", 9600, "-o", path,
        "--duration", 2, "--json",
    )  # fmt: skip
    time.sleep(0.8)
    for seq in range(50):
        for module, taxels in ((0, 10), (3, 4)):
            so = ",".join(map(str, counts(seq, module)[:taxels]))
            os.write(master, f"{seq},{seq / 100},{module},{so}\r\n".encode())
        time.sleep(0.01)
    totals, _ = ended(process)
    os.close(master)
    os.close(slave)
    log = read_log(path)
    assert 1.9 < totals["elapsed_s"] < 4
    frames = group_frames(log)
    assert frames.modules.tolist() == [0, 3]
    for seq in range(50):
        np.testing.assert_array_equal(frames.of_module(0)[seq], counts(seq, 0))
        expected = [*map(float, counts(seq, 3)[:4]), *[np.nan] * 6]
        np.testing.assert_array_equal(frames.of_module(1)[seq], expected)


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGKILL])
def test_interrupted_and_killed(end, tmp_path):
    path = tmp_path / "log.csv"
    with Device("text", link=tmp_path / "port") as device:
        process = suas("log", device.port, "--format", "text", "-o", path, "--flush", 0.1)
        device.wait_for_host()
        device.play(device_frames(120))
        played = device.played.rows
        if end == signal.SIGINT:
            time.sleep(0.3)
        process.send_signal(end)
        process.communicate(timeout=10)
    log = read_log(path)
    sent = check(log)
    assert process.returncode == (0 if end == signal.SIGINT else -signal.SIGKILL)
    # Killed: the last flush, 0.1 s, at 800 rows a second; generous on a busy machine.
    assert len(sent) >= (played if end == signal.SIGINT else played - 400)
    assert sent == {(i // MODULES, i % MODULES) for i in range(len(sent))}


def test_over_the_network(tmp_path):
    server = socket.create_server(("127.0.0.1", 0))
    path = tmp_path / "log.csv"
    url = f"socket://127.0.0.1:{server.getsockname()[1]}"
    process = suas("log", url, "--format", "cobs", "-o", path, "--duration", 1.5, "--json")
    client, _ = server.accept()
    sent = list(device_frames(40))
    client.sendall(b"".join(map(ENCODERS["cobs"], sent)))
    totals, _ = ended(process)
    client.close()
    server.close()
    assert len(check(read_log(path))) == totals["rows"] == len(sent)


# format asked for, what the device sends, what the message must say
TROUBLES = [
    ("text", lambda n: b"", ["silent", "powered"]),
    ("text", lambda n: ENCODERS["cobs"](Reading(n, 0.0, 0, (1, 2))), ["--format cobs"]),
    ("cobs", lambda n: b"%d,0.0,0,1,2\n" % n, ["--format text"]),
    ("text", lambda n: bytes((n * k * 89 + 131) % 256 for k in range(20)), ["--baud"]),
    ("text", lambda n: b"T=%d C\n" % n, ["T=", "seq,t_device_s,module"]),
    ("text", lambda n: b"t300840FAF9F8F7F6F5F4\r", ["--format roboskin"]),
]


def test_what_is_wrong_is_named(tmp_path):
    """Silence, another format, another baud rate; all ports at once, to save time."""
    ports = [os.openpty() for _ in TROUBLES]
    for master, slave in ports:
        tty.setraw(slave)
        os.set_blocking(master, False)
    loggers = [
        suas("log", os.ttyname(slave), "--format", name, "-o", tmp_path / f"{slave}.csv",
             "--duration", 2.5)
        for (name, _, _), (_, slave) in zip(TROUBLES, ports, strict=True)
    ]  # fmt: skip
    done = threading.Event()

    def send() -> None:
        n = 0
        while not done.wait(0.02):
            n += 1
            for (_, data, _), (master, _) in zip(TROUBLES, ports, strict=True):
                with contextlib.suppress(BlockingIOError):
                    os.write(master, data(n))

    sender = threading.Thread(target=send)
    sender.start()
    try:
        messages = [logger.communicate(timeout=30)[1] for logger in loggers]
    finally:
        done.set()
        sender.join()
    for descriptor in itertools.chain(*ports):
        os.close(descriptor)
    assert [logger.returncode for logger in loggers] == [2] * len(TROUBLES)
    for (_, _, words), message in zip(TROUBLES, messages, strict=True):
        for word in words:
            assert word in message


def test_a_busy_port_is_named(tmp_path):
    master, slave = os.openpty()
    fcntl.flock(slave, fcntl.LOCK_EX)
    process = suas("log", os.ttyname(slave), "--format", "text", "-o", tmp_path / "log.csv")
    _, err = process.communicate(timeout=10)
    os.close(master)
    os.close(slave)
    assert process.returncode == 2
    assert "busy" in err
    assert not (tmp_path / "log.csv").exists()


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["/dev/ttyNOPE", "--format", "text"], ["/dev/ttyNOPE", "no such port"]),
        (["/etc/hosts", "--format", "text"], ["not a serial port"]),
        (["/dev/null", "--format", "morse"], ["morse", ", ".join(FORMATS)]),
        (["socket://127.0.0.1:9", "--format", "text"], ["can't connect"]),
        (["0000:0000:X", "--format", "text"], ["no such USB device"]),
    ],
)
def test_a_port_that_can_not_be_opened_is_named(args, words, tmp_path, capsys):
    from fitting.cli.log import log

    with pytest.raises(BaseException) as error:  # noqa: PT011 - typer's own exit
        log(args[0], tmp_path / "log.csv", args[2])
    assert getattr(error.value, "exit_code", None) == 2
    message = capsys.readouterr().err
    for word in words:
        assert word in message
    assert not (tmp_path / "log.csv").exists()


def test_the_logger_imports_no_jax():
    program = (
        "import sys, fitting.cli.commands\n"
        "import suas_jax.acquisition.log.record, suas_jax.acquisition.frames.registry\n"
        "import suas_jax.acquisition.log.record\n"
        "import suas_jax.config\n"
        "print([m for m in sys.modules if m.split('.')[0] in ('jax', 'equinox', 'scipy')])"
    )
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    out = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, env=environment
    )
    assert out.stdout.strip() == "[]", out.stderr


def test_a_log_played_again_is_the_same_log(tmp_path):
    log, _, _ = record(tmp_path, "text", last=50)
    link = tmp_path / "again"
    player = suas("simulate", log.path, "--live", "--port", link, "--format", "cobs", "--json")
    assert player.stdout
    assert json.loads(player.stdout.readline())["port"] == str(link)
    copy = tmp_path / "copy.csv"
    logger = suas("log", link, "--format", "cobs", "-o", copy, "--duration", 2)
    ended(player)
    logger.communicate(timeout=10)
    again = read_log(copy)
    np.testing.assert_array_equal(again.so, log.so)
    np.testing.assert_allclose(again.t_device, log.t_device, atol=1e-6)
    assert len(list(log_readings(log))) == len(log)


@pytest.mark.parametrize("text", ["corrupt=2", "corrupt=x", "melt=1", "stuck=3", "unplug="])
def test_a_fault_that_is_none_is_named(text):
    with pytest.raises(ValueError, match=r"fault|corrupt"):
        parse_faults([text])


@pytest.mark.long  # a process compiles its scene; simulate in test_simulate
def test_a_scene_played_live(tmp_path):
    from test_baseline import LOAD, SCENE

    scene, link, truth = (tmp_path / name for name in ("scene.toml", "port", "truth.csv"))
    scene.write_text(SCENE + LOAD)
    player = suas(
        "simulate", scene, "--live", "-o", truth, "--rate", 50, "--duration", 1,
        "--port", link, "--json",
    )  # fmt: skip
    assert player.stdout
    player.stdout.readline()  # the port is there
    path = tmp_path / "log.csv"
    logger = suas("log", link, "--format", "text", "-o", path, "--duration", 5)
    totals, _ = ended(player)
    logger.communicate(timeout=10)
    np.testing.assert_array_equal(read_log(path).so, read_log(truth).so)
    assert totals["rows"] == 50
