"""Tests of a whole skin: under known forces, or pressed by a body through known travels."""

import dataclasses
import functools
from collections.abc import Sequence
from typing import ClassVar, TypeVar

import numpy as np

from fitting.material.data.errors import DataError
from fitting.material.experiments.indentation_curve import body_specimen
from fitting.material.experiments.measurements import Channel, Dataset, Predictor, joined
from fitting.material.experiments.prediction import AbstractExperiment
from fitting.material.experiments.scatter import least_size
from fitting.material.experiments.skin_curve import Specimen, specimen
from fitting.material.experiments.table_reader import Reader
from suas_jax.config import BodyLoadSpec, LineLoadSpec, SceneSpec

DISPLACEMENT, PRESSURE = 0, 1
"""Channels of a skin's readings; a body's force takes the place of the displacement."""
# Relative misfits are relative to no less than this fraction of a channel's median reading.
_FLOOR = 0.01

AnySkinTest = TypeVar("AnySkinTest", bound="SkinTest")


@dataclasses.dataclass(frozen=True)
class SkinTest(Dataset):
    """Displacements [m] and oil pressures [Pa] of a skin under known forces."""

    # Every residual is an equilibrium, and the modulus is known from the start.
    most_starts: ClassVar = 4
    READS: ClassVar = (
        (DISPLACEMENT, 1e-3, "displacement [mm]", "rms_m"),
        (PRESSURE, 1e3, "pressure [kPa]", "rms_Pa"),
    )

    scene: SceneSpec  # the skin, with the pattern of its loads
    drive: np.ndarray  # what was set: sum of the loads' magnitudes [N], shape [n]
    channel: np.ndarray  # `DISPLACEMENT` or `PRESSURE`, shape [n]
    # smallest size of a reading of this channel that a relative misfit is compared with [m,
    # Pa], shape [n]
    smallest: np.ndarray

    @property
    def abscissa(self) -> np.ndarray:
        """The force [N]."""
        return self.drive

    def channels(self) -> tuple[Channel, ...]:
        """Displacement in millimetres, oil pressure in kilopascals."""
        return tuple(
            Channel(self.channel == channel, unit, label)
            for channel, unit, label, _ in self.READS
            if (self.channel == channel).any()
        )

    @property
    def floor(self) -> float:
        """Zero: each channel has its own."""
        return 0.0

    def own_size(self) -> np.ndarray:
        """The reading's own size, never less than its channel's smallest [m, Pa]."""
        return np.maximum(np.abs(self.value), self.smallest)

    def absolute_scale(self, sets: Sequence[Dataset]) -> np.ndarray:
        """Root-mean-square displacement and root-mean-square pressure [m, Pa]."""
        scale = np.ones(self.size)
        for rows in self.paths():
            scale[rows] = np.sqrt(np.mean(self.value[rows] ** 2))
        return np.where(scale > 0.0, scale, 1.0)

    def paths(self) -> list[np.ndarray]:
        """Readings of each channel by what was set."""
        found = []
        for channel in np.unique(self.channel):
            rows = np.flatnonzero(self.channel == channel)
            found.append(rows[np.lexsort((self.drive[rows],) * 2)])
        return found

    @functools.cached_property
    def as_specimen(self) -> Specimen:
        """The skin's forward model, and what its own material says about sizes."""
        of_scene = body_specimen if self.scene.bodies else specimen
        return of_scene(self.scene, self.drive, self.channel, self.value)

    @property
    def model_error(self) -> float:
        """The corrected shell's own error."""
        return self.as_specimen.model_error

    @property
    def modulus(self) -> float:
        """Shear modulus that the readings suggest [Pa]."""
        return self.as_specimen.modulus

    @property
    def states(self) -> np.ndarray:
        """The inner face under the largest force, in plane strain, shape [2, 1]."""
        return np.array([[np.log(self.as_specimen.stretch)], [0.0]])

    def predictor(self, *, estimate: bool) -> Predictor:
        """Each skin is predicted alone."""
        return self._curve

    def _curve(self, tests: Sequence[Dataset]) -> AbstractExperiment:
        assert len(tests) == 1
        return self.as_specimen.curve


