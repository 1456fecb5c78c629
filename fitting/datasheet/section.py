"""Readings of a section for its data sheet: places along the arc, all skins in one batch."""

from collections.abc import Callable

import jax
import numpy as np

from fitting.arrays import Floats
from fitting.datasheet.figures import FINE, Accuracy, Cases, Measured
from fitting.datasheet.readings import Readings, far_taxels, read_all, skins_in_lanes
from fitting.datasheet.variants import Variants
from fitting.force_range.bound import angles_over, first_contacts, rated_force, readings_at_rest
from fitting.inverse_load.estimate.place import ContactPlaces
from fitting.inverse_load.settings import MODEL_ERROR
from suas_jax import Skin, skin_of


def between_taxels(skin: Skin, angle: Floats) -> np.ndarray:
    """Whether places lie between the outermost taxels; all of them where none does."""
    taxels = np.asarray(skin.electrodes.taxels.angle)[:, 0]
    inside = (angle >= taxels.min() - 1e-9) & (angle <= taxels.max() + 1e-9)
    return inside if inside.any() else np.ones_like(inside)


def measure_section(
    variants: Variants,  # the skin and its neighbours
    places: int,  # how many, from clamp to clamp
    noise: float,  # standard deviation of a reading [counts]
    force: float | None,  # the rated force [N]; see `rated_force`
    progress: Callable[[str], None],  # called with what is being done
    # angles of the first and the last place, all of which count [rad]; None for places from
    # clamp to clamp, of which those between the outermost taxels count
    between: tuple[float, float] | None = None,
) -> Measured:
    """Readings under line loads over a section."""
    spec = variants.spec
    free = skin_of(spec, contact=False)
    edge = angles_over(free, 2)[1]
    first, last = (-edge, edge) if between is None else np.clip(between, -edge, edge)
    angle = np.linspace(first, last, places)
    progress("first contact")
    readings_at_rest(free, angle)  # a skin without any has no figures
    touch, _ = first_contacts(free, angle)
    region = between_taxels(free, angle) if between is None else np.full(places, True)
    rated = rated_force(touch[region]) if force is None else force
    progress("readings")
    count = len(next(iter(variants.inputs.values())))
    forces = np.stack([0 * angle, 0 * angle + rated / 2, 0 * angle + rated, touch])
    known = np.where(np.isfinite(forces), forces, rated)
    shape = (count, *known.shape)  # skin, case, place
    which = np.broadcast_to(np.arange(count)[:, None, None], shape).ravel()
    lanes = [np.broadcast_to(x, shape).ravel() for x in (angle, known)]
    skins = skins_in_lanes(spec, variants.inputs)
    found = read_all(skins, which, *lanes)
    # Two contacts are closer to one another than two places, and may lie beyond the last.
    fine = np.linspace(-edge, edge, FINE)
    light = read_all(skins, np.zeros(len(fine), int), fine, 0 * fine).slope[-1]
    cases = jax.tree.map(lambda x: x.reshape(*x.shape[:-1], *shape), found)
    rest, half, at_rated, near = (
        Readings(*(np.asarray(x)[..., i, :] for x in cases)) for i in range(4)
    )
    lost = (near.result != 0) | ~np.isfinite(touch)
    near = near._replace(gap=np.where(lost, np.nan, near.gap))
    at = ContactPlaces.of(spec.geometry, free.geometry)
    return Measured(
        Cases(rest, half, at_rated, near, np.broadcast_to(known[3], (count, places))),
        at.coordinates(angle),
        at.outer_arc(angle),
        region,
        far_taxels(free, angle[:, None]),
        rated,
        Accuracy(noise, MODEL_ERROR),
        (places, 1),
        light=(at.outer_arc(fine), light[:, None]),
    )
