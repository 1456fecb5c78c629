"""Parameters in blocks: a law's own constants, then those of its effects and of its tests.

Each block maps its own part of θ to its own part of the constants; the whole is their product.
"""

import dataclasses
import functools
from collections.abc import Iterator
from typing import Any, SupportsFloat, TypeVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from fitting.material.laws.parameters import (
    AbstractBlock,
    AbstractFamily,
    Bounds,
    Columns,
    Constant,
    IndependentConstants,
    Scales,
    Signs,
    Vector,
)
from suas_jax.config.inelastic import RelaxationSpec, SofteningSpec
from suas_jax.config.tolerance import UncertainQuantity
from suas_jax.constitutive import AbstractLaw
from suas_jax.constitutive.inelastic import Inelastic
from suas_jax.constitutive.relaxation import PronySeries
from suas_jax.constitutive.softening import OgdenRoxburgh

MOST_PRONY_TERMS = 6
"""Prony terms of a fit."""
_LARGEST = 300.0
_STEP = 0.05  # natural size of a zero: of strain, and of the typical modulus


class AbstractAddition(AbstractBlock):
    """A block that stands beside a law's own constants."""

    @property
    def title(self) -> str:
        """What it adds to the law's title."""
        return ""

    def around(self, law: AbstractLaw, values: Vector) -> AbstractLaw:
        """The law with what the block adds to it; by default nothing."""
        return law

    def effects(self, values: np.ndarray) -> dict[str, Any]:
        """What [material] says beside the law's constants; by default nothing."""
        return {}


