"""The lumped thin shell: plane strain, incompressible, normals stay normal.

With mid-surface stretch l and current curvature k, incompressibility gives the thickness
change in closed form: a fibre at reference offset Z from a mid-surface of radius R has
the squared stretch ::

    lambda^2 = (a + 2 m c / a) / (1 + Z/R)^2,     m = Z + Z^2 / (2 R)

with a = |r'|^2 = l^2 and c = x'' y' - x' y'' = k l^3 of the mid-line r(s), so that the
strain energy per length is a function of a and c alone. Strains are measured from rest,
A = a - 1 and b = c/a - 1/R, without cancellation.

Interpolation is cubic Hermite in the Cartesian displacement over exact reference
geometry: the undeformed state is stress-free to the last digit.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax._types import Diagonal, Lanes, OffDiagonal, StationVector
from suas_jax.constitutive.base import AbstractLaw
from suas_jax.element import hermite
from suas_jax.geometry import SkinGeometry, outward, tangent
from suas_jax.jet import Jet, second_order
from suas_jax.kinematics import FibreStretch
from suas_jax.loads import LoadPoints
from suas_jax.mechanics.base import AbstractMechanics, Assembly, largest
from suas_jax.quadrature import gauss_legendre


class _Tables(NamedTuple):
    """Constants of one element on the unit interval."""

    xi: np.ndarray  # [gauss]
    weights: np.ndarray  # [gauss]
    derivatives: np.ndarray  # [gauss, order 1 and 2, shape]
    force: np.ndarray  # [shape, gauss * order]
    stiffness: np.ndarray  # [shape * shape, gauss * order * order]
    area: np.ndarray  # [shape, shape], antisymmetric


def _tables(gauss: int) -> _Tables:
    xi, weights = gauss_legendre(gauss)
    d = np.stack([np.stack(hermite(xi, 1), 1), np.stack(hermite(xi, 2), 1)], 1)
    force = np.einsum("g,gdn->ngd", weights, d).reshape(4, -1)
    stiffness = np.einsum("g,gdn,gfm->nmgdf", weights, d, d).reshape(16, -1)
    x, w = gauss_legendre(4)  # exact: products of cubics and their slopes
    product = np.einsum("g,ng,mg->nm", w, np.stack(hermite(x)), np.stack(hermite(x, 1)))
    return _Tables(xi, weights, d, force, stiffness, (product.T - product) / 2)


class _Element(NamedTuple):
    """Kinematics at the quadrature points: current r' and r'' and the two strains."""

    r1: tuple[Array, Array]
    r2: tuple[Array, Array]
    stretch: Array  # A = a - 1
    curvature: Array  # b = c/a - 1/R


def _mix(matrix: np.ndarray, x: Array) -> Array:
    """Apply a constant matrix to the leading axis: one product for all elements and lanes."""
    flat = matrix @ x.reshape(x.shape[0], -1)
    return flat.reshape(matrix.shape[0], *x.shape[1:])


