"""Bordered block-tridiagonal systems: what they are and how they are solved.

Along the arc a station is coupled to its two neighbours alone, so the tangent of any of
the mechanics is block-tridiagonal; the oil ties all stations together through one more
unknown and one more equation, the border::

    [ K   c ] [x]   [f]
    [ c^T d ] [z] = [g]

Lineax sees an ordinary linear operator and solver; the structure stays in this file.
"""

import dataclasses
import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import lineax as lx
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, PyTree

from suas_jax._types import Diagonal, LaneCounts, Lanes, OffDiagonal, StationVector


class BorderedVector(NamedTuple):
    """Station unknowns and, unless the border is absent, the border's one."""

    stations: StationVector
    border: Lanes | None


class BorderedBlockTridiagonal(lx.AbstractLinearOperator):
    """A symmetric block-tridiagonal operator with an optional border.

    The border is symmetric too unless its row is given apart from its column.

    Attributes:
        diagonal: blocks on the diagonal, symmetric.
        upper: block i couples the equations of station i to the unknowns of i + 1.
        column: the border's column, equal to its row, or None.
        corner: the border's diagonal entry, or None.
        row: the border's row where it differs from the column.
    """

    diagonal: Diagonal
    upper: OffDiagonal
    column: StationVector | None
    corner: Lanes | None
    row: StationVector | None = None

    def border(self) -> tuple[StationVector, StationVector, Lanes]:
        """Column, row and corner of an operator that has a border."""
        assert self.column is not None
        assert self.corner is not None
        return self.column, self.column if self.row is None else self.row, self.corner

    def mv(self, vector: BorderedVector) -> BorderedVector:
        """Matrix times vector."""
        x, z = vector
        zero = jnp.zeros_like(x[:, :1])
        y = jnp.einsum("ab...,b...->a...", self.diagonal, x)
        above = jnp.einsum("ab...,b...->a...", self.upper, x[:, 1:])
        below = jnp.einsum("ab...,a...->b...", self.upper, x[:, :-1])
        y = y + jnp.concatenate([above, zero], 1) + jnp.concatenate([zero, below], 1)
        if z is None:
            return BorderedVector(y, None)
        column, row, corner = self.border()
        return BorderedVector(y + column * z, jnp.sum(row * x, (0, 1)) + corner * z)

    def as_matrix(self) -> Float[Array, "n n"]:
        """Dense matrix (for tests and small problems)."""
        structure = self.in_structure()
        zeros = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), structure)
        flat, unravel = ravel_pytree(zeros)
        columns = jax.vmap(lambda e: ravel_pytree(self.mv(unravel(e)))[0])
        return columns(jnp.eye(flat.size, dtype=flat.dtype)).T

    def transpose(self) -> "BorderedBlockTridiagonal":
        """Row and column of the border change places; all else is symmetric."""
        if self.row is None:
            return self
        return dataclasses.replace(self, column=self.row, row=self.column)

    def in_structure(self) -> BorderedVector:
        """Shapes of the vectors it acts on."""
        dof, _, station, _ = self.diagonal.shape
        lane = jnp.broadcast_shapes(*(x.shape[-1:] for x in jax.tree.leaves(self)))
        dtype = self.diagonal.dtype
        stations: Any = jax.ShapeDtypeStruct((dof, station, *lane), dtype)
        border: Any = None if self.column is None else jax.ShapeDtypeStruct(lane, dtype)
        return BorderedVector(stations, border)

    def out_structure(self) -> BorderedVector:
        """Shapes of the vectors it returns."""
        return self.in_structure()


@lx.is_symmetric.register(BorderedBlockTridiagonal)
def _(operator: BorderedBlockTridiagonal) -> bool:
    return operator.row is None


for _check in (
    lx.is_diagonal,
    lx.is_tridiagonal,
    lx.is_lower_triangular,
    lx.is_upper_triangular,
    lx.is_positive_semidefinite,
    lx.is_negative_semidefinite,
    lx.has_unit_diagonal,
):

    @_check.register(BorderedBlockTridiagonal)
    def _(operator: BorderedBlockTridiagonal) -> bool:
        return False


for _transform in (lx.linearise, lx.materialise, lx.conj):

    @_transform.register(BorderedBlockTridiagonal)
    def _(operator: BorderedBlockTridiagonal) -> BorderedBlockTridiagonal:
        return operator


class Elimination(NamedTuple):
    """Solutions of a bordered system and what its pivots say.

    Attributes:
        solution: unknowns, shaped like the right-hand side.
        negative: number of negative eigenvalues of the whole bordered operator, by
            Sylvester's law of inertia (meaningless where row and column differ). With the
            oil's constraint as border, an equilibrium is stable on the constraint surface
            if and only if it is one (without border: none).
        smallest_pivot: smallest ratio of a pivot's magnitude to its diagonal entry.
    """

    solution: BorderedVector
    negative: LaneCounts
    smallest_pivot: Lanes


