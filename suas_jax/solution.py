"""Solve a scene: choose the mesh, find the equilibrium, estimate its error, report.

One compiled program does all of it for a given structure of scene and number of
elements; the numbers of the scene are its arguments.
"""

import dataclasses
import functools
import math
import time
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from suas_jax._types import Lanes
from suas_jax.compiled import COMPILED
from suas_jax.config import SceneSpec, continuous_inputs, structure
from suas_jax.equilibrium import Problem, State, equilibrium, verify
from suas_jax.mesh import MeshPlan
from suas_jax.observables import load_observables, observe, taxel_rows
from suas_jax.problem import build_problem, plan_for
from suas_jax.results import NAMES, advice

Inputs = Mapping[str, ArrayLike]

_MOST_ELEMENTS = 512


class Structure:
    """A scene compared by what decides the compiled program: all but its numbers."""

    def __init__(self, scene: SceneSpec) -> None:
        self.scene = scene
        self.key = structure(scene)

    def __hash__(self) -> int:
        return hash(self.key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Structure) and self.key == other.key


@dataclasses.dataclass(frozen=True)
class Solution:
    """A solved scene.

    Attributes:
        report: the quantities of `suas solve --json`, SI units in the key names.
        state: the equilibrium on the whole arc.
        plan: its mesh.
        scene: what was solved.
    """

    report: dict[str, Any]
    state: State
    plan: MeshPlan
    scene: SceneSpec

    @property
    def converged(self) -> bool:
        """Whether the equilibrium was found."""
        return bool(self.report["status"] == "converged")

    def problem(self) -> Problem:
        """The discrete problem on the whole arc."""
        return build_problem(self.scene, self.plan, continuous_inputs(self.scene))


def working_plan(plan: MeshPlan, symmetric: bool) -> MeshPlan:
    """The half of a symmetric plan, or the plan itself."""
    return plan.half() if symmetric else plan


def is_symmetric(plan: MeshPlan) -> bool:
    """Whether stations and loads of a plan are their own mirror image."""
    angles = plan.stations @ plan.values
    points = np.sort(plan.position @ plan.values)
    return bool(
        plan.mirror
        and plan.elements % 2 == 0
        and np.allclose(angles, -angles[::-1], atol=1e-12)
        and np.allclose(points, -points[::-1], atol=1e-12)
    )


def whole(problem: Problem, state: State, plan: MeshPlan) -> State:
    """The state on the whole arc from the one that was solved."""
    return state._replace(q=problem.mechanics.mirrored(state.q)) if plan.symmetric else state


def _discretisation_error(coarse: dict[str, Any], fine: dict[str, Any]) -> Lanes:
    """Error of the coarse solution, from one Newton correction with every element divided.

    The coarse solution is so near the fine one that a single correction reaches it to
    second order in the error. Pressure and mid-surface displacements of the loads
    converge with the fourth power of the element length, so the fine solution's own
    error is a sixteenth; the inner face's displacement follows the curvature, which
    converges with the second power.
    """
    tiny = jnp.asarray(1e-300)
    pressure = jnp.abs(coarse["pressure"] - fine["pressure"])
    parts = [pressure / jnp.maximum(jnp.abs(fine["pressure"]), tiny)]
    size = functools.reduce(jnp.maximum, [jnp.abs(d) for d in fine["displacement"]], tiny)

    def difference(name: str) -> list[Lanes]:
        return [jnp.abs(a - b) / size for a, b in zip(coarse[name], fine[name], strict=True)]

    fast = [part * 16 / 15 for part in [*parts, *difference("displacement")]]
    slow = [part * 4 / 3 for part in difference("inner_displacement")]
    return functools.reduce(jnp.maximum, fast + slow)


def _key_quantities(loads: list[dict[str, Any]], pressure: Lanes) -> dict[str, Any]:
    """What the error is estimated for."""
    lines = [load for load in loads if "displacement_m" in load]
    return {
        "pressure": pressure,
        "displacement": [load["displacement_m"] for load in lines],
        "inner_displacement": [load["inner_displacement_m"] for load in lines],
    }


