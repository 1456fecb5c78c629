"""JAX's own persistent cache, kept in a private folder whose entries are authenticated.

JAX loads whatever machine code lies in its cache folder, and writes there in place. Its
cache's two operations, get and put, are therefore given the project's own cache folder.
"""

import contextlib
from collections.abc import Iterator
from pathlib import Path

import jax
from jax.experimental.compilation_cache import compilation_cache

from suas_jax.files.cache_folder import CacheFolder
from suas_jax.runtime.program_store import circumstances_of_machine


def keep_machine_code(folder: CacheFolder, path: Path) -> None:
    """Let JAX keep what it compiles in a folder that can be trusted, or nowhere."""
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


@contextlib.contextmanager
def uncached() -> Iterator[None]:
    """Compile anew, past JAX's own cache: for measuring how long it takes."""
    name = "jax_enable_compilation_cache"
    before = getattr(jax.config, name)
    jax.config.update(name, False)
    compilation_cache.reset_cache()  # it looks at the setting once only
    try:
        yield
    finally:
        jax.config.update(name, before)
        compilation_cache.reset_cache()
