"""What estimates contacts on a pad: the parts that `LoadEstimator` needs."""

from collections.abc import Callable
from concurrent.futures import Executor

import numpy as np
from numpy.typing import NDArray

from fitting.inverse_load.estimate.assessment import AbstractLoadAssessment
from fitting.inverse_load.estimate.parts import EstimationParts
from fitting.inverse_load.fit.detection import PadDetector
from fitting.inverse_load.pad.fitter import PadFitter
from fitting.inverse_load.pad.input_errors import PadErrors
from fitting.inverse_load.pad.interpolant import PadInterpolant
from fitting.inverse_load.pad.posterior import PadPosterior
from fitting.inverse_load.pad.search import APART, PadNodeSearch
from fitting.inverse_load.pad.table import PadTable
from fitting.inverse_load.pad.table_build import FINE, PadResolution, pad_table_of
from suas_jax.config import InputErrors, SkinSpec
from suas_jax.scene.pad_forward import PadSkin, pad_skin_of

FREE_DIAMETERS = (2e-3, 7e-3, 12e-3)
"""Diameters that are tabulated where it is estimated [m]."""
_FALLBACK = 6e-3


class PadAssessment(AbstractLoadAssessment):
    """Estimates on a pad.

    Args:
        fitter: which knows edges and forces of first contact.
        nodes: which know distances.
        radius: of the outer face [m].
        taxels: angle and axial position [taxel, 2].
    """

    limit_error = 0.03  # of the table, which knows it at a few places

    def __init__(
        self,
        fitter: PadFitter,
        nodes: PadNodeSearch,
        radius: float,
        taxels: NDArray[np.float64],
    ) -> None:
        super().__init__(fitter.parameters, radius, len(taxels))
        self._fitter, self._nodes, self._places = fitter, nodes, taxels

    def first_contact(self, place: NDArray[np.float64]) -> float:
        """See the base class."""
        return float(self._fitter.table.first_contact_at(place[:1], place[1:2])[0])

    def near_taxels(self, place: NDArray[np.float64], taxels: NDArray[np.bool_]) -> bool:
        """See the base class."""
        return bool((self._nodes.distance(self._places[taxels], place) < APART).any())

    def at_edge(self, place: NDArray[np.float64]) -> bool:
        """See the base class."""
        return bool((np.abs(place[:2]) >= np.array(self._fitter.edge) * (1 - 1e-6)).any())


def pad_parts(
    spec: SkinSpec,
    errors: InputErrors,
    *,
    diameter: float | None,
    direction: bool,
    live: bool,
    most_contacts: int,
    from_rest: bool,
    progress: Callable[[str], None],
    workers: Executor | None,
    resolution: PadResolution,
) -> tuple[EstimationParts, PadSkin, PadTable]:
    """The parts for a pad, its model and its table of solved states.

    Args:
        spec: the pad.
        errors: of its inputs.
        diameter: of the contacts [m]; None estimates it.
        direction: whether directions are free.
        live: whether frames come one by one.
        most_contacts: to tell apart.
        from_rest: whether readings count from a baseline.
        progress: called with what is being done.
        workers: that solve the table's states; None: this process.
        resolution: of the tables.
    """
    diameters = FREE_DIAMETERS if diameter is None else (diameter,)
    skin = pad_skin_of(spec, elements=resolution.elements, contact=False)
    tables = tuple(_table(spec, d, progress, workers, resolution) for d in diameters)
    interpolant = PadInterpolant(tables, direction=direction)
    fitter = PadFitter(
        skin,
        interpolant,
        live=live,
        most_contacts=most_contacts,
        diameter=_FALLBACK if diameter is None else diameter,
    )
    middle = tables[len(tables) // 2]
    radius = float(skin.geometry.outer_radius[0])
    nodes = PadNodeSearch(middle, radius)
    own = skin.electrodes.taxels
    places = np.stack([np.asarray(x)[:, 0] for x in (own.angle, own.axial)], 1)
    detector = PadDetector(nodes.signatures, (len(middle.angle), len(middle.axial)))
    a, z = 0.3 * fitter.edge[0], 0.3 * fitter.edge[1]
    force = 0.3 * float(middle.cap.min())
    one, two = np.array([[a, z, force]]), np.array([[a, -a, z, -z, force, force]])
    single, several = (
        interpolant(fitter.completed(x, k + 1), k + 1).readings[0, :-1]
        for k, x in enumerate((one, two))
    )
    parts = EstimationParts(
        middle.rest,
        detector,
        nodes,
        fitter,
        PadAssessment(fitter, nodes, radius, places),
        (single, several),
        PadPosterior(fitter, nodes),
        PadErrors(spec, errors, skin, middle, from_rest=from_rest, slots=max(most_contacts, 2)),
    )
    return parts, skin, middle


def table_of_pad(
    spec: SkinSpec,
    diameter: float,
    progress: Callable[[str], None],
    workers: Executor | None,
) -> tuple[PadSkin, PadTable]:
    """A pad's model and its table of solved states.

    Args:
        spec: the pad.
        diameter: of the contacts [m].
        progress: called with what is being done.
        workers: that solve the table's states; None: this process.
    """
    return pad_skin_of(spec, contact=False), _table(spec, diameter, progress, workers)


def _table(
    spec: SkinSpec,
    diameter: float,
    progress: Callable[[str], None],
    workers: Executor | None,
    resolution: PadResolution = FINE,
) -> PadTable:
    def shown(done: int, total: int) -> None:
        if done == 1 or done % 10 == 0 or done == total:
            progress(
                f"table of solved states, contacts of {1e3 * diameter:g} mm: "
                f"{done} of {total} columns"
            )

    return pad_table_of(spec, diameter, resolution, progress=shown, workers=workers)
