"""Errors of a pad's inputs: what they do to its readings and to the oil's pressure.

Nothing is solved in a frame. With u = 1 / (SO - stray) = a + b w, w the membrane's
displacement over a taxel, an error of gap, permittivity, layers or scale moves a and b, which
the readings at rest tell; one of the membrane is a change of stiffness, which does what the
loads' decrease does, at more pressure::

    dSO = dstray - (SO - stray)^2 (da + (db / b) (u - a)) - n sum_c F_c dSO/dF_c
    dp = n (p - sum_c F_c dp/dF_c)

n is the relative change of stiffness that the error amounts to under the contact
(`stiffening`); the part of its effect that is not a change of stiffness is left out.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.fit.systematic import AbstractSystematicErrors
from fitting.inverse_load.pad.table import PadTable

_PLACE_ERROR, _FORCE_ERROR = 5e-5, 5e-3  # standard deviations [m], of the force
# Those by extent beyond the table's disc, the latter [1/m].
_WIDE_PLACE, _WIDE_FORCE = 0.02, 2.0


@dataclass(frozen=True)
class Stiffening:
    """Relative changes of a pad's stiffness by its errors."""

    even: Floats  # of those that do the same everywhere [error]
    share: Floats  # change of every solved input by each error, in its steps [error, path]
    # of the places [rad], [m]: from the pad's middle where its sides do the same, else all
    angle: Floats
    axial: Floats
    force: Floats  # solved there [angle, axial, force] [N]
    change: Floats  # change of stiffness by every solved input [angle, axial, force, path]

    def at(self, angle: Floats, axial: Floats, force: Floats) -> Floats:
        """Changes of stiffness by every error under contacts [..., error].

        Contacts have angles [rad], axial positions [m] and forces [N].
        """
        corners = [
            ((i, k), side * end)
            for i, side in enumerate(_shares(angle, self.angle))
            for k, end in enumerate(_shares(axial, self.axial))
        ]
        low, high = (sum(w * self.force[(*at, j)] for at, w in corners) for j in (0, 1))
        share = np.clip((force - low) / (high - low), 0.0, 1.0)
        change = sum(
            (w * level)[..., None] * self.change[(*at, j)]
            for at, w in corners
            for j, level in enumerate((1 - share, share))
        )
        return np.asarray(self.even + change @ self.share.T)


def _shares(x: Floats, nodes: Floats) -> list[Floats]:
    """Weights of the nodes, from a middle or from side to side; beyond them the nearest's."""
    own = np.abs(x) if nodes[0] == 0 else x
    return [np.interp(own, nodes, row) for row in np.eye(len(nodes))]


class InputEffects(NamedTuple):
    """What errors of a pad's inputs do, each of one standard deviation."""

    by_stray: Floats  # to the part of readings that no gap changes [error, taxel] [counts]
    constant: Floats  # da [error, taxel] [1/counts]
    relative: Floats  # db / b [error, taxel]
    stiffening: Stiffening


class PadErrors(AbstractSystematicErrors):
    """Errors of a pad's inputs, and what its model and mesh leave open.

    Against continuum and finer meshes the force is within half a per cent and the place
    within a twentieth of a millimetre: taken as standard deviations. What the sum of discs
    leaves out of contacts 20 to 45 mm long is up to a tenth of the force.
    """

    def __init__(
        self,
        names: tuple[str, ...],  # of the inputs' errors
        effects: InputEffects,  # of each
        table: PadTable,  # the pad's states
        radius: float,  # of the outer face [m]
        *,
        from_rest: bool,  # whether readings count from a baseline
    ) -> None:
        self.names, self._effects, self._table, self._radius = names, effects, table, radius
        self._stray = table.stray
        self._at_rest = 1 / (table.rest - table.stray)
        rest = effects.by_stray - effects.constant / self._at_rest**2
        self._moved_at_rest = np.concatenate([rest, np.zeros((len(names), 1))], 1)
        self.rest = 0 * self._moved_at_rest if from_rest else self._moved_at_rest

    def slopes(self, best: Explanations, per_contact: int, contacts: int) -> Floats:
        """See the base class."""
        del per_contact
        parameters = best.parameters[:, : 3 * contacts].reshape(-1, 3, contacts)
        by_force = best.held[:, 2 * contacts : 3 * contacts]
        angle, axial, force = parameters.swapaxes(0, 1)
        return self.under(angle, axial, force, by_force, best.so[:, :-1], best.pressure)

    def under_field(
        self, places: Floats, force: Floats, jacobian: Floats, channels: Floats
    ) -> Floats:
        """See the base class."""
        angle, axial = places.T[:, None]
        given = force[None], jacobian.T[None], channels[None, :-1], channels[-1:]
        return self.under(angle, axial, *given)[0]

    def under(
        self,
        angle: Floats,  # of forces [frame, force] [rad]
        axial: Floats,  # likewise [m]
        force: Floats,  # likewise [N]
        by_force: Floats,  # derivatives of the channels by them [frame, force, channel]
        so: Floats,  # readings [frame, taxel]
        pressure: Floats,  # of the oil [frame] [Pa]
    ) -> Floats:
        """Change of channels by each error [frame, error, channel]."""
        along = force[..., None] * by_force
        u = 1 / np.maximum(so - self._stray, 1e-9)
        effects = self._effects
        change = effects.constant + effects.relative * (u - self._at_rest)[:, None]
        electrical = effects.by_stray - change / u[:, None] ** 2
        own = np.concatenate([electrical, np.zeros((*electrical.shape[:2], 1))], 2)
        stiffer = effects.stiffening.at(angle, axial, force)  # [frame, contact, error]
        total = np.abs(force).sum(1, keepdims=True)
        weight = np.abs(force) / np.where(total > 0, total, 1.0)
        moved = own - np.einsum("fce,fcx->fex", stiffer, along)
        moved[..., -1] += np.einsum("fce,fc->fe", stiffer, weight) * pressure[:, None]
        return np.asarray(moved - self._moved_at_rest + self.rest)

    def unexplained(self, best: Explanations, per_contact: int) -> Floats | None:
        """See the base class: errors of the model and its mesh."""
        total = np.full(best.information.shape, np.nan)
        for i, count in enumerate(best.contacts.tolist()):
            width = per_contact * count
            own = best.parameters[i, :width].reshape(per_contact, count)
            by_place, by_force = self._table.errors_at(own[0], own[1])
            place, force = np.hypot(_PLACE_ERROR, by_place), np.hypot(_FORCE_ERROR, by_force)
            sigma = np.zeros_like(own)
            longest = np.nan_to_num(best.beside[i, :count, :2, 0]).max(-1, initial=0.0)
            longer = np.maximum(longest - self._table.diameter, 0.0)
            sigma[1] = np.hypot(place, _WIDE_PLACE * longer)
            sigma[0] = sigma[1] / self._radius
            sigma[2] = np.hypot(force, _WIDE_FORCE * longer) * own[2]
            total[i, :width, :width] = np.diag(sigma.reshape(-1) ** 2)
        return total
