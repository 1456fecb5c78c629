"""Does anything break the solver silently? Extreme scenes, every outcome named.

    python -m benchmarks.stress

Every converged state is checked apart from the solver that found it: its force balance is
assembled anew in double precision. No number may be NaN, and a scene that can't be solved
must say so by name. Writes the table of docs/stability.md.
"""

import dataclasses
import functools
import math
from collections.abc import Iterator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from rich.progress import track

from benchmarks.pages import write_section
from suas_jax import configure
from suas_jax.config import SceneSpec, continuous_inputs, scene_from_dict
from suas_jax.equilibrium.continuation import LoadStepping
from suas_jax.equilibrium.equilibrium import State, equilibrium, residual
from suas_jax.equilibrium.outcomes import NAMES
from suas_jax.mechanics.base import largest
from suas_jax.mechanics.model import AbstractPlan
from suas_jax.numerics.bordered_solve import BorderedVector
from suas_jax.runtime.compiled import OPTIONS
from suas_jax.scene.build import Structure, build_problem, plan_for, problem_of
from suas_jax.scene.observables import observe
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.report import plain

EPDM = {"law": "mooney-rivlin", "C1": "20.7 MPa", "C2": "-4.4 MPa", "C3": "77 kPa"}
FORCE_AT_10_KPA = 24.4  # N, the paper's case A
# Largest force imbalance of a converged state relative to the forces in it, by precision.
BALANCED = {"float64": 1e-7, "float32": 2e-3}


@dataclasses.dataclass(frozen=True)
class Trial:
    """One scene on one mesh."""

    group: str  # what is stressed
    label: str  # how much
    scene: SceneSpec  # the scene
    # elements along the arc and through the thickness (none for the shell)
    mesh: tuple[int, int] = (32, 0)
    precision: str = "float64"  # of the arithmetic
    expected: tuple[str, ...] = ("converged",)  # outcomes that are right
    # settings of the load stepping that differ from the default
    stepping: dict[str, float] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What became of a trial."""

    trial: Trial  # the trial
    status: str  # name of the result
    level: float  # share of the load carried
    iterations: int  # Newton corrections
    smallest_pivot: float  # relative
    imbalance: float  # force residual relative to the load, assembled anew
    report: dict[str, Any]  # what was observed

    @property
    def explanation(self) -> str:
        """Why it failed, or what limits a converged state."""
        reasons = []
        if self.report["wall_contact"]:
            reasons.append("wall contact")
        if not self.report["material_stable"]:
            reasons.append("material out of its window")
        if self.status == "limit_point":
            reasons.append("the arch collapses")
        return ", ".join(reasons)

    @property
    def faults(self) -> list[str]:
        """What is wrong with it; empty if all is well."""
        found = []
        if not all(math.isfinite(x) for x in numbers(self.report)):
            found.append("not finite")
        if self.status == "converged":
            if not self.imbalance < BALANCED[self.trial.precision]:
                found.append(f"imbalance {self.imbalance:.0e}")
            if "converged" not in self.trial.expected:
                found.append("a limit point was expected")
        elif self.status not in self.trial.expected and not self.explanation:
            found.append("unexpected failure")
        return found


def numbers(tree: Any) -> Iterator[float]:
    """Leaves of a report."""
    if isinstance(tree, dict):
        tree = list(tree.values())
    if isinstance(tree, list):
        for branch in tree:
            yield from numbers(branch)
    elif not isinstance(tree, str):
        yield float(tree)


def skin(
    *loads: tuple[float, float],
    material: dict[str, Any] = EPDM,
    oil: str = "incompressible",
    **geometry: float,
) -> SceneSpec:
    """The paper's skin, changed; loads are (angle in degrees, force in newtons)."""
    sizes = {"inner_radius": 0.0575, "thickness": 0.0015, "width": 0.123, "oil_gap": 0.005}
    units = {name: f"{value!r} m" for name, value in (sizes | geometry).items()}
    return scene_from_dict(
        {
            "geometry": {"half_angle": "90 deg"} | units,
            "material": material,
            "oil": {"model": oil},
            "load": [
                {"kind": "line", "angle": f"{a} deg", "force": f"{f!r} N"} for a, f in loads
            ],
        }
    )


