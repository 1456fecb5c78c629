"""Relaxation in terms of the long-term constants that a skin file holds.

With the stress S of the file's constants at the strain of now, the stress of a membrane that
relaxes is, from G(t) = 1 - sum g_i (1 - exp(-t/tau_i)) divided by its end G_end = 1 - sum g_i::

    S(t) + sum_i gamma_i R_i(t),   gamma_i = g_i / G_end,   dR_i/dt + R_i / tau_i = dS/dt

Over a step in which S changes linearly R is exact: R -> exp(-x) R + (1 - exp(-x))/x dS,
x = dt/tau. The R_i do not depend on g.

What estimates ask of a memory, on a section and on a pad, is `AbstractMemoryFollower`.
"""

import abc
from typing import NamedTuple, Self

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.fit.selection import Selection
from fitting.inverse_load.fit.systematic import AbstractSystematicErrors
from suas_jax.config import SkinSpec
from suas_jax.config.tolerance import deviation_of

SHARE_ERROR = 0.1
"""Standard deviation of the g_i together where a file states none, relative: from batch to
batch, and what a fit to one test leaves open."""


class LoadMemory(NamedTuple):
    """How a skin's membrane relaxes."""

    gamma: Floats  # relaxing shares of the stress over its long-term share [term]
    tau: Floats  # relaxation times [term] [s]
    # change of `gamma` by independent errors of the g_i, one standard deviation each
    # [error, term]
    errors: Floats

    @classmethod
    def of(cls, spec: SkinSpec) -> Self | None:
        """That of a skin's file; None where it states no relaxation."""
        given = spec.material.relaxation
        if given is None or not given.g:
            return None
        g, end = np.array(given.g, float), given.long_term_share
        stated = [deviation_of(x) for x in given.g]
        if any(x is not None for x in stated):
            columns = np.diag([x or 0.0 for x in stated])
            columns = columns[columns.any(1)]
        else:
            columns = SHARE_ERROR * g[None]
        by_g = np.eye(len(g)) / end + g[None] / end**2  # d gamma_j / d g_i
        return cls(g / end, np.array(given.tau, float), columns @ by_g)


def assumed_of_memory(spec: SkinSpec) -> str:
    """What estimates assume of a membrane that relaxes, in a sentence; empty for nothing."""
    given = spec.material.relaxation
    if given is None:
        return ""
    if any(deviation_of(share) is not None for share in given.g):
        return ""
    return (
        "[material] relaxation states no deviations; g is taken to be known to "
        f'{100 * SHARE_ERROR:g} % (write your own, such as g = ["0.15 +- 0.01"])'
    )


def creeping_load(memory: LoadMemory, time: Floats) -> Floats:
    """Load that the long-term constants need for a creeping dent, over the constant load [...].

    E(t) with E + sum gamma_i R_i = 1, the load coming at once at t = 0: the states
    R follow A R' = -R/tau with A = 1 + 1 gamma^T, from R = E(0) = 1 / (1 + sum gamma).

    Time counts since the load came on [s].
    """
    total = 1 + memory.gamma.sum()
    # R' = -R/tau + E', and E' = -gamma . R'
    rate = np.linalg.solve(
        np.eye(len(memory.tau)) + np.ones((len(memory.tau), 1)) * memory.gamma,
        -np.diag(1 / memory.tau),
    )
    values, vectors = np.linalg.eig(rate)
    start = np.linalg.solve(vectors, np.full(len(memory.tau), 1 / total))
    late = np.exp(values * np.asarray(time, float)[..., None])
    states = np.real((late * start) @ vectors.T)
    return np.asarray(1 - states @ memory.gamma)


class AbstractMemoryFollower(abc.ABC):
    """Follows what the membrane of one skin remembers, frame after frame."""

    selection: Selection  # of what explains a frame, less what the past leaves of it
    errors: AbstractSystematicErrors  # of the inputs and of the memory
    pressure: float  # of the oil in the frame, if nothing presses [Pa]

    @abc.abstractmethod
    def forget(self) -> None:
        """Begin with a membrane that has been at rest for long."""

    @abc.abstractmethod
    def before(self, time: float) -> Floats:
        """Take the time of a frame [s]; return what the past leaves of its readings [channel].

        A clock that goes backwards begins anew.
        """

    @abc.abstractmethod
    def after(self, best: Explanations | None) -> None:
        """Take what explains the frame; None: nothing does."""

    @abc.abstractmethod
    def untouched(self) -> None:
        """Take a frame that nothing presses."""

    def again(self) -> Floats | None:
        """What the past leaves beside the loads that were found; None where that is the same.

        The frame is then explained once more.
        """
        return None
