"""Bijections between a law's constants and unconstrained, dimensionless parameters.

A least-squares solver moves in ℝⁿ; a law's constants have units, signs and limits. Each family
maps θ ∈ ℝⁿ to constants that its law accepts, whatever θ: positive ones are exponentials, and
constants that only a condition on their sum binds become that sum and the rest.
"""

import abc
import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from suas_jax.constitutive import AbstractLaw

Vector = Float[Array, " p"]
"""Constants of a block, or their parameters."""
Bounds = Mapping[str, tuple[float, float]]
"""Lowest and highest value by constant, SI units."""
Signs = tuple[np.ndarray, np.ndarray]
Columns = Callable[[AbstractLaw], Array]


class Scales(NamedTuple):
    """What makes a law's constants dimensionless for a given set of data."""

    stress: ArrayLike  # a typical modulus [Pa]
    i1: ArrayLike  # largest I₁ − 3 in the data
    i2: ArrayLike  # largest I₂ − 3 in the data
    strain: ArrayLike  # largest |log λ| of any direction in the data


class AbstractBlock(abc.ABC):
    """Some constants and the parameters θ that reach them. Instances compare by value.

    `names` are TOML paths inside [material], such as "mu.0"; `units` are SI, "1" for a number.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]

    @property
    def size(self) -> int:
        """Number of constants."""
        return len(self.names)

    @property
    def stresses(self) -> np.ndarray:
        """Which constants are stresses, shape [p]."""
        return np.array([unit == "Pa" for unit in self.units])

    @abc.abstractmethod
    def constants(self, theta: Vector, scales: Scales) -> Vector:
        """Constants in SI units from unconstrained parameters."""

    @abc.abstractmethod
    def unconstrained(self, constants: Vector, scales: Scales) -> Vector:
        """Parameters from constants, the inverse of `constants`."""

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

    def ordered(self, constants: np.ndarray) -> np.ndarray:
        """Constants in canonical order, where equal laws can be written in several."""
        return constants

    def signs(self, constants: np.ndarray, bounds: Bounds) -> Signs:
        """Lowest and highest constants that the law's own conditions allow, each [p].

        `constants`: a point that meets them, where a condition leaves a choice. `bounds`: what
        else is asked of the constants; it may make that choice.
        """
        return np.full(self.size, -np.inf), np.full(self.size, np.inf)


class AbstractFamily(AbstractBlock):
    """A law whose constants are to be found.

    `terms` is the number of terms of a law whose constants come as lists, one entry a term.
    """

    law_name: str
    terms: int | None = None

    @property
    def law_size(self) -> int:
        """Number of the law's own constants, which come first; the rest is beside the law."""
        return self.size

    @property
    def title(self) -> str:
        """Name for people, with the number of terms."""
        return self.law_name

    @property
    def settings(self) -> dict[str, Any]:
        """Keys of [material] beside the law and its constants."""
        return {}

    @abc.abstractmethod
    def law(self, constants: Vector) -> AbstractLaw:
        """The law with these constants."""

    def effects(self, constants: np.ndarray) -> dict[str, Any]:
        """What [material] says beside the law's constants; by default nothing."""
        return {}

    def zeros(self, constants: Vector) -> Float[Array, " k"]:
        """Unknowns of the tests among the constants; by default there are none."""
        return constants[self.size :]

    def refined(self, theta: Vector, columns: Columns, scales: Scales, target: Array) -> Vector:
        """Improve a start by what is linear in it; by default it stays.

        `columns`: weighed readings of a law with unit modulus. `scales`: sizes that make
        constants dimensionless. `target`: weighed measurements.
        """
        return theta

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


@dataclasses.dataclass(frozen=True)
class Constant:
    """One constant of a law and the bijection that reaches it."""

    name: str  # key in [material]
    # "positive", c = s exp(θ); "free", c = s θ; "above one", c = 1 + exp(θ); or "above I1", a
    # limit of I₁ − 3 that all data stay below, c = i1 (1 + exp(θ))
    kind: str = "positive"
    # SI, "1" for a number. The size s is the typical modulus for a stress, else one.
    unit: str = "Pa"
    # (i, j) of the invariants it multiplies, which sets its size
    degree: tuple[int, int] = (0, 0)
    start: tuple[float, float] = (-1.0, 1.0)  # range of θ to start from

    def size(self, scales: Scales) -> ArrayLike:
        """Typical size of the constant."""
        if self.unit != "Pa":
            return 1.0
        i, j = self.degree
        if i + j <= 1:
            return scales.stress
        return scales.stress / (scales.i1**i * scales.i2**j) * (scales.i1 + scales.i2)

    def value(self, theta: Array, scales: Scales) -> ArrayLike:
        """The constant, SI."""
        if self.kind == "positive":
            return self.size(scales) * jnp.exp(theta)
        if self.kind == "free":
            return self.size(scales) * theta
        return (1.0 if self.kind == "above one" else scales.i1) * (1.0 + jnp.exp(theta))

    def theta(self, value: Array, scales: Scales) -> ArrayLike:
        """The parameter that gives a value, SI."""
        if self.kind == "positive":
            return jnp.log(value / self.size(scales))
        if self.kind == "free":
            return value / self.size(scales)
        return jnp.log(value / (1.0 if self.kind == "above one" else scales.i1) - 1.0)