class Shell(AbstractMechanics):
    """Discretised lumped shell, optionally the left half of a symmetric one.

    The unknowns of a station are the displacement (x, y) and its derivative by arc
    length, in Cartesian components except at the two ends, where they are tangential and
    normal so that a clamp is a mask: position and normal fixed, stretch free.

    Attributes:
        law: the membrane's material.
        mid_radius: radius of the undeformed mid-surface [m].
        thickness: [m].
        angles: of the stations from the symmetry axis [rad].
        points: the line loads as points on the outer face, per width [N/m].
        film_volume: see the base class.
        symmetric: whether the last station is the crown of a symmetric arch.
        gauss: quadrature points along an element.
        layers: quadrature points through the thickness.
    """

    law: AbstractLaw
    mid_radius: Lanes
    thickness: Lanes
    angles: Float[Array, "station #lane"]
    points: LoadPoints
    film_volume: Lanes
    symmetric: bool = eqx.field(static=True)
    gauss: int = eqx.field(static=True, default=3)
    layers: int = eqx.field(static=True, default=3)

    @classmethod
    def build(
        cls,
        geometry: SkinGeometry,
        law: AbstractLaw,
        angles: Float[Array, "station #lane"],
        points: LoadPoints,
        *,
        symmetric: bool,
    ) -> "Shell":
        """Discretise a skin.

        Args:
            geometry: dimensions, with a lane axis.
            law: material, its constants with a lane axis.
            angles: stations from clamp to clamp, or from clamp to crown.
            points: loads on those elements.
            symmetric: whether the last station is the crown of a symmetric arch.
        """
        return cls(
            law,
            geometry.mid_radius,
            geometry.thickness,
            angles,
            points,
            geometry.film_area / (2 if symmetric else 1),
            symmetric,
        )

    @property
    def length_scale(self) -> Lanes:
        """The thickness [m]."""
        return self.thickness

    @property
    def lengths(self) -> Float[Array, "element #lane"]:
        """Reference lengths of the elements along the mid-surface [m]."""
        return self.mid_radius * (self.angles[1:] - self.angles[:-1])

    def rest(self) -> StationVector:
        """Zero displacement."""
        return jnp.zeros((4, *self.angles.shape), self.angles.dtype)

    def _free(self) -> np.ndarray:
        """Mask of the unknowns that may move [dof, station, 1]."""
        free = np.ones((4, self.angles.shape[0], 1))
        clamp, crown = [[0.0], [0.0], [1.0], [0.0]], [[0.0], [1.0], [1.0], [0.0]]
        free[:, 0] = clamp
        free[:, -1] = crown if self.symmetric else clamp
        return free

    def unknowns(self) -> int:
        """Free displacements and slopes."""
        return int(self._free().sum())

    def _rotate_ends(self, q: StationVector, inverse: bool) -> StationVector:
        """Slopes at the ends from tangential and normal to Cartesian, or back."""
        t = tangent(self.angles[jnp.array([0, -1])])
        a, b = q[2, jnp.array([0, -1])], q[3, jnp.array([0, -1])]
        if inverse:
            x, y = t[0] * a + t[1] * b, -t[1] * a + t[0] * b
        else:
            x, y = t[0] * a - t[1] * b, t[1] * a + t[0] * b
        ends = jnp.stack([x, y])
        slopes = jnp.concatenate([ends[:, :1], q[2:, 1:-1], ends[:, 1:]], 1)
        return jnp.concatenate([q[:2], slopes])

    def _gather(self, q: StationVector) -> Float[Array, "4 2 element lane"]:
        """Element unknowns [shape, component]; slopes times the element's length."""
        q = self._rotate_ends(q, inverse=False)
        value, slope = q[:2], q[2:]
        length = self.lengths
        return jnp.stack(
            [value[:, :-1], slope[:, :-1] * length, value[:, 1:], slope[:, 1:] * length]
        )

    def _scatter(self, f: Float[Array, "4 2 element lane"]) -> StationVector:
        """Sum element vectors into stations: the transpose of `_gather`, masked."""
        length = self.lengths
        left = jnp.concatenate([f[0], f[1] * length])
        right = jnp.concatenate([f[2], f[3] * length])
        pad = jnp.zeros_like(left[:, :1])
        q = jnp.concatenate([left, pad], 1) + jnp.concatenate([pad, right], 1)
        return self._rotate_ends(q, inverse=True) * self._free()

    def _reference(self, xi: np.ndarray) -> tuple[Array, Array, Array]:
        """Reference angle, tangent and normal at local coordinates [xi, element, lane]."""
        start, span = self.angles[:-1], self.angles[1:] - self.angles[:-1]
        angle = start + xi[:, None, None] * span
        return angle, tangent(angle), outward(angle)

    def _strains(self, qe: Float[Array, "4 2 element lane"], tables: _Tables) -> _Element:
        _, t, n = self._reference(tables.xi)
        length = self.lengths
        derivatives = tables.derivatives.reshape(-1, 4)
        d = _mix(derivatives, qe).reshape(-1, 2, *qe.shape[1:])
        ux1, uy1 = d[:, 0, 0] / length, d[:, 0, 1] / length
        ux2, uy2 = d[:, 1, 0] / length**2, d[:, 1, 1] / length**2
        along = t[0] * ux1 + t[1] * uy1
        stretch = 2 * along + ux1**2 + uy1**2
        bending = (
            along / self.mid_radius - (n[0] * ux2 + n[1] * uy2) + (ux2 * uy1 - uy2 * ux1)
        )
        r1 = (t[0] + ux1, t[1] + uy1)
        r2 = (ux2 - n[0] / self.mid_radius, uy2 - n[1] / self.mid_radius)
        curvature = (bending - stretch / self.mid_radius) / (1 + stretch)
        return _Element(r1, r2, stretch, curvature)

    def _layers(self) -> tuple[Array, Array, Array, Array]:
        """Fibres through the thickness: weight, and the factors of their squared stretch.

        With b = c/a - 1/R a fibre has lambda^2 - 1 = along * (a - 1) + across * b.

        Returns:
            Offset [m], weight [m], along, across [m]; each [layer, 1, 1, lane].
        """
        points, weights = gauss_legendre(self.layers, -0.5, 0.5)
        offset = points[:, None, None, None] * self.thickness
        shell = 1 + offset / self.mid_radius
        weight = weights[:, None, None, None] * self.thickness * shell
        m = offset + offset**2 / (2 * self.mid_radius)
        return offset, weight, 1 / shell**2, 2 * m / shell**2

    def energy_density(self, stretch: Array, curvature: Array) -> Array:
        """Strain energy per area of the mid-surface, integrated over the thickness [J/m^2].

        Args:
            stretch: A = |r'|^2 - 1.
            curvature: b = c / |r'|^2 - 1/R [1/m].
        """
        _, weight, along, across = self._layers()
        energy = self.law.energy(FibreStretch(along * stretch + across * curvature))
        return jnp.sum(weight * energy, 0)

    def _energy_jet(self, stretch: Array, curvature: Array) -> Jet:
        """The energy density to second order in A and b.

        A fibre depends on one number, linear in both: two derivatives of the law are all
        it takes. The sum over the layers is a reduction on purpose: the compiler keeps
        its result instead of computing the law again for each of its uses.
        """
        _, weight, along, across = self._layers()

        def energy(green: Array) -> Array:
            return self.law.energy(FibreStretch(green))

        def slope(green: Array) -> tuple[Array, Array]:
            return jax.jvp(energy, (green,), (jnp.ones_like(green),))

        green = along * stretch + across * curvature
        (value, first), (_, second) = jax.jvp(slope, (green,), (jnp.ones_like(green),))
        first, second = weight * first, weight * second
        terms = (
            weight * value,
            along * first,
            across * first,
            along**2 * second,
            along * across * second,
            across**2 * second,
        )
        return Jet(*(jnp.sum(term, 0) for term in terms))

    def strain_energy(self, q: StationVector) -> Lanes:
        """Strain energy per width [J/m]."""
        tables = _tables(self.gauss)
        strains = self._strains(self._gather(q), tables)
        density = self.energy_density(strains.stretch, strains.curvature)
        weights = tables.weights[:, None, None] * self.lengths
        return jnp.sum(weights * density, (0, 1))

    def _volume(self, qe: Array) -> tuple[Lanes, Array]:
        """Enclosed volume less rest, and its gradient by the element unknowns.

        The area under the mid-line is a quadratic form; the area under the inner face
        differs from it by the membrane's own lower half, which incompressibility keeps.
        """
        x, w = gauss_legendre(4)
        _, _, n = self._reference(x)
        shapes = np.stack(hermite(x), 1) * w[:, None]
        linear = jnp.einsum("gn,cgel->ncel", shapes, n) * self.lengths
        area = _tables(self.gauss).area
        gx, gy = _mix(area, qe[:, 1]), _mix(area.T, qe[:, 0])
        volume = jnp.sum(linear * qe, (0, 1, 2)) + jnp.sum(qe[:, 0] * gx, (0, 1))
        return volume, linear + jnp.stack([gx, gy], 1)

    def volume_change(self, q: StationVector) -> Lanes:
        """Enclosed volume less its value at rest, per width [m^2]."""
        return self._volume(self._gather(q))[0]

    def work(self, q: StationVector) -> Lanes:
        """Work of the loads, which act at the rigid-normal point r + (t/2) n [J/m]."""
        displacement, r1, normal = self._at_loads(self._gather(q))
        x, y = r1
        size = jnp.sqrt(x**2 + y**2)
        turned = jnp.stack([-y / size, x / size]) - normal
        moved = displacement + self.thickness / 2 * turned
        return jnp.sum(self.points.force * moved, (0, 1))

    def _at_loads(self, qe: Array) -> tuple[Array, tuple[Array, Array], Array]:
        """Displacement, current r' and reference normal at the load points."""
        at, slope = self._load_shapes()
        length, start, span = self._load_elements()
        qp = jnp.einsum("ncel,epl->ncpl", qe, self.points.select)
        u = jnp.einsum("npl,ncpl->cpl", at, qp)
        u1 = jnp.einsum("npl,ncpl->cpl", slope, qp) / length
        angle = start + self.points.xi * span
        t = tangent(angle)
        return u, (t[0] + u1[0], t[1] + u1[1]), outward(angle)

    def _load_shapes(self) -> tuple[Array, Array]:
        xi = self.points.xi
        return jnp.stack(hermite(xi)), jnp.stack(hermite(xi, 1))

    def _load_elements(self) -> tuple[Array, Array, Array]:
        select = self.points.select
        span = self.angles[1:] - self.angles[:-1]
        pick = [jnp.sum(select * x[:, None], 0) for x in (self.lengths, self.angles[:-1], span)]
        return pick[0], pick[1], pick[2]

    def _load_terms(self, qe: Array) -> tuple[Array, Array]:
        """Load vector and its derivative, per element: [4, 2, E, L] and [4, 4, 3, E, L]."""
        at, slope = self._load_shapes()
        length, _, _ = self._load_elements()
        _, (x, y), _ = self._at_loads(qe)
        fx, fy = self.points.force

        def projected(x: Array, y: Array) -> Array:
            return (fy * x - fx * y) / jnp.sqrt(x**2 + y**2)

        jet = second_order(projected, x, y)
        half = self.thickness / 2
        slope = slope / length
        gradient = half * jnp.stack([jet.x, jet.y])
        vector = at[:, None] * self.points.force + slope[:, None] * gradient
        curvature = half * jnp.stack([jet.xx, jet.yy, jet.xy])
        matrix = slope[:, None, None] * slope[None, :, None] * curvature
        select = self.points.select
        return (
            jnp.einsum("ncpl,epl->ncel", vector, select),
            jnp.einsum("nmcpl,epl->nmcel", matrix, select),
        )

    def assemble(self, q: StationVector, pressure: Lanes, factor: Lanes) -> Assembly:
        """Residual, tangent and border at a trial state; see the base class."""
        tables = _tables(self.gauss)
        qe = self._gather(q)
        strains = self._strains(qe, tables)
        jet = self._energy_jet(strains.stretch, strains.curvature)
        stress, tangents = _point_terms(strains, jet, self.mid_radius, self.lengths)
        internal = _mix(tables.force, stress.reshape(-1, *stress.shape[2:]))
        stiffness = _mix(tables.stiffness, tangents.reshape(-1, *tangents.shape[3:]))
        stiffness = stiffness.reshape(4, 4, *stiffness.shape[1:])
        volume, gradient = self._volume(qe)
        load, load_stiffness = self._load_terms(qe)
        coupling = pressure * tables.area[:, :, None, None]
        stiffness = stiffness - factor * load_stiffness
        stiffness = stiffness.at[:, :, 2].add(-coupling)
        diagonal, upper = self._blocks(stiffness)
        return Assembly(
            self._scatter(internal - pressure * gradient - factor * load),
            diagonal,
            upper,
            self._scatter(gradient),
            self._scatter(load),
            volume,
        )

    def _blocks(self, k: Float[Array, "4 4 3 element lane"]) -> tuple[Diagonal, OffDiagonal]:
        """Element stiffness [shape, shape, (xx, yy, xy)] to station blocks."""
        length = self.lengths
        one = jnp.ones_like(length)
        scale = jnp.stack([one, length, one, length])
        k = k * (scale[:, None] * scale[None])[:, :, None]
        yx = jnp.swapaxes(k[:, :, 2], 0, 1)
        # [shape, component, shape, component]
        full = jnp.stack(
            [jnp.stack([k[:, :, 0], k[:, :, 2]], 2), jnp.stack([yx, k[:, :, 1]], 2)], 1
        )

        def block(rows: slice, columns: slice) -> Array:
            return full[rows, :, columns].reshape(4, 4, *full.shape[4:])

        left, right = slice(0, 2), slice(2, 4)
        pad = jnp.zeros_like(full[0, 0, 0, 0, :1])[None, None] * jnp.ones((4, 4, 1, 1))
        diagonal = jnp.concatenate([block(left, left), pad], 2) + jnp.concatenate(
            [pad, block(right, right)], 2
        )
        return self._constrain(diagonal, block(left, right))

    def _constrain(self, diagonal: Diagonal, upper: OffDiagonal) -> tuple[Diagonal, OffDiagonal]:
        """Turn the ends to tangential and normal slopes and fix what is clamped."""
        t = tangent(self.angles[jnp.array([0, -1])])
        zero, one = jnp.zeros_like(t[0]), jnp.ones_like(t[0])
        rows = [
            [one, zero, zero, zero],
            [zero, one, zero, zero],
            [zero, zero, t[0], t[1]],
            [zero, zero, -t[1], t[0]],
        ]
        turn = jnp.stack([jnp.stack(row) for row in rows])
        first, last = turn[:, :, 0], turn[:, :, 1]

        def rotate(a: Array, block: Array, b: Array | None) -> Array:
            block = jnp.sum(a[:, :, None] * block[None], 1)
            return block if b is None else jnp.sum(block[:, None] * b[None], 2)

        ends = [rotate(m, diagonal[:, :, i], m) for m, i in ((first, 0), (last, -1))]
        diagonal = jnp.concatenate(
            [ends[0][:, :, None], diagonal[:, :, 1:-1], ends[1][:, :, None]], 2
        )
        top = rotate(first, upper[:, :, 0], None)[:, :, None]
        upper = jnp.concatenate([top, upper[:, :, 1:]], 2)
        bottom = jnp.swapaxes(rotate(last, jnp.swapaxes(upper[:, :, -1], 0, 1), None), 0, 1)
        upper = jnp.concatenate([upper[:, :, :-1], bottom[:, :, None]], 2)
        free = self._free()
        fixed = np.eye(4)[:, :, None, None] * (1 - free)[:, None]
        diagonal = diagonal * (free[:, None] * free[None]) + fixed
        return diagonal, upper * (free[:, None, :-1] * free[None, :, 1:])

    def displacement_size(self, q: StationVector) -> Lanes:
        """Largest component of a station's displacement [m]."""
        return largest(q[:2])


