"""The demo of the site's front page: its table's interpolation, here and in the browser."""

import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parent.parent / "docs" / "extensions"))

import demo_table as demo

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)


def a_table() -> Any:
    """Dents that are cubic in place and force, in whole units."""
    share = [demo.along(n, np.zeros(1))[:, 0] for n in demo.SIDES]
    shape = (1 - share[0][:, None] ** 2) * (1 - share[1] ** 2)
    a, z, f = np.meshgrid(demo.ANGLES, demo.AXIALS, demo.FORCES, indexing="ij")
    size = (1 + a - a**3) * (1 - 300 * z**2) * (f - 0.02 * f**3)
    return np.round(-1000 * size[..., None, None] * shape)


def a_skin() -> dict[str, Any]:
    rng = np.random.default_rng(2)
    return {
        "half_angle": np.pi / 2, "width": 0.123, "oil_gap": 5e-3, "wall": 52.5e-3,
        "noise": 2.0, "plate": 0.8, "diameter": 4e-3,
        "taxel_angle": rng.uniform(-1, 1, 40), "taxel_axial": rng.uniform(-0.04, 0.04, 40),
    }  # fmt: skip


def test_the_grid_follows_the_finger() -> None:
    for centre in (0.0, 0.4, -0.6):
        places = demo.along(14, np.array([centre]))[:, 0]
        assert places[[0, 14, -1]] == pytest.approx([-1, centre, 1], abs=1e-12)
        steps = np.diff(places)
        assert (steps > 0).all()
        assert steps[13] < steps[0]
        assert steps[14] < steps[-1]


def test_cubics_are_interpolated_exactly() -> None:
    for nodes in (demo.ANGLES, demo.AXIALS, demo.FORCES):
        for x in np.linspace(nodes[0], nodes[-1], 23):
            first, share = demo.weights(nodes, x)
            near = nodes[first : first + 4]
            for power in range(4):
                assert share @ near**power == pytest.approx(x**power, abs=1e-12)


def test_the_page_reads_the_table_as_its_check_does(tmp_path: Path) -> None:
    if CHROMIUM is None:
        pytest.skip("no Chromium or Chrome is installed")
    from playwright.sync_api import sync_playwright

    table, skin = a_table(), a_skin()
    data = {**skin, **demo.NODES, "errors": np.ones(3), "held_out": 1, "table": table}
    file = tmp_path / "demo.html"
    file.write_text(demo.filled(data), encoding="utf-8")
    places = [(0.3, 0.01, 4.2), (0.0, 0.0, 1.0), (1.0, 0.044, 9.5)]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page, errors, asked = browser.new_page(), [], []
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("request", lambda request: asked.append(request.url))
        page.goto(file.as_uri())
        for place in places:
            change = demo.interpolated(table * demo.UNIT, place)
            known = demo.counts(change, skin, np.array(place)) - skin["plate"] / 5e-3
            assert page.evaluate("counts", list(place)) == pytest.approx(known, abs=1e-9)
            mirrored = page.evaluate("counts", [-place[0], -place[1], place[2]])
            turned = {k: -skin[k] for k in ("taxel_angle", "taxel_axial")}
            again = demo.counts(change, skin | turned, np.array(place)) - skin["plate"] / 5e-3
            assert mirrored == pytest.approx(again, abs=1e-9)
        # What was read without noise is what the estimate finds.
        start, truth = [0.295, 0.0103, 4.15], [0.3, 0.01, 4.2]
        found, half = page.evaluate(f"estimate(counts({truth}), {start})")
        assert found == pytest.approx(truth, rel=1e-3)
        assert all(x > 0 for x in half)
        assert errors == []
        assert asked == [file.as_uri()]  # nothing from elsewhere
        browser.close()
