"""Measurements of one file in SI units, by kind of test.

Each kind is a subclass of `Dataset` that owns its columns, the size that a misfit is compared
with, and the prediction of its readings by a law. Nominal stress is force over undeformed area,
Cauchy stress force over current area.
"""

import abc
import collections
import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, ClassVar, NamedTuple, Self, TypeVar

import numpy as np

from fitting.material.data.errors import DataError
from fitting.material.experiments.prediction import AbstractExperiment, Homogeneous, padded
from fitting.material.experiments.scatter import least_size
from suas_jax.config.errors import unknown

MODES = (
    *("uniaxial", "equibiaxial", "pure_shear", "biaxial", "biaxial_difference"),
    *("simple_shear", "balloon", "bulge", "volumetric", "skin", "indentation"),
)
_ALIASES = {
    "planar": "pure_shear",
    "pure-shear": "pure_shear",
    "simple-shear": "simple_shear",
    "biaxial-difference": "biaxial_difference",
}
_ABSCISSAS = {
    "simple_shear": "amount of shear",
    "biaxial_difference": "second stretch",
    "bulge": "apex height / radius",
    "volumetric": "volume ratio",
    "skin": "force [N]",
    "indentation": "travel [mm]",
}
# The mode of suas_jax that a one-parameter test is.
PATHS = {"uniaxial": "uniaxial", "equibiaxial": "equibiaxial", "pure_shear": "planar"}


Kind = TypeVar("Kind", bound="Dataset")


Predictor = Callable[[Sequence[Any]], AbstractExperiment]
"""Makes one prediction of the readings of several tests, one test after the other."""


class Channel(NamedTuple):
    """Readings of one quantity, as a figure draws them."""

    rows: np.ndarray  # which readings, shape [n]
    unit: float  # size of the figure's unit in SI units
    label: str  # name of the quantity with its unit


class Origin(NamedTuple):
    """Where the states and stresses of a test come from."""

    state: str = ""  # quantity that states the deformation, such as "strain"
    column: str = ""  # its name in the file
    unit: str = ""  # its unit; "" for a number
    # of the specimen that a displacement stretches [m]; NaN where not stated
    length: float = math.nan
    area: float = math.nan  # undeformed cross-section [m²]; NaN where not stated
    # duration of the loading before the first reading [s]; NaN where not stated
    ramp: float = math.nan
    # force at which the machine set its travel to zero [N]; NaN where not stated
    preload: float = math.nan


