"""Readings of a pad for its data sheet, from a table of solved states under one round contact.

Sensitivities to tolerances are those of `suas invert`. They move readings alone: of figures
that need more, the interval is unknown.
"""

from collections.abc import Callable
from concurrent.futures import Executor

import numpy as np

from fitting.arrays import Floats
from fitting.datasheet.figures import FINE, Accuracy, Cases, Measured
from fitting.datasheet.readings import Readings, far_taxels
from fitting.datasheet.variants import DEEPER, STEP, WARMER, Variants, why_constant
from fitting.force_range.bound import rated_force
from fitting.inverse_load.estimate.place import ContactPlaces
from fitting.inverse_load.pad.facts import PadShape
from fitting.inverse_load.pad.input_errors import PadErrors
from fitting.inverse_load.pad.interpolant import MOST, PadInterpolant
from fitting.inverse_load.pad.parts import pad_table_of
from fitting.inverse_load.pad.stiffening import effects_of, solved_contact
from fitting.inverse_load.pad.table import PadResolution, PadTable, grid
from fitting.inverse_load.settings import DIAMETER, PAD_MODEL_ERROR
from suas_jax.config import InputErrors, SkinSpec
from suas_jax.config.input_errors import value_of
from suas_jax.scene.skin import Skin, skin_of

ELEMENTS = (18, 15)
"""Of the meshes, along the arc and along the axis."""
_RESOLUTION = PadResolution(elements=ELEMENTS, spacing=10e-3, probes=(3, 3))
_LIGHT = 0.02  # of the largest force, that stands for none
_SLOTS = 2  # contacts that the program for solved states has room for
_NEVER = 1e8  # stands for a force of first contact that the table doesn't know [N]


def measure_pad(
    variants: Variants,  # the pad and its neighbours
    places: tuple[int, int],  # how many along the arc and along the axis, from edge to edge
    noise: float,  # standard deviation of a reading [counts]
    force: float | None,  # the rated force [N]; see `rated_force`
    progress: Callable[[str], None],  # called with what is being done
    workers: Executor | None = None,  # that solve the table; None: this process
    # angle [rad] and axial position [m] of the first and the last place, all of which count;
    # None for places from edge to edge, of which those between the outermost taxels count
    between: tuple[Floats, Floats] | None = None,
) -> Measured:
    """Readings under round contacts of 6 mm over a pad."""

    def shown(done: int, total: int) -> None:
        progress(f"table of solved states: {done} of {total} columns")

    spec = variants.spec
    skin = skin_of(spec, elements=_RESOLUTION.elements, contact=False)
    table = pad_table_of(spec, DIAMETER, _RESOLUTION, progress=shown, workers=workers)
    interpolant = PadInterpolant(table)
    edge = np.array([table.angle[-1], table.axial[-1]])
    first, last = (-edge, edge) if between is None else np.clip(between, -edge, edge)
    at = grid(*(np.linspace(*ends) for ends in zip(first, last, places, strict=True)))
    most = MOST * interpolant.largest(*at.T)
    touch = table.first_contact_at(*at.T)
    taxels = skin.electrodes.taxels.places
    region = ((at >= taxels.min(0) - 1e-9) & (at <= taxels.max(0) + 1e-9)).all(1)
    region = region if region.any() and between is None else np.ones_like(region)
    rated = rated_force(np.minimum(touch, most)[region]) if force is None else force
    if rated > most[region].min():
        raise ValueError(
            f"a rated force of {rated:g} N is beyond the pad's table of states, which ends at "
            f"{most[region].min():.3g} N; choose a smaller one"
        )
    progress("what tolerances do")
    errors = _errors(variants, skin, table)
    along = ContactPlaces.of(spec.geometry, skin.geometry)
    rate = along.outer_rate(at[:, 0])
    light, half, at_rated = (
        _readings(interpolant, errors, at, f, rate)
        for f in (_LIGHT * most, 0 * most + rated / 2, 0 * most + rated)
    )
    # Of a soft pad the slope at rest is up to a twentieth less than that of a light contact.
    light.slope[-1] += _at_no_force(interpolant, at)[:, None] - light.slope[-1, :, :1]
    # Two contacts are closer to one another than two places, and may lie beyond the last.
    fine = np.linspace(-edge[0], edge[0], FINE)
    rows = [_at_no_force(interpolant, grid(fine, x)) for x in at[: places[1], 1:]]
    at_rated.slope[:, :, 1:] = np.nan  # of the neighbours: unknown
    known, neighbour = touch < _NEVER, np.arange(light.gap.shape[0])[:, None] > 0
    closed = np.where(known & ~neighbour, 0.0, np.nan)
    near = light._replace(gap=closed, gap_slope=-np.ones_like(closed))
    rest = _moved(table.rest[:, None], errors.rest[:, :-1].T[..., None])
    light = light._replace(so=np.broadcast_to(rest, light.so.shape))
    at_rated = at_rated._replace(gap=np.full_like(light.gap, np.nan))
    return Measured(
        Cases(light, half, at_rated, near, np.where(known, touch, rated)[None]),
        along.coordinates(at[:, 0]) | {"axial_m": at[:, 1]},
        along.outer_arc(at[:, 0]),
        region,
        far_taxels(skin, at),
        rated,
        Accuracy(noise, float(np.hypot(PAD_MODEL_ERROR, table.reading_error))),
        places,
        missing={"min_gap_m": "a pad's table of states holds no gaps; `suas solve` tells them"},
        light=(along.outer_arc(fine), np.stack(rows, 1)),
    )


