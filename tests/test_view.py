"""The page in a real browser: what it shows of scenes, logs, live ports and lost links.

Skipped where neither Chromium nor Chrome is installed.
"""

import contextlib
import gc
import io
import json
import shutil
import socket
import threading
import time
import tracemalloc
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread
from test_live_run import KnownLoads
from test_recording import ESTIMATES, counts_under
from typer.testing import CliRunner

import fitting
from fitting.cli.app import app
from fitting.inverse_load.estimate.estimate import Contact, LoadEstimate
from fitting.inverse_load.live.run import LiveOptions, run_live
from fitting.inverse_load.readings import readings_of
from fitting.inverse_load.report.text import contact_text
from fitting.view.history_source import HistorySource
from fitting.view.hub import Hub, Player, understood
from fitting.view.live_source import LiveSource
from fitting.view.log_source import LogSource
from fitting.view.picture import Grid, arrow
from fitting.view.readings_picture import InterpolatedMembrane, ReadingsPictures
from fitting.view.scene_model import SceneModel, known_contacts, surfaces_of
from fitting.view.scene_source import SceneSource, all_stated, inputs_by, sliders_of
from fitting.view.server import ViewServer
from suas_jax.acquisition.device.device import Device
from suas_jax.acquisition.frames.reading import Reading
from suas_jax.acquisition.log.log_file import LogWriter, log_header, read_log
from suas_jax.acquisition.stream import Stream
from suas_jax.config import (
    LineLoadSpec,
    SceneSpec,
    continuous_inputs,
    load_scene,
    load_skin,
    with_solve,
)
from suas_jax.config.geometry import AlongSpec
from suas_jax.dynamics.course import history_of
from suas_jax.dynamics.history import history_sweep
from suas_jax.scene.solve import solve
from suas_jax.scene.taxel_film import TaxelFilm

CONFIGS = Path(__file__).parent.parent / "configs"
SKIN = CONFIGS / "skins" / "suas.toml"
PAD = CONFIGS / "skins" / "suas-pad.toml"
CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
REST = counts_under(5e-3)


# --- without a browser --------------------------------------------------------------------


def test_the_membrane_between_taxels_is_the_one_that_they_see() -> None:
    spec = load_skin(PAD)
    film, grid = TaxelFilm(spec), Grid.of(spec.geometry)
    membrane = InterpolatedMembrane(spec.geometry, film, 0.05, grid)

    def dent(angle: np.ndarray, axial: np.ndarray) -> np.ndarray:
        arc = spec.geometry.inner_radius * (angle - 0.1)
        return -1.5e-3 * np.exp(-(arc**2 + (axial - 5e-3) ** 2) / (2 * 12e-3**2))

    gap = spec.geometry.oil_gap + dent(film.angle, film.axial)
    so = np.array(film._electrodes.read_even_film(gap[:, None]))[:, 0]
    angle, axial = grid.points
    every = np.ones(len(so), bool)
    radial = np.sum(membrane(so, every) * grid.outward, 1)
    inside = (np.abs(angle) < 0.8) & (np.abs(axial) < 35e-3)
    np.testing.assert_allclose(radial[inside], dent(angle, axial)[inside], atol=6e-5)
    edge = (np.abs(angle) == angle.max()) | (np.abs(axial) == axial.max())
    assert np.abs(radial[edge]).max() < 5e-5
    # A taxel that reads nonsense is not gone by, and its neighbours fill the place.
    worst = int(np.argmin(gap))
    so[worst] = 60000
    radial = np.sum(membrane(so, np.arange(len(so)) != worst) * grid.outward, 1)
    np.testing.assert_allclose(radial[inside], dent(angle, axial)[inside], atol=1.5e-4)


def test_an_ellipse_holds_its_contact_with_95_percent() -> None:
    geometry = load_skin(PAD).geometry
    outer = geometry.inner_radius + geometry.thickness
    covariance = np.array([[2e-4, 3e-6, 0.0], [3e-6, 1e-6, 0.0], [0.0, 0.0, 0.01]])
    contact = Contact(0.2, 5.0, None, covariance, axial=0.01)
    long, short, turn = arrow(contact, Grid.of(geometry))["ellipse"]
    rng = np.random.default_rng(1)
    place = rng.multivariate_normal([0, 0], covariance[:2, :2], 20_000) * [outer, 1.0]
    turned = place @ np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    inside = (turned[:, 0] / long) ** 2 + (turned[:, 1] / short) ** 2 < 1
    assert inside.mean() == pytest.approx(0.95, abs=0.005)
    assert long > short


