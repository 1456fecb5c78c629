"""Taxels judged from a log: each fault is found where it is, and nowhere else."""

import json
import threading
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from skins import shaped
from test_baseline import log_of as log_at
from typer.testing import CliRunner

from fitting.cli.app import app
from suas_jax.acquisition.device.device import Device, log_readings
from suas_jax.acquisition.health import FAULTS, Health, log_health
from suas_jax.acquisition.log.convert import write_csv
from suas_jax.acquisition.log.log_file import SoLog
from suas_jax.acquisition.taxel_faults import StuckWatch, stuck_taxels
from suas_jax.config import ConfigError, continuous_inputs, load_skin
from suas_jax.scene.build import plan_for
from suas_jax.sensing.taxels import taxel_places, taxels_of
from suas_jax.skin.plain import plain_geometry

FRAMES, MODULES, TAXELS, NOISE = 1000, 3, 10, 2.0


@pytest.fixture
def rest() -> np.ndarray:
    random = np.random.default_rng(7)
    level = random.uniform(1000, 14000, (MODULES, TAXELS))
    return level + random.normal(0, NOISE, (FRAMES, MODULES, TAXELS))


def log_of(so: np.ndarray) -> SoLog:
    return log_at(so, rate=100.0)


def pressed(rest: np.ndarray) -> np.ndarray:
    """A load that comes and goes, strongest in the middle of each module."""
    load = np.sin(np.linspace(0, 12, FRAMES)) ** 2
    return rest + 300 * load[:, None, None] * np.linspace(-0.3, 1, TAXELS)


def faults(health: Health) -> dict[tuple[int, int], set[str]]:
    return {(t.module, t.taxel): set(t.faults) for t in health.faulty}


@pytest.mark.parametrize("loaded", [False, True])
def test_healthy_taxels_have_no_fault(rest: np.ndarray, loaded: bool) -> None:
    health = log_health(log_of(pressed(rest) if loaded else rest))
    assert faults(health) == {}
    noise = np.array([t.noise for t in health.taxels])
    # The second differences of 1000 normal numbers give their deviation to 3 %.
    assert noise == pytest.approx(np.full(30, np.hypot(NOISE, 12**-0.5)), rel=0.15)
    assert max(abs(t.coupling) for t in health.taxels) < 0.3
    assert all(t.lost == t.stuck == t.saturated == 0 for t in health.taxels)
    if loaded:
        assert min(t.follows for t in health.taxels) > 0.8
    else:
        assert all(np.isnan(t.follows) for t in health.taxels)


def test_a_membrane_on_a_taxel_is_no_stuck_taxel() -> None:
    """A press held on the wall keeps a count at full scale; a short never reads less."""
    so = 5000 + np.random.default_rng(2).normal(0, NOISE, (200, 10)).round()
    so[50:150, 1] = 65535  # the membrane lies on it
    so[:, 2] = 65535  # short-circuited
    so[50:150, 3] = 4990  # stuck
    found = stuck_taxels(so, NOISE)
    watch = StuckWatch(NOISE, 10)
    live = np.array([watch.feed(row) for row in so])
    for flags in (found, live):
        assert not flags[:, :2].any()
        assert flags[100, 2:4].all()
    assert found[:, 2].all()
    np.testing.assert_array_equal(found[:, 3], so[:, 3] == 4990)


def test_a_converter_of_fewer_bits_repeats_counts_without_being_stuck() -> None:
    random = np.random.default_rng(2)
    so = 16 * np.rint((5000 + random.uniform(0, 99, 10) + random.normal(0, 2, (60, 10))) / 16)
    so[:, :6] += 160 * np.arange(60)[:, None]  # most move, so that repeats count
    so[:, 9] = so[0, 9]
    watch = StuckWatch(2.0, 10)
    assert not np.any([watch.feed(row, 16) for row in so])


