"""The bordered block-tridiagonal solver against dense linear algebra."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from suas_jax.numerics.block_tridiagonal import BlockTridiagonal
from suas_jax.numerics.bordered_solve import (
    BlockElimination,
    BorderedBlockTridiagonal,
    BorderedVector,
    eliminate,
    solve_bordered,
    solve_near,
)

DOF, LANES = 2, 2
solve = eqx.filter_jit(eliminate)


def system(
    stations: int,
    *,
    definite: bool = True,
    border: bool = True,
    distinct: bool = False,
    lanes: int = LANES,
    dof: int = DOF,
    seed: int = 0,
) -> tuple[BorderedBlockTridiagonal, BorderedVector]:
    """A random system whose blocks on the diagonal outweigh the rest."""
    rng = np.random.default_rng(1000 * seed + stations)
    a = rng.normal(size=(dof, dof, stations, lanes))
    signs = np.ones((dof, stations, lanes))
    if not definite:
        signs = rng.choice([-1.0, 1.0], size=signs.shape)
    diagonal = (a + a.swapaxes(0, 1)) / 4
    diagonal[np.arange(dof), np.arange(dof)] += 3 * dof * signs
    upper = rng.normal(size=(dof, dof, stations - 1, lanes))
    column = row = corner = z = None
    if border:
        column = jnp.asarray(rng.normal(size=(dof, stations, lanes)))
        corner = jnp.asarray(6 * rng.choice([-1.0, 1.0], size=lanes))
        z = jnp.asarray(rng.normal(size=lanes))
    if distinct:
        row = column + 0.3 * jnp.asarray(rng.normal(size=(dof, stations, lanes)))
    operator = BorderedBlockTridiagonal(
        BlockTridiagonal(jnp.asarray(diagonal), jnp.asarray(upper)), column, corner, row
    )
    return operator, BorderedVector(jnp.asarray(rng.normal(size=(dof, stations, lanes))), z)


def dense(operator: BorderedBlockTridiagonal, lane: int) -> np.ndarray:
    """One lane as a matrix, station by station, the border last; put together by hand."""
    diagonal, upper = (
        np.asarray(x)[..., min(lane, x.shape[-1] - 1)]
        for x in (operator.tangent.diagonal, operator.tangent.upper)
    )
    dof, _, n = diagonal.shape
    size = dof * n
    matrix = np.zeros((size, size))
    for i in range(n):
        here = slice(dof * i, dof * (i + 1))
        matrix[here, here] = diagonal[:, :, i]
        if i + 1 < n:
            there = slice(dof * (i + 1), dof * (i + 2))
            matrix[here, there] = upper[:, :, i]
            matrix[there, here] = upper[:, :, i].T
    if operator.column is None:
        return matrix
    row = operator.column if operator.row is None else operator.row
    column, row = (np.asarray(x)[..., lane].T.ravel() for x in (operator.column, row))
    corner = float(np.asarray(operator.corner)[lane])
    return np.block([[matrix, column[:, None]], [row[None], np.array([[corner]])]])


def agree(got: np.ndarray, want: np.ndarray) -> None:
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-13 * np.max(np.abs(want)))


def flat(vector: BorderedVector, lane: int) -> np.ndarray:
    stations = np.asarray(vector.stations)[..., lane].T.ravel()
    if vector.border is None:
        return stations
    return np.append(stations, np.asarray(vector.border)[lane])


# Every number of stations of either parity is its own program.
SIZES = [(n, "symmetric", DOF) for n in range(1, 10)] + [(5, "symmetric", 4)]
SIZES += [(n, border, DOF) for border in ("none", "distinct") for n in (1, 2, 5, 6)]


@pytest.mark.parametrize(("stations", "border", "dof"), SIZES)
def test_solution_and_inertia_match_dense_algebra(stations: int, border: str, dof: int) -> None:
    kind = {"border": border != "none", "distinct": border == "distinct"}
    for definite in (True, False):
        operator, right = system(stations, definite=definite, dof=dof, **kind)
        found = solve(operator, right)
        for lane in range(LANES):
            matrix = dense(operator, lane)
            want = np.linalg.solve(matrix, flat(right, lane))
            agree(flat(found.solution, lane), want)
            if border != "distinct":  # inertia belongs to symmetric systems
                negative = np.sum(np.linalg.eigvalsh(matrix) < 0)
                assert int(found.negative[lane]) == negative


def test_inertia_varies_between_the_systems_tested() -> None:
    # Otherwise the comparison above would prove nothing.
    counts = {
        int(n)
        for stations in range(2, 10)
        for n in solve(*system(stations, definite=False)).negative
    }
    assert len(counts) >= 8


def test_smallest_pivot_of_a_single_station() -> None:
    # Pivots by hand: 4 and 1 - 2^2 / 4 + 1e-6; relative to the diagonal 1 and 1e-6.
    block = jnp.array([[4.0, 2.0], [2.0, 1.0 + 1e-6]])[:, :, None, None]
    operator = BorderedBlockTridiagonal(
        BlockTridiagonal(block, jnp.zeros((2, 2, 0, 1))), None, None
    )
    found = solve(operator, BorderedVector(jnp.ones((2, 1, 1)), None))
    np.testing.assert_allclose(found.smallest_pivot, 1e-6 / (1 + 1e-6), rtol=1e-8)


def test_smallest_pivot_of_a_chain_is_relative_to_its_diagonal() -> None:
    # From the left 4 and 1 - 1.9^2 / 4, from the right 9 and 9 - 1 / 9; both before the middle.
    diagonal = jnp.array([4.0, 1.0, 10.0, 9.0, 9.0])[None, None, :, None]
    upper = jnp.array([1.9, 0.1, 1.0, 1.0])[None, None, :, None]
    operator = BorderedBlockTridiagonal(BlockTridiagonal(diagonal, upper), None, None)
    found = solve(operator, BorderedVector(jnp.ones((1, 5, 1)), None))
    np.testing.assert_allclose(found.smallest_pivot, 1 - 1.9**2 / 4, rtol=1e-12)


@pytest.mark.parametrize("distinct", [False, True])
def test_products_and_transposes(distinct: bool) -> None:
    operator, right = system(4, distinct=distinct)
    product = operator.mv(right)
    transposed = operator.transpose().mv(right)
    for lane in range(LANES):
        matrix, vector = dense(operator, lane), flat(right, lane)
        agree(flat(product, lane), matrix @ vector)
        agree(flat(transposed, lane), matrix.T @ vector)
    solved = lx.linear_solve(operator.T, right, BlockElimination()).value
    for lane in range(LANES):
        want = np.linalg.solve(dense(operator, lane).T, flat(right, lane))
        agree(flat(solved, lane), want)


def test_dense_matrix_reproduces_products() -> None:
    operator, right = system(4, distinct=True)
    matrix = operator.as_matrix()
    vector, _ = ravel_pytree(right)
    product, _ = ravel_pytree(operator.mv(right))
    np.testing.assert_allclose(matrix @ vector, product, rtol=0, atol=1e-13)
    assert operator.in_size() == vector.size == matrix.shape[0]


def test_shared_blocks_broadcast_over_lanes() -> None:
    operator, right = system(5)
    shared = eqx.tree_at(
        lambda o: (o.tangent.diagonal, o.tangent.upper),
        operator,
        (operator.tangent.diagonal[..., :1], operator.tangent.upper[..., :1]),
    )
    found = solve(shared, right)
    for lane in range(LANES):
        want = np.linalg.solve(dense(shared, lane), flat(right, lane))
        agree(flat(found.solution, lane), want)
    one = BorderedVector(right.stations[..., :1], right.border[:1])
    found = solve(operator, one)
    for lane in range(LANES):
        want = np.linalg.solve(dense(operator, lane), flat(one, 0))
        agree(flat(found.solution, lane), want)


def by_lineax(operator: BorderedBlockTridiagonal, right: BorderedVector) -> jax.Array:
    return ravel_pytree(lx.linear_solve(operator, right, BlockElimination()).value)[0]


def by_elimination(operator: BorderedBlockTridiagonal, right: BorderedVector) -> jax.Array:
    return ravel_pytree(solve_bordered(operator, right))[0]


def by_dense(operator: BorderedBlockTridiagonal, right: BorderedVector) -> jax.Array:
    return jnp.linalg.solve(operator.as_matrix(), ravel_pytree(right)[0])


@pytest.mark.parametrize("solved", [by_lineax, by_elimination])
@pytest.mark.parametrize("distinct", [False, True])
def test_derivatives_of_solutions(distinct: bool, solved: Any) -> None:
    operator, right = system(4, distinct=distinct, lanes=1)
    other = jax.tree.map(lambda x: jnp.sin(3 * x), (operator, right))
    # The operator stays symmetric along the direction of differentiation.
    blocks = other[0].tangent.diagonal
    other = eqx.tree_at(lambda o: o[0].tangent.diagonal, other, blocks + blocks.swapaxes(0, 1))

    def compare(f: Any) -> None:
        got, want = (jax.jit(f, static_argnums=0)(by) for by in (solved, by_dense))
        assert jax.tree.structure(got) == jax.tree.structure(want)
        for a, b in zip(jax.tree.leaves(got), jax.tree.leaves(want), strict=True):
            assert float(jnp.max(jnp.abs(b))) > 1e-3
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-12)

    compare(lambda by: jax.jvp(by, (operator, right), other)[1])
    compare(lambda by: jax.grad(lambda s: jnp.sum(jnp.sin(by(*s))))((operator, right)))


def test_a_part_that_is_no_smaller_than_the_rest_is_solved_for_in_either_mode() -> None:
    """K + N against dense algebra, where a series in K^-1 N diverges; values of any size."""
    operator, right = system(9, distinct=True)
    rng = np.random.default_rng(1)
    x = jax.tree.map(lambda v: jnp.asarray(rng.uniform(-3, 0.9, v.shape)), right)
    small = BorderedVector(1e-9 * right.stations, 1e3 * right.border)

    def rest(y: BorderedVector) -> BorderedVector:
        return operator.mv(jax.tree.map(lambda a, b: -a * b, x, y))

    def near(b: BorderedVector) -> BorderedVector:
        return solve_near(rest, operator, b)

    found, back = jax.jit(lambda b: (near(b), jax.linear_transpose(near, b)(b)[0]))(small)
    for lane in range(LANES):
        matrix = dense(operator, lane) @ (np.eye(19) - np.diag(flat(x, lane)))
        for got, by in ((found, matrix), (back, matrix.T)):
            want = np.linalg.solve(by, flat(small, lane))
            np.testing.assert_allclose(flat(got, lane), want, rtol=1e-9)


def test_no_derivative_calls_back_into_python() -> None:
    operator, right = system(4, lanes=1)
    gradient = jax.jit(jax.grad(lambda s: jnp.sum(by_elimination(*s))))
    assert "callback" not in gradient.lower((operator, right)).as_text()


def test_vmap_equals_loop() -> None:
    systems = [system(4, seed=seed) for seed in range(3)]
    operators, rights = jax.tree.map(lambda *x: jnp.stack(x), *systems)
    both = jax.vmap(by_lineax)(operators, rights)
    only_right = jax.vmap(by_lineax, (None, 0))(systems[0][0], rights)
    for i, (operator, right) in enumerate(systems):
        np.testing.assert_allclose(both[i], by_lineax(operator, right), rtol=0, atol=1e-14)
        want = by_lineax(systems[0][0], right)
        np.testing.assert_allclose(only_right[i], want, rtol=0, atol=1e-14)


@pytest.mark.parametrize("stations", [1, 4, 5])
def test_a_singular_system_gives_no_finite_solution_and_no_exception(stations: int) -> None:
    # A free chain of springs: whole numbers, so its last pivot is zero exactly.
    degree = np.full(stations, 2.0)
    degree[0] -= 1
    degree[-1] -= 1
    operator = BorderedBlockTridiagonal(
        BlockTridiagonal(
            jnp.asarray(degree)[None, None, :, None], jnp.full((1, 1, stations - 1, 1), -1.0)
        ),
        None,
        None,
    )
    right = BorderedVector(jnp.ones((1, stations, 1)), None)
    found = lx.linear_solve(operator, right, BlockElimination(), throw=False)
    assert not np.any(np.isfinite(found.value.stations))
    assert found.result != lx.RESULTS.successful


def test_one_singular_lane_leaves_the_others_alone() -> None:
    operator, right = system(5)
    broken = eqx.tree_at(
        lambda o: (o.tangent.diagonal, o.tangent.upper),
        operator,
        tuple(
            x.at[..., 0].set(0.0) for x in (operator.tangent.diagonal, operator.tangent.upper)
        ),
    )
    found = solve(broken, right)
    assert not np.all(np.isfinite(found.solution.stations[..., 0]))
    want = np.linalg.solve(dense(operator, 1), flat(right, 1))
    agree(flat(found.solution, 1), want)


CAPABILITIES = sorted(
    name for name in dir(lx) if name.startswith("is_") or name == "has_unit_diagonal"
)


@pytest.mark.parametrize("name", CAPABILITIES)
def test_every_question_about_structure_has_its_answer(name: str) -> None:
    symmetric, distinct = system(3)[0], system(3, distinct=True)[0]
    ask = getattr(lx, name)
    assert ask(symmetric) is (name == "is_symmetric")
    assert ask(distinct) is False


@pytest.mark.parametrize("transform", [lx.linearise, lx.materialise, lx.conj])
def test_transforms_keep_the_operator(transform: Any) -> None:
    operator, right = system(3, distinct=True)
    got, want = transform(operator).mv(right), operator.mv(right)
    assert all(bool(jnp.all(a == b)) for a, b in zip(got, want, strict=True))


def test_other_operators_are_refused() -> None:
    with pytest.raises(ValueError, match="BorderedBlockTridiagonal"):
        lx.linear_solve(lx.DiagonalLinearOperator(jnp.ones(3)), jnp.ones(3), BlockElimination())


def count_equations(jaxpr: Any) -> int:
    inner = [
        sub
        for equation in jaxpr.eqns
        for value in equation.params.values()
        for sub in (value if isinstance(value, tuple | list) else [value])
    ]
    inner = [getattr(sub, "jaxpr", sub) for sub in inner]
    return len(jaxpr.eqns) + sum(count_equations(sub) for sub in inner if hasattr(sub, "eqns"))


@pytest.mark.parametrize("shortest", [4, 5])
def test_program_does_not_grow_with_the_number_of_stations(shortest: int) -> None:
    sizes = {
        count_equations(jax.make_jaxpr(eliminate)(*system(stations)).jaxpr)
        for stations in (shortest, shortest + 60)
    }
    assert len(sizes) == 1
    assert sizes.pop() > 50
