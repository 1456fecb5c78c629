"""Readings of a few contacts on a pad from tables of one, with derivatives.

One contact's readings are the table's spline. Changes of the reciprocal readings of several
add up, but for a few per cent of them: what is missing is taken from the solved state at
contacts nearby, as a correction that is kept while they move::

    u(x) = u_rest + sum_c (u_c(x_c) - u_rest) + correction

Columns of readings ("channels") are all taxels and, last, the oil's pressure.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fitting.inverse_load.pad.table import LEVELS, PadTable

LEAST, MOST = -0.3, 1.06
"""Shares of the table's largest force between which it is used."""
_LEAST_GAP = 1e-3  # smallest u in terms of that at rest


class Interpolated(NamedTuple):
    """What the interpolant says; frames lead.

    Attributes:
        readings: [frame, channel] [counts], [Pa].
        jacobian: by the parameters [frame, parameter, channel].
        change: of u from rest, of the pressure [frame, channel], not corrected.
    """

    readings: NDArray[np.float64]
    jacobian: NDArray[np.float64]
    change: NDArray[np.float64]


class PadInterpolant:
    """The interpolant of one pad.

    Args:
        tables: of one diameter, or of several, ascending: then the diameter is a parameter,
            and readings are polynomials of its square.
    """

    def __init__(self, tables: tuple[PadTable, ...]) -> None:
        self.tables = tables
        first = tables[0]
        self._stray = first.stray
        self._rest = 1 / (first.rest - first.stray)
        self._squares = np.array([table.diameter**2 for table in tables])

    @property
    def per_contact(self) -> int:
        """Parameters of a contact."""
        return 3 + (len(self.tables) > 1)

    @property
    def rest(self) -> NDArray[np.float64]:
        """Channels at rest."""
        return np.append(self.tables[0].rest, 0.0)

    def largest(self, angle: NDArray[np.float64], axial: NDArray[np.float64]) -> NDArray:
        """Largest force of the tables at places [N]."""
        return np.asarray(
            np.min([np.exp(t.largest(angle, axial)[0][:, 0]) for t in self.tables], 0)
        )

    def __call__(
        self,
        parameters: NDArray[np.float64],
        contacts: int,
        correction: NDArray[np.float64] | float = 0.0,
    ) -> Interpolated:
        """Readings and derivatives.

        Args:
            parameters: [frame, parameter], all of a name together.
            contacts: their number.
            correction: of u and the pressure [frame, channel].
        """
        frames, taxels = len(parameters), len(self._rest)
        by_contact = parameters.reshape(frames, -1, contacts)
        change = np.zeros((frames, taxels + 1))
        slopes = np.zeros((frames, self.per_contact, contacts, taxels + 1))
        for c in range(contacts):
            value, slope = self._one(by_contact[:, :, c])
            change += value
            slopes[:, :, c] = slope
        total = change + correction
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

    def _one(self, x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
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
    table: PadTable,
    angle: NDArray[np.float64],
    axial: NDArray[np.float64],
    force: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    log_cap, by_place = table.largest(angle, axial)
    cap = np.exp(log_cap[:, 0])
    share = force / cap
    inside = np.clip(share, LEVELS[0] * 2, MOST + 0.1)
    value, slopes = table.spline(angle, axial, inside)
    by_share = slopes[:, 2]
    # Beyond the table the last slope goes on.
    value = value + by_share * (share - inside)[:, None]
    slopes[:, :2] -= by_share[:, None] * (share[:, None] * by_place[:, :, 0])[..., None]
    slopes[:, 2] = by_share / cap[:, None]
    return value, slopes


def _lagrange(
    nodes: NDArray[np.float64], x: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lagrange polynomials and their slopes [place, node]."""
    powers = np.vander(nodes / nodes[-1], increasing=True)
    inverse = np.linalg.inv(powers)
    count = len(nodes)
    at = np.vander(x / nodes[-1], count, increasing=True)
    slope = np.zeros_like(at)
    slope[:, 1:] = at[:, :-1] * np.arange(1, count) / nodes[-1]
    return at @ inverse, slope @ inverse
