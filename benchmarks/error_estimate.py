"""Is the stated error honest? Random scenes against a much finer solid.

    python -m benchmarks.error_estimate [SCENES] [--seed N]

Thickness 0.4-4 mm, radius 30-100 mm, half angle 45-90 degrees; line loads, spread loads and
pressures, inwards, outwards and turned, from 1 % to 150 % of what gives the paper's pressure;
oil that is trapped, compressible or vented; four laws. Each scene is solved with ``model =
"auto"`` at three tolerances; scenes that touch the wall or have no equilibrium are drawn again.
The table gives, for each tolerance, how often the true error of pressure and mid-surface
displacement is below the estimate, how often the estimate is within ten times the true error,
and estimate over true error: the median, and the range of 98 scenes in 100.
"""

import argparse
import dataclasses
import functools
import sys
from collections import Counter
from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from rich.console import Console
from rich.table import Table
from scipy.optimize import brentq

from benchmarks.random_scenes import EPDM, LAWS, OILS
from suas_jax import configure
from suas_jax.config import SceneSpec, scene_from_dict, with_solve
from suas_jax.equilibrium.balance import State
from suas_jax.equilibrium.equilibrium import equilibrium
from suas_jax.mechanics.model import AbstractPlan
from suas_jax.runtime.compiled import COMPILED, OPTIONS
from suas_jax.scene.build import Inputs, Structure, plan_for, problem_of
from suas_jax.scene.error_estimate import key_quantities
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.program import inputs_of
from suas_jax.scene.solve import solve

Found = TypeVar("Found")
NEO_HOOKEAN, YEOH, RUBBER = (LAWS[name] for name in ("neo-hookean", "yeoh", "ogden"))
TRAPPED, VENTED = OILS["incompressible"], OILS["vented"]
COMPRESSIBLE = {"model": "compressible", "bulk_modulus": "2 MPa"}
# Law, shear modulus [Pa], oil, and what acts: lines, spread loads, pressures.
PATTERNS: tuple[tuple[dict[str, Any], float, dict[str, Any], str], ...] = (
    (EPDM, 32.6e6, TRAPPED, "l"),
    (NEO_HOOKEAN, 3e6, TRAPPED, "ll"),
    (EPDM, 32.6e6, VENTED, "l"),
    (YEOH, 1.2e6, COMPRESSIBLE, "lp"),
    (RUBBER, 4.225e5, TRAPPED, "l"),
    (NEO_HOOKEAN, 3e6, VENTED, "p"),
    (EPDM, 32.6e6, TRAPPED, "s"),
)
TAXELS = [f"{angle} deg" for angle in range(-40, 41, 10)]
TOLERANCES = (1e-2, 1e-3, 1e-4)
# The truth is extrapolated from meshes of even elements ever smaller by the same factors; at
# the corners of clamps none that can be solved is fine enough by itself.
TRUTHS = ((256, 4), (384, 6), (512, 8))
# Truths and true errors below this are not told apart.
FLOOR = 2e-6
_STEPS = (1.5, 2.0)  # by which the finer truths' elements are smaller
_ORDERS = (0.8, 4.0)


@dataclasses.dataclass(frozen=True)
class Case:
    """One scene at one tolerance."""

    rtol: float  # wanted
    model: str  # chosen
    estimate: float  # stated error
    by_mesh: float  # its part by the mesh
    true: float  # its error against the fine solid
    met: bool  # whether the solver claims to meet rtol
    label: str  # what the scene is

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
    law, modulus, oil, kinds = PATTERNS[pattern]
    thickness = float(np.exp(rng.uniform(np.log(4e-4), np.log(4e-3))))
    radius = 0.0575 if rng.random() < 0.5 else float(rng.uniform(0.03, 0.1))
    half = 90.0 if rng.random() < 0.6 else float(rng.uniform(45, 90))
    count = sum(kind != "p" for kind in kinds)
    angles = rng.uniform(-0.85 * half, 0.85 * half, count)
    while np.min(np.diff(np.sort(angles)), initial=np.inf) < 10:
        angles = rng.uniform(-0.85 * half, 0.85 * half, count)
    relative = thickness / 1.5e-3
    strong = 6 * relative**3 if oil is VENTED else 24.4 * relative
    loads: list[dict[str, str]] = []
    places = iter(angles)
    for kind in kinds:
        share = np.exp(rng.uniform(np.log(0.01), np.log(1.5))) / max(count, 1)
        sign = -1.0 if rng.random() < 0.25 else 1.0
        if kind == "p":
            pressure = 1e4 * relative * modulus / 32.6e6
            if oil is VENTED:  # inwards the arch buckles, outwards it stretches
                bending = modulus * thickness**3 / radius**3
                pressure = 0.7 * bending if sign > 0 else 0.05 * modulus * thickness / radius
            loads.append({"kind": "pressure", "pressure": f"{sign * share * pressure} Pa"})
            continue
        turn = 0.0 if rng.random() < 0.6 else float(rng.uniform(-60, 60))
        load = {
            "kind": "line",
            "angle": f"{float(next(places))} deg",
            "force": f"{float(sign * modulus / 32.6e6 * strong * share)} N",
            "direction": f"{turn} deg",
        }
        if kind == "s":
            load["spread"] = f"{float(np.exp(rng.uniform(np.log(0.5), np.log(10))))} mm"
        loads.append(load)
    geometry = {
        "inner_radius": f"{radius} m",
        "thickness": f"{thickness} m",
        "half_angle": f"{half} deg",
        "width": "123 mm",
        "oil_gap": "5 mm",
    }
    oil = oil | {"relative_permittivity": 2.2}
    tables = {"geometry": geometry, "material": law, "oil": oil, "load": loads}
    electrodes = {"taxels": [{"angle": angle} for angle in TAXELS]}
    return scene_from_dict({**tables, "electrodes": electrodes})


