"""Bodies whose travel ends over a clamped edge, which geometry alone tells."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from suas_jax.config import SceneSpec
from suas_jax.config.errors import ConfigError, Mistake
from suas_jax.config.quantities import format_quantity
from suas_jax.equilibrium.validity import ON_CLAMP
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.program import inputs_of, structure_of
from suas_jax.scene.structure import Inputs, Structure
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.section import outward

_ALONG_EDGE = 801  # places along a pad's clamped edge


def check_bodies(scene: SceneSpec) -> None:
    """Refuse travels that end over a clamped edge, which needs no solution to be known.

    Where a body that is pulled along by a force ends is not known before.
    Raises ConfigError: names the travel and what is possible there.
    """
    bodies = [(i, load) for i, load in enumerate(scene.loads) if load.kind == "body"]
    travels = {i: x.depth for i, x in bodies if x.depth is not None and not x.pulled}
    if not travels:
        return
    static = structure_of(scene, wall=False)
    rooms = COMPILED.run(_rooms, static, inputs_of(scene), once=True)
    over, wrong = ON_CLAMP * scene.geometry.mean_thickness, []
    for (i, _), room in zip(bodies, map(float, rooms), strict=True):
        depth = travels.get(i, 0.0)
        if depth <= max(room, 0.0) + over:
            continue
        most = "it meets one at first touch"
        if room > over:
            size = format_quantity(float(f"{room:.3g}"), "length")
            most = f"less than {size} is possible there"
        advice = (
            "the body would lie over a clamped edge, which does not give way: "
            f"{most}; press it less deep or elsewhere, or give it a smaller size"
        )
        shown = f'"{format_quantity(depth, "length")}"'
        wrong.append(Mistake("scene", f"load.{i}.depth", advice, shown))
    if wrong:
        raise ConfigError(wrong)


@eqx.filter_jit
def _rooms(scene: Structure, inputs: Inputs) -> list[Array]:
    """Travels at which the bodies of a scene meet a clamped edge [m]."""
    parts = scene_parts(scene.scene, inputs)
    edges = _clamped_edges(parts.skin.geometry, pad=scene.scene.geometry.dimension == 3)
    return [jnp.min(body.room(edges)) for body in parts.bodies]


def _clamped_edges(geometry: SkinGeometry, *, pad: bool) -> Array:
    """Places on the edges of the undeformed outer face [component, point, lane] [m]."""
    section, half = geometry.section, geometry.half_angle

    def face(share: Array) -> Array:
        angle = share[:, None] * half
        height = section.thickness(angle) / 2
        return section.mid_line(angle) + height * outward(section.direction(angle))

    ends, share = jnp.array([-1.0, 1.0]), jnp.linspace(-1.0, 1.0, _ALONG_EDGE)
    if not pad:
        return face(ends)
    axial, end = share[:, None] * geometry.width / 2, geometry.width / 2
    straight = [(face(jnp.full_like(share, k)), axial) for k in (-1.0, 1.0)]
    curved = [(face(share), jnp.broadcast_to(k * end, axial.shape)) for k in (-1.0, 1.0)]
    edges = [jnp.concatenate([x, z[None]]) for x, z in (*straight, *curved)]
    return jnp.concatenate(edges, 1)
