"""Doubts whether one contact explains a frame: a poor fit, or the pattern of one more contact.

A fit is poor by its chi2; the pattern of a further contact is sought in its residuals by a
score test. In a stream a doubt counts once the frame before gave it, too.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.fit.load_fitter import AbstractLoadFitter
from fitting.inverse_load.fit.loads_and_errors import SUSPECT
from fitting.inverse_load.search.base import AbstractNodeSearch

_ALIKE = 0.7  # cosine of two patterns of one contact


class _Doubt(NamedTuple):
    """Why one contact may not explain a frame of a stream.

    Attributes:
        place: of the pattern of one more contact that its residuals hold.
        poor: whether the fit is poor.
    """

    place: int | None
    poor: bool


class Doubts:
    """Tells which frames one contact may not explain.

    Args:
        fitter: least squares on the skin.
        nodes: coarse search for one contact, which knows the patterns.
        penalty: chi2 that a further contact must gain.
        most_contacts: to tell apart.
    """

    def __init__(
        self,
        fitter: AbstractLoadFitter,
        nodes: AbstractNodeSearch,
        penalty: float,
        most_contacts: int,
    ) -> None:
        self._live, self._per_contact = fitter.live, fitter.per_contact
        self._nodes = nodes
        self._penalty, self._most_contacts = penalty, most_contacts
        self._last = _Doubt(None, False)

    def forget(self) -> None:
        """Live: let nothing of the frames so far count for the next."""
        self._last = _Doubt(None, False)

    def hinted(self, y: Any, best: Explanations) -> NDArray[np.bool_]:
        """Frames whose residuals hold the pattern of one more contact (a score test)."""
        return self._hints(y, best)[0]

    def _hints(self, y: Any, best: Explanations) -> tuple[NDArray[np.bool_], NDArray[np.intp]]:
        """The same, and the place of the pattern that fits best."""
        if self._most_contacts < 2:
            return np.zeros(len(y), bool), np.zeros(len(y), np.intp)
        pattern = self._nodes.signatures
        residual = np.where(best.weight > 0, y - best.so, 0.0)
        along = np.maximum((best.weight * residual) @ pattern.T, 0.0)
        size = best.weight @ (pattern**2).T
        gain = along**2 / np.maximum(size, 1e-300)
        return np.asarray(gain.max(1) > self._penalty / 2), gain.argmax(1)

    def of(self, y: Any, best: Explanations) -> NDArray[np.bool_]:
        """Frames that one contact may not explain.

        Args:
            y: readings [frame, taxel] [counts].
            best: their explanations by one contact.
        """
        if self._live:
            return self._lasting(y, best)
        return (best.p_value(self._per_contact) < SUSPECT) | self.hinted(y, best)

    def _lasting(self, y: Any, best: Explanations) -> NDArray[np.bool_]:
        """Live: doubts that the frame before gave, too, or that are too strong for noise.

        Noise gives a hint to every twentieth frame and a poor fit to every five-hundredth,
        whose search on a pad takes as long as many frames; another contact stays.
        """
        hinted, place = self._hints(y, best)
        p_value = float(best.p_value(self._per_contact)[0])
        now = _Doubt(int(place[0]) if hinted[0] else None, p_value < SUSPECT)
        before, self._last = self._last, now
        alike = False
        if before.place is not None and now.place is not None:
            one, other = self._nodes.signatures[[before.place, now.place]]
            alike = one @ other > _ALIKE * np.sqrt((one @ one) * (other @ other))
        poor = p_value < SUSPECT / 100 or (before.poor and now.poor)
        return np.array([alike or poor])
