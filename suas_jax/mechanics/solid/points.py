"""The solid at the quadrature points of its elements: kinematics, stress, tangent.

The energy at a point is a function of two numbers, m = F:F - 2J = (l1 - l2)^2 and
j = J - 1, both without cancellation near rest, and with the pressure p of the element::

    P = 2 Psi_m D + (Psi_j + p) cof F,      D = F - cof F,   dm = 2 D:dF,   dj = cof F:dF

Multiplied with the inverse of the geometry's map and the quadrature weight, stress and
tangent act on derivatives by the local coordinates: what is left are sums with constant
coefficients over points and nodes, one matrix product for all elements.

A membrane that has grown by G against its seat is strained by F G^-1, in its plane, and by
1 / g_a along the axis. Laws see the isochoric part alone, which is that of g_a F G^-1 in the
plane and of 1 along the axis: plane strain again, of a volume g_a^3, over other axes::

    F' = F A,     A = g_a G^-1,     j' = det F' - 1 = g_a^3 - 1

In a material with a past (`suas_jax.constitutive.relaxation`) a step's stress is a share of the
law's and a rest S that is known, with the energy S : (C - 1) / 2 and P = F S.
"""

from typing import NamedTuple, TypeAlias

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from suas_jax.constitutive.base import AbstractLaw
from suas_jax.constitutive.deformation import PlaneStrain
from suas_jax.constitutive.relaxation import Response
from suas_jax.mechanics.solid.element import TABLES
from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.jet import second_order
from suas_jax.numerics.lanes import mix
from suas_jax.skin.prestress import Growth

PointField = Float[Array, "gauss layer element lane"]
Tensor: TypeAlias = tuple[tuple[Array, Array], tuple[Array, Array]]


class Grid(eqx.Module):
    """Reference geometry at the quadrature points."""

    # derivatives of (xi, eta) by (X, Y), [D][d]
    inverse: tuple[tuple[PointField, PointField], tuple[PointField, PointField]]
    # quadrature weights times the area that a unit of (xi, eta) covers [m^2]
    volume: PointField
    # A - 1 of a membrane that has grown; None where it fits its seat
    strain: Tensor | None = None
    dilatation: Lanes | None = None  # g_a^3 - 1 of such a one

    @classmethod
    def of(cls, nodes: Float[Array, "9 2 layer element lane"]) -> "Grid":
        """Map of every element from the positions of its nodes."""
        (xx, xy), (yx, yy) = local_derivatives(nodes)
        area = xx * yy - xy * yx
        weights = jnp.asarray(TABLES.weights)[:, None, None, None]
        return cls(((yy / area, -xy / area), (-yx / area, xx / area)), weights * area)

    def grown(self, growth: Growth, tangent: Float[Array, "2 *point"]) -> "Grid":
        """The same for a membrane that has grown.

        `growth`: of the membrane. `tangent`: unit vector along the undeformed section at the
        points.
        """
        a, g = free_strain(growth, tangent), self.inverse
        inverse = tuple(
            tuple(g[i][d] + a[i][0] * g[0][d] + a[i][1] * g[1][d] for d in range(2))
            for i in range(2)
        )
        more = jnp.expm1(3 * growth.axial)
        return Grid(inverse, growth.volume * self.volume, a, more)  # type: ignore[arg-type]

    def swelling(self, k: "Kinematics") -> PointField:
        """(J - det G) dV, over det A: what the pressure of an element makes zero."""
        free = self.dilatation
        return self.volume * (k.dilatation if free is None else k.dilatation - free)


def free_strain(growth: Growth, tangent: Float[Array, "2 *point"]) -> Tensor:
    """A - 1 in Cartesian components; see the module."""
    (x, y), along = tangent, jnp.expm1(growth.axial - growth.hoop)
    across = jnp.expm1(growth.axial - growth.radial)
    shear = (along - across) * x * y
    return (
        (along * x**2 + across * y**2, shear),
        (shear, along * y**2 + across * x**2),
    )