def trials() -> list[Trial]:
    """All that is tried."""
    found = []
    for millimetres in (0.02, 0.1, 0.5, 1.5, 5.0, 10.0):
        relative = millimetres / 1.5
        scene = skin((30, 20 * relative), thickness=1e-3 * millimetres)
        found.append(Trial("thickness", f"{millimetres} mm", scene))
        # Elements three hundred times as long as high: the way may be lost, by name.
        slender = ("converged", "no_convergence") if millimetres < 0.1 else ("converged",)
        label = f"{millimetres} mm, solid"
        found.append(Trial("thickness", label, scene, (64, 2), expected=slender))
    found += [
        Trial("aspect ratio", f"1:{n}", skin((30, 10.0)), (round(180.6 / 1.5 / n * 2), 2))
        for n in (10, 50, 120)
    ]
    thin = skin((30, 0.5), thickness=1e-4)
    found.append(Trial("aspect ratio", "1:200", thin, (9, 1)))
    for factor in (1e-6 / FORCE_AT_10_KPA, 1e-3, 1, 5, 15, 50):
        for sign in (1, -1):
            force = sign * factor * FORCE_AT_10_KPA
            found.append(Trial("force", f"{force:.3g} N", skin((10, force))))
    for distance in (5.0, 1.0, 0.1):
        at_clamp = skin((90 - distance, 20.0))
        found.append(Trial("next to the clamp", f"{distance} deg", at_clamp))
        found.append(Trial("next to the clamp", f"{distance} deg, solid", at_clamp, (64, 2)))
    found.append(Trial("opposing", "20 N in, 20 N out", skin((-30, 20.0), (30, -20.0))))
    found.append(Trial("opposing", "1 deg apart", skin((-0.5, 20.0), (0.5, -19.0))))
    for name, law in {
        "1 GPa": {"law": "neo-hookean", "mu": "1 GPa"},
        "10 Pa": {"law": "neo-hookean", "mu": "10 Pa"},
        "nearly unstable": {"law": "yeoh", "C1": "1 MPa", "C2": "-0.9 MPa", "C3": "1 MPa"},
        "locking": {"law": "gent", "mu": "3 MPa", "Jm": 0.1},
    }.items():
        found.append(
            Trial("law", name, skin((20, 24.4 if "GPa" in name else 1e-3), material=law))
        )
    for name, size in {"micrometres": 1e-6, "kilometres": 1e6}.items():
        scaled = {"inner_radius": 0.0575, "thickness": 0.0015, "width": 0.123, "oil_gap": 0.005}
        scaled = {key: value * size for key, value in scaled.items()}
        found.append(Trial("units", name, skin((20, 20 * size**2), **scaled)))
    # Corrections can't shrink to the default 1e-12 in single precision: that must be said.
    for mesh in ((16, 0), (32, 1)):
        model = "solid" if mesh[1] else "shell"
        single = Trial("float32", model, skin((20, 20.0)), mesh, precision="float32")
        found.append(dataclasses.replace(single, expected=("no_convergence",)))
        either = ("converged", "no_convergence")
        label, loose = f"{model}, corrections to 1e-3", {"rtol": 1e-3}
        found.append(dataclasses.replace(single, label=label, stepping=loose, expected=either))
    coarse = skin((0, 1.0))
    found.append(Trial("single element", "shell", skin(), (1, 0)))
    found += [
        Trial("two elements", "shell", coarse, (2, 0)),
        Trial("two elements", "solid", coarse, (2, 1)),
    ]
    for radius in (10.0, 1e3, 1e6):
        label = f"first step of {radius:g} thicknesses"
        found.append(
            Trial("load step", label, skin((45, 20.7)), stepping={"first_radius": radius})
        )
    collapse = {"expected": ("limit_point",)}
    for force in (20.0, 200.0):
        vented = skin((0, force), oil="vented")
        found.append(Trial("vented collapse", f"{force} N", vented, **collapse))
    found.append(
        Trial(
            "vented collapse", "20 N, solid", skin((0, 20.0), oil="vented"), (64, 2), **collapse
        )
    )
    return found


# The programs run once: the compiler's own optimisation would take longer than they do.
_compiled = functools.partial(
    eqx.filter_jit, compiler_options={**OPTIONS, "xla_backend_optimization_level": 0}
)


