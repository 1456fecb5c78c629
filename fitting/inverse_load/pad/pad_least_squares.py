"""Weighted least squares on the interpolant of a pad's tables, in all frames at once.

Levenberg-Marquardt inside bounds: contacts lie on the pad, press no harder than the tables
reach, and have diameters of the tables; a diameter that is estimated has a normal prior beside.
"""

from typing import Any, NamedTuple

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.fit.damped_step import (
    FIRST_DAMPING,
    GIVEN_UP,
    Descent,
    damped_step,
    next_damping,
)
from fitting.inverse_load.pad.interpolant import LEAST, MOST, Correction, PadInterpolant

DIAMETER_PRIOR = (6e-3, 3e-3)
"""Mean and standard deviation of a contact's diameter where it is estimated [m]."""
# Largest turn and tilt of a force from the radial where directions are free [rad].
_MOST_TURN = np.pi / 3
_STEPS = 100
_SETTLED = 1e-4  # decrease of chi2 below which a fit has ended
_CHUNK = 64  # frames whose coefficients are gathered together
_RIDGE = 1e-10


class PadFit(NamedTuple):
    """A fit, frame by frame.

    Attributes:
        parameters: [frame, parameter].
        readings: of the interpolant there [frame, channel].
        jacobian: their derivatives [frame, parameter, channel].
        chi2: weighted squares of the residuals, priors included [frame].
        gradient: of minus half of it [frame, parameter].
        information: J^T W J, priors included [frame, parameter, parameter].
    """

    parameters: Floats
    readings: Floats
    jacobian: Floats
    chi2: Floats
    gradient: Floats
    information: Floats

    def rows(self, index: Any) -> "PadFit":
        """Those of some frames."""
        return PadFit(*(x[index] for x in self))


