"""Programs kept between runs: the same results, and never a program of something else."""

import json
import os
import pathlib
import subprocess
import sys
import textwrap
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from suas_jax.files.cache_folder import CacheFolder
from suas_jax.runtime import content_key as keys
from suas_jax.runtime.compiled import Compiled
from suas_jax.runtime.compiling import listening
from suas_jax.runtime.content_key import Keyed, NoContentKeyError, content_key
from suas_jax.runtime.program_store import Hole, ProgramStore, frame_from_json, frame_to_json


class Term(Keyed):
    """A static argument of which one attribute decides the program."""

    def __init__(self, power: int, remark: str) -> None:
        self.key = power
        self.remark = remark  # decides nothing


@eqx.filter_jit
def power(term: Term, x: jax.Array) -> dict:
    return {"value": x**term.key, "name": "power", "sum": (jnp.sum(x), None)}


@eqx.filter_jit
def factorised(x: jax.Array) -> dict:
    """LAPACK, four times."""
    return {
        "det": jnp.linalg.det(x),
        "eigenvalues": jnp.linalg.eigvalsh(x),
        "solved": jnp.linalg.solve(x, x[0]),
        "cholesky": jnp.linalg.cholesky(x),
    }


doubled, tripled = eqx.filter_jit(lambda x: 2 * x), eqx.filter_jit(lambda x: 3 * x)


