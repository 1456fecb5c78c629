"""Differentiable model of the Soft Underwater Artificial Skin (SUAS)."""

import importlib
from typing import Any

# Public names and where they live. They are imported when first used: the serial logger
# shares this package and must start without JAX.
_HOMES = {
    "load_scene": "suas_jax.config",
    "load_skin": "suas_jax.config",
    "scene_from_dict": "suas_jax.config",
    "continuous_inputs": "suas_jax.config",
    "with_inputs": "suas_jax.config",
    "with_solve": "suas_jax.config",
    "ConfigError": "suas_jax.config",
    "solve": "suas_jax.solution",
    "Solution": "suas_jax.solution",
    "gradient": "suas_jax.sensitivity",
    "force_sweep": "suas_jax.sweep",
    "pressure_sweep": "suas_jax.sweep",
    "plot_solution": "suas_jax.plot",
    "plot_sweep": "suas_jax.plot",
    "plot_pad": "suas_jax.taxel_plot",
    "Loads": "suas_jax.skin",
    "forward": "suas_jax.skin",
    "load_jacobian": "suas_jax.skin",
    "loads_of": "suas_jax.skin",
    "skin_of": "suas_jax.skin",
    "read_log": "suas_jax.acquisition.log_file",
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)
