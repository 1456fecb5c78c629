"""A family of laws together with the relaxation and the softening of their stress."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fitting.statistics.parameters import AbstractFamily, Scales
from suas_jax.config.inelastic import RelaxationSpec, SofteningSpec
from suas_jax.constitutive import AbstractLaw
from suas_jax.constitutive.inelastic import Inelastic
from suas_jax.constitutive.relaxation import PronySeries
from suas_jax.constitutive.softening import OgdenRoxburgh

MOST_PRONY_TERMS = 6
"""Prony terms of a fit."""
_SOFTENING = ("softening.r", "softening.m", "softening.beta")
_LARGEST = 300.0


@dataclasses.dataclass(frozen=True)
class WithEffects(AbstractFamily):
    """A law's long-term constants, then Prony terms, then the constants of the softening.

    θ of the shares is log(g_i/g_∞), of the times log(τ_i / 1 s), of the softening log(r − 1),
    log(m/s) with s the energy that the data reach, and log β.

    Attributes:
        base: the law's family.
        prony: number of Prony terms; zero for none.
        mullins: whether the stress softens.
        window: shortest and longest time that the data resolve [s]; no part of what is
            compiled.
    """

    base: AbstractFamily
    prony: int
    mullins: bool
    window: tuple[float, float] = dataclasses.field(default=(1.0, 1.0), compare=False)

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
        """The law's constants, shares, times, and constants of the softening."""
        terms = range(self.prony)
        series = tuple(f"relaxation.{key}.{i}" for key in ("g", "tau") for i in terms)
        return self.base.names + series + (_SOFTENING if self.mullins else ())

    @property
    def units(self) -> tuple[str, ...]:  # type: ignore[override]
        """SI units."""
        series = ("1",) * self.prony + ("s",) * self.prony
        return self.base.units + series + (("1", "Pa", "1") if self.mullins else ())

    @property
    def terms(self) -> int | None:  # type: ignore[override]
        """The law's."""
        return self.base.terms

    @property
    def title(self) -> str:
        """The law's, with what is beside it."""
        series = f" + {self.prony} Prony terms" if self.prony != 1 else " + 1 Prony term"
        parts = (series if self.prony else "", " + Mullins softening" if self.mullins else "")
        return self.base.title + "".join(parts)

    @property
    def settings(self) -> dict[str, Any]:
        """The law's."""
        return self.base.settings

    @property
    def prior_deviation(self) -> np.ndarray:
        """The law's; 3 for all logarithms but those of times, 10."""
        own = np.repeat([3.0, 10.0, 3.0], [self.prony, self.prony, 3 * self.mullins])
        return np.append(self.base.prior_deviation, own)

    @property
    def theta_names(self) -> tuple[str, ...]:
        """The law's, then logarithms."""
        terms = range(self.prony)
        shares = tuple(f"log(relaxation.g.{i} / long-term share)" for i in terms)
        times = tuple(f"log(relaxation.tau.{i})" for i in terms)
        softening = ("log(softening.r - 1)", "log(softening.m)", "log(softening.beta)")
        return self.base.theta_names + shares + times + softening * self.mullins

    def constants(self, theta: Float[Array, " p"], scales: Scales) -> Float[Array, " p"]:
        """Constants in SI units."""
        own = [self.base.constants(theta[: self.law_size], scales)]
        a, t, s = self._parts(theta)
        if self.prony:
            share = jnp.exp(jnp.clip(a, -_LARGEST, _LARGEST))
            own += [share / (1.0 + jnp.sum(share)), jnp.exp(t)]
        if self.mullins:
            own.append(jnp.exp(s) * self._sizes(scales) + jnp.array([1.0, 0.0, 0.0]))
        return jnp.concatenate(own)

    def unconstrained(
        self, constants: Float[Array, " p"], scales: Scales
    ) -> Float[Array, " p"]:
        """Parameters from constants."""
        own = [self.base.unconstrained(constants[: self.law_size], scales)]
        g, tau, softening = self._parts(constants)
        if self.prony:
            own += [jnp.log(g / (1.0 - jnp.sum(g))), jnp.log(tau)]
        if self.mullins:
            above = softening - jnp.array([1.0, 0.0, 0.0])
            own.append(jnp.log(above / self._sizes(scales)))
        return jnp.concatenate(own)

    def law(self, constants: Float[Array, " p"]) -> AbstractLaw:
        """The law with its relaxation and softening."""
        g, tau, softening = self._parts(constants)
        return Inelastic(
            self.base.law(constants[: self.law_size]),
            PronySeries(g, tau) if self.prony else None,
            OgdenRoxburgh(*softening) if self.mullins else None,
        )

    def effects(self, constants: np.ndarray) -> dict[str, Any]:
        """Relaxation and softening as they stand in [material]."""
        g, tau, softening = self._parts(np.asarray(constants))
        found: dict[str, Any] = {}
        if self.prony:
            found["relaxation"] = RelaxationSpec(
                g=tuple(map(float, g)), tau=tuple(map(float, tau))
            )
        if self.mullins:
            r, m, beta = map(float, softening)
            found["softening"] = SofteningSpec(r=r, m=m, beta=beta)
        return found

    def random(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Starts of the law; times spread over the window."""
        return np.concatenate([self.base.random(rng, count), self.spread(rng, count)], axis=1)

    def spread(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Starts of what is beside the law, shape [count, p]; the first ones are even."""
        low, high = np.log(self.window)
        middle = (np.arange(self.prony) + 0.5) / max(self.prony, 1)
        shift = np.array([0.0, -0.25, 0.25])[: min(count, 3)] / max(self.prony, 1)
        even = [middle + step for step in shift]
        drawn = np.sort(rng.uniform(size=(max(count - 3, 0), self.prony)), axis=1)
        times = low + np.concatenate([np.array(even), drawn]) * (high - low)
        share = np.full((count, self.prony), np.log(0.5 / max(self.prony, 1)))
        widths = np.tile([[0.0, -1.5, -1.5], [-1.0, -3.0, -3.0], [0.5, 0.0, -1.0]], (count, 1))
        return np.concatenate([share, times, widths[:count, : 3 * self.mullins]], axis=1)

    def ordered(self, constants: np.ndarray) -> np.ndarray:
        """The law's order; Prony terms by rising time."""
        g, tau, softening = self._parts(constants)
        order = np.argsort(tau, kind="stable")
        own = self.base.ordered(constants[: self.law_size])
        return np.concatenate([own, g[order], tau[order], softening])

    def signs(
        self, constants: np.ndarray, bounds: Mapping[str, tuple[float, float]]
    ) -> tuple[np.ndarray, np.ndarray]:
        """The law's; all others are positive."""
        low, high = self.base.signs(constants[: self.law_size], bounds)
        count = self.size - self.law_size
        return np.append(low, np.zeros(count)), np.append(high, np.full(count, np.inf))

    def tree(self, values: Any) -> dict[str, Any]:
        """Per-constant values of the law by the keys of [material]."""
        return self.base.tree(list(values)[: self.law_size])

    def _parts(self, values: Any) -> tuple[Any, Any, Any]:
        """Shares, times, and the softening's among constants or parameters."""
        first, second = self.law_size + self.prony, self.law_size + 2 * self.prony
        return values[self.law_size : first], values[first:second], values[second:]

    def _sizes(self, scales: Scales) -> Array:
        energy = 0.5 * jnp.asarray(scales.stress) * jnp.asarray(scales.i1)
        return jnp.stack([jnp.ones_like(energy), energy, jnp.ones_like(energy)])
