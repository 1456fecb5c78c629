"""What presses of a unit showed beyond its model, taken off readings that are estimated.

`[calibration] discrepancy` of a skin file holds presses and the numbers of a process
(`fitting.statistics.discrepancy`). Its mean and its covariance under one contact are tabulated
over the states of the skin's table, per newton, and read between them. Both were learned from
single presses: frames with several contacts are read without them.

What a shift of the contact along the arc explains as well is not taken off: presses do not
tell it from errors of their own places, and a later body may stand differently. Its square
widens the covariance instead.
"""

from typing import TYPE_CHECKING

import numpy as np

from fitting.arrays import Flags, Floats, Rows
from fitting.inverse_load.fit.covariance import inverse
from fitting.inverse_load.fit.explanation import Alternative, Explanations
from fitting.inverse_load.fit.loads_and_errors import SUSPECT
from fitting.inverse_load.fit.section_least_squares import SETTLED
from fitting.inverse_load.fit.selection import Selection
from fitting.inverse_load.fit.systematic import no_covariance
from fitting.statistics.discrepancy import Discrepancy, Numbers, Presses
from suas_jax.config import SkinSpec

if TYPE_CHECKING:
    from fitting.inverse_load.search.table import LoadTable

_ANGLES, _LEVELS = 46, 13  # of the table that is kept


