"""The test of a whole skin: displacements and oil pressures under known forces."""

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np

from fitting.material.data.errors import DataError
from fitting.material.experiments.measurements import Channel, Dataset, Predictor, joined
from fitting.material.experiments.skin_curve import SkinCurve, Specimen, specimen
from fitting.material.experiments.table_reader import Reader
from suas_jax.config import LineLoadSpec, SceneSpec
from suas_jax.config.quantities import DimensionName, parse_quantity

DISPLACEMENT, PRESSURE = 0, 1
"""Channels of a skin's readings."""
# Relative misfits are relative to no less than this fraction of a channel's median reading.
_FLOOR = 0.01


@dataclasses.dataclass(frozen=True)
class SkinTest(Dataset):
    """Displacements [m] and oil pressures [Pa] of a skin under known forces.

    Attributes:
        scene: the skin, with the pattern of its loads.
        force: sum of the loads' magnitudes [N], shape [n].
        channel: `DISPLACEMENT` or `PRESSURE`, shape [n].
        smallest: smallest size of a reading of this channel that a relative misfit is
            compared with [m, Pa], shape [n].
    """

    scene: SceneSpec
    force: np.ndarray
    channel: np.ndarray
    smallest: np.ndarray

    @property
    def abscissa(self) -> np.ndarray:
        """The force [N]."""
        return self.force

    @property
    def abscissa_label(self) -> str:
        """Force with its unit."""
        return "force [N]"

    def channels(self) -> tuple[Channel, ...]:
        """Displacement in millimetres, oil pressure in kilopascals."""
        both = ((DISPLACEMENT, 1e-3, "displacement [mm]"), (PRESSURE, 1e3, "pressure [kPa]"))
        return tuple(
            Channel(self.channel == channel, unit, label)
            for channel, unit, label in both
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
        """Readings of each channel by force."""
        found = []
        for channel in np.unique(self.channel):
            rows = np.flatnonzero(self.channel == channel)
            found.append(rows[np.lexsort((self.force[rows],) * 2)])
        return found

    @functools.cached_property
    def as_specimen(self) -> Specimen:
        """The skin's forward model, and what its own material says about sizes."""
        return specimen(self.scene, self.force, self.channel, self.value)

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

    def _curve(self, tests: Sequence[Dataset]) -> SkinCurve:
        assert len(tests) == 1
        return self.as_specimen.curve


def skin(reader: Reader, scene: SceneSpec) -> SkinTest:
    """Displacements and oil pressures of a skin under given forces."""
    scene.require_no_bodies("A skin's curve")
    lines = [load for load in scene.loads if isinstance(load, LineLoadSpec)]
    if not lines or not any(load.force for load in lines):
        raise DataError(
            f"{reader.table.file}: --scene has no line load; the force of the curve needs a "
            f"[[load]] with angle and force"
        )
    force = reader.column("force")
    if force is None:
        raise reader.need("the force", "force_N")
    idle = int(np.sum(force == 0.0))
    if idle:
        reader.warnings.append(f"{idle} rows without force left out")
    columns = (
        (DISPLACEMENT, "displacement", "sigma_displacement"),
        (PRESSURE, "pressure", "sigma"),
    )
    parts = []
    for channel, name, noise in columns:
        values = reader.column(name)
        if values is None:
            continue
        if channel == PRESSURE and not scene.oil.trapped:
            raise DataError(f"{reader.table.file}: a vented skin has no oil pressure to read")
        values = np.where(force == 0.0, np.nan, values)
        sigma = _sigma(reader, values, reader.column(noise), name)
        test = SkinTest(
            **reader.fields(values, sigma),
            scene=scene,
            force=force,
            channel=np.full(len(values), channel),
            smallest=np.full(len(values), _FLOOR * float(np.nanmedian(np.abs(values)))),
        )
        parts.append(reader.kept(test, force))
    if not parts:
        raise reader.need("a reading", "displacement_mm", "oil_pressure_kPa")
    if np.any(parts[0].force < 0.0):
        raise DataError(
            f"{reader.table.file}: a force must be positive: it is the sum of the loads' "
            f"magnitudes, their directions are the scene's"
        )
    return joined(parts)


def _sigma(
    reader: Reader, values: np.ndarray, stated: np.ndarray | None, name: str
) -> np.ndarray:
    """Standard deviation of readings that are no stresses."""
    if stated is not None:
        reader.require_positive(stated, "sigma")
        return stated
    data = reader.table.metadata
    text = reader.noise or data.get("sigma") or data.get("noise")
    if text is None:
        return np.full(len(values), np.nan)
    try:
        if text.strip().endswith("%"):
            return parse_quantity(text, "number") * np.abs(values)
        kind: DimensionName = "length" if name == "displacement" else "stress"
        return np.full(len(values), parse_quantity(text, kind))
    except ValueError as error:
        raise DataError(
            f'{reader.table.file}: noise "{text}" of the {name}: {error}; give "1 %", or '
            f"columns sigma_displacement_mm and sigma_pressure_kPa"
        ) from None
