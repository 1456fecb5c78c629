"""Solve a scene: choose the mesh, find the equilibrium, estimate its error, report.

One compiled program does all of it for a given structure of scene and number of
elements; the numbers of the scene are its arguments.
"""

import dataclasses
import functools
import statistics
import time
from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool

from suas_jax.config import SceneSpec, continuous_inputs, structure, with_solve
from suas_jax.equilibrium.balance import Problem, State
from suas_jax.equilibrium.equilibrium import equilibrium
from suas_jax.mechanics.model import AbstractModel, AbstractPlan, Counts, Meshes
from suas_jax.mechanics.registry import MODELS
from suas_jax.runtime.compiled import COMPILED
from suas_jax.runtime.content_key import Keyed
from suas_jax.runtime.precision import require_float64
from suas_jax.scene.assessment import assess
from suas_jax.scene.build import build_problem, decay_angle, plan_for, problem_of
from suas_jax.scene.observables import observe
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.report import plain, report_of

Inputs = Mapping[str, ArrayLike]
# Part of rtol that the model may take: some must be left for the mesh.
_MODEL_SHARE = 0.9


class Structure(Keyed):
    """A scene compared by what decides the compiled program: all but its numbers.

    Args:
        scene: the scene.
        wall: whether the wall is there, see `problem_of`.
    """

    def __init__(self, scene: SceneSpec, *, wall: bool = False) -> None:
        self.scene = scene
        self.wall = wall
        self.key = (structure(scene), wall)


class Tried(NamedTuple):
    """A mesh, and the state found there on the part of it that is solved."""

    plan: AbstractPlan
    part: State


class Attempt(NamedTuple):
    """One model on one mesh, in arrays.

    Attributes:
        report: what is observed, errors included.
        state: the equilibrium on the whole membrane.
        shown: the state that the report describes, see `Solution`.
        outcome: how it was found.
        plan: its mesh.
        wall: whether the wall was there.
        part: the equilibrium on the part of the mesh that is solved.
        coarsest: the smallest mesh tried, with or without the wall as this one.
    """

    report: dict[str, Any]
    state: State
    shown: State
    outcome: dict[str, Any]
    plan: AbstractPlan
    wall: bool
    part: State
    coarsest: Tried

    @property
    def converged(self) -> bool:
        """Whether the equilibrium was found."""
        return _number(self.outcome["result"]) == 0

    @property
    def mesh_error(self) -> float:
        """Estimated error by the mesh."""
        return _number(self.report["discretisation_error"])

    @property
    def model_error(self) -> float:
        """Estimated error by the model."""
        return _number(self.report["model_error"])

    @property
    def at_the_wall(self) -> bool:
        """Whether the inner face reaches the wall, or has passed it."""
        return bool(_number(self.report["wall_contact"]))

    def model_too_coarse(self, rtol: float) -> bool:
        """Whether no mesh brings the error below rtol; true of an error that is unknown."""
        return not self.model_error < _MODEL_SHARE * rtol

    def better_than(self, coarser: "Attempt") -> bool:
        """Whether a finer mesh has helped: zones of contact may move from mesh to mesh."""
        same = self.wall == coarser.wall
        return self.converged and not (same and self.mesh_error >= coarser.mesh_error)

    def mesh_excess(self, rtol: float) -> float:
        """Error by the mesh over the one allowed; infinite where it is unknown."""
        left = rtol if self.model_too_coarse(rtol) else rtol - self.model_error
        return self.mesh_error / left if np.isfinite(self.mesh_error) else np.inf


