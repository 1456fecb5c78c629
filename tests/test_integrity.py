"""Losses, duplicates, wraps and stuck taxels are told apart."""

import itertools

import pytest

from suas_jax.acquisition.frames.reading import Reading
from suas_jax.acquisition.integrity import STUCK_AFTER, DeviceClock, Flags, Integrity

PERIOD = 0.01


def frame(seq: int, t: float | None = None, first: int | None = None) -> Reading:
    t = PERIOD * seq if t is None else t
    return Reading(seq, t, 0, (seq % 50000 if first is None else first, 7), t)


def judged(readings, modulus=None, checked=False) -> list[tuple[float, Flags]]:
    integrity = Integrity(modulus, checked)
    return [integrity.judge(reading) for reading in readings]


@pytest.mark.parametrize("checked", [False, True])
def test_a_gap_is_counted_where_it_is(checked):
    flags = [f for _, f in judged(map(frame, [0, 1, 2, 6, 7]), checked=checked)]
    assert [f.lost for f in flags] == [0, 0, 0, 3, 0]
    assert not any(f.suspect for f in flags)


@pytest.mark.parametrize("modulus", [2**8, 2**16, 2**32])
def test_a_counter_that_wraps_loses_nothing(modulus):
    start = modulus - 3
    readings = [frame((start + i) % modulus, PERIOD * i) for i in range(6)]
    assert all(f.lost == f.restart == 0 for _, f in judged(readings))


def test_a_frame_sent_twice_and_a_sensor_not_refreshed():
    flags = [f for _, f in judged([frame(0), frame(1), frame(1), frame(2, first=1), frame(3)])]
    assert [f.duplicate for f in flags] == [0, 0, 1, 0, 0]
    assert [f.repeat for f in flags] == [0, 0, 0, 1, 0]


def test_a_late_frame_is_no_restart():
    order = [0, 1, 3, 2, 4]
    times, flags = zip(*judged(map(frame, order), checked=True), strict=True)
    assert [f.restart for f in flags] == [0] * 5
    assert times == pytest.approx([PERIOD * seq for seq in order])


@pytest.mark.parametrize("modulus", [65.536, 4294.967296, 65536.0, 4294967.296])
@pytest.mark.parametrize("known", [False, True])
def test_the_clock_is_unwrapped(modulus, known):
    readings = [
        Reading(i, (modulus - 0.045 + PERIOD * i) % modulus, 0, (i,), PERIOD * i)
        for i in range(20)
    ]
    out = judged(readings, modulus if known else None)
    expected = [modulus - 0.045 + PERIOD * i for i in range(20)]
    assert [t for t, _ in out] == pytest.approx(expected, abs=2e-6)
    assert all(not any(f[:5]) and not f.clock_jump for _, f in out)


def test_a_clock_of_no_usual_width_goes_on_at_its_rate():
    readings = [Reading(i, (PERIOD * i) % 0.5, 0, (i,), PERIOD * i) for i in range(120)]
    times = [t for t, _ in judged(readings)]
    assert times == pytest.approx([PERIOD * i for i in range(120)], abs=1e-6)


def test_a_turn_of_the_clock_is_told_by_the_counter_where_the_host_has_no_clock():
    modulus = 65.536
    readings = [
        Reading(i, (65.5 + PERIOD * i) % modulus, 0, (i,), float("nan")) for i in range(20)
    ]
    out = judged(readings, modulus, checked=True)
    assert [t for t, _ in out] == pytest.approx([65.5 + PERIOD * i for i in range(20)])
    assert not any(f.clock_jump for _, f in out)


def test_turns_of_the_clock_in_a_long_silence():
    modulus = 65.536
    readings = [frame(0), frame(1), Reading(2, 200.0 % modulus, 0, (1,), 200.0)]
    assert judged(readings, modulus, checked=True)[-1][0] == pytest.approx(200.0)


@pytest.mark.parametrize("checked", [False, True])
def test_a_device_that_starts_again(checked):
    readings = [*map(frame, range(100)), *(frame(i)._replace(t_host=9.0) for i in range(3))]
    out = judged(readings, checked=checked)
    assert [f.restart for _, f in out] == [0] * 100 + [1, 0, 0]
    assert [f.lost for _, f in out] == [0] * 103
    assert out[-1][0] == pytest.approx(0.02)


