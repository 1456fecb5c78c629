"""What a test machine would read for a given law: the forward model of every test.

A homogeneous test reads a linear combination of the two Kirchhoff stresses at a known
state, c₁ τ₁(e₁, e₂) + c₂ τ₂(e₁, e₂): stress measure, direction and geometry of the test
are all in (e₁, e₂, c₁, c₂). Every uniaxial, biaxial, shear and balloon point of every
file is therefore one lane of the same compiled evaluation. The bulge needs a membrane.
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.constitutive import AbstractLaw, inflated_diaphragm
from suas_jax.constitutive.homogeneous import MODES, kirchhoff

# Points are padded to a multiple of this, so that data sets of similar size share
# compiled programs.
_BLOCK = 32
_NEWTON_STEPS = 7


class AbstractExperiment(eqx.Module):
    """Tests whose readings a law predicts."""

    @abc.abstractmethod
    def predict(self, law: AbstractLaw) -> Float[Array, " n"]:
        """Readings [Pa] of all points, padding included."""


class Homogeneous(AbstractExperiment):
    """Points of homogeneous tests, c₁ τ₁ + c₂ τ₂ at (e₁, e₂).

    Attributes:
        e1: log λ₁, shape [n].
        e2: log λ₂, shape [n].
        c1: factor of τ₁, shape [n].
        c2: factor of τ₂, shape [n].
    """

    e1: Float[Array, " n"]
    e2: Float[Array, " n"]
    c1: Float[Array, " n"]
    c2: Float[Array, " n"]

    def predict(self, law: AbstractLaw) -> Float[Array, " n"]:
        """Readings [Pa]; zero for padding."""
        tau_1, tau_2 = kirchhoff(law, self.e1, self.e2)
        return self.c1 * tau_1 + self.c2 * tau_2


class Bulge(AbstractExperiment):
    """Points of a circular-diaphragm bulge test: pressure at a given apex height.

    Attributes:
        height: apex height over the diaphragm's radius, shape [n].
        thickness: undeformed thickness over radius, shape [n].
    """

    height: Float[Array, " n"]
    thickness: Float[Array, " n"]

    def predict(self, law: AbstractLaw) -> Float[Array, " n"]:
        """Pressures [Pa]; not a number where the law has no bulge of that height."""
        frozen = jax.lax.stop_gradient(law)
        wanted = jnp.log(self.height)

        def log_height(law: AbstractLaw, e: Array) -> Array:
            stretch = jnp.exp(e)
            return jnp.log(inflated_diaphragm(law, stretch, 1.0, self.thickness).apex_height)

        def newton(law: AbstractLaw, log_e: Array) -> Array:
            e = jnp.exp(log_e)
            value, slope = jax.jvp(lambda x: log_height(law, x), (e,), (e,))
            step = jnp.clip((value - wanted) / jax.lax.stop_gradient(slope), -0.7, 0.7)
            return log_e - step

        # The apex of a spherical cap of this height stretches by about 1 + η².
        start = jnp.log(jnp.log1p(self.height**2))
        found = jax.lax.fori_loop(
            0, _NEWTON_STEPS, lambda _, x: newton(frozen, x), jax.lax.stop_gradient(start)
        )
        # The last step carries the derivative with respect to the constants.
        e = jnp.exp(newton(law, found))
        bulge = inflated_diaphragm(law, jnp.exp(e), 1.0, self.thickness)
        met = jnp.abs(jnp.log(bulge.apex_height) - wanted) < 1e-6
        return jnp.where(met, bulge.pressure, jnp.nan)


def padded(values: np.ndarray, fill: float = 0.0) -> Float[Array, " n"]:
    """Fill an array up to the next full block."""
    missing = -len(values) % _BLOCK
    return jnp.asarray(np.concatenate([values, np.full(missing, fill)]), float)


def mode_factors(mode: str, stretch: np.ndarray) -> tuple[np.ndarray, ...]:
    """(e₁, e₂, c₁, c₂) that read the Cauchy stress of a one-parameter mode.

    Args:
        mode: "uniaxial", "equibiaxial" or "planar".
        stretch: λ > 0, shape [n].
    """
    path = MODES[mode]
    e = np.log(stretch)
    one = np.ones_like(e)
    return e, path.ratio * e, one / path.directions, path.ratio / path.directions * one


def shear_factors(shear: np.ndarray) -> tuple[np.ndarray, ...]:
    """(e₁, e₂, c₁, c₂) that read the shear stress dΨ/dγ in simple shear.

    Stretches are exp(±h) with γ = 2 sinh h, so dΨ/dγ = (τ₁ − τ₂)/(2 cosh h).
    """
    h = np.arcsinh(0.5 * shear)
    share = 0.5 / np.cosh(h)
    return h, -h, share, -share
