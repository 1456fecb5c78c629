"""Inflation of two standard bodies, for any law: spherical balloon, thick-walled tube.

Both follow from the stored energy as a function of the enclosed volume, p = dU/dV.
The inflated diaphragm, which needs a differential equation, has its own file.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from suas_jax.constitutive.base import AbstractLaw, constant
from suas_jax.constitutive.deformation import LogStretches
from suas_jax.constitutive.specimens.homogeneous import equibiaxial

# The integrand is analytic in the logarithm of the radius; 32 points give 1e-14 for an
# outer radius of ten times the inner.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(32)


class TubeResponse(NamedTuple):
    """What holds a tube inflated and stretched."""

    pressure: Float[Array, "..."]  # internal over external pressure p [Pa]
    # N − πa²p [N], the pull on a tube with closed ends
    reduced_axial_force: Float[Array, "..."]
    axial_force: Float[Array, "..."]  # N [N], the resultant of axial stress over the wall


def balloon_pressure(
    law: AbstractLaw, stretch: ArrayLike, thickness_ratio: ArrayLike
) -> Float[Array, "..."]:
    """Pressure in a thin spherical balloon (Eq. 15).

    p = 2 (H/R) σ/λ³ with σ the equibiaxial stress; for Ogden
    p = 2 (H/R) Σ μ_p (λ^(α_p − 3) − λ^(−2α_p − 3)). Soft laws have a limit point: the
    pressure is a function of the stretch, not the other way round.

    `stretch`: λ = r/R > 0, any shape. `thickness_ratio`: H/R, undeformed thickness over radius.
    Returns the internal over the external pressure [Pa].
    """
    stretches = constant(stretch)
    cauchy = equibiaxial(law, stretches).cauchy
    return 2.0 * constant(thickness_ratio) * cauchy / stretches**3


def tube(
    law: AbstractLaw,
    inner_stretch: ArrayLike,  # λ_a = a/A > 0, any shape
    axial_stretch: ArrayLike,  # λ_z > 0; all four arguments broadcast
    inner_radius: ArrayLike,  # A [m]
    outer_radius: ArrayLike,  # B > A [m]; up to ten times A the result is exact to rounding
) -> TubeResponse:
    """Thick-walled circular tube under internal pressure and axial stretch.

    With λ = r/R the hoop stretch and λ_z the axial one, incompressibility gives
    λ_z λ² = 1 + (λ_z λ_a² − 1) A²/R² (Dorfmann and Ogden), and the energy per length

        U(v, λ_z) = 2π ∫ Ψ(λ, λ_z) R dR,   v = λ_z π a² the enclosed volume per length,

    has the slopes p = ∂U/∂v = ∫ λ ∂Ψ/∂λ dR / (λ_z λ² R) and N − πa²p = ∂U/∂λ_z. The
    integral runs over log R, where nothing is singular, the undeformed tube included.

    Returns the pressure and axial forces, in the broadcast shape.
    """
    a_stretch, z_stretch, A, B = jnp.broadcast_arrays(
        constant(inner_stretch),
        constant(axial_stretch),
        constant(inner_radius),
        constant(outer_radius),
    )
    # log(λ_z λ_a²), so that a small inflation keeps its digits.
    swelling = jnp.expm1(jnp.log(z_stretch) + 2.0 * jnp.log(a_stretch))
    width = jnp.log(B / A)
    along = [jnp.exp(-width * (1.0 + float(node))) for node in _NODES]  # A²/R²

    def energy(swelling: Array, z_stretch: Array) -> Array:
        """U / (πA²), by Gauss quadrature over log R."""
        e_z = jnp.log(z_stretch)
        points = jnp.stack(along)
        e = 0.5 * (jnp.log1p(swelling * points) - e_z)
        density = law.energy(LogStretches(e, jnp.broadcast_to(e_z, e.shape)))
        weights = jnp.asarray(_WEIGHTS).reshape(-1, *(1,) * (density.ndim - 1))
        return width * jnp.sum(weights * density / points, axis=0)

    one, zero = jnp.ones_like(swelling), jnp.zeros_like(swelling)
    _, pressure = jax.jvp(energy, (swelling, z_stretch), (one, zero))
    _, axial = jax.jvp(energy, (swelling, z_stretch), (zero, one))
    area = math.pi * A * A
    return TubeResponse(
        pressure=pressure,
        reduced_axial_force=area * axial,
        axial_force=area * (axial + a_stretch**2 * pressure),
    )
