"""Compiled programs kept between runs, found before anything is traced or lowered.

They are found by function, static arguments, shapes of arrays, and the source code. What is
kept is their portable form (StableHLO, see `jax.export`) and the frame of their results as
JSON; the machine code is kept by JAX's own cache.
"""

import contextlib
import functools
import hashlib
import json
import os
import platform
import struct
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.export
import jax.numpy as jnp
from jax.experimental.compilation_cache import compilation_cache

from suas_jax.files.cache_folder import CacheFolder
from suas_jax.runtime.content_key import NoContentKeyError, content_key, source_digest
from suas_jax.runtime.frame import count_holes, frame_from_json, frame_to_json

_BUILT_WITH = ("jax", "jaxlib", "numpy", "equinox", "lineax", "optimistix")
_LENGTH = struct.Struct("<q")


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
            if count_holes(frame) == len(exported.out_avals):
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
