"""Directions of contacts on a section that a fit holds radial: what friction may do to them.

The tangential force of a contact is tau of the inward one. One contact in four is radial, one
turned a little, two are inclined: tau is normal around zero with a deviation of 0, `_LITTLE` or
PRIOR_OF_TANGENT. With s what tau does to readings, s' what place and force leave of it, G what
it does to them and r the residuals of radial contacts (`systematic`), to first order::

    P_k = (1 / sigma_k^2 + s'^T W s')^-1,  tau_k = P_k s'^T W r
    w_k ~ odds_k (P_k / sigma_k^2)^1/2 exp(tau_k^2 / (2 P_k))
    tau = sum_k w_k tau_k,     dx = -G tau,
    <dtau^2> = sum_k w_k (P_k + tau_k^2) - tau^2

So readings that would show friction and do not leave place and force as they are. Where radial
contacts leave more than noise, tau would be what the model lacks: nothing moves then, and all
of the widest prior is counted.
"""

import numpy as np

from fitting.arrays import Flags, Floats
from fitting.inverse_load.fit.explanation import PRIOR_OF_TANGENT, TOLD, Explanations
from fitting.inverse_load.fit.loads_and_errors import SUSPECT
from fitting.inverse_load.fit.systematic import AbstractSystematicErrors, no_covariance
from fitting.inverse_load.fit.tabulated_changes import TabulatedChanges
from fitting.inverse_load.search.table import LoadTable

_RADIAL = 2  # parameters of a contact: angle and force
_LITTLE = 0.05  # tangential force over the inward one of a contact that is nearly radial
# Deviations of tau, and how often a contact has one for each that is radial.
_PRIORS = ((_LITTLE, 1.0), (PRIOR_OF_TANGENT, 2.0))
_RARE = 0.05  # probability of radial contacts below which tangential forces are told


class HeldDirections(AbstractSystematicErrors):
    """Tangential forces of contacts that were fitted as radial, an error for each contact."""

    def __init__(self, table: LoadTable, edge: float) -> None:
        self._changes = TabulatedChanges.of(table, table.slopes[:, :, 2:])
        self._edge = edge  # largest angle of a contact [rad]

    def slopes(self, best: Explanations, per_contact: int, contacts: int) -> Floats:
        """See the base class; of one inward force each."""
        x, held = best.parameters, best.held
        rows = [
            self._changes.under(x[:, k], x[:, contacts + k], held[:, [k, contacts + k]])[:, 0]
            for k in range(contacts)
        ]
        return np.stack(rows, 1)

    def averaged(
        self, best: Explanations, y: Floats, *, still: bool
    ) -> tuple[Explanations, Floats]:
        """Explanations of readings [frame, taxel] by contacts that may be inclined.

        Second are the covariances of their parameters by that, padded as the information is.
        Where the skin is not `still`, residuals are motion and say nothing of friction.
        """
        best = best.rows(np.arange(len(best)))
        total = no_covariance(best, _RADIAL)
        # Others were free in the fit, or there is none.
        radial_fits = np.isfinite(best.chi2) & ~np.isfinite(best.beside[:, 0, -1, 1])
        for count in np.unique(best.contacts[radial_fits]).tolist():
            frames, width = (
                np.flatnonzero(radial_fits & (best.contacts == count)),
                _RADIAL * count,
            )
            own = best.rows(frames)
            found = self.of(own, y[frames] - own.so, _RADIAL)
            settled = own.p_value(_RADIAL) >= SUSPECT
            settled &= (np.abs(own.parameters[:, :count]) < self._edge).all(1)
            mean, spread, radial = _mean(found.left, found.pull * still, settled)
            gain = found.gain
            total[frames, :width, :width] = gain @ spread @ np.swapaxes(gain, 1, 2)
            moved = own.parameters[:, :width] - (gain @ mean[..., None])[..., 0]
            moved[:, :count] = np.clip(moved[:, :count], -self._edge, self._edge)
            best.parameters[frames, :width] = moved
            taken = np.swapaxes(gain, 1, 2) @ np.nan_to_num(own.held[:, :width])
            left = found.slopes - taken
            best.so[frames] += (mean[:, None] @ left)[:, 0]
            force, deviation = moved[:, count:], np.sqrt(np.diagonal(spread, 0, 1, 2))
            told = (radial < _RARE)[:, None] & (deviation < TOLD * PRIOR_OF_TANGENT)
            shown = np.where(told, force * mean, np.nan)
            best.beside[frames, :count, -1] = np.stack([shown, np.abs(force) * deviation], -1)
        return best, total

    def of_mode(self, mode: Explanations) -> list[tuple[Floats, float]]:
        """What log(likelihood) of contacts that are not radial is above that of radial ones.

        With r residuals and W their inverse variances it is |E W r|^2 / 2 - h. Returns, prior
        by prior, E [contact, taxel], to first order that at the mode, and h, odds included.
        """
        count = int(mode.contacts[0])
        slopes = np.where(mode.weight > 0, self.slopes(mode, _RADIAL, count)[0], 0.0)
        found = []
        for prior, odds in _PRIORS:
            own = prior * slopes
            root = np.linalg.cholesky(np.eye(count) + (own * mode.weight) @ own.T)
            rare = np.log(np.diag(root)).sum() - np.log(odds)
            found.append((np.linalg.solve(root, own), float(rare)))
        return found


def _mean(left: Floats, pull: Floats, settled: Flags) -> tuple[Floats, Floats, Floats]:
    """Mean of tau [frame, contact], its covariance, and the probability of radial contacts.

    `left` and `pull` are s'^T W s' [frame, contact, contact] and s'^T W r [frame, contact].
    """
    frames, count = pull.shape
    log, means = [np.zeros(frames)], [np.zeros((frames, count))]
    spreads = [np.zeros_like(left)]
    for prior, odds in _PRIORS:
        spread = np.linalg.inv(np.eye(count) / prior**2 + left)
        mean = (spread @ pull[..., None])[..., 0]
        log_det = np.linalg.slogdet(spread / prior**2)[1]
        log.append(np.asarray((log_det + (pull * mean).sum(1)) / 2 + np.log(odds), float))
        means.append(mean)
        spreads.append(np.asarray(spread, float))
    weight = np.exp(np.array(log) - np.max(log, 0))
    weight = np.where(settled, weight / weight.sum(0), np.eye(len(log))[:, -1:])
    means = [np.where(settled[:, None], mean, 0.0) for mean in means]
    total = np.einsum("kf,kfi->fi", weight, means)
    spread = np.einsum("kf,kfij->fij", weight, spreads)
    apart = np.array(means) - total
    return total, spread + np.einsum("kf,kfi,kfj->fij", weight, apart, apart), weight[0]
