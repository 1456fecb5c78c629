"""Bodies as the page draws them: their surfaces once, and where they are in each picture."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from fitting.arrays import Floats
from suas_jax.config import SceneSpec
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.program import inputs_of
from suas_jax.skin.body import AbstractShape
from suas_jax.skin.plain import plain_geometry

_REACH = 0.4  # of a body that is drawn, in lengths of the section per angle
_RAYS, _RINGS = 48, 17  # of a surface: directions from the tip, and points along each
_HALVINGS = 40


def surfaces_of(scene: SceneSpec) -> list[list[list[float]]]:
    """Surfaces of a scene's bodies in their own frames, for each a grid [ray * ring, 3] [m].

    In plane strain there are two rays, along the section.
    """
    at_touch = {f"load.{i}.depth": np.zeros(()) for i, x in enumerate(scene.loads)}
    parts = scene_parts(scene, inputs_of(scene) | at_touch)
    reach = _REACH * float(plain_geometry(scene.geometry).outer_size[0])
    pad = scene.geometry.dimension == 3
    turn = np.linspace(0, 2 * np.pi, _RAYS + 1) if pad else np.array([np.pi, 0.0])
    ways = np.stack([np.cos(turn), np.sin(turn)][: 1 + pad])
    return [_surface(body.shape, ways, reach).tolist() for body in parts.bodies]


def _surface(shape: AbstractShape, ways: Floats, reach: float) -> Floats:
    """Points from the tip outwards, up to where the surface ends or leaves the picture."""

    def height(size: Floats) -> Floats:
        across = jnp.asarray(ways * size)[..., None]
        return np.asarray(shape.height(across))[..., 0]

    low, high = np.zeros(ways.shape[1]), np.full(ways.shape[1], reach)
    if not (height(high) <= reach).all():
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            inside = height(middle) <= reach
            low, high = np.where(inside, middle, low), np.where(inside, high, middle)
        high = low
    shares = np.sin(np.linspace(0, np.pi / 2, _RINGS))  # denser where a ball is steep
    rings = [(share * high, height(share * high)) for share in shares]
    points = [np.stack([*(ways * size), *((2 - len(ways)) * [0 * h]), h]) for size, h in rings]
    return np.stack(points, -1).transpose(1, 2, 0).reshape(-1, 3)


def placed(bodies: list[tuple[Floats, Floats]]) -> list[dict[str, Any]]:
    """Where bodies are: tips and axes, in space."""
    found = []
    for tip, frame in bodies:
        flat = len(tip) == 2
        axes = [np.pad(row, (0, flat)).tolist() for row in frame]
        if flat:
            axes.insert(1, [0.0, 0.0, 1.0])
        found.append({"tip": np.pad(tip, (0, flat)).tolist(), "axes": axes})
    return found
