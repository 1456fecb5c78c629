"""Time that a step of a creep's history takes, of the paper's section and of the shipped pad.

A press that comes and goes every 0.3 s, on rubber that relaxes as `hold.toml` has it. The
second of two runs, whose programs are loaded, is told::

    python -m benchmarks.history_steps
"""

import time
from pathlib import Path

import numpy as np

from suas_jax import configure
from suas_jax.config import SceneSpec, load_scene
from suas_jax.dynamics.course import history_of
from suas_jax.dynamics.history import history_sweep

SCENES = Path(__file__).parent.parent / "configs/scenes"


def told(name: str, scene: SceneSpec, force: float, rows: int) -> None:
    """Print what the second run takes."""
    times, forces = 0.3 * np.arange(rows + 1), force * (np.arange(rows + 1) % 2)
    for _ in range(2):
        wall, processor = time.perf_counter(), time.process_time()
        points = history_sweep(scene, history_of(list(times), force_N=list(forces))).points
        wall, processor = time.perf_counter() - wall, time.process_time() - processor
    steps, corrections = (sum(p[k] for p in points) for k in ("time_steps", "iterations"))
    print(
        f"{name}: {len(points)} rows, {steps} steps, {corrections} corrections: "
        f"{wall:.2f} s, {processor:.2f} s of processor time"
    )


if __name__ == "__main__":
    configure()
    hold, pad = (load_scene(SCENES / f"{name}.toml") for name in ("hold", "pad_crown"))
    own = {"relaxation": hold.material.relaxation}
    creeping = pad.model_copy(update={"material": pad.material.model_copy(update=own)})
    told("section", hold, 20.0, 40)
    told("pad", creeping, 6.0, 24)
