"""What a test machine would read for a given law: the forward model of every test.

A homogeneous test reads a linear combination of the two Kirchhoff stresses at a known
state, c₁ τ₁(e₁, e₂) + c₂ τ₂(e₁, e₂): stress measure, direction and geometry of the test
are all in (e₁, e₂, c₁, c₂). Every uniaxial, biaxial, shear and balloon point of every
file is therefore one lane of the same compiled evaluation. The bulge needs a membrane.
"""

import abc
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.constitutive import AbstractLaw, inflated_diaphragm
from suas_jax.constitutive.specimens.homogeneous import MODES, kirchhoff

# Points are padded to a multiple of this, so that data sets of similar size share
# compiled programs.
_BLOCK = 32
_NEWTON_STEPS = 7


class AbstractExperiment(eqx.Module):
    """Tests whose readings a law predicts.

    Attributes:
        costly: whether compiling the prediction takes longer than a whole fit's use of it.
    """

    costly: ClassVar[bool] = False

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

    A membrane is inflated to a given apex stretch, and its height follows. Near the apex
    stretch that gives the measured height h_i, pressure follows height along

        log p = log p(e) + (d log p / d log h) (log h_i − log h(e)),

    exact, with exact derivatives in the constants, where h(e) = h_i. `settled` moves e
    there for a law; a fit alternates it with steps in the constants.

    Attributes:
        height: apex height over the diaphragm's radius, shape [n].
        thickness: undeformed thickness over radius, shape [n].
        apex: e, logarithm of the apex stretch, shape [n].
    """

    height: Float[Array, " n"]
    thickness: Float[Array, " n"]
    apex: Float[Array, " n"]

    def predict(self, law: AbstractLaw) -> Float[Array, " n"]:
        """Pressures [Pa]; not a number where the law has no bulge of that height."""
        (log_p, log_h), (slope_p, slope_h) = self._inflated(law)
        along = jax.lax.stop_gradient(slope_p / slope_h)
        return jnp.exp(log_p + along * (jnp.log(self.height) - log_h))

    def settled(self, law: AbstractLaw) -> "Bulge":
        """The same test at the apex stretches that give the measured heights."""
        test = self
        for _ in range(_NEWTON_STEPS):
            (_, log_h), (_, slope_h) = _inflated(test, law)
            miss = jnp.log(test.height) - log_h
            # Where a law has no such bulge the estimate stays; `predict` says so.
            step = jnp.where(jnp.isfinite(miss / slope_h), miss / slope_h, 0.0)
            apex = test.apex * jnp.exp(jnp.clip(step, -0.5, 0.5))
            test = eqx.tree_at(lambda t: t.apex, test, apex)
            if float(jnp.max(jnp.abs(step))) < 1e-6:
                break
        return test

    def _inflated(self, law: AbstractLaw) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Pressure and height at the apex stretches as log p, log h; slopes in log e."""

        def at(e: Array) -> tuple[Array, Array]:
            bulge = inflated_diaphragm(law, jnp.exp(e), 1.0, self.thickness)
            return jnp.log(bulge.pressure), jnp.log(bulge.apex_height)

        return jax.jvp(at, (self.apex,), (self.apex,))


@eqx.filter_jit
def _inflated(test: Bulge, law: AbstractLaw) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    return test._inflated(law)


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
