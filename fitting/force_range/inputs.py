"""What the errors of a skin file's inputs do to the force of first contact.

Shortly before it, the smallest gap's deviation over its slope by the force is the force's.
"""

import math
from collections.abc import Callable, Mapping

from suas_jax.config import SkinSpec, continuous_inputs, input_errors

SmallestGap = Callable[[Mapping[str, float], float], float]

_BEFORE, _STEP = 0.9, 0.05  # of the force of first contact
_DEVIATIONS = 0.01  # of a standard deviation
_SENSING = "electrodes."  # what moves no membrane


def contact_deviation(spec: SkinSpec, force: float, smallest_gap: SmallestGap) -> float:
    """Standard deviation of the force of first contact, relative; NaN where it is unknown.

    `smallest_gap` is that [m] of the skin with some inputs changed, by path, under a force [N];
    NaN where there is no equilibrium.
    """
    if not math.isfinite(force):
        return math.nan
    known, errors = continuous_inputs(spec), input_errors(spec)

    def moved(direction: Mapping[str, float], size: float) -> float:
        changed = {path: known[path] + size * by for path, by in direction.items()}
        return smallest_gap(changed, _BEFORE * force)

    variance = 0.0
    for row in errors.directions:
        pairs = zip(errors.paths, row.tolist(), strict=True)
        own = {k: x for k, x in pairs if x and k in known and not k.startswith(_SENSING)}
        if own:
            change = moved(own, _DEVIATIONS) - moved(own, -_DEVIATIONS)
            variance += (change / (2 * _DEVIATIONS)) ** 2
    lower = smallest_gap({}, (_BEFORE - _STEP) * force)
    slope = (smallest_gap({}, _BEFORE * force) - lower) / (_STEP * force)
    return math.sqrt(variance) / abs(slope) / force if slope else math.nan
