"""Taxels that stand out from what the skin would read: faulty ones, left out of a fit.

A frame that nothing explains is fitted again without the taxels that stand out, each of which
counts against the fit: first by one contact, from the table's node that explains all but the
worst taxels best, then by as many contacts as its best explanation has.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.fit.loads_and_errors import SUSPECT
from fitting.inverse_load.search.base import AbstractNodeSearch

_OUTLIER = 4.5  # standard deviations of the residual of a taxel that is left out
_MOST_OUTLIERS = 0.2  # share of the taxels
_TRIMMED_FITS = 3


@dataclass(frozen=True)
class FaultyTaxels:
    """Explains frames without their faulty taxels.

    Args:
        nodes: states of one contact.
        fit: fits frames by a number of contacts, from readings, weights, starting points,
            states and that number, each contact beyond the first with its penalty.
        per_contact: parameters of a contact.
        most_contacts: to tell apart.
    """

    nodes: AbstractNodeSearch
    fit: Callable[[Any, Any, Any, Any, int], Explanations]
    per_contact: int
    most_contacts: int

    def explained_without(
        self, y: Any, weight: Any, frames: Any, best: Explanations
    ) -> Explanations:
        """Fit frames without the taxels that stand out, each counted against the fit.

        Args:
            y: readings [frame, taxel] [counts].
            weight: inverse variances, zero where a taxel is not used [frame, taxel].
            frames: those that are fitted.
            best: explanations of all frames.

        Returns:
            The explanations, with those of the frames where they are cheaper.
        """
        y, weight = y[frames], weight[frames]
        most = np.maximum(1, np.floor(_MOST_OUTLIERS * (weight > 0).sum(1)))
        node, trimmed = _least_trimmed(self.nodes, y, weight, most)
        start, states = self.nodes.loads[node], self.nodes.states(node)
        for _ in range(_TRIMMED_FITS):
            found = self.fit(y, trimmed, start, states, 1)
            trimmed = _inliers(y, weight, found.so)
            better = found.parameters[:, : start.shape[1]]
            start = np.where(np.isfinite(found.chi2)[:, None], better, start)
        best = self._if_cheaper(frames, weight, best, found, most)
        # Then from several contacts, less the taxels that stand out from them.
        for count in range(2, self.most_contacts + 1):
            suspect = best.p_value(self.per_contact)[frames] < SUSPECT / 10
            rows = np.flatnonzero((best.contacts[frames] == count) & suspect)
            if not rows.size:
                continue
            width = self.per_contact * count
            for _ in range(2):
                so = best.so[frames[rows]]
                start = best.parameters[frames[rows]][:, :width]
                states = self.nodes.states(self.nodes.nearest_to(start, count))
                kept = _inliers(y[rows], weight[rows], so)
                found = self.fit(y[rows], kept, start, states, count)
                best = self._if_cheaper(frames[rows], weight[rows], best, found, most[rows])
        return best

    def _if_cheaper(
        self, frames: Any, weight: Any, best: Explanations, found: Explanations, most: Any
    ) -> Explanations:
        """The fits of some frames where they are cheaper, taxels left out counted."""
        left_out = (weight > 0).sum(1) - found.used()
        rows = np.flatnonzero(left_out <= most)
        candidates = found.penalised(left_out * _OUTLIER**2).rows(rows)
        return best.cheapest(frames[rows], candidates)[0]


def _inliers(y: Any, weight: Any, so: Any) -> NDArray[np.float64]:
    """Weights without the taxels that stand out from a model.

    Args:
        y: readings [frame, taxel] [counts].
        weight: inverse variances, zero where a taxel is not used [frame, taxel].
        so: what the model reads [frame, taxel] [counts]; all stand out where it is not finite.
    """
    residual = np.abs(np.where(np.isfinite(so), y - so, np.inf))
    limit = np.where(weight > 0, _OUTLIER / np.sqrt(np.where(weight > 0, weight, 1.0)), 0.0)
    return np.where(residual < limit, weight, 0.0)


def _least_trimmed(
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
