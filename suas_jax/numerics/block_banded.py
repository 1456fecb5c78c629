"""Block-banded symmetric systems: the tangent of a tensor-product cubic spline shell.

Along the axis of stations a cubic spline couples a station to the next three. With some
dozens of unknowns a station the work is in products of their blocks, as in
`suas_jax.numerics.block_sweep`: arrays here are [..., row, column]. A system is factorised
once, as A = F S F^T with F block lower triangular and S = diag(+-1), by one scan over the
stations; any number of right-hand sides then costs two sweeps of thin products each. Nothing
pivots, so indefinite systems are welcome, and S counts the negative eigenvalues (Sylvester).
"""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from suas_jax.numerics.array_types import StationVector
from suas_jax.numerics.block_tridiagonal import AbstractTangent, Sweep

REACH = 3  # stations to either side that a station is coupled to

# Matrices of up to so many rows are factorised unknown by unknown, larger ones by halves.
_LEAF = 40
# Up to so many right-hand sides are multiplied one by one: a product of matrices would
# spend more time on rearranging the large one.
_FEW = 4

Bands: TypeAlias = Float[Array, "lane station 4 dof dof"]
# Blocks of F below the diagonal and the signs of the pivots, of one station.
_Column: TypeAlias = tuple[Array, Array]


class Factors(NamedTuple):
    """Factors A = F S F^T of a block-banded system."""

    # inverses of F's blocks on the diagonal, lower triangular
    inverse: Float[Array, "lane station dof dof"]
    # F's blocks below the diagonal, those of a column on top of each other
    below: Float[Array, "lane station 3*dof dof"]
    # of the elimination unknown by unknown; S holds their signs
    pivots: Float[Array, "lane station dof"]
    # smallest ratio of a pivot's magnitude to its diagonal entry
    smallest_pivot: Float[Array, " lane"]

    @property
    def negative(self) -> Int[Array, " lane"]:
        """Number of negative eigenvalues."""
        return jnp.sum(self.pivots < 0, (1, 2), dtype=jnp.int32)


class BlockBanded(AbstractTangent):
    """A symmetric operator that couples a station to the next three."""

    # block o of station i couples the equations of station i + o to the unknowns of station i,
    # so that the four blocks of a station are one column of the lower triangle; blocks beyond
    # the last station are ignored (but must be finite)
    bands: Bands
    # which unknowns are free, station by station; the equations of the others are replaced by
    # those of the identity. All are free if None.
    free: tuple[tuple[bool, ...], ...] | None = eqx.field(static=True, default=None)
    # unknowns among them that each bring a negative eigenvalue
    # whatever the state is; not counted
    multipliers: int = eqx.field(static=True, default=0)
    factors: Factors | None = None  # of the system, where they are known

    @property
    def structure(self) -> jax.ShapeDtypeStruct:
        """Shape and type of the vectors it acts on."""
        lanes, stations, _, dof, _ = self.bands.shape
        return jax.ShapeDtypeStruct((dof, stations, lanes), self.bands.dtype)

    def mv(self, x: StationVector) -> StationVector:
        """Matrix times vector; held unknowns are multiplied by one."""
        mask = jnp.ones((), x.dtype) if self.free is None else self.mask().T[:, :, None]
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
        """Factorise, unless that has been done, and substitute."""
        factors = factorise(self) if self.factors is None else self.factors
        solution = solve_with(factors, right)
        lanes = solution.shape[-1:]
        return Sweep(
            solution,
            jnp.broadcast_to(factors.negative - self.multipliers, lanes),
            jnp.broadcast_to(factors.smallest_pivot, lanes),
        )

    def factorised(self) -> "BlockBanded":
        """The system with its factors, for solves that follow one another."""
        return dataclasses.replace(self, factors=factorise(self))

    def mask(self) -> Float[np.ndarray, "station dof"]:
        """One where an unknown is free, zero where it is held."""
        return np.asarray(self.free, self.bands.dtype)


