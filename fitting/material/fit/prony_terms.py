"""How many Prony terms the data determine."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from fitting.material.experiments.measurements import Dataset
from fitting.material.fit.comparison import Comparison, ranked
from fitting.material.fit.fit import fit_material
from fitting.material.fit.preparation import window_of
from fitting.material.fit.result import MaterialFit
from fitting.material.fit.search import NoFit
from fitting.material.laws.with_effects import MOST_PRONY_TERMS, WithEffects

# A term counts if its share is known to this relative standard error, its time lies within the
# data's by this factor, and is apart from that of the next by this factor.
_UNKNOWN_SHARE, _BEYOND, _APART = 0.5, 3.0, 1.5
# AICc that one more term must gain for a further one to be tried.
_GAIN = 2.0


def choose_prony_terms(
    sets: Sequence[Dataset],
    law: str,
    terms: int | None,
    progress: Callable[[str], None] = lambda title: None,
    **options: Any,
) -> Comparison:
    """Fit a law with one, two, ... Prony terms, until one more brings nothing.

    Refused are numbers of terms of which one is not determined: its share is as uncertain as
    half of it, its time lies outside of those measured, or close to another's.

    Args:
        sets: the data.
        law: a value of `law` in [material].
        terms: number of terms of the law.
        progress: called with each title before it is fitted.
        options: as for `fit_material`.

    Raises:
        NoFit: no number of terms could be fitted.
    """
    fits: list[MaterialFit] = []
    failed: dict[str, str] = {}
    refused: dict[str, str] = {}
    for count in range(1, MOST_PRONY_TERMS + 1):
        progress(f"{law}, {count} Prony term{'s' if count > 1 else ''}")
        try:
            fit = fit_material(sets, law, terms, prony=count, doubt=False, **options)
        except NoFit as error:
            failed[f"{count} Prony terms"] = str(error)
            break
        reason = undetermined_term(fit)
        if reason:
            refused[fit.family.title] = reason
        before = fits[-1] if fits else None
        fits.append(fit)
        if before is not None and fit.criteria[0] > before.criteria[0] - _GAIN:
            break
    if not fits:
        raise NoFit("; ".join(failed.values()))
    return ranked(fits, failed, refused)


def undetermined_term(fit: MaterialFit) -> str:
    """Which Prony term of a fit the data don't determine, and why; "" if all are."""
    family = fit.family
    assert isinstance(family, WithEffects)
    first, last = family.law_size, family.law_size + family.prony
    g, tau = fit.constants[first:last], fit.constants[last : last + family.prony]
    errors = fit.uncertainty.standard_errors[first:last]
    shortest, longest = window_of(fit.sets, family.prony)
    for share, error, time in zip(g, errors, tau, strict=True):
        if not error < _UNKNOWN_SHARE * share:
            return f"the share {share:.2g} of the term of {time:.3g} s is not determined"
        if not shortest / _BEYOND < time < longest * _BEYOND:
            return (
                f"a term of {time:.3g} s lies outside of the times measured, {shortest:.3g} to "
                f"{longest:.3g} s"
            )
    near = np.flatnonzero(np.diff(np.log(np.sort(tau))) < np.log(_APART))
    if near.size:
        close = np.sort(tau)[near[0] : near[0] + 2]
        return f"terms of {close[0]:.3g} and {close[1]:.3g} s are one"
    return ""
