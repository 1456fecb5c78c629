"""Accuracy beside references, and the speed of the section: computed and measured again.

    python -m benchmarks.accuracy_speed

Rewrites their tables in docs/validation.md and docs/benchmarks.md. Nothing else should run
meanwhile: the times are those of the clock.
"""

import statistics
import time

import numpy as np

from benchmarks.demo import CASES, ROOT
from benchmarks.inverse_load import skin_of_taxels
from benchmarks.inverse_load_speed import slide, timed
from benchmarks.pages import write_section
from benchmarks.shell_speed import BATCH, measured
from fitting import LoadEstimator
from suas_jax import configure, load_scene, solve, sweep, with_inputs
from suas_jax.config import continuous_inputs

SCENES = ROOT / "configs" / "scenes"
PAD_PRESSURE, PAD_DISPLACEMENT, PAD_CONTACT = 1557.5, 2.120, 17.05  # continuum: Pa, mm, N


def accuracy() -> list[str]:
    """The paper's cases and the pad beside finite elements and the paper."""
    rows = ["| | reference | suas_jax |", "|---|---|---|"]
    contacts = []
    for name, case in CASES.items():
        scene = load_scene(SCENES / case.scene)
        force = solve(scene).report["loads"][0]["force_N"]
        curve = sweep(scene, forces=[case.contact * 1.05 * i / 10 for i in range(11)])
        contacts.append(curve.first_contact["force_N"] if curve.first_contact else float("nan"))
        rows.append(
            f"| case {name[0]} at 10 kPa: force | {case.reference} N (finite elements), "
            f"{case.paper} N (paper) | {force:.3f} N |"
        )
    wanted = ", ".join(f"{case.contact} N" for case in CASES.values())
    found = ", ".join(f"{force:.1f} N" for force in contacts)
    rows.append(
        f"| case A, B: first contact with the wall | {wanted} (finite elements) | {found} |"
    )
    pad = load_scene(SCENES / "pad_crown.toml")
    report = solve(pad).report
    moved = 1e3 * report["loads"][0]["inner_displacement_m"]
    rows.append(
        f"| pad, 6 N on 6 x 6 mm: oil pressure, displacement | {PAD_PRESSURE:,} Pa, "
        f"{PAD_DISPLACEMENT:.3f} mm (continuum) | {report['oil_pressure_Pa']:,.0f} Pa, "
        f"{moved:.3f} mm |"
    )
    curve = sweep(pad, forces=[0.0, 8.0, 14.0, 18.0])
    touch = curve.first_contact["force_N"] if curve.first_contact else float("nan")
    rows.append(
        f"| pad: first contact with the wall | {PAD_CONTACT} N (continuum) | {touch:.2f} N |"
    )
    return rows


def solved_again(name: str) -> float:
    """Time of `solve` for another force on a scene [s]."""
    scene = load_scene(SCENES / name)
    force, times = continuous_inputs(scene)["load.0.force"], []
    for share in np.linspace(0.9, 1.1, 21):
        other = with_inputs(scene, {"load.0.force": share * force})
        begin = time.perf_counter()
        solve(other)
        times.append(time.perf_counter() - begin)
    return statistics.median(times)


def speed() -> list[str]:
    """One equilibrium, many, and one frame to its load."""
    _, found = measured()
    alone = found["solve from zero"].seconds
    with_gradient = found["solve and gradient by all inputs"].seconds
    batches = (f"batch of {BATCH}, two threads", "  from 95 % of the loads")
    from_rest, from_near = (found[name].rate for name in batches)
    spec = skin_of_taxels()
    live = LoadEstimator(spec, live=True)
    counts = slide(LoadEstimator(spec))
    live.warm_up()
    frame = statistics.median(timed(live, counts[:2000])[0])
    section, pad = (1e3 * solved_again(f"{name}.toml") for name in ("case_b", "pad_crown"))
    return [
        "| | two quiet CPU cores |",
        "|---|---|",
        "| section: one equilibrium from rest, one with the gradient by all inputs | "
        f"{1e3 * alone:.2f} ms, {1e3 * with_gradient:.2f} ms |",
        "| `solve` in Python, its report included, for another force: section, pad | "
        f"{section:.0f} ms, {pad:.0f} ms |",
        "| section: equilibria of 1 to 25 N at the crown on 16 elements in a batch, "
        "two threads, from rest, from a neighbouring state | "
        f"{from_rest:,.0f} per second, {from_near:,.0f} per second |",
        f"| section: one frame of 40 taxels to its load, warm | {1e3 * frame:.1f} ms |",
    ]


def main() -> None:
    """Rewrite both tables."""
    configure()
    tables = (("validation.md", "accuracy", accuracy()), ("benchmarks.md", "speed", speed()))
    for page, name, rows in tables:
        write_section(page, name, rows)
        print("\n".join([*rows, ""]))


if __name__ == "__main__":
    main()
