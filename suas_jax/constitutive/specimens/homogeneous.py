"""Stress of an incompressible specimen in homogeneous deformation, for any law.

With the third stress free and e_i = log λ_i, the energy is a function Ψ̃(e₁, e₂) of two
strains, and its slopes are the Kirchhoff (here also Cauchy) stresses (Eqs. 18, 19):

    τ₁ = ∂Ψ̃/∂e₁,   τ₂ = ∂Ψ̃/∂e₂,   τ₃ = 0,   nominal P_i = τ_i/λ_i.

Nominal stress is force over undeformed area, Cauchy stress force over current area.
Everything is elementwise: stretches of any shape, whose trailing axes broadcast against
the lanes of the law. Near rest the stress is accurate relative to the strain.
"""

from collections.abc import Callable
from types import MappingProxyType
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from suas_jax.constitutive.base import AbstractLaw, constant
from suas_jax.constitutive.deformation import LogStretches, PlaneStrain


class Stress(NamedTuple):
    """Stress in one direction, two measures of it."""

    nominal: Float[Array, "..."]  # first Piola-Kirchhoff stress P [Pa] (Eq. 8)
    cauchy: Float[Array, "..."]  # Cauchy stress σ = λP [Pa] (Eq. 19)


class ShearStress(NamedTuple):
    """Stress in simple shear, with the stress on the plane of shear's own face free."""

    shear: Float[Array, "..."]  # σ₁₂ [Pa]; the nominal shear stress is the same
    along: Float[Array, "..."]  # σ₁₁, Cauchy, in the direction of sliding [Pa]
    across: Float[Array, "..."]  # σ₂₂, Cauchy, on the sliding faces [Pa]


class Mode(NamedTuple):
    """A one-parameter test: e₁ = h, e₂ = ratio × h with h = log stretch."""

    ratio: float  # e₂/e₁
    directions: int  # how many directions carry the reported stress

    def state(self, log_stretch: Float[Array, "..."]) -> LogStretches:
        """The deformation at h = log stretch, any shape."""
        return LogStretches(log_stretch, self.ratio * log_stretch)

    def stress(self, law: AbstractLaw, stretch: ArrayLike) -> Stress:
        """Stress at a stretch, any shape."""
        stretches = constant(stretch)
        work = _slope(lambda h: law.energy(self.state(h)), jnp.log(stretches))
        return _measures(work / self.directions, stretches)


MODES = MappingProxyType(
    {
        "uniaxial": Mode(ratio=-0.5, directions=1),
        "equibiaxial": Mode(ratio=1.0, directions=2),
        "planar": Mode(ratio=0.0, directions=1),
    }
)


def uniaxial(law: AbstractLaw, stretch: ArrayLike) -> Stress:
    """Stress in uniaxial tension or compression, stretches (λ, λ^−½, λ^−½).

    For Ogden, σ = Σ μ_p (λ^α_p − λ^(−α_p/2)).

    `stretch`: λ > 0, any shape.
    Returns the stress along the load [Pa].
    """
    return MODES["uniaxial"].stress(law, stretch)


def equibiaxial(law: AbstractLaw, stretch: ArrayLike) -> Stress:
    """Stress in equibiaxial extension (Eq. 13), stretches (λ, λ, λ⁻²).

    For Ogden, σ = Σ μ_p (λ^α_p − λ^(−2α_p)).

    `stretch`: λ > 0, any shape.
    Returns the stress in each of the two directions [Pa].
    """
    return MODES["equibiaxial"].stress(law, stretch)


def planar(law: AbstractLaw, stretch: ArrayLike) -> Stress:
    """Stress in planar extension ("pure shear"), stretches (λ, 1, 1/λ).

    For Ogden, σ = Σ μ_p (λ^α_p − λ^−α_p). Not to be confused with simple shear.

    `stretch`: λ > 0, any shape.
    Returns the stress along the extension [Pa]; the width is held and carries a stress too,
    which `biaxial(law, stretch, 1.0)` gives.
    """
    return MODES["planar"].stress(law, stretch)


def biaxial(
    law: AbstractLaw, stretch_1: ArrayLike, stretch_2: ArrayLike
) -> tuple[Stress, Stress]:
    """Stresses of a sheet under two independent stretches, (λ₁, λ₂, 1/(λ₁λ₂)).

    For Ogden, σ_i = Σ μ_p (λ_i^α_p − (λ₁λ₂)^−α_p).

    `stretch_1`: λ₁ > 0, any shape. `stretch_2`: λ₂ > 0, of a shape that broadcasts with λ₁.
    Returns the stress in the first and in the second direction [Pa].
    """
    first = constant(stretch_1)
    second = constant(stretch_2)
    tau_1, tau_2 = kirchhoff(law, jnp.log(first), jnp.log(second))
    return _measures(tau_1, first), _measures(tau_2, second)


def simple_shear(law: AbstractLaw, shear: ArrayLike) -> ShearStress:
    """Stress in simple shear, x₁ = X₁ + γX₂, with σ₃₃ = 0.

    The shear stress is σ₁₂ = dΨ/dγ. The normal stresses follow from the universal
    relation σ₁₁ − σ₂₂ = γσ₁₂ and from the mean stress that keeps σ₃₃ zero; for
    Mooney-Rivlin (C₃ = 0) they are σ₁₁ = 2C₁γ² and σ₂₂ = −2C₂γ². They are of second
    order in γ, and near rest accurate relative to σ₁₂ rather than to themselves.

    `shear`: amount of shear γ, any shape.
    Returns shear and normal stresses [Pa].
    """
    gamma = constant(shear)
    # The plane's distortion is γ² exactly: no root, no logarithm, smooth through zero.
    sheared = _slope(lambda g: law.energy(PlaneStrain(g * g, jnp.zeros_like(g))), gamma)
    h = jnp.arcsinh(0.5 * gamma)
    tau_1, tau_2 = kirchhoff(law, h, -h)
    total, difference = tau_1 + tau_2, gamma * sheared
    return ShearStress(sheared, 0.5 * (total + difference), 0.5 * (total - difference))


def kirchhoff(
    law: AbstractLaw, e1: Float[Array, "..."], e2: Float[Array, "..."]
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Kirchhoff stresses τ₁ = ∂Ψ̃/∂e₁ and τ₂ = ∂Ψ̃/∂e₂ with the third stress free.

    `e1`: log λ₁, any shape. `e2`: log λ₂, of a shape that broadcasts with e₁.
    Returns τ₁ and τ₂ [Pa].
    """
    e1, e2 = jnp.broadcast_arrays(e1, e2)
    return (
        _slope(lambda e: law.energy(LogStretches(e, e2)), e1),
        _slope(lambda e: law.energy(LogStretches(e1, e)), e2),
    )


def _slope(fn: Callable[[Array], Array], x: Float[Array, "..."]) -> Float[Array, "..."]:
    """Derivative of an elementwise function, at the broadcast shape of its output."""
    return jax.jvp(fn, (x,), (jnp.ones_like(x),))[1]


def _measures(cauchy: Float[Array, "..."], stretch: Float[Array, "..."]) -> Stress:
    return Stress(nominal=cauchy / stretch, cauchy=cauchy)
