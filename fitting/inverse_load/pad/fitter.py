"""Weighted least squares for contacts on a pad, on the interpolant of its tables.

Levenberg-Marquardt in all frames at once, inside bounds. Several contacts are solved where
the fit ends, the interpolant is corrected by what it left out, and the fit goes on until it
moves no more: its end is exact but for the interpolant's slopes.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fitting.inverse_load.fit.explanation import AbstractLoadFitter, Explanations, widened
from fitting.inverse_load.pad.interpolant import LEAST, MOST, Correction, PadInterpolant
from fitting.inverse_load.pad.solved import SolvedContacts, near
from fitting.inverse_load.pad.table_build import edge_of
from suas_jax.equilibrium.equilibrium import State
from suas_jax.scene.pad_forward import PadSkin

DIAMETER_PRIOR = (6e-3, 3e-3)
"""Mean and standard deviation of a contact's diameter where it is estimated [m]."""
MOST_TURN = np.pi / 3
"""Largest turn and tilt of a force from the radial where directions are free [rad]."""
_STEPS = 100
_SETTLED = 1e-4  # decrease of chi2 below which a fit has ended
_CHUNK = 64  # frames whose coefficients are gathered together
_DAMPING, _GIVEN_UP = 1e-3, 1e8
_ROUNDS = 4  # of solving several contacts and fitting again
_MOVED = 0.1  # standard deviations below which a round is the last


class _Fit(NamedTuple):
    """A fit, frame by frame."""

    parameters: NDArray[np.float64]
    readings: NDArray[np.float64]
    jacobian: NDArray[np.float64]
    chi2: NDArray[np.float64]
    gradient: NDArray[np.float64]
    information: NDArray[np.float64]

    def rows(self, index: Any) -> "_Fit":
        return _Fit(*(x[index] for x in self))


