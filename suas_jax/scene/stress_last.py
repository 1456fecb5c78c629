"""Skins that buckle at rest and that their loads hold: the loads first, the stress then.

From a rest that buckles no path of loads may lead on. A skin that is pressed before it is
lowered, warmed or filled does not pass by there.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from suas_jax.config import SceneSpec
from suas_jax.equilibrium.balance import State
from suas_jax.numerics.lanes import number
from suas_jax.scene.structure import Inputs
from suas_jax.skin.prestress import unloaded_depth

_STEPS = 16

Program = Callable[[Inputs, State], tuple[Any, State, State, State, dict[str, Any]]]


def stressed_last(scene: SceneSpec, inputs: Inputs, rest: State, run: Program) -> Any | None:
    """Solve a scene under its loads, in steps of what the skin carries without them.

    `run`: solves it with other inputs from a start. Returns what that does, of the whole; None
    where a step is lost.
    """
    water, start, found = scene.environment, rest, None
    fitting = {"oil.fill": 1.0, "geometry.mounting": 0.0, "geometry.mounting_axial": 0.0}
    if water is not None:
        fitting["environment.depth"] = unloaded_depth(water, scene.reference)
        fitting["environment.temperature"] = scene.reference.temperature
    ends = {key: (np.asarray(x), inputs[key]) for key, x in fitting.items() if key in inputs}
    for share in np.linspace(0.0, 1.0, _STEPS + 1):
        found = run({**inputs, **{k: a + share * (b - a) for k, (a, b) in ends.items()}}, start)
        if number(found[-1]["result"]) != 0:
            return None
        start = found[3]
    return found
