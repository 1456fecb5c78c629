"""The test of a whole skin: displacements and oil pressures under known forces."""

import dataclasses

import numpy as np

from fitting.material.data.tables import DataError
from fitting.material.experiments.measurements import Dataset, joined
from fitting.material.experiments.table_reader import Reader
from suas_jax.config import LineLoadSpec, SceneSpec
from suas_jax.config.quantities import DimensionName, parse_quantity


def skin(reader: Reader, scene: SceneSpec) -> Dataset:
    """Displacements and oil pressures of a skin under given forces."""
    lines = [load for load in scene.loads if isinstance(load, LineLoadSpec)]
    if not lines or not any(load.force for load in lines):
        raise DataError(
            f"{reader.table.file}: --scene has no line load; the force of the curve needs a "
            f"[[load]] with angle and force"
        )
    force = reader.column("force")
    if force is None:
        raise reader.need("the force", "force_N")
    readings = [
        (1, "displacement", reader.column("displacement"), reader.column("sigma_displacement")),
        (2, "pressure", reader.column("pressure"), reader.column("sigma")),
    ]
    parts = []
    idle = int(np.sum(force == 0.0))
    if idle:
        reader.warnings.append(f"{idle} rows without force say nothing; left out")
    for direction, name, values, sigma in readings:
        if values is None:
            continue
        if name == "pressure" and not scene.oil.trapped:
            raise DataError(f"{reader.table.file}: a vented skin has no oil pressure to read")
        values = np.where(force == 0.0, np.nan, values)
        size = 0.01 * float(np.nanmedian(np.abs(values)))
        factors = np.zeros((4, len(values)))
        part = reader.finish(
            name,
            np.ones(len(values)),
            np.where(np.isfinite(force), factors, np.nan),
            values,
            companion=np.full(len(values), size),
            direction=direction,
            coordinate=force,
            sigma=_sigma(reader, values, sigma, name),
        )
        parts.append(dataclasses.replace(part, scene=scene))
    if not parts:
        raise reader.need("a reading", "displacement_mm", "oil_pressure_kPa")
    if np.any(parts[0].coordinate < 0.0):
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
