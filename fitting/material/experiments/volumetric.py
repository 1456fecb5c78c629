"""Volumetric tests: pressure over the ratio of volumes, all around or by a piston.

A law of an incompressible rubber says nothing about them: they give the bulk modulus beside it.
A piston in a rigid cylinder reads its axial stress, p + (4/3) mu (1 - J) at small strain, which
exceeds the pressure by the share (4/3) mu/K: less than 0.1 % for solid rubber.
"""

import dataclasses

import numpy as np

from fitting.material.experiments.measurements import Channel, Predictor, StressTest
from fitting.material.experiments.table_reader import Reader

# Solid rubber has 1 to 3 GPa; a tenth of that is foam, air in the chamber or a wrong unit.
_SOFT, _STIFF = 1e8, 2e10


@dataclasses.dataclass(frozen=True)
class VolumetricTest(StressTest):
    """Pressures [Pa] over the ratio of volumes J = V/V0, which is the coordinate."""

    @property
    def deformation(self) -> np.ndarray:
        """Change of the volume, shape [n]."""
        return np.abs(1.0 - self.coordinate)

    def channels(self) -> tuple[Channel, ...]:
        """Pressure in megapascals."""
        return (Channel(np.ones(self.size, bool), 1e6, "pressure [MPa]"),)

    @property
    def unit_stress(self) -> np.ndarray:
        """Pressures of a unit bulk modulus, shape [n]."""
        return 1.0 - self.coordinate

    @property
    def modulus(self) -> float:
        """Bulk modulus of all readings alike [Pa]."""
        unit = self.unit_stress
        square = float(unit @ unit)
        return float(unit @ self.value) / square if square else np.nan

    def predictor(self, *, estimate: bool) -> Predictor:
        """There is none. Raises ValueError: always; `fit.bulk_modulus` fits these tests."""
        raise ValueError(
            f"{self.file}: a volumetric test gives the bulk modulus; an incompressible law "
            f"predicts none of its readings"
        )


def volumetric(reader: Reader) -> VolumetricTest:
    """Readings of a volumetric test: pressure over volume ratio, strain or compression."""
    values = reader.column("pressure")
    if values is None:
        values, _ = reader.needed_stress("the pressure", "pressure_MPa", "force_N")
        # That the piston's area does not change is understood.
        reader.warnings[:] = [
            text for text in reader.warnings if "taken as nominal" not in text
        ]
    ratio = _volume_ratio(reader)
    # Pressure reduces the volume, whatever the signs of a file are.
    if np.nansum(values * (ratio - 1.0)) > 0.0:
        if np.nansum(values) > 0.0:
            ratio = 2.0 - ratio
            reader.warnings.append("volumes shrink under pressure: the strain is compression")
        else:
            values = -values
    reader.require_positive(ratio, "volumetric_strain", "no volume would be left")
    thirds = np.log(ratio) / 3.0
    zero = np.zeros(len(values))
    factors = np.stack([thirds, thirds, zero, zero])
    along = {"coordinate": ratio, "strain": ratio - 1.0}
    kept = reader.stress_test(VolumetricTest, "pressure", factors, values, **along)
    modulus = kept.modulus
    if np.isfinite(modulus) and not _SOFT < modulus < _STIFF:
        doubt = (
            f"a bulk modulus of {modulus / 1e6:.3g} MPa is not that of a solid rubber (1 to "
            f"3 GPa): a foam, air in the chamber, or another unit"
        )
        kept = dataclasses.replace(kept, warnings=(*kept.warnings, doubt))
    return kept


def _volume_ratio(reader: Reader) -> np.ndarray:
    """J of each row; under a piston that of its travel."""
    ratio = reader.column("volume_ratio")
    if ratio is not None:
        reader.require_positive(ratio, "volume_ratio")
        return ratio
    for quantity, sign in (("volumetric_strain", 1.0), ("volumetric_compression", -1.0)):
        values = reader.column(quantity)
        if values is not None:
            return 1.0 + sign * values
    known = {quantity for quantity, _ in reader.columns}
    if not known & {"stretch", "strain", "log_strain", "green_strain", "displacement"}:
        raise reader.need("the change of volume", "volume_ratio", "volumetric_strain_%")
    return reader.stretch()
