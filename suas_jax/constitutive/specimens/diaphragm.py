"""Inflation of a circular diaphragm, clamped at its rim: the bulge test, for any law.

An axisymmetric membrane (the reduced model of Vertechy et al.). With R the undeformed
radius, t = log R, e₁ and e₂ the meridional and hoop logarithmic strains, φ the slope of
the meridian, τ_i = ∂Ψ̃/∂e_i, M_ij = ∂²Ψ̃/∂e_i∂e_j and X = pR/H, equilibrium reads

    de₂/dt = (λ₁/λ₂) cos φ − 1
    de₁/dt = ((λ₁/λ₂) cos φ τ₂ − τ₁ − M₁₂ de₂/dt) / (M₁₁ − τ₁)
    dφ/dt  = (X λ₁² λ₂ − (λ₁/λ₂) τ₂ sin φ) / τ₁.

Radius and pressure enter through X alone, so one integration outwards from an apex
stretched by λ₀ serves every size: the rim is where e₂ returns to zero, and X there is
the pressure. There is no search over pressures, and a pressure maximum is not an obstacle.

The apex is a regular singular point: perturbations die out as R⁻² from there, and a series
to second order starts the integration close to it. What is integrated are the coefficients
that this series would have, e_i = log λ₀ + a_i ξ² and φ = a₃ ξ, in t: they hardly change
before the membrane bends, where steps may be long. The step that would cross the rim is
taken again with e₂ as the independent variable, which ends on the rim itself.
"""

import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from suas_jax.constitutive.base import AbstractLaw, constant
from suas_jax.constitutive.specimens.homogeneous import kirchhoff

# Radii are measured by ξ, the slope that the apex curvature alone would give. Integration
# runs from 5e-4 (times √e₀ at small strain, as the rim does) over more than four decades,
# in steps of t that are shorter where the membrane bends: how many, and how long.
_START = 5e-4
_STEPS = ((8, 0.5), (8, 0.25), (78, 0.05))
# Largest relative violation of vertical equilibrium at the rim.
_BALANCE = 1e-9
# How far a lane is: under way, in front of the rim with its next step, or there.
_UNDER_WAY, _IN_FRONT, _THERE = 0, 1, 2


class Diaphragm(NamedTuple):
    """An inflated diaphragm."""

    pressure: Float[Array, "..."]  # p [Pa], positive on the concave side
    apex_height: Float[Array, "..."]  # height of the apex above the rim [m]
    # angle between membrane and clamping plane at the rim [rad];
    # beyond π/2 the bulge overhangs its rim
    rim_slope: Float[Array, "..."]


def inflated_diaphragm(
    law: AbstractLaw, apex_stretch: ArrayLike, radius: ArrayLike, thickness: ArrayLike
) -> Diaphragm:
    """Inflate a flat circular membrane, clamped at its rim, to a given apex stretch.

    `law`: the material, without lanes (use `jax.vmap` for many). `apex_stretch`: λ₀ > 1,
    equibiaxial stretch at the apex, any shape. `radius`: R₀ [m], radius of the undeformed
    membrane, broadcasts. `thickness`: H [m], undeformed thickness, broadcasts.
    Returns the pressure, apex height and rim slope in the broadcast shape, differentiable in
    every argument. Not a number where λ₀ ≤ 1, where the law has no rim for this apex (it loses
    stability on the way), or where vertical equilibrium of the bulge, 2τ₁ sin φ = X λ₁ λ₂²,
    fails at the rim by more than 1e-9.
    """
    stretch, R0, H = jnp.broadcast_arrays(
        constant(apex_stretch), constant(radius), constant(thickness)
    )
    load, height, slope = _unit_diaphragms(law, stretch)
    return Diaphragm(load * H / R0, height * R0, slope)


@eqx.filter_jit
def _unit_diaphragms(law: AbstractLaw, apex_stretch: Array) -> tuple[Array, Array, Array]:
    """The same for a radius and a thickness of one, arrays of any shape."""
    bulge = jnp.vectorize(lambda s: _unit_diaphragm(law, s), signature="()->(),(),()")
    return bulge(apex_stretch)


def _unit_diaphragm(law: AbstractLaw, apex_stretch: Array) -> tuple[Array, Array, Array]:
    """X at the rim [Pa], apex height and rim slope, for a radius of one."""
    e0 = jnp.log(apex_stretch)
    inflates = e0 > 0.0
    e0 = jnp.where(inflates, e0, 1.0)
    tau_0, _ = kirchhoff(law, e0, e0)
    scale = 2.0 * tau_0 * jnp.exp(-3.0 * e0)  # X/ξ
    first = _beside_apex(law, e0, tau_0)

    def step(carry: tuple[Array, Array], length: Array) -> tuple[tuple[Array, Array], None]:
        y, place = carry
        rimward = place == _IN_FRONT
        # Past the rim nothing may be computed: a state that is not a number would spoil
        # the derivatives of those that are.
        y_safe = jnp.where(place == _THERE, first, y)
        e2 = _state(e0, y_safe)[1]
        to = _advanced(law, e0, scale, y_safe, jnp.where(rimward, -e2, length), rimward)
        inside = _state(e0, to)[1] > 0.0
        moves = rimward | ((place == _UNDER_WAY) & inside)
        onward = jnp.where(inside, _UNDER_WAY, _IN_FRONT)
        return (jnp.where(moves, to, y), jnp.where(place == _UNDER_WAY, onward, _THERE)), None

    lengths = np.concatenate([np.full(count, length) for count, length in _STEPS])
    (y, place), _ = jax.lax.scan(step, (first, jnp.asarray(_UNDER_WAY)), jnp.asarray(lengths))
    there = inflates & (place == _THERE) & jnp.all(jnp.isfinite(y))
    y = jnp.where(there, y, first)
    e1, e2, slope, height = _state(e0, y)
    rim = jnp.exp(y[4])
    load = scale * rim
    tau_1, _ = kirchhoff(law, e1, e2)
    lift = load * jnp.exp(e1 + 2.0 * e2)
    good = there & (jnp.abs(2.0 * tau_1 * jnp.sin(slope) - lift) < _BALANCE * jnp.abs(lift))
    load, height, slope = (
        jnp.where(good, value, jnp.nan) for value in (load, height / rim, slope)
    )
    return load, height, slope


