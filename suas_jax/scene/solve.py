"""Solve a scene: choose the mesh, find the equilibrium, estimate its error, report.

One compiled program does all of it for a given structure of scene and number of
elements; the numbers of the scene are its arguments.
"""

import dataclasses
import time
from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from suas_jax.config import SceneSpec, continuous_inputs, structure, with_solve
from suas_jax.equilibrium.balance import Problem, State, verify
from suas_jax.equilibrium.equilibrium import equilibrium
from suas_jax.mesh.plan import MeshPlan
from suas_jax.runtime.compiled import COMPILED
from suas_jax.runtime.content_key import Keyed
from suas_jax.scene.build import (
    all_numbers,
    build_problem,
    geometry_of,
    line_loads_of,
    plan_for,
)
from suas_jax.scene.error_estimate import discretisation_error, model_error
from suas_jax.scene.observables import observe
from suas_jax.scene.report import plain, report_of
from suas_jax.scene.resolution import Resolution, first, forced

Inputs = Mapping[str, ArrayLike]
# Part of rtol that the model may take: some must be left for the mesh.
_MODEL_SHARE = 0.9


class Structure(Keyed):
    """A scene compared by what decides the compiled program: all but its numbers."""

    def __init__(self, scene: SceneSpec) -> None:
        self.scene = scene
        self.key = structure(scene)


class Attempt(NamedTuple):
    """One model on one mesh, in arrays.

    Attributes:
        report: what is observed, errors included.
        state: the equilibrium on the whole arc.
        outcome: how it was found.
        plan: its mesh.
    """

    report: dict[str, Any]
    state: State
    outcome: dict[str, Any]
    plan: MeshPlan

    @property
    def converged(self) -> bool:
        """Whether the equilibrium was found."""
        return int(np.ravel(self.outcome["result"])[0]) == 0

    @property
    def mesh_error(self) -> float:
        """Estimated error by the mesh."""
        return float(np.ravel(self.report["discretisation_error"])[0])

    @property
    def model_error(self) -> float:
        """Estimated error by the model."""
        return float(np.ravel(self.report["model_error"])[0])

    def model_too_coarse(self, rtol: float) -> bool:
        """Whether no mesh brings the error below rtol; true of an error that is unknown."""
        return not self.model_error < _MODEL_SHARE * rtol

    def mesh_too_coarse(self, rtol: float) -> bool:
        """Whether a finer mesh would help."""
        left = rtol if self.model_too_coarse(rtol) else rtol - self.model_error
        return self.converged and not self.mesh_error <= left

    def as_chosen(self, rtol: float) -> str:
        """Why the lumped shell was chosen, or why nothing else was tried."""
        if not self.converged:
            return "Lumped shell tried; the solid was not, as it starts no other path."
        return (
            f"Lumped shell chosen: its model error is estimated as {self.model_error:.1e}, "
            f"rtol is {rtol:.1e}."
        )


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


def assess(
    spec: SceneSpec, plan: MeshPlan, other_plan: MeshPlan, state: State, inputs: Inputs
) -> dict[str, Any]:
    """Observe a state on `plan` and check it on the comparison mesh `other_plan`.

    One assembly there, on the whole arc, answers two questions: whether the state is
    stable, sway included, and how far it is from the exact solution.
    """
    problem = build_problem(spec, plan, inputs)
    report = observe(spec, problem, state, inputs)
    other = build_problem(spec, other_plan, inputs)
    start = state._replace(q=problem.mechanics.to_comparison_mesh(state.q))
    check = verify(other, start)
    report["stable"] = check.stable
    numbers = all_numbers(spec, inputs)
    loads = line_loads_of(spec, numbers)
    error = discretisation_error(problem, state, other, check.correction, loads)
    same = plan.elements == other_plan.elements
    report["discretisation_error"] = jnp.full_like(error, jnp.nan) if same else error
    report["model_error"] = model_error(other, check, loads, geometry_of(numbers))
    return report


