"""What lanes of `forward` cost, free and at the wall: the table of docs/benchmarks.md.

    python -m benchmarks.lanes

The paper's skin, 32 elements, from rest, compiled beforehand. Rows take turns, so that a
change in the machine's load touches all of them; times are the processor's, of all threads.
On an accelerator (`JAX_PLATFORMS=cuda`) they are the clock's, and no page is written.
"""

import resource
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from benchmarks.pages import write_section
from suas_jax import configure, jit, load_skin
from suas_jax.numerics.lanes import on_cpu
from suas_jax.scene.forward import SensorOutput, forward
from suas_jax.scene.loads import Loads
from suas_jax.scene.skin import skin_of

SKIN = Path(__file__).parent.parent / "configs" / "skins" / "suas.toml"
LANES, MANY, ROUNDS = 64, 10_000, 5
# At the wall: angle [deg] and force [N]; it carries 1 to 158 N of them.
HELD = np.array([(0, 84), (0, 120), (0, 240), (45, 40), (45, 60), (45, 100)])
SECTION = {  # of random sections, from and to [m]
    "geometry.inner_radius": (0.045, 0.07),
    "geometry.thickness": (8e-4, 3e-3),
    "geometry.oil_gap": (4e-3, 8e-3),
}


def rows() -> dict[str, tuple[int, Callable[[], SensorOutput]]]:
    """Lanes of every row, and what to call."""
    spec, rng = load_skin(SKIN), np.random.default_rng(0)
    held, free = skin_of(spec), skin_of(spec, contact=False)
    angle, force = rng.uniform(-1.2, 1.2, MANY), rng.uniform(1, 15, MANY)
    at_wall = np.resize(np.deg2rad(HELD[:, 0]), LANES), np.resize(HELD[:, 1], LANES)
    one = angle[:LANES].copy(), force[:LANES].copy()
    one[0][7], one[1][7] = at_wall[0][4], at_wall[1][4]
    drawn = {name: rng.uniform(*ends, MANY) for name, ends in SECTION.items()}
    scaled = force * (drawn["geometry.thickness"] / 1.5e-3) ** 2

    @jit
    def sections(inputs: dict[str, Array], angle: Array, force: Array) -> SensorOutput:
        def of_one(inputs: dict[str, Array], angle: Array, force: Array) -> SensorOutput:
            skin = skin_of(spec, inputs, contact=False)
            return forward(skin, Loads.line(angle, force))

        return jax.vmap(of_one)(inputs, angle, force)

    few = Loads.line(angle[:LANES], force[:LANES])
    case_a = Loads.line(0.0, np.linspace(1, 25, MANY))
    numbers = jax.tree.map(jnp.asarray, (drawn, angle, scaled))
    return {
        "64 lanes, none at the wall": (LANES, lambda: forward(held, few)),
        "64 lanes, one at the wall": (LANES, lambda: forward(held, Loads.line(*one))),
        "64 lanes, all at the wall": (LANES, lambda: forward(held, Loads.line(*at_wall))),
        "10,000 lanes, 1 to 25 N at the crown": (MANY, lambda: forward(free, case_a)),
        "10,000 lanes, 1 to 15 N anywhere": (
            MANY,
            lambda: forward(free, Loads.line(angle, force)),
        ),
        "10,000 random sections, a load each": (MANY, lambda: sections(*numbers)),
    }


def busy() -> float:
    """Processor seconds of this program so far."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def main() -> None:
    """Print the table, and write it."""
    configure()
    calls, clock = rows(), busy if on_cpu() else time.perf_counter
    for _, call in calls.values():
        output = jax.block_until_ready(call())
        assert not np.any(output.result)
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(ROUNDS):
        for name, (_, call) in calls.items():
            begin = clock()
            jax.block_until_ready(call())
            times[name].append(clock() - begin)
    first = times[next(iter(times))]
    kind = "processor time" if on_cpu() else "time"
    lines = [f"| from rest | {kind} a lane | over the first row's |", "|---|---|---|"]
    for name, (count, _) in calls.items():
        ratio = statistics.median(
            (a / count) / (b / LANES) for a, b in zip(times[name], first, strict=True)
        )
        lane = 1e6 * statistics.median(times[name]) / count
        lines.append(f"| {name} | {lane:.{0 if lane >= 10 else 1}f} us | {ratio:.2f} |")
    print("\n".join(lines))
    if on_cpu():
        write_section("benchmarks.md", "lanes", lines)


if __name__ == "__main__":
    main()
