"""Statistics over the first axis of counts, some of which are missing (NaN)."""

import numpy as np
from numpy.typing import NDArray


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
