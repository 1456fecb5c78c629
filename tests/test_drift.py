"""Drift of the readings at rest: followed where nothing touches, left alone in contact."""

import numpy as np
import pytest

from fitting.inverse_load.drift import Drift, DriftCovariance, DriftDensities, DriftFollower
from fitting.inverse_load.estimate.estimate import STATUS, LoadEstimate
from fitting.inverse_load.fit.detection import ArcDetector, Detection
from fitting.inverse_load.frames import drifting

TAXELS, NOISE = 40, 2.0
PLACES = np.linspace(-1.3, 1.3, 150)
AT = np.linspace(-1.4, 1.4, TAXELS)
# A contact raises the taxels near it and lowers all others, as trapped oil does.
SIGNATURES = 10 * np.exp(-((AT - PLACES[:, None]) ** 2) / 0.02) - 1.5
REST = np.full(TAXELS, 160.0) + 10 * np.cos(3 * AT)


def follower(densities: DriftDensities | None = None) -> DriftFollower:
    return DriftFollower(REST, NOISE**2, ArcDetector(SIGNATURES), densities)


def matrix(covariance: DriftCovariance) -> np.ndarray:
    """The covariance [taxel, taxel]."""
    return np.diag(covariance.own) + covariance.shared @ covariance.shared.T


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


@pytest.mark.parametrize("jump", [500.0, -500.0])
def test_a_channel_that_jumped_does_not_end_the_learning_of_the_others(jump: float) -> None:
    time = np.arange(3200) / 8.0
    ramp = 12 * (time / time[-1])[:, None]
    change = readings(ramp, np.zeros(3200), 13)
    change[100:, 22] += jump
    own = follower()
    found = own.follow(time, change)
    others = np.arange(TAXELS) != 22
    assert np.abs(found.offset[-1] - 12)[others].max() < 1.5
    assert found.offset[-1, 22] == pytest.approx(12, abs=3)  # with all others
    before = own.drift
    pressed = readings(np.full((1, TAXELS), 12.0), np.full(32, 9.0), 14)
    pressed[:, 22] += jump
    own.follow(time[-1] + np.arange(32) / 8.0, pressed)
    np.testing.assert_array_equal(own.drift, before)


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
    before, drift = matrix(own.covariance), own.drift
    own.follow(
        30 + np.arange(320) / 40.0, readings(np.zeros((1, TAXELS)), np.full(320, 9.0), 7)
    )
    first, last = 320 / 40 - 32 / 80 - 1 / 80, 30 + 320 / 40 - 32 / 80 - 1 / 80
    np.testing.assert_array_equal(own.drift, drift)
    expected = before + matrix(densities.walk(REST, last - first))
    np.testing.assert_allclose(matrix(own.covariance), expected, rtol=1e-9, atol=1e-12)


def test_a_clock_that_goes_back_undoes_no_uncertainty() -> None:
    own = follower()
    still = readings(np.zeros((1, TAXELS)), np.full(3, 9.0), 7)
    for time in (5.0, 3.0, 4.0):
        own.follow(np.array([time]), still[:1])
    # Of the walk before the first frame and of the second from 3 s to 4 s.
    expected = matrix(DriftDensities().walk(REST, 1200.0 + 1.0))
    np.testing.assert_allclose(matrix(own.covariance), expected, rtol=1e-12)


class Listening(ArcDetector):
    """Keeps what it is told of the drift."""

    weight: np.ndarray
    shared: np.ndarray

    def test(self, left: np.ndarray, weight: np.ndarray, shared: np.ndarray) -> Detection:
        """As `ArcDetector.test`."""
        self.weight, self.shared = weight, shared
        return super().test(left, weight, shared)


def test_detection_is_told_of_the_drift_as_it_is() -> None:
    """Each taxel's variance, and the correlations that patterns over all taxels have."""
    detector = Listening(np.hstack([SIGNATURES, np.zeros((len(PLACES), 2 * TAXELS))]))
    densities = DriftDensities(gain=3e-2)
    own = DriftFollower(REST, NOISE**2, detector, densities)
    frames = [(0.0, 0.0), (0.1, 9.0), (300.0, 9.0), *100 * [(300.1, 0.0)], (2000.0, 9.0)]
    before = 0.0
    for time, force in frames:
        told = matrix(own.covariance) + matrix(densities.walk(REST, time - before))
        own.follow(np.array([time]), readings(np.zeros((1, TAXELS)), np.array([force]), 10))
        assert not detector.weight[:, TAXELS:].any()
        assert not detector.shared[:, TAXELS:].any()
        apart = 1 / detector.weight[0, :TAXELS] - NOISE**2
        together = detector.shared[:, :TAXELS]
        np.testing.assert_allclose(apart + (together**2).sum(0), np.diag(told), rtol=1e-9)
        np.testing.assert_allclose(np.diag(apart) + together.T @ together, told, atol=1e-9)
        before = time


