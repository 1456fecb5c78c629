"""The parts of an estimator, whatever the dimension."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from fitting.arrays import Floats
from fitting.inverse_load.estimate.assessment import LoadAssessment
from fitting.inverse_load.fit.detection import AbstractDetector
from fitting.inverse_load.fit.explanation import AbstractLoadFitter
from fitting.inverse_load.fit.load_posterior import AbstractLoadPosterior
from fitting.inverse_load.fit.systematic import AbstractSystematicErrors
from fitting.inverse_load.search.base import AbstractNodeSearch

if TYPE_CHECKING:
    from suas_jax.scene.skin import Skin


class Film(Protocol):
    """Readings of taxels under an even film."""

    def film(self, so: Floats) -> Floats:
        """Gaps [frame, taxel] [m], but for a constant, that give readings [counts].

        NaN where a reading is missing.
        """

    def readings(self, film: Floats) -> Floats:
        """Readings under such gaps [..., taxel] [counts]."""


@dataclass(frozen=True)
class EstimationParts:
    """The parts of an estimator, for one skin."""

    make_skin: "Callable[[], Skin]"  # its model, made when first needed
    film: Film  # what its taxels read under even films, by which taps are told
    table: Any  # of its solved states
    rest: Floats  # the model's readings at rest [taxel] [counts]
    rest_pressure: float  # of the oil [Pa]
    detector: AbstractDetector  # tells contact from noise
    nodes: AbstractNodeSearch  # where fits begin
    fitter: AbstractLoadFitter  # fits loads to readings
    assessment: LoadAssessment  # turns fits into estimates
    # readings of one and of two contacts, to compile or load what they need
    trials: tuple[Floats, Floats]
    posterior: AbstractLoadPosterior  # of a frame's loads
    # errors that all frames share: those of the skin file's numbers, and the model's own; None
    # where there are none
    systematic: AbstractSystematicErrors | None = None
    # fits one contact of unknown width; None where there is no such model
    wide_fitter: AbstractLoadFitter | None = None
