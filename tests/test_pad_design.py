"""Designs of pads: places and their mirror images, figures and slopes, what is refused."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fitting.datasheet.readings import Readings
from fitting.design.pad import PadProblem
from fitting.design.want import Limit, Variable, Want
from fitting.inverse_load.settings import DIAMETER
from suas_jax import Loads, Skin, forward, skin_of
from suas_jax.config import SkinSpec, load_skin, scene_from_dict
from tests.test_design import is_refused
from tests.test_pad_forward import SCENE

ROOT = Path(__file__).parent.parent
SHIPPED = ROOT / "configs" / "skins" / "suas-pad.toml"
WANT = ROOT / "configs" / "design" / "pad.toml"
GAP = Variable("geometry.oil_gap", ("geometry.oil_gap",), 4e-3, 6e-3, False)


def want(spec: SkinSpec, keys: tuple[str, ...], degrees: tuple[float, float]) -> Want:
    limits = tuple(Limit(key, 1.0, True) for key in keys)
    region: Any = tuple(np.deg2rad(degrees))
    return Want(
        SHIPPED, spec, (GAP,), "force_resolution_N", False, limits, region, 5, 5.0, 1, 0
    )


class _StandIn(PadProblem):
    """Readings that follow a formula of where taxels are, and of the gap."""

    def _readings(self, skins: Any, k: int, force: float) -> list[Readings]:
        return [readings(skin, self._places[k], force) for skin in skins]

    def _contacts(self, skins: Any, k: int) -> np.ndarray:
        angle, axial = self._places[k]
        gaps = np.array([float(skin.geometry.oil_gap[0]) for skin in skins])
        return np.asarray(1e3 * gaps * (2 + angle**2 + 1e3 * axial**2))


def readings(skin: Skin, place: Any, force: float) -> Readings:
    own, gap = skin.electrodes.taxels, float(skin.geometry.oil_gap[0])
    angle, axial = np.asarray(own.angle)[:, 0], np.asarray(own.axial)[:, 0]
    along, across = (angle - place[0]) / 0.3, (axial - place[1]) / 0.02
    light = 1e-2 / gap * np.exp(-(along**2) - across**2) * np.asarray(own.diameter)[:, 0] / 4e-3
    so = 4000 + 100 * light * force
    slope = np.stack(
        [2 * along * light * force / 0.3, 2 * across * light * force / 0.02, light]
    )
    zero = np.zeros(())
    return Readings(so, 100 * slope, gap - 1e-4 * force, zero - 1e-4, zero, zero)


def test_a_quarter_of_the_places_tells_all_of_them() -> None:
    """Readings of mirror images are those of the places themselves."""
    keys = ("range_N", "place_resolution_m", "sensitivity_counts_per_N", "nonlinearity")
    spec = load_skin(SHIPPED)
    even = _StandIn(want(spec, keys, (-60.0, 60.0)))
    assert (len(even._places), even.grid) == (6, (5, 3))
    whole = _StandIn(want(spec, keys, (-60.0, 59.99)))
    assert len(whole._places) == 15
    x = np.array([0.4])
    found, expected = even.placed(x), whole.placed(x)
    assert found.found
    for key in even.keys:
        np.testing.assert_allclose(found.values[key], expected.values[key], 2e-3, 1e-9)
        np.testing.assert_allclose(found.slopes[key], expected.slopes[key], 2e-3, 1e-6)
    # Ranges go with the gap, signals with 1/gap, but that taxels in rows move a little with it.
    slope = 2e-3 / (4e-3 + 0.4 * 2e-3)
    for key, sign, rtol in (("range_N", 1, 1e-6), ("sensitivity_counts_per_N", -1, 0.03)):
        by_gap = sign * slope * found.values[key]
        np.testing.assert_allclose(found.slopes[key][:, 0], by_gap, rtol)


@pytest.mark.long  # second program of a pad: readings with their slopes
def test_figures_of_a_pad_and_their_slopes() -> None:
    spec = scene_from_dict(SCENE)
    # Two taxels don't tell the three numbers of a contact, so there is no resolution.
    keys = ("min_gap_m", "sensitivity_counts_per_N", "nonlinearity")
    wanted = dataclasses.replace(want(spec, keys, (-25.0, 10.0)), goal="range_N")
    problem = PadProblem(wanted, elements=(10, 8), axials=2)
    x, far = np.array([-0.4]), 5e-3
    found, *sides = (problem.placed(x + side) for side in (0.0, -far, far))
    assert found.found
    for key, slopes in found.slopes.items():
        by_steps = (sides[1].values[key] - sides[0].values[key]) / (2 * far)
        atol = 1e-4 * np.abs(found.values[key]).max()
        np.testing.assert_allclose(slopes[:, 0], by_steps, 1e-3, atol, err_msg=key)
    # The gap is closed under first contact, and open as told under the rated force.
    skin = skin_of(spec, problem.want.inputs(x), elements=(10, 8), contact=False)
    for k, place in enumerate(problem._places):
        pad = problem._on_mesh(skin, k)
        force = np.append(found.values["range_N"][k], problem.rated)
        gaps = [float(forward(pad, Loads.patch(*place, f, DIAMETER)).min_gap[0]) for f in force]
        assert abs(gaps[0]) < 1e-5 * 3e-3
        assert gaps[1] == pytest.approx(found.values["min_gap_m"][k], rel=1e-6)
    # Slopes by place and force are differences of readings.
    k, h, rows = 0, 1e-5, []
    at = np.append(problem._places[0], problem.rated)
    for step in h * np.eye(3) * [1.0, 0.1, 100.0]:
        high, low = (
            np.asarray(forward(problem._on_mesh(skin, k), Loads.patch(*y, DIAMETER)).so)[:, 0]
            for y in (at + step, at - step)
        )
        rows.append((high - low) / (2 * step.max()))
    slopes = problem._readings([skin], k, problem.rated)[0].slope
    own = np.array([rows[0] / float(skin.geometry.outer_size[0]), *rows[1:]])
    np.testing.assert_allclose(slopes, own, rtol=1e-4, atol=1e-6 * np.abs(own).max())


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("geometry.thickness", "geometry.width", "moves a pad's edges"),
        ("force  =", 'units = "95 %"\nforce  =', "is known of sections alone"),
    ],
)
def test_what_a_pad_cannot_is_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    is_refused(WANT, tmp_path, old, new, words)
