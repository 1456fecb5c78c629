"""Inflation of a circular diaphragm, clamped at its rim: the bulge test, for any law.

An axisymmetric membrane (the reduced model of Vertechy et al.). With R the undeformed
radius, t = log R, e₁ and e₂ the meridional and hoop logarithmic strains, φ the slope of
the meridian, τ_i = ∂Ψ̃/∂e_i, M_ij = ∂²Ψ̃/∂e_i∂e_j and X = pR/H, equilibrium reads

    de₂/dt = (λ₁/λ₂) cos φ − 1
    de₁/dt = ((λ₁/λ₂) cos φ τ₂ − τ₁ − M₁₂ de₂/dt) / (M₁₁ − τ₁)
    dφ/dt  = (X λ₁² λ₂ − (λ₁/λ₂) τ₂ sin φ) / τ₁.

Radius and pressure enter through X alone, so one integration outwards from an apex
stretched by λ₀ serves every size: the rim is where e₂ returns to zero, and X there is
the pressure. There is no search over pressures, and a pressure maximum is no obstacle.

The apex is a regular singular point. Perturbations die out as R⁻² from there, and a
series to second order starts the integration close to it.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from suas_jax.constitutive.base import AbstractLaw, constant
from suas_jax.constitutive.specimens.homogeneous import kirchhoff

# Gauss collocation on panels of t. Repeated substitution converges like (width)^k / k!, so
# that a fixed number of sweeps solves a panel. With sixteen stages the polynomial is exact
# to rounding throughout its panel: the rim is found on it, without integrating again.
_STAGES, _SWEEPS, _PANEL = 16, 20, 0.125
# Radii are measured by ξ, the slope that the apex curvature alone would give. Integration
# runs from 5e-4 (times √e₀ at small strain, as the rim does) over more than four decades.
_START, _PANELS = 5e-4, 79
# Largest relative violation of vertical equilibrium at the rim.
_BALANCE = 1e-9
# Steps to the rim from the middle of its panel, and the largest last one of them.
_NEWTON_STEPS, _AT_RIM = 6, 1e-10


class Diaphragm(NamedTuple):
    """An inflated diaphragm.

    Attributes:
        pressure: p [Pa], positive on the concave side.
        apex_height: height of the apex above the rim [m].
        rim_slope: angle between membrane and clamping plane at the rim [rad]; beyond
            π/2 the bulge overhangs its rim.
    """

    pressure: Float[Array, "..."]
    apex_height: Float[Array, "..."]
    rim_slope: Float[Array, "..."]


def inflated_diaphragm(
    law: AbstractLaw, apex_stretch: ArrayLike, radius: ArrayLike, thickness: ArrayLike
) -> Diaphragm:
    """Inflate a flat circular membrane, clamped at its rim, to a given apex stretch.

    Args:
        law: the material, without lanes (use `jax.vmap` for many).
        apex_stretch: λ₀ > 1, equibiaxial stretch at the apex, any shape.
        radius: R₀ [m], radius of the undeformed membrane, broadcasts.
        thickness: H [m], undeformed thickness, broadcasts.

    Returns:
        Pressure, apex height and rim slope in the broadcast shape, differentiable in
        every argument. Not a number where λ₀ ≤ 1, where the law has no rim for this
        apex (it loses stability on the way), or where vertical equilibrium of the
        bulge, 2τ₁ sin φ = X λ₁ λ₂², fails at the rim by more than 1e-9.
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
    start = _START * jnp.sqrt(jnp.clip(e0, 0.0, 1.0))
    tau_0, _ = kirchhoff(law, e0, e0)
    scale = 2.0 * tau_0 * jnp.exp(-3.0 * e0)  # X/ξ

    first = _beside_apex(law, e0, tau_0, start)

    def panel(state: Array, index: Array) -> tuple[Array, tuple[Array, Array]]:
        # Past the rim nothing may be computed: a state that is not a number would spoil
        # the derivatives of those that are.
        inside = state[1] > 0.0
        xi = jnp.where(inside, start * jnp.exp(_PANEL * index), start)
        rates = _rates(law, jnp.where(inside, state, first), xi, scale)
        following = state + _PANEL * (rates @ _gauss_collocation(_STAGES).weights)
        return jnp.where(inside, following, state), (state, rates)

    _, (states, rates) = jax.lax.scan(panel, first, jnp.arange(_PANELS, dtype=first.dtype))
    hoop = states[:, 1]
    found = (hoop[0] > 0.0) & ~jnp.all(hoop > 0.0)
    crossing = jnp.where(found, jnp.argmin(hoop > 0.0) - 1, 0)

    # A law can fail on the panel of the rim; the search then runs on a straight line instead,
    # so that derivatives of what is not a number spoil no others.
    state, slopes = states[crossing], rates[crossing]
    found &= (e0 > 0.0) & jnp.all(jnp.isfinite(state)) & jnp.all(jnp.isfinite(slopes))
    state, slopes = (
        jnp.where(found, value, other)
        for value, other in ((state, 1.0), (slopes, -1.0 / _PANEL))
    )
    fraction, last = _rim(state[1], slopes[1])
    e1, e2, slope, height = _along_panel(state, slopes, fraction)
    rim = start * jnp.exp(_PANEL * (crossing + fraction))
    load = scale * rim
    tau_1, _ = kirchhoff(law, e1, e2)
    lift = load * jnp.exp(e1 + 2.0 * e2)
    balanced = jnp.abs(2.0 * tau_1 * jnp.sin(slope) - lift) < _BALANCE * jnp.abs(lift)
    good = found & balanced & (jnp.abs(last) < _AT_RIM)
    load, height, slope = (
        jnp.where(good, value, jnp.nan) for value in (load, height / rim, slope)
    )
    return load, height, slope


