"""What a taxel has in common with its neighbours: slow changes, and noise.

A load moves neighbouring taxels together, each with noise of its own. One that stays while
those around it move says nothing of the load; one whose noise is a neighbour's is connected
to it, or its counts were sent twice.
"""

import math

import numpy as np
from numpy.typing import NDArray

from suas_jax.acquisition.missing import deviation, mean, median

_NEIGHBOURS = 4
_SMOOTHED = 10  # frames averaged to see signals below the noise of one
_MOVED = 10.0  # standard errors by which neighbours must move to be followed


def neighbours(
    names: list[tuple[int, int]], places: dict[tuple[int, int], tuple[float, float]] | None
) -> list[list[int]]:
    """Indices of every taxel's neighbours.

    Args:
        names: module and number of the taxels.
        places: of the taxels on the wall [m], whose nearest are neighbours; where one is
            unknown, those of a module with the nearest numbers.
    """
    if places is not None and all(name in places for name in names):
        at = np.array([places[name] for name in names])
        distance = np.linalg.norm(at[:, None] - at[None], axis=-1)
        np.fill_diagonal(distance, np.inf)
        nearest = np.argsort(distance, axis=1)[:, :_NEIGHBOURS]
        return [[k for k in row if k != i] for i, row in enumerate(nearest.tolist())]
    by_module: dict[int, list[int]] = {}
    for k, (module, _) in enumerate(names):
        by_module.setdefault(module, []).append(k)
    groups = []
    for k, (module, _) in enumerate(names):
        others = sorted((abs(i - k), i) for i in by_module[module] if i != k)
        groups.append([i for _, i in others[:_NEIGHBOURS]])
    return groups


def correlations(
    so: NDArray[np.float64], noise: NDArray[np.float64], groups: list[list[int]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Of every taxel's slow changes with its neighbours', and the largest of its noise.

    Args:
        so: counts [frame, taxel]; NaN where missing.
        noise: from frame to frame [taxel].
        groups: indices of every taxel's neighbours.
    """
    taxels = so.shape[1]
    size = len(so) // _SMOOTHED
    parts = so[: size * _SMOOTHED].reshape(size, _SMOOTHED, taxels)
    slow = mean(parts.swapaxes(0, 1))
    slow = slow - median(slow)
    spread = np.nan_to_num(deviation(slow))
    quick = np.diff(so, 2, axis=0)
    follows, coupling = np.full(taxels, np.nan), np.full(taxels, np.nan)
    for k, others in enumerate(groups):
        if not others:
            continue
        error = np.hypot(noise[others], 1 / math.sqrt(12)) / math.sqrt(_SMOOTHED)
        moved = [i for i, e in zip(others, error, strict=True) if spread[i] > _MOVED * e]
        if len(moved) > len(others) / 2:
            # Outside a contact taxels move the other way: what counts is that they move.
            follows[k] = max(abs(_correlation(slow[:, k], slow[:, i])) for i in moved)
        found = [_correlation(quick[:, k], quick[:, i]) for i in others]
        coupling[k] = max((c for c in found if not math.isnan(c)), default=math.nan)
    return follows, coupling


def _correlation(x: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    """Pearson's, of what both have; 0 where one doesn't change, NaN where too few are left."""
    both = np.isfinite(x) & np.isfinite(y)
    if both.sum() < 3:
        return math.nan
    a, b = x[both] - x[both].mean(), y[both] - y[both].mean()
    size = math.sqrt(float((a @ a) * (b @ b)))
    return float(a @ b) / size if size > 0 else 0.0
