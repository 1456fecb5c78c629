"""Dead loads on the pad's outer face: their work and its derivatives.

A load acts at the rigid-normal point x + (t/2) n of the mid-surface x with normal n, which
turns with the shell: a dead force has a stiffness of its own. Load points move freely over
the mesh; displacement and normal are continuous across elements, so is the work.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from suas_jax.mechanics.pad.mid_surface import Vector, components, cross, dot
from suas_jax.mechanics.pad.net import ElementVector, Net
from suas_jax.mechanics.pad.stiffness import (
    COLUMNS,
    ROWS,
    Upper,
    add_blocks,
    no_blocks,
    upper_of,
)
from suas_jax.mesh.pad_plan import PadPlan
from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.bspline import bernstein
from suas_jax.numerics.polynomials import gauss_legendre
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.loads import PadLoad, PadLoadPoints
from suas_jax.skin.section import AbstractSection, Frame

# Points in a clipped element: exact for cubic displacement.
_LOAD_GAUSS = 2


class Spots(NamedTuple):
    """Places on the pad: elements, and the Bernstein polynomials there."""

    element: Int[Array, "2 point"]  # index along the long direction and across [2, point]
    # polynomials by kind of derivative, by arc length and along the axis: itself, by s, by z
    # [kind, 4 * 4, point]
    shapes: Float[Array, "kind 16 point"]
    rest: Frame  # the undeformed section there
    above: Array  # distance of the outer face from the mid-surface [m]


def locate(
    breakpoints: Float[Array, " breakpoint"], x: Float[Array, " point"]
) -> tuple[Int[Array, " point"], Float[Array, " point"], Float[Array, " point"]]:
    """Element, local coordinate in it and its length, of places along one direction."""
    fixed = jax.lax.stop_gradient(breakpoints)
    element = jnp.searchsorted(fixed, jax.lax.stop_gradient(x), side="right") - 1
    element = jnp.clip(element, 0, len(breakpoints) - 2)
    start, end = breakpoints[element], breakpoints[element + 1]
    return element, (x - start) / (end - start), end - start


Places = tuple[Array, list[Array]]


def _directions(
    net: Net, section: AbstractSection, at: tuple[Array, Array]
) -> tuple[Places, Places]:
    """Elements of places along the arc, and along the axis, with the polynomials there.

    The polynomials and their first two derivatives by length [4, point].
    """
    i, xi, span = locate(net.angles, at[0])
    k, eta, length = locate(net.axial, at[1])
    along = [jnp.stack(bernstein(xi, n)) / (section.size * span) ** n for n in range(3)]
    axially = [jnp.stack(bernstein(eta, n)) / length**n for n in range(3)]
    return (i, along), (k, axially)


def spots(
    net: Net,
    section: AbstractSection,  # the undeformed membrane across the axis
    at: tuple[Array, Array],  # reference angles [rad] and axial positions [m]
    # orders of differentiation by arc length and along the axis
    kinds: tuple[tuple[int, int], ...] = ((0, 0), (1, 0), (0, 1)),
) -> Spots:
    """Find places on the pad."""
    (i, along), (k, axially) = _directions(net, section, at)
    shapes = []
    for n, m in kinds:
        first, second = net.topology.ordered(along[n], axially[m])
        shapes.append((first[:, None] * second[None]).reshape(16, -1))
    element = jnp.stack(net.topology.ordered(i, k))
    rest = section.frame(at[0])
    return Spots(element, jnp.stack(shapes), rest, rest.thickness / 2)


def interpolated(spots: Spots, qe: ElementVector) -> Float[Array, "kind 3 point"]:
    """The displacement and its derivatives at places."""
    here = qe.reshape(len(qe), 16, *qe.shape[3:])[:, :, spots.element[0], spots.element[1]]
    return jnp.sum(spots.shapes[:, None] * here, 2)


def on_grid(
    net: Net,
    section: AbstractSection,  # the undeformed membrane across the axis
    at: tuple[Float[Array, " arc"], Float[Array, " axial"]],  # lines of the grid [rad], [m]
    qe: ElementVector,
    kinds: tuple[tuple[int, int], ...],
) -> Float[Array, "kind 3 arc*axial"]:
    """What `interpolated` gives at all crossings of lines, by sums along one and the other."""
    order = net.topology.ordered
    (long, first), (across, second) = order(*_directions(net, section, at))
    here = qe[:, :, :, long]  # [component, 4, 4, place along, element across]
    rows = [jnp.sum(shape[:, None, :, None] * here, 1)[..., across] for shape in first]
    values = []
    for n, m in (order(*kind) for kind in kinds):
        value = jnp.sum(second[m][:, None] * rows[n], 1)
        values.append(value if net.topology.along_arc else jnp.swapaxes(value, -1, -2))
    return jnp.stack(values).reshape(len(kinds), len(qe), -1)


def _arm(r: Float[Array, "2 3 *point"]) -> Vector:
    """Outward unit normal from r,s and r,z."""
    rs, rz = r
    m = cross(components(rz), components(rs))
    size = jnp.sqrt(dot(m, m))
    return m[0] / size, m[1] / size, m[2] / size


def _edges(spots: Spots, moved: Array) -> tuple[Array, Array]:
    """Current r,s and r,z [2, 3, point], and the reference normal."""
    zero = jnp.zeros_like(spots.rest.angle)
    t, n = (jnp.stack([*v, zero]) for v in (spots.rest.tangent, spots.rest.normal))
    z = jnp.stack([zero, zero, zero + 1])
    return jnp.stack([t, z]) + moved[1:3], n


def load_work(points: PadLoadPoints, spots: Spots, moved: Array) -> Array:
    """Work of the loads at unit factor [J].

    `points`: the loads, without lanes. `spots`: where they are. `moved`: displacement and its
    first derivatives there.
    """
    edges, n = _edges(spots, moved)
    arm = jnp.stack(_arm(edges)) - n
    return jnp.sum(points.force * (moved[0] + spots.above * arm))


def load_terms(
    points: PadLoadPoints, spots: Spots, moved: Array
) -> tuple[Float[Array, "3 16 point"], Float[Array, "2 3 2 3 point"]]:
    """First derivative of the work by element unknowns, and the second by r,s and r,z."""
    edges, _ = _edges(spots, moved)

    def projected(r: Float[Array, "2 3"], force: Float[Array, "3"]) -> Array:
        return dot(components(force), _arm(r))

    by_point, forces = (-1, -1), points.force * spots.above
    gradient = jax.vmap(jax.grad(projected), by_point, -1)(edges, forces)
    hessian = jax.vmap(jax.hessian(projected), by_point, -1)(edges, forces)
    vector = points.force[:, None] * spots.shapes[0]
    vector = vector + jnp.sum(gradient[:, :, None] * spots.shapes[1:3, None], 0)
    return vector, hessian


def add_vectors(f: ElementVector, spots: Spots, vector: Array) -> ElementVector:
    """Add the points' vectors to those of their elements."""
    shape = f.shape
    f = f.reshape(3, 16, *shape[3:])
    return f.at[:, :, spots.element[0], spots.element[1]].add(vector).reshape(shape)


def load_bands(net: Net, spots: Spots, hessian: Float[Array, "2 3 2 3 point"]) -> Upper:
    """The second derivative of the work, as upper bands at control values."""
    along, across = net.along, net.across
    long, side = spots.element
    shapes = spots.shapes[1:3].reshape(2, 4, 4, -1)
    shapes = jnp.einsum("iap,kabp->kibp", along[:, :, long], shapes)
    shapes = jnp.einsum("cjbp,kibp->kcijp", across[:, :, :, side], shapes)
    half = jnp.einsum("kcijp,kcldp->cijldp", shapes, hessian)
    blocks = jnp.einsum("cgjldp,ldgmp->gpjmcd", half[:, ROWS], shapes[:, :, COLUMNS])
    return upper_of(add_blocks(net, no_blocks(net), (long, side), blocks))


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
