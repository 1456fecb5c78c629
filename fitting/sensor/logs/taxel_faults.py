"""Masks of silent, stuck and saturated taxels, whose readings carry no information."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from suas_jax.acquisition.log.log_file import SoLog
from suas_jax.acquisition.taxel_faults import (
    full_scale,
    saturated,
    stuck_taxels,
    typical_noise,
)


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
    full = full_scale(so)
    stuck = stuck_taxels(so.T, typical_noise(so.T)).T
    for i, (m, k) in enumerate(zip(modules, numbers, strict=True)):
        row = so[i]
        present = np.isfinite(row)
        if not present.any():
            masked.append(Masked(m, k, "silent: no counts in the log", 0, True, str(log.path)))
            continue
        limits = saturated(row, full)
        for found, reason in (
            (limits, f"saturated (0 or {full:.0f} counts)"),
            (stuck[i] & ~limits, "stuck: keeps its count while others change"),
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
