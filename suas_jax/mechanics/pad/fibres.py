"""Fibres through the thickness of a pad: their strains, energy, stress resultants.

With the mid-surface r(s, z), the metric a_ab = r,a . r,b and h_ab = r,ab . m, where m is the
vector r,s x r,z of length J, a fibre at reference offset Z keeps its volume when it lies at
zeta with J (zeta + H zeta^2) = M = Z + Z^2/(2R), H the mean and K the Gaussian curvature.
By Cayley and Hamilton the fibre's metric g = a (1 + zeta S)^2, S = a^-1 b, is then

    g_ab = a_ab + 2 M h_ab / J^2 - K zeta^2 a_ab,      K = det h / J^4,

without a root but that in zeta, which is taken as M/J: K is zero at rest and in plane strain,
and the next term is of third order in the thickness. So all strains are rational functions
of six numbers, a_ab and h_ab. Everything is written in differences from rest.

A membrane that has grown by G against its seat keeps det G times the volume below, so that M
is that much larger, and its law sees the metric over the stretches of G.

In a material with a past (`suas_jax.constitutive.relaxation`) the stress of a step is a share
of the instantaneous one and a rest H that is known, whose energy is H : C / 2, with
C_33 = 1 / det C of the fibre's plane.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.constitutive.base import AbstractLaw
from suas_jax.constitutive.deformation import InPlaneStrain
from suas_jax.constitutive.relaxation import Response
from suas_jax.mechanics.pad.mid_surface import Rest, Scalar, Surface, Vector, components, total
from suas_jax.numerics.jet import second_order, staged
from suas_jax.numerics.polynomials import gauss_legendre
from suas_jax.skin.prestress import Growth

# Second derivative of a 2 x 2 determinant by its entries (11, 22, 12).
_DETERMINANT = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -2.0]])
# Entries of a symmetric 3 x 3 matrix as a list, and where each of the matrix is in it.
_VOIGT = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
_ENTRY = ((0, 3, 4), (3, 1, 5), (4, 5, 2))


def _determinant(x: Sequence[Array]) -> Scalar:
    return x[0] * x[1] - x[2] * x[2]


class Layers(NamedTuple):
    """Fibres through the thickness, one a layer."""

    # of a layer in the energy per area of the mid-surface [m]
    weight: Float[Array, "layer #lane"]
    lever: Float[Array, "layer #lane"]  # M = Z + Z^2 / (2R) [m]
    # 1 + Z/R, the length of the fibre along the arc relative to the mid-line
    stretch: Float[Array, "layer #lane"]
    growth: Growth | None = None  # of the membrane; None where it fits its seat
    # of a material with a past, its rest by entries (11, 22, 12,
    # 33) [Pa]; None of an elastic one
    response: Response | None = None

    def grown(self, growth: Growth | None) -> "Layers":
        """The same of a membrane that has grown."""
        if growth is None:
            return self
        more = growth.volume
        return Layers(more * self.weight, more * self.lever, self.stretch, growth)


def layers(count: int, rest: Rest, growth: Growth | None) -> Layers:
    """Gauss points through the thickness."""
    points, weights = gauss_legendre(count)
    offset = jnp.asarray(points)[:, None] * rest.thickness - rest.below
    stretch = 1 + offset * rest.curvature
    lever = offset + offset**2 * rest.curvature / 2
    weight = jnp.asarray(weights)[:, None] * rest.thickness * stretch
    return Layers(weight, lever, stretch).grown(growth)


def fibre_strains(s: Surface, fibres: Layers) -> tuple[Vector, Scalar, Scalar]:
    """Strains of all fibres, and what they are made of.

    Returns C - 1 by unit vectors at rest, entries (11, 22, 12), each [layer, *point]; 1/J^2 and
    det h / J^6.
    """
    area = s.metric[0] + s.metric[1] + _determinant(s.metric)
    inverse = 1 / (1 + area)
    saddle = _determinant(_curved(s)) * inverse**3
    # h_11/J^2 - 1/R without cancellation.
    bend = (
        inverse * (s.bending[0] - area * s.rest.curvature),
        inverse * s.bending[1],
        inverse * s.bending[2],
    )
    second = [saddle * a for a in _metric(s)]
    lever = _over_layers(fibres.lever, s)
    double, square = 2 * lever, lever * lever
    along, axial, twist = (
        s.metric[k] + double * bend[k] - square * second[k] for k in range(3)
    )
    scales = _scales(fibres, s)
    growth = fibres.growth
    if growth is not None:  # 2 M / R more than the (1 + Z/R)^2 - 1 of a membrane that fits
        along = along + (1 - 1 / growth.volume) * double * s.rest.curvature
    entries = [scales[0] * along, scales[1] * axial, scales[2] * twist]
    if growth is not None:
        entries[0] = entries[0] + jnp.expm1(-2 * growth.hoop)
        entries[1] = entries[1] + jnp.expm1(-2 * growth.axial)
    # Stacked, so that the compiler doesn't compute them anew for each of their many uses.
    return components(jnp.stack(entries)), inverse, saddle


def _over_layers(x: Float[Array, "layer #lane"], s: Surface) -> Array:
    """Put a layer's numbers in front of the points, lanes (of length one) behind."""
    return x.reshape(x.shape[0], *(1,) * (s.u[0].ndim - 1), -1)


