"""The same scene without its loads: what a skin carries before anything touches it."""

from typing import Any

import equinox as eqx
import numpy as np

from suas_jax.config import SceneSpec, with_solve
from suas_jax.equilibrium.balance import State
from suas_jax.equilibrium.buckling import stress_effect
from suas_jax.mechanics.model import AbstractPlan
from suas_jax.numerics.lanes import number
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.build import build_problem
from suas_jax.scene.choice import Attempt
from suas_jax.scene.program import inputs_of, prepared, run_program, structure_of
from suas_jax.scene.report import plain
from suas_jax.scene.structure import Inputs, Structure

_KEPT = ("oil_pressure_Pa", "hoop_force_N_per_m", "max_displacement_m", "min_gap_m")


@eqx.filter_jit
def _effect(
    scene: Structure, plan: AbstractPlan, inputs: Inputs, rest: State
) -> dict[str, Any]:
    effect = stress_effect(build_problem(scene.scene, plan, inputs), rest)
    return effect._asdict()


def rest_of(scene: SceneSpec, found: Attempt, *, once: bool) -> dict[str, Any]:
    """Solve a scene without its loads, on the mesh that it was solved on.

    Args:
        scene: the scene.
        found: its solution.
        once: whether programs run once.

    Returns:
        The keys of `REST_KEYS`; a rest that was not found is unstable, and has no more.
    """
    idle = with_solve(scene, oil_pressure=None)
    plan, meshes, inputs, start = prepared(idle, found.plan.model, found.plan.counts)
    nothing = {
        path: np.zeros(())
        for i in range(len(scene.loads))
        for path in (f"load.{i}.force", f"load.{i}.pressure")
        if path in inputs
    }
    away = {
        f"load.{i}.depth": np.asarray(-idle.geometry.width)
        for i, load in enumerate(scene.loads)
        if load.kind == "body"
    }
    nothing |= away
    static = structure_of(idle, wall=found.wall)
    report, state, _, _, outcome = run_program(
        static, meshes, inputs | nothing, start, once=once, travels_given=True
    )
    if number(outcome["result"]) != 0:
        return {"stable": False}
    seen = plain(report)
    effect = plain(
        COMPILED.run(_effect, static, plan, inputs_of(idle) | away, state, once=True)
    )
    pushed = any(load.kind in ("line", "patch") for load in scene.loads)
    return {
        "stable": seen["stable"],
        **{key: seen[key] for key in _KEPT[:2]},
        "buckling_share": effect["share"],
        "stiffness_change": effect["stiffness_change"] if pushed else None,
        **{key: seen[key] for key in _KEPT[2:]},
        "displacement_m": [load.get("displacement_m") for load in seen["loads"]],
        "so": seen.get("taxels", {}).get("so", []),
    }
