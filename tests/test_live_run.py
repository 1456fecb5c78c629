"""A live run from a simulated device: recorded, sent on, and through lost links."""

import contextlib
import json
import shutil
import socket
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_recording import recorded
from typer.testing import CliRunner

from fitting.cli.app import app
from fitting.inverse_load.estimate.estimate import Contact, LoadEstimate
from fitting.inverse_load.estimate.place import ContactPlaces
from fitting.inverse_load.live.run import LiveOptions, run_live
from fitting.inverse_load.live.serve import LineServer, host_and_port
from fitting.inverse_load.live.stream import LiveFrame, LiveWatcher, live_frames
from fitting.robotics.recording import LiveRecording, Recording
from suas_jax.acquisition.device.device import Device, repeated
from suas_jax.acquisition.device.faults import Faults
from suas_jax.acquisition.frames.reading import Reading
from suas_jax.acquisition.integrity import Flags
from suas_jax.acquisition.log.log_file import read_log
from suas_jax.acquisition.stream import Judged, Stream
from suas_jax.config import load_skin
from suas_jax.skin.plain import plain_geometry

SKIN = Path(__file__).parent.parent / "configs" / "skins" / "suas.toml"
TAXELS = 8
FRAMES, RATE = 60, 50.0
COUNTS = [tuple(150 + (seq + 3 * k) % 17 for k in range(TAXELS)) for seq in range(FRAMES)]


def device_frames() -> Iterator[Reading]:
    for seq in range(FRAMES):
        yield Reading(
            seq, seq / RATE, 0, tuple(150 + (seq + 3 * k) % 17 for k in range(TAXELS))
        )


class KnownLoads:
    """Stands for an estimator: the force is a tenth of the first reading."""

    def __init__(self) -> None:
        self.spec = load_skin(SKIN)
        self.along = ContactPlaces.of(self.spec.geometry, plain_geometry(self.spec.geometry))
        self.reading_noise, self.taxels, self.rest = 2.0, TAXELS, None
        self.input_errors = SimpleNamespace(text="")
        self.false_alarm, self.model_error, self.most_contacts = 0.01, 0.0025, 3

    def warm_up(self) -> None:
        """Nothing to compile."""

    def estimate(
        self, so: np.ndarray, stuck: np.ndarray, *, time: np.ndarray | None = None
    ) -> list[LoadEstimate]:
        """One contact."""
        contact = Contact(0.3, float(so[0, 0]) / 10, None, np.diag([1e-4, 1e-2]))
        return [LoadEstimate(True, (contact,), 500.0, False, 1.0, "ok")]


class Listening(LiveWatcher):
    """Tells when a run has begun to listen."""

    def __init__(self) -> None:
        self.begun = threading.Event()

    def waited(self, stream: Stream) -> None:
        """It listens."""
        self.begun.set()


def played(folder: Path, faults: Faults | None, watchers: list[Any]) -> Any:
    """Run live while a device plays all frames; the log that was recorded."""
    log, told, listening = folder / "run.csv", [], Listening()
    with Device("cobs", faults, folder / "port") as device:

        def play() -> None:
            device.wait_for_host()
            listening.begun.wait()  # what comes before is of unknown age, and forgotten
            told.append(device.play(device_frames()))

        player = threading.Thread(target=play)
        player.start()
        options = LiveOptions(
            device.port,
            "cobs",
            duration=FRAMES / RATE + 2.0,
            latency=5.0,
            log=log,
            as_json=True,
        )
        run_live(KnownLoads, options, lambda *_: [*watchers, listening])  # type: ignore[arg-type]
        player.join()
    return read_log(log), told[0]


def admitted(server: LineServer) -> socket.socket:
    """A connection that has shown the token."""
    client = socket.create_connection(server.address)
    client.sendall(f"{server.token}\n".encode())
    return client


class Listener:
    """A program that reads what is served, until there is no more."""

    def __init__(self, server: LineServer) -> None:
        self._lines: list[dict[str, Any]] = []
        self._client = admitted(server)
        self._thread = threading.Thread(target=self._listen)
        self._thread.start()

    def _listen(self) -> None:
        with self._client, self._client.makefile() as stream:
            self._lines.extend(json.loads(line) for line in stream)

    def ended(self) -> list[dict[str, Any]]:
        """What it has read."""
        self._thread.join(timeout=10)
        return self._lines


