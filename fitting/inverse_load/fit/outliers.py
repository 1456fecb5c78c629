"""Taxels that stand out from what the skin would read: faulty ones, left out of a fit."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitting.inverse_load.search.base import AbstractNodeSearch

OUTLIER = 4.5
"""Residual in standard deviations of a taxel that is left out."""


def inliers(y: Any, weight: Any, so: Any) -> NDArray[np.float64]:
    """Weights without the taxels that stand out from a model.

    Args:
        y: readings [frame, taxel] [counts].
        weight: inverse variances, zero where a taxel is not used [frame, taxel].
        so: what the model reads [frame, taxel] [counts]; all stand out where it is not finite.
    """
    residual = np.abs(np.where(np.isfinite(so), y - so, np.inf))
    limit = np.where(weight > 0, OUTLIER / np.sqrt(np.where(weight > 0, weight, 1.0)), 0.0)
    return np.where(residual < limit, weight, 0.0)


def least_trimmed(
    nodes: AbstractNodeSearch, y: Any, weight: Any, most: Any
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Nodes that explain all but the worst taxels best (least trimmed squares).

    Args:
        nodes: states of one contact.
        y: readings [frame, taxel] [counts].
        weight: inverse variances, zero where a taxel is not used [frame, taxel].
        most: taxels that may be left out [frame].

    Returns:
        The node of every frame, and weights without its worst taxels [frame, taxel].
    """
    trimmed, node = weight.copy(), np.zeros(len(y), int)
    for k in range(len(y)):
        squares = weight[k] * (y[k] - nodes.readings) ** 2
        squares[:, weight[k] <= 0] = np.inf
        squares[~nodes.known] = np.inf
        keep = int((weight[k] > 0).sum() - most[k])
        node[k] = np.partition(squares, keep - 1)[:, :keep].sum(1).argmin()
        own = squares[node[k]]
        trimmed[k, own > np.partition(own, keep - 1)[keep - 1]] = 0.0
    return node, trimmed
