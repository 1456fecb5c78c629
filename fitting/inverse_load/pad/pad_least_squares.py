"""Weighted least squares on the interpolant of a pad's tables, in all frames at once.

Levenberg-Marquardt inside bounds: contacts lie on the pad and press no harder than the table
reaches. What readings hardly show has a prior, whose residuals count as those of readings: a
contact's diameter is log-normal around the table's, its slenderness and the tangential
components of its force over the inward one are normal around zero.
"""

from typing import Any, NamedTuple

import numpy as np

from fitting.arrays import Floats, Rows
from fitting.inverse_load.fit.damped_step import (
    FIRST_DAMPING,
    GIVEN_UP,
    Descent,
    damped_step,
    next_damping,
)
from fitting.inverse_load.fit.explanation import PRIOR_OF_TANGENT
from fitting.inverse_load.pad.interpolant import (
    ASKEW,
    LEAST,
    MOST,
    PLAIN,
    WHOLE,
    Correction,
    PadInterpolant,
)
from fitting.steps import Steps

PRIOR = np.array([0.6, 0.5, PRIOR_OF_TANGENT, PRIOR_OF_TANGENT])
"""Standard deviations of a contact's ln d, slenderness and tangents (see `interpolant`)."""
_FREE = 3.0  # of tangents that are asked for
_DIAMETERS = (0.3, 15.0)  # smallest and largest, in terms of the table's
_SLENDER, _LEAST_SLENDER = 1.5, 0.1  # the least of one that lies askew
_MOST_TANGENT = np.tan(np.pi / 3)
STEPS = 100
"""Most steps of a fit."""
# Decrease of chi2 below which a fit has ended, its last step taken on the readings' slopes;
# extents are hardly told to more.
_SETTLED, _SETTLED_WHOLE = 1e-3, 1e-1
_CHUNK = 64  # frames whose coefficients are gathered together
_RIDGE = 1e-10


class PadFit(NamedTuple):
    """A fit, frame by frame."""

    parameters: Floats  # [frame, parameter]
    readings: Floats  # of the interpolant there [frame, channel]
    jacobian: Floats  # their derivatives [frame, parameter, channel]
    chi2: Floats  # weighted squares of the residuals, priors included [frame]
    gradient: Floats  # of minus half of it [frame, parameter]
    information: Floats  # J^T W J, priors included [frame, parameter, parameter]

    def rows(self, index: Any) -> "PadFit":
        """Those of some frames."""
        return PadFit(*(x[index] for x in self))


