"""Laws compared on the same data."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from fitting.material.experiments.measurements import Dataset
from fitting.material.fit.fit import NoFit, fit_material
from fitting.material.fit.result import MaterialFit
from fitting.material.laws.registry import candidates as usual_candidates
from fitting.material.laws.registry import family


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Laws compared on the same data.

    Attributes:
        fits: one per law that could be fitted, lowest AICc first.
        failed: reasons, by law, of those that could not.
    """

    fits: tuple[MaterialFit, ...]
    failed: dict[str, str]

    @property
    def best(self) -> MaterialFit:
        """The lowest AICc among converged fits that determine all their constants.

        A law with a combination of constants that the data leave free has terms to spare;
        it is chosen only where every law has one.
        """
        return min(self.fits, key=lambda fit: bool(fit.uncertainty.unidentifiable))

    @property
    def table(self) -> list[dict[str, Any]]:
        """One line per law."""
        return [
            {
                "law": fit.family.law_name,
                "title": fit.family.title,
                "constants": fit.family.size,
                "aicc": fit.criteria[0],
                "bic": fit.criteria[1],
                "cost": fit.cost,
                "condition_number": fit.uncertainty.condition_number,
                "unidentifiable": len(fit.uncertainty.unidentifiable),
                "status": fit.status,
            }
            for fit in self.fits
        ]


def compare_laws(
    sets: Sequence[Dataset],
    candidates: Sequence[tuple[str, int]] | None = None,
    progress: Callable[[str], None] = lambda title: None,
    **options: Any,
) -> Comparison:
    """Fit several laws and rank them by AICc.

    Args:
        sets: the data.
        candidates: laws and numbers of terms; None for those that the laws declare.
        progress: called with each law's title before it is fitted.
        options: as for `fit_material`.
    """
    fits, failed = [], {}
    count = sum(data.size for data in sets)
    for law, terms in usual_candidates() if candidates is None else candidates:
        chosen = family(law, terms)
        if chosen.size + 2 > count:
            failed[chosen.title] = f"{chosen.size} constants for {count} readings"
            continue
        progress(chosen.title)
        try:
            fits.append(fit_material(sets, chosen, **options))
        except NoFit as error:
            failed[chosen.title] = str(error)
    if not fits:
        raise NoFit("no law could be fitted: " + "; ".join(failed.values()))

    def rank(fit: MaterialFit) -> tuple[bool, float]:
        aicc = fit.criteria[0]
        return fit.status == "not_converged", aicc if np.isfinite(aicc) else np.inf

    return Comparison(tuple(sorted(fits, key=rank)), failed)
