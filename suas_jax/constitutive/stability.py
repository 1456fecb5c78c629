"""Where a law is stable: Drucker's condition by mode of deformation.

Stability asks that every further isochoric strain does positive work against the change
of Kirchhoff stress it causes, Σ dτ_i de_i > 0 with e_i = log λ_i and Σ de_i = 0. The
indeterminate pressure drops out, since Σ dp de_i = 0, and whichever stress is free the
condition is the same: the Hessian of the energy Ψ̃(e₁, e₂) = Ψ(e₁, e₂, −e₁ − e₂) must be
positive definite. In these terms dτ_i = Σ_j ∂²Ψ̃/∂e_i∂e_j de_j, with τ₃ = 0.
"""

from collections.abc import Callable
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from suas_jax.constitutive.base import AbstractLaw, constant
from suas_jax.constitutive.deformation import LogStretches
from suas_jax.constitutive.specimens.homogeneous import MODES
from suas_jax.numerics.length import length

_SAMPLES = 400
_BISECTIONS = 50


def drucker_modulus(
    law: AbstractLaw, stretch_1: ArrayLike, stretch_2: ArrayLike
) -> Float[Array, "..."]:
    """Smallest stiffness of an incompressible material against any further strain.

    min over Σ de_i = 0, Σ de_i² = 1 of ½ Σ dτ_i de_i: the smaller eigenvalue of a 2 × 2 matrix,
    in closed form. At rest it is the shear modulus; the law is stable in Drucker's sense where
    it is positive. The unit of strain weighs the three directions alike, so the value does not
    depend on how they are numbered.

    `stretch_1`: λ₁ > 0, any shape. `stretch_2`: λ₂ > 0, of a shape that broadcasts with λ₁; λ₃
    = 1/(λ₁λ₂).
    Returns the modulus [Pa]. Its derivative where both eigenvalues coincide, as they do at
    rest, is that of their mean.
    """
    e1, e2 = jnp.broadcast_arrays(jnp.log(constant(stretch_1)), jnp.log(constant(stretch_2)))

    # Orthonormal directions of the plane Σe_i = 0, and their sum: curvatures along the
    # three, all in one evaluation of the law, are the Hessian.
    first, second = (1 / np.sqrt(2), -1 / np.sqrt(2)), (1 / np.sqrt(6), 1 / np.sqrt(6))
    directions = np.stack([first, second, np.add(first, second)])

    def curvature(d: Float[Array, "2"]) -> Array:
        def energy(step: Array) -> Array:
            return law.energy(LogStretches(e1 + step * d[0], e2 + step * d[1]))

        def slope(step: Array) -> Array:
            return jax.jvp(energy, (step,), (one,))[1]

        return jax.jvp(slope, (zero,), (one,))[1]

    zero, one = jnp.zeros_like(e1), jnp.ones_like(e1)
    h11, h22, both = jax.vmap(curvature)(jnp.asarray(directions, e1.dtype))
    h12 = 0.5 * (both - h11 - h22)
    return 0.5 * (0.5 * (h11 + h22) - length(jnp.stack([0.5 * (h11 - h22), h12])))


def stable_range(
    law: AbstractLaw, mode: str, limits: tuple[float, float] = (0.1, 10.0)
) -> tuple[Float[Array, "*lanes"], Float[Array, "*lanes"]]:
    """Interval of stretches around one in which a law is stable in a mode.

    `mode`: "uniaxial", "equibiaxial" or "planar". `limits`: stretches beyond which is not
    looked, 0 < low < 1 < high.
    Returns the lowest and highest stretch, to 1e-10, in the shape of the law's lanes; a limit
    where stability is not lost before it. Differentiable in the law's constants. A loss and
    recovery within 1/400 of the way to a limit can be overlooked.
    Raises ValueError: the mode is unknown, or the limits do not enclose one.
    """
    if mode not in MODES:
        raise ValueError(f"unknown mode {mode!r}; it is one of {sorted(MODES)}")
    low, high = limits
    if not 0.0 < low < 1.0 < high:
        raise ValueError(f"limits must satisfy 0 < low < 1 < high, got {limits}")
    ends = jnp.log(jnp.array([low, high]))
    found = _first_losses(law, jnp.asarray(MODES[mode].ratio), ends)
    return found[0], found[1]


@eqx.filter_jit
def _first_losses(
    law: AbstractLaw, ratio: Float[Array, ""], ends: Float[Array, " 2"]
) -> Float[Array, "2 *lanes"]:
    """Stretches at which stability is lost on the way from rest to each end."""

    def modulus(law: AbstractLaw, h: Array) -> Array:
        return drucker_modulus(law, jnp.exp(h), jnp.exp(ratio * h))

    # The search is not differentiated: its last step is, below.
    frozen = jax.lax.stop_gradient(law)
    lanes = law.shear_modulus.shape
    at, found = jax.vmap(lambda end: _bracket(partial(modulus, frozen), end, lanes))(ends)
    # One Newton step with a frozen slope: it carries the root's derivative with respect
    # to the constants (implicit function theorem).
    _, slope = jax.jvp(partial(modulus, frozen), (at,), (jnp.ones_like(at),))
    root = at - modulus(law, at) / slope
    # At the end of a law's domain, such as locked chains, there is no slope to follow.
    return jnp.exp(jnp.where(found & jnp.isfinite(root), root, at))


def _bracket(
    modulus: Callable[[Array], Array], end: Float[Array, ""], lanes: tuple[int, ...]
) -> tuple[Float[Array, "*lanes"], Bool[Array, "*lanes"]]:
    """First zero of a modulus on the way from 0 to `end`, or `end`; whether there is one."""
    h = (end * jnp.arange(_SAMPLES + 1) / _SAMPLES).reshape(-1, *(1,) * len(lanes))
    stable = jnp.broadcast_to(modulus(h) > 0.0, (_SAMPLES + 1, *lanes))
    lost = jnp.argmin(stable, axis=0)
    found = ~jnp.all(stable, axis=0)
    outer = jnp.where(found, end * lost / _SAMPLES, end)
    # A law that is unstable at rest has no interval: both ends are one.
    inner = jnp.where(found, end * jnp.maximum(lost - 1, 0) / _SAMPLES, end)

    def halve(_: int, bracket: tuple[Array, Array]) -> tuple[Array, Array]:
        inner, outer = bracket
        middle = 0.5 * (inner + outer)
        good = modulus(middle) > 0.0
        return jnp.where(good, middle, inner), jnp.where(good, outer, middle)

    inner, outer = jax.lax.fori_loop(0, _BISECTIONS, halve, (inner, outer))
    return 0.5 * (inner + outer), found & (lost > 0)
