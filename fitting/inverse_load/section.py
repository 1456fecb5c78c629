"""Parts of `LoadEstimator` for loads on a skin in plane strain."""

from collections.abc import Callable

import numpy as np

from fitting.inverse_load.estimate.assessment import LoadAssessment
from fitting.inverse_load.estimate.parts import EstimationParts
from fitting.inverse_load.estimate.place import ContactPlaces
from fitting.inverse_load.estimate.place_shift import PlaceShift
from fitting.inverse_load.fit.detection import ArcDetector
from fitting.inverse_load.fit.load_posterior import SectionPosterior
from fitting.inverse_load.fit.section_errors import SectionErrors
from fitting.inverse_load.fit.section_fitter import SectionFitter
from fitting.inverse_load.fit.wide_contact import WideContactFitter
from fitting.inverse_load.search.section import NodeSearch
from fitting.inverse_load.search.table import table_of
from suas_jax.config import InputErrors, SkinSpec
from suas_jax.scene.skin import skin_of


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
    skin = skin_of(spec, contact=False)
    table = table_of(spec, skin, progress)
    fitter = SectionFitter(
        skin, table, direction=direction, live=live, most_contacts=most_contacts
    )
    nodes = NodeSearch(skin, table)
    record = spec.calibration
    shift = PlaceShift(None if record is None else record.place_shift)
    places = ContactPlaces(spec.geometry, skin.geometry, shift)
    taxels = np.asarray(skin.electrodes.taxels.angle)
    middle, quarter = len(table.angles) // 2, len(table.angles) // 4
    single = table.so[middle, table.so.shape[1] // 2]
    pair = table.so[quarter, -6] + table.so[-quarter, -6] - table.rest
    systematic: SectionErrors | None = None
    if len(errors):
        progress("building the table of the inputs' errors")
        systematic = SectionErrors(errors, skin, table, from_rest=from_rest, live=live)
    return EstimationParts(
        skin,
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
