"""Changes of a section's readings under one contact, tabulated over the states of `LoadTable`.

Near the wall readings change steeply, and so do their derivatives by anything. The table
holds, state by state, the change of the contact that does most nearly what something else
does, and the little that is left; both change slowly from state to state::

    S = J g + S'        J of the frame's own contact, g and S' from the table
"""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from fitting.arrays import Floats
from fitting.inverse_load.search.table import LoadTable

_RIDGE = 1e-12  # of squared cosines: where angle and force do the same


@dataclass(frozen=True)
class TabulatedChanges:
    """What some changes do to readings under one radial contact."""

    table: LoadTable
    # the change of a contact's angle and, per newton, of its force that does most of it
    # [angle, force, change, 2]
    alike: NDArray[Any]
    # what no change of the contact does, per newton [angle, force, change, taxel]
    left: NDArray[Any]

    @classmethod
    def of(cls, table: LoadTable, moved: Floats) -> Self:
        """Those that move readings by so much [angle, force, change, taxel]."""
        force = table.forces[..., None, None]
        jacobian = table.slopes[:, :, :2]
        alike = most_alike(jacobian, moved)
        left = (moved - alike @ jacobian) / force
        alike[..., 1] /= force[..., 0]
        return cls(table, *(_filled(x).astype(np.float32) for x in (alike, left)))

    def at(self, angle: Floats, force: Floats) -> tuple[Floats, Floats]:
        """The change of contacts [frame, change, 2], what is left [frame, change, taxel]."""
        table = self.table
        by_angle, by_log = table.steps
        place = np.clip((angle - table.angles[0]) / by_angle, 0, len(table.angles) - 1)
        low = np.minimum(place.astype(int), len(table.angles) - 2)
        left = np.zeros((len(angle), *self.left.shape[2:]))
        alike = np.zeros((len(angle), *self.alike.shape[2:]))
        positive = np.maximum(np.abs(force), 1e-12)
        last = table.forces.shape[1] - 1
        for i, share in ((low, low + 1 - place), (low + 1, place - low)):
            level = np.clip(np.log(positive / table.forces[i, 0]) / by_log, 0, last)
            k = np.minimum(level.astype(int), last - 1)
            for level_of, part in ((k, share * (k + 1 - level)), (k + 1, share * (level - k))):
                weight = part[:, None, None]
                left += weight * self.left[i, level_of]
                alike += weight * self.alike[i, level_of]
        alike[:, :, 1] *= force[:, None]
        return alike, left * force[:, None, None]

    def under(self, angle: Floats, force: Floats, jacobian: Floats) -> Floats:
        """Changes of readings [frame, change, taxel].

        The contact has an angle [frame, rad] and a force [frame, N]; the jacobian has the
        derivatives of the readings by the two [frame, 2, taxel].
        """
        alike, left = self.at(angle, force)
        return np.asarray(left + alike @ np.nan_to_num(jacobian))


def most_alike(jacobian: Floats, moved: Floats) -> Floats:
    """Changes of a contact that come nearest to changes of readings [..., change, 2].

    The jacobian is that of readings by the contact [..., 2, taxel]; `moved` are the changes
    of readings [..., change, taxel].
    """
    size = np.sqrt((jacobian**2).sum(-1, keepdims=True))
    unit = jacobian / np.where(size > 0, size, 1.0)
    across = np.swapaxes(unit, -1, -2)
    normal = unit @ across + _RIDGE * np.eye(jacobian.shape[-2])
    found = np.linalg.solve(normal, np.swapaxes(moved @ across, -1, -2))
    return np.asarray(np.swapaxes(found / np.where(size > 0, size, np.inf), -1, -2))


def _filled(values: Floats) -> Floats:
    """Where no state was found at a force, the values at less force [angle, force, ...]."""
    for k in range(1, values.shape[1]):
        values[:, k] = np.where(np.isfinite(values[:, k]), values[:, k], values[:, k - 1])
    return np.nan_to_num(values)