def product(
    a: Float[Array, "dof row lane"], b: Float[Array, "dof column lane"]
) -> Float[Array, "row column lane"]:
    """The transpose of one small matrix times another, in every lane.

    Written out over the few rows: a batched contraction would loop over the lanes.
    """
    terms = [a[k, :, None] * b[k, None] for k in range(a.shape[0])]
    return functools.reduce(jnp.add, terms)


class _Sweep(NamedTuple):
    solution: Float[Array, "dof right station lane"]
    negative: LaneCounts
    smallest_pivot: Lanes


def _ldl_solve(
    a: Float[Array, "dof dof lane"], b: Float[Array, "dof right lane"]
) -> tuple[Float[Array, "dof right lane"], Float[Array, "dof lane"]]:
    """Solve small symmetric systems, one a lane, by LDL^T without pivoting.

    The loops run over the few unknowns of a station when the program is traced, every
    operation over all lanes. A batched LAPACK call would loop over lanes one by one and
    spend its time in pivot search. Indefinite blocks are welcome: beyond the point
    where the membrane alone would buckle, the trapped oil still holds it.

    Returns:
        The solutions and the pivots.
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
) -> _Sweep:
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
    return _Sweep(
        jnp.moveaxis(solution, 0, 2),
        negative[:lane] + negative[lane:] + jnp.sum(pivots < 0, 0, dtype=jnp.int32),
        jnp.minimum(jnp.minimum(outer_ratio[:lane], outer_ratio[lane:]), ratio),
    )


def eliminate(operator: BorderedBlockTridiagonal, right: BorderedVector) -> Elimination:
    """Solve a bordered block-tridiagonal system and report its inertia.

    One sweep carries the right-hand side and the border's column together.

    Args:
        operator: the system.
        right: right-hand side.

    Returns:
        The solution with the number of negative eigenvalues and the smallest pivot.
    """
    if right.border is None:
        sweep = _eliminate(operator.diagonal, operator.upper, right.stations[:, None])
        solution = BorderedVector(sweep.solution[:, 0], None)
        return Elimination(solution, sweep.negative, sweep.smallest_pivot)
    column, row, corner = operator.border()
    both = jnp.stack(jnp.broadcast_arrays(right.stations, column), 1)
    sweep = _eliminate(operator.diagonal, operator.upper, both)
    particular, border = sweep.solution[:, 0], sweep.solution[:, 1]
    schur = corner - jnp.sum(row * border, (0, 1))
    z = (right.border - jnp.sum(row * particular, (0, 1))) / schur
    return Elimination(
        BorderedVector(particular - border * z, z),
        sweep.negative + (schur < 0),
        sweep.smallest_pivot,
    )


class BlockElimination(lx.AbstractLinearSolver[BorderedBlockTridiagonal]):
    """Direct solver for [`BorderedBlockTridiagonal`][] operators.

    Factorisation and substitution are one sweep, so nothing is prepared in `init`; under
    `vmap` over right-hand sides the factors are computed once.
    """

    def init(
        self, operator: lx.AbstractLinearOperator, options: dict[str, Any]
    ) -> BorderedBlockTridiagonal:
        """Accept the operator; see the base class."""
        del options
        if not isinstance(operator, BorderedBlockTridiagonal):
            raise ValueError("BlockElimination solves BorderedBlockTridiagonal operators only")
        return operator

    def compute(
        self, state: BorderedBlockTridiagonal, vector: PyTree[Array], options: dict[str, Any]
    ) -> tuple[PyTree[Array], lx.RESULTS, dict[str, Any]]:
        """Solve; the statistics carry the inertia and the smallest pivot."""
        del options
        result = eliminate(state, vector)
        statistics = {"negative": result.negative, "smallest_pivot": result.smallest_pivot}
        return result.solution, lx.RESULTS.successful, statistics

    def transpose(
        self, state: BorderedBlockTridiagonal, options: dict[str, Any]
    ) -> tuple[BorderedBlockTridiagonal, dict[str, Any]]:
        """The transposed operator is its own state."""
        return state.transpose(), options

    def conj(
        self, state: BorderedBlockTridiagonal, options: dict[str, Any]
    ) -> tuple[BorderedBlockTridiagonal, dict[str, Any]]:
        """The system is real."""
        return state, options

    def assume_full_rank(self) -> bool:
        """Singular systems have no solution here."""
        return True