class IndependentConstants(AbstractBlock):
    """Constants of which each has its own parameter: `parts`, in the order of their names."""

    parts: tuple[Constant, ...]

    @property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Keys in [material]."""
        return tuple(part.name for part in self.parts)

    @property
    def units(self) -> tuple[str, ...]:  # type: ignore[override]
        """Unit of each constant."""
        return tuple(part.unit for part in self.parts)

    @property
    def prior_deviation(self) -> np.ndarray:
        """Logarithms 3, the rest 10."""
        return np.array([10.0 if part.kind == "free" else 3.0 for part in self.parts])

    @property
    def theta_names(self) -> tuple[str, ...]:
        """Names of the parameters: log(name) where a parameter is a logarithm."""
        forms = {"free": "{}", "above one": "log({} - 1)"}
        return tuple(forms.get(part.kind, "log({})").format(part.name) for part in self.parts)

    def constants(self, theta: Vector, scales: Scales) -> Vector:
        """Constants in SI units."""
        pairs = zip(self.parts, theta, strict=True)
        return jnp.stack([jnp.asarray(part.value(t, scales)) for part, t in pairs])

    def unconstrained(self, constants: Vector, scales: Scales) -> Vector:
        """Parameters from constants."""
        pairs = zip(self.parts, constants, strict=True)
        return jnp.stack([jnp.asarray(part.theta(c, scales)) for part, c in pairs])

    def signs(self, constants: np.ndarray, bounds: Bounds) -> Signs:
        """Zero and up for positive constants."""
        low = np.where([part.kind == "free" for part in self.parts], -np.inf, 0.0)
        return low, np.full(self.size, np.inf)

    def random(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Uniform in each constant's range of starts; the first from its middle."""
        low, high = np.array([part.start for part in self.parts]).T
        starts = rng.uniform(low, high, (count, self.size))
        starts[0] = 0.5 * (low + high)
        return starts


@dataclasses.dataclass(frozen=True)
class Family(IndependentConstants, AbstractFamily):
    """A law whose constants are independent of each other.

    A law of one's own takes part in everything:
    `Family("mine", (Constant("mu"), Constant("k", "free", "1")), MyLaw)`.
    """

    law_name: str  # value of `law` in [material]
    parts: tuple[Constant, ...]  # its constants, in the order of the law's arguments
    build: Callable[..., AbstractLaw]  # the law's class
    # the first two constants are bound by C₁ + C₂ > 0; the first parameter is then the
    # logarithm of that sum
    modulus_is_sum: bool = False
    shown: str = ""  # name for people, where it is not the law's

    @property
    def title(self) -> str:
        """Name for people."""
        return self.shown or self.law_name

    def constants(self, theta: Vector, scales: Scales) -> Vector:
        """Constants in SI units."""
        found = super().constants(theta, scales)
        return found.at[0].add(-found[1]) if self.modulus_is_sum else found

    def unconstrained(self, constants: Vector, scales: Scales) -> Vector:
        """Parameters from constants."""
        if self.modulus_is_sum:
            constants = jnp.asarray(constants).at[0].add(constants[1])
        return super().unconstrained(constants, scales)

    def law(self, constants: Vector) -> AbstractLaw:
        """The law with these constants."""
        return self.build(*constants)

    @property
    def theta_names(self) -> tuple[str, ...]:
        """Names of the parameters: log(name) where a parameter is a logarithm."""
        names = super().theta_names
        first, second, *_ = (*self.names, "")
        return (f"log({first} + {second})", *names[1:]) if self.modulus_is_sum else names

    def signs(self, constants: np.ndarray, bounds: Bounds) -> Signs:
        """Zero and up for positive constants that stand alone."""
        low, high = super().signs(constants, bounds)
        if self.modulus_is_sum:
            low[0] = -np.inf
        return low, high
