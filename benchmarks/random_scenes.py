"""Random scenes: does every one converge or fail by name?

Thickness 0.1-5 mm, one or two loads within 80 degrees, 0 to 10 times the force of the
paper's case A at 10 kPa, every law, every oil. A scene that fails must have left the model's
validity before (wall contact, an unstable material) or have a limit point, as a vented arch
does. Run: ``python -m benchmarks.random_scenes [COUNT]``, or with ``--sections`` behind it for
ellipses, flat tops and splines of any size instead of the paper's circle.
"""

import dataclasses
import sys
from collections import Counter
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from rich.console import Console
from rich.table import Table

from suas_jax import configure
from suas_jax.config import (
    ConfigError,
    SceneSpec,
    continuous_inputs,
    scene_from_dict,
    with_inputs,
)
from suas_jax.equilibrium.balance import residual
from suas_jax.equilibrium.equilibrium import equilibrium
from suas_jax.equilibrium.outcomes import NAMES
from suas_jax.mechanics.base import largest
from suas_jax.mechanics.model import AbstractPlan
from suas_jax.numerics.bordered_solve import BorderedVector
from suas_jax.scene.build import Structure, plan_for, problem_of
from suas_jax.scene.observables import observe
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.report import plain
from suas_jax.skin.plain import plain_geometry

ELEMENTS = 32
FORCE_AT_10_KPA = 24.4  # N, the paper's case A
EPDM = {"law": "mooney-rivlin", "C1": "20.7 MPa", "C2": "-4.4 MPa", "C3": "77 kPa"}
LAWS: dict[str, dict[str, Any]] = {
    "mooney-rivlin": EPDM,
    "neo-hookean": {"law": "neo-hookean", "mu": "3 MPa"},
    "yeoh": {"law": "yeoh", "C1": "0.6 MPa", "C2": "-10 kPa", "C3": "1 kPa"},
    "ogden": {
        "law": "ogden",
        "mu": ["0.63 MPa", "1.2 kPa", "-10 kPa"],
        "alpha": [1.3, 5.0, -2.0],
        "convention": "mu/alpha",
    },
}
OILS: dict[str, dict[str, Any]] = {
    "incompressible": {"model": "incompressible"},
    "compressible": {"model": "compressible", "bulk_modulus": "1.5 GPa"},
    "vented": {"model": "vented"},
}


# Other sections: their tables, whose numbers are drawn anew for each scene.
_CORNER = {"radius": "30 mm", "angle": "90 deg"}
SECTIONS: dict[str, dict[str, Any]] = {
    "circle": {"inner_radius": "57.5 mm", "half_angle": "90 deg"},
    "ellipse": {
        "section": "ellipse",
        "inner_semi_axes": ["57.5 mm", "40 mm"],
        "half_angle": "90 deg",
    },
    "path": {
        "section": "path",
        "path": [{"line": "20 mm"}, _CORNER, {"line": "27.5 mm"}],
        "mirror": True,
    },
    "spline": {"section": "spline", "points": [[f"{x} mm", "0 mm"] for x in range(-4, 5)]},
}


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What became of one scene."""

    section: str  # of the skin
    law: str  # of the membrane
    oil: str  # model of the oil
    inputs: dict[str, float]  # continuous inputs, SI
    result: str  # name of the result
    level: float  # share of the load that the last equilibrium carries
    iterations: int  # Newton corrections
    report: dict[str, Any]  # observables of the last equilibrium
    imbalance: float  # its force residual relative to the load

    @property
    def valid(self) -> bool:
        """Whether the last equilibrium is within the model's validity."""
        return not self.report["wall_contact"] and bool(self.report["material_stable"])

    @property
    def label(self) -> str:
        """Result for the table; a failure out of validity says what came first."""
        if self.result == "converged" or self.valid:
            return self.result
        cause = "wall_contact" if self.report["wall_contact"] else "material_unstable"
        return f"{self.result} after {cause}"