def test_a_live_run_is_recorded_and_sent_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "run.mcap"
    with (
        LineServer("127.0.0.1:0") as server,
        Recording(path, load_skin(SKIN), skin_file=SKIN) as recording,
    ):
        listener = Listener(server)
        log, _ = played(tmp_path, None, [LiveRecording(recording), server])
        assert not path.exists()  # until it is whole
    lines = listener.ended()
    printed = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line["seq"] for line in printed] == list(range(FRAMES))
    assert lines == printed
    assert len(log) == FRAMES
    messages, facts, _ = recorded(path)
    frames = messages["/suas/taxels"]
    assert [frame.sequence for _, frame in frames] == list(range(FRAMES))
    np.testing.assert_array_equal([frame.counts for _, frame in frames], log.so)
    forces = [told.wrench.force.z for _, told in messages["/suas/contact_0/wrench"]]
    np.testing.assert_allclose(forces, log.so[:, 0] / 10)
    # Stamps are the calendar's, at the pace of the frames.
    stamps = np.array([stamp for stamp, _ in frames]) * 1e-9
    assert abs(stamps[-1] - time.time()) < 60
    assert stamps[-1] - stamps[0] == pytest.approx((FRAMES - 1) / RATE, rel=0.2)
    assert "suas_skin" in facts["frames"]


class Busy:
    """A stream at 100 Hz, one frame a chunk, read on a machine that takes its time."""

    def __init__(
        self,
        pause: float,  # between two frames' estimates [s]
        count: int,  # number of frames
    ) -> None:
        self.now, self.taken, self.pause, self.count = 0.0, 0, pause, count

    @property
    def waiting(self) -> bool:
        """Whether more frames have arrived than were taken."""
        return self.taken < self.count and 0.01 * self.taken <= self.now

    def batches(self) -> Iterator[list[Judged]]:
        """A frame at a time, each not before it arrives."""
        while self.taken < self.count:
            arrived = 0.01 * self.taken
            self.now = max(self.now, arrived)
            reading = Reading(self.taken, arrived, 0, COUNTS[0], t_host=arrived)
            self.taken += 1
            yield [Judged(reading, arrived, Flags())]

    def clock(self) -> float:
        """The time [s]."""
        return self.now


