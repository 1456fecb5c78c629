"""Readings of a few contacts on a pad from a table of one, with derivatives.

One contact's readings are the table's spline. Changes of the reciprocal readings of several
add up, but for a few per cent of them: what is missing is taken from the solved state at
contacts nearby, as a correction that is kept while they move::

    u(x) = u_rest + sum_c (u_c(x_c) - u_rest) + correction

A contact of another extent than the table's disc is the mean of such discs over a box, the
second moments of whose points are what the contact's has more than the disc's; where it is
smaller, that is an extrapolation. With d_1 and d_2 the diameters along arc and axis of the even
ellipse of the same second moments, d_0 that of the disc::

    v_k = (d_k^2 - d_0^2) / 16,   d_1 = d exp(s),   d_2 = d exp(-s)

How much stiffer or softer a dent becomes as it grows follows from its depth, so a contact whose
dent is r times less deep than the disc's reads r times what it would under the r-th part of its
force (against solved discs of 30 mm: forces to 2 %, where r = 1 is up to 10 % off).

A slender contact that lies askew is such boxes along a line, by Gauss' quadrature: the boxes
have the short diameter, the line what the long one has more, turned from the arc towards the
axis.

What tangential components add is linear, with the table's own slopes.

Columns of readings ("channels") are all taxels and, last, the oil's pressure.
"""

import functools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline

from fitting.arrays import Floats
from fitting.inverse_load.pad.table import LEVELS, PadTable

LEAST, MOST = float(LEVELS[0]), 1.2
"""Shares of the table's largest force between which it is used, over first contact at most."""
PLAIN, WHOLE, ASKEW = 3, 7, 8
"""Parameters of a contact that is the table's disc under a radial force (angle, axial position,
inward force), of any (also the diameter d [m], the slenderness s, and the tangential components
along arc and axis over the inward force), and of one askew (also its turn [rad])."""
_LINE = np.polynomial.legendre.leggauss(4)  # places and weights of boxes along a line
_WIDEST = 25e-3  # largest standard deviation of a contact's pressure with its own relief [m]
_LEAST_GAP = 1e-3  # smallest u in terms of that at rest


class Correction(NamedTuple):
    """What the interpolant leaves out at some contacts."""

    parameters: Floats  # of the contacts [parameter]
    change: Floats  # to add to u and the oil's pressure [channel]
    min_gap: float  # between membrane and wall there [m]


class _Cap(NamedTuple):
    """Largest forces of the table at places."""

    force: Floats  # [place] [N]
    by_place: Floats  # slopes of its logarithm by angle and axial position [place, 2]


class Interpolated(NamedTuple):
    """What the interpolant says; frames lead."""

    readings: Floats  # [frame, channel] [counts], [Pa]
    jacobian: Floats  # by the parameters [frame, parameter, channel]
    change: Floats  # of u from rest, of the pressure [frame, channel], not corrected


