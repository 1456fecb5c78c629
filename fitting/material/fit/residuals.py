"""From measurements and a family of laws to residuals.

r_i(θ) = √w_i (y_i(θ) − y_i) / s_i; the scale s_i says which misfit counts as one.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fitting.material.experiments.prediction import AbstractExperiment
from fitting.statistics.parameters import AbstractFamily, Scales
from fitting.statistics.residuals import AbstractResiduals, sensitivity
from suas_jax.constitutive import AbstractLaw

KINDS = ("relative", "absolute", "noise", "estimated")


class Residuals(AbstractResiduals):
    """Misfit of a family of laws to measurements, as a function of θ.

    Attributes:
        experiments: the tests, each predicting a run of readings.
        value: measured readings [Pa], shape [n] with padding.
        inverse_scale: √w/s [1/Pa], shape [n]; zero for padding.
        scales: sizes that make constants dimensionless.
        shared: errors that all readings of a test share, such as a model's own, in the form
            that `shared_error` gives them, shape [k, n]; k is zero where there are none.
        family: the law; part of the compiled program.
    """

    experiments: tuple[AbstractExperiment, ...]
    value: Float[Array, " n"]
    inverse_scale: Float[Array, " n"]
    scales: Scales
    shared: Float[Array, "k n"]
    family: AbstractFamily = eqx.field(static=True)

    @property
    def costly(self) -> bool:
        """Whether one of the tests is costly to compile."""
        return any(test.costly for test in self.experiments)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the law's constants."""
        return self.family.names

    @property
    def units(self) -> tuple[str, ...]:
        """Their SI units, "1" for a number."""
        return self.family.units

    def constants(self, theta: Float[Array, " p"]) -> Float[Array, " p"]:
        """Constants in SI units from unconstrained parameters."""
        return self.family.constants(theta, self.scales)

    @property
    def mapping(self) -> Callable[[Float[Array, " p"]], Float[Array, " p"]]:
        """The family's map from θ, with the scales."""
        return Mapping(self.scales, self.family)

    def unconstrained(self, constants: Float[Array, " p"]) -> Float[Array, " p"]:
        """Unconstrained parameters from constants."""
        return self.family.unconstrained(constants, self.scales)

    def predict(self, constants: Float[Array, " p"]) -> Float[Array, " n"]:
        """Readings [Pa] for constants in SI units, padding included."""
        law, zeros = self.family.law(constants), self.family.zeros(constants)
        return jnp.concatenate([test.shifted(zeros).predict(law) for test in self.experiments])

    def of_constants(self, constants: Float[Array, " p"]) -> Float[Array, " n"]:
        """Residuals for constants in SI units."""
        return self.weighed(self.predict(constants) - self.value)

    def linearised(
        self, constants: Float[Array, " p"]
    ) -> tuple[Float[Array, " n"], Float[Array, "n p"]]:
        """Residuals and their derivatives by the constants in SI units."""
        parts = [test.linearised(self.family, constants) for test in self.experiments]
        value, slope = (jnp.concatenate(part) for part in zip(*parts, strict=True))
        return self.weighed(value - self.value), jax.vmap(self.weighed, 1, 1)(slope)

    def weighed(self, misfit: Float[Array, " n"]) -> Float[Array, " n"]:
        """Misfit [Pa] over its scale; exactly zero for padding.

        With e the shared errors in units of the noise, residuals are multiplied by
        (I + e eᵀ)^(-1/2), which makes them independent and of unit variance again.
        """
        used = self.inverse_scale > 0.0
        r = jnp.where(used, misfit, 0.0) * self.inverse_scale
        return r - self.shared.T @ (self.shared @ r)

    def misfit(self, r: Float[Array, " n"]) -> Float[Array, " n"]:
        """Misfit [Pa] from residuals, the inverse of `weighed`; zero for padding."""
        share = 1.0 - jnp.sum(self.shared**2, axis=1)
        plain = r + self.shared.T @ ((self.shared @ r) / share)
        used = self.inverse_scale > 0.0
        return jnp.where(used, plain / jnp.where(used, self.inverse_scale, 1.0), 0.0)

    def refined(self, theta: Float[Array, " p"]) -> Float[Array, " p"]:
        """Use what is linear in a start: the shares of an Ogden law's terms."""

        def columns(law: AbstractLaw) -> Array:
            readings = [test.predict(law) for test in self.experiments]
            return self.weighed(jnp.concatenate(readings) * self.scales.stress)

        return self.family.refined(theta, columns, self.scales, self.weighed(self.value))


class Mapping(eqx.Module):
    """The map of a family from unconstrained parameters to constants.

    Attributes:
        scales: sizes that make constants dimensionless.
        family: the law.
    """

    scales: Scales
    family: AbstractFamily = eqx.field(static=True)

    def __call__(self, theta: Float[Array, " p"]) -> Float[Array, " p"]:
        """Constants in SI units."""
        return self.family.constants(theta, self.scales)


def readings(residuals: Residuals, constants: Float[Array, " p"]) -> tuple[Array, Array]:
    """Predicted readings [Pa] and residuals for constants in SI units, each [n].

    Their derivatives are computed along: every fit needs that program, and a second one
    would take longer to compile than it could save. Padding is predicted as measured.
    """
    r, _ = sensitivity(residuals, constants)
    return residuals.value + residuals.misfit(r), r


def shared_error(error: np.ndarray) -> np.ndarray:
    """A shared error as `Residuals.shared` holds it.

    Args:
        error: standard deviation of the shared error in units of each reading's noise,
            signed alike for all; zero for readings that don't share it, shape [n].

    Returns:
        d with I − d dᵀ = (I + e eᵀ)^(-1/2), shape [n].
    """
    square = float(error @ error)
    if square == 0.0:
        return error
    return error * np.sqrt((1.0 - 1.0 / np.sqrt(1.0 + square)) / square)