def local_derivatives(
    u: Float[Array, "9 2 layer element lane"],
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Derivatives of a nodal field by (xi, eta) at the quadrature points, [d][component]."""
    h = mix(TABLES.gradient.reshape(-1, 9), u).reshape(-1, 2, *u.shape[1:])
    return (h[:, 0, 0], h[:, 0, 1]), (h[:, 1, 0], h[:, 1, 1])


class Kinematics(NamedTuple):
    """Strain measures and the tensors that their variations contract with."""

    distortion: PointField  # m
    dilatation: PointField  # j
    deviator: Tensor  # D, pulled back to local coordinates [component][d]
    cofactor: Tensor  # cof F, pulled back
    gradient: Tensor  # F - 1 by reference coordinates [component][D]


def kinematics(grid: Grid, u: Float[Array, "9 2 layer element lane"]) -> Kinematics:
    """Strain measures of a displacement field.

    `grid`: reference geometry. `u`: displacements of the elements' nodes.
    """
    g, d = grid.inverse, local_derivatives(u)
    (xx, xy), (yx, yy) = (
        tuple(g[D][0] * d[0][c] + g[D][1] * d[1][c] for D in range(2)) for c in range(2)
    )
    if grid.strain is not None:
        (axx, axy), (_, ayy) = grid.strain
        xx, xy, yx, yy = xx + axx, xy + axy, yx + axy, yy + ayy
    state = PlaneStrain.from_displacement_gradient(
        jnp.stack([jnp.stack([xx, xy]), jnp.stack([yx, yy])])
    )
    stretch, shear = xx - yy, xy + yx
    deviator = ((stretch, shear), (shear, -stretch))
    cofactor = ((1 + yy, -yx), (-xy, 1 + xx))

    def pulled(a: Tensor) -> Tensor:
        (aa, ab), (ba, bb) = (
            [a[c][0] * g[0][k] + a[c][1] * g[1][k] for k in range(2)] for c in range(2)
        )
        return (aa, ab), (ba, bb)

    strain = state.distortion, state.dilatation
    return Kinematics(*strain, pulled(deviator), pulled(cofactor), ((xx, xy), (yx, yy)))


class PointTerms(NamedTuple):
    """What the elements' vectors and matrices are summed from, weights included."""

    stress: Array  # pulled back, [gauss, d, component, ...]
    cofactor: Array  # pulled back, the same shape
    tangent: Array  # [gauss, d, d', (xx, yy, xy), ...]
    constraint: PointField  # see `Grid.swelling`


def remembered_stress(
    law: AbstractLaw, k: Kinematics
) -> Float[Array, "3 gauss layer element lane"]:
    """Deviator of the law's stress, pulled back: S by reference coordinates, (XX, YY, XY) [Pa].

    `k`: kinematics at the points.
    """

    def energy(distortion: Array, dilatation: Array) -> Array:
        return law.energy(PlaneStrain(distortion, dilatation))

    w = second_order(energy, k.distortion, k.dilatation, once=law.in_stretches)
    (xx, xy), (yx, yy) = k.gradient
    f = ((1 + xx, xy), (yx, 1 + yy))
    cofactor = ((f[1][1], -f[1][0]), (-f[0][1], f[0][0]))

    def piola(c: int, D: int) -> Array:
        return 2 * w.x * (f[c][D] - cofactor[c][D]) + w.y * cofactor[c][D]

    def entry(D: int, E: int) -> Array:
        pulled = sum(cofactor[c][D] * piola(c, E) for c in range(2))
        return pulled / (1 + k.dilatation)

    return jnp.stack([entry(0, 0), entry(1, 1), entry(0, 1)])


def rest_energy(k: Kinematics, response: Response) -> PointField:
    """Energy S : (C - 1) / 2 of the stress that the past leaves [J/m^3]."""
    (xx, xy), (yx, yy) = k.gradient
    first, second = 2 * xx + xx**2 + yx**2, 2 * yy + yy**2 + xy**2
    mixed = (1 + xx) * xy + yx * (1 + yy)
    along, across, shear = response.rest
    return (along * first + across * second) / 2 + shear * mixed


def point_terms(
    law: AbstractLaw,
    grid: Grid,  # reference geometry
    k: Kinematics,  # at the quadrature points
    pressure: PointField,  # p, the Lagrange multiplier of J = 1
    response: Response | None = None,  # of a material with a past; None of an elastic one
) -> PointTerms:
    """Stress and tangent at the quadrature points."""

    def energy(distortion: Array, dilatation: Array) -> Array:
        density = law.energy(PlaneStrain(distortion, dilatation))
        return density if response is None else response.share * density

    w = second_order(energy, k.distortion, k.dilatation, once=law.in_stretches)
    g, volume = grid.inverse, grid.volume
    shear, bulk = 2 * w.x, w.y + pressure
    mm, mj, jj = 4 * volume * w.xx, 2 * volume * w.xy, volume * w.yy
    d, c = k.deviator, k.cofactor
    # Second variation of m: 2 (dF:dF - 2 det dF); of j: 2 det dF.
    metric = [
        [shear * volume * (g[0][a] * g[0][b] + g[1][a] * g[1][b]) for b in range(2)]
        for a in range(2)
    ]
    area = (bulk - shear) * volume * (g[0][0] * g[1][1] - g[0][1] * g[1][0])

    rest = None
    if response is not None:
        (xx, xy), (yx, yy) = k.gradient
        f = ((1 + xx, xy), (yx, 1 + yy))
        along, across, both = response.rest
        s = ((along, both), (both, across))
        each = [(D, E) for D in range(2) for E in range(2)]
        for a in range(2):
            for b in range(2):
                pulled = sum(g[D][a] * g[E][b] * s[D][E] for D, E in each)
                metric[a][b] = metric[a][b] + volume * pulled
        rest = [
            [sum(f[i][E] * s[E][D] * g[D][a] for D, E in each) for a in range(2)]
            for i in range(2)
        ]

    def stress(a: int, i: int) -> Array:
        own = shear * d[i][a] + bulk * c[i][a]
        return volume * (own if rest is None else own + rest[i][a])

    def tangent(a: int, b: int, i: int, j: int) -> Array:
        by_deviator = mm * d[j][b] + mj * c[j][b]
        by_cofactor = mj * d[j][b] + jj * c[j][b]
        total = d[i][a] * by_deviator + c[i][a] * by_cofactor
        if i == j:
            total = total + metric[a][b]
        elif a != b:
            total = total + (area if a == i else -area)
        return total

    both = [(a, b) for a in range(2) for b in range(2)]
    pairs = ((0, 0), (1, 1), (0, 1))
    return PointTerms(
        jnp.stack([stress(a, i) for a, i in both], 1),
        jnp.stack([volume * c[i][a] for a, i in both], 1),
        jnp.stack([tangent(a, b, i, j) for a, b in both for i, j in pairs], 1),
        grid.swelling(k),
    )