@pytest.mark.parametrize("name", ["suas-ellipse", "suas-flat-topped"])
def test_any_section_is_drawn_by_its_arc(name: str) -> None:
    spec = load_skin(CONFIGS / "skins" / f"{name}.toml")
    film, grid = TaxelFilm(spec), Grid.of(spec.geometry)
    steps = np.linalg.norm(np.diff(grid.place, axis=0), axis=1)
    arc = grid.places.inner_arc(grid.angle)
    np.testing.assert_allclose(steps, np.diff(arc), rtol=2e-4)
    # The wall's taxels lie along the normals of their feet, a film below them.
    feet = [np.interp(film.section_angle, grid.angle, x) for x in grid.place.T]
    depth = np.linalg.norm(film.positions[:, :2] - np.stack(feet, 1), axis=1)
    np.testing.assert_allclose(depth, spec.geometry.mean_gap, rtol=2e-3)
    # A dent is found by arc length, whatever the section.
    membrane = InterpolatedMembrane(spec.geometry, film, 0.05, grid)
    taxels = grid.places.inner_arc(film.section_angle)
    dent = -1e-3 * np.exp(-(((taxels - taxels[5]) / 25e-3) ** 2))
    so = np.array(film._electrodes.read_even_film((film.rest_gap + dent)[:, None]))[:, 0]
    height = np.sum(membrane(so, np.ones(len(so), bool)) * grid.outward, 1)
    assert arc[np.argmin(height)] == pytest.approx(taxels[5], abs=3e-3)
    np.testing.assert_allclose(np.interp(taxels, arc, height), dent, atol=2e-5)
    # A contact told by its arc is where the membrane's arc is as long.
    around = grid.places.estimated(grid.places.from_place("arc", np.array([19.5e-3, 20.5e-3])))
    covariance = np.diag([np.diff(around)[0] ** 2, 0.1])  # a millimetre, as it is estimated
    by_arc = grid.places.name == "arc"
    contact = Contact(0.0, 5.0, None, covariance, arc=20e-3, by_arc=by_arc)
    drawn = arrow(contact, grid)
    assert grid.places.inner_arc(np.array(drawn["angle"])) == pytest.approx(20e-3, rel=1e-5)
    outer = np.diff(grid.place + spec.geometry.mean_thickness * grid.normal, axis=0)
    k = int(np.searchsorted(grid.angle, drawn["angle"]))
    longer = np.linalg.norm(outer, axis=1)[k - 1] / steps[k - 1]
    assert drawn["ellipse"][0] == pytest.approx(1.96e-3 * longer, rel=2e-2)


def test_loads_of_any_section_have_sliders() -> None:
    spec = load_skin(CONFIGS / "skins" / "suas-flat-topped.toml")
    line = LineLoadSpec(arc="10 mm", force="5 N")
    table = AlongSpec(arc=[0, 0.5, 1], value=["1.2 mm", "1.8 mm", "1.2 mm"])
    geometry = spec.geometry.model_copy(update={"thickness": table})
    given = {name: getattr(spec, name) for name in spec.model_fields_set}
    scene = SceneSpec(**(given | {"geometry": geometry}), load=(line,))
    sliders = {slider["name"]: slider for slider in sliders_of(scene)}
    assert "geometry.thickness" not in sliders
    assert sliders["geometry.oil_gap"]["value"] == 5e-3
    arc = sliders["load.0.arc"]
    # 20 mm, a quarter of a circle of 30 mm and 27.5 mm are half of the section.
    half = 20e-3 + 30e-3 * np.pi / 2 + 27.5e-3
    assert arc["value"] == 10e-3
    assert arc["most"] == pytest.approx(0.94 * half, rel=1e-9)
    observed = [{"angle_deg": 0.0, "arc_m": 10e-3, "force_N": 5.0}]
    (contact,) = known_contacts(scene, Grid.of(scene.geometry), observed).values()
    assert contact_text(contact).startswith("10.0 mm along the arc, 5.00 N")


@pytest.mark.parametrize("name", ["hold", "film", "deep_sea", "pad_ball"])
def test_stiffness_scales_the_stress_constants_alone(name: str) -> None:
    scene = all_stated(load_scene(CONFIGS / "scenes" / f"{name}.toml"))
    values = {slider["name"]: slider["value"] for slider in sliders_of(scene)}
    found, own = inputs_by(scene, values | {"stiffness": 2.0}), continuous_inputs(scene)
    changed = {path: value / own[path] for path, value in found.items() if value != own[path]}
    assert changed == dict.fromkeys(("material.C1", "material.C2", "material.C3"), 2.0)