def _point_terms(
    strains: _Element, jet: Jet, radius: Lanes, length: Float[Array, "element lane"]
) -> tuple[Array, Array]:
    """Chain rule from (A, b) to r' and r'' at every quadrature point.

    First to (a, c): b = c/a - 1/R. Then a is quadratic in r' and c = x'' y' - x' y''
    bilinear, so their derivatives are written out. The powers of the element's length
    that turn derivatives by xi into derivatives by arc length are applied here, which
    leaves constant matrices for the sums.

    Returns:
        Stress [gauss, order, component, ...] and tangent [gauss, order, order,
        (xx, yy, xy), ...].
    """
    inverse = 1 / (1 + strains.stretch)
    ratio = -(strains.curvature + 1 / radius) * inverse  # db/da; db/dc = inverse
    w_a = jet.x + jet.y * ratio
    w_c = jet.y * inverse
    w_aa = jet.xx + 2 * jet.xy * ratio + jet.yy * ratio**2 - 2 * jet.y * ratio * inverse
    w_ac = (jet.xy + jet.yy * ratio) * inverse - jet.y * inverse**2
    w_cc = jet.yy * inverse**2
    (x1, y1), (x2, y2) = strains.r1, strains.r2
    by_stretch = ((2 * x1, 2 * y1), (0.0, 0.0))
    by_curl = ((-y2, x2), (y1, -x1))
    power = (1.0, 1 / length)

    def stress(d: int, c: int) -> Array:
        return power[d] * (w_a * by_stretch[d][c] + w_c * by_curl[d][c])

    def tangents(d: int, f: int, c: int, e: int) -> Array:
        a, b = by_stretch[f][e], by_curl[f][e]
        total = by_curl[d][c] * (w_ac * a + w_cc * b)
        if d == 0:
            total = total + by_stretch[d][c] * (w_aa * a + w_ac * b)
        if d == f == 0 and c == e:
            total = total + 2 * w_a
        if d != f and c != e:  # c is the cross product of r'' and r'
            total = total + (-w_c if c == d else w_c)
        return power[d] * power[f] / length * total

    pairs = ((0, 0), (1, 1), (0, 1))
    return (
        jnp.stack([jnp.stack([stress(d, c) for c in range(2)], 1) for d in range(2)], 1),
        jnp.stack(
            [
                jnp.stack(
                    [jnp.stack([tangents(d, f, *pair) for pair in pairs], 1) for f in range(2)],
                    1,
                )
                for d in range(2)
            ],
            1,
        ),
    )
