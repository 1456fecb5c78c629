"""Drift of the readings at rest: followed where nothing touches, left alone in contact."""

import numpy as np
import pytest

from fitting.inverse_load.drift import DriftDensities, DriftFollower
from fitting.inverse_load.fit.detection import ArcDetector

TAXELS, NOISE = 40, 2.0
PLACES = np.linspace(-1.3, 1.3, 150)
AT = np.linspace(-1.4, 1.4, TAXELS)
# A contact raises the taxels near it and lowers all others, as trapped oil does.
SIGNATURES = 10 * np.exp(-((AT - PLACES[:, None]) ** 2) / 0.02) - 1.5
REST = np.full(TAXELS, 160.0) + 10 * np.cos(3 * AT)


def follower(densities: DriftDensities | None = None) -> DriftFollower:
    return DriftFollower(REST, NOISE**2, ArcDetector(SIGNATURES), densities)


def readings(drift: np.ndarray, force: np.ndarray, seed: int) -> np.ndarray:
    """Changes from rest [frame, taxel]: drift, a contact in the middle, noise."""
    random = np.random.default_rng(seed)
    pressed = force[:, None] * SIGNATURES[len(PLACES) // 2]
    return drift + pressed + random.normal(0, NOISE, (len(force), TAXELS))


@pytest.mark.parametrize("kind", ["common", "gain", "taxel"])
def test_drifts_of_five_counts_are_followed_through_contacts(kind: str) -> None:
    frames = 8000
    time = np.arange(frames) / 40.0
    ramp = (time / time[-1])[:, None]
    own = 5 * np.random.default_rng(1).choice([-1.0, 1.0], TAXELS)
    drift = {"common": 5 * ramp + 0 * REST, "gain": 0.01 * ramp * REST, "taxel": ramp * own}
    force = np.where((time // 4) % 2 == 1, 8.0, 0.0)
    found = follower().follow(time, readings(drift[kind], force, 2))
    off = (found.offset - drift[kind])[400:]
    sigma = np.sqrt(found.variance[400:])
    assert np.sqrt((off**2).mean()) < 0.5
    assert 0.6 < np.sqrt(((off / sigma) ** 2).mean()) < 1.6


def test_what_has_drifted_before_the_first_frame_is_learned_at_once() -> None:
    start = 5 + np.random.default_rng(3).normal(0, 2, TAXELS)
    time = np.arange(200) / 40.0
    found = follower().follow(time, readings(start[None], np.zeros(200), 4))
    assert np.abs(found.offset[-1] - start).max() < 5 * NOISE / np.sqrt(200)


def test_a_contact_from_the_first_frame_on_teaches_nothing() -> None:
    time = np.arange(400) / 40.0
    own = follower()
    found = own.follow(time, readings(np.zeros((1, TAXELS)), np.full(400, 6.0), 5))
    assert not own.known
    assert not found.offset.any()
    assert not found.variance.any()


def test_uncertainty_grows_in_contact_by_the_stated_walk() -> None:
    densities = DriftDensities()
    own = follower(densities)
    own.follow(np.arange(320) / 40.0, readings(np.zeros((1, TAXELS)), np.zeros(320), 6))
    before, drift = own.covariance, own.drift
    own.follow(
        10 + np.arange(320) / 40.0, readings(np.zeros((1, TAXELS)), np.full(320, 9.0), 7)
    )
    first, last = 320 / 40 - 32 / 80 - 1 / 80, 10 + 320 / 40 - 32 / 80 - 1 / 80
    np.testing.assert_array_equal(own.drift, drift)
    expected = before + densities.walk(REST, last - first)
    np.testing.assert_allclose(own.covariance, expected, rtol=1e-9, atol=1e-12)


def test_walk_is_that_of_its_three_parts() -> None:
    densities, rest = DriftDensities(0.2, 0.3, 0.01, 1.0), np.array([100.0, 200.0])
    # 10 s of each taxel's 0.2^2, of all taxels' 0.3^2, of a gain's 0.01^2 times rest x rest.
    expected = 10 * np.array([[0.04 + 0.09 + 1.0, 0.09 + 2.0], [0.09 + 2.0, 0.04 + 0.09 + 4.0]])
    np.testing.assert_allclose(densities.walk(rest, 10.0), expected, rtol=1e-12)


@pytest.mark.parametrize("start", [15.0, -15.0])
def test_all_readings_far_from_the_baseline_are_a_drift_and_no_contact(start: float) -> None:
    """Three standard deviations of the common walk between the baseline and the first frame."""
    own = follower()
    drift = np.full((1, TAXELS), start)
    found = own.follow(np.arange(200) / 40.0, readings(drift, np.zeros(200), 8))
    assert own.known
    assert np.abs(found.offset[-1] - start).max() < 5 * NOISE / np.sqrt(200)


def test_frames_of_a_stream_are_taken_together() -> None:
    own = DriftFollower(REST, NOISE**2, ArcDetector(SIGNATURES), gathered=8)
    still = readings(np.zeros((1, TAXELS)), np.zeros(8), 9)
    found = [own.follow(np.array([k / 40]), still[k : k + 1]) for k in range(8)]
    assert [bool(one.variance.any()) for one in found] == [False] * 7 + [True]
    one_by_one = DriftFollower(REST, NOISE**2, ArcDetector(SIGNATURES))
    one_by_one.follow(np.array([0.0]), still[:1])
    assert one_by_one.known
    # Frames that come together are taken at once.
    log = DriftFollower(REST, NOISE**2, ArcDetector(SIGNATURES), gathered=8)
    log.follow(np.arange(3) / 40.0, still[:3])
    assert log.known