def _beside_apex(law: AbstractLaw, e0: Array, tau_0: Array, xi: Array) -> Array:
    """State at a small ξ, to second order: λ_i = λ₀ + c_i ξ², φ = ξ, height λ₀ξ²/2.

    The equations at order ξ² give c₁ = 3c₂ + λ₀/2 and, with P_ij the nominal tangents,
    c₂ = −(P + (3P₁₁ − P₁₂) λ₀) / (16 P₁₁).
    """
    _, _, m11, m12 = _stresses_and_moduli(law, e0, e0)
    # λ₀ times P, and λ₀² times P₁₁ and P₁₂; the common power of λ₀ is left out.
    p11, p12 = m11 - tau_0, m12
    relative_2 = -(tau_0 + 3.0 * p11 - p12) / (16.0 * p11)
    relative_1 = 3.0 * relative_2 + 0.5
    square = xi * xi
    return jnp.stack(
        [e0 + relative_1 * square, e0 + relative_2 * square, xi, 0.5 * jnp.exp(e0) * square]
    )


def _rates(
    law: AbstractLaw, state: Float[Array, " 4"], xi: Float[Array, ""], scale: Array
) -> Float[Array, "4 stages"]:
    """Slopes of (e₁, e₂, φ, height) at the nodes of the panel that starts at `xi`."""
    scheme = _gauss_collocation(_STAGES)
    at = xi * jnp.exp(_PANEL * jnp.asarray(scheme.nodes))

    def sweep(_: int, rates: Array) -> Array:
        return _slopes(law, state[:, None] + _PANEL * (rates @ scheme.upto), at, scale)

    return jax.lax.fori_loop(0, _SWEEPS, sweep, jnp.zeros((4, _STAGES), state.dtype))


def _rim(
    hoop: Float[Array, ""], rates: Float[Array, " stages"]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Fraction of a panel at which the hoop strain returns to zero, and the last step to it.

    Newton's method on the polynomial of the strain. The steps at the root carry the
    derivatives: one makes the first exact, two the first three.
    """

    def step(x: Array, hoop: Array, rates: Array) -> Array:
        values, integrals = _polynomials(x)
        coefficients = rates @ _gauss_collocation(_STAGES).coefficients.T
        change = -(hoop + _PANEL * coefficients @ integrals) / (_PANEL * coefficients @ values)
        return jnp.clip(change, -1.0, 1.0)

    root = jnp.array(0.5, hoop.dtype)
    known = jax.lax.stop_gradient((hoop, rates))
    root = jax.lax.fori_loop(0, _NEWTON_STEPS, lambda _, x: x + step(x, *known), root)
    for _ in range(2):
        last = step(root, hoop, rates)
        root = root + last
    return root, last


def _along_panel(
    state: Float[Array, " 4"], rates: Float[Array, "4 stages"], fraction: Float[Array, ""]
) -> Float[Array, " 4"]:
    """State at a fraction of a panel, on the polynomial that has these slopes."""
    coefficients = _gauss_collocation(_STAGES).coefficients
    _, integrals = _polynomials(fraction)
    return state + _PANEL * (rates @ coefficients.T) @ integrals


def _polynomials(
    fraction: Float[Array, ""],
) -> tuple[Float[Array, " stages"], Float[Array, " stages"]]:
    """Legendre polynomials at a fraction of a panel, and their integrals from its start."""
    at = 2.0 * fraction - 1.0

    def following(pair: tuple[Array, Array], n: Array) -> tuple[tuple[Array, Array], Array]:
        before, last = pair
        found = ((2.0 * n + 1.0) * at * last - n * before) / (n + 1.0)
        return (last, found), found

    one = jnp.ones_like(at)
    degrees = jnp.arange(1, _STAGES, dtype=at.dtype)
    _, further = jax.lax.scan(following, (one, at), degrees)
    values = jnp.concatenate([jnp.stack([one, at]), further])
    integrals = 0.5 * (values[2:] - values[:-2]) / (2.0 * degrees + 1.0)
    return values[:-1], jnp.concatenate([0.5 * (at + 1.0)[None], integrals])


def _slopes(
    law: AbstractLaw, state: Float[Array, "4 n"], xi: Float[Array, " n"], scale: Array
) -> Float[Array, "4 n"]:
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


class _Collocation(NamedTuple):
    """Gauss nodes on [0, 1] and the polynomials that are one at a node, zero at the others.

    Attributes:
        nodes: shape [stages].
        coefficients: of Legendre polynomials in the node polynomials, shape [degree, stages].
        upto: integrals of the node polynomials from zero up to each node, [stages, node].
        weights: their integrals over [0, 1], shape [stages].
    """

    nodes: np.ndarray
    coefficients: np.ndarray
    upto: np.ndarray
    weights: np.ndarray


def _gauss_collocation(stages: int) -> _Collocation:
    legendre = np.polynomial.legendre
    nodes, weights = legendre.leggauss(stages)
    coefficients = np.linalg.inv(legendre.legvander(nodes, stages - 1))
    integrals = legendre.legval(nodes, legendre.legint(coefficients, lbnd=-1.0, axis=0))
    return _Collocation(0.5 * (nodes + 1.0), coefficients, 0.5 * integrals, 0.5 * weights)
