"""The paper's two load cases, their curves to wall contact, and what moves the pressure.

Run by `make demo`; figures and curves go to the folder `demo`.
"""

import dataclasses
from pathlib import Path

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from suas_jax import (
    configure,
    continuous_inputs,
    gradient,
    load_scene,
    plot_solution,
    plot_sweep,
    solve,
    sweep,
    with_inputs,
    with_solve,
)
from suas_jax.scene.solve import Solution
from suas_jax.scene.sweep import Sweep

ROOT = Path(__file__).parent.parent
OUTPUT = ROOT / "demo"


@dataclasses.dataclass(frozen=True)
class Case:
    """A load case at 10 kPa with what others found."""

    scene: str  # its file
    paper: float  # total force of the paper's finite-element model [N]
    reference: float  # total force of independent, converged finite elements [N]
    inner: float  # displacement of the inner face under the load of the same [mm]
    contact: float  # their force at first wall contact [N]


CASES = {
    "A, load at the crown": Case("case_a.toml", 24.4, 24.366, 3.045, 82.8),
    "B, load at 45 degrees": Case("case_b.toml", 20.7, 20.669, 3.949, 38.1),
}


def solved(case: Case) -> tuple[Solution, Sweep]:
    """Solve a case and follow it to the wall; write its figures and its curve."""
    scene = load_scene(ROOT / "configs" / "scenes" / case.scene)
    label = case.scene.removesuffix(".toml")
    solution = solve(scene, repeat=21)
    plot_solution(solution, OUTPUT / f"{label}.png")
    forces = [case.contact * 1.05 * i / 20 for i in range(21)]
    curve = sweep(scene, forces=forces)
    plot_sweep(curve, OUTPUT / f"{label}_curve.png")
    curve.write_csv(OUTPUT / f"{label}_curve.csv")
    return solution, curve


def comparison(results: dict[str, tuple[Solution, Sweep]]) -> Table:
    """The paper's numbers, those of independent finite elements, and ours."""
    columns = ("case", "quantity", "paper", "finite elements", "suas_jax")
    table = Table(*columns, title="At 10 kPa of oil pressure")
    for name, (solution, curve) in results.items():
        case, load, contact = CASES[name], solution.report["loads"][0], curve.first_contact
        force, inner = load["force_N"], 1e3 * load["inner_displacement_m"]
        wall = "none" if contact is None else f"{contact['force_N']:.1f}"
        table.add_row(name, "force", f"{case.paper} N", f"{case.reference} N", f"{force:.3f} N")
        table.add_row("", "inner face", "", f"{case.inner} mm", f"{inner:.3f} mm")
        table.add_row("", "first wall contact", "", f"{case.contact} N", f"{wall} N")
    return table


def sensitivities(solution: Solution) -> Table:
    """What moves the oil pressure most, the load kept: change per per cent of an input."""
    force = solution.report["loads"][0]["force_N"]
    scene = with_solve(solution.scene, oil_pressure=None)
    scene = with_inputs(scene, {"load.0.force": force})
    forced = solve(scene)
    slopes, values = gradient(forced, "oil_pressure_Pa"), continuous_inputs(scene)
    pressure = forced.report["oil_pressure_Pa"]
    shares = {key: slopes[key] * values[key] / pressure for key in slopes}
    table = Table("1 % more of", "changes the oil pressure by", title="Case A at its force")
    for key in sorted((k for k in shares if shares[k]), key=lambda k: -abs(shares[k])):
        table.add_row(key, f"{shares[key]:+.3f} %")
    return table


def main() -> None:
    """Solve, sweep, differentiate; print tables and write figures."""
    configure()
    OUTPUT.mkdir(exist_ok=True)
    console = Console()
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    results: dict[str, tuple[Solution, Sweep]] = {}
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("")
        for name, case in CASES.items():
            progress.update(task, description=f"case {name}: solve, then sweep to the wall")
            results[name] = solved(case)
        progress.update(task, description="gradient of the oil pressure")
        slopes = sensitivities(results[next(iter(CASES))][0])
    console.print(comparison(results))
    times = [s.report["timings_s"]["solve"] for s, _ in results.values()]
    text = " and ".join(f"{1e3 * t:.1f} ms" for t in times)
    console.print(f"Once compiled, a solve with its error estimate takes {text}.\n")
    console.print(slopes)
    for path in sorted(OUTPUT.iterdir()):
        console.print(f"wrote {path.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