@functools.partial(eqx.filter_jit, compiler_options=OPTIONS)
def _values(
    structure: Structure, plan: AbstractPlan, inputs: Inputs, state: State | None
) -> tuple[Array, Array]:
    """Result and key quantities of a state; of the equilibrium on the plan if none is given."""
    parts = scene_parts(structure.scene, inputs)
    problem = problem_of(parts, plan)
    result = jnp.zeros(1, int)
    if state is None:
        found = equilibrium(problem)
        result, state = found.result, found.state
    return result, jnp.concatenate(key_quantities(problem.mechanics, state, parts.forces))


def truth_of(scene: SceneSpec) -> np.ndarray | None:
    """Key quantities of the continuum; None if there is no equilibrium."""
    inputs = inputs_of(scene)
    found = []
    for mesh in TRUTHS:
        result, values = _values(Structure(scene), plan_for(scene, "solid", mesh), inputs, None)
        if int(result[0]) != 0:
            return None
        found.append(np.asarray(values))
    return extrapolated(*found)


def extrapolated(coarse: np.ndarray, middle: np.ndarray, fine: np.ndarray) -> np.ndarray:
    """Limits of values on meshes whose elements are smaller by `_STEPS`, each at its own order.

    With errors c h^p, (fine - middle) / (middle - coarse) gives p, and the last error is
    (fine - middle) 2^-p / (1.5^-p - 2^-p). Values that don't change in one direction have
    converged.
    """
    limits = fine.copy()
    for k, (a, b, c) in enumerate(zip(coarse, middle, fine, strict=True)):
        if (b - a) * (c - b) <= 0:
            continue

        def excess(p: float, ratio: float = (b - a) / (c - b)) -> float:
            first, second = (step**-p for step in _STEPS)
            return (1 - first) / (first - second) - ratio

        low, high = _ORDERS
        if excess(low) * excess(high) < 0:
            order = brentq(excess, low, high)
        else:
            order = low if excess(low) > 0 else high
        first, second = (step**-order for step in _STEPS)
        limits[k] = c + (c - b) * second / (first - second)
    return limits


def true_error_of(values: np.ndarray, truth: np.ndarray) -> float:
    """Relative error of the pressure and of the displacements, the largest of them one."""
    errors = np.abs(values - truth)
    of_pressure = errors[0] / abs(truth[0]) if truth[0] != 0 else 0.0
    return float(max(of_pressure, errors[1:].max() / truth[-1]))


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
    truth: np.ndarray | None = None
    law, oil = scene.material.law, scene.oil.model
    loads = ", ".join(load.kind for load in scene.loads)
    label = f"{law}, {oil}, {1e3 * scene.geometry.mean_thickness:.2f} mm, {loads}"
    found = []
    for rtol in TOLERANCES:
        solution = solve(with_solve(scene, model="auto", rtol=rtol))
        report = solution.report
        if report["status"] != "converged" or report["wall_contact"]:
            return []
        truth = truth_of(scene) if truth is None else truth
        if truth is None:
            return []
        shown = solution.plan, inputs_of(scene), solution.shown
        _, values = _values(Structure(scene), *shown)
        true = true_error_of(np.asarray(values), truth)
        stated = report["error_estimate"], report["discretisation_error"]
        found.append(Case(rtol, report["model"], *stated, true, report["rtol_met"], label))
    return found


def studied(count: int, seed: int, case_of: Callable[[SceneSpec], Found | None]) -> list[Found]:
    """What is found of random scenes, each drawn again until it has a valid equilibrium.

    Scenes of a pattern share their programs, which are freed before the next pattern's: those
    of all together don't fit into the memory that compiled code may have.

    Args:
        count: number of scenes.
        seed: of the generator.
        case_of: of a scene; None or nothing for one without equilibrium.
    """
    rng = np.random.default_rng(seed)
    cases: list[Found] = []
    for pattern in range(len(PATTERNS)):
        for _ in range(pattern, count, len(PATTERNS)):
            found = None
            while not found:
                found = case_of(sample(rng, pattern))
            cases.append(found)
            print(len(cases), found, file=sys.stderr, flush=True)
        COMPILED.forget()
        jax.clear_caches()
    return cases


def study(count: int, seed: int) -> list[Case]:
    """Random scenes, pattern by pattern."""
    return [case for cases in studied(count, seed, cases_of) for case in cases]


def main() -> None:
    """Print how often the estimate holds, and where it does not."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="?", type=int, default=100)
    parser.add_argument("--seed", type=int, default=7)
    arguments = parser.parse_args()
    configure()
    cases = study(arguments.scenes, arguments.seed)
    columns = ("rtol", "shell", "solid", "claimed met", "truly met", "true < estimate")
    table = Table(
        *columns, "within 10x", "ratio", "1 to 99 %", title=f"{arguments.scenes} scenes"
    )
    for rtol in TOLERANCES:
        group = [c for c in cases if c.rtol == rtol]
        models = Counter(c.model for c in group)
        met = [c for c in group if c.met]
        ratios = [c.estimate / max(c.true, FLOOR) for c in group]
        table.add_row(
            f"{rtol:.0e}",
            str(models["shell"]),
            str(models["solid"]),
            str(len(met)),
            str(sum(c.true <= rtol for c in met)),
            str(sum(c.covered for c in group)),
            str(sum(c.sharp for c in group)),
            f"{np.median(ratios):.1f}",
            "{:.1f} to {:.1f}".format(*np.percentile(ratios, [1, 99])),
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
