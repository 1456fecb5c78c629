"""The solid at its quadrature points: kinematics, stress, tangent.

A point X = r(s, z) + eta (h/2) n moves by u(s, z, eta). All components are those of the
undeformed membrane's tangent, normal and axis (t, n, z) at that place, where
L = grad u is the sum of u,a times the gradient of each coordinate a = s, z, eta and

    C - 1 = L + L^T + L^T L,      J - 1 = tr L + (sum of principal minors) + det L.

The energy is the law's, of the six entries of C - 1, with the multiplier p of J = 1 and a
penalty that vanishes with J - 1::

    Psi(C) + p (J - 1) + gamma mu (J - 1)^2 / 2 - p^2 / (2 kappa)

kappa is so large that p is a multiplier to rounding; it makes every pivot of the tangent one
of a definite sign. A membrane that has grown by G has Psi(G^-1 C G^-1) det G and J - det G.
"""

import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.polynomial import Legendre, Polynomial

from suas_jax.constitutive.base import AbstractLaw
from suas_jax.constitutive.deformation_gradient import (
    ENTRIES,
    Entries,
    GeneralDeformation,
    determinant,
    green,
)
from suas_jax.mechanics.pad.mid_surface import total
from suas_jax.numerics.jet import staged
from suas_jax.numerics.polynomials import gauss_legendre
from suas_jax.skin.prestress import Growth
from suas_jax.skin.section import AbstractSection

PENALTY = 2.0  # gamma: on the square of the change of volume, in shear moduli
MULTIPLIER = 1e8  # kappa over the shear modulus
# Coordinates s, z, eta: the kind of derivative by length that each one has.
KIND_OF = (1, 2, 0)


class Thickness(NamedTuple):
    """Tables at the quadrature points through the thickness, eta from -1 to 1.

    The displacement is interpolated between values at Gauss-Lobatto points, of which the first
    lies on the inner face and the last on the outer one; the pressure, of one degree less, is a
    sum of Legendre polynomials.
    """

    eta: Float[np.ndarray, " point"]  # the points
    weights: Float[np.ndarray, " point"]  # of the points
    shapes: Float[np.ndarray, "value point"]  # of the displacement [value, point]
    slopes: Float[np.ndarray, "value point"]  # their derivatives by eta
    modes: Float[np.ndarray, "mode point"]  # of the pressure [mode, point]


def levels(degree: int) -> Float[np.ndarray, " value"]:
    """Where the displacement's values are: eta of the Gauss-Lobatto points."""
    inside = Legendre.basis(degree).deriv().roots()
    return np.concatenate([[-1.0], np.sort(np.real(inside)), [1.0]])


def _polynomials(degree: int) -> list[Polynomial]:
    at = levels(degree)
    others = [np.delete(at, k) for k in range(degree + 1)]
    return [
        Polynomial.fromroots(rest) / np.prod(own - rest)
        for own, rest in zip(at, others, strict=True)
    ]


def shapes_at(
    degree: int, eta: Float[np.ndarray, " point"], derivative: int = 0
) -> Float[np.ndarray, "value point"]:
    """The displacement's polynomials, or their derivatives, at places.

    `eta`: places. `derivative`: order of differentiation.
    """
    return np.stack([p.deriv(derivative)(eta) for p in _polynomials(degree)])


@functools.cache
def thickness(degree: int, points: int) -> Thickness:
    """Tables for a degree of the displacement.

    `degree`: of the displacement. `points`: of the quadrature.
    """
    eta, weights = gauss_legendre(points, -1.0, 1.0)
    modes = np.stack([Legendre.basis(k)(eta) for k in range(degree)])
    return Thickness(eta, weights, shapes_at(degree, eta), shapes_at(degree, eta, 1), modes)


class Geometry(NamedTuple):
    """The undeformed membrane at points [eta, place]."""

    # gradients of s, z, eta in (t, n, z) [coordinate, component]
    inverse: Float[Array, "3 3 eta place"]
    # per area of the mid-surface, the weight through the thickness included [m]
    volume: Float[Array, "eta place"]


