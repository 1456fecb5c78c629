"""Compiled programs kept between runs, found before anything is traced or lowered.

They are found by function, static arguments, shapes of arrays, and the source code. What is
kept is their portable form (StableHLO, see `jax.export`) and the frame of their results as
JSON; the machine code is kept by JAX's own cache.

A frame says what the arrays of a result are parts of: dictionaries, named tuples and modules of
this project, with fixed numbers and words. Reading it makes such containers and nothing else.
"""

import contextlib
import dataclasses
import functools
import hashlib
import importlib
import json
import os
import platform
import struct
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.export
import jax.numpy as jnp
from jax.experimental.compilation_cache import compilation_cache
from jaxtyping import Array

from suas_jax.files.cache_folder import CacheFolder
from suas_jax.runtime.content_key import (
    PACKAGES,
    NoContentKeyError,
    content_key,
    named,
    source_digest,
)

_BUILT_WITH = ("jax", "jaxlib", "numpy", "equinox", "lineax", "optimistix")
_LENGTH = struct.Struct("<q")


class Hole:
    """Stands for an array in what a program returns."""


def filled_by(call: Callable[..., Any], frame: Any) -> Callable[..., Any]:
    """The program that puts the arrays of a call in the places of the `Hole`s of a frame."""
    leaves, structure = jax.tree.flatten(frame)

    def filled(*arrays: Array) -> Any:
        found = iter(call(*arrays))
        results = [next(found) if isinstance(x, Hole) else x for x in leaves]
        return jax.tree.unflatten(structure, results)

    return filled


def frame_to_json(frame: Any) -> Any:
    """A frame as a tree that `json.dumps` takes.

    Raises NoContentKeyError: it holds something that could not be made again.
    """
    if frame is None or isinstance(frame, bool | int | float | str):
        return {"value": frame}
    if isinstance(frame, Hole):
        return "array"
    if isinstance(frame, dict) and all(isinstance(key, str) for key in frame):
        return {"dict": {key: frame_to_json(value) for key, value in frame.items()}}
    kind = type(frame)
    if kind in (list, tuple):
        return {kind.__name__: [frame_to_json(item) for item in frame]}
    if _is_ours(kind) and isinstance(frame, tuple) and hasattr(kind, "_fields"):
        return {"named": named(kind), "fields": [frame_to_json(item) for item in frame]}
    if _is_ours(kind) and dataclasses.is_dataclass(frame):
        fields = {f.name: getattr(frame, f.name) for f in dataclasses.fields(frame)}
        items = {name: frame_to_json(value) for name, value in fields.items()}
        return {"module": named(kind), "fields": items}
    raise NoContentKeyError(f"a program that returns a {kind.__name__}")


def frame_from_json(tree: Any) -> Any:
    """The frame that `frame_to_json` wrote. Raises ValueError: it is none."""
    match tree:
        case "array":
            return Hole()
        case {"value": value}:
            return value
        case {"dict": items}:
            return {key: frame_from_json(value) for key, value in items.items()}
        case {"list": items}:
            return list(_all(items))
        case {"tuple": items}:
            return tuple(_all(items))
        case {"named": name, "fields": items}:
            kind = _class(name)
            if not issubclass(kind, tuple):
                raise ValueError(f"{name} is not a named tuple")
            return tuple.__new__(kind, tuple(_all(items)))
        case {"module": name, "fields": items}:
            kind = _class(name)
            if not dataclasses.is_dataclass(kind):
                raise ValueError(f"{name} has no fields")
            made = object.__new__(kind)
            for key, value in items.items():
                object.__setattr__(made, key, frame_from_json(value))
            return made
    raise ValueError("no frame of a program")


def _all(items: list[Any]) -> Iterator[Any]:
    return (frame_from_json(item) for item in items)


def _is_ours(kind: type) -> bool:
    return kind.__module__.split(".")[0] in PACKAGES


