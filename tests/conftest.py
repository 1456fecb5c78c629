"""Settings shared by every test: float64, quick compilation, programs kept between runs."""

import gc
import os
import pathlib
from collections.abc import Iterator

# As commands do, and before NumPy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax
import pytest

from suas_jax.runtime.compiled import COMPILED
from suas_jax.runtime.memory import give_back_freed_memory

# As in suas_jax.runtime.compiled: half the compile time for the same programs. Read when
# the first program is compiled.
os.environ["XLA_FLAGS"] = (
    os.environ.get("XLA_FLAGS", "") + " --xla_cpu_use_fusion_emitters=false"
)
jax.config.update("jax_enable_x64", True)
# As in suas_jax.runtime.settings: an eighth of the suite's time, which is mostly tracing.
gc.set_threshold(100_000)
jax.config.update("jax_traceback_in_locations_limit", 0)
CACHE = pathlib.Path(__file__).parent.parent / ".jax_cache"
# What commands keep between runs: the suite neither uses nor fills the user's own folder.
os.environ["XDG_CACHE_HOME"] = str(CACHE / "commands")
jax.config.update("jax_compilation_cache_dir", str(CACHE))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)


@pytest.fixture(autouse=True, scope="module")
def programs_of_one_file() -> Iterator[None]:
    """Free what a file's programs take: those of the whole suite would need gigabytes."""
    yield
    COMPILED.forget()
    jax.clear_caches()
    gc.collect()
    give_back_freed_memory()  # gigabytes