@dataclasses.dataclass(frozen=True)
class IndentationTest(SkinTest):
    """Forces [N] of a body, and oil pressures [Pa], at known travels [m]; see `SkinTest`."""

    most_starts: ClassVar = 2
    READS: ClassVar = (
        (DISPLACEMENT, 1.0, "force [N]", "rms_N"),
        (PRESSURE, 1e3, "pressure [kPa]", "rms_Pa"),
    )

    @property
    def abscissa(self) -> np.ndarray:
        """The travel [mm]."""
        return 1e3 * self.drive


def skin(reader: Reader, scene: SceneSpec) -> SkinTest:
    """Displacements and oil pressures of a skin under given forces."""
    scene.require_no_bodies("A skin's curve")
    lines = [load for load in scene.loads if isinstance(load, LineLoadSpec)]
    if not lines or not any(load.force for load in lines):
        raise DataError(
            f"{reader.table.file}: --scene has no line load; the force of the curve needs a "
            f"[[load]] with angle and force"
        )
    force = reader.needed("force", "the force", "force_N")
    return _test(SkinTest, reader, scene, force, "displacement")


def indentation(reader: Reader, scene: SceneSpec) -> IndentationTest:
    """Forces and oil pressures of a skin that a body is pressed into by given travels."""
    file = reader.table.file
    pushing = [load for load in scene.loads if load.kind != "pressure"]
    if [load.kind for load in pushing] != ["body"]:
        raise DataError(
            f'{file}: --scene needs one [[load]] with kind = "body", which the force of the '
            f"file is of, and no other load than pressures; it has {len(pushing)}"
        )
    if not isinstance(pushing[0], BodyLoadSpec) or pushing[0].depth is None:
        raise DataError(f'{file}: --scene: give its body a depth, such as depth = "2 mm"')
    travel = reader.column("depth")
    if travel is None:
        travel = reader.needed("displacement", "the travel", "travel_mm", "depth_mm")
    if reader.machine_stiffness is not None:
        what = "the force for --machine-stiffness"
        travel = travel - reader.needed("force", what, "force_N") / reader.machine_stiffness
    off = travel <= 0.0
    if off.any():
        reader.warnings.append(f"{int(off.sum())} rows before first touch left out")
    return _test(IndentationTest, reader, scene, np.where(off, 0.0, travel), "force")


def _test(
    kind: type[AnySkinTest], reader: Reader, scene: SceneSpec, drive: np.ndarray, read: str
) -> AnySkinTest:
    """A test's readings, of the quantity `read` and of oil pressure, under what was set.

    Rows without it, `drive`, say nothing.
    """
    idle = int(np.sum(drive == 0.0))
    if idle and read == "displacement":
        reader.warnings.append(f"{idle} rows without force left out")
    parts = []
    for channel, name in ((DISPLACEMENT, read), (PRESSURE, "pressure")):
        values = reader.column(name)
        if values is None:
            continue
        if channel == PRESSURE and not scene.oil.trapped:
            raise DataError(f"{reader.table.file}: a vented skin has no oil pressure to read")
        values = np.where(drive == 0.0, np.nan, values)
        sizes = np.abs(values[np.isfinite(values)])
        typical = float(np.median(sizes)) if sizes.size else 0.0
        noisy = least_size(drive, values, [np.arange(len(values))])
        test = kind(
            **reader.fields(values, name),
            scene=scene,
            drive=drive,
            channel=np.full(len(values), channel),
            smallest=np.full(len(values), max(_FLOOR * typical, noisy)),
        )
        parts.append(reader.kept(test, drive))
    if not parts:
        own = {"displacement": "displacement_mm", "force": "force_N"}[read]
        raise reader.need("a reading", own, "oil_pressure_kPa")
    if np.any(parts[0].drive < 0.0):
        raise DataError(
            f"{reader.table.file}: a force must be positive: it is the sum of the loads' "
            f"magnitudes, their directions are the scene's"
        )
    return joined(parts)