@pytest.fixture(autouse=True)
def _known_module(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if this file belonged to the packages whose source is part of every key."""
    monkeypatch.setattr(keys, "PACKAGES", (*keys.PACKAGES, __name__))


def another_run(folder: pathlib.Path) -> Compiled:
    compiled = Compiled()
    kept = CacheFolder(folder / "programs", key_file=folder / "state" / "key")
    compiled.store = ProgramStore(kept)
    return compiled


def kept_files(folder: pathlib.Path) -> list[pathlib.Path]:
    return list(folder.glob("programs/*.kept"))


def test_a_kept_program_runs_without_tracing(tmp_path: pathlib.Path) -> None:
    x = jnp.arange(3.0)
    for remark in ("first", "second"):
        compiled = another_run(tmp_path)
        found = compiled.run(power, Term(3, remark), x)
        np.testing.assert_array_equal(found["value"], x**3)
        assert found["name"] == "power"
        assert float(found["sum"][0]) == 3.0
        assert found["sum"][1] is None
        assert len(compiled.loaded) == (remark == "second")


def test_only_compiling_is_announced(tmp_path: pathlib.Path) -> None:
    term, x, heard = Term(2, ""), jnp.arange(3.0), []
    with listening(heard.append):
        first = another_run(tmp_path)
        first.run(power, term, x)
        assert heard == [True, False]
        first.run(power, term, x)
        another_run(tmp_path).run(power, term, x)  # loaded
        assert heard == [True, False]
        Compiled().run(power, term, x)  # keeps nothing
    Compiled().run(power, term, x)  # nobody listens any more
    assert heard == [True, False, True, False]


@pytest.mark.parametrize(
    "other", [(Term(2, ""), jnp.arange(3.0)), (Term(3, ""), jnp.arange(4.0))]
)
def test_other_settings_and_shapes_are_other_programs(
    tmp_path: pathlib.Path, other: tuple[Term, jax.Array]
) -> None:
    another_run(tmp_path).run(power, Term(3, ""), jnp.arange(3.0))
    term, x = other
    compiled = another_run(tmp_path)
    np.testing.assert_array_equal(compiled.run(power, term, x)["value"], x**term.key)
    assert not compiled.loaded


def test_another_type_of_number_is_another_program(tmp_path: pathlib.Path) -> None:
    compiled = another_run(tmp_path)
    for x in (jnp.arange(3), jnp.arange(3.0), np.arange(3, dtype=np.float32)):
        found = compiled.run(power, Term(2, ""), x)["value"]
        assert found.dtype == x.dtype


def test_functions_that_share_a_name_share_no_program(tmp_path: pathlib.Path) -> None:
    run = another_run(tmp_path).run
    assert float(run(doubled, jnp.ones(()))) == 2.0
    assert float(run(tripled, jnp.ones(()))) == 3.0

    factor = 4.0

    @eqx.filter_jit
    def closure(x: jax.Array) -> jax.Array:
        return factor * x

    assert float(run(closure, jnp.ones(()))) == 4.0
    assert not kept_files(tmp_path)


class Pair(NamedTuple):
    """Two values."""

    first: object
    second: object


class Module(eqx.Module):
    """A value that is traced, and one that is not."""

    value: object
    fixed: int = eqx.field(static=True, default=1)


DISTINCT = [
    None, 0, False, 0.0, "0", b"0", 1, True, 1.0, "1", float("nan"), -0.0, (), [], {}, set(),
    (1,), [1], {1: 1}, {"1": 1}, {1: "1"}, {1}, ((1,), 2), (1, (2,)), ("a", "bc"), ("ab", "c"),
    np.array([1]), np.array([1.0]), np.array([[1]]), np.float64(1), np.dtype(int), Pair(1, 2),
    Pair(2, 1), Module(1), Module(1, 2), Module(None), Term(1, ""), Term, power, Module, np.sum,
]  # fmt: skip


def test_different_contents_have_different_keys() -> None:
    found = [content_key(value) for value in DISTINCT]
    assert len(set(found)) == len(DISTINCT)


def test_keys_come_from_content_not_from_identity() -> None:
    name = "".join(["a", "b"])  # not the interned word
    assert content_key([name, name]) == content_key(["ab", "".join(["ab"])])
    assert content_key({"x": 1, "y": 2}) == content_key({"y": 2, "x": 1})
    assert content_key({1, 2, 3}) == content_key({3, 2, 1})
    assert content_key(Term(1, "a")) == content_key(Term(1, "b"))


@pytest.mark.parametrize("value", [object(), lambda: 1, np.array([object()]), open, iter([])])
def test_what_has_no_content_has_no_key(value: object) -> None:
    with pytest.raises(NoContentKeyError):
        content_key([value])


def test_frames_are_data() -> None:
    """Containers of this project come back; no other class is made by a file."""
    frame = {"a": [Hole(), None, 1.5, "x", True], "b": (float("inf"), {})}
    again = frame_from_json(json.loads(json.dumps(frame_to_json(frame))))
    assert isinstance(again["a"].pop(0), Hole)
    frame["a"].pop(0)  # type: ignore[attr-defined]
    assert again == frame
    for kind in ("named", "module"):
        foreign = ("os:system", "subprocess:Popen", "builtins:dict", "suas_jaxx:Pair")
        ours = ("suas_jax.runtime.program_store:importlib", "suas_jax.config.load:Path")
        for name in foreign + ours:
            with pytest.raises(ValueError, match="not a class of this project"):
                frame_from_json({kind: name, "fields": []})


FILL = """
    import os, sys
    sys.path.insert(0, {tests!r})
    import pathlib, jax, jax.numpy as jnp, numpy as np
    jax.config.update("jax_enable_x64", True)
    import test_program_store as test
    from suas_jax.runtime import content_key as keys
    from suas_jax.runtime.program_store import keep_machine_code
    from suas_jax.runtime.program_store import ProgramStore
    keys.PACKAGES = (*keys.PACKAGES, test.__name__)
    folder = pathlib.Path({folder!r})
    matrix = jnp.eye(5) * 2 + 0.1

    def checked_run():
        "How many programs were loaded: the result is right in any case."
        compiled = test.another_run(folder)
        kept = compiled.store._folder
        keep_machine_code(kept, folder / "programs")
        found = compiled.run(test.factorised, matrix)
        x = np.asarray(matrix)
        np.testing.assert_allclose(found["det"], np.linalg.det(x))
        np.testing.assert_allclose(found["eigenvalues"], np.linalg.eigvalsh(x))
        np.testing.assert_allclose(found["solved"], np.eye(5)[0], atol=1e-14)
        np.testing.assert_allclose(found["cholesky"], np.linalg.cholesky(x))
        return len(compiled.loaded)
"""
DAMAGE = """
    assert checked_run() == 1
    random = np.random.default_rng(0)
    files = sorted(folder.glob("programs/*.kept"), key=lambda f: f.stat().st_size)[-2:]
    assert len(files) == 2  # the portable program, its machine code
    for file in files:
        whole = file.read_bytes()
        for position in random.integers(0, 8 * len(whole), 6):
            damaged = bytearray(whole)
            damaged[position // 8] ^= 1 << position % 8
            file.write_bytes(damaged)
            checked_run()
            assert len(file.read_bytes()) > 100
        for content in (b"", whole[:100], whole + b"x"):
            file.write_bytes(content)
            checked_run()
    assert checked_run() == 1
"""


def other_process(folder: pathlib.Path, program: str) -> None:
    tests = str(pathlib.Path(__file__).parent)
    text = textwrap.dedent(FILL).format(tests=tests, folder=str(folder))
    done = subprocess.run(
        [sys.executable, "-c", text + textwrap.dedent(program)],
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert done.returncode == 0, done.stderr


def test_damage_between_two_processes_means_compiling_again(tmp_path: pathlib.Path) -> None:
    """LAPACK calls included: nothing prepares them but the kept program itself."""
    other_process(tmp_path, "assert checked_run() == 0")
    other_process(tmp_path, DAMAGE)
