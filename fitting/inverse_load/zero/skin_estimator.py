"""The estimator that a skin file, its zero and a baseline file describe."""

import logging
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from fitting.inverse_load.estimator import LoadEstimator
from fitting.inverse_load.readings import Layout
from fitting.inverse_load.zero.zero_file import aged, skin_with_zero
from suas_jax.config import SkinSpec
from suas_jax.config.oil import refuse_other_fluid

_log = logging.getLogger("suas")


def skin_estimator(
    skin: Path, baseline: Path | None = None, zero: Path | str | None = None, **settings: Any
) -> LoadEstimator:
    """Make the estimator of a skin.

    The baseline has readings at rest, of `suas baseline`; without one (None) readings are
    absolute. `zero` is what `suas zero` wrote; None takes the one beside the skin file, if
    there is one, and "none" takes none. The logger `suas` says which it is. Settings are those
    of the `LoadEstimator`.
    Raises ConfigError: the skin file or the zero can't be used.
    Raises ValueError: the baseline is of another layout, or a setting makes no sense.
    Raises Float64Error: float64 is off.
    """
    spec, told = skin_with_zero(skin, zero)
    spec, more = aged(spec, datetime.now(UTC).isoformat())
    for sentence in (told, *more):
        if sentence:
            _log.warning(sentence)
    return estimator_of(spec, baseline, **settings)


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

    Raises ValueError: the skin has no electrodes, or the baseline is of another layout or
    fluid.
    """
    layout = Layout(spec)
    if baseline is None:
        return None, None
    from suas_jax.acquisition.baseline import FLUID, read_baseline

    read = read_baseline(baseline)
    refuse_other_fluid(
        read.header.get(FLUID, ""), spec.oil.relative_permittivity, str(baseline)
    )
    return layout.baseline(read, str(baseline))
