"""How fast the lumped shell solves: one table, ratios taken side by side in one run.

    python benchmarks/shell_speed.py

Case A of the paper (24.4 N at the crown), 16 elements, double precision, compiled
beforehand. Every row is the median of its repetitions, dispatch included; the rows take
turns, so that a change in the machine's load touches all of them.
"""

import statistics
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from suas_jax.config import continuous_inputs, scene_from_dict
from suas_jax.equilibrium.balance import State
from suas_jax.equilibrium.equilibrium import equilibrium
from suas_jax.equilibrium.equilibrium_path import path
from suas_jax.runtime.compiled import OPTIONS
from suas_jax.scene.build import build_problem, plan_for

BATCH, SWEEP, ROUNDS, FORCE = 1000, 30, 15, 24.4

SCENE = {
    "geometry": {
        "inner_radius": "57.5 mm",
        "thickness": "1.5 mm",
        "half_angle": "90 deg",
        "width": "123 mm",
        "oil_gap": "5 mm",
    },
    "material": {"law": "mooney-rivlin", "C1": "20.7 MPa", "C2": "-4.4 MPa", "C3": "77 kPa"},
    "oil": {"model": "incompressible"},
    "load": [{"kind": "line", "angle": "0 deg", "force": f"{FORCE} N"}],
}


def timed(call: Callable[[], Any], repeat: int) -> float:
    """Mean time of a few calls in a row [s]."""
    start = time.perf_counter()
    for _ in range(repeat):
        jax.block_until_ready(call())
    return (time.perf_counter() - start) / repeat


class Timing(NamedTuple):
    """What one row measured."""

    seconds: float  # median of the rounds
    ratio: float  # to one solve from zero, median of the ratios side by side
    solves: int  # equilibria in it

    @property
    def rate(self) -> float:
        """Equilibria per second."""
        return self.solves / self.seconds


def measured() -> tuple[float, dict[str, Timing]]:
    """Time to compile the first solve [s], and the rows of the table."""
    scene = scene_from_dict(SCENE)
    plan = plan_for(scene, "shell", (16,))
    inputs = {k: jnp.asarray(v, float) for k, v in continuous_inputs(scene).items()}

    def problem_of(inputs: dict) -> Any:
        return build_problem(scene, plan, inputs)

    def pressure(inputs: dict) -> jax.Array:
        return equilibrium(problem_of(inputs)).state.pressure[0]

    def solved_at(force: jax.Array, stiffness: jax.Array) -> State:
        c1 = stiffness * inputs["material.C1"]
        changed = problem_of({**inputs, "load.0.force": force, "material.C1": c1})
        return equilibrium(changed).state

    def varied(force: jax.Array, stiffness: jax.Array) -> jax.Array:
        return solved_at(force, stiffness).pressure[0]

    def warm(force: jax.Array, stiffness: jax.Array, state: State) -> jax.Array:
        c1 = stiffness * inputs["material.C1"]
        changed = problem_of({**inputs, "load.0.force": force, "material.C1": c1})
        return equilibrium(changed, state).state.pressure[0]

    problem = problem_of(inputs)
    before = problem_of({**inputs, "load.0.force": 0.95 * inputs["load.0.force"]})
    near = equilibrium(before).state
    near = near._replace(factor=0.95 * near.factor)  # 95 % of this problem's loads
    levels = jnp.linspace(1 / SWEEP, 1, SWEEP)
    forces, stiffness = jnp.linspace(1, 25, BATCH), jnp.linspace(2, 0.8, BATCH)
    halves = [slice(0, BATCH // 2), slice(BATCH // 2, BATCH)]

    def quick(function: Callable) -> Callable:
        return jax.jit(function, compiler_options=OPTIONS)

    solve, gradient = quick(equilibrium), quick(jax.grad(pressure))
    sweep, batch = quick(path), quick(jax.vmap(varied))
    # As in a fit or along a track: every lane starts from the state at 95 % of its load.
    warm_batch = quick(jax.vmap(warm))
    fewer = quick(jax.vmap(lambda f, c: solved_at(0.95 * f, c)))(forces, stiffness)
    fewer = fewer._replace(factor=0.95 * fewer.factor)
    started = time.perf_counter()
    jax.block_until_ready(solve(problem))
    compile_time = time.perf_counter() - started

    # One call uses little of a second core: the loop's operations are short. Two threads
    # with half of the lanes each use both.
    with ThreadPoolExecutor(2) as pool:

        def half(lanes: slice) -> jax.Array:
            return jax.block_until_ready(batch(forces[lanes], stiffness[lanes]))

        def warm_half(lanes: slice) -> jax.Array:
            states = jax.tree.map(lambda x: x[lanes], fewer)
            return jax.block_until_ready(warm_batch(forces[lanes], stiffness[lanes], states))

        rows: dict[str, tuple[Callable[[], Any], int, int]] = {
            "solve from zero": (lambda: solve(problem), 20, 1),
            "solve from 95 % of the load": (lambda: solve(problem, near), 20, 1),
            "solve and gradient by all inputs": (lambda: gradient(inputs), 20, 1),
            f"sweep of {SWEEP} points": (lambda: sweep(problem, levels), 3, SWEEP),
            f"batch of {BATCH}, one call": (lambda: batch(forces, stiffness), 1, BATCH),
            f"batch of {BATCH}, two threads": (lambda: list(pool.map(half, halves)), 1, BATCH),
            "  from 95 % of the loads": (lambda: list(pool.map(warm_half, halves)), 1, BATCH),
        }
        for call, _, _ in rows.values():
            jax.block_until_ready(call())
        times: dict[str, list[float]] = {name: [] for name in rows}
        for _ in range(ROUNDS):
            for name, (call, repeat, _) in rows.items():
                times[name].append(timed(call, repeat))

    reference = times["solve from zero"]
    found = {}
    for name, (_, _, count) in rows.items():
        ratio = statistics.median(a / b for a, b in zip(times[name], reference, strict=True))
        found[name] = Timing(statistics.median(times[name]), ratio, count)
    return compile_time, found


def main() -> None:
    """Print the table."""
    compile_time, found = measured()
    print(f"compile, first solve: {compile_time:.2f} s")
    print(f"{'':34s}{'ms':>10s}{'x one solve':>14s}{'equilibria/s':>14s}")
    for name, row in found.items():
        print(f"{name:34s}{1e3 * row.seconds:10.3f}{row.ratio:14.2f}{row.rate:14.0f}")


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main()
