"""Run time against error: shell, solid and, where installed, FElupe side by side.

    python -m benchmarks.run_time_error [--rounds N] [--quick]

Four scenes at a given force, every program from the undeformed state, every mesh compared
with a solid far finer than any of them. All rows take turns, so that a change in the
machine's load touches all of them, and times are stated relative to one of the rows.
Writes the table and the plot of docs/benchmarks.md.
"""

import argparse
import contextlib
import dataclasses
import functools
import importlib.util
import statistics
import time
import tracemalloc
from collections.abc import Callable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental.compilation_cache import compilation_cache
from rich.console import Console
from rich.progress import Progress

from benchmarks.pages import DOCS, write_section
from benchmarks.run_time_report import Row, draw, equal_error, table_of
from suas_jax import configure
from suas_jax.config import SceneSpec, continuous_inputs, scene_from_dict
from suas_jax.equilibrium.correction import corrected
from suas_jax.equilibrium.equilibrium import Equilibrium, Problem, equilibrium
from suas_jax.runtime.compiled import OPTIONS
from suas_jax.scene.build import plan_for, problem_of
from suas_jax.scene.observables import load_observables
from suas_jax.scene.parts import scene_parts

EPDM = {"law": "mooney-rivlin", "C1": "20.7 MPa", "C2": "-4.4 MPa", "C3": "77 kPa"}
# Inner radius [mm], thickness [mm], angle of the load [deg], force [N].
SCENES = {
    "case A": (57.5, 1.5, 0.0, 24.366),
    "case B": (57.5, 1.5, 45.0, 20.669),
    "thin": (57.5, 0.8, 0.0, 10.042),
    "small radius": (40.0, 1.5, 60.0, 20.638),
}
SHELLS = (8, 16, 32, 64)
SOLIDS = ((32, 1), (64, 1), (64, 2), (128, 2), (600, 4))
PEERS = ((32, 1), (60, 1), (120, 1), (240, 2), (600, 4))
TRUTH = (512, 4)


@contextlib.contextmanager
def uncached() -> Iterator[None]:
    """Compile anew, past JAX's own cache: for measuring how long it takes."""
    name = "jax_enable_compilation_cache"
    before = getattr(jax.config, name)
    jax.config.update(name, False)
    compilation_cache.reset_cache()  # it looks at the setting once only
    try:
        yield
    finally:
        jax.config.update(name, before)
        compilation_cache.reset_cache()


def scene_of(name: str) -> SceneSpec:
    """A scene of the comparison."""
    radius, thickness, angle, force = SCENES[name]
    geometry = {
        "inner_radius": f"{radius} mm",
        "thickness": f"{thickness} mm",
        "half_angle": "90 deg",
        "width": "123 mm",
        "oil_gap": "5 mm",
    }
    load = {"kind": "line", "angle": f"{angle} deg", "force": f"{force} N"}
    tables = {"geometry": geometry, "material": EPDM, "load": [load]}
    return scene_from_dict(tables | {"oil": {"model": "incompressible"}})


_PROGRAMS: dict[Any, tuple[Any, float, int]] = {}


def _compiled(problem: Problem) -> tuple[Callable[[Problem], Equilibrium], float, int]:
    """The solver for problems of this shape, its compile time and its memory."""
    leaves, tree = jax.tree.flatten(problem)
    key = (tree, tuple(x.shape for x in leaves))
    if key not in _PROGRAMS:
        begin = time.perf_counter()
        lowered = jax.jit(functools.partial(equilibrium, omitted=True)).lower(problem)
        with uncached():
            program = lowered.compile(compiler_options=OPTIONS)
        seconds = time.perf_counter() - begin
        used = program.memory_analysis()
        parts = (
            used.temp_size_in_bytes,
            used.argument_size_in_bytes,
            used.output_size_in_bytes,
        )
        _PROGRAMS[key] = (program, seconds, sum(parts))
    return _PROGRAMS[key]


