"""The solid's tangent: condensed element by element and column by column, then swept.

Each element loses its centre and its linear pressures first, see `condensation`. The constant
pressures go next, with the displacements half-way between stations, a column of elements at a
time: a saddle point with as many negative eigenvalues as constraints while the material
holds. Every one of them that is missing or in excess belongs to the membrane and is counted.

Nodes across the thickness are eliminated as the displacement of the innermost one and the
differences between neighbours. Those of slender elements cost the cube of length over height
more than bending does: in the nodes' own displacements that leaves too few digits.
"""

import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.mechanics.solid.condensation import Condensed
from suas_jax.mechanics.solid.layout import Layout
from suas_jax.numerics.array_types import StationVector
from suas_jax.numerics.block_sweep import factorise, solve, symmetric_inverse
from suas_jax.numerics.block_tridiagonal import AbstractTangent, Sweep

# First and last of the element's nodes on the left, on the right and in the middle, and by
# how many displacements those of the next layer lie further on.
_GROUPS = {"left": (0, 3, 4), "right": (3, 6, 4), "middle": (6, 8, 2)}


class _Bases(NamedTuple):
    """Unknowns as sums of differences between neighbours across the thickness."""

    station: Float[Array, "dof dof"]  # displacements of a station [row, column]
    sides: Float[Array, "2*dof 2*dof"]  # those of two stations
    # what is left inside a column of elements, pressures as they are
    column: Float[Array, "row row"]

    @classmethod
    def of(cls, layout: Layout) -> "_Bases":
        """The bases of a layout. `layout`: numbers of elements."""

        def sums(nodes: int) -> np.ndarray:
            return np.kron(np.tri(nodes), np.eye(2))

        station, middle = sums(layout.nodes), sums(layout.layers + 1)
        column = np.eye(len(middle) + layout.layers)
        column[: len(middle), : len(middle)] = middle
        sides = np.kron(np.eye(2), station)
        return cls(*(jnp.asarray(x) for x in (station, sides, column)))


class _Columns(NamedTuple):
    """Condensed columns of elements, matrix by matrix [element, lane, row, column]."""

    inverse: Array
    carried: Array
    pivots: Array


