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
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import lineax as lx
from jax.flatten_util import ravel_pytree
from jax.scipy.sparse.linalg import gmres
from jaxtyping import Array, Float, PyTree

from suas_jax.numerics.array_types import LaneCounts, Lanes, StationVector
from suas_jax.numerics.block_tridiagonal import AbstractTangent

# Of GMRES: relative residual at which it ends, and the largest that counts as a solution
_LAST, _LOOSE = 1e-12, 1e-9
_DIRECTIONS, _MOST_RESTARTS = 30, 5


class BorderedVector(NamedTuple):
    """Station unknowns and, unless the border is absent, the border's one."""

    stations: StationVector
    border: Lanes | None


class BorderedBlockTridiagonal(lx.AbstractLinearOperator):
    """A symmetric block-tridiagonal operator with an optional border.

    The border is symmetric too unless its row is given apart from its column.
    """

    tangent: AbstractTangent  # the block-tridiagonal part
    column: StationVector | None  # the border's column, equal to its row, or None
    corner: Lanes | None  # the border's diagonal entry, or None
    row: StationVector | None = None  # the border's row where it differs from the column

    def border(self) -> tuple[StationVector, StationVector, Lanes]:
        """Column, row and corner of an operator that has a border."""
        assert self.column is not None
        assert self.corner is not None
        return self.column, self.column if self.row is None else self.row, self.corner

    def mv(self, vector: BorderedVector) -> BorderedVector:
        """Matrix times vector."""
        x, z = vector
        y = self.tangent.mv(x)
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
        inner = self.tangent.structure
        borders = (x for x in (self.column, self.corner, self.row) if x is not None)
        lane = jnp.broadcast_shapes(inner.shape[-1:], *(x.shape[-1:] for x in borders))
        stations: Any = jax.ShapeDtypeStruct((*inner.shape[:-1], *lane), inner.dtype)
        border: Any = None
        if self.column is not None:
            border = jax.ShapeDtypeStruct(lane, inner.dtype)
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
    """Solutions of a bordered system and what its pivots say."""

    solution: BorderedVector  # unknowns, shaped like the right-hand side
    # number of negative eigenvalues of the whole bordered operator, by Sylvester's law of
    # inertia (meaningless where row and column differ). With the oil's constraint as border, an
    # equilibrium is stable on the constraint surface if and only if it is one (without border:
    # none).
    negative: LaneCounts
    smallest_pivot: Lanes  # smallest ratio of a pivot's magnitude to its diagonal entry


def eliminate(operator: BorderedBlockTridiagonal, right: BorderedVector) -> Elimination:
    """Solve a bordered block-tridiagonal system and report its inertia.

    One sweep carries the right-hand side and the border's column together.

    `operator`: the system.
    Returns the solution with the number of negative eigenvalues and the smallest pivot.
    """
    if right.border is None:
        sweep = operator.tangent.solve(right.stations[:, None])
        solution = BorderedVector(sweep.solution[:, 0], None)
        return Elimination(solution, sweep.negative, sweep.smallest_pivot)
    column, row, corner = operator.border()
    both = jnp.stack(jnp.broadcast_arrays(right.stations, column), 1)
    sweep = operator.tangent.solve(both)
    particular, border = sweep.solution[:, 0], sweep.solution[:, 1]
    schur = corner - jnp.sum(row * border, (0, 1))
    z = (right.border - jnp.sum(row * particular, (0, 1))) / schur
    return Elimination(
        BorderedVector(particular - border * z, z),
        sweep.negative + (schur < 0),
        sweep.smallest_pivot,
    )


def solve_bordered(operator: BorderedBlockTridiagonal, right: BorderedVector) -> BorderedVector:
    """Solve a bordered system, with derivatives of any order by either argument.

    As `lineax.linear_solve` with [`BlockElimination`][], whose derivatives call back into
    Python to raise: no program with such a call can be kept between runs.
    """
    # One array, as JAX transposes no solve of which a part alone depends on the inputs.
    flat, unravel = ravel_pytree(right)

    def solve(operator: BorderedBlockTridiagonal, flat: Array) -> Array:
        return ravel_pytree(eliminate(operator, unravel(flat)).solution)[0]

    solution = jax.lax.custom_linear_solve(
        lambda flat: ravel_pytree(operator.mv(unravel(flat)))[0],
        flat,
        lambda _, flat: solve(operator, flat),
        lambda _, flat: solve(operator.transpose(), flat),
    )
    found: BorderedVector = unravel(solution)
    return found


def solve_near(
    rest: Callable[[BorderedVector], BorderedVector],  # product of N with a vector
    operator: BorderedBlockTridiagonal,  # K
    right: BorderedVector,  # b
) -> BorderedVector:
    """Solve (K + N) x = b, with a bordered K, in either mode.

    By GMRES on K^-1 (K + N) x = K^-1 b, each lane's unknowns relative to their size in K^-1 b.

    Returns x; not a number where it does not converge.
    """
    flat, unravel = ravel_pytree(right)

    def product(x: Array) -> Array:
        y = unravel(x)
        return ravel_pytree(operator.mv(y))[0] + ravel_pytree(rest(y))[0]

    def solve(
        operator: BorderedBlockTridiagonal, product: Callable[[Array], Array], b: Array
    ) -> Array:
        def step(b: Array) -> Array:
            return ravel_pytree(solve_bordered(operator, unravel(b)))[0]

        def spread(x: Array) -> Array:
            largest = jnp.max(jnp.abs(x), tuple(range(x.ndim - 1)))
            return jnp.broadcast_to(jnp.where(largest > 0, largest, 1.0), x.shape)

        first = step(b)
        size = ravel_pytree(jax.tree.map(spread, unravel(first)))[0]
        start = first / size

        def near_one(x: Array) -> Array:
            return step(product(size * x)) / size

        x, _ = gmres(
            near_one,
            start,
            start,
            tol=_LAST,
            restart=_DIRECTIONS,
            maxiter=_MOST_RESTARTS,
            solve_method="incremental",
        )
        left = jnp.linalg.norm(near_one(x) - start)
        return jnp.where(left <= _LOOSE * jnp.linalg.norm(start), size * x, jnp.nan)

    solution = jax.lax.custom_linear_solve(
        product,
        flat,
        functools.partial(solve, operator),
        functools.partial(solve, operator.transpose()),
    )
    found: BorderedVector = unravel(solution)
    return found


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
