"""What the wall carries, and where the membrane lies on it."""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from suas_jax.mechanics.base import ContactState
from suas_jax.numerics.array_types import Lanes
from suas_jax.skin.circle import Circle
from suas_jax.skin.geometry import SkinGeometry

Grid = Float[Array, "along line lane"]


def contact_zone(contact: ContactState, geometry: SkinGeometry) -> dict[str, Any]:
    """Force, area and extent of contact; the extent means something only where there is one.

    Args:
        contact: the inner face at its contact points.
        geometry: of the skin.
    """
    force = jnp.sum(contact.area * contact.pressure, (0, 1))
    if contact.axial is None:  # a section: point after point along the arc
        gap, angle = (
            jnp.moveaxis(jnp.broadcast_to(x, contact.gap.shape), 1, 0).reshape(
                -1, 1, contact.gap.shape[-1]
            )
            for x in (contact.gap, contact.polar_angle)
        )
        start, end, covered = _closed(gap, angle)
        half = geometry.width / 2
        force, width = force * geometry.width, geometry.width
        axial = [-half, half]
    else:
        start, end, covered = _closed(contact.gap, contact.polar_angle)
        across = [jnp.swapaxes(x, 0, 1) for x in (contact.gap, contact.axial)]
        axial = list(_closed(*across)[:2])
        steps = jnp.diff(jnp.mean(contact.axial, 0), axis=0) / 2
        width = jnp.pad(steps, ((1, 0), (0, 0))) + jnp.pad(steps, ((0, 1), (0, 0)))
    section = geometry.section
    places = {"angle_deg": [jnp.rad2deg(section.given_angle(x)) for x in (start, end)]}
    if not isinstance(section, Circle):
        places["arc_m"] = [section.arc(x) for x in (start, end)]
    return {
        "force_N": force,
        "area_m2": jnp.sum(covered * width, 0) * geometry.wall_size,
        **places,
        "axial_m": axial,
    }


def _closed(gap: Grid, place: Grid) -> tuple[Lanes, Lanes, Float[Array, "line lane"]]:
    """Where the gap is closed along lines; between two points it is taken as linear.

    Returns:
        Smallest and largest place over all lines, and the extent on each line.
    """
    first, second = gap[:-1], gap[1:]
    crosses = (first < 0) != (second < 0)
    share = jnp.where(crosses, first / jnp.where(crosses, first - second, 1.0), 0.0)
    crossing = place[:-1] + share * (place[1:] - place[:-1])
    closed = (first < 0) | (second < 0)
    start = jnp.where(closed, jnp.where(first < 0, place[:-1], crossing), jnp.inf)
    end = jnp.where(closed, jnp.where(second < 0, place[1:], crossing), -jnp.inf)
    covered = jnp.sum(jnp.where(closed, end - start, 0.0), 0)
    return jnp.min(start, (0, 1)), jnp.max(end, (0, 1)), covered
