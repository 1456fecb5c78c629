"""Unconstrained parameters of Ogden's law.

A term is its share of the shear modulus m_p = μ_p α_p / 2 > 0 and its exponent, which keeps
Eq. 12 and is smooth through α_p = 0, where μ_p alone is not.
"""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fitting.material.laws.parameters import (
    AbstractFamily,
    Bounds,
    Columns,
    Scales,
    Signs,
    Vector,
)
from suas_jax.constitutive import AbstractLaw
from suas_jax.constitutive.laws.ogden import Ogden

_SMALLEST_EXPONENT = 1e-4
_LARGEST_POWER = 80.0


@dataclasses.dataclass(frozen=True)
class OgdenFamily(AbstractFamily):
    """Ogden's law with a number of terms, θ = (log m_p/s, ~α_p), m_p = μ_p α_p / 2."""

    terms: int  # number of terms
    law_name: str = "ogden"

    def __post_init__(self) -> None:
        if self.terms < 1:
            raise ValueError(f"Ogden law: at least one term is needed, got {self.terms}")

    @property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]
        """mu.0, ..., alpha.0, ..."""
        return tuple(f"{key}.{i}" for key in ("mu", "alpha") for i in range(self.terms))

    @property
    def units(self) -> tuple[str, ...]:  # type: ignore[override]
        """Pascals and pure numbers."""
        return ("Pa",) * self.terms + ("1",) * self.terms

    @property
    def title(self) -> str:
        """Name with the number of terms."""
        return f"ogden-{self.terms}"

    @property
    def settings(self) -> dict[str, Any]:
        """The convention of the constants."""
        return {"convention": "mu/alpha"}

    @property
    def prior_deviation(self) -> np.ndarray:
        """Shares 3 in their logarithm, exponents 10."""
        return np.repeat([3.0, 10.0], self.terms)

    @property
    def theta_names(self) -> tuple[str, ...]:
        """Shares of the shear modulus, then exponents."""
        shares = tuple(f"log(mu.{i} alpha.{i} / 2)" for i in range(self.terms))
        return shares + self.names[self.terms :]

    def constants(self, theta: Vector, scales: Scales) -> Vector:
        """μ_p [Pa] and α_p."""
        share = scales.stress * jnp.exp(theta[: self.terms])
        alpha = self._exponents(theta, scales)
        return jnp.concatenate([2.0 * share / alpha, alpha])

    def unconstrained(self, constants: Vector, scales: Scales) -> Vector:
        """Parameters from μ_p [Pa] and α_p."""
        mu, alpha = constants[: self.terms], constants[self.terms :]
        within = jnp.minimum(jnp.abs(alpha) * scales.strain / _LARGEST_POWER, 1.0 - 1e-9)
        spread = alpha / jnp.sqrt(1.0 - within**2)
        return jnp.concatenate([jnp.log(0.5 * mu * alpha / scales.stress), spread])

    def _exponents(self, theta: Vector, scales: Scales) -> Float[Array, " terms"]:
        """α_p, which θ_p is as long as it is small; λ^α_p stays below exp(80)."""
        spread = theta[self.terms :]
        alpha = spread / jnp.sqrt(1.0 + (spread * scales.strain / _LARGEST_POWER) ** 2)
        near = jnp.abs(alpha) < _SMALLEST_EXPONENT
        return jnp.where(near, jnp.where(alpha < 0, -1.0, 1.0) * _SMALLEST_EXPONENT, alpha)

    def law(self, constants: Vector) -> AbstractLaw:
        """The law with these constants."""
        return Ogden(constants[: self.terms], constants[self.terms :])

    def random(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Exponents of both signs and all usual sizes, terms of equal share."""
        size = np.exp(rng.uniform(np.log(0.4), np.log(14.0), (count, self.terms)))
        sign = np.where(rng.uniform(size=size.shape) < 0.35, -1.0, 1.0)
        alpha = size * sign
        alpha[0] = ([2.0, -2.0, 4.0, -4.0, 6.0, 8.0] * self.terms)[: self.terms]
        share = np.log(np.full((count, self.terms), 1.0 / self.terms))
        return np.concatenate([share, alpha], axis=1)

    def refined(self, theta: Vector, columns: Columns, scales: Scales, target: Array) -> Vector:
        """Best shares m_p ≥ 0 for the given exponents: the residual is linear in them."""
        alpha = self._exponents(theta, scales)
        basis = jax.vmap(lambda a: columns(Ogden((2.0 / a)[None], a[None])))(alpha)
        basis = jnp.where(jnp.isfinite(basis), basis, 0.0)
        gram, moment = basis @ basis.T, basis @ target
        size = jnp.maximum(jnp.diagonal(gram), 1e-300)

        # Coordinate descent for non-negative least squares; a rough answer will do.
        def sweep(_: int, share: Array) -> Array:
            for p in range(self.terms):
                rest = moment[p] - gram[p] @ share
                share = share.at[p].set(jnp.maximum(share[p] + rest / size[p], 0.0))
            return share

        share = jax.lax.fori_loop(0, 30, sweep, jnp.zeros(self.terms))
        # A term that non-negativity switches off stays within reach.
        usual = jnp.abs(moment) / size / self.terms
        share = jnp.maximum(share, jnp.maximum(1e-3 * usual, 1e-12))
        return theta.at[: self.terms].set(jnp.log(share))

    def signs(self, constants: np.ndarray, bounds: Bounds) -> Signs:
        """μ_p α_p > 0: each exponent keeps its sign, unless a bound fixes another one."""
        low, high = np.full(self.size, -np.inf), np.full(self.size, np.inf)
        for p in range(self.terms):
            negative = constants[self.terms + p] < 0.0
            for name in (f"mu.{p}", f"alpha.{p}"):
                least, most = bounds.get(name, (-np.inf, np.inf))
                negative = (negative or most <= 0.0) and least < 0.0
            for i in (p, self.terms + p):
                low[i], high[i] = (-np.inf, 0.0) if negative else (0.0, np.inf)
        return low, high

    def ordered(self, constants: np.ndarray) -> np.ndarray:
        """Terms by falling share of the shear modulus."""
        mu, alpha = constants[: self.terms], constants[self.terms :]
        order = np.argsort(-mu * alpha, kind="stable")
        return np.concatenate([mu[order], alpha[order]])