def _beside_apex(
    law: AbstractLaw, e0: Float[Array, ""], tau_0: Float[Array, ""]
) -> Float[Array, " 5"]:
    """Coefficients (a₁, a₂, a₃, a₄) at a small ξ, with log ξ; see `_state`.

    With λ_i = λ₀ + c_i ξ² the equations at order ξ² give c₁ = 3c₂ + λ₀/2 and, with P_ij the
    nominal tangents, c₂ = −(P + (3P₁₁ − P₁₂) λ₀) / (16 P₁₁).
    """
    _, _, m11, m12 = _stresses_and_moduli(law, e0, e0)
    # λ₀ times P, and λ₀² times P₁₁ and P₁₂; the common power of λ₀ is left out.
    p11, p12 = m11 - tau_0, m12
    relative_2 = -(tau_0 + 3.0 * p11 - p12) / (16.0 * p11)
    relative_1 = 3.0 * relative_2 + 0.5
    start = jnp.log(_START * jnp.sqrt(jnp.minimum(e0, 1.0)))
    return jnp.stack([relative_1, relative_2, jnp.ones_like(e0), 0.5 * jnp.exp(e0), start])


def _state(e0: Float[Array, ""], y: Float[Array, " 5"]) -> Float[Array, " 4"]:
    """(e₁, e₂, φ, height) = (e₀ + a₁ξ², e₀ + a₂ξ², a₃ξ, a₄ξ²), height in units of ξ/R."""
    xi = jnp.exp(y[4])
    square = xi * xi
    return jnp.stack([e0 + y[0] * square, e0 + y[1] * square, y[2] * xi, y[3] * square])


def _advanced(
    law: AbstractLaw,
    e0: Float[Array, ""],
    scale: Float[Array, ""],
    y: Float[Array, " 5"],
    length: Float[Array, ""],
    rimward: Bool[Array, ""],
) -> Float[Array, " 5"]:
    """One step of Dormand and Prince's method of eighth order, in t or, rimward, in e₂."""
    nodes, weights = (jnp.asarray(table) for table in _dormand_prince())

    def slopes(y: Float[Array, " 5"]) -> Float[Array, " 5"]:
        xi = jnp.exp(y[4])
        rates = _slopes(law, _state(e0, y), xi, scale)
        size = jnp.stack([xi * xi, xi * xi, xi, xi * xi])
        along_t = jnp.append(rates / size - jnp.array([2.0, 2.0, 1.0, 2.0]) * y[:4], 1.0)
        return along_t / jnp.where(rimward, rates[1], 1.0)

    def stage(i: Int[Array, ""], found: Float[Array, "12 5"]) -> Float[Array, "12 5"]:
        return found.at[i].set(slopes(y + length * (nodes[i] @ found)))

    found = jax.lax.fori_loop(0, len(weights), stage, jnp.zeros((len(weights), 5), y.dtype))
    return y + length * (weights @ found)


@functools.cache
def _dormand_prince() -> tuple[np.ndarray, np.ndarray]:
    """Coefficients of DOP853, as SciPy has them: of the stages [12, 12], of their sum [12]."""
    # Imported here: nothing else in the model needs SciPy, which takes a while to import.
    from scipy.integrate import DOP853

    count = DOP853.n_stages
    return np.asarray(DOP853.A)[:count, :count], np.asarray(DOP853.B)


def _slopes(
    law: AbstractLaw, state: Float[Array, " 4"], xi: Float[Array, ""], scale: Float[Array, ""]
) -> Float[Array, " 4"]:
    """Derivatives of (e₁, e₂, φ, height) with respect to log ξ; height in units of ξ."""
    e1, e2, slope, _ = state
    tau_1, tau_2, m11, m12 = _stresses_and_moduli(law, e1, e2)
    ratio = jnp.exp(e1 - e2)
    # (λ₁/λ₂) cos φ − 1 without cancellation: a flat membrane has small strains.
    hoop = jnp.expm1(e1 - e2) - 2.0 * ratio * jnp.sin(0.5 * slope) ** 2
    meridian = ((tau_2 - tau_1) + (tau_2 - m12) * hoop) / (m11 - tau_1)
    lift = scale * xi * jnp.exp(2.0 * e1 + e2)
    turn = (lift - ratio * tau_2 * jnp.sin(slope)) / tau_1
    return jnp.stack([meridian, hoop, turn, jnp.exp(e1) * jnp.sin(slope) * xi])


def _stresses_and_moduli(
    law: AbstractLaw, e1: Float[Array, "..."], e2: Float[Array, "..."]
) -> tuple[Array, Array, Array, Array]:
    """τ₁, τ₂, M₁₁ and M₁₂ [Pa]."""
    (tau_1, tau_2), (m11, m12) = jax.jvp(
        lambda e: kirchhoff(law, e, e2), (e1,), (jnp.ones_like(e1),)
    )
    return tau_1, tau_2, m11, m12