def assess(
    spec: SceneSpec, plan: MeshPlan, fine_plan: MeshPlan, state: State, inputs: Inputs
) -> dict[str, Any]:
    """Observe a state on `plan` and check it on `fine_plan`.

    One assembly on the fine mesh of the whole arc answers two questions: whether the
    state is stable, sway included, and how far it is from a better solution.
    """
    problem = build_problem(spec, plan, inputs)
    report = observe(spec, problem, state, inputs)
    fine = build_problem(spec, fine_plan, inputs)
    start = state._replace(q=problem.mechanics.prolonged(state.q))
    check = verify(fine, start)
    report["stable"] = check.stable
    better = load_observables(spec, fine, check.correction, inputs)
    report["discretisation_error"] = _discretisation_error(
        _key_quantities(report["loads"], state.pressure),
        _key_quantities(better, check.correction.pressure),
    )
    return report


@eqx.filter_jit
def _program(
    scene: Structure, plan: MeshPlan, half: MeshPlan, fine_plan: MeshPlan, inputs: Inputs
) -> tuple[dict[str, Any], State, dict[str, Any]]:
    """Solve on `half` (or `plan` itself), then assess on the whole arc."""
    problem = build_problem(scene.scene, half, inputs)
    found = equilibrium(problem)
    state = whole(problem, found.state, half)
    report = assess(scene.scene, plan, fine_plan, state, inputs)
    outcome = {
        "result": found.result,
        "level": found.level,
        "iterations": found.iterations,
        "smallest_pivot": found.smallest_pivot,
        "unknowns": jnp.full(1, problem.mechanics.unknowns() + int(problem.oil.trapped)),
    }
    return report, state, outcome


def _starting_elements(scene: SceneSpec) -> int:
    """Elements of the first mesh that is tried for a wanted error."""
    intervals = 2 * (1 + len(scene.loads))
    return max(16 if scene.solve.rtol >= 1e-4 else 32, 4 * intervals)


def plain(tree: dict[str, Any], row: int = 0) -> dict[str, Any]:
    """Arrays to Python numbers, one row of them where they have many."""

    def number(x: Any) -> Any:
        if not isinstance(x, (jax.Array, np.ndarray)):
            return x
        return np.asarray(x).reshape(-1)[row].item()

    columns = tree.get("taxels", {})
    others = {name: x for name, x in tree.items() if name != "taxels"}
    numbers: dict[str, Any] = jax.tree.map(number, others)
    if columns:
        count = columns["so"].shape[-2]
        rows = {name: np.asarray(x).reshape(-1, count)[row] for name, x in columns.items()}
        numbers["taxels"] = {name: x.tolist() for name, x in rows.items()}
    return numbers


def unloaded(scene: SceneSpec) -> bool:
    """Whether nothing acts on the skin."""
    return all(
        getattr(load, "force", getattr(load, "pressure", 0.0)) == 0 for load in scene.loads
    )


@eqx.filter_jit
def _rest_program(scene: Structure, plan: MeshPlan, inputs: Inputs) -> tuple[Any, State]:
    problem = build_problem(scene.scene, plan, inputs)
    zero = jnp.zeros(1)
    state = State(problem.mechanics.rest(), zero, zero + 1)
    return observe(scene.scene, problem, state, inputs), state