@dataclasses.dataclass(frozen=True)
class Dataset(abc.ABC):
    """Readings of one file, one entry per reading (two per row of a biaxial test)."""

    follows_history: ClassVar[bool] = False  # whether a reading depends on those before it
    # most starts of a fit, where readings are costly to predict; None for any
    most_starts: ClassVar[int | None] = None

    mode: str  # kind of test
    file: str  # where the readings come from
    value: np.ndarray  # readings, SI units, shape [n]
    sigma: np.ndarray  # standard deviation of the noise, NaN where not stated, shape [n]
    weight: np.ndarray  # weight in the sum of squares, shape [n]
    specimen: np.ndarray  # name of the specimen of each reading, shape [n]
    line: np.ndarray  # line in the file, shape [n]
    dropped: dict[str, int]  # how many rows were left out, by reason
    warnings: tuple[str, ...]  # what a person should know about this file
    origin: Origin  # columns and sizes behind the states

    @property
    def size(self) -> int:
        """Number of readings."""
        return len(self.value)

    @property
    @abc.abstractmethod
    def abscissa(self) -> np.ndarray:
        """What a figure draws the readings against, shape [n]."""

    @property
    def abscissa_label(self) -> str:
        """Name of the abscissa, with its unit."""
        return _ABSCISSAS.get(self.mode, "stretch")

    @abc.abstractmethod
    def channels(self) -> tuple[Channel, ...]:
        """The quantities that were read."""

    @property
    @abc.abstractmethod
    def floor(self) -> float:
        """Smallest size that a relative misfit is compared with; one for all readings."""

    @abc.abstractmethod
    def own_size(self) -> np.ndarray:
        """Size of each reading or of what was read with it, shape [n]."""

    def relative_scale(self) -> np.ndarray:
        """Size that a relative misfit is compared with: its own, at least the floor [n]."""
        return np.maximum(self.own_size(), self.floor)

    @abc.abstractmethod
    def absolute_scale(self, sets: Sequence["Dataset"]) -> np.ndarray:
        """Root-mean-square reading of the same quantity among data sets, shape [n]."""

    @abc.abstractmethod
    def paths(self) -> list[np.ndarray]:
        """Positions of the readings of each series, in the order in which it deforms."""

    @property
    def is_curve(self) -> bool:
        """Whether each series is one curve: otherwise there is nothing to extrapolate to."""
        return True

    @property
    def order(self) -> np.ndarray:
        """What tells how close readings are along a series, shape [n]."""
        return self.abscissa

    @property
    def model_error(self) -> float:
        """Standard deviation of the forward model's own error, relative to each reading."""
        return 0.0

    @property
    @abc.abstractmethod
    def modulus(self) -> float:
        """Shear modulus that the readings suggest [Pa]; NaN where they don't."""

    @property
    @abc.abstractmethod
    def states(self) -> np.ndarray:
        """Logarithms of λ₁ and λ₂ that the test reaches, shape [2, state]."""

    @abc.abstractmethod
    def predictor(self, *, estimate: bool) -> Predictor:
        """What predicts the readings; tests with equal predictors are predicted together.

        `estimate`: a rough prediction will do where it is much faster.
        """

    def select(self, keep: np.ndarray) -> Self:
        """The readings where `keep` is true."""
        changes: dict[str, Any] = {k: x[..., keep] for k, x in self.arrays().items()}
        return dataclasses.replace(self, **changes)

    def arrays(self) -> dict[str, np.ndarray]:
        """What each reading has, by field [..., n]."""
        return {k: x for k, x in vars(self).items() if isinstance(x, np.ndarray)}


def series_of(data: Dataset) -> Iterator[np.ndarray]:
    """Positions of the readings of each specimen, as the file has them.

    Where their times fall all along, the file was listed from its end.
    """
    time = getattr(data, "time", np.zeros(data.size))
    for specimen in dict.fromkeys(data.specimen):
        rows = np.flatnonzero(data.specimen == specimen)
        steps = np.diff(time[rows])
        yield rows[::-1] if steps.size and np.all(steps < 0) else rows


def mode_named(name: str) -> str:
    """The kind of test that a name means. Raises DataError: there is no such kind."""
    known = _ALIASES.get(name, name)
    if known not in MODES:
        raise DataError(f"--data {name}: {unknown(name, MODES, 'mode')}")
    return known


def joined(sets: Sequence[Kind]) -> Kind:
    """Readings of several series of one file as one data set."""
    parts = [part.arrays() for part in sets]
    changes: dict[str, Any] = {
        key: np.concatenate([own[key] for own in parts], axis=-1) for key in parts[0]
    }
    dropped: collections.Counter[str] = collections.Counter()
    for part in sets:
        dropped.update(part.dropped)
    warnings = tuple(dict.fromkeys(text for part in sets for text in part.warnings))
    return dataclasses.replace(sets[0], **changes, dropped=dict(dropped), warnings=warnings)


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
    """Stresses or pressures [Pa] read in known homogeneous states, balloons among them.

    Whatever measure the file states, a reading is the combination c₁ τ₁ + c₂ τ₂ of Kirchhoff
    stresses; see `fitting.material.experiments.prediction`.
    """

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
        """A share of the median reading, or what the scatter near rest asks for [Pa]."""
        series = series_of(self) if self.is_curve else ()
        return max(self.least_floor, least_size(self.coordinate, self.value, series))

    @property
    def least_floor(self) -> float:
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
