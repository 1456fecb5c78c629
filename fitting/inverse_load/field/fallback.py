"""When a load field is told: beside contacts that explain as much, or in their place.

A field costs -2 log(evidence). Contacts cost what their selection counts (chi2, and a penalty
for each beyond the first), and Schwarz's criterion for the first. Both leave out what readings
that are met exactly cost.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.special import chdtrc

from fitting.arrays import Floats
from fitting.inverse_load.estimate.assessment import POOR
from fitting.inverse_load.estimate.estimate import LoadEstimate
from fitting.inverse_load.estimate.place import ContactPlaces
from fitting.inverse_load.field.fitter import FieldFitter
from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.fit.selection import PLAUSIBLE
from fitting.inverse_load.fit.systematic import AbstractSystematicErrors
from fitting.inverse_load.fit.wide_contact import UNUSUAL
from suas_jax.scene.skin import Skin

_CLOSE = 10.0  # difference of cost below which both are told
# Statuses of contacts that explain a frame, or don't; the wall's are about the wall.
_EXPLAINED = frozenset(("ok", "imprecise", "ambiguous", "pull", "at_edge"))
_UNEXPLAINED = frozenset(("poor_fit", "model_mismatch", "no_convergence"))


class FieldFallback:
    """Load fields of frames that one contact does not explain, on one skin.

    `coordinates`: of a contact's place. `live`: frames come one by one, and contacts that
    explain them are believed; in a log a field is tried beside several and wide ones, too.
    """

    def __init__(
        self,
        skin: Skin,
        edge: Floats,  # largest coordinates of a place
        along: ContactPlaces,
        errors: AbstractSystematicErrors | None,  # of the skin's inputs
        *,
        per_contact: int,  # parameters of a contact
        coordinates: int,
        live: bool,
    ) -> None:
        self._fitter = FieldFitter(skin, edge, along, errors)
        self._taxels = len(skin.electrodes.taxels.angle)
        self._per_contact, self._coordinates = per_contact, coordinates
        self._live = live

    def told(
        self, estimates: Sequence[LoadEstimate], best: Explanations, y: Floats, weight: Floats
    ) -> list[LoadEstimate]:
        """Estimates of frames, with fields where they explain as much as contacts or more.

        Explanations, readings [frame, channel] and inverse variances are those of the frames.
        """
        plausible = best.p_value(self._per_contact) >= PLAUSIBLE
        wide = np.nan_to_num(best.beside[:, 0, :2, 0]).max(1, initial=0.0) > UNUSUAL
        few = (best.contacts == 1) & ~wide | self._live
        found = list(estimates)
        # On a pad the model of a wide contact is rough.
        rough = wide & (best.contacts == 1) & (self._coordinates == 2)
        for i, estimate in enumerate(estimates):
            pulled = any(contact.force < 0 for contact in estimate.contacts)
            known = estimate.status in _EXPLAINED | _UNEXPLAINED
            if known and (pulled or not (plausible[i] and few[i])):
                own = y[i, : self._taxels], weight[i, : self._taxels]
                how = float(best.score[i]), pulled, bool(rough[i])
                found[i] = self._or_field(estimate, *how, *own)
        return found

    def warm_up(self, y: Floats) -> None:
        """Compile, or load, what a fit of readings [taxel] needs."""
        self._fitter.fit(y, np.ones(self._taxels))

    def _or_field(
        self,
        contacts: LoadEstimate,
        score: float,  # what they cost
        pulled: bool,  # whether one of them pulls
        rough: bool,  # whether their model is
        y: Any,
        weight: Any,
    ) -> LoadEstimate:
        fit, used = self._fitter.fit(y, weight), int((weight > 0).sum())
        explained = fit is not None and chdtrc(used, fit.chi2) > POOR
        if fit is None or not explained or float(fit.found.min_gap) <= 0:
            return contacts
        gain = score + (self._coordinates + 1) * np.log(used) - fit.cost
        # Oil that can't be compressed makes a pull read as a push all around it does.
        if gain < -_CLOSE and not (pulled or rough):
            return contacts
        field = self._fitter.told(fit, weight, float(gain))
        total = sum(contact.force for contact in contacts.contacts)
        if gain < -_CLOSE and rough and field.force.low <= total <= field.force.high:
            return contacts
        if gain <= _CLOSE and contacts.status in _EXPLAINED:
            status = contacts.status if pulled else "ambiguous"
            return replace(contacts, status=status, field=field)
        return LoadEstimate(
            True,
            oil_pressure=float(fit.found.pressure),
            wall_contact=False,
            chi2_per_dof=fit.chi2 / used,
            status="load_field",
            left_out=tuple(np.flatnonzero(weight == 0).tolist()),
            alternatives=contacts.contacts,
            field=field,
        )
