"""Skins that buckle at rest and that their loads hold: the loads first, the stress then.

From a rest that buckles no path of loads may lead on. A skin that is pressed before it is
lowered, warmed or filled does not pass by there.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from suas_jax.config import SceneSpec
from suas_jax.equilibrium.balance import State
from suas_jax.equilibrium.outcomes import NAMES, PATH_ENDS
from suas_jax.numerics.lanes import number
from suas_jax.scene.structure import Inputs
from suas_jax.skin.prestress import is_prestressed, unloaded_depth

_STEPS, _SHORTEST = 16, 1 / 128
# Outcomes of a path that another one may pass by; what else a body meets, it meets on any.
_WAY_LOST = (*PATH_ENDS, "unstable")

Solved = tuple[Any, State, State, State, dict[str, Any]]
Program = Callable[[Inputs, State], Solved]


def stressed_last(
    scene: SceneSpec,
    inputs: Inputs,
    rest: State,
    run: Program,  # solves the scene with other inputs from a start
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
