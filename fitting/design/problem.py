"""What a search asks of a skin: its figures as functions of its variables, with derivatives.

Those of places are a section's (`fitting.design.section`) or a pad's (`fitting.design.pad`).
Frequencies and buckling, which have no place, have central differences.
"""

import abc
from collections.abc import Sequence
from dataclasses import replace
from math import inf
from typing import ClassVar, NamedTuple

import numpy as np

from fitting.arrays import Floats
from fitting.datasheet.in_time import buckling_mismatch, motion_figures
from fitting.datasheet.variants import named
from fitting.datasheet.words import PLACED, READ_AT_RATED
from fitting.design.want import BY_DIFFERENCES, OwnLimit, Want
from suas_jax.config import SkinSpec, with_inputs
from suas_jax.config.inputs import given_inputs
from suas_jax.config.tolerance import UncertainQuantity, deviation_of

_LEFT = 0.02  # of the gap of the skin to start from, under the rated force
STEP = 1e-3
"""Of a variable's range, for central differences."""


class Outcome(NamedTuple):
    """Figures of a design."""

    values: dict[str, Floats]  # by key [place]; of figures without a place [1]
    slopes: dict[str, Floats]  # their derivatives by the variables [place, variable]
    found: bool  # whether every state was


def without_crosstalk(keys: Sequence[str], far: np.ndarray) -> np.ndarray:
    """Where crosstalk is zero, for no taxel is far from the contact [key, place].

    `far` are those that are [taxel, place].
    """
    return np.array([[key == "crosstalk"] for key in keys]) & ~far.any(0)


def off_the_wall(want: Want) -> Want:
    """With a limit on the smallest gap under the rated force, where no other holds it open.

    Readings are those of a membrane that passes through the wall: beyond first contact they
    tell what no skin does.
    """
    held = {"min_gap_m": 0.0, "range_N": want.force or inf}
    open_already = any(x.least and x.value >= held.get(x.key, inf) for x in want.limits)
    if open_already or want.figures.isdisjoint(READ_AT_RATED):
        return want
    gap = OwnLimit("min_gap_m", _LEFT * want.spec.geometry.mean_gap, least=True)
    return replace(want, limits=(*want.limits, gap))


class Problem(abc.ABC):
    """The figures that a search asks for."""

    tolerance: ClassVar[float] = 1e-7  # of the goal and the limits, relative
    want: Want  # what is wanted
    rated: float  # the rated force [N]
    grid: tuple[int, int]  # places along the arc and along the axis
    ends: tuple[Floats, Floats]  # first and last place, angle [rad] and a pad's position [m]

    def __init__(self, want: Want) -> None:
        self.want = want = off_the_wall(want)
        self.keys = tuple(key for key in PLACED if key in want.figures)
        self._others = tuple(key for key in BY_DIFFERENCES if key in want.figures)

    def __call__(self, x: Floats) -> Outcome:
        """The figures of a design, of which `x` are the variables, between 0 and 1."""
        outcome = self.placed(np.asarray(x, float))
        return self._with_others(outcome, x) if self._others and outcome.found else outcome

    @abc.abstractmethod
    def placed(self, x: Floats) -> Outcome:
        """The figures that have places."""

    def spec(self, x: Floats) -> SkinSpec:
        """The skin of a design; tolerances stay the same share of its numbers."""
        own, inputs = given_inputs(self.want.spec), {}
        for path, now in self.want.inputs(x).items():
            value, deviation = float(now), deviation_of(own[path])
            if deviation is not None:
                share = abs(value / own[path]) if own[path] else 1.0
                value = UncertainQuantity(value, deviation * share)
            inputs[path] = value
        return with_inputs(self.want.spec.unloaded, inputs).skin

    def _with_others(self, outcome: Outcome, x: Floats) -> Outcome:
        """With figures that have no place."""
        own = self._without_place(x)
        by_x = np.zeros((len(self._others), len(x)))
        for i in range(len(x)):
            step = np.where(np.arange(len(x)) == i, STEP, 0.0)
            change = self._without_place(x + step) - self._without_place(x - step)
            by_x[:, i] = change / (2 * STEP)
        values = dict(zip(self._others, own[:, None], strict=True))
        rows = dict(zip(self._others, by_x[:, None], strict=True))
        found = outcome.found and bool(np.isfinite(own).all())
        return Outcome({**outcome.values, **values}, {**outcome.slopes, **rows}, found)

    def _without_place(self, x: Floats) -> Floats:
        spec = self.spec(x)
        found: dict[str, float] = {}
        if set(self._others) - {"buckling_mismatch"}:
            found, reason = motion_figures(spec)
            if not found:
                raise ValueError(f"limits: {self._others[0]}: {reason}")
        if "buckling_mismatch" in self._others:
            found["buckling_mismatch"] = buckling_mismatch(named(spec))[0]
        return np.array([found[key] for key in self._others])
