"""Errors of the skin file's numbers, carried into the loads of every frame.

The inputs of a skin are known to within independent errors c, each of one standard deviation
(`suas_jax.config.input_errors`). With J and S the derivatives of the readings by loads and
errors, W the weights and r the residuals of a frame, to first order::

    S' = S - J (J^T W J)^-1 J^T W S        what no load explains
    P = (1 + S'^T W S')^-1,  c = P S'^T W r      errors given the frame: spread, most likely
    dx = -G c,  G = (J^T W J)^-1 J^T W S         what they do to the loads
    chi2 falls by (S'^T W r)^T P (S'^T W r)      less what the errors themselves count

What was fitted along and eliminated explains its part of S, too: J and J^T W J are what it
leaves of them, and c = P (S - J_held G)^T W r. A stiffness hardly shows in the residuals
(S' is small, P is 1) and moves every frame's force alike; a gap without a baseline shows in
every taxel. Loads are fitted with the inputs as written; their covariance is that of noise,
plus G (P + c c^T) G^T. Only where noise alone doesn't explain a frame are errors fitted with
its loads (`Selection`).

Readings that count from a baseline are moved by S less its value at rest.
"""

import abc
import copy
from collections.abc import Callable, Iterator
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from fitting.arrays import Floats, Rows
from fitting.inverse_load.fit.covariance import inverse
from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.model.contact_parameters import ContactParameters

_CHUNK = 128  # frames that are worked through together


class ErrorsOfFrames(NamedTuple):
    """What frames say about the errors of the inputs; frames of one number of contacts."""

    slopes: Floats  # of the readings by the errors, S [frame, error, channel]
    gain: Floats  # of the loads, G [frame, parameter, error]
    left: Floats  # the information that loads leave, S'^T W S' [frame, error, error]
    pull: Floats  # S'^T W r [frame, error]
    spread: Floats  # covariance of the errors given the frame, P [frame, error, error]
    likely: Floats  # the most likely errors, in standard deviations [frame, error]
    decrease: Floats  # of chi2, less the squares of the errors [frame]


