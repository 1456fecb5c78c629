"""Least squares for one contact that presses an arc of unknown length.

Readings hardly change with a contact's width until it is wider than the film is thick; then
a contact taken as a line leaves a pattern that two lines side by side explain as well. The
square of the arc's length is fitted along with angle and force, and eliminated: with I the
information and s its row::

    I' = I_xx - I_xs I_sx / I_ss,    J' = J_x - (I_xs / I_ss) J_s

whose inverse is the covariance of angle and force, the length unknown.
"""

import numpy as np

from fitting.inverse_load.fit.explanation import Attempt, Explanations
from fitting.inverse_load.fit.section_fitter import SectionFitter
from fitting.inverse_load.fit.section_least_squares import WIDE_FIT_PROGRAM, Fit
from fitting.inverse_load.search.table import LoadTable
from fitting.steps import Steps
from suas_jax.scene.skin import Skin

_START = 12e-3  # length of the arc where fits begin [m]
_SHORTEST, _LONGEST = 1e-3, 60e-3  # [m]
# Standard deviation of a half-normal prior [m]: two fingers look like one contact as wide as
# they are apart, which is rarer than they are.
_USUAL = 15e-3


class WideContactFitter(SectionFitter):
    """Least squares on a skin in plane strain, for one radial contact over an arc.

    The table's states bound the forces. Live, single frames are fitted, whole at once;
    otherwise many lanes side by side. `most_contacts` sets the widest set of parameters.
    """

    program = staticmethod(lambda contacts: WIDE_FIT_PROGRAM)

    def __init__(self, skin: Skin, table: LoadTable, *, live: bool, most_contacts: int) -> None:
        super().__init__(skin, table, direction=False, live=live, most_contacts=most_contacts)
        self._bounds = np.concatenate([self._bounds, [[_SHORTEST**2, _LONGEST**2]]])
        self._radius = float(skin.geometry.outer_size[0])

    def steps(self, asked: Attempt) -> Steps[Explanations]:
        """See the base class; the start holds angle and force of one contact."""
        length = np.full((len(asked.start), 1), _START**2)
        begin = np.concatenate([asked.start[:, :2], length], 1)
        return super().steps(asked._replace(start=begin))

    def _gathered(self, fit: Fit, asked: Attempt) -> Explanations:
        jacobian, information = fit.evaluation.jacobian, fit.information
        own = np.where(information[2, 2] > 0, information[2, 2], np.inf)
        share = information[:2, 2] / own
        reduced = fit._replace(
            parameters=fit.parameters[:2],
            evaluation=fit.evaluation._replace(
                jacobian=jacobian[:2] - share[:, None] * jacobian[2]
            ),
            information=information[:2, :2] - share[:, None] * information[2, :2],
        )
        found = super()._gathered(reduced, asked)
        found.held[:, :2] = np.asarray(jacobian[:2]).transpose(2, 0, 1)
        found.eliminated[:, 0] = np.asarray(jacobian[2] / np.sqrt(own)).T
        length = np.sqrt(np.asarray(fit.parameters[2]))
        variance = 1 / np.maximum(own - (share * information[2, :2]).sum(0), 1e-300)
        found.beside[:, 0, 0] = np.stack([length, np.sqrt(variance) / (2 * length)], 1)
        found.score[:] += (length / _USUAL) ** 2
        # An arc that reaches over the clamp is not a contact.
        over = np.abs(found.parameters[:, 0]) + length / 2 / self._radius > self.edge
        found.score[over] = found.chi2[over] = np.inf
        return found
