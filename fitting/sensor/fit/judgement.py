"""What a calibration is worth: its errors, whether it follows the counts, and what to warn of.

The constants are found; what remains of the counts is compared with their noise, the errors of
the constants are widened where it is more, and all that a person should know is put into words.
"""

import numpy as np

from fitting.sensor.fit.checks import disagreement_warning, masked_taxels, noise_warning
from fitting.sensor.fit.priors import findings, log_contributions
from fitting.sensor.fit.residuals import SensorProblem, bounds_of
from fitting.sensor.fit.result import SensorFit
from fitting.sensor.fit.search import Found
from fitting.sensor.logs.data import SensorData
from fitting.sensor.logs.known_loads import KnownLoads
from fitting.sensor.model.constants import GAP, PATHS, PERMITTIVITY
from fitting.sensor.shapes.shapes import Shapes
from fitting.statistics.diagnostics import misfit
from fitting.statistics.identifiability import Uncertainty, uncertainty


def judged_fit(
    data: SensorData,
    problem: SensorProblem,
    found: Found,
    shapes: Shapes,
    loads: KnownLoads,
    noise: np.ndarray,
    touching: np.ndarray,
    steady: bool,
    warnings: list[str],
) -> SensorFit:
    """A calibration with its errors, its misfit and its warnings.

    Args:
        data: the logs.
        problem: what was fitted to what, with the measured noise.
        found: its minimum.
        shapes: the membrane in the known states.
        loads: the known states, the baseline's included.
        noise: standard deviation of a reading [taxel, log], counts.
        touching: readings of taxels that the membrane touches [taxel, frame].
        steady: whether the shapes change no more.
        warnings: of the search.
    """
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
        problem.residuals(),
        constants,
        known_noise=True,
        inflation=judged_misfit.inflation,
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
        warnings.append(words + (hint if problem.model.factor is None else ""))
    warnings += [disagreement_warning(problem, constants), noise_warning(noise, data)]
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
    )


def _ratio(
    problem: SensorProblem, constants: np.ndarray, judged: Uncertainty
) -> tuple[float, float] | None:
    """Permittivity over gap with its standard error; None with several gaps."""
    names = problem.family.names
    if PERMITTIVITY not in names or problem.model.gap_of is not None:
        return None
    i = names.index(PERMITTIVITY)
    gradient = np.zeros(len(names))
    gap = float(problem.model.inputs[PATHS[GAP]])
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
