"""Parts of `LoadEstimator` for loads on a skin in plane strain."""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.estimate.assessment import LoadAssessment
from fitting.inverse_load.estimate.parts import EstimationParts
from fitting.inverse_load.estimate.place import ContactPlaces, PlaceShift
from fitting.inverse_load.fit.detection import ArcDetector
from fitting.inverse_load.fit.section_errors import SectionErrors
from fitting.inverse_load.fit.section_fitter import SectionFitter
from fitting.inverse_load.fit.section_posterior import SectionPosterior
from fitting.inverse_load.fit.wide_contact import WideContactFitter
from fitting.inverse_load.search.section import NodeSearch
from fitting.inverse_load.search.table import table_of
from suas_jax.config import InputErrors, SkinSpec
from suas_jax.runtime.start import before_computing
from suas_jax.scene.skin import skin_of
from suas_jax.sensing.electrodes import Electrodes


class SectionFilm(NamedTuple):
    """Even films over the taxels of a section."""

    electrodes: Electrodes

    def film(self, so: Floats) -> Floats:
        """Gaps [frame, taxel] [m] that give readings [counts]; NaN: missing."""
        return np.asarray(self.electrodes.even_film(jnp.asarray(so).T)).T

    def readings(self, film: Floats) -> Floats:
        """Readings under such gaps [taxel] [counts]."""
        return np.asarray(self.electrodes.read_even_film(jnp.asarray(film)[:, None])[:, 0])


def section_parts(
    spec: SkinSpec,
    errors: InputErrors,
    *,
    direction: bool,
    live: bool,
    most_contacts: int,
    from_rest: bool,
    progress: Callable[[str], None],
) -> EstimationParts:
    """The parts for a skin in plane strain."""
    before_computing()
    skin = skin_of(spec, contact=False)
    table = table_of(spec, skin, progress)
    fitter = SectionFitter(
        skin, table, direction=direction, live=live, most_contacts=most_contacts
    )
    nodes = NodeSearch(skin, table)
    record = spec.calibration
    shift = PlaceShift(None if record is None else record.place_shift)
    places = ContactPlaces.of(spec.geometry, skin.geometry, shift)
    taxels = np.asarray(skin.electrodes.taxels.angle)
    middle, quarter = len(table.angles) // 2, len(table.angles) // 4
    single = table.so[middle, table.so.shape[1] // 2]
    pair = table.so[quarter, -6] + table.so[-quarter, -6] - table.rest
    systematic: SectionErrors | None = None
    if len(errors):
        progress("building the table of the inputs' errors")
        systematic = SectionErrors(errors, skin, table, from_rest=from_rest, live=live)
    return EstimationParts(
        lambda: skin,
        SectionFilm(skin.electrodes),
        table,
        table.rest,
        float(table.rest_pressure),
        ArcDetector(table.signatures),
        nodes,
        fitter,
        LoadAssessment(fitter, nodes, places, taxels),
        (single, pair),
        SectionPosterior(fitter, nodes),
        systematic,
        None
        if direction
        else WideContactFitter(skin, table, live=live, most_contacts=most_contacts),
    )
