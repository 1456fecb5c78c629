"""The pad's stiffness matrix: from second derivatives at points to bands of stations.

Elements go through one scan along the stations, a row of elements across at a time: small
enough for the cache. Quadrature points are summed along the stations first, then across: a
fifth of the operations of one sum over both. Along the stations the table already holds the
splines of that row, across it holds Bernstein polynomials, turned into control values
afterwards.
"""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from suas_jax.mechanics.pad.mid_surface import total
from suas_jax.mechanics.pad.net import Net, Tables
from suas_jax.numerics.block_banded import REACH
from suas_jax.numerics.bspline import SplineAxis

# Upper bands of a matrix on all control values along the stations, in Cartesian components:
# by offset along, control value of the row, offset across, components, station across.
Upper = Float[Array, "4 control 7 width width across"]

# The same with components last, as single blocks are added to it.
Blocks = Float[Array, "4 control across 7 width width"]

# Pairs of an element's control values, row first, by offset.
SLOTS = [(i, i + o) for o in range(4) for i in range(4 - o)]
ROWS, COLUMNS = np.array(SLOTS).T
_ACROSS = range(-REACH, REACH + 1)


def upper_bands(
    net: Net,
    tables: Tables,
    pairs: Sequence[tuple[int, int]],  # of kinds of derivatives
    kinds: Sequence[tuple[int, int]],  # orders of differentiation along the stations, across
    # second derivatives of a density by each pair, times powers of the lengths across
    blocks: Float[Array, "pair width width gauss gauss long across"],
    lengths: Float[Array, " long"],  # of the elements along the stations [m]
) -> Upper:
    """Sum the elements."""
    topology = net.topology
    mixed = np.array([k for k, (left, right) in enumerate(pairs) if left != right])
    every = [*pairs, *(pairs[k][::-1] for k in mixed)]
    # Pairs of a group have the same orders across, and so the same table there.
    across_of = [(kinds[left][1], kinds[right][1]) for left, right in every]
    by_group = sorted(range(len(every)), key=across_of.__getitem__)
    groups = sorted(set(across_of))
    ends = np.cumsum([across_of.count(group) for group in groups])[:-1]
    splines = jnp.einsum("oga,iae->ogie", tables.long, net.along)
    powers = jnp.stack([lengths**-order for order in range(3)])
    splines = splines * powers[:, None, None]
    left, right = (np.array([kinds[every[k][side]][0] for k in by_group]) for side in (0, 1))
    table = splines[left][:, :, ROWS] * splines[right][:, :, COLUMNS]
    table = table * (tables.weights[:, None, None] * lengths)
    table = jnp.transpose(table, (3, 2, 0, 1))  # [element, slots, pair, gauss]
    shapes = np.stack([tables.across[group] for group in groups])  # [group, gauss, 16]
    bernstein = jnp.asarray(shapes.reshape(-1, 16).T)
    count, gauss = topology.across.elements, len(tables.weights)
    # Extraction across for the components of rows and of columns.
    width = topology.width
    shape = (4, 4, width, width, count)
    by_slot = jnp.moveaxis(net.across, 0, 2)  # [control, Bernstein, component, element]
    of_rows = jnp.broadcast_to(by_slot[:, :, :, None], shape).reshape(4, 4, 1, 1, -1)
    of_columns = jnp.broadcast_to(by_slot[:, :, None], shape).reshape(4, 4, 1, -1)

    def row(_: None, at: tuple[Array, Array]) -> tuple[None, Array]:
        block, mine = at
        block = jnp.concatenate([block, jnp.swapaxes(block[mixed], 3, 4)])[np.array(by_group)]
        by_groups = zip(jnp.split(mine, ends, 1), jnp.split(block, ends), strict=True)
        halves = [
            products.reshape(len(SLOTS), -1) @ points.reshape(products[0].size, -1)
            for products, points in by_groups
        ]
        along = jnp.stack(halves).reshape(len(groups), len(SLOTS), gauss, -1)
        k = bernstein @ jnp.swapaxes(along, 1, 2).reshape(len(groups) * gauss, -1)
        k = k.reshape(4, 4, len(SLOTS), width**2 * count)
        k = total(k[a] * of_rows[:, a] for a in range(4))
        k = total(k[:, a, None] * of_columns[:, a] for a in range(4))
        k = k.reshape(4, 4, len(SLOTS), width, width, count)
        return None, jnp.stack([_by_diagonal(k, o, topology.across) for o in _ACROSS], 1)

    rows = jnp.transpose(blocks, (5, 0, 3, 4, 1, 2, 6))
    _, found = jax.lax.scan(row, None, (rows, table))
    bands, first = [], 0
    for o in range(REACH + 1):
        slots = range(4 - o)
        parts = [found[:, first + i] for i in slots]
        first += len(parts)
        controls = topology.long.first[:, None] + np.arange(4)
        bands.append(_summed(parts, slots, 0, controls, topology.long.stations + 2))
    return jnp.stack(bands)