def own_row(scene: str, program: str, elements: int, layers: int = 0) -> Row:
    """The corrected shell or the solid of this project."""
    spec = scene_of(scene)
    inputs = {k: jnp.asarray(v, float) for k, v in continuous_inputs(spec).items()}
    counts = (elements, layers) if layers else (elements,)
    plan = plan_for(spec, "solid" if layers else "shell", counts)
    parts = scene_parts(spec, inputs)
    problem = problem_of(parts, plan.reduced())
    solver, seconds, memory = _compiled(problem)

    def call() -> tuple[float, float]:
        found = jax.block_until_ready(solver(problem))
        if int(found.result[0]) != 0:
            raise RuntimeError(f"{scene}, {program}, {elements} x {layers}: not converged")
        _, shown, mechanics = corrected(problem, found.state, found.change)
        read = dataclasses.replace(problem, mechanics=mechanics)
        moved = load_observables(parts, read, shown)[0]["displacement_m"]
        return float(shown.pressure[0]), float(moved[0])

    def timed() -> tuple[float, float]:
        jax.block_until_ready(solver(problem))
        return 0.0, 0.0

    row = Row(scene, program, f"{elements} x {layers or '-'}", timed, seconds, memory)
    row.error = call()  # turned into an error by the caller
    return row


def peer_row(scene: str, solver: str, mesh: tuple[int, int]) -> Row:
    """FElupe; the fewest equal load steps that converge."""
    from benchmarks.felupe_arch import Arch, FelupeArch

    radius, thickness, angle, force = SCENES[scene]
    arch = Arch(
        radius * 1e-3,
        thickness * 1e-3,
        np.pi / 2,
        0.123,
        20.7e6,
        -4.4e6,
        77e3,
        np.deg2rad(angle),
        force,
    )
    model = FelupeArch(arch, *mesh, solver)
    for steps in (1, 2, 4, 8):
        try:
            tracemalloc.start()
            pressure, moved, _ = model.solve(steps)
            break
        except RuntimeError:
            continue
        finally:
            memory = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
    else:
        raise RuntimeError(f"FElupe found no way to {scene}")
    name = {"pardiso": "FElupe, PARDISO", "superlu": "FElupe, SuperLU"}[solver]
    row = Row(
        scene, name, f"{mesh[0]} x {mesh[1]}", lambda: model.solve(steps)[:2], 0.0, memory
    )
    row.error = (pressure, moved)
    return row


def rows_of(scene: str, quick: bool) -> list[Row]:
    """All programs and meshes for a scene, their errors known."""
    truth = own_row(scene, "solid", *TRUTH).error
    rows = [own_row(scene, "shell", n) for n in SHELLS]
    rows += [own_row(scene, "solid", *mesh) for mesh in (SOLIDS[:3] if quick else SOLIDS)]
    if importlib.util.find_spec("felupe"):
        solvers = ["superlu"] + ["pardiso"] * bool(importlib.util.find_spec("pypardiso"))
        finest = len(PEERS) if scene == "case A" else -1
        meshes = PEERS[:2] if quick else PEERS[:finest]
        rows += [peer_row(scene, s, mesh) for s in solvers for mesh in meshes]
    for row in rows:
        row.error = tuple(abs(a / b - 1) for a, b in zip(row.error, truth, strict=True))
    return rows


def measure(rows: list[Row], rounds: int) -> None:
    """Let the rows take turns."""
    with Progress(transient=True) as progress:
        for _ in progress.track(range(rounds), description="timing"):
            for row in rows:
                time.sleep(0.3)  # threads of the one before may still spin
                row.seconds.append(_timed(row.call))


def _timed(call: Callable[[], Any]) -> float:
    """Median time of as many calls as take a tenth of a second, of one at least [s]."""
    times: list[float] = []
    while sum(times) < 0.1:
        begin = time.perf_counter()
        call()
        times.append(time.perf_counter() - begin)
    return statistics.median(times)


def main() -> None:
    """Measure, print, write the docs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--quick", action="store_true", help="few meshes, docs untouched")
    parser.add_argument("--scenes", type=int, default=len(SCENES), help="only the first ones")
    arguments = parser.parse_args()
    configure()
    rows: list[Row] = []
    console = Console(width=140)
    for scene in list(SCENES)[: 1 if arguments.quick else arguments.scenes]:
        group = rows_of(scene, arguments.quick)
        measure(group, arguments.rounds)
        rows += group
        console.print("\n".join(table_of(group)), markup=False)
    console.print("\n".join(equal_error(rows)), markup=False)
    if not arguments.quick:
        draw(rows, DOCS / "run_time_error.png")
        write_section("benchmarks.md", "equal error", equal_error(rows))


if __name__ == "__main__":
    main()
