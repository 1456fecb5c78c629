"""Is the stated error honest? Random scenes against a much finer solid.

    python -m benchmarks.error_estimate [SCENES] [--seed N]

Thickness 0.3-5 mm, radius 30-100 mm, half angle 45-90 degrees, one or two loads of which
some are spread, forces from 1 % to 150 % of what gives the paper's pressure, three oils,
four laws. Each scene is solved with ``model = "auto"`` at two tolerances; scenes that touch
the wall or have no equilibrium are drawn again. The table gives, for each tolerance, how
often the true error of pressure and mid-surface displacement is below the estimate, and
how often the estimate is within ten times the true error.
"""

import argparse
import dataclasses
import functools
import sys
from collections import Counter
from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from rich.console import Console
from rich.table import Table

from suas_jax import configure
from suas_jax.config import SceneSpec, continuous_inputs, scene_from_dict, with_solve
from suas_jax.equilibrium.equilibrium import equilibrium
from suas_jax.mechanics.model import AbstractPlan
from suas_jax.runtime.compiled import OPTIONS
from suas_jax.scene.build import plan_for, problem_of
from suas_jax.scene.observables import load_observables
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.report import plain
from suas_jax.scene.solve import solve
from suas_jax.scene.structure import Inputs, Structure

EPDM = {"law": "mooney-rivlin", "C1": "20.7 MPa", "C2": "-4.4 MPa", "C3": "77 kPa"}
Found = TypeVar("Found")
RUBBER = {
    "law": "ogden",
    "mu": ["0.63 MPa", "1.2 kPa", "-10 kPa"],
    "alpha": [1.3, 5.0, -2.0],
    "convention": "mu/alpha",
}
TRAPPED: dict[str, Any] = {"model": "incompressible"}
# Law, shear modulus [Pa], oil, and for each load whether it is spread.
Pattern = tuple[dict[str, Any], float, dict[str, Any], tuple[bool, ...]]
YEOH = {"law": "yeoh", "C1": "0.6 MPa", "C2": "-10 kPa", "C3": "1 kPa"}
POINTS: tuple[Pattern, ...] = (
    (EPDM, 32.6e6, TRAPPED, (False,)),
    (RUBBER, 4.225e5, TRAPPED, (False, False)),
    (EPDM, 32.6e6, {"model": "vented"}, (False,)),
    ({"law": "neo-hookean", "mu": "3 MPa"}, 3e6, TRAPPED, (False, False)),
)
COMPRESSIBLE = {"model": "compressible", "bulk_modulus": "1.5 GPa"}
# A mesh under a spread load is a program of its own, hence fewer of them.
PATTERNS: tuple[Pattern, ...] = (
    *POINTS,
    (YEOH, 1.2e6, COMPRESSIBLE, (False,)),
    *POINTS,
    (YEOH, 1.2e6, COMPRESSIBLE, (True,)),
)
TOLERANCES = (1e-2, 1e-3)
TRUTH = (512, 6)
# Truths and true errors below this are not told apart.
FLOOR = 2e-6


@dataclasses.dataclass(frozen=True)
class Case:
    """One scene at one tolerance.

    Attributes:
        rtol: wanted.
        model: chosen.
        estimate: stated error.
        by_mesh: its part by the mesh.
        true: its error against the fine solid.
        met: whether the solver claims to meet rtol.
        label: what the scene is.
    """

    rtol: float
    model: str
    estimate: float
    by_mesh: float
    true: float
    met: bool
    label: str

    @property
    def covered(self) -> bool:
        """Whether the true error is below the estimate."""
        return self.true <= max(self.estimate, FLOOR)

    @property
    def sharp(self) -> bool:
        """Whether the estimate is within ten times the true error."""
        return self.estimate <= 10 * max(self.true, FLOOR)


def sample(rng: np.random.Generator, pattern: int) -> SceneSpec:
    """A random scene of a pattern."""
    law, modulus, oil, spread = PATTERNS[pattern]
    thickness = float(np.exp(rng.uniform(np.log(3e-4), np.log(5e-3))))
    radius = 0.0575 if rng.random() < 0.5 else float(rng.uniform(0.03, 0.1))
    half = 90.0 if rng.random() < 0.6 else float(rng.uniform(45, 90))
    angles = rng.uniform(-0.85 * half, 0.85 * half, len(spread))
    while np.min(np.diff(np.sort(angles)), initial=np.inf) < 8:
        angles = rng.uniform(-0.85 * half, 0.85 * half, len(spread))
    relative = thickness / 1.5e-3
    strong = 6 * relative**3 if oil["model"] == "vented" else 24.4 * relative
    loads = []
    for angle, arc in zip(angles, spread, strict=True):
        share = np.exp(rng.uniform(np.log(0.01), np.log(1.5))) / len(spread)
        force = modulus / 32.6e6 * strong * share
        load = {"kind": "line", "angle": f"{float(angle)} deg", "force": f"{float(force)} N"}
        loads.append(load | ({"spread": f"{rng.uniform(1, 10)} mm"} if arc else {}))
    geometry = {
        "inner_radius": f"{radius} m",
        "thickness": f"{thickness} m",
        "half_angle": f"{half} deg",
        "width": "123 mm",
        "oil_gap": "5 mm",
    }
    return scene_from_dict({"geometry": geometry, "material": law, "oil": oil, "load": loads})


