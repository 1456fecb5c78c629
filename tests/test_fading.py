"""Contacts that fade after a stronger one: dents of a membrane that relaxes, and fingers."""

from collections.abc import Callable

import numpy as np
import pytest

from fitting.arrays import Floats
from fitting.inverse_load.estimate.estimate import Contact, LoadEstimate
from fitting.inverse_load.fading import FadingWatch
from fitting.inverse_load.memory.series import LoadMemory, creeping_load

MEMORY = LoadMemory(np.array([0.15, 0.10]) / 0.75, np.array([0.5, 10.0]), np.zeros((0, 2)))
NOISE = 0.03  # of a force [N]
TIME = np.arange(0.0, 60.0, 0.1)
Course = Callable[[Floats], Floats]


def frames(force: Floats, place: float = 0.01, seed: int = 0) -> list[LoadEstimate]:
    """Estimates of single contacts of some forces; less than four deviations is none."""
    noisy = force + np.random.default_rng(seed).normal(0.0, NOISE, len(force))
    covariance = np.diag([1e-6, NOISE**2])
    return [
        LoadEstimate(True, (Contact(0.1, f, None, covariance, place),), status="ok")
        if f > 4 * NOISE
        else LoadEstimate(False)
        for f in noisy
    ]


def pressed(time: Floats, begin: float, end: float, force: float) -> Floats:
    """Force that an elastic membrane needs for the dent of one that relaxes [N]."""
    on, off = (
        np.where(time >= t, creeping_load(MEMORY, np.maximum(time - t, 0.0)), 0.0)
        for t in (begin, end)
    )
    return force * np.asarray(on - off)


def statuses(estimates: list[LoadEstimate], time: Floats = TIME) -> list[str]:
    return [e.status for e in FadingWatch().told(time, estimates)]


def test_the_dent_that_a_load_leaves_is_no_contact_at_ok() -> None:
    estimates = frames(pressed(TIME, 1.0, 31.0, 20.0))
    watch = FadingWatch()
    found = watch.told(TIME, estimates)
    after = TIME > 31.0
    assert {e.status for e in np.array(found)[after]} == {"fading"}
    assert {e.contact for e in np.array(found)[after]} == {None}
    assert {e.status for e in np.array(found)[(TIME > 1.0) & (TIME < 31.0)]} == {"ok"}
    left = watch.left
    assert left is not None
    assert (left.before, left.ended) == pytest.approx((20.0, 31.0), abs=0.2)
    assert left.first == pytest.approx(20 * (1 - 0.75) - 0.3, abs=0.4)
    assert "states no relaxation" in left.text(remembers=False)
    assert "states too little relaxation" in left.text(remembers=True)


def test_a_stream_knows_the_second_dent_at_once() -> None:
    force = pressed(TIME, 1.0, 11.0, 20.0) + pressed(TIME, 41.0, 51.0, 10.0)
    watch = FadingWatch()
    found = [
        watch.told(TIME[k : k + 1], [estimate])[0].status
        for k, estimate in enumerate(frames(force))
    ]
    first = (TIME > 11.0) & (TIME < 14.0)
    assert set(np.array(found)[first]) == {"ok", "fading"}
    assert found[int(np.argmax(TIME > 13.9))] == "fading"
    assert "ok" not in np.array(found)[TIME > 51.05]


@pytest.mark.parametrize(
    "course",
    [
        lambda t: np.where(t < 30.0, 20.0, 1.0),
        lambda t: np.clip(20.0 - 0.5 * (t - 10.0), 0.0, 20.0),
        lambda t: 20.0 * np.exp(-np.maximum(t - 10.0, 0.0) / 5.0),
        lambda t: 10.0 + 10.0 * np.cos(t),
        lambda t: np.where(t < 30.0, 20.0, np.clip(0.2 * (t - 40.0), 0.0, 4.0)),
        lambda t: np.where(t < 30.0, 20.0, 1.0 + 0.1 * np.sin(t)),
    ],
    ids=["held lighter", "unloaded", "let go", "swinging", "pressed again", "trembling"],
)
def test_loads_that_fall_otherwise_keep_their_status(course: Course) -> None:
    for seed in range(20):
        found = FadingWatch()
        told = found.told(TIME, frames(course(TIME), seed=seed))
        assert "fading" not in {e.status for e in told}
        assert found.left is None


def test_a_light_contact_elsewhere_is_a_contact() -> None:
    estimates = frames(pressed(TIME, 1.0, 31.0, 20.0))
    elsewhere = frames(pressed(TIME, 1.0, 31.0, 20.0), place=0.03)
    k = int(np.argmax(TIME > 31.0))
    assert "fading" not in statuses(estimates[:k] + elsewhere[k:])


def test_what_lifts_within_half_a_second_is_a_finger() -> None:
    fast = TIME / 200
    assert "fading" not in statuses(frames(pressed(TIME, 1.0, 31.0, 20.0)), fast)
