"""Block-banded symmetric systems: the tangent of a tensor-product cubic spline shell.

Along the axis of stations a cubic spline couples a station to the next three. With some
dozens of unknowns a station the work is in products of their blocks, as in
`suas_jax.numerics.block_sweep`: arrays here are [..., row, column]. A system is factorised
once, as A = F S F^T with F block lower triangular and S = diag(+-1), by one scan over the
stations; any number of right-hand sides then costs two sweeps of thin products each. Nothing
pivots, so indefinite systems are welcome, and S counts the negative eigenvalues (Sylvester).
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.numerics.array_types import StationVector
from suas_jax.numerics.block_tridiagonal import AbstractTangent, Sweep

REACH = 3  # stations to either side that a station is coupled to

# Columns eliminated one by one before the rest of the block is updated at once.
_PANEL = 24

Bands = Float[Array, "lane station 4 dof dof"]


class Factors(NamedTuple):
    """Factors A = F S F^T of a block-banded system.

    Attributes:
        inverse: inverses of F's blocks on the diagonal, lower triangular.
        below: F's blocks below the diagonal, those of a column on top of each other.
        pivots: of the elimination unknown by unknown; S holds their signs.
        smallest_pivot: smallest ratio of a pivot's magnitude to its diagonal entry.
    """

    inverse: Float[Array, "lane station dof dof"]
    below: Float[Array, "lane station 3*dof dof"]
    pivots: Float[Array, "lane station dof"]
    smallest_pivot: Float[Array, " lane"]


class BlockBanded(AbstractTangent):
    """A symmetric operator that couples a station to the next three.

    Attributes:
        bands: block o of station i couples the equations of station i + o to the unknowns
            of station i, so that the four blocks of a station are one column of the lower
            triangle; blocks beyond the last station are ignored.
        free: which unknowns are free, station by station; the equations of the others are
            replaced by those of the identity. All are free if None.
    """

    bands: Bands
    free: tuple[tuple[bool, ...], ...] | None = eqx.field(static=True, default=None)

    @property
    def structure(self) -> jax.ShapeDtypeStruct:
        """Shape and type of the vectors it acts on."""
        lanes, stations, _, dof, _ = self.bands.shape
        return jax.ShapeDtypeStruct((dof, stations, lanes), self.bands.dtype)

    def mv(self, x: StationVector) -> StationVector:
        """Matrix times vector; held unknowns are multiplied by one."""
        mask = jnp.ones((), x.dtype) if self.free is None else self._mask().T[:, :, None]
        rows = jnp.moveaxis(x * mask, (2, 1), (0, 1))
        n = rows.shape[1]
        y = jnp.einsum("...sij,...sj->...si", self.bands[:, :, 0], rows)
        for o in range(1, min(REACH + 1, n)):
            block = self.bands[:, : n - o, o]
            y = y.at[:, o:].add(jnp.einsum("...sij,...sj->...si", block, rows[:, : n - o]))
            y = y.at[:, : n - o].add(jnp.einsum("...sij,...si->...sj", block, rows[:, o:]))
        y = jnp.moveaxis(y, (0, 1), (2, 1))
        return y * mask + x * (1 - mask)

    def solve(self, right: Float[Array, "dof right station lane"]) -> Sweep:
        """Factorise and substitute."""
        factors = factorise(self)
        return Sweep(
            solve_with(factors, right),
            jnp.sum(factors.pivots < 0, (1, 2), dtype=jnp.int32),
            factors.smallest_pivot,
        )

    def _mask(self) -> Float[np.ndarray, "station dof"]:
        """One where an unknown is free, zero where it is held."""
        return np.asarray(self.free, self.bands.dtype)


def factorise(tangent: BlockBanded) -> Factors:
    """Factorise block-banded systems, lane after lane."""
    mask = None if tangent.free is None else tangent._mask()
    if tangent.bands.shape[0] == 1:
        return jax.tree.map(lambda x: x[None], _factorised(tangent.bands[0], mask))
    return jax.lax.map(lambda bands: _factorised(bands, mask), tangent.bands)


def solve_with(
    factors: Factors, right: Float[Array, "dof right station lane"]
) -> Float[Array, "dof right station lane"]:
    """Solve with factorised systems, for any number of right-hand sides.

    Args:
        factors: of one system for all lanes, or of one a lane.
        right: right-hand sides; one lane is taken for every system.
    """
    dof, count, stations, lanes = right.shape
    if factors.pivots.shape[0] == 1:
        rows = jnp.moveaxis(right, 2, 0).reshape(stations, dof, count * lanes)
        x = _substituted(*(x[0] for x in factors[:3]), jnp.swapaxes(rows, 1, 2))
        return (
            jnp.moveaxis(jnp.swapaxes(x, 1, 2), 0, 1)
            .reshape(dof, stations, count, lanes)
            .swapaxes(1, 2)
        )
    lanes = factors.pivots.shape[0]
    rows = jnp.broadcast_to(right, (*right.shape[:-1], lanes)).transpose(3, 2, 1, 0)
    x = jax.lax.map(lambda a: _substituted(*a), (*factors[:3], rows))
    return x.transpose(3, 2, 1, 0)


def _factorised(
    bands: Float[Array, "station 4 dof dof"], mask: Float[np.ndarray, "station dof"] | None
) -> Factors:
    """Factorise one system, column of blocks after column of blocks (left-looking)."""
    stations, _, dof, _ = bands.shape
    columns: Any = (bands.reshape(stations, 4 * dof, dof), None)
    if mask is not None:
        beyond = np.concatenate([mask, np.ones((REACH, dof), mask.dtype)])
        rows = np.concatenate([beyond[o : o + stations] for o in range(REACH + 1)], 1)
        columns = (columns[0], (rows, mask))

    def column(carry: tuple[Array, Array, Array], station: Any) -> Any:
        one, two, three = carry  # of the last station, the one before and so on
        block, held = station
        if held is not None:
            rows, own = held
            block = block * (rows[:, None] * own)
            block = block.at[:dof].add(jnp.diag(1 - own))
        diagonal = jnp.diagonal(block[:dof])
        for k, (panel, sign) in enumerate((one, two, three)):
            update = panel @ (panel[:dof] * sign).T
            block = block.at[: (REACH - k) * dof].add(-update)
        inverse, pivots = _inverse_factor(block[:dof])
        sign = jnp.sign(pivots)
        below = (block[dof:] @ inverse.T) * sign
        carry = ((below, sign), (one[0][dof:], one[1]), (two[0][dof:], two[1]))
        return carry, (inverse, below, pivots, jnp.min(jnp.abs(pivots / diagonal)))

    start = tuple(
        (jnp.zeros((k * dof, dof), bands.dtype), jnp.ones(dof, bands.dtype)) for k in (3, 2, 1)
    )
    _, (inverse, below, pivots, ratio) = jax.lax.scan(column, start, columns)
    return Factors(inverse, below, pivots, jnp.min(ratio))


def _substituted(
    inverse: Float[Array, "station dof dof"],
    below: Float[Array, "station 3*dof dof"],
    pivots: Float[Array, "station dof"],
    right: Float[Array, "station right dof"],
) -> Float[Array, "station right dof"]:
    """Substitute forwards, then backwards; a right-hand side is a row."""
    _, count, dof = right.shape

    def forward(carry: Array, station: tuple[Array, ...]) -> Any:
        inverse, below, mine = station
        y = (mine - carry[:, :dof]) @ inverse.T
        later = jnp.pad(carry[:, dof:], [(0, 0), (0, dof)])
        return later + y @ below.T, y

    def backward(carry: Array, station: tuple[Array, ...]) -> Any:
        inverse, below, mine = station
        x = (mine - carry @ below) @ inverse
        return jnp.concatenate([x, carry[:, : 2 * dof]], 1), x

    start = jnp.zeros((count, REACH * dof), right.dtype)
    _, y = jax.lax.scan(forward, start, (inverse, below, right))
    y = y * jnp.sign(pivots)[:, None]
    _, x = jax.lax.scan(backward, start, (inverse, below, y), reverse=True)
    return x


def _inverse_factor(
    a: Float[Array, "dof dof"],
) -> tuple[Float[Array, "dof dof"], Float[Array, " dof"]]:
    """T and the pivots with T A T^T = diag(sign of pivots), T lower triangular.

    A panel of rows is eliminated at a time. What is left of A lies to the right of the
    panel's columns, T so far to the left, in one array: the same product updates both.
    """
    size = a.shape[0]
    panels = -(-size // _PANEL)
    width = -(-size // panels)
    fill = panels * width - size
    a = jnp.pad(a, [(0, fill), (0, fill)])
    a = a + np.diag(np.arange(size + fill) >= size).astype(a.dtype)
    index = np.arange(size + fill)
    unit = jnp.eye(width, dtype=a.dtype)

    def panel(k: Array, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        a, pivots = carry
        first = k * width
        rows = jax.lax.dynamic_slice(a, (first, 0), (width, index.size))
        small, found = _small_inverse_factor(
            jax.lax.dynamic_slice(rows, (0, first), (width, width))
        )
        rows = small @ jax.lax.dynamic_update_slice(rows, unit, (0, first))
        columns = jax.lax.dynamic_slice(a, (0, first), (index.size, width))
        behind = (index >= first + width)[:, None]
        left = jnp.where(behind, columns, 0) @ small.T * jnp.sign(found)
        a = jax.lax.dynamic_update_slice(a, jnp.where(behind, 0, columns), (0, first))
        a = a - left @ rows
        rows = jnp.where(index < first + width, rows, 0)
        a = jax.lax.dynamic_update_slice(a, rows, (first, 0))
        return a, jax.lax.dynamic_update_slice(pivots, found, (first,))

    start = (a, jnp.zeros(index.size, a.dtype))
    a, pivots = jax.lax.fori_loop(0, panels, panel, start)
    return a[:size, :size], pivots[:size]


def _small_inverse_factor(
    a: Float[Array, "dof dof"],
) -> tuple[Float[Array, "dof dof"], Float[Array, " dof"]]:
    """As `_inverse_factor`, unknown by unknown."""
    index = np.arange(a.shape[0])

    def step(k: Array, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        a, pivots = carry
        row = jax.lax.dynamic_index_in_dim(a, k, 0, keepdims=False)
        column = jax.lax.dynamic_index_in_dim(a, k, 1, keepdims=False)
        here = index == k
        left = jnp.where(index > k, column / row[k], 0)
        a = jnp.where(here, here[:, None], a) - left[:, None] * jnp.where(here, 1, row)
        return a, jnp.where(here, row[k], pivots)

    a, pivots = jax.lax.fori_loop(0, index.size, step, (a, jnp.zeros(index.size, a.dtype)))
    lower = jnp.where(index[:, None] >= index, a, 0)
    return lower / jnp.sqrt(jnp.abs(pivots))[:, None], pivots
