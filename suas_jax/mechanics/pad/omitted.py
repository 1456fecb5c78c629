"""What the pad's thin shell leaves out, as energy: the source of its modelling error.

As in the section's shell (`suas_jax.mechanics.shell.omitted`): normals that stay normal forbid
transverse shear, loads do no work where the membrane thins beneath them, and a clamp holds a
line where it should hold a face. With the shell's moments M and membrane forces N per width,
Q = div M, shear modulus G and thickness t, under inward forces f on the outer face::

    E = 27/40 integral |Q|^2 / (G t) dA
        + sum over loads f (tr N / 12 + tr M / (4 t)) / G
        + integral over clamped edges (c1 N^2 + c2 (M / t)^2 + c3 Q M / t + c4 N Q) / G ds

where the last three are those across the edge. Traces are what thins an incompressible
membrane in two directions; in plane strain, where those along the axis are half of those along
the arc, every term is the section's. To first order the solution of the potential less E is
one more substitution with the tangent at hand.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.constitutive.base import AbstractLaw
from suas_jax.mechanics.pad.fibres import Layers, energy_density
from suas_jax.mechanics.pad.mid_surface import Surface, Vector
from suas_jax.mechanics.shell.omitted import (
    CLAMP_MOMENT,
    CLAMP_MOMENT_SHEAR,
    CLAMP_NORMAL,
    CLAMP_NORMAL_SHEAR,
    SHEAR,
)
from suas_jax.numerics.polynomials import lagrange_slopes
from suas_jax.skin.prestress import Growth

_LOAD_NORMAL, _LOAD_MOMENT = 1 / 12, 1 / 4


class Forces(NamedTuple):
    """Resultants by entries (11, 22, 12) of arc and axis."""

    normal: Float[Array, "3 *point"]  # membrane forces [N/m]
    moment: Float[Array, "3 *point"]  # moments [N]

    @property
    def thinning(self) -> tuple[Array, Array]:
        """Traces of the membrane forces and of the moments."""
        return self.normal[0] + self.normal[1], self.moment[0] + self.moment[1]


def forces_of(law: AbstractLaw, s: Surface, fibres: Layers) -> Forces:
    """Derivatives of the energy density by metric and curvature, as at small strain.

    `s`: the mid-surface at points. `fibres`: through the thickness.
    """

    def energy(metric: Vector, bending: Vector) -> Array:
        moved = s._replace(metric=metric, bending=bending)
        return jnp.sum(energy_density(law, moved, fibres))

    by_metric, by_bending = jax.grad(energy, (0, 1))(s.metric, s.bending)
    normal = jnp.stack([2 * by_metric[0], 2 * by_metric[1], by_metric[2]])
    return Forces(normal, jnp.stack([*by_bending[:2], by_bending[2] / 2]))


class Elements(NamedTuple):
    """Elements and their Gauss points, along the arc first."""

    xi: np.ndarray  # Gauss points on the unit interval
    weights: np.ndarray  # their weights there
    arc: Float[Array, " arc"]  # lengths along the arc [m]
    axial: Float[Array, " axial"]  # along the axis [m]
    # whether the first and the last edge are, along the arc and along the axis
    clamped: tuple[tuple[bool, bool], tuple[bool, bool]]


def relaxed_energy(
    at: Forces,  # resultants at the Gauss points [3, gauss, gauss, arc, axial]
    elements: Elements,  # where the Gauss points are
    thickness: Float[Array, "gauss gauss arc axial"],  # of the membrane at them [m]
    modulus: Array,  # small-strain shear modulus [Pa]
    growth: Growth | None,  # of the membrane; None where it fits its seat
) -> Array:
    """The part of E by which the membrane itself is softer [J]."""
    slope, weights = lagrange_slopes(elements.xi), elements.weights
    moment = at.moment
    by_arc = jnp.einsum("hg,cgkef->chkef", slope, moment) / elements.arc[:, None]
    by_axial = jnp.einsum("hk,cgkef->cghef", slope, moment) / elements.axial
    along, across = by_arc[0] + by_axial[2], by_arc[2] + by_axial[1]
    sizes = jnp.einsum("g,k,e,f->gkef", weights, weights, elements.arc, elements.axial)
    total = SHEAR * jnp.sum(sizes * (along**2 + across**2) / thickness)
    for way, lengths in enumerate((elements.arc, elements.axial)):
        turned = [x if way == 0 else with_sides_swapped(x) for x in (*at, thickness)]
        beside = elements.axial if way == 0 else elements.arc
        grown: Array | float = 0.0
        if growth is not None:  # too thick by itself for the clamp
            along_edge = growth.axial if way == 0 else growth.hoop
            grown = 4 * modulus * (growth.radial + along_edge / 2)
        for index, held in ((0, elements.clamped[way][0]), (-1, elements.clamped[way][1])):
            if held:
                edge = [x[..., index, :] for x in turned]
                at_end = way, index, lengths[index], beside
                total = total + _clamp(edge, at_end, elements, grown)
    return jnp.sum(total / modulus)  # one number: a lane's modulus is an array of one


def with_sides_swapped(x: Array) -> Array:
    """With the axis in the place of the arc."""
    return jnp.swapaxes(jnp.swapaxes(x, -1, -2), -3, -4)


def _clamp(
    edge: list[Array],  # resultants and thickness in the elements along the edge
    # direction across the edge, which end, and lengths of the elements across it and along it
    at_end: tuple[int, int, Array, Array],
    elements: Elements,  # all of them, with their Gauss points
    # membrane force over thickness of one that keeps its free thickness there [Pa]
    grown: Array | float,
) -> Array:
    """Integral along a clamped edge, times the shear modulus."""
    (way, index, length, beside), xi, weights = at_end, elements.xi, elements.weights
    side = 1.0 if index == 0 else -1.0
    fit = np.stack([weights, 12 * weights * (xi - 0.5)])

    def at_edge(x: Array) -> tuple[Array, Array]:
        """Value at the edge and slope across it [gauss, beside], of a straight line."""
        mean, rise = jnp.tensordot(jnp.asarray(fit), x, 1)
        return mean - side * rise / 2, rise / length

    normal, moment, thickness = edge
    t = thickness[0 if index == 0 else -1]
    n = at_edge(normal[way])[0] - t * grown
    m, rising = at_edge(moment[way])
    twist, _ = at_edge(moment[2])
    twisting = jnp.einsum("hk,kf->hf", lagrange_slopes(xi), twist) / beside
    q = side * (rising + twisting)
    m = m / t
    density = CLAMP_NORMAL * n**2 + CLAMP_MOMENT * m**2
    density = density + q * (CLAMP_MOMENT_SHEAR * m + CLAMP_NORMAL_SHEAR * n)
    return jnp.sum(weights[:, None] * beside * density)


def thinning_work(
    at: Forces, inward: Float[Array, " point"], thickness: Array, modulus: Array
) -> Array:
    """The part of E that loads do where the membrane thins beneath them [J].

    `at`: resultants under the loads. `inward`: their components along the inward normal [N].
    `thickness`: of the membrane there [m]. `modulus`: small-strain shear modulus [Pa].
    """
    normal, moment = at.thinning
    thinning = _LOAD_NORMAL * normal + _LOAD_MOMENT * moment / thickness
    return jnp.sum(inward * thinning / modulus)
