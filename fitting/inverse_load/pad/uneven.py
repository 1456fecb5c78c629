"""The table of a pad that is not its own mirror image, from that of an even pad.

Thickness and gap of a unit vary by some per cent from place to place. To a contact that is,
nearly, another force on the membrane and another gap under each taxel. So a quarter of the pad
of mean thickness and gap is solved, and of the unit itself only a few places all over it. There
the contact is found under which the even pad reads most alike: loaded more by a share e, and
d away. Both are smooth in between. With u = 1 / (SO - stray) = a + b w, w the displacement over
a taxel, and the states at rest 0 ::

    u(x, F) = u_0 + (b / b_even) (u_even(x + d, F (1 + e)) - u_0,even)
    p(x, F) = c p_even(x + d, F (1 + e)) / (1 + e)

c is what is missing at the solved places. Near clamps less force reads nearly as a contact
nearer to them does, so d has a prior around zero: what is found is smooth, and is right between
the places. What of the unit is no other contact, a dent of another width above all, is left
out. The middles between those places are solved, too, to tell by how much contacts and readings
are off (`PadTable.place_error` and its like), which widens intervals.
"""

from collections.abc import Callable
from dataclasses import replace

import jax.numpy as jnp
import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.pad.columns import Column, Columns
from fitting.inverse_load.pad.interpolant import PadInterpolant
from fitting.inverse_load.pad.rest import GapLine, gap_line
from fitting.inverse_load.pad.spline import TensorSpline
from fitting.inverse_load.pad.table import LEVELS, PadTable, grid, reciprocal
from suas_jax.config import SkinSpec
from suas_jax.scene.skin import Skin
from suas_jax.skin.plain import angles_at, plain_geometry

PROBES = (7, 5)
"""Places of the unit that are solved, along the arc and along the axis."""
_ROUNDS = 6
_MOST = 0.5  # share of force that e is at most
_FARTHEST = 4e-3  # d is at most, along arc and axis [m]
# Standard deviation of d [m] before readings tell it, and that of readings, relative to their
# change. Measured on one thick pad at 120 places: forces between the solved places are 0.42 %
# off in its inner half (0.83 % without a prior), places 0.13 mm (0.07 mm).
_SHIFT, _ERROR = 0.5e-3, 1e-2
_RIDGE = 1e-6  # share of the trace that is added where a unit has no state
_PRESSURE = 0.25  # share of the pressure that c adds or takes at most
_CHUNK = 64  # places that are interpolated at once
_PRESSED = LEVELS != 0


