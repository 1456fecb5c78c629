"""Least squares for one contact that presses an arc of unknown length, or not inwards alone.

Readings hardly change with a contact's width until it is wider than the film is thick; then
a contact taken as a line leaves a pattern that two lines side by side explain as well. A force
that friction turns by a few degrees leaves that of a lighter contact elsewhere. The square of
the arc's length, the tangential force over the inward one, or both are fitted along with angle
and force, and eliminated: with I the information and s their rows::

    I' = I_xx - I_xs I_ss^-1 I_sx,    J' = J_x - I_xs I_ss^-1 J_s

whose inverse is the covariance of angle and force, these unknown. The cheapest is told, each
of both at the cost of Schwarz's criterion for one more than the other.
"""

import copy

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.fit.covariance import inverse, whitened
from fitting.inverse_load.fit.explanation import (
    PRIOR_OF_TANGENT,
    TOLD,
    UNSETTLED,
    Attempt,
    Explanations,
)
from fitting.inverse_load.fit.section_fitter import SectionFitter
from fitting.inverse_load.fit.section_least_squares import WIDE_FIT_PROGRAM, Fit
from fitting.inverse_load.model.evaluation import NARROWEST
from fitting.inverse_load.search.table import LoadTable
from fitting.steps import Steps
from suas_jax.scene.skin import Skin

LENGTH, _TANGENT = 2, 3
"""Rows of the fit's parameters beside angle and force."""

_START = 12e-3  # length of the arc where fits begin [m]
_LONGEST = 60e-3  # [m]
# Standard deviation of a half-normal prior [m]: two fingers look like one contact as wide as
# they are apart, which is rarer than they are.
_USUAL = 15e-3
_MOST_TANGENT = np.tan(np.pi / 3)
_UNKNOWN = 1e12


class WideContactFitter(SectionFitter):
    """Least squares on a skin in plane strain, for one contact that is not a radial line.

    The table's states bound the forces. Live, single frames are fitted, whole at once;
    otherwise many lanes side by side. `most_contacts` sets the widest set of parameters.
    """

    program = staticmethod(lambda contacts: WIDE_FIT_PROGRAM)

    def __init__(self, skin: Skin, table: LoadTable, *, live: bool, most_contacts: int) -> None:
        super().__init__(skin, table, direction=False, live=live, most_contacts=most_contacts)
        self._all = np.concatenate(
            [self._bounds, [[NARROWEST**2, _LONGEST**2], [-_MOST_TANGENT, _MOST_TANGENT]]]
        )
        self._radius = float(skin.geometry.outer_size[0])
        self._free: list[int] = []

    def steps(self, asked: Attempt) -> Steps[Explanations]:
        """See the base class; the start holds angle and force of one contact."""
        best = yield from self.freed(asked, [LENGTH])
        for free in ([_TANGENT], [LENGTH, _TANGENT]):
            found = yield from self.freed(asked, free)
            best = best.cheapest(np.arange(len(best)), found)[0]
        return best

    def freed(self, asked: Attempt, free: list[int]) -> Steps[Explanations]:
        """Fit with some rows of the parameters free beside angle and force."""
        length = _START if LENGTH in free else NARROWEST
        more = np.tile([length**2, 0.0], (len(asked.start), 1))
        begin = np.concatenate([asked.start[:, :2], more], 1)
        # Another frame may be fitted before this search goes on.
        own = copy.copy(self)
        own._free, own._bounds = free, self._all.copy()
        for row in {LENGTH, _TANGENT} - set(free):
            own._bounds[row] = more[0, row - 2]
        found = yield from SectionFitter.steps(own, asked._replace(start=begin))
        used = np.maximum((asked.weight > 0).sum(1), 2)
        settled = found.predicted_decrease <= UNSETTLED
        return found.penalised(np.where(settled, (len(free) - 1) * np.log(used), np.inf))

    def _gathered(self, fit: Fit, asked: Attempt) -> Explanations:
        free = np.array(self._free)
        jacobian = np.asarray(fit.evaluation.jacobian).transpose(2, 0, 1)
        whole = np.asarray(fit.information).transpose(2, 0, 1)
        own, across = whole[:, free[:, None], free], whole[:, free, :2]
        share = np.nan_to_num(inverse(own), posinf=0.0) @ across  # [frame, free, 2]
        turned = share.transpose(0, 2, 1)
        reduced = fit._replace(
            parameters=fit.parameters[:2],
            evaluation=fit.evaluation._replace(
                jacobian=(jacobian[:, :2] - turned @ jacobian[:, free]).transpose(1, 2, 0)
            ),
            information=(whole[:, :2, :2] - turned @ across).transpose(1, 2, 0),
        )
        found = super()._gathered(reduced, asked)
        found.held[:, :2] = jacobian[:, :2]
        found.eliminated[:, : len(free)] = whitened(np.nan_to_num(jacobian[:, free]), own)
        rows = np.array([0, 1, *free])
        covariance = np.nan_to_num(inverse(whole[:, rows[:, None], rows]), posinf=_UNKNOWN)
        self._told(found, np.asarray(fit.parameters).T, covariance)
        return found

    def _told(
        self,
        found: Explanations,
        parameters: Floats,  # of the fit [frame, 4]
        covariance: Floats,  # of angle, force and what was free [frame, parameter, parameter]
    ) -> None:
        """Write what was found beside angle and force."""
        deviations = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        if _TANGENT in self._free:  # the last
            force, tangent = parameters[:, 1], parameters[:, _TANGENT]
            by = np.zeros_like(deviations)
            by[:, 1], by[:, -1] = tangent, force
            deviation = np.sqrt(np.einsum("fi,fij,fj->f", by, covariance, by))
            known = deviations[:, -1] < TOLD * PRIOR_OF_TANGENT
            shown = np.where(known, force * tangent, np.nan)
            found.beside[:, 0, 2] = np.stack([shown, deviation], 1)
        if LENGTH in self._free:
            length = np.sqrt(parameters[:, LENGTH])
            deviation = deviations[:, 2] / (2 * length)
            found.beside[:, 0, 0] = np.stack([length, deviation], 1)
            found.score[:] += (length / _USUAL) ** 2
            # An arc that reaches over the clamp is not a contact.
            over = np.abs(found.parameters[:, 0]) + length / 2 / self._radius > self.edge
            found.score[over] = found.chi2[over] = np.inf
