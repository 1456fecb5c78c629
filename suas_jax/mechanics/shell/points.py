"""The lumped shell at the quadrature points of its elements: strains, stress, tangent."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.numerics.polynomials import gauss_legendre, hermite
from suas_jax.skin.section import Frame


class Tables(NamedTuple):
    """Constants of one element on the unit interval."""

    xi: np.ndarray  # [gauss]
    weights: np.ndarray  # [gauss]
    derivatives: np.ndarray  # [gauss * order, shape], orders 1 and 2
    force: np.ndarray  # [shape, gauss * order]
    stiffness: np.ndarray  # [shape * shape, gauss * order * order]
    area: np.ndarray  # [shape, shape], antisymmetric


def derivatives(xi: np.ndarray) -> Float[np.ndarray, "point*order shape"]:
    """First and second derivatives of the shape functions at local coordinates."""
    return np.stack([hermite(xi, k).T for k in (1, 2)], 1).reshape(-1, 4)


def element_tables(gauss: int) -> Tables:
    """Tables for a number of quadrature points."""
    xi, weights = gauss_legendre(gauss)
    d = derivatives(xi).reshape(gauss, 2, 4)
    force = np.einsum("g,gdn->ngd", weights, d).reshape(4, -1)
    stiffness = np.einsum("g,gdn,gfm->nmgdf", weights, d, d).reshape(16, -1)
    x, w = gauss_legendre(4)  # exact: products of cubics and their slopes
    product = np.einsum("g,ng,mg->nm", w, hermite(x), hermite(x, 1))
    return Tables(xi, weights, d.reshape(-1, 4), force, stiffness, (product.T - product) / 2)


def mix(matrix: np.ndarray, x: Array) -> Array:
    """Apply a constant matrix to the leading axis: one product for all elements and lanes."""
    flat = jnp.asarray(matrix) @ x.reshape(x.shape[0], -1)
    return flat.reshape(matrix.shape[0], *x.shape[1:])


class Points(NamedTuple):
    """Kinematics: r' and r'' of the current mid-line r(s), and the two strains."""

    r: tuple[tuple[Array, Array], tuple[Array, Array]]  # [order][component]
    stretch: Float[Array, "point element lane"]  # A = a - 1
    curvature: Float[Array, "point element lane"]  # b = c/a - 1/R


class Moments(NamedTuple):
    """Derivatives of the energy density."""

    first: tuple[Array, Array]  # by A, b
    second: tuple[Array, Array, Array]  # by AA, Ab, bb


def kinematics(
    u1: tuple[Array, Array],  # derivative of the displacement by arc length
    u2: tuple[Array, Array],  # second one [1/m]
    at: Frame,  # the undeformed mid-line
) -> Points:
    """Strains from displacement."""
    t, n, k = at.tangent, at.normal, at.curvature
    (x1, y1), (x2, y2) = u1, u2
    along = t[0] * x1 + t[1] * y1
    stretch = 2 * along + x1**2 + y1**2
    turning = along * k - (n[0] * x2 + n[1] * y2) + (x2 * y1 - y2 * x1)
    curvature = (turning - stretch * k) / (1 + stretch)
    r1 = (t[0] + x1, t[1] + y1)
    r2 = (x2 - n[0] * k, y2 - n[1] * k)
    return Points((r1, r2), stretch, curvature)


def point_stress(
    points: Points,  # kinematics
    first: tuple[Array, Array],  # derivatives of an energy density by A and b
    curvature: Array,  # of the undeformed mid-line [1/m]
    length: Float[Array, "element #lane"],
) -> Float[Array, "gauss order component element lane"]:
    """Chain rule of a first derivative from (A, b) to r' and r''; see `point_terms`.

    `length`: of the elements [m].
    """
    by_a, by_b = first
    inverse = 1 / (1 + points.stretch)
    w_a = by_a - by_b * (points.curvature + curvature) * inverse
    w_c = by_b * inverse
    (x1, y1), (x2, y2) = points.r
    rows = [
        [2 * x1 * w_a - y2 * w_c, 2 * y1 * w_a + x2 * w_c],
        [y1 * w_c / length, -x1 * w_c / length],
    ]
    return jnp.stack([jnp.stack(row, 1) for row in rows], 1)


def point_terms(
    points: Points, moments: Moments, curvature: Array, length: Float[Array, "element #lane"]
) -> tuple[Array, Array]:
    """Chain rule from (A, b) to r' and r''.

    First to (a, c): b = c/a - 1/R. Then a is quadratic in r' and c = x'' y' - x' y''
    bilinear, so their derivatives are written out. The powers of the element's length
    that turn derivatives by xi into derivatives by arc length are applied here, which
    leaves constant matrices for the sums.

    Returns the stress [gauss, order, component, ...] and tangent [gauss, order, order, (xx, yy,
    xy), ...].
    """
    inverse = 1 / (1 + points.stretch)
    ratio = -(points.curvature + curvature) * inverse  # db/da; db/dc = inverse
    by_a, by_b = moments.first
    by_aa, by_ab, by_bb = moments.second
    w_a = by_a + by_b * ratio
    w_c = by_b * inverse
    w_aa = by_aa + 2 * by_ab * ratio + by_bb * ratio**2 - 2 * by_b * ratio * inverse
    w_ac = (by_ab + by_bb * ratio) * inverse - by_b * inverse**2
    w_cc = by_bb * inverse**2
    (x1, y1), (x2, y2) = points.r
    by_stretch = ((2 * x1, 2 * y1), (0.0, 0.0))
    by_curl = ((-y2, x2), (y1, -x1))
    power = (1.0, 1 / length)

    def tangent(d: int, f: int, c: int, e: int) -> Array:
        a, b = by_stretch[f][e], by_curl[f][e]
        total = by_curl[d][c] * (w_ac * a + w_cc * b)
        if d == 0:
            total = total + by_stretch[d][c] * (w_aa * a + w_ac * b)
        if d == f == 0 and c == e:
            total = total + 2 * w_a
        if d != f and c != e:  # c is the cross product of r'' and r'
            total = total + (-w_c if c == d else w_c)
        return power[d] * power[f] / length * total

    orders, pairs = ((0, 0), (0, 1), (1, 0), (1, 1)), ((0, 0), (1, 1), (0, 1))
    tangents = jnp.stack([tangent(*order, *pair) for order in orders for pair in pairs], 1)
    return (
        point_stress(points, moments.first, curvature, length),
        tangents.reshape(len(tangents), 2, 2, 3, *tangents.shape[2:]),
    )
