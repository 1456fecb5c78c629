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
    "solve": "suas_jax.scene.solve",
    "Solution": "suas_jax.scene.solve",
    "gradient": "suas_jax.scene.gradient",
    "force_sweep": "suas_jax.scene.sweep",
    "pressure_sweep": "suas_jax.scene.sweep",
    "plot_solution": "suas_jax.figures.solution",
    "plot_sweep": "suas_jax.figures.curve",
    "plot_pad": "suas_jax.figures.pad",
    "Loads": "suas_jax.scene.forward",
    "forward": "suas_jax.scene.forward",
    "load_jacobian": "suas_jax.scene.forward",
    "loads_of": "suas_jax.scene.forward",
    "skin_of": "suas_jax.scene.forward",
    "read_log": "suas_jax.acquisition.log.log_file",
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)
