"""Skins that sway or that buckle at rest: the branch that a membrane takes.

Where a symmetric equilibrium is unstable, it is reached as a real skin reaches it, by loads a
little off their places, and followed to where they belong.

From a rest that buckles no path of loads may lead on. A skin that is pressed before it is
lowered, warmed or filled does not pass by there: its loads come first, the stress then.
"""

from collections.abc import Callable, Mapping

import numpy as np

from suas_jax.config import SceneSpec, continuous_inputs
from suas_jax.equilibrium.balance import State
from suas_jax.equilibrium.outcomes import NAMES, PATH_ENDS
from suas_jax.mechanics.model import Counts, Meshes
from suas_jax.mesh.section import measures
from suas_jax.numerics.lanes import number
from suas_jax.scene.build import Inputs
from suas_jax.scene.program import prepared, run_program, structure_of
from suas_jax.scene.travel import Solved
from suas_jax.skin.prestress import is_prestressed, unloaded_depth

# By which loads are moved along the arc, as a share of half of it: the branch that is found
# does not depend on it, from 0.1 to 3 %.
_SHIFT = 0.01
_BISECTIONS = 10  # at most of the load at which stability ends
_NARROW = 0.01  # of that load: how well it is known then
_STEPS, _SHORTEST = 16, 1 / 128
# Outcomes of a path that another one may pass by; what else a body meets, it meets on any.
_WAY_LOST = (*PATH_ENDS, "unstable")


def can_sway(scene: SceneSpec, meshes: Meshes) -> bool:
    """Whether symmetry was taken for granted, and loads can be moved off it."""
    placed = any(load.kind != "pressure" for load in scene.loads)
    return meshes.solved.symmetric and placed and scene.solve.oil_pressure is None


def shifted(scene: SceneSpec, inputs: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """A scene's inputs with its loads a little further along the arc."""
    found = measures(scene)
    moved = {}
    for i, load in enumerate(scene.loads):
        if load.kind != "pressure":
            by_arc = load.arc is not None
            key = f"load.{i}.{'arc' if by_arc else 'angle'}"
            size = found.size if by_arc else 1.0
            moved[key] = inputs[key] + _SHIFT * found.half_angle * size
    return {**inputs, **moved}


def stable_factor(
    scene: SceneSpec, model: str, counts: Counts, high: float, *, wall: bool, once: bool
) -> float:
    """The factor on all loads at which the equilibrium stops being stable.

    To a per cent of it, or a thousandth of `high`, a factor at which it no longer is.
    """
    _, meshes, inputs, rest = prepared(scene, model, counts)
    static, known = structure_of(scene, wall=wall), continuous_inputs(scene)
    ends = (".force", ".pressure", ".depth")
    sizes = [k for k in known if k.startswith("load.") and k.endswith(ends)]
    low = 0.0
    for _ in range(_BISECTIONS):
        if high - low < _NARROW * high:
            break
        middle = (low + high) / 2
        scaled = {**inputs, **{key: middle * inputs[key] for key in sizes}}
        report, *_, outcome = run_program(static, meshes, scaled, rest, once=once)
        if number(outcome["result"]) == 0 and bool(number(report["stable"])):
            low = middle
        else:
            high = middle
    return (low + high) / 2


def stressed_last(
    scene: SceneSpec,
    inputs: Inputs,
    rest: State,
    run: Callable[[Inputs, State], Solved],  # solves the scene with other inputs from a start
    lost: Solved,  # what that ended with from rest, without a solution
) -> Solved:
    """Solve a scene under its loads, in steps of what the skin carries without them.

    Returns what `run` does; `lost` where a step is lost, too, or where no path helps.
    """
    if scene.bodies and NAMES[int(number(lost[-1]["result"]))] not in _WAY_LOST:
        return lost
    if not is_prestressed(scene):
        return lost
    water, start, found = scene.environment, rest, lost
    fitting = {"oil.fill": 1.0, "geometry.mounting": 0.0, "geometry.mounting_axial": 0.0}
    if water is not None:
        fitting["environment.depth"] = unloaded_depth(water, scene.reference)
        fitting["environment.temperature"] = scene.reference.temperature
    ends = {key: (np.asarray(x), inputs[key]) for key, x in fitting.items() if key in inputs}
    share, stride = 0.0, 1 / _STEPS
    while True:
        at = {k: a + share * (b - a) for k, (a, b) in ends.items()}
        now = run({**inputs, **at}, start)
        if number(now[-1]["result"]) != 0:
            stride /= 2
            if found is lost or stride < _SHORTEST:
                return lost
            share -= stride
            continue
        found, start = now, now[3]
        if share == 1:
            return found
        share = min(share + stride, 1.0)