class ElementTangent(AbstractTangent):
    """The tangent as element matrices."""

    # blocks (xx, yy, xy) of the nine nodes' matrix
    stiffness: Float[Array, "9 9 3 layer element lane"]
    # derivative of the pressures' equations by the displacements
    constraint: Float[Array, "9 3 2 layer element lane"]
    # factor [Pa/m^2] on the square of an element's change of volume, which the constraint makes
    # zero: it changes no solution and keeps pivots away from zero
    penalty: Float[Array, "layer element #lane"]
    # which displacements of the two end stations may move [dof, end]
    free: tuple[tuple[bool, ...], tuple[bool, ...]] = eqx.field(static=True)
    layout: Layout = eqx.field(static=True)  # numbers of elements

    @property
    def structure(self) -> jax.ShapeDtypeStruct:
        """Shape and type of the vectors it acts on."""
        shape = (self.layout.size, self.layout.elements + 1, self.stiffness.shape[-1])
        return jax.ShapeDtypeStruct(shape, self.stiffness.dtype)

    def mask(self) -> Float[np.ndarray, "dof station 1"]:
        """One where a station's displacement may move, zero where it is held."""
        return self.layout.mask(self.free)

    def mv(self, x: StationVector) -> StationVector:
        """Matrix times vector; held and unused places are multiplied by one."""
        mask, dof = self.mask(), self.layout.dof
        u, p = self.layout.gather(jnp.concatenate([x[:dof] * mask, x[dof:]]))
        xx, yy, xy = (self.stiffness[:, :, i] for i in range(3))
        along = jnp.einsum("nm...,m...->n...", xx, u[:, 0])
        along = along + jnp.einsum("nm...,m...->n...", xy, u[:, 1])
        upward = jnp.einsum("nm...,m...->n...", yy, u[:, 1])
        upward = upward + jnp.einsum("mn...,m...->n...", xy, u[:, 0])
        force = jnp.stack([along, upward], 1)
        force = force + jnp.einsum("nac...,a...->nc...", self.constraint, p)
        change = jnp.einsum("nac...,nc...->a...", self.constraint, u)
        y = self.layout.scatter(force, change, mask)
        unused = jnp.zeros_like(x).at[:dof].set(x[:dof] * (1 - mask))
        return y + unused.at[dof:, -1].set(x[dof:, -1])

    def solve(self, right: Float[Array, "dof right station lane"]) -> Sweep:
        """Condense, sweep along the arc, recover; see the module."""
        layout, mask, bases = self.layout, self.mask(), _Bases.of(self.layout)
        element = Condensed.of(self.stiffness, self.constraint, self.penalty)
        columns, diagonal, upper = self._columns(element, bases)
        factors = factorise(diagonal, upper)

        lanes = max(right.shape[-1], self.stiffness.shape[-1])
        right = jnp.broadcast_to(right, (*right.shape[:-1], lanes))
        count = right.shape[1]
        stations, inside = right[: layout.dof] * mask[:, None], right[layout.dof :, :, :-1]
        middle = inside[: layout.dof].reshape(-1, 2, *inside.shape[1:])
        pressure = inside[layout.dof :].reshape(3, layout.layers, *inside.shape[1:])
        force = jnp.moveaxis(middle[1::2], 0, 2)  # at the centres [2, right, layer, ...]
        pressure = jnp.moveaxis(pressure, 1, 2)
        fixed, change = element.reduced(force, pressure)
        lines = {
            name: _placed(change[first:last].reshape(-1, *change.shape[2:]), step)
            for name, (first, last, step) in _GROUPS.items()
        }
        free = middle[::2].reshape(-1, *middle.shape[2:]) - lines["middle"]
        own = jnp.concatenate([free, jnp.moveaxis(pressure[0], 1, 0)])
        own = bases.column.T @ _batched(own)
        kept = columns.inverse @ own
        back = columns.carried.mT @ own
        sides = jnp.concatenate([lines["left"], lines["right"]])
        sides = bases.sides.T @ _batched(sides) + back
        dof = layout.dof
        rest = bases.station.T @ jnp.moveaxis(stations, (2, 3), (0, 1))
        rest = rest - jnp.pad(sides[:, :, :dof], [(0, 1), (0, 0), (0, 0), (0, 0)])
        rest = rest - jnp.pad(sides[:, :, dof:], [(1, 0), (0, 0), (0, 0), (0, 0)])
        held_rows = jnp.moveaxis(right[:dof] * (1 - mask[:, None]), (2, 3), (0, 1))
        rest = rest * jnp.moveaxis(mask, (1, 2), (0, 1))[..., None] + held_rows

        x = solve(factors, rest)
        moved = x * jnp.moveaxis(mask, (1, 2), (0, 1))[..., None]
        both = jnp.concatenate([moved[:-1], moved[1:]], 2)
        found = bases.column @ (kept - columns.carried @ both)
        found = jnp.moveaxis(found, (0, 1), (2, 3))
        both = jnp.moveaxis(bases.sides @ both, (0, 1), (2, 3))
        x = bases.station @ moved + (x - moved)  # places that are held stay as they are
        free, mean = found[: 2 * layout.layers + 2], found[2 * layout.layers + 2 :]
        outer = jnp.concatenate(
            [_taken(both[:dof], 3, 4), _taken(both[dof:], 3, 4), _taken(free, 2, 2)]
        )  # [node, component, right, layer, ...]
        centre, linear = element.recovered(outer, fixed, force)
        pressure = jnp.concatenate([jnp.moveaxis(mean, 1, 0)[None], linear])
        pressure = jnp.moveaxis(pressure, 2, 1).reshape(-1, count, *inside.shape[2:])
        even = free.reshape(-1, 2, *free.shape[1:])
        odd = jnp.moveaxis(centre, 2, 0)
        woven = jnp.stack([even[:-1], odd], 1).reshape(-1, *even.shape[1:])
        woven = jnp.concatenate([woven, even[-1:]])
        inside = jnp.concatenate([woven.reshape(-1, *free.shape[1:]), pressure])
        inside = jnp.concatenate([inside, right[dof:, :, -1:]], 2)
        solution = jnp.concatenate([jnp.moveaxis(x, (0, 1), (2, 3)), inside])

        negative = _count(columns.pivots, (0, 2)) - layout.layers * layout.elements
        outer_pivots = factors.pivots.reshape(factors.pivots.shape[0], 2, lanes, dof)
        negative = negative + _count(outer_pivots, (0, 1, 3))
        negative = negative + _count(factors.middle_pivots, (1,))
        scale = jnp.max(jnp.abs(jnp.diagonal(diagonal, axis1=-2, axis2=-1)), (0, 2))
        smallest = jnp.minimum(
            jnp.min(jnp.abs(outer_pivots), (0, 1, 3), initial=jnp.inf),
            jnp.min(jnp.abs(factors.middle_pivots), 1),
        )
        return Sweep(solution, negative, smallest / scale)

    def _columns(self, element: Condensed, bases: _Bases) -> tuple[_Columns, Array, Array]:
        """Eliminate what is left inside the columns; blocks of the stations."""
        k, mean, dof = element.stiffness, element.mean, self.layout.dof
        tail = k.shape[4:]

        def block(row: str, column: str) -> Array:
            (r0, r1, rs), (c0, c1, cs) = _GROUPS[row], _GROUPS[column]
            part = k[r0:r1, :, c0:c1].reshape(2 * (r1 - r0), 2 * (c1 - c0), *tail)
            return _placed_twice(part, rs, cs)

        def pressure(row: str) -> Array:
            first, last, step = _GROUPS[row]
            part = mean[first:last].reshape(2 * (last - first), 1, *tail)
            return _placed_twice(part, step, 1)

        sides = ("left", "right")
        couple = pressure("middle")
        zero = jnp.zeros((couple.shape[1], *couple.shape[1:]), couple.dtype)
        own = jnp.concatenate(
            [
                jnp.concatenate([block("middle", "middle"), couple], 1),
                jnp.concatenate([jnp.swapaxes(couple, 0, 1), zero], 1),
            ]
        )
        across = jnp.concatenate(
            [
                jnp.concatenate([block("middle", side) for side in sides], 1),
                jnp.concatenate([jnp.swapaxes(pressure(side), 0, 1) for side in sides], 1),
            ]
        )
        own = bases.column.T @ _batched(own) @ bases.column
        inverse, pivots = symmetric_inverse(own)
        across = bases.column.T @ _batched(across) @ bases.sides
        carried = inverse @ across
        removed = across.mT @ carried

        def station(row: str, column: str) -> Array:
            return bases.station.T @ _batched(block(row, column)) @ bases.station

        left = station("left", "left") - removed[..., :dof, :dof]
        upper = station("left", "right") - removed[..., :dof, dof:]
        right = station("right", "right") - removed[..., dof:, dof:]
        ends = [(0, 0)] * 3
        diagonal = jnp.pad(left, [(0, 1), *ends]) + jnp.pad(right, [(1, 0), *ends])
        mask = self.mask()[:, :, 0].T[:, None]
        rows, columns = mask[..., :, None], mask[..., None, :]
        diagonal = diagonal * (rows * columns) + np.eye(dof) * (1 - rows)
        upper = upper * (rows[:-1] * columns[1:])
        return _Columns(inverse, carried, pivots), diagonal, upper