def _class(name: str) -> type:
    """A class of this project by module and name."""
    module, _, path = name.partition(":")
    if module.split(".")[0] not in PACKAGES:
        raise ValueError(f"{name}: is not a class of this project")
    found: Any = importlib.import_module(module)
    for part in path.split("."):
        found = getattr(found, part, None)
    if not isinstance(found, type) or found.__module__ != module:
        raise ValueError(f"{name}: is not a class of this project")
    return found


class KeptProgram(NamedTuple):
    """A program in its portable form, and what the arrays that it returns are parts of."""

    exported: jax.export.Exported
    frame: Any


class ProgramStore:
    """Programs kept in a folder."""

    def __init__(self, folder: CacheFolder) -> None:
        self._folder = folder

    def name(self, function: Callable[..., Any], arguments: Any, options: Any) -> str | None:
        """The name of the program of a call; None if it can't be told apart from others."""
        try:
            return content_key((function, arguments, options, _circumstances()))
        except NoContentKeyError:
            return None

    def load(self, name: str) -> KeptProgram | None:
        """The program of a name; None if there is none."""
        content = self._folder.get(name)
        if content is None:
            return None
        # Whatever is wrong with an entry, compiling again is the remedy.
        with contextlib.suppress(Exception):
            begin = _LENGTH.size
            (size,) = _LENGTH.unpack_from(content)
            frame = frame_from_json(json.loads(content[begin : begin + size]))
            exported = jax.export.deserialize(bytearray(content[begin + size :]))
            holes = sum(isinstance(x, Hole) for x in jax.tree.leaves(frame))
            if holes == len(exported.out_avals):
                return KeptProgram(exported, frame)
        self._folder.discard(name)
        return None

    def save(self, name: str, program: KeptProgram) -> None:
        """Keep a program; one that can't be kept is compiled again."""
        with contextlib.suppress(NoContentKeyError, ValueError):
            frame = json.dumps(frame_to_json(program.frame)).encode()
            body = bytes(program.exported.serialize())
            self._folder.put(name, _LENGTH.pack(len(frame)) + frame + body)

    def settled(self) -> None:
        """Say that the programs loaded so far work."""
        self._folder.settled()


@functools.cache
def circumstances_of_machine() -> str:
    """What machine code depends on besides its program: libraries and processor."""
    facts = [f"{name} {version(name)}" for name in _BUILT_WITH]
    facts += [platform.python_version(), platform.machine()]
    facts += [os.environ.get("XLA_FLAGS", "")]
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        facts += sorted({x for x in lines if x.startswith(("flags", "model name", "Features"))})
    return hashlib.sha256("\n".join(facts).encode()).hexdigest()


def _circumstances() -> tuple[Any, ...]:
    """What else a program depends on: source code, libraries, devices, settings."""
    device = jax.devices()[0]
    devices = (device.platform, device.device_kind, jax.device_count())
    number = str(jnp.zeros(()).dtype)
    return (source_digest(), circumstances_of_machine(), devices, number)


def keep_machine_code(folder: CacheFolder, path: Path) -> None:
    """Let JAX keep what it compiles in a folder that can be trusted, or nowhere.

    JAX loads whatever machine code lies in its cache folder, and writes there in place. Its
    cache's two operations, get and put, are therefore given the project's own cache folder,
    whose entries are authenticated.
    """
    jax.config.update("jax_enable_compilation_cache", False)
    with contextlib.suppress(ImportError, AttributeError):
        # Not public; without it the cache stays off.
        from jax._src import compilation_cache as private
        from jax._src.compilation_cache_interface import CacheInterface

        class _Checked(CacheInterface):
            _path = path

            def get(self, key: str) -> bytes | None:
                return folder.get(f"{circumstances_of_machine()[:16]}-{key}")

            def put(self, key: str, value: bytes) -> None:
                folder.put(f"{circumstances_of_machine()[:16]}-{key}", value)

        assert callable(private.get_file_cache)  # what is replaced is there
        private.get_file_cache = lambda path: (_Checked(), path)
        compilation_cache.reset_cache()
        jax.config.update("jax_compilation_cache_dir", str(path))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
        jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
        jax.config.update("jax_persistent_cache_enable_xla_caches", "none")
        jax.config.update("jax_enable_compilation_cache", True)