def test_answers_do_not_depend_on_the_way_to_them() -> None:
    scene = all_stated(load_scene(CONFIGS / "scenes" / "case_b.toml"))
    grid = Grid.of(scene.geometry)
    dragged, fresh = SceneModel(scene, grid), SceneModel(scene, grid)
    for angle, force in ((0.7, 20.0), (0.4, 22.0), (-0.1, 25.0), (-0.5, 12.0)):
        values = {"load.0.angle": angle, "load.0.force": force}
        found = dragged(values)
    expected = fresh(values)
    assert found.status == expected.status == "converged"
    assert found.oil_pressure == pytest.approx(expected.oil_pressure, rel=1e-7)
    np.testing.assert_allclose(found.displacement, expected.displacement, atol=1e-10)
    mirrored = fresh({"load.0.angle": 0.5, "load.0.force": 12.0})
    assert mirrored.oil_pressure == pytest.approx(found.oil_pressure, rel=1e-5)


@pytest.mark.long  # a program of bodies: 20 s of processor time; test_bodies.py has the physics
def test_a_body_is_where_its_sliders_say() -> None:
    scene = all_stated(load_scene(CONFIGS / "scenes" / "body.toml"))
    sliders = {slider["name"]: slider for slider in sliders_of(scene)}
    assert sliders["load.0.depth"]["value"] == 2e-3
    grid = Grid.of(scene.geometry)
    model = SceneModel(scene, grid)
    model({"load.0.depth": 1e-3})
    found = model({"load.0.depth": 2e-3})
    report = solve(with_solve(scene, elements=32)).report
    assert found.loads[0]["force_N"] == pytest.approx(report["loads"][0]["force_N"], rel=0.02)
    assert found.oil_pressure == pytest.approx(report["oil_pressure_Pa"], rel=0.01)
    ((tip, frame),) = found.bodies
    middle = tip + 10e-3 * frame[-1]  # of the cylinder
    outer = scene.geometry.inner_radius + scene.geometry.mean_thickness
    assert np.hypot(*middle) == pytest.approx(outer - 2e-3 + 10e-3, rel=1e-6)
    (surface,) = surfaces_of(scene)
    points = np.array(surface)[:, [0, 2]] @ frame + tip
    np.testing.assert_allclose(np.linalg.norm(points - middle, axis=1), 10e-3, rtol=1e-6)


@pytest.mark.long  # a program of histories: 30 s of processor time; physics: test_history.py
def test_a_history_is_shown_as_it_was_solved() -> None:
    scene = load_scene(CONFIGS / "scenes" / "hold.toml")
    rows = history_of([0.0, 0.1, 30.0, 30.1], force_N=[0.0, 20.0, 20.0, 0.0])
    sweep = history_sweep(scene, rows)
    source = HistorySource(sweep, "hold")
    assert source.hub.description["timeline"]["last"] == 30.1
    for k, point in enumerate(sweep.points):
        largest = np.linalg.norm(source._displacement(k), axis=1).max()
        assert largest == pytest.approx(point["max_displacement_m"], rel=2e-3, abs=1e-9)
    assert sweep.points[2]["max_displacement_m"] > 1.1 * sweep.points[1]["max_displacement_m"]
    source._show(2)
    message = source.hub.newest(0)
    assert message is not None
    assert b'"force_N":20.0' in message.content.replace(b" ", b"")


def test_a_timeline_is_played_stopped_and_sought(monkeypatch: pytest.MonkeyPatch) -> None:
    now, shown = [0.0], []
    monkeypatch.setattr("fitting.view.hub.time.monotonic", lambda: now[0])
    wishes = [{}, {}, {"play": False}, {"seek": 0.5}, {}, {"speed": 0.1, "play": True}, {}, {}]
    player = Player(np.array([0.0, 1.0, 2.0, 4.0]), seconds=2.0)

    class Clock(Hub):
        def wishes(self, timeout: float) -> dict[str, Any]:
            now[0] += 0.6
            return wishes.pop(0)

    player.run(Clock({}), lambda: not wishes, shown.append)
    # 1.2, 2.4 s at twice the speed; stopped at 2.4, moved to 0.5, on at a tenth.
    assert player.timeline["speeds"][-1] > 2
    assert shown == [0, 1, 2, 2, 0, 0]
    assert player.header == {"playing": True, "speed": 0.1}
    assert player.index == 0