class AbstractSystematicErrors(abc.ABC):
    """Errors that all frames share, on one skin."""

    names: tuple[str, ...]  # of the errors
    # change of the readings at rest by each error [error, channel]; zero where readings count
    # from a baseline
    rest: Floats

    @abc.abstractmethod
    def slopes(self, best: Explanations, per_contact: int, contacts: int) -> Floats:
        """Change of readings by one standard deviation of each error [frame, error, channel].

        `best`: explanations of frames. `per_contact`: parameters of a contact. `contacts`:
        their number, the same in all frames.
        """

    def from_rest(self) -> Self:
        """The same of readings that count from those at rest, which errors move as well."""
        other = copy.copy(self)
        other.rest = np.zeros_like(self.rest)
        return other

    def unexplained(self, best: Explanations, per_contact: int) -> Floats | None:
        """Covariances of the parameters that come from the model itself, if there are any."""
        return None

    def under_field(
        self,
        places: Floats,  # of the field's nodes [node, coordinate]
        force: Floats,  # at each [N]
        jacobian: Floats,  # of channels by the forces [channel, node]
        channels: Floats,  # readings and, last, the oil's pressure [channel]
    ) -> Floats | None:
        """Change of channels under a load field [error, channel]; None where none is known."""
        del places, force, jacobian, channels
        return None

    def of(self, best: Explanations, residual: Floats, per_contact: int) -> ErrorsOfFrames:
        """What frames of one number of contacts say about the errors.

        `best`: their explanations. `residual`: readings less the model's [frame, channel];
        anything where not used. `per_contact`: parameters of a contact.
        """
        count = int(best.contacts[0])
        width = per_contact * count
        used = best.weight > 0
        slopes = np.where(
            used[:, None], np.nan_to_num(self.slopes(best, per_contact, count)), 0
        )
        jacobian = np.where(used[:, None], np.nan_to_num(best.jacobian[:, :width]), 0.0)
        moved = jacobian * best.weight[:, None]
        across = np.swapaxes(slopes, 1, 2)
        # What a frame doesn't determine at all is no less known for the errors.
        information = best.information[:, :width, :width]
        covariance = inverse(information)
        covariance = np.where(np.isfinite(covariance), covariance, 0.0)
        gain = covariance @ (moved @ across)
        weighted = slopes * best.weight[:, None]
        others = best.eliminated @ np.swapaxes(weighted, 1, 2)
        known = np.swapaxes(gain, 1, 2) @ np.nan_to_num(information) @ gain
        left = weighted @ across - known - np.swapaxes(others, 1, 2) @ others
        held = np.where(used[:, None], np.nan_to_num(best.held[:, :width]), 0.0)
        free = (slopes - np.swapaxes(gain, 1, 2) @ held) * best.weight[:, None]
        pull = (free @ np.where(used, np.nan_to_num(residual), 0.0)[..., None])[..., 0]
        spread = np.asarray(np.linalg.inv(np.eye(left.shape[1]) + left), float)
        likely = (spread @ pull[..., None])[..., 0]
        return ErrorsOfFrames(slopes, gain, left, pull, spread, likely, (pull * likely).sum(1))

    def of_loads(self, found: ErrorsOfFrames, best: Explanations, per_contact: int) -> Floats:
        """Covariances of the parameters of frames of one number of contacts.

        `found`: what the frames say about the errors. `best`: their explanations.
        `per_contact`: parameters of a contact.
        """
        # Where errors were fitted with the loads, none is left to shift them.
        shift = np.where(best.absorbed[:, None], 0.0, found.likely)
        second = found.spread + shift[:, :, None] * shift[:, None]
        return np.asarray(found.gain @ second @ np.swapaxes(found.gain, 1, 2))

    def covariance(self, best: Explanations, y: Floats, per_contact: int) -> Floats:
        """Covariances of the parameters by the errors, padded as the information is.

        `best`: explanations of frames. `y`: their readings [frame, channel]. `per_contact`:
        parameters of a contact.
        """
        total = np.full(best.information.shape, np.nan)
        for frames in _alike(best.contacts):
            width = per_contact * int(best.contacts[frames[0]])
            own = best.rows(frames)
            found = self.of(own, y[frames] - own.so, per_contact)
            total[frames, :width, :width] = self.of_loads(found, own, per_contact)
        own_error = self.unexplained(best, per_contact)
        return total if own_error is None else total + own_error


def no_covariance(best: Explanations, per_contact: int) -> Floats:
    """Covariances that are zero, padded with NaN as the information is."""
    used = np.arange(best.information.shape[1]) < per_contact * best.contacts[:, None]
    return np.where(used[:, :, None] & used[:, None], 0.0, np.nan)


def of_shared_places(
    best: Explanations, per_contact: int, covariance: Callable[[Floats], Floats]
) -> Floats:
    """Covariances of the parameters by what all places are off by together, padded likewise.

    Angles come first among the parameters; `covariance` is theirs [frame, contact, contact].
    """
    total = no_covariance(best, per_contact)
    for count in np.unique(best.contacts):
        frames = np.flatnonzero(best.contacts == count)
        total[frames, :count, :count] = covariance(best.parameters[frames, :count])
    return total


def of_scattered_forces(
    best: Explanations, parameters: ContactParameters, variance: float
) -> Floats:
    """The same by errors of each force, relative, of one variance."""
    total = no_covariance(best, parameters.per_contact)
    for count in np.unique(best.contacts):
        frames = np.flatnonzero(best.contacts == count)
        own = np.arange(total.shape[1])[parameters.rows("force", int(count))]
        total[frames[:, None], own, own] = variance * best.parameters[frames[:, None], own] ** 2
    return total


def _alike(contacts: NDArray[np.int64]) -> Iterator[Rows]:
    """Frames of one number of contacts, so few together that they fit in the cache."""
    for count in np.unique(contacts):
        frames = np.flatnonzero(contacts == count)
        for begin in range(0, len(frames), _CHUNK):
            yield frames[begin : begin + _CHUNK]
