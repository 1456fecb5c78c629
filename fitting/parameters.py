"""Bijections between a law's constants and unconstrained, dimensionless parameters.

A least-squares solver moves in ℝⁿ; a law's constants have units, signs and limits. Each
family maps θ ∈ ℝⁿ to constants that its law accepts, whatever θ: positive ones are
exponentials, an Ogden term is its share of the shear modulus m_p = μ_p α_p / 2 > 0 and
its exponent, which keeps Eq. 12 and is smooth through α_p = 0, where μ_p alone is not.
"""

import abc
import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from suas_jax.constitutive import (
    AbstractLaw,
    ArrudaBoyce,
    Gent,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    Polynomial,
    Yeoh,
)

_SMALLEST_EXPONENT = 1e-4
_LARGEST_POWER = 80.0


class Scales(NamedTuple):
    """What makes a law's constants dimensionless for a given set of data.

    Attributes:
        stress: a typical modulus [Pa].
        i1: largest I₁ − 3 in the data.
        i2: largest I₂ − 3 in the data.
        strain: largest |log λ| of any direction in the data.
    """

    stress: ArrayLike
    i1: ArrayLike
    i2: ArrayLike
    strain: ArrayLike


class AbstractFamily(abc.ABC):
    """A law whose constants are to be found. Instances compare by value.

    `names` are TOML paths inside [material], such as "mu.0"; `units` are "Pa" or "1".
    """

    law_name: str
    names: tuple[str, ...]
    units: tuple[str, ...]

    @property
    def size(self) -> int:
        """Number of constants."""
        return len(self.names)

    @property
    def title(self) -> str:
        """Name for people, with the number of terms."""
        return self.law_name

    @abc.abstractmethod
    def constants(self, theta: Float[Array, " p"], scales: Scales) -> Float[Array, " p"]:
        """Constants in SI units from unconstrained parameters."""

    @abc.abstractmethod
    def unconstrained(
        self, constants: Float[Array, " p"], scales: Scales
    ) -> Float[Array, " p"]:
        """Parameters from constants, the inverse of `constants`."""

    @abc.abstractmethod
    def law(self, constants: Float[Array, " p"]) -> AbstractLaw:
        """The law with these constants."""

    @abc.abstractmethod
    def random(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Starting points θ, shape [count, p]; the first is a plain guess."""

    @property
    def prior_deviation(self) -> np.ndarray:
        """Standard deviations of the normal prior of θ about zero, shape [p].

        Wide: a logarithm within a factor of 400 (95 %), anything else within 20 of its
        natural sizes.
        """
        return np.full(self.size, 10.0)

    @property
    def theta_names(self) -> tuple[str, ...]:
        """What each θ is, for people."""
        return self.names

    def refined(
        self,
        theta: Float[Array, " p"],
        columns: Callable[[AbstractLaw], Array],
        scales: Scales,
        target: Array,
    ) -> Float[Array, " p"]:
        """Improve a start by what is linear in it; by default it stays.

        Args:
            theta: the start.
            columns: weighed readings of a law with unit modulus.
            scales: sizes that make constants dimensionless.
            target: weighed measurements.
        """
        return theta

    def ordered(self, constants: np.ndarray) -> np.ndarray:
        """Constants in canonical order, where equal laws can be written in several."""
        return constants

    def signs(
        self, constants: np.ndarray, bounds: Mapping[str, tuple[float, float]]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest constants that the law's own conditions allow, each [p].

        Args:
            constants: a point that meets them, where a condition leaves a choice.
            bounds: what else is asked of the constants; it may make that choice.
        """
        return np.full(self.size, -np.inf), np.full(self.size, np.inf)

    def tree(self, values: Any) -> dict[str, Any]:
        """Per-constant values by the keys of [material]."""
        tree: dict[str, Any] = {}
        for name, value in zip(self.names, values, strict=True):
            key, _, index = name.partition(".")
            if index:
                tree.setdefault(key, []).append(value)
            else:
                tree[key] = value
        return tree


class Constant(NamedTuple):
    """One constant of a law and the bijection that reaches it.

    Attributes:
        name: key in [material].
        kind: "positive", c = s exp(θ); "free", c = s θ; or "above I1", a limit of I₁ − 3
            that all data stay below, c = i1 (1 + exp(θ)).
        unit: "Pa" or "1". The size s is the typical modulus for a stress, one otherwise.
        degree: (i, j) of the invariants it multiplies, which sets its size.
        start: range of θ to start from.
    """

    name: str
    kind: str = "positive"
    unit: str = "Pa"
    degree: tuple[int, int] = (0, 0)
    start: tuple[float, float] = (-1.0, 1.0)

    def size(self, scales: Scales) -> ArrayLike:
        """Typical size of the constant."""
        if self.unit != "Pa":
            return 1.0
        i, j = self.degree
        if i + j <= 1:
            return scales.stress
        return scales.stress / (scales.i1**i * scales.i2**j) * (scales.i1 + scales.i2)


@dataclasses.dataclass(frozen=True)
class Family(AbstractFamily):
    """A law whose constants are independent of each other.

    A law of one's own takes part in everything:
    `Family("mine", (Constant("mu"), Constant("k", "free", "1")), MyLaw)`.

    Attributes:
        law_name: value of `law` in [material].
        parts: its constants, in the order of the law's arguments.
        build: the law's class.
        modulus_is_sum: the first two constants are bound by C₁ + C₂ > 0; the first
            parameter is then the logarithm of that sum.
    """

    law_name: str
    parts: tuple[Constant, ...]
    build: Callable[..., AbstractLaw]
    modulus_is_sum: bool = False

    @property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Keys in [material]."""
        return tuple(part.name for part in self.parts)

    @property
    def units(self) -> tuple[str, ...]:  # type: ignore[override]
        """Unit of each constant."""
        return tuple(part.unit for part in self.parts)

    def constants(self, theta: Float[Array, " p"], scales: Scales) -> Float[Array, " p"]:
        """Constants in SI units."""
        values = []
        for part, t in zip(self.parts, theta, strict=True):
            if part.kind == "positive":
                values.append(part.size(scales) * jnp.exp(t))
            elif part.kind == "free":
                values.append(part.size(scales) * t)
            else:
                values.append(scales.i1 * (1.0 + jnp.exp(t)))
        if self.modulus_is_sum:
            values[0] = values[0] - values[1]
        return jnp.stack(values)

    def unconstrained(
        self, constants: Float[Array, " p"], scales: Scales
    ) -> Float[Array, " p"]:
        """Parameters from constants."""
        values = list(constants)
        if self.modulus_is_sum:
            values[0] = values[0] + values[1]
        theta = []
        for part, c in zip(self.parts, values, strict=True):
            if part.kind == "positive":
                theta.append(jnp.log(c / part.size(scales)))
            elif part.kind == "free":
                theta.append(c / part.size(scales))
            else:
                theta.append(jnp.log(c / scales.i1 - 1.0))
        return jnp.stack(theta)

    def law(self, constants: Float[Array, " p"]) -> AbstractLaw:
        """The law with these constants."""
        return self.build(*constants)

    @property
    def prior_deviation(self) -> np.ndarray:
        """Logarithms 3, the rest 10."""
        return np.array([10.0 if part.kind == "free" else 3.0 for part in self.parts])

    @property
    def theta_names(self) -> tuple[str, ...]:
        """Logarithms are said."""
        said = []
        for i, part in enumerate(self.parts):
            name = part.name
            if i == 0 and self.modulus_is_sum:
                name = f"{self.parts[0].name} + {self.parts[1].name}"
            said.append(name if part.kind == "free" else f"log({name})")
        return tuple(said)

    def signs(
        self, constants: np.ndarray, bounds: Mapping[str, tuple[float, float]]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Zero and up for positive constants that stand alone."""
        alone = [part.kind != "free" for part in self.parts]
        if self.modulus_is_sum:
            alone[0] = False
        return np.where(alone, 0.0, -np.inf), np.full(self.size, np.inf)

    def random(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Uniform in each constant's range of starts; the first from its middle."""
        low, high = np.array([part.start for part in self.parts]).T
        starts = rng.uniform(low, high, (count, self.size))
        starts[0] = 0.5 * (low + high)
        return starts


@dataclasses.dataclass(frozen=True)
class OgdenFamily(AbstractFamily):
    """Ogden's law with a number of terms, θ = (log m_p/s, ~α_p), m_p = μ_p α_p / 2.

    Attributes:
        terms: number of terms.
    """

    terms: int
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
    def prior_deviation(self) -> np.ndarray:
        """Shares 3 in their logarithm, exponents 10."""
        return np.repeat([3.0, 10.0], self.terms)

    @property
    def theta_names(self) -> tuple[str, ...]:
        """Shares of the shear modulus, then exponents."""
        shares = tuple(f"log(mu.{i} alpha.{i} / 2)" for i in range(self.terms))
        return shares + self.names[self.terms :]

    def constants(self, theta: Float[Array, " p"], scales: Scales) -> Float[Array, " p"]:
        """μ_p [Pa] and α_p."""
        share = scales.stress * jnp.exp(theta[: self.terms])
        alpha = self._exponents(theta, scales)
        return jnp.concatenate([2.0 * share / alpha, alpha])

    def unconstrained(
        self, constants: Float[Array, " p"], scales: Scales
    ) -> Float[Array, " p"]:
        """Parameters from μ_p [Pa] and α_p."""
        mu, alpha = constants[: self.terms], constants[self.terms :]
        within = jnp.minimum(jnp.abs(alpha) * scales.strain / _LARGEST_POWER, 1.0 - 1e-9)
        spread = alpha / jnp.sqrt(1.0 - within**2)
        return jnp.concatenate([jnp.log(0.5 * mu * alpha / scales.stress), spread])

    def _exponents(self, theta: Float[Array, " p"], scales: Scales) -> Float[Array, " terms"]:
        """α_p, which θ_p is as long as it is small; λ^α_p stays below exp(80)."""
        spread = theta[self.terms :]
        alpha = spread / jnp.sqrt(1.0 + (spread * scales.strain / _LARGEST_POWER) ** 2)
        near = jnp.abs(alpha) < _SMALLEST_EXPONENT
        return jnp.where(near, jnp.where(alpha < 0, -1.0, 1.0) * _SMALLEST_EXPONENT, alpha)

    def law(self, constants: Float[Array, " p"]) -> AbstractLaw:
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

    def refined(
        self,
        theta: Float[Array, " p"],
        columns: Callable[[AbstractLaw], Array],
        scales: Scales,
        target: Array,
    ) -> Float[Array, " p"]:
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

    def signs(
        self, constants: np.ndarray, bounds: Mapping[str, tuple[float, float]]
    ) -> tuple[np.ndarray, np.ndarray]:
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


_DEGREES = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3))