def test_every_fault_is_found_where_it_is(rest: np.ndarray) -> None:
    random = np.random.default_rng(1)
    so = pressed(rest)
    so[400:, 0, 0] = so[400, 0, 0]  # stuck
    so[:, 0, 4] = 65535  # saturated
    so[:, 0, 8] = np.nan  # silent
    so[random.random(FRAMES) < 0.2, 1, 1] = np.nan  # lossy
    so[:, 1, 4] += random.normal(0, 20, FRAMES)  # noisy
    so[:, 2, 6] = rest[:, 2, 6]  # unresponsive
    so[:, 2, 9] = so[:, 2, 8] + 17  # coupled
    found = faults(log_health(log_of(so)))
    assert found.pop((2, 9)) == {"coupled"}
    assert found == {
        (0, 1): {"stuck"},
        (0, 5): {"saturated"},
        (0, 9): {"silent"},
        (1, 2): {"lossy"},
        (1, 5): {"noisy"},
        (2, 7): {"unresponsive"},
        (2, 10): {"coupled"},
    }


def test_presses_between_two_frames_couple_no_noise(rest: np.ndarray) -> None:
    """A hand is quick: neighbours jump together in a tenth of the frames."""
    load = np.interp(np.arange(FRAMES) % 100, [80, 82, 95, 97], [0.0, 1.0, 1.0, 0.0])
    so = rest + 300 * load[:, None, None] * np.linspace(-0.3, 1, TAXELS)
    assert faults(log_health(log_of(so))) == {}


def test_taxels_of_another_layout_are_named(rest: np.ndarray) -> None:
    places = {(m, k + 1): (0.0, 0.01 * k) for m in range(MODULES) for k in range(TAXELS)}
    del places[2, 10]
    health = log_health(log_of(rest), {**places, (3, 1): (0.0, 0.1)})
    assert "the log has not: 3.1:" in health.notes[0]
    assert "the skin file has not: 2.10:" in health.notes[1]
    assert not log_health(log_of(rest), {**places, (2, 10): (0.0, 0.1)}).notes


def test_a_drift_is_measured(rest: np.ndarray) -> None:
    """Ten seconds at 30 counts a minute: five counts, below the noise of three frames."""
    rest[:, 1, 3] += np.linspace(0, 5, FRAMES)
    health = log_health(log_of(rest))
    assert faults(health) == {(1, 4): {"drifting"}}
    (drift,) = (t.drift for t in health.taxels if t.faults)
    assert drift == pytest.approx(30.0, rel=0.15)


def test_lost_frames_count_as_loss(rest: np.ndarray) -> None:
    log = log_of(rest)
    lost = np.zeros(len(log), np.int64)
    lost[np.flatnonzero(log.module == 1)[100]] = 250
    health = log_health(
        SoLog(
            log.path, {}, log.t_host, log.t_device, log.seq, log.module, log.so, {"lost": lost}
        )
    )
    assert faults(health) == {(1, k): {"lossy"} for k in range(1, TAXELS + 1)}
    shares = [t.lost for t in health.taxels if t.module == 1]
    assert shares == pytest.approx([0.2] * TAXELS)


def test_neighbours_are_the_nearest_where_places_are_known(rest: np.ndarray) -> None:
    """Taxels that lie apart may move apart: with their places known no fault is found."""
    so = rest[:, :1].copy()
    left, right = np.sin(np.linspace(0, 9, FRAMES)), np.cos(np.linspace(0, 37, FRAMES))
    so[:, 0, ::2] += 300 * left[:, None]
    so[:, 0, 1::2] += 300 * right[:, None]
    so[:, 0, 9] = rest[:, 0, 9]
    places = {(0, k + 1): (float(k % 2), 0.001 * k) for k in range(TAXELS)}
    assert faults(log_health(log_of(so), places)) == {(0, 10): {"unresponsive"}}


def test_too_short_a_log_is_refused(rest: np.ndarray) -> None:
    with pytest.raises(ValueError, match="40 frames"):
        log_health(log_of(rest[:40]))


