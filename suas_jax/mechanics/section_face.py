"""The oil's gap along rays from the axis: d(phi) = r_inner(phi) - r_wall.

A mechanics gives points of its deformed inner face, a ray asks for a radius at a polar
angle. On one element the face is smooth and its polar angle grows with the local
coordinate, so the radius is a smooth function of the angle: the polynomial through a few
samples is exact to far below the error of the mesh. No iteration is needed, neither for
values nor for derivatives, and one polynomial serves any number of rays.
"""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from suas_jax.mechanics.base import Profile
from suas_jax.mechanics.face import AbstractFace
from suas_jax.numerics.array_types import Lanes
from suas_jax.skin.geometry import outward

# Intervals an element is sampled in, the degree of its polynomial.
INTERVALS = 4


class PolarFace(AbstractFace):
    """The inner face as its radius over the polar angle, element by element.

    Attributes:
        edges: polar angles of the elements' ends [rad].
        radius: coefficients of the radius [m] in ascending powers of a coordinate that
            runs from -1 to 1 over the element's angle.
        folded: whether some ray meets the face more than once (the polar angle turns
            back along the arc): no gap can be told.
    """

    varies_along_axis: ClassVar[bool] = False
    edges: Float[Array, "station lane"]
    radius: Float[Array, "power element lane"]
    folded: Bool[Array, " lane"]

    def gap(
        self,
        angle: Float[Array, "ray #lane"],
        axial: Float[Array, "ray #lane"],
        wall_radius: Lanes,
    ) -> Float[Array, "ray lane"]:
        """Gap along rays from the axis, whatever their axial position; see the base class."""
        del axial
        return gap_at(self, angle, wall_radius)


def polar_face(shape: Profile, inner_radius: Lanes) -> PolarFace:
    """Describe the deformed inner face by its radius over the polar angle.

    Args:
        shape: the section, in `INTERVALS` intervals an element.
        inner_radius: of the undeformed inner face [m].
    """
    x, y = inner_radius * outward(shape.angle) + shape.inner_displacement
    angle, radius = jnp.arctan2(x, y), jnp.sqrt(x**2 + y**2)
    first, last = angle[0], angle[-1]
    t = (2 * angle - first - last) / (last - first)
    folded = jnp.any(angle[1:] <= angle[:-1], (0, 1))
    return PolarFace(jnp.concatenate([first, last[-1:]]), _interpolant(t, radius), folded)


def _interpolant(t: Array, values: Array) -> Array:
    """Coefficients in ascending powers of the polynomial through samples (leading axis)."""
    n = t.shape[0]
    # Newton's divided differences, then Horner's scheme on polynomials.
    table = list(values)
    for order in range(1, n):
        for i in range(n - 1, order - 1, -1):
            table[i] = (table[i] - table[i - 1]) / (t[i] - t[i - order])
    powers = [table[-1]]
    for i in range(n - 2, -1, -1):
        shifted = [table[i] - t[i] * powers[0]]
        shifted += [powers[k - 1] - t[i] * powers[k] for k in range(1, len(powers))]
        powers = [*shifted, powers[-1]]
    return jnp.stack(powers)


def radius_at(face: PolarFace, angle: Float[Array, "ray #lane"]) -> Float[Array, "ray lane"]:
    """Radius of the inner face along rays from the axis [m].

    Args:
        face: the inner face.
        angle: polar angles of the rays [rad]; beyond the clamped edges, where nothing
            moves, a ray takes the radius of the edge.
    """
    edges, powers = face.edges, list(face.radius)
    angle = jnp.clip(angle, edges[0], edges[-1])
    element = jnp.sum(angle[:, None] >= edges[1:-1], 1)
    table = jnp.stack([(edges[:-1] + edges[1:]) / 2, 2 / jnp.diff(edges, axis=0), *powers], -1)
    # One row of the table a ray: with lanes and elements in one axis, rows are contiguous.
    lanes = jnp.arange(edges.shape[1])
    rows = jnp.moveaxis(table, 0, 1).reshape(-1, table.shape[-1])
    picked = rows[lanes * table.shape[0] + element]
    middle, scale, *powers = jnp.moveaxis(picked, -1, 0)
    t = (angle - middle) * scale
    radius = powers[-1]
    for power in powers[-2::-1]:
        radius = radius * t + power
    return radius


def gap_at(
    face: PolarFace, angle: Float[Array, "ray #lane"], wall_radius: Lanes
) -> Float[Array, "ray lane"]:
    """Gap between inner face and wall along rays from the axis [m]; NaN where folded."""
    gap = radius_at(face, angle) - wall_radius
    return jnp.where(face.folded, jnp.nan, gap)