def _free(name: str, degree: tuple[int, int]) -> Constant:
    return Constant(name, "free", "Pa", degree, (-0.3, 0.3))


def _mooney_rivlin(terms: int) -> AbstractFamily:
    parts = (Constant("C1"), _free("C2", (0, 1)), _free("C3", (0, 2)))[:terms]
    return Family("mooney-rivlin", parts, MooneyRivlin, modulus_is_sum=terms > 1)


def _yeoh(terms: int) -> AbstractFamily:
    parts = (Constant("C1"), _free("C2", (2, 0)), _free("C3", (3, 0)))[:terms]
    return Family("yeoh", parts, Yeoh)


def _polynomial(degree: int) -> AbstractFamily:
    chosen = [(i, j) for i, j in _DEGREES if i + j <= degree]
    parts = tuple(_free(f"C{i}{j}", (i, j)) for i, j in chosen[1:])
    return Family("polynomial", (Constant("C10"), *parts), Polynomial, modulus_is_sum=True)


def _ogden(terms: int) -> AbstractFamily:
    return OgdenFamily(terms)


def _fixed(*parts: Constant, law: str, build: Callable) -> Callable[[int], AbstractFamily]:
    return lambda terms: Family(law, parts, build)


class Choice(NamedTuple):
    """A law that can be asked for by name.

    Attributes:
        build: family from the number of terms (polynomial: the degree).
        usual: number of terms if none is asked for.
        most: largest number of terms.
    """

    build: Callable[[int], AbstractFamily]
    usual: int = 1
    most: int = 1