def _errors(variants: Variants, skin: Skin, table: PadTable) -> PadErrors:
    """What every change of the variants does to the readings.

    Of warmth and depth that is what they do at rest, too, where `suas invert` leaves it out.
    """
    own, paths = variants.errors, tuple(variants.inputs)
    directions = np.zeros((len(variants.changes), len(paths)))
    directions[: len(own), : len(own.paths)] = own.directions
    rows = (-2, WARMER), (-1, DEEPER)
    felt = [(row, path) for row, path in rows if not why_constant(variants.spec, path)]
    for row, path in felt:
        directions[row, paths.index(path)] = 1.0
    every = InputErrors(paths, directions, variants.changes, own.assumed, variants.spec)
    effects = effects_of(every, skin, table, slots=_SLOTS)
    radius = PadShape.of(skin).radius
    found = PadErrors(every.names, effects, table, radius, from_rest=False)
    found.rest = found.rest.copy()
    for row, path in felt:
        low, high = (_at_rest(variants.spec, path, side, skin) for side in (-1.0, 1.0))
        found.rest[row] += (high - low) / 2
    return found


def _at_rest(spec: SkinSpec, path: str, change: float, skin: Skin) -> Floats:
    """Readings at rest and the oil's pressure with one input changed [channel]."""
    moved = {path: value_of(spec, path) + change}
    pad = skin_of(spec, moved, elements=skin.elements, contact=False)
    return solved_contact(pad, np.zeros(3), DIAMETER, _SLOTS)[0]


def _at_no_force(interpolant: PadInterpolant, at: Floats) -> Floats:
    """Derivatives of the readings by the force of contacts that hardly press [taxel, place]."""
    loads = np.column_stack([at, np.zeros(len(at))])
    return np.asarray(interpolant(loads, 1).jacobian[:, -1, :-1].T)


def _readings(
    interpolant: PadInterpolant, errors: PadErrors, at: Floats, force: Floats, rate: Floats
) -> Readings:
    """Readings of contacts on the pad and its neighbours [taxel, skin, place].

    `rate` is the length of the outer face per angle at the places [m].
    """
    loads = np.column_stack([at, force])
    found = interpolant(loads, 1)
    so, jacobian = found.readings, found.jacobian
    angle, axial, push = loads.T[..., None]
    changed = errors.under(angle, axial, push, jacobian[:, 2:3], so[:, :-1], so[:, -1])
    moved = np.moveaxis(changed[..., :-1], 0, -1)  # change, taxel, place
    per_metre = np.stack([rate, *np.ones((2, len(rate)))])[:, None]
    own = np.moveaxis(jacobian[..., :-1], 0, -1) / per_metre
    skins = 1 + 2 * len(moved)
    slope = np.repeat(own[:, :, None], skins, 2)
    # A light contact's readings are linear in its force, so their slopes move as they do.
    by_force = (moved - errors.rest[:, :-1, None]) / force
    slope[-1] = _moved(own[-1], np.swapaxes(by_force, 0, 1))
    readings = _moved(so[:, :-1].T, np.swapaxes(moved, 0, 1))
    zero = np.zeros((skins, len(loads)))
    return Readings(readings, slope, zero, zero, zero + so[:, -1], zero.astype(int))


def _moved(own: Floats, slopes: Floats) -> Floats:
    """Values of the pad itself [taxel, place], then of each change downwards and upwards."""
    sides = np.tile([-STEP, STEP], slopes.shape[1])[:, None]
    steps = np.repeat(slopes, 2, axis=1) * sides
    return np.concatenate([own[:, None], own[:, None] + steps], 1)
