"""What is beyond first order where a skin is much softer or stiffer than its file says.

Equal readings mean an equal shape. The force F at a place a that keeps a shape is linear in the
stress at rest, and so is F (a - a0), with a0 the place without that stress. Forces are
therefore nearly linear in the errors; places and residuals are not.

- **Errors of stiffness and of stress multiply.** A force off by a share rho at one deviation is
  off by rho t (1 + rho t / 2) at t of them, nearly. Deviations of forces grow by 1 + rho / 2.
- **Places** are linear in the errors over the force. With r = C_aF / C_FF and a force of k F,
  k = 1 - rho t, the true place lies off the line of the ellipse by d = r F (1 - k)^2 / k. Its
  variance grows until ellipses of 99.9 % hold the points `_FAR` deviations away, or half the
  stiffness.
- **Residuals** that an error leaves are those of a stiffer skin: an error that changes the
  force by a share s shows in them as 1 / (1 + s t) of what it does to first order, so that
  frames tell less of it.
"""

import numpy as np

from fitting.arrays import Flags, Floats
from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.fit.systematic import AbstractSystematicErrors, ErrorsOfFrames

_FAR = 3.0  # standard deviations of the force
_SOFTEST = 0.5  # share of the stiffness; skins that lose more buckle before they are touched
_REGION = 13.8  # chi2 of 99.9 % in place and force
_TOLD = 2.0  # standard deviations at which an error's residuals are taken
_PRODUCT = 0.5  # second order of errors that multiply
_NONE = 1e-12  # stands for no force, and no deviation of it


class AbstractSectionErrors(AbstractSystematicErrors):
    """Errors that all frames share, on a skin in plane strain."""

    of_membrane: Flags  # which of them change what the membrane answers, and no reading else

    def of_loads(self, found: ErrorsOfFrames, best: Explanations, per_contact: int) -> Floats:
        """See the base class; as if the errors of the membrane were large."""
        found = less_told(found, best, self.of_membrane)
        whole = super().of_loads(found, best, per_contact)
        alone = found._replace(gain=found.gain * self.of_membrane)
        part = super().of_loads(alone, best, per_contact)
        return whole + beyond_first_order(part, best) - part


def less_told(found: ErrorsOfFrames, best: Explanations, errors: Flags) -> ErrorsOfFrames:
    """What frames say about some errors, where residuals are those of stiffer skins."""
    count = int(best.contacts[0])
    forces = slice(count, 2 * count)
    total = np.abs(best.parameters[:, forces]).sum(1)[:, None]
    share = errors * np.abs(found.gain[:, forces].sum(1)) / np.maximum(total, _NONE)
    shown = 1 / (1 + _TOLD * share)
    left = shown[:, :, None] * found.left * shown[:, None]
    pull = shown * found.pull
    spread = np.asarray(np.linalg.inv(np.eye(left.shape[1]) + left), float)
    likely = (spread @ pull[..., None])[..., 0]
    return found._replace(spread=spread, likely=likely)


def beyond_first_order(shared: Floats, best: Explanations) -> Floats:
    """Covariances of the parameters by errors of the membrane, where these may be large.

    `shared` are those to first order [frame, parameter, parameter], of frames of one number of
    contacts. Free directions of contacts behave as places do.
    """
    total, count = shared.copy(), int(best.contacts[0])
    for k in range(count):
        row = count + k  # of the force, after the places
        force = best.parameters[:, row]
        wider = 1 + _PRODUCT * _relative(total[:, row, row], force)
        total[:, row] *= wider[:, None]
        total[:, :, row] *= wider[:, None]
        variance = total[:, row, row]
        rho = _relative(variance, force)
        softer = np.minimum(_FAR, (1 - _SOFTEST) / np.maximum(rho, _NONE))
        needed = np.zeros(len(force))
        for far in (softer, -_FAR):
            left = 1 - rho * far
            needed = np.maximum(needed, ((1 - left) ** 2 / left) ** 2 / (_REGION - far**2))
        for other in {*range(k, shared.shape[1], count)} - {row}:
            slope = total[:, other, row] / np.maximum(variance, _NONE**2)
            total[:, other, other] += (slope * force) ** 2 * needed
    return total


def _relative(variance: Floats, force: Floats) -> Floats:
    """Relative deviations of forces."""
    return np.asarray(np.sqrt(np.maximum(variance, 0)) / np.maximum(np.abs(force), _NONE))