def test_bodies_with_friction_are_refused() -> None:
    scene = load_scene(CONFIGS / "scenes" / "body.toml")
    rough = scene.loads[0].model_copy(update={"friction": 0.3})
    with pytest.raises(ValueError, match="friction"):
        all_stated(scene.model_copy(update={"loads": (rough,)}))


def test_wishes_are_kept_within_what_is_offered() -> None:
    sliders = [{"name": "load.0.force", "least": 0.0, "most": 20.0}]
    offered = {"sliders": sliders, "timeline": {"first": 0.0, "last": 3.0, "speeds": [1.0]}}

    def wish(**message: Any) -> Any:
        return understood(message, offered)

    assert wish(type="set", name="load.0.force", value=99) == ("load.0.force", 20.0)
    assert wish(type="set", name="load.0.force", value=float("nan")) == ("load.0.force", 0.0)
    for value in (10**3900, float("inf")):  # what JSON of 4 kB can hold
        assert wish(type="set", name="load.0.force", value=value) == ("load.0.force", 20.0)
        assert wish(type="set", name="load.0.force", value=-value) == ("load.0.force", 0.0)
        assert wish(type="seek", value=value) == ("seek", 3.0)
        assert wish(type="speed", value=value) is None
    assert wish(type="seek", value=-5) == ("seek", 0.0)
    for bad in (
        {"type": "set", "name": "material.C1", "value": 1},
        {"type": "set", "name": ["x"], "value": 1},
        {"type": "set", "name": "load.0.force", "value": "much"},
        {"type": "speed", "value": 77},
        {"type": "play", "value": 1},
        {"type": None},
    ):
        assert wish(**bad) is None


def answer(server: ViewServer, path: str = "", **headers: str) -> tuple[int, Any]:
    """Status and answer to a browser that has the server's token as a cookie."""
    base, token = server.url.split("?token=")
    port = urllib.parse.urlsplit(base).port
    cookie = {"Cookie": f"suas_view_{port}={token}"}
    request = urllib.request.Request(base + path, headers={**cookie, **headers})
    try:
        with urllib.request.urlopen(request, timeout=10) as response:
            return response.status, response
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error


def test_only_its_own_pages_are_answered() -> None:
    with ViewServer(Hub({"title": "x"}), "127.0.0.1", 0) as server:
        status, response = answer(server)
        assert status == 200
        policy = response.headers["Content-Security-Policy"]
        assert policy.startswith("default-src 'none'; script-src 'self';")
        port = address(server)[1]
        assert answer(server, Host=f"elsewhere.example:{port}")[0] == 403
        upgrade = {
            "Connection": "Upgrade",
            "Upgrade": "websocket",
            "Sec-WebSocket-Version": "13",
            "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
        }
        assert answer(server, "socket", Origin="http://elsewhere.example", **upgrade)[0] == 403
        assert answer(server, "socket", **upgrade)[0] == 403
        for name in (
            "nothing.js",
            "..%2fserver.py",
            "%2e%2e/server.py",
            "server.py",
            "../hub.py",
        ):
            assert answer(server, name)[0] == 404
        status, response = answer(server, f"{'a' * 300}.js")
        assert status == 404
        assert response.headers["X-Content-Type-Options"] == "nosniff"
        with (
            pytest.raises(OSError, match=f"127.0.0.1:{port}"),
            ViewServer(Hub({}), "127.0.0.1", port),
        ):
            pass


def test_nobody_is_answered_without_the_token(monkeypatch: pytest.MonkeyPatch) -> None:
    with ViewServer(Hub({"title": "x"}), "127.0.0.1", 0) as server:
        base, token = server.url.split("?token=")
        origin = base.removesuffix("/")
        for cookie in ("", f"suas_view_1={token}", f"suas_view_{address(server)[1]}=guess"):
            for path in ("", "page.js", "socket", "?token=", "?token=guess"):
                assert answer(server, path, Cookie=cookie, Origin=origin)[0] == 403
        # The address that is printed makes the token a cookie, and is left behind.
        browser = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
        with browser.open(server.url, timeout=10) as response:
            assert (response.status, response.url) == (200, base)
        with browser.open(base, timeout=10) as response:
            assert response.status == 200
    monkeypatch.setenv("SUAS_TOKEN", "known-beforehand")
    with ViewServer(Hub({}), "127.0.0.1", 0) as server:
        assert server.url.endswith("/?token=known-beforehand")
    for wrong in ("short", "with a space in it", "x" * 129, ""):
        monkeypatch.setenv("SUAS_TOKEN", wrong)
        with pytest.raises(ValueError, match="SUAS_TOKEN"):
            ViewServer(Hub({}), "127.0.0.1", 0)


