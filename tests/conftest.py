"""Settings shared by every test: float64, quick compilation, programs kept between runs."""

import gc
import os
from collections.abc import Iterator

# As commands do, and before NumPy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax
import platformdirs
import psutil
import pytest

from suas_jax.files.cache_folder import CacheFolder
from suas_jax.runtime import compiled, settings
from suas_jax.runtime.compiled import COMPILED, OPTIONS, give_back_freed_memory
from suas_jax.runtime.program_store import keep_machine_code

# The options of compiled programs for every other one, too. Read when the first is compiled.
QUICK = {
    **OPTIONS,
    # Programs run a few times: what the compiler's own optimisation gains, it costs twice.
    "xla_backend_optimization_level": 0,
    # Two processes run tests: neither is done sooner if several threads generate code.
    "xla_cpu_parallel_codegen_split_count": 1,
}
os.environ["XLA_FLAGS"] = " ".join(
    [os.environ.get("XLA_FLAGS", "")] + [f"--{k}={str(v).lower()}" for k, v in QUICK.items()]
)
# Batches run often: loops that run as fast as they ever do are worth half a compilation.
compiled.OPTIONS = {**QUICK, "xla_backend_optimization_level": 1}
jax.config.update("jax_enable_x64", True)
# As in suas_jax.runtime.settings: an eighth of the suite's time, which is mostly tracing.
gc.set_threshold(100_000)
jax.config.update("jax_traceback_in_locations_limit", 0)
# Every program is kept between runs, in a private folder that checkouts share, with its
# size bounded; where there is none, compiling takes its time. The user's own programs are
# neither used nor replaced.
CACHE = platformdirs.user_cache_path("suas_jax") / "tests"
PROGRAMS = CacheFolder(
    CACHE / "programs", most_bytes=2_000_000_000, key_file=CACHE / "key" / "key"
)
keep_machine_code(PROGRAMS, CACHE / "programs")
os.environ["XDG_CACHE_HOME"] = str(CACHE / "commands")
# A command that a test runs in this process compiles as the tests do, and keeps its machine
# code with theirs: a portable form beside it would be traced once more.
settings.keep_machine_code = lambda *_: None  # type: ignore[assignment]
settings.ProgramStore = lambda *_: None  # type: ignore[assignment, misc]
MUCH = 2_500_000_000
"""Bytes from which on a process of the suite frees the programs of the files before."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files first: none of them is left over for one process at the end."""
    items.sort(key=lambda item: -item.path.stat().st_size)


@pytest.fixture(autouse=True, scope="module")
def programs_of_files() -> Iterator[None]:
    """Files share programs as long as memory lasts: those of the whole suite take gigabytes."""
    yield
    PROGRAMS.settled()
    if psutil.Process().memory_info().rss > MUCH:
        COMPILED.forget()
        jax.clear_caches()
        gc.collect()
        give_back_freed_memory()
