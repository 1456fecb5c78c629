"""The shell's elements: which unknowns they have, and how those of all make a system.

The unknowns of a station are the displacement (x, y) and its derivative by arc length; at the
two ends they are tangential and normal. An element has those of its two stations, Cartesian,
slopes times its length: the values and slopes of cubic Hermite shapes by the local coordinate.
Clamps and the crown's symmetry concern the two end stations alone: their few numbers are taken
out, worked on and put back, which leaves everything between untouched.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.numerics.array_types import Diagonal, Lanes, OffDiagonal, StationVector
from suas_jax.numerics.block_tridiagonal import at_stations, product
from suas_jax.numerics.polynomials import gauss_legendre, hermite
from suas_jax.skin.section import AbstractSection, Frame, tangent

EndMatrices = Float[Array, "4 4 end #lane"]


def turn_matrices(t: Float[Array, "2 end #lane"]) -> EndMatrices:
    """From tangential and normal slopes to Cartesian ones; displacements stay.

    `t`: tangents at the ends.
    """
    zero, one = jnp.zeros_like(t[0]), jnp.ones_like(t[0])
    rows = [
        [one, zero, zero, zero],
        [zero, one, zero, zero],
        [zero, zero, t[0], -t[1]],
        [zero, zero, t[1], t[0]],
    ]
    return jnp.stack([jnp.stack(row) for row in rows])


def turn_vector(matrices: EndMatrices, q: StationVector) -> StationVector:
    """Multiply the end stations of a vector."""
    ends = jnp.concatenate([q[:, :1], q[:, -1:]], 1)
    turned = jnp.sum(matrices * ends, 1)
    return jnp.concatenate([turned[:, :1], q[:, 1:-1], turned[:, 1:]], 1)


def turn_blocks(
    diagonal: Diagonal, upper: OffDiagonal, matrices: EndMatrices, free: np.ndarray
) -> tuple[Diagonal, OffDiagonal]:
    """Congruence transform of the end stations, then fix what is clamped.

    `diagonal`: blocks on the diagonal. `upper`: blocks above it. `matrices`: for both ends.
    `free`: mask of the unknowns that may move [dof, end, 1].
    """
    turn = matrices * free
    ends = jnp.stack([diagonal[:, :, 0], diagonal[:, :, -1]], 2)
    fixed = np.eye(4)[:, :, None, None] * (1 - free)
    ends = _times(product(turn, ends), turn) + fixed
    diagonal = _put(_put(diagonal, ends[:, :, 0], 0), ends[:, :, 1], -1)
    upper = _put(upper, product(turn[:, :, 0], upper[:, :, 0]), 0)
    upper = _put(upper, _times(upper[:, :, -1], turn[:, :, 1]), -1)
    return diagonal, upper


def _put(x: Array, station: Array, index: int) -> Array:
    axis = x.ndim - 2
    return jax.lax.dynamic_update_index_in_dim(x, station, index % x.shape[axis], axis)


def _times(a: Array, b: Array) -> Array:
    return product(jnp.swapaxes(a, 0, 1), b)


class Elements(eqx.Module):
    """The elements between stations."""

    angles: Float[Array, "station #lane"]  # of the stations from the symmetry axis [rad]
    section: AbstractSection  # the undeformed membrane
    lengths: Float[Array, "element #lane"]  # along the mid-surface [m]
    # factors that turn an element's unknowns into values and slopes by xi
    scale: Float[Array, "4 1 element #lane"]
    ends: EndMatrices  # from tangential and normal slopes at the ends to Cartesian ones
    # whether the last station is the crown of a symmetric arch
    symmetric: bool = eqx.field(static=True)

    @classmethod
    def between(
        cls, angles: Float[Array, "station #lane"], section: AbstractSection, *, symmetric: bool
    ) -> "Elements":
        """The elements between stations at some angles."""
        lengths = section.size * (angles[1:] - angles[:-1])
        one = jnp.ones_like(lengths)
        scale = jnp.stack([one, lengths, one, lengths])[:, None]
        ends = turn_matrices(tangent(section.direction(jnp.stack([angles[0], angles[-1]]))))
        return cls(angles, section, lengths, scale, ends, symmetric)

    def free(self) -> np.ndarray:
        """Mask of the unknowns that may move [dof, station, 1]."""
        free = np.ones((4, self.angles.shape[0], 1))
        clamp, crown = [[0.0], [0.0], [1.0], [0.0]], [[0.0], [1.0], [1.0], [0.0]]
        free[:, 0] = clamp
        free[:, -1] = crown if self.symmetric else clamp
        return free

    def gather(self, q: StationVector) -> Float[Array, "4 2 element lane"]:
        """Element unknowns [shape, component]; slopes times the element's length."""
        q = turn_vector(self.ends, q)
        pairs = jnp.stack([q[:, :-1], q[:, 1:]])
        return pairs.reshape(4, 2, *pairs.shape[2:]) * self.scale

    def scatter(self, f: Float[Array, "4 2 element lane"]) -> StationVector:
        """Sum element vectors into stations: the transpose of `gather`, masked."""
        left, right = (f * self.scale).reshape(2, 4, *f.shape[2:])
        ends = jnp.swapaxes(self.ends, 0, 1) * self.free()[:, [0, -1]][:, None]
        return turn_vector(ends, at_stations(left, right))

    def reference(self, xi: np.ndarray) -> Frame:
        """The undeformed membrane at local coordinates [xi, element, lane]."""
        start, span = self.angles[:-1], self.angles[1:] - self.angles[:-1]
        return self.section.frame(start + xi[:, None, None] * span)

    def blocks(self, k: Float[Array, "4 4 2 2 element lane"]) -> tuple[Diagonal, OffDiagonal]:
        """Element stiffness [shape, shape, component, component] to station blocks."""
        scale = self.scale[..., None, None, :, :][:, 0]
        k = k * (scale[:, None] * scale[None])
        # [end, end, 4, 4]
        k = k.reshape(2, 2, 2, 2, *k.shape[2:]).transpose(0, 2, 1, 4, 3, 5, 6, 7)
        k = k.reshape(2, 2, 4, 4, *k.shape[6:])
        diagonal = at_stations(k[0, 0], k[1, 1])
        return turn_blocks(diagonal, k[0, 1], self.ends, self.free()[:, [0, -1]])

    def volume(self, qe: Array, product: Array) -> tuple[Lanes, Array]:
        """Enclosed volume less rest, and its gradient by the element unknowns.

        The area under the mid-line is a quadratic form; the area under the inner face
        differs from it by the membrane's own lower half, which incompressibility keeps.

        `qe`: element unknowns. `product`: the antisymmetric area matrix times them.
        """
        x, w = gauss_legendre(4)
        n = self.reference(x).normal
        shapes = hermite(x).T * w[:, None]
        linear = jnp.einsum("gn,cgel->ncel", shapes, n) * self.lengths
        quadratic = product[:, ::-1] * np.array([1.0, -1.0])[:, None, None]
        return jnp.sum(qe * (linear + quadratic / 2), (0, 1, 2)), linear + quadratic


def full_blocks(k: Float[Array, "4 4 3 element lane"]) -> Float[Array, "4 4 2 2 element lane"]:
    """Component blocks of a symmetric element matrix from (xx, yy, xy)."""
    xx, yy, xy = k[:, :, 0], k[:, :, 1], k[:, :, 2]
    full = jnp.stack([xx, xy, jnp.swapaxes(xy, 0, 1), yy], 2)
    return full.reshape(4, 4, 2, 2, *k.shape[3:])
