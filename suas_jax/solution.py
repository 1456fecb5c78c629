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
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from suas_jax._types import Lanes
from suas_jax.compiled import COMPILED
from suas_jax.config import SceneSpec, continuous_inputs, structure
from suas_jax.equilibrium import Problem, State, equilibrium, verify
from suas_jax.mechanics.base import ErrorShares
from suas_jax.mesh import MeshPlan
from suas_jax.observables import load_observables, observe
from suas_jax.problem import build_problem, plan_for
from suas_jax.report import plain, report_of
from suas_jax.resolution import first, forced

Inputs = Mapping[str, ArrayLike]


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


def _discretisation_error(
    found: dict[str, Any], other: dict[str, Any], shares: ErrorShares
) -> Lanes:
    """Error of a solution, from its difference to that on the comparison mesh.

    The two are so near that a single Newton correction of the state found leads to the
    other to second order in the error.
    """
    tiny = jnp.asarray(1e-300)
    pressure = jnp.abs(found["pressure"] - other["pressure"])
    parts = [pressure / jnp.maximum(jnp.abs(other["pressure"]), tiny)]
    size = functools.reduce(jnp.maximum, [jnp.abs(d) for d in other["displacement"]], tiny)

    def difference(name: str) -> list[Lanes]:
        return [jnp.abs(a - b) / size for a, b in zip(found[name], other[name], strict=True)]

    fast = [part * shares.fast for part in [*parts, *difference("displacement")]]
    slow = [part * shares.slow for part in difference("inner_displacement")]
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
    better = load_observables(spec, other, check.correction, inputs)
    error = _discretisation_error(
        _key_quantities(report["loads"], state.pressure),
        _key_quantities(better, check.correction.pressure),
        problem.mechanics.error_shares,
    )
    same = plan.elements == other_plan.elements
    report["discretisation_error"] = jnp.full_like(error, jnp.nan) if same else error
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
    estimated discretisation error meets `rtol`.

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
        wanted = forced(scene)
        size = wanted or first(scene)
        while True:
            plan = plan_for(scene, *size)
            if unloaded(scene):
                report, state = COMPILED.run(_rest_program, static, plan, inputs, once=once)
                report |= {"discretisation_error": 0.0, "stable": True}
                outcome = {"result": 0, "level": 1.0, "iterations": 0, "unknowns": 0}
                return report, state, outcome, plan
            symmetric = is_symmetric(plan)
            half = working_plan(plan, symmetric)
            arguments = (static, plan, half, plan.comparison(), inputs)
            report, state, outcome = COMPILED.run(_program, *arguments, once=once)
            error = float(report["discretisation_error"][0])
            enough = not error > scene.solve.rtol or int(outcome["result"][0]) != 0
            finer = size.finer()
            if wanted or enough or finer is None:
                return report, state, outcome, plan
            size = finer

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


def _blind(taxels: list[dict[str, Any]]) -> list[str]:
    """Which taxels have no reading, where there are such."""
    blind = sum(not math.isfinite(taxel["so"]) for taxel in taxels)
    if not blind:
        return []
    return [
        f"{blind} of {len(taxels)} taxels touch the membrane: they have no capacitance, a "
        "real converter saturates."
    ]
