"""The undeformed section of a scene as points to draw, and its loads."""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from suas_jax.config import SceneSpec, continuous_inputs
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.program import inputs_of, structure_of
from suas_jax.scene.structure import Inputs, Structure
from suas_jax.skin.body import Body
from suas_jax.skin.geometry import SkinGeometry

_POINTS = 361
_BODY_REACH = (
    0.4  # of a body that is drawn, to either side, in lengths of the section per angle
)


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
