"""A pad's contacts at 100 Hz: docs/load_evidence.md.

    python -m benchmarks.pad_live [--seconds S]

A finger slides over the shipped pad (320 taxels), lifts off and comes back, between frames at
rest. The readings are those of the estimator's own table with 2 counts of noise, whose accuracy
is not the question here; they are played to a pseudo-terminal. With the pad's baseline, so that
drift is followed. The machine should do nothing else: with two cores both programs share it.

Then two fingers come and go, two seconds each, at 100 Hz: a frame's time, and what is dropped
because frames take longer than they come, without a budget and with some. Budgets count the
estimating thread's own processor time, so that other programs do not count; --fingers measures
them alone.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.inverse_load_speed import both_ends, shown, timed
from fitting.inverse_load.estimator import LoadEstimator
from fitting.inverse_load.fit.bounded_selection import BoundedSelection
from suas_jax import configure
from suas_jax.acquisition.log.log_file import LogWriter, log_header
from suas_jax.config import SkinSpec, load_skin

SKIN = Path(__file__).parent.parent / "configs/skins/suas-pad.toml"
_RATE = 100.0
_NOISE = 2.0
_LATENCY = 0.1  # age at which a frame is dropped [s]
_TOUCH = 200  # frames of a touch, and of the rest before it
_FINGERS = (  # angles [deg], axial positions [m], forces [N]
    ((-20, 20), (-0.010, 0.015), (6.0, 5.0)),
    ((-5, 12), (0.0, 0.010), (6.0, 5.0)),
    ((-20, 20), (-0.010, 0.015), (6.0, 1.5)),
    ((10, 35), (0.030, -0.020), (3.0, 4.0)),
)


def slide(estimator: LoadEstimator, seconds: float) -> np.ndarray:
    """Counts of a finger that slides, and lifts every other two seconds [frame, taxel]."""
    t = np.arange(0, seconds, 1 / _RATE)
    angle, axial = np.deg2rad(40 * np.sin(0.9 * t)), 0.03 * np.sin(0.6 * t)
    force = 7 + 4 * np.sin(1.7 * t)
    # Of the fitter's own interpolant, so that thousands of frames cost seconds.
    loads = np.stack([angle, axial, force], 1)
    fitter: Any = estimator.selection.fitter
    so = np.concatenate(
        [fitter.interpolant(part, 1).readings[:, :-1] for part in np.array_split(loads, 40)]
    )
    so = np.where((t // 2 % 2 == 1)[:, None], so, estimator.model_rest)
    return np.round(so + np.random.default_rng(0).normal(0, _NOISE, so.shape))


def fingers(estimator: LoadEstimator) -> np.ndarray:
    """Counts of two fingers that come and go, two seconds each [frame, taxel]."""
    fitter: Any = estimator.selection.fitter
    rows = []
    for angles, axial, forces in _FINGERS:
        x = np.array([*np.deg2rad(angles), *axial, *forces])
        correction = fitter.correction(x, 2)
        so = fitter.interpolant(x[None], 2, correction).readings[0, :-1]
        rows += [np.tile(estimator.model_rest, (_TOUCH, 1)), np.tile(so, (_TOUCH, 1))]
    so = np.concatenate(rows)
    return np.round(so + np.random.default_rng(1).normal(0, _NOISE, so.shape))


def come_and_go(spec: SkinSpec, budget: float | None) -> str:
    """Two fingers at 100 Hz, in the time that the estimate's own thread works."""
    live = LoadEstimator(spec, live=True, budget=budget)
    live.warm_up()
    clock, selection = time.process_time, live.selection
    if isinstance(selection, BoundedSelection) and selection.budget is not None:
        clock = selection.budget.clock = time.thread_time
    counts = fingers(live)
    took, delays, now, k, dropped, last = [], [], 0.0, 0, 0, -1
    while k < len(counts):
        now = max(now, k / _RATE)  # no frame is estimated before it is there
        newest = min(int(now * _RATE), len(counts) - 1)
        if now - k / _RATE > _LATENCY and newest > k:
            dropped, k = dropped + newest - k, newest
        begin = clock()
        (estimate,) = live.estimate(counts[k : k + 1])
        took.append(clock() - begin)
        now += took[-1]
        touch = k // _TOUCH
        if touch % 2 and touch != last and len(estimate.contacts) == 2:
            last = touch
            delays.append(now - touch * _TOUCH / _RATE)
        # What is solved beside the frames goes on meanwhile.
        time.sleep(max(1 / _RATE - took[-1], 0.0))
        k += 1
    low, high, most, worst = 1e3 * np.percentile(took, [50, 90, 99, 100])
    told = ", ".join(f"{1e3 * x:.0f}" for x in delays)
    return (
        f"two fingers, {'no budget' if budget is None else f'budget {1e3 * budget:g} ms'}: a "
        f"frame's processor time {low:.1f} ms median, {high:.1f} ms at 90 %, {most:.1f} ms at "
        f"99 %, {worst:.0f} ms at most; {dropped} of {len(counts)} frames dropped; told as two "
        f"after {told} ms"
    )


def write_log(path: Path, so: np.ndarray) -> None:
    """Readings as the logger writes them, ten taxels a module."""
    with LogWriter(path, log_header(), taxels=10) as log:
        for k, frame in enumerate(so.astype(int).tolist()):
            for module in range(len(frame) // 10):
                counts = tuple(frame[10 * module : 10 * module + 10])
                log.write(k / _RATE, k / _RATE, k, module, counts)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--fingers", action="store_true")
    options = parser.parse_args()
    configure()
    print(f"load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    spec = load_skin(SKIN)
    for budget in (None, 0.02, 0.05):
        print(come_and_go(spec, budget))
    if options.fingers:
        return
    begin, busy = time.perf_counter(), time.process_time()
    live = LoadEstimator(spec, live=True)
    wall, spent = time.perf_counter() - begin, time.process_time() - busy
    print(f"table made or loaded in {wall:.1f} s, {spent:.1f} s of processor time")
    counts = slide(live, options.seconds + 40)
    live.warm_up()
    shown("one frame, half of them at rest", *timed(live, counts[:2000]))
    batch = LoadEstimator(spec)
    batch.estimate(counts[:1000])
    begin = time.perf_counter()
    batch.estimate(counts[:1000])
    print(f"1,000 frames of a log: {time.perf_counter() - begin:.1f} s")
    folder = Path(tempfile.mkdtemp())
    write_log(folder / "rest.csv", counts[:200])
    write_log(folder / "slide.csv", counts)
    command = [sys.executable, "-c", "from fitting.cli.app import main; main()"]
    rest = str(folder / "rest.json")
    words = ["baseline", str(folder / "rest.csv"), "-o", rest]
    subprocess.run([*command, *words], check=True, cwd=SKIN.parents[2])
    played, skin = [str(folder / "slide.csv")], [str(SKIN), "--baseline", rest]
    print(both_ends(played, skin, options.seconds))


if __name__ == "__main__":
    main()