CHOICES: dict[str, Choice] = {
    "neo-hookean": Choice(_fixed(Constant("mu"), law="neo-hookean", build=NeoHookean)),
    "mooney-rivlin": Choice(_mooney_rivlin, 3, 3),
    "yeoh": Choice(_yeoh, 3, 3),
    "ogden": Choice(_ogden, 3, 6),
    "gent": Choice(
        _fixed(
            Constant("mu"),
            Constant("Jm", "above I1", "1", start=(-4.0, 2.0)),
            law="gent",
            build=Gent,
        )
    ),
    "arruda-boyce": Choice(
        _fixed(
            Constant("mu"),
            Constant("lambda_m", "positive", "1", start=(0.2, 3.0)),
            law="arruda-boyce",
            build=ArrudaBoyce,
        )
    ),
    "polynomial": Choice(_polynomial, 2, 3),
}


def family(law: str, terms: int | None = None) -> AbstractFamily:
    """Choose a law by name.

    Args:
        law: a value of `law` in [material].
        terms: number of terms (Ogden 1 to 6, Mooney-Rivlin and Yeoh 1 to 3 constants) or
            degree (polynomial 1 to 3); None takes the usual number.

    Raises:
        ValueError: the law is unknown or has no such number of terms.
    """
    if law not in CHOICES:
        raise ValueError(f"--law {law}: unknown law; allowed: auto, {', '.join(CHOICES)}")
    choice = CHOICES[law]
    count = choice.usual if terms is None else terms
    if not 1 <= count <= choice.most:
        allowed = "1" if choice.most == 1 else f"1 to {choice.most}"
        raise ValueError(f"--terms {count}: {law} allows {allowed}")
    return choice.build(count)
