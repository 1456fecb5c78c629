"""What is known after known presses: a skin's inputs with the covariance of their errors."""

import dataclasses
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from fitting.arrays import Floats
from suas_jax.config import InputErrors, SkinSpec, with_inputs
from suas_jax.config.input_errors import value_of

_LSB = "electrodes.lsb"
_CAUSES = {  # beginnings of paths
    "material.": "stiffness",
    "oil.fill": "filling",
    "geometry.mounting": "mounting",
    "geometry.thickness": "thickness",
    "geometry.oil_gap": "gap",
    "environment.temperature": "temperature",
    "oil.relative_permittivity": "permittivity",
    _LSB: "scale",
}
_ABSOLUTE = {"mounting": "of the length", "temperature": "K"}  # of which no share is told


class Gaussian(NamedTuple):
    """A normal distribution."""

    mean: Floats  # [parameter]
    covariance: Floats  # [parameter, parameter]


def conditioned(
    prior: Gaussian, at: Floats, jacobian: Floats, residual: Floats, weight: Floats
) -> Gaussian:
    """The posterior after measurements y = h(x) + noise, with h linear about a point.

    With r = y - h(x_0) and J = dh/dx there, P = (P_0^-1 + J^T W J)^-1 and
    x = x_0 + P (J^T W r + P_0^-1 (m - x_0)). Repeated at its own mean it is the
    Gauss-Newton method for the most probable x.

    The prior is one of full rank; the point is x_0 [parameter], with J [measurement, parameter]
    and r [measurement] there. Weights are inverse variances of the noise, zero where nothing
    was measured [measurement].
    """
    before = np.linalg.inv(prior.covariance)
    information = before + jacobian.T @ (weight[:, None] * jacobian)
    covariance = np.linalg.inv(information)
    pull = jacobian.T @ (weight * residual) + before @ (prior.mean - at)
    return Gaussian(at + covariance @ pull, (covariance + covariance.T) / 2)


@dataclasses.dataclass(frozen=True)
class KnownPress:
    """One press with a known force."""

    angle: float  # where, as sections define angles [rad]
    force: float  # inwards [N]
    angle_deviation: float  # standard deviation of the place [rad]
    force_deviation: float  # of the force [N]
    text: str  # as it was told
    place: float  # where, as scenes of its section tell it: an angle [rad], or an arc [m]
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


class Cause(NamedTuple):
    """Inputs that are one thing to a person, such as the thickness at all of its nodes."""

    name: str
    change: float  # of their sum, relative; of mounting and temperature their mean's
    deviation: float  # its standard deviation
    before: float  # that without the zero
    unit: str  # empty: a share of the value; "SI" where the value is zero

    @property
    def text(self) -> str:
        """Change and standard deviation, such as "filling -0.19 ± 0.05 %"."""
        if self.unit in ("K", "SI"):
            return f"{self.name} {self.change:+.2g} ± {self.deviation:.2g} {self.unit}"
        own, error = 100 * self.change, 100 * self.deviation
        digits = int(np.clip(1 - np.floor(np.log10(max(error, 1e-9))), 0, 6))
        return f"{self.name} {own:+.{digits}f} ± {error:.{digits}f} % {self.unit}".rstrip()


@dataclasses.dataclass(frozen=True)
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
    taken: str = ""  # when the log began, as its header says
    at_rest: bool = False  # whether the readings at rest counted, too, as they are
    # how many times the skin file's readings all taxels read at rest; None where not alike
    rest_factor: float | None = None
    # as `after`, of half and of twice each press's force; NaN where the model has no state
    after_at: Mapping[str, Floats] = dataclasses.field(default_factory=dict)

    @property
    def values(self) -> Floats:
        """Most probable inputs [path], SI."""
        return inputs_at(self.errors, self.posterior.mean)

    @property
    def covariance(self) -> Floats:
        """Of the inputs [path, path], SI."""
        columns = self.errors.directions
        return np.asarray(columns.T @ self.posterior.covariance @ columns)

    @property
    def causes(self) -> list[Cause]:
        """What moved, the inputs of a kind together: first what the presses told most of."""
        own = inputs_at(self.errors, np.zeros(len(self.errors)))
        groups: dict[str, list[int]] = {}
        for k, path in enumerate(self.errors.paths):
            known = (name for start, name in _CAUSES.items() if path.startswith(start))
            groups.setdefault(next(known, path), []).append(k)
        found = []
        for name, rows in groups.items():
            size = np.abs(own[rows]).sum()
            unit = _ABSOLUTE.get(name, "" if size else "SI")
            # Of constants of a material, or nodes of a sheet, the sizes are summed.
            share = np.full(len(rows), 1 / len(rows)) if unit else np.sign(own[rows]) / size
            by = self.errors.directions[:, rows] @ share
            root = np.sqrt([by @ self.posterior.covariance @ by, by @ by]).tolist()
            found.append(Cause(name, float(self.posterior.mean @ by), root[0], root[1], unit))
        return sorted(found, key=lambda cause: -abs(cause.change) / cause.before)


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
