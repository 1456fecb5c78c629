"""A law with the constants that follow the data: what it reads, and where it is stable."""

import dataclasses
import functools
from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from fitting.material.experiments.measurements import PATHS, Dataset
from fitting.material.experiments.prediction import Homogeneous, padded
from fitting.material.fit.problem import MaterialProblem, readings
from fitting.material.fit.specimens import Specimens
from fitting.material.laws.parameters import Family
from fitting.statistics.identifiability import Uncertainty
from fitting.statistics.residuals import sensitivity
from suas_jax.constitutive import AbstractLaw, stable_range

_LANES = 64  # readings of one compiled evaluation
STABLE_LIMITS = (0.01, 100.0)
"""Stretches between which the ends of stability are looked for."""


@dataclasses.dataclass(frozen=True)
class FittedLaw:
    """A law fitted to data; see `MaterialFit`."""

    # its residuals, with the data that were fitted; a posterior samples
    # `problem.residuals.log_likelihood`
    problem: MaterialProblem
    constants: np.ndarray  # SI units, in the order of `family.names`
    uncertainty: Uncertainty  # covariance and identifiability
    # factors of several specimens of one mode; None where there is one each
    specimens: Specimens | None
    bounded: tuple[str, ...]  # constants that stopped at a bound
    bounds: Mapping[str, tuple[float, float]]  # hard bounds by constant, SI units

    @property
    def sets(self) -> tuple[Dataset, ...]:
        """The data that were fitted."""
        return self.problem.sets

    @property
    def family(self) -> Family:
        """The law's family."""
        return self.problem.residuals.family

    @property
    def law(self) -> AbstractLaw:
        """The fitted law."""
        return self.family.law(jnp.asarray(self.constants))

    def stress(
        self, factors: np.ndarray, constants: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Readings at e₁, e₂, c₁, c₂ [4, n] in Pa, with derivatives by the law's constants."""
        at = jnp.asarray(self.constants if constants is None else constants)
        found = []
        for first in range(0, factors.shape[1], _LANES):
            part = factors[:, first : first + _LANES]
            test = Homogeneous(*(padded(x) for x in part))
            found.append(
                [np.asarray(x)[: part.shape[1]] for x in _prediction(self.family, test, at)]
            )
        values, slopes = zip(*found, strict=True)
        return np.concatenate(values), np.concatenate(slopes)

    @functools.cached_property
    def stable(self) -> dict[str, tuple[float, float]]:
        """Stretches around one in which the law is stable, by mode; see `STABLE_LIMITS`."""
        found = {}
        for mode, path in PATHS.items():
            low, high = stable_range(self.law, path, STABLE_LIMITS)
            found[mode] = (float(low), float(high))
        return found

    def misfits(self) -> list[np.ndarray]:
        """Predicted less measured readings of each data set [Pa]."""
        residuals = self.problem.residuals
        predicted, _ = readings(residuals, jnp.asarray(self.constants))
        difference = np.asarray(predicted - residuals.value)
        return [difference[place] for place in self.problem.places]

    def half_widths(self) -> list[np.ndarray]:
        """Half widths of the 95 % intervals of the predicted readings of each data set [SI]."""
        residuals = self.problem.residuals
        _, J = sensitivity(residuals, jnp.asarray(self.constants))
        deviation = self.uncertainty.spread_of(np.asarray(jax.vmap(residuals.misfit, 1, 1)(J)))
        half = self.uncertainty.quantile(0.95) * deviation
        return [half[place] for place in self.problem.places]


@eqx.filter_jit
def _prediction(
    family: Family, test: Homogeneous, constants: jax.Array
) -> tuple[jax.Array, jax.Array]:
    def stress(c: jax.Array) -> jax.Array:
        return test.predict(family.law(c))

    return stress(constants), jax.jacfwd(stress)(constants)