class PadInterpolant:
    """The interpolant of one pad.

    The table has the pad's states; the radius is that of the outer face [m], needed where
    extents are told.
    """

    def __init__(self, table: PadTable, radius: float = float("nan")) -> None:
        self.table = table
        self.metres = np.array([radius, 1.0])
        """Of a unit of place [m]."""
        self._stray = table.stray
        self._rest = 1 / (table.rest - table.stray)

    @property
    def rest(self) -> Floats:
        """Channels at rest."""
        return np.append(self.table.rest, 0.0)

    def largest(self, angle: Floats, axial: Floats) -> NDArray:
        """Largest force of the table at places [N]."""
        return np.asarray(np.exp(self.table.largest.values(angle, axial)[:, 0]))

    def __call__(
        self, parameters: Floats, contacts: int, correction: Correction | None = None
    ) -> Interpolated:
        """Readings and derivatives.

        Parameters are [frame, parameter], all of a name together, PLAIN or WHOLE of them a
        contact. The correction is that of u and the pressure; there is none where it is not
        given.
        """
        frames, taxels = len(parameters), len(self._rest)
        by_contact = parameters.reshape(frames, -1, contacts)
        change = np.zeros((frames, taxels + 1))
        slopes = np.zeros((frames, by_contact.shape[1], contacts, taxels + 1))
        kinds = {PLAIN: self._plain, WHOLE: self._whole, ASKEW: self._askew}
        one = kinds[by_contact.shape[1]]
        for c in range(contacts):
            value, slope = one(by_contact[:, :, c])
            change += value
            slopes[:, :, c] = slope
        total = change if correction is None else change + correction.change
        readings, by_u = self._read(total)
        jacobian = slopes.reshape(frames, -1, taxels + 1)
        jacobian[..., :taxels] *= by_u[:, None]
        return Interpolated(readings, jacobian, change)

    def _read(self, change: Floats) -> tuple[Floats, Floats]:
        """Readings by the change of u and the pressure [frame, channel], slopes by u."""
        taxels = len(self._rest)
        u = self._rest + change[:, :taxels]
        least = _LEAST_GAP * self._rest
        open_ = u > least
        u = np.maximum(u, least)
        readings = np.concatenate([self._stray + 1 / u, change[:, taxels:]], 1)
        return readings, np.where(open_, -1 / u**2, 0.0)

    def summed(self, contacts: Floats) -> Floats:
        """Readings of groups of any size, not corrected [group, channel].

        `contacts`: their parameters [group, contact, WHOLE].
        """
        groups, count, _ = contacts.shape
        change = np.zeros((groups, len(self._rest) + 1))
        if count:
            each = self(contacts.reshape(groups * count, WHOLE), 1).change
            change = each.reshape(groups, count, -1).sum(1)
        return self._read(change)[0]

    def left_out(
        self, parameters: Floats, contacts: int, so: Floats, pressure: float, gap: float
    ) -> Correction:
        """What the interpolant leaves out of a solved state.

        A taxel that the membrane touches is left to the interpolant.

        The state has contacts [parameter], readings [taxel] [counts], a pressure of the oil
        [Pa] and a smallest gap [m].
        """
        change = np.append(1 / (so - self._stray) - self._rest, pressure)
        own = self(parameters[None], contacts).change[0]
        missing = np.where(np.isfinite(change), change - own, 0.0)
        return Correction(parameters.copy(), missing, gap)

    def _plain(self, x: Floats) -> tuple[Floats, Floats]:
        """Change of u by the table's disc [frame, channel], and its slopes."""
        cap = self._cap(x)
        share = x[:, 2] / cap.force
        inside = _inside(share)
        value, slopes = self.table.spline(*x[:, :2].T, inside)
        return _beyond(value, slopes, inside, share, cap)

    def _whole(self, x: Floats) -> tuple[Floats, Floats]:
        """The same of a contact of any extent, under a force of any direction."""
        diameters = x[:, 3:4] * np.exp(np.stack([x[:, 4], -x[:, 4]], 1))
        excess = (diameters**2 - self.table.diameter**2) / 16
        cap, relief = self._cap(x), self.relief(excess)
        value, slopes = self._boxes(x, cap, relief, np.zeros((len(x), 2)), excess, excess)
        by_excess = (slopes[:, 3:5] + slopes[:, 5:7]) * (diameters**2 / 8)[..., None]
        by_diameter = by_excess.sum(1, keepdims=True) / x[:, 3, None, None]
        shape = np.concatenate([by_diameter, by_excess[:, :1] - by_excess[:, 1:]], 1)
        return self._pulled(x, cap, value, slopes[:, :PLAIN], shape)

    def _askew(self, x: Floats) -> tuple[Floats, Floats]:
        """The same of a slender contact at any angle."""
        diameter, slender, turn = x[:, 3], x[:, 4], x[:, 7]
        short = diameter**2 * np.exp(-2 * slender) / 16
        line = diameter**2 * np.sinh(2 * slender) / 8
        half = np.sqrt(3 * np.maximum(line, 1e-12))
        way = np.stack([np.cos(turn), np.sin(turn)], 1)
        box = np.tile((short - self.table.diameter**2 / 16)[:, None], (1, 2))
        excess = box + line[:, None] * way**2
        cap, relief = self._cap(x), self.relief(excess)
        size = len(x), self.table.u.shape[-1] + 1
        value, rows = np.zeros(size), np.zeros((len(x), 9, size[1]))
        by_half, by_turn = np.zeros(size), np.zeros(size)
        for t, share in zip(*_LINE, strict=True):
            shift = t * half[:, None] * way
            own, slopes = self._boxes(x, cap, relief, shift, box, excess)
            value, rows = value + share / 2 * own, rows + share / 2 * slopes
            by_metre = slopes[:, 7:] / self.metres[:, None]
            by_half = by_half + share / 2 * t * (way[..., None] * by_metre).sum(1)
            side = np.stack([-way[:, 1], way[:, 0]], 1)[..., None]
            by_turn = by_turn + share / 2 * t * half[:, None] * (side * by_metre).sum(1)
        along = (way**2)[..., None] * rows[:, 5:7]
        by_line = 1.5 / half[:, None] * by_half + along.sum(1)
        by_box = rows[:, 3:7].sum(1)
        by_turn = by_turn + (line * np.sin(2 * turn))[:, None] * (rows[:, 6] - rows[:, 5])
        shape = [
            2 * (short[:, None] * by_box + line[:, None] * by_line) / diameter[:, None],
            -2 * short[:, None] * by_box
            + (diameter**2 * np.cosh(2 * slender) / 4)[:, None] * by_line,
        ]
        value, slopes = self._pulled(x, cap, value, rows[:, :PLAIN], np.stack(shape, 1))
        return value, np.concatenate([slopes, by_turn[:, None]], 1)

    def _boxes(
        self,
        x: Floats,  # parameters of the contacts, whose places and forces count
        cap: _Cap,  # largest forces at their places
        reliefs: tuple[Floats, Floats],  # `relief` of the excess
        shift: Floats,  # of the boxes [contact, 2] [m]
        box: Floats,  # second moments of the boxes, along arc and axis [contact, 2] [m^2]
        excess: Floats,  # those of the whole contacts beyond the disc's, likewise
    ) -> tuple[Floats, Floats]:
        """Change of u by discs over boxes beside contacts' places, as dents of theirs respond.

        Returns the change [contact, channel], and slopes by place, force, box, excess and the
        boxes' middle alone [contact, 9, channel].
        """
        relief, by_excess = reliefs
        force = x[:, 2] / relief
        share = force / cap.force
        inside = _inside(share)
        # The discs' forces are the same shares of the largest ones: their centre is moved.
        middle = x[:, :2] + shift / self.metres - excess / self.metres**2 * cap.by_place
        value, slopes = self.table.spline.over(middle, box / self.metres**2, inside)
        by_middle = relief[:, None, None] * slopes[:, :2]
        value, plain = _beyond(value, slopes[:, :3], inside, share, cap)
        by_relief = (value - force[:, None] * plain[:, 2])[:, None]
        plain[:, :2] *= relief[:, None, None]
        by_box = relief[:, None, None] * slopes[:, 3:] / self.metres[:, None] ** 2
        shifted = (cap.by_place / self.metres**2)[..., None] * by_middle
        rows = (plain, by_box, by_excess[..., None] * by_relief - shifted, by_middle)
        return relief[:, None] * value, np.concatenate(rows, 1)

    def _pulled(
        self, x: Floats, cap: _Cap, value: Floats, plain: Floats, shape: Floats
    ) -> tuple[Floats, Floats]:
        """Change of u and slopes with what tangential forces add."""
        share = x[:, 2] / cap.force
        inside = _inside(share)
        across, slopes = (
            y.reshape(*y.shape[:-1], 2, -1) for y in self.table.tangential(*x[:, :2].T, inside)
        )
        force, tangents = x[:, 2, None], x[:, 5:7]
        along = (tangents[:, None] @ across)[:, 0]
        moved = (tangents[:, None, None] @ slopes)[:, :, 0]  # by place and share
        moved[:, 2] *= (inside == share)[:, None]
        moved[:, :2] -= moved[:, 2:] * (share[:, None] * cap.by_place)[..., None]
        moved[:, 2] /= cap.force[:, None]
        plain = plain + force[..., None] * moved
        plain[:, 2] += along
        rows = (plain, shape, force[..., None] * across)
        return value + force * along, np.concatenate(rows, 1)

    def reliefs(self, parameters: Floats, contacts: int) -> Floats:
        """`relief` of contacts [frame, contact] by their parameters [frame, parameter]."""
        x = parameters.reshape(len(parameters), -1, contacts)
        turn = x[:, 7] if x.shape[1] == ASKEW else 0.0
        diameters = extents(x[:, 3], x[:, 4], turn).reshape(2, -1).T
        excess = (diameters**2 - self.table.diameter**2) / 16
        return self.relief(excess)[0].reshape(-1, contacts)

    def relief(self, excess: Floats) -> tuple[Floats, Floats]:
        """Depth of the disc's dent over that of another contact of the same force.

        The excess is the contact's second moments beyond the disc's, along arc and axis
        [contact, 2] [m^2].
        Returns the ratio, above one where it is wider [contact], and its derivatives
        [contact, 2].
        """
        low, high = -(self.table.diameter**2) / 16, _WIDEST**2
        known = np.minimum(np.maximum(excess, low), high)
        ratio = np.exp(self._log_relief.ev(*known.T))
        slopes = [self._log_relief.ev(*known.T, dx=1 - k, dy=k) for k in range(2)]
        by_excess = np.where(known == excess, np.stack(slopes, 1), 0.0)
        return ratio, ratio[:, None] * by_excess

    @functools.cached_property
    def _log_relief(self) -> RectBivariateSpline:
        """Its logarithm by second moments beyond the disc's, in the pad's middle."""
        least = self.table.diameter**2 / 16  # of a point
        excess = np.concatenate([[-least, -least / 2], np.linspace(0.0, _WIDEST, 12) ** 2])
        variance = excess / self.metres[:, None] ** 2
        level = LEVELS[LEVELS > 0][0]
        change = self.table.spline.over_grid(np.zeros(2), variance, level)
        depth = np.abs(change[..., :-1]).max(-1)
        disc = int(np.flatnonzero(excess == 0)[0])
        return RectBivariateSpline(excess, excess, np.log(depth[disc, disc] / depth))

    def _cap(self, x: Floats) -> _Cap:
        """Largest forces at the places of contacts [contact, parameter]."""
        logarithm, by_place = self.table.largest(*x[:, :2].T)
        return _Cap(np.exp(logarithm[:, 0]), by_place[:, :, 0])


def _inside(share: Floats) -> Floats:
    """Shares of the largest force as far as the table goes."""
    return np.minimum(np.maximum(share, LEAST), MOST)


def _beyond(
    value: Floats, slopes: Floats, inside: Floats, share: Floats, cap: _Cap
) -> tuple[Floats, Floats]:
    """Values with the last slope going on beyond the table, and slopes by place and force."""
    by_share = slopes[:, 2]
    value = value + by_share * (share - inside)[:, None]
    by_force = by_share / cap.force[:, None]
    moved = slopes[:, :2] - by_share[:, None] * (share[:, None] * cap.by_place)[..., None]
    return value, np.concatenate([moved, by_force[:, None]], 1)


def extents(diameter: Floats, slender: Floats, turn: Floats | float) -> Floats:
    """Diameters along arc and axis of ellipses [2, ...] [m]."""
    long, short = (diameter**2 * np.exp(2 * sign * slender) for sign in (1, -1))
    cos, sin = np.cos(turn) ** 2, np.sin(turn) ** 2
    return np.sqrt([long * cos + short * sin, long * sin + short * cos])
