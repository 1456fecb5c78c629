"""The solved scenes that `suas tour` shows before anything is compiled.

    python -m benchmarks.tour_states

Writes fitting/cli/tour.json. A test solves the scenes again and compares.
"""

from pathlib import Path
from typing import Any

import numpy as np

from fitting.cli.tour import STATES
from fitting.json_text import json_text
from suas_jax import Solution, configure, load_scene, solve
from suas_jax.figures.outline import outline
from suas_jax.figures.section import deformed
from suas_jax.files.writing import write_text

ROOT = Path(__file__).parent.parent
SCENES = ("press", "pad_fingers")
_SPARSE = 4  # of the points of a curve one is kept


def solution_of(name: str) -> Solution:
    """A scene of the tour, solved."""
    return solve(load_scene(ROOT / "configs" / "scenes" / f"{name}.toml"))


def answer(name: str, report: dict[str, Any]) -> dict[str, Any]:
    """What the tour tells of a scene's report."""
    found = {"scene": f"configs/scenes/{name}.toml"} | {
        key: report[key] for key in ("dimension", "oil_pressure_Pa", "min_gap_m")
    }
    wanted = ("angle_deg", "axial_m", "force_N")
    found["loads"] = [{key: x[key] for key in wanted if key in x} for x in report["loads"]]
    wanted = ("angle_deg", "axial_m", "so")
    found["taxels"] = [{key: round(x[key], 5) for key in wanted} for x in report["taxels"]]
    return found


def curves(solution: Solution) -> dict[str, Any]:
    """The faces of a section and the wall [2, point] [mm]; nothing of a pad."""
    if solution.report["dimension"] == 3:
        return {}
    drawn = outline(solution.scene)
    shape = deformed(solution, drawn)
    found = {"inner": shape.inner, "outer": shape.outer, "wall": 1e3 * drawn.wall}
    return {
        name: np.round(np.c_[x[:, :-1:_SPARSE], x[:, -1]], 2).tolist()
        for name, x in found.items()
    }


def main() -> None:
    """Write the file."""
    configure()
    solved = {name: solution_of(name) for name in SCENES}
    states = [answer(name, x.report) | curves(x) for name, x in solved.items()]
    write_text(STATES, json_text(states) + "\n")


if __name__ == "__main__":
    main()
