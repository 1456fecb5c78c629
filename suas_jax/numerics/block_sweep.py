"""Block-tridiagonal systems with large blocks: inverses by blocks, products by matrix.

With a dozen unknowns a station and more, the work is in products of small matrices, which
the compiler does well when a batch of them lies matrix by matrix in memory: arrays here are
[..., row, column], unlike elsewhere. Nothing pivots, so indefinite blocks are welcome and
the signs of the pivots count negative eigenvalues.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

# Inverted at once inside the sweep along the arc: fewer, larger operations.
_SWEEP_BLOCK = 6

Matrices = Float[Array, "*batch row column"]


def _leaf(a: Matrices) -> tuple[Matrices, Float[Array, "*batch row"]]:
    """Inverse and pivots of symmetric matrices of up to three rows, by LDL^T.

    Cofactors would be shorter and lose twice the digits.
    """
    n = a.shape[-1]
    first = a[..., 0, 0]
    p = 1 / first
    if n == 1:
        return p[..., None, None], first[..., None]
    m = -a[..., 0, 1] * p  # entries of the inverse of L
    second = a[..., 1, 1] + a[..., 0, 1] * m
    q = 1 / second
    if n == 2:
        rows = [[p + m * m * q, m * q], [m * q, q]]
        return _stacked(rows), jnp.stack([first, second], -1)
    mixed = a[..., 1, 2] + a[..., 0, 2] * m
    k = -mixed * q
    j = -a[..., 0, 2] * p + k * m
    third = a[..., 2, 2] - a[..., 0, 2] ** 2 * p + mixed * k
    r = 1 / third
    off = m * q + j * k * r
    rows = [
        [p + m * m * q + j * j * r, off, j * r],
        [off, q + k * k * r, k * r],
        [j * r, k * r, r],
    ]
    return _stacked(rows), jnp.stack([first, second, third], -1)


def _stacked(rows: list[list[Array]]) -> Matrices:
    return jnp.stack([jnp.stack(row, -1) for row in rows], -2)


def symmetric_inverse(a: Matrices) -> tuple[Matrices, Float[Array, "*batch row"]]:
    """Invert symmetric matrices by halves, for large batches.

    `a`: matrices whose leading minors don't vanish: order the unknowns so that definite ones
    come before the multipliers of their constraints.
    Returns the inverses, and the pivots of the LDL^T factorisation, whose signs are those of
    the eigenvalues (Sylvester).
    """
    n = a.shape[-1]
    if n <= 3:
        return _leaf(a)
    half = 3 * max(1, n // 6)
    p, b, d = a[..., :half, :half], a[..., :half, half:], a[..., half:, half:]
    inverse, first = symmetric_inverse(p)
    x = inverse @ b
    complement, second = symmetric_inverse(d - b.mT @ x)
    y = x @ complement
    top = jnp.concatenate([inverse + y @ x.mT, -y], -1)
    bottom = jnp.concatenate([-y.mT, complement], -1)
    return jnp.concatenate([top, bottom], -2), jnp.concatenate([first, second], -1)


def swept_inverse(a: Matrices) -> tuple[Matrices, Float[Array, "*batch row"]]:
    """Invert like `symmetric_inverse`, by few large operations, for small batches.

    Blocks of unknowns change sides one after the other (the sweep operator).
    """
    n = a.shape[-1]
    pivots = []
    for k in range(0, n, _SWEEP_BLOCK):
        end = min(k + _SWEEP_BLOCK, n)
        inverse, found = symmetric_inverse(a[..., k:end, k:end])
        pivots.append(found)
        zero = jnp.zeros_like(inverse)
        minus = jnp.broadcast_to(-jnp.eye(end - k, dtype=a.dtype), inverse.shape)
        row, column = a[..., k:end, :], a[..., :, k:end]
        row = jnp.concatenate([row[..., :k], minus, row[..., end:]], -1)
        row = inverse @ row
        column = jnp.concatenate([column[..., :k, :], zero, column[..., end:, :]], -2)
        mask = jnp.ones(n, a.dtype).at[k:end].set(0)
        rest = a * (mask * mask[:, None]) - column @ row
        a = jnp.concatenate([rest[..., :k, :], row, rest[..., end:, :]], -2)
    return -a, jnp.concatenate(pivots, -1)


class Factors(NamedTuple):
    """Factors of block-tridiagonal systems, eliminated from both ends to the middle.

    The right half, reversed, rides along as further lanes, which halves the number of
    steps that wait for each other.
    """

    # of the outer stations' blocks when their turn came [step, 2 lane, ...]
    inverse: Float[Array, "step lanes row column"]
    # of each outer station to its inner neighbour
    coupling: Float[Array, "step lanes row column"]
    middle: Float[Array, "lane row column"]  # inverse of the middle block [lane, ...]
    pivots: Float[Array, "step lanes row"]  # of the outer stations [step, 2 lane, row]
    middle_pivots: Float[Array, "lane row"]  # of the middle station [lane, row]


def _halves(left: Array, right: Array, fill: Array) -> Array:
    """Join the left half and the reversed right half, made as long, as lanes."""
    right = right[::-1]
    if right.shape[0] < left.shape[0]:  # an uncoupled station at the outer end
        fill = jnp.broadcast_to(fill, (1, *right.shape[1:]))
        right = jnp.concatenate([fill, right])
    return jnp.concatenate([left, right], 1)


def factorise(
    diagonal: Float[Array, "station lane row column"],  # blocks on the diagonal
    # block i couples the equations of station i to the unknowns of i + 1
    upper: Float[Array, "element lane row column"],
) -> Factors:
    """Factorise symmetric block-tridiagonal systems."""
    stations, lanes, n, _ = diagonal.shape
    half = stations // 2
    zero = jnp.zeros((), diagonal.dtype)
    chain = (
        _halves(diagonal[:half], diagonal[half + 1 :], jnp.eye(n, dtype=diagonal.dtype)),
        _halves(upper[:half], upper[half:].mT, zero),
    )

    def forward(update: Array, station: tuple[Array, Array]) -> Any:
        block, coupling = station
        block = block - update
        inverse, pivots = swept_inverse(block)
        return coupling.mT @ (inverse @ coupling), (inverse, pivots)

    start = jnp.zeros((2 * lanes, n, n), diagonal.dtype)
    update, (inverse, pivots) = jax.lax.scan(forward, start, chain)
    last = diagonal[half] - update[:lanes] - update[lanes:]
    middle, middle_pivots = symmetric_inverse(last)
    return Factors(inverse, chain[1], middle, pivots, middle_pivots)


def solve(
    factors: Factors, right: Float[Array, "station lane row right"]
) -> Float[Array, "station lane row right"]:
    """Solve with factorised systems, for any number of right-hand sides."""
    stations, lanes, n, columns = right.shape
    half = stations // 2
    sides = _halves(right[:half], right[half + 1 :], jnp.zeros((), right.dtype))

    def forward(update: Array, station: tuple[Array, ...]) -> Any:
        inverse, coupling, mine = station
        kept = inverse @ (mine - update)
        return coupling.mT @ kept, kept

    start = jnp.zeros((2 * lanes, n, columns), right.dtype)
    update, kept = jax.lax.scan(forward, start, (factors.inverse, factors.coupling, sides))
    middle = factors.middle @ (right[half] - update[:lanes] - update[lanes:])

    def backward(inner: Array, station: tuple[Array, ...]) -> Any:
        inverse, coupling, kept = station
        x = kept - inverse @ (coupling @ inner)
        return x, x

    both = jnp.concatenate([middle, middle])
    chain = (factors.inverse, factors.coupling, kept)
    _, outer = jax.lax.scan(backward, both, chain, reverse=True)
    right_half = outer[1:] if stations % 2 == 0 else outer
    return jnp.concatenate([outer[:, :lanes], middle[None], right_half[::-1, lanes:]])
