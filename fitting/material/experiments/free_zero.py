"""Tension and compression whose zeros, or whose machine's stiffness, are found with the law.

A slack specimen, a load cell that is off and a machine that gives way read, of a nominal stress
P(λ) of the material,

    y = P(λ) + o,   λ = λ_m − s − k (y_m − o)

with λ_m, y_m the measured stretch and nominal stress, s the slack over the specimen's length,
o the force that is off over its area, and k = A/(K L) of a machine of stiffness K. A slack
specimen carries nothing: λ does not cross one.

Rubber is steepest at rest. A curve on which readings do not rise at first is of a specimen that
hung slack (`idle`), and one that grows steeper from rest has a toe (`toe_end`), in which the
specimen or its grips were taking up slack.
"""

from collections.abc import Sequence
from typing import ClassVar, NamedTuple, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from fitting.material.experiments.measurements import PATHS, Dataset, StressTest, series_of
from fitting.material.experiments.prediction import (
    POWERS,
    AbstractExperiment,
    mode_factors,
    padded,
)
from suas_jax.constitutive import AbstractLaw
from suas_jax.constitutive.specimens.homogeneous import kirchhoff

KINDS = ("slack", "force", "machine")
_DEGREE, _LEAST = 5, 0.01


class Zero(NamedTuple):
    """One unknown of a test's zeros."""

    kind: str  # "slack" [strain], "force" [Pa] or "machine" [1/Pa]
    test: int  # position of the data set
    specimen: str  # of the data set; the machine is shared by all


class FreeZero(AbstractExperiment):
    """Points of tests of one stretch with free zeros."""

    sized_by: ClassVar = "stretch"
    stretch: Float[Array, " n"]  # measured λ_m
    # measured nominal stress without its scatter [Pa], shape [n]; a machine gives way by the
    # force itself, not by what its noise adds
    nominal: Float[Array, " n"]
    ratio: Float[Array, " n"]  # log λ₂ / log λ₁ of the mode
    c1: Float[Array, " n"]  # factor of τ₁ in the Cauchy stress
    c2: Float[Array, " n"]  # factor of τ₂ in the Cauchy stress
    # of λ by which the Cauchy stress is divided in a reading, shape [n]
    power: Float[Array, " n"]
    side: Float[Array, " n"]  # 1 in tension, −1 in compression
    # position of slack, force and machine among the zeros; beyond them for none, shape [3, n]
    which: Int[Array, "3 n"]
    zeros: Float[Array, " k"]  # s, o and k of all tests

    def shifted(self, zeros: Float[Array, " k"]) -> Self:
        """The same tests with these zeros."""
        return eqx.tree_at(lambda test: test.zeros, self, zeros)

    def predict(self, law: AbstractLaw) -> Float[Array, " n"]:
        """Readings [Pa]; zero for padding."""
        slack, force, machine = jnp.append(self.zeros, 0.0)[self.which]
        moved = slack + machine * (self.nominal - force)
        stretch = self.side * jnp.maximum(self.side * (self.stretch - moved), self.side)
        # A step of the search may take away the whole specimen.
        stretch = jnp.maximum(stretch, 0.05)
        h = jnp.log(stretch)
        tau_1, tau_2 = kirchhoff(law, h, self.ratio * h)
        cauchy = self.c1 * tau_1 + self.c2 * tau_2
        return cauchy / stretch**self.power + force * stretch ** (1.0 - self.power)


def can_be_freed(test: object) -> bool:
    """Whether a test is one of a single stretch with a stress reading."""
    if not isinstance(test, StressTest) or test.follows_history:
        return False
    return test.mode in PATHS and test.measure in POWERS


def smoothed(test: StressTest, values: np.ndarray) -> np.ndarray:
    """Values along a test without their scatter, by specimen.

    A stiffness that is a polynomial in the stretch, times the stress of a neo-Hookean solid,
    and a constant; relative deviations count, for near rest little stress moves much.
    """
    found = np.array(values, float)
    for rows in series_of(test):
        x, y = test.stretch_1[rows], values[rows]
        degree = min(_DEGREE, len(rows) // 8)
        if degree < 1 or np.ptp(x) == 0.0:
            continue
        unit = test.unit_stress[rows]
        middle = (x - x.mean()) / np.ptp(x)
        basis = unit[:, None] * np.polynomial.chebyshev.chebvander(2.0 * middle, degree)
        basis = np.column_stack([np.ones(len(x)), basis])
        weight = 1.0 / np.maximum(np.abs(y), _LEAST * np.max(np.abs(y)))
        solution, *_ = np.linalg.lstsq(basis * weight[:, None], y * weight, rcond=None)
        found[rows] = basis @ solution
    return found


def free_zeros(
    tests: Sequence[StressTest], numbers: Sequence[int], zeros: Sequence[Zero]
) -> FreeZero:
    """Tests of one stretch, at `numbers` among those of the fit, with free zeros."""
    rows, which = [], []
    for test, number in zip(tests, numbers, strict=True):
        # Of a stretch whose logarithm is one.
        _, along, first, second = mode_factors(PATHS[test.mode], np.exp(np.ones(1)))
        power = POWERS[test.measure]
        side = 1.0 if np.sum(np.log(test.stretch_1)) >= 0.0 else -1.0
        force = smoothed(test, test.value * test.stretch_1 ** (power - 1.0))
        constants = np.array([along[0], first[0], second[0], power, side])
        of_each = np.repeat(constants[:, None], test.size, axis=1)
        rows.append(np.concatenate([test.stretch_1[None], force[None], of_each]))
        of_test = np.full((len(KINDS), test.size), len(zeros))
        for position, zero in enumerate(zeros):
            own = np.full(test.size, zero.test == number)
            if zero.kind != "machine":
                own &= test.specimen == zero.specimen
            of_test[KINDS.index(zero.kind), own] = position
        which.append(of_test)
    readings, places = np.concatenate(rows, axis=1), np.concatenate(which, axis=1)
    fills = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0)
    columns = [padded(row, fill) for row, fill in zip(readings, fills, strict=True)]
    padding = ((0, 0), (0, len(columns[0]) - places.shape[1]))
    positions = jnp.asarray(np.pad(places, padding, constant_values=len(zeros)))
    names = ("stretch", "nominal", "ratio", "c1", "c2", "power", "side")
    by_name = dict(zip(names, columns, strict=True))
    return FreeZero(**by_name, which=positions, zeros=jnp.zeros(len(zeros)))


