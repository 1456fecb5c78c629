"""Settings shared by every test: float64, quick compilation, programs kept between runs."""

import os
import pathlib

import jax

# As in suas_jax.runtime.compiled: half the compile time for the same programs. Read when
# the first program is compiled.
os.environ["XLA_FLAGS"] = (
    os.environ.get("XLA_FLAGS", "") + " --xla_cpu_use_fusion_emitters=false"
)
jax.config.update("jax_enable_x64", True)
jax.config.update(
    "jax_compilation_cache_dir", str(pathlib.Path(__file__).parent.parent / ".jax_cache")
)
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)