@pytest.mark.parametrize("pause", [0.002, 0.03, 0.4])
def test_an_overloaded_stream_goes_on_with_the_newest_frame(
    pause: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    stream: Any = Busy(pause, 1000)
    loads: Any = KnownLoads()

    def slowly(*_: Any, **__: Any) -> list[LoadEstimate]:
        stream.now += pause
        return [LoadEstimate(False, (), status="no_contact")]

    monkeypatch.setattr(loads, "estimate", slowly)
    found = list(live_frames(stream, loads, latency=0.1, clock=stream.clock))
    seqs = [frame.seq for frame in found]
    assert seqs == sorted(seqs)
    assert len(found) + found[-1].dropped == 1000
    assert seqs[-1] == 999
    # No load is older than the wait that is allowed and the estimate itself.
    assert max(frame.estimate.latency for frame in found) <= 0.1 + pause + 1e-9
    if pause < 0.01:
        assert found[-1].dropped == 0
    if pause > 0.1:  # what is estimated next had just arrived
        assert max(frame.estimate.latency for frame in found) <= pause + 0.01 + 1e-9
        assert len(found) >= 0.9 * 10.0 / (pause + 0.01)


def test_an_unplugged_port_is_waited_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    faults = Faults(unplug_at=0.4, unplug_for=0.4)
    log, told = played(tmp_path, faults, [])
    assert told.stalled > 0  # frames that no host could take
    # What was on its way when the cable was pulled is lost with it.
    assert 0 <= told.rows - told.stalled - len(log) <= 2
    assert "waiting for it to come back" in capsys.readouterr().err


class Deleting(LiveWatcher):
    """Deletes a file once something is estimated."""

    def __init__(self, file: Path) -> None:
        self._file: Path | None = file

    def estimated(self, frame: LiveFrame) -> None:
        """Delete it."""
        if self._file is not None:
            self._file.unlink()
            self._file = None


def test_a_live_log_that_is_deleted_goes_on_beside(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(ValueError, match=r"the log is in .*run\.beside1\.csv"):
        played(tmp_path, None, [Deleting(tmp_path / "run.csv")])
    assert len(read_log(tmp_path / "run.beside1.csv")) == FRAMES
    assert "was deleted or moved" in capsys.readouterr().err


def test_a_client_that_does_not_read_delays_nobody() -> None:
    contacts = (Contact(0.3, 1.0, None, None),)
    estimate = LoadEstimate(True, contacts, status="ok", left_out=tuple(range(300)))
    with LineServer("127.0.0.1:0") as server:
        asleep = admitted(server)
        listener = Listener(server)
        while len(server._clients) < 2:
            time.sleep(0.01)
        for seq in range(5000):
            server.estimated(LiveFrame(0.0, seq, estimate, None, 0))
            if seq % 4 == 0:
                time.sleep(1e-3)
        waiting = max(map(len, server._clients.values()))
    seen = [line["seq"] for line in listener.ended()]
    asleep.close()
    assert waiting <= 4  # however much was sent
    assert seen[-1] == 4999
    assert seen == sorted(seen)


@pytest.mark.skipif(shutil.which("g++") is None, reason="needs a compiler of C++")
def test_the_client_in_cpp_reads_what_is_served(tmp_path: Path) -> None:
    source = Path(__file__).parent.parent / "docs" / "clients" / "read_loads.cpp"
    client = tmp_path / "read_loads"
    strict = ("-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Werror")
    subprocess.run(["g++", *strict, source, "-o", client], check=True)
    on_pad = Contact(-0.5, 2.5, None, np.diag([1e-4, 1e-6, 0.0625]), axial=-8.25e-3)
    on_section = Contact(np.deg2rad(31), 12.0, None, np.diag([1e-4, 0.25]))
    unknown = Contact(0.0, 1.0, None, None, axial=0.0)
    frames = [
        LoadEstimate(False, (), status="no_contact"),
        LoadEstimate(True, (on_pad, unknown), status="ok", alternatives=(on_section,)),
        LoadEstimate(True, (on_section,), status='not {"a", [b}', left_out=(3, 4)),
    ]
    with LineServer("127.0.0.1:0") as server:
        reads = subprocess.Popen(
            [client, *map(str, server.address)],
            env={"SUAS_TOKEN": server.token},
            stdout=subprocess.PIPE,
            text=True,
        )
        while not server._clients:
            time.sleep(0.01)
        for seq, estimate in enumerate(frames):
            server.estimated(LiveFrame(0.0, seq, estimate, None, 0))
    printed, _ = reads.communicate(timeout=10)
    assert reads.returncode == 0
    assert printed.splitlines() == [
        '0 "no_contact"',
        '1 "ok"',
        "  2.50 +- 0.25 N at -28.65 deg, -8.25 mm",
        "  1.00 +- nan N at 0.00 deg, 0.00 mm",
        f"2 {json.dumps(frames[2].status_text)}",
        "  12.00 +- 0.50 N at 31.00 deg",
    ]


def test_nobody_is_sent_a_line_without_the_token(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fitting.inverse_load.live.serve._STALLED", 0.5)
    frame = LiveFrame(0.0, 7, LoadEstimate(False, (), status="no_contact"), None, 0)
    with LineServer("127.0.0.1:0") as server, contextlib.ExitStack() as open_:
        strangers = []
        for words in (b"", b"guess\n", server.token.encode(), b"x" * 300, b"\n"):
            stranger = open_.enter_context(socket.create_connection(server.address))
            stranger.sendall(words)
            strangers.append(stranger)
        listener = Listener(server)
        while not server._clients:
            time.sleep(0.01)
        assert len(server._clients) == 1
        server.estimated(frame)
        for stranger in strangers:
            stranger.settimeout(5.0)
            with contextlib.suppress(ConnectionResetError):
                assert stranger.recv(1) == b""
    assert [line["seq"] for line in listener.ended()] == [7]


@pytest.mark.parametrize("address", ["8701", ":8701", "host:", "host:port", "host:70000"])
def test_an_address_that_is_none_is_refused(address: str) -> None:
    with pytest.raises(ValueError, match="HOST:PORT"):
        host_and_port(address, "--serve")
    assert host_and_port("[::1]:8701", "--serve") == ("::1", 8701)


@pytest.mark.parametrize("command", ["invert", "view"])
def test_the_commands_record_and_serve(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "fitting.inverse_load.zero.skin_estimator.estimator_of", lambda *_, **__: KnownLoads()
    )
    log, recording = tmp_path / "run.csv", tmp_path / "run.mcap"
    options = {
        "invert": ["--json", "--latency", "5", "--mcap", recording, "--serve", "127.0.0.1:0"],
        "view": ["--address", "127.0.0.1:0"],
    }
    over = threading.Event()
    with Device("cobs", link=tmp_path / "port") as device:

        def play() -> None:
            device.wait_for_host()
            device.play(repeated(device_frames()), stopped=over.is_set)

        player = threading.Thread(target=play)
        player.start()
        given = [SKIN, log, "--live", device.port, "--format", "cobs", "--duration", 1.5]
        words = [command, *map(str, [*given, *options[command]])]
        result = CliRunner().invoke(app, words)
        over.set()
        player.join()
    assert result.exit_code == 0, result.output
    recorded_rows = len(read_log(log))
    assert recorded_rows > 0
    if command == "view":
        assert result.stdout.startswith("http://127.0.0.1:")
        return
    assert "JSON lines at 127.0.0.1:" in result.stderr
    assert len(result.stdout.splitlines()) == recorded_rows
    assert len(recorded(recording)[0]["/suas/taxels"]) == recorded_rows
