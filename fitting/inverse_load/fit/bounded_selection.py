"""Selection of a stream's loads within a budget of time.

A frame is explained as without a budget where its time allows it. Where it does not, the frame
is told by what is known: one contact, or as many as before, fitted alone. Its search goes on in
the time that the next frames leave, on the readings that it began with; from what it finds the
frames after it are followed.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.fit.explanation import (
    PLAUSIBLE,
    UNSETTLED,
    Alternative,
    Attempt,
    Explanations,
)
from fitting.inverse_load.fit.selection import Selection
from fitting.steps import Budget, Search, Steps, finished

_AS_GOOD = 1.5  # chi2 of one contact that is followed, over that which its search left


@dataclass
class BoundedSelection(Selection):
    """Finds the best explanation of frames that come one by one, each within its time."""

    budget: Budget | None = None  # of a frame; there is one

    def __post_init__(self) -> None:
        super().__post_init__()
        self._search: Search[tuple[Explanations, list[Alternative | None]]] | None = None
        self._left = np.inf  # chi2 of what the last search found

    def forget(self) -> None:
        """See the base class."""
        super().forget()
        self.untouched()

    def untouched(self) -> None:
        """Take a frame that nothing touches: no search goes on."""
        self.last, self._search, self.searched, self.coarse = None, None, False, False

    def explain(
        self, y: Floats, weight: Floats
    ) -> tuple[Explanations, list[Alternative | None]]:
        """The best explanation of a frame and its second mode, or what is known when time ends.

        Readings are [1, taxel] [counts], weights inverse variances, zero where a taxel is not
        used [1, taxel].
        """
        assert self.budget is not None
        known: Explanations | None = None
        if self._search is not None:
            known = self._alone(y, weight, self.known)
            if not self._sure(y, weight, known) and self._search.go_on():
                self._search = known = None
        if self._search is None:
            self.known, search = None, Search(self.steps(y, weight), self.budget)
            if search.go_on():
                self.coarse = False
                assert search.found is not None
                return search.found
            self._search = search
            known = self.known or self._alone(y, weight, self.last)
        assert known is not None
        others: list[Alternative | None] = [None]
        self.known, self.coarse = known, not self._sure(y, weight, known)
        if not self.coarse:  # whatever the search was about is gone
            self.last, self._search = known, None
            others = finished(self._or_pairs(y, weight, known, others))
        self.seconds = np.zeros(1)
        return known, others

    def _alone(self, y: Any, weight: Any, earlier: Explanations | None) -> Explanations:
        """One contact, or as many as an earlier frame's, by loads alone."""
        count = 1 if earlier is None else int(earlier.contacts[0])
        node, _ = self.nodes.nearest(y, weight)
        if earlier is None or (count == 1 and not self._nearer(y, weight, node, earlier)):
            start, state = self.nodes.near(y, weight, node), self.nodes.states(node)
        else:
            start, state = self._predicted(y, weight, earlier), earlier.state
        return self.fitter.roughly(Attempt(y, weight, start, state, count))

    def _sure(self, y: Any, weight: Any, known: Explanations) -> bool:
        """Whether loads alone explain a frame, and nothing hints at others."""
        if self._p_value(known)[0] < PLAUSIBLE or known.predicted_decrease[0] > UNSETTLED:
            return False
        if known.contacts[0] > 1:
            return True
        _, second = self.nodes.nearest(y, weight)
        return bool(second[0] < 0 and not self.doubts.hinted(y, known)[0])

    def _reconsidered(self, *given: Any) -> Steps[Explanations]:
        """See the base class."""
        found = yield from super()._reconsidered(*given)
        self._left = float(found.chi2[0])
        return found

    def _followed(self, y: Any, weight: Any) -> Steps[Explanations | None]:
        """See the base class; likewise one contact that a search found, of whatever kind."""
        last = self.last
        if last is None or last.contacts[0] > 1 or not self.searched:
            return (yield from super()._followed(y, weight))
        used = np.where(last.weight > 0, weight, 0.0)
        start = self._predicted(y, used, last)
        asked = Attempt(y, used, start, last.state, 1)
        if last.absorbed[0]:
            found = yield from self._loads.beside_errors(asked, last.shift)
        else:
            wide = self.wide_fitter
            fitter = wide if wide is not None and wide.made(last) else self.fitter
            pull = bool(last.parameters[0, self.fitter.parameters.rows("force", 1)][0] < 0)
            found = yield from fitter.steps(asked._replace(pull=pull))
        settled = max(self._left, float(found.used()[0]))
        return found if found.chi2[0] < _AS_GOOD * settled else None
