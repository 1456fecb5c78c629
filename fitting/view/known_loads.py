"""The loads of a solved scene on the page: arrows at known places, and bodies."""

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.estimate.estimate import Contact
from fitting.view.picture import Grid
from suas_jax.config import SceneSpec
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.program import inputs_of
from suas_jax.skin.body_shapes import AbstractShape
from suas_jax.skin.plain import plain_geometry

_HALF_WIDTHS = "contact_half_width_m", "contact_half_width_axial_m"
_REACH = 0.4  # of a body that is drawn, in lengths of the section per angle
_RAYS, _RINGS = 48, 17  # of a surface: directions from the tip, and points along each
_HALVINGS = 40


def known_contacts(
    scene: SceneSpec, grid: Grid, loads: Sequence[dict[str, Any]]
) -> dict[int, Contact]:
    """The scene's loads that have a place, by their number.

    `scene`: says how forces are directed. `loads`: what is observed of them.
    """
    found = {}
    for i, (spec, load) in enumerate(zip(scene.loads, loads, strict=True)):
        if spec.kind == "pressure":
            continue
        angle, arc = np.deg2rad(load["angle_deg"]), load.get("arc_m")
        way = "radial" if spec.kind == "body" else spec.direction
        turn = way if isinstance(way, float) else 0.0
        if way == "vertical":
            told = ("angle", angle) if arc is None else ("arc", arc)
            turn = grid.direction(float(grid.places.from_place(told[0], np.asarray(told[1]))))
        axial = None if spec.kind == "line" else load.get("axial_m")
        by_arc = not scene.geometry.has_angle
        found[i] = Contact(
            angle, load["force_N"], turn, None, axial=axial, arc=arc, by_arc=by_arc
        )
    return found


def body_rows(loads: Sequence[dict[str, Any]]) -> list[tuple[str, str]]:
    """Travel, force and zone of contact of each body, for the page's table."""
    return [
        (f"body {i + 1}" if len(loads) > 1 else "body", _body(load))
        for i, load in enumerate(loads)
        if "depth_m" in load
    ]


def _body(load: dict[str, Any]) -> str:
    force, depth = load["force_N"], 1e3 * load["depth_m"]
    if force <= 0:
        return f"{depth:.3f} mm, touches nothing"
    zone = [2e3 * load[key] for key in _HALF_WIDTHS if key in load]
    over = " by ".join(f"{x:.1f}" for x in zone) + " mm"
    if not load["contact_resolved"]:
        over = "a zone smaller than the mesh"
    return f"{depth:.3f} mm, {force:.3f} N, over {over}"


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
