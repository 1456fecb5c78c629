"""The estimator that a skin file and a baseline file describe."""

from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from fitting.inverse_load.estimator import LoadEstimator
from fitting.inverse_load.readings import Layout
from suas_jax.config import SkinSpec, load_skin


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
    return estimator_of(load_skin(skin), baseline, **settings)


def estimator_of(
    spec: SkinSpec, baseline: Path | None = None, **settings: Any
) -> LoadEstimator:
    """The same for a skin that has been read."""
    rest, variance = rest_of(spec, baseline)
    if rest is not None:
        settings |= {"rest": rest, "rest_variance": variance}
    return LoadEstimator(spec, **settings)


def rest_of(spec: SkinSpec, baseline: Path | None) -> tuple[NDArray | None, NDArray | None]:
    """Readings at rest and their variance from a baseline's file; None without one.

    Raises:
        ValueError: the skin has no electrodes, or the baseline is of another layout.
    """
    layout = Layout(spec)
    if baseline is None:
        return None, None
    from suas_jax.acquisition.baseline import read_baseline

    return layout.baseline(read_baseline(baseline), str(baseline))
