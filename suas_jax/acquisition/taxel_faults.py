"""Taxels that say nothing about the gap: stuck at a count, or saturated (zero or full scale).

One is stuck while it keeps its count in more frames than chance explains, in which most of the
others changed; where noise is too small to tell, in STUCK_AFTER frames. A taxel at full scale
that has read less before or after is no fault: the membrane lies on it.
"""

import math

import numpy as np
from numpy.typing import NDArray

from suas_jax.acquisition.log.data import MAX_COUNT

STUCK_AFTER = 100
"""Frames in which a taxel keeps its count while others move, where chance says nothing."""
_STUCK = 1e-10  # chance that a healthy taxel repeats its count often enough to be called stuck
_LEAST_NOISE = 0.4  # counts: below it a healthy taxel may well repeat itself
# Full scales of converters with fewer bits than the log's counts.
_FULL_SCALES = (255, 1023, 4095, 16383)
_NORMAL = 1.4826  # standard deviation over median absolute deviation, of a normal law
_JUMP = 6.0
_PILED_UP = 5  # readings at the very end of a range that make it a full scale


def full_scale(so: NDArray[np.float64]) -> float:
    """Count at which the converter is full: 65535, or a smaller one where readings pile up."""
    largest = np.nanmax(so) if np.isfinite(so).any() else 0.0
    piled_up = largest in _FULL_SCALES and np.sum(so == largest) >= _PILED_UP
    return float(largest) if piled_up else float(MAX_COUNT)


def saturated(so: NDArray[np.float64], full: float = MAX_COUNT) -> NDArray[np.bool_]:
    """Which counts are at an end of the converter's range, 0 or `full`."""
    return np.asarray((so >= full) | (so <= 0))


def noise_by_taxel(so: NDArray[np.float64]) -> NDArray[np.float64]:
    """Standard deviation of a reading from frame to frame [taxel] [counts]; NaN where unknown.

    From second differences of counts [frame, taxel], which a steady change of the load doesn't
    touch; those beyond six standard deviations are jumps of the load and left out, and so are
    the differences of a taxel that keeps its count.
    """
    noise = np.full(so.shape[1], np.nan)
    for k, series in enumerate(so.T):
        present = series[np.isfinite(series)]
        bend = np.abs(np.diff(present, 2))
        if bend.size < 3:
            continue
        limit = _JUMP * (_NORMAL * float(np.median(bend)) + 1.0)
        kept = bend[bend <= limit]
        noise[k] = math.sqrt(float((kept**2).mean()) / 6.0) if kept.size else 0.0
    return noise


def typical_noise(so: NDArray[np.float64]) -> float:
    """Noise of the median taxel [counts]; see `noise_by_taxel`."""
    noise = noise_by_taxel(so)
    noise = noise[np.isfinite(noise)]
    return float(np.median(noise)) if noise.size else 0.0


def repeats_needed(noise: float, taxels: int) -> int:
    """Equal counts in a row beyond which a taxel of this noise [counts] is stuck."""
    if not noise >= _LEAST_NOISE:
        return STUCK_AFTER
    # Two readings of Gaussian noise s round to the same count with about this chance.
    same = min(1 / (2 * math.sqrt(math.pi) * noise), 0.9)
    return math.ceil(math.log(_STUCK / max(taxels, 1)) / math.log(same))


def stuck_taxels(so: NDArray[np.float64], noise: float) -> NDArray[np.bool_]:
    """Where taxels are stuck [frame, taxel], by counts of a noise [counts].

    Frames in which most taxels keep their counts (polled before the converter refreshed, or a
    skin at rest without noise) say nothing.
    """
    frames, taxels = so.shape
    stuck = np.zeros(so.shape, bool)
    if frames < 2:
        return stuck
    same = np.diff(so, axis=0) == 0
    compared = np.isfinite(np.diff(so, axis=0))
    fresh = same.sum(1) <= 0.5 * np.maximum(compared.sum(1), 1)
    needed = repeats_needed(noise, taxels)
    for k in np.flatnonzero((same & fresh[:, None]).sum(0) >= needed):
        for begin, end in _equal_runs(so[:, k]):
            if fresh[begin : end - 1].sum() >= needed:
                stuck[begin:end, k] = True
    return stuck & ~((so >= MAX_COUNT) & (so < MAX_COUNT).any(0))


def _equal_runs(values: NDArray[np.float64]) -> NDArray[np.intp]:
    """First index and last + 1 of runs of equal neighbours (NaN is one of its own) [run, 2]."""
    edges = np.flatnonzero(~(np.diff(values) == 0)) + 1
    begin = np.concatenate([[0], edges])
    return np.stack([begin, np.append(edges, len(values))], axis=1)


class StuckWatch:
    """`stuck_taxels` frame by frame, for a stream of so many taxels of a noise [counts]."""

    def __init__(self, noise: float, taxels: int) -> None:
        self._noise = noise
        self._last = np.full(taxels, np.nan)
        self._run = np.zeros(taxels, np.int64)
        self._sound = np.zeros(taxels, bool)  # read less than full scale

    def feed(self, so: NDArray[np.float64], step: int = 1) -> NDArray[np.bool_]:
        """Take a frame, whose counts come in steps; return which taxels are stuck by now."""
        same = so == self._last
        changed = np.isfinite(so)
        if same.sum() <= 0.5 * max(int(changed.sum()), 1):
            self._run[same] += 1
        self._run[~same] = 0
        self._last = so.copy()
        self._sound |= so < MAX_COUNT
        needed = repeats_needed(self._noise / step, len(so))
        return (self._run >= needed) & ~((so >= MAX_COUNT) & self._sound)


def mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean of what is present; NaN where nothing is, without a warning."""
    present = np.isfinite(values).sum(axis=0)
    return np.where(present > 0, np.nansum(values, axis=0) / np.maximum(present, 1), np.nan)


def median(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Median of what is present; NaN where nothing is, without a warning."""
    found = np.full(values.shape[1:], np.nan)
    known = np.isfinite(values).any(0)
    found[known] = np.nanmedian(values[:, known], axis=0)
    return found


def deviation(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Standard deviation of what is present; NaN where fewer than two values are."""
    present = np.isfinite(values).sum(axis=0)
    squares = np.nansum((values - mean(values)) ** 2, axis=0)
    return np.where(present > 1, np.sqrt(squares / np.maximum(present - 1, 1)), np.nan)
