"""The deformed inner face over the undeformed one: its height along normals of the section.

A mechanics gives points of its deformed inner face, a ray asks for a height at its angle. On
one element the face is smooth and the angle of the normal through it grows with the local
coordinate, so the height is a smooth function of the angle: the polynomial through a few
samples is exact to far below the error of the mesh. No iteration is needed, neither for
values nor for derivatives, and one polynomial serves any number of rays.
"""

from typing import ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from suas_jax.mechanics.base import Profile
from suas_jax.mechanics.face import AbstractFace
from suas_jax.numerics.polynomials import polynomial, power_coefficients
from suas_jax.skin.section import AbstractSection

# Intervals an element is sampled in, the degree of its polynomial.
INTERVALS = 4
_NOWHERE = 1e3  # angle of no ray [rad]: finite, as weighted sums are made of faces


class NormalFace(AbstractFace):
    """The inner face as its height over the angle of normals, element by element."""

    varies_along_axis: ClassVar[bool] = False
    edges: Float[Array, "station lane"]  # angles of the elements' ends [rad]
    # coefficients of the height [m] in ascending powers of a coordinate that runs from -1 to 1
    # over the element's angle
    powers: Float[Array, "power element lane"]
    # first and last angle of the elements along which it turns back [rad]: rays there meet the
    # face more than once, and no gap can be told there; the first is larger where none does
    fold: Float[Array, "2 lane"]

    @property
    def folded(self) -> Bool[Array, " lane"]:
        """Whether some ray meets the face more than once."""
        return self.fold[0] <= self.fold[1]

    def height(
        self, angle: Float[Array, "ray #lane"], axial: Float[Array, "ray #lane"]
    ) -> Float[Array, "ray lane"]:
        """Whatever the axial position; see the base class."""
        del axial
        known = (angle < self.fold[0]) | (angle > self.fold[1])
        return jnp.where(known, height_at(self, angle), jnp.nan)


def normal_face(shape: Profile, section: AbstractSection) -> NormalFace:
    """Describe the deformed inner face by its height over the angle of normals.

    `shape`: the section, in `INTERVALS` intervals an element.
    """
    angle, height = section.foot(shape.rest + shape.inner_displacement, shape.angle)
    first, last = angle[0], angle[-1]
    t = (2 * angle - first - last) / (last - first)
    back = jnp.any(~(angle[1:] > angle[:-1]), 0)
    ends = [
        jnp.min(jnp.where(back, jnp.min(angle, 0), _NOWHERE), 0),
        jnp.max(jnp.where(back, jnp.max(angle, 0), -_NOWHERE), 0),
    ]
    edges = jnp.concatenate([first, last[-1:]])
    fold = jax.lax.stop_gradient(jnp.stack(ends))
    return NormalFace(edges, power_coefficients(t, height), fold)


def height_at(face: NormalFace, angle: Float[Array, "ray #lane"]) -> Float[Array, "ray lane"]:
    """Height of the inner face along rays, folded or not [m].

    `angle`: of the rays [rad]; beyond the clamped edges, where nothing moves, a ray takes the
    height of the edge.
    """
    edges, powers = face.edges, list(face.powers)
    angle = jnp.clip(angle, edges[0], edges[-1])
    element = jnp.sum(angle[:, None] >= edges[1:-1], 1)
    table = jnp.stack([(edges[:-1] + edges[1:]) / 2, 2 / jnp.diff(edges, axis=0), *powers], -1)
    # One row of the table a ray: with lanes and elements in one axis, rows are contiguous.
    lanes = jnp.arange(edges.shape[1])
    rows = jnp.moveaxis(table, 0, 1).reshape(-1, table.shape[-1])
    picked = rows[lanes * table.shape[0] + element]
    middle, scale, *powers = jnp.moveaxis(picked, -1, 0)
    return polynomial(powers, (angle - middle) * scale)
