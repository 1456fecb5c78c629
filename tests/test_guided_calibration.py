"""`suas calibrate` against a simulated device: rest, presses, an interruption, verification."""

import itertools
import json
import threading
from collections.abc import Callable, Iterator, Sequence
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from skins import shaped
from typer.testing import CliRunner

from fitting.calibration.html_report import Verification, _drawing
from fitting.calibration.next_press import _places
from fitting.calibration.plan import Press, Step, press_of, usual_presses
from fitting.calibration.recording import REST_FRAMES, Rest, SteadyWindow, StepRecorder
from fitting.calibration.run import _known
from fitting.cli.app import app
from suas_jax.acquisition.baseline import Baseline
from suas_jax.acquisition.device.device import Device
from suas_jax.acquisition.frames.reading import Reading
from suas_jax.acquisition.health import MIN_FRAMES
from suas_jax.acquisition.log.log_file import read_log
from suas_jax.config import SkinSpec, load_skin

SKIN = Path(__file__).parent.parent / "configs/skins/suas.toml"
GAP, PERMITTIVITY, FORCE, RATE, NOISE = 5.2e-3, 2.35, 8.0, 100, 1.0
HOLD = 1.0


@pytest.fixture(scope="module")
def skin() -> SkinSpec:
    return load_skin(SKIN)


# Counts of the shipped skin with another gap and permittivity, by `suas_jax.forward`: at rest
# and under 8 N at the usual places, the last one to verify [state, taxel].
COUNTS = np.array(
    [
        [164.86, 164.86, 164.86, 164.86, 164.86, 164.86, 164.86, 164.86],
        [205.69, 316.48, 269.14, 174.54, 134.10, 120.48, 123.67, 142.76],
        [147.89, 141.61, 165.20, 230.08, 230.08, 165.20, 141.61, 147.89],
        [142.76, 123.67, 120.48, 134.10, 174.54, 269.14, 316.48, 205.69],
        [140.30, 122.54, 126.71, 159.79, 243.46, 262.62, 196.79, 168.41],
    ]
)


def played(states: Sequence[np.ndarray], seconds: Sequence[float]) -> Iterator[Reading]:
    """One state after another, with noise; the last one for ever."""
    random = np.random.default_rng(3)
    frames = itertools.chain(
        *(itertools.repeat(so, int(RATE * s)) for so, s in zip(states, seconds, strict=True)),
        itertools.repeat(states[-1]),
    )
    for k, so in enumerate(frames):
        noisy = np.rint(so + random.normal(0, NOISE, len(so)))
        yield Reading(k, k / RATE, 0, tuple(map(int, noisy)))


@pytest.fixture
def calibrate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable:
    """Run the command while a device plays; its status and output."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    def run(readings: Iterator[Reading], *options: str) -> tuple[int, str, str]:
        ended = threading.Event()
        with Device("cobs", link=tmp_path / "port") as device:

            def play() -> None:
                device.wait_for_host(ended.is_set)
                device.play(readings, speed=2.0, stopped=ended.is_set)

            player = threading.Thread(target=play)
            player.start()
            try:
                arguments = ["calibrate", device.port, str(SKIN), "--format", "cobs"]
                arguments += ["--force", f"{FORCE} N", "--hold", str(HOLD), "--model", "shell"]
                done = CliRunner().invoke(app, [*arguments, *options])
            finally:
                ended.set()
                player.join()
        return done.exit_code, done.stdout, done.stderr

    return run


class Page(HTMLParser):
    """Tags and words of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.words: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:  # noqa: D102
        self.tags.append(tag)

    def handle_data(self, data: str) -> None:  # noqa: D102
        self.words.append(data)