@pytest.mark.parametrize("wrong", [934, 4, 194])
def test_a_damaged_number_is_suspect_and_does_no_harm(wrong):
    """134 read as 934, 4 or 194: that row is doubted, its neighbours are not."""
    readings = [frame(i) for i in range(120, 150)]
    readings[14] = readings[14]._replace(seq=wrong)
    flags = [f for _, f in judged(readings)]
    assert [f.suspect for f in flags] == [0] * 14 + [1] + [0] * 15
    assert [f.restart for f in flags] == [0] * 30
    assert flags[15].lost == 1


@pytest.mark.parametrize(("said", "suspect"), [(14, 0), (16, 1), (6, 0), (4, 1)])
def test_counter_and_clock_may_differ_by_half_of_what_was_lost(said, suspect):
    """The counter goes on by ten; the clock by this many frames."""
    readings = [*map(frame, range(20)), frame(29, PERIOD * (19 + said))]
    assert judged(readings)[-1][1].suspect == suspect


def test_a_jump_that_is_confirmed_is_believed():
    """The counter jumps without the clock: a doubt first, then a fact."""
    readings = [frame(i) for i in range(20)]
    readings += [frame(i + 500, PERIOD * i) for i in range(20, 25)]
    flags = [f for _, f in judged(readings)]
    assert [f.suspect for f in flags[20:]] == [1, 0, 0, 0, 0]
    assert flags[21].lost == 500


def test_a_stuck_taxel_is_found_when_the_others_move():
    integrity = Integrity(None, False)
    flags = [integrity.judge(frame(seq))[1] for seq in range(STUCK_AFTER + 5)]
    assert flags[STUCK_AFTER - 2].stuck == 0
    assert flags[-1].stuck == 0b10
    assert integrity.summary.stuck == {0: [2]}
    still = [f for _, f in judged(frame(i, first=3) for i in range(STUCK_AFTER + 5))]
    assert not any(f.stuck for f in still)  # a skin at rest without noise


def clock(jumps: dict[int, float], frames: int = 40) -> list[Reading]:
    """Frames whose clock is moved by some seconds from some frames on."""
    moved = {i: sum(by for at, by in jumps.items() if i >= at) for i in range(frames)}
    return [Reading(i, 100 + PERIOD * i + moved[i], 0, (i,), PERIOD * i) for i in range(frames)]


@pytest.mark.parametrize("modulus", [None, 2**32 * 1e-6])
@pytest.mark.parametrize("checked", [False, True])
@pytest.mark.parametrize("by", [10.0, -10.0, 0.4, -0.4, -0.05, 1.7e9, -90.0])
def test_a_clock_that_jumps_is_flagged_and_goes_on(by, checked, modulus):
    out = judged(clock({20: by}), modulus, checked)
    assert [f.clock_jump for _, f in out] == [0] * 20 + [1] + [0] * 19
    assert [t for t, _ in out] == pytest.approx([100 + PERIOD * i for i in range(40)], abs=1e-5)
    assert not any(f.suspect or f.lost or f.restart for _, f in out)


@pytest.mark.parametrize("by", [10.0, -10.0])
def test_a_jump_that_ends_is_taken_back(by):
    """The second jump goes back to the first scale, though two frames are lost with it."""
    readings = clock({10: by, 20: -by})
    del readings[20:22]
    out = judged(readings, checked=True)
    assert [i for i, (_, f) in enumerate(out) if f.clock_jump] == [10, 20]
    assert out[20][1].lost == 2
    assert out[25][0] == pytest.approx(readings[25].t_device, abs=1e-9)
    times = [t for t, _ in out]
    assert all(b > a for a, b in itertools.pairwise(times))


def test_a_pause_of_the_device_is_no_jump():
    readings = [
        r if r.seq < 20 else r._replace(t_device=r.t_device + 7.0, t_host=r.t_host + 7.03)
        for r in clock({})
    ]
    out = judged(readings, checked=True)
    assert not any(f.clock_jump for _, f in out)
    assert out[-1][0] == readings[-1].t_device


def test_a_jump_is_told_once_for_all_modules_of_a_frame():
    integrity = Integrity(None, checked=True)
    for r in clock({20: 5.0}):
        for module in range(3):
            integrity.judge(r._replace(module=module))
    assert integrity.summary.clock_jumps == 1
    (sentence,) = integrity.sentences()
    assert "jumped at frame 20" in sentence
    assert integrity.sentences() == []


