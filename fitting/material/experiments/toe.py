"""Start of a curve of tension or compression: slack that carries nothing, and a toe.

Rubber is steepest at rest. A curve on which readings do not rise at first is of a specimen that
hung slack, and one that grows steeper from rest has a toe, in which the specimen or its grips
were taking up slack; both end at a stretch that is found here.
"""

import numpy as np

from fitting.material.experiments.free_zero import can_be_freed
from fitting.material.experiments.measurements import Dataset
from fitting.material.experiments.selection import series_of
from fitting.material.experiments.stress_tests import StressTest

CERTAIN = 5.0
"""Standard errors beyond which a pattern of a curve is no scatter."""
# A toe begins with a slope that is lower by this share than the steepest.
_STEEPER = 0.25
# ... and has ended at this share of the largest stress.
_TOE_ENDS = 0.4


def idle(x: np.ndarray, y: np.ndarray, largest: float) -> float | None:
    """Where a slack specimen begins to carry; None if it does so at once.

    Before that, readings scatter about zero and do not rise; behind it they do.

    `x`: logarithms of the stretches, positive away from rest [n]. `y`: stresses, likewise [n].
    `largest`: size of the largest stress.
    """
    order = np.argsort(x, kind="stable")
    x, y = x[order], y[order]
    flat = np.flatnonzero(np.abs(y) > 0.02 * largest)
    end = int(flat[0]) if flat.size else 0
    while end >= 4:
        # Readings before must not rise as those behind do.
        before = np.polyfit(x[:end], y[:end], 1)[0] if x[end - 1] > x[0] else 0.0
        behind = x[end:] <= x[end] + max(x[end] - x[0], 1e-12)
        if behind.sum() < 2:
            return None
        after = np.polyfit(x[end:][behind], y[end:][behind], 1)[0]
        if before < 0.2 * after and x[end] > 0.02 * x[-1]:
            return float(x[end - 1])
        end = int(0.75 * end)
    return None


def toe_end(x: np.ndarray, y: np.ndarray) -> float | None:
    """Where a curve that grows steeper from rest is steepest; None if it does not.

    Slopes of lines through an eighth of the early readings each.

    `x`: logarithms of the stretches, positive away from rest [n]. `y`: stresses, likewise [n].
    """
    order = np.argsort(x, kind="stable")
    # Against the stretch itself rubber is steepest at rest, until its chains lock.
    x, y = np.expm1(x[order]), y[order]
    early = int(np.argmax(y > _TOE_ENDS * np.max(y)))
    x, y = x[:early], y[:early]
    width = max(len(x) // 8, 4)
    starts = np.arange(0, len(x) - 3, max(width // 2, 1))
    slopes, errors, middles = [], [], []
    for i in starts:
        part = slice(i, i + width)
        if len(x[part]) < 4 or np.ptp(x[part]) <= 0.0:
            continue
        coefficients, covariance = np.polyfit(x[part], y[part], 1, cov="unscaled")
        rest = y[part] - np.polyval(coefficients, x[part])
        slopes.append(float(coefficients[0]))
        errors.append(float(np.sqrt(covariance[0, 0] * np.sum(rest**2) / (len(rest) - 2))))
        middles.append(float(np.mean(x[part])))
    if len(slopes) < 4:
        return None
    # Scatter is judged from all of them: of few readings it is little known.
    scatter = float(np.sqrt(np.mean(np.square(errors))))
    best = int(np.argmax(slopes))
    rise = slopes[best] - slopes[0]
    fall = slopes[best] - min(slopes[best:])
    least = max(CERTAIN * scatter, _STEEPER * slopes[best])
    if best == 0 or rise < least or fall < min(scatter, 0.02 * slopes[best]):
        return None
    return float(np.log1p(middles[best]))


def without_toe(data: Dataset, share: float = 0.0) -> Dataset:
    """A test without its toe.

    `share`: of the largest stress, below which readings are left out; none where the curve is
    steepest at once.
    """
    if not isinstance(data, StressTest) or not can_be_freed(data):
        return data
    keep = np.ones(data.size, dtype=bool)
    for rows in series_of(data):
        x = np.log(data.stretch_1[rows])
        side = 1.0 if np.sum(x) >= 0.0 else -1.0
        end = toe_end(side * x, side * data.value[rows])
        if end is not None:
            keep[rows[side * x < end]] = False
        size = side * data.value[rows]
        if share > 0.0:
            first = int(np.argmax(size >= share * np.max(size)))
            keep[rows[side * x < side * x[first]]] = False
    return data.select(keep) if keep.sum() > 6 else data
