"""Differentiable model of the Soft Underwater Artificial Skin (SUAS): docs/api.md."""

import importlib
from typing import Any

# Public names and where they live. They are imported when first used: the serial logger
# shares this package and must start without JAX.
_HOMES = {
    "ConfigError": "suas_jax.config",
    "Float64Error": "suas_jax.runtime.compiled",
    "Loads": "suas_jax.scene.loads",
    "Skin": "suas_jax.scene.skin",
    "Solution": "suas_jax.scene.solve",
    "Sweep": "suas_jax.scene.sweep",
    "configure": "suas_jax.runtime.settings",
    "continuous_inputs": "suas_jax.config",
    "forward": "suas_jax.scene.forward",
    "gradient": "suas_jax.scene.gradient",
    "history_of": "suas_jax.dynamics.course",
    "history_sweep": "suas_jax.dynamics.history",
    "jit": "suas_jax.runtime.compiled",
    "load_jacobian": "suas_jax.scene.forward",
    "load_scene": "suas_jax.config",
    "load_skin": "suas_jax.config",
    "loads_of": "suas_jax.scene.loads",
    "modes": "suas_jax.dynamics.modes",
    "plot_modes": "suas_jax.figures.modes",
    "plot_pad": "suas_jax.figures.pad",
    "plot_solution": "suas_jax.figures.section",
    "plot_sweep": "suas_jax.figures.curve",
    "read_log": "suas_jax.acquisition.log.log_file",
    "scene_from_dict": "suas_jax.config",
    "skin_of": "suas_jax.scene.skin",
    "solve": "suas_jax.scene.solve",
    "sweep": "suas_jax.scene.sweep",
    "with_inputs": "suas_jax.config",
    "with_solve": "suas_jax.config",
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return [*globals(), *_HOMES]