def solve(scene: SceneSpec, *, repeat: int = 1) -> Solution:
    """Find the equilibrium of a scene.

    The mesh is the one the scene asks for (`elements`), or is refined until the estimated
    discretisation error meets `rtol`.

    Args:
        scene: what to solve.
        repeat: how often to run after compilation; the solve time is the median.

    Returns:
        The solution; a failed solve is named in its report, not raised.
    """
    inputs = {k: jnp.asarray(v, float) for k, v in continuous_inputs(scene).items()}
    static = Structure(scene)
    once = repeat == 1
    compiled_before = COMPILED.seconds

    def attempt() -> tuple[dict[str, Any], State, dict[str, Any], MeshPlan]:
        elements = scene.solve.elements or _starting_elements(scene)
        while True:
            plan = plan_for(scene, elements)
            if unloaded(scene):
                report, state = COMPILED.run(_rest_program, static, plan, inputs, once=once)
                report |= {"discretisation_error": 0.0, "stable": True}
                outcome = {"result": 0, "level": 1.0, "iterations": 0, "unknowns": 0}
                return report, state, outcome, plan
            symmetric = is_symmetric(plan)
            half = working_plan(plan, symmetric)
            arguments = (static, plan, half, plan.refined(), inputs)
            report, state, outcome = COMPILED.run(_program, *arguments, once=once)
            error = float(report["discretisation_error"][0])
            enough = not error > scene.solve.rtol or int(outcome["result"][0]) != 0
            if scene.solve.elements or enough or 2 * elements > _MOST_ELEMENTS:
                return report, state, outcome, plan
            elements *= 2

    result = attempt()
    seconds = []
    for _ in range(repeat):
        begin = time.perf_counter()
        result = attempt()
        seconds.append(time.perf_counter() - begin)
    report, state, outcome, plan = result
    report = report_of(scene, plain(report), plain(outcome))
    report["timings_s"] = {
        "compile": COMPILED.seconds - compiled_before,
        "solve": float(np.median(seconds)),
    }
    return Solution(report, state, plan, scene)


def report_of(
    scene: SceneSpec, observed: dict[str, Any], outcome: dict[str, Any]
) -> dict[str, Any]:
    """The report of one state, in the order of the contract."""
    kinds = [{"kind": load.kind} for load in scene.loads]
    loads = [kind | load for kind, load in zip(kinds, observed["loads"], strict=True)]
    taxels = taxel_rows(scene, observed.pop("taxels", {}))
    return {
        **_header(scene, observed | {"loads": loads}, outcome, taxels),
        "iterations": outcome["iterations"],
        "unknowns": outcome["unknowns"],
        "taxels": taxels,
    }


def _header(
    scene: SceneSpec,
    report: dict[str, Any],
    outcome: dict[str, Any],
    taxels: list[dict[str, Any]],
) -> dict[str, Any]:
    """Status, message and error estimate, ahead of the observables."""
    status = NAMES[outcome["result"]]
    error = report.pop("discretisation_error")
    known = bool(np.isfinite(error)) and status == "converged"
    message = [advice(status)]
    if status != "converged" and scene.solve.oil_pressure is None:
        message.append(f"It carries {outcome['level']:.4g} of the load.")
    if status == "converged":
        message += _remarks(scene, report, error if known else None)
        message += _blind(taxels)
    return {
        "model": "shell",
        "status": status,
        "message": " ".join(filter(None, message)),
        "rtol_met": known and error <= scene.solve.rtol,
        **report,
        "error_estimate": error if known else None,
        "discretisation_error": error if known else None,
        "model_error": None,
    }


def _remarks(scene: SceneSpec, report: dict[str, Any], error: float | None) -> list[str]:
    """What a user should know about a converged state."""
    remarks = []
    if scene.solve.model == "auto":
        remarks.append("Lumped shell chosen.")
    if error is None:
        remarks.append("The mesh's error could not be estimated.")
    elif error > scene.solve.rtol:
        remarks.append(f"Estimated mesh error {error:.1e} exceeds rtol {scene.solve.rtol:.1e}.")
    if report["wall_contact"]:
        remarks.append(
            "The inner face has reached the rigid wall: contact is not modelled, the state "
            "is not valid."
        )
    if not report["stable"]:
        remarks.append("The equilibrium is unstable: a real membrane leaves it.")
    if not report["material_stable"]:
        remarks.append("The material leaves its stability window (see the stretches).")
    return remarks


def _blind(taxels: list[dict[str, Any]]) -> list[str]:
    """Which taxels have no reading, where there are such."""
    blind = sum(not math.isfinite(taxel["so"]) for taxel in taxels)
    if not blind:
        return []
    return [
        f"{blind} of {len(taxels)} taxels touch the membrane: they have no capacitance, a "
        "real converter saturates."
    ]