def _scales(fibres: Layers, s: Surface) -> tuple[Array, Array, Array]:
    """What turns metric entries (11, 22, 12) into strains by unit vectors at rest."""
    stretch = _over_layers(fibres.stretch, s)
    axial = jnp.ones_like(stretch)
    if fibres.growth is not None:
        stretch = stretch * jnp.exp(fibres.growth.hoop)
        axial = axial * jnp.exp(fibres.growth.axial)
    return 1 / stretch**2, 1 / axial**2, 1 / (axial * stretch)


def _metric(s: Surface) -> Vector:
    return 1 + s.metric[0], 1 + s.metric[1], s.metric[2]


def _curved(s: Surface) -> Vector:
    return s.rest.curvature + s.bending[0], s.bending[1], s.bending[2]


def _invariants(strain: Vector) -> tuple[Array, Array]:
    """The two that a law is a function of."""
    return strain[0] + strain[1], _determinant(strain)


def energy_density(law: AbstractLaw, s: Surface, fibres: Layers) -> Scalar:
    """Strain energy per area of the undeformed mid-surface [J/m^2]."""
    strain, _, _ = fibre_strains(s, fibres)
    energy = _energy(law, fibres, *_invariants(strain))
    if fibres.response is not None:
        along, axial, twist, _ = fibres.response.rest
        energy = energy + (along * strain[0] + axial * strain[1]) / 2 + twist * strain[2]
    return jnp.sum(_over_layers(fibres.weight, s) * energy, 0)


def _energy(law: AbstractLaw, fibres: Layers, trace: Array, determinant: Array) -> Array:
    """Energy per volume that is a function of the invariants: all of it in an elastic body."""
    energy = law.energy(InPlaneStrain(trace, determinant))
    if fibres.response is None:
        return energy
    share, rest = fibres.response
    return share * energy + rest[3] / (2 * (1 + trace + determinant))


def deviator(law: AbstractLaw, s: Surface, fibres: Layers) -> Float[Array, "4 layer *point"]:
    """Deviator of the law's stress, pulled back, by entries (11, 22, 12, 33) [Pa].

    A membrane's stress, none across the thickness, less a third of its trace.
    """
    strain, _, _ = fibre_strains(s, fibres)

    def energy(trace: Array, determinant: Array) -> Array:
        return law.energy(InPlaneStrain(trace, determinant))

    invariants = _invariants(strain)
    ones = jnp.ones_like(strain[0])
    by_trace = jax.jvp(energy, invariants, (ones, 0 * ones))[1]
    by_determinant = jax.jvp(energy, invariants, (0 * ones, ones))[1]
    along = 2 * (by_trace + by_determinant * strain[1])
    axial = 2 * (by_trace + by_determinant * strain[0])
    twist = -2 * by_determinant * strain[2]
    c11, c22, c12 = 1 + strain[0], 1 + strain[1], strain[2]
    area = 1 + invariants[0] + invariants[1]
    third = (along * c11 + axial * c22 + 2 * twist * c12) / 3
    less = third / area
    return jnp.stack(
        [along - less * c22, axial - less * c11, twist + less * c12, -third * area]
    )


class Resultants(NamedTuple):
    """Derivatives of the energy density by the six numbers a_11 a_22 a_12 h_11 h_22 h_12."""

    first: list[Scalar]  # gradient
    second: list[list[Scalar]]  # Hessian


def _moments(fibres: Layers, terms: list[Array]) -> Array:
    """Sums of terms over the fibres by powers of the levers, 0 to 4.

    A matrix product, so that the compiler keeps the moments instead of computing the law
    again for each of their uses.
    """
    if fibres.lever.shape[-1] == 1:
        powers = fibres.lever[:, 0] ** np.arange(5)[:, None]
        return powers @ jnp.stack(terms, 1).reshape(len(powers[0]), -1)
    # Levers differ from point to point with curvature and thickness.
    powers = fibres.lever ** np.arange(5)[:, None, None]
    return jnp.einsum("klp,ltp->ktp", powers, jnp.stack(terms, 1))


