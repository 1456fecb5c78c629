"""What of a scene decides its compiled programs: all but its numbers."""

from collections.abc import Mapping

from jaxtyping import ArrayLike

from suas_jax.config import SceneSpec, structure
from suas_jax.runtime.content_key import Keyed

Inputs = Mapping[str, ArrayLike]


class Structure(Keyed):
    """A scene compared by what decides the compiled program, with its wall or without it."""

    def __init__(self, scene: SceneSpec, *, wall: bool = False) -> None:
        self.scene = scene
        self.wall = wall
        self.key = (structure(scene), wall)
