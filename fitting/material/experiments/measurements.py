"""Measurements of one file in SI units: what the readings of every kind of test share.

Each kind of test is a subclass of `Dataset` that owns its columns, the size that a misfit is
compared with, and the prediction of its readings by a law. Nominal stress is force over
undeformed area, Cauchy stress force over current area.
"""

import abc
import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple, Self, TypeVar

import numpy as np

from fitting.material.data.errors import DataError
from fitting.material.experiments.prediction import AbstractExperiment
from suas_jax.config.errors import listed, nearest

MODES = (
    "uniaxial",
    "equibiaxial",
    "pure_shear",
    "biaxial",
    "biaxial_difference",
    "simple_shear",
    "balloon",
    "bulge",
    "volumetric",
    "skin",
    "indentation",
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
        arrays: dict[str, Any] = {
            field.name: getattr(self, field.name)[..., keep]
            for field in dataclasses.fields(self)
            if isinstance(getattr(self, field.name), np.ndarray)
        }
        return dataclasses.replace(self, **arrays)


def mode_named(name: str) -> str:
    """The kind of test that a name means.

    Raises DataError: there is no such kind.
    """
    known = _ALIASES.get(name, name)
    if known in MODES:
        return known
    near = nearest(name, MODES)
    hint = f'did you mean "{near}"? ' if near else ""
    raise DataError(f"--data {name}: unknown mode; {hint}allowed: {listed(MODES)}")


def joined(sets: Sequence[Kind]) -> Kind:
    """Readings of several series of one file as one data set."""
    arrays = {
        field.name: np.concatenate([getattr(part, field.name) for part in sets], axis=-1)
        for field in dataclasses.fields(sets[0])
        if isinstance(getattr(sets[0], field.name), np.ndarray)
    }
    dropped: dict[str, int] = {}
    for part in sets:
        for reason, count in part.dropped.items():
            dropped[reason] = dropped.get(reason, 0) + count
    warnings = tuple(dict.fromkeys(text for part in sets for text in part.warnings))
    changes: dict[str, Any] = {**arrays, "dropped": dropped, "warnings": warnings}
    return dataclasses.replace(sets[0], **changes)
