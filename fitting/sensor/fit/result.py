"""The result of a sensor calibration and what it is worth: errors, misfit, and what to warn of.

The constants are found; what remains of the counts is compared with their noise, the errors of
the constants are widened where it is more, and all that a person should know is put into words.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np

from fitting.arrays import Floats
from fitting.sensor.fit.assumptions import contradiction_warning, pulled_warning
from fitting.sensor.fit.checks import (
    disagreement_warning,
    exchanged_warning,
    masked_taxels,
    noise_warning,
    wall_warning,
)
from fitting.sensor.fit.input_noise import InputErrors, noise_sentences
from fitting.sensor.fit.priors import findings, log_contributions
from fitting.sensor.fit.residuals import Prior, SensorProblem, SensorResiduals, bounds_of
from fitting.sensor.fit.search import Found
from fitting.sensor.logs.data import SensorData
from fitting.sensor.logs.known_loads import KnownLoads
from fitting.sensor.logs.log import Masked
from fitting.sensor.model.as_built import PlaceErrors
from fitting.sensor.model.constants import GAP, PATHS, PERMITTIVITY, PLACE, PUSH, SensorFamily
from fitting.sensor.model.counts import parts_of
from fitting.sensor.shapes.shapes import Shapes
from fitting.statistics.diagnostics import Misfit, misfit
from fitting.statistics.discrepancy import Discrepancy, Presses, learned
from fitting.statistics.identifiability import Uncertainty, uncertainty
from fitting.statistics.residuals import sensitivity


@dataclasses.dataclass(frozen=True)
class SensorFit:
    """A calibration."""

    data: SensorData  # the readings
    problem: SensorProblem  # what was fitted to what, priors and noise included
    shapes: Shapes  # the membrane in the known states
    loads: KnownLoads  # the known states, the baseline's included
    constants: np.ndarray  # fitted, SI [p]
    converged: bool  # whether it is a minimum, with shapes that don't change any more
    cost: float  # half the sum of squared residuals
    held: tuple[str, ...]  # names of the constants that stopped at the smallest value there is
    uncertainty: Uncertainty  # covariance, priors included
    # standard errors without priors [p]; infinite where the data leave a constant open
    alone: np.ndarray
    ratio: tuple[float, float] | None  # permittivity over gap with its standard error [1/m]
    misfit: Misfit  # whether what remains is noise
    noise: np.ndarray  # standard deviation of a reading [taxel, log], counts
    masked: tuple[Masked, ...]  # all that was left out
    outliers: int  # how many readings were
    # of every taxel with its standard error [2, taxel], counts; None if not asked for
    offsets: np.ndarray | None
    drift: np.ndarray | None  # [taxel, log], counts/s; None where there is none
    findings: tuple[str, ...]  # what the data don't determine, in words
    contributions: tuple[dict[str, Any], ...]  # what each log, and each fluid, tells
    warnings: tuple[str, ...]  # what a person should know
    input_errors: InputErrors  # of known forces and displacements
    discrepancy: Discrepancy | None = None  # from the model, as presses show; of sections

    @property
    def residuals(self) -> SensorResiduals:
        """The misfit; a posterior samples its `log_likelihood`."""
        return self.problem.residuals()

    @property
    def family(self) -> SensorFamily:
        """The calibrated constants."""
        return self.problem.family

    @property
    def priors(self) -> Mapping[str, Prior]:
        """What was assumed, by constant."""
        return self.problem.priors

    @property
    def force(self) -> np.ndarray:
        """On each load, given or found [load, state, N]."""
        return self.shapes.force

    @property
    def displacement(self) -> np.ndarray:
        """Of each load [load, state, m]."""
        return self.shapes.displacement

    def place_shift(self, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """By how much presses at angles [place] are felt further along than told [rad].

        With its covariance [place, place]; None where presses have no places to be found, and
        on pads.
        """
        at = [i for i, n in enumerate(self.family.names) if n.startswith(f"{PLACE}.")]
        if not at or self.data.spec.geometry.dimension == 3:
            return None
        own = self.uncertainty.covariance[np.ix_(at, at)]
        told = self.data.loads.angle[0, np.flatnonzero(self.data.loaded)]
        errors = PlaceErrors(told, self.family.parts[at[0]].size)
        return errors.shared(self.constants[at], own, angle)

    @property
    def force_scatter(self) -> float | None:
        """Relative deviation of presses' forces as presses tell it; None of other fits."""
        prior = self.priors.get(f"{PUSH}.0")
        return None if prior is None else prior.sd

    @property
    def status(self) -> str:
        """How the search ended, one word."""
        return "converged" if self.converged else "not_converged"

    @property
    def errors(self) -> np.ndarray:
        """Predicted less measured counts of the readings used, NaN elsewhere [taxel, frame].

        Offsets and drift are taken out.
        """
        here = self.problem.readings
        r = self.problem.standardised(self.constants)
        return np.where(here.used, r * here.sigma, np.nan)[:, : self.data.so.shape[1]]