def factorise(tangent: BlockBanded) -> Factors:
    """Factorise block-banded systems.

    A pivot that vanishes leaves no finite factors. One lane goes after the other: as an axis
    of every product lanes take up to 1.7 times as long.
    """
    mask = None if tangent.free is None else tangent.mask()
    return _each(lambda bands: _factorised(bands, mask), tangent.bands)


def solve_with(
    factors: Factors, right: Float[Array, "dof right station #lane"]
) -> Float[Array, "dof right station lane"]:
    """Solve with factorised systems, for any number of right-hand sides.

    `factors`: of one system for all lanes, or of one a lane. `right`: right-hand sides; one
    lane is taken for every system.
    """
    systems = factors.pivots.shape[0]
    if systems == 1:  # the lanes are so many more right-hand sides
        dof, count, stations, lanes = right.shape
        rows = right.transpose(2, 1, 3, 0).reshape(1, stations, count * lanes, dof)
        x = _each(_substituted, (*factors[:3], rows))[0]
        return x.reshape(stations, count, lanes, dof).transpose(3, 1, 0, 2)
    rows = jnp.broadcast_to(right, (*right.shape[:-1], systems)).transpose(3, 2, 1, 0)
    return _each(_substituted, (*factors[:3], rows)).transpose(3, 2, 1, 0)


def refined(
    tangent: BlockBanded,  # the system
    factors: Factors,  # its own, or those of a neighbouring system (a chord step)
    right: Float[Array, "dof right station #lane"],
    solution: Float[Array, "dof right station lane"],  # of which the residual is taken
) -> Float[Array, "dof right station lane"]:
    """One step of iterative refinement towards the solution of a system."""
    product = jax.vmap(tangent.mv, 1, 1)(solution)
    return solution + solve_with(factors, right - product)


def _each(function: Callable[[Any], Any], arguments: Any) -> Any:
    """A function of one lane for all of them, one after the other."""
    if jax.tree.leaves(arguments)[0].shape[0] == 1:
        found = function(jax.tree.map(lambda x: x[0], arguments))
        return jax.tree.map(lambda x: x[None], found)
    return jax.lax.map(function, arguments)


def _factorised(
    bands: Float[Array, "station 4 dof dof"], mask: Float[np.ndarray, "station dof"] | None
) -> Factors:
    """Factorise one system, column of blocks after column of blocks (left-looking).

    What the last three columns take from this one is computed when its turn comes. Every
    product is of rows with rows, which is twice as fast as of columns with columns.
    """
    stations, _, dof, _ = bands.shape
    held: Any = None
    if mask is not None:
        beyond = np.concatenate([mask, np.ones((REACH, dof), mask.dtype)])
        held = np.stack([beyond[o : o + stations] for o in range(REACH + 1)], 1)

    def column(carry: tuple[_Column, ...], station: tuple[Array, Any]) -> Any:
        block, free = station
        if free is not None:
            block = block * (free[:, :, None] * free[0])
            block = block.at[0].add(jnp.diag(1 - free[0]))
        one, two, three = (
            (below @ (below[:dof] * sign).T).reshape(-1, dof, dof) for below, sign in carry
        )
        own = block[0] - one[0] - two[0] - three[0]
        inverse, pivots = _inverse_factor(own)
        sign = jnp.sign(pivots)
        rest = jnp.concatenate([block[1] - one[1] - two[1], block[2] - one[2], block[3]])
        below = (rest @ inverse.T) * sign
        first, second, _ = carry
        carry = ((below, sign), (first[0][dof:], first[1]), (second[0][dof:], second[1]))
        ratio = jnp.min(jnp.abs(pivots / jnp.diagonal(block[0])))
        return carry, (inverse, below, pivots, ratio)

    start: tuple[_Column, ...] = tuple(
        (jnp.zeros((k * dof, dof), bands.dtype), jnp.ones(dof, bands.dtype)) for k in (3, 2, 1)
    )
    _, found = jax.lax.scan(column, start, (bands, held))
    inverse, below, pivots, ratio = found
    return Factors(inverse, below, pivots, jnp.min(ratio))


