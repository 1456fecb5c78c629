"""The parameters of a law in a fit, derived from the law's declaration."""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fitting.material.laws.parameters import (
    AbstractFamily,
    Bounds,
    Columns,
    Constant,
    Family,
    Scales,
    Signs,
    Vector,
)
from suas_jax.config.law import Constant as Declaration
from suas_jax.config.schema_scene import LAWS
from suas_jax.constitutive import AbstractLaw, registry
from suas_jax.constitutive.laws.ogden import Ogden

_SMALLEST_EXPONENT = 1e-4
_LARGEST_POWER = 80.0


@dataclasses.dataclass(frozen=True)
class OgdenFamily(AbstractFamily):
    """Ogden's law with a number of terms, θ = (log m_p/s, ~α_p).

    The share of the shear modulus m_p = μ_p α_p / 2 > 0 keeps Eq. 12 and is smooth through
    α_p = 0, where μ_p alone is not.
    """

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


# Laws whose constants come as lists, one entry a term.
_BY_TERMS: dict[str, Callable[[int], AbstractFamily]] = {"ogden": OgdenFamily}


def family(law: str, terms: int | None = None) -> AbstractFamily:
    """The constants of a law to be fitted.

    `terms`: number of terms (Ogden 1 to 6, Mooney-Rivlin and Yeoh 1 to 3 constants) or degree
    (polynomial 1 to 3); None takes the usual number.
    Raises ValueError: the law is unknown or has no such number of terms.
    """
    if law not in LAWS:
        raise ValueError(f"--law {law}: unknown law; allowed: auto, {', '.join(LAWS)}")
    spec = LAWS[law]
    most = spec.most_terms()
    count = (spec.usual_terms or most) if terms is None else terms
    if not 1 <= count <= most:
        allowed = "1" if most == 1 else f"1 to {most}"
        raise ValueError(f"--terms {count}: {law} allows {allowed}")
    if law in _BY_TERMS:
        return _BY_TERMS[law](count)
    chosen = {k: c for k, c in spec.declared().items() if c.since <= count}
    bound = len(spec.half_modulus) > 1 and set(spec.half_modulus) <= chosen.keys()
    alone = spec.half_modulus[:1]
    parts = tuple(
        _part(key, declared, positive=declared.positive or key in alone)
        for key, declared in chosen.items()
    )
    # Where several numbers of constants are compared, the name tells them apart.
    shown = f"{law}-{count}" if len(spec.compared) > 1 else law
    return Family(law, parts, registry.LAWS[law], modulus_is_sum=bound, shown=shown)


def candidates() -> list[tuple[str, int]]:
    """Laws and numbers of terms that are compared, by rising number of constants."""
    every = [(law, terms) for law, spec in LAWS.items() for terms in spec.compared]
    return sorted(every, key=lambda pair: family(*pair).size)


def _part(name: str, declared: Declaration, *, positive: bool) -> Constant:
    kind = "above I1" if declared.limits_i1 else "positive" if positive else "free"
    usual = (-0.3, 0.3) if kind == "free" else (-1.0, 1.0)
    start = declared.start or usual
    return Constant(name, kind, declared.unit, declared.degree, start)