def even_spec(spec: SkinSpec) -> SkinSpec:
    """The same pad with the mean of its thickness and gap everywhere, and equal channels."""
    geometry = spec.geometry
    means = {"thickness": geometry.mean_thickness, "oil_gap": geometry.mean_gap}
    return spec.model_copy(
        update={
            "geometry": geometry.model_copy(update=means),
            "electrodes": spec.sensing.with_equal_channels(),
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
) -> Floats:
    """What the unit's contacts are on an even pad.

    See `force_shares`, from which it goes on with places; the radius is of the outer face [m].
    Returns shifts of angle [rad] and axial position [m], shares of force and ratios of the
    pressure [place, level, 4].
    """
    interpolant = PadInterpolant(table)
    levels = force.shape[1]
    most = np.array([_FARTHEST / radius, _FARTHEST, _MOST])
    end = np.array([table.angle[-1], table.axial[-1]])
    shift = np.zeros((*force.shape, 3))
    shift[..., 2] = force_shares(table, places, force, found)
    change = np.where(np.isfinite(found.so), found.so - table.rest, 0.0)
    variance = _ERROR**2 * np.sum(change**2, -1, keepdims=True)
    for _ in range(_ROUNDS):
        so, slope, _ = _read(interpolant, places, force, shift)
        prior = variance / np.array([_SHIFT / radius, _SHIFT, np.inf]) ** 2
        step, _ = _step(found, so, slope, radius, prior, shift)
        shift = np.clip(shift + step, -most, most)
        there = places[:, None] + shift[..., :2]
        shift[..., :2] += np.clip(there, -end, end) - there
    for k in range(1, levels):
        missing = ~found.found[:, k]
        shift[missing, k] = shift[missing, k - 1]
    *_, pressure = _read(interpolant, places, force, shift)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = found.pressure * (1 + shift[..., 2]) / pressure
    ratio = np.where(np.isfinite(ratio) & found.found, ratio, 1.0)
    ratio = np.clip(ratio, 1 - _PRESSURE, 1 + _PRESSURE)
    return np.concatenate([shift, ratio[..., None]], -1)


def _step(
    found: Column,  # readings of the unit
    so: Floats,  # those of contacts on the even pad [place, level, taxel]
    slope: Floats,  # by angle, axial position and share of force [place, level, 3, taxel]
    radius: float,  # of the outer face [m]
    prior: Floats | float = 0.0,  # information of these three, times the readings' variance
    shift: Floats | float = 0.0,  # the three where the slopes are
) -> tuple[Floats, Floats]:
    """Least-squares step of contacts [place, level, 3], and what it leaves of the readings."""
    good = np.isfinite(found.so) & found.found[..., None]
    left = np.where(good, found.so - so, 0.0)
    unit = np.array([_SHIFT / radius, _SHIFT, 1.0])
    slope = np.where(good[..., None, :], slope * unit[:, None], 0.0)
    square = slope @ slope.swapaxes(-1, -2)
    size = np.trace(square, axis1=-2, axis2=-1)[..., None, None]
    ridge = np.where(size > 0, _RIDGE * size, 1.0)
    held = np.broadcast_to(prior * unit**2, slope.shape[:-1])
    pull = (slope @ left[..., None])[..., 0] - held * shift / unit
    square = square + np.eye(3) * (ridge + held[..., None])
    step = np.linalg.solve(square, pull[..., None])
    return step[..., 0] * unit, left - (step.swapaxes(-1, -2) @ slope)[..., 0, :]


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
    specs: tuple[SkinSpec, SkinSpec],  # of that pad, and of the unit
    skin: Skin,  # the unit, with the elements of the table's meshes
    on_unit: Callable[[Floats], Floats],
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> PadTable:
    """The table of a unit.

    `on_unit` gives the unit's angles of places from the even pad's: sections of uneven
    thickness count them along their own mid-line. `progress` is called with the number of
    columns solved and their total.
    """
    probes = tuple(
        np.linspace(x[0], x[-1], n)
        for x, n in zip((even.angle, even.axial), PROBES, strict=True)
    )
    places, levels = grid(*probes), LEVELS[_PRESSED]
    middles = grid(*((x[1:] + x[:-1]) / 2 for x in probes))
    columns = Columns(skin, even.diameter, progress, len(places) + len(middles))
    of_even, of_unit = (
        line._replace(at=1 / (rest - line.stray))
        for line, rest in zip(
            (gap_line(spec, {}) for spec in specs), (even.rest, columns.rest()[0]), strict=True
        )
    )
    radius = float(skin.geometry.outer_size[0])

    def states(places: Floats) -> tuple[Floats, Column]:
        """Forces, and what the unit's states read, seen by the even pad's taxels."""
        cap = np.exp(even.largest.values(*places.T)[:, 0])
        force = levels * cap[:, None]
        at = np.repeat(places, force.shape[1], 0)
        on_mesh = even.force_on_mesh(at[:, 0], at[:, 1], force.reshape(-1))
        there = np.column_stack([on_unit(places[:, 0]), places[:, 1]])
        found = columns.solve(there, cap, on_mesh.reshape(force.shape) / cap[:, None])
        return force, found._replace(so=of_unit.seen_by(of_even, found.so))

    own = contacts_alike(even, places, *states(places), radius)
    spline = TensorSpline.through((probes[0], probes[1]), own.reshape(*PROBES, -1))
    force, found = states(middles)
    shift = spline.values(*middles.T).reshape(*force.shape, -1)[..., :3]
    so, slope, _ = _read(PadInterpolant(even), middles, force, shift)
    off, left = _step(found, so, slope, radius)
    change = np.where(left == 0, 0.0, found.so - even.rest)
    size = np.linalg.norm(change, axis=-1)
    known = size > 0
    # Medians: of a state that leaves a taxel next to no gap, one reading says everything.
    share = np.linalg.norm(left, axis=-1)[known] / size[known]
    off = off.reshape(*(n - 1 for n in PROBES), len(levels), 3) * [radius, 1.0, 1.0]
    return replace(
        _changed(even, (of_even, of_unit), spline),
        angle=on_unit(even.angle),
        across_angle=on_unit(even.across_angle),
        place_error=_by_reach(off[..., :2]),
        force_error=_by_reach(off[..., 2:]),
        reading_error=np.median(share) if share.size else np.zeros(()),
    )


def _by_reach(off: Floats) -> Floats:
    """Root mean squares of errors at places alike in both directions, of a median level.

    Errors are [angle, axial, level, direction].
    """
    square = np.mean(np.median(off**2, axis=2), axis=-1)
    square = (square + square[::-1])[len(square) // 2 :] / 2
    square = (square + square[:, ::-1])[:, square.shape[1] // 2 :] / 2
    return np.asarray(np.sqrt(square))


def _changed(even: PadTable, lines: tuple[GapLine, GapLine], spline: TensorSpline) -> PadTable:
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
        rest=of_unit.stray + 1 / of_unit.at,
        stray=of_unit.stray,
        across=np.concatenate([across[..., :-1] * ratio, even.across[..., -1:]], -1),
    )
