"""A pad's contacts at 100 Hz: docs/load_evidence.md.

    python -m benchmarks.pad_live [--seconds S]

A finger slides over the shipped pad (320 taxels), lifts off and comes back, between frames at
rest. The readings are those of the estimator's own table with 2 counts of noise, whose accuracy
is not the question here; they are played to a pseudo-terminal. With the pad's baseline, so that
drift is followed. The machine should do nothing else: with two cores both programs share it.
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
from suas_jax import configure
from suas_jax.acquisition.log.log_file import LogWriter, log_header
from suas_jax.config import load_skin

SKIN = Path(__file__).parent.parent / "configs/skins/suas-pad.toml"
_RATE = 100.0
_NOISE = 2.0


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
    options = parser.parse_args()
    configure()
    print(f"load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    spec = load_skin(SKIN)
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
