"""Estimates made of explanations: covariances, statuses, what can't be said."""

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np

from fitting.arrays import Flags, Floats, Rows
from fitting.inverse_load.estimate.estimate import Contact, LoadEstimate
from fitting.inverse_load.estimate.place import ContactPlaces
from fitting.inverse_load.fit.covariance import covariance_of, inverse
from fitting.inverse_load.fit.explanation import (
    UNSETTLED,
    AbstractLoadFitter,
    Alternative,
    Explanations,
)
from fitting.inverse_load.fit.loads_and_errors import SUSPECT
from fitting.inverse_load.fit.several_contacts import FELT
from fitting.inverse_load.search.base import AbstractNodeSearch

POOR = 1e-4
"""p-value of chi2 below which the fit is called poor."""
_BEYOND_MODEL = 9.0  # chi2 per degree of freedom beyond which no number is given
_AMBIGUOUS = 6.0  # difference of chi2 below which a second mode is reported
_SURE = 2.0  # standard deviations within which first contact can't be excluded
_DIRECTIONS = 32  # in which a contact on a pad may lie beyond the taxels
_ONE_SIDED = 1.645  # standard deviations below which one in twenty lies


class LoadAssessment:
    """Estimates from explanations, for one skin.

    The fitter knows edges and forces of first contact, the nodes know distances, and `along`
    knows what scenes call places. Taxels have places [taxel, coordinate]; further columns of
    explanations are not taxels.
    """

    def __init__(
        self,
        fitter: AbstractLoadFitter,
        nodes: AbstractNodeSearch,
        along: ContactPlaces,
        taxels: Floats,
    ) -> None:
        self._fitter, self._nodes, self._places = fitter, nodes, taxels
        self._parameters, self._per_contact = fitter.parameters, fitter.per_contact
        self.along, self._taxels = along, len(taxels)

    def estimates(
        self,
        best: Explanations,  # their explanations
        others: Sequence[Alternative | None],  # their second modes
        full_scale: Flags,  # taxels that read full scale [frame, taxel]
        # covariance from the errors that all frames share, as wide as `best`'s information
        # [frame, parameter, parameter]
        systematic: Floats | None = None,
        own: Floats | None = None,  # covariance that frames have of their own, likewise
    ) -> list[LoadEstimate]:
        """Estimates of frames that something touches."""
        wide, several = best.wide, best.contacts > 1
        # What looks wide may be many fingers, of whose patterns noise hides what is left.
        poor = best.p_value(self._per_contact) < np.where(wide, SUSPECT, POOR)
        covariance = covariance_of(best, self._per_contact)
        if own is not None:
            covariance = covariance + own
        return [
            self._estimate(
                best,
                others[i],
                i,
                covariance[i],
                None if systematic is None else systematic[i],
                full_scale[i],
                bool(poor[i]),
                bool(wide[i] and several[i]),
            )
            for i in range(len(best))
        ]

    def so_far(self, known: Explanations) -> LoadEstimate:
        """The estimate of a frame whose search goes on."""
        count, chi2 = int(known.contacts[0]), float(known.chi2[0])
        kept = known.weight[0] > 0
        out = tuple(np.flatnonzero(~kept[: self._taxels]).tolist())
        if not np.isfinite(chi2):
            return LoadEstimate(True, status="coarse", left_out=out)
        ratio = chi2 / max(int(kept.sum()) - self._per_contact * count, 1)
        contacts = self._contacts(known.parameters[0], count, None, None)
        pressure = float(known.pressure[0])
        return LoadEstimate(True, contacts, pressure, None, ratio, "coarse", out)

    def _estimate(
        self,
        best: Explanations,
        other: Alternative | None,
        i: int,
        covariance: Any,
        systematic: Any,
        full_scale: Flags,
        poor: bool,
        many: bool,  # whether one of several contacts is so wide that it may be others
    ) -> LoadEstimate:
        count, chi2 = int(best.contacts[i]), float(best.chi2[i])
        kept = best.weight[i] > 0
        ratio = chi2 / max(int(kept.sum()) - self._per_contact * count, 1)
        out = tuple(np.flatnonzero(~kept[: self._taxels]).tolist())
        if not np.isfinite(chi2):
            return LoadEstimate(None, status="no_convergence", left_out=out)
        places = best.parameters[i, : self._parameters.places * count]
        places = places.reshape(-1, count).T
        spread = covariance * (max(ratio, 1.0) if poor else 1.0)
        own, more = best.parameters[i], best.beside[i]
        bound, near = self._bound(own, count, spread, systematic, more)
        wall = bool(best.min_gap[i] <= self._fitter.wall_gap) or near
        blind, distance = self._places[full_scale], self._nodes.distance
        wall = wall or any(
            (distance(blind, place) < self._nodes.separate).any() for place in places
        )
        if poor and ratio > _BEYOND_MODEL:
            wall = wall and bound > 0  # else the misfit alone reaches the wall
            unknown = True if wall else None
            status = "wall_contact" if wall else "model_mismatch"
            return LoadEstimate(
                unknown,
                wall_contact=unknown,
                chi2_per_dof=ratio,
                status=status,
                left_out=out,
                at_least=bound if wall else None,
            )
        beyond = max(self._beyond(place, kept[: self._taxels]) for place in places)
        edge = bool((np.abs(places) >= self._fitter.edge * (1 - 1e-6)).any())
        edge = edge or beyond > self._nodes.separate / 2
        # There slopes at the fit's end say nothing of how far off it is.
        told = not (wall or edge)
        contacts = self._contacts(
            best.parameters[i],
            count,
            spread if told else None,
            systematic if told else None,
            best.beside[i],
            # At the wall no error is stated that would tell which of them are there at all.
            self._felt(best.parameters[i], count, spread) if wall else None,
        )
        alternatives: tuple[Contact, ...] = ()
        if count == 1 and other is not None and other.chi2 < chi2 + _AMBIGUOUS:
            width = self._per_contact * other.contacts
            apart = inverse(other.information[None, :width, :width])[0]
            alternatives = self._contacts(other.parameters, other.contacts, apart, None)
        if wall:
            status = "wall_contact"
        elif edge and not poor:
            status = "at_edge"  # whether the fit has settled there or not
        elif best.predicted_decrease[i] > UNSETTLED:
            status = "no_convergence"
        elif poor:
            status = "poor_fit"
        elif best.parameters[i, self._parameters.rows("force", count)][0] < 0:
            status = "pull"
        elif alternatives or many:
            status = "ambiguous"
        elif any(contact.imprecise for contact in contacts):
            status = "imprecise"
        else:
            status = "ok"
        pressure = float(best.pressure[i])
        return LoadEstimate(
            True,
            contacts,
            pressure,
            wall,
            ratio,
            status,
            out,
            alternatives,
            at_least=bound if wall else None,
        )

    def _beyond(self, place: Floats, used: Flags) -> float:
        """How far a place lies outside of the taxels in use, as distances; negative inside.

        That is the largest distance of a line that parts the place from all of them.
        """
        size = len(place)
        metres = self._nodes.distance(np.eye(size), np.zeros((1, size)))
        turn = np.linspace(0, 2 * np.pi, 2 if size == 1 else _DIRECTIONS, endpoint=False)
        ways = np.stack([np.cos(turn), np.sin(turn)][:size])
        steps = (self._places[used] - place) * metres
        return float(-(steps @ ways).max(0).min())

    def _bound(
        self, parameters: Any, count: int, covariance: Any, systematic: Any, beside: Any
    ) -> tuple[float, bool]:
        """Force that acts at least [N], and whether the wall may take more.

        Beyond first contact the oil's pressure, and with it the readings, hardly change:
        the force that explains them is that of first contact, or a little less. Errors that
        all frames share move both alike; they multiply forces, while noise adds to them.
        """
        forces = self._parameters.rows("force", count)
        force, own = parameters[forces], covariance[forces, forces]
        shared = np.zeros_like(own) if systematic is None else systematic[forces, forces]
        places = parameters[: self._parameters.places * count].reshape(-1, count).T
        limit = self._fitter.first_contact(places, beside[:count, :, 0])
        reached = (1 - self._fitter.limit_error) * limit[0]
        near = count == 1 and force[0] + _SURE * _root(own) >= reached
        # No force pulls: together they are at least what any of them are.
        bounds = [
            _least(
                min(force[rows].sum(), limit[rows].sum()),
                _root(own[np.ix_(rows, rows)]),
                _root(shared[np.ix_(rows, rows)]),
            )
            for size in range(1, count + 1)
            for rows in map(list, itertools.combinations(range(count), size))
        ]
        return max(*bounds, 0.0), bool(near)

    def _felt(self, parameters: Any, count: int, covariance: Any) -> Rows:
        """Contacts whose force is twice its error; the strongest where none is."""
        forces = self._parameters.rows("force", count)
        force, own = parameters[forces], np.diag(covariance)[forces]
        felt = force > FELT * np.sqrt(np.where(own > 0, own, 0.0))
        felt[force.argmax()] = True
        return np.flatnonzero(felt)

    def _contacts(
        self,
        parameters: Any,
        count: int,
        covariance: Any,
        systematic: Any,
        beside: Any = None,
        chosen: Rows | None = None,
    ) -> tuple[Contact, ...]:
        contacts = []
        for k in range(count) if chosen is None else chosen:
            rows = slice(k, self._per_contact * count, count)
            names = self._parameters.names
            values = dict(zip(names, parameters[rows].tolist(), strict=True))
            at = np.array(values["angle"])
            scale = np.ones(len(names))
            scale[names.index("angle")] = self.along.slope(at)
            own, total = (
                None if x is None else x[rows, rows] * np.outer(scale, scale)
                for x in (systematic, covariance)
            )
            arc = self.along.arc(at)
            told = () if beside is None else zip(self._fitter.beside, beside[k], strict=True)
            contacts.append(
                Contact(
                    float(self.along.angle(at)),
                    values["force"],
                    values.get("direction"),
                    total if total is None or own is None else total + own,
                    float(self.along.outer_arc(at)),
                    own,
                    values.get("axial"),
                    values.get("diameter"),
                    values.get("tilt"),
                    None if arc is None else float(arc),
                    self.along.name == "arc",
                    **{n: (float(x[0]), float(x[1])) for n, x in told if x[0] == x[0]},
                )
            )
        return tuple(sorted(contacts, key=lambda contact: contact.arc_position or 0.0))


def _least(force: float, noise: float, shared: float) -> float:
    """A force [N] less what noise adds to it, and errors that multiply it, in 19 of 20 cases.

    `noise` and `shared` are its standard deviations by either [N].
    """
    if force <= 0:
        return force
    lost = -force * np.expm1(-_ONE_SIDED * shared / force)
    return float(force - np.hypot(lost, _ONE_SIDED * noise))


def _root(covariance: Floats) -> float:
    """Standard deviation of a sum; zero where it is not known."""
    variance = float(np.sum(covariance))
    return float(np.sqrt(variance)) if np.isfinite(variance) and variance > 0 else 0.0