class PadFitter(AbstractLoadFitter):
    """Least squares on one pad.

    Args:
        skin: the pad.
        interpolant: of its tables.
        live: whether frames come one by one.
        most_contacts: widest set of parameters.
        diameter: of the contacts where it is no parameter [m].
    """

    def __init__(
        self,
        skin: PadSkin,
        interpolant: PadInterpolant,
        *,
        live: bool,
        most_contacts: int,
        diameter: float,
    ) -> None:
        self.interpolant, self.live = interpolant, live
        self.table = interpolant.tables[0]
        self.parameters = interpolant.parameters
        self.free_diameter = "diameter" in self.parameters.names
        self._width = self.per_contact * most_contacts
        smallest = interpolant.tables[0].diameter
        self.edge = edge_of(skin, interpolant.tables[-1].diameter)
        self._diameters = smallest, interpolant.tables[-1].diameter
        self._radius = float(skin.geometry.outer_radius[0])
        self._gap = float(skin.geometry.oil_gap[0])
        self._solved = SolvedContacts(skin, interpolant, most_contacts, diameter)
        self._kept: dict[int, Correction] = {}

    def fit(
        self,
        y: NDArray[np.float64],
        weight: NDArray[np.float64],
        start: NDArray[np.float64],
        state: State,
        contacts: int,
        *,
        pull: bool = False,
    ) -> Explanations:
        """See the base class; no states are needed."""
        del state
        start = self.completed(start, contacts)
        if contacts == 1 and (pull or not self.interpolant.direction):
            fit = self._fitted(y, weight, start, 1, None, pull)
            return self._gathered(fit, weight, 1, self._gap_sign(fit.parameters))
        fits, gaps = [], []
        for i in range(len(y)):
            row = slice(i, i + 1)
            fit, gap = self._refined(y[row], weight[row], start[row], contacts)
            fits.append(fit)
            gaps.append(gap)
        joined = _Fit(*(np.concatenate(x) for x in zip(*fits, strict=True)))
        return self._gathered(joined, weight, contacts, np.array(gaps))

    def inside(self, parameters: NDArray[np.float64], contacts: int) -> NDArray[np.float64]:
        """See the base class."""
        low, high = self.bounds(parameters, contacts, False)
        return np.clip(parameters, low, high)

    def screened(
        self,
        frames: NDArray[np.intp],
        y: NDArray[np.float64],
        weight: NDArray[np.float64],
        start: NDArray[np.float64],
        contacts: int,
        to_beat: NDArray[np.float64],
    ) -> NDArray[np.intp]:
        """The start of every frame from which the interpolant alone explains it best.

        None where even that is no better than what is known: the interpolant is exact for a
        contact beside one that hardly presses.
        """
        start = self.completed(start, contacts)
        fit = self._fitted(y, weight, start, contacts, None, False)
        best = [
            rows[np.argmin(fit.chi2[rows])]
            for rows in (np.flatnonzero(frames == i) for i in np.unique(frames))
        ]
        chosen = np.array(best, np.intp)
        return chosen[fit.chi2[chosen] < to_beat[chosen]]

    def completed(self, start: NDArray[np.float64], contacts: int) -> NDArray[np.float64]:
        """Starting points with all parameters: the prior's diameter, radial forces."""
        missing = self.parameters.names[start.shape[1] // contacts :]
        values = [DIAMETER_PRIOR[0] if name == "diameter" else 0.0 for name in missing]
        more = np.tile(np.repeat(values, contacts), (len(start), 1))
        return np.concatenate([start, more], 1) if missing else start

    def bounds(
        self, parameters: NDArray[np.float64], contacts: int, pull: bool
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lower and upper bounds [frame, parameter]; those of forces depend on places.

        Args:
            parameters: where they are wanted [frame, parameter].
            contacts: their number.
            pull: whether forces pull outwards.
        """
        frames = len(parameters)
        angle, axial = (
            np.clip(parameters[:, self.parameters.rows(name, contacts)], -edge, edge)
            for name, edge in zip(("angle", "axial"), self.edge, strict=True)
        )
        cap = self.interpolant.largest(angle.reshape(-1), axial.reshape(-1))
        cap = cap.reshape(frames, contacts)
        ones = np.ones((frames, contacts))
        force = (LEAST * cap, 0 * cap) if pull else (0 * cap, MOST * cap)
        low = [-self.edge[0] * ones, -self.edge[1] * ones, force[0]]
        high = [self.edge[0] * ones, self.edge[1] * ones, force[1]]
        if self.free_diameter:
            low.append(self._diameters[0] * ones)
            high.append(self._diameters[1] * ones)
        if self.interpolant.direction:
            low += [-MOST_TURN * ones] * 2
            high += [MOST_TURN * ones] * 2
        return np.concatenate(low, 1), np.concatenate(high, 1)

    # --- posterior ----------------------------------------------------------------------

    def prior_volume(self) -> float:
        """Of one contact's parameters: even, but normal in the diameter."""
        force = MOST * float(self.interpolant.tables[0].cap.mean())
        size = 4 * self.edge[0] * self.edge[1] * force
        if self.free_diameter:
            size *= np.sqrt(2 * np.pi) * DIAMETER_PRIOR[1]
        if self.interpolant.direction:
            size *= (2 * MOST_TURN) ** 2
        return float(size)

    def correction(self, parameters: NDArray[np.float64], contacts: int) -> Correction | None:
        """What the interpolant leaves out at some contacts; None for nothing, or unknown.

        Args:
            parameters: of the contacts [parameter].
            contacts: their number.
        """
        if contacts == 1 and not self.interpolant.direction:
            return None
        return self._solved.correction(parameters, contacts)

    def chi2(
        self,
        y: NDArray[np.float64],
        weight: NDArray[np.float64],
        parameters: NDArray[np.float64],
        contacts: int,
        correction: Correction | None,
    ) -> NDArray[np.float64]:
        """Weighted squares of the residuals, and of the diameters' from their prior [frame].

        Args:
            y: readings [frame, channel].
            weight: inverse variances [frame, channel].
            parameters: [frame, parameter].
            contacts: their number.
            correction: of the interpolant.
        """
        return self._judged(y, weight, parameters, contacts, correction).chi2

    # --- least squares ----------------------------------------------------------------

    def _judged(
        self, y: Any, weight: Any, parameters: Any, contacts: int, correction: Correction | None
    ) -> _Fit:
        found = self.interpolant(parameters, contacts, correction)
        used = weight > 0
        residual = np.where(used, y - found.readings, 0.0)
        weighted = found.jacobian * weight[:, None]
        chi2 = (weight * residual**2).sum(1)
        gradient = (weighted @ residual[..., None])[..., 0]
        information = weighted @ np.swapaxes(found.jacobian, 1, 2)
        if self.free_diameter:
            mean, sigma = DIAMETER_PRIOR
            rows = self.parameters.rows("diameter", contacts)
            off = mean - parameters[:, rows]
            chi2 = chi2 + (off**2).sum(1) / sigma**2
            gradient[:, rows] += off / sigma**2
            k = np.arange(rows.start, rows.stop)
            information[:, k, k] += 1 / sigma**2
        return _Fit(parameters, found.readings, found.jacobian, chi2, gradient, information)

    def _fitted(
        self,
        y: Any,
        weight: Any,
        start: Any,
        contacts: int,
        correction: Correction | None,
        pull: bool,
    ) -> _Fit:
        """Fit frames, a few together: what they need fits in the cache."""
        parts = []
        for begin in range(0, len(y), _CHUNK):
            rows = slice(begin, begin + _CHUNK)
            part = (y[rows], weight[rows], start[rows])
            parts.append(self._walk(*part, contacts, correction, pull))
        return _Fit(*(np.concatenate(x) for x in zip(*parts, strict=True)))

    def _walk(
        self,
        y: Any,
        weight: Any,
        start: Any,
        contacts: int,
        correction: Correction | None,
        pull: bool,
    ) -> _Fit:
        low, high = self.bounds(start, contacts, pull)
        best = self._judged(y, weight, np.clip(start, low, high), contacts, correction)
        damping = np.full(len(y), _DAMPING)
        live = np.arange(len(y))
        for _ in range(_STEPS):
            old = best.rows(live)
            step, decrease = _step(old, low[live], high[live], damping[live])
            there = old.parameters + step
            lowest, highest = self.bounds(there, contacts, pull)
            there = np.clip(there, lowest, highest)
            new = self._judged(y[live], weight[live], there, contacts, correction)
            better = new.chi2 <= old.chi2
            bounds = (low, lowest), (high, highest)
            for whole, part in (*zip(best, new, strict=True), *bounds):
                whole[live[better]] = part[better]
            damping[live] = np.where(
                better, damping[live] / 10, np.maximum(10 * damping[live], 0.1)
            )
            ended = better & (old.chi2 - new.chi2 < _SETTLED) & (decrease < 100 * _SETTLED)
            live = live[~ended & (damping[live] < _GIVEN_UP)]
            if not live.size:
                break
        return best

    # --- several contacts -------------------------------------------------------------

    def _refined(self, y: Any, weight: Any, start: Any, contacts: int) -> tuple[_Fit, float]:
        """Fit one frame by several contacts or free directions, solving them on the way."""
        kept, gap = self._kept.get(contacts), 1.0
        # A coarse start is near enough to try what is known.
        close = self._near(kept, start[0], contacts, live=True)
        fit = self._fitted(y, weight, start, contacts, kept if close else None, False)
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
            fit = self._fitted(y, weight, now[None], contacts, found, False)
            moved = fit.parameters[0] - now
            if moved @ fit.information[0] @ moved < _MOVED**2:
                break
        return fit, gap

    def _near(self, kept: Correction | None, now: Any, contacts: int, *, live: bool) -> bool:
        return kept is not None and near(kept, now, contacts, self._radius, live=live)

    def _gap_sign(self, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
        """Below zero where a contact is beyond the force of first contact."""
        angle, axial, force = parameters[:, :3].T  # of single contacts
        return self._gap * (1 - force / self.table.first_contact_at(angle, axial))

    def _gathered(
        self, fit: _Fit, weight: Any, contacts: int, gaps: NDArray[np.float64]
    ) -> Explanations:
        frames, wide = len(fit.chi2), self._width
        low, high = self.bounds(fit.parameters, contacts, False)
        low = np.where(fit.parameters < low, -np.inf, low)
        _, decrease = _step(fit, low, high, np.zeros(frames))
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


def _step(
    fit: _Fit, low: Any, high: Any, damping: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Damped Gauss-Newton step [frame, parameter] and the decrease of chi2 it predicts."""
    tiny = 1e-12 * (1 + np.abs(fit.parameters))
    stuck = ((fit.parameters <= low + tiny) & (fit.gradient < 0)) | (
        (fit.parameters >= high - tiny) & (fit.gradient > 0)
    )
    gradient = np.where(stuck, 0.0, fit.gradient)
    diagonal = np.diagonal(fit.information, axis1=1, axis2=2)
    scale = np.sqrt(np.where(stuck | (diagonal <= 0), 1.0, diagonal))
    free = ~(stuck[:, :, None] | stuck[:, None])
    matrix = np.where(free, fit.information, 0.0) / (scale[:, :, None] * scale[:, None])
    k = np.arange(matrix.shape[-1])
    matrix[:, k, k] = 1.0 + damping[:, None] + 1e-10
    solution = np.linalg.solve(matrix, (gradient / scale)[..., None])[..., 0]
    decrease = (solution * gradient / scale).sum(1)
    return solution / scale, decrease
