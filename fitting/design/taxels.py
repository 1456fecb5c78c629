"""Which taxels to keep: the fewest that tell a contact's force or place well at every place.

One frame's Fisher information is the sum of its taxels' shares c c', c being the slopes of a
reading by place and force over its deviation. With weights w from 0 to 1, whose sum is the
number to keep, the variance v(w) by the bound of Cramer and Rao is convex, and so is its power
mean over the places, near the worst of them for a high power. From that minimum taxels are
exchanged as long as the worst place gains, then as long as the mean does and the worst loses
nothing. The tangent plane of any mean of v is a bound that no choice of as many taxels is below
(Boyd & Vandenberghe, Convex Optimization, sections 3.1.3 and 7.5.2).
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from fitting.arrays import Floats

_POWER = 16.0  # of the mean of variances that stands for the worst of them
_TRIED = 24  # taxels of either side that are tried in an exchange
_EXCHANGES = 200
_STARTS = 8  # of the exchanges
_PRICES = 20  # of a taxel, that are tried
_SMALLEST = 1e-6  # weight of a taxel, so that the information can be inverted


class Selection(NamedTuple):
    """A choice of taxels."""

    kept: NDArray[np.bool_]  # whether a taxel is [taxel]
    every: Floats  # the figure at the places with all taxels [place]
    chosen: Floats  # with those that are kept [place]
    bound: float  # no choice of as many is below it at its worst place
    # what the place that suffers most loses without each taxel that is kept, a share; NaN of
    # others [taxel]
    costs: Floats


class Variances:
    """Variances at places as functions of the taxels' weights.

    `columns`: slopes of the readings by the place's coordinates and, last, by the force, over
    the readings' deviations [coordinate, taxel, place]. `of_force`: whether the force's
    variance is wanted; else the sum of the others.
    """

    def __init__(self, columns: Floats, *, of_force: bool) -> None:
        rows = np.moveaxis(np.asarray(columns, float), 0, -1)  # taxel, place, coordinate
        # Of one size, so that the information is conditioned as the figures are.
        size = np.sqrt((rows**2).sum((0, 1)))
        size[size == 0] = 1.0
        self._rows = rows / size
        count = rows.shape[-1]
        self._which = [count - 1] if of_force else list(range(count - 1))
        self._own = size[self._which]

    @property
    def taxels(self) -> int:
        """How many there are."""
        return len(self._rows)

    def __call__(self, weights: Floats) -> tuple[Floats, Floats]:
        """Variances [place] and minus their derivatives by the weights [taxel, place]."""
        rows = self._rows
        variance, columns = self._inverted(self.information(weights))
        share = np.sum(np.einsum("tpi,pik->tpk", rows, columns) ** 2, -1)
        return variance, np.where(np.isfinite(share), share, 0.0)

    def information(self, weights: Floats) -> Floats:
        """Fisher information [place, coordinate, coordinate], scaled."""
        rows = self._rows
        return np.einsum("t,tpi,tpj->pij", weights, rows, rows, optimize=True)

    def exchanged(
        self, weights: Floats, out: NDArray[np.intp], into: NDArray[np.intp]
    ) -> Floats:
        """Variances with one taxel instead of another [out, into, place]."""
        squares = np.einsum("tpi,tpj->tpij", self._rows, self._rows)
        moved = self.information(weights) - squares[out, None] + squares[None, into]
        return self._inverted(moved)[0]

    def _inverted(self, information: Floats) -> tuple[Floats, Floats]:
        """Variances, infinite where taxels don't tell, and columns of the inverse."""
        # As 1e-12 of it is rounding, what is below is nothing.
        ridge = 1e-13 * np.eye(information.shape[-1])
        columns = np.linalg.inv(information + ridge)[..., self._which] / self._own
        variance = sum(columns[..., k, i] / self._own[i] for i, k in enumerate(self._which))
        good = (variance > 0) & (variance * self._own.max() ** 2 < 1e10)
        return np.where(good, variance, np.inf), columns


