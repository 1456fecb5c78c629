"""Solved states of several contacts: what the interpolant is corrected by."""

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.pad.interpolant import Correction, PadInterpolant, force_components
from suas_jax.scene.forward import forward
from suas_jax.scene.loads import Loads
from suas_jax.scene.skin import Skin

# Live, a correction is kept while contacts move by less than this and forces change by that
# share; in a log by a fifth of that.
_NEAR, _SHARE = 2.5e-3, 0.15
_STRICT = 0.2
_SMALL = 0.03  # tangential force of differences in terms of the whole force
_LEAST = 0.01  # and of at least this force [N]


def near(
    kept: Correction, parameters: Floats, contacts: int, radius: float, *, live: bool
) -> bool:
    """Whether a correction holds well enough for other contacts.

    Args:
        kept: the correction.
        parameters: of the contacts [parameter].
        contacts: their number.
        radius: of the outer face [m].
        live: whether time counts more than accuracy.
    """
    share = 1.0 if live else _STRICT
    old, new = (x.reshape(-1, contacts).T for x in (kept.parameters, parameters))
    moved = np.hypot(radius * (old[:, 0] - new[:, 0]), old[:, 1] - new[:, 1])
    if kept.across is None:
        change = np.abs(old[:, 2] - new[:, 2])
    else:
        change = np.linalg.norm(force_components(old) - force_components(new), axis=-1)
    still = (moved < share * _NEAR) & (change < share * _SHARE * np.abs(new[:, 2]))
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
        self, skin: Skin, interpolant: PadInterpolant, most_contacts: int, diameter: float
    ) -> None:
        self._skin, self._interpolant = skin, interpolant
        self._most, self._diameter = max(most_contacts, 2), diameter
        table = interpolant.tables[0]
        self._stray, self._rest = table.stray, 1 / (table.rest - table.stray)

    def correction(
        self, parameters: Floats, contacts: int, kept: Correction | None = None
    ) -> Correction | None:
        """Solve some contacts; None where no state was found.

        Args:
            parameters: [parameter], all of a name together.
            contacts: their number.
            kept: a correction nearby, whose slopes by tangential forces still hold.
        """
        by_contact = parameters.reshape(-1, contacts).T
        found = self._solve(by_contact)
        if found is None:
            return None
        change, gap = found
        across = None
        if self._interpolant.direction:
            across = None if kept is None else kept.across
            if across is None:
                across = self._across(by_contact, change)
        known = Correction(parameters.copy(), np.zeros_like(change), gap, across)
        own = self._interpolant(parameters[None], contacts, known).change[0]
        # A taxel that the membrane touches is left to the interpolant.
        missing = np.where(np.isfinite(change), change - own, 0.0)
        return known._replace(change=missing)

    def _across(self, by_contact: Floats, change: Floats) -> Floats:
        """Differences by small tangential forces at constant radial ones; zero if unknown."""
        slopes = np.zeros((len(by_contact), 2, len(change)))
        for contact in range(len(by_contact)):
            for component in range(2):
                force = force_components(by_contact)
                step = _SMALL * max(float(np.linalg.norm(force[contact])), _LEAST)
                force[contact, 1 + component] += step
                found = self._solve(_along(by_contact, force))
                if found is not None:
                    slopes[contact, component] = np.nan_to_num((found[0] - change) / step)
        return slopes

    def _solve(self, by_contact: Floats) -> tuple[Floats, float] | None:
        """Change of u and the oil's pressure [channel], and smallest gap, under contacts."""
        count = len(by_contact)
        names = self._interpolant.parameters.names
        given = dict(zip(names, by_contact.T, strict=True))
        rows = [given["angle"], given["axial"], given["force"]]
        rows.append(given.get("diameter", np.full(count, self._diameter)))
        if self._interpolant.direction:
            rows += [given["direction"], given["tilt"]]
        # What is not used lies where the first one is, without a force.
        columns = np.array([np.append(x, np.full(self._most - count, x[0])) for x in rows])
        columns[2, count:] = 0.0
        columns[2, :count] = self._interpolant.tables[0].force_on_mesh(*columns[:3, :count])
        found = forward(self._skin, Loads.patch(*columns[..., None]))
        if not bool(found.solved[0]):
            return None
        u = 1 / (np.asarray(found.so)[:, 0] - self._stray)
        change = np.append(u - self._rest, np.asarray(found.oil_pressure))
        return change, float(found.min_gap[0])


def _along(by_contact: Floats, force: Floats) -> Floats:
    """Contacts with other components of their forces."""
    changed = by_contact.copy()
    changed[:, 2] = np.linalg.norm(force, axis=-1)
    changed[:, -2] = np.arctan2(force[:, 1], force[:, 0])
    changed[:, -1] = np.arcsin(force[:, 2] / np.maximum(changed[:, 2], 1e-300))
    return changed