def address(server: ViewServer) -> tuple[str, int]:
    """Host and port of a server."""
    found = urllib.parse.urlsplit(server.url)
    assert found.hostname is not None
    assert found.port is not None
    return found.hostname, found.port


def asked(server: ViewServer, request: bytes) -> bytes:
    """The begin of what is answered to these bytes."""
    host, port = address(server)
    with socket.create_connection((host, port), 10) as client:
        client.sendall(request.replace(b"HOST", f"Host: {host}:{port}".encode()))
        return client.recv(1000)


@pytest.mark.parametrize(
    ("request_", "status"),
    [
        (b"GET /" + b"a" * 9000 + b" HTTP/1.1\r\nHOST\r\n\r\n", 400),
        (b"GET / HTTP/1.1\r\nHOST\r\nX: " + b"a" * 9000 + b"\r\n\r\n", 400),
        (b"GET / HTTP/1.1\r\nHost: a:99999999\r\n\r\n", 403),
        (b"GET / HTTP/1.1\r\nHost: \xff\xfe\r\n\r\n", 403),
        (b"GET http://[ HTTP/1.1\r\nHOST\r\n\r\n", 400),
        (b"\x16\x03\x01\0\r\n\r\n", 400),
    ],
)
def test_requests_that_make_no_sense(
    request_: bytes, status: int, capfd: pytest.CaptureFixture[str]
) -> None:
    with ViewServer(Hub({"title": "x"}), "127.0.0.1", 0) as server:
        head = asked(server, request_).split(b"\r\n")[0]
    assert head.split()[1] == str(status).encode()
    assert "Traceback" not in capfd.readouterr().err


def test_connections_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fitting.view.server._MOST_CONNECTIONS", 3)
    with ViewServer(Hub({"title": "x"}), "127.0.0.1", 0) as server, contextlib.ExitStack() as s:
        for _ in range(3):
            s.enter_context(socket.create_connection(address(server)))
        end = time.monotonic() + 10
        while answer(server)[0] != 503:  # those accepted at once are counted afterwards
            assert time.monotonic() < end


@pytest.mark.parametrize(
    "begin", [b"", b"GET / HTTP/1.1\r\n", b"GET / HTTP/1.1\r\nHost: localhost\r\nX: "]
)
def test_a_connection_without_a_whole_request_is_closed(
    begin: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fitting.view.server._PATIENCE", 0.2)
    with (
        ViewServer(Hub({"title": "x"}), "127.0.0.1", 0) as server,
        socket.create_connection(address(server), 10) as client,
    ):
        client.sendall(begin)
        end = time.monotonic() + 10
        with contextlib.suppress(ConnectionError):  # one byte at a time is not an excuse
            while begin and time.monotonic() < end:
                client.sendall(b"x")
                time.sleep(0.02)
            assert client.recv(100) == b""
        assert time.monotonic() < end


# --- in the browser -----------------------------------------------------------------------


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    if CHROMIUM is None:
        pytest.skip("no Chromium or Chrome is installed")
    from playwright.sync_api import sync_playwright

    flags = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=CHROMIUM, args=flags)
        yield running
        running.close()


