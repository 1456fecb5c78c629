"""A number that varies along the arc: a cubic spline through the values of a table."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.interpolate import CubicSpline

from suas_jax.numerics.newton_polynomial import polynomial


class Along(eqx.Module):
    """The cubic spline through values at fractions of the inner face's arc.

    Two continuous derivatives; not-a-knot at the ends. It is linear in the values, so that
    the places alone make its matrix.

    Attributes:
        at: the fractions, from 0 at the left clamp to 1 at the right one.
        values: there [place, lane].
        mirrored: whether the right half is the mirror image of the left one.
    """

    at: tuple[float, ...] = eqx.field(static=True)
    values: Float[Array, "place #lane"]
    mirrored: bool = eqx.field(static=True, default=False)

    def __call__(self, fraction: Float[Array, "*shape #lane"]) -> Float[Array, "*shape lane"]:
        """The number at fractions of the arc."""
        knots = np.array(self.at)
        # [power, interval, place], in distances from the knots.
        powers = np.asarray(CubicSpline(knots, np.eye(len(knots))).c)[::-1]
        table = jnp.einsum("pik,kl->pil", powers, self.values)
        inside = jnp.sum(fraction[..., None] >= knots[1:-1], -1)
        x = fraction - jnp.asarray(knots)[inside]
        lane = jnp.arange(table.shape[-1])
        return polynomial([row[inside, lane] for row in table], x)

    def mean(self) -> Float[Array, " #lane"]:
        """Over the arc."""
        knots = np.array(self.at)
        weights = [float(CubicSpline(knots, row).integrate(0, 1)) for row in np.eye(len(knots))]
        return jnp.asarray(weights) @ self.values
