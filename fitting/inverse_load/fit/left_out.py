"""What a fit of radial lines on a section leaves out of contacts: friction and width.

The tangential force of a contact is tau of the inward one, and it presses an arc of length l.
With even odds it is a radial line, nearly one, or neither: tau and l^2 are normal around zero
with deviations of zero, `_LITTLE` or `_USUAL`. With s what they do to readings, s' what
place and force leave of it, G what it does to them and r the residuals of lines (`systematic`),
for u = (tau, l^2) with a prior's variances V_k, to first order::

    P_k = (V_k^-1 + s'^T W s')^-1,  u_k = P_k s'^T W r
    w_k ~ det(P_k V_k^-1)^1/2 exp(u_k^T P_k^-1 u_k / 2)
    u = sum_k w_k u_k,     dx = -G u,
    <du du^T> = sum_k w_k (P_k + u_k u_k^T) - u u^T

What friction of one contact does depends on the others: s' of several comes from the model in
their own equilibrium, that of one from the table. Readings that would show friction or width
and do not leave place and force as they are. Where lines leave more than noise, u would be what
the model lacks: nothing moves then, and all of the widest prior is counted.
"""

import numpy as np

from fitting.arrays import Flags, Floats
from fitting.inverse_load.fit.explanation import PRIOR_OF_TANGENT, TOLD, Explanations
from fitting.inverse_load.fit.loads_and_errors import SUSPECT
from fitting.inverse_load.fit.systematic import AbstractSystematicErrors, no_covariance
from fitting.inverse_load.fit.tabulated_changes import TabulatedChanges
from fitting.inverse_load.model.evaluation import (
    CONTACTS,
    FRAMES,
    filled_up,
    in_batches,
    slopes_beside_program,
)
from fitting.inverse_load.search.table import LoadTable
from suas_jax.equilibrium.state import State
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.skin import Skin

_LINE = 2  # parameters of a contact: angle and force
# Deviations of the tangential force over the inward one and of the square of the arc [m^2].
_LITTLE = (0.05, 5e-3**2)
_USUAL = (PRIOR_OF_TANGENT, 15e-3**2)
_PRIORS = (_LITTLE, _USUAL)
_RARE = 0.05  # probability of radial lines below which tangential forces are told