def test_the_command_judges_a_log(
    rest: np.ndarray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rest[400:, 0, 0] = rest[400, 0, 0]
    log, figure = tmp_path / "rest.csv", tmp_path / "health.png"
    write_csv(log_of(rest), log)
    monkeypatch.setenv("COLUMNS", "120")
    done = CliRunner().invoke(app, ["health", str(log), "--plot", str(figure)])
    assert done.exit_code == 0, done.output
    assert f"stuck: 0.1: {FAULTS['stuck']}" in " ".join(done.output.split())
    assert "30 taxels, 1 faulty" in done.output
    assert figure.stat().st_size > 10_000
    done = CliRunner().invoke(app, ["health", str(log), "--json"])
    report = json.loads(done.stdout)
    assert (report["status"], report["faulty"], len(report["taxels"])) == ("faults", 1, 30)
    assert report["taxels"][0]["faults"] == ["stuck"]
    assert report["taxels"][0]["stuck_share"] == pytest.approx(0.6)


def test_the_command_listens_to_a_port(rest: np.ndarray, tmp_path: Path) -> None:
    rest[:, 1, 3] = 0
    with Device("cobs", link=tmp_path / "port") as device:

        def play() -> None:
            device.wait_for_host()
            device.play(log_readings(log_of(rest)), duration=3.5)

        player = threading.Thread(target=play)
        player.start()
        arguments = ["health", device.port, "--format", "cobs", "--duration", "3", "--json"]
        done = CliRunner().invoke(app, arguments)
        player.join()
    assert done.exit_code == 0, done.output
    report = json.loads(done.stdout)
    assert [t["faults"] for t in report["taxels"] if t["faults"]] == [["saturated"]]
    assert report["frames"] > 50


ELLIPSE = {
    "section": "ellipse",
    "inner_semi_axes": ["57.5 mm", "40 mm"],
    "half_angle": "90 deg",
}
OIL = {"model": "incompressible", "relative_permittivity": 2.2}


@pytest.mark.parametrize("name", ["suas.toml", "suas-pad.toml", "suas-rubber.toml", "ellipse"])
def test_places_are_the_models(name: str) -> None:
    """Those on the unrolled wall are those that the model reads."""
    electrodes = load_skin(Path("configs/skins/suas-pad.toml")).electrodes
    geometry = shaped(ELLIPSE).geometry
    if name != "ellipse":
        spec = load_skin(Path("configs/skins") / name)
        electrodes, geometry = spec.electrodes, spec.geometry
    assert electrodes is not None
    inputs = continuous_inputs(electrodes)
    stated = defaultdict(float, {f"electrodes.{key}": x for key, x in inputs.items()})
    skin = plain_geometry(geometry)
    taxels = taxels_of(electrodes, stated, skin)
    places = np.array([*taxel_places(electrodes, geometry).values()])
    np.testing.assert_allclose(places[:, 0], skin.wall_arc(taxels.angle)[:, 0], atol=1e-12)
    np.testing.assert_allclose(places[:, 1], taxels.axial[:, 0], atol=1e-12)


def test_taxels_off_a_section_are_refused_with_the_room_there_is() -> None:
    """What the table of a circle tells alone."""
    modules = {"angle": "80 deg", "axial": "0 mm", "pitch": "6.5 mm", "diameter": "4 mm"}
    taxels = [{"arc": arc, "diameter": "4 mm", "axial": "0 mm"} for arc in ("20 mm", "90 mm")]
    for table, key, text in (
        ({"layout": "roboskin", "modules": [modules]}, "electrodes.modules.0.angle", "away"),
        ({"taxels": taxels}, "electrodes.taxels.1.arc", "clamped edges are at -"),
    ):
        spec = shaped(ELLIPSE, oil=OIL, electrodes={"lsb": "0.305 fF"} | table)
        with pytest.raises(ConfigError, match=key) as caught:
            plan_for(spec, "shell", (16,))
        assert text in str(caught.value)