@functools.partial(eqx.filter_jit, compiler_options=OPTIONS)
def _fine(
    structure: Structure, plan: AbstractPlan, inputs: Inputs
) -> tuple[Array, dict[str, Any]]:
    parts = scene_parts(structure.scene, inputs)
    problem = problem_of(parts, plan)
    found = equilibrium(problem)
    loads = load_observables(parts, problem, found.state)
    return found.result, {"oil_pressure_Pa": found.state.pressure, "loads": loads}


def truth_of(scene: SceneSpec) -> dict[str, Any] | None:
    """Pressure and displacements on the fine mesh; None if there is no equilibrium."""
    inputs = {k: jnp.asarray(v, float) for k, v in continuous_inputs(scene).items()}
    result, report = _fine(Structure(scene), plan_for(scene, "solid", TRUTH), inputs)
    return plain(report) if int(result[0]) == 0 else None


def true_error(report: dict[str, Any], truth: dict[str, Any]) -> float:
    """Relative error of the pressure and of the displacements, the largest of them one."""
    size = max(abs(load["displacement_m"]) for load in truth["loads"])
    errors = [
        abs(load["displacement_m"] - true["displacement_m"]) / size
        for load, true in zip(report["loads"], truth["loads"], strict=True)
    ]
    if truth["oil_pressure_Pa"] != 0:
        errors.append(abs(report["oil_pressure_Pa"] / truth["oil_pressure_Pa"] - 1))
    return max(errors)


def cases_of(scene: SceneSpec) -> list[Case]:
    """The scene at every tolerance; none if it has no valid equilibrium."""
    found = []
    for rtol in TOLERANCES:
        report = solve(with_solve(scene, model="auto", rtol=rtol)).report
        if report["status"] != "converged" or report["wall_contact"]:
            return []
        found.append((rtol, report))
    truth = truth_of(scene)
    if truth is None:
        return []
    law, oil = scene.material.law, scene.oil.model
    angles = ", ".join(f"{np.rad2deg(load.angle):.0f}" for load in scene.loads)
    label = f"{law}, {oil}, {1e3 * scene.geometry.thickness:.2f} mm, loads at {angles} deg"
    return [
        Case(
            rtol,
            report["model"],
            report["error_estimate"],
            report["discretisation_error"],
            true_error(report, truth),
            report["rtol_met"],
            label,
        )
        for rtol, report in found
    ]


def studied(
    count: int, seed: int, case_of: Callable[[np.random.Generator, int], Found | None]
) -> list[Found]:
    """What is found of random scenes, each drawn again until it has a valid equilibrium.

    Args:
        count: number of scenes.
        seed: of the generator.
        case_of: draws the scene of a number; None or nothing for one without equilibrium.
    """
    rng = np.random.default_rng(seed)
    cases: list[Found] = []
    for i in range(count):
        found = None
        while not found:
            found = case_of(rng, i)
        cases.append(found)
        print(i, found, file=sys.stderr, flush=True)
    return cases


def study(count: int, seed: int) -> list[Case]:
    """Random scenes, pattern by pattern."""
    found = studied(count, seed, lambda rng, i: cases_of(sample(rng, i % len(PATTERNS))))
    return [case for cases in found for case in cases]


def main() -> None:
    """Print how often the estimate holds, and where it does not."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="?", type=int, default=100)
    parser.add_argument("--seed", type=int, default=7)
    arguments = parser.parse_args()
    configure()
    cases = study(arguments.scenes, arguments.seed)
    columns = ("rtol", "shell", "solid", "claimed met", "truly met", "true < estimate")
    table = Table(*columns, "within 10x", "median ratio", title=f"{arguments.scenes} scenes")
    for rtol in TOLERANCES:
        group = [c for c in cases if c.rtol == rtol]
        models = Counter(c.model for c in group)
        met = [c for c in group if c.met]
        table.add_row(
            f"{rtol:.0e}",
            str(models["shell"]),
            str(models["solid"]),
            str(len(met)),
            str(sum(c.true <= rtol for c in met)),
            str(sum(c.covered for c in group)),
            str(sum(c.sharp for c in group)),
            f"{np.median([c.estimate / max(c.true, FLOOR) for c in group]):.1f}",
        )
    console = Console(width=120)
    console.print(table)
    for c in cases:
        if not (c.covered and c.sharp):
            console.print(
                f"rtol {c.rtol:.0e} {c.model}: {c.estimate:.1e} for {c.true:.1e} ({c.label})"
            )


if __name__ == "__main__":
    main()