def no_blocks(net: Net) -> Blocks:
    """A matrix without entries."""
    topology = net.topology
    shape = (REACH + 1, topology.long.stations + 2, topology.across.stations, len(_ACROSS))
    return jnp.zeros((*shape, 3, 3), net.frames.dtype)


def add_blocks(
    net: Net,
    sum_so_far: Blocks,  # the matrix
    # index along the stations and across of every place
    element: tuple[Int[Array, " place"], Int[Array, " place"]],
    # by `SLOTS` along the stations, row and column across, components
    blocks: Float[Array, "slot place 4 4 3 3"],
) -> Blocks:
    """Add elements' blocks to a matrix."""
    topology = net.topology
    control = jnp.asarray(topology.long.first)[element[0]] + ROWS[:, None]
    station = jnp.asarray(topology.across.station_of)[element[1]]
    # Places of what is not a station are beyond the end, and dropped.
    place = jnp.where(station < 0, topology.across.stations, station)
    diagonal = REACH + np.arange(4) - np.arange(4)[:, None]
    index = (
        (COLUMNS - ROWS)[:, None, None, None],
        control[:, :, None, None],
        place[None, :, :, None],
        diagonal[None, None],
    )
    return sum_so_far.at[index].add(blocks, mode="drop")


def upper_of(blocks: Blocks) -> Upper:
    """Bands from a matrix of blocks."""
    return jnp.transpose(blocks, (0, 1, 3, 4, 5, 2))


def dense_bands(net: Net, upper: Upper) -> Float[Array, "station 4 dof dof"]:
    """Lower bands of stations, in local components, as dense blocks."""
    folded = _folded(upper, net)[:, 1:-1]
    return _dense(_turned(folded, net))


def _by_diagonal(k: Array, offset: int, across: SplineAxis) -> Array:
    """Sum elements across, on the diagonal with an offset."""
    slots = range(max(0, -offset), min(4, 4 - offset))
    parts = [k[i, i + offset] for i in slots]
    return _summed(parts, slots, -1, across.station_of, across.stations)


def _summed(parts: list[Array], slots: range, axis: int, where: np.ndarray, size: int) -> Array:
    """Sum what elements give to their control values.

    `parts`: one for each of `slots`, elements along an axis. `slots`: which of an element's
    control values. `where`: place of each element's control values [element, 4]; none if
    negative. `size`: number of places.
    """
    count = len(where)
    even = np.all(np.diff(where[:, 1:3], axis=0) == 1)
    total: Array | float = 0.0
    for slot, part in zip(slots, parts, strict=True):
        room = [(0, 0, 0)] * part.ndim
        zero = jnp.zeros((), part.dtype)
        if even:
            start = int(where[0, 1]) + slot - 1
            room[axis] = (start, size - count - start, 0)
            total = total + jax.lax.pad(part, zero, room)
        else:
            room[axis] = (0, 1, 0)
            element = np.full(size + 1, count)
            element[where[:, slot]] = np.arange(count)
            total = total + jnp.take(jax.lax.pad(part, zero, room), element[:-1], axis)
    return total  # type: ignore[return-value]