@dataclasses.dataclass(frozen=True)
class Solution:
    """A solved scene.

    Attributes:
        report: the quantities of `suas solve --json`, SI units in the key names.
        state: the equilibrium on the whole membrane.
        shown: the state that the report describes: the equilibrium, where the mechanics is
            `corrected` with the first-order effect of what it leaves out.
        plan: its mesh.
        scene: what was solved.
        wall: whether the wall was there.
        part: the equilibrium on the part of the mesh that is solved.
        coarsest: the smallest mesh tried on the way, whose program is at hand.
        once: whether its program was compiled to run once.
    """

    report: dict[str, Any]
    state: State
    shown: State
    plan: AbstractPlan
    scene: SceneSpec
    wall: bool
    part: State
    coarsest: Tried
    once: bool = True

    @property
    def converged(self) -> bool:
        """Whether the equilibrium was found."""
        return bool(self.report["status"] == "converged")

    def problem(self) -> Problem:
        """The discrete problem on the whole arc."""
        inputs = continuous_inputs(self.scene)
        return build_problem(self.scene, self.plan, inputs, wall=self.wall)


@eqx.filter_jit
def _program(
    scene: Structure, meshes: Meshes, inputs: Inputs, start: State, judged: Bool[Array, ""]
) -> tuple[dict[str, Any], State, State, State, dict[str, Any]]:
    """Solve the whole membrane or a part of it, then assess the whole.

    One program serves solves from rest and from a state nearby (at rest the factor is zero),
    those whose error is judged and those of which only the outputs are wanted.
    """
    parts = scene_parts(scene.scene, inputs)
    problem = problem_of(parts, meshes.solved, wall=scene.wall)
    near = start if problem.oil_pressure is None else None
    found = equilibrium(problem, near)
    report, state, shown = assess(parts, meshes, problem, found.state, judged, wall=scene.wall)
    outcome = {
        "result": jnp.where(found.result == 0, report.pop("validity"), found.result),
        "level": found.level,
        "iterations": found.iterations,
        "smallest_pivot": found.smallest_pivot,
        "unknowns": jnp.full(1, problem.mechanics.unknowns() + int(problem.oil.trapped)),
    }
    return report, state, shown, found.state, outcome


def unloaded(scene: SceneSpec) -> bool:
    """Whether nothing acts on the skin."""
    return all(
        getattr(load, "force", getattr(load, "pressure", 0.0)) == 0 for load in scene.loads
    )


@eqx.filter_jit
def _rest_program(scene: Structure, plan: AbstractPlan, inputs: Inputs) -> tuple[Any, State]:
    parts = scene_parts(scene.scene, inputs)
    problem = problem_of(parts, plan)
    zero = jnp.zeros(1)
    state = State(problem.mechanics.rest(), zero, zero + 1)
    return observe(parts, problem, state), state


def solve(scene: SceneSpec, *, repeat: int = 1) -> Solution:
    """Find the equilibrium of a scene.

    The mesh is the one the scene asks for (`elements`, `mesh`), or is refined until the
    estimated error meets `rtol`. Where the model is left open too (`auto`), it is the
    shell unless what its correction leaves out is more than `rtol` allows, or no mesh of it
    meets `rtol`.

    Args:
        scene: what to solve.
        repeat: how often to run; the solve time is the median. More than one run is worth
            a program that takes longer to compile and less time to run.

    Returns:
        The solution; a failed solve is named in its report, not raised.

    Raises:
        Float64Error: float64 is off.
    """
    require_float64()
    compiled_before = COMPILED.seconds
    decay_angle(scene)  # its small program is compiled, and kept, outside the time measured
    seconds, once = [], repeat == 1
    for run in range(repeat + (repeat > 1)):
        begin, compiling = time.perf_counter(), COMPILED.seconds
        found, reason = _choose(scene, once=once)
        elapsed = time.perf_counter() - begin - (COMPILED.seconds - compiling)
        if run > 0 or repeat == 1:  # of several, the first one compiles
            seconds.append(elapsed)
    outcome = plain(found.outcome) | {"model": found.plan.model, "reason": reason}
    report = report_of(scene, plain(found.report), outcome)
    report["timings_s"] = {
        "compile": COMPILED.seconds - compiled_before,
        "solve": statistics.median(seconds),
    }
    states = found.state, found.shown, found.plan
    return Solution(report, *states, scene, found.wall, found.part, found.coarsest, once)


