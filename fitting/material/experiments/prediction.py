"""Predictions of a law for a test: the forward model of a calibration of a material.

A homogeneous test reads a combination of the two Kirchhoff stresses at a known state,
c₁ τ₁(e₁, e₂) + c₂ τ₂(e₁, e₂), whatever its measure, direction and geometry: every uniaxial,
biaxial, shear and balloon point of every file is one lane of the same compiled evaluation.
"""

import abc
from typing import ClassVar, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fitting.material.laws.parameters import Family
from fitting.statistics.residuals import linearised
from suas_jax.constitutive import AbstractLaw
from suas_jax.constitutive.specimens.homogeneous import MODES, kirchhoff

# Points are padded to a power of two, and to no less than this, so that data sets of
# different sizes share compiled programs.
_FEWEST = 64

POWERS = {"cauchy": 0, "nominal": 1, "second_pk": 2}
"""Power of the stretch by which the Cauchy stress is divided in a measure of stress."""


class AbstractExperiment(eqx.Module):
    """Tests whose readings a law predicts."""

    sized_by: ClassVar[str]  # an array with one entry a reading

    @property
    def effort(self) -> dict[str, bool]:
        """How its programs are compiled, as `COMPILED.run` is told: here to run many times."""
        return {}

    @property
    def size(self) -> int:
        """Number of readings, padding included."""
        return len(getattr(self, self.sized_by))

    def settled(self, law: AbstractLaw) -> Self:
        """The same tests, at the states that fit a law."""
        return self

    def shifted(self, zeros: Float[Array, " k"]) -> Self:
        """The same tests with other zeros; by default a test has none that are free."""
        return self

    def linearised(
        self, family: Family, constants: Float[Array, " p"]
    ) -> tuple[Float[Array, " n"], Float[Array, "n p"]]:
        """Readings of a family's law and their derivatives by its constants, SI units."""
        return linearised(
            lambda c: self.shifted(family.zeros(c)).predict(family.law(c)), constants
        )

    @abc.abstractmethod
    def predict(self, law: AbstractLaw) -> Float[Array, " n"]:
        """Readings of all points, padding included."""


class Homogeneous(AbstractExperiment):
    """Points of homogeneous tests, c₁ τ₁ + c₂ τ₂ at (e₁, e₂)."""

    sized_by: ClassVar = "e1"
    e1: Float[Array, " n"]  # log λ₁
    e2: Float[Array, " n"]  # log λ₂
    c1: Float[Array, " n"]  # factor of τ₁
    c2: Float[Array, " n"]  # factor of τ₂

    def predict(self, law: AbstractLaw) -> Float[Array, " n"]:
        """Readings [Pa]; zero for padding."""
        tau_1, tau_2 = kirchhoff(law, self.e1, self.e2)
        return self.c1 * tau_1 + self.c2 * tau_2


def padded(values: np.ndarray, fill: float = 0.0) -> Float[Array, " n"]:
    """Fill an array up to the next size that programs are compiled for."""
    missing = max(_FEWEST, 1 << (len(values) - 1).bit_length()) - len(values)
    return jnp.asarray(np.concatenate([values, np.full(missing, fill)]), float)


def mode_factors(
    mode: str, stretch: np.ndarray, measure: str = "cauchy"
) -> Float[np.ndarray, "4 n"]:
    """(e₁, e₂, c₁, c₂) that read a stress of a one-parameter mode.

    `mode`: "uniaxial", "equibiaxial" or "planar". `stretch`: λ > 0, shape [n]. `measure`: a key
    of `POWERS`.
    """
    path = MODES[mode]
    e = np.log(stretch)
    share = 1.0 / path.directions / stretch ** POWERS[measure]
    return np.stack([e, path.ratio * e, share, path.ratio * share])


def shear_factors(shear: np.ndarray) -> tuple[np.ndarray, ...]:
    """(e₁, e₂, c₁, c₂) that read the shear stress dΨ/dγ in simple shear.

    Stretches are exp(±h) with γ = 2 sinh h, so dΨ/dγ = (τ₁ − τ₂)/(2 cosh h).
    """
    h = np.arcsinh(0.5 * shear)
    share = 0.5 / np.cosh(h)
    return h, -h, share, -share
