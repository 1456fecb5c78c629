"""Tangents along the arc, and how the shell's is eliminated.

The tangent of a mechanics couples a station to its two neighbours alone. What it is (its
product with a vector) and how it is solved belong together: small blocks are eliminated
unknown by unknown here, large ones with unknowns of their own inside the elements in
`suas_jax.mechanics.solid.tangent`.
"""

import abc
import functools
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from suas_jax.numerics.array_types import (
    Diagonal,
    LaneCounts,
    Lanes,
    OffDiagonal,
    StationVector,
)


def product(
    a: Float[Array, "dof row lane"], b: Float[Array, "dof column lane"]
) -> Float[Array, "row column lane"]:
    """The transpose of one small matrix times another, in every lane.

    Written out over the few rows: a batched contraction would loop over the lanes.
    """
    terms = [a[k, :, None] * b[k, None] for k in range(a.shape[0])]
    return functools.reduce(jnp.add, terms)


def at_stations(left: Array, right: Array) -> Array:
    """Sum what elements give to their left and their right stations [..., element, lane]."""
    rest = [(0, 0)] * (left.ndim - 2)
    return jnp.pad(left, [*rest, (0, 1), (0, 0)]) + jnp.pad(right, [*rest, (1, 0), (0, 0)])


class Sweep(NamedTuple):
    """Solutions of a tangent's linear system and what its pivots say."""

    solution: Float[Array, "dof right station lane"]  # one column per right-hand side
    # number of negative eigenvalues, those not counted that multipliers of the mechanics' own
    # constraints bring with them
    negative: LaneCounts
    smallest_pivot: Lanes  # smallest ratio of a pivot's magnitude to its diagonal entry


class AbstractTangent(eqx.Module):
    """A symmetric operator on station vectors that can be solved in one sweep."""

    @property
    @abc.abstractmethod
    def structure(self) -> jax.ShapeDtypeStruct:
        """Shape and type of the vectors it acts on."""

    @abc.abstractmethod
    def mv(self, x: StationVector) -> StationVector:
        """Matrix times vector."""

    @abc.abstractmethod
    def solve(self, right: Float[Array, "dof right station lane"]) -> Sweep:
        """Solve for several right-hand sides at once."""


class BlockTridiagonal(AbstractTangent):
    """Blocks of few unknowns, given as they are."""

    diagonal: Diagonal  # blocks on the diagonal, symmetric
    upper: OffDiagonal  # block i couples the equations of station i to the unknowns of i + 1

    @property
    def structure(self) -> jax.ShapeDtypeStruct:
        """Shape and type of the vectors it acts on."""
        dof, _, station, _ = self.diagonal.shape
        lane = jnp.broadcast_shapes(self.diagonal.shape[-1:], self.upper.shape[-1:])
        return jax.ShapeDtypeStruct((dof, station, *lane), self.diagonal.dtype)

    def mv(self, x: StationVector) -> StationVector:
        """Matrix times vector."""
        zero = jnp.zeros_like(x[:, :1])
        y = jnp.einsum("ab...,b...->a...", self.diagonal, x)
        above = jnp.einsum("ab...,b...->a...", self.upper, x[:, 1:])
        below = jnp.einsum("ab...,a...->b...", self.upper, x[:, :-1])
        return y + jnp.concatenate([above, zero], 1) + jnp.concatenate([zero, below], 1)

    def solve(self, right: Float[Array, "dof right station lane"]) -> Sweep:
        """Eliminate from both ends towards the middle station, then substitute back."""
        return _eliminate(self.diagonal, self.upper, right)


def _ldl_solve(
    a: Float[Array, "dof dof lane"], b: Float[Array, "dof right lane"]
) -> tuple[Float[Array, "dof right lane"], Float[Array, "dof lane"]]:
    """Solve small symmetric systems, one a lane, by LDL^T without pivoting.

    The loops run over the few unknowns of a station when the program is traced, every
    operation over all lanes. A batched LAPACK call would loop over lanes one by one and
    spend its time in pivot search. Indefinite blocks are welcome: beyond the point
    where the membrane alone would buckle, the trapped oil still holds it.

    Returns the solutions and the pivots.
    """
    n = a.shape[0]
    lower: dict[tuple[int, int], Array] = {}
    pivots: list[Array] = []
    for i in range(n):
        pivot = a[i, i]
        for k in range(i):
            pivot = pivot - lower[i, k] ** 2 * pivots[k]
        pivots.append(pivot)
        for j in range(i + 1, n):
            entry = a[j, i]
            for k in range(i):
                entry = entry - lower[j, k] * lower[i, k] * pivots[k]
            lower[j, i] = entry / pivot
    # Without the barrier the compiler fuses the factors into each of their uses and
    # computes them anew for every right-hand side.
    keys = list(lower)
    factors = jax.lax.optimization_barrier(jnp.stack(pivots + [lower[k] for k in keys]))
    pivot_array = factors[:n]
    lower = {key: factors[n + i] for i, key in enumerate(keys)}
    rows = list(b)
    for i in range(n):
        for k in range(i):
            rows[i] = rows[i] - lower[i, k] * rows[k]
    inverse = 1 / pivot_array
    rows = [row * inverse[i] for i, row in enumerate(rows)]
    for i in reversed(range(n)):
        for k in range(i + 1, n):
            rows[i] = rows[i] - lower[k, i] * rows[k]
    return jax.lax.optimization_barrier(jnp.stack(rows)), pivot_array


