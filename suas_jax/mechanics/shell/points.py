"""The lumped shell at the quadrature points of its elements: strains, stress, tangent.

With A = |r'|^2 - 1 the stretch and b = c/a - 1/R the bending of the mid-line, the fibre at
reference offset Z through the thickness has ::

    lambda^2 - 1 = (A + m b) / (1 + Z/R)^2,     m = 2 Z + Z^2 / R

In a material with a past (`suas_jax.constitutive.relaxation`) the stress of a step is a share
of the instantaneous one and a rest H that is known, whose energy is H : C / 2. In plane strain
C is the square of the fibre's stretch along it and its inverse across; C is that which the law
sees.

A membrane that has grown by G against its seat keeps J = det G times its volume, and its law
sees x = lambda / (g_hoop sqrt(g_axial)) beside the stretch 1 / g_axial along the axis::

    x^2 - 1 = (A + J m b + (J - h) m / R + 1 - h) / (h (1 + Z/R)^2),    h = g_hoop^2 g_axial
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.constitutive.base import AbstractLaw
from suas_jax.constitutive.deformation import (
    AbstractDeformation,
    FibreStretch,
    HeldFibre,
    InPlaneStrain,
)
from suas_jax.constitutive.relaxation import Response
from suas_jax.numerics.polynomials import gauss_legendre, hermite
from suas_jax.skin.prestress import Growth
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


class Points(NamedTuple):
    """Kinematics: r' and r'' of the current mid-line r(s), and the two strains."""

    r: tuple[tuple[Array, Array], tuple[Array, Array]]  # [order][component]
    stretch: Float[Array, "point element lane"]  # A = a - 1
    curvature: Float[Array, "point element lane"]  # b = c/a - 1/R


class Moments(NamedTuple):
    """Derivatives of the energy density."""

    first: tuple[Array, Array]  # by A, b
    second: tuple[Array, Array, Array]  # by AA, Ab, bb


class Fibres(eqx.Module):
    """A membrane's material, integrated over its thickness."""

    law: AbstractLaw  # the material
    # of the undeformed mid-line, which broadcasts against the strains [1/m]
    mid_curvature: Array
    thickness: Array  # likewise [m]
    layers: int = eqx.field(static=True)  # quadrature points through the thickness
    # of a material with a past, its rest [2, layer, ...] along and
    # across fibres; None of an elastic one
    response: Response | None = None
    growth: Growth | None = None  # of the membrane against its seat; None where it fits

    def _state(self, green: Array) -> AbstractDeformation:
        if self.growth is None:
            return FibreStretch(green)
        return HeldFibre(green, -self.growth.axial)

    def energy(self, stretch: Array, curvature: Array) -> Array:
        """Strain energy per area of the mid-surface [J/m^2].

        `stretch`: A = |r'|^2 - 1. `curvature`: b = c / |r'|^2 - 1/R [1/m].
        """
        weight, lever, square, free = self._layers()
        green = (stretch + lever * curvature + free) / square
        return jnp.sum(weight * self._density(green), 0)

    def _density(self, green: Array) -> Array:
        """Energy per volume of the fibres [J/m^3]."""
        energy = self.law.energy(self._state(green))
        if self.response is None:
            return energy
        share, (along, across) = self.response
        if self.growth is None:
            return share * energy + (along * green - across * green / (1 + green)) / 2
        length = jnp.exp(self.growth.axial)  # those of C along and across: x^2, 1/x^2 times it
        return share * energy + length * (along * green - across * green / (1 + green)) / 2

    def deviator(self, stretch: Array, curvature: Array) -> Float[Array, "2 layer *shape"]:
        """Deviator of the law's stress, pulled back: along and across the fibres [Pa].

        `stretch`: A = |r'|^2 - 1. `curvature`: b = c / |r'|^2 - 1/R [1/m].
        """
        _, lever, square, free = self._layers()
        green = (stretch + lever * curvature + free) / square
        axial = jnp.zeros(1) if self.growth is None else -self.growth.axial
        held, size = jnp.expm1(2 * axial), jnp.exp(-axial)
        green = size * green + jnp.expm1(-axial)  # of C along the fibre

        def kirchhoff(axis: str) -> Array:
            """Of a membrane: stress along a direction, none across the thickness."""

            def energy(e: Array) -> Array:
                along, aside = (green + e, held) if axis == "along" else (green, held + e)
                return self.law.energy(InPlaneStrain(along + aside, along * aside))

            none = jnp.zeros_like(green)
            return 2 * jax.jvp(energy, (none,), (jnp.ones_like(green),))[1]

        length = 1 + green
        along, aside = length * kirchhoff("along"), (1 + held) * kirchhoff("aside")
        mean = (along + aside) / 3
        return jnp.stack([(along - mean) / length, -mean * length * (1 + held)])

    def moments(self, stretch: Array, curvature: Array) -> Moments:
        """Derivatives of the energy per area by A and b.

        A fibre depends on one number, linear in both strains: two derivatives of the law
        are all it takes. The sum over the layers is a reduction on purpose: the compiler
        keeps its result instead of computing the law again for each of its uses.
        """
        weight, lever, square, free = self._layers()

        def slope(green: Array) -> Array:
            return jax.jvp(self._density, (green,), (jnp.ones_like(green),))[1]

        green = (stretch + lever * curvature + free) / square
        first, second = jax.jvp(slope, (green,), (jnp.ones_like(green),))
        first, second = first / square, second / square**2

        def moment(power: Array, derivative: Array) -> Array:
            return jnp.sum(power * derivative, 0)

        ones, squares = weight * lever, weight * lever**2
        return Moments(
            (moment(weight, first), moment(ones, first)),
            (moment(weight, second), moment(ones, second), moment(squares, second)),
        )

    def _layers(self) -> tuple[Array, Array, Array, Array | float]:
        """Weight [m], lever m [m], (1 + Z/R)^2, and the strain at no displacement times it.

        Of the fibres [layer, ...], and as the module says where the membrane has grown.
        """
        rule = gauss_legendre(self.layers, -0.5, 0.5)
        points, weights = (jnp.asarray(x)[:, None, None, None] for x in rule)
        offset = points * self.thickness
        shell = 1 + offset * self.mid_curvature
        weight = weights * self.thickness * shell
        lever = 2 * offset + offset**2 * self.mid_curvature
        if self.growth is None:
            return weight, lever, shell**2, 0.0
        g = self.growth
        own, volume = 2 * g.hoop + g.axial, g.volume
        size = jnp.exp(own)
        curved = size * jnp.expm1(g.radial - g.hoop) * lever * self.mid_curvature
        return volume * weight, volume * lever, size * shell**2, curved - jnp.expm1(own)


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