def _substituted(system: tuple[Array, ...]) -> Float[Array, "station right dof"]:
    """Substitute forwards, then backwards, in one factorised system.

    `system`: inverses, blocks below, pivots and right-hand sides, which are rows [station,
    right, dof].
    """
    inverse, below, pivots, right = system
    _, count, dof = right.shape

    def forward(known: Array, station: tuple[Array, ...]) -> Any:
        inverse, below, mine = station
        y = _times(inverse, mine - known[:, :dof])
        return jnp.pad(known[:, dof:], [(0, 0), (0, dof)]) + _times(below, y), y

    def backward(later: Array, station: tuple[Array, ...]) -> Any:
        inverse, below, mine = station
        x = _times(inverse.T, mine - _times(below.T, later))
        return jnp.concatenate([x, later[:, : 2 * dof]], 1), x

    start = jnp.zeros((count, REACH * dof), right.dtype)
    _, y = jax.lax.scan(forward, start, (inverse, below, right))
    y = y * jnp.sign(pivots)[:, None]
    _, x = jax.lax.scan(backward, start, (inverse, below, y), reverse=True)
    return x


def _times(
    matrix: Float[Array, "row column"], vectors: Float[Array, "right column"]
) -> Float[Array, "right row"]:
    """A matrix times each of the vectors."""
    if vectors.shape[0] > _FEW:
        return vectors @ matrix.T
    return jnp.stack([matrix @ vector for vector in vectors])


def _inverse_factor(
    a: Float[Array, "dof dof"],
) -> tuple[Float[Array, "dof dof"], Float[Array, " dof"]]:
    """T and the pivots with T A T^T = diag(sign of pivots), T lower triangular.

    Without LAPACK: its Cholesky factorisation saves a sixth of the whole time, but not where
    blocks are indefinite, its triangular solves start threads that wait for each other on a
    busy machine, and compiled programs that call a library can't be kept between runs.
    """
    size = a.shape[0]
    if size <= _LEAF:
        return _small_inverse_factor(a)
    half = size // 2
    first, upper_pivots = _inverse_factor(a[:half, :half])
    below = a[half:, :half] @ first.T
    signed = below * jnp.sign(upper_pivots)
    second, lower_pivots = _inverse_factor(a[half:, half:] - signed @ below.T)
    top = jnp.pad(first, [(0, 0), (0, size - half)])
    bottom = jnp.concatenate([-(second @ (signed @ first)), second], 1)
    return jnp.concatenate([top, bottom]), jnp.concatenate([upper_pivots, lower_pivots])


def _small_inverse_factor(
    a: Float[Array, "dof dof"],
) -> tuple[Float[Array, "dof dof"], Float[Array, " dof"]]:
    """As `_inverse_factor`, unknown by unknown.

    What is left of A lies in the columns not yet eliminated and T so far in the others: the
    same product updates both.
    """
    index = np.arange(a.shape[0])

    def step(k: Array, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        a, pivots = carry
        row = jax.lax.dynamic_index_in_dim(a, k, 0, keepdims=False)
        here = index == k
        left = jnp.where(index > k, row / row[k], 0)  # the column, by symmetry
        a = jnp.where(here, here[:, None], a) - left[:, None] * jnp.where(here, 1, row)
        return a, jnp.where(here, row[k], pivots)

    a, pivots = jax.lax.fori_loop(0, index.size, step, (a, jnp.zeros(index.size, a.dtype)))
    lower = jnp.where(index[:, None] >= index, a, 0)
    return lower / jnp.sqrt(jnp.abs(pivots))[:, None], pivots