@_compiled
def _program(
    structure: Structure, plan: AbstractPlan, inputs: dict[str, Array], stepping: LoadStepping
) -> tuple[dict[str, Any], State]:
    parts = scene_parts(structure.scene, inputs)
    problem = problem_of(parts, plan)
    found = equilibrium(problem, stepping=stepping)
    outcome = {
        "result": found.result,
        "level": found.level,
        "iterations": found.iterations,
        "smallest_pivot": found.smallest_pivot,
        "report": observe(parts, problem, found.state),
    }
    return outcome, found.state


@_compiled
def _imbalance(
    structure: Structure,
    plan: AbstractPlan,
    inputs: dict[str, Array],
    state: State,
    level: Array,
) -> Array:
    """Force residual relative to the largest nodal force of load and pressure."""
    problem = build_problem(structure.scene, plan, inputs)
    border = state.pressure if problem.oil.trapped else None
    force, _ = residual(problem, BorderedVector(state.q, border), level)
    parts = problem.mechanics.assemble(state.q, state.pressure, level)
    scale = largest(parts.load) + largest(state.pressure * parts.volume_gradient)
    return largest(force.stations) / jnp.maximum(scale, 1e-300)


def attempt(trial: Trial) -> Outcome:
    """Solve a trial and check what comes out, in double precision."""
    layers = trial.mesh[1]
    counts = trial.mesh if layers else trial.mesh[:1]
    plan = plan_for(trial.scene, "solid" if layers else "shell", counts)
    structure = Structure(trial.scene)
    values = continuous_inputs(trial.scene)
    with jax.enable_x64(trial.precision == "float64"):
        inputs = {k: jnp.asarray(v, float) for k, v in values.items()}
        arguments = (structure, plan, inputs, LoadStepping(**trial.stepping))
        solved, state = _program(*arguments)
    with jax.enable_x64(True):
        inputs = {k: jnp.asarray(v, float) for k, v in values.items()}
        state = jax.tree.map(lambda x: jnp.asarray(np.asarray(x), float), state)
        level = jnp.asarray(np.asarray(solved["level"]), float)
        arguments = (structure, plan, inputs, state, level)
        off = float(_imbalance(*arguments)[0])
    one = plain(solved)
    return Outcome(
        trial,
        NAMES[one["result"]],
        one["level"],
        one["iterations"],
        one["smallest_pivot"],
        off,
        one["report"],
    )


def table_of(outcomes: list[Outcome]) -> list[str]:
    """Markdown, one line a trial."""
    columns = ("stress", "how much", "outcome", "load", "corrections", "smallest pivot")
    columns += ("imbalance", "remark")
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    for o in outcomes:
        cells = (
            o.trial.group,
            o.trial.label,
            o.status,
            f"{o.level:.3g}",
            str(o.iterations),
            f"{o.smallest_pivot:.0e}",
            f"{o.imbalance:.0e}",
            "; ".join(f"**{fault}**" for fault in o.faults) or o.explanation,
        )
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def summary_of(outcomes: list[Outcome]) -> list[str]:
    """Markdown, one line for the trials of a stress that end alike."""
    alike: dict[tuple[str, str, str], list[Outcome]] = {}
    for o in outcomes:
        remark = "; ".join(f"**{fault}**" for fault in o.faults) or o.explanation
        alike.setdefault((o.trial.group, o.status, remark), []).append(o)
    columns = ("stress", "how much", "trials", "outcome", "least load", "most corrections")
    columns += ("smallest pivot", "largest imbalance", "remark")
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    for (group, status, remark), found in alike.items():
        labels = list(dict.fromkeys([found[0].trial.label, found[-1].trial.label]))
        cells = (group, " ... ".join(labels), str(len(found)), status)
        cells += (
            f"{min(o.level for o in found):.3g}",
            str(max(o.iterations for o in found)),
            f"{min(o.smallest_pivot for o in found):.0e}",
            f"{max(o.imbalance for o in found):.0e}",
            remark,
        )
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def main() -> None:
    """Print the table and write its summary; exit status 1 if a trial has a fault."""
    configure()
    outcomes = [attempt(trial) for trial in track(trials(), "solving")]
    print("\n".join(table_of(outcomes)))
    write_section("stability.md", "table", summary_of(outcomes))
    raise SystemExit(any(o.faults for o in outcomes))


if __name__ == "__main__":
    main()
