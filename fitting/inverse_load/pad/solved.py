"""Solved states of several contacts: what the interpolant is corrected by."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.pad.interpolant import ASKEW, PLAIN, Correction, PadInterpolant

if TYPE_CHECKING:
    from suas_jax.scene.skin import Skin

# Live, a correction is kept while contacts move by less than this and forces, extents and turns
# change by that share; in a log by a fifth of that.
_NEAR, _SHARE = 2.5e-3, 0.15
_STRICT = 0.2


def near(
    kept: Correction, parameters: Floats, contacts: int, radius: float, *, live: bool
) -> bool:
    """Whether a correction holds well enough for other contacts.

    Parameters are those of the other contacts [parameter]; the radius is that of the outer face
    [m]. Live, time counts more than accuracy.
    """
    share = 1.0 if live else _STRICT
    if len(kept.parameters) != len(parameters):
        return False
    old, new = (x.reshape(-1, contacts).T for x in (kept.parameters, parameters))
    moved = np.hypot(radius * (old[:, 0] - new[:, 0]), old[:, 1] - new[:, 1])
    change = np.abs(old[:, 2] - new[:, 2])
    still = (moved < share * _NEAR) & (change < share * _SHARE * np.abs(new[:, 2]))
    if len(old[0]) == PLAIN:
        return bool(still.all())
    rows = [4, ASKEW - 1] if len(old[0]) == ASKEW else [4]
    shape = np.append(np.log(new[:, 3] / old[:, 3]), new[:, rows] - old[:, rows])
    return bool(still.all()) and bool((np.abs(shape) < share * _SHARE).all())


class SolvedContacts:
    """Solves contacts on a pad; one compiled program for any number of them.

    The interpolant is what is corrected; there are at most `most_contacts` at a time. The skin
    is made when they are first solved.
    """

    def __init__(
        self, skin: "Callable[[], Skin]", interpolant: PadInterpolant, most_contacts: int
    ) -> None:
        self._skin, self._interpolant = skin, interpolant
        self._most = max(most_contacts, 2)

    def correction(self, parameters: Floats, contacts: int) -> Correction | None:
        """Solve some contacts of the table's diameter; None where no state was found.

        The parameters are angles, axial positions and inward forces [parameter].
        """
        from suas_jax.scene.forward import forward
        from suas_jax.scene.loads import Loads

        rows, table = parameters.reshape(-1, contacts), self._interpolant.table
        # What is not used lies where the first one is, without a force.
        columns = np.array([np.append(x, np.full(self._most - contacts, x[0])) for x in rows])
        columns[2, contacts:] = 0.0
        columns[2, :contacts] = table.force_on_mesh(*columns[:, :contacts])
        angle, axial, force = columns[..., None]
        found = forward(self._skin(), Loads.patch(angle, axial, force, table.diameter))
        if not bool(found.solved[0]):
            return None
        numbers = float(found.oil_pressure[0]), float(found.min_gap[0])
        so = np.asarray(found.so)[:, 0]
        return self._interpolant.left_out(parameters, contacts, so, *numbers)
