"""Bijections between a law's constants and unconstrained, dimensionless parameters.

A least-squares solver moves in ℝⁿ; a law's constants have units, signs and limits. Each block
maps θ ∈ ℝⁿ to constants that its law accepts, whatever θ: every part has its own parameter, a
positive one by an exponential; where a condition binds several constants, all parts together
make them. A family is the product of the block of a law and of those beside it.
"""

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from typing import Any, ClassVar, NamedTuple, TypeVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from suas_jax.constitutive import AbstractLaw

Vector = Float[Array, " p"]
"""Constants of a block, or their parameters."""
Bounds = Mapping[str, tuple[float, float]]
"""Lowest and highest value by constant, SI units."""
Signs = tuple[np.ndarray, np.ndarray]


class Scales(NamedTuple):
    """What makes a law's constants dimensionless for a given set of data."""

    stress: ArrayLike  # a typical modulus [Pa]
    i1: ArrayLike  # largest I₁ − 3 in the data
    i2: ArrayLike  # largest I₂ − 3 in the data
    strain: ArrayLike  # largest |log λ| of any direction in the data


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
    prior: float | None = None  # deviation of θ; None for 10 of a free one, 3 of a logarithm
    shown: str = ""  # what the parameter is of, where that is not the constant

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


class AbstractBlock:
    """Some constants and the parameters θ that reach them. Instances compare by value."""

    parts: tuple[Constant, ...]  # one a constant; names are TOML paths inside [material]
    title: str = ""  # what it adds to a law's title
    settings: ClassVar[Mapping[str, str]] = {}  # what [material] says beside the constants
    of_tests: ClassVar[bool] = False  # whether the constants are unknowns of the tests

    def mixed(self, values: Vector) -> Vector:
        """Constants from the values of the parts; by default they are these."""
        return values

    def unmixed(self, constants: Vector) -> Vector:
        """Values of the parts from constants, the inverse of `mixed`."""
        return constants

    def around(self, law: AbstractLaw, values: Vector) -> AbstractLaw:
        """The law with what the block adds to it; by default nothing."""
        return law

    def effects(self, values: np.ndarray) -> dict[str, Any]:
        """What [material] says beside the law's constants; by default nothing."""
        return {}

    def ordered(self, constants: np.ndarray) -> np.ndarray:
        """Constants in canonical order, where equal laws can be written in several."""
        return constants

    def signs(self, constants: np.ndarray, bounds: Bounds) -> Signs:
        """Lowest and highest constants that the law's own conditions allow, each [p].

        `constants`: a point that meets them, where a condition leaves a choice. `bounds`: what
        else is asked of the constants; it may make that choice.
        """
        low = np.where([part.kind == "free" for part in self.parts], -np.inf, 0.0)
        return low, np.full(self.size, np.inf)

    def random(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Starting points θ, shape [count, p]; the first is a plain guess."""
        low, high = np.array([part.start for part in self.parts]).T
        starts = rng.uniform(low, high, (count, self.size))
        starts[0] = 0.5 * (low + high)
        return starts

    @property
    def size(self) -> int:
        """Number of constants."""
        return len(self.parts)

    @property
    def prior_deviation(self) -> np.ndarray:
        """Standard deviations of the normal prior of θ about zero, shape [p].

        Wide: a logarithm within a factor of 400 (95 %), anything else within 20 of its
        natural sizes.
        """
        usual = {"free": 10.0}
        return np.array([part.prior or usual.get(part.kind, 3.0) for part in self.parts])

    @property
    def theta_names(self) -> tuple[str, ...]:
        """What each θ is, for people: log(name) where it is a logarithm."""
        forms = {"free": "{}", "above one": "log({} - 1)"}
        pairs = ((forms.get(part.kind, "log({})"), part) for part in self.parts)
        return tuple(form.format(part.shown or part.name) for form, part in pairs)

    def constants(self, theta: Vector, scales: Scales) -> Vector:
        """Constants in SI units from unconstrained parameters."""
        pairs = zip(self.parts, theta, strict=True)
        return self.mixed(jnp.stack([jnp.asarray(part.value(t, scales)) for part, t in pairs]))

    def unconstrained(self, constants: Vector, scales: Scales) -> Vector:
        """Parameters from constants, the inverse of `constants`."""
        pairs = zip(self.parts, self.unmixed(jnp.asarray(constants)), strict=True)
        return jnp.stack([jnp.asarray(part.theta(value, scales)) for part, value in pairs])


@dataclasses.dataclass(frozen=True)
class LawBlock(AbstractBlock):
    """A law's own constants, independent of each other."""

    parts: tuple[Constant, ...]


class SumBlock(LawBlock):
    """Constants of which the first two are bound by C₁ + C₂ > 0: the first parameter's sum."""

    def mixed(self, values: Vector) -> Vector:
        """C₁ from the sum."""
        return values.at[0].add(-values[1])

    def unmixed(self, constants: Vector) -> Vector:
        """The sum from C₁."""
        return constants.at[0].add(constants[1])

    @property
    def theta_names(self) -> tuple[str, ...]:
        """The sum's logarithm, then as they are."""
        first, second, *_ = (part.name for part in self.parts)
        return (f"log({first} + {second})", *super().theta_names[1:])

    def signs(self, constants: np.ndarray, bounds: Bounds) -> Signs:
        """Zero and up for positive constants that stand alone."""
        low, high = super().signs(constants, bounds)
        low[0] = -np.inf
        return low, high


def _joined(name: str) -> Any:
    """An array that a family has from all its blocks."""

    def joined(self: "Family") -> np.ndarray:
        return np.concatenate([getattr(block, name) for block in self.blocks])

    return property(joined, doc="Of all blocks.")


@dataclasses.dataclass(frozen=True)
class Family:
    """A law whose constants are to be found, with further blocks of constants beside its own.

    A law of one's own takes part in everything:
    `Family("mine", (Constant("mu"), Constant("k", "free", "1")), MyLaw)`.
    """

    law_name: str  # value of `law` in [material]
    parts: tuple[Constant, ...]  # its constants, in the order of the law's arguments
    build: Callable[..., AbstractLaw]  # the law's class
    law_block: type[LawBlock] = LawBlock  # how the law's constants hang together
    shown: str = ""  # name for people, where it is not the law's
    terms: int | None = None  # number of terms of a law whose constants come as lists
    beside: tuple[AbstractBlock, ...] = ()  # what stands beside the law

    @property
    def blocks(self) -> tuple[AbstractBlock, ...]:
        """The law's own block, then the others."""
        return (self.law_block(self.parts), *self.beside)

    @property
    def names(self) -> tuple[str, ...]:
        """TOML paths inside [material], such as "mu.0"."""
        return tuple(part.name for block in self.blocks for part in block.parts)

    @property
    def units(self) -> tuple[str, ...]:
        """SI units of the constants, "1" for a number."""
        return tuple(part.unit for block in self.blocks for part in block.parts)

    @property
    def theta_names(self) -> tuple[str, ...]:
        """What each θ is, for people."""
        return tuple(name for block in self.blocks for name in block.theta_names)

    @property
    def title(self) -> str:
        """Name for people, with the number of terms and what is beside the law."""
        return (self.shown or self.law_name) + "".join(block.title for block in self.beside)

    @property
    def settings(self) -> Mapping[str, str]:
        """Keys of [material] beside the law and its constants."""
        return self.law_block.settings

    @property
    def law_size(self) -> int:
        """Number of the law's own constants, which come first; the rest is beside the law."""
        return len(self.parts)

    @property
    def size(self) -> int:
        """Number of constants."""
        return sum(block.size for block in self.blocks)

    @property
    def stresses(self) -> np.ndarray:
        """Which constants are stresses, shape [p]."""
        return np.array([unit == "Pa" for unit in self.units])

    prior_deviation = _joined("prior_deviation")

    def split(self, values: Any) -> Iterator[tuple[AbstractBlock, Any]]:
        """Each block with its own of the values."""
        at = 0
        for block in self.blocks:
            yield block, values[at : at + block.size]
            at += block.size

    def constants(self, theta: Vector, scales: Scales) -> Vector:
        """Constants in SI units from unconstrained parameters."""
        return jnp.concatenate([b.constants(own, scales) for b, own in self.split(theta)])

    def unconstrained(self, constants: Vector, scales: Scales) -> Vector:
        """Parameters from constants, the inverse of `constants`."""
        parts = self.split(jnp.asarray(constants))
        return jnp.concatenate([block.unconstrained(own, scales) for block, own in parts])

    def law(self, constants: Vector) -> AbstractLaw:
        """The law with these constants, and with what each block adds to it."""
        law = self.build(*constants[: self.law_size])
        for block, values in self.split(constants):
            law = block.around(law, values)
        return law

    def zeros(self, constants: Vector) -> Float[Array, " k"]:
        """Unknowns of the tests among the constants."""
        found = [own for block, own in self.split(constants) if block.of_tests]
        return jnp.concatenate([constants[:0], *found])

    def effects(self, constants: np.ndarray) -> dict[str, Any]:
        """What [material] says beside the law's constants."""
        parts = self.split(np.asarray(constants))
        return {k: v for block, own in parts for k, v in block.effects(own).items()}

    def random(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Starting points θ, shape [count, p]; the first is a plain guess."""
        return np.concatenate([block.random(rng, count) for block in self.blocks], axis=1)

    def ordered(self, constants: np.ndarray) -> np.ndarray:
        """Constants in canonical order."""
        return np.concatenate([block.ordered(own) for block, own in self.split(constants)])

    def signs(self, constants: np.ndarray, bounds: Bounds) -> Signs:
        """Lowest and highest constants that the law's own conditions allow, each [p]."""
        pairs = (block.signs(own, bounds) for block, own in self.split(constants))
        low, high = (np.concatenate(side) for side in zip(*pairs, strict=True))
        return low, high

    def tree(self, values: Any) -> dict[str, Any]:
        """Per-constant values of the law by the keys of [material]."""
        tree: dict[str, Any] = {}
        for part, value in zip(self.parts, values, strict=False):
            key, _, index = part.name.partition(".")
            if index:
                tree.setdefault(key, []).append(value)
            else:
                tree[key] = value
        return tree


Kind = TypeVar("Kind", bound=AbstractBlock)


def block_of(family: Family, kind: type[Kind]) -> tuple[Kind, slice] | None:
    """A family's block of a kind and the place of its constants; None where there is none."""
    at = 0
    for block in family.blocks:
        if isinstance(block, kind):
            return block, slice(at, at + block.size)
        at += block.size
    return None
