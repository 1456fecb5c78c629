"""Scatter of the readings of a curve, and spikes in it, before any law is fitted.

A cubic through two readings on either side predicts a reading. Where readings lie dense the
departure from it is noise; where it is far more, the reading is a spike: none of the specimen.
"""

from collections.abc import Iterable

import numpy as np

# Relative misfits are relative to no less than this many times the scatter near rest: below
# it noise would tell the constants (`benchmarks/material_calibration.py noise`).
TIMES_SCATTER = 50.0
_SIDE = 2  # readings on either side
_FEWEST = 10  # departures that tell a scatter
# Deviation of a departure over that of the noise, beyond which neighbours tell nothing.
_STRETCHED = 20.0
_MAD = 1.4826  # standard deviation over median size, of normal noise
# Departures of spikes over their deviations: so many times the scatter at least, and this
# share of the reading.
_TIMES, _SHARE = 8.0, 0.07
_MOST = 0.02  # of the readings; where more depart, the curve has a step or a kink


def departures(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Departures of readings from what their neighbours predict [n].

    The second array is the deviation that unit noise of all five readings gives a departure.
    Both are NaN where the stretch turns back among these, or too few are left.

    `x`: stretches in the order of time [n]. `y`: readings [n].
    """
    count = len(x)
    if count <= 2 * _SIDE:
        return np.full(count, np.nan), np.full(count, np.nan)
    first = np.clip(np.arange(count) - _SIDE, 0, count - 2 * _SIDE - 1)
    window = first[:, None] + np.arange(2 * _SIDE + 1)
    steps = np.diff(x[window], axis=1)
    forward = np.all(steps > 0.0, axis=1) | np.all(steps < 0.0, axis=1)
    others = window[window != np.arange(count)[:, None]].reshape(count, 2 * _SIDE)
    near = np.where(forward[:, None], x[others], np.arange(2 * _SIDE))
    apart = near[:, :, None] - near[:, None, :]
    own = np.eye(2 * _SIDE, dtype=bool)
    ratio = (x[:, None, None] - near[:, None, :]) / np.where(own, 1.0, apart)
    weight = np.prod(np.where(own, 1.0, ratio), axis=2)
    departed = y - np.sum(weight * y[others], axis=1)
    deviation = np.sqrt(1.0 + np.sum(weight**2, axis=1))
    known = forward & (deviation < _STRETCHED)
    return np.where(known, departed, np.nan), np.where(known, deviation, np.nan)


def _scatter(shown: np.ndarray) -> float:
    """Standard deviation of the noise; zero where too few readings show it."""
    sizes = np.abs(shown[np.isfinite(shown)])
    return _MAD * float(np.median(sizes)) if sizes.size >= _FEWEST else 0.0


def _scatter_near_rest(shown: np.ndarray, size: np.ndarray) -> float:
    """Standard deviation of the noise of the quarter of the readings that are smallest.

    Zero where there are too few to tell.

    `shown`: departures over their deviations, see `departures`. `size`: of the readings [n].
    """
    known = np.isfinite(shown)
    if not known.any():
        return 0.0
    return _scatter(shown[known & (size <= np.quantile(size[known], 0.25))])


def least_size(x: np.ndarray, y: np.ndarray, series: Iterable[np.ndarray]) -> float:
    """Size below which noise would tell a relative misfit; zero where the curves can't tell.

    `x`: stretches, or whatever was set [n]. `y`: readings [n]. `series`: positions of the
    readings of each curve, in the order of time.
    """
    shown = np.full(len(y), np.nan)
    for rows in series:
        departed, deviation = departures(x[rows], y[rows])
        shown[rows] = departed / deviation
    return TIMES_SCATTER * _scatter_near_rest(shown, np.abs(y))


def _standing(x: np.ndarray, y: np.ndarray, floor: float) -> tuple[np.ndarray, np.ndarray]:
    """Departures over what noise lets them be, and which stand out by it [n]."""
    departed, deviation = departures(x, y)
    size = np.maximum(np.abs(y - departed), floor)
    shown = departed / deviation
    near_rest = _scatter_near_rest(shown, size)
    if near_rest == 0.0:
        return np.zeros(len(x)), np.zeros(len(x), dtype=bool)
    ratio = np.abs(shown) / (_TIMES * np.hypot(near_rest, _scatter(shown / size) * size))
    # Comparisons with NaN are false.
    return np.nan_to_num(ratio), (ratio > 1.0) & (np.abs(shown) > _SHARE * size)


def spikes(x: np.ndarray, y: np.ndarray, floor: float) -> np.ndarray:
    """Readings that stand out from their neighbours, while all others follow theirs [n].

    `floor`: size that a departure is compared with where the reading is smaller.
    """
    left = np.arange(len(x))
    most = max(1, int(_MOST * len(x)))
    for _ in range(most + 1):
        ratio, out = _standing(x[left], y[left], floor)
        if not out.any():
            every = np.arange(len(x))
            gone = np.setdiff1d(every, left).tolist()
            found = [k for k in gone if _is_off(x, y, np.sort([*left, k]), k)]
            return np.isin(every, found)
        # A spike moves its neighbours' predictions, too: it is the one without which all
        # others follow theirs best.
        suspects = np.argsort(np.where(out, ratio, 0.0))[-2 * _SIDE - 1 :]
        rests = [np.delete(left, k) for k in suspects[out[suspects]]]
        left = min(rests, key=lambda rows: np.sum(_standing(x[rows], y[rows], floor)[0] ** 2))
    return np.zeros(len(x), dtype=bool)


def _is_off(x: np.ndarray, y: np.ndarray, rows: np.ndarray, k: int) -> bool:
    """Whether reading k of some rows departs further than its neighbours differ, halved.

    A kink, as at the end of slack, departs by less: a third of the larger slope's step.
    """
    at = np.searchsorted(rows, k)
    departed, _ = departures(x[rows], y[rows])
    return bool(np.abs(departed[at]) > np.abs(np.gradient(y[rows])[at]))
