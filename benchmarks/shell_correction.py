"""The shell with and without the effect of what it leaves out, against a much finer solid.

    python -m benchmarks.shell_correction [SCENES] [--seed N]

Thickness 0.4-4 mm, radius 30-100 mm, half angle 45-90 degrees; line loads, spread loads and
pressures, inwards, outwards and turned, from 1 % to 150 % of what gives the paper's pressure;
oil that is trapped, compressible or vented; four laws. None of the scenes is among those that
the clamps' constants were fitted to. Scenes that touch the wall or have no equilibrium are
drawn again. Errors are relative: of the pressure to itself, of displacements under the loads
and of taxels' gaps to the largest displacement of the mid-surface.
"""

import argparse
import dataclasses
import functools
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from rich.console import Console
from rich.table import Table

from benchmarks.error_estimate import FLOOR, studied
from suas_jax import configure
from suas_jax.config import SceneSpec, continuous_inputs, with_solve
from suas_jax.equilibrium.balance import State
from suas_jax.equilibrium.equilibrium import equilibrium
from suas_jax.mechanics.model import AbstractPlan
from suas_jax.runtime.compiled import OPTIONS
from suas_jax.scene.build import Inputs, Structure, plan_for, problem_of
from suas_jax.scene.observables import observe
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.report import plain
from suas_jax.scene.solve import solve

ELEMENTS = 64
TRUTH = (512, 6)
QUANTITIES = ("pressure", "mid-surface", "inner face", "taxels' gaps")


@functools.partial(eqx.filter_jit, compiler_options=OPTIONS)
def _observed(
    scene: Structure, plan: AbstractPlan, inputs: Inputs, state: State | None
) -> tuple[Array, dict[str, Any]]:
    """What is observed of an equilibrium, that of the solid if none is given."""
    parts = scene_parts(scene.scene, inputs)
    problem = problem_of(parts, plan)
    result = jnp.zeros(1, int)
    if state is None:
        found = equilibrium(problem)
        result, state = found.result, found.state
    report = observe(parts, problem, state)
    size = problem.mechanics.shape(state.q).largest_mid_displacement()
    return result, report | {"size": size}


@dataclasses.dataclass(frozen=True)
class Case:
    """Errors of one scene."""

    label: str  # what the scene is
    before: np.ndarray  # of the lumped shell, by quantity
    after: np.ndarray  # of the corrected shell
    estimate: float  # stated error
    model: float  # its part by the model

    @property
    def true(self) -> float:
        """What the estimate is of: the error of pressure and mid-surface."""
        return float(self.after[:2].max())


def errors(report: dict[str, Any], truth: dict[str, Any]) -> np.ndarray:
    """Relative errors by quantity; zero where a scene hasn't got one."""
    size = truth["size"]
    pressure = 0.0
    if truth["oil_pressure_Pa"] != 0:
        pressure = abs(report["oil_pressure_Pa"] / truth["oil_pressure_Pa"] - 1)
    pairs = [x for x in zip(report["loads"], truth["loads"], strict=True) if len(x[0]) > 2]
    moved = [
        max((abs(a[key] - b[key]) / size for a, b in pairs), default=0.0)
        for key in ("displacement_m", "inner_displacement_m")
    ]
    gaps = np.subtract(report["taxels"]["gap_m"], truth["taxels"]["gap_m"])
    return np.array([pressure, *moved, np.max(np.abs(gaps)) / size])


def case_of(scene: SceneSpec) -> Case | None:
    """Errors of a scene; None if it has no valid equilibrium."""
    solution = solve(with_solve(scene, model="shell", elements=ELEMENTS))
    report = solution.report
    if report["status"] != "converged" or report["wall_contact"] or not report["stable"]:
        return None
    inputs = {k: jnp.asarray(v, float) for k, v in continuous_inputs(scene).items()}
    static = Structure(scene)
    _, lumped = _observed(static, solution.plan, inputs, solution.state)
    result, truth = _observed(static, plan_for(scene, "solid", TRUTH), inputs, None)
    if int(result[0]) != 0:
        return None
    gaps = [taxel["gap_m"] for taxel in report["taxels"]]
    corrected = report | {"taxels": {"gap_m": gaps}}
    exact = plain(truth)
    loads = ", ".join(
        load.kind if load.kind == "pressure" else f"{np.rad2deg(load.angle):.0f} deg"
        for load in scene.loads
    )
    thickness = f"{1e3 * scene.geometry.mean_thickness:.2f} mm"
    return Case(
        f"{scene.material.law}, {scene.oil.model}, {thickness}, {loads}",
        errors(plain(lumped), exact),
        errors(corrected, exact),
        report["error_estimate"],
        report["model_error"],
    )


def study(count: int, seed: int) -> list[Case]:
    """Random scenes, pattern by pattern."""
    return studied(count, seed, case_of)


def main() -> None:
    """Print the table of errors before and after."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="?", type=int, default=42)
    parser.add_argument("--seed", type=int, default=11)
    arguments = parser.parse_args()
    configure()
    cases = study(arguments.scenes, arguments.seed)
    table = Table("error of", title=f"{len(cases)} scenes, lumped shell -> corrected shell")
    for column in ("rms", "median", "largest"):
        table.add_column(column)
    before, after = (np.stack([getattr(c, x) for c in cases]) for x in ("before", "after"))
    for k, name in enumerate(QUANTITIES):
        has = before[:, k] > 0
        pair = before[has, k], after[has, k]
        rows = (
            [np.sqrt(np.mean(x**2)) for x in pair],
            [np.median(x) for x in pair],
            [np.max(x) for x in pair],
        )
        table.add_row(name, *(f"{a:.1e} -> {b:.1e}" for a, b in rows))
    ratio = np.array([c.estimate / max(c.true, FLOOR) for c in cases])
    console = Console(width=110)
    console.print(table)
    console.print(
        f"stated error: above the true one in {np.sum(ratio >= 1)}, median "
        f"{np.median(ratio):.1f} times, within ten times in {np.sum(ratio <= 10)}"
    )
    for case, factor in zip(cases, ratio, strict=True):
        if not 1 <= factor <= 10:
            console.print(f"stated / true {factor:.2g}, true {case.true:.1e}: {case.label}")


if __name__ == "__main__":
    main()