def _count(pivots: Array, axes: tuple[int, ...]) -> Array:
    return jnp.sum(pivots < 0, axes, dtype=jnp.int32)


def _batched(x: Array) -> Array:
    """[row, column, element, lane] to [element, lane, row, column]."""
    return jnp.moveaxis(x, (2, 3), (0, 1))


def _placed(x: Array, step: int) -> Array:
    """Sum layers' vectors [row, right, layer, ...], each `step` rows further on."""
    layers = x.shape[2]
    rest = [(0, 0)] * (x.ndim - 2)
    return functools.reduce(
        jnp.add,
        [
            jnp.pad(x[:, :, j], [(step * j, step * (layers - 1 - j)), *rest])
            for j in range(layers)
        ],
    )


def _placed_twice(x: Array, down: int, along: int) -> Array:
    """Sum layers' matrices [row, column, layer, ...], each further down and along."""
    layers = x.shape[2]
    rest = [(0, 0)] * (x.ndim - 3)

    def room(step: int, j: int) -> tuple[int, int]:
        return step * j, step * (layers - 1 - j)

    return functools.reduce(
        jnp.add,
        [jnp.pad(x[:, :, j], [room(down, j), room(along, j), *rest]) for j in range(layers)],
    )


def _taken(line: Array, nodes: int, step: int) -> Array:
    """Nodes of every layer from a line of them: [node, component, right, layer, ...]."""
    layers = (line.shape[0] - 2 * nodes) // step + 1
    parts = [line[step * j : step * j + 2 * nodes] for j in range(layers)]
    x = jnp.stack(parts, 2)
    return x.reshape(nodes, 2, *x.shape[1:])