@dataclasses.dataclass(frozen=True)
class Relaxation(AbstractAddition):
    """Prony terms, θ = (log g_i/g_∞, log(τ_i / 1 s))."""

    count: int  # number of terms
    # shortest and longest time that the data resolve [s]; no part of what is compiled
    window: tuple[float, float] = dataclasses.field(default=(1.0, 1.0), compare=False)

    @property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Shares, then times."""
        return tuple(f"relaxation.{key}.{i}" for key in ("g", "tau") for i in range(self.count))

    @property
    def units(self) -> tuple[str, ...]:  # type: ignore[override]
        """Pure numbers, then seconds."""
        return ("1",) * self.count + ("s",) * self.count

    @property
    def title(self) -> str:
        """The number of terms."""
        return f" + {self.count} Prony term{'s' if self.count > 1 else ''}"

    @property
    def prior_deviation(self) -> np.ndarray:
        """Shares 3, times 10 in their logarithms."""
        return np.repeat([3.0, 10.0], self.count)

    @property
    def theta_names(self) -> tuple[str, ...]:
        """Logarithms."""
        shares = tuple(f"log(relaxation.g.{i} / long-term share)" for i in range(self.count))
        return shares + tuple(f"log(relaxation.tau.{i})" for i in range(self.count))

    def parts(self, values: Any) -> tuple[Any, Any]:
        """Shares g and times τ [s] among the block's constants, each [term]."""
        return values[: self.count], values[self.count :]

    def constants(self, theta: Vector, scales: Scales) -> Vector:
        """Shares and times [s]."""
        a, t = self.parts(theta)
        share = jnp.exp(jnp.clip(a, -_LARGEST, _LARGEST))
        return jnp.concatenate([share / (1.0 + jnp.sum(share)), jnp.exp(t)])

    def unconstrained(self, constants: Vector, scales: Scales) -> Vector:
        """Logarithms."""
        g, tau = self.parts(constants)
        return jnp.concatenate([jnp.log(g / (1.0 - jnp.sum(g))), jnp.log(tau)])

    def around(self, law: AbstractLaw, values: Vector) -> AbstractLaw:
        """The long-term law with its relaxation."""
        return Inelastic(law, PronySeries(*self.parts(values)))

    def effects(self, values: np.ndarray) -> dict[str, Any]:
        """The series as it stands in [material]."""
        g, tau = (tuple(map(_kept, part)) for part in self.parts(values))
        return {"relaxation": RelaxationSpec(g=g, tau=tau)}

    def random(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Even shares, times spread over the window; the first ones evenly."""
        low, high = np.log(self.window)
        middle = (np.arange(self.count) + 0.5) / self.count
        shift = np.array([0.0, -0.25, 0.25])[: min(count, 3)] / self.count
        drawn = np.sort(rng.uniform(size=(max(count - 3, 0), self.count)), axis=1)
        times = low + np.concatenate([middle + shift[:, None], drawn]) * (high - low)
        share = np.full((count, self.count), np.log(0.5 / self.count))
        return np.concatenate([share, times], axis=1)

    def signs(self, constants: np.ndarray, bounds: Bounds) -> Signs:
        """All are positive."""
        return np.zeros(self.size), np.full(self.size, np.inf)

    def ordered(self, constants: np.ndarray) -> np.ndarray:
        """Terms by rising time."""
        g, tau = self.parts(constants)
        order = np.argsort(tau, kind="stable")
        return np.concatenate([g[order], tau[order]])


class _Energy(Constant):
    """A constant whose size is the energy that the data reach [J/m³]."""

    def size(self, scales: Scales) -> ArrayLike:
        return 0.5 * jnp.asarray(scales.stress) * jnp.asarray(scales.i1)


@dataclasses.dataclass(frozen=True)
class Softening(IndependentConstants, AbstractAddition):
    """Constants of the softening, θ = (log(r − 1), log(m/s), log β), s the data's energy."""

    parts: tuple[Constant, ...] = (
        Constant("softening.r", "above one", "1"),
        _Energy("softening.m"),
        Constant("softening.beta", unit="1"),
    )

    @property
    def title(self) -> str:
        """Its name."""
        return " + Mullins softening"

    def around(self, law: AbstractLaw, values: Vector) -> AbstractLaw:
        """The virgin law with its softening, after its relaxation."""
        softening = OgdenRoxburgh(*values)
        if isinstance(law, Inelastic):
            return Inelastic(law.elastic, law.relaxation, softening)
        return Inelastic(law, None, softening)

    def effects(self, values: np.ndarray) -> dict[str, Any]:
        """The softening as it stands in [material]."""
        r, m, beta = map(_kept, values)
        return {"softening": SofteningSpec(r=r, m=m, beta=beta)}

    def random(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Three kinds of softening, in turn."""
        kinds = [[0.0, -1.5, -1.5], [-1.0, -3.0, -3.0], [0.5, 0.0, -1.0]]
        return np.resize(kinds, (count, 3))


def _kept(value: SupportsFloat) -> float:
    """A number that keeps the deviation which it may carry."""
    return value if isinstance(value, UncertainQuantity) else float(value)


class _Zero(Constant):
    """A zero of a test: strain, stress, or the compliance of its machine."""

    def size(self, scales: Scales) -> ArrayLike:
        stress = jnp.asarray(scales.stress)
        return _STEP * {"1": jnp.asarray(1.0), "Pa": stress, "1/Pa": 1.0 / stress}[self.unit]


@dataclasses.dataclass(frozen=True)
class TestZeros(IndependentConstants, AbstractAddition):
    """Unknown zeros of the tests, θ in natural sizes."""

    __test__ = False  # no test of pytest's

    kinds: tuple[str, ...]  # of each zero: "slack", "force" or "machine"
    labels: tuple[str, ...]  # names of the zeros
    # where the search begins, in natural sizes; no part of what is compiled
    start: tuple[float, ...] = dataclasses.field(compare=False)

    @property
    def parts(self) -> tuple[Constant, ...]:  # type: ignore[override]
        """Zeros of any sign."""
        units = {"slack": "1", "force": "Pa", "machine": "1/Pa"}
        pairs = zip(self.kinds, self.labels, strict=True)
        return tuple(_Zero(label, "free", units[kind]) for kind, label in pairs)

    def random(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Zeros begin where they were estimated."""
        return np.tile(np.asarray(self.start, float), (count, 1))


def _of_law(name: str) -> Any:
    """An attribute that an extended family has from its law."""
    return property(lambda self: getattr(self.base, name), doc="The law's.")


def _of_all(name: str) -> Any:
    """An attribute that an extended family adds up: its law's, then that of each block."""

    def added(self: "ExtendedFamily") -> Any:
        return functools.reduce(
            lambda whole, block: whole + getattr(block, name),
            self.blocks,
            getattr(self.base, name),
        )

    return property(added, doc="The law's, then that of each block.")


@dataclasses.dataclass(frozen=True)
class ExtendedFamily(AbstractFamily):
    """A law with further blocks of constants beside its own, which come first."""

    base: AbstractFamily  # the law's family
    blocks: tuple[AbstractAddition, ...]  # what stands beside it

    law_name = _of_law("law_name")
    terms = _of_law("terms")
    settings = _of_law("settings")
    names = _of_all("names")
    units = _of_all("units")
    theta_names = _of_all("theta_names")
    title = _of_all("title")

    @property
    def law_size(self) -> int:
        """Number of the law's own constants."""
        return self.base.size

    def _split(self, values: Any) -> Iterator[tuple[Any, Any]]:
        """The law's family and each block, with its own of the values."""
        at = 0
        for part in (self.base, *self.blocks):
            yield part, values[at : at + part.size]
            at += part.size

    @property
    def prior_deviation(self) -> np.ndarray:
        """Of all blocks."""
        return np.concatenate([p.prior_deviation for p in (self.base, *self.blocks)])

    def constants(self, theta: Vector, scales: Scales) -> Vector:
        """Constants in SI units."""
        return jnp.concatenate([p.constants(own, scales) for p, own in self._split(theta)])

    def unconstrained(self, constants: Vector, scales: Scales) -> Vector:
        """Parameters from constants."""
        parts = self._split(constants)
        return jnp.concatenate([part.unconstrained(own, scales) for part, own in parts])

    def law(self, constants: Vector) -> AbstractLaw:
        """The law with what each block adds to it."""
        (base, own), *rest = self._split(constants)
        law: AbstractLaw = base.law(own)
        for block, values in rest:
            law = block.around(law, values)
        return law

    def effects(self, constants: np.ndarray) -> dict[str, Any]:
        """Relaxation and softening as they stand in [material]."""
        _, *rest = self._split(np.asarray(constants))
        return {k: v for block, own in rest for k, v in block.effects(own).items()}

    def zeros(self, constants: Vector) -> Float[Array, " k"]:
        """Unknown zeros of the tests among the constants."""
        found = block_of(self, TestZeros)
        return super().zeros(constants) if found is None else constants[found[1]]

    def random(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Starts of all blocks."""
        return np.concatenate([self.base.random(rng, count), self.beside(rng, count)], axis=1)

    def beside(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Starts of what is beside the law, shape [count, p]; the first ones are even."""
        return np.concatenate([block.random(rng, count) for block in self.blocks], axis=1)

    def refined(self, theta: Vector, columns: Columns, scales: Scales, target: Array) -> Vector:
        """What is linear in the law's constants; the rest stays."""
        size = self.law_size
        better = self.base.refined(theta[:size], columns, scales, target)
        return jnp.concatenate([better, theta[size:]])

    def ordered(self, constants: np.ndarray) -> np.ndarray:
        """Each block's order."""
        return np.concatenate([part.ordered(own) for part, own in self._split(constants)])

    def signs(self, constants: np.ndarray, bounds: Bounds) -> Signs:
        """Of all blocks."""
        pairs = (part.signs(own, bounds) for part, own in self._split(constants))
        low, high = (np.concatenate(side) for side in zip(*pairs, strict=True))
        return low, high

    def tree(self, values: Any) -> dict[str, Any]:
        """Per-constant values of the law by the keys of [material]."""
        return self.base.tree(list(values)[: self.law_size])


Kind = TypeVar("Kind", bound=AbstractAddition)


def block_of(family: AbstractFamily, kind: type[Kind]) -> tuple[Kind, slice] | None:
    """A family's block of a kind and the place of its constants; None where there is none."""
    if isinstance(family, ExtendedFamily):
        at = family.law_size
        for block in family.blocks:
            if isinstance(block, kind):
                return block, slice(at, at + block.size)
            at += block.size
    return None