def pattern(law: str, oil: str, loads: int, section: str = "circle") -> SceneSpec:
    """A scene of the wanted structure around the paper's skin, or another section."""
    angles = (20.0, -35.0)[:loads]
    tables = {
        "geometry": {
            **SECTIONS[section],
            "thickness": "1.5 mm",
            "width": "123 mm",
            "oil_gap": "5 mm",
        },
        "material": LAWS[law],
        "oil": OILS[oil],
        "load": [
            {"kind": "line", "force": "10 N"}
            | ({"angle": f"{a} deg"} if section == "circle" else {"arc": f"{a / 10} mm"})
            for a in angles
        ],
        "solve": {"model": "shell"},
    }
    return scene_from_dict(tables)


def sample(rng: np.random.Generator, scene: SceneSpec) -> SceneSpec:
    """The pattern with random thickness, angles and forces."""
    angles = rng.uniform(-80, 80, len(scene.loads))
    while np.min(np.diff(np.sort(angles)), initial=np.inf) < 3.0:
        angles = rng.uniform(-80, 80, len(scene.loads))
    drawn = {"geometry.thickness": float(np.exp(rng.uniform(np.log(1e-4), np.log(5e-3))))}
    for i, angle in enumerate(angles):
        drawn[f"load.{i}.angle"] = float(np.deg2rad(angle))
        drawn[f"load.{i}.force"] = float(rng.uniform(0, 10 * FORCE_AT_10_KPA))
    return with_inputs(scene, drawn)


def sample_section(rng: np.random.Generator, scene: SceneSpec) -> SceneSpec:
    """The pattern with another shape, thickness, places and forces.

    Shapes that can't be are drawn again.
    """
    while True:
        drawn = _shape(rng, scene.geometry.section)
        drawn["geometry.thickness"] = float(np.exp(rng.uniform(np.log(5e-4), np.log(3e-3))))
        drawn["geometry.oil_gap"] = float(rng.uniform(2e-3, 8e-3))
        arcs = rng.uniform(-0.03, 0.03, len(scene.loads))
        for i, arc in enumerate(arcs):
            drawn[f"load.{i}.arc"] = float(arc)
            drawn[f"load.{i}.force"] = float(rng.uniform(0, 3 * FORCE_AT_10_KPA))
        if np.min(np.diff(np.sort(arcs)), initial=np.inf) < 3e-3:
            continue
        try:
            found = with_inputs(scene, drawn)
            plain_geometry(found.geometry)
        except (ConfigError, ValueError):
            continue
        return found


def _shape(rng: np.random.Generator, section: str) -> dict[str, float]:
    """Numbers of the inner face."""
    wide, high = rng.uniform(0.04, 0.07), rng.uniform(0.03, 0.07)
    if section == "ellipse":
        names = "inner_semi_axes.0", "inner_semi_axes.1", "half_angle"
        values = [wide, high, rng.uniform(1.0, 1.8)]
    elif section == "path":
        names = "path.0.line", "path.1.radius", "path.2.line"
        values = [*rng.uniform([0.005, 0.015, 0.01], [0.03, 0.045, 0.03])]
    else:
        turn = np.linspace(-np.pi / 2, np.pi / 2, 9)
        bump = 1 + rng.uniform(-0.03, 0.03, 9)
        x, y = wide * bump * np.sin(turn), high * bump * np.cos(turn)
        names = [f"points.{k}.{i}" for k in range(9) for i in (0, 1)]
        values = [*np.stack([x, y], 1).reshape(-1)]
    return {f"geometry.{k}": float(v) for k, v in zip(names, values, strict=True)}


