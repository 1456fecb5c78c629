"""What a pad costs: its solver's parts, and the user's own command.

    python -m benchmarks.pad_speed            prints and writes the tables of docs/pad_method.md

The shipped pad under a patch of 10 N at 30 degrees and -21.5 mm, no symmetry, 24 x 20 elements,
double precision, compiled beforehand; medians, the rows take turns. Solves and gradient have
the effect of transverse shear in them. The command is run in processes of their own, with an
empty cache folder and with a filled one.
"""

import functools
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp

from benchmarks.pages import write_section
from suas_jax import configure
from suas_jax.config import continuous_inputs, load_scene, with_inputs
from suas_jax.equilibrium.balance import residual, unknowns_of
from suas_jax.equilibrium.correction import corrected
from suas_jax.equilibrium.equilibrium import equilibrium
from suas_jax.numerics.bordered_solve import eliminate
from suas_jax.runtime.compiled import OPTIONS
from suas_jax.scene.build import build_problem, plan_for

ROOT = Path(__file__).parent.parent
SCENE = ROOT / "configs/scenes/pad_side.toml"
ELEMENTS, ROUNDS = (24, 20), 9
FORCE, MORE, FURTHER = 10.0, 1.05, 2e-3  # N; share; m
SUAS = [sys.executable, "-c", "from fitting.cli.app import main; main()"]


def quick(function: Callable[..., Any]) -> Callable[..., Any]:
    return jax.jit(function, compiler_options=OPTIONS)


def parts() -> list[str]:
    """Rows of the solver's parts."""
    scene = with_inputs(load_scene(SCENE), {"load.0.force": FORCE})
    plan = plan_for(scene, "shell", ELEMENTS)
    inputs = {k: jnp.asarray(v, float) for k, v in continuous_inputs(scene).items()}

    def problem_of(inputs: dict[str, Any]) -> Any:
        return build_problem(scene, plan, inputs)

    def correction(problem: Any, y: Any, level: Any) -> Any:
        right, operator = residual(problem, y, level)
        return eliminate(operator, right).solution

    def pressure(inputs: dict[str, Any], state: Any, change: Any) -> jax.Array:
        return corrected(problem_of(inputs), state, change).state.pressure[0]

    solve = quick(functools.partial(equilibrium, omitted=True))
    problem = problem_of(inputs)
    found = solve(problem)
    assert int(found.result[0]) == 0
    state = found.state
    y, level, _ = unknowns_of(problem, state)
    one, gradient = quick(correction), quick(jax.grad(pressure))
    more = problem_of(inputs | {"load.0.force": MORE * inputs["load.0.force"]})
    further = problem_of(inputs | {"load.0.axial": inputs["load.0.axial"] + FURTHER})
    start = state._replace(factor=state.factor / MORE)
    rows: dict[str, Callable[[], Any]] = {
        f"{FORCE:g} N from rest": lambda: solve(problem),
        "one Newton correction": lambda: one(problem, y, level),
        f"{100 * (MORE - 1):.0f} % more load": lambda: solve(more, start),
        f"{1e3 * FURTHER:g} mm further along the axis": lambda: solve(further, state),
        "gradient of the oil's pressure by all inputs": lambda: gradient(
            inputs, state, found.change
        ),
    }
    assert all(int(rows[name]().result[0]) == 0 for name in list(rows)[2:4])
    times: dict[str, list[float]] = {name: [] for name in rows}
    for call in rows.values():
        jax.block_until_ready(call())
    for _ in range(ROUNDS):
        for name, call in rows.items():
            begin = time.perf_counter()
            jax.block_until_ready(call())
            times[name].append(time.perf_counter() - begin)
    typical = {name: statistics.median(x) for name, x in times.items()}
    whole = typical[next(iter(rows))]
    lines = ["| | ms | in solves from rest |", "|---|---|---|"]
    for name, seconds in typical.items():
        lines.append(f"| {name} | {1e3 * seconds:.0f} | {seconds / whole:.2f} |")
    return lines


def commands() -> list[str]:
    """Rows of the user's command."""
    lines = ["| `suas solve pad_side.toml` | s | CPU s | memory |", "|---|---|---|---|"]
    for options in ([], ["--gradient", "oil_pressure_Pa"]):
        with tempfile.TemporaryDirectory() as folder:
            for kind, runs in (("nothing kept", 1), ("programs kept", 3)):
                taken = [timed_command(options, folder) for _ in range(runs)]
                wall, spent, memory = (statistics.median(x) for x in zip(*taken, strict=True))
                name = " ".join([*options[:1], kind])
                lines.append(f"| {name} | {wall:.1f} | {spent:.1f} | {memory:.0f} MB |")
    return lines


def timed_command(options: list[str], folder: str) -> tuple[float, float, float]:
    """Wall time [s], processor time [s] and largest memory [MB] of one run."""
    environment = os.environ | {"XDG_CACHE_HOME": folder}
    begin = time.perf_counter()
    process = subprocess.Popen(
        [*SUAS, "solve", str(SCENE), "--json", *options],
        env=environment,
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    assert process.stdout is not None
    assert json.loads(process.stdout.read())["status"] == "converged"
    _, _, usage = os.wait4(process.pid, 0)
    wall = time.perf_counter() - begin
    return wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def main() -> None:
    configure()
    processes = commands()  # first: a process counts the memory of the one it came from, too
    lines = [*parts(), "", *processes]
    print("\n".join(lines))
    write_section("pad_method.md", "speed", lines)


if __name__ == "__main__":
    main()
