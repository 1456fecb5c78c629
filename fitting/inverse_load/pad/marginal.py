"""What is told of a contact on a pad, with all else that it may be marginalised.

The fit has WHOLE parameters a contact (`fitting.inverse_load.pad.interpolant`). Told are its
place, its force and, where asked for, its diameter and direction; the others are eliminated:
with I the information, priors included, t the rows that are told and s the others::

    I' = I_tt - I_ts I_ss^-1 I_st,    J' = J_t - I_ts I_ss^-1 J_s

Where directions are told, the force is the whole one, turned from the inward normal in the
section's plane and tilted out of it; else it is the inward component.
"""

from dataclasses import dataclass

import numpy as np

from fitting.arrays import Flags, Floats, Rows
from fitting.inverse_load.fit.covariance import inverse, whitened
from fitting.inverse_load.fit.explanation import PRIOR_OF_TANGENT, TOLD
from fitting.inverse_load.model.contact_parameters import ContactParameters, pad_parameters
from fitting.inverse_load.pad.interpolant import ASKEW, PLAIN, WHOLE, extents

BESIDE = ("arc_extent", "axial_extent", "arc_force", "axial_force")
"""What is estimated beside the parameters that are told."""
_UNKNOWN = 1e12


@dataclass(frozen=True)
class Told:
    """What is told of contacts."""

    diameter: bool  # whether the diameter is
    direction: bool  # whether turn and tilt of the force are

    @property
    def parameters(self) -> ContactParameters:
        """Names of what is told."""
        return pad_parameters(diameter=self.diameter, direction=self.direction)

    def columns(self, contacts: int, size: int = WHOLE) -> tuple[Rows, Rows]:
        """Which of a contact's parameters, WHOLE or ASKEW, are told, and which are not."""
        names = [True] * PLAIN + [self.diameter, False] + [self.direction] * 2
        names += [False] * (size - WHOLE)
        told = np.repeat(names, contacts)
        return np.flatnonzero(told), np.flatnonzero(~told)

    def whole(self, told: Floats, beside: Floats, contacts: int) -> Floats:
        """Whole parameters [frame, parameter] from those told and others that hold for all."""
        found = np.tile(beside, (len(told), 1))
        found[:, self.columns(contacts)[0]] = told
        if self.direction:
            x = found.reshape(len(told), WHOLE, contacts)
            turn, tilt = x[:, 5].copy(), x[:, 6].copy()
            x[:, 2] *= np.cos(turn) * np.cos(tilt)
            x[:, 5], x[:, 6] = np.tan(turn), np.tan(tilt) / np.cos(turn)
        return found

    def turned(self, whole: Floats, contacts: int) -> tuple[Floats, Floats]:
        """Whole parameters with forces as they are told, and what theirs do to the fit's.

        `whole` are the parameters of the fit [frame, parameter].
        Returns parameters [frame, parameter]; derivatives of the fit's by them [frame, p, p].
        """
        frames, size = whole.shape
        shown = whole.copy()
        slopes = np.tile(np.eye(size), (frames, 1, 1))
        if not self.direction:
            return shown, slopes
        force, across, axially = (
            whole[:, k * contacts : (k + 1) * contacts] for k in (2, 5, 6)
        )
        long = np.sqrt(1 + across**2 + axially**2)
        flat = np.sqrt(1 + across**2)
        turn, tilt = np.arctan(across), np.arcsin(axially / long)
        total = force * long
        for k, value in ((2, total), (5, turn), (6, tilt)):
            shown[:, k * contacts : (k + 1) * contacts] = value
        cos = np.cos(turn)
        zero = np.zeros_like(force)
        rows = {  # of force, tangents; by total, turn, tilt
            2: (1 / long, -force * np.tan(turn), -force * np.tan(tilt)),
            5: (zero, 1 / cos**2, zero),
            6: (zero, np.tan(tilt) * np.sin(turn) / cos**2, flat * (1 + np.tan(tilt) ** 2)),
        }
        for contact in range(contacts):
            for k, row in rows.items():
                for j, value in zip((2, 5, 6), row, strict=True):
                    at = k * contacts + contact, j * contacts + contact
                    slopes[:, at[0], at[1]] = value[:, contact]
        return shown, slopes

    def marginal(
        self, whole: Floats, jacobian: Floats, information: Floats, contacts: int
    ) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """Parameters that are told, jacobian and information with the others eliminated.

        Last what those do to readings, and the jacobian with those held, see
        `Explanations.eliminated` and `Explanations.held` [frame, row, channel].
        """
        shown, slopes = self.turned(whole, contacts)
        turned = np.swapaxes(slopes, 1, 2)
        jacobian, information = turned @ jacobian, turned @ information @ slopes
        told, other = self.columns(contacts, whole.shape[1] // contacts)
        across = information[:, other[:, None], told]
        own = information[:, other[:, None], other]
        share = np.swapaxes(np.linalg.solve(own, across), 1, 2)
        return (
            shown[:, told],
            jacobian[:, told] - share @ jacobian[:, other],
            information[:, told[:, None], told] - share @ across,
            whitened(jacobian[:, other], own),
            jacobian[:, told],
        )


def beside(whole: Floats, information: Floats, prior: Floats, contacts: int) -> Floats:
    """Extents and tangential forces of contacts [frame, contact, quantity, 2] [m], [N].

    `whole` are the parameters of the fit [frame, parameter], with their information, priors
    included. `prior` are the standard deviations of the last four.
    Returns values and standard deviations in the order of `BESIDE`; NaN where readings tell
    hardly more than the prior.
    """
    # What readings don't determine at all leaves nothing finite to be told.
    covariance = np.nan_to_num(inverse(information), posinf=_UNKNOWN)
    size = whole.shape[1] // contacts
    found = np.full((len(whole), contacts, len(BESIDE), 2), np.nan)
    for contact in range(contacts):
        rows = np.arange(contact, size * contacts, contacts)
        x, own = whole[:, rows], covariance[:, rows[:, None], rows]
        turn = x[:, 7] if size == ASKEW else np.zeros(len(x))
        both = extents(x[:, 3], x[:, 4], turn)
        for k, own_turn in enumerate((turn, turn + np.pi / 2)):
            # Logarithm of the extent by diameter, slenderness and turn.
            share = (x[:, 3] / both[k]) ** 2
            long, short = (share * np.exp(2 * sign * x[:, 4]) for sign in (1, -1))
            by = np.zeros_like(x)
            by[:, 3] = 1 / x[:, 3]
            by[:, 4] = long * np.cos(own_turn) ** 2 - short * np.sin(own_turn) ** 2
            by[:, 7:] = ((short - long) * np.sin(2 * own_turn) / 2)[:, None]
            deviation = _deviation(by, own)
            told = deviation < TOLD * np.hypot(*prior[:2])
            found[:, contact, k] = _where(told, both[k], both[k] * deviation)
            j = 5 + k
            by = np.zeros_like(x)
            by[:, 2], by[:, j] = x[:, j], x[:, 2]
            deviation = _deviation(by, own)
            told = np.sqrt(own[:, j, j]) < TOLD * min(prior[2 + k], PRIOR_OF_TANGENT)
            found[:, contact, 2 + k] = _where(told, x[:, 2] * x[:, j], deviation)
    return found


def _deviation(by: Floats, covariance: Floats) -> Floats:
    """Standard deviation of a function with these derivatives by parameters [frame]."""
    return np.sqrt(np.maximum(np.einsum("fi,fij,fj->f", by, covariance, by), 0.0))


def _where(told: Flags, value: Floats, deviation: Floats) -> Floats:
    return np.where(told[:, None], np.stack([value, deviation], 1), np.nan)