CERTAIN = 5.0
"""Standard errors beyond which a pattern of a curve is not scatter."""
# A toe begins with a slope that is lower by this share than the steepest.
_STEEPER = 0.25
# ... and has ended at this share of the largest stress.
_TOE_ENDS = 0.4


def idle(x: np.ndarray, y: np.ndarray, largest: float) -> float | None:
    """Where a slack specimen begins to carry; None if it does so at once.

    Before that, stresses y scatter about zero and do not rise; behind it they do. x: logarithms
    of the stretches; both positive away from rest.
    """
    order = np.argsort(x, kind="stable")
    x, y = x[order], y[order]
    flat = np.flatnonzero(np.abs(y) > 0.02 * largest)
    end = int(flat[0]) if flat.size else 0
    while end >= 4:
        # Readings before must not rise as those behind do.
        before = np.polyfit(x[:end], y[:end], 1)[0] if x[end - 1] > x[0] else 0.0
        behind = x[end:] <= x[end] + max(x[end] - x[0], 1e-12)
        if behind.sum() < 2:
            return None
        after = np.polyfit(x[end:][behind], y[end:][behind], 1)[0]
        if before < 0.2 * after and x[end] > 0.02 * x[-1]:
            return float(x[end - 1])
        end = int(0.75 * end)
    return None


def toe_end(x: np.ndarray, y: np.ndarray) -> float | None:
    """Where a curve that grows steeper from rest is steepest; None if it does not.

    Slopes of lines through an eighth of the early readings each; x and y as for `idle`.
    """
    order = np.argsort(x, kind="stable")
    # Against the stretch itself rubber is steepest at rest, until its chains lock.
    x, y = np.expm1(x[order]), y[order]
    early = int(np.argmax(y > _TOE_ENDS * np.max(y)))
    x, y = x[:early], y[:early]
    width = max(len(x) // 8, 4)
    starts = np.arange(0, len(x) - 3, max(width // 2, 1))
    slopes, errors, middles = [], [], []
    for i in starts:
        part = slice(i, i + width)
        if len(x[part]) < 4 or np.ptp(x[part]) <= 0.0:
            continue
        coefficients, covariance = np.polyfit(x[part], y[part], 1, cov="unscaled")
        rest = y[part] - np.polyval(coefficients, x[part])
        slopes.append(float(coefficients[0]))
        errors.append(float(np.sqrt(covariance[0, 0] * np.sum(rest**2) / (len(rest) - 2))))
        middles.append(float(np.mean(x[part])))
    if len(slopes) < 4:
        return None
    # Scatter is judged from all of them: of few readings it is little known.
    scatter = float(np.sqrt(np.mean(np.square(errors))))
    best = int(np.argmax(slopes))
    rise = slopes[best] - slopes[0]
    fall = slopes[best] - min(slopes[best:])
    least = max(CERTAIN * scatter, _STEEPER * slopes[best])
    if best == 0 or rise < least or fall < min(scatter, 0.02 * slopes[best]):
        return None
    return float(np.log1p(middles[best]))


def without_toe(data: Dataset, share: float = 0.0) -> Dataset:
    """A test without its toe.

    `share`: of the largest stress, below which readings are left out; none where the curve is
    steepest at once.
    """
    if not isinstance(data, StressTest) or not can_be_freed(data):
        return data
    keep = np.ones(data.size, dtype=bool)
    for rows in series_of(data):
        x = np.log(data.stretch_1[rows])
        side = 1.0 if np.sum(x) >= 0.0 else -1.0
        end = toe_end(side * x, side * data.value[rows])
        if end is not None:
            keep[rows[side * x < end]] = False
        size = side * data.value[rows]
        if share > 0.0:
            first = int(np.argmax(size >= share * np.max(size)))
            keep[rows[side * x < side * x[first]]] = False
    return data.select(keep) if keep.sum() > 6 else data
