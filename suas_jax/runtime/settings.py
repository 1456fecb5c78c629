"""Settings of the JAX runtime, made by entry points and never on import."""

import gc
import warnings

import jax
import platformdirs

from suas_jax.files.cache_folder import CacheFolder
from suas_jax.runtime.blas import limit_blas
from suas_jax.runtime.compiled import COMPILED
from suas_jax.runtime.program_store import ProgramStore, keep_machine_code


def configure() -> None:
    """Compute in float64, keep compiled programs between runs, give BLAS one thread.

    Whoever wants more threads for other work says so by ``OPENBLAS_NUM_THREADS``.

    Raises:
        ValueError: ``JAX_PLATFORMS`` names a device that JAX doesn't find.
    """
    _require_platform()
    limit_blas()
    # Tracing makes many small objects that live on: looking for garbage among them every
    # few hundred allocations takes a sixth of a command's time.
    gc.set_threshold(100_000)
    jax.config.update("jax_enable_x64", True)
    cache = platformdirs.user_cache_path("suas_jax")
    # Where an operation stands in the source code is of no use in a program that is kept.
    jax.config.update("jax_traceback_in_locations_limit", 0)
    programs = CacheFolder(cache / "programs")
    if programs.refusal is not None:
        warnings.warn(f"{programs.refusal}: nothing is kept between runs", stacklevel=2)
        jax.config.update("jax_enable_compilation_cache", False)
        return
    keep_machine_code(programs, cache / "programs")
    COMPILED.store = ProgramStore(programs)


def _require_platform() -> None:
    wanted = jax.config.jax_platforms  # type: ignore[attr-defined] # made at run time
    if not wanted:
        return
    try:
        jax.devices()
    except (RuntimeError, AssertionError):  # the latter where a platform's plugin is missing
        raise ValueError(
            f'JAX_PLATFORMS is "{wanted}", but JAX finds no such device here: unset the '
            'variable, or set it to "cpu"'
        ) from None