def geometry(
    section: AbstractSection,  # across the axis; its mean where the thickness varies along it
    # how much further the outer face lies out, over angle and axial position [m]
    relief: Callable[[Array, Array], Array | float],
    place: Sequence[Array],  # angles [rad] and axial positions [m]
    # eta of the points through the thickness, and their weights
    through: tuple[np.ndarray, np.ndarray],
) -> Geometry:
    """Map of the undeformed membrane."""
    angle, axial = place
    at, eta = section.frame(angle), jnp.asarray(through[0])[:, None]

    def offset(angle: Array, axial: Array) -> Array:
        thickness = section.thickness(angle) + jnp.zeros_like(angle)
        return (eta * thickness + (eta + 1) * relief(angle, axial)) / 2

    one, zero = jnp.ones_like(angle), jnp.zeros_like(angle)
    height, by_angle = jax.jvp(offset, (angle, axial), (one, zero))
    by_axial = jax.jvp(offset, (angle, axial), (zero, one))[1]
    along = 1 + at.curvature * height  # X,s . t
    half = (section.thickness(angle) + relief(angle, axial)) / 2 + 0 * along  # X,eta . n
    none = jnp.zeros_like(along)
    rows = [
        [1 / along, none, none],
        [none, none, none + 1],
        [-by_angle / section.size / (along * half), 1 / half, -by_axial / half],
    ]
    volume = jnp.asarray(through[1])[:, None] * along * half
    return Geometry(jnp.stack([jnp.stack(row) for row in rows]), volume)


def displacement_gradient(
    moved: Float[Array, "3 3 *point"], inverse: Float[Array, "3 3 *point"]
) -> Float[Array, "3 3 *point"]:
    """L [component, by component] from u by the coordinates [coordinate, component]."""
    return jnp.sum(moved[:, :, None] * inverse[:, None], 0)


def dilatation(L: Float[Array, "3 3 *point"]) -> Float[Array, "*point"]:
    """J - 1."""
    (a, b, c), (d, e, f), (g, h, i) = L
    minors = a * e - b * d + a * i - c * g + e * i - f * h
    return a + e + i + minors + determinant(L)


def elastic(entries: Entries, growth: Growth | None) -> Entries:
    """Entries of C - 1 as the law of a membrane that has grown sees them."""
    if growth is None:
        return entries
    g = growth.hoop, growth.radial, growth.axial
    logs = [-g[i] - g[j] for i, j in ENTRIES]
    unit = [jnp.expm1(x) if i == j else 0 * x for x, (i, j) in zip(logs, ENTRIES, strict=True)]
    grown = zip(logs, entries, unit, strict=True)
    return [jnp.exp(x) * entry + more for x, entry, more in grown]


def energy_density(
    law: AbstractLaw, entries: Entries, growth: Growth | None
) -> Float[Array, "*point"]:
    """Strain energy per volume of the undeformed membrane [J/m^3]."""
    density = law.energy(GeneralDeformation.of_strain(elastic(entries, growth)))
    return density if growth is None else growth.volume * density


def swelling(L: Float[Array, "3 3 *point"], growth: Growth | None) -> Float[Array, "*point"]:
    """J less its stress-free value."""
    if growth is None:
        return dilatation(L)
    return dilatation(L) - jnp.expm1(growth.hoop + growth.radial + growth.axial)


class Terms(NamedTuple):
    """Derivatives of the potential by u by the coordinates, volume weights included."""

    stress: Array  # [coordinate, component, eta, place]
    tangent: Array  # [coordinate, component, coordinate, component, eta, place]
    cofactor: Array  # derivative of J [coordinate, component, eta, place]
    swelling: Array  # J less its stress-free value, weighted [eta, place]


