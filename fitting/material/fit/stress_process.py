"""Readings as a Gaussian process around a law: what is likely of α, β and δ in rubbers.

Of P = A α(I₁) + B β(I₂) + δ (`fitting.material.fit.band`) α is a law's and a process beside it,
β that of rubbers, b (μ/2) √(3/I₂) with `SECOND`, and a process beside it; δ depends on both
invariants.

`SECOND` and the other scales were set on Treloar (1944), Kawabata (1981) and Meunier (2008).

Fillers may stiffen α near rest by a share r of `RISES`. That part of α is normal around zero
with the deviation r α / (1 + x / `_SOFTENED`), x = I₁ - 3, and varies slowly in log(x).
"""

from typing import NamedTuple, Self

import numpy as np
from jaxtyping import Float
from scipy import linalg

Rows = Float[np.ndarray, " n"]

SECOND = (0.15, 0.08)
"""Share b of the shear modulus that I₂ carries in rubbers at rest: mean and deviation."""
_VARIES = 0.05  # of b along I₂
_BOTH = 0.06  # δ over the stress, fully where I₁ is 4
_LENGTH, _GROWTH = 0.8, 0.03  # of α beside a law's: in log(I₁ - 2.7), and by I₁
_LENGTH_2, _LENGTH_BOTH = 1.0, 0.5
_OFFSET = 0.3
RISES = (0.0, 0.15, 0.5)
"""Share by which fillers stiffen a rubber near rest, as no law of the list does."""
# Of I₁ - 3: where half of a rise is gone, and what is added to it in the logarithm, over whose
# third a rise is alike.
_SOFTENED, _AT_REST, _FALL = 0.03, 0.003, 2.0
_FILLED = 0.03  # prior probability of each rise over that of none, nearly
EXPONENT = -0.5


class States(NamedTuple):
    """What readings are made of: A, B and both invariants, each [n]."""

    a: Rows
    b: Rows
    i1: Rows
    i2: Rows

    @classmethod
    def of(cls, factors: Float[np.ndarray, "4 n"]) -> Self:
        """From (e₁, e₂, c₁, c₂) of each reading."""
        e1, e2, c1, c2 = factors
        x, y, z = np.exp(2.0 * e1), np.exp(2.0 * e2), np.exp(-2.0 * (e1 + e2))
        a = 2.0 * (c1 * (x - z) + c2 * (y - z))
        b = 2.0 * (c1 * (1.0 / z - 1.0 / x) + c2 * (1.0 / z - 1.0 / y))
        return cls(a, b, x + y + z, 1.0 / x + 1.0 / y + 1.0 / z)

    def and_(self, other: Self) -> Self:
        """These, then others."""
        return type(self)(*map(np.concatenate, zip(self, other, strict=True)))


class Readings(NamedTuple):
    """Readings [Pa], the size of their noise, errors that they share [k, n], where they are."""

    states: States
    value: Rows
    scale: Rows
    shared: Float[np.ndarray, "k n"]


class First(NamedTuple):
    """α of one law along its invariant: log(I₁ - 2.7) and α + b μ/2 [Pa], up to an I₁.

    A law that is not stable from some I₁ on has no α there.
    """

    x: np.ndarray
    alpha: np.ndarray
    constants: int
    title: str

    def at(self, i1: Rows) -> Rows:
        """α + b μ/2 [Pa]."""
        return np.interp(along(i1), self.x, self.alpha)


class Part(NamedTuple):
    """One law with one size of what is beside it, conditioned on the readings."""

    first: First
    share: float
    rise: float
    noise: float
    evidence: float
    root: np.ndarray
    weights: np.ndarray


def along(i1: Rows) -> Rows:
    """What a law's α is interpolated along, log(I₁ - 2.7)."""
    return np.log(i1 - 3.0 + _OFFSET)


def reaches(first: First, i1: Rows) -> bool:
    """Whether a law is stable wherever it is asked; the constant one is."""
    return not first.title or float(along(np.max(i1))) <= float(first.x[-1])


def conditioned(
    readings: Readings, modulus: float, first: First, share: float, rise: float, noise: float
) -> Part | None:
    """A law with what is beside it, after the readings; None where numbers fail."""
    states = readings.states
    covariance = covariance_of(states, modulus, first, share, rise)
    covariance = covariance + np.diag((noise * readings.scale) ** 2)
    covariance += readings.shared.T @ readings.shared
    # Nothing is known to better than rounding.
    covariance[np.diag_indices_from(covariance)] *= 1.0 + 1e-9
    try:
        root = linalg.cholesky(covariance, lower=True)
    except linalg.LinAlgError:
        return None
    off = readings.value - mean_of(states, modulus, first)
    weights = linalg.solve_triangular(root, off, lower=True)
    evidence = -0.5 * float(weights @ weights) - float(np.log(np.diagonal(root)).sum())
    evidence -= 0.5 * first.constants * float(np.log(len(off)))
    evidence += float(np.log(_FILLED if rise else 1.0 - _FILLED))
    return Part(first, share, rise, noise, evidence, root, weights)


def mean_of(states: States, modulus: float, first: First) -> Rows:
    """Readings, before any of them is known [Pa]."""
    second = SECOND[0] * 0.5 * modulus
    alpha = first.at(states.i1) - second
    return states.a * alpha + states.b * second * (states.i2 / 3.0) ** EXPONENT


def covariance_of(
    states: States, modulus: float, first: First, share: float, rise: float
) -> np.ndarray:
    """Their covariance [Pa²]."""
    x, z = along(states.i1), along(states.i2)
    far_1, far_2 = (np.subtract.outer(y, y) ** 2 for y in (x, z))
    beyond = states.i1 - 3.0
    first_part = states.a * first.at(states.i1)
    second_part = states.b * 0.5 * modulus * (states.i2 / 3.0) ** EXPONENT
    # A larger share of I₂ is a smaller one of I₁: the modulus is what was measured.
    exchanged = second_part - states.a * 0.5 * modulus
    beside = first_part * np.minimum(beyond, 1.0)
    # The stiffness as a whole is the data's; further out α may grow.
    found = np.outer(first_part, first_part) * (
        1.0
        + share**2 * np.exp(-0.5 * far_1 / _LENGTH**2)
        + _GROWTH**2 * np.outer(beyond, beyond)
    )
    risen = rise * first_part / (1.0 + beyond / _SOFTENED)
    near_rest = np.log(beyond + _AT_REST)
    far_rest = np.subtract.outer(near_rest, near_rest) ** 2
    found += np.outer(risen, risen) * np.exp(-0.5 * far_rest / _FALL**2)
    found += SECOND[1] ** 2 * np.outer(exchanged, exchanged)
    along_2 = np.exp(-0.5 * far_2 / _LENGTH_2**2)
    found += _VARIES**2 * np.outer(second_part, second_part) * along_2
    near = np.exp(-0.5 * (far_1 + far_2) / _LENGTH_BOTH**2)
    found += _BOTH**2 * np.outer(beside, beside) * near
    return np.asarray(found)
