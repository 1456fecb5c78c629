"""Laws compared on the same data, and numbers of Prony terms."""

import dataclasses
import functools
import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from fitting.material.experiments.measurements import PATHS, Dataset
from fitting.material.fit.band import Belief, asked_stretches, half_width, nominal_factors
from fitting.material.fit.fit import fit_material
from fitting.material.fit.preparation import window_of
from fitting.material.fit.result import MaterialFit
from fitting.material.fit.search import NoFit
from fitting.material.laws.blocks import MOST_PRONY_TERMS, Relaxation
from fitting.material.laws.parameters import block_of
from fitting.material.laws.registry import candidates as usual_candidates
from fitting.material.laws.registry import family
from fitting.statistics.diagnostics import information_criteria

# A law must be stable this much further than the data reach, in log stretch.
STABILITY_MARGIN = 0.1
_MOST_CORRELATED = 0.97

# A term counts if its share is known to this relative standard error, its time lies within the
# data's by this factor, and is apart from that of the next by this factor.
_UNKNOWN_SHARE, _BEYOND, _APART = 0.5, 3.0, 1.5
# AICc that one more term must gain for a further one to be tried.
_GAIN = 2.0


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Laws compared on the same data."""

    fits: tuple[MaterialFit, ...]  # one per law that could be fitted, lowest AICc first
    # reasons, by title, of those that could not: too few readings, no finite stresses, no
    # convergence, no stiffness at rest
    failed: dict[str, str]
    # further reasons against laws, by title, such as a scene's stretches
    refused: Mapping[str, str] = dataclasses.field(default_factory=dict)
    up_to: float | None = None  # largest stretch that is asked for; None for that of the data

    @functools.cached_property
    def effective_number(self) -> float:
        """Number of independent readings: n (1 − ρ)/(1 + ρ).

        ρ is the correlation of neighbouring residuals of the law that follows the data most
        closely; what others have on top is their misfit. Where nothing but misfit is left, as
        of a smooth curve, there are at least as many as give that law a finite AICc.
        """
        count = float(self.fits[0].problem.residuals.used.sum())
        closest = min(self.fits, key=lambda fit: fit.cost)
        rho = float(np.clip(closest.misfit.autocorrelation, 0.0, _MOST_CORRELATED))
        # A correlation that chance explains is none.
        if rho < 2.0 / np.sqrt(count):
            return count
        least = closest.family.size + 3.0
        return max(count * (1.0 - rho) / (1.0 + rho), min(least, count))

    def aicc(self, fit: MaterialFit) -> float:
        """AICc with the effective number of readings; infinite if they are too few."""
        count = int(fit.problem.residuals.used.sum())
        known = fit.problem.kind in ("noise", "estimated")
        square, p, effective = 2.0 * fit.cost, fit.family.size, self.effective_number
        return information_criteria(square, count, p, known_noise=known, effective=effective)[0]

    def against(self, fit: MaterialFit) -> list[str]:
        """Why a law is not to be recommended; nothing if it is sound."""
        reasons = []
        if fit.status == "not_converged":
            reasons.append("no start converged")
        reasons += [f"unstable: {text}" for text in fit.instabilities(STABILITY_MARGIN)]
        if fit.family.title in self.refused:
            reasons.append(self.refused[fit.family.title])
        reasons += [
            f"{mode}, not measured: {ratio:.3g} times the middle of the 95 % band"
            for mode, ratio in self.beyond_band(fit).items()
        ]
        if count := fit.uncertainty.spare:
            reasons.append(
                f"{count} combination{'s' if count > 1 else ''} of constants not determined"
            )
        return reasons

    def beyond_band(self, fit: MaterialFit) -> dict[str, float]:
        """Modes not measured in which a law leaves the 95 % band: stress over the middle."""
        found = {}
        for mode, (stretch, middle, half) in self._bands.items():
            law, _ = fit.stress(nominal_factors(mode, stretch))
            off = np.nan_to_num(np.abs(law - middle) / half, nan=np.inf)
            if np.max(off) > 1.0:
                at = int(np.argmax(off))
                found[mode] = float(law[at] / middle[at])
        return found

    @functools.cached_property
    def _bands(self) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Stretches, middle and half width of each mode that was not measured."""
        belief = Belief.of(self.fits)
        found = {}
        for mode in PATHS:
            if mode not in belief.measured:
                stretch = asked_stretches(self.fits[0], mode, self.up_to)
                middle, deviation = belief.stress(mode, stretch, self.up_to)
                found[mode] = stretch, middle, half_width(deviation)
        return found

    @property
    def best(self) -> MaterialFit:
        """The lowest AICc among laws against which nothing stands.

        Where something stands against every law, stability goes first, then convergence, then
        how far modes that were not measured are off, then constants that are determined.
        """
        return min(self.fits, key=self._faults)

    def _faults(self, fit: MaterialFit) -> tuple[bool, bool, float, bool]:
        unstable = bool(fit.instabilities(STABILITY_MARGIN)) or fit.family.title in self.refused
        # How far a ratio is from one, either way; infinite for what is not stress.
        ratios = self.beyond_band(fit).values()
        off = (abs(float(np.log(x))) if 0.0 < x < np.inf else np.inf for x in ratios)
        spare = fit.uncertainty.spare > 0
        return unstable, fit.status == "not_converged", max(off, default=0.0), spare

    @property
    def table(self) -> list[dict[str, Any]]:
        """One line per law."""
        best = self.best
        lines = []
        for fit in self.fits:
            reasons = self.against(fit)
            delta = self.aicc(fit) - self.aicc(best)
            if not reasons and fit is not best:
                reasons = [f"AICc is {delta:.3g} higher"]
            lines.append(
                {
                    "law": fit.family.law_name,
                    "title": fit.family.title,
                    "constants": fit.family.size,
                    "aicc": self.aicc(fit),
                    "delta_aicc": delta,
                    "bic": fit.criteria[1],
                    "cost": fit.cost,
                    "condition_number": fit.uncertainty.condition_number,
                    "unidentifiable": len(fit.uncertainty.unidentifiable),
                    "stable": not fit.instabilities(STABILITY_MARGIN),
                    "misfit": fit.misfit.significant,
                    "rejected": [] if fit is best else reasons,
                    "chosen": fit is best,
                    "status": fit.status,
                }
            )
        return lines


