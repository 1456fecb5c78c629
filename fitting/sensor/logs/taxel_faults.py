"""Masks of silent, stuck and saturated taxels, whose readings carry no information."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from suas_jax.acquisition.equal_runs import equal_runs
from suas_jax.acquisition.log.log_file import MAX_COUNT, SoLog

# A converter of fewer bits is full at one of these counts.
_FULL_SCALES = (255, 1023, 4095, 16383)
# A taxel that keeps its count this long while others change is stuck.
_STUCK_AFTER = 20


@dataclasses.dataclass(frozen=True)
class Masked:
    """Readings of a taxel that are left out.

    Attributes:
        module: from 0.
        taxel: number in its module, from 1.
        reason: why, in words.
        frames: how many readings.
        whole: whether nothing of the taxel is left in this log.
        log: the file.
    """

    module: int
    taxel: int
    reason: str
    frames: int
    whole: bool
    log: str


def without_faults(
    so: np.ndarray,
    log: SoLog,
    modules: Sequence[int],
    numbers: Sequence[int],
    masked: list[Masked],
) -> np.ndarray:
    """Take out what says nothing about the gap, and list it."""
    so = so.copy()
    full = _full_scale(so, log.header)
    runs = np.array([_longest_run(row) for row in so])
    usual = float(np.median(runs[np.isfinite(so).any(1)])) if np.isfinite(so).any() else 0.0
    for i, (m, k) in enumerate(zip(modules, numbers, strict=True)):
        row = so[i]
        present = np.isfinite(row)
        if not present.any():
            masked.append(Masked(m, k, "silent: no counts in the log", 0, True, str(log.path)))
            continue
        limits = (row >= full) | (row <= 0)
        stuck = _stuck(row, max(_STUCK_AFTER, 3 * usual)) & ~limits
        for found, reason in (
            (limits, f"saturated (0 or {full:.0f} counts)"),
            (stuck, "stuck: keeps its count while others change"),
        ):
            if found.any():
                so[i, found] = np.nan
                whole = not np.isfinite(so[i]).any()
                count = int(found.sum())
                masked.append(Masked(m, k, reason, count, whole, str(log.path)))
        # A few readings between saturated or stuck ones are no basis for anything.
        left = np.isfinite(so[i]).sum()
        if 0 < left < 0.02 * present.sum() and left < 5:
            so[i] = np.nan
    if not np.isfinite(so).any():
        reasons = sorted({m.reason.split(":")[0] for m in masked})
        raise ValueError(
            f"{log.path}: no reading is left: all {len(so)} taxels are {' or '.join(reasons)}"
        )
    return so


def _full_scale(so: np.ndarray, header: Mapping[str, str]) -> float:
    """The count at which the converter is full."""
    largest = np.nanmax(so) if np.isfinite(so).any() else 0.0
    for full in _FULL_SCALES:
        # Many readings at the very end of a range, none beyond it.
        if largest == full and np.sum(so == full) >= 5:
            return float(full)
    return float(MAX_COUNT)


def _longest_run(row: np.ndarray) -> int:
    runs = equal_runs(row[np.isfinite(row)])
    return int(np.max(runs[:, 1] - runs[:, 0], initial=0))


def _stuck(row: np.ndarray, after: float) -> np.ndarray:
    """Readings in runs of equal counts that are longer than others' [frame]."""
    where = np.flatnonzero(np.isfinite(row))
    stuck = np.zeros(len(row), bool)
    for begin, end in equal_runs(row[where]):
        if end - begin > after:
            stuck[where[begin:end]] = True
    return stuck
