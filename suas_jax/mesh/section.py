"""The mesh of a scene's section: where its clamps and loads put the breakpoints."""

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np

from suas_jax.config import BodyLoadSpec, LineLoadSpec, SceneSpec, continuous_inputs
from suas_jax.mesh.plan import MeshPlan, breakpoints, plan_mesh
from suas_jax.skin.loads import LineLoad, angle_of
from suas_jax.skin.plain import check_places, plain_geometry
from suas_jax.skin.section import AbstractSection


def plan_section(
    scene: SceneSpec,
    elements: int,  # along the whole arc
    decay: float,  # length over which boundary layers fade, as an angle [rad]
    local: tuple[float, float] | None = None,  # see `plan_mesh`
    # angle from where each body comes in to the material that it touches, in the order of the
    # file [rad]; none for nowhere
    slid: Sequence[float] = (),
) -> MeshPlan:
    """Mesh of the whole arc for the line loads of a scene."""
    spread = [load.spread is not None for load in scene.loads if isinstance(load, LineLoadSpec)]
    found = measures(scene)
    numbers = found.angles
    symmetric = scene.solve.symmetry and found.symmetric and _mirror_image(scene, numbers)
    away = np.zeros(len(numbers))
    first = 2 + len(spread) + sum(spread)  # after the clamps' and the lines'
    away[first : first + len(slid)] = slid
    return plan_mesh(
        numbers, spread, elements, decay, symmetric=symmetric, local=local, slid=away.tolist()
    )


class Measures(NamedTuple):
    """What a mesh needs to know of a scene's section, as plain numbers."""

    angles: tuple[float, ...]  # of the breakpoints in the order of a plan [rad]
    # angles of the dead loads and bodies, in the order of the file [rad]
    places: tuple[float, ...]
    half_angle: float  # of the right clamp [rad]
    size: float  # length of the mid-line per angle [m]
    symmetric: bool  # whether the section is its own mirror image


@functools.lru_cache(maxsize=64)
def measures(scene: SceneSpec) -> Measures:
    """Plain numbers of a scene's section and of the places of its loads."""
    geometry = plain_geometry(scene.geometry)
    section = geometry.section
    loads = {f"load.{i}": spec for i, spec in enumerate(scene.loads) if spec.kind != "pressure"}
    check_places(scene.geometry, loads)
    known = continuous_inputs(scene)
    numbers = {k: np.array([v]) for k, v in known.items() if k.startswith("load.")}

    def found(section: AbstractSection) -> tuple[list[Any], list[Any]]:
        lines, places, touched = [], [], []
        for key, spec in loads.items():
            value = functools.partial(_numbered, numbers, key)
            if isinstance(spec, LineLoadSpec):
                lines.append(LineLoad.of(spec, section, value))
            places.append(angle_of(spec, section, value))
            if spec.kind == "body":
                touched.append(places[-1])
        return breakpoints(section, lines, touched), places

    run = found if scene.geometry.is_circle else eqx.filter_jit(found)
    ends, middles = (tuple(float(x[0]) for x in group) for group in run(section))
    half, size = (float(x[0]) for x in (section.half_angle, section.size))
    return Measures(ends, middles, half, size, geometry.symmetric)


def _numbered(numbers: dict[str, Any], load: str, key: str) -> Any:
    return numbers.get(f"{load}.{key}", np.zeros(1))


def _mirror_image(scene: SceneSpec, numbers: Sequence[float]) -> bool:
    """Whether the loads are their own mirror image."""

    def key(load: LineLoadSpec | BodyLoadSpec, middle: float, sign: int) -> tuple[Any, ...]:
        if isinstance(load, BodyLoadSpec):
            own = (load.shape, load.radius, load.opening, load.depth, load.force, load.friction)
            along = (load.drag or 0.0, load.tangential_force or 0.0)
            return (str(own), sign * middle, *(sign * x for x in along))
        turn = 0.0
        if load.direction == "vertical":
            turn = middle  # the turn that points a radial force down
        elif not isinstance(load.direction, str):
            turn = load.direction
        return ("", sign * middle, load.force, sign * turn, load.spread or 0.0)

    loads: list[tuple[LineLoadSpec | BodyLoadSpec, float]] = []
    at = 2
    for load in scene.loads:
        if isinstance(load, LineLoadSpec):
            ends = numbers[at : at + (1 if load.spread is None else 2)]
            loads.append((load, sum(ends) / len(ends)))
            at += len(ends)
    for load in scene.loads:  # whose breakpoints come after those of the lines
        if isinstance(load, BodyLoadSpec):
            loads.append((load, numbers[at]))
            at += 1
    given = sorted(key(*load, 1) for load in loads)
    mirrored = sorted(key(*load, -1) for load in loads)
    return all(
        a[0] == b[0] and np.allclose(a[1:], b[1:], rtol=1e-12, atol=1e-12)
        for a, b in zip(given, mirrored, strict=True)
    )
