"""How fast loads are estimated: docs/load_evidence.md.

    python -m benchmarks.inverse_load_speed [--live SECONDS]

1. single frames of a sliding contact, one after the other, as a stream gives them;
2. a log of 10,000 frames in batches;
3. SciPy's least squares with finite differences on the same model, from the same start,
   against both, on the same frames in turns;
4. with --live: 100 frames a second from a pseudo-terminal, both ends as programs of their
   own. The machine should do nothing else: with two cores they share it.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from benchmarks.inverse_load import SKIN, measured, skin_of_taxels
from fitting.inverse_load.estimator import LoadEstimator
from suas_jax import configure, jit
from suas_jax.scene.forward import forward
from suas_jax.scene.loads import Loads

FRAMES = 10_000
_RATE = 100.0


def slide(estimator: LoadEstimator) -> np.ndarray:
    """Counts of a contact that slides to and fro under a changing force [frame, taxel]."""
    t = np.arange(FRAMES) / _RATE
    angle, force = np.deg2rad(50 * np.sin(0.9 * t)), 12 + 8 * np.sin(1.7 * t)
    run, parts = jit(forward), []
    for begin in range(0, FRAMES, 500):
        part = slice(begin, begin + 500)
        parts.append(np.asarray(run(estimator.skin, Loads.line(angle[part], force[part])).so).T)
    return measured(np.concatenate(parts), 0)


def shown(name: str, seconds: list[float], busy: list[float]) -> None:
    low, middle, high = 1e3 * np.percentile(seconds, [10, 50, 99])
    print(
        f"{name}: median {middle:.2f} ms, fastest tenth below {low:.2f} ms, 99 % below "
        f"{high:.2f} ms; processor time, median {1e3 * np.median(busy):.2f} ms"
    )


def timed(estimator: LoadEstimator, counts: np.ndarray) -> tuple[list[float], list[float]]:
    """Seconds and processor seconds of every frame alone."""
    seconds, busy = [], []
    for row in counts:
        begin, work = time.perf_counter(), time.process_time()
        estimator.estimate(row[None])
        seconds.append(time.perf_counter() - begin)
        busy.append(time.process_time() - work)
    return seconds, busy


def against_scipy(
    batch: LoadEstimator, live: LoadEstimator, counts: np.ndarray, frames: int = 256
) -> None:
    """The same fits by SciPy, each from the nearest state of the table."""
    run = jit(forward)
    y, weight = batch.weigh(counts[:frames])
    nodes, _ = batch.selection.nodes.nearest(y, weight)
    starts = [batch.table.start(nodes[k : k + 1]) for k in range(frames)]
    seconds, found = [], []
    for k in range(-1, frames):
        begin = time.perf_counter()
        root, state = np.sqrt(weight[k]), starts[k]

        def residual(x: np.ndarray, k: int = k, root=root, state=state) -> np.ndarray:
            so = run(batch.skin, Loads.line(x[0], x[1]), state).so
            return np.asarray(root * (np.asarray(so)[:, 0] - y[k]))

        node = batch.selection.nodes.loads[nodes[k]]
        found.append(least_squares(residual, node, x_scale=[0.02, 0.2]).x)
        seconds.append(time.perf_counter() - begin)
    begin = time.perf_counter()
    ours = batch.estimate(counts[:frames])
    together = (time.perf_counter() - begin) / frames
    alone, _ = timed(live, counts[:frames])
    first = [estimate.contacts[0] for estimate in ours]
    apart = np.array([[c.angle, c.force] for c in first]) - np.array(found[1:])
    sigma = np.array([np.sqrt(np.diag(c.covariance)) for c in first])
    each = float(np.median(seconds[1:]))
    print(
        f"SciPy: median {1e3 * each:.1f} ms a frame; ours {1e3 * np.median(alone):.2f} ms "
        f"alone (x {each / np.median(alone):.0f}), {1e3 * together:.2f} ms in a batch of "
        f"{frames} (x {each / together:.0f}); they differ by {np.abs(apart / sigma).max():.2f} "
        "standard deviations at most"
    )


def on_a_terminal(seconds: float) -> None:
    """Both ends of a pseudo-terminal."""
    folder = Path(tempfile.mkdtemp())
    text = SKIN.read_text()
    rows = [f'{{ angle = "{a!r} deg" }},' for a in np.linspace(-80, 80, 40).tolist()]
    (folder / "skin.toml").write_text(
        text[: text.index("taxels = [")] + "taxels = [\n" + "\n".join(rows) + "\n]\n"
    )
    (folder / "scene.toml").write_text(
        'skin = "skin.toml"\n[[load]]\nkind = "line"\nangle = "0 deg"\nforce = "10 N"\n'
        'direction = "radial"\n'
    )
    steps = np.arange(0, seconds + 10, 0.5)
    lines = [f"{t},{12 + 8 * np.sin(1.7 * t)},{50 * np.sin(0.9 * t)}" for t in steps]
    (folder / "path.csv").write_text(
        "# scene: scene.toml\nt_s,loads.0.force_N,loads.0.angle_deg\n" + "\n".join(lines) + "\n"
    )
    played = [str(folder / "path.csv"), "--rate", str(int(_RATE))]
    print(both_ends(played, [str(folder / "skin.toml")], seconds))


def both_ends(
    played: list[str],  # arguments of `suas simulate`
    skin: list[str],  # arguments of `suas invert`
    seconds: float,  # how long
) -> str:
    """Play readings to a pseudo-terminal and estimate them there, a program at either end.

    Returns frames and delays, in words.
    """
    command = [sys.executable, "-c", "from fitting.cli.app import main; main()"]
    environment = {**os.environ, "PYTHONPATH": str(SKIN.parents[2])}
    port = Path(tempfile.mkdtemp()) / "port"
    device = subprocess.Popen(
        [*command, "simulate", *played, "--live", "--json", "--port", str(port)],
        env=environment,
        stdout=subprocess.PIPE,
    )
    while not port.exists():
        time.sleep(0.2)
    live = ["--live", str(port), "--json", "--duration", str(seconds)]
    done = subprocess.run(
        [*command, "invert", *skin, *live], env=environment, stdout=subprocess.PIPE, check=True
    )
    device.terminate()
    device.wait()
    frames = [json.loads(line) for line in done.stdout.splitlines()]
    delays = 1e3 * np.percentile([frame["latency_s"] for frame in frames], [50, 99, 100])
    return (
        f"pseudo-terminal, {seconds:g} s at {_RATE:g} Hz: {len(frames)} frames estimated, "
        f"{frames[-1]['dropped']} dropped; from the last byte to the estimate {delays[0]:.1f} "
        f"ms median, {delays[1]:.1f} ms at 99 %, {delays[2]:.1f} ms at most"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--live", type=float, metavar="SECONDS")
    options = parser.parse_args()
    configure()
    print(f"load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    spec = skin_of_taxels()
    batch, live = LoadEstimator(spec), LoadEstimator(spec, live=True)
    counts = slide(batch)
    live.warm_up()
    shown("one frame, one contact", *timed(live, counts[:2000]))
    batch.estimate(counts)
    begin, work = time.perf_counter(), time.process_time()
    batch.estimate(counts)
    spent, busy = time.perf_counter() - begin, time.process_time() - work
    print(f"{FRAMES} frames of a log: {spent:.1f} s, {busy:.1f} s of processor time")
    against_scipy(batch, live, counts)
    if options.live:
        on_a_terminal(options.live)
    print(f"load average {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
