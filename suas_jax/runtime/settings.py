"""Settings of the JAX runtime, made by entry points and never on import."""

import gc

import jax
import platformdirs

from suas_jax.runtime.compiled import COMPILED
from suas_jax.runtime.program_store import ProgramStore


def configure() -> None:
    """Compute in float64 and keep compiled programs between runs."""
    # Tracing makes many small objects that live on: looking for garbage among them every
    # few hundred allocations takes a sixth of a command's time.
    gc.set_threshold(100_000)
    jax.config.update("jax_enable_x64", True)
    cache = platformdirs.user_cache_path("suas_jax") / "compiled"
    jax.config.update("jax_compilation_cache_dir", str(cache))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    COMPILED.store = ProgramStore(cache / "programs")
