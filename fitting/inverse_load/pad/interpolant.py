"""Readings of a few contacts on a pad from tables of one, with derivatives.

One contact's readings are the table's spline. Changes of the reciprocal readings of several
add up, but for a few per cent of them: what is missing is taken from the solved state at
contacts nearby, as a correction that is kept while they move::

    u(x) = u_rest + sum_c (u_c(x_c) - u_rest) + correction

Where directions are free, a contact is the table's under its radial component alone; what its
tangential components add is linear, with slopes from solved states nearby.

Columns of readings ("channels") are all taxels and, last, the oil's pressure.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fitting.arrays import Floats
from fitting.inverse_load.model.contact_parameters import pad_parameters
from fitting.inverse_load.pad.columns import LEVELS
from fitting.inverse_load.pad.table import PadTable

LEAST, MOST = -0.3, 1.2
"""Shares of the table's largest force between which it is used, over first contact at most."""
_LEAST_GAP = 1e-3  # smallest u in terms of that at rest


class Correction(NamedTuple):
    """What the interpolant leaves out at some contacts.

    Attributes:
        parameters: of the contacts [parameter].
        change: to add to u and the oil's pressure [channel].
        min_gap: between membrane and wall there [m].
        across: derivatives of u and the oil's pressure by the tangential components of the
            forces, along arc and axis [contact, component, channel]; None where forces are
            radial.
    """

    parameters: Floats
    change: Floats
    min_gap: float
    across: Floats | None = None


def force_components(x: Floats) -> Floats:
    """Radial force and those along arc and axis [N], of contacts with a direction.

    Args:
        x: of contacts: parameters [..., parameter], force third, direction and tilt last.
    """
    force, turn, tilt = x[..., 2], x[..., -2], x[..., -1]
    plane = force * np.cos(tilt)
    return np.stack([plane * np.cos(turn), plane * np.sin(turn), force * np.sin(tilt)], -1)


class Interpolated(NamedTuple):
    """What the interpolant says; frames lead.

    Attributes:
        readings: [frame, channel] [counts], [Pa].
        jacobian: by the parameters [frame, parameter, channel].
        change: of u from rest, of the pressure [frame, channel], not corrected.
    """

    readings: Floats
    jacobian: Floats
    change: Floats


