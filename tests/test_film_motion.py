"""What may be motion of the film, and impulses of taps, against closed forms."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fitting.inverse_load.estimate.estimate import Contact, LoadEstimate, Tap
from fitting.inverse_load.film_motion import (
    FilmMotion,
    covariance_by_motion,
    fading_time,
    mostly_motion,
    told_moving,
)
from fitting.inverse_load.report.text import frame_json
from fitting.inverse_load.taps import LONGEST, ForceCurve, Motion, MotionWatch, TapFinder
from fitting.steps import Budget, Steps
from suas_jax.config import load_skin
from tests.skins import CASE_B
from tests.stand_ins import explanations

FADING = 0.1
FRAMES = np.arange(0.0, 2.0, 0.01)


def test_what_is_still_to_fade_of_a_jump_may_be_motion() -> None:
    # After a jump by h at zero a first-order lag leaves h exp(-t/T) to come.
    height = np.array([300.0, -80.0, 10.0])
    left = np.exp(-np.maximum(FRAMES - 0.5, 0.0) / FADING)
    change = height * np.where(FRAMES[:, None] < 0.5, 0.0, 1 - left[:, None])
    found = FilmMotion(FADING, 4.0).follow(FRAMES, change)
    assert not found[FRAMES < 0.5].any()
    moving = (FRAMES > 0.5 + FADING) & (FRAMES < 0.5 + 3 * FADING)
    to_come = (height - change)[moving]
    assert np.all(np.abs(found[moving]) > 0.4 * np.abs(to_come))
    assert np.all(np.abs(found[moving]) < 2.0 * np.abs(to_come))
    assert np.all(np.abs(found[FRAMES > 0.5 + 5 * FADING]) < 0.01 * np.abs(height))
    assert not found[FRAMES > 0.5 + 10 * FADING].any()


def test_noise_and_missing_readings_are_no_motion() -> None:
    rng = np.random.default_rng(0)
    change = rng.normal(0.0, 2.0, (len(FRAMES), 40))
    change[rng.random(change.shape) < 0.2] = np.nan
    found = FilmMotion(FADING, 4.0).follow(FRAMES, change)
    assert np.isfinite(found).all()
    assert np.mean(found.any(1)) < 0.005


def test_a_clock_that_is_set_back_begins_anew() -> None:
    motion = FilmMotion(FADING, 4.0)
    motion.follow(np.array([5.0, 5.01]), np.array([[500.0], [0.0]]))
    assert not motion.follow(np.array([1.0]), np.array([[0.0]])).any()


def test_loads_by_motion_are_those_that_explain_it() -> None:
    jacobian = np.array([[[1.0, 0.5, 0.0, 0.0], [0.0, 1.0, 2.0, 0.0]]])
    best = explanations([1.0, 2.0], jacobian=jacobian, weight=[1.0, 4.0, 0.25, 1.0])
    loads = np.array([0.3, -0.7])
    found = covariance_by_motion(best, (loads @ jacobian[0])[None, :], 2)
    assert found[0] == pytest.approx(np.outer(loads, loads), rel=1e-9)


@pytest.mark.parametrize(
    ("status", "force", "moved", "told", "contact"),
    [
        ("ok", 5.0, 10.0, "moving", True),
        ("ok", 1.5, 10.0, "moving", None),  # less than two deviations
        ("ok", 5.0, 2.0, "ok", True),  # 2 of 100 counts
        ("poor_fit", 5.0, 10.0, "moving", True),
        ("no_contact", 5.0, 10.0, "no_contact", True),
    ],
)
def test_a_status_says_where_motion_matters(
    status: str, force: float, moved: float, told: str, contact: bool | None
) -> None:
    estimate = LoadEstimate(True, (Contact(0.0, force, None, np.eye(2)),), status=status)
    (found,) = told_moving([estimate], np.array([[moved]]), np.array([[100.0]]))
    assert (found.status, found.contact) == (told, contact)


def test_a_moving_frame_tells_no_force_without_a_deviation() -> None:
    contacts = Contact(0.0, 5.0, None, np.eye(2)), Contact(1.5, 8.0, None, None)
    estimate = LoadEstimate(True, contacts, status="at_edge")
    (found,) = told_moving([estimate], np.array([[50.0]]), np.array([[100.0]]))
    assert found.contacts == contacts[:1]
    assert found.contact


def test_a_frame_is_mostly_motion_where_half_of_its_change_may_be() -> None:
    change = np.array([[30.0, np.nan, 40.0]] * 3 + [[0.0, np.nan, 0.0]])
    moved = np.array([[0.0, 0.0, 26.0], [0.0, 9.0, 24.0], [0.0] * 3, [0.0] * 3])
    assert mostly_motion(moved, change).tolist() == [True, True, False, False]


def _motion(force: np.ndarray, amplitude: np.ndarray) -> tuple[np.ndarray, float]:
    """Amplitudes of m a'' + c a' + F(a) = f(t) under a half sine, and its impulse."""
    curve = ForceCurve(np.ones(1), amplitude, force)
    length, peak = 0.05, 3.0

    def rate(t: float, y: np.ndarray) -> list[float]:
        push = peak * np.sin(np.pi * t / length) if 0 < t < length else 0.0
        return [y[1], (push - float(curve.at(y[0])) - 0.03 * y[1]) / 0.002]

    found = solve_ivp(rate, (0.0, 1.99), [0.0, 0.0], t_eval=FRAMES, max_step=1e-3, rtol=1e-8)
    return found.y[0], 2 / np.pi * peak * length