@pytest.mark.long  # a whole calibration, twice; its parts below and in test_sensor_*
def test_a_skin_is_calibrated_with_an_interruption(
    calibrate: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody presses at the third place; the same command goes on there, and verifies."""
    rest, *presses = COUNTS
    first = played([rest, presses[0], rest, presses[1], rest], [2, 2, 1, 2, 1])

    # The estimator itself is verified where it is tested (tests/test_inverse_load.py).
    def estimated(spec: SkinSpec, baseline: Baseline, logs: list) -> list[Verification]:
        given.append((spec, baseline, logs))
        return [Verification(logs[0][0], "ok", 0.35, 8.1, None, passed=True)]

    given: list[tuple[SkinSpec, Baseline, list]] = []
    monkeypatch.setattr("fitting.calibration.run.verify", estimated)
    status, _, said = calibrate(first, "--timeout", "3")
    assert status == 2
    assert "3 of 5: press at 0 deg" in said
    assert "4 of 5: press at 45 deg with 8 N" in said
    assert "nothing touched the skin" in said
    assert "the same command goes on" in said
    folder = Path("suas.calibration")
    kept = {path.name: path.read_bytes() for path in folder.glob("*.csv")}
    assert sorted(kept) == ["press_1.csv", "press_2.csv", "rest.csv"]

    second = played([rest, presses[2], rest, presses[3], rest], [2, 2, 1, 2, 1])
    status, out, said = calibrate(second, "--timeout", "60", "--json")
    assert status == 0, said + out
    assert "3 of 5 steps are there already" in said
    assert "press at 0 deg" not in said
    assert {name: (folder / name).read_bytes() for name in kept} == kept
    log = read_log(folder / "press_3.csv")
    assert log.header["load_0_force_N"] == "8"
    assert len(log) == pytest.approx(0.8 * RATE * HOLD, abs=3)
    assert np.abs(log.so - presses[2]).max() < 6 * NOISE

    report = json.loads(out)
    ((spec, baseline, logs),) = given
    assert spec.geometry.oil_gap == pytest.approx(report["parameters"]["oil_gap"])
    assert baseline.so[0] == pytest.approx(rest, abs=1)
    assert read_log(logs[0][1]).so.mean(0) == pytest.approx(presses[3], abs=1)
    errors = report["standard_errors"]
    for name, true in (("oil_gap", GAP), ("relative_permittivity", PERMITTIVITY)):
        assert report["parameters"][name] == pytest.approx(true, abs=4 * errors[name])
        assert errors[name] < 0.01 * true
    assert report["verified"] is True
    (check,) = report["verification"]
    assert check["estimated_angle_deg"] == pytest.approx(19.8, abs=0.5)
    assert check["estimated_force_N"] == pytest.approx(FORCE, rel=0.03)
    assert load_skin(Path("suas.calibrated.toml")).geometry.oil_gap == pytest.approx(
        GAP, rel=0.01
    )
    text = Path("suas.calibrated.html").read_text()
    page = Page(text)
    assert {"svg", "table", "h1"} <= set(page.tags)
    assert not {"script", "link", "img"} & set(page.tags)
    assert "http:" not in text
    assert "https:" not in text
    words = " ".join(page.words)
    assert "converged, verified" in words
    assert "All 8 taxels are healthy." in words
    assert "5 mm" in words  # the skin file's gap beside the calibrated one


def test_a_slow_device_s_rest_is_long_enough_to_judge_its_taxels() -> None:
    window, rate = SteadyWindow(HOLD, fewest=REST_FRAMES), 10.0
    times = []
    while not window.full:
        times.append(len(times) / rate)
        window.feed(times[-1], np.zeros(4))
    assert sum(time >= window.settled for time in times) >= MIN_FRAMES


def test_another_calibration_does_not_go_on_in_the_folder(calibrate: Callable) -> None:
    folder = Path("suas.calibration")
    folder.mkdir()
    (folder / "plan.json").write_text("{}")
    status, _, said = calibrate(played([COUNTS[0]], [1]))
    assert status == 2
    assert "another skin file or with other loads" in said


def test_another_layout_is_refused(calibrate: Callable) -> None:
    status, _, said = calibrate(played([COUNTS[0][:7]], [1]))
    assert status == 2
    assert "sends 7 counts" in said
    assert not list(Path("suas.calibration").glob("*.csv"))


@pytest.mark.parametrize(
    ("moving", "touched", "steady"),
    [(0.0, False, True), (40.0, True, True), (np.linspace(0, 60, 100)[:, None], True, False)],
)
def test_a_load_counts_once_it_is_held(moving: float, touched: bool, steady: bool) -> None:
    random = np.random.default_rng(0)
    rest = Rest(np.full(6, 9000.0), np.full(6, 2.0))
    window = SteadyWindow(0.99, rest)
    for k, so in enumerate(rest.so + moving + random.normal(0, 2, (100, 6))):
        assert window.full == (k >= 96)  # but for a twentieth
        window.feed(0.01 * k, so)
    assert window.full
    assert (window.touched(), window.steady()) == (touched, steady)
    window.feed(0.2, rest.so)  # the device's clock began again
    assert not window.full


@pytest.mark.parametrize(
    ("moving", "late", "touched", "steady"),
    [
        # The last tenth: 8 standard errors of its mean and 3 counts from rest, which are 8.1.
        (0.0, 8.0, False, False),
        (0.0, 8.2, True, False),
        # Every tenth: 6 standard errors, 1 count and 2 % of the change from the mean of all.
        (0.0, 4.8 / 0.9, False, True),
        (0.0, 4.9 / 0.9, False, False),
        (200.0, 8.8 / 0.9, True, True),
        (200.0, 8.9 / 0.9, True, False),
    ],
)
def test_what_is_touched_and_held_is_told_by_standard_errors(
    moving: float, late: float, touched: bool, steady: bool
) -> None:
    """Of readings without noise, on a skin whose noise at rest was 2 counts, rounding too."""
    rest = Rest(np.full(6, 9000.0), np.full(6, np.sqrt(4 - 1 / 12)))
    window = SteadyWindow(0.99, rest)
    for k in range(100):
        window.feed(0.01 * k, rest.so + moving + late * (k >= 90))
    assert (window.touched(), window.steady()) == (touched, steady)


def test_a_step_keeps_the_rows_of_its_window_less_the_first_fifth() -> None:
    """Of a device without a clock of its own, by the host's."""
    window = SteadyWindow(1.0)
    for k in range(60, 110):
        window.feed(0.1 * k, np.zeros(2))
    recorder: Any = SimpleNamespace()
    for clocks in ((0.0, 1.0), (np.nan, 0.1)):
        recorder._rows = [
            SimpleNamespace(
                t_device=clocks[0] + 0.1 * k, reading=SimpleNamespace(t_host=clocks[1] * k)
            )
            for k in range(110)
        ]
        rows = StepRecorder._cut(recorder, window)
        assert rows == recorder._rows[70:]  # of 6 to 10.9 s


def test_presses_from_the_command_line(skin: SkinSpec) -> None:
    press = press_of("-30 deg, 500 gf", skin, "--press")
    assert (press.place, press.force) == pytest.approx((np.radians(-30), 4.90333), rel=1e-5)
    pad = load_skin(SKIN.with_name("suas-pad.toml"))
    assert press_of("10 deg, -5 mm, 3 N", pad, "--press").axial == pytest.approx(-5e-3)
    assert _known(Step("press_1", Press(np.radians(10), 3.0, -5e-3))) == {
        "load_0_force_N": "3",
        "load_0_angle_deg": "10",
        "load_0_axial_mm": "-5",
    }
    with pytest.raises(ValueError, match="beyond the pad's end"):
        press_of("10 deg, 62 mm, 3 N", pad, "--press")
    assert {p.axial for group in usual_presses(pad, 5.0) for p in group} == {0.0}
    for text, words in (
        ("30 deg", "expected"),
        ("30 mm, 5 N", "an angle"),
        ("95 deg, 5 N", "within 90 deg"),
        ("91 deg, 5 N", "within 90 deg"),
        ("5 deg, -5 N", "above zero"),
        ("5 deg, 3 mm, 5 N", "expected"),
    ):
        with pytest.raises(ValueError, match=words):
            press_of(text, skin, "--press")


def test_presses_on_a_path_are_told_by_the_arc(tmp_path: Path) -> None:
    flat = [{"line": "20 mm"}, {"radius": "30 mm", "angle": "90 deg"}, {"line": "27.5 mm"}]
    skin = shaped({"section": "path", "path": flat, "mirror": True})
    press = press_of("-12 mm, 5 N", skin, "--press")
    assert press == Press(pytest.approx(-12e-3), 5.0, None, "arc")
    assert press.text == "at -12 mm with 5 N"
    usual, _ = usual_presses(skin, 5.0)
    # Half of 94.624 mm, in tenths that a person can set.
    assert [p.place for p in usual] == pytest.approx([-47.3e-3, 0, 47.3e-3], rel=1e-12)
    assert usual[0].text == "at -47.3 mm with 5 N"
    planned = _places(skin, 6.0)
    assert [p.text for p in planned[:2]] == ["at -75.7 mm with 3 N", "at -64.9 mm with 3 N"]
    for text, words in (("10 deg, 5 N", '"22 mm, 5 N"'), ("95 mm, 5 N", "an arc within 94.6")):
        with pytest.raises(ValueError, match=words):
            press_of(text, skin, "--press")
    known = _known(Step("press_1", press))
    assert known == {"load_0_force_N": "5", "load_0_arc_mm": "-12"}
    drawing = _drawing(skin, [(0.0, 0.0)], [(Step("press_1", press), press)])
    assert [float(x[0]) for x in (drawing["taxels"] + drawing["presses"])] == sorted(
        [float(drawing["presses"][0][0]), drawing["width"] / 2], reverse=True
    )
