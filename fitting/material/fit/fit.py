"""Fit a law to test data."""

import dataclasses
from collections.abc import Mapping, Sequence

import jax.numpy as jnp
import numpy as np

from fitting.material.experiments.artefacts import Suspect
from fitting.material.experiments.data_checks import returns
from fitting.material.experiments.free_zero import KINDS as ZERO_KINDS
from fitting.material.experiments.free_zero import can_be_freed, without_toe
from fitting.material.experiments.measurements import Dataset, StressTest
from fitting.material.fit.noise import judged_residuals, noise_of, noise_remark
from fitting.material.fit.preparation import prepared, refuse_what_forgets, window_of
from fitting.material.fit.problem import MaterialProblem
from fitting.material.fit.result import MaterialFit
from fitting.material.fit.search import (
    NoFit,
    SearchSettings,
    minimise_in_box,
    most_starts,
    refuse_without_stiffness,
    search_for_typical_specimen,
    weighed_search,
)
from fitting.material.fit.specimens import has_several_specimens
from fitting.material.fit.suspects import fit_suspects, with_zeros, zero_in_units, zeros_of
from fitting.material.laws.blocks import Relaxation, Softening
from fitting.material.laws.parameters import Family
from fitting.material.laws.registry import family
from fitting.statistics.identifiability import uncertainty
from fitting.statistics.least_squares import Minima
from suas_jax.runtime.compiled import require_float64

_STARTS_IN_BOX = 5
_ZEROS = {"slack", "force offset"}  # shown by a curve, which something else may explain, too
# Means of a curve lie on it to far below its noise. Those of a history do with runs this short:
# measured, z of Ogden and Roxburgh's constants is 2600 √N/n² for n runs of N readings.
_THIN, _THIN_HISTORY = 500, 10_000
# Shares of the largest stress at which a toe may end.
_TOES = (0.05, 0.1, 0.2, 0.3, 0.4)
_FEWEST_BEHIND_TOE, _CLEAR = 12, 5.0
# Zeros that are found with the law, of which one takes care of an artefact.
_MENDS = {"slack": ("slack", "force"), "toe": ("slack",), "force offset": ("force", "slack")}


def fit_material(
    sets: Sequence[Dataset],
    law: str | Family = "ogden",
    terms: int | None = None,
    *,
    residual: str = "relative",
    starts: int = 64,
    seed: int = 0,
    branch: str | None = None,
    cycle: str = "all",
    cut_break: bool = False,
    cut_spikes: bool = False,
    thin: int | None = None,
    zero: Sequence[str] = (),
    bounds: Mapping[str, tuple[float, float]] | None = None,
    prony: int = 0,
    mullins: bool = False,
    doubt: bool = True,
) -> MaterialFit:
    """Find the constants of a law that follow test data best.

    Args:
        sets: the data, from `datasets.load_dataset`.
        law: a value of `law` in [material], or a family of one's own.
        terms: number of terms, if the law has any.
        residual: "relative", "absolute", "noise" or "estimated", see `problem.pose`.
        starts: number of starting points.
        seed: of the random starting points.
        branch: "all", or "loading" to leave unloading branches out; None takes all.
        cycle: "all", or the loading of the "first", the "last" or a numbered cycle.
        cut_break: leave out what follows the failure of a specimen.
        cut_spikes: leave out readings that stand out from their neighbours.
        thin: most readings of a curve; more are averaged to half as many. Zero keeps all, None
            takes 500, or 10,000 where a reading depends on those before it.
        zero: what is found with the law: "slack", "force", "machine".
        bounds: hard bounds by constant, SI units, such as {"alpha.0": (1, 3)}.
        prony: number of Prony terms of a law whose stress relaxes; zero for an elastic one.
        mullins: whether the stress softens below the largest load before.
        doubt: look for artefacts that explain a misfit, and for the end of a toe.

    Raises:
        ValueError: law, terms, residual, branch or bounds are not allowed.
        NoFit: no start gave finite residuals, or the best law has no stiffness at rest.
        Float64Error: float64 is off.
    """
    require_float64()
    chosen = law if isinstance(law, Family) else family(law, terms)
    if starts < 1:
        raise ValueError(f"--starts {starts}: at least one is needed")
    if thin is not None and thin < 0:
        raise ValueError(f"--thin {thin}: a number of readings is expected; 0 keeps all")
    unknown = [kind for kind in zero if kind not in ZERO_KINDS]
    if unknown:
        raise ValueError(f"--zero {unknown[0]}: unknown; allowed: {', '.join(ZERO_KINDS)}")
    settings = SearchSettings(residual, starts, seed, tuple(dict.fromkeys(zero)))
    remembers = prony > 0 or mullins
    if thin is None:
        thin = _THIN_HISTORY if remembers else _THIN
    if remembers:
        refuse_what_forgets(branch, cycle, zero, bounds)
    used, notes, suspects = prepared(
        sets,
        branch,
        cycle,
        zero,
        cut_break=cut_break,
        cut_spikes=cut_spikes,
        thin=thin,
        remembers=remembers,
    )
    if remembers:
        window = window_of(used, prony)
        series = (Relaxation(prony, window),) if prony else ()
        softening = (Softening(),) if mullins else ()
        chosen = dataclasses.replace(chosen, beside=(*series, *softening))
    fit = _fitted(used, chosen, bounds, notes, suspects, settings, doubt=doubt)
    refuse_without_stiffness(fit.sets, fit.family, fit.constants)
    if not (doubt and "slack" in zero and fit.misfit.significant):
        return fit
    gone = False
    for share in _TOES:
        rest = [without_toe(data, share) for data in used]
        shorter = _fitted(rest, chosen, bounds, notes, suspects, settings)
        # A toe fades; what is left of it where it can no longer be seen still pulls.
        if gone or (share == _TOES[-1] and not shorter.misfit.significant):
            refuse_without_stiffness(shorter.sets, shorter.family, shorter.constants)
            text = f"readings below {100.0 * share:.0f} % of the largest stress left out: a toe"
            return dataclasses.replace(shorter, remarks=(*shorter.remarks, text))
        gone = not shorter.misfit.significant
    return fit


