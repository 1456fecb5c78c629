"""Solved states of several contacts: what the interpolant is corrected by."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from fitting.inverse_load.pad.interpolant import PadInterpolant
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.pad_forward import PadSkin, Patches, readings

READ = eqx.filter_jit(readings)
"""The readings of solved contacts, to be run by `COMPILED`."""
# Live, a correction is kept while contacts move by less than this and forces change by that
# share; in a log by a fifth of that.
_NEAR, _SHARE = 2.5e-3, 0.15
_STRICT = 0.2


class Correction(NamedTuple):
    """What the interpolant leaves out at some contacts.

    Attributes:
        parameters: of the contacts [parameter].
        change: to add to u and the oil's pressure [channel].
        min_gap: between membrane and wall there [m].
    """

    parameters: NDArray[np.float64]
    change: NDArray[np.float64]
    min_gap: float

    def near(
        self, parameters: NDArray[np.float64], contacts: int, radius: float, *, live: bool
    ) -> bool:
        """Whether it holds well enough for other contacts.

        Args:
            parameters: of the contacts [parameter].
            contacts: their number.
            radius: of the outer face [m].
            live: whether time counts more than accuracy.
        """
        share = 1.0 if live else _STRICT
        old, new = (x.reshape(-1, contacts) for x in (self.parameters, parameters))
        moved = np.hypot(radius * (old[0] - new[0]), old[1] - new[1])
        force = np.abs(old[2] - new[2])
        still = (moved < share * _NEAR) & (force < share * _SHARE * np.abs(new[2]))
        return bool(still.all())


class SolvedContacts:
    """Solves contacts on a pad; one compiled program for any number of them.

    Args:
        skin: the pad.
        interpolant: that is corrected.
        most_contacts: most at a time.
        diameter: of the contacts where it is no parameter [m].
    """

    def __init__(
        self, skin: PadSkin, interpolant: PadInterpolant, most_contacts: int, diameter: float
    ) -> None:
        self._skin, self._interpolant = skin, interpolant
        self._most, self._diameter = max(most_contacts, 2), diameter
        table = interpolant.tables[0]
        self._stray, self._rest = table.stray, 1 / (table.rest - table.stray)

    def correction(self, parameters: NDArray[np.float64], contacts: int) -> Correction | None:
        """Solve some contacts; None where no state was found.

        Args:
            parameters: [parameter], all of a name together.
            contacts: their number.
        """
        columns = np.full((4, self._most), self._diameter)
        by_name = parameters.reshape(-1, contacts)
        columns[: len(by_name), :contacts] = by_name
        # What is not used lies where the first one is, without a force.
        columns[:, contacts:] = columns[:, :1]
        columns[2, contacts:] = 0.0
        patches = Patches(*(jnp.asarray(row) for row in columns))
        used = Patches(*(jnp.asarray(row[:contacts]) for row in columns))
        plan = self._skin.plan(used, slots=self._most)
        found = COMPILED.run(READ, self._skin, patches, plan)
        if not bool(found.found):
            return None
        u = 1 / (np.asarray(found.so) - self._stray)
        change = np.append(u - self._rest, float(found.pressure))
        own = self._interpolant(parameters[None], contacts).change[0]
        # A taxel that the membrane touches is left to the interpolant.
        missing = np.where(np.isfinite(change), change - own, 0.0)
        return Correction(parameters.copy(), missing, float(found.min_gap))