class PadInterpolant:
    """The interpolant of one pad.

    Args:
        tables: of one diameter, or of several, ascending: then the diameter is a parameter,
            and readings are polynomials of its square.
        direction: whether turn and tilt of the forces are parameters.
    """

    def __init__(self, tables: tuple[PadTable, ...], *, direction: bool = False) -> None:
        self.tables, self.direction = tables, direction
        self.parameters = pad_parameters(diameter=len(tables) > 1, direction=direction)
        first = tables[0]
        self._stray = first.stray
        self._rest = 1 / (first.rest - first.stray)
        self._squares = np.array([table.diameter**2 for table in tables])

    @property
    def rest(self) -> Floats:
        """Channels at rest."""
        return np.append(self.tables[0].rest, 0.0)

    def largest(self, angle: Floats, axial: Floats) -> NDArray:
        """Largest force of the tables at places [N]."""
        return np.asarray(
            np.min([np.exp(t.largest(angle, axial)[0][:, 0]) for t in self.tables], 0)
        )

    def __call__(
        self, parameters: Floats, contacts: int, correction: Correction | None = None
    ) -> Interpolated:
        """Readings and derivatives.

        Args:
            parameters: [frame, parameter], all of a name together.
            contacts: their number.
            correction: of u and the pressure; none where not given.
        """
        frames, taxels = len(parameters), len(self._rest)
        by_contact = parameters.reshape(frames, -1, contacts)
        change = np.zeros((frames, taxels + 1))
        slopes = np.zeros((frames, self.parameters.per_contact, contacts, taxels + 1))
        across = None if correction is None else correction.across
        for c in range(contacts):
            own = None if across is None else across[c]
            value, slope = self._turned(by_contact[:, :, c], own)
            change += value
            slopes[:, :, c] = slope
        total = change if correction is None else change + correction.change
        u = self._rest + total[:, :taxels]
        least = _LEAST_GAP * self._rest
        open_ = u > least
        u = np.maximum(u, least)
        so = self._stray + 1 / u
        by_u = np.where(open_, -1 / u**2, 0.0)
        readings = np.concatenate([so, total[:, taxels:]], 1)
        jacobian = slopes.reshape(frames, -1, taxels + 1)
        jacobian[..., :taxels] *= by_u[:, None]
        return Interpolated(readings, jacobian, change)

    def _turned(self, x: Floats, across: Floats | None) -> tuple[Floats, Floats]:
        """The same of a contact whose force may not be radial.

        Args:
            x: parameters [frame, parameter].
            across: slopes by its tangential forces [component, channel]; zero if None.
        """
        if not self.direction:
            return self._one(x)
        components = force_components(x)
        base = x[:, :-2].copy()
        base[:, 2] = components[:, 0]
        value, slope = self._one(base)
        by_force = np.zeros((len(x), 3, value.shape[1]))
        by_force[:, 0] = slope[:, 2]
        if across is not None:
            by_force[:, 1:] = across
            value = value + components[:, 1:] @ across
        force, turn, tilt = x[:, 2], x[:, -2], x[:, -1]
        zero = np.zeros_like(force)
        flat = np.stack([np.cos(turn), np.sin(turn), zero], -1) * force[:, None]
        by_turn = np.cos(tilt)[:, None] * np.stack([-flat[:, 1], flat[:, 0], zero], -1)
        by_tilt = -np.sin(tilt)[:, None] * flat
        by_tilt[:, 2] = force * np.cos(tilt)
        unit = x.copy()
        unit[:, 2] = 1.0
        rows = np.stack([force_components(unit), by_turn, by_tilt], 1) @ by_force
        slope[:, 2] = rows[:, 0]
        return value, np.concatenate([slope, rows[:, 1:]], 1)

    def _one(self, x: Floats) -> tuple[Floats, Floats]:
        """Change of u by one contact [frame, channel], and its slopes [frame, 3 or 4, ...]."""
        found = [_from_table(table, *x[:, :3].T) for table in self.tables]
        if len(found) == 1:
            return found[0]
        share, slope = _lagrange(self._squares, x[:, 3] ** 2)
        values, slopes = (np.stack([f[k] for f in found], 1) for k in (0, 1))
        value = (share[..., None] * values).sum(1)
        by_square = (slope[..., None] * values).sum(1)
        by_others = (share[..., None, None] * slopes).sum(1)
        by_diameter = (2 * x[:, 3:4] * by_square)[:, None]
        return value, np.concatenate([by_others, by_diameter], 1)


def _from_table(
    table: PadTable, angle: Floats, axial: Floats, force: Floats
) -> tuple[Floats, Floats]:
    log_cap, by_place = table.largest(angle, axial)
    cap = np.exp(log_cap[:, 0])
    share = force / cap
    inside = np.clip(share, LEVELS[0] * 2, MOST)
    value, slopes = table.spline(angle, axial, inside)
    by_share = slopes[:, 2]
    # Beyond the table the last slope goes on.
    value = value + by_share * (share - inside)[:, None]
    slopes[:, :2] -= by_share[:, None] * (share[:, None] * by_place[:, :, 0])[..., None]
    slopes[:, 2] = by_share / cap[:, None]
    return value, slopes


def _lagrange(nodes: Floats, x: Floats) -> tuple[Floats, Floats]:
    """Lagrange polynomials and their slopes [place, node]."""
    powers = np.vander(nodes / nodes[-1], increasing=True)
    inverse = np.linalg.inv(powers)
    count = len(nodes)
    at = np.vander(x / nodes[-1], count, increasing=True)
    slope = np.zeros_like(at)
    slope[:, 1:] = at[:, :-1] * np.arange(1, count) / nodes[-1]
    return at @ inverse, slope @ inverse
