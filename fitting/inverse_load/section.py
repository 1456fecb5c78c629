"""Parts of `LoadEstimator` for loads on a skin in plane strain, their posterior among them."""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fitting.arrays import Floats
from fitting.inverse_load.estimate.assessment import LoadAssessment
from fitting.inverse_load.estimate.parts import EstimationParts
from fitting.inverse_load.estimate.place import ContactPlaces, PlaceShift
from fitting.inverse_load.fit.detection import ArcDetector
from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.fit.load_posterior import AbstractLoadPosterior
from fitting.inverse_load.fit.section_errors import SectionErrors
from fitting.inverse_load.fit.section_fitter import SectionFitter
from fitting.inverse_load.fit.wide_contact import WideContactFitter
from fitting.inverse_load.model.evaluation import loads_from
from fitting.inverse_load.search.base import AbstractNodeSearch
from fitting.inverse_load.search.section import NodeSearch
from fitting.inverse_load.search.table import table_of
from fitting.statistics.log_probability import LogProbability
from suas_jax.config import InputErrors, SkinSpec
from suas_jax.equilibrium.correction import corrected
from suas_jax.equilibrium.equilibrium import equilibrium
from suas_jax.equilibrium.state import State
from suas_jax.runtime.start import before_computing
from suas_jax.scene.error_estimate import bounded
from suas_jax.scene.skin import skin_of
from suas_jax.sensing.electrodes import Electrodes

_SAME = np.deg2rad(1.0)  # between contacts that are one


class SectionFilm(NamedTuple):
    """Even films over the taxels of a section."""

    electrodes: Electrodes

    def film(self, so: Floats) -> Floats:
        """Gaps [frame, taxel] [m] that give readings [counts]; NaN: missing."""
        return np.asarray(self.electrodes.even_film(jnp.asarray(so).T)).T

    def readings(self, film: Floats) -> Floats:
        """Readings under such gaps [taxel] [counts]."""
        return np.asarray(self.electrodes.read_even_film(jnp.asarray(film)[:, None])[:, 0])


class SectionPosterior(AbstractLoadPosterior):
    """The posterior of line loads in plane strain: even over angle, force and direction.

    Where directions are not free, friction and width are integrated out (`LeftOutOfContacts`).
    """

    def __init__(self, fitter: SectionFitter, nodes: AbstractNodeSearch) -> None:
        low, high = (x[:, 0] for x in fitter.limits(1, 1, False))
        super().__init__(nodes, 1, float(np.prod(high - low)), _SAME, np.array([[-1.0]]))
        self._fitter = fitter

    def log_probability(self, y: Floats, mode: Explanations) -> LogProbability:
        """See the base class."""
        count, skin = int(mode.contacts[0]), self._fitter.skin
        pull = bool(mode.parameters[0, count] < 0)
        low, high = (x[..., 0] for x in self._fitter.limits(count, 1, pull))
        state, reading, weight = mode.state, jnp.asarray(y), jnp.asarray(mode.weight[0])
        left_out = self._fitter.left_out
        others = [] if left_out is None else left_out.of_mode(mode)

        def log_probability(points: Float[Array, "point p"]) -> Float[Array, " point"]:
            lanes = points.shape[0]
            inside = jnp.all((points >= low) & (points <= high), 1)
            problem = skin.problem(loads_from(jnp.clip(points, low, high).T, count))
            near = State(*(jnp.repeat(jnp.asarray(x), lanes, -1) for x in state))
            found = equilibrium(problem, near, omitted=True)
            shown = corrected(problem, found.state, found.change)
            so = skin.electrodes.read(shown.mechanics, shown.state.q).so
            residual = jnp.where(weight[:, None] > 0, reading[:, None] - so, 0.0)
            chi2 = jnp.sum(weight[:, None] * residual**2, 0)
            trust = bounded(problem, found.state, shown.state, found.outcome)
            log = -chi2 / 2
            for own, rare in others:
                gain = jnp.sum((own @ (weight[:, None] * residual)) ** 2, 0) / 2 - rare
                log = jnp.logaddexp(log, gain - chi2 / 2)
            return jnp.where(inside & (trust.result == 0), log, -jnp.inf)

        return log_probability


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
