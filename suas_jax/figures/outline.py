"""The undeformed section of a scene as points to draw, and its loads."""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from suas_jax.config import SceneSpec, continuous_inputs
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.program import inputs_of, structure_of
from suas_jax.scene.structure import Inputs, Structure

_POINTS = 361


class Outline(NamedTuple):
    """Curves [2, point] in metres, and where their points are.

    Attributes:
        angle: as sections define it [rad].
        given: as scenes tell it [deg].
        arc: along the inner face from its middle [m].
        inner: face of the membrane.
        outer: face of the membrane.
        wall: beneath the film.
        load_angle: of the dead loads, in the order of the file [rad].
        load_push: unit vectors of their forces in the section's plane [load, 2].
    """

    angle: Any
    given: Any
    arc: Any
    inner: Any
    outer: Any
    wall: Any
    load_angle: Any
    load_push: Any


def outline(scene: SceneSpec) -> Outline:
    """The section and the loads of a scene."""
    if scene.geometry.is_circle:
        found = _outline(Structure(scene), continuous_inputs(scene))
    else:
        found = COMPILED.run(
            _COMPILED, structure_of(scene, wall=False), inputs_of(scene), once=True
        )
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
    )


_COMPILED = eqx.filter_jit(_outline)