def select(variances: Variances, keep: int) -> Selection:
    """Choose so many taxels by variances of a figure, finite with all of them.

    Raises ValueError: there are not more taxels than that, or they are too few to tell the
    figure.
    """
    count = variances.taxels
    if not 3 <= keep < count:
        raise ValueError(f"taxels.keep = {keep}: from 3 to {count - 1} of the {count} taxels")
    every, _ = variances(np.ones(count))
    if not np.isfinite(every).all():
        raise ValueError("all taxels together do not tell the figure at every place")
    relaxed = _relaxed(variances, keep, every.max())
    bound = max(_bound(variances, relaxed, keep), float(every.max()))
    kept, chosen = min(
        (_exchanged(variances, first) for first in _first(relaxed, keep)),
        key=lambda found: float(found[1].max()),
    )
    if not np.isfinite(chosen).all():
        raise ValueError(f"{keep} taxels do not tell the figure at every place; keep more")
    costs = np.full(count, np.nan)
    for i in np.flatnonzero(kept):
        less = kept.astype(float)
        less[i] = 0.0
        costs[i] = np.sqrt(np.max(variances(less)[0] / chosen)) - 1
    return Selection(kept, np.sqrt(every), np.sqrt(chosen), float(np.sqrt(bound)), costs)


def _relaxed(variances: Variances, keep: int, scale: float) -> Floats:
    """Weights from 0 to 1, of about as many taxels as are kept, for the least power mean.

    Every weight has one price; the price at which their sum is right is found by bisection.
    """

    def mean(weights: Floats, price: float) -> tuple[float, Floats]:
        variance, share = variances(weights)
        relative = variance / scale
        size = np.mean(relative**_POWER) ** (1 / _POWER)
        pull = (relative / size) ** (_POWER - 1) / len(relative)
        return size + price * weights.sum(), price - (share @ pull) / scale

    weights = np.full(variances.taxels, keep / variances.taxels)
    # Variances go with the inverse of a common weight: at this price it is the right one.
    middle = np.log(mean(weights, 0.0)[0] / keep)
    low, high = middle - 5.0, middle + 5.0
    for _ in range(_PRICES):
        weights = minimize(
            mean,
            weights,
            (np.exp(middle),),
            jac=True,
            method="L-BFGS-B",
            bounds=[(_SMALLEST, 1.0)] * len(weights),
        ).x
        if abs(weights.sum() - keep) < 0.1:
            break
        low, high = (middle, high) if weights.sum() > keep else (low, middle)
        middle = (low + high) / 2
    return weights


def _bound(variances: Variances, weights: Floats, keep: int) -> float:
    """What the worst variance of any choice is at least, by the tangent plane at weights."""
    variance, share = variances(weights)
    mean = (variance / variance.max()) ** (_POWER - 1)
    mean /= mean.sum()
    slope = -(share @ mean)
    return float(variance @ mean + np.sort(slope)[:keep].sum() - slope @ weights)


def _first(relaxed: Floats, keep: int) -> Iterator[NDArray[np.bool_]]:
    """Choices to start from: the largest weights, then taxels drawn by their weights."""
    random = np.random.default_rng(0)
    for k in range(_STARTS):
        drawn = random.gumbel(size=len(relaxed)) if k else 0.0
        kept = np.zeros(len(relaxed), bool)
        kept[np.argsort(-(np.log(relaxed) + drawn), kind="stable")[:keep]] = True
        yield kept


def _exchanged(
    variances: Variances, kept: NDArray[np.bool_]
) -> tuple[NDArray[np.bool_], Floats]:
    """Exchange taxels one by one as long as the worst place gains; those kept, variances."""
    most, even = np.inf, False  # of the worst variance, once all places count alike
    for _ in range(_EXCHANGES):
        weights = kept.astype(float)
        now, share = variances(weights)
        value = share @ (np.ones_like(now) if even else (now / now.max()) ** (_POWER - 1))
        out, into = np.flatnonzero(kept), np.flatnonzero(~kept)
        out = out[np.argsort(value[out])[:_TRIED]]
        into = into[np.argsort(-value[into])[:_TRIED]]
        found = variances.exchanged(weights, out, into)
        worst = found.max(-1)
        size = np.where(worst <= most, found.mean(-1), np.inf) if even else worst
        best = np.unravel_index(size.argmin(), size.shape)
        if size[best] < (now.mean() if even else now.max()) * (1 - 1e-6):
            kept[[out[best[0]], into[best[1]]]] = [False, True]
        elif even:
            break
        else:
            most, even = now.max() * (1 + 1e-9), True
    return kept, variances(kept.astype(float))[0]