class LeftOutOfContacts(AbstractSystematicErrors):
    """Friction and width of contacts that were fitted as radial lines."""

    def __init__(self, skin: Skin, table: LoadTable, *, edge: float, live: bool) -> None:
        self._skin, self._lanes = skin, 1 if live else FRAMES
        self._changes = TabulatedChanges.of(table, table.slopes[:, :, _LINE:])
        self._edge = edge  # largest angle of a contact [rad]

    def slopes(self, best: Explanations, per_contact: int, contacts: int) -> Floats:
        """See the base class: by all tangential forces over inward ones, then all squares."""
        if contacts > 1:
            return self._under_several(best.parameters[:, : _LINE * contacts], best.state)
        x = best.parameters
        found = self._changes.under(x[:, 0], x[:, 1], best.held[:, :_LINE])
        # What the fit itself found of a single contact is not left out.
        known = np.isfinite(best.beside[:, 0, [-1, 0], 1])
        return np.where(known[..., None], 0.0, found)

    def _under_several(self, parameters: Floats, state: State) -> Floats:
        """The same under contacts of which each changes what the others' friction does."""
        count = parameters.shape[1] // _LINE

        def run(parameters: Floats, state: State) -> Floats:
            given = self._skin, parameters, state
            return np.asarray(COMPILED.run(slopes_beside_program, *given))

        found = in_batches(run, filled_up(parameters, count), state, self._lanes)
        kept = np.concatenate([np.arange(count), CONTACTS + np.arange(count)])
        return found[:, kept]

    def averaged(
        self, best: Explanations, y: Floats, *, still: bool
    ) -> tuple[Explanations, Floats]:
        """Explanations of readings [frame, taxel] by contacts that may be no radial lines.

        Second are the covariances of their parameters by that, padded as the information is.
        Where the skin is not `still`, residuals are motion and say nothing of them.
        """
        best = best.rows(np.arange(len(best)))
        total = no_covariance(best, _LINE)
        known = np.isfinite(best.chi2)
        for count in np.unique(best.contacts[known]).tolist():
            frames, width = np.flatnonzero(known & (best.contacts == count)), _LINE * count
            own = best.rows(frames)
            found = self.of(own, y[frames] - own.so, _LINE)
            settled = own.p_value(_LINE) >= SUSPECT
            settled &= (np.abs(own.parameters[:, :count]) < self._edge).all(1)
            mean, spread, line = _mean(found.left, found.pull * still, settled)
            gain = found.gain
            total[frames, :width, :width] = gain @ spread @ np.swapaxes(gain, 1, 2)
            moved = own.parameters[:, :width] - (gain @ mean[..., None])[..., 0]
            moved[:, :count] = np.clip(moved[:, :count], -self._edge, self._edge)
            best.parameters[frames, :width] = moved
            taken = np.swapaxes(gain, 1, 2) @ np.nan_to_num(own.held[:, :width])
            left = found.slopes - taken
            best.so[frames] += (mean[:, None] @ left)[:, 0]
            force, tangent = moved[:, count:], slice(count)
            deviation = np.sqrt(np.diagonal(spread, 0, 1, 2))[:, tangent]
            told = (line < _RARE)[:, None] & (deviation < TOLD * PRIOR_OF_TANGENT)
            shown = np.where(told, force * mean[:, tangent], np.nan)
            shown = np.stack([shown, np.abs(force) * deviation], -1)
            fitted = own.beside[:, :count, -1]
            shown = np.where(np.isfinite(fitted[..., 1:]), fitted, shown)
            best.beside[frames, :count, -1] = shown
        return best, total

    def of_mode(self, mode: Explanations) -> list[tuple[Floats, float]]:
        """What log(likelihood) of other contacts is above that of radial lines, at a mode.

        With r residuals and W their inverse variances it is |E W r|^2 / 2 - h. Returns, prior
        by prior, E [quantity, taxel], to first order that at the mode, and h.
        """
        count = int(mode.contacts[0])
        slopes = np.where(mode.weight > 0, self.slopes(mode, _LINE, count)[0], 0.0)
        found = []
        for prior in _PRIORS:
            own = np.repeat(prior, count)[:, None] * slopes
            root = np.linalg.cholesky(np.eye(len(own)) + (own * mode.weight) @ own.T)
            found.append((np.linalg.solve(root, own), float(np.log(np.diag(root)).sum())))
        return found


def _mean(left: Floats, pull: Floats, settled: Flags) -> tuple[Floats, Floats, Floats]:
    """Mean of u [frame, quantity], its covariance, and the probability of radial lines.

    `left` and `pull` are s'^T W s' [frame, quantity, quantity] and s'^T W r [frame, quantity].
    """
    frames, size = pull.shape
    log, means, spreads = [np.zeros(frames)], [np.zeros(pull.shape)], [np.zeros(left.shape)]
    for prior in _PRIORS:
        own = np.repeat(prior, size // len(prior))
        # In terms of the prior's deviations, which differ by their units.
        scaled = np.eye(size) + left * np.outer(own, own)
        spread = np.outer(own, own) * np.linalg.inv(scaled)
        mean = (spread @ pull[..., None])[..., 0]
        rare = np.linalg.slogdet(scaled)[1]
        log.append(np.asarray(((pull * mean).sum(1) - rare) / 2, float))
        means.append(mean)
        spreads.append(np.asarray(spread, float))
    weight = np.exp(np.array(log) - np.max(log, 0))
    weight = np.where(settled, weight / weight.sum(0), np.eye(len(log))[:, -1:])
    apart = np.where(settled[:, None], np.array(means), 0.0)  # [prior, frame, quantity]
    total = np.einsum("kf,kfi->fi", weight, apart)
    apart -= total
    spread = np.einsum("kf,kfij->fij", weight, spreads)
    return total, spread + np.einsum("kf,kfi,kfj->fij", weight, apart, apart), weight[0]