def compare_laws(
    sets: Sequence[Dataset],
    candidates: Sequence[tuple[str, int]] | None = None,
    progress: Callable[[str], None] = lambda title: None,
    refuses: Callable[[MaterialFit], str] | None = None,
    up_to: float | None = None,
    **options: Any,
) -> Comparison:
    """Fit several laws and rank them by AICc.

    Args:
        sets: the data.
        candidates: laws and numbers of terms; None for those that the laws declare.
        progress: called with each law's title before it is fitted.
        refuses: a reason against a fit that is about to be recommended; "" for none.
        up_to: largest stretch that is asked for; None for that of the data.
        options: as for `fit_material`.

    Raises:
        NoFit: every law failed; says why each.
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
            fit = fit_material(sets, chosen, doubt=False, **options)
        except NoFit as error:
            failed[chosen.title] = str(error).removeprefix(f"{chosen.title}: ")
            continue
        if fit.status == "not_converged":
            failed[chosen.title] = "no start converged"
        else:
            fits.append(fit)
    if not fits:
        reasons = (f"{title}: {reason}" for title, reason in failed.items())
        raise NoFit("no law could be fitted: " + "; ".join(reasons))
    comparison = dataclasses.replace(ranked(fits, failed), up_to=up_to)
    while refuses is not None and comparison.best.family.title not in comparison.refused:
        best = comparison.best
        if not (reason := refuses(best)):
            break
        refused = {**comparison.refused, best.family.title: reason}
        comparison = dataclasses.replace(comparison, refused=refused)
    return comparison


def ranked(
    fits: Sequence[MaterialFit],
    failed: dict[str, str],  # reasons, by title, of those that could not be fitted
    refused: Mapping[str, str] | None = None,  # further reasons against them, by title
) -> Comparison:
    """Fits of the same data, lowest AICc first; those that did not converge go last."""
    comparison = Comparison(tuple(fits), failed, dict(refused or {}))

    def rank(fit: MaterialFit) -> tuple[bool, float]:
        aicc = comparison.aicc(fit)
        return fit.status == "not_converged", aicc if np.isfinite(aicc) else np.inf

    return dataclasses.replace(comparison, fits=tuple(sorted(fits, key=rank)))


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

    `progress`: called with each title before it is fitted.
    Raises NoFit: no number of terms could be fitted.
    """
    fits: list[MaterialFit] = []
    failed, refused = dict[str, str](), dict[str, str]()
    for count in range(1, MOST_PRONY_TERMS + 1):
        progress(f"{law}, {count} Prony term{'s' if count > 1 else ''}")
        try:
            fit = fit_material(sets, law, terms, prony=count, doubt=False, **options)
        except NoFit as error:
            failed[f"{count} Prony terms"] = str(error)
            break
        if reason := undetermined_term(fit):
            refused[fit.family.title] = reason
        fits.append(fit)
        if len(fits) > 1 and fit.criteria[0] > fits[-2].criteria[0] - _GAIN:
            break
    if not fits:
        raise NoFit("; ".join(failed.values()))
    return ranked(fits, failed, refused)


def undetermined_term(fit: MaterialFit) -> str:
    """Which Prony term of a fit the data don't determine, and why; "" if all are."""
    found = block_of(fit.family, Relaxation)
    assert found is not None
    series, place = found
    g, tau = series.terms(fit.constants[place])
    errors, _ = series.terms(fit.uncertainty.standard_errors[place])
    shortest, longest = window_of(fit.sets, series.count)
    for share, error, time in zip(g, errors, tau, strict=True):
        if not error < _UNKNOWN_SHARE * share:
            return f"the share {share:.2g} of the term of {time:.3g} s is not determined"
        if not shortest / _BEYOND < time < longest * _BEYOND:
            measured = f"{shortest:.3g} to {longest:.3g} s"
            return f"a term of {time:.3g} s lies outside of the times measured, {measured}"
    tau = np.sort(tau)
    for first, second in itertools.pairwise(tau):
        if np.log(second) - np.log(first) < np.log(_APART):
            return f"terms of {first:.3g} and {second:.3g} s are one"
    return ""
