"""Frames of a load path on a pad: each continues the equilibrium of the frame before.

Meshes are graded around loads, whose places count in steps of a millimetre or two there: most
frames share the mesh of the one before; a frame with another mesh starts from rest.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array
from numpy.typing import NDArray

from suas_jax.config import SceneSpec, with_inputs, with_solve
from suas_jax.config.csv_table import SURROUNDINGS
from suas_jax.equilibrium.balance import State
from suas_jax.equilibrium.correction import corrected
from suas_jax.equilibrium.equilibrium import equilibrium
from suas_jax.equilibrium.outcomes import NAMES, advice
from suas_jax.mechanics.model import Counts
from suas_jax.mechanics.pad.model import PAD, PadMesh
from suas_jax.numerics.array_types import Lanes
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.build import Inputs, Structure, plan_for, problem_of
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.program import at_rest, inputs_of, structure_of
from suas_jax.simulation.load_path import LoadPath

# Frames below which a program isn't worth the compiler's own optimisation.
_FEW = 10
_FIELDS = {
    "force_N": ("force", 1.0),
    "angle_deg": ("angle", math.pi / 180),
    "arc_m": ("arc", 1.0),
    "direction_deg": ("direction", math.pi / 180),
    "axial_m": ("axial", 1.0),
    "tilt_deg": ("tilt", math.pi / 180),
    "diameter_m": ("diameter", 1.0),
    "pressure_Pa": ("pressure", 1.0),
}


class NoSolutionError(Exception):
    """No equilibrium was found for a load; the message says which and why."""


def no_solution(time: float, result: Any) -> NoSolutionError:
    """What is said of a frame [s] whose outcome has an index."""
    name = NAMES[int(result)]
    return NoSolutionError(f"t = {time:g} s: {name}. {advice(name)}")


def pad_capacitances(
    path: LoadPath,
    time: NDArray[np.float64],
    progress: Callable[[int], None] = lambda done: None,
) -> NDArray[np.float64]:
    """The same as `capacitances`, of a pad.

    NaN where the membrane touches a taxel that no further dielectric covers. Raises
    ConfigError: a load leaves the pad; NoSolutionError: some loads have no equilibrium.
    """
    scene, moved, plans = pad_path(path, time)
    inputs = inputs_of(scene)
    free, held = (structure_of(scene, wall=wall) for wall in (False, True))
    rows: list[NDArray[np.float64]] = []
    state, last = None, None
    for i, plan in enumerate(plans):
        if state is None or last is None or not same_mesh(plan, last):
            state = at_rest(plan)
        here = inputs | {k: np.asarray(float(v[i])) for k, v in moved.items()}
        start, once = state, len(time) < _FEW
        found = COMPILED.run(_frame, free, plan, here, start, once=once, long=True)
        if scene.wall.contact and float(found[3][0]) < 0:
            # The program that knows contact is compiled where the membrane reaches the wall.
            found = COMPILED.run(_frame, held, plan, here, start, once=once, long=True)
        capacitance, state, result, _ = found
        if int(result[0]):
            raise no_solution(time[i], result[0])
        last = plan
        rows.append(np.asarray(capacitance)[:, 0])
        progress(i + 1)
    return np.stack(rows)


def pad_path(
    path: LoadPath, time: NDArray[np.float64]
) -> tuple[SceneSpec, dict[str, NDArray[np.float64]], list[PadMesh]]:
    """The scene with what a path moves stated in it, those inputs, and a mesh a frame."""
    scene, moved = _moving(path, time)
    # No mesh depends on the electrodes, which take long to check.
    bare = scene.model_copy(update={"electrodes": None})
    scenes = [
        with_inputs(bare, {k: float(v[i]) for k, v in moved.items()}) for i in range(len(time))
    ]
    counts = _counts(scenes, scene)
    return scene, moved, _alike([_plan(each, counts) for each in scenes])


@eqx.filter_jit
def _frame(
    scene: Structure, plan: PadMesh, inputs: Inputs, start: State
) -> tuple[Array, State, Lanes, Lanes]:
    """Capacitances, the state to start the next frame from, its result and smallest gap."""
    parts = scene_parts(scene.scene, inputs)
    problem = problem_of(parts, plan, wall=scene.wall)
    found = equilibrium(problem, start)
    shown = corrected(problem, found.state).state
    readings = parts.skin.sensing().read(problem.mechanics, shown.q)
    gap = problem.mechanics.shape(shown.q).smallest_gap(parts.skin.geometry).value
    return readings.capacitance, found.state, found.outcome, gap


def _moving(
    path: LoadPath, time: NDArray[np.float64]
) -> tuple[SceneSpec, dict[str, NDArray[np.float64]]]:
    """The scene with what the path moves stated in it, and those inputs over time."""
    moved, loads = path.surroundings(time), list(path.scene.loads)
    for name, values in path.at(time).items():
        if name in SURROUNDINGS:
            continue
        _, index, column = name.split(".")
        field, scale = _FIELDS[column]
        moved[f"load.{index}.{field}"] = scale * values
        k = int(index)
        loads[k] = loads[k].model_copy(update={field: float(scale * values[0])})
    return path.scene.model_copy(update={"loads": tuple(loads)}), moved


def _counts(scenes: list[SceneSpec], scene: SceneSpec) -> Counts:
    given = PAD.given(scene)
    if given is not None:
        return given
    few = scenes[:: max(1, len(scenes) // 50)]
    arc, axial = zip(*(PAD.first(each) for each in few), strict=True)
    return max(arc), max(axial)


def _plan(scene: SceneSpec, counts: Counts) -> PadMesh:
    plan = plan_for(with_solve(scene, symmetry=False), PAD.name, counts)
    assert isinstance(plan, PadMesh)
    return plan


def _alike(plans: list[PadMesh]) -> list[PadMesh]:
    """Plans with as many load points as any of them needs: one program serves them all."""
    most = tuple(
        (max(a for a, _ in spreads), max(b for _, b in spreads))
        for spreads in zip(*(plan.plan.spread for plan in plans), strict=True)
    )
    return [PadMesh(dataclasses.replace(plan.plan, spread=most)) for plan in plans]


def same_mesh(plan: PadMesh, other: PadMesh) -> bool:
    """Whether two frames are solved on one mesh."""
    own, its = plan.plan, other.plan
    return np.array_equal(own.arc, its.arc) and np.array_equal(own.axial, its.axial)