class PadLeastSquares:
    """Least squares for contacts on one pad, on its interpolant alone.

    Args:
        interpolant: of its tables.
        edge: largest angle [rad] and axial position [m] of a contact.
    """

    def __init__(self, interpolant: PadInterpolant, edge: tuple[float, float]) -> None:
        self._interpolant, self._edge = interpolant, edge
        self._parameters = interpolant.parameters
        self._free_diameter = "diameter" in self._parameters.names
        self._diameters = interpolant.tables[0].diameter, interpolant.tables[-1].diameter

    def bounds(self, parameters: Floats, contacts: int, pull: bool) -> tuple[Floats, Floats]:
        """Lower and upper bounds [frame, parameter]; those of forces depend on places.

        Args:
            parameters: where they are wanted [frame, parameter].
            contacts: their number.
            pull: whether forces pull outwards.
        """
        frames = len(parameters)
        angle, axial = (
            np.clip(parameters[:, self._parameters.rows(name, contacts)], -edge, edge)
            for name, edge in zip(("angle", "axial"), self._edge, strict=True)
        )
        cap = self._interpolant.largest(angle.reshape(-1), axial.reshape(-1))
        cap = cap.reshape(frames, contacts)
        ones = np.ones((frames, contacts))
        force = (LEAST * cap, 0 * cap) if pull else (0 * cap, MOST * cap)
        low = [-self._edge[0] * ones, -self._edge[1] * ones, force[0]]
        high = [self._edge[0] * ones, self._edge[1] * ones, force[1]]
        if self._free_diameter:
            low.append(self._diameters[0] * ones)
            high.append(self._diameters[1] * ones)
        if self._interpolant.direction:
            low += [-_MOST_TURN * ones] * 2
            high += [_MOST_TURN * ones] * 2
        return np.concatenate(low, 1), np.concatenate(high, 1)

    def prior_volume(self) -> float:
        """Of one contact's parameters: even, but normal in the diameter."""
        force = MOST * float(self._interpolant.tables[0].cap.mean())
        size = 4 * self._edge[0] * self._edge[1] * force
        if self._free_diameter:
            size *= np.sqrt(2 * np.pi) * DIAMETER_PRIOR[1]
        if self._interpolant.direction:
            size *= (2 * _MOST_TURN) ** 2
        return float(size)

    def chi2(
        self,
        y: Floats,
        weight: Floats,
        parameters: Floats,
        contacts: int,
        correction: Correction | None,
    ) -> Floats:
        """Weighted squares of the residuals, and of the diameters' from their prior [frame].

        Args:
            y: readings [frame, channel].
            weight: inverse variances [frame, channel].
            parameters: [frame, parameter].
            contacts: their number.
            correction: of the interpolant.
        """
        return self._judged(y, weight, parameters, contacts, correction).chi2

    def _judged(
        self, y: Any, weight: Any, parameters: Any, contacts: int, correction: Correction | None
    ) -> PadFit:
        found = self._interpolant(parameters, contacts, correction)
        used = weight > 0
        residual = np.where(used, y - found.readings, 0.0)
        weighted = found.jacobian * weight[:, None]
        chi2 = (weight * residual**2).sum(1)
        gradient = (weighted @ residual[..., None])[..., 0]
        information = weighted @ np.swapaxes(found.jacobian, 1, 2)
        if self._free_diameter:
            mean, sigma = DIAMETER_PRIOR
            rows = self._parameters.rows("diameter", contacts)
            off = mean - parameters[:, rows]
            chi2 = chi2 + (off**2).sum(1) / sigma**2
            gradient[:, rows] += off / sigma**2
            k = np.arange(rows.start, rows.stop)
            information[:, k, k] += 1 / sigma**2
        return PadFit(parameters, found.readings, found.jacobian, chi2, gradient, information)

    def fitted(
        self,
        y: Any,
        weight: Any,
        start: Any,
        contacts: int,
        correction: Correction | None,
        pull: bool,
    ) -> PadFit:
        """Fit frames, a few together: what they need fits in the cache.

        Args:
            y: readings [frame, channel].
            weight: inverse variances [frame, channel].
            start: parameters [frame, parameter].
            contacts: their number.
            correction: of the interpolant.
            pull: whether forces pull outwards.
        """
        parts = []
        for begin in range(0, len(y), _CHUNK):
            rows = slice(begin, begin + _CHUNK)
            part = (y[rows], weight[rows], start[rows])
            parts.append(self._walk(*part, contacts, correction, pull))
        return PadFit(*(np.concatenate(x) for x in zip(*parts, strict=True)))

    def _walk(
        self,
        y: Any,
        weight: Any,
        start: Any,
        contacts: int,
        correction: Correction | None,
        pull: bool,
    ) -> PadFit:
        low, high = self.bounds(start, contacts, pull)
        best = self._judged(y, weight, np.clip(start, low, high), contacts, correction)
        damping = np.full(len(y), FIRST_DAMPING)
        live = np.arange(len(y))
        for _ in range(_STEPS):
            old = best.rows(live)
            step, decrease = step_of(old, low[live], high[live], damping[live])
            there = old.parameters + step
            lowest, highest = self.bounds(there, contacts, pull)
            there = np.clip(there, lowest, highest)
            new = self._judged(y[live], weight[live], there, contacts, correction)
            better = new.chi2 <= old.chi2
            bounds = (low, lowest), (high, highest)
            for whole, part in (*zip(best, new, strict=True), *bounds):
                whole[live[better]] = part[better]
            damping[live] = next_damping(damping[live], better)
            ended = better & (old.chi2 - new.chi2 < _SETTLED) & (decrease < 100 * _SETTLED)
            live = live[~ended & (damping[live] < GIVEN_UP)]
            if not live.size:
                break
        return best


def step_of(fit: PadFit, low: Any, high: Any, damping: Floats) -> tuple[Floats, Floats]:
    """Damped Gauss-Newton step [frame, parameter] and the decrease of chi2 it predicts.

    Args:
        fit: where it begins.
        low: lower bounds [frame, parameter].
        high: upper bounds, likewise.
        damping: of the step [frame].
    """
    information = fit.information.transpose(1, 2, 0)
    here = Descent(fit.parameters.T, fit.gradient.T, information, low.T, high.T)
    step, decrease = damped_step(here, damping, _solved, ridge=_RIDGE)
    return step.T, decrease


def _solved(matrix: Floats, right: Floats) -> Floats:
    """Solutions [n, frame] of matrices [n, n, frame]."""
    found = np.linalg.solve(matrix.transpose(2, 0, 1), right.T[..., None])
    return np.asarray(found[..., 0].T, float)