class PadLeastSquares:
    """Least squares for contacts on one pad, on its interpolant alone.

    The interpolant is that of the pad's table. The edge is the largest angle [rad] and axial
    position [m] of a contact. `direction` says whether nothing is known of directions before.
    """

    def __init__(
        self, interpolant: PadInterpolant, edge: Floats, *, direction: bool = False
    ) -> None:
        self._interpolant, self._edge = interpolant, edge
        self._diameter = interpolant.table.diameter
        self._least_cap = float(interpolant.table.cap.min())
        self.prior = np.append(PRIOR[:2], [_FREE, _FREE]) if direction else PRIOR

    def bounds(self, parameters: Floats, contacts: int, pull: bool) -> tuple[Floats, Floats]:
        """Lower and upper bounds [frame, parameter]; those of forces depend on places.

        Forces that are small enough anywhere on the pad are only told so.

        They are wanted at the parameters [frame, parameter]; `pull` says whether forces pull
        outwards.
        """
        ones = np.ones((len(parameters), contacts))
        cap = self._least_cap * ones
        if pull or (parameters[:, 2 * contacts : 3 * contacts] > MOST * cap).any():
            cap = self._cap(parameters, contacts)
        force = (LEAST * cap, 0 * cap) if pull else (0 * cap, MOST * cap)
        low = [-self._edge[0] * ones, -self._edge[1] * ones, force[0]]
        high = [self._edge[0] * ones, self._edge[1] * ones, force[1]]
        if parameters.shape[1] > PLAIN * contacts:
            smallest, largest = (x * self._diameter for x in _DIAMETERS)
            low += [x * ones for x in (smallest, -_SLENDER, -_MOST_TANGENT, -_MOST_TANGENT)]
            high += [x * ones for x in (largest, _SLENDER, _MOST_TANGENT, _MOST_TANGENT)]
        if parameters.shape[1] == ASKEW * contacts:
            low[4] = _LEAST_SLENDER * ones
            low.append(-np.pi * ones)
            high.append(np.pi * ones)
        return np.concatenate(low, 1), np.concatenate(high, 1)

    def _cap(self, parameters: Floats, contacts: int) -> Floats:
        """Largest forces of contacts by their places and extents [frame, contact] [N]."""
        angle, axial = (
            np.clip(parameters[:, k * contacts : (k + 1) * contacts], -edge, edge)
            for k, edge in enumerate(self._edge)
        )
        cap = self._interpolant.largest(angle.reshape(-1), axial.reshape(-1))
        cap = cap.reshape(len(parameters), contacts)
        if parameters.shape[1] > PLAIN * contacts:
            shape = parameters.copy()
            slender = slice(4 * contacts, 5 * contacts)  # a step may end far beyond its bounds
            shape[:, slender] = np.clip(shape[:, slender], -_SLENDER, _SLENDER)
            cap = cap * self._interpolant.reliefs(shape, contacts)
        return np.asarray(cap)

    def completed(self, plain: Floats, contacts: int) -> Floats:
        """Parameters of discs under radial forces, with what a prior expects of the others."""
        expected = np.repeat([self._diameter, 0.0, 0.0, 0.0], contacts)
        return np.concatenate([plain, np.tile(expected, (len(plain), 1))], 1)

    def profiled(
        self,
        y: Floats,  # readings [frame, channel]
        weight: Floats,  # inverse variances [frame, channel]
        parameters: Floats,  # [frame, parameter]
        contacts: int,
        correction: Correction | None,  # of the interpolant
        free: Rows,  # parameters that are free
    ) -> Floats:
        """Weighted squares of residuals, least over some parameters to first order [frame]."""
        found = self.judged(y, weight, parameters, contacts, correction)
        gradient = found.gradient[:, free, None]
        step = np.linalg.solve(found.information[:, free[:, None], free], gradient)
        return np.asarray(found.chi2 - (gradient * step).sum((1, 2)))

    def judged(
        self,
        y: Any,
        weight: Any,
        parameters: Any,
        contacts: int,
        correction: Correction | None = None,
    ) -> PadFit:
        """What parameters leave of readings, and where it leads; see `steps`."""
        found = self._interpolant(parameters, contacts, correction)
        used = weight > 0
        residual = np.where(used, y - found.readings, 0.0)
        weighted = found.jacobian * weight[:, None]
        chi2 = (weight * residual**2).sum(1)
        gradient = (weighted @ residual[..., None])[..., 0]
        information = weighted @ np.swapaxes(found.jacobian, 1, 2)
        if parameters.shape[1] > PLAIN * contacts:
            first, last = PLAIN * contacts, WHOLE * contacts
            value = parameters[:, first:last].copy()
            slope = np.ones_like(value)
            slope[:, :contacts] = 1 / value[:, :contacts]
            value[:, :contacts] = np.log(value[:, :contacts] / self._diameter)
            sigma = np.repeat(self.prior, contacts)
            chi2 = chi2 + ((value / sigma) ** 2).sum(1)
            gradient[:, first:last] -= slope * value / sigma**2
            k = np.arange(first, last)
            information[:, k, k] += (slope / sigma) ** 2
        return PadFit(parameters, found.readings, found.jacobian, chi2, gradient, information)

    def steps(
        self,
        y: Any,  # readings [frame, channel]
        weight: Any,  # inverse variances [frame, channel]
        start: Any,  # [frame, parameter]: PLAIN, WHOLE or ASKEW a contact, all of them fitted
        contacts: int,
        correction: Correction | None,  # of the interpolant
        pull: bool,  # whether forces pull outwards
        *,
        most: int = STEPS,  # steps of a frame, which may be too few to settle
    ) -> Steps[PadFit]:
        """Fit frames; a few together: what they need fits in the cache."""
        if len(y) > _CHUNK:
            how, parts = (contacts, correction, pull), []
            for begin in range(0, len(y), _CHUNK):
                rows = slice(begin, begin + _CHUNK)
                own = y[rows], weight[rows], start[rows]
                parts.append((yield from self.steps(*own, *how, most=most)))
            return PadFit(*(np.concatenate(x) for x in zip(*parts, strict=True)))
        name = f"step of {contacts} in {len(y)}"
        yield name
        low, high = self.bounds(start, contacts, pull)
        best = self.judged(y, weight, np.clip(start, low, high), contacts, correction)
        damping = np.full(len(y), FIRST_DAMPING)
        live = np.arange(len(y))
        settled = _SETTLED if start.shape[1] == PLAIN * contacts else _SETTLED_WHOLE
        for _ in range(most):
            yield name
            old = best.rows(live)
            step, decrease = step_of(old, low[live], high[live], damping[live])
            # A damped step promises little wherever it begins.
            going = (decrease > settled) | (damping[live] > FIRST_DAMPING)
            if not going.all():
                _moved(best, live[~going], step[~going], low, high)
                live, step, decrease = live[going], step[going], decrease[going]
                old = best.rows(live)
            if not live.size:
                break
            there = old.parameters + step
            lowest, highest = self.bounds(there, contacts, pull)
            there = np.clip(there, lowest, highest)
            new = self.judged(y[live], weight[live], there, contacts, correction)
            better = new.chi2 <= old.chi2
            bounds = (low, lowest), (high, highest)
            for whole, part in (*zip(best, new, strict=True), *bounds):
                whole[live[better]] = part[better]
            damping[live] = next_damping(damping[live], better)
            ended = better & (old.chi2 - new.chi2 < settled / 10) & (decrease < settled)
            live = live[~ended & (damping[live] < GIVEN_UP)]
        return best