class ReadingDiscrepancy:
    """The discrepancy of one skin's readings under one radial contact."""

    def __init__(self, found: Discrepancy, table: "LoadTable") -> None:
        angles, levels = (
            np.linspace(0, size - 1, min(size, count)).round().astype(int)
            for size, count in zip(table.forces.shape, (_ANGLES, _LEVELS), strict=True)
        )
        self._angles = table.angles[angles]
        # Levels of force are the same shares of the largest at all angles.
        self._lowest = np.log(table.forces[angles, 0])
        self._levels = np.log(table.forces[0, levels] / table.forces[0, 0])
        force = table.forces[np.ix_(angles, levels)]
        change = np.nan_to_num((table.so - table.rest)[np.ix_(angles, levels)])
        # One angle after another: all at once would take gigabytes where there are many taxels.
        rows = zip(self._angles, force, change, strict=True)
        told = [found.at(np.full(len(levels), angle), f, so) for angle, f, so in rows]
        mean, covariance = (np.stack(x) for x in zip(*told, strict=True))
        slopes = _by_load(table)[np.ix_(angles, levels)]
        noise = np.nanmedian(found.presses.noise) ** 2
        weight = 1 / (noise + np.diagonal(covariance, axis1=2, axis2=3))
        moved = slopes[..., :1, :] * _loads_by(mean, slopes, weight)[..., :1, None]
        mean = mean - moved[..., 0, :]
        covariance = covariance + np.swapaxes(moved, 2, 3) * moved
        self._mean = mean / force[..., None]
        self._covariance = covariance / force[..., None, None] ** 2

    @classmethod
    def of(
        cls, spec: SkinSpec, table: "LoadTable", taxels: Floats
    ) -> "ReadingDiscrepancy | None":
        """That of a skin file; None where it has none. `taxels`: their angles [taxel] [rad].

        Raises ValueError: it was learned on other taxels, or its numbers are of no process.
        """
        record = None if spec.calibration is None else spec.calibration.discrepancy
        if record is None:
            return None
        rows = (record.changes, record.left, record.noise, record.places, record.pushes)
        told = Presses(*(np.array(x, float) for x in (record.angles, record.forces, *rows)))
        if told.left.shape[1] != len(taxels):
            raise ValueError(
                f"[calibration] discrepancy: {told.left.shape[1]} numbers a press for the "
                f"skin's {len(taxels)} taxels; fit the sensor again"
            )
        numbers = Numbers(**{key: getattr(record, key) for key in Numbers._fields})
        try:
            return cls(Discrepancy(told, numbers, taxels), table)
        except np.linalg.LinAlgError:
            raise ValueError(
                "[calibration] discrepancy: its numbers have no covariance that can be "
                "inverted; fit the sensor again"
            ) from None

    def under(self, angle: Floats, force: Floats) -> tuple[Floats, Floats]:
        """Mean [frame, taxel] and covariance [frame, taxel, taxel] under contacts.

        They have angles [frame, rad] and forces [frame, N].
        """
        size = np.abs(force)
        last, top = len(self._angles) - 1, len(self._levels) - 1
        place = np.interp(angle, self._angles, np.arange(last + 1))
        low = np.minimum(place.astype(int), last - 1)
        mean = np.zeros((len(angle), self._mean.shape[-1]))
        covariance = np.zeros((*mean.shape, mean.shape[1]))
        log = np.log(np.maximum(size, 1e-12))
        for i, share in ((low, low + 1 - place), (low + 1, place - low)):
            level = np.interp(log - self._lowest[i], self._levels, np.arange(top + 1))
            k = np.minimum(level.astype(int), top - 1)
            for own, part in ((k, share * (k + 1 - level)), (k + 1, share * (level - k))):
                mean += part[:, None] * self._mean[i, own]
                covariance += part[:, None, None] * self._covariance[i, own]
        return mean * force[:, None], covariance * size[:, None, None] ** 2

    def taken_off(
        self, selection: Selection, y: Floats, weight: Floats
    ) -> tuple[Floats, Floats, Floats, Explanations, Flags]:
        """Readings without it, inverse variances, and the covariance of what is left.

        Readings and weights are [frame, taxel], the covariance [frame, taxel, taxel]. Frames
        that one contact does not explain stay as they are. Last are explanations by one
        contact, and which of them [frame] are those of the frames as returned.
        """
        nodes, per_contact = selection.nodes, selection.fitter.per_contact
        near = nodes.near(y, weight, nodes.nearest(y, weight)[0])
        best, others = selection.of_one.explain(*self._without(y, weight, near)[:2])
        one = best.p_value(per_contact) >= SUSPECT
        own, weights, left = self._without(
            y, weight, np.where(one[:, None], best.parameters[:, :2], near)
        )
        readings, weights = (
            np.where(one[:, None], *pair) for pair in ((own, y), (weights, weight))
        )
        plain = one & (best.parameters[:, 1] > 0) & ~best.absorbed
        plain &= ~best.eliminated.any((1, 2)) & (best.used() == (weight > 0).sum(1))
        plain &= np.array([other is None for other in others])
        best, settled = _stepped(best, readings, weights, np.flatnonzero(plain), per_contact)
        return readings, weights, left * one[:, None, None], best, settled

    def explain(
        self, selection: Selection, y: Floats, weight: Floats
    ) -> tuple[Floats, Floats, Floats, Explanations, list[Alternative | None]]:
        """The same, with the best explanations and their second modes.

        Most frames of one contact are explained already, to a last step.
        """
        y, weight, left, best, settled = self.taken_off(selection, y, weight)
        if selection.fitter.live:
            return y, weight, left, *selection.explain(y, weight)
        others: list[Alternative | None] = [None] * len(y)
        again = np.flatnonzero(~settled | selection.doubts.of(y, best))
        seconds = np.zeros(len(y))
        if again.size:
            found, second = selection.explain(y[again], weight[again])
            best = best.with_frames(again, found, np.arange(len(again)))
            for i, other in zip(again.tolist(), second, strict=True):
                others[i] = other
            seconds[again] = selection.seconds
        selection.seconds = seconds
        return y, weight, left, best, others

    def _without(
        self, y: Floats, weight: Floats, loads: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """The same under known contacts, angle and force [frame, 2]."""
        mean, covariance = self.under(*loads.T)
        own = np.diagonal(covariance, axis1=1, axis2=2)
        return y - mean, weight / (1 + weight * own), covariance

    def of_loads(self, best: Explanations, left: Floats, per_contact: int) -> Floats:
        """Covariances of the parameters, beside those of noise, padded as the information is.

        The weights of the explanations have the variances of what is left; with its covariance
        C [frame, taxel, taxel] and G = (J^T W J)^-1 J^T W it is G (C - diag C) G^T.
        """
        total = no_covariance(best, per_contact)
        own = slice(0, per_contact)
        for i in np.flatnonzero(best.contacts == 1):
            jacobian = np.nan_to_num(best.jacobian[i, own]) * best.weight[i]
            gain = inverse(best.information[i : i + 1, own, own])[0] @ jacobian
            apart = left[i] - np.diag(np.diag(left[i]))
            total[i, own, own] = np.nan_to_num(gain @ apart @ gain.T)
        return total


def _by_load(table: "LoadTable") -> Floats:
    """Derivatives of readings by angle and force of a contact [angle, level, 2, taxel]."""
    change = np.nan_to_num(table.so - table.rest)
    by_force = np.gradient(change, axis=1) / np.gradient(table.forces, axis=1)[..., None]
    # A level is of another force at the next angle.
    along = np.gradient(table.forces, table.angles, axis=0)[..., None]
    by_angle = np.gradient(change, table.angles, axis=0) - along * by_force
    return np.stack([by_angle, by_force], 2)


def _loads_by(change: Floats, slopes: Floats, weight: Floats) -> Floats:
    """What angle and force change by with readings, by least squares [..., 2]."""
    weighted = slopes * weight[..., None, :]
    told = np.linalg.pinv(weighted @ np.swapaxes(slopes, -1, -2), hermitian=True)
    return np.asarray((told @ weighted @ change[..., None])[..., 0])


def _stepped(
    best: Explanations, y: Floats, weight: Floats, frames: Rows, per_contact: int
) -> tuple[Explanations, Flags]:
    """Explanations of other readings by the last step of a fit, where it is one [frame]."""
    settled, own = np.zeros(len(best), bool), slice(0, per_contact)
    jacobian = np.nan_to_num(best.jacobian[frames, own])
    weighted = jacobian * weight[frames, None]
    residual = np.where(weight > 0, y - best.so, 0.0)[frames]
    information = weighted @ jacobian.swapaxes(1, 2)
    gradient = np.einsum("fpt,ft->fp", weighted, residual)
    step = np.einsum("fpq,fq->fp", inverse(information), gradient)
    change = np.einsum("fp,fpt->ft", step, jacobian)
    told = best.rows(frames)  # copies
    told.parameters[:, own] += step
    told.information[:, own, own] = information
    told.chi2[:] = told.score[:] = (weight[frames] * (residual - change) ** 2).sum(1)
    told.so[:] += change
    told.weight[:] = weight[frames]
    settled[frames] = (step * gradient).sum(1) < SETTLED
    return best.with_frames(frames, told, np.arange(len(frames))), settled