class Page:
    """An open page, its errors, and what it asked of any server."""

    def __init__(self, browser: Any, url: str) -> None:
        self._page = browser.new_page(viewport={"width": 900, "height": 600})
        self.errors: list[str] = []
        self.requests: list[str] = []
        self._page.on("console", lambda m: m.type == "error" and self.errors.append(m.text))
        self._page.on("pageerror", lambda error: self.errors.append(str(error)))
        self._page.on("request", lambda request: self.requests.append(request.url))
        self._page.goto(url)

    def text(self, selector: str) -> str:
        """What an element says."""
        return str(self._page.inner_text(selector))

    def until(self, selector: str, words: str, timeout: float = 60.0) -> str:
        """Wait until an element holds some words."""
        end = time.monotonic() + timeout
        while words not in self.text(selector):
            assert time.monotonic() < end, f"{words!r} not in {self.text(selector)!r}"
            self._page.wait_for_timeout(50)
        return self.text(selector)

    def pixels(self) -> np.ndarray:
        """The picture in space without its legend, colours from 0 to 1 [row, column, 3]."""
        self._page.wait_for_timeout(300)
        return imread(io.BytesIO(self._page.locator("#canvas").screenshot()))[:-60, :, :3]

    def slide(self, selector: str, value: float) -> None:
        """Move a slider."""
        self._page.locator(selector).evaluate(
            "(input, value) => { input.value = value; input.dispatchEvent(new Event('input'));"
            " input.dispatchEvent(new Event('change')); }",
            value,
        )

    def press(self, selector: str) -> None:
        """Click on an element."""
        self._page.click(selector)

    def arrow(self) -> np.ndarray:
        """Middle of the red pixels, where nothing but arrows is red [px]."""
        rows, columns = np.nonzero(self.pixels()[..., 0] > self.pixels()[..., 2] + 0.3)
        return np.array([columns.mean(), rows.mean()])

    def drag(self, start: np.ndarray, end: np.ndarray) -> None:
        """Move what is at one place to another, with the mouse."""
        self._page.mouse.move(*start)
        self._page.mouse.down()
        for share in np.linspace(0, 1, 8)[1:]:
            self._page.mouse.move(*(start + share * (end - start)))
            self._page.wait_for_timeout(30)
        self._page.mouse.up()
        self._page.wait_for_timeout(300)

    def close(self) -> None:
        """Close the page."""
        self._page.close()


@contextlib.contextmanager
def shown(hub: Hub, run: Callable[[Callable[[], bool]], Any]) -> Iterator[ViewServer]:
    """A source that runs beside its server."""
    over = threading.Event()
    worker = threading.Thread(target=run, args=(over.is_set,))
    with ViewServer(hub, "127.0.0.1", 0) as server:
        worker.start()
        try:
            yield server
        finally:
            over.set()
            worker.join(timeout=60)


def reddish(pixels: np.ndarray) -> int:
    return int((pixels[..., 0] > pixels[..., 2] + 0.2).sum())


