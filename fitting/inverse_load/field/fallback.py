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
from fitting.inverse_load.estimate.measured_pressure import contradicted
from fitting.inverse_load.estimate.place import ContactPlaces
from fitting.inverse_load.field.fitter import FieldFitter
from fitting.inverse_load.fit.explanation import PLAUSIBLE, Explanations
from fitting.inverse_load.fit.systematic import AbstractSystematicErrors
from fitting.steps import Budget
from suas_jax.scene.skin import Skin

_CLOSE = 10.0  # difference of cost below which both are told
_STEP = "load field"  # that a budget knows
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
        scatter: float = 0.0,  # of forces from one press to another, relative
        little_gap: float = 0.0,  # below which a membrane may touch the wall elsewhere [m]
        live: bool,
        budget: Budget | None = None,  # of a live frame
    ) -> None:
        self._fitter = FieldFitter(skin, edge, along, errors, scatter)
        self._taxels = len(skin.electrodes.taxels.angle)
        self._per_contact, self._coordinates = per_contact, coordinates
        self._little_gap, self._live, self._budget = little_gap, live, budget

    def told(
        self, estimates: Sequence[LoadEstimate], best: Explanations, y: Floats, weight: Floats
    ) -> list[LoadEstimate]:
        """Estimates of frames, with fields where they explain as much as contacts or more.

        Explanations, channels [frame, channel] and inverse variances are those of the frames;
        the last channel is the oil's pressure, whether the contacts were fitted to it or not.
        """
        plausible = best.p_value(self._per_contact) >= PLAUSIBLE
        wide = best.wide
        few = (best.contacts == 1) & ~wide | self._live & ~(wide & (best.contacts > 1))
        score = best.score
        if best.so.shape[1] == self._taxels:  # the contacts know nothing of the pressure
            score = score + weight[:, -1] * (y[:, -1] - best.pressure) ** 2
        found = list(estimates)
        for i, estimate in enumerate(estimates):
            pulled = any(contact.force < 0 for contact in estimate.contacts)
            known = estimate.status in _EXPLAINED | _UNEXPLAINED
            own = y[i], weight[i]
            sure = bool(plausible[i] and few[i]) and not contradicted(estimate, *own)
            if known and (pulled or not sure):
                found[i] = self._in_time(estimate, float(score[i]), pulled, *own)
        return found

    def warm_up(self, y: Floats) -> None:
        """Compile what a fit of readings [taxel] needs, or load it; see how long one takes."""
        channels, weight = np.append(y, 0.0), np.append(np.ones(self._taxels), 0.0)

        def told() -> None:
            fit = self._fitter.fit(channels, weight)
            if fit is not None:
                self._fitter.told(fit, weight, 0.0)

        told()
        if self._budget is not None:  # nothing is compiled any more
            with self._budget.timing(_STEP):
                told()

    def _in_time(
        self, contacts: LoadEstimate, score: float, pulled: bool, y: Any, weight: Any
    ) -> LoadEstimate:
        """A field where there is time for one; else contacts whose frame is not at its end."""
        if self._budget is None:
            return self._or_field(contacts, score, pulled, y, weight)
        if not self._budget.allows(_STEP):
            kept = tuple(replace(c, covariance=None) for c in contacts.contacts)
            return replace(contacts, contacts=kept, status="coarse", alternatives=())
        with self._budget.timing(_STEP):
            return self._or_field(contacts, score, pulled, y, weight)

    def _or_field(
        self,
        contacts: LoadEstimate,
        score: float,  # what they cost
        pulled: bool,  # whether one of them pulls
        y: Any,
        weight: Any,
    ) -> LoadEstimate:
        fit, used = self._fitter.fit(y, weight), int((weight > 0).sum())
        explained = fit is not None and chdtrc(used, fit.chi2) > POOR
        if fit is None or not explained or float(fit.found.min_gap) <= 0:
            return contacts
        gain = score + (self._coordinates + 1) * np.log(used) - fit.cost
        # Oil that can't be compressed makes a pull read as a push all around it does.
        if gain < -_CLOSE and not pulled:
            return contacts
        field = self._fitter.told(fit, weight, float(gain))
        if gain <= _CLOSE and contacts.status in _EXPLAINED:
            status = contacts.status if pulled else "ambiguous"
            return replace(contacts, status=status, field=field)
        return LoadEstimate(
            True,
            oil_pressure=float(fit.found.pressure),
            # A field is even where a wall that holds up the membrane would be felt.
            wall_contact=None if float(fit.found.min_gap) < self._little_gap else False,
            chi2_per_dof=fit.chi2 / used,
            status="load_field",
            left_out=tuple(np.flatnonzero(weight[: self._taxels] == 0).tolist()),
            alternatives=contacts.contacts,
            field=field,
        )