def report_with(
    solution: Solution, inputs: Mapping[str, float], *, judged: bool = False
) -> dict[str, Any] | None:
    """What a solution's scene reports with other numbers.

    Args:
        solution: of the scene; nothing is compiled anew.
        inputs: SI values by TOML path that replace the scene's own.
        judged: whether errors are wanted, on the solution's own mesh; without them it is the
            smallest mesh that was tried.

    Returns:
        The observed quantities; None where no solution was found.
    """
    scene = solution.scene
    plan, start = (solution.plan, solution.part) if judged else solution.coarsest
    known = _prepared(scene, plan.model, plan.counts)
    arrays = known.inputs | {k: np.asarray(v, float) for k, v in inputs.items()}
    static, once = _structure(scene, wall=solution.wall), solution.once
    if unloaded(scene):
        report, _ = COMPILED.run(_rest_program, static, plan, arrays, once=once)
        return plain(report)
    report, *_, outcome = _run(static, known.meshes, arrays, start, once=once, judged=judged)
    return plain(report) if _number(outcome["result"]) == 0 else None


def _run(
    static: Structure,
    meshes: Meshes,
    inputs: Inputs,
    start: State,
    *,
    once: bool,
    judged: bool = True,
) -> tuple[dict[str, Any], State, State, State, dict[str, Any]]:
    """The program of a scene from a start; from rest where that leads nowhere."""
    known, flag = (static, meshes, inputs), np.asarray(judged)
    effort = {"once": once, "long": meshes.whole.solves_long}
    found: Any = COMPILED.run(_program, *known, start, flag, **effort)
    free = static.scene.solve.oil_pressure is None  # a wanted pressure is sought from rest
    if free and _number(start.factor) != 0 and _number(found[-1]["result"]) != 0:
        rest = _at_rest(meshes.solved)
        found = COMPILED.run(_program, *known, rest, flag, **effort)
    return found


def _number(lane: ArrayLike) -> float:
    """The value of the only lane; by NumPy, as JAX compiles programs for an index."""
    return float(np.ravel(lane)[0])


def _at_rest(plan: AbstractPlan) -> State:
    none = jnp.asarray(np.zeros(1))
    return State(jnp.asarray(np.zeros((*plan.unknowns_shape, 1))), none, none)


class _Prepared(NamedTuple):
    """What a scene's program takes for one model and mesh."""

    plan: AbstractPlan
    meshes: Meshes
    inputs: dict[str, np.ndarray]
    rest: State


# A scene that is solved again costs its program's time, not that of planning its mesh.
@functools.lru_cache(maxsize=32)
def _prepared(scene: SceneSpec, name: str, counts: Counts) -> _Prepared:
    plan = plan_for(scene, name, counts)
    inputs = {k: np.asarray(v, float) for k, v in continuous_inputs(scene).items()}
    meshes = plan.meshes()
    return _Prepared(plan, meshes, inputs, _at_rest(meshes.solved))


@functools.lru_cache(maxsize=32)
def _structure(scene: SceneSpec, *, wall: bool) -> Structure:
    return Structure(_pattern(scene), wall=wall)


def _pattern(scene: SceneSpec) -> SceneSpec:
    """The scene without what decides which programs run, not what they are."""
    return with_solve(scene, model="auto", rtol=None, elements=None, mesh=None)