def _eliminate(
    diagonal: Diagonal, upper: OffDiagonal, right: Float[Array, "dof right station lane"]
) -> Sweep:
    """Eliminate from both ends towards the middle station, then substitute back.

    Both ends at once halve the number of sequential steps: the right half, reversed,
    rides along as further lanes.
    """
    dof, _, n, _ = diagonal.shape
    lane = max(x.shape[-1] for x in (diagonal, upper, right))
    diagonal, upper, right = (
        jnp.broadcast_to(x, (*x.shape[:-1], lane)) for x in (diagonal, upper, right)
    )
    half, even = n // 2, n % 2 == 0

    def stacked(x: Array) -> Array:
        return jnp.moveaxis(x, 2, 0)

    def halves(left: Array, mirrored: Array, fill: Array) -> Array:
        mirrored = stacked(mirrored[:, :, ::-1])
        if even:  # an uncoupled station at the outer end makes the halves equally long
            fill = jnp.broadcast_to(fill, (1, *mirrored.shape[1:]))
            mirrored = jnp.concatenate([fill, mirrored])
        return jnp.concatenate([stacked(left), mirrored], -1)

    identity = jnp.eye(dof, dtype=diagonal.dtype)[None, :, :, None]
    zero = jnp.zeros((), diagonal.dtype)
    transposed = jnp.swapaxes(upper[:, :, half:], 0, 1)
    chain = (
        halves(diagonal[:, :, :half], diagonal[:, :, half + 1 :], identity),
        halves(upper[:, :, :half], transposed, zero),
        halves(right[:, :, :half], right[:, :, half + 1 :], zero),
    )

    def forward(carry: tuple[Array, Array], station: tuple[Array, Array, Array]) -> Any:
        block, coupling, rhs = station
        block, rhs = block - carry[0], rhs - carry[1]
        joint, pivots = _ldl_solve(block, jnp.concatenate([coupling, rhs], 1))
        update = product(coupling, joint)
        return (update[:, :dof], update[:, dof:]), (joint[:, :dof], joint[:, dof:], pivots)

    start = (
        jnp.zeros((dof, dof, 2 * lane), diagonal.dtype),
        jnp.zeros((dof, right.shape[1], 2 * lane), diagonal.dtype),
    )
    carry, (coupled, reduced, outer_pivots) = jax.lax.scan(forward, start, chain)
    block, rhs = (
        x[:, :, half] - c[..., :lane] - c[..., lane:]
        for x, c in zip((diagonal, right), carry, strict=True)
    )
    middle, pivots = _ldl_solve(block, rhs)

    def backward(inner: Array, station: tuple[Array, Array]) -> tuple[Array, Array]:
        coupling, rhs = station
        x = rhs - sum(coupling[:, k, None] * inner[None, k] for k in range(dof))
        return x, x

    _, outer = jax.lax.scan(
        backward, jnp.concatenate([middle, middle], -1), (coupled, reduced), reverse=True
    )
    right_half = outer[1:] if even else outer
    solution = jnp.concatenate([outer[..., :lane], middle[None], right_half[::-1, ..., lane:]])
    size = jnp.stack([chain[0][:, k, k] for k in range(dof)], 1)
    outer_ratio = jnp.min(jnp.abs(outer_pivots / size), (0, 1), initial=jnp.inf)
    size = jnp.stack([diagonal[k, k, half] for k in range(dof)])
    ratio = jnp.min(jnp.abs(pivots / size), 0)
    negative = jnp.sum(outer_pivots < 0, (0, 1), dtype=jnp.int32)
    return Sweep(
        jnp.moveaxis(solution, 0, 2),
        negative[:lane] + negative[lane:] + jnp.sum(pivots < 0, 0, dtype=jnp.int32),
        jnp.minimum(jnp.minimum(outer_ratio[:lane], outer_ratio[lane:]), ratio),
    )