def test_another_number_of_taxels_is_flagged_row_by_row():
    integrity = Integrity(None, checked=True)
    counts = {True: (1, 2, 3), False: (1, 3)}
    found = [
        integrity.judge(Reading(i, PERIOD * i, 4, counts[not 5 <= i < 8], PERIOD * i))[1]
        for i in range(12)
    ]
    assert [f.other_taxels for f in found] == [0] * 5 + [2] * 3 + [0] * 4
    assert integrity.summary.other_taxels == 3
    (sentence,) = integrity.sentences()
    assert "module 4 sends 2 counts instead of 3 from frame 5 on" in sentence


def test_the_skin_file_knows_how_many_taxels_there_are():
    integrity = Integrity(None, checked=True, taxels={0: 3})
    assert integrity.judge(frame(0))[1].other_taxels == 2


def test_totals_are_the_sums_of_the_flags():
    integrity = Integrity(None, checked=False)
    readings = [frame(i) for i in range(120, 150) if i != 140]
    readings[5:5] = [readings[4]]  # sent twice
    readings[10] = readings[10]._replace(counts=readings[9].counts)
    readings[14] = readings[14]._replace(seq=934)
    readings += [frame(i)._replace(t_host=9.0) for i in range(3)]
    flags = [integrity.judge(reading)[1] for reading in readings]
    total = integrity.summary
    found = (total.rows, total.lost, total.duplicates, total.repeats, total.restarts)
    assert (*found, total.suspects) == (len(readings), 2, 1, 1, 1, 1)
    sums = (sum(f.lost for f in flags), sum(f.suspect for f in flags))
    assert sums == (total.lost, total.suspects)


def test_a_recording_that_goes_on_is_flagged_at_its_begin():
    integrity = Integrity(None, checked=True, resumed=True)
    flags = [integrity.judge(frame(i)._replace(module=m))[1] for i in (7, 8) for m in (0, 1)]
    assert [f.restart for f in flags] == [1, 1, 0, 0]
    assert integrity.summary.restarts == 0


@pytest.mark.parametrize(("gained", "jumped"), [(0.55, False), (0.7, True), (-0.7, True)])
def test_after_a_pause_the_clock_may_differ_from_the_host_s_by_a_twentieth(gained, jumped):
    """And a tenth of a second: after 10 s by 0.6 s."""
    readings = [r if r.seq < 20 else r._replace(t_host=r.t_host + 10.0) for r in clock({})]
    moved = [r if r.seq < 20 else r._replace(t_device=r.t_device + gained) for r in readings]
    paused = [r if r.seq < 20 else r._replace(t_device=r.t_device + 10.0) for r in moved]
    assert judged(paused, checked=True)[20][1].clock_jump == jumped


@pytest.mark.parametrize("known", [False, True])
def test_a_frame_that_comes_again_may_be_earlier_the_next_may_not(known):
    device, nan = DeviceClock(65.536), float("nan")
    if known:
        device.follow(frame(3), frame(4), 1, 4 * PERIOD, jumped=False)
    last = Reading(5, 5 * PERIOD, 0, (1,), nan)
    assert not device.time_of(last, last._replace(t_device=4.5 * PERIOD), 0)[1]
    backwards = last._replace(seq=6, t_device=4.5 * PERIOD)
    assert device.time_of(last, backwards, 1)[1]


def test_the_rate_is_that_of_frames_that_follow_each_other():
    device = DeviceClock(None)
    device.follow(frame(0), frame(1), 1, PERIOD, jumped=False)
    assert device.period == PERIOD
    device.follow(frame(1), frame(1, 3 * PERIOD), 0, 3 * PERIOD, jumped=False)
    device.follow(frame(1), frame(3), 2, 3 * PERIOD, jumped=False)
    device.follow(frame(1), frame(2, 9.0), 1, 9.0, jumped=True)
    assert device.period == PERIOD


def test_readings_after_a_wrap_are_on_the_scale_of_those_before():
    device, last = DeviceClock(65.536), frame(5, 65.53)
    wrapped = frame(6, 0.004)._replace(t_host=65.54)
    t_device, jumped = device.time_of(last, wrapped, 1)
    device.follow(last, wrapped, 1, t_device, jumped)
    assert not jumped
    assert device.on_scale(wrapped) == t_device == pytest.approx(65.54)
    missing = wrapped._replace(seq=7, t_device=float("nan"))
    assert not device.time_of(wrapped, missing, 1)[1]
    assert device.time_of(missing, frame(8, 0.024), 1) == (pytest.approx(65.56), False)
