"""The fitter of contacts on a pad: least squares on the interpolant, and what that leaves out.

Several contacts are solved where the fit ends, the interpolant is corrected by what it left
out, and the fit goes on until it moves no more: its end is exact but for the interpolant's
slopes.
"""

from typing import Any

import numpy as np

from fitting.arrays import Floats, Rows
from fitting.inverse_load.fit.explanation import AbstractLoadFitter, Explanations, widened
from fitting.inverse_load.pad.interpolant import Correction, PadInterpolant
from fitting.inverse_load.pad.pad_least_squares import (
    DIAMETER_PRIOR,
    PadFit,
    PadLeastSquares,
    step_of,
)
from fitting.inverse_load.pad.solved import SolvedContacts, near
from fitting.inverse_load.pad.table_build import edge_of
from suas_jax.equilibrium.equilibrium import State
from suas_jax.scene.skin import Skin

_ROUNDS = 4  # of solving several contacts and fitting again
_MOVED = 0.1  # standard deviations below which a round is the last


class PadFitter(AbstractLoadFitter):
    """Least squares on one pad.

    Args:
        skin: the pad.
        interpolant: of its tables.
        live: whether frames come one by one.
        most_contacts: widest set of parameters.
        diameter: of the contacts where it is no parameter [m].

    Attributes:
        squares: least squares on the interpolant alone.
        edge: largest angle [rad] and axial position [m] of a contact.
    """

    def __init__(
        self,
        skin: Skin,
        interpolant: PadInterpolant,
        *,
        live: bool,
        most_contacts: int,
        diameter: float,
    ) -> None:
        self.interpolant, self.live = interpolant, live
        self.table = interpolant.tables[0]
        self.parameters = interpolant.parameters
        self._width = self.per_contact * most_contacts
        self.edge = edge_of(skin, interpolant.tables[-1].diameter)
        self.squares = PadLeastSquares(interpolant, self.edge)
        self._radius = float(skin.geometry.outer_size[0])
        self._gap = float(skin.geometry.oil_gap[0])
        self._solved = SolvedContacts(skin, interpolant, most_contacts, diameter)
        self._kept: dict[int, Correction] = {}

    def fit(
        self,
        y: Floats,
        weight: Floats,
        start: Floats,
        state: State,
        contacts: int,
        *,
        pull: bool = False,
    ) -> Explanations:
        """See the base class; no states are needed."""
        del state
        start = self.completed(start, contacts)
        if contacts == 1 and (pull or not self.interpolant.direction):
            fit = self.squares.fitted(y, weight, start, 1, None, pull)
            return self._gathered(fit, weight, 1, self._gap_sign(fit.parameters))
        fits, gaps = [], []
        for i in range(len(y)):
            row = slice(i, i + 1)
            fit, gap = self._refined(y[row], weight[row], start[row], contacts)
            fits.append(fit)
            gaps.append(gap)
        joined = PadFit(*(np.concatenate(x) for x in zip(*fits, strict=True)))
        return self._gathered(joined, weight, contacts, np.array(gaps))

    def inside(self, parameters: Floats, contacts: int) -> Floats:
        """See the base class."""
        low, high = self.squares.bounds(parameters, contacts, False)
        return np.clip(parameters, low, high)

    def screened(
        self,
        frames: Rows,
        y: Floats,
        weight: Floats,
        start: Floats,
        contacts: int,
        to_beat: Floats,
    ) -> Rows:
        """The start of every frame from which the interpolant alone explains it best.

        None where even that is no better than what is known: the interpolant is exact for a
        contact beside one that hardly presses.
        """
        start = self.completed(start, contacts)
        fit = self.squares.fitted(y, weight, start, contacts, None, False)
        best = [
            rows[np.argmin(fit.chi2[rows])]
            for rows in (np.flatnonzero(frames == i) for i in np.unique(frames))
        ]
        chosen = np.array(best, np.intp)
        return chosen[fit.chi2[chosen] < to_beat[chosen]]

    def completed(self, start: Floats, contacts: int) -> Floats:
        """Starting points with all parameters: the prior's diameter, radial forces."""
        missing = self.parameters.names[start.shape[1] // contacts :]
        values = [DIAMETER_PRIOR[0] if name == "diameter" else 0.0 for name in missing]
        more = np.tile(np.repeat(values, contacts), (len(start), 1))
        return np.concatenate([start, more], 1) if missing else start

    def correction(self, parameters: Floats, contacts: int) -> Correction | None:
        """What the interpolant leaves out at some contacts; None for nothing, or unknown.

        Args:
            parameters: of the contacts [parameter].
            contacts: their number.
        """
        if contacts == 1 and not self.interpolant.direction:
            return None
        return self._solved.correction(parameters, contacts)

    # --- several contacts -------------------------------------------------------------

    def _refined(self, y: Any, weight: Any, start: Any, contacts: int) -> tuple[PadFit, float]:
        """Fit one frame by several contacts or free directions, solving them on the way."""
        kept, gap = self._kept.get(contacts), 1.0
        # A coarse start is near enough to try what is known.
        close = self._near(kept, start[0], contacts, live=True)
        fit = self.squares.fitted(y, weight, start, contacts, kept if close else None, False)
        for _ in range(_ROUNDS):
            now = fit.parameters[0]
            if kept is not None and close and self._near(kept, now, contacts, live=self.live):
                gap = kept.min_gap
                break
            nearby = self._near(kept, now, contacts, live=True)
            found = self._solved.correction(now, contacts, kept if nearby else None)
            if found is None:
                return fit._replace(chi2=np.full(1, np.inf)), gap
            self._kept[contacts] = kept = found
            close, gap = True, found.min_gap
            fit = self.squares.fitted(y, weight, now[None], contacts, found, False)
            moved = fit.parameters[0] - now
            if moved @ fit.information[0] @ moved < _MOVED**2:
                break
        return fit, gap

    def _near(self, kept: Correction | None, now: Any, contacts: int, *, live: bool) -> bool:
        return kept is not None and near(kept, now, contacts, self._radius, live=live)

    def _gap_sign(self, parameters: Floats) -> Floats:
        """Below zero where a contact is beyond the force of first contact."""
        angle, axial, force = parameters[:, :3].T  # of single contacts
        return self._gap * (1 - force / self.table.first_contact_at(angle, axial))

    def _gathered(self, fit: PadFit, weight: Any, contacts: int, gaps: Floats) -> Explanations:
        frames, wide = len(fit.chi2), self._width
        low, high = self.squares.bounds(fit.parameters, contacts, False)
        low = np.where(fit.parameters < low, -np.inf, low)
        _, decrease = step_of(fit, low, high, np.zeros(frames))
        return Explanations(
            score=fit.chi2.copy(),
            chi2=fit.chi2.copy(),
            contacts=np.full(frames, contacts),
            parameters=widened(fit.parameters, wide),
            jacobian=widened(fit.jacobian, wide),
            information=widened(fit.information, wide, wide),
            predicted_decrease=decrease,
            pressure=fit.readings[:, -1].copy(),
            min_gap=gaps,
            so=fit.readings.copy(),
            q=np.zeros((frames, 0, 0)),
            weight=weight.copy(),
            absorbed=np.zeros(len(fit.chi2), bool),
            spread=np.full((len(fit.chi2), 2), np.nan),
        )
