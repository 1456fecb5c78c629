"""A family of laws together with unknown zeros of the tests."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fitting.statistics.parameters import AbstractFamily, Scales
from suas_jax.constitutive import AbstractLaw

_STEP = 0.05
"""Natural size of a zero: of strain, and of the typical modulus."""


@dataclasses.dataclass(frozen=True)
class WithZeros(AbstractFamily):
    """A law's constants, then the zeros of the tests.

    Attributes:
        base: the law's family.
        kinds: of each zero: "slack", "force" or "machine".
        labels: names of the zeros.
        start: where the search begins, in natural sizes; no part of what is compiled.
    """

    base: AbstractFamily
    kinds: tuple[str, ...]
    labels: tuple[str, ...]
    start: tuple[float, ...] = dataclasses.field(compare=False)

    @property
    def law_name(self) -> str:  # type: ignore[override]
        """The law's."""
        return self.base.law_name

    @property
    def law_size(self) -> int:
        """Number of the law's own constants."""
        return self.base.size

    @property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]
        """The law's constants, then the zeros."""
        return self.base.names + self.labels

    @property
    def units(self) -> tuple[str, ...]:  # type: ignore[override]
        """SI units."""
        own = {"slack": "1", "force": "Pa", "machine": "1/Pa"}
        return self.base.units + tuple(own[kind] for kind in self.kinds)

    @property
    def terms(self) -> int | None:  # type: ignore[override]
        """The law's."""
        return self.base.terms

    @property
    def title(self) -> str:
        """The law's."""
        return self.base.title

    @property
    def settings(self) -> dict[str, Any]:
        """The law's."""
        return self.base.settings

    @property
    def prior_deviation(self) -> np.ndarray:
        """The law's; zeros 10 natural sizes."""
        return np.append(self.base.prior_deviation, np.full(len(self.kinds), 10.0))

    @property
    def theta_names(self) -> tuple[str, ...]:
        """The law's, then the zeros."""
        return self.base.theta_names + self.labels

    def zeros(self, constants: Float[Array, " p"]) -> Float[Array, " k"]:
        """The zeros among the constants."""
        return constants[self.base.size :]

    def _sizes(self, scales: Scales) -> Array:
        stress = jnp.asarray(scales.stress)
        own = {"slack": 1.0, "force": stress, "machine": 1.0 / stress}
        return _STEP * jnp.stack([jnp.asarray(own[kind]) for kind in self.kinds])

    def constants(self, theta: Float[Array, " p"], scales: Scales) -> Float[Array, " p"]:
        """Constants in SI units."""
        own = theta[self.base.size :] * self._sizes(scales)
        return jnp.concatenate([self.base.constants(theta[: self.base.size], scales), own])

    def unconstrained(
        self, constants: Float[Array, " p"], scales: Scales
    ) -> Float[Array, " p"]:
        """Parameters from constants."""
        own = constants[self.base.size :] / self._sizes(scales)
        return jnp.concatenate(
            [self.base.unconstrained(constants[: self.base.size], scales), own]
        )

    def law(self, constants: Float[Array, " p"]) -> AbstractLaw:
        """The law with these constants."""
        return self.base.law(constants[: self.base.size])

    def random(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Starts of the law; zeros begin where they were estimated."""
        own = np.tile(np.asarray(self.start, float), (count, 1))
        return np.concatenate([self.base.random(rng, count), own], axis=1)

    def refined(
        self,
        theta: Float[Array, " p"],
        columns: Callable[[AbstractLaw], Array],
        scales: Scales,
        target: Array,
    ) -> Float[Array, " p"]:
        """What is linear in the law's constants; zeros stay."""
        better = self.base.refined(theta[: self.base.size], columns, scales, target)
        return jnp.concatenate([better, theta[self.base.size :]])

    def ordered(self, constants: np.ndarray) -> np.ndarray:
        """The law's order."""
        size = self.base.size
        return np.append(self.base.ordered(constants[:size]), constants[size:])

    def signs(
        self, constants: np.ndarray, bounds: Mapping[str, tuple[float, float]]
    ) -> tuple[np.ndarray, np.ndarray]:
        """The law's; zeros may have any sign."""
        low, high = self.base.signs(constants[: self.base.size], bounds)
        free = np.full(len(self.kinds), np.inf)
        return np.append(low, -free), np.append(high, free)

    def tree(self, values: Any) -> dict[str, Any]:
        """Per-constant values of the law by the keys of [material]; zeros are no part of it."""
        return self.base.tree(list(values)[: self.base.size])
