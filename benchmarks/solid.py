"""The solid against an independent finite-element reference, and how long it takes.

    python benchmarks/solid.py            # 600 x 4, the accuracy and the timing table
    python benchmarks/solid.py 128 2      # another mesh
    python benchmarks/solid.py growth     # cost against the number of elements

Times are medians after compilation, dispatch included; the first call's compilation is
listed apart.
"""

import csv
import pathlib
import resource
import statistics
import sys
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from suas_jax.config import SceneSpec, continuous_inputs, scene_from_dict
from suas_jax.equilibrium.equilibrium import differentiable, equilibrium
from suas_jax.scene.build import build_problem, plan_for
from suas_jax.scene.solve import solve

REFERENCE = pathlib.Path(__file__).parents[1] / "tests" / "data" / "arch.csv"
EPDM = {"law": "mooney-rivlin", "C1": "20.7 MPa", "C2": "-4.4 MPa", "C3": "77 kPa"}
RUBBER = {
    "law": "ogden",
    "mu": ["0.63 MPa", "1.2 kPa", "-10 kPa"],
    "alpha": [1.3, 5.0, -2.0],
    "convention": "mu/alpha",
}


def scene_of(row: dict[str, str], mesh: tuple[int, int]) -> SceneSpec:
    """A reference case as a scene, without the wall as the references are."""
    load = {"kind": "line", "angle": f"{row['load_angle_deg']} deg", "force": "1 N"}
    if float(row["load_spread_m"]) > 0:
        load["spread"] = f"{row['load_spread_m']} m"
    return scene_from_dict(
        {
            "geometry": {
                "inner_radius": f"{row['inner_radius_m']} m",
                "thickness": f"{row['thickness_m']} m",
                "half_angle": "90 deg",
                "width": "123 mm",
                "oil_gap": "5 mm",
            },
            "material": RUBBER if "ogden" in row["law"] else EPDM,
            "oil": {"model": "incompressible"},
            "wall": {"contact": False},
            "load": [load],
            "solve": {
                "model": "solid",
                "mesh": list(mesh),
                "oil_pressure": f"{row['oil_pressure_Pa']} Pa",
            },
        }
    )


def accuracy(mesh: tuple[int, int]) -> None:
    """Relative errors of every reference case (stretches: absolute)."""
    print(f"{'case':20s}{'p [Pa]':>9s}{'force':>10s}{'inner':>10s}{'energy':>10s}", end="")
    print(f"{'stretch':>10s}{'':>10s}{'estimate':>10s}")
    with REFERENCE.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    for row in rows:
        report = solve(scene_of(row, mesh)).report
        load = report["loads"][0]
        pairs = (
            (load["force_N"], "force_N"),
            (load["inner_displacement_m"], "inner_displacement_along_load_m"),
            (report["strain_energy_J"], "strain_energy_J"),
        )
        errors = [found / float(row[name]) - 1 for found, name in pairs]
        errors += [
            report[f"stretch_{end}"] - float(row[f"inner_hoop_stretch_{end}"])
            for end in ("min", "max")
        ]
        errors.append(report["discretisation_error"])
        cells = "".join(f"{error:10.1e}" for error in errors)
        print(f"{row['case']:20s}{float(row['oil_pressure_Pa']):9.0f}{cells}", flush=True)


def timed(call: Callable[[], Any], repeat: int = 9) -> float:
    """Median time of a call that is compiled already [s]."""
    jax.block_until_ready(call())
    times = []
    for _ in range(repeat):
        start = time.perf_counter()
        jax.block_until_ready(call())
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def speed(mesh: tuple[int, int]) -> None:
    """Assembly, elimination, whole solve and gradient at case A, 24.4 N."""
    row = {
        "load_angle_deg": "0",
        "load_spread_m": "0",
        "inner_radius_m": "0.0575",
        "thickness_m": "0.0015",
        "law": "",
        "oil_pressure_Pa": "1e4",
    }
    spec = scene_of(row, mesh)
    inputs = {k: jnp.asarray(v, float) for k, v in continuous_inputs(spec).items()}
    inputs = {**inputs, "load.0.force": jnp.asarray(24.4)}
    del inputs["solve.oil_pressure"]
    free = spec.model_copy(
        update={"solve": spec.solve.model_copy(update={"oil_pressure": None})}
    )
    plan = plan_for(free, "solid", mesh)
    problem = build_problem(free, plan, inputs)

    @jax.jit
    def gradient(inputs: dict, state: Any) -> dict:
        def pressure(inputs: dict) -> jax.Array:
            return differentiable(build_problem(free, plan, inputs), state).pressure[0]

        return jax.grad(pressure)(inputs)

    run = jax.jit(equilibrium)
    start = time.perf_counter()
    found = jax.block_until_ready(run(problem))
    compiled = time.perf_counter() - start
    q, p, factor = found.state
    assemble = jax.jit(lambda q, p: problem.mechanics.assemble(q, p, factor))
    tangent = assemble(q, p).tangent
    sweep = jax.jit(lambda tangent, right: tangent.solve(right))
    right = jnp.stack([problem.mechanics.load, problem.mechanics.load], 1)
    whole, steps = timed(lambda: run(problem)), int(found.iterations[0])
    print(f"mesh {mesh[0]} x {mesh[1]}, {problem.mechanics.unknowns()} unknowns")
    for name, seconds in (
        ("assembly", timed(lambda: assemble(q, p))),
        ("condensation, sweep, recovery", timed(lambda: sweep(tangent, right))),
        (f"solve from zero, {steps} corrections", whole),
        ("per correction", whole / steps),
        ("gradient by all inputs", timed(lambda: gradient(inputs, found.state))),
    ):
        print(f"  {name:36s}{1e3 * seconds:9.2f} ms")
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"  first solve {compiled:.1f} s, peak memory of the process {memory:.0f} MB")


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    if "growth" in sys.argv:
        for elements in (600, 2000, 6000, 20000):
            speed((elements, 4))
    else:
        size = (int(sys.argv[1]), int(sys.argv[2])) if len(sys.argv) > 2 else (600, 4)
        speed(size)
        accuracy(size)
