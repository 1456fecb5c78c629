"""A number that varies over the skin: cubic splines through the values of a table."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.polynomials import polynomial


class Along(eqx.Module):
    """The cubic spline through values at fractions of the inner face's arc.

    Two continuous derivatives; not-a-knot at the ends. It is linear in the values, so that
    the places alone make its matrix.
    """

    # the fractions, from 0 at the left clamp to 1 at the right one
    at: tuple[float, ...] = eqx.field(static=True)
    values: Float[Array, "place #lane"]  # there [place, lane]
    # whether the right half is the mirror image of the left one
    mirrored: bool = eqx.field(static=True, default=False)

    def __call__(self, fraction: Float[Array, "*shape #lane"]) -> Float[Array, "*shape lane"]:
        """The number at fractions of the arc."""
        knots = np.array(self.at)
        table = jnp.einsum("pik,kl->pil", _powers(self.at), self.values)
        inside = jnp.sum(fraction[..., None] >= knots[1:-1], -1)
        x = fraction - jnp.asarray(knots)[inside]
        lane = jnp.arange(table.shape[-1])
        return polynomial([row[inside, lane] for row in table], x)

    def mean(self) -> Float[Array, " #lane"]:
        """Over the arc."""
        return jnp.asarray(_weights(self.at)) @ self.values


class Sheet(eqx.Module):
    """The product of two cubic splines, along the arc and along the axis; see `Along`."""

    # fractions of the inner face's arc, and of the length along the axis
    at: tuple[tuple[float, ...], tuple[float, ...]] = eqx.field(static=True)
    # there [place along the arc, place along the axis, lane]
    values: Float[Array, "arc axial #lane"]
    width: Lanes  # the length along the axis [m]
    # whether the right half is the mirror image of the left one
    mirrored: bool = eqx.field(static=True, default=False)

    def __call__(
        self, fraction: Float[Array, "*shape #lane"], axial: Float[Array, "*shape #lane"]
    ) -> Float[Array, "*shape lane"]:
        """The number at fractions of the arc and positions along the axis from its middle."""
        both = jnp.broadcast_arrays(fraction, 0.5 + axial / self.width)
        shares = [_shares(at, x) for at, x in zip(self.at, both, strict=True)]
        values = jnp.expand_dims(self.values, tuple(range(2, 1 + both[0].ndim)))
        return jnp.sum(values * shares[0][:, None] * shares[1], (0, 1))

    def mean(self) -> Along:
        """Over the length, along the arc."""
        values = jnp.einsum("b,abl->al", _weights(self.at[1]), self.values)
        return Along(self.at[0], values, self.mirrored)

    def beyond_mean(self) -> "Sheet":
        """What is left without the mean over the length."""
        rest = self.values - self.mean().values[:, None]
        return Sheet(self.at, rest, self.width, self.mirrored)


def _powers(at: tuple[float, ...]) -> Float[np.ndarray, "power interval place"]:
    """Of the splines through one at a place and zero at the others, from the knots."""
    from scipy.interpolate import CubicSpline  # a fifth of the package's imports

    return np.asarray(CubicSpline(np.array(at), np.eye(len(at))).c)[::-1]


def _weights(at: tuple[float, ...]) -> Float[np.ndarray, " place"]:
    """Of the values in their mean."""
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(np.array(at), np.eye(len(at)))
    return np.asarray(spline.integrate(0, 1))


def _shares(at: tuple[float, ...], x: Array) -> Float[Array, "place *shape"]:
    """Of the values in the spline at fractions."""
    knots = np.array(at)
    inside = jnp.sum(x[..., None] >= knots[1:-1], -1)
    table = jnp.moveaxis(jnp.asarray(_powers(at))[:, inside], -1, 1)  # [power, place, *shape]
    return polynomial(list(table), x - jnp.asarray(knots)[inside])
