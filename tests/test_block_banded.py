"""Block-banded systems against dense linear algebra."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.extend.core import jaxprs_in_params

from suas_jax.numerics.block_banded import REACH, BlockBanded, factorise, refined, solve_with
from suas_jax.numerics.bordered_solve import BorderedBlockTridiagonal, BorderedVector, eliminate

DOF, LANES = 3, 2
factorise, solve_with, refined = (jax.jit(f) for f in (factorise, solve_with, refined))
Mask = tuple[tuple[bool, ...], ...]


@jax.jit
def solved(tangent: BlockBanded, right: jax.Array) -> Any:
    return tangent.solve(right), tangent.mv(right[:, 0])


def bands_of(matrix: np.ndarray, dof: int) -> np.ndarray:
    """The lower blocks of a dense matrix; where they would lie beyond it, anything."""
    n = matrix.shape[0] // dof
    bands = np.full((n, REACH + 1, dof, dof), 1e3)
    for i in range(n):
        for o in range(min(REACH + 1, n - i)):
            rows = slice((i + o) * dof, (i + o + 1) * dof)
            bands[i, o] = matrix[rows, i * dof : (i + 1) * dof]
    return bands


def matrix_of(
    stations: int, dof: int, definite: bool, rng: np.random.Generator, free: Mask | None = None
) -> np.ndarray:
    """A random symmetric matrix of the right bandwidth whose diagonal outweighs the rest."""
    size = stations * dof
    a = rng.normal(size=(size, size))
    a = (a + a.T) / 2
    station = np.arange(size) // dof
    a[abs(station[:, None] - station) > REACH] = 0
    signs = np.ones(size) if definite else rng.choice([-1.0, 1.0], size=size)
    a[np.diag_indices(size)] += 4 * dof * signs
    if free is not None:
        f = np.ravel(np.asarray(free, float))
        a = f[:, None] * a * f + np.diag(1 - f)
    return a


def flat(x: Any) -> np.ndarray:
    """Station by station: [dof, ..., station] to [station dof, ...]."""
    x = np.moveaxis(np.asarray(x), -1, 0)
    return x.reshape(-1, *x.shape[2:])


def agree(got: np.ndarray, want: np.ndarray) -> None:
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-13 * np.max(np.abs(want)))


@pytest.mark.parametrize(
    ("stations", "dof", "lanes", "held"),
    [(1, 3, 1, False), (2, 3, 2, False), (5, 3, 2, True), (5, 42, 1, False)],
)
def test_solution_product_and_inertia_match_dense_algebra(
    stations: int, dof: int, lanes: int, held: bool
) -> None:
    rng = np.random.default_rng(stations)
    free = tuple(tuple(bool(x) for x in row) for row in rng.random((stations, dof)) < 0.7)
    counts = set()
    for definite in (True, False):
        whole = [matrix_of(stations, dof, definite, rng) for _ in range(lanes)]
        bands = jnp.asarray(np.stack([bands_of(a, dof) for a in whole]))
        right = jnp.asarray(rng.normal(size=(dof, 2, stations, lanes)))
        sweep, product = solved(BlockBanded(bands, free if held else None), right)
        for lane, a in enumerate(whole):
            f = np.ravel(np.asarray(free, float)) if held else np.ones(len(a))
            a = f[:, None] * a * f + np.diag(1 - f)
            b = flat(right[..., lane])
            agree(flat(sweep.solution[..., lane]), np.linalg.solve(a, b))
            agree(flat(product[..., lane]), a @ b[:, 0])
            assert int(sweep.negative[lane]) == np.sum(np.linalg.eigvalsh(a) < 0)
            counts.add(int(sweep.negative[lane]))
    assert len(counts) > 1  # otherwise the comparison of inertia would prove nothing


@pytest.mark.parametrize("count", [1, 6])
def test_one_system_solves_the_right_hand_sides_of_every_lane(count: int) -> None:
    rng = np.random.default_rng(1)
    a = matrix_of(5, DOF, False, rng)
    right = jnp.asarray(rng.normal(size=(DOF, count, 5, LANES)))
    sweep, _ = solved(BlockBanded(jnp.asarray(bands_of(a, DOF))[None]), right)
    assert sweep.negative.shape == sweep.smallest_pivot.shape == (LANES,)
    for lane in range(LANES):
        want = np.linalg.solve(a, flat(right[..., lane]))
        agree(flat(sweep.solution[..., lane]), want)


def test_known_factors_are_not_made_again() -> None:
    rng = np.random.default_rng(2)
    own, other = (
        BlockBanded(jnp.asarray(bands_of(matrix_of(5, DOF, False, rng), DOF))[None])
        for _ in range(2)
    )
    right = jnp.asarray(rng.normal(size=(DOF, 2, 5, 1)))
    factors = other.factorised().factors
    sweep, product = solved(dataclasses.replace(own, factors=factors), right)
    agree(flat(sweep.solution[..., 0]), flat(solved(other, right)[0].solution[..., 0]))
    agree(flat(product[..., 0]), flat(solved(own, right)[1][..., 0]))


def test_smallest_pivot_by_hand() -> None:
    # Pivots 4 and 1 - 2^2 / 4 + 1e-6 of the first station, 1 - 3^2 / 4 of the last.
    a = np.diag([4.0, 1 + 1e-6, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    a[0, 1] = a[1, 0] = 2
    a[0, 7] = a[7, 0] = 3
    a[1, 7] = a[7, 1] = 1.5
    factors = factorise(BlockBanded(jnp.asarray(bands_of(a, 2))[None]))
    np.testing.assert_allclose(factors.smallest_pivot, 1e-6 / (1 + 1e-6), rtol=1e-8)
    assert int(factors.negative[0]) == np.sum(np.linalg.eigvalsh(a) < 0) == 1


def ill_conditioned(signed: bool) -> tuple[np.ndarray, np.ndarray]:
    """G W G^T with G lower triangular and banded: condition 1e10, inertia that of W."""
    rng = np.random.default_rng(2)
    stations, dof = 6, DOF
    size = stations * dof
    station = np.arange(size) // dof
    g = np.tril(rng.normal(size=(size, size))) / 6
    g[station[:, None] - station > REACH] = 0
    g[np.diag_indices(size)] = 1
    weights = 10 ** rng.uniform(-12, 0, size=size)
    if signed:
        weights[rng.choice(size, 5, replace=False)] *= -1
    return g @ np.diag(weights) @ g.T, weights


@pytest.mark.parametrize("signed", [False, True])
def test_ill_conditioned_systems_and_their_refinement(signed: bool) -> None:
    a, weights = ill_conditioned(signed)
    assert 1e10 < np.linalg.cond(a) < 1e14
    tangent = BlockBanded(jnp.asarray(bands_of(a, DOF))[None])
    right = jnp.asarray(np.random.default_rng(3).normal(size=(DOF, 1, 6, 1)))
    factors = factorise(tangent)
    assert int(factors.negative[0]) == np.sum(weights < 0)

    def backward_error(x: jax.Array) -> float:
        vector = flat(x)[:, 0, 0] if x.ndim == 3 else flat(x[..., 0])[:, 0]
        residual = a @ vector - flat(right[..., 0])[:, 0]
        return float(np.max(abs(residual)) / (np.linalg.norm(a, 1) * np.max(abs(vector))))

    found = solve_with(factors, right)
    assert backward_error(found) < 1e-13
    assert backward_error(refined(tangent, factors, right, found)) < 3e-16


def test_chord_steps_converge_with_factors_of_a_neighbour() -> None:
    rng = np.random.default_rng(4)
    a = matrix_of(6, DOF, True, rng)
    shift = 0.05 * np.diag(np.diagonal(a))
    near, here = (BlockBanded(jnp.asarray(bands_of(x, DOF))[None]) for x in (a, a + shift))
    right = jnp.asarray(rng.normal(size=(DOF, 1, 6, 1)))
    factors = factorise(near)
    x = solve_with(factors, right)
    want = np.linalg.solve(a + shift, flat(right[..., 0]))
    errors = []
    for _ in range(4):
        errors.append(np.max(abs(flat(x[..., 0]) - want)))
        x = refined(here, factors, right, x)
    assert errors[3] < 0.2**3 * errors[0]


@pytest.mark.parametrize("border", ["symmetric", "distinct"])
def test_bordered_elimination_matches_dense_algebra(border: str) -> None:
    rng = np.random.default_rng(5)
    free = tuple(tuple(not (i == 0 and k < 2) for k in range(DOF)) for i in range(5))
    whole = [matrix_of(5, DOF, False, rng, free) for _ in range(LANES)]
    tangent = BlockBanded(jnp.asarray(np.stack([bands_of(a, DOF) for a in whole])), free)
    column, row, right = (jnp.asarray(rng.normal(size=(DOF, 5, LANES))) for _ in range(3))
    corner, z = jnp.asarray([4.0, -4.0]), jnp.asarray(rng.normal(size=LANES))
    row = row if border == "distinct" else column
    operator = BorderedBlockTridiagonal(tangent, column, corner, row)
    vector = BorderedVector(right, z)
    found, product = jax.jit(lambda o, v: (eliminate(o, v), o.mv(v)))(operator, vector)
    for lane, a in enumerate(whole):
        c, r = flat(column[..., lane]), flat(row[..., lane])
        a = np.block([[a, c[:, None]], [r[None], corner[lane : lane + 1, None]]])
        b = np.append(flat(right[..., lane]), z[lane])
        x = np.append(flat(found.solution.stations[..., lane]), found.solution.border[lane])
        agree(x, np.linalg.solve(a, b))
        agree(np.append(flat(product.stations[..., lane]), product.border[lane]), a @ b)
        if border == "symmetric":
            assert int(found.negative[lane]) == np.sum(np.linalg.eigvalsh(a) < 0)


def shapes(jaxpr: Any) -> set[tuple[int, ...]]:
    """Of everything that is computed in a program."""
    found = {x.aval.shape for equation in jaxpr.eqns for x in equation.outvars}
    for equation in jaxpr.eqns:
        for inner in jaxprs_in_params(equation.params):
            found |= shapes(inner)
    return found


def test_vmap_over_right_hand_sides_factorises_once() -> None:
    batch, dof = 11, 5
    rng = np.random.default_rng(6)
    whole = [matrix_of(6, dof, True, rng) for _ in range(batch)]
    bands = jnp.asarray(np.stack([bands_of(a, dof) for a in whole]))[:, None]
    right = jnp.asarray(rng.normal(size=(batch, dof, 1, 6, 1)))

    def solution(bands: jax.Array, right: jax.Array) -> jax.Array:
        return BlockBanded(bands).solve(right).solution

    def batched_blocks(axes: Any, *arguments: jax.Array) -> set[tuple[int, ...]]:
        program = jax.make_jaxpr(jax.vmap(solution, axes))(*arguments)
        return {s for s in shapes(program.jaxpr) if batch in s and s.count(dof) > 1}

    assert batched_blocks((0, 0), bands, right)
    assert not batched_blocks((None, 0), bands[0], right)
    once = jax.jit(jax.vmap(solution, (None, 0)))(bands[0], right)
    for x, b in zip(once, right, strict=True):
        agree(flat(x[..., 0]), np.linalg.solve(whole[0], flat(b[..., 0])))
    each = jax.jit(jax.vmap(solution))(bands, right)
    for x, a, b in zip(each, whole, right, strict=True):
        agree(flat(x[..., 0]), np.linalg.solve(a, flat(b[..., 0])))


def test_derivative_of_a_solution() -> None:
    rng = np.random.default_rng(7)
    a, change = (matrix_of(4, DOF, False, rng) for _ in range(2))
    bands, direction = (jnp.asarray(bands_of(x, DOF))[None] for x in (a, change))
    right = jnp.asarray(rng.normal(size=(DOF, 1, 4, 1)))

    def solution(bands: jax.Array) -> jax.Array:
        return BlockBanded(bands).solve(right).solution

    value, derivative = jax.jit(lambda *x: jax.jvp(solution, x[:1], x[1:]))(bands, direction)
    x = flat(value[..., 0])
    np.testing.assert_allclose(
        flat(derivative[..., 0]), -np.linalg.solve(a, change @ x), rtol=0, atol=1e-12
    )


def test_a_singular_system_gives_no_finite_solution() -> None:
    chain = 2 * np.eye(5) - np.eye(5, k=1) - np.eye(5, k=-1)
    chain[0, 0] = chain[4, 4] = 1  # a free chain of springs: its last pivot is zero exactly
    bands = jnp.asarray(bands_of(chain, 1))[None]
    sweep, _ = solved(BlockBanded(bands), jnp.ones((1, 1, 5, 1)))
    assert not np.any(np.isfinite(sweep.solution))
    assert float(sweep.smallest_pivot[0]) == 0


def test_the_program_calls_no_library() -> None:
    # Compiled programs that call LAPACK can't be kept between runs.
    bands = jax.ShapeDtypeStruct((1, 6, REACH + 1, 50, 50), float)
    right = jax.ShapeDtypeStruct((50, 2, 6, 1), float)
    assert "custom_call" not in solved.lower(BlockBanded(bands), right).as_text()