def judged_fit(
    data: SensorData,
    problem: SensorProblem,  # what was fitted to what, with the measured noise
    found: Found,  # its minimum
    shapes: Shapes,  # the membrane in the known states
    loads: KnownLoads,  # the known states, the baseline's included
    noise: np.ndarray,  # standard deviation of a reading [taxel, log], counts
    touching: np.ndarray,  # readings of taxels that the membrane touches [taxel, frame]
    steady: bool,  # whether the shapes change no more
    inputs: InputErrors,  # of known inputs
    warnings: list[str],  # of the search
) -> SensorFit:
    """A calibration with its errors, its misfit and its warnings."""
    constants, family, here = found.constants, problem.family, problem.readings
    r = problem.standardised(constants)
    paths = [
        row[used & (here.log == k)]
        for k in range(here.logs)
        for row, used in zip(r, here.used, strict=True)
    ]
    typical = float(np.sqrt(np.mean((here.so / here.sigma)[here.used] ** 2)))
    judged_misfit = misfit(
        [path for path in paths if len(path)],
        family.size,
        known_noise=False,
        exact=1e-4 * typical,
    )
    judged = uncertainty(
        problem.residuals(), constants, known_noise=True, inflation=judged_misfit.inflation
    )
    sizes = problem.relative_sizes(constants)
    alone = bounds_of(problem.information(constants) / judged_misfit.inflation**2) * sizes
    held = tuple(family.names[i] for i in found.held)
    for name in held:
        warnings.append(f"{name} stopped at zero: the logs would have it negative")
    if judged_misfit.description:
        words = judged_misfit.description.replace(
            "the law does not follow the data", "the model does not follow the counts"
        ).replace("along the tests", "along the logs")
        hint = "; --field takes capacitances from the field instead of the formula"
        can = problem.model.factor is None and data.spec.geometry.dimension == 2
        warnings.append(words + (hint if can else ""))
    warnings += noise_sentences(problem, constants, loads, inputs)
    warnings += [
        *inputs.warnings,
        contradiction_warning(family, data, shapes.force, shapes.displacement),
        disagreement_warning(problem, constants),
        exchanged_warning(problem, constants, data),
        pulled_warning(problem, constants),
        noise_warning(noise, data),
        wall_warning(touching),
    ]
    offsets, drift = _taken_out(problem, constants)
    return SensorFit(
        data=data,
        problem=problem,
        shapes=shapes,
        loads=loads,
        constants=constants,
        converged=steady and bool(found.minima.converged[0]),
        cost=float(found.minima.cost[0]),
        held=held,
        uncertainty=judged,
        alone=alone,
        ratio=_ratio(problem, constants, judged),
        misfit=judged_misfit,
        noise=noise,
        masked=(*data.masked, *masked_taxels(problem, touching, data)),
        outliers=int((here.present & ~here.used).sum()),
        offsets=offsets,
        drift=drift,
        findings=tuple(findings(problem, constants, judged_misfit.inflation)),
        contributions=tuple(
            log_contributions(problem, constants, judged_misfit.inflation, data)
        ),
        warnings=tuple(dict.fromkeys(filter(None, warnings))),
        input_errors=inputs,
    )


