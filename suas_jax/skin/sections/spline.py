"""A smooth curve through points."""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.config.sections.spline import SplineSpec
from suas_jax.numerics.array_types import Lanes
from suas_jax.skin.charted import AbstractCurve

_MIRRORED = 1e-9  # of the width, by which points may miss their mirror images


class Spline(AbstractCurve):
    """The cubic spline through points by the length of their chords, not-a-knot at the ends."""

    points: Float[Array, "2 point lane"]  # [2, point, lane], in metres
    slopes: Float[Array, "2 point lane"]  # derivatives by the parameter there
    # whether the right half is the mirror image of the left one
    mirrored: bool = eqx.field(static=True, default=False)

    @property
    def symmetric(self) -> bool:
        """See the base class."""
        return self.mirrored

    @classmethod
    def of(cls, spec: SplineSpec, value: Callable[[str], Lanes]) -> "Spline":
        """See the base class."""
        rows = [[value(f"points.{k}.{i}") for k in range(len(spec.points))] for i in (0, 1)]
        points = jnp.stack([jnp.stack(jnp.broadcast_arrays(*row)) for row in rows])
        given = np.array(spec.points, float)
        image = given[::-1] * [-1, 1] + [given[0, 0] + given[-1, 0], 0]
        width = np.ptp(given[:, 0])
        mirrored = bool(np.allclose(given, image, rtol=0, atol=_MIRRORED * width))
        chord = jnp.sqrt(jnp.sum(jnp.diff(points, axis=1) ** 2, 0))
        return cls(points, _slopes(points, chord), mirrored)

    def edges(self) -> Float[Array, "edge lane"]:
        """Sums of the chords' lengths [m]."""
        chord = jnp.sqrt(jnp.sum(jnp.diff(self.points, axis=1) ** 2, 0))
        return jnp.concatenate([jnp.zeros_like(chord[:1]), jnp.cumsum(chord, 0)])

    def position(self, parameter: Array, interval: Array) -> Float[Array, "2 *shape"]:
        """Cubic Hermite interpolation; see the base class."""
        edges, left = self.edges(), interval[..., 0]
        step = (edges[1:] - edges[:-1])[left]
        x = (parameter - edges[left]) / step
        (p, q), (u, v) = (
            (values[:, left], values[:, left + 1]) for values in (self.points, self.slopes)
        )
        rise = q - p
        bend = x * (1 - x) * ((1 - x) * (u * step - rise) - x * (v * step - rise))
        return p + x * rise + bend


def _slopes(points: Float[Array, "2 point lane"], h: Float[Array, "chord lane"]) -> Array:
    """Derivatives at the points that make second derivatives continuous."""
    count = points.shape[1]
    rise = jnp.diff(points, axis=1) / h
    matrix = jnp.zeros((h.shape[-1], count, count))
    inner = np.arange(1, count - 1)
    left, right = h[:-1].T, h[1:].T
    matrix = matrix.at[:, inner, inner - 1].set(right)
    matrix = matrix.at[:, inner, inner].set(2 * (left + right))
    matrix = matrix.at[:, inner, inner + 1].set(left)
    sides = 3 * (h[1:] * rise[:, :-1] + h[:-1] * rise[:, 1:])

    def end(a: Array, b: Array, first: Array, second: Array) -> tuple[Array, Array, Array]:
        """Third derivatives of the two outermost pieces agree."""
        right_side = ((a + 2 * (a + b)) * b * first + a**2 * second) / (a + b)
        return b, a + b, right_side

    for row, near, k, j in ((0, 1, 0, 1), (count - 1, count - 2, -1, -2)):
        here, beside, value = end(h[k], h[j], rise[:, k], rise[:, j])
        matrix = matrix.at[:, row, row].set(here).at[:, row, near].set(beside)
        sides = jnp.concatenate(
            [value[:, None], sides] if row == 0 else [sides, value[:, None]], 1
        )
    solved = jnp.linalg.solve(matrix, jnp.transpose(sides, (2, 1, 0)))
    return jnp.transpose(solved, (2, 1, 0))
