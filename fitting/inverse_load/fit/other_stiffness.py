"""What is beyond first order where a skin is much softer or stiffer than its file says.

The same readings are the same shape. What it takes to keep a shape changes linearly with the
stress at rest: the force F, and F (a - a0), which is what the force at a place a does in excess
of itself at a0. Forces are linear in the errors up to shares of one; two other things are not.

- **Places** are linear in the errors over the force. With rho = sigma_F / F, r = C_aF / C_FF
  and a force of k F, k = 1 - rho t at t deviations, the true place lies off the line of the
  ellipse by d = r F (1 - k)^2 / k. Its variance grows until ellipses of 99.9 % hold the points
  `_FAR` deviations away, or half the stiffness.
- **Residuals** that an error leaves are those of a stiffer skin: an error that changes the
  force by a share s shows in them as 1 / (1 + s t) of what it does to first order, so that
  frames tell less of it.
"""

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.fit.systematic import ErrorsOfFrames

_FAR = 3.0  # standard deviations of the force
_SOFTEST = 0.5  # share of the stiffness; skins that lose more buckle before they are touched
_REGION = 13.8  # chi2 of 99.9 % in place and force
_TOLD = 2.0  # standard deviations at which an error's residuals are taken
_NONE = 1e-12  # stands for no force, and no deviation of it


def less_told(found: ErrorsOfFrames, best: Explanations) -> ErrorsOfFrames:
    """What frames say about the errors, where residuals are those of stiffer skins."""
    count = int(best.contacts[0])
    forces = slice(count, 2 * count)
    total = np.abs(best.parameters[:, forces]).sum(1)[:, None]
    share = np.abs(found.gain[:, forces].sum(1)) / np.maximum(total, _NONE)
    shown = 1 / (1 + _TOLD * share)
    left = shown[:, :, None] * found.left * shown[:, None]
    pull = shown * found.pull
    spread = np.asarray(np.linalg.inv(np.eye(left.shape[1]) + left), float)
    likely = (spread @ pull[..., None])[..., 0]
    return found._replace(spread=spread, likely=likely)


def variance_of_places(shared: Floats, best: Explanations, per_contact: int) -> Floats:
    """What errors add to variances of places beyond first order, as covariances.

    `shared` are covariances of the parameters by errors of the inputs, padded [frame,
    parameter, parameter]. Free directions of contacts behave as places do.
    """
    total = 0.0 * shared
    for count in np.unique(best.contacts):
        frames = np.flatnonzero(best.contacts == count)
        for k in range(count):
            row = count + k  # of the force, after the places
            force, variance = best.parameters[frames, row], shared[frames, row, row]
            rho = np.sqrt(np.maximum(variance, 0.0)) / np.maximum(np.abs(force), _NONE)
            softer = np.minimum(_FAR, (1 - _SOFTEST) / np.maximum(rho, _NONE))
            needed = np.zeros(len(frames))
            for far in (softer, -_FAR):
                left = 1 - rho * far
                needed = np.maximum(needed, ((1 - left) ** 2 / left) ** 2 / (_REGION - far**2))
            for other in {*range(k, per_contact * int(count), int(count))} - {row}:
                slope = shared[frames, other, row] / np.maximum(variance, _NONE**2)
                total[frames, other, other] += (slope * force) ** 2 * needed
    return total