def _moved(best: PadFit, rows: Rows, step: Floats, low: Floats, high: Floats) -> None:
    """Take steps of some frames on the readings' slopes, which hold over so little a way."""
    inside = np.clip(best.parameters[rows] + step, low[rows], high[rows])
    step = (inside - best.parameters[rows])[..., None]
    changed = best.information[rows] @ step
    gain = (step * (2 * best.gradient[rows][..., None] - changed)).sum((1, 2))
    best.parameters[rows] = inside
    best.readings[rows] += (step * best.jacobian[rows]).sum(1)
    best.gradient[rows] -= changed[..., 0]
    best.chi2[rows] -= gain


def step_of(fit: PadFit, low: Any, high: Any, damping: Floats) -> tuple[Floats, Floats]:
    """Damped Gauss-Newton step [frame, parameter] and the decrease of chi2 it predicts.

    The step begins where the fit is, between lower and upper bounds [frame, parameter], with
    the damping [frame].
    """
    information = fit.information.transpose(1, 2, 0)
    here = Descent(fit.parameters.T, fit.gradient.T, information, low.T, high.T)
    step, decrease = damped_step(here, damping, _solved, ridge=_RIDGE)
    return step.T, decrease


def _solved(matrix: Floats, right: Floats) -> Floats:
    """Solutions [n, frame] of matrices [n, n, frame]."""
    found = np.linalg.solve(matrix.transpose(2, 0, 1), right.T[..., None])
    return np.asarray(found[..., 0].T, float)
