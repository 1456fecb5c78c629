"""Programs kept between runs: the same results, and never a program of something else."""

import pathlib

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from suas_jax.runtime.compiled import Compiled
from suas_jax.runtime.program_store import Keyed, ProgramStore


class Term(Keyed):
    """A static argument of which one attribute decides the program."""

    def __init__(self, power: int, remark: str) -> None:
        self.key = power
        self.remark = remark  # decides nothing


@eqx.filter_jit
def power(term: Term, x: jax.Array) -> dict:
    return {"value": x**term.key, "name": "power", "sum": (jnp.sum(x), None)}


@eqx.filter_jit
def determinant(x: jax.Array) -> jax.Array:
    return jnp.linalg.det(x)


@pytest.fixture
def folder(tmp_path: pathlib.Path) -> pathlib.Path:
    return tmp_path / "programs"


def another_run(folder: pathlib.Path) -> Compiled:
    compiled = Compiled()
    compiled.store = ProgramStore(folder)
    return compiled


def test_a_kept_program_runs_without_tracing(folder: pathlib.Path) -> None:
    x = jnp.arange(3.0)
    for remark in ("first", "second"):
        compiled = another_run(folder)
        found = compiled.run(power, Term(3, remark), x)
        np.testing.assert_array_equal(found["value"], x**3)
        assert found["name"] == "power"
        assert float(found["sum"][0]) == 3.0
        assert found["sum"][1] is None
        assert len(compiled.loaded) == (remark == "second")


@pytest.mark.parametrize(
    "other", [(Term(2, ""), jnp.arange(3.0)), (Term(3, ""), jnp.arange(4.0))]
)
def test_other_settings_and_shapes_are_other_programs(
    folder: pathlib.Path, other: tuple[Term, jax.Array]
) -> None:
    another_run(folder).run(power, Term(3, ""), jnp.arange(3.0))
    term, x = other
    compiled = another_run(folder)
    np.testing.assert_array_equal(compiled.run(power, term, x)["value"], x**term.key)
    assert not compiled.loaded


def test_a_damaged_file_is_compiled_again(folder: pathlib.Path) -> None:
    x = jnp.arange(3.0)
    another_run(folder).run(power, Term(3, ""), x)
    (file,) = folder.iterdir()
    file.write_bytes(file.read_bytes()[:100])
    for loaded in (0, 1):
        compiled = another_run(folder)
        found = compiled.run(power, Term(3, ""), x)
        np.testing.assert_array_equal(found["value"], x**3)
        assert len(compiled.loaded) == loaded


def test_what_can_t_be_kept_still_runs(folder: pathlib.Path) -> None:
    factor = 2.0

    @eqx.filter_jit
    def closure(x: jax.Array) -> jax.Array:
        return factor * x

    run = another_run(folder).run
    assert float(run(closure, jnp.ones(()))) == 2.0
    # LAPACK is made ready by lowering; a loaded program would call into nothing.
    np.testing.assert_allclose(run(determinant, 2.0 * jnp.eye(5)), 32.0)
    assert not folder.exists()
