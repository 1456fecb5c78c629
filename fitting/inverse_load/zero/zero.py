"""What is known after known presses: a skin's inputs with the covariance of their errors."""

from dataclasses import dataclass

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.zero.gaussian import Gaussian
from suas_jax.config import InputErrors, SkinSpec, with_inputs
from suas_jax.config.input_errors import value_of

_LSB = "electrodes.lsb"


@dataclass(frozen=True)
class KnownPress:
    """One press with a known force."""

    angle: float  # where, as sections define angles [rad]
    force: float  # inwards [N]
    angle_deviation: float  # standard deviation of the place [rad]
    force_deviation: float  # of the force [N]
    text: str  # as it was told
    axial: float | None = None  # where along a pad [m]; None in plane strain
    axial_deviation: float = 0.0  # its standard deviation [m]
    diameter: float = 0.0  # of the disc that presses on a pad [m]

    @property
    def quantities(self) -> tuple[float, ...]:
        """Angle, axial position on a pad, force."""
        return self.angle, *(() if self.axial is None else (self.axial,)), self.force

    @property
    def deviations(self) -> tuple[float, ...]:
        """Standard deviations of the quantities."""
        along = () if self.axial is None else (self.axial_deviation,)
        return self.angle_deviation, *along, self.force_deviation


@dataclass(frozen=True)
class Zero:
    """What known presses say."""

    errors: InputErrors  # of the inputs, as they were before
    posterior: Gaussian  # of the errors, in standard deviations
    presses: tuple[KnownPress, ...]  # in the order of the log
    # standard deviation of a force estimated at each press, without the zero [press], relative
    before: Floats
    after: Floats  # the same with it
    chi2_per_dof: float  # of the presses' readings; about 1 where the model holds
    status: str  # "ok", or "poor_fit" where the covariance is scaled up by chi2

    @property
    def values(self) -> Floats:
        """Most probable inputs [path], SI."""
        return inputs_at(self.errors, self.posterior.mean)

    @property
    def covariance(self) -> Floats:
        """Of the inputs [path, path], SI."""
        columns = self.errors.directions
        return np.asarray(columns.T @ self.posterior.covariance @ columns)


def inputs_at(errors: InputErrors, e: Floats) -> Floats:
    """Inputs [path] at some errors [error], SI."""
    own = np.array([value_of(errors.spec, path) for path in errors.paths])
    return np.asarray(own + e @ errors.directions)


def zeroed_inputs(spec: SkinSpec, values: dict[str, float]) -> SkinSpec:
    """A skin with other inputs, which state no deviations any more.

    Raises ValueError: a path is none of its inputs, or a value is not allowed.
    """
    if _LSB in values and spec.electrodes is not None:  # which files need not give
        electrodes = spec.electrodes.model_copy(update={"lsb": values[_LSB]})
        spec = spec.model_copy(update={"electrodes": electrodes})
    return with_inputs(spec, values)  # type: ignore[arg-type]
