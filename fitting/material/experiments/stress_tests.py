"""Tests of a homogeneous deformation: tension, shear, and the spherical balloon.

Each reading becomes the combination c₁ τ₁ + c₂ τ₂ of Kirchhoff stresses that its test measures
(see `fitting.material.experiments.prediction`), whatever measure the file states.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from fitting.material.experiments.measurements import Channel, Dataset, Predictor
from fitting.material.experiments.prediction import Homogeneous, padded

# Tests in which both stretches are free: no one curve, and nothing to extrapolate to.
_FREE_STATES = frozenset(["biaxial", "biaxial_difference"])
# Relative misfits are relative to no less than these fractions of a file's median
# reading; a difference of two stresses passes through zero without being small itself.
_FLOOR, _FLOOR_DIFFERENCE = 0.01, 0.05
_LABELS = {
    "nominal": "nominal stress",
    "cauchy": "Cauchy stress",
    "second_pk": "second Piola-Kirchhoff stress",
    "shear": "shear stress",
    "difference": "Cauchy stress difference",
    "pressure": "pressure",
}


@dataclasses.dataclass(frozen=True)
class StressTest(Dataset):
    """Stresses or pressures [Pa] read in known homogeneous states."""

    # what was read: "nominal", "cauchy", "second_pk", "shear", "difference" or "pressure"
    measure: str
    coordinate: np.ndarray  # stretch, or the amount of shear, shape [n]
    factors: np.ndarray  # e₁, e₂, c₁, c₂ of each reading, shape [4, n]
    # size of the largest stress read at the same state [Pa], shape [n]; zero where the reading
    # is the only one
    companion: np.ndarray
    direction: np.ndarray  # 1 or 2, of a stress, shape [n]
    time: np.ndarray  # of each reading [s], NaN where not stated, shape [n]

    @property
    def stretch_1(self) -> np.ndarray:
        """λ₁, shape [n]."""
        return np.exp(self.factors[0])

    @property
    def stretch_2(self) -> np.ndarray:
        """λ₂, shape [n]."""
        return np.exp(self.factors[1])

    @property
    def abscissa(self) -> np.ndarray:
        """The coordinate; of a stress difference the second stretch."""
        return self.stretch_2 if self.mode == "biaxial_difference" else self.coordinate

    @property
    def deformation(self) -> np.ndarray:
        """How far each reading is from rest, a number that grows with loading, shape [n]."""
        return np.abs(self.coordinate if self.mode == "simple_shear" else self.factors[0])

    def channels(self) -> tuple[Channel, ...]:
        """Stress in megapascals, or pressure in kilopascals."""
        unit, name = (1e3, "kPa") if self.measure == "pressure" else (1e6, "MPa")
        label = f"{_LABELS[self.measure]} [{name}]"
        return (Channel(np.ones(self.size, bool), unit, label),)

    @property
    def floor(self) -> float:
        """A share of the median reading [Pa]."""
        share = _FLOOR_DIFFERENCE if self.measure == "difference" else _FLOOR
        sizes = np.abs(self.value[self.value != 0.0])
        return share * float(np.median(sizes)) if sizes.size else 1.0

    def own_size(self) -> np.ndarray:
        """Size of the reading or of its companion [Pa].

        The zero stress on a sheet's free edge is as uncertain as the load beside it.
        """
        return np.maximum(np.abs(self.value), self.companion)

    def absolute_scale(self, sets: Sequence[Dataset]) -> np.ndarray:
        """Root-mean-square stress; pressures are compared with pressures [Pa]."""
        own = self.measure == "pressure"
        alike = [
            data.value
            for data in sets
            if isinstance(data, StressTest) and (data.measure == "pressure") == own
        ]
        size = float(np.sqrt(np.mean(np.concatenate(alike) ** 2)))
        return np.full(self.size, size if size > 0.0 else 1.0)

    @property
    def is_curve(self) -> bool:
        """Whether one stretch sets the other."""
        return self.mode not in _FREE_STATES

    def paths(self) -> list[np.ndarray]:
        """Readings of each direction by coordinate; biaxial ones by both stretches."""
        found = []
        for direction in np.unique(self.direction):
            rows = np.flatnonzero(self.direction == direction)
            keys = (self.coordinate[rows],) * 2
            if not self.is_curve:
                keys = (self.stretch_2[rows], self.coordinate[rows])
            found.append(rows[np.lexsort(keys)])
        return found

    @property
    def unit_stress(self) -> np.ndarray:
        """Readings of a neo-Hookean law of unit modulus, shape [n]."""
        e1, e2, c1, c2 = self.factors
        tau_3 = np.exp(-2.0 * (e1 + e2))
        return np.asarray(c1 * (np.exp(2.0 * e1) - tau_3) + c2 * (np.exp(2.0 * e2) - tau_3))

    @property
    def modulus(self) -> float:
        """Neo-Hookean modulus of the least deformed third of the test [Pa]."""
        e1, e2, _, _ = self.factors
        unit, size = self.unit_stress, np.abs(e1) + np.abs(e2)
        near = size <= np.quantile(size, 1.0 / 3.0)
        square = float(np.sum(unit[near] ** 2))
        return float(np.sum(unit[near] * self.value[near])) / square if square else np.nan

    @property
    def states(self) -> np.ndarray:
        """Logarithms of both stretches, shape [2, n]."""
        return self.factors[:2]

    def predictor(self, *, estimate: bool) -> Predictor:
        """All homogeneous tests are points of one evaluation."""
        return homogeneous


def homogeneous(tests: Sequence[StressTest]) -> Homogeneous:
    """Homogeneous tests, one after the other, as points of one evaluation."""
    factors = np.concatenate([test.factors for test in tests], axis=1)
    return Homogeneous(*(padded(row) for row in factors))
