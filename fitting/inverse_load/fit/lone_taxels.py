"""Taxels whose readings no load explains, told by what the others read.

A membrane bends smoothly, so the gaps above some taxels tell that above another one. With x the
change of u = 1 / (SO - stray), which is nearly the gap, relative to rest, S that of a table's n
states and N the noise, x is taken for drawn with covariance A, and the others tell x_i::

    A = N + 16 S^T S / n + 0.3^2 1 1^T,    x_i - (A^-1 x)_i / (A^-1)_ii  +-  (A^-1)_ii^(-1/2)

A taxel further off than any is in any state, by OUTLIER of these deviations, is left out. The
furthest goes first, and the others are looked at anew: A^-1 -> A^-1 - a_i a_i^T / (A^-1)_ii.
"""

from functools import lru_cache

import numpy as np

from fitting.arrays import Flags, Floats
from fitting.inverse_load.fit.doubts import OUTLIER, most_left_out

_WIDER = 16.0  # variance of the changes over that of a table's states, whose loads are single
_UNIFORM = 0.3  # relative error of all gaps together
_FURTHEST = 1.5  # gap over that at rest up to which the noise of u grows with it


class LoneTaxels:
    """Finds the taxels of one skin that read what no load explains."""

    def __init__(
        self,
        states: Floats,  # readings of the table's states [state, taxel] [counts]
        rest: Floats,  # the model's readings at rest [taxel] [counts]
        stray: Floats,  # part of the readings that no gap changes [taxel] [counts]
        variance: Floats,  # of a reading [taxel] [counts^2]
    ) -> None:
        self._rest, self._stray = rest, stray
        change = self._change(states)
        noise = np.where(np.isfinite(variance), variance, 0.0) / (rest - stray) ** 2
        spread = _WIDER / max(len(change), 1) * change.T @ change + _UNIFORM**2
        covariance = np.diag(noise) + spread
        inverse = np.linalg.inv(covariance)
        off = np.abs(change @ inverse) / np.sqrt(np.diag(inverse))
        self._limit = OUTLIER + off.max(initial=0.0)

        @lru_cache(maxsize=4)
        def of_used(used: bytes) -> tuple[Floats, Floats]:
            """A^-1 of the taxels in use, zero beside, and its diagonal, infinite beside."""
            rows = np.flatnonzero(np.frombuffer(used, bool))
            found, known = np.zeros_like(inverse), np.full(len(rest), np.inf)
            pick = np.ix_(rows, rows)
            found[pick] = inverse if len(rows) == len(rest) else np.linalg.inv(covariance[pick])
            known[rows] = np.diag(found)[rows]
            return found, known

        self._of_used = of_used

    def _change(self, so: Floats) -> Floats:
        """Relative change of u from rest [..., taxel]."""
        return np.asarray((self._rest - so) / np.maximum(so - self._stray, 1e-3))

    def found(self, so: Floats) -> Flags:
        """Taxels to leave out [frame, taxel], none where they are many.

        Readings are as the model has them [frame, taxel] [counts], NaN where not used.
        """
        used = np.isfinite(so)
        change = np.where(used, self._change(so), 0.0)
        # Noise of counts is a larger one of large gaps.
        limit = self._limit * np.clip(1 + change, 1.0, _FURTHEST) ** 2
        lone = np.zeros(so.shape, bool)
        most = most_left_out(used)
        alike = len(so) < 2 or bool((used == used[0]).all())
        patterns, group = (
            (used[:1], np.zeros(len(so), int))
            if alike
            else np.unique(used, axis=0, return_inverse=True)
        )
        for k, pattern in enumerate(patterns):
            inverse, known = self._of_used(pattern.tobytes())
            rows = np.flatnonzero(group.reshape(-1) == k)
            off = change[rows] @ inverse
            over = (np.abs(off) > limit[rows] * np.sqrt(known)).any(1)
            for i, own in zip(rows[over].tolist(), off[over], strict=True):
                lone[i, _apart(own, inverse, known, limit[i], int(most[i]))] = True
        return lone


def _apart(
    off: Floats,  # A^-1 x [taxel]
    inverse: Floats,  # A^-1 [taxel, taxel]
    known: Floats,  # its diagonal [taxel]
    limit: Floats,  # deviations beyond which a taxel is left out [taxel]
    most: int,  # how many may be
) -> list[int]:
    """Taxels of a frame to leave out, the furthest first."""
    apart: list[int] = []
    left = off
    while len(apart) <= most:
        far = np.abs(left) / np.sqrt(known)
        far[apart] = 0.0
        i = int(far.argmax())
        if far[i] <= limit[i]:
            return apart
        apart.append(i)
        # Without those: as by A^-1 less its part that goes through them.
        root = np.linalg.cholesky(inverse[np.ix_(apart, apart)])
        through = np.linalg.solve(root, inverse[apart])
        left = off - np.linalg.solve(root, off[apart]) @ through
        known = np.maximum(np.diag(inverse) - (through**2).sum(0), 0.0)
        known[known <= 0] = np.inf
    return []