@pytest.mark.parametrize("bend", [0.0, 0.5])
def test_the_impulse_of_a_tap_is_that_of_its_motion(bend: float) -> None:
    amplitude = np.linspace(0.0, 4.0, 41)
    force = amplitude + bend * amplitude**2
    shape = np.array([2e-4, -1e-4, 5e-5])
    a, impulse = _motion(force, amplitude)
    watch, motion = MotionWatch(FADING), None
    gap = 5e-3 + a[:, None] * shape
    time = np.delete(FRAMES, [7, 12, 30])  # lost frames
    kept = (np.delete(x, [7, 12, 30], 0) for x in (gap, np.abs(a)))
    for t, g, size in zip(time, *kept, strict=True):
        motion = watch.follow(float(t), g, touched=bool(size > 0.01)) or motion
    assert isinstance(motion, Motion)
    curve = ForceCurve.of(force[1:], amplitude[1:, None] * shape)
    scaled, _ = curve.amplitudes(motion.gap, np.ones(3))
    found = motion.duration * (motion.share @ curve.at(scaled))
    assert found == pytest.approx(impulse, rel=0.01)
    # The mean of the gaps is that of a steady load only where the skin answers in proportion.
    steady = motion.duration * curve.at(motion.share @ scaled)
    assert (abs(steady / impulse - 1) < 0.02) == (bend == 0.0)


def test_a_tap_is_told_with_deviations_of_its_place() -> None:
    place = Contact(np.deg2rad(15.0), 0.2, None, np.diag([1e-4, 4e-6, 1e-2]), axial=0.01)
    estimate = LoadEstimate(False, tap=Tap(0.3, 0.6, place, 7e-3, 2e-3))
    told = frame_json(0.95, 95, estimate)["tap"]
    assert told["angle_deviation_deg"] == pytest.approx(np.rad2deg(1e-2))
    assert told["axial_deviation_m"] == pytest.approx(2e-3)


@pytest.mark.parametrize("still", [1, 7, 200])
def test_what_is_known_of_rest_has_the_variance_of_its_frames(still: int) -> None:
    # Many watches side by side are draws of the same noise.
    rng, watch, motion = np.random.default_rng(1), MotionWatch(FADING), None
    touched = np.r_[np.zeros(still), np.ones(3), np.zeros(20)] > 0
    for k, one in enumerate(touched):
        gap = 0.0 if one else rng.normal(0.0, 1.0, 40_000)
        motion = watch.follow(0.01 * k, gap + np.zeros(40_000), touched=bool(one)) or motion
    assert isinstance(motion, Motion)
    assert motion.rest_variance == pytest.approx(np.var(motion.gap[1]), rel=0.03)


def test_a_press_that_lasts_is_no_tap() -> None:
    watch = MotionWatch(FADING)
    assert FRAMES[-1] * 1.1 > LONGEST * FADING
    for touched, end in (((FRAMES > 0.1) & (FRAMES < 1.6), True), (FRAMES > 0.1, False)):
        ended = [
            watch.follow(float(t), np.full(3, 5e-3), touched=bool(one))
            for t, one in zip(FRAMES * 1.1, touched, strict=True)
        ]
        assert any(ended) == end
        watch.forget()


def test_a_file_without_densities_says_nothing_of_motion() -> None:
    spec = load_skin(CASE_B.parent.parent / "skins/suas.toml")
    assert fading_time(spec) is None


class _EvenFilm:
    """Taxels that read a count less for every micrometre more of gap."""

    def film(self, so: np.ndarray) -> np.ndarray:
        return np.asarray(6e-3 - 1e-6 * so)

    def readings(self, film: np.ndarray) -> np.ndarray:
        return np.asarray((6e-3 - film) / 1e-6)


def _taps(swings: list[float], force: float, budget: Budget | None) -> list:
    """What every frame tells of swings whose mean a force explains, in five steps of 1 s."""
    clock = SimpleNamespace(now=0.0)
    found = LoadEstimate(True, (Contact(0.0, force, None, 0.01 * np.eye(2)),))
    nodes = SimpleNamespace(
        rest=np.full(3, 1000.0),
        levels=2,
        known=np.full(2, True),
        loads=np.array([[0.0, 1.0], [0.0, 2.0]]),
        readings=1000.0 - np.array([[10.0] * 3, [20.0] * 3]),
        nearest_to=lambda *_: np.zeros(1, int),
    )

    def explain(*_: Any) -> Steps[tuple[LoadEstimate, np.ndarray]]:
        for _ in range(5):
            yield "fit"
            clock.now += 1.0
        return found, np.zeros(2)

    if budget is not None:
        budget.clock = lambda: clock.now
    beside: Any = _EvenFilm(), nodes, 3, 4.0, explain, budget
    finder, told = TapFinder(MotionWatch(FADING), *beside), []
    for k, a in enumerate(swings):
        begun = clock.now
        if budget is not None:
            budget.begin()
        gap = 5e-3 + 1e-5 * a * np.ones(3)
        told.append(finder.follow(0.02 * k, gap, touched=a != 0.0))
        assert budget is None or clock.now - begun <= budget.seconds
    return told


def test_a_motion_whose_mean_shows_no_press_is_no_tap() -> None:
    # What pushes as much out as in leaves a force of zero, over which no error is known.
    swings = [0.0, 0.0, 1.0, -1.0, *[0.0] * 20]
    assert _taps(swings, 0.0, None) == [None] * len(swings)


def test_the_frame_that_ends_a_tap_keeps_its_budget() -> None:
    swings = [0.0, 0.0, 1.0, 1.0, *[0.0] * 20]
    at_once = _taps(swings, 1.5, None)
    (end,) = np.flatnonzero([tap is not None for tap in at_once])
    later = _taps(swings, 1.5, Budget(2.0))
    # Ten steps, two of which a frame has time for.
    assert later[end + 4].impulse == at_once[end].impulse > 0
    assert later.count(None) == len(swings) - 1
