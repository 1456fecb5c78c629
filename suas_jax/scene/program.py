"""The compiled program of a scene on one mesh, and what it takes.

It solves, estimates the error and reads what is reported, for a structure of scene and a number
of elements; the numbers of the scene are its arguments.
"""

import functools
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from suas_jax.config import SceneSpec, continuous_inputs, with_solve
from suas_jax.equilibrium.balance import State
from suas_jax.equilibrium.equilibrium import equilibrium
from suas_jax.equilibrium.friction import equilibrium_with_friction
from suas_jax.equilibrium.validity import final_result
from suas_jax.mechanics.model import AbstractPlan, Counts, Meshes
from suas_jax.numerics.lanes import number
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.assessment import assess
from suas_jax.scene.build import Inputs, Structure, plan_for, problem_of
from suas_jax.scene.force_search import under_forces
from suas_jax.scene.observables import observe
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.travel import driven_by_force
from suas_jax.skin.prestress import is_prestressed


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
    found = (
        equilibrium(problem, near) if near is None else equilibrium_with_friction(problem, near)
    )
    lost = found.result != 0
    assessed = assess(parts, meshes, problem, found.state, judged, lost, wall=scene.wall)
    report, state, shown = assessed
    outcome = {
        "result": final_result(found.result, report.pop("validity")),
        "level": found.level,
        "iterations": found.iterations,
        "smallest_pivot": found.smallest_pivot,
        "unknowns": jnp.full(1, problem.mechanics.unknowns() + int(problem.oil.trapped)),
    }
    return report, state, shown, found.state, outcome


def unloaded(scene: SceneSpec) -> bool:
    """Whether nothing acts on the skin."""
    return not is_prestressed(scene) and not any(
        getattr(load, key, None)
        for load in scene.loads
        for key in ("force", "pressure", "depth")
    )


@eqx.filter_jit
def _rest_program(scene: Structure, plan: AbstractPlan, inputs: Inputs) -> tuple[Any, State]:
    """Report and state of a scene on which nothing acts."""
    parts = scene_parts(scene.scene, inputs)
    problem = problem_of(parts, plan)
    zero = jnp.zeros(1)
    state = State(problem.mechanics.rest(), zero, zero + 1)
    return observe(parts, problem, state), state


def run_program(
    static: Structure,
    meshes: Meshes,
    inputs: Inputs,
    start: State,
    *,
    once: bool,
    judged: bool = True,
    travels_given: bool = False,
    until_wall: bool = False,
    refined: bool = False,
    slopes: np.ndarray | None = None,
) -> tuple[dict[str, Any], State, State, State, dict[str, Any]]:
    """The program of a scene from a start; from rest where that leads nowhere.

    Where nothing acts on the skin the report is that of the undeformed skin. Bodies that are
    pressed by a force take the travel at which they carry it, unless the inputs give it;
    `until_wall` says that a state in a wall that is left out will do; `refined`, that start and
    travels are those of a solution on another mesh: where they lead nowhere, nothing else does;
    `slopes` are those in the outcome of another mesh, see `under_forces`.

    Returns what is observed; the equilibrium, the state to report and that of the part solved;
    how it was found.
    """
    if unloaded(static.scene):
        driven = driven_by_force(static.scene)
        touching = {d.path(d.travel): np.zeros(()) for d in driven}
        at_touch = {**touching, **inputs}
        report, state = COMPILED.run(_rest_program, static, meshes.whole, at_touch, once=once)
        report |= {"discretisation_error": 0.0, "model_error": 0.0, "stable": True}
        outcome = {"result": 0, "level": 1.0, "iterations": 0, "unknowns": 0}
        return report, state, state, at_rest(meshes.solved), outcome
    flag, effort = np.asarray(judged), {"once": once, "long": meshes.whole.solves_long}
    # A wanted pressure is sought from rest; paths of contact begin anew there by themselves.
    contact = bool(static.scene.bodies) or static.wall
    rubbed = any(load.friction for load in static.scene.bodies)
    itself = contact and not rubbed and not is_prestressed(static.scene)
    again = static.scene.solve.oil_pressure is None and not itself

    def run(inputs: Inputs, start: State) -> Any:
        found: Any = COMPILED.run(_program, static, meshes, inputs, start, flag, **effort)
        if again and number(start.factor) != 0 and number(found[-1]["result"]) != 0:
            rest = at_rest(meshes.solved)
            found = COMPILED.run(_program, static, meshes, inputs, rest, flag, **effort)
        return found

    if driven_by_force(static.scene) and not travels_given:
        return under_forces(
            static.scene,
            inputs,
            start,
            run,
            until_wall=until_wall,
            refined=refined,
            slopes=slopes,
        )
    return run(inputs, start)


def at_rest(plan: AbstractPlan) -> State:
    """The start of a solve from rest."""
    none = jnp.asarray(np.zeros(1))
    return State(jnp.asarray(np.zeros((*plan.unknowns_shape, 1))), none, none)


class Prepared(NamedTuple):
    """What a scene's program takes for one model and mesh."""

    plan: AbstractPlan
    meshes: Meshes
    inputs: dict[str, np.ndarray]
    rest: State


# A scene that is solved again costs its program's time, not that of planning its mesh.
@functools.lru_cache(maxsize=32)
def prepared(
    scene: SceneSpec, name: str, counts: Counts, slid: tuple[float, ...] = ()
) -> Prepared:
    """Mesh of a model and a size, inputs and start of a scene's program; see `plan_for`."""
    plan = plan_for(scene, name, counts, slid)
    meshes = meshes_of(scene, plan)
    return Prepared(plan, meshes, inputs_of(scene), at_rest(meshes.solved))


def meshes_of(scene: SceneSpec, plan: AbstractPlan) -> Meshes:
    """The meshes that a scene's program works on, for one of the whole membrane."""
    meshes = plan.meshes()
    if scene.bodies:
        # A state carried to another mesh touches a stiff body elsewhere, or not at all: the
        # error is told by another solve, see `choice`.
        meshes = meshes._replace(compared=(), stability=meshes.whole)
    return meshes


def inputs_of(scene: SceneSpec) -> dict[str, np.ndarray]:
    """A scene's numbers as its programs take them."""
    return {path: np.asarray(x, float) for path, x in continuous_inputs(scene).items()}


@functools.lru_cache(maxsize=32)
def structure_of(scene: SceneSpec, *, wall: bool) -> Structure:
    """What decides the programs of a scene, with or without its wall."""
    # Without what decides which programs run, not what they are.
    pattern = with_solve(scene, model="auto", rtol=None, elements=None, mesh=None)
    return Structure(pattern, wall=wall)
