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

from collections.abc import Mapping

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.fit.systematic import AbstractSystematicErrors
from fitting.inverse_load.pad.rest import GapLine, gap_line
from fitting.inverse_load.pad.stiffening import stiffening_of
from fitting.inverse_load.pad.table import PadTable
from suas_jax.config import InputErrors
from suas_jax.config.input_errors import value_of
from suas_jax.scene.skin import Skin

_PLACE_ERROR, _FORCE_ERROR = 5e-5, 5e-3  # standard deviations [m], of the force
_WIDE_PLACE, _WIDE_FORCE = (
    0.02,
    2.0,
)  # those by extent beyond the table's disc, the latter [1/m]
_SMALL = 1e-3  # of a standard deviation, for derivatives at rest
_GAP = "geometry.oil_gap"
_ELECTRICAL = ("electrodes.", "oil.relative_permittivity", _GAP)


class PadErrors(AbstractSystematicErrors):
    """Errors of a pad's inputs, and what its model and mesh leave open.

    Against continuum and finer meshes the force is within half a per cent and the place
    within a twentieth of a millimetre: taken as standard deviations. What the sum of discs
    leaves out of contacts 20 to 45 mm long is up to a tenth of the force.
    """

    def __init__(
        self,
        errors: InputErrors,  # of its inputs
        skin: Skin,  # the model made from it
        table: PadTable,  # its states
        *,
        from_rest: bool,  # whether readings count from a baseline
        slots: int,  # contacts that the program for solved states has room for
    ) -> None:
        self.names = errors.names
        self._spec, self._table = errors.spec, table
        self._radius = float(skin.geometry.outer_size[0])
        taxels, count = len(table.rest), len(errors)
        self._stray = table.stray
        self._at_rest = 1 / (table.rest - table.stray)
        self._by_stray = np.zeros((count, taxels))
        self._constant = np.zeros((count, taxels))  # da
        self._relative = np.zeros((count, taxels))  # db / b
        mechanical: dict[str, Floats] = {}
        for e, direction in enumerate(errors.directions):
            change = dict(zip(errors.paths, direction.tolist(), strict=True))
            change = {path: size for path, size in change.items() if size}
            electrical = {p: s for p, s in change.items() if p.startswith(_ELECTRICAL)}
            if electrical:
                self._read_at_rest(e, electrical)
            for path in change.keys() - electrical.keys():
                mechanical.setdefault(path, np.zeros(count))[e] = change[path]
        # In an order that does not change, which names what is kept.
        mechanical = {path: mechanical[path] for path in errors.paths if path in mechanical}
        self._stiffening = stiffening_of(errors, mechanical, skin, table, slots)
        rest = self._by_stray - self._constant / self._at_rest**2
        zero = np.zeros((count, 1))
        self._moved_at_rest = np.concatenate([rest, zero], 1)
        self.rest = 0 * self._moved_at_rest if from_rest else self._moved_at_rest

    def slopes(self, best: Explanations, per_contact: int, contacts: int) -> Floats:
        """See the base class."""
        del per_contact
        parameters = best.parameters[:, : 3 * contacts].reshape(-1, 3, contacts)
        by_force = best.jacobian[:, 2 * contacts : 3 * contacts]
        angle, axial, force = parameters.swapaxes(0, 1)
        return self._under(angle, axial, force, by_force, best.so[:, :-1], best.pressure)

    def under_field(
        self, places: Floats, force: Floats, jacobian: Floats, channels: Floats
    ) -> Floats:
        """See the base class."""
        angle, axial = places.T[:, None]
        given = force[None], jacobian.T[None], channels[None, :-1], channels[-1:]
        return self._under(angle, axial, *given)[0]

    def _under(
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
        change = self._constant + self._relative * (u - self._at_rest)[:, None]
        electrical = self._by_stray - change / u[:, None] ** 2
        own = np.concatenate([electrical, np.zeros((*electrical.shape[:2], 1))], 2)
        stiffer = self._stiffening.at(angle, axial, force)  # [frame, contact, error]
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

    # --- what errors of single inputs do ------------------------------------------------

    def _read_at_rest(self, e: int, change: Mapping[str, float]) -> None:
        """Derivatives of the readings at rest along a change of electrical inputs."""
        low, high = (self._gap_line(change, side * _SMALL) for side in (-1.0, 1.0))
        by_stray, constant, slope = (
            (b - a) / (2 * _SMALL) for a, b in zip(low, high, strict=True)
        )
        _, _, own = self._gap_line(change, 0.0)
        self._by_stray[e], self._constant[e] = by_stray, constant
        self._relative[e] = slope / own

    def _gap_line(self, change: Mapping[str, float], size: float) -> GapLine:
        """With inputs changed by a share of an error."""
        inputs = {path: value_of(self._spec, path) + size * by for path, by in change.items()}
        return gap_line(self._spec, inputs)
