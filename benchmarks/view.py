"""What `suas view` costs: from a frame's arrival to its picture, processor time, memory.

Frames of the shipped pad (320 taxels) at 100 Hz with three contacts that are not estimated but
given, so that what is measured is the page's share alone; a page is open in headless Chromium
with software WebGL, or none is.

    python benchmarks/view.py --seconds 60
    python benchmarks/view.py --endure 60       # memory over minutes with a page open
"""

import argparse
import os
import shutil
import time
from pathlib import Path

import numpy as np
import psutil

from fitting.inverse_load.estimate.estimate import Contact, LoadEstimate
from fitting.inverse_load.live.stream import FrameReadings, LiveFrame
from fitting.view.live_source import LiveSource
from fitting.view.readings_picture import ReadingsPictures
from fitting.view.server import ViewServer
from suas_jax import configure, load_skin

SKIN = Path(__file__).parent.parent / "configs" / "skins" / "suas-pad.toml"
RATE = 100.0
SOFTWARE = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
NONE = ["--no-sandbox", "--disable-gpu", "--disable-3d-apis"]


def frames(source: LiveSource, pictures: ReadingsPictures, seconds: float) -> None:
    """Hand over frames at the rate of the device."""
    rng = np.random.default_rng(0)
    film, stuck = pictures.film, np.zeros(320, bool)
    covariance = np.diag([1e-4, 1e-6, 1e-2])
    begin = time.monotonic()
    for k in range(round(seconds * RATE)):
        time.sleep(max(0.0, begin + k / RATE - time.monotonic()))
        angle = 0.5 * np.sin(0.02 * k)
        near = np.exp(-((film.angle - angle) ** 2) / 0.02 - (film.axial / 0.012) ** 2)
        so = np.round(film.rest + 90 * near + rng.normal(0, 2, 320))
        contacts = tuple(
            Contact(angle + shift, 5.0, None, covariance, axial=0.0) for shift in (0, 0.4, 0.8)
        )
        estimate = LoadEstimate(True, contacts, 1500.0, False, 1.0, "ok")
        readings = FrameReadings(k / RATE, k, time.monotonic(), so, stuck)
        source.estimated(LiveFrame(k / RATE, k, estimate, None, 0, readings))


def with_a_page(
    source: LiveSource, pictures: ReadingsPictures, url: str, seconds: float, flags: list[str]
) -> None:
    """Measure while a page is open."""
    from playwright.sync_api import sync_playwright

    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=flags)
        page = browser.new_page(viewport={"width": 1280, "height": 760})
        page.goto(url)
        page.wait_for_selector("body[data-drawn]")
        frames(source, pictures, 5.0)
        source.hub.latencies.clear()
        before = psutil.Process().memory_info().rss
        begin, moment = time.process_time(), time.monotonic()
        frames(source, pictures, seconds)
        spent = time.process_time() - begin
        elapsed = time.monotonic() - moment
        grown = psutil.Process().memory_info().rss - before
        browser.close()
    latency = np.array(source.hub.latencies)
    middle, most = 1e3 * np.quantile(latency, (0.5, 0.99))
    print(f"  {1e3 * spent / (seconds * RATE):.2f} ms of processor a frame")
    print(f"  {len(latency) / elapsed:.1f} pictures a second")
    print(f"  frame to picture: median {middle:.1f} ms, 99 % within {most:.1f} ms")
    print(f"  memory grew by {grown / 1e6:.2f} MB in {elapsed:.0f} s")


def endure(source: LiveSource, pictures: ReadingsPictures, url: str, minutes: int) -> None:
    """Print the server's memory every five minutes while a page is open."""
    from playwright.sync_api import sync_playwright

    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=NONE)
        browser.new_page().goto(url)
        for passed in range(0, minutes + 1, 5):
            memory = psutil.Process().memory_info().rss
            print(f"{passed:4d} min: {memory / 1e6:.1f} MB", flush=True)
            if passed < minutes:
                frames(source, pictures, 300.0)
        browser.close()


def main() -> None:
    """Measure without a page, then with one."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="of each run")
    parser.add_argument("--endure", type=int, metavar="MINUTES", help="memory alone")
    arguments = parser.parse_args()
    seconds = arguments.seconds
    configure()
    pictures = ReadingsPictures(load_skin(SKIN), None)
    source = LiveSource(pictures, "benchmark")
    with ViewServer(source.hub, "127.0.0.1", 0) as server:
        frames(source, pictures, 3.0)
        if arguments.endure:
            endure(source, pictures, server.url, arguments.endure)
            return
        begin = time.process_time()
        frames(source, pictures, seconds)
        spent = time.process_time() - begin
        print(f"no page open: {1e3 * spent / (seconds * RATE):.2f} ms of processor a frame")
        print("a page that draws by software:")
        with_a_page(source, pictures, server.url, seconds, SOFTWARE)
        print("a page without a picture in space:")
        with_a_page(source, pictures, server.url, seconds, NONE)
        message = source.hub.newest(0)
        assert message is not None
        print(f"{len(message.content)} bytes a picture; load average {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
