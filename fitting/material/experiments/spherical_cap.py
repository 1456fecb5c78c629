"""The bulge of a diaphragm taken for a spherical cap: an estimate of its pressure.

Hill's special solution: with η the apex height and ρ the undeformed radius, both over that of
the rim, the membrane is stretched by λ = (1 + η²)/(1 + η²ρ²) in every direction. Other laws
have other shapes; but the virtual work of inflating this one,

    p dV/dη = 2π R T ∫ 2τ(λ) (∂ log λ/∂η) ρ dρ,    dV/dη = π R³ (1 + η²)/2,

with τ the equibiaxial stress and T the thickness, is off by no more than the square of how far
the shapes are apart. For a neo-Hookean membrane that is 12 % at small heights, as for any
law, and fades as exp(−η²/0.19) to less than 1 %; this much is taken off. A law has such a
pressure at every height, also where it has no membrane of that height.
"""

from typing import Self

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fitting.material.experiments.prediction import AbstractExperiment
from suas_jax.constitutive import AbstractLaw
from suas_jax.constitutive.specimens.homogeneous import kirchhoff

_POINTS = 8
# By how much a cap at small heights resists more than a membrane, and the η² where that fades.
_STIFFER, _FADES = 0.123, 0.19


class SphericalCap(AbstractExperiment):
    """Points of a bulge test, each the sum of stresses at points of a spherical cap.

    Attributes:
        strain: log λ at the points of each reading's cap, shape [n, points].
        share: of each point's stress in the pressure, shape [n, points].
    """

    strain: Float[Array, "n points"]
    share: Float[Array, "n points"]

    @classmethod
    def of_heights(cls, height: Float[np.ndarray, " n"], thickness: np.ndarray) -> Self:
        """Caps of apex heights and undeformed thicknesses, both over the radius."""
        nodes, weights = np.polynomial.legendre.leggauss(_POINTS)
        # Gauss's points in ρ², which the integrand is a function of.
        square, weights = 0.5 * (nodes + 1.0), 0.5 * weights
        eta = height[:, None]
        apex, there = 1.0 + eta**2, 1.0 + eta**2 * square
        growth = 2.0 * eta / apex - 2.0 * eta * square / there
        stiffer = 1.0 + _STIFFER * np.exp(-(eta**2) / _FADES)
        share = 4.0 * thickness[:, None] / apex * growth * weights / stiffer
        return cls(jnp.asarray(np.log(apex / there)), jnp.asarray(share))

    @property
    def size(self) -> int:
        """Number of readings."""
        return len(self.strain)

    def predict(self, law: AbstractLaw) -> Float[Array, " n"]:
        """Pressures [Pa]."""
        stress, _ = kirchhoff(law, self.strain, self.strain)
        return jnp.sum(self.share * stress, axis=1)
