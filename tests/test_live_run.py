"""A live run from a simulated device: recorded, sent on, and through lost links."""

import json
import socket
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
from fitting.inverse_load.live.stream import LiveFrame, LiveWatcher
from fitting.robotics.recording import LiveRecording, Recording
from suas_jax.acquisition.device.device import Device, repeated
from suas_jax.acquisition.device.faults import Faults
from suas_jax.acquisition.frames.reading import Reading
from suas_jax.acquisition.log.log_file import read_log
from suas_jax.acquisition.stream import Stream
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
        self.along = ContactPlaces(self.spec.geometry, plain_geometry(self.spec.geometry))
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


class Listener:
    """A program that reads what is served, until there is no more."""

    def __init__(self, server: LineServer) -> None:
        self._lines: list[dict[str, Any]] = []
        self._client = socket.create_connection(server.address)
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
        asleep = socket.create_connection(server.address)
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
