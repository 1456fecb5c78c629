"""Skins that sway: where a symmetric equilibrium is unstable, the branch that a membrane takes.

It is reached as a real skin reaches it, by loads a little off their places, and followed to
where they belong.
"""

from collections.abc import Mapping

import numpy as np

from suas_jax.config import SceneSpec, continuous_inputs
from suas_jax.mechanics.model import Counts, Meshes
from suas_jax.mesh.section import measures
from suas_jax.numerics.lanes import number
from suas_jax.scene.program import prepared, run_program, structure_of

# By which loads are moved along the arc, as a share of half of it: the branch that is found
# does not depend on it, from 0.1 to 3 %.
_SHIFT = 0.01
_STEPS = 10  # bisections at most of the load at which stability ends
_NARROW = 0.01  # of that load: how well it is known then

Inputs = Mapping[str, np.ndarray]


def can_sway(scene: SceneSpec, meshes: Meshes) -> bool:
    """Whether symmetry was taken for granted, and loads can be moved off it."""
    placed = any(load.kind != "pressure" for load in scene.loads)
    return meshes.solved.symmetric and placed and scene.solve.oil_pressure is None


def shifted(scene: SceneSpec, inputs: Inputs) -> dict[str, np.ndarray]:
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
    for _ in range(_STEPS):
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