def bluish(pixels: np.ndarray) -> int:
    return int((pixels[..., 2] > pixels[..., 0] + 0.2).sum())


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Frames at rest, pressed between 20 and 40 degrees, one taxel missing, one saturated."""
    path = tmp_path_factory.mktemp("view") / "press.csv"
    with LogWriter(path, log_header(skin=str(SKIN))) as writer:
        for k in range(5):
            row: list[int | None] = [REST] * 8
            if k:
                row = [REST - 50, REST - 50, None, REST - 50, 65535, counts_under(2e-3)] + 2 * [
                    REST
                ]
            writer.write(0.5 * k, 0.5 * k, 100 + k, 0, row, ())
    return path


def test_a_log_on_its_timeline(browser: Any, log: Path) -> None:
    spec = load_skin(SKIN)
    pictures = ReadingsPictures(spec, None)
    readings = readings_of(read_log(log), spec, 2.0)
    source = LogSource(readings, pictures, log.name, estimates=ESTIMATES)
    with shown(source.hub, source.run) as server:
        page = Page(browser, server.url)
        page.until("#title", "press.csv")
        page.until("#place", "2.00 of 2.00 s")  # it has played to its end
        page.slide("#seek", 0.1)
        page.until("#place", "0.00 of")
        assert page.text("#status") == "no contact"
        assert "Nothing touches the skin" in page.text("#message")
        at_rest = page.pixels()
        assert reddish(at_rest) < 500
        page.slide("#seek", 0.6)
        page.until("#place", "0.50 of")
        values = page.text("#values")
        assert "1.234 kPa" in values or "1.235 kPa" in values
        assert "30.00 ± 0.57°, 7.000 ± 0.200 N" in values
        assert "101 (2 of 5)" in values
        assert "2.0" in values.split("smallest gap over a taxel")[1][:12]
        pressed = page.pixels()
        assert reddish(pressed) > 5000  # the dent
        assert bluish(pressed) > 500 > bluish(at_rest)  # where the oil went
        page.press("#show-membrane")
        page.press("#show-taxels")
        arrows = page.pixels()
        assert 100 < reddish(arrows) < reddish(pressed)
        page.press("#show-contacts")
        assert reddish(page.pixels()) == 0
        for place, words in ((1.1, "wall contact"), (1.6, "too few taxels"), (2.0, "pull")):
            page.slide("#seek", place)
            page.until("#status", words)
        assert page.errors == []
        origin = server.url.split("/?token=")[0]
        assert all(url.startswith((origin, "data:")) for url in page.requests)
        page.close()


def test_a_scene_answers_its_sliders(browser: Any) -> None:
    scene = load_scene(CONFIGS / "scenes" / "case_b.toml")
    source = SceneSource(scene, "case_b.toml")

    def pressure(page: Page) -> float:
        return float(page.text("#values").split("oil pressure")[1].split("kPa")[0])

    with shown(source.hub, source.run) as server:
        page = Page(browser, server.url)
        page.until("#status", "converged", 300)
        assert pressure(page) == pytest.approx(10.0, rel=0.01)  # the paper's case B
        before = page.text("#values")
        page.slide("[data-name='load.0.force']", 10.0)
        page.until("#sliders", "10.0 N")
        while page.text("#values") == before:
            time.sleep(0.05)
        lighter = pressure(page)
        assert 3.0 < lighter < 7.0
        before = page.text("#values")
        page.slide("[data-name='stiffness']", 2.0)
        while page.text("#values") == before:
            time.sleep(0.05)
        # Twice the stiffness under twice the force is the same shape at twice the pressure.
        page.slide("[data-name='load.0.force']", 20.0)
        page.until("#values", f"{2 * lighter:.2f}"[:4])
        assert reddish(page.pixels()) > 2000
        # The arrow follows the mouse that takes it, over the skin.
        for hidden in ("#show-membrane", "#show-taxels"):
            page.press(hidden)
        before, told = page.arrow(), page.text("#sliders")
        page.drag(before, before - np.array([120.0, 30.0]))
        while page.text("#sliders") == told or page.text("#status") != "converged":
            time.sleep(0.05)
        shift = page.arrow() - before
        assert shift[0] == pytest.approx(-120.0, abs=30.0)  # it turns, too
        assert page.errors == []
        page.close()
    assert source.hub.latencies


class SimulatedDevice:
    """A device on a pseudo-terminal that is unplugged, plugged in and silent on demand."""

    def __init__(self, link: Path) -> None:
        self.plugged, self.speaking, self.ended = (threading.Event() for _ in range(3))
        self.plugged.set()
        self.speaking.set()
        self.device = Device("cobs", link=link)
        self._thread = threading.Thread(target=self._play)
        self._thread.start()

    def _play(self) -> None:
        self.device.wait_for_host()
        self.device.play(self._readings())

    def _readings(self) -> Iterator[Reading]:
        present = True
        for seq in range(100_000):
            while not self.speaking.is_set() and not self.ended.is_set():
                time.sleep(0.02)
            if self.ended.is_set():
                return
            if present != self.plugged.is_set():
                present = not present
                (self.device.plug_in if present else self.device.unplug)()
            yield Reading(seq, seq / 50, 0, counts_of(seq))

    def end(self) -> int:
        """Stop playing; the number of frames that a host took."""
        self.ended.set()
        self._thread.join()
        self.device.close()
        return self.device.played.rows - self.device.played.stalled


def counts_of(seq: int) -> tuple[int, ...]:
    return tuple(REST + (60 if k == seq % 8 else -8) for k in range(8))


def test_a_live_device_its_lost_port_and_a_page_opened_again(
    browser: Any, tmp_path: Path
) -> None:
    log, spec = tmp_path / "run.csv", load_skin(SKIN)
    source = LiveSource(ReadingsPictures(spec, None), "the port")
    simulated = SimulatedDevice(tmp_path / "port")
    options = LiveOptions(simulated.device.port, "cobs", latency=5.0, log=log)
    streams: list[Stream] = []
    run = threading.Thread(target=_run_unsignalled, args=(options, source, streams))
    with ViewServer(source.hub, "127.0.0.1", 0) as server:
        page = Page(browser, server.url)
        page.until("#link", "waiting for the device")
        run.start()
        page.until("#link", "port connected")
        page.until("#status", "ok")
        values = page.text("#values")
        simulated.plugged.clear()
        page.until("#link", "port lost")
        assert "waits for it to come back" in page.text("#message")
        page.until("#sentences", "waiting for it to come back")
        simulated.plugged.set()
        page.until("#link", "port connected")
        page.until("#sentences", "back after")
        page.close()
        again = Page(browser, server.url)
        again.until("#link", "port connected")
        again.until("#sentences", "back after")  # what happened before it was opened
        simulated.speaking.clear()
        again.until("#link", "device silent")
        taken = simulated.end()
        streams[0].stop.set()
        run.join()
        assert again.errors == []
        again.close()
    assert "17.19 ± 0.57°" in values
    recorded = read_log(log)
    # What came before the run listened is forgotten; what was on its way goes with the cable.
    first = int(recorded.seq[0])
    assert 0 <= taken - first - len(recorded) <= 2
    rows = zip(recorded.seq.tolist(), recorded.so, strict=True)
    assert all(tuple(so) == counts_of(seq) for seq, so in rows)
    assert source.hub.latencies


def _run_unsignalled(options: LiveOptions, source: LiveSource, streams: list[Stream]) -> None:
    """A live run in a thread, where signals can't be taken over."""
    import fitting.inverse_load.live.run as live

    @contextlib.contextmanager
    def unsignalled(stream: Stream) -> Iterator[None]:
        streams.append(stream)
        yield

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(live, "ended_by_signal", unsignalled)
        run_live(KnownLoads, options, lambda *_: [source])  # type: ignore[arg-type]