def _choose(scene: SceneSpec, *, once: bool) -> tuple[Attempt, str]:
    """Solve with the model that the scene asks for, and say why it is that one."""
    model, rtol = scene.solve.model, scene.rtol
    models = MODELS[scene.geometry.dimension]
    if model != "auto":
        return _attempt(scene, model, models[model].given(scene), once=once), ""
    if len(models) == 1:
        (name,) = models
        return _attempt(scene, name, models[name].given(scene), once=once), ""
    given = {name: m.given(scene) for name, m in models.items()}
    for name, counts in reversed(given.items()):
        if counts is not None:
            found = _attempt(scene, name, counts, once=once)
            return found, f"The mesh given is that of the {name}."
    shell = _attempt(scene, "shell", None, once=once)
    if not shell.converged:
        return shell, "Shell tried; the solid was not, as it starts no other path."
    if not shell.model_too_coarse(rtol) and shell.mesh_excess(rtol) <= 1:
        return shell, _shell_chosen(shell, rtol)
    at_the_wall = shell.at_the_wall and scene.wall.contact
    solid = _attempt(scene, "solid", None, once=once, wall=at_the_wall)
    if not solid.converged:
        if at_the_wall and not shell.wall:
            shell = _attempt(scene, "shell", None, once=once, wall=True)
        return shell, f"{_shell_chosen(shell, rtol)} The solid did not converge."
    if not (shell.model_too_coarse(rtol) or solid.mesh_error < shell.mesh_error):
        return shell, f"{_shell_chosen(shell, rtol)} The solid's mesh error is no smaller."
    if solid.wall == shell.wall:
        solid = solid._replace(coarsest=shell.coarsest)
    return solid, f"Solid chosen: {_shell_rejected(shell, rtol)}"


def _shell_rejected(shell: Attempt, rtol: float) -> str:
    if shell.model_too_coarse(rtol):
        stated = f"the corrected shell's model error, estimated as {shell.model_error:.1e},"
        return f"{stated} exceeds rtol {rtol:.1e}."
    stated = f"the mesh error of the shell's finest mesh, estimated as {shell.mesh_error:.1e},"
    return f"{stated} is more than rtol {rtol:.1e} leaves."


def _shell_chosen(shell: Attempt, rtol: float) -> str:
    return (
        f"Corrected shell chosen: its model error is estimated as {shell.model_error:.1e}, "
        f"rtol is {rtol:.1e}."
    )


def _attempt(
    scene: SceneSpec, name: str, given: Counts | None, *, once: bool, wall: bool = False
) -> Attempt:
    """Solve with one model, on the mesh given or on finer ones until `rtol` is met.

    The wall is left out until the membrane reaches it: a state without it whose gap is open
    is one with it, and most scenes need no program that knows contact.
    """
    model, rtol = MODELS[scene.geometry.dimension][name], scene.rtol
    counts = given or model.first(scene)
    coarsest: Tried | None = None
    coarser: Attempt | None = None
    while True:
        plan, meshes, inputs, rest = _prepared(scene, name, counts)
        static = _structure(scene, wall=wall)
        if unloaded(scene):
            report, state = COMPILED.run(_rest_program, static, plan, inputs, once=once)
            report |= {"discretisation_error": 0.0, "model_error": 0.0, "stable": True}
            outcome = {"result": 0, "level": 1.0, "iterations": 0, "unknowns": 0}
            tried = Tried(plan, rest)
            return Attempt(report, state, state, outcome, plan, False, rest, tried)
        start = None if coarser is None else _carried(model, coarser, meshes.solved)
        solved = _run(static, meshes, inputs, start or rest, once=once)
        report, state, shown, part, outcome = solved
        coarsest = coarsest or Tried(plan, part)
        found = Attempt(report, state, shown, outcome, plan, wall, part, coarsest)
        if coarser is not None and not found.better_than(coarser):
            return coarser
        # Where another model is tried next, a finer mesh of this one is wasted.
        other_next = scene.solve.model == "auto" and name == "shell" and not given
        other_next = other_next and found.converged and found.model_too_coarse(rtol)
        if found.at_the_wall and scene.wall.contact and not (wall or other_next):
            wall, coarsest = True, None
            continue
        coarser = found
        excess = found.mesh_excess(rtol)
        if given or other_next or not found.converged or excess <= 1:
            return found
        finer = model.finer(counts, excess)
        if finer is None:
            return found
        counts = finer


def _carried(model: AbstractModel, found: Attempt, target: AbstractPlan) -> State | None:
    """The state of a coarser mesh as a start on another one."""
    q = model.carried(np.asarray(found.state.q), found.plan, target)
    return None if q is None else found.state._replace(q=jnp.asarray(q))
