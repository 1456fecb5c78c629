"""The outline of a section, and on it the wall, the loads and the bodies."""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from matplotlib.axes import Axes

from suas_jax.config import SceneSpec, continuous_inputs
from suas_jax.figures.style import BODY, CONTACT, WALL
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.build import Inputs, Structure
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.program import inputs_of, structure_of
from suas_jax.scene.solve import Solution
from suas_jax.skin.body import Body
from suas_jax.skin.geometry import SkinGeometry

_POINTS = 361
_BODY_REACH = 0.4  # of a body that is drawn, to either side, over the section's size per angle


class Outline(NamedTuple):
    """Curves [2, point] in metres, and where their points are."""

    angle: Any  # as sections define it [rad]
    given: Any  # as scenes tell it [deg]
    arc: Any  # along the inner face from its middle [m]
    inner: Any  # face of the membrane
    outer: Any  # face of the membrane
    wall: Any  # beneath the film
    load_angle: Any  # of the dead loads, in the order of the file [rad]
    load_push: Any  # unit vectors of their forces in the section's plane [load, 2]
    bodies: Any  # their surfaces at first touch, in the order of the file [body, 2, point]
    body_way: Any  # unit vectors along which they come in [body, 2]


def outline(scene: SceneSpec) -> Outline:
    """The section, the loads and the bodies of a scene."""
    at_touch = {
        f"load.{i}.depth": np.zeros(()) for i, x in enumerate(scene.loads) if x.kind == "body"
    }
    if scene.geometry.is_circle:
        found = _outline(Structure(scene), {**continuous_inputs(scene), **at_touch})
    else:
        inputs = inputs_of(scene) | at_touch
        found = COMPILED.run(_COMPILED, structure_of(scene, wall=False), inputs, once=True)
    return Outline(*(np.asarray(x) for x in found))


def _outline(structure: Structure, inputs: Inputs) -> Outline:
    parts = scene_parts(structure.scene, inputs)
    geometry = parts.skin.geometry
    section = geometry.section
    angle = jnp.linspace(-1, 1, _POINTS)[:, None] * section.half_angle
    inner, normal = section.inner_face(angle), section.inner_normal(angle)
    thick = section.thickness(angle)
    signs = [jnp.sign(load.force) for load in parts.forces]
    push = [
        s * load.direction(section)[:2] for s, load in zip(signs, parts.forces, strict=True)
    ]
    return Outline(
        angle[:, 0],
        jnp.rad2deg(section.given_angle(angle))[:, 0],
        section.arc(angle)[:, 0],
        inner[..., 0],
        (inner + thick * normal)[..., 0],
        (inner - geometry.gap(angle) * normal)[..., 0],
        jnp.stack([load.angle for load in parts.forces] or [jnp.zeros(1)])[:, 0],
        jnp.stack(push or [jnp.zeros((2, 1))])[..., 0],
        jnp.stack([_surface(x, geometry) for x in parts.bodies] or [jnp.zeros((2, 1))]),
        jnp.stack([-x.frame[-1, :2, 0] for x in parts.bodies] or [jnp.zeros(2)]),
    )


def _surface(body: Body, geometry: SkinGeometry) -> Array:
    """The side of a body that faces the skin, across the axis [2, point] [m]."""
    reach = _BODY_REACH * geometry.outer_size
    across = jnp.linspace(-1, 1, _POINTS)[:, None] * reach
    place = [across, *(jnp.zeros_like(across) for _ in body.frame[2:])]
    height = body.shape.height(jnp.stack(place))
    inside = jnp.isfinite(height) & (height <= reach)
    edge = jnp.max(jnp.where(inside, jnp.abs(across), 0.0), 0)
    across = jnp.clip(across, -edge, edge)
    place[0] = across
    height = jnp.minimum(body.shape.height(jnp.stack(place)), reach)
    along, out = body.frame[0, :2, None], body.frame[-1, :2, None]
    found: Array = body.origin[:2, None] + across * along + height * out
    return found[..., 0]


_COMPILED = eqx.filter_jit(_outline)


def draw_wall(axes: Axes, solution: Solution, drawn: Outline) -> None:
    """Draw the wall, on axes in millimetres, and on it the zone where the inner face lies."""
    wall = solution.report["wall"]
    # Beneath all else: a membrane beyond it stays visible.
    axes.fill(*(1e3 * drawn.wall), color=WALL, lw=0, zorder=0)
    if wall is not None:
        key, places = ("arc_m", drawn.arc) if "arc_m" in wall else ("angle_deg", drawn.given)
        ends = np.interp(np.asarray(wall[key]), places, drawn.angle)
        label = f"wall carries {wall['force_N']:.4g} N"
        _draw_zone(axes, ends, drawn.angle, 1e3 * drawn.wall, label)


def _draw_zone(axes: Axes, ends: Any, angle: Any, curve: np.ndarray, label: str) -> None:
    """Where something is touched between two angles, on a curve with points at angles."""
    inside = np.linspace(ends[0], ends[1], 99)
    zone = [np.interp(inside, angle, x) for x in curve]
    # Zones are short: the ends of the line show those that are a point on this scale.
    axes.plot(*zone, color=CONTACT, lw=4, solid_capstyle="round", zorder=3, label=label)
    axes.legend(loc="lower center")


_ZONE = ("contact_from_m", "contact_to_m")


def draw_loads(axes: Axes, drawn: Outline, outer: np.ndarray, angle: np.ndarray) -> None:
    """Draw every line load as an arrow that ends at the outer face, on axes in millimetres.

    Of that deformed face there are points [2, point] [mm], and their angles [rad].
    """
    length = 0.18 * np.ptp(outer[0])
    for place, push in zip(drawn.load_angle, drawn.load_push, strict=True):
        if not push.any():  # no load, or none that pushes
            continue
        at = outer[:, int(np.argmin(np.abs(angle - place)))]
        axes.annotate(
            "",
            xy=tuple(at),
            xytext=tuple(at - length * push),
            arrowprops={"arrowstyle": "-|>", "color": CONTACT, "lw": 1.5},
        )
        axes.update_datalim([at - length * push])


def draw_bodies(
    axes: Axes, solution: Solution, drawn: Outline, outer: np.ndarray, angle: np.ndarray
) -> None:
    """Draw the bodies of a solved section, and the zones where the skin touches them.

    The other arguments are those of `draw_loads`.
    """
    found = [load for load in solution.report["loads"] if load["kind"] == "body"]
    reports = zip(found, drawn.bodies, drawn.body_way, strict=False)
    for load, surface, way in reports:
        moved = 1e3 * (surface + load["depth_m"] * way[:, None])
        axes.fill(*moved, color=BODY, lw=0, zorder=0)
        axes.plot(*moved, color="0.3", lw=1)
        if load["zones"] == 0:
            continue
        along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(drawn.outer), axis=0))])
        along += load["arc_position_m"] - np.interp(_angle(load, drawn), drawn.angle, along)
        places = [load["arc_position_m"] + load[key] for key in _ZONE]
        ends = np.interp(places, along, drawn.angle)
        label = f"body presses with {load['force_N']:.4g} N"
        _draw_zone(axes, ends, angle, outer, label)


def _angle(load: dict[str, Any], drawn: Outline) -> float:
    """Where a load of a report is, as sections define angles [rad]."""
    if "arc_m" in load:
        return float(np.interp(load["arc_m"], drawn.arc, drawn.angle))
    return float(np.interp(load["angle_deg"], drawn.given, drawn.angle))