def resultants(law: AbstractLaw, s: Surface, fibres: Layers) -> Resultants:
    """Differentiate the energy: the law by its two invariants, the rest by hand.

    A fibre's strain e = sigma (A + M B - M^2 P) is linear in A = a - 1, B = 2 (h/J^2 - h_0)
    and P = f a with f = det h / J^6. So moments of the law's derivatives by the levers M come
    first; then, with c = h/J^2, g = d log J^2/da and b = df/dh,

        dA = da,   dB = 2/J^2 dh - 2 c (g.da),   dP = f da + a (b.dh - 3 f g.da).

    The Hessian by (a, h) is sums of matrices of moments and of products of vectors. Small
    arrays are lists of their entries: that is what the compiler makes fast loops of.
    """
    strain, inverse, f = fibre_strains(s, fibres)

    def energy(trace: Array, determinant: Array) -> Array:
        return _energy(law, fibres, trace, determinant)

    jet = second_order(energy, *_invariants(strain), once=law.in_stretches)
    weight = _over_layers(fibres.weight, s)
    scales = _scales(fibres, s)
    co = (strain[1], strain[0], -2 * strain[2])
    unit = (1.0, 1.0, 0.0)
    pulls = [jet.x * unit[p] + jet.y * co[p] for p in range(3)]
    if fibres.response is not None:
        along, axial, twist, _ = fibres.response.rest
        pulls = [x + y for x, y in zip(pulls, (along / 2, axial / 2, twist), strict=True)]
    terms = [weight * scales[p] * pulls[p] for p in range(3)]
    for p, q in _VOIGT:
        value = jet.xy * (unit[p] * co[q] + co[p] * unit[q]) + jet.yy * (co[p] * co[q])
        value = value + jet.xx * (unit[p] * unit[q]) + jet.y * _DETERMINANT[p, q]
        terms.append(weight * scales[p] * scales[q] * value)
    flat = list(_moments(fibres, terms).reshape(5 * len(terms), *inverse.shape))
    by_power = [flat[k : k + len(terms)] for k in range(0, len(flat), len(terms))]
    n, m = [row[:3] for row in by_power[:3]], [row[3:] for row in by_power]
    a, h = _metric(s), _curved(s)
    c = [inverse * x for x in h]
    g = [inverse * a[1], inverse * a[0], -2 * inverse * a[2]]
    cube = inverse**3
    b = [cube * h[1], cube * h[0], -2 * cube * h[2]]

    def times(matrix: list[Array], x: Sequence[Array]) -> list[Array]:
        return [total(matrix[_ENTRY[p][q]] * x[q] for q in range(3)) for p in range(3)]

    def inner(x: Sequence[Array], y: Sequence[Array]) -> Array:
        return x[0] * y[0] + x[1] * y[1] + x[2] * y[2]

    # Moments with (1 - f M^2), the factor of da.
    once = {k: [x - f * y for x, y in zip(m[k], m[k + 2], strict=True)] for k in (1, 2)}
    c2, c3, a3, a4 = times(m[2], c), times(m[3], c), times(m[3], a), times(m[4], a)
    aa, ca, cc = inner(a, a4), 2 * inner(a, c3), 4 * inner(c, c2)
    turning, bow = 2 * inner(n[1], c), -inner(n[2], a)
    pulled = [x + y for x, y in zip(times(once[2], a), n[2], strict=True)]
    by_g = [2 * x - 3 * f * y for x, y in zip(times(once[1], c), pulled, strict=True)]
    by_gh = [
        2 * inverse * (2 * x + y) - 6 * inverse * f * z
        for x, y, z in zip(c2, n[1], a3, strict=True)
    ]
    shifted = [2 * inverse * x for x in a3]
    both = turning + 3 * f * bow
    scalars = [inverse, f, cube, aa, bow, both, turning]
    scalars += [cc - 6 * f * ca + 9 * f * f * aa + 2 * turning + 12 * f * bow]
    scalars += [ca - 3 * f * aa - 3 * bow]
    rows = staged([*scalars, *g, *b, *pulled, *by_g, *by_gh, *shifted])
    inverse, f, cube, aa, bow, both, turning, gg, gb = rows[:9]
    g, b, pulled, by_g, by_gh, shifted = (rows[k : k + 3] for k in range(9, 27, 3))
    entries = [n[0][p] - f * n[2][p] - g[p] * both for p in range(3)]
    entries += [2 * inverse * n[1][p] + bow * b[p] for p in range(3)]
    for p, q in _VOIGT:
        metric = m[0][_ENTRY[p][q]] - f * (2 * m[2][_ENTRY[p][q]] - f * m[4][_ENTRY[p][q]])
        metric = metric - g[p] * by_g[q] - by_g[p] * g[q] + gg * g[p] * g[q]
        entries.append(metric - inverse * both * float(_DETERMINANT[p, q]))
    twice = 2 * inverse
    for p in range(3):
        for q in range(3):
            k = _ENTRY[p][q]
            mixed = twice * once[1][k] - g[p] * by_gh[q]
            entries.append(mixed - pulled[p] * b[q] + gb * g[p] * b[q])
    for p, q in _VOIGT:
        bending = 4 * inverse * inverse * m[2][_ENTRY[p][q]] + aa * b[p] * b[q]
        bending = bending - b[p] * shifted[q] - shifted[p] * b[q]
        entries.append(bending + bow * cube * float(_DETERMINANT[p, q]))
    entries = staged(entries)
    second = [[entries[0]] * 6 for _ in range(6)]
    for k, (p, q) in enumerate(_VOIGT):
        second[p][q] = second[q][p] = entries[6 + k]
        second[3 + p][3 + q] = second[3 + q][3 + p] = entries[21 + k]
    for p in range(3):
        for q in range(3):
            second[p][3 + q] = second[3 + q][p] = entries[12 + 3 * p + q]
    return Resultants(entries[:6], second)
