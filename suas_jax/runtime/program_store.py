"""Compiled programs kept between runs, ready to call.

JAX's own cache is found by the lowered program, so every run traces and lowers anew to look
it up: most of what a command waits for. Here a program is found by what it is made from: the
function, its static arguments, the shapes of its arrays, and the source code itself.
"""

import contextlib
import functools
import hashlib
import io
import os
import pickle
import platform
import tempfile
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
from jax.experimental.compilation_cache import compilation_cache
from jax.experimental.serialize_executable import deserialize_and_load, serialize
from jaxtyping import Array

_MOST = 300  # programs kept; the oldest go first
_BUILT_WITH = ("jax", "jaxlib", "numpy", "equinox", "lineax", "optimistix")
Program = Callable[..., Any]


class Keyed:
    """A static argument of a program that is compared by its key alone.

    Attributes:
        key: what decides the compiled program; hashable, and plain enough to be pickled.
    """

    key: Any

    def __hash__(self) -> int:
        return hash(self.key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, type(self)) and self.key == other.key


class ProgramStore:
    """A folder of compiled programs.

    Args:
        folder: where they are kept; made when the first is saved.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def file(self, function: Program, arguments: Any, options: Any) -> Path | None:
        """Where the program of a call belongs; None if it can't be told apart from others."""
        name = f"{function.__module__}.{getattr(function, '__qualname__', '<locals>')}"
        if "<locals>" in name:  # closes over what no key sees
            return None
        described = io.BytesIO()
        try:
            _Describer(described, protocol=5).dump((name, arguments, sorted(options.items())))
        except (pickle.PicklingError, TypeError, AttributeError):
            return None
        digest = hashlib.sha256(described.getvalue() + _circumstances())
        return self._folder / f"{digest.hexdigest()[:40]}.program"

    def load(self, file: Path) -> Program | None:
        """The program of a file, to be called with its arrays; None if there is none."""
        # Whatever is wrong with a file, compiling again is the remedy.
        with contextlib.suppress(Exception):
            payload, count, frame = pickle.loads(file.read_bytes())
            holes = sum(isinstance(x, Hole) for x in jax.tree.leaves(frame))
            taken = jax.tree.structure(((0,) * count, {}))
            call = deserialize_and_load(payload, taken, jax.tree.structure((0,) * holes))
            os.utime(file)
            return filled_by(call, frame)
        return None

    def save(self, file: Path, compiled: Any, count: int, frame: Any) -> None:
        """Keep a program.

        Args:
            file: where it belongs.
            compiled: as JAX compiled it, from `count` arrays to a tuple of arrays.
            count: number of its arguments.
            frame: what the call returns, with a `Hole` for each of the arrays.
        """
        try:
            content = pickle.dumps((serialize(compiled)[0], count, frame), protocol=5)
            self._folder.mkdir(parents=True, exist_ok=True)
            handle, draft = tempfile.mkstemp(dir=self._folder)
            with os.fdopen(handle, "wb") as stream:
                stream.write(content)
            os.replace(draft, file)
            kept = sorted(self._folder.glob("*.program"), key=lambda f: f.stat().st_mtime)
            for old in kept[:-_MOST]:
                old.unlink(missing_ok=True)
        except (OSError, ValueError, TypeError, AttributeError, pickle.PicklingError):
            return  # a program that isn't kept is compiled again


class Hole:
    """Stands for an array in what a program returns."""


def filled_by(call: Program, frame: Any) -> Program:
    """The program that puts the arrays of a call in their places.

    Args:
        call: returns a tuple of arrays.
        frame: what is to be returned, with a `Hole` for each of them.
    """
    leaves, structure = jax.tree.flatten(frame)

    def filled(*arrays: Array) -> Any:
        found = iter(call(*arrays))
        results = [next(found) if isinstance(x, Hole) else x for x in leaves]
        return jax.tree.unflatten(structure, results)

    return filled


def self_contained(lowered: Any) -> bool:
    """Whether a lowered program calls nothing but itself.

    LAPACK and other libraries are made ready when a call to them is lowered, which a program
    that is loaded never is.
    """
    return "custom_call" not in lowered.as_text()


@contextlib.contextmanager
def uncached() -> Iterator[None]:
    """Compile anew, past JAX's own cache: what comes from there can't be kept once more."""
    name = "jax_enable_compilation_cache"
    before = getattr(jax.config, name)
    jax.config.update(name, False)
    compilation_cache.reset_cache()  # it looks at the setting once only
    try:
        yield
    finally:
        jax.config.update(name, before)
        compilation_cache.reset_cache()


class _Describer(pickle.Pickler):
    """Writes what decides a program; nothing that is written is ever read."""

    def reducer_override(self, obj: Any) -> Any:
        return (type(obj), (obj.key,)) if isinstance(obj, Keyed) else NotImplemented


@functools.cache
def _circumstances() -> bytes:
    """What else a program depends on: source code, libraries, processor, settings."""
    digest = hashlib.sha256()
    package = Path(__file__).parents[1]
    for folder in (package, package.parent / "fitting"):
        for source in sorted(folder.rglob("*.py")):
            digest.update(source.read_bytes())
    device = jax.devices()[0]
    facts = [f"{name} {version(name)}" for name in _BUILT_WITH]
    facts += [platform.python_version(), platform.machine(), device.platform]
    facts += [
        device.device_kind,
        str(jax.device_count()),
        str(jnp.zeros(()).dtype),
    ]
    facts += [os.environ.get("XLA_FLAGS", "")]
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        facts += sorted({x for x in lines if x.startswith(("flags", "model name", "Features"))})
    digest.update("\n".join(facts).encode())
    return digest.digest()
