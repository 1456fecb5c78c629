"""What may stand beside a law: relaxation, softening, and unknown zeros of the tests."""

import dataclasses
from typing import Any, SupportsFloat

import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from fitting.material.laws.parameters import AbstractBlock, Constant, Scales, Vector
from suas_jax.config.inelastic import RelaxationSpec, SofteningSpec
from suas_jax.config.tolerance import UncertainQuantity
from suas_jax.constitutive import AbstractLaw
from suas_jax.constitutive.relaxation import Inelastic, OgdenRoxburgh, PronySeries

MOST_PRONY_TERMS = 6
"""Prony terms of a fit."""
_LARGEST = 300.0  # e-folds of a share over the long-term one
_STEP = 0.05  # natural size of a zero: of strain, and of the typical modulus


@dataclasses.dataclass(frozen=True)
class Relaxation(AbstractBlock):
    """Prony terms, θ = (log g_i/g_∞, log(τ_i / 1 s))."""

    count: int  # number of terms
    # shortest and longest time that the data resolve [s]; no part of what is compiled
    window: tuple[float, float] = dataclasses.field(default=(1.0, 1.0), compare=False)

    @property
    def parts(self) -> tuple[Constant, ...]:  # type: ignore[override]
        """Shares, then times."""
        shares, times = (
            [f"relaxation.{key}.{i}" for i in range(self.count)] for key in ("g", "tau")
        )
        return (
            *(Constant(g, unit="1", shown=f"{g} / long-term share") for g in shares),
            *(Constant(tau, unit="s", prior=10.0) for tau in times),
        )

    @property
    def title(self) -> str:  # type: ignore[override]
        """The number of terms."""
        return f" + {self.count} Prony term{'s' if self.count > 1 else ''}"

    def terms(self, values: Any) -> tuple[Any, Any]:
        """Shares g and times τ [s] among the block's constants, each [term]."""
        return values[: self.count], values[self.count :]

    def mixed(self, values: Vector) -> Vector:
        """Shares of the instantaneous modulus from those over the long-term one."""
        share, tau = self.terms(values)
        share = jnp.clip(share, np.exp(-_LARGEST), np.exp(_LARGEST))
        return jnp.concatenate([share / (1.0 + jnp.sum(share)), tau])

    def unmixed(self, constants: Vector) -> Vector:
        """Shares over the long-term one."""
        g, tau = self.terms(constants)
        return jnp.concatenate([g / (1.0 - jnp.sum(g)), tau])

    def around(self, law: AbstractLaw, values: Vector) -> AbstractLaw:
        """The long-term law with its relaxation."""
        return Inelastic(law, PronySeries(*self.terms(values)))

    def effects(self, values: np.ndarray) -> dict[str, Any]:
        """The series as it stands in [material]."""
        g, tau = (tuple(map(_kept, part)) for part in self.terms(values))
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

    def ordered(self, constants: np.ndarray) -> np.ndarray:
        """Terms by rising time."""
        g, tau = self.terms(constants)
        order = np.argsort(tau, kind="stable")
        return np.concatenate([g[order], tau[order]])


class _Energy(Constant):
    """A constant whose size is the energy that the data reach [J/m³]."""

    def size(self, scales: Scales) -> ArrayLike:
        return 0.5 * jnp.asarray(scales.stress) * jnp.asarray(scales.i1)


@dataclasses.dataclass(frozen=True)
class Softening(AbstractBlock):
    """Constants of the softening, θ = (log(r − 1), log(m/s), log β), s the data's energy."""

    parts: tuple[Constant, ...] = (
        Constant("softening.r", "above one", "1"),
        _Energy("softening.m"),
        Constant("softening.beta", unit="1"),
    )
    title: str = " + Mullins softening"

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
class TestZeros(AbstractBlock):
    """Unknown zeros of the tests, θ in natural sizes."""

    __test__ = False  # no test of pytest's
    of_tests = True

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
