"""What an indentation curve of a ball on the shipped pad costs.

    python -m benchmarks.pad_curve [--model shell|solid] [--travels N]

`configs/scenes/pad_ball.toml` to 4 mm at the default tolerance: with the programs compiled or
loaded, then once more.
"""

import argparse
import time
from pathlib import Path

import numpy as np

from suas_jax import configure, sweep
from suas_jax.config import load_scene, with_solve

SCENE = Path(__file__).parent.parent / "configs/scenes/pad_ball.toml"
DEEPEST = 4e-3  # m


def main() -> None:
    """Print the times."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--model", choices=("shell", "solid"), default="shell")
    parser.add_argument("--travels", type=int, default=41)
    options = parser.parse_args()
    configure()
    scene = with_solve(load_scene(SCENE), model=options.model)
    for name in ("first", "again"):
        start, begin = time.process_time(), time.perf_counter()
        points = sweep(scene, depths=np.linspace(0, DEEPEST, options.travels)).points
        seconds, clock = time.process_time() - start, time.perf_counter() - begin
        ends = {point["status"] for point in points}
        error = max(point["discretisation_error"] for point in points)
        used = f"{seconds:.1f} s of processor time in {clock:.1f} s"
        print(f"{name}: {used}, {ends}, error by the mesh {error:.1e}", flush=True)


if __name__ == "__main__":
    main()
