"""What `model = "auto"` chooses for the paper's cases, and how far off it is.

    python -m benchmarks.automatic_choice

Writes the table of docs/errors_method.md. True errors are those of pressure and mid-surface
displacement against the solid with 1024 x 8 elements.
"""

from pathlib import Path

from benchmarks.error_estimate import true_error
from benchmarks.pages import write_section
from suas_jax import configure
from suas_jax.config import load_scene, with_inputs, with_solve
from suas_jax.scene.solve import solve

SCENES = Path(__file__).parent.parent / "configs" / "scenes"
FORCES = {"case A": ("case_a.toml", 24.366), "case B": ("case_b.toml", 20.669)}
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5)
TRUTH = (1024, 8)


def table() -> list[str]:
    """Markdown, one line a case and tolerance."""
    head = ("", "rtol", "chosen", "mesh", "unknowns", "estimate", "true error")
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for name, (file, force) in FORCES.items():
        scene = with_solve(load_scene(SCENES / file), oil_pressure=None)
        scene = with_inputs(scene, {"load.0.force": force})
        truth = solve(with_solve(scene, model="solid", mesh=TRUTH)).report
        for rtol in TOLERANCES:
            solution = solve(with_solve(scene, model="auto", rtol=rtol))
            report, plan = solution.report, solution.plan
            size = plan.counts
            cells = (
                name,
                f"{rtol:.0e}",
                report["model"],
                " x ".join(map(str, size)),
                str(report["unknowns"]),
                f"{report['error_estimate']:.1e}" + (not report["rtol_met"]) * ", misses rtol",
                "(the truth)" if size == TRUTH else f"{true_error(report, truth):.1e}",
            )
            lines.append("| " + " | ".join(cells) + " |")
    return lines


def main() -> None:
    """Print and write the table."""
    configure()
    lines = table()
    print("\n".join(lines))
    write_section("errors_method.md", "choice", lines)


if __name__ == "__main__":
    main()
