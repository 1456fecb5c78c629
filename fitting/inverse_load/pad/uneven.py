"""The table of a pad that is not its own mirror image, from that of an even pad.

Thickness and gap of a unit vary by some per cent from place to place. To a contact that is,
nearly, another force on the membrane and another gap under each taxel. So a quarter of the pad
of mean thickness and gap is solved, and of the unit itself only a few places all over it. There
the contact is found under which the even pad reads most alike: loaded more by a share e, and
d away. Both are smooth in between. With u = 1 / (SO - stray) = a + b w, w the displacement over
a taxel, and the states at rest 0 ::

    u(x, F) = u_0 + (b / b_even) (u_even(x + d, F (1 + e)) - u_0,even)
    p(x, F) = c p_even(x + d, F (1 + e)) / (1 + e)

c is what is missing at the solved places. What of the unit is no other contact, a dent of
another width above all, is left out. A few further places between those are solved to tell by
how much contacts and readings are off (`PadTable.doubt`), which widens intervals.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.pad.columns import LEVELS, Column, Columns, grid
from fitting.inverse_load.pad.input_errors import gap_line
from fitting.inverse_load.pad.interpolant import PadInterpolant
from fitting.inverse_load.pad.rest import rest_readings
from fitting.inverse_load.pad.spline import TensorSpline
from fitting.inverse_load.pad.table import PadTable, reciprocal
from suas_jax.config import SkinSpec
from suas_jax.scene.skin import Skin
from suas_jax.skin.plain import angles_at, plain_geometry

PROBES = (7, 5)
"""Places of the unit that are solved, along the arc and along the axis."""
_ROUNDS = 6
_MOST = 0.5  # share of force that e is at most
_FARTHEST = 4e-3  # d is at most, along arc and axis [m]
_SHIFT = 1e-3  # change of d [m] that counts as much as e = 1
_RIDGE = 1e-6  # share of the trace that is added where directions of d and e read alike
_PRESSURE = 0.25  # share of the pressure that c adds or takes at most
# Of the places between the solved ones, counted row by row, every fifth is a further one: no
# divisor of a row's length, so that they lie all over the pad.
_EVERY = 5
_CHUNK = 64  # places that are interpolated at once
_PRESSED = LEVELS != 0


def even_spec(spec: SkinSpec) -> SkinSpec:
    """The same pad with the mean of its thickness and gap everywhere, and equal channels."""
    geometry = spec.geometry
    means = {"thickness": geometry.mean_thickness, "oil_gap": geometry.mean_gap}
    electrodes = spec.electrodes
    assert electrodes is not None
    return spec.model_copy(
        update={
            "geometry": geometry.model_copy(update=means),
            "electrodes": electrodes.with_equal_channels(),
            "calibration": None,
        }
    )


def same_places(spec: SkinSpec, other: SkinSpec) -> Callable[[Floats], Floats]:
    """Angles on another pad from those on one, of places at the same arc of the inner face."""
    section = plain_geometry(spec.geometry).section

    def there(angle: Floats) -> Floats:
        arc = np.asarray(section.arc(jnp.asarray(angle)[:, None]))[:, 0]
        return angles_at(other.geometry, "arc", arc)

    return there


class Line(NamedTuple):
    """u = rest + slope (w - w_0) of every taxel, beside the stray counts."""

    stray: Floats  # [taxel] [counts]
    rest: Floats  # u at rest [taxel] [1/counts]
    slope: Floats  # by the displacement [taxel] [1/counts/m]

    @classmethod
    def of(cls, spec: SkinSpec, skin: Skin) -> "Line":
        """Of a pad."""
        stray, _, slope = gap_line(spec, {})
        return cls(stray, 1 / (rest_readings(skin) - stray), slope)

    def seen_by(self, other: "Line", so: Floats) -> Floats:
        """What the other pad's taxels read where this one's read so [..., taxel] [counts]."""
        change = 1 / (so - self.stray) - self.rest
        return np.asarray(other.stray + 1 / (other.rest + other.slope / self.slope * change))


def force_shares(table: PadTable, places: Floats, force: Floats, found: Column) -> Floats:
    """The share e of the force by which a table's pad is loaded more [place, level].

    e minimises the squares of so(F (1 + e)) - so by Gauss and Newton.

    The table is the even pad's. Places are angle [rad] and axial position [m] [place, 2],
    forces those on the unit [place, level] [N]; `found` is what the unit's states read, seen by
    the table's taxels [place, level, taxel].
    Returns the share; that of the next lighter load where the unit has no state.
    """
    interpolant = PadInterpolant(table)
    count, levels = force.shape
    share = np.zeros_like(force)
    at = np.repeat(places, levels, 0)
    for _ in range(_ROUNDS):
        loads = np.column_stack([at, (force * (1 + share)).reshape(-1)])
        own = interpolant(loads, 1)
        so = own.readings[:, :-1].reshape(found.so.shape)
        slope = own.jacobian[:, 2, :-1].reshape(found.so.shape) * force[..., None]
        good = np.isfinite(found.so)
        left = np.where(good, found.so - so, 0.0)
        slope = np.where(good, slope, 0.0)
        size = np.sum(slope**2, -1)
        step = np.sum(slope * left, -1) / np.where(size > 0, size, 1.0)
        share = np.clip(share + step, -_MOST, _MOST)
    for k in range(levels):
        before = share[:, k - 1] if k else np.zeros(count)
        share[:, k] = np.where(found.found[:, k], share[:, k], before)
    return np.asarray(share)


def contacts_alike(
    table: PadTable, places: Floats, force: Floats, found: Column, radius: float
) -> tuple[Floats, Floats]:
    """What the unit's contacts are on an even pad, and the readings that this leaves.

    See `force_shares`, from which it goes on with places; the radius is of the outer face [m].
    Returns shifts of angle [rad] and axial position [m], shares of force and ratios of the
    pressure [place, level, 4], and what is left of the readings [place, level, taxel].
    """
    interpolant = PadInterpolant(table)
    levels = force.shape[1]
    unit = np.array([_SHIFT / radius, _SHIFT, 1.0])
    most = np.array([_FARTHEST / radius, _FARTHEST, _MOST])
    end = np.array([table.angle[-1], table.axial[-1]])
    shift = np.zeros((*force.shape, 3))
    shift[..., 2] = force_shares(table, places, force, found)
    good = np.isfinite(found.so) & found.found[..., None]
    for _ in range(_ROUNDS):
        so, slope, pressure = _read(interpolant, places, force, shift)
        left = np.where(good, found.so - so, 0.0)
        slope = np.where(good[..., None, :], slope * unit[:, None], 0.0)
        square = slope @ slope.swapaxes(-1, -2)
        size = np.trace(square, axis1=-2, axis2=-1)[..., None, None]
        square = square + np.eye(3) * np.where(size > 0, _RIDGE * size, 1.0)
        step = np.linalg.solve(square, slope @ left[..., None])[..., 0] * unit
        shift = np.clip(shift + step, -most, most)
        there = places[:, None] + shift[..., :2]
        shift[..., :2] += np.clip(there, -end, end) - there
    for k in range(1, levels):
        missing = ~found.found[:, k]
        shift[missing, k] = shift[missing, k - 1]
    so, _, pressure = _read(interpolant, places, force, shift)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = found.pressure * (1 + shift[..., 2]) / pressure
    ratio = np.where(np.isfinite(ratio) & found.found, ratio, 1.0)
    ratio = np.clip(ratio, 1 - _PRESSURE, 1 + _PRESSURE)
    left = np.where(good, found.so - so, 0.0)
    return np.concatenate([shift, ratio[..., None]], -1), left


def _read(
    interpolant: PadInterpolant, places: Floats, force: Floats, shift: Floats
) -> tuple[Floats, Floats, Floats]:
    """Readings of shifted contacts, slopes by the shifts, the pressure."""
    at = places[:, None] + shift[..., :2]
    loads = np.concatenate([at, (force * (1 + shift[..., 2]))[..., None]], -1).reshape(-1, 3)
    own = interpolant(loads, 1)
    so = own.readings[:, :-1].reshape(*force.shape, -1)
    slope = own.jacobian[:, :, :-1].reshape(*force.shape, 3, so.shape[-1]).copy()
    slope[..., 2, :] *= force[..., None]
    return so, slope, own.readings[:, -1].reshape(force.shape)


def uneven_table(
    even: PadTable,  # of the pad of mean thickness and gap
    lines: tuple[Line, Line],  # of that pad, and of the unit
    skin: Skin,  # the unit, with the elements of the table's meshes
    on_unit: Callable[[Floats], Floats],
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> PadTable:
    """The table of a unit.

    `on_unit` gives the unit's angles of places from the even pad's: sections of uneven
    thickness count them along their own mid-line. `progress` is called with the number of
    columns solved and their total.
    """
    of_even, of_unit = lines
    probes = tuple(
        np.linspace(x[0], x[-1], n)
        for x, n in zip((even.angle, even.axial), PROBES, strict=True)
    )
    places = grid(*probes)
    between = grid(*((x[1:] + x[:-1]) / 2 for x in probes))
    checks = between[::_EVERY]
    columns = Columns(skin, even.diameter, progress, len(places) + len(checks))
    radius = float(skin.geometry.outer_size[0])

    def alike(places: Floats) -> tuple[Floats, Floats, Floats]:
        cap = np.exp(even.largest.values(*places.T)[:, 0])
        force = LEVELS[_PRESSED] * cap[:, None]
        at = np.repeat(places, force.shape[1], 0)
        on_mesh = even.force_on_mesh(at[:, 0], at[:, 1], force.reshape(-1))
        there = np.column_stack([on_unit(places[:, 0]), places[:, 1]])
        found = columns.solve(there, cap, on_mesh.reshape(force.shape) / cap[:, None])
        seen = found._replace(so=of_unit.seen_by(of_even, found.so))
        return *contacts_alike(even, places, force, seen, radius), seen.so

    spline = TensorSpline.through((probes[0], probes[1]), alike(places)[0].reshape(*PROBES, -1))
    own, left, so = alike(checks)
    off = own - spline.values(*checks.T).reshape(own.shape)
    table = _changed(even, lines, spline)
    along, across = on_unit(even.angle), on_unit(even.across_angle)
    doubt = _doubt(off, left, so - even.rest, radius)
    return replace(table, angle=along, across_angle=across, doubt=doubt)


def _doubt(off: Floats, left: Floats, change: Floats, radius: float) -> Floats:
    """Root mean squares of errors of contacts and readings, see `PadTable.doubt`."""
    place = np.sqrt(np.mean((off[..., :2] * np.array([radius, 1.0])) ** 2))
    force = np.sqrt(np.mean(off[..., 2] ** 2))
    size = np.nansum(np.where(left == 0, 0.0, change) ** 2)
    return np.array([place, force, np.sqrt(np.sum(left**2) / size) if size else 0.0])


def _changed(even: PadTable, lines: tuple[Line, Line], spline: TensorSpline) -> PadTable:
    """The even pad's table with contacts (`contacts_alike`) and lines of taxels of a unit."""
    of_even, of_unit = lines
    shape, rest = even.cap.shape, int(np.flatnonzero(LEVELS == 0)[0])
    end = np.array([even.angle[-1], even.axial[-1]])

    def alike(places: Floats) -> Floats:
        own = spline.values(*places.T).reshape(len(places), -1, 4)
        return np.insert(own, rest, own[:, rest], axis=1)

    own = alike(even.places)
    share = own[..., 2]
    there = np.clip(even.places[:, None] + own[..., :2], -end, end)
    # No node is loaded beyond what the even pad's table knows.
    cap = even.cap.reshape(-1) / (1 + np.maximum(share.max(1), 0.0))
    force = LEVELS * cap[:, None] * (1 + share)
    interpolant, u, pressure = PadInterpolant(even), [], []
    for begin in range(0, len(cap), _CHUNK):
        here = slice(begin, begin + _CHUNK)
        at = np.concatenate([there[here], force[here][..., None]], -1).reshape(-1, 3)
        found = interpolant(at, 1).readings
        so = of_even.seen_by(of_unit, found[:, :-1])
        u.append(1 / (so - of_unit.stray))
        pressure.append(found[:, -1] * (own[here, :, 3] / (1 + share[here])).reshape(-1))
    softer = 1 + alike(grid(even.across_angle, even.across_axial))[..., 2]
    across = even.across * softer.reshape(*even.across.shape[:2], len(LEVELS), 1, 1)
    ratio = of_unit.slope / of_even.slope
    touch = reciprocal(reciprocal(even.first_contact) * (1 + share[:, -1].reshape(shape)))
    return replace(
        even,
        cap=cap.reshape(shape),
        first_contact=touch,
        u=np.concatenate(u).reshape(*shape, len(LEVELS), -1),
        pressure=np.concatenate(pressure).reshape(*shape, -1),
        rest=of_unit.stray + 1 / of_unit.rest,
        stray=of_unit.stray,
        across=np.concatenate([across[..., :-1] * ratio, even.across[..., -1:]], -1),
    )
