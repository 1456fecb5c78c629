"""The points at which a pad's loads act, for the mesh and the inputs at hand."""

from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from suas_jax.mesh.pad_plan import PadPlan
from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.polynomials import gauss_legendre
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.loads import PadLoad, PadLoadPoints

# Points in a clipped element: exact for cubic displacement.
_LOAD_GAUSS = 2


def pad_load_points(
    plan: PadPlan, geometry: SkinGeometry, loads: Sequence[PadLoad]
) -> PadLoadPoints:
    """The points that the loads act at, for the inputs at hand.

    Rectangles and lines have Gauss points in every element that they reach over, clipped to
    it; discs have points of their own rule, whatever the elements: displacements have two
    continuous derivatives, so both converge fast. Where the plan is mirrored only the points
    of the modelled part count.

    `geometry`: dimensions, with a lane axis. `loads`: in the order of the plan.
    """
    leaves = jax.tree.leaves((geometry, loads))
    lanes = max(x.shape[-1] for x in leaves)
    if not loads:
        none = jnp.zeros((0, lanes))
        return PadLoadPoints(none, none, jnp.zeros((3, 0, lanes)))
    breaks = plan.breakpoints(geometry)
    found = []
    for load, spread, disc in zip(loads, plan.spread, plan.discs, strict=True):
        arc, length = load.extent()
        section = geometry.section
        above = section.thickness(load.angle) / 2
        above = above + geometry.thickness_beyond_mean(load.angle, load.axial)
        local = section.size * (1 + section.curvature(load.angle) * above)
        inputs = (load.angle, load.axial, arc / local, length)
        rule = _disc_rule(spread, plan.mirrored) if disc else _rectangle_rule(spread)
        spread_out = [jnp.broadcast_to(x, (*x.shape[:-1], lanes)) for x in (*breaks, *inputs)]
        angle, axial, weight = jax.vmap(rule, -1, -1)(*spread_out)
        force = (load.force * load.direction(section))[:, None] * weight
        found.append((angle, axial, force))
    angle, axial, force = (jnp.concatenate(x, -2) for x in zip(*found, strict=True))
    return PadLoadPoints(angle, axial, force)


Rule = Callable[..., tuple[Array, Array, Array]]


def _rectangle_rule(spread: tuple[int, int]) -> Rule:
    def rule(
        arc_breaks: Array,
        axial_breaks: Array,
        angle: Lanes,
        axial: Lanes,
        arc: Lanes,
        length: Lanes,
    ) -> tuple[Array, Array, Array]:
        x, wx = _clipped(arc_breaks, angle, arc, spread[0])
        z, wz = _clipped(axial_breaks, axial, length, spread[1])
        shape = (len(x), len(z))
        return (
            jnp.broadcast_to(x[:, None], shape).reshape(-1),
            jnp.broadcast_to(z, shape).reshape(-1),
            (wx[:, None] * wz).reshape(-1),
        )

    return rule


def _clipped(breaks: Array, centre: Array, half: Array, reach: int) -> tuple[Array, Array]:
    """Points of an interval, element by element, and their shares of it."""
    if reach == 0:  # a point; on a mirror plane half of it is modelled
        inside = (centre > breaks[0]) & (centre < breaks[-1])
        on_edge = (centre == breaks[0]) | (centre == breaks[-1])
        return centre[None], (inside + 0.5 * on_edge)[None]
    low, high = centre - half, centre + half
    fixed = jax.lax.stop_gradient(breaks)
    first = jnp.searchsorted(fixed, jax.lax.stop_gradient(low), side="right") - 1
    index = jnp.clip(first, 0, len(breaks) - 1 - reach) + np.arange(reach)
    a, b = (jnp.clip(breaks[k], low, high) for k in (index, index + 1))
    x, w = gauss_legendre(_LOAD_GAUSS)
    points = a[:, None] + (b - a)[:, None] * x
    # A share of zero length may lie outside the mesh, where no element is.
    points = jnp.clip(points, fixed[0], fixed[-1])
    return points.reshape(-1), ((b - a)[:, None] * w).reshape(-1) / (2 * half)


def _disc_rule(spread: tuple[int, int], mirrored: tuple[bool, bool]) -> Rule:
    """Gauss points in the square of the radius, evenly spaced around."""
    radial, around = spread
    square, weights = gauss_legendre(radial)
    turn = 2 * np.pi * (np.arange(around) + 0.5) / around
    x, z = (np.sqrt(square)[:, None] * f(turn) for f in (np.cos, np.sin))
    share = np.repeat(weights / around, around)

    def rule(
        arc_breaks: Array,
        axial_breaks: Array,
        angle: Array,
        axial: Array,
        arc: Array,
        length: Array,
    ) -> tuple[Array, Array, Array]:
        angles, positions = angle + arc * x.reshape(-1), axial + length * z.reshape(-1)
        weight = jnp.asarray(share)
        for place, breaks, half in (
            (angles, arc_breaks, mirrored[0]),
            (positions, axial_breaks, mirrored[1]),
        ):
            if half:
                weight = weight * jnp.where(place == breaks[-1], 0.5, place < breaks[-1])
        return angles, positions, weight

    return rule
