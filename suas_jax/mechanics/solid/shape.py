"""The deformed solid, recovered from its unknowns: positions, stretches."""

import functools

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.mechanics.base import Displacements, Profile
from suas_jax.mechanics.solid.element import NODES, located, node_weights, quadratic
from suas_jax.mechanics.solid.layout import Layout
from suas_jax.numerics.array_types import StationVector
from suas_jax.skin.prestress import Growth

Nodes = Float[Array, "9 2 layer element lane"]


def face_stretch(
    angles: Float[Array, "station #lane"],
    rest: tuple[Array, Array],
    current: tuple[Array, Array],
) -> Float[Array, "3 element lane"]:
    """Hoop stretch of a face at the left, middle and right node of every element.

    Nodes are two orders more accurate than the elements' derivatives: the stretch is that
    of the quartics through five neighbouring nodes. Wherever the face is smooth this is
    good for a hundredth of the error; at the clamps' corners nothing is. The undeformed
    face is differentiated alike: where its curvature jumps, so does its length per angle, and
    what quartics across the jump make of it cancels.

    `angles`: of the stations [rad]. `rest`, `current`: positions of the face's nodes at the
    stations and half-way between them, [2, station, lane] and [2, element, lane] [m].
    """

    def woven(ends: Array, between: Array) -> Array:
        """All nodes along the face, on the last axis but one."""
        pairs = jnp.stack([ends[..., :-1, :], between], -2)
        nodes = pairs.reshape(*ends.shape[:-2], -1, ends.shape[-1])
        return jnp.concatenate([nodes, ends[..., -1:, :]], -2)

    angle = woven(angles, (angles[1:] + angles[:-1]) / 2)
    x = jnp.stack(jnp.broadcast_arrays(woven(*current), woven(*rest)))
    count = angle.shape[0]
    reach = min(5, count)
    first = np.clip(np.arange(count) - reach // 2, 0, count - reach)
    near = [angle[first + k] for k in range(reach)]
    slope = jnp.zeros_like(x)
    for j in range(reach):
        others = [k for k in range(reach) if k != j]
        weight = jnp.zeros_like(angle)
        for m in others:
            factors = [(angle - near[k]) / (near[j] - near[k]) for k in others if k != m]
            weight = weight + functools.reduce(jnp.multiply, factors) / (near[j] - near[m])
        slope = slope + weight * x[:, :, first + j]
    deformed, undeformed = jnp.sqrt(jnp.sum(slope**2, 1))
    stretch = deformed / undeformed
    return jnp.stack([stretch[:-1:2], stretch[1::2], stretch[2::2]])


def _line(
    values: Nodes, xi: Float[Array, "sample #element #lane"], node: tuple[int, int], order: int
) -> Float[Array, "component sample element lane"]:
    """A nodal field, or its derivative by xi, along a line of nodes.

    `values`: of the nodes. `xi`: local coordinate along the arc, -1 to 1. `node`: layer, and
    position of the line across it. `order`: of the derivative.
    """
    layer, across = node
    nodes = [values[NODES.index((a, across)), :, layer] for a in range(3)]
    parts = [n * v[:, None] for n, v in zip(quadratic(xi, order), nodes, strict=True)]
    return parts[0] + parts[1] + parts[2]


def displacements(xi: Float[Array, "sample #element #lane"], u: Nodes) -> Displacements:
    """Displacements at one local coordinate of every element.

    `xi`: local coordinate along the arc, -1 to 1. `u`: displacements of the nodes.
    """
    layers = u.shape[2]
    # The middle line of nodes lies between two layers or inside one.
    middle = (layers // 2, layers % 2)
    return Displacements(_line(u, xi, middle, 0), _line(u, xi, (0, 0), 0))


def section(
    angle: Float[Array, "sample element lane"],  # reference angle [rad]
    rest: Float[Array, "2 sample element lane"],  # undeformed inner face [m]
    xi: Float[Array, "sample #element #lane"],
    u: Nodes,  # displacements of the nodes
    x: Nodes,  # reference positions of the nodes
    inner_stretch: Float[Array, "3 element lane"],
    growth: Growth | None,  # of the membrane; None where it fits its seat
) -> Profile:
    """The deformed section at one local coordinate of every element.

    `xi`: local coordinate along the arc, -1 to 1. `inner_stretch`: of the inner face at its
    nodes, see `face_stretch`.
    """
    outer = (u.shape[2] - 1, 2)
    along = _line(x, xi, outer, 1)
    now = along + _line(u, xi, outer, 1)
    moved = displacements(xi, u)
    nodes = zip(quadratic(xi), inner_stretch, strict=True)
    free = 1.0 if growth is None else jnp.exp(growth.hoop)
    return Profile(
        angle=angle,
        rest=rest,
        mid_displacement=moved.mid_displacement,
        inner_displacement=moved.inner_displacement,
        outer_displacement=_line(u, xi, outer, 0),
        inner_stretch=functools.reduce(jnp.add, [n * stretch for n, stretch in nodes]) / free,
        outer_stretch=jnp.sqrt(jnp.sum(now**2, 0) / jnp.sum(along**2, 0)) / free,
    )


def mirrored(layout: Layout, q: StationVector) -> StationVector:
    """Unknowns of the whole arc from those of the left half of a symmetric one."""
    sides = jnp.array([-1.0, 1.0] * layout.nodes)[:, None, None]
    modes = jnp.repeat(jnp.array([1.0, -1.0, 1.0]), layout.layers)[:, None, None]
    inner = jnp.concatenate([sides, modes])
    stations, inside = layout.split(q)
    return layout.joined(
        jnp.concatenate([stations, sides * stations[:, -2::-1]], 1),
        jnp.concatenate([inside, inner * inside[:, ::-1]], 1),
    )


def joined_along(layout: Layout, q: StationVector) -> StationVector:
    """The same deformation on elements joined in pairs along the arc.

    A last one without a partner stays as it is.
    """
    stations, middles = layout.lines(q)
    _, p = layout.gather(q)
    pairs = layout.elements // 2 * 2
    lone = layout.elements > pairs
    kept = jnp.concatenate(
        [stations[:, :, : pairs + 1 : 2], stations[:, :, layout.elements :][:, :, :lone]], 2
    )
    between = jnp.concatenate([stations[:, :, 1:pairs:2], middles[:, :, pairs:]], 2)
    joined = _joined_modes(p[:, :, :pairs], 2, 1)
    p = jnp.concatenate([joined, p[:, :, pairs:]], 2)
    return _assembled(Layout(kept.shape[2] - 1, layout.layers), kept, between, p)


def joined_across(layout: Layout, q: StationVector) -> StationVector:
    """The same deformation on layers joined in pairs; their number is even."""
    coarse = Layout(layout.elements, layout.layers // 2)
    nodes = node_weights(*located(layout.layer_ends, coarse.heights), layout.layers)
    stations, middles = (jnp.einsum("cn,xn...->xc...", nodes, x) for x in layout.lines(q))
    _, p = layout.gather(q)
    heights = np.diff(layout.layer_ends)
    first = jnp.asarray(heights[::2] / (heights[::2] + heights[1::2]))
    joined = _joined_modes(p, 1, 2, first[:, None, None])
    return _assembled(coarse, stations, middles, joined)


def _assembled(layout: Layout, stations: Array, middles: Array, p: Array) -> StationVector:
    """Unknowns from displacements of stations and of what lies half-way, and pressures."""

    def rows(x: Array) -> Array:
        return jnp.swapaxes(x, 0, 1).reshape(-1, *x.shape[2:])

    inside = jnp.concatenate([rows(middles), p.reshape(-1, *p.shape[2:])])
    return layout.joined(rows(stations), inside)


def _joined_modes(
    p: Float[Array, "3 layer element lane"],  # pressure modes
    axis: int,  # along which elements lie side by side
    mode: int,  # the one that is linear along it
    # of a pair's length that its first element has
    share: Float[Array, "layer 1 1"] | float = 0.5,
) -> Float[Array, "3 layer element lane"]:
    """Best linear fit to the pressures of pairs of elements, side by side along an axis."""
    index = [slice(None)] * 4
    first, second = (p[(*index[:axis], slice(i, None, 2))] for i in range(2))
    rest = 1 - share
    mean = share * first + rest * second
    slope = 3 * share * rest * (second[0] - first[0])
    slope = slope + share**2 * first[mode] + rest**2 * second[mode]
    return mean.at[mode].set(slope)
