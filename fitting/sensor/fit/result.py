"""The result of a sensor calibration."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from fitting.sensor.fit.residuals import Prior, SensorProblem, SensorResiduals
from fitting.sensor.logs.data import SensorData
from fitting.sensor.logs.known_loads import KnownLoads
from fitting.sensor.logs.taxel_faults import Masked
from fitting.sensor.model.constants import SensorFamily
from fitting.sensor.shapes.shapes import Shapes
from fitting.statistics.diagnostics import Misfit
from fitting.statistics.identifiability import Uncertainty


@dataclasses.dataclass(frozen=True)
class SensorFit:
    """A calibration.

    Attributes:
        data: the readings.
        problem: what was fitted to what, priors and noise included.
        shapes: the membrane in the known states.
        loads: the known states, the baseline's included.
        constants: fitted, SI [p].
        converged: whether it is a minimum, with shapes that don't change any more.
        cost: half the sum of squared residuals.
        held: names of the constants that stopped at the smallest value that there is.
        uncertainty: covariance, priors included.
        alone: standard errors without priors [p]; infinite where the data leave a constant
            open.
        ratio: permittivity over gap with its standard error [1/m].
        misfit: whether what remains is noise.
        noise: standard deviation of a reading [taxel, log], counts.
        masked: all that was left out.
        outliers: how many readings were.
        offsets: of every taxel with its standard error [2, taxel], counts; None if not
            asked for.
        drift: of every taxel and log [taxel, log], counts/s; None where there is none.
        findings: what the data don't determine, in words.
        contributions: what each log, and each fluid, contributes to every constant.
        warnings: what a person should know.
    """

    data: SensorData
    problem: SensorProblem
    shapes: Shapes
    loads: KnownLoads
    constants: np.ndarray
    converged: bool
    cost: float
    held: tuple[str, ...]
    uncertainty: Uncertainty
    alone: np.ndarray
    ratio: tuple[float, float] | None
    misfit: Misfit
    noise: np.ndarray
    masked: tuple[Masked, ...]
    outliers: int
    offsets: np.ndarray | None
    drift: np.ndarray | None
    findings: tuple[str, ...]
    contributions: tuple[dict[str, Any], ...]
    warnings: tuple[str, ...]

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
