"""The parameters of a law in a fit, derived from the law's declaration."""

from collections.abc import Mapping
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from fitting.material.laws.parameters import (
    Bounds,
    Constant,
    Family,
    LawBlock,
    Scales,
    Signs,
    SumBlock,
    Vector,
)
from suas_jax.config.law import Constant as Declaration
from suas_jax.config.schema_scene import LAWS
from suas_jax.constitutive import registry
from suas_jax.constitutive.laws.ogden import Ogden

_SMALLEST_EXPONENT = 1e-4
_LARGEST_POWER = 80.0


class _Exponent(Constant):
    """α_p, which θ is as long as it is small; λ^α_p stays below exp(80)."""

    def value(self, theta: Array, scales: Scales) -> ArrayLike:
        alpha = theta / jnp.sqrt(1.0 + (theta * scales.strain / _LARGEST_POWER) ** 2)
        near = jnp.abs(alpha) < _SMALLEST_EXPONENT
        return jnp.where(near, jnp.where(alpha < 0, -1.0, 1.0) * _SMALLEST_EXPONENT, alpha)

    def theta(self, value: Array, scales: Scales) -> ArrayLike:
        within = jnp.minimum(jnp.abs(value) * scales.strain / _LARGEST_POWER, 1.0 - 1e-9)
        return value / jnp.sqrt(1.0 - within**2)


class OgdenBlock(LawBlock):
    """Constants of Ogden's law with a number of terms, θ = (log m_p/s, ~α_p).

    The share of the shear modulus m_p = μ_p α_p / 2 > 0 keeps Eq. 12 and is smooth through
    α_p = 0, where μ_p alone is not.
    """

    settings: ClassVar[Mapping[str, str]] = {"convention": "mu/alpha"}

    def terms(self, values: Any) -> tuple[Any, Any]:
        """What multiplies each term, and its exponent, each [term]."""
        return values[: self.size // 2], values[self.size // 2 :]

    def mixed(self, values: Vector) -> Vector:
        """μ_p [Pa] from the shares of the modulus, and α_p."""
        share, alpha = self.terms(values)
        return jnp.concatenate([2.0 * share / alpha, alpha])

    def unmixed(self, constants: Vector) -> Vector:
        """Shares of the modulus from μ_p [Pa], and α_p."""
        mu, alpha = self.terms(constants)
        return jnp.concatenate([0.5 * mu * alpha, alpha])

    def random(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Exponents of both signs and all usual sizes, terms of equal share."""
        terms = self.size // 2
        size = np.exp(rng.uniform(np.log(0.4), np.log(14.0), (count, terms)))
        alpha = size * np.where(rng.uniform(size=size.shape) < 0.35, -1.0, 1.0)
        alpha[0] = ([2.0, -2.0, 4.0, -4.0, 6.0, 8.0] * terms)[:terms]
        return np.concatenate([np.log(np.full((count, terms), 1.0 / terms)), alpha], axis=1)

    def signs(self, constants: np.ndarray, bounds: Bounds) -> Signs:
        """μ_p α_p > 0: each exponent keeps its sign, unless a bound fixes another one."""
        terms, low, high = self.size // 2, np.zeros(self.size), np.full(self.size, np.inf)
        for p in range(terms):
            negative = constants[terms + p] < 0.0
            for part in (self.parts[p], self.parts[terms + p]):
                least, most = bounds.get(part.name, (-np.inf, np.inf))
                negative = (negative or most <= 0.0) and least < 0.0
            if negative:
                low[[p, terms + p]], high[[p, terms + p]] = -np.inf, 0.0
        return low, high

    def ordered(self, constants: np.ndarray) -> np.ndarray:
        """Terms by falling share of the shear modulus."""
        mu, alpha = self.terms(constants)
        order = np.argsort(-mu * alpha, kind="stable")
        return np.concatenate([mu[order], alpha[order]])


def _ogden(*constants: Float[Array, ""]) -> Ogden:
    """The law from μ_0, ..., α_0, ..."""
    return Ogden(*jnp.stack(constants).reshape(2, -1))


def _ogden_family(terms: int) -> Family:
    shares = [Constant(f"mu.{i}", shown=f"mu.{i} alpha.{i} / 2") for i in range(terms)]
    exponents = [_Exponent(f"alpha.{i}", "free", "1") for i in range(terms)]
    parts = (*shares, *exponents)
    return Family("ogden", parts, _ogden, OgdenBlock, f"ogden-{terms}", terms)


def family(law: str, terms: int | None = None) -> Family:
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
    if law == "ogden":
        return _ogden_family(count)
    chosen = {k: c for k, c in spec.declared().items() if c.since <= count}
    bound = len(spec.half_modulus) > 1 and set(spec.half_modulus) <= chosen.keys()
    alone = spec.half_modulus[:1]
    parts = tuple(
        _part(key, declared, positive=declared.positive or key in alone)
        for key, declared in chosen.items()
    )
    # Where several numbers of constants are compared, the name tells them apart.
    shown = f"{law}-{count}" if len(spec.compared) > 1 else law
    return Family(law, parts, registry.LAWS[law], SumBlock if bound else LawBlock, shown)


def candidates() -> list[tuple[str, int]]:
    """Laws and numbers of terms that are compared, by rising number of constants."""
    every = [(law, terms) for law, spec in LAWS.items() for terms in spec.compared]
    return sorted(every, key=lambda pair: family(*pair).size)


def _part(name: str, declared: Declaration, *, positive: bool) -> Constant:
    kind = "above I1" if declared.limits_i1 else "positive" if positive else "free"
    usual = (-0.3, 0.3) if kind == "free" else (-1.0, 1.0)
    start = declared.start or usual
    return Constant(name, kind, declared.unit, declared.degree, start)
