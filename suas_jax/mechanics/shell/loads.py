"""Dead loads on the lumped shell's outer face: their work and its derivatives.

A load acts at the rigid-normal point x + (t/2) n of the mid-line x with normal n, which
turns with the shell: a dead force has a stiffness of its own.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.jet import second_order
from suas_jax.numerics.polynomials import hermite
from suas_jax.skin.loads import LoadPoints
from suas_jax.skin.section import AbstractSection

# Points up to which their terms are written out one by one.
_FEW_POINTS = 4

ElementVector = Float[Array, "4 2 element lane"]


class Loaded(NamedTuple):
    """The mid-line under the load points [..., point, lane]."""

    at: Float[Array, "4 point lane"]  # shape functions
    # their derivatives by arc length, per unit of the scaled unknowns [1/m]
    slope: Float[Array, "4 point lane"]
    displacement: Float[Array, "2 point lane"]  # of the mid-line [m]
    r1: tuple[Array, Array]  # its current tangent r'(s)
    normal: Float[Array, "2 point lane"]  # its reference normal
    half: Array  # half the thickness [m]


def under(
    points: LoadPoints,  # the loads
    qe: ElementVector,  # element unknowns [shape, component]
    angles: Float[Array, "station #lane"],
    section: AbstractSection,
) -> Loaded:
    """Evaluate the mid-line at the load points. `angles`: of the stations [rad]."""
    start, span = _elements_of(points, angles)
    at = hermite(points.xi)
    slope = hermite(points.xi, 1) / (section.size * span)
    qp = jnp.sum(qe[:, :, :, None] * points.select, 2)
    u1 = jnp.sum(slope[:, None] * qp, 0)
    frame = section.frame(start + points.xi * span)
    t = frame.tangent
    r1 = (t[0] + u1[0], t[1] + u1[1])
    moved, half = jnp.sum(at[:, None] * qp, 0), frame.thickness / 2
    return Loaded(at, slope, moved, r1, frame.normal, half)


def places(
    points: LoadPoints, angles: Float[Array, "station #lane"]
) -> Float[Array, "point lane"]:
    """Angles of the load points between stations at given ones [rad]."""
    start, span = _elements_of(points, angles)
    return start + points.xi * span


def _elements_of(
    points: LoadPoints, angles: Float[Array, "station #lane"]
) -> tuple[Float[Array, "point lane"], Float[Array, "point lane"]]:
    """Angle where the element of every point starts, and the one that it spans [rad]."""
    select = points.select
    start = jnp.sum(select * angles[:-1, None], 0)
    return start, jnp.sum(select * (angles[1:] - angles[:-1])[:, None], 0)


def load_work(points: LoadPoints, loaded: Loaded) -> Lanes:
    """Work of the loads at unit factor, per width [J/m]."""
    x, y = loaded.r1
    size = jnp.sqrt(x**2 + y**2)
    turned = jnp.stack([-y / size, x / size]) - loaded.normal
    moved = loaded.displacement + loaded.half * turned
    return jnp.sum(points.force * moved, (0, 1))


def load_terms(
    points: LoadPoints, loaded: Loaded
) -> tuple[ElementVector | float, Float[Array, "4 4 2 2 element lane"] | float]:
    """First and second derivative of the work by the element unknowns."""
    fx, fy = points.force

    def projected(x: Array, y: Array) -> Array:
        return (fy * x - fx * y) / jnp.sqrt(x**2 + y**2)

    jet = second_order(projected, *loaded.r1)
    half, slope, select = loaded.half, loaded.slope, points.select
    gradient = half * jnp.stack([jet.x, jet.y])
    curvature = half * jnp.stack([jnp.stack([jet.xx, jet.xy]), jnp.stack([jet.xy, jet.yy])])
    vector = loaded.at[:, None] * points.force + slope[:, None] * gradient
    count = select.shape[1]
    if count > _FEW_POINTS:
        matrix = slope[:, None, None, None] * slope[None, :, None, None] * curvature
        return (
            jnp.einsum("ncpl,epl->ncel", vector, select),
            jnp.einsum("nmcdpl,epl->nmcdel", matrix, select),
        )
    # Term by term, the few points of line loads become part of the loop that uses them; a
    # contraction or a reduction would store zeros for most elements.
    vectors: ElementVector | float = 0.0
    matrices: Array | float = 0.0
    for p in range(count):
        vectors = vectors + vector[:, :, p, None] * select[:, p]
        rows, columns = slope[:, None, p], slope[None, :, p]
        bending = curvature[:, :, p, None] * select[:, p]
        matrices = matrices + (rows * columns)[:, :, None, None, None] * bending
    return vectors, matrices
