"""Runs of equal counts, by which taxels that are stuck are recognised."""

import numpy as np
from numpy.typing import NDArray


def equal_runs(values: NDArray[np.float64]) -> NDArray[np.intp]:
    """Runs of equal neighbouring values; what is missing (NaN) is a run of its own.

    Args:
        values: counts of one taxel, shape [n].

    Returns:
        First index of each run, and the index after its last, shape [run, 2].
    """
    edges = np.flatnonzero(~(np.diff(values) == 0)) + 1
    begin = np.concatenate([[0], edges]) if len(values) else edges
    return np.stack([begin, np.append(begin[1:], len(values))[: len(begin)]], axis=1)