@eqx.filter_jit
def _program(
    scene: Structure, plan: MeshPlan, half: MeshPlan, other_plan: MeshPlan, inputs: Inputs
) -> tuple[dict[str, Any], State, dict[str, Any]]:
    """Solve on `half` (or `plan` itself), then assess on the whole arc."""
    problem = build_problem(scene.scene, half, inputs)
    found = equilibrium(problem)
    state = whole(problem, found.state, half)
    report = assess(scene.scene, plan, other_plan, state, inputs)
    outcome = {
        "result": found.result,
        "level": found.level,
        "iterations": found.iterations,
        "smallest_pivot": found.smallest_pivot,
        "unknowns": jnp.full(1, problem.mechanics.unknowns() + int(problem.oil.trapped)),
    }
    return report, state, outcome


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

    The mesh is the one the scene asks for (`elements`, `mesh`), or is refined until the
    estimated error meets `rtol`. Where the model is left open too (`auto`), it is the
    lumped shell unless what the shell leaves out is more than `rtol` allows.

    Args:
        scene: what to solve.
        repeat: how often to run after compilation; the solve time is the median.

    Returns:
        The solution; a failed solve is named in its report, not raised.
    """
    inputs = {k: jnp.asarray(v, float) for k, v in continuous_inputs(scene).items()}
    # Tolerance, model and mesh decide which programs run, not what they are.
    static = Structure(with_solve(scene, model="auto", rtol=1e-3, elements=None, mesh=None))
    once = repeat == 1
    compiled_before, rtol = COMPILED.seconds, scene.solve.rtol

    def attempt(model: str, size: Resolution | None) -> Attempt:
        wanted = size is not None
        size = size or first(scene, model)
        while True:
            plan = plan_for(scene, *size)
            if unloaded(scene):
                report, state = COMPILED.run(_rest_program, static, plan, inputs, once=once)
                report |= {"discretisation_error": 0.0, "model_error": 0.0, "stable": True}
                outcome = {"result": 0, "level": 1.0, "iterations": 0, "unknowns": 0}
                return Attempt(report, state, outcome, plan)
            half = working_plan(plan, is_symmetric(plan))
            arguments = (static, plan, half, plan.comparison(), inputs)
            report, state, outcome = COMPILED.run(_program, *arguments, once=once)
            found = Attempt(report, state, outcome, plan)
            finer = size.finer()
            hopeless = scene.solve.model == "auto" and model == "shell"
            hopeless = hopeless and found.model_too_coarse(rtol)
            if wanted or finer is None or hopeless or not found.mesh_too_coarse(rtol):
                return found
            size = finer

    def choose() -> tuple[Attempt, str]:
        model, size = scene.solve.model, forced(scene)
        if model != "auto":
            return attempt(model, size), ""
        if size is not None:
            model = "solid" if size.layers else "shell"
            return attempt(model, size), f"The mesh given is that of the {model}."
        shell = attempt("shell", None)
        if not shell.converged or not shell.model_too_coarse(rtol):
            return shell, shell.as_chosen(rtol)
        solid = attempt("solid", None)
        if not solid.converged:
            return shell, f"{shell.as_chosen(rtol)} The solid did not converge."
        return solid, (
            f"Solid chosen: the lumped shell's model error, estimated as "
            f"{shell.model_error:.1e}, exceeds rtol {rtol:.1e}."
        )

    result = choose()
    seconds = []
    for _ in range(repeat):
        begin = time.perf_counter()
        result = choose()
        seconds.append(time.perf_counter() - begin)
    found, reason = result
    outcome = plain(found.outcome) | {"model": found.plan.model, "reason": reason}
    report = report_of(scene, plain(found.report), outcome)
    report["timings_s"] = {
        "compile": COMPILED.seconds - compiled_before,
        "solve": float(np.median(seconds)),
    }
    return Solution(report, found.state, found.plan, scene)