def test_what_is_missing_teaches_nothing_of_its_taxel() -> None:
    """The mean of n readings of each taxel, weighed against its walk before the first frame."""
    changes = np.full((16, TAXELS), 0.5)
    changes[:10, 3] = changes[:, 5] = np.nan
    own = follower()
    own.follow(np.zeros(16), changes)
    seen, count = np.arange(TAXELS) != 5, np.where(np.arange(TAXELS) == 3, 6, 16)
    walk = matrix(DriftDensities().walk(REST, 1200.0))
    gain = walk[:, seen] @ np.linalg.inv((walk + np.diag(NOISE**2 / count))[np.ix_(seen, seen)])
    np.testing.assert_allclose(own.drift, gain @ np.full(TAXELS - 1, 0.5), rtol=1e-9)
    np.testing.assert_allclose(matrix(own.covariance), walk - gain @ walk[seen], atol=1e-9)


def test_frames_in_contact_teach_nothing_beside_quiet_ones() -> None:
    quiet, mixed = follower(), follower()
    still = readings(np.full((1, TAXELS), 1.0), np.zeros(16), 11)
    pressed = readings(np.full((1, TAXELS), 1.0), np.full(16, 9.0), 12)
    quiet.follow(np.zeros(16), still)
    mixed.follow(np.zeros(32), np.vstack([still, pressed]))
    np.testing.assert_allclose(mixed.drift, quiet.drift, rtol=1e-12)
    np.testing.assert_allclose(matrix(mixed.covariance), matrix(quiet.covariance), rtol=1e-12)


def test_sizes_are_the_mean_and_the_one_furthest_from_zero() -> None:
    drift = Drift(np.array([[1.0, -4.0, 3.0, 0.0], [0.0, 0.5, 1.0, 0.5]]), np.ones((2, 4)))
    assert drift.sizes() == [(0.0, -4.0), (0.5, 1.0)]
    assert drift.rows(slice(1, 2)).sizes() == [(0.5, 1.0)]


def test_every_frame_needs_its_time() -> None:
    with pytest.raises(ValueError, match="zip"):
        follower().follow(np.zeros(3), np.zeros((2, TAXELS)))


def test_walk_is_that_of_its_three_parts() -> None:
    densities, rest = DriftDensities(0.2, 0.3, 0.01, 1.0), np.array([100.0, 200.0])
    # 10 s of each taxel's 0.2^2, of all taxels' 0.3^2, of a gain's 0.01^2 times rest x rest.
    expected = 10 * np.array([[0.04 + 0.09 + 1.0, 0.09 + 2.0], [0.09 + 2.0, 0.04 + 0.09 + 4.0]])
    np.testing.assert_allclose(matrix(densities.walk(rest, 10.0)), expected, rtol=1e-12)


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


@pytest.mark.parametrize(
    ("status", "largest", "told"),
    [
        ("ok", 2.0, "ok"),
        ("ok", -4.0, "ok_drifted"),
        ("no_contact", 4.0, "drifting"),
        ("poor_fit", 4.0, "poor_fit"),
    ],
)
def test_status_tells_that_the_device_has_drifted(
    status: str, largest: float, told: str
) -> None:
    found = drifting(LoadEstimate(True, status=status), 0.5, largest)
    assert (found.status, found.drift) == (told, (0.5, largest))
    assert told in STATUS


def test_looks_at_changing_taxels_are_kalmans_to_within_the_columns_that_are_left_out() -> None:
    """Against the gain of the whole matrix; a tenth of the taxels is missing each time."""
    densities, random = DriftDensities(), np.random.default_rng(3)
    own = densities.walk(REST, 1200.0)
    whole, drift, dense = matrix(own), np.zeros(TAXELS), np.zeros(TAXELS)
    for _ in range(30):
        walk = densities.walk(REST, 5.0)
        own, whole = own.plus(walk), whole + matrix(walk)
        seen, residual = random.random(TAXELS) > 0.1, random.normal(0, 1, TAXELS)
        weight = seen / NOISE**2
        gain = whole @ np.linalg.inv(whole + np.diag(np.where(seen, NOISE**2, 1e12)))
        dense = dense + gain @ (residual - dense)
        whole = whole - gain @ whole
        own, moved = own.learned(weight, residual - drift)
        drift = drift + moved
    sigma = np.sqrt(np.diag(whole))
    assert np.abs((drift - dense) / sigma).max() < 0.05
    np.testing.assert_allclose(own.variance, np.diag(whole), rtol=0.02)