def terms(
    law: AbstractLaw,
    at: Geometry,  # the undeformed membrane
    moved: Float[Array, "3 3 eta place"],
    pressure: Float[Array, "eta place"],  # multiplier of J = 1 [Pa]
    growth: Growth | None,  # of the membrane; None where it fits its seat
) -> Terms:
    """Stress and tangent. `moved`: displacement by the coordinates [coordinate, component]."""
    L, inverse = displacement_gradient(moved, at.inverse), at.inverse
    change = swelling(L, growth)
    first, second = _by_entries(law, green(L), growth, at.volume)
    F = L + np.eye(3)[:, :, None, None]
    # Derivatives of the entries of C by u by the coordinates.
    by = [
        F[None, :, i] * inverse[:, None, j] + F[None, :, j] * inverse[:, None, i]
        if i != j
        else 2 * F[None, :, i] * inverse[:, None, i]
        for i, j in ENTRIES
    ]
    cofactor = jnp.stack(
        [sum(_cofactor(F, c, j) * inverse[:, j] for j in range(3)) for c in range(3)], 1
    )
    modulus = PENALTY * law.shear_modulus
    bulk = (pressure + modulus * change) * at.volume
    stress = sum(first[k] * by[k] for k in range(6)) + bulk * cofactor
    half = [sum(second[k][m] * by[m] for m in range(6)) for k in range(6)]
    tangent = sum(by[k][:, :, None, None] * half[k] for k in range(6))
    volumetric = modulus * at.volume * cofactor
    tangent = tangent + cofactor[:, :, None, None] * volumetric
    metric = total(
        first[k]
        * (
            inverse[:, None, i] * inverse[None, :, j]
            + inverse[:, None, j] * inverse[None, :, i]
        )
        for k, (i, j) in enumerate(ENTRIES)
    )
    turning = _second_of_volume(F, inverse) * bulk
    unit = np.eye(3)[None, :, None, :, None, None]
    tangent = tangent + metric[:, None, :, None] * unit + turning
    return Terms(stress, tangent, cofactor * at.volume, change * at.volume)


def _by_entries(
    law: AbstractLaw, entries: Entries, growth: Growth | None, volume: Float[Array, "*point"]
) -> tuple[list[Array], list[list[Array]]]:
    """First and second derivatives of the energy of volumes by the entries of C."""

    def energy(*entries: Array) -> Array:
        return jnp.sum(volume * energy_density(law, entries, growth))

    slope = jax.grad(energy, argnums=tuple(range(6)))

    unit = np.eye(6).reshape(6, 6, *(1,) * entries[0].ndim)
    along = tuple(jnp.broadcast_to(x, (6, *entries[0].shape)) for x in unit)
    first = slope(*entries)
    second = jax.vmap(lambda *way: jax.jvp(slope, tuple(entries), way)[1])(*along)
    rows = staged([*first, *(second[i][j] for i in range(6) for j in range(i, 6))])
    matrix: list[list[Array]] = [[rows[0]] * 6 for _ in range(6)]
    rest = iter(rows[6:])
    for i in range(6):
        for j in range(i, 6):
            matrix[i][j] = matrix[j][i] = next(rest)
    return rows[:6], matrix


def _cofactor(F: Array, i: int, j: int) -> Array:
    (a, b), (c, d) = [[(i + 1) % 3, (i + 2) % 3], [(j + 1) % 3, (j + 2) % 3]]
    return F[a, c] * F[b, d] - F[a, d] * F[b, c]


def _second_of_volume(F: Array, inverse: Array) -> Array:
    """Second derivative of J by u by the coordinates [coordinate, component, ...]."""
    # Vector products of the coordinates' gradients, carried along by F.
    cross = jnp.stack(
        [
            inverse[:, None, (k + 1) % 3] * inverse[None, :, (k + 2) % 3]
            - inverse[:, None, (k + 2) % 3] * inverse[None, :, (k + 1) % 3]
            for k in range(3)
        ]
    )
    carried = [sum(F[e, k] * cross[k] for k in range(3)) for e in range(3)]
    zero = jnp.zeros_like(carried[0])
    rows = [
        [zero, carried[2], -carried[1]],
        [-carried[2], zero, carried[0]],
        [carried[1], -carried[0], zero],
    ]
    matrix = jnp.stack([jnp.stack(row) for row in rows])  # [c, d, a, b, ...]
    return jnp.transpose(matrix, (2, 0, 3, 1, *range(4, matrix.ndim)))


def at_points(
    shapes: Float[np.ndarray, "value eta"],  # of the displacement through the thickness
    slopes: Float[np.ndarray, "value eta"],  # their derivatives by eta
    # by kind of derivative and value through the thickness
    values: Float[Array, "kind value 3 place"],
) -> Float[Array, "3 3 eta place"]:
    """Displacement by the coordinates at the points [coordinate, component]."""
    return jnp.stack(
        [
            jnp.einsum("ve,vcp->cep", shapes if kind else slopes, values[kind])
            for kind in KIND_OF
        ]
    )
