"""Measurements of one file: what was read, in which state, with which noise, in SI units.

Nominal stress is force over undeformed area, Cauchy stress force over current area. Each
reading becomes the combination c₁ τ₁ + c₂ τ₂ of Kirchhoff stresses that its test measures
(see `fitting.material.experiments.homogeneous`), whatever measure the file states.
"""

import dataclasses
from typing import Any

import numpy as np

from fitting.material.data.tables import DataError
from suas_jax.config import SceneSpec
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
    "skin",
)
_ALIASES = {
    "planar": "pure_shear",
    "pure-shear": "pure_shear",
    "simple-shear": "simple_shear",
    "biaxial-difference": "biaxial_difference",
}
# The mode of suas_jax that a one-parameter test is.
PATHS = {"uniaxial": "uniaxial", "equibiaxial": "equibiaxial", "pure_shear": "planar"}
# Modes in which both stretches are free: no one curve, and nothing to extrapolate to.
ALL_STATES = frozenset(["biaxial", "biaxial_difference"])


@dataclasses.dataclass(frozen=True)
class Dataset:
    """Readings of one file, one entry per reading (two per row of a biaxial test).

    Attributes:
        mode: kind of test.
        file: where the readings come from.
        measure: what was read: "nominal", "cauchy", "second_pk", "shear", "difference"
            or "pressure".
        coordinate: what a plot is drawn against: stretch, shear or relative height.
        stretch_1: λ₁, shape [n]; of a bulge, an estimate at its apex.
        stretch_2: λ₂, shape [n].
        factors: e₁, e₂, c₁, c₂, shape [4, n]; of a bulge, an estimate.
        value: readings [Pa], shape [n].
        companion: largest stress read at the same state [Pa], shape [n].
        sigma: standard deviation of the noise [Pa], NaN where not stated, shape [n].
        weight: weight in the sum of squares, shape [n].
        direction: 1 or 2, shape [n].
        specimen: name of the specimen of each reading, shape [n].
        line: line in the file, shape [n].
        bulge: thickness over radius of the diaphragm, shape [n]; empty otherwise.
        dropped: how many rows were left out, by reason.
        warnings: what a person should know about this file.
        scene: the skin that was tested, with the pattern of its loads; in this mode the
            coordinate is the force [N] and readings are displacements [m] (direction 1)
            or oil pressures [Pa] (direction 2).
    """

    mode: str
    file: str
    measure: str
    coordinate: np.ndarray
    stretch_1: np.ndarray
    stretch_2: np.ndarray
    factors: np.ndarray
    value: np.ndarray
    companion: np.ndarray
    sigma: np.ndarray
    weight: np.ndarray
    direction: np.ndarray
    specimen: np.ndarray
    line: np.ndarray
    bulge: np.ndarray
    dropped: dict[str, int]
    warnings: tuple[str, ...]
    scene: SceneSpec | None = None

    @property
    def size(self) -> int:
        """Number of readings."""
        return len(self.value)

    def select(self, keep: np.ndarray) -> "Dataset":
        """The readings where `keep` is true."""
        arrays: dict[str, Any] = {
            field.name: getattr(self, field.name)[..., keep]
            for field in dataclasses.fields(self)
            if isinstance(getattr(self, field.name), np.ndarray)
            and getattr(self, field.name).shape[-1:] == (self.size,)
        }
        return dataclasses.replace(self, **arrays)


def mode_named(name: str) -> str:
    """The kind of test that a name means.

    Raises:
        DataError: there is no such kind.
    """
    known = _ALIASES.get(name, name)
    if known in MODES:
        return known
    near = nearest(name, MODES)
    hint = f'did you mean "{near}"? ' if near else ""
    raise DataError(f"--data {name}: unknown mode; {hint}allowed: {listed(MODES)}")


def joined(sets: list[Dataset]) -> Dataset:
    """Readings of several directions of one file as one data set."""
    arrays = {
        field.name: np.concatenate([getattr(part, field.name) for part in sets], axis=-1)
        for field in dataclasses.fields(Dataset)
        if isinstance(getattr(sets[0], field.name), np.ndarray)
    }
    dropped: dict[str, int] = {}
    for part in sets:
        for reason, count in part.dropped.items():
            dropped[reason] = dropped.get(reason, 0) + count
    warnings = tuple(dict.fromkeys(text for part in sets for text in part.warnings))
    changes: dict[str, Any] = {**arrays, "dropped": dropped, "warnings": warnings}
    return dataclasses.replace(sets[0], **changes)
