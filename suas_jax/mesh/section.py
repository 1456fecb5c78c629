"""The mesh of a scene's section: where its clamps and loads put the breakpoints."""

import numpy as np

from suas_jax.config import LineLoadSpec, SceneSpec
from suas_jax.mesh.plan import MeshPlan, plan_mesh


def plan_section(
    scene: SceneSpec,
    elements: int,
    decay: float,
    local: tuple[float, float] | None = None,
) -> MeshPlan:
    """Mesh of the whole arc for the line loads of a scene.

    Args:
        scene: the scene.
        elements: along the whole arc.
        decay: length over which boundary layers fade, as an angle [rad].
        local: see `plan_mesh`.
    """
    geometry = scene.geometry
    outer = geometry.inner_radius + geometry.thickness
    numbers, spread = [-geometry.half_angle, geometry.half_angle], []
    for load in scene.loads:
        if isinstance(load, LineLoadSpec):
            spread.append(load.spread is not None)
            half = 0.0 if load.spread is None else load.spread / (2 * outer)
            ends = [load.angle - half, load.angle + half]
            numbers += ends if spread[-1] else [load.angle]
    symmetric = _mirror_image(scene)
    return plan_mesh(numbers, spread, elements, decay, symmetric=symmetric, local=local)


def _mirror_image(scene: SceneSpec) -> bool:
    """Whether the loads are their own mirror image."""

    def key(load: LineLoadSpec, sign: int) -> tuple[float, float, float, float]:
        turn = 0.0
        if load.direction == "vertical":
            turn = load.angle  # the turn that points a radial force down
        elif not isinstance(load.direction, str):
            turn = load.direction
        return (sign * load.angle, load.force, sign * turn, load.spread or 0.0)

    loads = [load for load in scene.loads if isinstance(load, LineLoadSpec)]
    given = sorted(key(load, 1) for load in loads)
    mirrored = sorted(key(load, -1) for load in loads)
    return bool(np.allclose(given, mirrored, rtol=1e-12, atol=1e-12)) if loads else True
