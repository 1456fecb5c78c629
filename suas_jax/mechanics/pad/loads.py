"""Dead loads on the pad's outer face: their work and its derivatives.

A load acts at the rigid-normal point x + (t/2) n of the mid-surface x with normal n, which
turns with the shell: a dead force has a stiffness of its own. Load points move freely over
the mesh; displacement and normal are continuous across elements, so is the work.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
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
from suas_jax.numerics.bspline import bernstein
from suas_jax.skin.loads import PadLoadPoints
from suas_jax.skin.section import AbstractSection, Frame


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
