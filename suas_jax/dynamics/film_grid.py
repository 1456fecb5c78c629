"""Flow of a pad's film on a grid of samples, by finite volumes.

Links join neighbouring samples along the arc and along the axis. What a sample gains is what
its links bring; the pressures that do it follow from one scalar elliptic problem, solved row
after row along the arc (a block-tridiagonal system whose blocks off the diagonal are diagonal).
"""

from typing import Any, NamedTuple, Self

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.dynamics.inertia import Densities

Sides = tuple[Float[Array, "arc_link axial"], Float[Array, "arc axial_link"]]
"""Of links along the arc, and of those along the axis."""


class Links(NamedTuple):
    """Links between samples, over some time."""

    passage: Sides  # cross-section of the film [m^2]
    conductance: Sides  # flux by the pressure that drives it [m^3/(s Pa)]
    kept: Sides  # share of a velocity that is left without pressure

    @classmethod
    def over(
        cls,
        position: Float[Array, "3 arc axial"],  # of the samples [m]
        film: Float[Array, "arc axial"],  # thickness of the film there [m]
        given: Densities,  # of the oil, and its viscosity
        time: Array,  # in which a flow changes [s]
    ) -> Self:
        """Of a film."""
        lengths = [jnp.sqrt(jnp.sum(jnp.diff(position, axis=k) ** 2, 0)) for k in (1, 2)]
        rows = []
        for axis in (0, 1):
            # Width of the strip that a sample's flux has: half of either length beside it.
            ends = [[(0, 0)] * (1 - axis) + [pad] + [(0, 0)] * axis for pad in ((1, 0), (0, 1))]
            width = sum(jnp.pad(lengths[1 - axis], end) for end in ends) / 2
            passage, drained = (_mean(film**n * width, axis) for n in (1, 3))
            inert = given.oil / time
            slow = inert + 12 * given.viscosity * passage / drained
            rows.append((passage, passage / lengths[axis] / slow, inert / slow))
        first, second = rows
        return cls(*((a, b) for a, b in zip(first, second, strict=True)))

    def flow(
        self, room: Float[Array, "arc axial"], before: Sides
    ) -> tuple[Float[Array, "arc axial"], Sides]:
        """Pressures, and velocities along the links.

        `room`: what the film gains at every sample [m^3/s]; together nothing. `before`:
        velocities at the begin of the time.
        """
        kept = [a * b * c for a, b, c in zip(self.passage, self.kept, before, strict=True)]
        pressure = self.potential(-room - _leaving(kept))
        driven = [-jnp.diff(pressure, axis=k) * self.conductance[k] for k in (0, 1)]
        along, aside = ((a + b) / c for a, b, c in zip(kept, driven, self.passage, strict=True))
        return pressure, (along, aside)

    def squares(self, flow: Sides) -> Float[Array, "arc axial"]:
        """Square of the velocity at the samples."""
        along, aside = (jnp.pad(x**2, _beyond(k)) for k, x in enumerate(flow))
        return (along[1:] + along[:-1] + aside[:, 1:] + aside[:, :-1]) / 2

    def potential(
        self, source: Float[Array, "arc axial *right"]
    ) -> Float[Array, "arc axial *right"]:
        """Pressures that make samples lose what they have; together they have nothing."""
        along, aside = self.conductance
        rows, columns = (jnp.pad(x, _beyond(k)) for k, x in enumerate((along, aside)))
        own = rows[1:] + rows[:-1] + columns[:, 1:] + columns[:, :-1]
        # A pressure is known but for a constant: it is zero at the last sample.
        own = own.at[-1, -1].multiply(2.0)
        beside = jax.vmap(lambda x: jnp.diag(x, 1) + jnp.diag(x, -1))(aside)
        blocks = jax.vmap(jnp.diag)(own) - beside
        after = jnp.pad(along, ((0, 1), (0, 0)))
        right = source.reshape(*own.shape, -1)

        def forward(before: tuple[Array, Array, Array], row: tuple[Array, ...]) -> Any:
            inverse, y, link = before
            block, mine, following = row
            inverse = jnp.linalg.inv(block - link[:, None] * inverse * link)
            y = inverse @ (mine + link[:, None] * y)
            return (inverse, y, following), (inverse, y)

        def backward(later: Array, row: tuple[Array, Array, Array]) -> Any:
            inverse, y, link = row
            x = y + inverse @ (link[:, None] * later)
            return x, x

        none = jnp.zeros_like(blocks[0]), jnp.zeros_like(right[0]), jnp.zeros_like(after[0])
        _, (inverses, y) = jax.lax.scan(forward, none, (blocks, right, after))
        _, x = jax.lax.scan(backward, none[1], (inverses, y, after), reverse=True)
        return x.reshape(source.shape)


def areas_of(position: Float[Array, "3 arc axial"]) -> Float[Array, "3 arc axial"]:
    """Vectors of the area that a sample stands for, inwards [m^2]."""
    along, aside = (jnp.asarray(jnp.gradient(position, axis=k)) for k in (1, 2))
    count = position.shape[1:]
    return jnp.cross(along, aside, axis=0) * _ends(count[0])[:, None] * _ends(count[1])


def _ends(count: int) -> np.ndarray:
    """Ones, halves at both ends."""
    weights = np.ones(count)
    weights[[0, -1]] = 0.5
    return weights


def _beyond(axis: int) -> list[tuple[int, int]]:
    """No links beyond the ends."""
    return [(1, 1), (0, 0)] if axis == 0 else [(0, 0), (1, 1)]


def _leaving(flux: list[Array]) -> Array:
    """What leaves every sample."""
    along, aside = (jnp.pad(x, _beyond(k)) for k, x in enumerate(flux))
    return jnp.diff(along, axis=0) + jnp.diff(aside, axis=1)


def _mean(nodes: Array, axis: int) -> Array:
    """Values at the middle of links."""
    first = jax.lax.slice_in_dim(nodes, 0, -1, axis=axis)
    return (first + jax.lax.slice_in_dim(nodes, 1, None, axis=axis)) / 2
