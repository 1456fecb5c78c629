"""The estimator that a skin file and a baseline file describe."""

from pathlib import Path
from typing import Any

from fitting.inverse_load.estimator import LoadEstimator
from fitting.inverse_load.readings import Layout
from suas_jax.config import load_skin


def skin_estimator(skin: Path, baseline: Path | None = None, **settings: Any) -> LoadEstimator:
    """Make the estimator of a skin.

    Args:
        skin: skin file.
        baseline: readings at rest, of `suas baseline`; None: readings are absolute.
        settings: of the `LoadEstimator`.

    Raises:
        ConfigError: the skin file can't be used.
        ValueError: the baseline is of another layout, or a setting makes no sense.
        Float64Error: float64 is off.
    """
    spec = load_skin(skin)
    layout = Layout(spec)
    if baseline is not None:
        from suas_jax.acquisition.baseline import read_baseline

        rest, variance = layout.baseline(read_baseline(baseline), str(baseline))
        settings |= {"rest": rest, "rest_variance": variance}
    return LoadEstimator(spec, **settings)