def _fitted(
    used: list[Dataset],
    chosen: Family,
    bounds: Mapping[str, tuple[float, float]] | None,
    notes: list[str],
    suspects: list[Suspect],
    settings: SearchSettings,
    *,
    doubt: bool = False,
) -> MaterialFit:
    """The fit of prepared data, and what explains its misfit."""
    residual, starts, seed, zero = settings
    notes = [*notes]
    suspects = [s for s in suspects if not any(k in zero for k in _MENDS.get(s.kind, ()))]
    zeros = zeros_of(used, zero) if zero else ()
    wider = with_zeros(chosen, used, zeros) if zeros else chosen
    problem, minima = weighed_search(used, wider, settings, zeros)
    specimens = None
    if np.isfinite(minima.cost[0]) and not zeros and not bounds and has_several_specimens(used):
        specimens, problem, minima = search_for_typical_specimen(
            wider, problem, minima, settings
        )
    if not np.isfinite(minima.cost[0]):
        raise NoFit(
            f"{chosen.title}: none of {starts} starts gave finite stresses; check the units, "
            f"or choose another law"
        )
    starts = most_starts(used, starts)
    if problem.model_error and residual != "noise":
        notes.append(
            f"the corrected shell's own error, about {100.0 * problem.model_error:.2g} % of "
            f"a skin's readings, is in no interval; state the noise and use "
            f"--residual noise, which allows for it"
        )
    scales = problem.residuals.scales
    constants = np.asarray(wider.constants(jnp.asarray(minima.theta[0]), scales))
    constants = wider.ordered(constants)
    at_bounds: tuple[str, ...] = ()
    if bounds:
        constants, minima, at_bounds = _bounded(problem, minima, constants, bounds, seed)
        if at_bounds:
            notes.append(f"at a bound, and held there in all intervals: {', '.join(at_bounds)}")
    known = residual == "noise"
    noise = noise_of(problem, constants)
    misfit = judged_residuals(problem, constants, noise, known_noise=known)
    ratio = noise.ratio if noise.excluded and not known else None
    if ratio is not None:
        notes.append(noise_remark(problem.sets, noise, residual))
    judged = uncertainty(
        problem.residuals,
        constants,
        known_noise=known,
        inflation=misfit.inflation,
        held=at_bounds,
        noise_ratio=ratio,
    )
    if specimens is not None and specimens.differ:
        stresses = np.where(wider.stresses, constants, 0.0)
        judged = judged.with_error(stresses * specimens.mean_error)
        notes.append(
            f"the specimens differ by {100.0 * specimens.scatter.deviation:.2g} % in stiffness "
            f"beyond their noise; the constants are those of the typical one"
        )
    named = {suspect.kind for suspect in suspects}
    if doubt and misfit.significant and named <= _ZEROS and not bounds:
        explaining = fit_suspects(problem, constants, noise)
        suspects += [suspect for suspect in explaining if suspect.kind not in named]
        if not suspects and not zero:
            suspects += _toe(problem.sets, chosen, settings)
    notes += [suspect.text for suspect in suspects]
    return MaterialFit(
        problem,
        constants,
        judged,
        specimens,
        at_bounds,
        dict(bounds or {}),
        minima,
        misfit,
        starts,
        tuple(notes),
        noise,
        tuple(suspects),
    )


def _bounded(
    problem: MaterialProblem,
    minima: Minima,
    constants: np.ndarray,
    bounds: Mapping[str, tuple[float, float]],
    seed: int,
) -> tuple[np.ndarray, Minima, tuple[str, ...]]:
    """The minimum inside hard bounds; see `minimise_in_box`."""
    family = problem.residuals.family
    others = family.random(np.random.default_rng(seed + 1), _STARTS_IN_BOX)
    if any(data.mode == "bulge" for data in problem.sets):
        others = minima.theta[1:2]  # membranes are expensive
    found = minimise_in_box(problem.residuals, family, constants, others, bounds)
    if not np.isfinite(found[1].cost[0]):
        raise NoFit(
            f"{family.title}: --bound leaves no constants with finite stresses for all "
            f"readings; widen the bounds, or choose another law"
        )
    return found


def _toe(sets: Sequence[Dataset], chosen: Family, settings: SearchSettings) -> list[Suspect]:
    """A toe, if the law follows what is left without it, with the slack found."""
    if len(sets) > 1 or not can_be_freed(sets[0]):
        return []
    (data,) = sets
    assert isinstance(data, StressTest)
    if returns(data):  # what a loop leaves is the material's, as in `fit_suspects`
        return []
    for share in _TOES:
        rest = without_toe(data, share)
        if rest.size < _FEWEST_BEHIND_TOE:
            break
        found = _fitted([rest], chosen, None, [], [], settings._replace(zero=("slack",)))
        slack, error = found.constants[chosen.size], found.uncertainty.standard_errors[-1]
        if slack < _CLEAR * error:
            continue
        if not found.misfit.significant:
            amount, accuracy, unit = zero_in_units("slack", slack, error, data)
            text = (
                f"above {100.0 * share:.0f} % of the largest stress the law follows the data "
                f"if {amount:.3g} +- {accuracy:.2g} {unit} of slack were taken up before"
            )
            return [Suspect("toe", data.file, text, "--zero slack", float(amount), unit)]
    return []