def _transposed(x: Float[Array, "7 3 3 across"]) -> Array:
    """The transpose of a block."""
    rows = [jnp.roll(x[REACH - o], -o, -1) for o in _ACROSS]
    return jnp.swapaxes(jnp.stack(rows), 1, 2)


def _folded(upper: Upper, net: Net) -> Upper:
    """Add what belongs to images beyond mirror planes to what they are images of."""
    axis, odd = net.topology.long, np.array(net.topology.parities[0], float)
    loose = 1.0 - np.array(net.topology.held)
    add: list[tuple[int, int, Any]] = []
    last = axis.stations + 1
    if np.any(loose):
        # The first control value at an open end is that of the next one.
        rows, columns = loose[:, None, None], loose[:, None]
        if axis.left == "open":
            one = upper[1, 0] * rows
            add.append((0, 1, upper[0, 0] * rows * columns + one + _transposed(one)))
            add += [(o - 1, 1, upper[o, 0] * rows) for o in (2, 3)]
        if axis.right == "open":
            one = upper[1, last - 1] * columns
            add.append((0, last - 1, upper[0, last] * rows * columns + one + _transposed(one)))
            add += [(o - 1, last - o, upper[o, last - o] * columns) for o in (2, 3)]
    rows, columns = odd[:, None, None], odd[:, None]
    if axis.left == "mirror":
        itself, two = upper[0, 0] * rows * columns, upper[2, 0] * rows
        add.append((0, 2, itself + two + _transposed(two)))
        add.append((1, 1, _transposed(upper[1, 0] * rows)))
        add.append((1, 2, upper[3, 0] * rows))
    if axis.right == "mirror":
        itself, two = upper[0, last] * rows * columns, upper[2, last - 2] * columns
        add.append((0, last - 2, itself + two + _transposed(two)))
        add.append((1, last - 2, _transposed(upper[1, last - 1] * columns)))
        add.append((1, last - 3, upper[3, last - 3] * columns))
    for offset, control, block in add:
        upper = upper.at[offset, control].add(block)
    return upper


def _turned(x: Float[Array, "4 station 7 width width across"], net: Net) -> Array:
    """Turn Cartesian components into local ones."""
    frames = net.frames[:2, 1]  # sine and cosine, with their signs, of the arc's columns
    if net.topology.along_arc:
        rows = frames[:, None, :, None, None, None, None]
        ahead = jnp.stack([jnp.roll(frames, -o, 1) for o in range(REACH + 1)], 1)
        columns = ahead[:, :, :, None, None, None, None]
    else:
        rows = frames[:, None, None, None, None, None]
        ahead = jnp.stack([jnp.roll(frames, -o, 1) for o in _ACROSS], 1)
        columns = ahead[:, None, None, :, None, None]
    for axis, (sine, cosine) in ((3, rows), (4, columns)):
        parts = [
            jax.lax.slice_in_dim(x, c, c + 1, axis=axis) for c in range(net.topology.width)
        ]
        for k in range(0, 3 * net.topology.vectors, 3):
            across, up = parts[k : k + 2]
            parts[k : k + 2] = cosine * across + sine * up, cosine * up - sine * across
        x = jnp.concatenate(parts, axis)
    return x


def _dense(
    x: Float[Array, "4 station 7 width width across"],
) -> Float[Array, "station 4 dof dof"]:
    """Lower dense blocks from upper bands."""
    count, diagonals, n, width = x.shape[1], x.shape[2], x.shape[5], x.shape[3]
    x = jnp.transpose(x, (1, 0, 4, 3, 5, 2))  # [..., row, diagonal]
    others = x.shape[:-2]
    # Read with rows one shorter than they are, every row moves on by one more column.
    wide = jnp.pad(x, [(0, 0)] * 5 + [(0, n)]).reshape(*others, n * (n + diagonals))
    rows = wide[..., : n * (n + diagonals - 1)].reshape(*others, n, n + diagonals - 1)
    square = rows[..., REACH : REACH + n]  # [station, offset, column c, row c, row, column]
    return jnp.transpose(square, (0, 1, 5, 2, 4, 3)).reshape(count, 4, width * n, width * n)