def _ratio(
    problem: SensorProblem, constants: np.ndarray, judged: Uncertainty
) -> tuple[float, float] | None:
    """Permittivity over gap with its standard error; None with several gaps."""
    names, inputs = problem.family.names, problem.model.inputs
    if PERMITTIVITY not in names or problem.model.gap_of or PATHS[GAP] not in inputs:
        return None
    i = names.index(PERMITTIVITY)
    gradient = np.zeros(len(names))
    gap = float(inputs[PATHS[GAP]])
    if GAP in names:
        j = names.index(GAP)
        gap = constants[j]
        gradient[j] = -constants[i] / gap**2
    gradient[i] = 1 / gap
    error = float(np.sqrt(gradient @ judged.covariance @ gradient))
    return float(constants[i] / gap), error


def _taken_out(
    problem: SensorProblem, constants: np.ndarray
) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Offsets with standard errors [2, taxel], and drifts [taxel, log]."""
    here = problem.readings
    if not here.extras:
        return None, None
    found, errors = here.taken_out(here.so - problem.predicted(constants))
    silent = ~here.used.any(1)
    found[silent], errors[silent] = np.nan, np.nan
    offsets = np.stack([found[:, 0], errors[:, 0]]) if here.offsets else None
    return offsets, found[:, -here.logs :] if here.drifting else None


def with_discrepancy(fit: SensorFit) -> SensorFit:
    """A unit's calibration with what its presses show beyond the model; a pad's as it is.

    See `fitting.statistics.discrepancy`. Places and forces are those that were told, but for
    what places are off by together: their errors, which a fit finds press by press, would take
    up part of it.
    """
    if fit.data.spec.geometry.dimension == 3:
        return fit
    numbers = fit.problem.model.numbers(jnp.asarray(fit.constants))
    *_, electrodes = parts_of(fit.data.spec, numbers)
    taxels = np.asarray(electrodes.taxels.angle)[:, 0]
    found = learned(presses_of(fit), taxels)
    return dataclasses.replace(fit, discrepancy=found)


def presses_of(fit: SensorFit) -> Presses:
    """Told presses and what the fit leaves of their readings."""
    here, names = fit.problem.readings, fit.family.names
    _, slopes = sensitivity(fit.residuals, jnp.asarray(fit.constants))
    taxels, frames = here.so.shape
    by = np.asarray(slopes)[: here.so.size].reshape(taxels, frames, -1) * here.sigma[..., None]
    left = -fit.problem.standardised(fit.constants) * here.sigma
    left = np.where(here.used, left, np.nan)
    so = fit.problem.predicted(fit.constants)
    loaded = np.append(fit.data.loaded, False)  # a baseline's state comes last
    pressed = loaded[here.state]
    change = np.nan_to_num(so - so[:, ~pressed].mean(1, keepdims=True))
    angle = fit.data.loads.angle[0, here.state[pressed]]
    shared = fit.place_shift(angle)
    shifts = np.zeros(len(angle)) if shared is None else shared[0]
    rows: list[tuple[Floats, ...]] = []
    states = [int(k) for k in np.flatnonzero(loaded)]
    for i, shift in zip(np.flatnonzero(pressed), shifts, strict=True):
        number = states.index(int(here.state[i]))
        k, m = (names.index(f"{kind}.{number}") for kind in (PLACE, PUSH))
        place, push = by[:, i, k], by[:, i, m]
        told = left[:, i] + place * (fit.constants[k] - shift) + push * fit.constants[m]
        size, scatter = fit.family.parts[k].size, fit.priors[names[m]].sd
        rows.append((change[:, i], told, here.sigma[:, i], place * size, push * scatter))
    own = here.state[pressed]
    force = np.nan_to_num(fit.data.loads.force).sum(0)[own]
    return Presses(angle + shifts, force, *(np.array(x) for x in zip(*rows, strict=True)))