@eqx.filter_jit
def _solve(
    structure: Structure, plans: AbstractPlan, inputs: dict[str, Array]
) -> dict[str, Any]:
    scene = structure.scene

    def one(plan: AbstractPlan, inputs: dict[str, Array]) -> dict[str, Any]:
        parts = scene_parts(scene, inputs)
        problem = problem_of(parts, plan)
        found = equilibrium(problem)
        border = found.state.pressure if problem.oil.trapped else None
        y = BorderedVector(found.state.q, border)
        force, _ = residual(problem, y, found.level)
        load = problem.mechanics.assemble(found.state.q, 0 * found.level, found.level).load
        outcome = {
            "result": found.result,
            "level": found.level,
            "iterations": found.iterations,
            "imbalance": largest(force.stations) / largest(load),
            "report": observe(parts, problem, found.state),
        }
        return jax.tree.map(lambda x: x[0], outcome)

    return jax.vmap(one)(plans, inputs)


ALL_PATTERNS = tuple((law, oil, n) for law in LAWS for oil in OILS for n in (1, 2))
SHAPED_PATTERNS = tuple(
    (law, "incompressible", 1, section)
    for section in SECTIONS
    if section != "circle"
    for law in LAWS
)


def draw(
    rng: np.random.Generator, structure: SceneSpec, count: int
) -> tuple[AbstractPlan, list[dict[str, float]], dict[str, Array]]:
    """Random scenes of one structure: meshes stacked, inputs one by one and stacked."""
    one = sample if structure.geometry.section == "circle" else sample_section
    scenes = [one(rng, structure) for _ in range(count)]
    plans = [plan_for(scene, "shell", (ELEMENTS,)) for scene in scenes]
    stacked = jax.tree.map(lambda *x: np.stack(x), *plans)
    inputs = [continuous_inputs(scene) for scene in scenes]
    lanes = {key: jnp.array([values[key] for values in inputs]) for key in inputs[0]}
    return stacked, inputs, lanes


def study(
    count: int, seed: int = 0, patterns: Sequence[tuple[Any, ...]] = ALL_PATTERNS
) -> list[Outcome]:
    """Solve `count` random scenes of each pattern: law, oil, number of loads, section."""
    rng = np.random.default_rng(seed)
    outcomes = []
    for law, oil, *rest in patterns:
        structure = pattern(law, oil, *rest)
        plans, inputs, lanes = draw(rng, structure, count)
        solved = _solve(Structure(structure), plans, lanes)
        for i, values in enumerate(inputs):
            one = plain(solved, i)
            result = NAMES[one.pop("result")]
            section = structure.geometry.section
            outcomes.append(Outcome(section, law, oil, values, result, **one))
    return outcomes


def main() -> None:
    """Print a table of outcomes."""
    configure()
    numbers = [text for text in sys.argv[1:] if text != "--sections"]
    total = int(numbers[0]) if numbers else 500
    patterns = SHAPED_PATTERNS if "--sections" in sys.argv else ALL_PATTERNS
    outcomes = study(-(-total // len(patterns)), patterns=patterns)
    labels = sorted({outcome.label for outcome in outcomes})
    table = Table(
        "section", "law", "oil", *labels, "most corrections", title=f"{len(outcomes)} scenes"
    )
    for kind in dict.fromkeys((o.section, o.law, o.oil) for o in outcomes):
        group = [o for o in outcomes if (o.section, o.law, o.oil) == kind]
        counts = Counter(o.label for o in group)
        most = max(o.iterations for o in group)
        table.add_row(*kind, *(str(counts[label]) for label in labels), str(most))
    console = Console()
    console.print(table)
    worst = max(o.imbalance for o in outcomes if o.result == "converged")
    console.print(f"largest imbalance of a converged scene: {worst:.1e} of the load")
    for o in outcomes:
        if o.oil != "vented" and o.valid and o.result != "converged":
            console.print(
                f"valid, but {o.result} at {o.level:.4g}: {o.section}, {o.law}, {o.oil}, "
                f"{o.inputs}"
            )


if __name__ == "__main__":
    main()
