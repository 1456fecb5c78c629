"""A misfit to readings as a function of constants, and its derivatives.

r(θ) is what least squares makes small, and what a posterior is built from: ½ Σ r² is the cost,
−½ Σ r²/s² − n log s the log-likelihood. θ are unconstrained parameters, c(θ) the constants.
"""

import abc
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.runtime.compiled import COMPILED


class AbstractResiduals(eqx.Module):
    """A misfit as a function of unconstrained parameters θ: what least squares minimises."""

    value: eqx.AbstractVar[Float[Array, " n"]]  # measured readings
    # √w/s, shape [n]; zero for readings that are not used
    inverse_scale: eqx.AbstractVar[Float[Array, " n"]]
    # what is found: names, SI units ("1" for a number) and the bijection that reaches it
    family: eqx.AbstractVar[Any]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the constants."""
        return self.family.names

    @property
    def units(self) -> tuple[str, ...]:
        """Their SI units, "1" for a number."""
        return self.family.units

    @property
    def mapping(self) -> Callable[[Float[Array, " p"]], Float[Array, " p"]]:
        """`constants` as a function that holds no more than it needs."""
        return self.family.constants

    def constants(self, theta: Float[Array, " p"]) -> Float[Array, " p"]:
        """Constants in SI units from unconstrained parameters."""
        return self.mapping(theta)

    def unconstrained(self, constants: Float[Array, " p"]) -> Float[Array, " p"]:
        """Unconstrained parameters from constants, the inverse of `constants`."""
        return self.family.unconstrained(constants)

    @abc.abstractmethod
    def of_constants(self, constants: Float[Array, " p"]) -> Float[Array, " n"]:
        """Residuals for constants in SI units, shape [n]."""

    def linearised(
        self, constants: Float[Array, " p"]
    ) -> tuple[Float[Array, " n"], Float[Array, "n p"]]:
        """Residuals and their derivatives by the constants in SI units."""
        return linearised(self.of_constants, constants)

    def __call__(self, theta: Float[Array, " p"]) -> Float[Array, " n"]:
        """Residuals for unconstrained parameters, shape [n]."""
        return self.of_constants(self.constants(theta))

    @property
    def effort(self) -> dict[str, bool]:
        """How their programs are compiled, as `COMPILED.run` is told."""
        return {}

    def log_likelihood(
        self, theta: Float[Array, " p"], noise: Float[Array, ""] | float = 1.0
    ) -> Float[Array, ""]:
        """Gaussian log-likelihood up to a constant, −½ Σ r²/s² − n log s.

        `theta`: unconstrained parameters. `noise`: s, standard deviation of the residuals: one
        where the scales are the known noise, otherwise estimated or sampled with the
        parameters.
        Returns the log-likelihood; −∞ where the law can't follow the test.
        """
        r = self(theta)
        count = jnp.sum(self.inverse_scale > 0.0)
        value = -0.5 * jnp.sum(r * r) / noise**2 - count * jnp.log(noise)
        return jnp.where(jnp.isfinite(value), value, -jnp.inf)

    @property
    def used(self) -> np.ndarray:
        """Which of the padded readings are measurements, shape [n]."""
        return np.asarray(self.inverse_scale) > 0.0


# What was found last: residuals, the constants asked for, the answer.
_LAST: list[tuple[Any, Any, Any]] = [(None, None, None)]


def sensitivity(
    residuals: AbstractResiduals, constants: Float[Array, " p"]
) -> tuple[Float[Array, " n"], Float[Array, "n p"]]:
    """Residuals and their derivatives with respect to the constants, SI units.

    The last ones are remembered: a report asks for those of its fit a dozen times, and
    equilibria of a pad take seconds.
    """
    known, at, last = _LAST[0]
    if known is residuals and np.array_equal(at, constants):
        return last
    found: tuple[Array, Array] = COMPILED.run(
        _sensitivity, residuals, constants, **residuals.effort
    )
    _LAST[0] = residuals, np.asarray(constants), found
    return found


@eqx.filter_jit
def _sensitivity(residuals: AbstractResiduals, constants: Array) -> tuple[Array, Array]:
    return residuals.linearised(constants)


def linearised(
    function: Callable[[Array], Array], point: Float[Array, " p"]
) -> tuple[Float[Array, " n"], Float[Array, "n p"]]:
    """Values of a function and their derivatives, in one forward pass for all of them."""

    def push(tangent: Array) -> tuple[Array, Array]:
        return jax.jvp(function, (point,), (tangent,))

    return jax.vmap(push, out_axes=(None, 1))(jnp.eye(point.size, dtype=point.dtype))


def by_theta(residuals: AbstractResiduals, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Residuals [n] and their derivatives by the unconstrained parameters [n, p]."""
    constants, slope = constants_by_theta(residuals, theta)
    r, J = sensitivity(residuals, jnp.asarray(constants))
    own = np.diag(slope)
    alone = np.array_equal(slope, np.diag(own))  # each constant has a parameter of its own
    return np.asarray(r), np.asarray(J) * own if alone else np.asarray(J) @ slope


def constants_by_theta(
    residuals: AbstractResiduals, theta: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Constants [p], SI units, and their derivatives by the parameters [p, p]."""
    # The readings, which the constants don't depend on, must not choose the program.
    c, slope = _constants_by_theta(residuals.mapping, jnp.asarray(theta))
    return np.asarray(c), np.asarray(slope)


@eqx.filter_jit
def _constants_by_theta(mapping: Callable[[Array], Array], theta: Array) -> tuple[Array, Array]:
    return mapping(theta), jax.jacfwd(mapping)(theta)
