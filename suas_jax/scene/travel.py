"""Which travels of bodies are found for forces, and what reports say of them."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from suas_jax.config import SceneSpec
from suas_jax.equilibrium.balance import State
from suas_jax.numerics.lanes import number

FIRST = 0.25  # travel to begin with, in thicknesses
POWER = 1.5  # with which a force grows with the travel, at first sight
# Travel below which a number stands for it, not for its logarithm, in thicknesses: where the
# skin comes out to meet a body, its travel is negative.
LEAST = 1e-3
LONGEST = 1.5  # step of a logarithm


def shares_of_travel(depths: Mapping[str, float]) -> dict[str, float]:
    """Travels of bodies over that of the one that is pressed in most, by the paths of depths.

    All alike where that one stands at its first touch. A body that the scene keeps off the skin
    alone comes in, too, as the travel grows.
    """
    most = max(depths.values(), default=0.0)
    return {path: depth / most if most else 1.0 for path, depth in depths.items()}


Solved = tuple[dict[str, Any], State, State, State, dict[str, Any]]


class Driven(NamedTuple):
    """A force that a scene gives a body, and the travel that is found for it."""

    load: int  # index of the body
    force: str  # key of the force; its value in the report ends in ``_N``
    travel: str  # key of the travel; in the report it ends in ``_m``

    @property
    def across(self) -> bool:
        """Whether it is across the approach, where friction alone carries it."""
        return self.force != "force"

    def path(self, key: str) -> str:
        """TOML path of one of the keys."""
        return f"load.{self.load}.{key}"

    def of(self, report: dict[str, Any], key: str) -> float:
        """What a report says of one of the keys."""
        unit = "N" if key == self.force else "m"
        return number(report["loads"][self.load][f"{key}_{unit}"])


_PAIRS = (
    ("force", "depth"),
    ("tangential_force", "drag"),
    ("tangential_force_axial", "drag_axial"),
)


def driven_by_force(scene: SceneSpec) -> list[Driven]:
    """The forces that bodies are pressed or pulled along by."""
    return [
        Driven(i, force, travel)
        for i, load in enumerate(scene.loads)
        if load.kind == "body"
        for force, travel in _PAIRS
        if getattr(load, force) is not None
    ]


def travels_of(scene: SceneSpec, report: dict[str, Any]) -> dict[str, np.ndarray]:
    """The travels that a report found, as inputs of the scene's program [m]."""
    return {
        driven.path(driven.travel): np.asarray(driven.of(report, driven.travel))
        for driven in driven_by_force(scene)
    }


def on_the_way(scene: SceneSpec, state: State, share: float) -> State:
    """A state as one on the way to other travels, which is then followed from there.

    A factor scales all that acts, so this needs bodies alone; a drag that stays is near enough.

    `state`: its equilibrium at travels. `share`: of those that are wanted.
    """
    if not 0 < share < np.inf or any(load.kind != "body" for load in scene.loads):
        return state
    return state._replace(factor=state.factor * share)