def test_a_picture_of_320_taxels_is_small_and_the_last_one_stays() -> None:
    spec = load_skin(PAD)
    pictures = ReadingsPictures(spec, None)
    hub = Hub(pictures.description("pad"))
    covariance = np.diag([1e-4, 1e-6, 1e-2])
    contacts = tuple(Contact(0.1 * k, 3.0, None, covariance, axial=0.01) for k in range(3))
    estimate = LoadEstimate(True, contacts, 900.0, False, 1.0, "ok")
    rng = np.random.default_rng(0)
    stuck = np.zeros(320, bool)
    for k in range(50):  # nobody looks: nothing is encoded, and only the last is kept
        so = np.round(pictures.film.rest + rng.normal(0, 2, 320))
        hub.show(pictures.picture(0.01 * k, so, stuck, estimate, []))
    message = hub.newest(0)
    assert message is not None
    assert message.number == 50
    assert len(message.content) < 11_000
    size = int.from_bytes(message.content[:4], "little")
    header = json.loads(message.content[4 : 4 + size])
    assert header["t_s"] == pytest.approx(0.49)
    assert header["force_N"] == 9.0
    assert hub.newest(50) is None


def test_memory_does_not_grow_with_the_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fitting.view.hub._MOST_SAMPLES", 200)
    spec = load_skin(SKIN)
    pictures = ReadingsPictures(spec, None)
    hub = Hub(pictures.description("skin"))
    stuck = np.zeros(8, bool)

    def frames(first: int, count: int) -> None:
        for k in range(first, first + count):
            so = pictures.film.rest + k % 7
            hub.show(pictures.picture(0.01 * k, so, stuck, None, []))
            hub.say(f"sentence {k}")
            if k % 3 == 0:
                hub.newest(0)

    frames(0, 300)  # fills what is kept for the charts
    ours = [tracemalloc.Filter(True, str(Path(fitting.__file__).parent / "*"))]

    def traced() -> int:
        # What the libraries' caches hold at the moment is not the frames'.
        gc.collect()
        statistics = tracemalloc.take_snapshot().filter_traces(ours).statistics("filename")
        return sum(s.size for s in statistics)

    tracemalloc.start()
    frames(300, 600)  # what is replaced one by one is traced from here on
    before = traced()
    frames(900, 900)
    grown = traced() - before
    tracemalloc.stop()
    assert grown < 20_000  # three times the frames above


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("LOG", "more.csv"), "--live PORT only"),
        (("LOG", "--loads", "x", "--taxels-only"), "give one of them"),
        (("LOG", "--history", "x.csv"), "goes with a scene"),
        (("HISTORY",), "as --history"),
        (("LOG", "--address", "8700"), "HOST:PORT"),
        (("LOG", "--skin", "nowhere.toml"), "nowhere.toml"),
        (("nowhere.toml",), "nowhere.toml"),
        (("SKIN", "--live", "/dev/nowhere"), "/dev/nowhere"),
    ],
)
def test_what_cannot_be_shown_is_refused(
    arguments: tuple[str, ...], words: str, log: Path
) -> None:
    loads = SKIN.parents[1] / "scenes" / "hold.csv"
    files = {"LOG": str(log), "SKIN": str(SKIN), "HISTORY": str(loads)}
    given = [files.get(argument, argument) for argument in arguments]
    result = CliRunner().invoke(app, ["view", *given])
    assert result.exit_code == 2
    assert words in result.stderr


def test_a_log_is_served_until_its_time_is_over(log: Path) -> None:
    options = ["--taxels-only", "--address", "127.0.0.1:0", "--duration", "0.2"]
    result = CliRunner().invoke(app, ["view", str(log), *options])
    assert result.exit_code == 0, result.output
    assert result.stdout.startswith("http://127.0.0.1:")
